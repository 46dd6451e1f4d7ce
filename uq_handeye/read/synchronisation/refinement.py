r"""The time offset refined jointly with X and W, and how well it is known.

Model: the constraint of `constraint` on poses, ``G(t) X C(t') = W``, with one more unknown, the offset d between the
clocks. An error of d moves the interpolated side of row i by ``rate_i d`` (left rotation, additive translation), its
residual therefore by ``j_i d`` with ``j_i = D_i rate_i``, D_i the derivative by that side. Gauss-Newton on
``(xi_X, xi_W, d)``, in units in which the covariance of a residual is 1 and with the robust weights of `robust`: with J
the columns of X and W, what they leave of j is ``k = j - J (J^T J)^-1 J^T j`` (Frisch and Waugh), and

    d <- d - k^T r / k^T k,        Var(d) = 1 / k^T k    for rows whose errors are independent

r the residual after X and W are fitted. Rates that contain noise cost precision, but do not pull d towards 0: at the
end ``k^T r = 0``, and the noise of a rate is not that of its row (`interpolation.at_times`).

*Honest standard deviation.* Rows of a video are not independent: errors of the detection last for many frames, a clock
of 10 ms puts an error along the path into every row, neighbours may share a sample. What row i adds to the error of d
is ``c_i = -k_i^T r_i / (k^T k - k_i^T k_i)`` (as in a jackknife; and with the slope of the robust weights, which fall
as residuals grow, in the denominator). Var(d) is that of the model, or ``sum c_i^2`` where that is larger (the sandwich
of one parameter): errors along the path, of fast rows. Where neighbouring c_i are correlated (p < 0.001) it is
multiplied by ``1 + 2 sum rho_l``, rho the autocorrelation of c_i, summed over its initial positive
sequence (C. J. Geyer 1992). That is the model of the timing noise: any stationary error whose correlation dies out
within the recording. What is constant, such as the delay of a filter, is part of the offset itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ...core.geometry.se3 import Array
from ...errors import DegenerateMotionError, InputError, NotConvergedError
from ...fit.diagnostics.residual_patterns import RARE
from ...fit.likelihood.consensus import NOTHING, consensus, misfit, residual_noise, robust_variance
from ...fit.likelihood.constraint import OnPoses, Unknowns
from ...fit.likelihood.gauss_helmert import CLOSED_FORM_STEPS, Fit, fit
from ...fit.likelihood.robust import FULL, pose_distances, robust_weights
from ...fit.one_model.noise_of_data import estimate_noise
from ...model.noise.models import PoseNoise, marginals
from ...model.noise.square_roots import gram, whiten
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.timing import SIDES
from .correlation import autocorrelation
from .interpolation import Interpolated, at_times

# Rows that the start, the first rounds and the noise are found from, evenly spread.
FOR_START, FOR_ROUNDS, FOR_NOISE = 200, 1500, 2000
# Rows that the offset is finally told from; more would only take time: it is then known to microseconds.
FOR_ALL = 20_000
# Gauss-Newton stands still below this share of the deviation of the offset, or below so many seconds.
STILL, ROUNDING = 1e-3, 1e-10
# Share that is accepted in the end, where weights and offset take turns.
NEARLY_STILL = 0.2
# Steps at most, and the longest of them (s).
MOST, LONGEST = 40, 0.1
# Share of j that X and W must leave for the offset to be told from them.
TOLD = 1e-8
# Rows from which on correlations and squares are judged.
FEWEST_TO_JUDGE = 30


@dataclass(frozen=True, eq=False)
class Pairing:
    """Two streams sorted by time, and how rows are made of them; times count from the ``origins`` of their clocks."""

    robot_times: Array
    robot: Array
    camera_times: Array
    camera: Array
    side: str  # the interpolated one
    kind: str
    max_gap: float
    inverted: bool  # eye-to-hand

    @property
    def n(self) -> int:
        """Rows that there could be: poses of the side that is not interpolated."""
        return len(self.camera_times if self.side == "robot" else self.robot_times)

    def interpolated(self, offset: float, rows: NDArray[np.intp] | None = None) -> Interpolated:
        """The interpolated side at the times of the other one; rates by the offset."""
        if self.side == "robot":
            wanted = self.camera_times if rows is None else self.camera_times[rows]
            return at_times(self.robot_times, self.robot, wanted + offset, self.kind, self.max_gap)
        wanted = self.robot_times if rows is None else self.robot_times[rows]
        found = at_times(self.camera_times, self.camera, wanted - offset, self.kind, self.max_gap)
        return found._replace(rate=-found.rate)

    def rows_at(self, offset: float) -> NDArray[np.intp]:
        """Return the rows for which nothing is extrapolated and no gap is bridged."""
        return np.flatnonzero(self.interpolated(offset).fine)

    def poses(self, found: Interpolated, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """Robot and camera poses (k, 4, 4) of the rows that ``found`` is of."""
        if self.side == "robot":
            return found.poses, self.camera[rows]
        return self.robot[rows], found.poses


class Refined(NamedTuple):
    """The offset and what was found with it."""

    offset: float
    std: float  # s, honest
    model_std: float  # s, if rows were independent and the noise as modelled
    growth: float  # factor on the deviation for what neighbouring rows share; 1: nothing found
    unknowns: Unknowns
    noise: PoseNoise
    of_samples: bool  # the noise is that of the samples, not of the interpolated rows
    weights: Array
    wanted: tuple[float, float]  # the offset by the data alone, without a prior, and its deviation
    score: float  # of candidates: log of rotation and translation variance of the residuals of most rows
    steps: int


class _Round(NamedTuple):
    fit: Fit
    weights: Array
    step: float
    information: float
    contributions: Array  # (n,): what each row adds to the error of the offset
    told: bool


def thinned(rows: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return at most ``most`` of the rows, evenly spread."""
    if len(rows) <= most:
        return rows
    return rows[np.linspace(0, len(rows) - 1, most).round().astype(np.intp)]


