"""Start of the search for a time offset: the correlation of two angular speeds.

Model: the gripper and the camera (or the target) are one rigid body, so that both sensors rotate with the same angular
speed at the same moment, whatever X: ``|omega_robot(t + offset)| = |omega_camera(t)|``. No X, no W, no axes are needed.

Both streams are brought to one grid (the larger of the two median intervals); the speed at a grid time is the angle
between the poses half a window before and after it, divided by the window (rad/s). Of three windows the one with the
most significant correlation is taken: short ones follow fast motion, long ones average noise. Wrong detections rotate
fast: both speeds are cut off at one level, the smaller of the two 98 % quantiles. The correlation coefficient at every
lag is that of the grid times at which both speeds are known (neither gap nor end), by FFT in O(n log n); a parabola
refines the peak.

The peak counts if it exceeds the correlation of unrelated motions of the same smoothness by chance: with Bartlett's
effective number ``n / (1 + 2 sum rho_robot rho_camera)`` and as many trials as there are independent lags. Other peaks
that are nearly as high are kept: a periodic motion has one per period, and the hand-eye residual has to choose.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from ...core.geometry.se3 import Array, logarithm
from ...core.levels import RARE
from ...errors import InputError
from .interpolation import at_times

# Windows over which speeds are taken (s): short ones for fast motion, long ones for noisy poses.
WINDOWS_S = (0.1, 0.3, 1.0)
# The largest grid. Its FFT needs a gigabyte.
MAX_GRID_STEPS = 4_000_000
# Both speeds must be known at this number of grid times, and at this share of the largest number that any lag has.
MIN_GRID_TIMES, MIN_OVERLAP = 20, 0.3
# Peaks below this share of the highest are dropped.
MIN_PEAK_RATIO = 0.7
# The least correlation that counts, and one that counts in any case: few and smooth data have too small an effective
# number for the test against chance.
MIN_CORRELATION, SURE_CORRELATION = 0.2, 0.95


class Speeds(NamedTuple):
    """Angular speeds of one stream on a grid."""

    start: float  # s, on the clock of the stream
    step: float  # s
    speed: Array  # (n,) rad/s, NaN where not known

    @property
    def times(self) -> Array:
        """(n,)"""
        return np.asarray(self.start + self.step * np.arange(len(self.speed)), dtype=float)


class Correlation(NamedTuple):
    """The correlation of both speeds at each lag, and the offsets that it suggests."""

    lags: Array  # (m,) s: robot_time - camera_time
    values: Array  # (m,), NaN where too little overlaps
    peaks: tuple[float, ...]  # s, the highest first
    heights: tuple[float, ...]
    needed: float  # what the highest peak must reach to stand out of chance
    robot: Speeds
    camera: Speeds

    @property
    def found(self) -> bool:
        """True if the highest peak stands out."""
        return bool(self.heights) and self.heights[0] >= min(max(self.needed, MIN_CORRELATION), SURE_CORRELATION)


def speeds_of(times: Array, poses: Array, step: float, window: float, max_gap: float) -> Speeds:
    """The angular speeds of a stream sorted by time."""
    window = max(window, 2 * step)
    n = int((times[-1] - times[0] - window) / step) + 1
    if n > MAX_GRID_STEPS:
        raise InputError(
            f"Expected at most {MAX_GRID_STEPS:,} grid steps of {step:.3g} s, got {n:,}: a stream lasts "
            f"{times[-1] - times[0]:.3g} s with long gaps. Cut it to the part that both share, or look at "
            "the unit of its timestamps."
        )
    start = times[0] + 0.5 * window
    if n < 1:
        return Speeds(start, step, np.zeros(0))
    middle = start + step * np.arange(n)
    ends = [at_times(times, poses, middle + sign * 0.5 * window, max_gap=max_gap).poses for sign in (-1, 1)]
    known = np.isfinite(ends[0][:, 0, 0]) & np.isfinite(ends[1][:, 0, 0])
    turn = logarithm(ends[0][known][:, :3, :3].mT @ ends[1][known][:, :3, :3])
    speed = np.full(n, np.nan)
    speed[known] = np.sqrt((turn * turn).sum(axis=-1)) / window
    return Speeds(start, step, speed)


def best_correlation(
    robot: tuple[Array, Array], camera: tuple[Array, Array], low: float, high: float, max_gap: float
) -> Correlation:
    """The correlation of two streams (times, poses), sorted by time, at lags from ``low`` to ``high`` (s)."""
    step = max(float(np.median(np.diff(times))) for times, _ in (robot, camera))
    found = []
    for window in dict.fromkeys(max(window, 2 * step) for window in WINDOWS_S):
        one, other = (speeds_of(times, poses, step, window, max(max_gap, 3 * step)) for times, poses in (robot, camera))
        found.append(correlate(one, other, low, high))
    return max(found, key=lambda one: one.heights[0] / min(one.needed, SURE_CORRELATION) if one.heights else -1.0)


def correlate(robot: Speeds, camera: Speeds, low: float, high: float) -> Correlation:
    """The correlation at lags from ``low`` to ``high`` (s); either may be infinite."""
    a, b = robot.speed, camera.speed
    lags: Array = robot.start - camera.start + robot.step * np.arange(-(len(b) - 1.0), len(a))
    nothing = Correlation(lags[:0], lags[:0], (), (), 1.0, robot, camera)
    inside = (lags >= low - robot.step) & (lags <= high + robot.step)
    known_a, known_b = np.isfinite(a), np.isfinite(b)
    if min(known_a.sum(), known_b.sum()) < MIN_GRID_TIMES or not inside.any():
        return nothing
    cut = min(np.quantile(a[known_a], 0.98), np.quantile(b[known_b], 0.98))
    a, b = (np.where(k, np.minimum(np.nan_to_num(x), cut), 0.0) for x, k in ((a, known_a), (b, known_b)))
    a, b = a - a[known_a].mean() * known_a, b - b[known_b].mean() * known_b
    if max(a.std(), b.std()) == 0:
        return nothing
    values, number = _coefficients(a, b, known_a.astype(float), known_b.astype(float))
    enough = number >= max(MIN_GRID_TIMES, MIN_OVERLAP * number[inside].max())
    values = np.where(enough, values, np.nan)
    lags, values, number = lags[inside], values[inside], number[inside]
    if not np.isfinite(values).any():
        return nothing
    spread = 1 + 2 * float(_shared_correlation(a, b))
    effective = max(float(np.nanmax(number)) / max(spread, 1.0), 4.0)
    trials = max(1.0, len(values) / max(spread, 1.0))
    needed = float(np.tanh(-ndtri(RARE.probability / trials) / np.sqrt(max(effective - 3.0, 1.0))))
    peaks, heights = _peaks(lags, values)
    return Correlation(lags, values, peaks, heights, needed, robot, camera)


def _coefficients(a: Array, b: Array, known_a: Array, known_b: Array) -> tuple[Array, Array]:
    """Correlation coefficients at all lags, and of how many pairs; unknown values are 0 in a and b."""
    size = 1 << (len(a) + len(b) - 1).bit_length()
    A = np.fft.rfft(np.stack([known_a, a, a * a]), size)
    B = np.conj(np.fft.rfft(np.stack([known_b, b, b * b]), size))
    products = np.stack([A[0] * B[0], A[1] * B[0], A[0] * B[1], A[2] * B[0], A[0] * B[2], A[1] * B[1]])
    sums = np.fft.irfft(products, size)
    sums = np.concatenate([sums[:, size - (len(b) - 1) :], sums[:, : len(a)]], axis=1)
    n, sa, sb, saa, sbb, sab = sums
    n = np.maximum(np.round(n), 1.0)
    va, vb = saa - sa * sa / n, sbb - sb * sb / n
    floor = 1e-9 * max(float(saa.max()), float(sbb.max()))
    scale = np.sqrt(np.maximum(va, 0.0) * np.maximum(vb, 0.0))
    return np.where((va > floor) & (vb > floor), (sab - sa * sb / n) / np.where(scale > 0, scale, 1.0), 0.0), n


def autocorrelation(x: Array) -> Array:
    """Return the autocorrelation (n,) of a series (n,) at lag 0, 1, ...; zeros of one that is 0."""
    both = np.fft.irfft(np.abs(np.fft.rfft(x, 2 * len(x))) ** 2)[: len(x)]
    return both / both[0] if both[0] > 0 else np.zeros(len(x))


def _shared_correlation(a: Array, b: Array) -> float:
    """Sum of the products of both autocorrelations over lag 1, 2, ... up to where either is first below 0."""
    rho = [autocorrelation(x)[1 : min(len(a), len(b))] for x in (a, b)]
    positive = np.logical_and.accumulate((rho[0] > 0) & (rho[1] > 0))
    return float((rho[0] * rho[1])[positive].sum())


def _peaks(lags: Array, values: Array) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return places and heights of the local maxima, the highest first, refined by a parabola."""
    filled = np.where(np.isfinite(values), values, -1.0)
    padded = np.concatenate([[-2.0], filled, [-2.0]])
    top = np.flatnonzero((filled >= padded[:-2]) & (filled > padded[2:]) & (filled > -1.0))
    order = top[np.argsort(-filled[top], kind="stable")]
    order = order[filled[order] >= MIN_PEAK_RATIO * filled[order[0]]] if order.size else order
    step = lags[1] - lags[0] if len(lags) > 1 else 0.0
    found = []
    for k in order:
        shift = 0.0
        if 0 < k < len(filled) - 1 and min(filled[k - 1], filled[k + 1]) > -1.0:
            bend = filled[k - 1] - 2 * filled[k] + filled[k + 1]
            shift = 0.5 * (filled[k - 1] - filled[k + 1]) / bend if bend < 0 else 0.0
        found.append(float(lags[k] + shift * step))
    return tuple(found), tuple(float(filled[k]) for k in order)
