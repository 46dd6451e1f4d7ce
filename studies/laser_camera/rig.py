"""A hand-carried rig of a spinning laser scanner and a camera with an IMU: its motion, its two pose streams, its drift.

Model: both sensors are rigidly mounted, ``X = scanner_T_camera``. Each reports poses in the frame of its own start, on
its own clock, ``scanner_time = camera_time + offset``:

- scanner, once per second, by matching its scan with a map: ``start_T_scanner`` with white noise;
- camera, 200 times per second, by visual-inertial odometry: ``start_T_camera`` with white noise and drift.

In the words of the library the scanner is the robot and the inverse pose of the camera, ``camera_T_start``, that of the
target; ``W = scanner's start_T_camera's start`` is a nuisance, ``G X C = W``. White noise is that of
``start_T_scanner`` and of ``camera_T_start``: left rotation, additive translation, rad and m.

Drift is that of dead reckoning. The error of attitude is a random walk theta(t), and displacements are added up in the
frame that it turns: ``R = exp([theta]x) R_true``, ``p(t) = int exp([theta(s)]x) dp_true(s) + tau(t)``, tau another
random walk. To first order each step eta of theta at time s turns all that follows about the place where it happened,

    xi(t) = sum over s < t of (eta, eta x (p(t) - p(s))) + (0, tau(t))                                (drift_covariance)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import Array, inverse, inverse_jacobian, perturb, skew
from uq_handeye.trials.simulation.rig import disturbed

CAMERA_RATE, SCANNER_RATE = 200.0, 1.0  # Hz
SCANS = 60  # of a calibration
LARGEST_OFFSET = 0.3  # s
# Axes of a camera (z ahead) on a scanner (x ahead), not quite as drawn.
X = np.eye(4)
X[:3, :3] = (
    Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]) * Rotation.from_rotvec([0.05, -0.03, 0.04])
).as_matrix()
X[:3, 3] = [0.06, -0.02, -0.11]
# What the drawing of the mount is wrong by: rad and m.
MISALIGNED = np.r_[np.radians([5.0, -6.0, 4.0]), 0.05, -0.04, 0.03]
NOMINAL = perturb(X, MISALIGNED)
# Steps per second at which drift is added up for its covariance.
DRIFT_STEPS = 10

Path = Callable[[Array], Array]  # seconds (...) -> world_T_camera (..., 4, 4)


@dataclass(frozen=True)
class Sensors:
    """Standard deviations per axis, rad and m; of the random walks after one second."""

    scanner: tuple[float, float] = (2e-3, 5e-3)
    camera: tuple[float, float] = (3e-4, 1e-3)
    drift: tuple[float, float] = (0.0, 0.0)

    def drifting(self, times: float = 1.0) -> Sensors:
        """Return sensors with ``times`` times a drift of 0.5 mrad and 2 mm after a second."""
        return replace(self, drift=(5e-4 * times, 2e-3 * times))

    @property
    def white(self) -> uq.PoseNoise:
        """Noise of the samples of the streams."""
        return uq.PoseNoise(*(np.diag(np.repeat(deviations, 3) ** 2.0) for deviations in (self.scanner, self.camera)))


def poses(rotation: Array, position: Array) -> Array:
    """(..., 3) rotation vectors and positions to (..., 4, 4)."""
    T = np.zeros((*position.shape[:-1], 4, 4))
    T[..., :3, :3] = Rotation.from_rotvec(rotation.reshape(-1, 3)).as_matrix().reshape(*position.shape[:-1], 3, 3)
    T[..., :3, 3] = position
    T[..., 3, 3] = 1.0
    return T


def waved(rng: np.random.Generator, duration: float) -> Path:
    """The rig in both hands, rotated about all axes and moved about within a metre: splines through random knots."""
    knots = np.arange(-6.0, duration + 6.0, 2.5)
    turn = make_interp_spline(knots, 0.8 * rng.normal(size=(len(knots), 3)), 5)
    place = make_interp_spline(knots, 0.4 * rng.normal(size=(len(knots), 3)), 5)
    return lambda t: poses(turn(np.asarray(t, dtype=float)), place(np.asarray(t, dtype=float)))


class Loop(NamedTuple):
    """A walk from origin to origin: sums of sines of the share of the way, metres; the rig looks half along it."""

    duration: float  # s
    x: tuple[tuple[int, float, float], ...]  # (waves per round, amplitude, phase)
    y: tuple[tuple[int, float, float], ...]
    z: tuple[tuple[int, float, float], ...]

    def __call__(self, t: Array) -> Array:
        t = np.asarray(t, dtype=float)
        share = 2 * np.pi * t[..., None] / self.duration
        position, speed = np.zeros((*t.shape, 3)), np.zeros((*t.shape, 3))
        for column, axis in enumerate((self.x, self.y, self.z)):
            waves, amplitude, phase = np.array(axis).T
            position[..., column] = (amplitude * (np.sin(waves * share + phase) - np.sin(phase))).sum(axis=-1)
            speed[..., column] = (amplitude * waves * np.cos(waves * share + phase)).sum(axis=-1)
        yaw = 0.5 * np.unwrap(np.arctan2(speed[..., 1], speed[..., 0]), axis=-1)
        sway = np.stack([0.12 * np.sin(2.1 * t), 0.15 * np.sin(1.7 * t + 1.0), yaw + 0.1 * np.sin(1.3 * t)], axis=-1)
        attitude = Rotation.from_euler("xyz", sway.reshape(-1, 3)).as_rotvec().reshape(sway.shape)
        camera = poses(attitude, position)
        camera[..., :3, :3] = camera[..., :3, :3] @ X[:3, :3]  # the yaw is that of the scanner
        return camera


LOOPS = {  # each goes up and down by a storey
    1: Loop(60.0, ((1, 8.0, 0.0), (2, 1.5, 0.4)), ((2, 4.0, 0.0), (1, 1.0, 0.3)), ((1, 3.0, 0.0),)),
    2: Loop(80.0, ((1, 9.0, 0.7), (3, 1.2, 0.0)), ((1, 7.0, 2.1), (2, 2.0, 0.5)), ((1, 3.0, 1.6), (2, 1.0, 0.0))),
    3: Loop(70.0, ((1, 6.0, 0.0), (2, 3.0, 1.2)), ((1, 6.0, 1.6), (2, 3.0, 2.8)), ((1, 3.0, 0.8), (2, 1.0, 0.5))),
}


def drifted(T: Array, times: Array, drift: tuple[float, float], rng: np.random.Generator, trials: int) -> Array:
    """Return ``start_T_camera`` (m, 4, 4) by dead reckoning at increasing times: (trials, m, 4, 4)."""
    length = np.sqrt(np.diff(times, prepend=times[0]))[:, None]
    theta, tau = (d * np.cumsum(length * rng.standard_normal((trials, len(times), 3)), axis=1) for d in drift)
    result = np.empty((trials, *T.shape))
    turn = Rotation.from_rotvec(theta.reshape(-1, 3)).as_matrix().reshape(trials, -1, 3, 3)
    result[:] = T
    result[..., :3, :3] = turn @ T[:, :3, :3]
    step = np.diff(T[:, :3, 3], axis=0)[:, :, None]
    result[..., :3, 3] = T[0, :3, 3] + tau
    result[:, 1:, :3, 3] += np.cumsum((turn[:, :-1] @ step)[..., 0], axis=1)
    return result


def drift_covariance(path: Path, start: float, times: Array, drift: tuple[float, float]) -> Array:
    """Return the covariance of ``camera_T_start`` at m times since ``start`` (s): joint (6m, 6m), to first order;
    pose by pose.
    """
    dt = 1.0 / DRIFT_STEPS
    s = np.arange(start, times[-1], dt) + 0.5 * dt
    length = np.clip(times[:, None] - (s - 0.5 * dt), 0.0, dt)  # (m, k): what of each step lies before each time
    own = inverse(path(np.array(start)))
    there, at = own @ path(times), (own @ path(s))[:, :3, 3]
    by_step = np.zeros((len(times), 6, len(s), 3))
    by_step[:, :3] = np.eye(3)[:, None]
    by_step[:, 3:] = -skew(there[:, None, :3, 3] - at).transpose(0, 2, 1, 3)
    by_step *= (np.sqrt(length) * drift[0])[:, None, :, None]
    flat = by_step.reshape(6 * len(times), -1)
    S = (flat @ flat.T).reshape(len(times), 6, len(times), 6)
    since = times - start
    S[:, 3:, :, 3:] += (drift[1] ** 2 * np.minimum(since[:, None], since))[:, None, :, None] * np.eye(3)[:, None]
    J = inverse_jacobian(there)
    return np.asarray(np.einsum("iab,ibjc,jdc->iajd", J, S, J).reshape(6 * len(times), -1))


class Recording(NamedTuple):
    """A calibration: both streams as `uq.synchronise` takes them, and what is true of them."""

    scanner: uq.Stream
    camera: uq.Stream
    offset: float
    path: Path
    start: float  # of the camera, on the scanner's clock


def recording(rng: np.random.Generator, sensors: Sensors) -> Recording:
    """SCANS scans while the rig is waved, with a clock offset drawn evenly within LARGEST_OFFSET."""
    duration = SCANS / SCANNER_RATE
    path = waved(rng, duration)
    offset = rng.uniform(-LARGEST_OFFSET, LARGEST_OFFSET)
    scans: Array = (np.arange(float(SCANS)) + rng.uniform(0.0, 1.0)) / SCANNER_RATE
    # true time is that of the scanner; the camera runs from 2 s before the first scan to 2 s after the last
    count = round((SCANS + 3) / SCANNER_RATE * CAMERA_RATE)
    frames: Array = scans[0] - 2.0 + (rng.uniform(0.0, 1.0) + np.arange(float(count))) / CAMERA_RATE
    G = inverse(path(scans[:1]) @ inverse(X)) @ path(scans) @ inverse(X)
    V = drifted(inverse(path(frames[:1])) @ path(frames), frames, sensors.drift, rng, 1)[0]
    noise = sensors.white
    return Recording(
        uq.Stream(scans, disturbed(G, noise.robot, (), rng)),
        uq.Stream(frames - offset, disturbed(inverse(V), noise.camera, (), rng)),
        offset,
        path,
        float(frames[0]),
    )


def fused(V: Array, G: Array, estimate: Array) -> Array:
    """Places of the scanner (..., m, 3) in the frame of its start, from both streams at the times of the scans.

    The simplest fusion in which X counts: attitude is the camera's, carried through X; the displacement between two
    scans is the mean of the scanner's own and of the camera's, carried through X; they are added up.
    ``V = start_T_camera``, ``G = start_T_scanner`` (..., m, 4, 4), ``estimate`` of X (..., 4, 4).
    """
    E = estimate[..., None, :, :]
    by_camera = E @ inverse(V[..., :1, :, :]) @ V @ inverse(E)
    own, through = ((inverse(T[..., :-1, :, :]) @ T[..., 1:, :, :])[..., :3, 3] for T in (G, by_camera))
    steps = (by_camera[..., :-1, :3, :3] @ (0.5 * (own + through))[..., None])[..., 0]
    return np.concatenate([np.zeros_like(steps[..., :1, :]), np.cumsum(steps, axis=-2)], axis=-2)


class Walk(NamedTuple):
    """A loop at the times of its scans: exact poses (m, 4, 4) in the frames of their starts."""

    loop: Loop
    times: Array
    V: Array
    G: Array

    def late(self, seconds: Array) -> Array:
        """``start_T_camera`` (..., m, 4, 4) if all camera times are read wrong by so many seconds (...)."""
        moved = self.loop(self.times + np.asarray(seconds)[..., None])
        return np.asarray(inverse(self.loop(np.zeros(1))) @ moved)


def walk(experiment: int) -> Walk:
    loop = LOOPS[experiment]
    times = np.arange(0.0, loop.duration + 0.5 / SCANNER_RATE, 1.0 / SCANNER_RATE)
    V = inverse(loop(times[:1])) @ loop(times)
    return Walk(loop, times, V, X @ V @ inverse(X))


def walked(
    of: Walk, sensors: Sensors, rng: np.random.Generator, trials: int, late: Array | None = None
) -> tuple[Array, Array]:
    """Return the measurements of a walk: V, G (trials, m, 4, 4), with noise and drift; ``late`` as in `Walk.late`."""
    fine = np.linspace(0.0, of.loop.duration, (len(of.times) - 1) * DRIFT_STEPS + 1)
    V = drifted(inverse(of.loop(fine[:1])) @ of.loop(fine), fine, sensors.drift, rng, trials)[:, ::DRIFT_STEPS]
    if late is not None:
        V = V @ inverse(of.V) @ of.late(late)
    noise = sensors.white
    camera = disturbed(inverse(V).reshape(-1, 4, 4), noise.camera, (), rng)
    return inverse(camera).reshape(V.shape), disturbed(of.G, noise.robot, (trials,), rng)
