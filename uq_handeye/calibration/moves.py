"""Search for what did not stand still: a step in time of the camera or the target of poses side by side.

X and W are tested for a step (`graph.steps_in_time`) with the noise and the weights of the fit. Where one is no
chance, or poses in a row are rejected, the poses are taken as a rig of one view (`rig.single`), whose paths say what
moved, from which pose on, and whether a step explains the residuals (`fit.diagnostics.paths`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array
from ..errors import DegenerateMotionError, NotConvergedError, SingularNoiseError
from ..findings import Finding
from ..fit.graph.drifts import MAX_REMAINING_BESIDE_DRIFT
from ..fit.graph.gauss_helmert import Fit
from ..fit.graph.request import Request
from ..fit.graph.steps_in_time import FALSE_FINDING, MIN_RUN, steps_of
from ..model.errors import keys
from ..model.errors.error_estimate import ErrorEstimate
from ..model.errors.joint_covariance import joint_form
from ..model.errors.key import ErrorKey
from ..model.errors.models import PoseNoise
from ..model.errors.sizes import SIZES
from ..model.poses.pose_pairs import PosePairs

if TYPE_CHECKING:
    from ..fit.graph.noise import RigNoise

# Findings of a camera or target that did not stand still.
MOVED, DRIFTS = "rig.moved", "rig.drifts"
_DRIFTS = frozenset(keys.DRIFTS.values())
# A full covariance (6n, 6n) of more poses is not taken apart to look for a step.
MAX_POSES_OF_FULL_COVARIANCE = 200
# A step is looked for in this many poses, evenly spread over longer recordings.
MAX_POSES_FOR_MOVES = 1000


def moves(poses: PosePairs, noise: PoseNoise, of: Fit, shared: Sequence[ErrorEstimate] = ()) -> list[Finding]:
    """Return the finding about a camera or target that did not stand still; none where nothing moved, or X is open.

    Parameters
    ----------
    poses : n pairs of poses
    noise : of these poses
    of : the fit of the poses with the noise, and its robust weights
    shared : the shared errors at the sizes of the noise

    A step makes the estimated drift of a session with timestamps larger, which then explains the step. So where no step
    is found, it is tested with the drift of a usual mount, too.
    """
    full = any(S is not None and np.ndim(S) == 2 and len(S) > 6 for S in noise.sides.values())
    if of.W is None or of.open is not None or (full and poses.n > MAX_POSES_OF_FULL_COVARIANCE):
        return []
    rows = np.unique(np.linspace(0, poses.n - 1, min(poses.n, MAX_POSES_FOR_MOVES)).round().astype(np.intp))
    weights = np.ones(poses.n) if of.weights is None else of.weights
    some = poses.rows(rows)
    order = np.arange(some.n) if some.timestamps is None else np.argsort(some.timestamps, kind="stable")
    weights = weights[rows][order]
    rejected = np.convolve(weights < 0.5, np.ones(MIN_RUN), "valid") if some.n >= MIN_RUN else np.zeros(1)
    found: list[Finding] = []
    try:
        steps = steps_of(of, rows[order])
        likely = min((step.p for step in steps), default=1.0) * len(steps)
        if likely <= FALSE_FINDING or rejected.max() >= MIN_RUN:
            found = _judged(some, of, _noise_of(noise.rows(rows), some.n, order, {}), weights)
        drifts = {one.key.error: one.size for one in shared if one.key.error in _DRIFTS and one.size > 0}
        usual = {key: SIZES[key].median / size for key, size in drifts.items()}
        if not found and min(usual.values(), default=1.0) < 1.0:
            own = _noise_of(noise.rows(rows), some.n, order, usual)
            again = _judged(some, of, own, weights, MAX_REMAINING_BESIDE_DRIFT)
            found = [one for one in again if one.code == MOVED]
    except (NotConvergedError, DegenerateMotionError, SingularNoiseError, np.linalg.LinAlgError):
        return []  # the rest of the poses does not determine a step
    return [_with_rows(one, rows) if one.code == MOVED else one for one in found]


def _judged(
    poses: PosePairs, of: Fit, noise: RigNoise, weights: Array, remaining: float | None = None
) -> list[Finding]:
    """Return what did not stand still in poses, by their rig with this noise; ``remaining`` as in `judged_paths`."""
    from ..fit.diagnostics.paths import MAX_REMAINING_SHARE, judged_paths
    from ..fit.graph.fit import Task, Weights, fit
    from ..fit.graph.graph import Graph
    from ..model.rig.single import rig_of_poses

    rig = rig_of_poses(poses)
    graph = Graph.of(rig)
    parts = [] if of.prior is None else of.prior.parts()
    prior = {start // 6: (mean, information) for _, start, mean, information in parts}
    assert of.W is not None
    found = fit(graph, noise, np.stack([of.X, of.W]), "efficient", Weights(weights, np.ones(graph.P)), prior)
    task = Task(rig, graph, prior, Request(), True)
    findings = judged_paths(task, found, MAX_REMAINING_SHARE if remaining is None else remaining)[1]
    return [one for one in findings if one.code in (MOVED, DRIFTS)]


def _with_rows(finding: Finding, rows: NDArray[np.intp]) -> Finding:
    """Return the finding with rows of the poses in place of names of robot poses."""

    def of_row(path: Mapping[str, Any]) -> dict[str, Any]:
        return {**path, "since": int(rows[int(path["since"])])}

    values = of_row(finding.values)
    return Finding(finding.code, finding.severity, values | {"others": [of_row(one) for one in values["others"]]})


def _noise_of(noise: PoseNoise, n: int, order: NDArray[np.intp], factors: Mapping[ErrorKey, float]) -> RigNoise:
    """Noise of the graph: each pose's own, and the columns of the errors that poses share, smaller by ``factors``."""
    from ..fit.graph.noise import RigNoise

    robot, camera = (joint_form(S, n) for S in (noise.robot, noise.camera))
    of_robot, of_camera = (
        side.shared * [1.0 if key is None else min(1.0, factors.get(key.error, 1.0)) for key in side.keys]
        for side in (robot, camera)
    )
    is_robot = np.arange(of_robot.shape[-1] + of_camera.shape[-1]) < of_robot.shape[-1]
    return RigNoise(robot.own[order], camera.own[order], of_robot[order], of_camera[order], is_robot)
