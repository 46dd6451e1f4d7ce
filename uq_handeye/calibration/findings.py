"""Whether the covariance of a calibration means anything: a rotation that is left open has no first-order one."""

from __future__ import annotations

import numpy as np

from ..errors import DegenerateMotionError
from ..poses.motions import Motions
from ..poses.residuals import rotation_angles
from .result import Calibration

# A first-order covariance of a rotation means nothing beyond this standard deviation.
UNDETERMINED = np.radians(20.0)


def require_determined(result: Calibration, motions: Motions) -> None:
    """Raise `DegenerateMotionError` with the result where its rotation is left open."""
    if (weakest := result.weakest_rotation) is None or weakest[1] <= UNDETERMINED:
        return
    axis, deviation = weakest
    directions = np.zeros((1, 6))
    directions[0, :3] = axis
    raise DegenerateMotionError(
        f"With this noise the motions do not determine X by method {result.method!r}: its rotation about "
        f"({', '.join(f'{x:.3f}' for x in axis)}) in the frame of `A` has a first-order standard deviation of "
        f"{np.degrees(deviation):.0f} degrees. {_advice(result.method, motions)}",
        directions,
        partial=result,
    )


def _advice(method: str, motions: Motions) -> str:
    smallest = float(np.degrees(rotation_angles(motions.A[..., :3, :3]).min()))
    if method == "shiu" and smallest < 1.0:
        return (
            f"This method counts all motions alike, and one of them turns by {smallest:.2g} degrees only, which leaves "
            "its axis to the noise: leave small rotations out, or use another method."
        )
    return "Add motions that turn about other axes."
