"""`CameraScale`: the unit of camera poses whose scale is not known, as of visual SLAM or structure from motion."""

from __future__ import annotations

from dataclasses import dataclass

from ...core.files.records import Record
from ...errors import InputError

UNKNOWN = "unknown"


@dataclass(frozen=True)
class CameraScale(Record):
    """Length in metres of one unit of the camera poses, estimated with a flat prior.

    ``factor``: the translations of the camera poses were multiplied by it; new ones of the same scene need it, too.
    """

    factor: float  # m per unit
    std: float  # of the factor

    def _possible(self) -> CameraScale:
        if not (self.factor > 0 and self.std >= 0):
            raise InputError(f"Expected a scale above 0 with a standard deviation, got {self!r:.80}.")
        return self

    @property
    def units_per_m(self) -> float:
        """Number of units of the camera poses in one metre."""
        return 1.0 / self.factor
