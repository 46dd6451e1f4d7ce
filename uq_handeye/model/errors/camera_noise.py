"""`CameraNoise`, the noise of camera poses without corners whose pixel noise is to be estimated.

The covariance of such poses has a known shape (`shared_errors.camera_noise`). With s the
standard deviation of the pixels of the corners they were made from,

    Sigma(s) = s^2 (blkdiag(own) + F_1 F_1^T) + F_0 F_0^T

F_1 are errors of the intrinsics that come from the same pictures and grow with their noise, F_0 those of another
calibration, which do not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from ...core.files.json_values import JsonObject
from ...core.read_only import ReadOnlyArrays
from ...errors import InputError
from .joint_covariance import Index, JointCovariance
from .keys import INTRINSICS, PIXELS
from .sizes import SIZES, Size
from .term import ErrorTerm


@dataclass(frozen=True, eq=False)
class CameraNoise(ReadOnlyArrays):
    """Covariance of n camera poses, for a standard deviation of one pixel; `camera_noise` makes it.

    It may be the ``noise`` of `calibrate`, or ``camera`` of `PoseNoise`. Where ``pixel_sd`` is None, `calibrate`
    estimates it from the residuals.
    """

    joint: JointCovariance  # for s = 1 pixel
    scales: NDArray[np.bool_]  # (q,) the shared columns that grow with s: F_1; the others are F_0
    pixel_sd: float | None = None  # s in pixels; None: to be estimated
    square: float | None = None  # m, between neighbouring points of the board; None: they have no one distance
    views: JsonObject | None = None  # plain numbers of the board and the camera, of which it was made

    def __post_init__(self) -> None:
        if self.scales.shape != self.joint.shared.shape[-1:] or self.joint.own.ndim != 3:
            raise InputError(f"Expected `scales` to be of the {self.joint.shared.shape[-1]} shared columns of one set.")
        if self.pixel_sd is not None:
            object.__setattr__(self, "pixel_sd", checked_pixels(self.pixel_sd))
        super().__post_init__()

    @property
    def n(self) -> int:
        """Number of poses."""
        return self.joint.n

    @property
    def sides(self) -> dict[str, CameraNoise | None]:
        """Covariances by name, as of `PoseNoise`: that of the robot is not known."""
        return {"robot": None, "camera": self}

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the covariance, (6n, 6n)."""
        return self.joint.shape

    def checked(self, name: str) -> CameraNoise | JointCovariance:
        """Return it as a side of `PoseNoise`, which only the camera may be; Sigma(s) where s is known."""
        if name != "camera":
            raise InputError(f"Expected the covariance `{name}` to be numbers: only `camera` may be a CameraNoise.")
        return self if self.pixel_sd is None else self.covariance().checked(name)

    def covariance(self, pixel_sd: float | None = None) -> JointCovariance:
        """Sigma(s); ``pixel_sd`` None is that which is known."""
        s = self.pixel_sd if pixel_sd is None else pixel_sd
        if s is None:
            raise InputError(
                "The pixel noise of this `camera_noise` is not known: `calibrate` estimates it; elsewhere give "
                "camera_noise(..., pixel_sd=0.2), or take the `noise` of its result."
            )
        shared = self.joint.shared * np.where(self.scales, s, 1.0)
        return JointCovariance(s * s * self.joint.own, shared, self.joint.keys)

    def rows(self, index: Index) -> CameraNoise:
        """Return the noise of some of the poses."""
        return replace(self, joint=self.joint.rows(index))

    def terms(self) -> tuple[ErrorTerm, ...]:
        """Return the errors of the camera poses: those that grow with the pixel noise, and those that do not."""
        size = SIZES[PIXELS] if self.pixel_sd is None else Size(self.pixel_sd, 1.0, "px", "declared")
        keys, F, fixed = [key or INTRINSICS for key in self.joint.keys], self.joint.shared, ~self.scales
        own = np.asarray(np.linalg.cholesky(self.joint.own))
        grown = ErrorTerm(PIXELS, "camera", size, F[..., self.scales], own, tuple(compress(keys, self.scales)))
        if not fixed.any():
            return (grown,)
        rest = tuple(compress(keys, fixed))
        return grown, ErrorTerm(INTRINSICS, "camera", Size(1.0), columns=F[..., fixed], keys=rest)


def checked_pixels(value: float | str) -> float:
    """A standard deviation in pixels, a number or text such as "0.2px"."""
    try:
        s = float(str(value).strip().removesuffix("px"))
    except ValueError:
        s = float("nan")
    if not 1e-6 <= s <= 100.0:
        raise InputError(
            f"Expected `pixel_sd` (--pixel-noise) to be a standard deviation in pixels such as 0.2, got {value!r}."
        )
    return s
