r"""Paths that should agree: every unknown pose against a copy of itself for some of its views (T18).

With whitened rows ``rho + A (x, z) + B d = 0``, B the columns of one unknown pose in some of its views and 0 in the
others, d (6,) is by how much the pose in these views differs from that in the rest. Beside the fit, ``H = A^T A + P_0``
and ``e`` its residual,

    d = -M^-1 B^T e,      Cov d = M^-1,      M = B^T B - B^T A H^-1 A^T B,      d^T M d ~ chi^2_6

the difference of the chi-square with the copy and without it, with all errors of the joint model (A holds those that
poses share, the rows of one robot pose are whitened together). Two kinds of copies:

- a camera in its views of one target, or a target in the views by one camera: the cycle through the two closes or not;
- a pose from one moment on: it stood still or did not. Of all moments the one with the largest chi-square is kept; its
  p allows for the choice (DeLong 1981 for the maximum over all moments, or the number of moments if that says less).

Directions of d that the other views do not tell (share of M in B^T B below `TOLD`) do not count: 6 less their number.
Reference: D. W. K. Andrews (1993), Econometrica 61, 821; A. Estrella (2003), Econometric Theory 19, 1128.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, gammaln

from ...core.files.records import Record
from ...core.geometry.se3 import Array
from ..description import Rig
from ..fit import RigFit
from ..graph import Graph

# Share of the information of the views alone below which a direction of the change is not told by the others.
TOLD = 1e-5
# Moments on either side of a change, at least.
LEAST = 3


@dataclass(frozen=True, eq=False)
class RigPath(Record):
    """Two ways to one pose, and how far they differ.

    Attributes
    ----------
    name : str
        Camera, target or arm whose pose has two estimates.
    by : str or None
        Target, or camera, whose views give the one; None: a change in time.
    since : moment or None
        Name of the first robot pose of the other, for a change in time.
    chi_square, dof, p : float
        Of the difference; p of a change allows for the choice of the moment.
    change : (6,)
        ``(theta, tau)`` of the one minus the other, rad and m.
    covariance : (6, 6)
        Of the change; 0 along directions that are not told.
    count : int
        Views that belong to the one, or come after the change.
    """

    _in_file: ClassVar[str] = "name by since chi_square dof p change covariance count"

    name: str
    by: str | None
    since: Any
    chi_square: float
    dof: int
    p: float
    change: Annotated[Array, 6]
    covariance: Annotated[Array, 6, 6]
    count: int
    number: int = -1  # of the unknown
    edges: NDArray[np.bool_] | None = None  # (E,) of the copy

    @property
    def words(self) -> str:
        """Name of the pose and of the views."""
        return f"{self.name}, by {self.by}" if self.by is not None else f"{self.name}, from robot pose {self.since} on"


def paths_of(rig: Rig, found: RigFit) -> tuple[RigPath, ...]:
    """Return every path of a fit: those through pairs of camera and target, then those in time."""
    graph = found.graph
    white = [
        np.concatenate([part.white[..., :-1], part.half @ part.residual[..., None]], axis=-1) for part in found.rows
    ]
    return (*_through_pairs(found, white), *_in_time(found, white, *moments_of(rig, graph)))


def moments_of(rig: Rig, graph: Graph) -> tuple[NDArray[np.intp], tuple[Any, ...]]:
    """(E,) place in time of each view, and the names of all moments: sorted if numbers, else as they come."""
    names = dict.fromkeys(name for arm in rig.arms.values() for name in arm.names)
    names |= dict.fromkeys(name for view in rig.views for name in view.at or ())
    listed = list(names)
    if all(isinstance(name, int | float) for name in listed):
        listed.sort()
    place = {name: k for k, name in enumerate(listed)}
    at = [[place[name] for name in view.at or ()] for view in rig.views]
    return np.array([at[v][k] for v, k in zip(graph.view.tolist(), graph.row.tolist(), strict=True)]), tuple(listed)


def _columns(found: RigFit, k: int, u: int, of: NDArray[np.bool_]) -> tuple[Array, NDArray[np.intp]]:
    """B (g, d, 6) of batch k by the unknown u, in the edges ``of`` (E,), and the groups that have any."""
    part = found.rows[k]
    J = part.A[..., 6 * u : 6 * u + 6] * np.repeat(of[part.batch.edges], 6, axis=-1)[..., None]
    some = np.flatnonzero(np.abs(J).max(axis=(-2, -1)) > 0)
    return np.asarray(part.half[some] @ J[some]), some


def _sums(B: Array, white: Array) -> Array:
    """(g, 6, 6 + p + m + 1) of each group: B^T [B, A, e]."""
    return np.asarray(B.mT @ np.concatenate([B, white], axis=-1))


def _differences(whole: Array, sums: Array) -> tuple[Array, NDArray[np.intp], Array, Array]:
    """Chi-squares (k,), degrees of freedom (k,), d (k, 6) and covariances (k, 6, 6) of sums (k, 6, 6 + p + m + 1)."""
    G, C, g = sums[..., :6], sums[..., 6:-1], sums[..., -1:]
    root = np.linalg.inv(np.linalg.cholesky(G))
    share, vectors = np.linalg.eigh(root @ (G - C @ whole @ C.mT) @ root.mT)
    told = share > TOLD
    inverse = np.where(told, 1.0 / np.where(told, share, 1.0), 0.0)
    D = root.mT @ vectors
    along = (D.mT @ g)[..., 0]
    d = -(D @ (inverse * along)[..., None])[..., 0]
    return (inverse * along**2).sum(axis=-1), told.sum(axis=-1), d, (D * inverse[..., None, :]) @ D.mT


def _through_pairs(found: RigFit, white: list[Array]) -> list[RigPath]:
    """Cameras by each of their targets, and targets by each of their cameras, where there are several."""
    graph, paths = found.graph, []
    for u, partners in [(u, graph.W[u == graph.X]) for u in np.unique(graph.X).tolist()] + [
        (u, graph.X[u == graph.W]) for u in np.unique(graph.W).tolist()
    ]:
        of_all = (u == graph.X) | (u == graph.W)
        listed = np.unique(partners).tolist()
        # of two ways to one pose each is the other's other: one of them says it
        for v in listed if len(listed) > 2 else listed[1:]:
            of = of_all & ((v == graph.X) | (v == graph.W))
            total = np.zeros((6, 6 + white[0].shape[-1]))
            for k, rows in enumerate(white):
                B, some = _columns(found, k, u, of)
                total += _sums(B, rows[some]).sum(axis=0)
            square, dof, d, S = (one[0] for one in _differences(found.whole, total[None]))
            if dof:
                paths.append(
                    RigPath(graph.names[u], graph.names[v], None, float(square), int(dof), float(chdtrc(dof, square)),
                            d, S, int(of.sum()), u, of)
                )  # fmt: skip
    return paths


def _in_time(found: RigFit, white: list[Array], moment: NDArray[np.intp], names: tuple[Any, ...]) -> list[RigPath]:
    """Each pose from one moment on, the one of the largest chi-square."""
    graph, paths = found.graph, []
    for u in range(graph.m):
        sums, first, of_u = [], [], np.zeros(graph.E, dtype=bool)
        for part, rows in zip(found.rows, white, strict=True):
            some = np.flatnonzero(np.abs(part.A[..., 6 * u : 6 * u + 6]).max(axis=(-2, -1)) > 0)
            B = rows[some, :, 6 * u : 6 * u + 6]
            sums.append(_sums(B, rows[some]))
            first.append(moment[part.batch.edges[some]].min(axis=-1))
            of_u[part.batch.edges[some]] = True
        at = np.concatenate(first)
        order = np.argsort(at, kind="stable")
        after = np.cumsum(np.concatenate(sums)[order][::-1], axis=0)[::-1]  # from each group on
        begins = np.flatnonzero(np.diff(at[order])) + 1
        begins = begins[(begins >= LEAST) & (begins <= len(at) - LEAST)]
        if not len(begins):
            continue
        square, dof, d, S = _differences(found.whole, after[begins])
        square = np.where(dof == dof.max(), square, 0.0)
        best = int(np.argmax(square))
        since = int(at[order][begins[best]])
        of = of_u & (moment >= since)
        p = _largest_by_chance(float(square[best]), int(dof[best]), begins / len(at))
        paths.append(
            RigPath(graph.names[u], None, names[since], float(square[best]), int(dof[best]), p, d[best], S[best],
                    int(of.sum()), u, of)
        )  # fmt: skip
    return paths


def _largest_by_chance(square: float, dof: int, shares: Array) -> float:
    """Probability that the largest chi-square of all moments, at these shares of the views, is as large."""
    each = float(chdtrc(dof, square)) * len(shares)
    if square <= dof:
        return min(1.0, each)
    odds = np.log(shares[-1] / (1.0 - shares[-1])) - np.log(shares[0] / (1.0 - shares[0]))
    density = np.exp(0.5 * dof * np.log(0.5 * square) - 0.5 * square - gammaln(0.5 * dof))
    return float(min(1.0, each, density * ((1.0 - dof / square) * odds + 2.0 / square)))
