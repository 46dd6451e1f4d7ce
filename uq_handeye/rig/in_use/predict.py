r"""Position of a point that a camera of a rig sees, in the world or in the frame of another camera, with covariance.

With ``K_i = [B_a G_a] X_i`` the pose of camera i, ``x = K_i p``; an error xi of a factor T of K moves x by
``R_< (theta x R s + tau)``, R_< the rotation of the factors before T, R that of T, s the point in the frame of T's
child. In the frame of camera j, ``q = K_j^-1 x``, the difference of both moves counts, rotated by ``R_j^T``: what i and
j share, such as the robot pose of one arm, cancels. The errors are those of the posterior and the noise of the robot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from ...core.files.records import Record
from ...core.geometry.checks import as_transforms
from ...core.geometry.se3 import Array, inverse, perturb, skew
from ...errors import InputError
from ..description import WORLD, ArmPoses, Rig, View
from ..graph import Graph
from .evidence import new_noise


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
    result: Any, camera: str, points: Any, robot: Mapping[str, Any] | None = None, into: str = WORLD
) -> RigPoints:
    """Predict where points in the frame of a camera are.

    Parameters
    ----------
    result : RigCalibration
    camera : str
    points : (n, 3) or (3,)
        In the frame of the camera, m.
    robot : mapping of names of arms to poses (k, 4, 4) or (4, 4), or None
        Where the arms stand, row by row; None for cameras that stand still, and for two cameras of one arm.
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
    chain = _Chain(result, at, k)
    x, F = chain.moved(camera, np.broadcast_to(p, (k, *p.shape)))
    if into != WORLD:
        K = chain.pose(into)
        x = (inverse(K)[:, None] @ np.concatenate([x, np.ones((*x.shape[:2], 1))], axis=-1)[..., None])[..., :3, 0]
        _, other = chain.moved(into, x)
        F = K[:, None, :3, :3].mT @ (F - other)
    S = F @ chain.covariance[:, None] @ F.mT
    return RigPoints(into, np.ascontiguousarray(x), 0.5 * (S + S.mT))


def _poses(robot: Mapping[str, Any] | None, arm: str) -> Array:
    if robot is None or arm not in robot:
        raise InputError(f"Expected the robot poses of the arm {arm!r}, which carries a camera.")
    T = as_transforms(robot[arm], f"robot[{arm!r}]", stack=False)
    return T[None] if T.ndim == 2 else T


class _Chain:
    """Poses of cameras at k robot poses, and the errors of all: posterior (N,), then noise of each arm (6,)."""

    def __init__(self, result: Any, at: Mapping[str, Array], k: int) -> None:
        self.result, self.arms, self.k = result, list(at), k
        posterior, rig = result.posterior, result.rig
        if posterior is None:
            raise InputError("Expected the result of a rig with its posterior. Calibrate again.")
        self.N = len(posterior.covariance)
        self.covariance = np.zeros((k, self.N + 6 * len(at), self.N + 6 * len(at)))
        self.covariance[:, : self.N, : self.N] = posterior.covariance
        self.robot, self.K = {}, {}
        for a, (name, T) in enumerate(at.items()):
            place = self.N + 6 * a
            ahead = np.broadcast_to(perturb(np.eye(4), np.eye(6)[5]), (k, 4, 4))
            alone = Rig(
                {name: rig.arms[name].like(ArmPoses(T))}, {"at": name}, {"it": WORLD}, (View("at", "it", ahead),)
            )
            noise = new_noise(result, alone, Graph.of(alone))
            self.robot[name] = perturb(T, -(noise.K_robot @ posterior.estimate[:, None])[..., 0])
            self.K[name] = noise.K_robot
            self.covariance[:, place : place + 6, place : place + 6] = noise.robot

    def factors(self, camera: str) -> list[tuple[str, Array]]:
        """Factors (k, 4, 4) of the pose of a camera with what they are."""
        result, place = self.result, self.result.rig.cameras[camera]
        found: list[tuple[str, Array]] = [(camera, result.cameras[camera].pose)]
        if place != WORLD:
            found.insert(0, ("", self.robot[place]))
            if place in result.names:
                found.insert(0, (place, result.arms[place].pose))
        return [(name, np.broadcast_to(T, (self.k, 4, 4))) for name, T in found]

    def pose(self, camera: str) -> Array:
        """(k, 4, 4) in the world."""
        T = np.broadcast_to(np.eye(4), (self.k, 4, 4))
        for _, factor in self.factors(camera):
            T = T @ factor
        return np.asarray(T)

    def moved(self, camera: str, p: Array) -> tuple[Array, Array]:
        """World points (k, n, 3) of points p (k, n, 3) of a camera, and derivatives (k, n, 3, N + 6 arms)."""
        factors, place = self.factors(camera), self.result.rig.cameras[camera]
        F = np.zeros((*p.shape, self.covariance.shape[-1]))
        x = p
        for i, (name, T) in reversed(list(enumerate(factors))):
            before = np.broadcast_to(np.eye(3), (self.k, 3, 3))
            for _, factor in factors[:i]:
                before = before @ factor[:, :3, :3]
            turned = (T[:, None, :3, :3] @ x[..., None])[..., 0]
            D = np.concatenate([-skew(turned), np.broadcast_to(np.eye(3), (*p.shape, 3))], axis=-1)
            D = before[:, None] @ D  # (k, n, 3, 6)
            if name:
                u = 6 * self.result.names.index(name)
                F[..., u : u + 6] += D
            else:
                at = self.N + 6 * self.arms.index(place)
                F[..., at : at + 6] += D
                m = self.K[place].shape[-1]
                F[..., self.N - m : self.N] += D @ self.K[place][:, None]
            x = turned + T[:, None, :3, 3]
        return x, F
