r"""Refinement of the time offset jointly with X and W, and the standard deviation of the offset.

Model: the constraint of `constraint` on poses, ``G(t) X C(t') = W``, with one more unknown, the offset d between the
clocks. An error of d moves the interpolated side of row i by ``rate_i d`` (left rotation, additive translation), its
residual therefore by ``j_i d`` with ``j_i = D_i rate_i``, D_i the derivative by that side. Gauss-Newton on
``(xi_X, xi_W, d)``, in units in which the covariance of a residual is 1 and with the robust weights of `robust`: with J
the columns of X and W, the part of j that they do not explain is ``k = j - J (J^T J)^-1 J^T j`` (Frisch and Waugh), and

    d <- d - k^T r / k^T k,        Var(d) = 1 / k^T k    for rows whose errors are independent

r the residual after X and W are fitted. Rates that contain noise cost precision, but do not pull d towards 0: at the
end ``k^T r = 0``, and the noise of a rate is not that of its row (`interpolation.at_times`).

*Standard deviation of correlated rows.* Rows of a video are not independent: errors of the detection last for many
frames, a clock of 10 ms puts an error along the path into every row, neighbours may share a sample. Row i adds to the
error of d ``c_i = -k_i^T r_i / (k^T k - k_i^T k_i)`` (as in a jackknife; and with the slope of the robust weights,
which fall as residuals grow, in the denominator). Var(d) is that of the model, or ``sum c_i^2`` where that is larger
(the sandwich of one parameter), which contains errors along the path of fast rows. Where neighbouring c_i are
correlated (p < 0.001) it is multiplied by ``1 + 2 sum rho_l``, rho the autocorrelation of c_i, summed over its initial
positive sequence (C. J. Geyer 1992). The timing noise may thus be any stationary error whose correlation decays within
the recording. A constant error, such as the delay of a filter, is part of the offset itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from ...core.geometry.se3 import Array
from ...core.levels import CONTRADICTED
from ...core.rounding import HALF_DIGITS, SOLUTION_ROUNDING
from ...errors import DegenerateMotionError, InputError, NotConvergedError
from ...fit.graph.consensus import NO_WEIGHT, consensus, misfit, residual_noise, robust_variance
from ...fit.graph.constraint import OnPoses, Unknowns
from ...fit.graph.gauss_helmert import CLOSED_FORM_STEPS, Fit, fit
from ...fit.graph.noise_of_data import estimate_noise
from ...fit.graph.robust import FULL, pose_distances, robust_weights
from ...model.errors.models import PoseNoise, marginals
from ...model.errors.square_roots import gram, whiten
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.timing import SIDES
from .correlation import autocorrelation
from .interpolation import Interpolated
from .pairing import Pairing, noise_at, thinned

# Rows, evenly spread, of which the start, the first rounds and the noise are computed.
ROWS_FOR_START, ROWS_FOR_ROUNDS, ROWS_FOR_NOISE = 200, 1500, 2000
# Rows of which the final offset is computed: it is then known to microseconds, and more would only take time.
ROWS_FOR_RESULT = 20_000
# The iteration has converged at a step below this share of the standard deviation of the offset.
CONVERGED_STEP_SD = 1e-3
# The last step of an iteration that did not converge, but is accepted: weights and offset may take turns.
ACCEPTED_STEP_SD = 0.2
# Fewest rows whose correlation and squares are judged.
MIN_ROWS_TO_JUDGE = 30


class Refined(NamedTuple):
    """The offset, and X, W, noise and robust weights at it."""

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
    """One Gauss-Newton round: X and W at an offset, new robust weights, and the step of the offset."""

    fit: Fit
    weights: Array
    step: float
    information: float
    contributions: Array  # (n,): what each row adds to the error of the offset
    determined: bool  # X and W leave something of the influence of the offset


def start(pairing: Pairing, offset: float, seed: int) -> Refined:
    """Return X and W at an offset (robust, from few rows), the offset improved, and a score to compare candidates."""
    rows = thinned(pairing.rows_at(offset), ROWS_FOR_START)
    found = pairing.interpolated(offset, rows)
    constraint = OnPoses(*pairing.poses(found, rows), pairing.inverted)
    agreed = consensus(constraint, None, seed)
    noise = residual_noise(constraint, agreed.unknowns)
    assert isinstance(noise, PoseNoise)  # of poses, not of motions
    begun = Refined(offset, np.inf, np.inf, 1.0, agreed.unknowns, noise, False, agreed.inside, (offset, np.inf), 0.0, 0)
    improved = refine(pairing, begun, rows, None, strict=False)
    rows = thinned(pairing.rows_at(improved.offset), ROWS_FOR_START)
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
    max_steps: int = 40,
    longest_step: float = 0.1,
) -> Refined:
    """Refine X, W and the offset over these rows by Gauss-Newton, from ``begun``, in steps of ``longest_step`` (s).

    Rows that an offset on the way would have to extrapolate are left out. Raises `NotConvergedError` if ``strict``.
    """
    offset, at, noise, of_samples = begun.offset, begun.unknowns, begun.noise, begun.of_samples
    weights = begun.weights if len(begun.weights) == len(rows) else np.ones(len(rows))
    growth, last, low, high = 1.0, np.inf, -np.inf, np.inf
    for steps in range(1, max_steps + 1):
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
        if not done.determined:
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
        wanted = offset + float(np.clip(step, -longest_step, longest_step))
        halved = np.isfinite(high - low) and (abs(step) > 0.5 * abs(last) or not low < wanted < high)
        last, move = step, (0.5 * (low + high) if halved else wanted) - offset
        offset += move
        if abs(move) < max(CONVERGED_STEP_SD * model, SOLUTION_ROUNDING) and (settled or steps >= max_steps // 2):
            return Refined(offset, std, model, growth, at, noise, of_samples, weights, data, 0.0, steps)
    if strict and not abs(last) < ACCEPTED_STEP_SD * model:
        raise NotConvergedError(
            f"The time offset did not settle within {max_steps} steps (last at {offset:.6g} s, last step {step:.2g} "
            "s): the streams do not fit together. Look at the setup, at the frames of both streams and at their "
            "timestamps."
        )
    return Refined(offset, std, model, growth, at, noise, of_samples, weights, data, 0.0, max_steps)


def _round(
    pairing: Pairing, found: Interpolated, rows: NDArray[np.intp], at: Unknowns, noise: PoseNoise, weights: Array
) -> _Round:
    """Return X, W and weights at one offset, and the step of the offset."""
    constraint = OnPoses(*pairing.poses(found, rows), pairing.inverted)
    now = fit(constraint, noise, at, CLOSED_FORM_STEPS, weights)
    distances, _ = pose_distances(now)
    wanted = robust_weights(distances / max(robust_variance(distances, 6), 1.0))
    j = now.linear.sides[0 if pairing.side == "robot" else 1] @ found.rate[..., None]
    white = whiten(now.weighted_factor, np.concatenate([now.linear.J, j, now.residual[..., None]], axis=-1))
    sums = gram(white)
    left = white[..., 12] - white[..., :12] @ (now.covariance @ sums[:12, 12])
    information = float((left**2).sum())
    determined = information > HALF_DIGITS * float(sums[12, 12]) and information > 0
    contributions = -(left * white[..., 13]).sum(axis=-1) / (information if determined else 1.0)
    share = (left**2).sum(axis=-1) / (information if determined else 1.0)
    # What is left of the residual of a row grows as that row pulls the offset less: as in a jackknife.
    without = contributions / np.maximum(1.0 - share, 0.1)
    falling = (weights > 0) & (weights < 1)
    if determined and falling.any():  # d psi / d r = w + r dw/dr
        along = (left * white[..., 13]).sum(axis=-1)[falling] ** 2 / weights[falling] ** 2
        slope = 2.0 * float(along.sum()) / ((NO_WEIGHT - FULL) * max(robust_variance(distances, 6), 1.0))
        without = without / max(1.0 - slope / information, 0.25)
    return _Round(now, wanted, float(contributions.sum()), information, without, determined)


def _noise_of(pairing: Pairing, best: Refined, found: Interpolated, rows: NDArray[np.intp]) -> PoseNoise:
    """Return the noise of some rows: from that of the samples, or of these rows out of all that the best offset has."""
    if best.of_samples:
        return noise_at(best.noise, found, pairing.side)
    return best.noise.rows(np.searchsorted(pairing.rows_at(best.offset), rows))


def honest(c: Array, model_std: float) -> tuple[float, float]:
    """Return the standard deviation of the offset from its contributions (n,), and the factor of correlation."""
    n = len(c)
    variance, growth2 = model_std**2, 1.0
    if n >= MIN_ROWS_TO_JUDGE:
        variance = max(variance, float((c**2).sum()))
        growth2 = _growth2(c - c.mean())
    return float(np.sqrt(variance * growth2)), float(np.sqrt(growth2))


def _growth2(c: Array) -> float:
    """Return ``1 + 2 sum rho`` over the initial positive sequence, at least 1; 1 where chance explains it."""
    n, rho = len(c), autocorrelation(c)
    falling = 1.0 - np.arange(1, 6) / 6.0
    z = np.sqrt(n) * max(float(rho[1]), float(falling @ rho[1:6]) / float(np.sqrt(falling @ falling)))
    if 2 * float(ndtr(-z)) > CONTRADICTED.probability:
        return 1.0
    pairs = rho[: n // 2 * 2].reshape(-1, 2).sum(axis=1)
    last = int(np.argmax(pairs <= 0)) if (pairs <= 0).any() else len(pairs)
    return max(float(2 * pairs[: max(last, 1)].sum() - 1), 1.0)


def with_noise(pairing: Pairing, begun: Refined, rows: NDArray[np.intp]) -> PoseNoise:
    """Return the noise of the rows, estimated as `calibrate` would at the offset that ``begun`` has."""
    rows = thinned(rows, ROWS_FOR_NOISE)
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
    rows = thinned(every, ROWS_FOR_ROUNDS)
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
    """Return the RMS rotation (rad) and translation (m) residual per axis of the best X and W at each offset (m,).

    Of at most `ROWS_FOR_ROUNDS` rows that all offsets have, with the weights that these get at the best one.
    """
    common = np.intersect1d(pairing.rows_at(float(offsets.min())), pairing.rows_at(float(offsets.max())))
    rows = thinned(np.intersect1d(common, pairing.rows_at(best.offset)), ROWS_FOR_ROUNDS)
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
