r"""Test of the paths of a rig that should agree: which camera or target moved between its views (T18).

A copy of one unknown pose is estimated for some of its views, and its difference d from the pose is tested
(`graph.steps_in_time`), for all errors of the joint model: those that poses share are among the unknowns, and the
rows of one robot pose are whitened together. There are two kinds of copies:

- a camera in its views of one target, or a target in the views by one camera: the cycle through the two closes or not;
- a pose from one moment on: it moved at that moment or not.

*The pose that moved.* Paths are tested with the weights of the fit, except for runs of rejected views: a camera that
was knocked spoils all later views, and robust weights that reject them would hide the move. Single outliers stay
rejected. For every path that does not close, a robust fit is made with the copy of its pose as a further unknown, in
which most views of the pose and of the copy must count: a copy fits any single outlier. The one with the least

    chi-square of the views that count + PENALTY * limit * (views that are rejected)

is named, with those that explain the views nearly as well. Where the residuals are larger than the noise explains even
with the copy, the chi-squares are divided by chi-square over degrees of freedom, so that a noise that was given too
small is not taken for a move.

*A step, a drift or a wander.* A pose that drifts from the first view to the last makes the chi-square of some moment
large, too. So the step is compared with a pose that changes in proportion to the number of the moment,

    d_k = d (k - mean),      columns (k - mean) B_k,

by their chi-squares, each of six numbers: the larger one is named. Other errors that change slowly (the arm's along a
path through the workspace) are neither. A step leaves nothing: with the copy, that of every other step is small, and
likewise with the columns of a drift. A pose is named only where the largest one that is left is below
`MAX_REMAINING_SHARE` of that of the step, or of the drift.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from ...core.files.records import Record
from ...core.geometry.se3 import Array, logarithm, perturb
from ...core.levels import DOUBTFUL as RESOLVED
from ...errors import InputError, NotConvergedError
from ...findings import Finding
from ...model.rig.description import Rig
from ...model.rig.sentences import path_words
from ..graph.fit import RigFit, Task, Weights, White, fit
from ..graph.graph import Graph
from ..graph.noise import RigNoise
from ..graph.request import Request
from ..graph.robust import largest_by_chance
from ..graph.steps_in_time import (
    FALSE_FINDING,
    MIN_MOMENTS,
    MIN_RUN,
    Moments,
    differences,
    largest_step,
    sums_of,
)
from ..graph.weights import fit_robustly

# Two causes cannot be separated where their chi-squares differ by less.
AS_GOOD_CHI_SQUARE = 6.0
# Of the chi-square of a step that is named, the largest share that another one still has once the step is fitted.
MAX_REMAINING_SHARE = 0.4
# A rejected view counts as this many times the largest squared distance that chance makes.
PENALTY = 3.0


@dataclass(frozen=True, eq=False)
class RigPath(Record):
    """Two estimates of one pose by different views, and their difference.

    Attributes
    ----------
    name : str
        Camera, target or arm whose pose has two estimates.
    by : str or None
        Target, or camera, whose views give the one; None: a change in time.
    since : moment or None
        Name of the first robot pose of the other, for a change in time.
    chi_square, dof, p : float
        Test of the difference; p of a change allows for the choice of the moment.
    change : (6,)
        ``(theta, tau)`` of the one minus the other, rad and m.
    covariance : (6, 6)
        Of the change; 0 along directions that are not resolved.
    count : int
        Views that belong to the one, or come after the change.
    """

    _in_file: ClassVar[str] = "name by since chi_square dof p change covariance count"

    name: str
    by: str | None
    since: Hashable
    chi_square: float
    dof: int
    p: float
    change: Annotated[Array, 6]
    covariance: Annotated[Array, 6, 6]
    count: int
    number: int = -1  # of the unknown
    edges: NDArray[np.bool_] | None = None  # (E,) of the copy

    @property
    def moment(self) -> str | None:
        """Name of the first robot pose of a change in time, as text."""
        return None if self.by is not None else str(self.since)

    @property
    def words(self) -> str:
        """Name of the pose and of the views."""
        return path_words(self.name, self.by, self.moment)


def paths_of(rig: Rig, found: RigFit) -> tuple[RigPath, ...]:
    """Return every path of a fit: those through pairs of camera and target, then those in time."""
    graph, pairs, (moment, names) = found.graph, _pairs(found.graph), moments_of(rig, found.graph)
    in_time = [_InTime.of(found, moment, u) for u in range(graph.m)]
    totals = np.zeros((len(pairs), 6, len(found.whole) + 7))
    for k, part in enumerate(found.rows):
        rows, J = part.white, part.J
        products = rows[..., : graph.p].mT @ rows  # (g, p, q + 1) of all unknowns
        for one in in_time:
            one.add(k, products)
        for total, (u, _, of) in zip(totals, pairs, strict=True):
            total += _sums_of_pair(part, J, rows, u, of)
    steps = (one.path(found, moment, names) for one in in_time)
    return (*_through_pairs(found, pairs, totals), *(path for path in steps if path is not None))


def moments_of(rig: Rig, graph: Graph) -> tuple[NDArray[np.intp], tuple[Hashable, ...]]:
    """(E,) place in time of each view, and the names of all moments in order."""
    listed = rig.moments
    place = {name: k for k, name in enumerate(listed)}
    at = [[place[name] for name in view.at or ()] for view in rig.views]
    return np.array([at[v][k] for v, k in zip(graph.view.tolist(), graph.row.tolist(), strict=True)]), tuple(listed)


def _sums_of_pair(part: White, J: Array, rows: Array, u: int, of: NDArray[np.bool_]) -> Array:
    """(6, 6 + q + 1) `sums_of` of all groups of a batch by the unknown u in the edges ``of`` (E,).

    ``J`` (b, d, p) and whitened ``rows`` (b, d, q + 1) of the batch.
    """
    B = part.half @ (J[..., 6 * u : 6 * u + 6] * np.repeat(of[part.batch.edges], 6, axis=-1)[..., None])
    return np.asarray(sums_of(B.reshape(1, -1, 6), rows.reshape(1, -1, rows.shape[-1]))[0])


def _views_of(graph: Graph, u: int) -> NDArray[np.bool_]:
    """(E,) whether a view depends on an unknown."""
    return np.asarray((u == graph.X) | (u == graph.W) | (graph.base[0] == u) | (graph.base[1] == u))


Pair = tuple[int, int, NDArray[np.bool_]]  # a pose, the one whose views give its other estimate, and these views (E,)


def _pairs(graph: Graph) -> list[Pair]:
    """Cameras by each of their targets, and targets by each of their cameras, where there are several."""
    found = []
    for u, partners in [(u, graph.W[u == graph.X]) for u in np.unique(graph.X).tolist()] + [
        (u, graph.X[u == graph.W]) for u in np.unique(graph.W).tolist()
    ]:
        of_all = (u == graph.X) | (u == graph.W)
        listed = np.unique(partners).tolist()
        # both estimates of one pose give the same difference: one of them is reported
        for v in listed if len(listed) > 2 else listed[1:]:
            found.append((u, v, of_all & ((v == graph.X) | (v == graph.W))))
    return found


def _through_pairs(found: RigFit, pairs: list[Pair], totals: Array) -> list[RigPath]:
    """Paths through pairs of camera and target, by the sums of their rows."""
    names, paths = found.graph.names, []
    for (u, v, of), total in zip(pairs, totals, strict=True):
        square, dof, d, S = (one[0] for one in differences(found.whole, total[None]))
        if dof:
            paths.append(
                RigPath(names[u], names[v], None, float(square), int(dof), float(chdtrc(dof, square)), d, S,
                        int(of.sum()), u, of)
            )  # fmt: skip
    return paths


class _InTime(NamedTuple):
    """Rows of one pose in order of time."""

    u: int
    groups: tuple[NDArray[np.intp], ...]  # of each batch, those that depend on the pose
    numbers: tuple[NDArray[np.intp], ...]  # of these among all groups of the pose
    moments: Moments
    sums: Array

    @classmethod
    def of(cls, found: RigFit, moment: NDArray[np.intp], u: int) -> _InTime:
        """Look for the groups of rows that depend on a pose."""
        has, batches = _views_of(found.graph, u), [part.batch.edges for part in found.rows]
        groups = tuple(np.flatnonzero(has[edges].any(axis=-1)) for edges in batches)
        first = np.concatenate([moment[edges[of]].min(axis=-1) for edges, of in zip(batches, groups, strict=True)])
        numbers = np.split(np.arange(len(first)), np.cumsum([len(of) for of in groups])[:-1])
        moments = Moments.of(first)
        return cls(u, groups, tuple(numbers), moments, moments.no_sums(len(found.whole)))

    def columns(self, k: int, rows: Array) -> tuple[Array, Array]:
        """Columns B (g, d, 6) of the pose and rows (g, d, q + 1) of batch k, whose whitened rows are given."""
        of = rows[self.groups[k]]
        return of[..., 6 * self.u : 6 * self.u + 6], of

    def add(self, k: int, products: Array) -> None:
        """Add the rows of batch k to the sums, by the products (g, p, q + 1) of the columns of all unknowns."""
        of, all_of = slice(6 * self.u, 6 * self.u + 6), len(self.groups[k]) == len(products)
        each = products[:, of] if all_of else products[self.groups[k], of]
        self.moments.add(self.sums, self.numbers[k], np.concatenate([each[..., of], each], axis=-1))

    def path(self, found: RigFit, moment: NDArray[np.intp], names: tuple[Hashable, ...]) -> RigPath | None:
        """Return the pose from one moment on, the one of the largest chi-square; None of few moments."""
        step = largest_step(found.whole, self.sums, self.moments)
        if step is None:
            return None
        since = int(self.moments.at[step.begin])
        of = _views_of(found.graph, self.u) & (moment >= since)
        return RigPath(
            found.graph.names[self.u], None, names[since], step.chi_square, step.dof, step.p, step.change,
            step.covariance, int(of.sum()), self.u, of,
        )  # fmt: skip


class _Copied(NamedTuple):
    """A path, fitted with the copy of its pose."""

    path: RigPath
    objective: float
    change: Array
    square: float
    remaining: float  # largest chi-square of another step in time that is left
    covariance: Array  # (6, 6) of the change


class _Drift(NamedTuple):
    """Change of a pose in proportion to the number of the moment."""

    name: str
    chi_square: float
    dof: int
    change: Array  # (6,) of the pose from the first moment to the last
    covariance: Array  # (6, 6)
    remaining: float  # largest chi-square of a step in time that is left


def _drift_of(rig: Rig, found: RigFit, u: int) -> _Drift | None:
    """Return the drift of an unknown pose; None where the views of few moments show it."""
    moment, _ = moments_of(rig, found.graph)
    of = _InTime.of(found, moment, u)
    if len(np.unique(of.moments.at)) < 2 * MIN_MOMENTS:
        return None
    at = of.moments.in_order_of_rows
    share = (at - at.min()) / np.ptp(at)
    shares = [(share - share.mean())[numbers][:, None, None] for numbers in of.numbers]
    sums = np.zeros(of.sums.shape[1:])
    for k, part in enumerate(found.rows):
        B, rows = of.columns(k, part.white)
        sums += sums_of(shares[k] * B, rows).sum(axis=0)
    square, dof, d, S = (one[0] for one in differences(found.whole, sums[None]))
    if not dof:
        return None
    # the largest step in time, with the columns of the drift among the unknowns
    K = found.whole @ sums[:, 6:-1].T
    S_dz = -S @ K.T
    whole = np.block([[found.whole - K @ S_dz, S_dz.T], [S_dz, S]])
    z, left = -K @ d, of.moments.no_sums(len(whole))
    for k, part in enumerate(found.rows):
        B, rows = of.columns(k, part.white)
        D = shares[k] * B
        e = rows[..., -1:] + D @ d[:, None] + rows[..., :-1] @ z[:, None]
        of.moments.add(left, of.numbers[k], sums_of(B, np.concatenate([rows[..., :-1], D, e], axis=-1)))
    step = largest_step(whole, left, of.moments)
    return _Drift(found.graph.names[u], float(square), int(dof), d, S, 0.0 if step is None else step.chi_square)


def judged_paths(
    task: Task, found: RigFit, remaining: float = MAX_REMAINING_SHARE
) -> tuple[tuple[RigPath, ...], tuple[Finding, ...]]:
    """Return all paths of a fit, and the findings about a pose that moved.

    Paths have the weights of the fit; the path of a pose that moved also counts the runs of rejected views. A path that
    does not close although no move explains it is a separate finding. ``remaining``: of the chi-square of a step or a
    drift, the largest share that another step may still have.
    """
    paths = paths_of(task.rig, found)
    if (moved := _moved(task, found, paths, remaining)) is not None:
        same = [(one.name, one.by) == (moved[0].name, moved[0].by) for one in paths]
        return tuple(moved[0] if is_it else one for one, is_it in zip(paths, same, strict=True)), (moved[1],)
    return paths, tuple(_unexplained(found, paths))


def _unexplained(found: RigFit, paths: tuple[RigPath, ...]) -> list[Finding]:
    """Return the least likely path, if that is no chance."""
    least = min(paths, key=lambda one: one.p, default=None)
    if least is None or (p := min(1.0, _p(least, found) * len(paths))) > FALSE_FINDING:
        return []
    values = {"path": least.words, "angle": float(np.linalg.norm(least.change[:3])),
              "shift": float(np.linalg.norm(least.change[3:])), "chi_square": least.chi_square, "p": p}  # fmt: skip
    return [Finding("rig.path_rings", "caution", values)]


def _moved(task: Task, found: RigFit, own: tuple[RigPath, ...], remaining: float) -> tuple[RigPath, Finding] | None:
    """Return the path of a pose that moved or drifts, with the finding."""
    with_runs = _with_runs(task, found) if task.robust else found
    paths = own if with_runs is found else paths_of(task.rig, with_runs)
    ringing = sorted(
        (path for path in paths if _p(path, found) * len(paths) < FALSE_FINDING), key=lambda one: -one.chi_square
    )
    if not ringing:
        return None
    ringing = [path for path in ringing if path.chi_square > 0.1 * ringing[0].chi_square][:4]
    copied = [one for path in ringing if (one := _with_copy(task, found, path)) is not None]
    if not copied:
        return None
    copied.sort(key=lambda one: one.objective)
    best = copied[0]
    if best.path.by is None and (drift := _larger_drift(task.rig, with_runs, ringing)) is not None:
        return _drifting(task.rig, with_runs, *drift, len(paths), remaining)
    p = float(chdtrc(6, best.square)) * len(paths)
    if p > FALSE_FINDING or best.remaining > remaining * best.path.chi_square:
        return None
    others = [one.path for one in copied[1:] if one.objective < best.objective + AS_GOOD_CHI_SQUARE and
              (one.path.name, one.path.by) != (best.path.name, best.path.by)]  # fmt: skip
    return best.path, _finding(task.rig, best, p, others)


def _larger_drift(rig: Rig, found: RigFit, ringing: list[RigPath]) -> tuple[_Drift, RigPath] | None:
    """Return the drift of the largest chi-square, and its path, if no step has one as large."""
    steps = [path for path in ringing if path.by is None]
    of_each = [(drift, path) for path in steps if (drift := _drift_of(rig, found, path.number)) is not None]
    if not of_each:
        return None
    largest = max(of_each, key=lambda one: one[0].chi_square)
    return None if largest[0].chi_square <= max(one.chi_square for one in steps) else largest


def _drifting(
    rig: Rig, found: RigFit, drift: _Drift, path: RigPath, count: int, remaining: float
) -> tuple[RigPath, Finding] | None:
    """Return the path of a pose that drifts with the finding; None where other steps are left, or it is chance.

    ``count``: number of paths that were tested.
    """
    scale = max(1.0, (found.chi_square - drift.chi_square) / max(found.dof - drift.dof, 1))
    p = float(chdtrc(drift.dof, drift.chi_square / scale)) * count
    if p > FALSE_FINDING or drift.remaining > remaining * drift.chi_square:
        return None
    values = {
        "kind": _kind(rig, drift.name), "name": drift.name, **sizes_of_move(drift.change, scale * drift.covariance),
        "chi_square": drift.chi_square, "p": p,
    }  # fmt: skip
    return path, Finding("rig.drifts", "failure", values)


def named_error(task: Task, noise: RigNoise, at: Array, error: Exception) -> Exception:
    """Return the error of a robust fit that failed, with the pose that moved if one explains it."""
    try:
        plain = fit(task.graph, noise, at, "efficient", prior=task.prior)
        if not plain.converged:  # its residuals are those of no rig, with one pose that moved or without
            return error
        _, findings = judged_paths(task._replace(request=Request()), plain)
    except (InputError, NotConvergedError, np.linalg.LinAlgError):
        return error
    return InputError(str(findings[0])) if findings else error


def _p(path: RigPath, found: RigFit) -> float:
    """p of a path, its chi-square divided by that per degree of freedom which the copy leaves."""
    left = (found.chi_square - path.chi_square) / max(found.dof - path.dof, 1)
    square = path.chi_square / max(1.0, left)
    single = float(chdtrc(path.dof, path.chi_square))
    return path.p if left <= 1 else min(1.0, float(chdtrc(path.dof, square)) * max(1.0, path.p / max(single, 1e-300)))


def _with_runs(task: Task, found: RigFit) -> RigFit:
    """Return the fit in which runs of rejected views of one pose count."""
    graph = found.graph
    moment, _ = moments_of(task.rig, graph)
    weak = found.view_weights < 0.5
    if not weak.any():
        return found
    again = np.zeros(graph.E, dtype=bool)
    for u in range(graph.m):
        of = np.flatnonzero(_views_of(graph, u))
        for run in _runs(moment[of], weak[of]):
            again[of[run]] = True
    if not again.any():
        return found
    w_e, w_k = np.where(again, 1.0, found.edge_weights), np.ones(graph.P)
    spared = np.zeros(graph.P + 1, dtype=bool)
    for side in graph.side:
        spared[side[again]] = True
    w_k = np.where(spared[:-1], 1.0, found.pose_weights)
    return fit(graph, found.noise, found.at, "efficient", Weights(w_e, w_k), task.prior)


def _runs(moment: NDArray[np.intp], weak: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Views of `MIN_RUN` or more moments in a row of which most views are rejected; of fewer, the first or the last."""
    of = np.unique(moment, return_inverse=True)[1]
    bad = np.bincount(of, weak) > 0.5 * np.bincount(of)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], bad.astype(int), [0]])))
    return [
        np.flatnonzero((of >= a) & (of < b))
        for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
        if b - a >= (MIN_RUN if a > 0 and b < len(bad) else MIN_MOMENTS)
    ]


