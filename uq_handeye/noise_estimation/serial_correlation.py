r"""Correlation of the errors of neighbouring poses: drift, and noise that is correlated in time.

Model (`noise.serial_errors`): beside the errors of each pose, whose covariance S_i has been estimated as if there
were nothing else, a stationary Markov process z with the covariance ``exp(-|i - j| / length) diag(p_1 I, p_2 I)``
reaches the residuals of pose i through H_i:

    r_i = J_i x + F_i e + D_i eta_i + H_i z_i

- *camera*: ``H_i = J_X,i``: X itself moves, a bracket that gives way or warms up;
- *camera mount*: ``H_i = J_X,i [[I, 0], [-[t_X]x, I]]``: the same about the origin of X's parent frame, as of a camera
  that rotates with what holds it; looked at where that origin is farther than NEAR times the target;
- *target*: ``H_i = I`` (that of W, ``J_W = -I``);
- *camera noise*, *robot noise*: ``H_i = D_i`` of that side, noise of the poses that is correlated in time.

A drift is a process as long as the data: a random walk about a mean that is not known either, so that X is stated for
any moment of the session. i counts the poses in the order of their timestamps; in a stream, with steps shorter than
STREAM, it is time in units of the median step.

Restricted likelihood. With S as the sum of all errors, up to one factor sigma^2 on all of them which is profiled (1
where a data sheet or corners say how large the errors of each pose are), N = 6 n - p,

    d = log|S| + log|J^T S^-1 J| + N log(r^T P r),      sigma^2 = r^T P r / N

which takes O(n): `SerialErrors`, in the frame of z. What is shared (columns F, prior N(0, 1)) are further unknowns.

Is there any? d is evaluated on a grid: all ways (below MANY poses those that move), lengths of n, n / 10, ... poses,
sizes from small to large. The *odds* are the mean over the grid of the likelihood ratios against independent poses (a
Bayes factor, all cells alike). Few poses hardly tell: a drift of a third of the noise from pose to pose makes the
covariance of 8 poses 2 times too small, and shows in hardly one set in two. Errors in common are therefore taken in
from odds of FEW_ODDS on, of n > FEW poses from ``(n / FEW)^2`` times as large ones: of 15 independent poses this widens
about one covariance in three, by some per cent, and of 40 one in 50
(tests/noise_estimation/test_serial_correlation.py).

Which? The way with the largest mean; a drift of the camera and one of the target look alike in few poses, only the
former reaches X, and the target's is believed where it is FAVOUR times as likely. Sizes are then, of few poses, their
posterior mean over the grid; of many the maximum over both sizes and the length, with a wide log-normal prior.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..findings import Finding
from ..geometry.se3 import Array, block, skew
from ..likelihood.gauss_helmert import Fit
from ..noise.estimate import Component, NoiseEstimate, SerialCorrelation
from ..noise.joint_covariance import JointCovariance
from ..noise.models import PoseNoise, is_joint
from ..noise.serial_errors import SerialErrors, banded_factor, solve_banded
from ..noise.square_roots import weighted
from ..poses.pose_pairs import PosePairs

MOVES, NOISES = ("camera", "target", "camera mount"), ("camera noise", "robot noise")
# Of the distance to the target: how far the origin of X's parent frame must be for turning about it to be another move.
NEAR = 0.25
# Poses from which on noise that is correlated is looked for, too, and sizes and length are maximised.
MANY = 50
# A stream's median step is shorter than this, in seconds.
STREAM = 0.5
# Odds from which on errors in common are taken in, of FEW poses or less.
FEW_ODDS, FEW = 0.5, 15
# How much likelier than the camera's the target's must be.
FAVOUR = 3.0
# As shares of the noise: steps of a random walk from pose to pose (deviations); shorter processes (variances).
WALKS = (0.06, 0.125, 0.25, 0.5, 1.0)
SIZES = (0.1, 0.4, 1.6, 6.4, 25.0)
# Lengths of the grid: each a tenth of the one before, down to this.
SHORTEST = 2.0
# Deviation of the logarithm of a size about that of the grid, and what the variances are sought between.
WIDE, RANGE = 2.0**0.5, (1e-3, 1e5)
# Moves of X and W do nothing to the residuals where they do less than this share of the others: their squares count.
UNSEEN = 1e-7
# Odds from which on it is a caution.
SURE = 20.0


def account_for_correlation(
    fit: Fit, poses: PosePairs, noise: PoseNoise, estimate: NoiseEstimate
) -> NoiseEstimate | None:
    """The estimate with what neighbouring poses have in common, where the residuals show some; else None.

    Parameters
    ----------
    fit : Fit
        Of these poses with the noise of the estimate.
    noise : PoseNoise
        What was estimated, for independent poses.

    Returns
    -------
    NoiseEstimate or None
        Its ``noise`` holds `SerialErrors`; ``correlation`` says what was found.
    """
    if any(S is not None and is_joint(S) and not isinstance(S, JointCovariance) for S in (noise.robot, noise.camera)):
        return None
    kept = np.arange(poses.n) if fit.weights is None else np.flatnonzero(fit.weights)
    time = times_of(poses)
    tied = not (estimate.has_prior or estimate.camera_known or estimate.by_geometry)
    distance = float(np.sqrt(np.mean(np.sum(poses.camera[:, :3, 3] ** 2, axis=-1))))
    found = _find(fit, kept, time, tied, distance)
    return None if found is None else _included(found, fit, noise, estimate, time)


def times_of(poses: PosePairs) -> Array:
    """(n,) the poses' times, in poses: their order, or in a stream the time in median steps."""
    if poses.timestamps is None:
        return np.arange(float(poses.n))
    order = np.argsort(poses.timestamps, kind="stable")
    step = float(np.median(np.diff(poses.timestamps[order])))
    if poses.timing is not None or step < STREAM:
        return np.asarray((poses.timestamps - poses.timestamps[order[0]]) / step)
    rank = np.empty(poses.n)
    rank[order] = np.arange(float(poses.n))
    return rank


