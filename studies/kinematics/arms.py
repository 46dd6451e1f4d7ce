"""Arms that are not as their URDF says: exact forward kinematics with errors drawn once, poses as users take them.

The true pose of the robot at the joints q that it reports is

    G = FK(q + n + u(q); e),    n ~ N(0, joint_sd^2) at each pose again,    u: smooth, and in no model

with e drawn from the scales of the groups of `Kinematics.errors`, also those that X and W absorb. The camera sees

    eye-in-hand: inv(X) inv(G) W,    eye-to-hand: inv(X) G W         with noise (theta, tau) of the camera.

An arm comes from three files beside this one, written from published nominal dimensions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.common.scores import errors
from uq_handeye.core.geometry.se3 import Array, inverse, perturb

HERE = Path(__file__).parent / "arms"
# Where the arm takes its pictures: the flange looks down.
HOMES = {
    "ur5_like": (0.0, -1.8, 1.9, -1.67, -1.57, 0.0),
    "irb120_like": (0.0, 0.3, 0.1, 0.0, 1.1, 0.0),
    "panda_like": (0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8),
}
ARMS = tuple(HOMES)
GEOMETRY = ("joint offsets", "joint tilts", "link lengths")
GROUPS = (*GEOMETRY, "transmission", "sag")
MOST = np.pi  # rad; a joint that may turn further is used as far as this
NEAR_TURN, NEAR_MOVE = np.radians(30.0), 0.15  # of a local set, from one view
DISTANCE = 0.4  # m, from the camera to the target
STEPS = 40  # of the inverse kinematics
REACHED = 1e-8


@cache
def arm(name: str) -> uq.Kinematics:
    """One of `ARMS`, read from its URDF."""
    return uq.Kinematics.from_urdf(HERE / f"{name}.urdf")


def home(name: str) -> Array:
    return np.array(HOMES[name])


def drawn_errors(kinematics: uq.Kinematics, scales: Mapping[str, float], rng: np.random.Generator) -> Array:
    """e (m,) of one arm: normal with the standard deviation of the group, 0 for groups without one."""
    sd = np.array([scales.get(error.group, 0.0) for error in kinematics.errors])
    return np.asarray(sd * rng.standard_normal(len(sd)))


@dataclass(frozen=True, eq=False)
class Unmodelled:
    """``u_k(q) = sum_j amplitude_kj sin(a_kj . q + phase_kj)``: products of functions of two joints, smooth."""

    amplitudes: Array  # (L, terms) rad
    waves: Array  # (L, terms, L)
    phases: Array  # (L, terms)

    @classmethod
    def drawn(cls, joints: int, sd: float, rng: np.random.Generator, terms: int = 4) -> Unmodelled:
        """Draw the errors of so many joints, with the standard deviation ``sd`` (rad) of each over all poses."""
        waves = np.zeros((joints, terms, joints))
        for wave in waves.reshape(-1, joints):
            wave[rng.choice(joints, 2, replace=False)] = rng.choice([-1.0, 1.0], 2)
        amplitudes = sd * np.sqrt(2 / terms) * rng.standard_normal((joints, terms))
        return cls(amplitudes, waves, rng.uniform(0, 2 * np.pi, (joints, terms)))

    def at(self, q: Array) -> Array:
        """(..., L) rad."""
        return np.asarray(
            (self.amplitudes * np.sin(np.einsum("...j,ktj->...kt", q, self.waves) + self.phases)).sum(axis=-1)
        )


@dataclass(frozen=True, eq=False)
class Rig:
    """An arm with its errors, a camera and a target."""

    kinematics: uq.Kinematics
    e: Array  # (m,)
    setup: str
    X: Array
    W: Array
    joint_sd: float  # rad
    camera_sd: Array  # (6,)
    unmodelled: Unmodelled | None = None

    def true_robot(self, q: Array) -> Array:
        """base_T_tip (..., 4, 4) at joints that are exactly as reported."""
        moved = q if self.unmodelled is None else q + self.unmodelled.at(q)
        return np.asarray(self.kinematics.poses(moved, self.e))

    def true_camera(self, G: Array) -> Array:
        """camera_T_target (..., 4, 4) at poses of the robot."""
        return np.asarray(inverse(self.X) @ (inverse(G) if self.setup == "eye-in-hand" else G) @ self.W)

    def seen(self, q: Array, rng: np.random.Generator) -> Array:
        """Return what the camera measures at joints reported as q: with the noise of the joints and of the camera."""
        C = self.true_camera(self.true_robot(q + self.joint_sd * rng.standard_normal(q.shape)))
        return perturb(C, self.camera_sd * rng.standard_normal((*q.shape[:-1], 6)))

    def poses(self, q: Array, rng: np.random.Generator) -> uq.PosePairs:
        """Return the recorded data: poses of the robot by the URDF, camera poses, joints."""
        return uq.PosePairs(self.kinematics.poses(q), self.seen(q, rng), self.setup, joints=q)

    @property
    def gauge(self) -> tuple[Array, Array]:
        """A and B with ``FK(q; e) = A FK(q; e without the gauge columns) B``, but for products of two errors."""
        kept = np.where([error.gauge for error in self.kinematics.errors], 0.0, self.e)
        first = np.where([error.gauge and error.joint == self.kinematics.names[0] for error in self.errors], self.e, 0)
        at = np.zeros(self.kinematics.n_joints)
        A = self.kinematics.poses(at, kept + first) @ inverse(self.kinematics.poses(at, kept))
        return A, inverse(self.kinematics.poses(at, kept)) @ inverse(A) @ self.kinematics.poses(at, self.e)

    @property
    def errors(self) -> tuple[uq.ErrorParameter, ...]:
        return tuple(self.kinematics.errors)

    @property
    def X_of_controller(self) -> Array:
        """X to the flange (base, eye-to-hand) in which joint L (joint 1) moves as the URDF says: what is estimated."""
        A, B = self.gauge
        return np.asarray(B @ self.X if self.setup == "eye-in-hand" else inverse(A) @ self.X)


def drawn_rig(
    name: str,
    setup: str,
    scales: Mapping[str, float],
    rng: np.random.Generator,
    *,
    joint_sd: float,
    camera_sd: Array,
    unmodelled: float = 0.0,
) -> Rig:
    """Camera and target where the arm at home sees the target at `DISTANCE`; errors drawn from their scales."""
    kinematics = arm(name)
    e = drawn_errors(kinematics, scales, rng)
    G = kinematics.poses(home(name))
    # The camera on the hand, or the target: looks (is seen) along the flange's z, with a lever of a few centimetres.
    mount = np.eye(4)
    mount[:3, 3] = rng.uniform([-0.06, -0.06, 0.03], [0.06, 0.06, 0.09])
    mount[:3, :3] = Rotation.from_rotvec([0, 0, rng.uniform(-np.pi, np.pi)]).as_matrix()
    mount = perturb(mount, np.concatenate([0.15 * rng.standard_normal(3), np.zeros(3)]))
    C = facing(rng)
    if setup == "eye-in-hand":
        X, W = mount, G @ mount @ C
    else:
        X, W = G @ mount @ inverse(C), mount
    smooth = Unmodelled.drawn(kinematics.n_joints, unmodelled, rng) if unmodelled else None
    return Rig(kinematics, e, setup, X, W, joint_sd, camera_sd, smooth)


def facing(rng: np.random.Generator) -> Array:
    """camera_T_target of a target that faces the camera at `DISTANCE`, tilted a little."""
    C = np.eye(4)
    C[:3, :3] = Rotation.from_rotvec([np.pi, 0.0, 0.0]).as_matrix()
    C[2, 3] = DISTANCE
    return perturb(C, np.concatenate([0.2 * rng.standard_normal(3), np.zeros(3)]))


def local_joints(rig: Rig, name: str, n: int, rng: np.random.Generator) -> Array:
    """(n, L) joints of views about that of home: within 0.3 m and 30 deg, as users take them."""
    kinematics = rig.kinematics
    start = home(name)
    C0 = inverse(rig.X) @ (inverse(kinematics.poses(start)) if rig.setup == "eye-in-hand" else kinematics.poses(start))
    C0 = C0 @ rig.W
    found = np.empty((0, kinematics.n_joints))
    while len(found) < n:
        axis = rng.standard_normal((2 * n, 3))
        axis *= NEAR_TURN * np.cbrt(rng.uniform(size=(2 * n, 1))) / np.linalg.norm(axis, axis=-1, keepdims=True)
        C = perturb(C0, np.concatenate([axis, rng.uniform(-NEAR_MOVE, NEAR_MOVE, (2 * n, 3))], axis=-1))
        back = rig.X @ C @ inverse(rig.W)
        q, ok = inverse_kinematics(kinematics, inverse(back) if rig.setup == "eye-in-hand" else back, start)
        found = np.concatenate([found, q[ok]])
    return found[:n]


def workspace_joints(kinematics: uq.Kinematics, n: int, rng: np.random.Generator) -> Array:
    """(n, L) joints anywhere between the limits, the tip above the floor."""
    low, high = np.clip(kinematics.limits, -MOST, MOST).T
    found = np.empty((0, kinematics.n_joints))
    while len(found) < n:
        q = rng.uniform(low, high, (2 * n, len(low)))
        found = np.concatenate([found, q[kinematics.poses(q)[:, 2, 3] > 0.0]])
    return found[:n]


def inverse_kinematics(kinematics: uq.Kinematics, wanted: Array, start: Array) -> tuple[Array, Array]:
    """Joints (n, L) from ``start`` on that bring the tip to ``wanted`` (n, 4, 4), and which do so inside the limits."""
    q = np.tile(start, (len(wanted), 1))
    for _ in range(STEPS):
        e = errors(wanted, kinematics.poses(q))
        if np.abs(e).max() < REACHED:
            break
        J = kinematics.jacobian(q)
        step = (J.mT @ np.linalg.solve(J @ J.mT + 1e-8 * np.eye(6), e[..., None]))[..., 0]
        q = q + np.clip(step, -0.3, 0.3)
    low, high = kinematics.limits.T
    reached = np.abs(errors(wanted, kinematics.poses(q))).max(axis=-1) < 1e-6
    return q, reached & ((q >= low) & (q <= high)).all(axis=-1)
