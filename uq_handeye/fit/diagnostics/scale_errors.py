r"""Errors that all rows share (focal length, target scale, robot scale): what they do to X, and whether they show.

Model: a `Fit`, in the notation of `diagnostics`. The relative error s of a length that all rows share adds ``k s`` to
r. It moves X by ``-C J^T S^-1 k s``; as one more unknown it is estimated by ``s = k' . r' / |k'|^2`` with the standard
deviation ``1 / |k'|``, where k' is the whitened k less what X and W can explain of it (a score test). The lengths are
those of the poses as the fit corrects them, whose noise is independent of r. Columns of errors that were declared are
in S: the score of another is beside theirs.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ...core.files.records import Record
from ...core.geometry.se3 import Array
from ...findings import Finding
from ...model.noise.square_roots import Factor, whiten
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ...model.shared_errors.shared_error import FOCAL_LENGTH, ROBOT_SCALE, TARGET_SCALE
from ..likelihood.gauss_helmert import Fit
from ..likelihood.shared_estimates import SIGNAL
from .residual_patterns import RARE, Autocorrelation

# Estimates of a scale error beyond so many standard deviations are findings.
SCORE = 4.0
# The error whose effect is stated.
SCALE = 1e-3

PROBED = (FOCAL_LENGTH, TARGET_SCALE, ROBOT_SCALE)


@dataclass(frozen=True, eq=False)
class ScaleError(Record):
    """A relative error that all rows share: what 0.1 % of it does to X, and what the residuals say about it."""

    name: str
    reason: Finding | None  # why its effect is not known
    shift: Annotated[Array, 6]  # (6,) of X for 0.1 %, rad and m
    shift_sd: float  # sqrt(shift^T C_XX^-1 shift): in standard deviations of X
    visible: bool  # whether residuals can show it at all
    estimate: float  # relative error of the lengths as given
    sd: float
    z: float
    covered: bool  # the noise holds it: declared, or the focal length estimated with the camera poses

    @property
    def asked_for(self) -> bool:
        """True if the residuals indicate it beyond chance."""
        return not self.covered and self.visible and abs(self.z) > SCORE


def inflation(found: Autocorrelation) -> float:
    """Factor on the standard deviations of the estimates below; 1 where no correlation was found."""
    if found.p_value is None or found.factor is None or found.p_value >= RARE:
        return 1.0
    return float(np.sqrt(max(found.factor, 1.0)))


def shared_lengths(
    first: Array, second: Array, data: PosePairs | Motions, poses: PosePairs | None, on_poses: bool
) -> dict[str, tuple[int, Array] | None]:
    """Side and change of its translations (n, 3) for a relative error 1; None where it is not known.

    ``first`` and ``second`` are the poses (motions) of robot and camera, corrected by the fit.
    """
    depth: Array | None = None
    if on_poses:
        depth = second[:, :3, 3] * np.array([0.0, 0.0, 1.0])
    elif poses is not None and isinstance(data, Motions) and data.pairs is not None:
        along = poses.camera[:, :3, 3] * np.array([0.0, 0.0, 1.0])
        i, j = data.pairs.T
        depth = along[j] - (second[:, :3, :3] @ along[i, :, None])[..., 0]
    return {
        FOCAL_LENGTH: None if depth is None else (1, depth),  # the distances from camera to target
        TARGET_SCALE: (1, second[:, :3, 3]),
        ROBOT_SCALE: (0, first[:, :3, 3]),
    }


def scale_errors(
    fit: Fit,
    factor: Factor,
    white: Array,
    lengths: dict[str, tuple[int, Array] | None],
    inflation: float,
    covered: Collection[str] = (),
) -> tuple[ScaleError, ...]:
    """Return the effect and the visibility of each of the ``lengths``; ``covered`` are those that the noise holds."""
    C, J, r = fit.covariance, white[..., :-1], white[..., -1]
    known = {name: value for name, value in lengths.items() if value is not None}
    changes = [(fit.linear.sides[side][..., 3:] @ change[..., None]) for side, change in known.values()]
    k = whiten(factor, np.concatenate(changes, axis=-1))  # (n, 6, probes)
    response = -C @ (J.reshape(-1, len(C)).T @ k.reshape(J.shape[0] * 6, -1))
    rest = k + J @ response
    before, after = (np.sum(x**2, axis=(0, 1)) for x in (k, rest))
    to_unit = np.linalg.inv(np.linalg.cholesky(C[:6, :6]))
    found: list[ScaleError] = []
    for name, value in lengths.items():
        if value is None:
            reason = Finding("diagnostics.scale_unknown", "note", {"name": name})
            found.append(ScaleError(name, reason, np.zeros(6), 0.0, False, 0.0, 0.0, 0.0, name in covered))
            continue
        m = list(known).index(name)
        shift = SCALE * response[:6, m]
        size = float(np.linalg.norm(to_unit @ shift))
        if not after[m] > max(1e-9 * before[m], SIGNAL * 3 * len(r)):
            found.append(ScaleError(name, None, shift, size, False, 0.0, 0.0, 0.0, name in covered))
            continue
        estimate, sd = float(np.sum(rest[..., m] * r) / after[m]), inflation / float(np.sqrt(after[m]))
        found.append(ScaleError(name, None, shift, size, True, estimate, sd, estimate / sd, name in covered))
    return tuple(found)