def effect_on_residuals(fit: Fit, way: str) -> Array:
    """H (n, 6, 6) of one of MOVES or NOISES."""
    J_X = fit.linear.J[..., :6]
    if way == "camera":
        return J_X
    if way == "camera mount":
        return np.asarray(J_X @ block(np.eye(3), 0.0, -skew(fit.X[:3, 3]), np.eye(3)))
    if way == "target":
        return np.broadcast_to(np.eye(6), J_X.shape)
    return fit.linear.sides[way == "camera noise"]


def _ways(fit: Fit, distance: float, n: int) -> list[str]:
    """Return what may be correlated; ``distance`` (m) of the target."""
    mount = float(np.linalg.norm(fit.X[:3, 3])) > NEAR * distance
    return [*(MOVES if mount else MOVES[:2]), *(NOISES if n >= MANY else ())]


class _At(NamedTuple):
    """Fit at a size and a length."""

    deviance: float
    scale: float  # sigma^2


@dataclass(frozen=True, eq=False)
class _Rows:
    """The residuals of the poses that count, for one way."""

    own: Array  # S_i (n, 6, 6)
    y: Array  # (n, 6, p + q + 1): J, F and r
    p: int
    unit: Array  # (2,) mean variances of rotation and translation residuals
    base: SerialErrors  # with this way's H; size and length do not count
    tied: bool  # sigma^2 is free

    @cached_property
    def by_state(self) -> tuple[Array, Array]:
        """T and y in the frame of the state, by time."""
        order = self.base.order
        inverse = np.linalg.inv(self.base.by_state[order])
        return inverse @ self.own[order] @ inverse.mT, inverse @ self.y[order]

    def at(self, rotation: float, translation: float, length: float) -> _At:
        """Fit with these shares of the mean variances as those of the process."""
        P = np.diag(np.repeat([rotation, translation] * self.unit, 3))
        process = SerialErrors(self.base.time, self.base.by_state, P, length)
        T, y = self.by_state
        C = banded_factor(process.bands(T))
        ahead = np.array(y)
        ahead[1:] -= process.passed_on[1:, None, None] * y[:-1]
        return self._judged(C[0], solve_banded(C, ahead.reshape(-1, y.shape[-1])))

    def independent(self) -> _At:
        """Without any process."""
        T, y = self.by_state
        L = np.linalg.cholesky(T)
        white = np.linalg.solve(L, y).reshape(-1, y.shape[-1])
        return self._judged(np.diagonal(L, axis1=1, axis2=2), white)

    def _judged(self, pivots: Array, white: Array) -> _At:
        sums = white.T @ white
        p, q, freedom = self.p, len(sums) - 1 - self.p, 6 * len(self.own) - self.p
        scale = 1.0
        for _ in range(3 if q and self.tied else 1):
            known = np.diag(np.repeat([0.0, scale], [p, q]))
            L = np.linalg.cholesky(sums[:-1, :-1] + known)
            fitted = np.linalg.solve(L, sums[:-1, -1])
            squares = float(sums[-1, -1] - fitted @ fitted)
            if self.tied:
                scale = squares / freedom
        logs = 2.0 * float(np.log(pivots).sum()) + 2.0 * float(np.log(np.diagonal(L)).sum()) - q * np.log(scale)
        return _At(logs + (freedom * np.log(squares) if self.tied else squares), scale)


