"""Streams of a robot and a camera along smooth motions with known X, W and time offset."""

import numpy as np
from scipy.interpolate import make_interp_spline
from support import moved, random_transforms, rotations, transforms

import uq_handeye as uq

# (rotation, translation) of robot and camera, rad and m
NOISE = ((2e-4, 1e-4), (1e-3, 5e-4))


def pose_noise(noise=NOISE):
    return uq.PoseNoise(*(np.diag(np.repeat(deviations, 3) ** 2.0) for deviations in noise))


def motion(rng, duration, knot=0.8, turn=0.6, shift=0.15, drift=0.0):
    """Poses at any times from -2 to duration + 2: splines of fifth order through random knots, ``drift`` in rad/s."""
    knots = np.arange(-4.0, duration + 4.0 + knot, knot)
    vector = make_interp_spline(knots, turn * rng.normal(size=(len(knots), 3)), 5)
    position = make_interp_spline(knots, shift * rng.normal(size=(len(knots), 3)) + [0.5, 0.0, 0.6], 5)
    base, axis = random_transforms(rng)[:3, :3], rng.normal(size=3)
    axis *= drift / np.linalg.norm(axis)

    def pose(t):
        t = np.asarray(t, dtype=float)
        return transforms(base @ rotations(t[:, None] * axis) @ rotations(vector(t)), position(t))

    return pose


def streams(rng, pose, offset, duration, *, rates=(200.0, 20.0), noise=NOISE, setup="eye-in-hand", X=None, W=None):
    """X, W and both streams, ``robot_time = camera_time + offset``; the camera's times are not even."""
    X = random_transforms(rng) if X is None else X
    W = random_transforms(rng) if W is None else W
    robot_times = np.arange(0.0, duration, 1 / rates[0]) + rng.uniform(0, 1 / rates[0])
    times = np.arange(0.3, duration - 0.3, 1 / rates[1])
    times = times + (rng.uniform() + 0.2 * rng.uniform(-1, 1, len(times))) / rates[1]
    G, C = pose(robot_times), np.linalg.inv(X) @ np.linalg.inv(pose(times)) @ W
    if setup == "eye-to-hand":
        G = np.linalg.inv(G)
    G, C = (
        moved(T, rng.normal(size=(len(T), 6)) * np.repeat(deviations, 3))
        for T, deviations in zip((G, C), noise, strict=True)
    )
    return X, W, uq.Stream(robot_times, G), uq.Stream(times - offset, C)


def some(stream, index):
    return uq.Stream(stream.timestamps[index], stream.poses[index])
