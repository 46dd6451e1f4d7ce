"""New views of a rig compared with its result: columns of moves and causes of each camera, target and base.

Every camera, target and base is tried as the one that moved, every camera as one whose focal length or image centre
changed, every target as one of another size, and the view that fits least as the only wrong one (`causes`, `judged`).
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable

import numpy as np

from ...calibration.evidence.new_views import RigEvidence, evidence_of_views
from ...calibration.rig_poses import RigPoses
from ...core.geometry.se3 import Array
from ...fit.diagnostics.paths import moments_of
from ...fit.graph.rows import PredictiveReference
from ...model.poses.pose_pairs import PosePairs
from ...model.rig.description import Rig
from ...model.shared_errors.shared_error import SharedError
from .causes import CAMERA_MOVED, FOCAL_LENGTH, IMAGE_CENTRE, ONE_POSE, TARGET_MOVED, TARGET_SIZE, Candidate
from .judged import Compared


def compared_views(
    result: RigPoses, rig: Rig, same: Iterable[str] | str | None = None
) -> tuple[Compared, RigEvidence, tuple[Hashable, ...]]:
    """Compare new views with a calibrated rig; return also the evidence, and the names of moments in order of time.

    Parameters
    ----------
    result : RigCalibration
    rig : Rig
        New robot poses and views, with names and carriers of the calibrated rig; some of its parts may be missing.
    same : names of arms, cameras and targets, or None
        Which of them are those of the calibration, so that their errors are the same; also robot, camera and target for
        all of a kind, or none. None: all.

    Raises
    ------
    InputError
        Names or carriers that the calibrated rig does not have.
    """
    found = evidence_of_views(result, rig, same)
    moment, names = moments_of(rig, found.graph)

    def reference(columns: Array | None) -> PredictiveReference:
        size = found.dof if columns is None else int(np.linalg.matrix_rank(columns[:, 0]))
        return _reference(found, max(size, 1))

    moved = {name: found.moved(name) for name in _seen(found)}
    causes = lambda: _candidates(result, rig, found)  # noqa: E731
    return Compared(found.rows, found.dof, reference, moved, causes, moment[found.edges]), found, names


def _candidates(result: RigPoses, rig: Rig, found: RigEvidence) -> list[Candidate]:
    """Return the causes of each camera, target and base that was seen, and the view that fits least as a wrong one."""
    graph, candidates = found.graph, list[Candidate]()
    pairs = PosePairs(np.broadcast_to(np.eye(4), graph.C.shape), graph.C, "eye-in-hand")
    F_focal, F_centre, F_size = (
        error.at(pairs)
        for error in (SharedError.focal_length(1.0), SharedError.principal_point(1.0), SharedError.target_scale(1.0))
    )
    for name in _seen(found):
        u = graph.names.index(name)
        axes, columns = result.poses[u][:3, :3], found.moved(name)
        if name in rig.cameras:
            of = np.equal(graph.X, u)[:, None, None]
            candidates += [
                Candidate(CAMERA_MOVED, columns, axes, of=name),
                Candidate(FOCAL_LENGTH, found.changed(F_focal * of), of=name),
                Candidate(IMAGE_CENTRE, found.changed(F_centre * of), of=name),
            ]
        else:
            candidates.append(Candidate(TARGET_MOVED, columns, axes, of=name))
            if name in rig.targets:
                size = found.changed(F_size * np.equal(graph.W, u)[:, None, None])
                candidates.append(Candidate(TARGET_SIZE, size, of=name))
    if graph.E >= 3:  # one wrong view can be separated from a change
        candidates.append(_wrong_view(rig, found))
    return candidates


def _wrong_view(rig: Rig, found: RigEvidence, tried: int = 12) -> Candidate:
    """Return the view that explains most as the only wrong one, of those ``tried`` whose residuals are largest."""
    graph = found.graph
    squares = np.bincount(found.edges, found.rows.r[:, 0] ** 2, graph.E)

    def columns(e: int) -> Array:
        F = np.zeros((graph.E, 6, 6))
        F[e] = np.eye(6)
        return found.changed(F)

    most = np.argsort(-squares)[:tried].tolist()
    worst = max(most, key=lambda e: found.rows.explained_by(columns(e)).gain)
    view = rig.views[graph.view[worst]]
    at = "" if view.at is None else f" at robot pose {view.at[graph.row[worst]]}"
    return Candidate(ONE_POSE, columns(worst), choices=graph.E, of=f"of {view.target} by {view.camera}{at}")


def _seen(found: RigEvidence) -> list[str]:
    """Names of the poses that the new views depend on."""
    graph = found.graph
    numbers = np.unique(np.concatenate([graph.X, graph.W, *graph.base]))
    return [graph.names[k] for k in numbers.tolist() if k < graph.m]


def p_of_pair(found: RigEvidence, rig: Rig, camera: str, target: str) -> float:
    """p-value of the views of one pair by themselves."""
    views = [k for k, view in enumerate(rig.views) if (view.camera, view.target) == (camera, target)]
    of = np.isin(found.graph.view, views)[found.edges]
    some = found.rows.rows(of)
    return _reference(found, int(of.sum())).p_value(some.d2)


def _reference(found: RigEvidence, size: int) -> PredictiveReference:
    """Distribution of d^2 of ``size`` numbers, at the points of the sizes of the noise."""
    return PredictiveReference(size, found.weights, found.scales, np.full(len(found.scales), float(size)))