def _with_copy(task: Task, found: RigFit, path: RigPath) -> _Copied | None:
    """Fit the graph with a copy of the pose in the views of the path; None where that has no answer."""
    graph, u, m = found.graph, path.number, found.graph.m
    of = path.edges
    assert of is not None

    def of_copy(base: NDArray[np.intp]) -> NDArray[np.intp]:
        return np.where(base == m, m + 1, np.where(of & (base == u), m, base))

    other = replace(
        graph, names=(*graph.names, f"{graph.names[u]} (copy)"), X=np.where(of & (u == graph.X), m, graph.X),
        W=np.where(of & (u == graph.W), m, graph.W),
        base=(of_copy(graph.base[0]), of_copy(graph.base[1])),
    )  # fmt: skip
    start = np.concatenate([found.at, perturb(found.at[u], path.change)[None]])
    try:
        if task.robust:
            fitted, _ = fit_robustly(other, found.noise, start, task.method, task.prior)
        else:
            fitted = fit(other, found.noise, start, task.method, prior=task.prior)
    except (InputError, NotConvergedError, np.linalg.LinAlgError):
        return None
    change = pose_change(fitted.at[u], fitted.at[m])
    D = np.zeros((6, len(fitted.covariance)))
    D[:, 6 * m :], D[:, 6 * u : 6 * u + 6] = np.eye(6), -np.eye(6)
    S = D @ fitted.covariance @ D.T
    square = _square(change, S)
    weight = fitted.view_weights
    rest = _views_of(graph, u) & ~of
    if min(weight[of].mean(), weight[rest].mean() if rest.any() else 1.0) < 0.5:  # outliers agree on no place
        return None
    rejected = float((1.0 - weight).sum())
    scale = max(1.0, fitted.chi_square / max(fitted.dof, 1))
    limit = largest_by_chance(graph.E + graph.P)
    remaining = max((one.chi_square for one in paths_of(task.rig, fitted) if one.by is None), default=0.0)
    return _Copied(path, fitted.chi_square + PENALTY * limit * rejected, change, square / scale, remaining, scale * S)


