"""Data sets with their truth: arms with errors and cameras with PnP, and rigs without an arm.

The controller reports the nominal poses N(q) of an arm whose true poses are G(q). The camera sees

    eye-in-hand: inv(X) inv(G) W,    eye-to-hand: inv(X) G W

and with ``G = A N B`` over the workspace (`true_arms`), what a user needs is X in the frames of the controller as they
fit the whole workspace: ``B X`` and ``inv(A) W`` eye-in-hand, ``inv(A) X`` and ``B W`` eye-to-hand.

Rigs without an arm have white noise of both sides and one more error: none, a drift, a wrong size of the target or a
wrong focal length. Where the camera drifts, X is its mean over the session.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.one_model.chains import Array, Chain, branch, chain, inverse_kinematics, urdf
from studies.one_model.true_arms import TrueArm, drawn_arm, exponential
from studies.one_model.views import MIDDLE, Camera, by_pnp, drawn_camera, drawn_views, estimated

SETUPS = ("eye-in-hand", "eye-to-hand")
PIXEL_NOISE = (0.1, 0.4)  # pixels, from set to set
NEAR, FAR = 8, 12  # postures held out: as the calibrated ones, and of the spread ``anywhere``
ROUNDS = 6  # of drawing postures, after which the rig is drawn again
# White noise of rigs without an arm, standard deviations (rad, m) drawn log-uniformly between these.
ROBOT, CAMERA = ((1e-4, 2e-5), (1e-3, 2e-4)), ((3e-4, 1e-4), (3e-3, 1e-3))
STEP = ((2e-5, 2e-5), (2e-4, 2e-4))  # rad and m per pose of a slow drift
WRONG_SQUARE, WRONG_FOCAL = 0.01, 0.005


class Spread(NamedTuple):
    """Views of a session (rad, m; see `drawn_views`) and where inverse kinematics starts about home (rad)."""

    tilt: float
    roll: float
    distance: tuple[float, float]
    part: float
    start: float


SPREADS = {
    "local": Spread(np.radians(25.0), np.radians(45.0), (0.3, 0.6), 0.3, 0.1),
    "anywhere": Spread(np.radians(65.0), np.pi, (0.3, 0.9), 0.6, 0.8),
    "distant": Spread(np.radians(65.0), np.pi, (0.3, 1.6), 0.8, 0.8),
}


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Postures that were not calibrated: joints, the poses that the controller reports, and what is true there.

    ``seen`` are the camera poses by PnP from corners without noise: with the intrinsics that the calibrated poses have.
    """

    joints: Array  # (m, L) rad
    robot: Array  # (m, 4, 4) nominal
    true_robot: Array  # (m, 4, 4)
    true_camera: Array  # (m, 4, 4) camera_T_target
    seen: Array  # (m, 4, 4)


@dataclass(frozen=True, eq=False)
class DataSet:
    """One session, and the truth in the frames aligned over the workspace.

    ``true_camera`` are the camera poses without noise. A rig without an arm has no joints, URDF and held-out postures.
    """

    poses: uq.PosePairs
    X_true: Array
    W_true: Array
    true_camera: Array
    arm: str = ""
    urdf: str | None = None
    joints: Array | None = None
    true_arm: TrueArm | None = None
    near: HeldOut | None = None
    far: HeldOut | None = None


def inverse(T: Array) -> Array:
    """Return the inverse of poses (..., 4, 4)."""
    found = np.zeros_like(T)
    found[..., :3, :3] = T[..., :3, :3].mT
    found[..., :3, 3] = -(T[..., :3, :3].mT @ T[..., :3, 3, None])[..., 0]
    found[..., 3, 3] = 1.0
    return found


