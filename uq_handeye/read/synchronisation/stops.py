"""Stops: intervals in which neither the robot nor the camera moves, each averaged to one pair of poses.

Model: at a stop the pose is constant but for noise. The noise of each stream (rad, m per axis) is estimated from third
differences of its poses, which smooth motion hardly enters; at the quartile of the smallest, as motion is there as
well. A sample is still where the poses half a window before and behind it differ by less than `STILL_NOISE_RATIO` times
the standard deviation of their difference, and in any case by less than `STILL_ROTATION_RAD` and
`STILL_TRANSLATION_M`. A stop is a stretch of still samples of the robot in which the camera is still too, without a
margin at both ends, with enough samples of each.

The mean rotation is that of SciPy (chordal), the mean translation that of the samples. At a stop the time offset only
decides which samples belong to it: the rate of the poses, and with it the influence of the offset on X, is 0.

A camera that is triggered once per stop leaves the offset open within the stops: every offset at which all its pictures
lie in a stop fits alike (`offsets_at_rest`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, logarithm
from .interpolation import noise_floor

# Displacements are compared over this time; a stop lasts at least as long.
STOP_WINDOW_S = 0.3
# A displacement of more standard deviations of its noise than this is motion.
STILL_NOISE_RATIO = 6.0
# Displacements below these are no motion, however small the noise is: the resolution of a robot's encoders.
STILL_ROTATION_RAD, STILL_TRANSLATION_M = 2e-4, 5e-5
# Fewest samples of each sensor at a stop.
MIN_SAMPLES_PER_STOP = 3
# Share of the pictures that must lie in stops, or within half a window of one, for a camera that is triggered at stops.
MIN_SHARE_AT_REST = 0.9


class Stop(NamedTuple):
    """One stop: averaged poses, and when (s, clock of the camera)."""

    begin: float
    end: float
    robot: Array  # (4, 4)
    camera: Array  # (4, 4)
    robot_samples: int
    camera_samples: int


def still_samples(times: Array, poses: Array) -> NDArray[np.bool_]:
    """Return which samples (n,) of a stream sorted by time are at rest."""
    before = np.searchsorted(times, times - 0.5 * STOP_WINDOW_S, side="left")
    behind = np.minimum(np.searchsorted(times, times + 0.5 * STOP_WINDOW_S, side="right") - 1, len(times) - 1)
    turn = logarithm(poses[behind, :3, :3] @ poses[before, :3, :3].mT)
    move = poses[behind, :3, 3] - poses[before, :3, 3]
    noise = [STILL_NOISE_RATIO * np.sqrt(2.0) * sd for sd in noise_floor(poses)]  # of a difference of two poses
    still = (turn**2).sum(axis=-1) < max(noise[0], STILL_ROTATION_RAD) ** 2
    small = still & ((move**2).sum(axis=-1) < max(noise[1], STILL_TRANSLATION_M) ** 2)
    return np.asarray(small & (behind > before))


def find_stops(
    robot_times: Array,
    robot: Array,
    camera_times: Array,
    camera: Array,
    offset: float,
    max_gap: float,
) -> list[Stop]:
    """Return the stops of both, in order; times on the clocks of the sensors, ``robot_time = camera_time + offset``.

    A third of the window at both ends of a stop is left out: the arm still settles.
    """
    margin = STOP_WINDOW_S / 3
    own_times = robot_times - offset  # on the clock of the camera
    still, seen = still_samples(robot_times, robot), still_samples(camera_times, camera)
    edges = np.flatnonzero(np.diff(still.astype(int), prepend=0, append=0))
    stops = []
    for first, behind in edges.reshape(-1, 2):
        inside = own_times[first:behind]
        if (np.diff(inside) > max_gap).any():
            continue
        begin, end = float(inside[0]) + margin, float(inside[-1]) - margin
        if end - begin < STOP_WINDOW_S - 2 * margin:
            continue
        i, j = np.searchsorted(own_times, [begin, end])
        a, b = np.searchsorted(camera_times, [begin, end])
        if min(j - i, b - a) < MIN_SAMPLES_PER_STOP or seen[a:b].mean() < 0.8:
            continue
        stops.append(Stop(begin, end, mean_pose(robot[i:j]), mean_pose(camera[a:b]), int(j - i), int(b - a)))
    return stops


def offsets_at_rest(times: Array, poses: Array, pictures: Array, offset: float) -> tuple[float, float] | None:
    """Return the least and the largest offset at which a robot stands still at every picture; None if it moves at some.

    Parameters
    ----------
    times, poses : (m,), (m, 4, 4)
        Stream of the robot, sorted by time.
    pictures : (n,)
        Times of the pictures on the clock of the camera, ``robot_time = picture + offset``.
    offset : float
        The offset that selects the stop of each picture: the nearest one.
    """
    if len(pictures) < 2 or np.median(np.diff(pictures)) < STOP_WINDOW_S:
        return None
    edges = np.flatnonzero(np.diff(still_samples(times, poses).astype(int), prepend=0, append=0)).reshape(-1, 2)
    begin, end = times[edges[:, 0]] - 0.5 * STOP_WINDOW_S, times[edges[:, 1] - 1] + 0.5 * STOP_WINDOW_S
    lasting = end - begin >= STOP_WINDOW_S
    begin, end = begin[lasting], end[lasting]
    if not len(begin):
        return None
    at = (pictures + offset)[:, None]
    away = np.maximum(np.maximum(begin - at, at - end), 0.0)  # (n, stops)
    stop = away.argmin(axis=1)
    near = away.min(axis=1) <= 0.5 * STOP_WINDOW_S
    if near.mean() < MIN_SHARE_AT_REST:
        return None
    # Pictures beyond a stop are outliers of the timing, as they are of the poses.
    few = 1.0 - MIN_SHARE_AT_REST
    low = float(np.quantile((begin[stop] - pictures)[near], 1.0 - 0.5 * few))
    high = float(np.quantile((end[stop] - pictures)[near], 0.5 * few))
    return (low, high) if high - low > 0.5 * STOP_WINDOW_S else None


def mean_pose(poses: Array) -> Array:
    """Mean rotation and mean translation (4, 4) of poses (k, 4, 4) that lie close together."""
    result = np.eye(4)
    result[:3, :3] = Rotation.from_matrix(poses[:, :3, :3]).mean().as_matrix()
    result[:3, 3] = poses[:, :3, 3].mean(axis=0)
    return result
