"""What did not stand still: a step in time of the camera or the target of poses side by side.

The poses are a rig of one view (`rig.single`), whose paths in time are tested with the noise and the weights of the fit
(`rig.checks.paths`): from one pose on, the camera or the target is elsewhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DegenerateMotionError, NotConvergedError, SingularNoiseError
from ..findings import Finding
from ..fit.likelihood.gauss_helmert import Fit
from ..model.noise.joint_covariance import JointCovariance
from ..model.noise.models import PoseNoise, is_joint
from ..model.poses.pose_pairs import PosePairs
from ..rig.checks.paths import judged_paths
from ..rig.fit import Task, fit
from ..rig.graph import Graph
from ..rig.noise import RigNoise
from ..rig.single import rig_of_poses

# A step is looked for in this many poses, evenly spread over longer recordings.
MAX_POSES_FOR_MOVES = 1000


def moves(poses: PosePairs, noise: PoseNoise, of: Fit) -> list[Finding]:
    """Return the finding about a camera or target that did not stand still; none where nothing moved, or X is open.

    Parameters
    ----------
    poses : n pairs of poses
    noise : of these poses
    of : the fit of the poses with the noise, and its robust weights
    """
    if of.W is None or of.open is not None or poses.n < 2:
        return []
    rows = np.unique(np.linspace(0, poses.n - 1, min(poses.n, MAX_POSES_FOR_MOVES)).round().astype(np.intp))
    weights = np.ones(poses.n) if of.weights is None else of.weights
    some = poses.rows(rows)
    rig = rig_of_poses(some)
    graph = Graph.of(rig)
    order = np.array([int(row) for row in rig.arms[poses.names.arm].names], dtype=np.intp)
    task = Task(rig, graph, {}, "efficient", True, True, 0)
    try:
        found = fit(
            graph, _noise_of(noise.rows(rows), some.n, order), np.stack([of.X, of.W]), "efficient", weights[rows][order]
        )
        findings = judged_paths(task, found)[1]
    except (NotConvergedError, DegenerateMotionError, SingularNoiseError, np.linalg.LinAlgError):
        return []  # the rest of the poses does not determine a step
    return [_with_rows(one, rows) for one in findings if one.code == "rig.moved"]


def _with_rows(finding: Finding, rows: NDArray[np.intp]) -> Finding:
    """Return the finding with rows of the poses in place of names of robot poses."""

    def of_row(path: Mapping[str, Any]) -> dict[str, Any]:
        return {**path, "since": int(rows[int(path["since"])])}

    values = of_row(finding.values)
    return Finding(finding.code, finding.severity, values | {"others": [of_row(one) for one in values["others"]]})


def _noise_of(noise: PoseNoise, n: int, order: NDArray[np.intp]) -> RigNoise:
    """Noise of the graph: each pose's own, and the columns of the errors that poses share."""
    robot, camera = (_joint(S, n) for S in (noise.robot, noise.camera))
    of_robot = [robot.shared, np.zeros_like(camera.shared)]
    of_camera = [np.zeros_like(robot.shared), camera.shared]
    K_robot, K_camera = (np.concatenate(columns, axis=-1)[order] for columns in (of_robot, of_camera))
    return RigNoise(robot.own[order], camera.own[order], K_robot, K_camera)


def _joint(S: Any, n: int) -> JointCovariance:
    """Noise of one side as blocks of each pose and columns; of a full covariance (6n, 6n) by its eigenvectors."""
    if isinstance(S, JointCovariance):
        return S
    if S is None or not is_joint(S):
        own = np.broadcast_to(np.zeros((6, 6)) if S is None else np.asarray(S), (n, 6, 6))
        return JointCovariance(own, np.zeros((n, 6, 0)))
    values, vectors = np.linalg.eigh(np.asarray(S))
    least = max(float(values[0]), 0.0)
    columns = vectors * np.sqrt(np.maximum(values - least, 0.0))
    return JointCovariance(np.tile(least * np.eye(6), (n, 1, 1)), columns.reshape(n, 6, 6 * n))
