"""What the accuracy of the robot may do to X, where the poses are local and nothing is declared about it.

Errors of the kinematics are nearly the same in all poses of one region: the residuals do not show them, and X takes
them up. With the gain ``K_i = -C J_i^T S^-1 D_i`` of the estimate an error field with the columns F (`accuracy_field`)
moves X by ``sum_i K_i F_i z``, z ~ N(0, I); an accuracy as many arms have it is taken.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..findings import Finding
from ..geometry.se3 import Array
from ..likelihood.gauss_helmert import Fit
from ..noise.square_roots import pulled, whiten
from ..poses.pose_pairs import PosePairs
from ..shared_errors.accuracy_field import deviations, field_columns
from ..shared_errors.shared_error import CLOCK_OFFSET, ROBOT_SCALE, SharedError

# Accuracy (m, rad) of an arm of which nothing is known, and the factor on the stated deviations from which on what it
# does to X is a caution.
TYPICAL = (0.5e-3, np.radians(0.05))
CLEARLY = 3.0
# Poses are local where no two of their positions are farther apart than this share of the largest distance from the
# base.
LOCAL = 0.75
# Poses among which the largest distance is looked for.
_LOOKED_AT = 500


def accuracy_findings(
    poses: PosePairs | None, shared: tuple[SharedError, ...], fit: Fit, covariance: Array, estimated: bool
) -> list[Finding]:
    """One finding for local poses whose noise is estimated, with the default errors and no others of the robot.

    None of simulated poses, whose robot is as it was simulated, nor of poses with joints, which say more of the arm.
    """
    of_robot = any(e.side == "robot" and e.name not in (ROBOT_SCALE, CLOCK_OFFSET) for e in shared)
    by_default = any(error.default for error in shared)
    if poses is None or poses.truth is not None or fit.W is None or fit.opened is not None:
        return []
    if not estimated or not by_default or of_robot or poses.joints is not None:
        return []
    span, angle, reach = extent(poses.robot)
    if not 0 < span < LOCAL * reach:
        return []
    S = moved_by(fit, poses, *TYPICAL)
    move, turn = (float(np.sqrt(np.linalg.eigvalsh(S[part, part])[-1])) for part in (slice(3, 6), slice(3)))
    sd_move, sd_turn = (
        float(np.sqrt(np.linalg.eigvalsh(covariance[part, part])[-1])) for part in (slice(3, 6), slice(3))
    )
    clear = move > CLEARLY * sd_move or turn > CLEARLY * sd_turn
    values = {
        "span": span, "angle": angle, "move": move, "turn": turn, "sd_move": sd_move, "sd_turn": sd_turn,
        "accuracy_move": TYPICAL[0], "accuracy_turn": TYPICAL[1],
    }  # fmt: skip
    return [Finding("calibration.robot_undeclared", "caution" if clear else "note", values)]


def extent(T: Array) -> tuple[float, float, float]:
    """Largest distance and angle between two of the poses, and largest distance from the base (m, rad)."""
    some = T[np.linspace(0, len(T) - 1, min(len(T), _LOOKED_AT)).astype(int)]
    t = some[:, :3, 3]
    span = float(np.sqrt(np.max(np.sum((t[:, None] - t) ** 2, axis=-1))))
    q = Rotation.from_matrix(some[:, :3, :3]).as_quat()
    angle = 2.0 * float(np.arccos(np.clip(np.abs(q @ q.T).min(), 0.0, 1.0)))
    return span, angle, float(np.linalg.norm(t, axis=-1).max())


def moved_by(fit: Fit, poses: PosePairs, translation: float, rotation: float) -> Array:
    """(6, 6) covariance of the move of X by the field of an accuracy (m, rad), as the fit is weighted."""
    columns = field_columns(poses.robot, deviations(translation, rotation), None)[1]
    factor = fit.weighted_factor
    back = pulled(factor, whiten(factor, fit.linear.J))  # S^-1 J
    moves = np.einsum("nri,nrk->ik", back, fit.linear.sides[0] @ columns(poses.robot))
    E = (fit.covariance @ moves)[:6]
    return np.asarray(E @ E.T)
