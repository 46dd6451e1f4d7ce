"""Time offset of poses that were paired by interpolation, and its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from ...core.files.records import Record
from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array
from ...errors import InputError
from ...findings import Finding, warn
from ..errors.joint_covariance import Index

SIDES = ("robot", "camera")
# Streams are not interpolated across gaps of more median intervals than this.
MAX_GAP_INTERVALS = 3.0


@dataclass(frozen=True, eq=False)
class Timing(Record):
    """The offset between the clocks that n pose pairs were made with, and what an error of it does to them.

    Model: ``robot_time = camera_time + offset``; an error d of the offset moves pose i of the interpolated side by
    ``xi_i = rate_i d``, xi = (theta, tau) in the convention of the toolkit. It is one number for all poses, known with
    the standard deviation ``std`` (s); 0: taken as exact.
    """

    offset: float
    std: float
    rate: Annotated[Array, "n", 6]  # (n, 6), rad/s and m/s
    side: str  # the interpolated one, "robot" or "camera"

    def __post_init__(self) -> None:
        rate = np.array(as_numbers(self.rate, "rate"))
        if rate.ndim != 2 or rate.shape[1] != 6 or not np.isfinite(rate).all():
            raise InputError(f"Expected `rate` to be finite numbers of shape (n, 6), got shape {rate.shape}.")
        if self.side not in SIDES:
            raise InputError(f"Expected `side` to be robot or camera, got {self.side!r}.")
        if not (np.isfinite(self.offset) and np.isfinite(self.std) and self.std >= 0):
            raise InputError(
                f"Expected a finite offset and a standard deviation >= 0 (s), got {self.offset!r} and {self.std!r}."
            )
        rate.flags.writeable = False
        object.__setattr__(self, "rate", rate)

    def __len__(self) -> int:
        return len(self.rate)

    def rows(self, index: Index) -> Timing:
        """Return the timing of some of the poses; the offset is known as well as before."""
        return Timing(self.offset, self.std, self.rate[index], self.side)

    @property
    def matters(self) -> bool:
        """True if an error of the offset moves any pose."""
        return bool(self.std > 0 and self.rate.any())


@dataclass(frozen=True)
class TimeOffset(Record):
    """The share of the time offset in the covariance of X: a rank-one term ``std^2 g g^T``.

    ``sensitivity`` is g, by how much X moves (theta, tau) per second of offset; ``share`` of the variance of X in the
    direction where the offset matters most is due to it.
    """

    offset: float  # s
    std: float  # s
    side: str
    sensitivity: tuple[float, ...]  # (6,) rad/s, m/s
    share: float

    def _possible(self) -> TimeOffset:
        if len(self.sensitivity) != 6 or self.side not in SIDES or not 0 <= self.share <= 1:
            raise InputError(f"Expected a time offset of one side, with 6 sensitivities, got {self!r:.80}.")
        return self


def warn_left_out(function: str, data: Any) -> None:
    """Warn where ``data`` (PosePairs or Motions) have an offset that ``function`` takes as exact."""
    warn(left_out_of(function, getattr(getattr(data, "poses", data), "timing", None)), stacklevel=3)


def left_out_of(function: str, timing: Timing | None) -> list[Finding]:
    """Report what a function that takes the offset as exact leaves out, if the offset matters."""
    if timing is None or not timing.matters:
        return []
    return [Finding("poses.offset_taken_as_exact", "caution", {"function": function, "std": timing.std})]
