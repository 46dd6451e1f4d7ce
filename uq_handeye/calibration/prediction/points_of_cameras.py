r"""Position of a point that a camera of a rig sees, in the world or in the frame of another camera.

With ``K_i = [B_a G_a] X_i`` the pose of camera i, ``x = K_i p``; an error xi of a factor T of K moves x by
``R_< (theta x R s + tau)``, R_< the rotation of the factors before T, R that of T, s the point in the frame of T's
child. In the frame of camera j, ``q = K_j^-1 x``, the difference of both moves counts, rotated by ``R_j^T``: what i and
j share, such as the robot pose of one arm, cancels. The errors are those of the posterior and the noise of the robot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...core.files.records import Record
from ...core.geometry.checks import as_transforms
from ...core.geometry.se3 import Array, inverse, perturb, skew
from ...errors import InputError
from ...fit.diagnostics.task_space import by_pose
from ...fit.graph.graph import Graph
from ...model.errors.cholesky import factor
from ...model.rig.description import WORLD, ArmPoses, Rig, View
from ..rig_poses import RigPoses
from .noise_of_views import new_noise, posterior_of

# Name of a target that no rig has.
_AHEAD = " ahead"


@dataclass(frozen=True, eq=False)
class RigPoints(Record):
    """Points (k, n, 3) at k robot poses with their covariances (k, n, 3, 3), m, in the frame ``frame``."""

    _in_file: ClassVar[str] = "frame points covariance"

    frame: str
    points: Annotated[Array, "k", "n", 3]
    covariance: Annotated[Array, "k", "n", 3, 3]

    @property
    def std(self) -> Array:
        """(k, n, 3) standard deviations (m)."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))


def predict_points(
    result: RigPoses, camera: str, points: ArrayLike, robot: Mapping[str, ArrayLike] | None = None, into: str = WORLD
) -> RigPoints:
    """Predict where points in the frame of a camera are.

    Parameters
    ----------
    result : RigCalibration
    camera : str
    points : (n, 3) or (3,)
        In the frame of the camera, m.
    robot : mapping of names of arms to poses (k, 4, 4) or (4, 4), or None
        Poses of the arms, row by row; None for cameras fixed in the world, and for two cameras of one arm.
    into : "world" or the name of a camera

    Raises
    ------
    InputError
        Names that the rig does not have, an arm without poses, a result whose directions are open.
    """
    rig = result.rig
    for name in {camera, into} - {WORLD}:
        if name not in rig.cameras:
            raise InputError(f"Expected the name of one of {', '.join(rig.cameras)}, got {name!r}.")
    p = np.atleast_2d(np.asarray(points, dtype=float))
    if p.ndim != 2 or p.shape[1] != 3 or not np.isfinite(p).all():
        raise InputError(f"Expected `points` to be (n, 3) numbers, got shape {p.shape}.")
    names = [name for name in (camera, into) if name != WORLD]
    if opened := [name for name in names if len(result.cameras[name].open)]:
        raise InputError(f"The pose of {opened[0]!r} is not determined in all directions, so points are not predicted.")
    arms = list(dict.fromkeys(place for name in names if (place := rig.cameras[name]) != WORLD))
    if robot is None and len(names) == 2 and len(arms) == 1 and rig.cameras[camera] == rig.cameras[into]:
        robot = {arms[0]: rig.arms[arms[0]].poses[0]}  # anywhere: it carries both, and cancels
    at = {name: _poses(robot, name) for name in arms}
    if len({len(T) for T in at.values()}) > 1:
        raise InputError("Expected as many robot poses of each arm, row by row.")
    k = len(next(iter(at.values()))) if at else 1
    K, F, S = _errors_of_cameras(result, names, at, k)
    x = p @ K[0, :, :3, :3].mT + K[0, :, None, :3, 3]
    by = by_pose(x - K[0, :, None, :3, 3]) @ F[0, :, None]
    if into != WORLD:
        K_j, by_j = K[1, :, None, :3], by_pose(x - K[1, :, None, :3, 3]) @ F[1, :, None]
        by = K_j[..., :3].mT @ (by - by_j)
        x = (x - K_j[..., 3]) @ K[1, :, :3, :3]
    found = by @ S @ by.mT
    return RigPoints(into, np.ascontiguousarray(x), 0.5 * (found + found.mT))


def _poses(robot: Mapping[str, ArrayLike] | None, arm: str) -> Array:
    if robot is None or arm not in robot:
        raise InputError(f"Expected the robot poses of the arm {arm!r}, which carries a camera.")
    T = as_transforms(robot[arm], f"robot[{arm!r}]", stack=False)
    return T[None] if T.ndim == 2 else T


def _errors_of_cameras(
    result: RigPoses, names: Sequence[str], at: Mapping[str, Array], k: int
) -> tuple[Array, Array, Array]:
    """Poses (c, k, 4, 4) of cameras at k robot poses, what errors do to them (c, k, 6, M), their covariance (M, M).

    The errors are those of the posterior and one of unit variance for each number of a robot pose of each arm.
    """
    rig, posterior = result.rig, posterior_of(result)
    C = np.broadcast_to(perturb(np.eye(4), np.eye(6)[5]), (k, 4, 4))  # of a target 1 m ahead of each, that is exact
    arms = {name: arm.like(ArmPoses(at[name])) if name in at else arm for name, arm in rig.arms.items()}
    views = (View(name, _AHEAD, C, None if rig.cameras[name] == WORLD else tuple(range(k))) for name in names)
    alone = Rig(arms, {name: rig.cameras[name] for name in names}, {_AHEAD: WORLD}, tuple(views))
    graph = Graph.of(alone)
    noise = new_noise(result, alone, graph, measured=False)
    robot = perturb(graph.robot, -(noise.K_robot @ posterior.estimate[:, None])[..., 0])
    poses = dict(zip(result.names, result.poses, strict=True))
    T = np.stack([poses.get(name, np.eye(4)) for name in graph.names])
    J, (by_robot, _), N = graph.by_unknowns(sides := graph.linearise(T, robot)), sides.robot, len(posterior.covariance)
    F = np.zeros((graph.E, 6, N + 6 * len(arms)))
    for u, name in enumerate(graph.names):
        if name in poses:
            F[..., posterior.block(name)] = J[..., 6 * u : 6 * u + 6]
    for e in np.flatnonzero(graph.side[0] < graph.P):
        g = graph.side[0][e]
        of, D = N + 6 * int(graph.arm[g]), by_robot[e]
        F[e, :, N - noise.count : N] = D @ noise.K_robot[g]
        F[e, :, of : of + 6] = D @ factor(noise.robot[g])
    L = graph.products(T, robot)[0]
    F[:, 3:] += skew(L[:, :3, 2]) @ F[:, :3]  # from the target to the camera: the lever is the axis of view
    S = np.eye(F.shape[-1])
    S[:N, :N] = posterior.covariance
    return (L @ inverse(graph.C)).reshape(-1, k, 4, 4), F.reshape(-1, k, *F.shape[1:]), S
