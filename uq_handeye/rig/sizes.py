r"""Noise of a rig from its own views: components with owners, whose sizes are found together (`one_model`).

An arm owns rotation and translation noise of its poses, and its accuracy; a camera rotation and translation noise,
that by the view, focal length and image centre; a target its scale. The column of an owner is zero in the rows of the
others. Sizes of cameras share a prior: log-normal about a median that is itself log-normal, so that few views of one
camera borrow from the others. Rows of one robot pose stand together (`engine.Rows`): views at one moment show the
robot's noise directly, by the correlation of their residuals.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array, perturb
from ..errors import NotConvergedError
from ..fit.one_model.component import Component
from ..fit.one_model.engine import LatentModel, Rows
from ..fit.one_model.integration import integrate
from ..fit.one_model.mode import GAIN, find_mode
from ..model.poses.pose_pairs import PosePairs
from ..model.shared_errors.shared_error import assumed_accuracy
from ..model.shared_errors.sizes import SIZES, Size
from ..model.shared_errors.view import intrinsics_columns, view_block
from .description import Rig
from .fit import Prior, prior_at
from .graph import Graph
from .noise import RigNoise, intrinsics_of, kinematic_components

# Factor (one sigma of the logarithm) by which cameras differ from their common median.
APART = 2.0
# Factor of the sizes of focal length and image centre.
OF_CAMERA = 3.0
# Views from which the sizes are found at most, whole groups; rounds of linearisation; what a step may still move.
ENOUGH, ROUNDS, STILL = 600, 6, 2e-2

OF_EACH_CAMERA = ("rotation", "translation", "by view", "focal length", "principal point")
_PARTS = (("rotation", np.eye(6)[:, :3]), ("translation", np.eye(6)[:, 3:]))


@dataclass(frozen=True, eq=False)
class Found:
    """Noise with the sizes as found, what the open sizes add to the covariance, and a line for each component."""

    noise: RigNoise
    spread: Array  # (p, p)
    lines: tuple[dict[str, object], ...]


def components_of(
    rig: Rig, graph: Graph, shared: bool, bound: Mapping[str, Array] | None = None
) -> tuple[Component, ...]:
    """Return all components of the poses of a graph: columns (P, 6, m) of the robot, (E, 6, m) of the cameras.

    ``shared``: with what all poses of an owner share; without, noise of each pose only. ``bound``: robot poses
    (n, 4, 4) by arm that the errors of its accuracy belong to; None: those of the graph.
    """
    found = []
    of_view = [(view.camera, view.target, view.covariance is not None) for view in rig.views]
    for k, name in enumerate(rig.arms):
        of = (graph.arm == k).astype(float)[:, None, None]
        if not of.any():
            continue
        found += [Component(f"{name} {what}", "robot", SIZES[f"robot {what}"], block=of * B) for what, B in _PARTS]
        if rig.arms[name].kinematics is not None:
            found += kinematic_components(rig, graph, name)
        elif shared:
            found.append(_accuracy(graph, name, graph.arm == k, None if bound is None else bound[name]))
    intrinsics = intrinsics_columns(graph.C) if shared else None
    by_view = _by_view(graph)
    for name in rig.cameras:
        owned = np.array([camera == name for camera, _, _ in of_view])[graph.view]
        own = (owned & ~np.array([known for *_, known in of_view])[graph.view]).astype(float)[:, None, None]
        if own.any():
            found += [
                Component(f"{name} {what}", "camera", SIZES[f"camera {what}"], block=own * B) for what, B in _PARTS
            ]
        if own.any():
            found.append(Component(f"{name} by view", "camera", SIZES["camera by view"], block=own * by_view))
        if (calibrated := intrinsics_of(rig, graph, name)) is not None:
            found.append(Component(f"{name} intrinsics", "camera", Size(1.0), columns=calibrated))
        elif intrinsics is not None:
            K = intrinsics * owned[:, None, None]
            found.append(Component(f"{name} focal length", "camera", _open("focal length"), columns=K[..., :1]))
            found.append(Component(f"{name} principal point", "camera", _open("principal point"), columns=K[..., 1:3]))
    if shared:
        for name in rig.targets:
            owned = np.array([target == name for _, target, _ in of_view])[graph.view]
            K = np.zeros((graph.E, 6, 1))
            K[:, 3:, 0] = graph.C[:, :3, 3] * owned[:, None]
            found.append(Component(f"{name} scale", "camera", SIZES["target scale"], columns=K))
    return tuple(found)


def _open(name: str) -> Size:
    """Size of what a camera's own calibration leaves, between cameras of all kinds."""
    return replace(SIZES[name], factor=OF_CAMERA)