def arm_set(
    arm: str,
    accuracy: float,
    rng: np.random.Generator,
    *,
    n: int = 30,
    spread: str = "local",
    setup: str = "eye-in-hand",
    intrinsics: str = "estimated",
    corner_noise: float | None = None,
    repeatable: bool = True,
) -> DataSet:
    """Draw a session of an arm of ``accuracy`` (m).

    Parameters
    ----------
    intrinsics : "estimated" or "exact"
        Those that PnP is given.
    corner_noise : float or None
        Pixels; None draws it from `PIXEL_NOISE`.
    repeatable : bool
        With noise of the joints; False: none.
    """
    of = chain(arm)
    true_arm, A, B = drawn_arm(of, accuracy, rng)
    camera = drawn_camera(rng)
    given = estimated(camera, rng) if intrinsics == "estimated" else camera
    X, W, home, q = _session(of, camera, n + NEAR, SPREADS[spread], setup, rng)
    noise = rng if repeatable else None
    views = _views(setup, X, W, true_arm.poses(q[:n], noise))
    sd = float(np.exp(rng.uniform(*np.log(PIXEL_NOISE)))) if corner_noise is None else corner_noise
    pixels = camera.corners(views)
    seen = by_pnp(pixels + sd * rng.standard_normal(pixels.shape), given)

    far = _joints(of, camera, X, W, home, FAR, SPREADS["anywhere"], setup, rng)

    def held_out(joints: Array) -> HeldOut:
        G = true_arm.poses(joints)
        true = _views(setup, X, W, G)
        return HeldOut(joints, of.poses(joints), G, true, by_pnp(camera.corners(true), given))

    return DataSet(
        uq.PosePairs(of.poses(q[:n]), seen, setup),
        B @ X if setup == "eye-in-hand" else inverse(A) @ X,
        inverse(A) @ W if setup == "eye-in-hand" else B @ W,
        views,
        arm,
        urdf(of),
        q[:n],
        true_arm,
        held_out(q[n:]),
        held_out(far),
    )


def _views(setup: str, X: Array, W: Array, G: Array) -> Array:
    return np.asarray(inverse(X) @ (inverse(G) if setup == "eye-in-hand" else G) @ W)


def _mount(rng: np.random.Generator, *, facing: bool) -> Array:
    """Draw what the flange carries, a few centimetres away: a camera that looks outward, or a board that faces so."""
    a = np.concatenate([0.15 * rng.standard_normal(3), rng.uniform([-0.08, -0.08, 0.02], [0.08, 0.08, 0.1])])
    T = exponential(a)
    T[:3, :3] = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)]).as_matrix() @ T[:3, :3]
    if facing:
        T[:3, :3] = T[:3, :3] @ np.diag([1.0, -1.0, -1.0])
    return T


def _session(
    of: Chain, camera: Camera, n: int, spread: Spread, setup: str, rng: np.random.Generator
) -> tuple[Array, Array, Array, Array]:
    """Draw X, W, the joints at home and those (n, L) of the session."""
    free = np.full(of.n_joints, 0.25)
    free[[0, -1]] = 1.2
    low, high = 0.9 * of.range.T
    while True:
        home = np.clip(of.home + rng.uniform(-free, free), low, high)
        G = of.poses(home[None])[0]
        first = drawn_views(camera, 1, rng, tilt=0.2, roll=np.pi, distance=(0.4, 0.5), part=0.1)[0]
        mount = _mount(rng, facing=setup == "eye-to-hand")
        X, W = (mount, G @ mount @ first) if setup == "eye-in-hand" else (G @ mount @ inverse(first), mount)
        q = _joints(of, camera, X, W, home, n, spread, setup, rng)
        if len(q) == n:
            return X, W, home, q


def _joints(
    of: Chain,
    camera: Camera,
    X: Array,
    W: Array,
    home: Array,
    n: int,
    spread: Spread,
    setup: str,
    rng: np.random.Generator,
) -> Array:
    """Draw joints (n, L), or fewer, of the branch of home at which the camera sees the whole board."""
    at_home = of.poses(home[None])
    first = _views(setup, X, W, at_home)[0]
    found = np.empty((0, of.n_joints))
    for _ in range(ROUNDS):
        views = drawn_views(
            camera, 2 * n, rng, tilt=spread.tilt, roll=spread.roll, distance=spread.distance, part=spread.part
        )
        _roll_about(views, first)  # so that the wrist is near its middle
        views = views[camera.sees(views)]
        back = X @ views @ inverse(W)
        start = home + rng.uniform(-spread.start, spread.start, (len(views), of.n_joints))
        q, reached = inverse_kinematics(of, inverse(back) if setup == "eye-in-hand" else back, start)
        q = q[reached & (of.poses(q)[:, 2, 3] > 0.0)]
        found = np.concatenate([found, q[(branch(of, q) == branch(of, home[None])).all(axis=1)]])
        if len(found) >= n:
            break
    return found[:n]


