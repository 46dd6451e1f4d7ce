r"""Variance components of the linearised constraint by restricted maximum likelihood (REML).

Model (`constraint`), with isotropic errors of the two sides and S_i linear in the variances:

    r_i = J_i dx + D_1i v_1i + D_2i v_2i,      S_i = s V_1i + c V_2i + b V_3i

s and c are the rotation variances of side 1 and side 2 (rad^2), b is the translation variance of both sides together
(m^2): on poses and on motions alike, each side rotates its translation error by an orthogonal matrix, which leaves
``sigma^2 I`` as it is, so that only the sum enters. Side 2 rotates its rotation error likewise:
``V_2 = blkdiag(I, 0)``, ``V_3 = blkdiag(0, I)``. Side 1 has a lever q_i (m):
``V_1 = [[I, -[q]x], [[q]x, -[q]x [q]x]]``. On poses q_i leads from the gripper to the target, on motions its length is
that of t_X.

In axes along q_i the six rows are three pairs (rotation, translation), independent of each other, with the levers
``l = |q|, |q|, 0`` and

    S = [[s + c, s l], [s l, b + s l^2]],   V_1 = (1, l)(1, l)^T,   V_2 = (1, 0)(1, 0)^T,   V_3 = (0, 1)(0, 1)^T

With ``P = S^-1 - S^-1 J (J^T S^-1 J)^-1 J^T S^-1`` minus twice the restricted log-likelihood, its score and its
expected information are (Patterson and Thompson 1971; Harville 1977)

    d = log|S| + log|J^T S^-1 J| + r^T P r
    score_k = (r^T P V_k P r - tr(P V_k)) / 2,      I_kl = tr(P V_k P V_l) / 2

and all are sums over pairs: O(n). Variances are >= 0; scoring with the average information
``r^T P V_k P V_l P r / 2`` (Gilmour, Thompson and Cullis 1995), an active set and step halving find the maximum.

With few poses lever times rotation can take the place of all translation noise, and the restricted likelihood may be
largest at ``b = 0``, where the translation residuals along the levers would be exact: a noise that nobody has, and a
covariance of X that is far too small. A weak prior, density proportional to the standard deviation (Chung et al.
2013), keeps b away from 0; it enlarges b by one part in its degrees of freedom. A pose of weight w counts as w poses.
Leading axes are independent problems.

What is known of unknowns beforehand. Errors e ~ N(0, I) that all rows share (T10, columns F scaled by their standard
deviations) are further unknowns, ``J -> [J, F]``, whose prior adds ``blkdiag(0, I)`` to ``J^T S^-1 J``. With
``S -> S + F F^T`` and X and W alone d is the same number, and all else above holds as it stands.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, gammaincinv

from ..geometry.se3 import Array, skew
from ..likelihood.constraint import Linearised
from ..likelihood.gauss_helmert import SINGULAR, inverse_information

# Of chi-square with one degree of freedom: a profile interval ends where the deviance has grown by this (95 %).
QUANTILE = float(chdtri(1, 0.05))
# The maximum is reached where the next step would gain less than this in the log-likelihood.
GAIN = 1e-8
MOST_STEPS = 60
MOST_STEPS_OF_ENDS = 40
_HALVINGS = 12
# Of the expected information that is added to the curvature of a step, so that it is never singular.
_SHARE = 0.02
# Information that is kept at least, as a share of that without the unknowns.
_LEAST = 1e-9
# Relative growth of the deviance that is taken for rounding.
_ROUNDING = 1e-11
# Variances below this share of the mean squared residual count as 0 where a sum of them must be positive.
_FLOOR = 1e-9
# Keeps information that variances near 0 make singular, to rounding, positive definite.
_RIDGE = 1e-13


@dataclass(frozen=True, eq=False)
class Rows:
    """All that r and J enter with: their Gram matrices by pairs with a lever, and one for all pairs without.

    With y the pair's rows of (J, r) in rotation and translation (each p + 1) the table holds, packed, ``y_t y_t^T``,
    ``y_t y_u^T + y_u y_t^T`` and ``y_u y_u^T`` times the weight; the last two rows of it are sums of the pairs without
    lever. Columns of J are scaled by ``unit``.
    """

    table: Array  # (..., 3 n + 2, q), q = (p + 1)(p + 2)/2
    lever: Array  # (..., n), metres
    weight: Array  # (..., n)
    unit: Array  # (..., p)
    size: Array  # (..., 2): mean squares of the rows of r in rotation and in translation, with no fit
    known: Array  # (..., p + 1, p + 1): what is known of the unknowns adds to the sums, scaled likewise

    def spread(self) -> Rows:
        """For several variances on the same data: those have one more leading axis, the last one."""
        return Rows(
            self.table, self.lever[..., None, :], self.weight[..., None, :], self.unit[..., None, :],
            self.size[..., None, :], self.known[..., None, :, :],
        )  # fmt: skip


class Restricted(NamedTuple):
    """Restricted likelihood at given variances (s, c, b)."""

    deviance: Array  # (...): minus twice the restricted log-likelihood
    score: Array  # (..., 3)
    information: Array  # (..., 3, 3), expected
    average: Array  # (..., 3, 3): mean of the expected and the observed information
    step: Array  # (..., p): the generalised-least-squares step of the unknowns, shared errors last


@dataclass(frozen=True, eq=False)
class Model:
    """Model of the unknown variances v (K): ``(s, c, b) = mixing v + offset``, some with a log-normal prior.

    A prior says that log of the standard deviation is Gaussian with mean ``log_mean`` and standard deviation
    ``log_sd``.
    """

    mixing: Array  # (3, K)
    offset: Array  # (3,)
    log_mean: Array  # (K,), 0 where there is no prior
    log_sd: Array  # (K,), infinite where there is no prior

    @property
    def size(self) -> int:
        """K"""
        return int(self.mixing.shape[1])

    @property
    def known(self) -> NDArray[np.bool_]:
        """(K,) which have a prior; they are found as logarithms, the others as they are."""
        return np.isfinite(self.log_sd)


class State(NamedTuple):
    """The objective at v, by the coordinates z: log v where there is a prior, else v."""

    v: Array  # (..., K)
    deviance: Array  # (...), with the prior
    score: Array  # (..., K)
    information: Array  # (..., K, K), expected
    curvature: Array  # (..., K, K), for the next step
    data: Restricted


def paired_rows(
    linear: Linearised, weights: Array | None, shared: Array | None = None, prior: Array | None = None
) -> Rows:
    """The n poses or motions of ``linear`` in axes along each lever, with ``weights`` (..., n) or None.

    ``shared`` (..., n, 6, k) are the effects on r of errors that all share, per standard deviation; ``prior``
    (p + 1, p + 1) is what one of the unknowns adds to ``[J, r]^T S^-1 [J, r]``. Raises `DegenerateMotionError` where
    the data do not determine the unknowns.
    """
    D = linear.sides[0]
    K = D[..., 3:, :3] @ D[..., :3, :3].mT  # [q]x
    q = np.stack([K[..., 2, 1], K[..., 0, 2], K[..., 1, 0]], axis=-1)
    lever = np.sqrt((q * q).sum(axis=-1))
    third = np.where(lever[..., None] > 0, q / np.where(lever > 0, lever, 1.0)[..., None], [0.0, 0.0, 1.0])
    w = np.broadcast_to(np.ones(lever.shape[-1]) if weights is None else weights, lever.shape)
    r, J = linear.r, linear.J
    p, k = J.shape[-1], 0 if shared is None else shared.shape[-1]
    known = np.diag(np.repeat([0.0, 1.0, 0.0], [p, k, 1]))
    if shared is not None:
        J = np.concatenate([J, np.broadcast_to(shared, (*J.shape[:-1], k))], axis=-1)
    if prior is not None:
        own = np.append(np.arange(p), p + k)
        known[np.ix_(own, own)] += prior
    total = np.maximum(3.0 * w.sum(axis=-1), 1e-300)
    squares = w[..., None] * r * r
    size = np.stack([squares[..., part].sum(axis=(-2, -1)) for part in (slice(3), slice(3, 6))], axis=-1)
    size = size / total[..., None]
    scaled = (w[..., None, None] * J * J).sum(axis=(-3, -2))
    unit = 1.0 / np.sqrt(np.where(scaled > 0, scaled, 1.0))
    y = np.concatenate([J * unit[..., None, None, :], r[..., None]], axis=-1)
    turn, shift = y[..., :3, :], y[..., 3:, :]
    along_turn, along_shift = ((third[..., None, :] @ part)[..., 0, :] for part in (turn, shift))
    # Of rows across the lever: sums over both pairs. [q]x turns axes (e, f) across it into |q| (f, -e), so that the
    # translations that go with rotations (e, f) are (f, -e): those of the rows turned by [third]x.
    i, j = np.triu_indices(y.shape[-1])
    K = skew(third)
    turned = K.mT @ shift
    across_turn = turn - third[..., :, None] * along_turn[..., None, :]
    root = np.sqrt(w)[..., None, None]
    across_turn, turned = root * across_turn, root * turned
    parts = [
        across_turn.mT @ across_turn,
        (mixed := across_turn.mT @ turned) + mixed.mT,
        turned.mT @ turned,
        *(((flat := root[..., 0] * part).mT @ flat)[..., None, :, :] for part in (along_turn, along_shift)),
    ]
    table = np.concatenate([part[..., i, j] for part in parts], axis=-2)
    wide = np.concatenate([unit, np.ones((*unit.shape[:-1], 1))], axis=-1)
    known = known * wide[..., :, None] * wide[..., None, :]
    _require_rank(parts, unit, known)
    return Rows(table, lever, w, unit, size, known)


def _require_rank(parts: list[Array], unit: Array, known: Array) -> None:
    """Raise where rotation and translation rows, and what is known, together do not determine the unknowns."""
    total = parts[0].sum(axis=-3) + parts[2].sum(axis=-3) + parts[3][..., 0, :, :] + parts[4][..., 0, :, :]
    total = total + known
    by = 1.0 / unit
    inverse_information(total[..., :-1, :-1] * by[..., :, None] * by[..., None, :])


def restricted(rows: Rows, variances: Array) -> Restricted:
    """Deviance, score and expected information at (s, c, b) (..., 3)."""
    floor = _FLOOR * rows.size
    s, c = np.maximum(variances[..., 0, None], 0.0), np.maximum(variances[..., 1, None], 0.0)
    a = np.maximum(s + c, floor[..., 0, None])
    b = np.maximum(variances[..., 2, None], floor[..., 1, None])
    lever, w = rows.lever, rows.weight
    lever = np.broadcast_to(lever, np.broadcast_shapes(lever.shape, a.shape))
    square = lever * lever
    det = a * b + s * c * square
    drag = s * lever
    # S^-1 u_k (turn and shift, k = 1, 2, 3), u_k^T S^-1 u_l (k <= l) and S^-1, across the lever ...
    g = np.empty((*det.shape[:-1], 3, 2, det.shape[-1]))
    g[..., 0, 0, :], g[..., 0, 1, :] = b, c * lever
    g[..., 1, 0, :], g[..., 2, 1, :] = b + drag * lever, a
    g[..., 1, 1, :] = g[..., 2, 0, :] = -drag
    g /= det[..., None, None, :]
    m = np.empty((*det.shape[:-1], 6, det.shape[-1]))
    m[..., 0, :] = (b + c * square) / det
    m[..., 1:3, :], m[..., 3:5, :], m[..., 5, :] = g[..., 0, :, :], g[..., 1, :, :], g[..., 2, 1, :]
    # ... and along it, where one number serves all pairs.
    by_a, by_b = 1.0 / a, 1.0 / b
    none = np.zeros_like(by_a)
    g_along = np.concatenate([by_a, none, by_a, none, none, by_b], axis=-1).reshape(*det.shape[:-1], 3, 2)
    m_along = np.concatenate([by_a, by_a, none, by_a, none, by_b], axis=-1)
    # For each table row the factors of S^-1, of S^-1 V_k S^-1 and of S^-1 V_k S^-1 V_l S^-1.
    factors = np.empty((*det.shape[:-1], 10, rows.table.shape[-2]))
    across = factors[..., :-2].reshape(*det.shape[:-1], 10, 3, -1)
    first, second = g[..., _FIRST, :, :], g[..., _SECOND, :, :]
    products = first * second  # turn turn, shift shift
    mixed = 0.5 * (first[..., 0, :] * second[..., 1, :] + first[..., 1, :] * second[..., 0, :])
    across[..., 0, 0, :], across[..., 0, 1, :], across[..., 0, 2, :] = g[..., 1, 0, :], g[..., 1, 1, :], g[..., 2, 1, :]
    across[..., 1:4, ::2, :], across[..., 1:4, 1, :] = products[..., _SAME, :, :], mixed[..., _SAME, :]
    across[..., 4:, ::2, :], across[..., 4:, 1, :] = products * m[..., None, :], mixed * m
    along = g_along[..., _FIRST, :] * g_along[..., _SECOND, :]
    factors[..., :-2] = across.reshape(*det.shape[:-1], 10, -1)
    factors[..., 0, -2:] = np.concatenate([by_a, by_b], axis=-1)
    factors[..., 1:4, -2:], factors[..., 4:, -2:] = along[..., _SAME, :], along * m_along[..., None]
    # one product with the table, also for several variances on the same data
    # (einsum, as BLAS would start threads for it, whose waiting takes 50 times as long on a busy machine)
    flat = np.einsum("...ij,...jk->...ik", factors.reshape(*rows.table.shape[:-2], -1, factors.shape[-1]), rows.table)
    sums = _unpacked(flat.reshape(*factors.shape[:-1], -1))
    F, N, L = sums[..., 0, :, :], sums[..., 1:4, :, :], sums[..., 4:, :, :]
    F = F + rows.known
    scale = 1.0 / np.sqrt(np.einsum("...ii->...i", F[..., :-1, :-1]))
    unit = F[..., :-1, :-1] * scale[..., :, None] * scale[..., None, :]
    factor = np.linalg.cholesky(unit + _RIDGE * np.eye(unit.shape[-1]))
    half = np.linalg.inv(factor) * scale[..., None, :]
    C = half.mT @ half
    step = -(C @ F[..., :-1, -1:])
    z = np.concatenate([step, np.ones((*step.shape[:-2], 1, 1))], axis=-2)
    residual = (z.mT @ F @ z)[..., 0, 0]
    Nz = (N @ z[..., None, :, :])[..., 0]
    quadratic = (Nz * z[..., None, :, 0]).sum(axis=-1)
    both = Nz[..., :-1] @ C @ Nz[..., :-1].mT
    both[..., _FIRST, _SECOND] = (z.mT[..., None, :, :] @ L @ z[..., None, :, :])[..., 0, 0] - both[
        ..., _FIRST, _SECOND
    ]
    both[..., _SECOND, _FIRST] = both[..., _FIRST, _SECOND]
    CN = C[..., None, :, :] @ N[..., :-1, :-1]
    total = w.sum(axis=-1)
    trace = 2.0 * (w[..., None, :] * m[..., _SAME, :]).sum(axis=-1) + total[..., None] * m_along[..., _SAME]
    trace = trace - np.einsum("...ii->...", CN)
    whole = 2.0 * (w[..., None, :] * m * m).sum(axis=-1) + total[..., None] * m_along**2
    squares = whole - 2.0 * (C[..., None, :, :] * L[..., :-1, :-1]).sum(axis=(-2, -1))
    squares = squares + (CN[..., _FIRST, :, :] * CN.mT[..., _SECOND, :, :]).sum(axis=(-2, -1))
    squares[..., _SAME] = np.maximum(squares[..., _SAME], _LEAST * whole[..., _SAME])  # never lost in rounding
    information = np.empty((*det.shape[:-1], 3, 3))
    information[..., _FIRST, _SECOND] = information[..., _SECOND, _FIRST] = 0.5 * squares
    logs = 2.0 * (w * np.log(det)).sum(axis=-1) + total * np.log(a * b)[..., 0]
    logs = logs + 2.0 * np.log(np.diagonal(factor, axis1=-2, axis2=-1) / (scale * rows.unit)).sum(axis=-1)
    return Restricted(logs + residual, 0.5 * (quadratic - trace), information, 0.5 * both, step[..., 0] * rows.unit)


# Entries (k, l), k <= l, of a symmetric 3x3 matrix, and where k = l.
_FIRST, _SECOND = np.triu_indices(3)
_SAME = np.flatnonzero(_FIRST == _SECOND)


def _unpacked(packed: Array) -> Array:
    """Symmetric matrices (..., k, k) from their upper triangles (..., k (k + 1)/2)."""
    return packed[..., _places(packed.shape[-1])]


@cache
def _places(count: int) -> NDArray[np.intp]:
    k = int(np.sqrt(2 * count))
    i, j = np.triu_indices(k)
    where = np.empty((k, k), dtype=np.intp)
    where[i, j] = where[j, i] = np.arange(count)
    return where


def state_of(rows: Rows, model: Model, v: Array) -> State:
    """The objective with its priors; the weak one on b (module) is part of it."""
    variances = v @ model.mixing.T + model.offset
    data = restricted(rows, variances)
    b = np.maximum(variances[..., 2], _FLOOR * rows.size[..., 1])
    weak = np.zeros_like(data.information)
    weak[..., 2, 2] = 0.5 / b**2
    by_variance = data.score + 0.5 * np.eye(3)[2] / b[..., None]
    score = by_variance @ model.mixing
    information = model.mixing.T @ (data.information + weak) @ model.mixing
    curvature = model.mixing.T @ (data.average + weak) @ model.mixing
    deviance = data.deviance - np.log(b)
    known = model.known
    if known.any():
        by = np.where(known, v, 1.0)
        off = np.where(known, (0.5 * np.log(by) - model.log_mean) / model.log_sd, 0.0)
        score = by * score - 0.5 * off / model.log_sd
        own = np.diag(0.25 / model.log_sd**2)
        scale = by[..., :, None] * by[..., None, :]
        information, curvature = scale * information + own, scale * curvature + own
        deviance = deviance + (off * off).sum(axis=-1)
    curvature = curvature + _SHARE * information * np.eye(model.size)
    # what is only rounding gives no step
    lost = (np.einsum("...ii->...i", curvature) <= 0.5 * _SHARE * np.einsum("...ii->...i", information)).any(axis=-1)
    curvature = np.where(lost[..., None, None], information * np.eye(model.size), curvature)
    return State(v, deviance, score, information, curvature, data)


def maximise(
    rows: Rows, model: Model, v: Array, held: NDArray[np.bool_] | None = None, gain: float = GAIN
) -> tuple[State, NDArray[np.bool_]]:
    """The maximum from a start v (..., K), and whether it was reached (...); ``held`` (..., K) do not move."""
    state = state_of(rows, model, v)
    held = np.zeros(model.size, dtype=bool) if held is None else held
    held = np.broadcast_to(held, v.shape)
    known = model.known
    done = np.zeros(v.shape[:-1], dtype=bool)
    for _ in range(MOST_STEPS):
        move = _move(state, known, held)
        ahead = (state.score * move).sum(axis=-1)
        done = done | (ahead < gain)
        if done.all():
            break
        share = np.where(done, 0.0, 1.0)
        for _ in range(_HALVINGS):
            tried = state_of(rows, model, _moved(state.v, share[..., None] * move, known))
            worse = tried.deviance > state.deviance + _ROUNDING * (1.0 + np.abs(state.deviance))
            if not worse.any():
                break
            share = np.where(worse, 0.25 * share, share)
        else:
            tried = state_of(rows, model, _moved(state.v, np.where(worse, 0.0, share)[..., None] * move, known))
            done = done | worse
        state = tried
    return state, done


def _moved(v: Array, move: Array, known: NDArray[np.bool_]) -> Array:
    return np.where(known, v * np.exp(np.where(known, move, 0.0)), np.maximum(v + move, 0.0))


def _move(state: State, known: NDArray[np.bool_], held: NDArray[np.bool_], shift: Array | float = 0.0) -> Array:
    """The scoring step with ``v >= 0``, where ``held`` move by ``shift``.

    What would become negative is set to 0, and the others step again.
    """
    unit = 1.0 / np.sqrt(np.maximum(np.diagonal(state.curvature, axis1=-2, axis2=-1), 1e-300))
    size = state.v.shape[-1]
    matrix = state.curvature * unit[..., :, None] * unit[..., None, :] + 1e-10 * np.eye(size)
    score = state.score * unit
    bounded = np.broadcast_to(~known, held.shape)
    stop = -state.v / unit
    given = held | (bounded & (state.v <= 0.0) & (state.score <= 0.0))
    step = np.where(held, shift / unit, stop)
    for _ in range(size):
        fixed = np.where(given, step, 0.0)
        load = np.where(given, fixed, score - (matrix @ fixed[..., None])[..., 0])
        both = ~given[..., :, None] & ~given[..., None, :]
        found = np.linalg.solve(np.where(both, matrix, np.eye(size)), load[..., None])[..., 0]
        beyond = bounded & ~given & (found < stop)
        step = np.where(given, fixed, np.where(beyond, stop, found))
        if not beyond.any():
            break
        given = given | beyond
    move = step * unit
    return np.where(known & ~held, np.clip(move, -3.0, 3.0), move)


def intervals(rows: Rows, model: Model, best: State, which: NDArray[np.intp]) -> tuple[Array, Array, NDArray[np.bool_]]:
    """95 % intervals (..., k) of the variances ``which`` (k), and whether both ends were found (..., k).

    An end is where the deviance of the restricted likelihood, all else at its best, has grown by QUANTILE. One that was
    not found is the outer end of its bracket: the interval is then too wide, never too narrow.

    The lower end is 0 where the data cannot tell the variance from 0. Each end is a Newton iteration on the square root
    of the growth, by log v, in which the others move along; a bracket keeps it safe.
    """
    K, k = model.size, len(which)
    index, upper = np.tile(which, 2), np.arange(2 * k) >= k  # lower ends, then upper ends
    held = np.broadcast_to(np.eye(K, dtype=bool)[index], (*best.v.shape[:-1], 2 * k, K))
    wide = rows.spread()
    known, known_here = model.known, model.known[index]
    centre = best.v[..., index]
    deviation = np.sqrt(_variances(best))[..., index]
    low, high = np.where(upper, centre, 0.0), np.where(upper, np.inf, centre)
    # where the data tell a variance from 0 at a glance, 0 is not tried
    relative = np.where(known_here, deviation, deviation / np.where(centre > 0, centre, 1.0))
    sure = (centre > 0) & (known_here | (relative < 0.3))
    reach = np.exp(np.where(upper, 2.0, -2.0) * np.minimum(relative, 3.0))
    guess = np.where(sure, centre * reach, np.where(upper, centre + 2.5 * deviation, 0.0))
    v = np.broadcast_to(best.v[..., None, :], held.shape)
    root = float(np.sqrt(QUANTILE))
    state, _ = maximise(wide, model, np.where(held, guess[..., None], v), held, gain=1e-2)
    last = np.full(held.shape[:-1], np.inf)
    finished = np.zeros(held.shape[:-1], dtype=bool)
    for _ in range(MOST_STEPS_OF_ENDS):
        move = _move(state, known, held)
        gain = np.maximum((state.score * move).sum(axis=-1), 0.0)
        if (gain > 0.5).any():
            state, _ = maximise(wide, model, state.v, held, gain=1e-2)
            continue
        share = np.where(gain > 0.3 * last, 0.5, 1.0)
        last = gain
        distance = np.sqrt(np.maximum(state.deviance - gain - best.deviance[..., None], 1e-12))
        at_zero = guess <= 0.0
        near = gain < 5e-3
        finished = near & ((at_zero & (distance <= root)) | (np.abs(distance - root) < 2e-3))
        finished |= np.isfinite(high) & (high - low <= 1e-9 * np.where(np.isfinite(high), high, 1.0))
        if finished.all():
            break
        outside = distance > root
        high = np.where(near & (outside == upper), guess, high)
        low = np.where(near & (outside != upper), guess, low)
        profile = state.score - (state.curvature @ move[..., None])[..., 0]
        slope = -(profile * np.where(held & ~known, state.v, held)).sum(axis=-1) / distance  # of the distance by log v
        right = np.where(upper, slope > 1e-3, slope < -1e-3)
        ahead = np.clip((root - distance) / np.where(right, slope, np.where(upper, 1.0, -1.0)), -1.5, 1.5)
        ahead = np.where(at_zero, 0.3 * centre, guess * np.exp(ahead))
        within = np.sqrt(low * np.where(np.isinf(high), 0.0, high))
        middle = np.where(np.isinf(high), 2.0 * guess, np.where(low > 0, within, 0.25 * guess))
        new = np.where((ahead > low) & (ahead < high), ahead, middle)
        new = np.where(finished | ~near, guess, new)
        grown = np.log(np.where(known_here, new, 1.0) / np.where(known_here, guess, 1.0))
        shift = np.where(held, np.where(known_here, grown, new - guess)[..., None], 0.0)
        move = _move(state, known, held, shift) * np.where(near, 1.0, share)[..., None]
        moved = _moved(state.v, np.where(held, 0.0, move), known)
        guess = new
        state = state_of(wide, model, np.where(held, guess[..., None], moved))
    else:
        guess = np.where(finished, guess, np.where(upper, high, low))
    return guess[..., :k], guess[..., k:], finished[..., :k] & finished[..., k:]


def _variances(state: State) -> Array:
    """(..., K) of the estimates by z."""
    return np.diagonal(covariance_of(state), axis1=-2, axis2=-1)


def covariance_of(state: State) -> Array:
    """(..., K, K) of the estimates by z; directions without information get the largest variance that is finite."""
    unit = 1.0 / np.sqrt(np.maximum(np.diagonal(state.information, axis1=-2, axis2=-1), 1e-300))
    scale = unit[..., :, None] * unit[..., None, :]
    values, vectors = np.linalg.eigh(state.information * scale)
    return np.asarray((vectors / np.maximum(values, SINGULAR)[..., None, :]) @ vectors.mT * scale)


def chi_square_interval(value: Array, variance: Array) -> tuple[Array, Array]:
    """95 % interval of a variance whose estimate is about chi-square with ``2 value^2 / variance`` degrees of freedom.

    Below about 0.01 degrees of freedom there is no upper end: infinite.
    """
    half = value * value / np.where(variance > 0, variance, 1.0)
    usable = (half > 0.005) & (variance > 0)
    half = np.where(usable, half, 1.0)
    low, high = (half * value / gammaincinv(half, level) for level in (0.975, 0.025))
    low = np.where(usable, low, np.where(variance > 0, 0.0, value))
    return low, np.where(usable, high, np.where(variance > 0, np.inf, value))