def _by_view(graph: Graph) -> Array:
    """(E, 6, 6) square roots of the shape that the corners of each target give (`shared_errors.view`)."""
    found = np.zeros((graph.E, 6, 6))
    for target in np.unique(graph.W):
        of = target == graph.W
        found[of] = view_block(graph.C[of])
    return found


def _accuracy(graph: Graph, name: str, of: Array, bound: Array | None) -> Component:
    """Errors of the arm over its workspace, of which nothing is declared."""
    poses = _alone(graph.robot[of])
    error = assumed_accuracy().bound(poses if bound is None else _alone(bound))
    columns, left = np.zeros((graph.P, 6, len(error.sd))), np.zeros((graph.P, 6, 6))
    columns[of] = error.at(poses)
    if bound is None and error.left is not None:
        values, vectors = np.linalg.eigh(error.left)
        left[of] = vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
    return Component(f"{name} accuracy", "robot", Size(float(error.sd[0]), error.factor, "m"), columns, left)


def _alone(robot: Array) -> PosePairs:
    return PosePairs(robot, np.broadcast_to(np.eye(4), robot.shape))


def find_sizes(
    rig: Rig, graph: Graph, at: Array, kept: NDArray[np.bool_], shared: bool = True, prior: Prior | None = None
) -> Found:
    """Find the sizes near the poses ``at`` (m, 4, 4), from the views ``kept`` (E,).

    Raises `NotConvergedError` where poses or sizes do not converge.
    """
    parts = components_of(rig, graph, shared)
    used = graph.of_edges(_spread_over(graph, np.flatnonzero(kept)))
    theta = None
    place = _places(graph, used)
    own = tuple(_rows_of(part, *place) for part in parts)
    for done in range(ROUNDS):
        model = _model(rig, used, own, at, prior)
        mode = find_mode(model, theta, GAIN if done else max(GAIN, 1e-2))
        theta = mode.theta
        found = model.of_poses(theta)
        square = float(found.mean @ np.linalg.lstsq(found.covariance, found.mean, rcond=None)[0])
        if done and square < STILL**2 * len(found.mean):
            break
        at = perturb(at, found.mean.reshape(-1, 6))
    else:
        raise NotConvergedError("Noise estimation of the rig did not converge. Give the noise, or look for outliers.")
    mixture = integrate(model, [mode])
    centre = model.of_poses(mixture.mean_theta)
    spread = mixture.about(centre.mean) - centre.covariance
    values, vectors = np.linalg.eigh(0.5 * (spread + spread.T))
    sizes = model.sizes(mixture.mean_theta)
    sd = np.zeros(len(parts))
    sd[model.free] = np.sqrt(np.diag(mixture.covariance_theta))
    lines = tuple(
        {"name": part.name, "size": float(s), "low": float(s * np.exp(-1.96 * d)), "high": float(s * np.exp(1.96 * d)),
         "unit": part.size.unit}
        for part, s, d in zip(parts, sizes.tolist(), sd.tolist(), strict=True)
    )  # fmt: skip
    return Found(_noise(rig, graph, parts, sizes), (vectors * np.maximum(values, 0.0)) @ vectors.T, lines)


