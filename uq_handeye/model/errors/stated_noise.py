"""Noise of poses whose covariances are stated in conventions of other libraries, which depend on the poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol

import numpy as np

from ...core.geometry.conventions import CovarianceReading
from ...core.geometry.se3 import Array
from ...errors import InputError
from .models import PoseNoise


class Pairs(Protocol):
    """Robot and camera poses (n, 4, 4), as `PosePairs` hold them."""

    @property
    def robot(self) -> Array: ...
    @property
    def camera(self) -> Array: ...


@dataclass(frozen=True, eq=False)
class StatedNoise:
    """Covariances of robot and camera poses as they are stated, (6, 6), (n, 6, 6) or (6n, 6n); None is exact.

    ``readings``: how the numbers of a side are read; a side without one is as the toolkit has it.
    """

    ITEM: ClassVar[Literal["pose"]] = "pose"

    robot: Array | None
    camera: Array | None
    readings: Mapping[str, CovarianceReading]

    def at(self, poses: Pairs) -> PoseNoise:
        """Return the noise of these poses, which remembers how it was read."""
        sides = {"robot": self.robot, "camera": self.camera}
        for side, reading in self.readings.items():
            S, T = sides[side], poses.robot if side == "robot" else poses.camera
            if S is None:
                continue
            n = _count(S)
            if n not in (None, len(T)):
                raise InputError(f"Expected the covariance `{side}` to cover {len(T)} poses, got {n}.")
            sides[side] = reading.read(S, T, side)
        return PoseNoise(sides["robot"], sides["camera"], read_as=dict(self.readings))


def _count(S: Array) -> int | None:
    """Number of poses that a covariance is of; None: one serves all."""
    shape = np.shape(S)
    return None if shape == (6, 6) else shape[0] // 6 if len(shape) == 2 else shape[0]
