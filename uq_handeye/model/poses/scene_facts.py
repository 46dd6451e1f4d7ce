"""`SceneFacts`: what is known of the pictures of a scene that camera poses come from."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.files.records import Record


@dataclass(frozen=True)
class SceneFacts(Record):
    """Numbers of a scene without a board, whose camera poses have a scale of their own."""

    pictures: int  # given
    points: int
    per_picture: float  # points that a picture shows, on average
    pixel_noise: float  # of a feature, px
    focal: float  # px
    focal_sd: float  # px