def _spread_over(graph: Graph, kept: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return edges of whole groups, spread over all of them, `ENOUGH` at most."""
    if len(kept) <= ENOUGH:
        return kept
    groups = np.unique(graph.group[kept])
    count = max(2, int(len(groups) * ENOUGH / len(kept)))
    some = groups[np.unique(np.linspace(0, len(groups) - 1, count).round().astype(int))]
    chosen = kept[np.isin(graph.group[kept], some)]
    everything = len(np.unique(np.r_[graph.X[kept], graph.W[kept] + graph.m]))
    return chosen if len(np.unique(np.r_[graph.X[chosen], graph.W[chosen] + graph.m])) == everything else kept


def _places(graph: Graph, used: Graph) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Numbers in the graph of the edges and robot poses of a part of it."""
    row_of = {key: k for k, key in enumerate(zip(graph.view.tolist(), graph.row.tolist(), strict=True))}
    pose_of = {key: k for k, key in enumerate(zip(graph.arm.tolist(), graph.pose.tolist(), strict=True))}
    edges = [row_of[key] for key in zip(used.view.tolist(), used.row.tolist(), strict=True)]
    poses = [pose_of[key] for key in zip(used.arm.tolist(), used.pose.tolist(), strict=True)]
    return np.array(edges, dtype=np.intp), np.array(poses, dtype=np.intp)


def _rows_of(part: Component, edges: NDArray[np.intp], poses: NDArray[np.intp]) -> Component:
    return part.rows(poses if part.side == "robot" else edges)


def _model(rig: Rig, graph: Graph, parts: tuple[Component, ...], at: Array, prior: Prior | None) -> LatentModel:
    sides = graph.linearise(at)
    given = _given(rig, graph)
    groups = []
    for batch in graph.batches:
        (b, e), q = batch.edges.shape, batch.robots.shape[1]
        D_R, D_C = graph.by_robots(batch, sides), sides.camera[batch.edges]
        blocks, shared = {}, [np.zeros((b, 6 * e, 0))]
        for k, part in enumerate(parts):
            of_robot = part.side == "robot"
            if part.columns is not None:
                m = part.count
                if of_robot:
                    shared.append(D_R @ part.columns[batch.robots].reshape(b, 6 * q, m))
                else:
                    shared.append((D_C @ part.columns[batch.edges]).reshape(b, 6 * e, m))
            if part.block is not None:
                blocks[k] = (
                    _stacked([D_R[..., 6 * j : 6 * j + 6] @ part.block[batch.robots[:, j]] for j in range(q)], b, e)
                    if of_robot
                    else _diagonal(D_C @ part.block[batch.edges])
                )
        known = _diagonal(D_C @ given[batch.edges]) if given is not None else None
        J = graph.by_unknowns(sides, batch.edges).reshape(b, 6 * e, graph.p)
        groups.append(Rows(J, sides.r[batch.edges].reshape(b, -1), np.concatenate(shared, axis=-1), blocks, known))
    known_poses = None
    if prior:
        of = prior_at(graph, at, prior)
        known_poses = np.block([[of.information, of.gradient[:, None]], [of.gradient[None], np.array([[of.square]])]])
    first, *others = groups
    return LatentModel(
        first.J, first.r, parts, first.shared, first.blocks, first.known, known_poses, tuple(others),
        _covariance_of_sizes(rig, parts),
    )  # fmt: skip


def _stacked(roots: list[Array], b: int, e: int) -> Array:
    total = np.zeros((b, 6 * e, 6 * e))
    for B in roots:
        total += B @ B.mT
    return total


def _diagonal(roots: Array) -> Array:
    """(b, 6e, 6e) block diagonal of the squares of (b, e, 6, k)."""
    b, e = roots.shape[:2]
    found = np.zeros((b, e, 6, e, 6))
    square = roots @ roots.mT
    for k in range(e):
        found[:, k, :, k] = square[:, k]
    return found.reshape(b, 6 * e, 6 * e)


def _given(rig: Rig, graph: Graph) -> Array | None:
    """(E, 6, 6) square roots of the covariances that views came with, or None."""
    if all(view.covariance is None for view in rig.views):
        return None
    found = np.zeros((graph.E, 6, 6))
    for k, view in enumerate(rig.views):
        if view.covariance is not None:
            of = graph.view == k
            S = view.covariance if view.covariance.ndim == 3 else view.covariance[None].repeat(len(view.poses), axis=0)
            found[of] = np.linalg.cholesky(S[graph.row[of]])
    return found


def _covariance_of_sizes(rig: Rig, parts: tuple[Component, ...]) -> Array:
    """Prior covariance of the logarithms of the free sizes: those of one kind of noise of all cameras have a median in
    common.
    """
    free = [part for part in parts if not part.size.is_known]
    C = np.diag([np.log(part.size.factor) ** 2 for part in free])
    for what in OF_EACH_CAMERA:
        names = {f"{name} {what}" for name in rig.cameras}
        of = np.flatnonzero([part.name in names for part in free])
        for i in of:
            for j in of[of != i]:
                C[i, j] = np.log(free[i].size.factor) ** 2 - np.log(APART) ** 2
    return C


def _noise(rig: Rig, graph: Graph, parts: tuple[Component, ...], sizes: Array) -> RigNoise:
    own = {"robot": np.zeros((graph.P, 6, 6)), "camera": np.zeros((graph.E, 6, 6))}
    K: dict[str, list[Array]] = {"robot": [], "camera": []}
    names: list[str] = []
    given = _given(rig, graph)
    if given is not None:
        own["camera"] += given @ given.mT
    for part, s in zip(parts, sizes.tolist(), strict=True):
        if part.block is not None:
            own[part.side] += s * s * part.block @ part.block.mT
        if part.columns is not None:
            for side, n in (("robot", graph.P), ("camera", graph.E)):
                K[side].append(s * part.columns if side == part.side else np.zeros((n, 6, part.count)))
            names += part.parts
    robot, camera = (
        np.concatenate([np.zeros((n, 6, 0)), *K[side]], axis=-1)
        for side, n in (("robot", graph.P), ("camera", graph.E))
    )
    return RigNoise(own["robot"], own["camera"], robot, camera, tuple(names))
