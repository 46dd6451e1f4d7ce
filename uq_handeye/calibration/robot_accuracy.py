"""Possible effect of the robot's accuracy on X, where the poses are local and nothing is declared about it.

Errors of the kinematics are nearly the same in all poses of one region: the residuals do not show them, and X takes
them up. An accuracy as many arms have it, a smooth field over the pose (`accuracy_field`), is carried to X.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..findings import Finding
from ..geometry.se3 import Array
from ..likelihood.carried_errors import carried_moves
from ..likelihood.gauss_helmert import Fit
from ..likelihood.shared_estimates import of_moves
from ..poses.pose_pairs import PosePairs
from ..shared_errors.shared_error import CLOCK_OFFSET, ROBOT_SCALE, SharedError

# Accuracy (m, rad) of an arm of which nothing is known, and the factor on the stated deviations from which on what it
# does to X is a caution.
TYPICAL = (0.5e-3, np.radians(0.05))
CLEARLY = 3.0
# Poses are local where no two of their positions are farther apart than this share of the largest distance from the
# base.
LOCAL = 0.5
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
    typical = SharedError.robot_accuracy(*TYPICAL).bound(poses)
    S = of_moves(carried_moves(fit, typical, poses)[:6])
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
