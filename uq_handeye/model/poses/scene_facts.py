"""`SceneFacts`: what is known of the pictures of a scene that camera poses come from."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar

from ...core.files.records import Record
from ...errors import InputError

_BASE64 = re.compile(r"[A-Za-z0-9+/]*=*")


@dataclass(frozen=True)
class SceneView(Record):
    """A small copy of a picture with some of the points that it shows."""

    name: str
    width: int
    height: int
    jpeg: str  # base64
    at: tuple[float, ...]  # x, y of one point after the other, px of the copy

    def _possible(self) -> SceneView:
        if not _BASE64.fullmatch(self.jpeg) or len(self.at) % 2:  # it is set into pages as it is
            raise InputError(f"Expected a picture as base64 and pixels in pairs, got {self!r:.80}.")
        return self


@dataclass(frozen=True)
class SceneFacts(Record):
    """Numbers of a scene without a board, whose camera poses have a scale of their own."""

    _if_any: ClassVar[str] = "image_size known"

    pictures: int  # given
    points: int
    per_picture: float  # points that a picture shows, on average
    pixel_noise: float  # of a feature, px
    focal: float  # px
    focal_sd: float  # px
    lens: tuple[float, ...] = ()  # fx, fy, cx, cy, k1, k2, p1, p2 of the model brown
    lens_sd: tuple[float, ...] = ()  # 0: given
    views: tuple[SceneView, ...] = ()
    image_size: tuple[int, ...] = ()  # width, height
    known: str = ""  # its points and their descriptors, by which later pictures are placed in it
