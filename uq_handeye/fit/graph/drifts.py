r"""Drift in a rig with times: cameras and targets that creep while the poses are taken.

Each camera and each target has a random walk of its own over the moments of the session (`shared_errors.assumed`), in
few terms: their columns are those of errors that its views share. The pose of the result is the mean over the session.
With the numbers z of a drift, ``M = E z z^T`` by their posterior, and its columns F_i at the n views of a camera or
target, the pose at view i is off that mean by ``xi_i = J_i^-1 D_i F_i z``, J_i the derivative by the pose and D_i that
by the errors of the view: as of a moment drawn from the session it has ``n^-1 sum_i E xi_i xi_i^T`` more.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...model.errors.key import Kind, Owner
from ...model.errors.keys import DRIFTS
from ...model.errors.sizes import SIZES
from ...model.errors.term import ErrorTerm
from ...model.rig.description import Rig
from ...model.shared_errors.assumed import drift_columns
from .fit import Place, RigFit
from .graph import VIEWS_TOGETHER, Graph
from .noise import RigNoise

# Kinds of the drifts of a rig.
DRIFT_KINDS = (Kind.CAMERA_DRIFT, Kind.TARGET_DRIFT)
# Fewer moments show no drift; all drifts of a rig have at most this many columns, but one term each.
MIN_MOMENTS_FOR_DRIFT, MAX_DRIFT_COLUMNS = 6, 72
# Where the drift is larger than usual, a step in time is looked for with the usual one, too; beside it another step may
# have this share of its chi-square: a step of 3 mm leaves 0.03 to 0.08, a random walk 0.3 and more.
MAX_REMAINING_BESIDE_DRIFT = 0.2

Rows = dict[str, NDArray[np.bool_]]  # (E,) views of each camera or target, by its name


def drifts_of(graph: Graph, times: Array, walked: Array, cameras: Rows, targets: Rows) -> list[ErrorTerm]:
    """Return the drifts of cameras and targets at views, none where too few moments show any.

    ``times`` (E,): of the views; ``walked`` (n,): moments of the session that the walks go over. The more cameras and
    targets, the fewer terms of the walk: one holds 80 % of its variance, two 90 %.
    """
    if len(walked) < MIN_MOMENTS_FOR_DRIFT:
        return []
    terms, found = int(np.clip(MAX_DRIFT_COLUMNS // (6 * (len(cameras) + len(targets))), 1, 6)), []
    for owner, things in ((Owner.CAMERA, cameras), (Owner.TARGET, targets)):
        F = drift_columns(graph.C, times, owner == Owner.TARGET, walked, terms).rows()
        for name, of in things.items():
            key, columns = DRIFTS[owner].of(name), np.asarray(of[:, None, None] * F)
            keys = tuple(key.number(k + 1) for k in range(F.shape[-1]))
            found.append(ErrorTerm(key, "camera", SIZES[DRIFTS[owner]], columns=columns, keys=keys))
    return found


def times_of(rig: Rig, graph: Graph) -> Array | None:
    """(E,) times of the views; None where their moments are numbers or names."""
    moments = [(rig.views[v].at or ())[k] for v, k in zip(graph.view.tolist(), graph.row.tolist(), strict=True)]
    timed = all(arm.timed for arm in rig.arms.values()) or {*map(type, moments)} == {float}
    return np.array(moments, dtype=float) if timed else None


def motion_in_session(found: RigFit) -> Array:
    """(p, p) covariance of where the drifting poses were at any moment of the session, beside that of their means."""
    graph, noise, p = found.graph, found.noise, found.graph.p
    motion = np.zeros((p, p))
    of_camera = np.flatnonzero(~noise.of_robot)  # numbers of the columns of the camera side among all
    for u, name in enumerate(graph.names):
        of = [c for c, k in enumerate(of_camera) if noise.keys[k].kind in DRIFT_KINDS and noise.keys[k].name == name]
        if not of:
            continue
        z, place = found.z[of_camera[of]], p + of_camera[of]
        M = np.outer(z, z) + found.whole[np.ix_(place, place)]
        edges = np.flatnonzero((u == graph.X) | (u == graph.W))
        edges = edges[np.unique(np.linspace(0, len(edges) - 1, min(len(edges), VIEWS_TOGETHER)).astype(np.intp))]
        sides = Place(found.at, graph.robot, graph.C).sides(graph, edges)
        J = np.where((graph.X[edges] == u)[:, None, None], sides.X, sides.W)
        xi = np.linalg.solve(J, sides.camera @ noise.by_camera[edges][..., of])
        at = slice(6 * u, 6 * u + 6)
        motion[at, at] = np.mean(xi @ M @ xi.mT, axis=0)
    return motion


def with_usual_drift(noise: RigNoise, sizes: Iterable[tuple[str, float]]) -> RigNoise | None:
    """Return the noise with drifts of a usual mount, where larger ones were estimated; None where none was.

    ``sizes``: camera or target, and the size of its drift.
    """
    usual = SIZES[DRIFTS[Owner.CAMERA]].median
    factors = {name: min(1.0, usual / size) for name, size in sizes if size > 0}
    if min(factors.values(), default=1.0) == 1.0:
        return None
    own = [noise.keys[k] for k in np.flatnonzero(~noise.of_robot)]
    scale = np.array([factors.get(key.name, 1.0) if key.kind in DRIFT_KINDS else 1.0 for key in own])
    return replace(noise, by_camera=noise.by_camera * scale)
