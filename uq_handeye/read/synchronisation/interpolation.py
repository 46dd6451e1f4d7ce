"""Poses between two samples of a stream: Sub-problem 2 of the paper on SO(4), and the geodesic of SE(3).

Model: samples ``T_i, T_(i+1)`` (4x4, any frames) at times ``tau_i < tau_(i+1)``, a time tau between them, and the
weight of the first (38),

    w = (tau_(i+1) - tau) / (tau_(i+1) - tau_i)

**so4.** With ``E = F2(T)`` (51) on SO(4), the pose at tau is the rotation nearest to both (37),

    argmax over E in SO(4) of  tr{E [w E_i + (1 - w) E_(i+1)]^T}

(the paper prints "arg min" in the second line of (37); what it minimises in the first line makes it a maximum). That is
Problem 1: the polar factor of ``H = w E_i + (1 - w) E_(i+1)``. In the limit d -> infinity, which is used here, it needs
no SVD. The rotation is the chordal mean. With ``R_i^T R_(i+1) = exp([theta n]x)`` it lies on the arc between both, at

    R = R_i exp([phi n]x),   tan(phi) = (1 - w) sin(theta) / (w + (1 - w) cos(theta))

and ``w R_i + (1 - w) R_(i+1) = R P`` with the symmetric ``P = n n^T + rho (I - n n^T)``,
``rho^2 = w^2 + (1 - w)^2 + 2 w (1 - w) cos(theta)``. The terms of order 1/d of the polar factor give the translation

    t = R (I + P)^-1 (R^T m + p),    m = w t_i + (1 - w) t_(i+1),    p = w R_i^T t_i + (1 - w) R_(i+1)^T t_(i+1)

the mean of what linear interpolation gives in the one frame and in the other. At finite d (``scale``) the polar factor
is taken by SVD (`nearest_rotation.orthonormalise`); the two agree to |t|^2/d^2.

**geodesic.** The screw motion from one sample to the other, ``T_i exp((1 - w) log(T_i^-1 T_(i+1)))``. (Not the geodesic
of a metric that separates rotation and translation, which is slerp with a straight line: that depends on the frame in
which the translation is expressed.)

Both give the same result for a pose and its inverse, and with a fixed transform, such as X, before or behind. They
differ by third order in the step: by at most 0.016 theta^3 in rotation for small theta (rad). Both miss
the true motion by second order, ``w (1 - w)/2`` times acceleration times the interval squared.

Between two samples 180 deg apart the path is not known: steps beyond `MAX_STEP_RAD` are refused.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ...core.geometry.checks import as_numbers, as_transforms
from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.se3 import Array, left_jacobian, logarithm, perturb
from ...errors import InputError, require_one_of
from ...methods.scaled import check_scale, se3_from_so4, so4_from_se3

KINDS = ("so4", "geodesic")
# The largest rotation (rad) between neighbouring samples: near half a turn either way round is possible.
MAX_STEP_RAD = np.pi - 0.05
# Entries of `Interpolated.problem`: a pose is there, or the time is before or after the stream, in a gap or half turn.
FINE, BEFORE, AFTER, GAP, TURN = range(5)


def check_kind(kind: str) -> None:
    """Raise `InputError` for anything but a name in KINDS."""
    require_one_of("interpolation", kind, KINDS)


def interpolate(first: Array, second: Array, weight: Array, kind: str = "so4", scale: float | None = None) -> Array:
    """The poses (..., 4, 4) between ``first`` and ``second`` (..., 4, 4), at the weights (...) of the first (38).

    Parameters
    ----------
    first, second : (..., 4, 4)
    weight : (...)
        In [0, 1]: 1 is ``first``, 0 is ``second``.
    kind : "so4" or "geodesic"
    scale : float or None
        Scaling factor d of "so4"; None is its limit.

    Raises
    ------
    InputError
        Weights outside [0, 1] (nothing is extrapolated); steps of about half a turn; unknown kinds.
    """
    check_kind(kind)
    first, second = as_transforms(first, "first", stack=False), as_transforms(second, "second", stack=False)
    w = as_numbers(weight, "weight")
    if not ((w >= 0) & (w <= 1)).all():
        raise InputError("Expected `weight` in [0, 1], got a value outside: poses are not extrapolated.")
    step = logarithm(first[..., :3, :3].mT @ second[..., :3, :3])
    angle = np.sqrt((step * step).sum(axis=-1))
    if angle.max(initial=0.0) > MAX_STEP_RAD:
        raise InputError(
            f"Expected steps below {np.degrees(MAX_STEP_RAD):.0f} degrees between neighbouring poses, got "
            f"{np.degrees(angle.max()):.1f}: the way between them is not known."
        )
    if kind == "geodesic":
        if scale is not None:
            raise InputError("Expected no `scale` with 'geodesic': it is the scaling factor of 'so4'.")
        return _geodesic(first, second, step, w)
    if scale is None:
        return _so4_limit(first, second, step, angle, w)
    check_scale(scale)
    w = w[..., None, None]
    H = w * so4_from_se3(first, scale) + (1 - w) * so4_from_se3(second, scale)  # (37)
    return se3_from_so4(orthonormalise(H), scale)


def _so4_limit(first: Array, second: Array, step: Array, angle: Array, w: Array) -> Array:
    v = 1.0 - w
    along, across = w + v * np.cos(angle), v * np.sin(angle)
    rho = np.hypot(along, across)
    share = np.divide(np.arctan2(across, along), angle, out=np.array(np.broadcast_to(v, angle.shape)), where=angle > 0)
    R_0, R_1 = first[..., :3, :3], second[..., :3, :3]
    t_0, t_1 = first[..., :3, 3], second[..., :3, 3]
    result = _turned(first, share[..., None] * step)
    R = result[..., :3, :3]
    w, v = w[..., None], v[..., None]
    m = w * t_0 + v * t_1
    both = (R.mT @ m[..., None] + R_0.mT @ (w * t_0)[..., None] + R_1.mT @ (v * t_1)[..., None])[..., 0]
    n = np.divide(step, angle[..., None], out=np.zeros_like(step), where=angle[..., None] > 0)
    inside = 1.0 / (1.0 + rho)[..., None]  # (I + P)^-1 = inside (I - n n^T) + n n^T / 2
    both = inside * both + (0.5 - inside) * n * (n * both).sum(axis=-1, keepdims=True)
    result[..., :3, 3] = (R @ both[..., None])[..., 0]
    return result


def _geodesic(first: Array, second: Array, step: Array, w: Array) -> Array:
    share = (1.0 - w)[..., None]
    along = first[..., :3, :3].mT @ (second[..., :3, 3:] - first[..., :3, 3:])
    move = left_jacobian(share * step) @ (share[..., None] * np.linalg.solve(left_jacobian(step), along))
    result = _turned(first, share * step)
    result[..., :3, 3:] = first[..., :3, 3:] + first[..., :3, :3] @ move
    return result


def _turned(T: Array, vector: Array) -> Array:
    """The rotation of T, turned on by ``vector`` in its own frame; translation left to the caller."""
    return perturb(T, np.concatenate([(T[..., :3, :3] @ vector[..., None])[..., 0], np.zeros_like(vector)], axis=-1))


class Interpolated(NamedTuple):
    """A stream at m times."""

    poses: Array  # (m, 4, 4), NaN where there is none
    rate: Array  # (m, 6): d xi / d time of the pose, xi left rotation and additive translation; rad/s and m/s
    weight: Array  # (m,) of the sample before (38)
    left: NDArray[np.intp]  # (m,) number of the sample before
    problem: NDArray[np.intp]  # (m,) FINE, or why there is no pose

    @property
    def fine(self) -> NDArray[np.bool_]:
        """(m,) whether there is a pose."""
        return np.asarray(self.problem == FINE)

    def rows(self, index: NDArray[np.intp]) -> Interpolated:
        """Return the poses at some of the times."""
        return Interpolated._make(part[index] for part in self)


def at_times(times: Array, poses: Array, wanted: Array, kind: str = "so4", max_gap: float = np.inf) -> Interpolated:
    """Return a stream, sorted by time, at the ``wanted`` times; nothing is extrapolated.

    Parameters
    ----------
    times : (n,) increasing
    poses : (n, 4, 4)
    wanted : (m,)
    kind : "so4" or "geodesic"
    max_gap : float (s)
        Where the samples before and after are farther apart, there is no pose. A time that is that of a sample needs
        no neighbour.

    The rate is that from the sample before the interval to the sample behind it (of the interval itself at an end or
    beside a gap): as far as the noise of the samples is independent, its noise is then not that of the pose.
    """
    last = len(times) - 1
    problem = np.full(len(wanted), FINE)
    problem[wanted < times[0]], problem[wanted > times[last]] = BEFORE, AFTER
    left = np.clip(np.searchsorted(times, wanted, side="right") - 1, 0, max(last - 1, 0))
    right = np.minimum(left + 1, last)
    length = times[right] - times[left]
    with np.errstate(invalid="ignore", divide="ignore"):
        weight = np.where(length > 0, (times[right] - wanted) / length, 1.0)  # (38)
    between = (weight > 0) & (weight < 1)
    problem[(problem == FINE) & between & (length > max_gap)] = GAP
    fine = problem == FINE
    turn = np.zeros(len(wanted))
    step = logarithm(poses[left[fine], :3, :3].mT @ poses[right[fine], :3, :3])
    turn[fine] = np.sqrt((step * step).sum(axis=-1))
    problem[fine & between & (turn > MAX_STEP_RAD)] = TURN
    fine = problem == FINE
    result, rate = np.full((len(wanted), 4, 4), np.nan), np.full((len(wanted), 6), np.nan)
    if fine.any():
        i, j, w = left[fine], right[fine], np.clip(weight[fine], 0.0, 1.0)
        inner = (w > 0) & (w < 1)
        result[fine] = np.where((w == 0)[:, None, None], poses[j], poses[i])
        where = np.flatnonzero(fine)[inner]
        result[where] = interpolate(poses[i[inner]], poses[j[inner]], w[inner], kind)
        rate[fine] = _rate(times, poses, i, j, max_gap)
    return Interpolated(result, rate, weight, left, problem)


def _rate(times: Array, poses: Array, left: NDArray[np.intp], right: NDArray[np.intp], max_gap: float) -> Array:
    """d xi / d time (m, 6) between the samples around the interval."""
    last = len(times) - 1
    before, behind = np.maximum(left - 1, 0), np.minimum(right + 1, last)
    before = np.where(times[left] - times[before] > max_gap, left, before)
    behind = np.where(times[behind] - times[right] > max_gap, right, behind)
    span = times[behind] - times[before]
    turn = logarithm(poses[behind, :3, :3] @ poses[before, :3, :3].mT)
    move = poses[behind, :3, 3] - poses[before, :3, 3]
    return np.asarray(np.concatenate([turn, move], axis=-1) / np.where(span > 0, span, np.inf)[:, None])


def misses(times: Array, poses: Array, kind: str = "so4", max_gap: float = np.inf) -> Array:
    """Return the error of interpolating each sample from the two beside it: xi (n, 6), rad and m.

    0 at both ends, beside gaps and half turns. For smooth motion and even times interpolation between neighbouring
    samples misses by ``w (1 - w)`` times that (second order), a quarter at most; the noise of three samples is in it.
    """
    result = np.zeros((len(times), 6))
    if len(times) < 3:
        return result
    near = (np.diff(times) <= max_gap)[:-1] & (np.diff(times) <= max_gap)[1:]
    step = logarithm(poses[:-2, :3, :3].mT @ poses[2:, :3, :3])
    k = np.flatnonzero(near & ((step * step).sum(axis=-1) < MAX_STEP_RAD**2))
    weight = (times[k + 2] - times[k + 1]) / (times[k + 2] - times[k])
    found = interpolate(poses[k], poses[k + 2], weight, kind)
    result[k + 1, :3] = logarithm(found[:, :3, :3] @ poses[k + 1, :3, :3].mT)
    result[k + 1, 3:] = found[:, :3, 3] - poses[k + 1, :3, 3]
    return result


def error_of_interpolation(poses: Array, missed: Array) -> tuple[float, float]:
    """Rotation (rad) and translation (m) by which interpolation misses the motion at most between two samples.

    Root mean square over the stream, from its `misses`, once the noise of the samples is taken out (`noise_floor`).
    """
    turn, move = (
        0.25 * float(np.sqrt(max(float(np.mean((part**2).sum(axis=-1))) - 4.5 * noise**2, 0.0)))
        for part, noise in zip((missed[:, :3], missed[:, 3:]), noise_floor(poses), strict=True)
    )
    return turn, move


def noise_floor(poses: Array) -> tuple[float, float]:
    """Noise (rad, m) per axis of a stream, from third differences of neighbouring samples."""
    if len(poses) < 8:
        return 0.0, 0.0
    quartile = float(chdtri(3, 0.75))
    turn = np.diff(logarithm(poses[1:, :3, :3] @ poses[:-1, :3, :3].mT), n=2, axis=0)
    move = np.diff(poses[:, :3, 3], n=3, axis=0)
    rotation, translation = (
        float(np.sqrt(np.quantile((e**2).sum(axis=-1), 0.25) / (20.0 * quartile))) for e in (turn, move)
    )
    return rotation, translation