def pose_change(before: Array, after: Array) -> Array:
    """(6,) ``(theta, tau)`` of a pose after a move, in the frame of its parent, rad and m."""
    return np.concatenate([logarithm(after[:3, :3] @ before[:3, :3].T), after[:3, 3] - before[:3, 3]])


def sizes_of_move(change: Array, S: Array) -> dict[str, float | None]:
    """Return angle and shift of a move with their standard deviations, None of the one that is not resolved.

    Where only one of the two is resolved, the other is taken as 0: a board slides, a camera tilts.
    """
    parts = (slice(0, 3), slice(3, 6))
    moved = [float(chdtrc(3, _square(change[part], S[part, part]))) < RESOLVED.probability for part in parts]
    found: dict[str, float | None] = {}
    for name, part, other, own, of_other in zip(
        ("angle", "shift"), parts, parts[::-1], moved, moved[::-1], strict=True
    ):
        d, C = change[part], S[part, part]
        if own and not of_other:
            gain = S[part, other] @ np.linalg.pinv(S[other, other], hermitian=True)
            d, C = d - gain @ change[other], C - gain @ S[other, part]
        size = float(np.linalg.norm(d))
        along = d / max(size, 1e-300)
        sd = float(np.sqrt(max(float(along @ C @ along), 0.0)))
        found |= {name: size, f"{name}_sd": sd if own or not of_other else None}
    return found


def _square(d: Array, S: Array) -> float:
    return float(d @ np.linalg.lstsq(S, d, rcond=None)[0])


def _kind(rig: Rig, name: str) -> str:
    return "camera" if name in rig.cameras else "target" if name in rig.targets else "base of the arm"


def _finding(rig: Rig, best: _Copied, p: float, others: list[RigPath]) -> Finding:
    path = best.path
    kind = _kind(rig, path.name)
    values = {
        "kind": kind, "name": path.name, **sizes_of_move(best.change, best.covariance), "chi_square": best.square,
        "p": p, "others": [{"name": one.name, "by": one.by, "since": one.moment} for one in others],
    }  # fmt: skip
    if path.by is None:
        cameras = {"cameras": list(rig.cameras)} if kind != "camera" else {}
        return Finding("rig.moved", "failure", values | {"since": path.moment, **cameras})
    return Finding("rig.paths_disagree", "caution", values | {"by": path.by})
