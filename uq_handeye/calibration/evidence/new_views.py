r"""New views of a rig compared with its result: whitened residuals, with their covariance if nothing has changed.

At the estimates, with poses corrected by the estimates of the shared errors, the rows of a group (`fit.graph.graph`)
are

    rho = J xi + D K (e - estimate) + D eta

xi and e those of the posterior, eta the noise of the new poses, correlated within a group by its robot poses. Rows are
whitened by ``Cov(D eta) = L L^T`` of their group, so that they are independent (`graph.rows.NewRows`). Directions
that the calibration did not determine are free parameters: their columns are projected out.

Where the noise was estimated, d^2 is uncertain by a factor that depends on the sizes of all noise: its distribution is
a mixture over their posterior (`evidence`), with 2 / nu the variance of the logarithm of the factor.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array, perturb
from ...core.read_only import ReadOnlyArrays
from ...errors import InputError
from ...fit.graph.fit import Place, whitened
from ...fit.graph.graph import Graph
from ...fit.graph.rows import NewRows
from ...fit.graph.sizes import ALL_TARGETS, model_of
from ...model.errors.key import ErrorKey
from ...model.rig.description import Rig
from ..prediction.noise_of_views import new_noise, parts_of, posterior_of
from ..rig_poses import RigPoses


@dataclass(frozen=True, eq=False)
class RigEvidence(ReadOnlyArrays):
    """New views compared with a calibrated rig: whitened rows, and the columns of the causes."""

    graph: Graph
    rows: NewRows  # (M, 1): one number each, of variance 1
    J: Array  # (M, p) whitened derivatives by the errors of the poses
    edges: NDArray[np.intp]  # (M,) view of each row
    free: Array  # (M, k) whitened columns of what the calibration left open
    weights: Array  # (t,) of points of the open sizes
    scales: Array  # (t,) of d^2 at them
    by_camera: Array  # (E, 6, 6) derivatives of the residuals by the camera poses
    halves: tuple[Array, ...]  # of each batch of the graph, which whiten its rows

    @property
    def dof(self) -> int:
        """Number of residuals minus that of the open directions."""
        return int(len(self.J) - np.linalg.matrix_rank(self.free)) if self.free.size else len(self.J)

    def moved(self, name: str, of: NDArray[np.bool_] | None = None) -> Array:
        """(M, 1, 6) columns of a move of one unknown pose, in the views ``of`` (E,)."""
        u = self.graph.names.index(name)
        columns = -self.J[:, 6 * u : 6 * u + 6]
        if of is not None:
            columns = columns * of[self.edges][:, None]
        return _without(columns, self.free)[:, None, :]

    def changed(self, F: Array) -> Array:
        """(M, 1, c) columns of an error of the camera poses, whose effect on each of them is F (E, 6, c)."""
        columns = [
            half @ (self.by_camera[batch.edges] @ F[batch.edges]).reshape(len(batch.edges), -1, F.shape[-1])
            for batch, half in zip(self.graph.batches, self.halves, strict=True)
        ]
        return -_without(np.concatenate([part.reshape(-1, F.shape[-1]) for part in columns]), self.free)[:, None, :]


def like(result: RigPoses, rig: Rig) -> Rig:
    """Return new poses and views as a rig like the calibrated one; raises `InputError` for names it does not have."""
    if not isinstance(rig, Rig):
        raise InputError(f"Expected new views of a rig as a Rig (uq.Rig, uq.read_rig), got {type(rig).__name__}.")
    old = result.rig
    for what in ("cameras", "targets"):
        for name, place in getattr(rig, what).items():
            has = getattr(old, what)
            if name not in has:
                raise InputError(f"The new views name {name!r}; the calibrated rig has {', '.join(has)}.")
            if has[name] != place:
                raise InputError(f"{name!r} is on {place!r} in the new views and was on {has[name]!r} before.")
    if unknown := [name for name in rig.arms if name not in old.arms]:
        raise InputError(f"The new poses are of the arm {unknown[0]!r}; the rig has {', '.join(old.arms)}.")
    arms = {name: arm.like(rig.arms[name]) if name in rig.arms else arm for name, arm in old.arms.items()}
    return Rig(arms, old.cameras, old.targets, rig.views)


def others_of(result: RigPoses, same: Iterable[str] | str | None) -> NDArray[np.bool_]:
    """(q,) shared errors of arms, cameras and targets that are not ``same``: names, or robot, camera, target, none."""
    rig, keys = result.rig, posterior_of(result).keys
    kinds = {"robot": list(rig.arms), "camera": list(rig.cameras), "target": list(rig.targets)}
    things = [name for of in kinds.values() for name in of]
    if same is None:
        return np.zeros(len(keys), dtype=bool)
    given = [part.strip() for part in same.split(",")] if isinstance(same, str) else list(same)
    if given == ["none"]:
        given = []
    kept = {name for part in given for name in kinds.get(part, [part])}
    if unknown := sorted(kept - set(things)):
        listed = ", ".join([*kinds, *things])
        raise InputError(f"Expected `same` (--same) to be names out of {listed}, got {unknown[0]!r}.")
    kept |= {ALL_TARGETS} if set(rig.targets) <= kept else set()
    return np.array([(key.name or key.owner) not in kept for key in keys], dtype=bool)


def evidence_of_views(result: RigPoses, rig: Rig, same: Iterable[str] | str | None = None) -> RigEvidence:
    """Compare new views with the result of a rig; raises `InputError` for views of another rig.

    Errors of arms, cameras and targets that are not the ``same`` are independent, with the estimated size.
    """
    rig = like(result, rig)
    graph = Graph.of(rig)
    noise = new_noise(result, rig, graph, measured=True)
    posterior = posterior_of(result)
    others = others_of(result, same)
    e = np.where(others, 0.0, posterior.estimate)[:, None]
    robot, C = perturb(graph.robot, -(noise.K_robot @ e)[..., 0]), perturb(graph.C, -(noise.K_camera @ e)[..., 0])
    place = Place(result.poses, robot, C)
    ones = np.ones(graph.E), np.ones(graph.P)
    white, edges, halves = [], [], []
    for batch in graph.batches:
        part = whitened(graph, batch, place, noise, *ones)
        halves.append(part.half)
        white.append(part.white.reshape(-1, part.white.shape[-1]))
        edges.append(np.repeat(batch.edges.reshape(-1), 6))
    flat = np.concatenate(white)
    J = flat[:, : graph.p]
    free = J @ result.open.T
    kept = _without(flat, free)
    by_state = kept[:, :-1]
    anew = by_state[:, graph.p :][:, others]
    by_state[:, graph.p + np.flatnonzero(others)] = 0.0
    by_unit = np.concatenate([by_state @ posterior.A, anew], axis=1)
    rows = NewRows(kept[:, -1:], by_unit[:, None], np.ones((len(kept), 1, 1)), posterior)
    scales = _scales(result, rig, graph, halves, by_unit)
    weights = result.size_weights if len(scales) > 1 else np.ones(1)
    of_views = np.concatenate(edges)
    return RigEvidence(graph, rows, J, of_views, free, weights, scales, place.sides(graph).camera, tuple(halves))


def _scales(result: RigPoses, rig: Rig, graph: Graph, halves: list[Array], V: Array) -> Array:
    """Mean of d^2 over its k numbers at each point of the uncertain sizes; it is 1 at the sizes of the noise used.

    With ``Sigma = 1 + V V^T`` of the whitened rows and T_c the part of component c in the 1, it is ``1 + sum_c
    (exp(2 delta_c) - 1) tr(Sigma^-1 T_c) / k``, delta_c the logarithm of the size of c at the point minus the one used.
    """
    lines = {ErrorKey.from_dict(part["key"]): part["logs"] for part in result.components if "logs" in part}
    parts = tuple(
        one for one in parts_of(result, rig, graph, measured=True) if one.block is not None and one.key in lines
    )
    if not parts:
        return np.ones(1)
    M = np.linalg.inv(np.eye(V.shape[1]) + V.T @ V)
    g, start = np.zeros(len(parts)), 0
    for rows, half in zip(model_of(rig, graph, parts, result.poses, None).groups, halves, strict=True):
        b, d = rows.r.shape
        V_i = V[start : start + b * d].reshape(b, d, -1)
        start += b * d
        for c, B in rows.blocks.items():
            T = parts[c].size.median ** 2 * (half @ B @ half.mT)
            g[c] += float(np.einsum("bii->", T) - np.einsum("bki,ij,bkj->", T @ V_i, M, V_i, optimize=True))
    return np.asarray(1.0 + g / len(V) @ np.expm1(2.0 * np.array([lines[one.key] for one in parts])))


def _without(columns: Array, free: Array) -> Array:
    """Columns (M, c) with what lies in the span of others (M, k) taken away."""
    if not free.shape[1]:
        return columns
    Q, R = np.linalg.qr(free)
    Q = Q[:, np.abs(np.diag(R)) > 1e-9 * max(float(np.abs(R).max(initial=0.0)), 1e-300)]
    return np.asarray(columns - Q @ (Q.T @ columns))