class _Found(NamedTuple):
    way: str
    rotation: float  # variance of the process (rad^2, m^2)
    translation: float
    length: float
    drift: bool
    odds: float
    spread: float  # deviation of the logarithm of the variances
    scale: float


def _determined(J: Array) -> Array:
    """J (n, 6, r) by those moves of X and W that the residuals see; the others count for no likelihood."""
    flat = J.reshape(-1, J.shape[-1])
    scale = np.linalg.norm(flat, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    _, s, moves = np.linalg.svd(flat / scale, full_matrices=False)
    seen = s > UNSEEN * s[0]
    return J if seen.all() else np.asarray(J @ (moves[seen] / scale).T)


def _find(fit: Fit, kept: NDArray[np.intp], time: Array, tied: bool, distance: float) -> _Found | None:
    S = fit.S if fit.weights is None else weighted(fit.S, fit.weights)
    own = S.own if isinstance(S, JointCovariance) else np.asarray(S)
    shared = S.shared if isinstance(S, JointCovariance) else np.zeros((*fit.residual.shape, 0))
    J, n = _determined(fit.linear.J), len(kept)
    y = np.concatenate([J, shared, fit.residual[..., None]], axis=-1)[kept]
    own = own[kept]
    variances = np.diagonal(own, axis1=1, axis2=2).mean(axis=0)
    unit = np.array([variances[:3].mean(), variances[3:].mean()])

    def rows_of(way: str) -> _Rows:
        H = effect_on_residuals(fit, way)[kept]
        return _Rows(own, y, J.shape[-1], unit, SerialErrors(time[kept], H, np.eye(6), 1.0), tied)

    rows = {way: rows_of(way) for way in _ways(fit, distance, n)}
    whole = float(np.ptp(time[kept])) + 1.0
    lengths = [whole]
    while lengths[-1] / 10 >= SHORTEST:
        lengths.append(lengths[-1] / 10)
    none = rows["camera"].independent().deviance
    # At a small size of each of the two ways that differ most the likelihood grows, or it does so nowhere.
    if not any(rows[way].at(size, size, length).deviance < none
               for way in MOVES[:2] for length in lengths for size in _sizes(length, whole)[1:2]):  # fmt: skip
        return None
    ratios = {
        (way, length): np.array([0.5 * (none - of.at(size, size, length).deviance) for size in _sizes(length, whole)])
        for way, of in rows.items()
        for length in lengths
    }
    highest = max(float(part.max()) for part in ratios.values())
    means = {cell: float(np.exp(part - highest).mean()) for cell, part in ratios.items()}
    log_odds = highest + float(np.log(np.mean(list(means.values()))))
    if log_odds < np.log(FEW_ODDS * max(1.0, n / FEW) ** 2):
        return None
    weight = {way: FAVOUR if way.startswith("camera") else 1.0 for way in rows}
    way = max(rows, key=lambda way: weight[way] * sum(means[way, length] for length in lengths))
    length = max(lengths, key=lambda length: means[way, length])
    sizes, logs = np.array(_sizes(length, whole)), ratios[way, length]
    probability = np.exp(logs - logs.max())
    probability /= probability.sum()
    size = float(probability @ sizes)
    best = np.array([size, size, length])
    spread = float(np.sqrt(probability @ (np.log(sizes) - probability @ np.log(sizes)) ** 2))
    if n >= MANY:
        best, spread = _maximised(rows[way], np.array([*[sizes[logs.argmax()]] * 2, length]), whole)
    at = rows[way].at(*best)
    rotation, translation = at.scale * best[:2] * unit
    odds = float(np.exp(min(log_odds, 500.0)))
    return _Found(
        way, float(rotation), float(translation), float(best[2]), bool(best[2] > 0.9 * whole), odds, spread, at.scale
    )


def _sizes(length: float, whole: float) -> list[float]:
    """Variances of the process on the grid, as shares of the noise: of a walk by its steps ``2 p / length``."""
    return [0.5 * step * step * length for step in WALKS] if length == whole else list(SIZES)


def _maximised(rows: _Rows, start: Array, whole: float) -> tuple[Array, float]:
    """Sizes of rotation and translation and the length at the maximum, and the standard deviation of log size there."""
    from scipy.optimize import minimize  # slow to import

    begin = np.log(start)

    def objective(x: Array) -> float:
        off = (x[:2] - begin[:2]) / WIDE
        return rows.at(*np.exp(x)).deviance + float(off @ off)

    bounds = [tuple(np.log(RANGE))] * 2 + [(np.log(0.3), np.log(whole))]
    options: Any = {"maxiter": 25, "ftol": 1e-7}
    found = minimize(objective, begin, method="L-BFGS-B", bounds=bounds, options=options)
    step = np.array([0.3, 0.3, 0.0])
    bend = (objective(found.x + step) - 2 * float(found.fun) + objective(found.x - step)) / 0.3**2
    return np.exp(found.x), float(np.sqrt(2.0 / max(bend, 0.5)))


def _included(found: _Found, fit: Fit, noise: PoseNoise, estimate: NoiseEstimate, time: Array) -> NoiseEstimate:
    """The estimate with the process in its noise, components and findings."""
    n = len(time)
    side = "robot" if found.way == "robot noise" else "camera"
    H: Array = np.broadcast_to(np.eye(6), (n, 6, 6))
    if found.way in MOVES:  # as errors of the camera poses that do the same to the residuals
        H = np.asarray(np.linalg.solve(fit.linear.sides[1], effect_on_residuals(fit, found.way)))
    what = ("drift of the " if found.drift else "correlated ") + found.way
    process = SerialErrors(time, H, np.diag(np.repeat([found.rotation, found.translation], 3)), found.length, what)
    scaled = {name: _scaled(getattr(noise, name), found.scale) for name in ("robot", "camera")}
    scaled[side] = _with_process(scaled[side], process)
    by = float(np.sqrt(found.scale))
    components = tuple(Component(**_rescaled(asdict(part), by)) for part in estimate.components)
    findings = tuple(replace(finding, values=_rescaled(finding.values, by)) for finding in estimate.findings)
    reach = np.exp(found.spread)
    components += tuple(
        Component(f"{what}, {kind}", unit, sd := float(np.sqrt(variance)), sd / reach, sd * reach, "estimated")
        for kind, unit, variance in (("rotation", "rad", found.rotation), ("translation", "m", found.translation))
    )
    correlation = SerialCorrelation(
        found.way, float(np.sqrt(found.rotation)), float(np.sqrt(found.translation)), found.length, found.drift,
        found.odds, found.spread,
    )  # fmt: skip
    return replace(
        estimate,
        noise=replace(noise, **scaled),
        components=components,
        findings=findings,
        variances=found.scale * estimate.variances,
        covariance=found.scale**2 * estimate.covariance,
        correlation=correlation,
    )


def _rescaled(values: Any, by: float) -> Any:
    """Plain values of a component, or of a finding that holds some, with estimated standard deviations times ``by``."""
    if isinstance(values, list | tuple):
        return [_rescaled(value, by) for value in values]
    if not isinstance(values, Mapping):
        return values
    if "status" in values:
        free = values["status"] in ("estimated", "zero", "not told apart")
        of = {name: values[name] for name in ("value", "low", "high") if free and values[name] is not None}
        return {**values, **{name: by * value for name, value in of.items()}}
    return {name: _rescaled(value, by) for name, value in values.items()}


def correlation_finding(correlation: SerialCorrelation, setup: str, growth: float) -> Finding:
    """Report what neighbouring poses have in common; ``growth``: of the standard deviations of X by it."""
    values = {
        "way": correlation.way,
        "against": "gripper" if (correlation.way == "target") == (setup == "eye-to-hand") else "base",
        "rotation": correlation.rotation,
        "translation": correlation.translation,
        "length": correlation.length,
        "drift": correlation.drift,
        "odds": correlation.odds,
        "growth": growth,
    }
    return Finding("noise_estimation.correlated", "caution" if correlation.odds > SURE else "note", values)


def _scaled(S: Any, scale: float) -> Any:
    """The covariance of each pose alone times a factor; what poses share as it is."""
    if S is None or scale == 1.0:
        return S
    return S.weighted(np.full(S.n, scale)) if isinstance(S, JointCovariance) else scale * S


def _with_process(S: Any, process: SerialErrors) -> JointCovariance:
    """The covariance of one side with a process beside it."""
    if isinstance(S, JointCovariance):
        return replace(S, serial=process)
    own = np.zeros((6, 6)) if S is None else S
    return JointCovariance(np.broadcast_to(own, (process.n, 6, 6)), np.zeros((process.n, 6, 0)), serial=process)