def _roll_about(views: Array, first: Array) -> None:
    """Turn views, in place, about the board's normal through its middle by the roll of the ``first`` one (4, 4)."""
    angle = np.arctan2(first[1, 0], first[0, 0])
    R = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    middle = views[:, :3, :3] @ MIDDLE + views[:, :3, 3]
    views[:, :3, :3] = views[:, :3, :3] @ R
    views[:, :3, 3] = middle - views[:, :3, :3] @ MIDDLE


def simple_set(kind: str, rng: np.random.Generator, *, n: int = 30, setup: str = "eye-in-hand") -> DataSet:
    """Draw a rig without an arm: ``white``, ``drift``, ``wrong_square`` or ``wrong_focal``.

    The board is seen from 0.4 to 0.8 m within 35 deg of its normal and 60 deg about the line of sight. ``drift`` has
    timestamps. Camera poses have white noise; those of ``wrong_focal`` come from corners by PnP.
    """
    camera = drawn_camera(rng)
    X, W = (_random_pose(rng, size) for size in ((0.1, 0.8) if setup == "eye-in-hand" else (0.8, 0.1)))
    views = np.empty((0, 4, 4))
    while len(views) < n:
        drawn = drawn_views(camera, 2 * n, rng, tilt=np.radians(35), roll=np.radians(60), distance=(0.4, 0.8), part=0.5)
        views = np.concatenate([views, drawn[camera.sees(drawn)]])[:n]
    robot = X @ views @ inverse(W)
    if setup == "eye-in-hand":
        robot = inverse(robot)
    seen, times = views, None
    if kind == "drift":
        walk = _drawn_sizes(STEP, rng) * np.cumsum(rng.standard_normal((n, 6)), axis=0)
        walk -= walk.mean(axis=0)
        camera_moves = bool(rng.integers(2))
        Xs, Ws = (_moved(X, walk), W) if camera_moves else (X, _moved(W, walk))
        seen, times = _views(setup, Xs, Ws, robot), np.arange(float(n))
    robot_sd, camera_sd = _drawn_sizes(ROBOT, rng), _drawn_sizes(CAMERA, rng)
    sign = float(rng.choice([-1.0, 1.0]))
    if kind == "wrong_focal":
        pixels = camera.corners(seen)
        sd = float(np.exp(rng.uniform(*np.log(PIXEL_NOISE))))
        wrong = Camera(camera.focal * (1.0 + sign * WRONG_FOCAL), camera.centre, camera.lens)
        measured = by_pnp(pixels + sd * rng.standard_normal(pixels.shape), wrong)
    else:
        measured = _moved(seen, camera_sd * rng.standard_normal((n, 6)))
        if kind == "wrong_square":
            measured[:, :3, 3] *= 1.0 + sign * WRONG_SQUARE
    poses = uq.PosePairs(_moved(robot, robot_sd * rng.standard_normal((n, 6))), measured, setup, times)
    return DataSet(poses, X, W, seen)


SIMPLE = ("white", "drift", "wrong_square", "wrong_focal")


def _drawn_sizes(between: Sequence[Sequence[float]], rng: np.random.Generator) -> Array:
    """Draw standard deviations (6,) log-uniformly."""
    return np.repeat(np.exp(rng.uniform(*np.log(between))), 3)


def _moved(T: Array, a: Array) -> Array:
    """Return ``R = exp([theta]x) R``, ``t = t + tau`` for errors a (n, 6)."""
    found = np.array(np.broadcast_to(T, (len(a), 4, 4)))
    found[:, :3, :3] = Rotation.from_rotvec(a[:, :3]).as_matrix() @ found[:, :3, :3]
    found[:, :3, 3] += a[:, 3:]
    return found


def _random_pose(rng: np.random.Generator, size: float) -> Array:
    """Draw a pose of any rotation, at a distance of about ``size`` (m)."""
    T = np.eye(4)
    T[:3, :3] = Rotation.random(rng=rng).as_matrix()
    T[:3, 3] = size * rng.uniform(-1.0, 1.0, 3)
    return T
