r"""Name the pose of a rig that did not stand still: paths that ring are fitted with a copy of their pose.

Paths are tested as the fit weighs the views, but for runs of rejected ones: a camera that was knocked spoils all later
views, and robust weights that reject them would hide it. Single outliers stay rejected. Every path that rings is then
a fit of its own, robust, with the copy of its pose as one more unknown; the one with the least

    chi-square of the views that count + PENALTY * limit * (views that are rejected)

is named, with those that explain the views nearly as well. Where the residuals are larger than the noise says even with
the copy, chi-squares are divided by that (chi-square over degrees of freedom), so that a noise that was given too small
does not make a move.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from ...core.geometry.se3 import Array, logarithm, perturb
from ...errors import InputError, NotConvergedError
from ...findings import Finding, Severity
from ...fit.likelihood.robust import largest_by_chance
from ..description import Rig
from ..fit import RigFit, Task, fit
from ..noise import RigNoise
from ..weights import fit_robustly
from .paths import RigPath, moments_of, paths_of

# Probability of a false finding in one rig; of one that fails it.
LEVEL, SURE = 5e-3, 1e-8
# Paths that are fitted with their copy; difference of chi-square within which another one explains as much.
TRIED, AS_GOOD = 4, 6.0
# Moments of a run of rejected views, at least.
RUN = 5
# A rejected view counts as so many times the largest distance that chance makes.
PENALTY = 3.0


@dataclass(frozen=True, eq=False)
class _Copied:
    """A path, fitted with the copy of its pose."""

    path: RigPath
    objective: float
    change: Array
    square: float


def judged_paths(task: Task, found: RigFit) -> tuple[tuple[RigPath, ...], tuple[Finding, ...]]:
    """Return all paths of a fit, and what they say about a pose that did not stand still.

    Paths are those of the fit as it weighs the views. That of a pose that moved counts the runs of rejected views; one
    that rings although no move explains it is a finding of its own.
    """
    paths = paths_of(task.rig, found)
    if (moved := _moved(task, found, paths)) is not None:
        same = [(one.name, one.by) == (moved[0].name, moved[0].by) for one in paths]
        return tuple(moved[0] if is_it else one for one, is_it in zip(paths, same, strict=True)), (moved[1],)
    return paths, tuple(_unexplained(found, paths))


def _unexplained(found: RigFit, paths: tuple[RigPath, ...]) -> list[Finding]:
    """Return the least likely path, if that is no chance."""
    least = min(paths, key=lambda one: one.p, default=None)
    if least is None or (p := min(1.0, _p(least, found) * len(paths))) > LEVEL:
        return []
    values = {"path": least.words, "angle": float(np.linalg.norm(least.change[:3])),
              "shift": float(np.linalg.norm(least.change[3:])), "chi_square": least.chi_square, "p": p}  # fmt: skip
    return [Finding("rig.path_rings", "caution", values)]


def _moved(task: Task, found: RigFit, own: tuple[RigPath, ...]) -> tuple[RigPath, Finding] | None:
    """Return the path of a pose that moved, with the finding."""
    with_runs = _with_runs(task, found) if task.robust else found
    paths = own if with_runs is found else paths_of(task.rig, with_runs)
    ringing = sorted((path for path in paths if _p(path, found) * len(paths) < LEVEL), key=lambda one: -one.chi_square)
    if not ringing:
        return None
    ringing = [path for path in ringing if path.chi_square > 0.1 * ringing[0].chi_square][:TRIED]
    copied = [one for path in ringing if (one := _with_copy(task, found, path)) is not None]
    if not copied:
        return None
    copied.sort(key=lambda one: one.objective)
    best = copied[0]
    p = float(chdtrc(6, best.square)) * len(paths)
    if p > LEVEL:
        return None
    others = [one.path for one in copied[1:] if one.objective < best.objective + AS_GOOD and
              (one.path.name, one.path.by) != (best.path.name, best.path.by)]  # fmt: skip
    return best.path, _finding(task.rig, found, best, p, others)


def named_error(task: Task, noise: RigNoise, at: Array, error: Exception) -> Exception:
    """Return the error of a robust fit that failed, with the pose that did not stand still if one explains it."""
    try:
        plain = fit(task.graph, noise, at, "efficient", prior=task.prior)
        _, findings = judged_paths(task._replace(method="efficient", robust=True), plain)
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
    poses = np.concatenate([found.pose_weights, [1.0]])
    weak = np.minimum(found.edge_weights, np.minimum(poses[graph.side[0]], poses[graph.side[1]])) < 0.5
    if not weak.any():
        return found
    again = np.zeros(graph.E, dtype=bool)
    for u in range(graph.m):
        of_u = (u == graph.X) | (u == graph.W) | (graph.base[0] == u) | (graph.base[1] == u)
        of = np.flatnonzero(of_u)
        for run in _runs(moment[of], weak[of]):
            again[of[run]] = True
    if not again.any():
        return found
    w_e, w_k = np.where(again, 1.0, found.edge_weights), np.ones(graph.P)
    spared = np.zeros(graph.P + 1, dtype=bool)
    for side in graph.side:
        spared[side[again]] = True
    w_k = np.where(spared[:-1], 1.0, found.pose_weights)
    return fit(graph, found.noise, found.at, "efficient", w_e, w_k, task.prior)


def _runs(moment: NDArray[np.intp], weak: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Views of `RUN` or more moments in a row of which most views are rejected."""
    of = np.unique(moment, return_inverse=True)[1]
    bad = np.bincount(of, weak) > 0.5 * np.bincount(of)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], bad.astype(int), [0]])))
    return [np.flatnonzero((of >= a) & (of < b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= RUN]


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
    change = np.concatenate([logarithm(fitted.at[m, :3, :3] @ fitted.at[u, :3, :3].T),
                             fitted.at[m, :3, 3] - fitted.at[u, :3, 3]])  # fmt: skip
    D = np.zeros((6, len(fitted.covariance)))
    D[:, 6 * m :], D[:, 6 * u : 6 * u + 6] = np.eye(6), -np.eye(6)
    S = D @ fitted.covariance @ D.T
    square = float(change @ np.linalg.lstsq(S, change, rcond=None)[0])
    poses = np.concatenate([fitted.pose_weights, [1.0]])
    weight = np.minimum(fitted.edge_weights, np.minimum(poses[graph.side[0]], poses[graph.side[1]]))
    if weight[path.edges].mean() < 0.5:  # they do not agree on another place either
        return None
    rejected = float((1.0 - weight).sum())
    scale = max(1.0, fitted.chi_square / max(fitted.dof, 1))
    limit = largest_by_chance(graph.E + graph.P)
    return _Copied(path, fitted.chi_square + PENALTY * limit * rejected, change, square / scale)


def _finding(rig: Rig, found: RigFit, best: _Copied, p: float, others: list[RigPath]) -> Finding:
    path = best.path
    kind = "camera" if path.name in rig.cameras else "target" if path.name in rig.targets else "base of the arm"
    values: dict[str, Any] = {
        "kind": kind, "name": path.name, "angle": float(np.linalg.norm(best.change[:3])),
        "shift": float(np.linalg.norm(best.change[3:])), "chi_square": best.square, "p": p,
        "others": [one.words for one in others],
    }  # fmt: skip
    assert path.edges is not None
    counts = found.edge_weights > 0.5
    mixed = bool((counts & path.edges).any())
    severity: Severity = "failure" if mixed and p < SURE else "caution"
    if path.by is None:
        return Finding("rig.moved", severity, values | {"since": str(path.since)})
    return Finding("rig.paths_disagree", "caution", values | {"by": path.by})