def start(pairing: Pairing, offset: float, seed: int) -> Refined:
    """X and W at an offset (robust, from few rows), the offset improved; its score tells candidates apart."""
    rows = thinned(pairing.rows_at(offset), FOR_START)
    found = pairing.interpolated(offset, rows)
    constraint = OnPoses(*pairing.poses(found, rows), pairing.inverted)
    agreed = consensus(constraint, None, seed)
    noise: Any = residual_noise(constraint, agreed.unknowns)
    begun = Refined(offset, np.inf, np.inf, 1.0, agreed.unknowns, noise, False, agreed.inside, (offset, np.inf), 0.0, 0)
    improved = refine(pairing, begun, rows, None, strict=False)
    rows = thinned(pairing.rows_at(improved.offset), FOR_START)
    found = pairing.interpolated(improved.offset, rows)
    squares = misfit(OnPoses(*pairing.poses(found, rows), pairing.inverted), improved.unknowns)
    variances = [max(robust_variance(column, 3), 1e-24) for column in squares.T]
    return improved._replace(score=float(np.log(variances).sum()))


def refine(
    pairing: Pairing,
    begun: Refined,
    rows: NDArray[np.intp],
    prior: tuple[float, float] | None,
    *,
    strict: bool = True,
) -> Refined:
    """Gauss-Newton on X, W and the offset over these rows, from ``begun``.

    Rows that an offset on the way would have to extrapolate are left out. Raises `NotConvergedError` if ``strict``.
    """
    offset, at, noise, of_samples = begun.offset, begun.unknowns, begun.noise, begun.of_samples
    weights = begun.weights if len(begun.weights) == len(rows) else np.ones(len(rows))
    growth, last, low, high = 1.0, np.inf, -np.inf, np.inf
    for steps in range(1, MOST + 1):
        found = pairing.interpolated(offset, rows)
        if not found.fine.all():
            rows, weights = rows[found.fine], weights[found.fine]
            found = pairing.interpolated(offset, rows)
        if len(rows) < 4:
            raise InputError(f"Only {len(rows)} poses are left at the offset {offset:.4g} s.")
        used = noise_at(noise, found, pairing.side) if of_samples else noise
        done = _round(pairing, found, rows, at, used, weights)
        at = done.fit.unknowns
        settled = bool(np.abs(done.weights - weights).max() < 0.05)
        weights = done.weights
        if not done.told:
            return begun._replace(offset=offset, std=np.inf, unknowns=at, weights=weights, steps=steps)
        model = 1.0 / np.sqrt(done.information)
        std, growth = honest(done.contributions, model)
        step, data = done.step, (offset + done.step, std)
        if prior is not None:
            of_data, of_prior = std**-2, prior[1] ** -2
            step = (of_data * step + of_prior * (prior[0] - offset)) / (of_data + of_prior)
            std = (of_data + of_prior) ** -0.5
        # Rows that change their interval make the score jump: once its sign has changed, halving finds where.
        low, high = (offset, high) if step > 0 else (low, offset)
        if low >= high:  # the weights have moved on since
            low, high = (offset, np.inf) if step > 0 else (-np.inf, offset)
        wanted = offset + float(np.clip(step, -LONGEST, LONGEST))
        halved = np.isfinite(high - low) and (abs(step) > 0.5 * abs(last) or not low < wanted < high)
        last, move = step, (0.5 * (low + high) if halved else wanted) - offset
        offset += move
        if abs(move) < max(STILL * model, ROUNDING) and (settled or steps >= MOST // 2):
            return Refined(offset, std, model, growth, at, noise, of_samples, weights, data, 0.0, steps)
    if strict and not abs(last) < NEARLY_STILL * model:
        raise NotConvergedError(
            f"The time offset did not settle within {MOST} steps (last at {offset:.6g} s, last step {step:.2g} s): the "
            "streams do not fit together. Look at the setup, at the frames of both streams and at their timestamps."
        )
    return Refined(offset, std, model, growth, at, noise, of_samples, weights, data, 0.0, MOST)


def _round(
    pairing: Pairing, found: Interpolated, rows: NDArray[np.intp], at: Unknowns, noise: PoseNoise, weights: Array
) -> _Round:
    """X, W and weights at one offset, and the step of the offset."""
    constraint = OnPoses(*pairing.poses(found, rows), pairing.inverted)
    now = fit(constraint, noise, at, CLOSED_FORM_STEPS, weights)
    distances, _ = pose_distances(now)
    wanted = robust_weights(distances / max(robust_variance(distances, 6), 1.0))
    j = now.linear.sides[0 if pairing.side == "robot" else 1] @ found.rate[..., None]
    white = whiten(now.weighted_factor, np.concatenate([now.linear.J, j, now.residual[..., None]], axis=-1))
    sums = gram(white)
    left = white[..., 12] - white[..., :12] @ (now.covariance @ sums[:12, 12])
    information = float((left**2).sum())
    told = information > TOLD * float(sums[12, 12]) and information > 0
    contributions = -(left * white[..., 13]).sum(axis=-1) / (information if told else 1.0)
    share = (left**2).sum(axis=-1) / (information if told else 1.0)
    # What is left of the residual of a row grows as that row pulls the offset less: as in a jackknife.
    without = contributions / np.maximum(1.0 - share, 0.1)
    falling = (weights > 0) & (weights < 1)
    if told and falling.any():  # d psi / d r = w + r dw/dr
        along = (left * white[..., 13]).sum(axis=-1)[falling] ** 2 / weights[falling] ** 2
        slope = 2.0 * float(along.sum()) / ((NOTHING - FULL) * max(robust_variance(distances, 6), 1.0))
        without = without / max(1.0 - slope / information, 0.25)
    return _Round(now, wanted, float(contributions.sum()), information, without, told)


def noise_at(noise: PoseNoise, found: Interpolated, side: str) -> PoseNoise:
    """The noise of the rows from that of the samples: the mean of two is less noisy by ``w^2 + (1 - w)^2``."""
    S = getattr(noise, side)
    if S is None:
        return noise
    w = np.clip(found.weight, 0.0, 1.0)
    less = (w**2 + (1 - w) ** 2)[:, None, None] * S
    return PoseNoise(less, noise.camera) if side == "robot" else PoseNoise(noise.robot, less)


def _noise_of(pairing: Pairing, best: Refined, found: Interpolated, rows: NDArray[np.intp]) -> PoseNoise:
    """The noise of some rows: from that of the samples, or of these rows out of all that the best offset has."""
    if best.of_samples:
        return noise_at(best.noise, found, pairing.side)
    return best.noise.rows(np.searchsorted(pairing.rows_at(best.offset), rows))


def noise_of_rows(noise: PoseNoise, found: Interpolated, side: str) -> PoseNoise:
    """The noise to calibrate all rows with as if they were independent: `noise_at`, and samples that rows share.

    Rows whose intervals touch share a sample. With the weights ``w_ik`` of sample k in row i, their errors have the
    covariances ``sum_k w_ik w_jk S``. What neighbours do to X is alike, so that of row i counts what it shares with all
    others: ``sum_k w_ik s_k S``, with ``s_k = sum_j w_jk``. That is `noise_at` where the interpolated stream has twice
    the rate of the other, and S itself, not 2/3 of it, where both have the same.
    """
    S = getattr(noise, side)
    if S is None:
        return noise
    w = np.clip(found.weight, 0.0, 1.0)
    size = int(found.left.max(initial=0)) + 2
    used = np.bincount(found.left, w, size) + np.bincount(found.left + 1, 1 - w, size)
    counted = (w * used[found.left] + (1 - w) * used[found.left + 1])[:, None, None] * S
    return PoseNoise(counted, noise.camera) if side == "robot" else PoseNoise(noise.robot, counted)


def honest(c: Array, model_std: float) -> tuple[float, float]:
    """The standard deviation of the offset from its contributions (n,), and the factor for correlated
    neighbours in it.
    """
    n = len(c)
    variance, growth2 = model_std**2, 1.0
    if n >= FEWEST_TO_JUDGE:
        variance = max(variance, float((c**2).sum()))
        growth2 = _growth2(c - c.mean())
    return float(np.sqrt(variance * growth2)), float(np.sqrt(growth2))


def _growth2(c: Array) -> float:
    """``1 + 2 sum rho`` over the initial positive sequence, at least 1; 1 where chance explains the correlation."""
    n, rho = len(c), autocorrelation(c)
    falling = 1.0 - np.arange(1, 6) / 6.0
    z = np.sqrt(n) * max(float(rho[1]), float(falling @ rho[1:6]) / float(np.sqrt(falling @ falling)))
    if 2 * float(ndtr(-z)) > RARE:
        return 1.0
    pairs = rho[: n // 2 * 2].reshape(-1, 2).sum(axis=1)
    last = int(np.argmax(pairs <= 0)) if (pairs <= 0).any() else len(pairs)
    return max(float(2 * pairs[: max(last, 1)].sum() - 1), 1.0)


def with_noise(pairing: Pairing, begun: Refined, rows: NDArray[np.intp]) -> PoseNoise:
    """The noise of the rows, estimated at the offset found so far as `calibrate` would."""
    rows = thinned(rows, FOR_NOISE)
    found = pairing.interpolated(begun.offset, rows)
    rows, found = rows[found.fine], found if found.fine.all() else pairing.interpolated(begun.offset, rows[found.fine])
    robot, camera = pairing.poses(found, rows)
    done = _round(pairing, found, rows, begun.unknowns, begun.noise, np.ones(len(rows)))
    poses = PosePairs(robot, camera, "eye-to-hand" if pairing.inverted else "eye-in-hand")
    try:
        estimate = estimate_noise(poses, start=done.fit.X, weights=(done.weights > 0.5).astype(float))
    except (InputError, NotConvergedError, DegenerateMotionError):
        return begun.noise
    if estimate.noise is None:
        return begun.noise
    # Other offsets have other rows: the noise of a usual one is that of all.
    sides = [getattr(estimate.noise, side) for side in SIDES]
    return PoseNoise(*(None if S is None else marginals(S).reshape(-1, 6, 6).mean(axis=0) for S in sides))


def bias_of_interpolation(pairing: Pairing, best: Refined, missed: Array) -> float:
    """Return how far the error of interpolation moves X, in standard deviations of X (the longest of all directions).

    ``missed`` (n, 6) are the `interpolation.misses` of the interpolated stream. They are no noise: what neighbouring
    rows miss is alike. To first order X moves by ``b = -C J^T S^-1 D e``, e_i the miss of row i; this is
    ``sqrt(b^T C^-1 b)``.
    """
    every = pairing.rows_at(best.offset)
    rows = thinned(every, FOR_ROUNDS)
    found = pairing.interpolated(best.offset, rows)
    w = np.clip(found.weight, 0.0, 1.0)[:, None]
    right = np.minimum(found.left + 1, len(missed) - 1)
    e = w * (1 - w) * 0.5 * (missed[found.left] + missed[right])
    noise = _noise_of(pairing, best, found, rows)
    now = _round(pairing, found, rows, best.unknowns, noise, np.ones(len(rows))).fit
    moved = now.linear.sides[0 if pairing.side == "robot" else 1] @ e[..., None]
    white = whiten(now.factor, np.concatenate([now.linear.J, moved], axis=-1))
    b = (now.covariance @ gram(white)[:12, 12])[:6]
    thinner = np.sqrt(len(every) / len(rows))  # rows left out only for speed would make X better known
    return float(thinner * np.sqrt(b @ np.linalg.solve(now.covariance_X, b)))


def residual_scale(pairing: Pairing, best: Refined, offsets: Array) -> tuple[Array, Array]:
    """RMS rotation (rad) and translation (m) residual per axis of the best X and W at each of the offsets (m,).

    Of at most `FOR_ROUNDS` rows that all offsets have, with the weights that these get at the best one.
    """
    common = np.intersect1d(pairing.rows_at(float(offsets.min())), pairing.rows_at(float(offsets.max())))
    rows = thinned(np.intersect1d(common, pairing.rows_at(best.offset)), FOR_ROUNDS)
    found = pairing.interpolated(best.offset, rows)
    noise = _noise_of(pairing, best, found, rows)
    weights = _round(pairing, found, rows, best.unknowns, noise, np.ones(len(rows))).weights
    at, sums = best.unknowns, []
    for offset in offsets:
        found = pairing.interpolated(float(offset), rows)
        fine = found.fine
        robot, camera = pairing.poses(found, rows)
        noise = _noise_of(pairing, best, found, rows).rows(fine)
        now = fit(OnPoses(robot[fine], camera[fine], pairing.inverted), noise, at, 1, weights[fine])
        squares = weights[fine] @ now.residual**2 / max(float(weights[fine].sum()), 1e-12)
        sums.append([squares[:3].mean(), squares[3:].mean()])
    rotation, translation = np.sqrt(np.array(sums)).T
    return rotation, translation
