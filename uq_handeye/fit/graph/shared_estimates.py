r"""The posterior of one fit for the errors that all poses share: estimates, test of each, and their effect on X.

Model: a `Fit` whose noise holds columns F with a name (`SharedError`), scaled by their standard deviations, so that
``e = sd z``, ``z ~ N(0, I)``; z, its covariance and its effect on X and W are `Fit.told`, the joint fit of (x, z).
The estimate of one of them from the residuals, without its prior but with those of the others, is
``z / (1 - v) +- sqrt(v / (1 - v))``, v its variance: the score test of one more unknown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from ...core.geometry.se3 import Array, perturb
from ...core.rounding import CHAIN_ROUNDING, EPS
from ...model.errors.cholesky import symmetric_factor
from ...model.errors.columns import parts_of, some_rows, times
from ...model.errors.error_estimate import ErrorEstimate
from ...model.errors.joint_covariance import joint_of
from ...model.errors.key import ErrorKey, Owner
from ...model.errors.keys import DRIFTS, INTRINSICS
from ...model.errors.models import Noise
from ...model.shared_errors.shared_error import OF_LENGTHS, SharedError
from .constraint import MIN_RESOLVED_SHARE, covariances_of
from .gauss_helmert import Fit, Told
from .posterior import Posterior

# What X and W cannot explain of a column must exceed what the noise of the poses makes of it, in squares, by this
# factor: else it is that noise which residuals and column have in common. By the same factor the data must resolve a
# direction better than `MIN_RESOLVED_SHARE` before it is tested.
MIN_EXPLAINED_RATIO = 10.0
# Factors by which the standard deviations of an error are multiplied in its test.
SD_FACTORS = np.geomspace(1e-2, 1e3, 501)


class GroupTest(NamedTuple):
    """The numbers of one error, all together, against what was assumed of them."""

    p_value: float
    times: float  # the factor of the standard deviations that explains the estimates best


def posterior_of_fit(
    fit: Fit, noise: Noise, errors: Sequence[SharedError], beside: Mapping[ErrorKey, Array] | None = None
) -> Posterior:
    """Return the posterior of the unknown poses, of those errors that the noise has columns of, and of what the
    intrinsics of the camera do to its poses (columns without a key of their own).

    ``beside`` are moves (p,) or (p, r) of the poses by errors that the noise does not hold.
    """
    C, p = fit.covariance, fit.linear.J.shape[-1]
    columns: dict[ErrorKey, tuple[int, int]] = {}
    sd: dict[ErrorKey, float] = {}
    for k, (side, S) in enumerate(zip(noise.sides, map(joint_of, covariances_of(noise)), strict=True)):
        for j, key in enumerate(() if S is None else S.keys):
            if side == "camera" and key in (None, INTRINSICS):
                key = INTRINSICS.number(j)
                sd[key] = 1.0
            if key is not None:
                columns[key] = k, j
    of_errors = {key: float(s) for error in errors for key, s in zip(error.keys, error.sd, strict=True)}
    sd = {key: s for key, s in (of_errors | sd).items() if key in columns}
    unit = np.array(list(sd.values()))
    z, response, left = _told(fit, noise, [columns[key] for key in sd])
    left = left * np.outer(unit, unit)
    C = C + sum(map(of_moves, (beside or {}).values()), np.zeros(()))
    joint = np.block([[C, response * unit], [(response * unit).T, left]])
    return Posterior(tuple(sd), unit * z, 0.5 * (joint + joint.T), ("X", "W")[: p // 6])


def _told(fit: Fit, noise: Noise, columns: Sequence[tuple[int, int]]) -> Told:
    """`Fit.told` of columns of the noise that the fit is of, by the number of their side and their own on that side."""
    sides = [joint_of(S) for S in covariances_of(noise)]
    if joint_of(fit.S) is None:
        f = [fit.linear.sides[k] @ S.shared[..., j, None] for k, j in columns if (S := sides[k]) is not None]
        return fit.told(np.concatenate([*f, np.zeros((*fit.residual.shape, 0))], axis=-1))
    before = 0 if sides[0] is None else sides[0].columns.shape[-1]  # S has those of the first side first
    return fit.told_of_shared.of(np.array([j + k * before for k, j in columns], dtype=np.intp))


def motion_in_session(fit: Fit, noise: Noise) -> Array | None:
    r"""Return moves (p, p) of X and W from their means over the session to where they were at any of its poses.

    With the numbers z of a drift, ``M = E z z^T`` by their posterior, and its columns F_i at the n poses, X (of a
    camera that drifts; W of a target) is off its mean by ``xi_i = J_i^-1 D_i F_i z``, J_i the derivative by X: as of a
    pose drawn from the session it has ``n^-1 sum_i E xi_i xi_i^T`` more. None where no drift is in the noise.
    """
    p, S = fit.linear.J.shape[-1], joint_of(covariances_of(noise)[1])
    if S is None or p < 12:
        return None
    found = np.zeros((p, p))
    for place, moved in ((slice(0, 6), Owner.CAMERA), (slice(6, 12), Owner.TARGET)):
        of = [j for j, key in enumerate(S.keys) if key is not None and key.error == DRIFTS[moved]]
        if of:
            z, _, left = _told(fit, noise, [(1, j) for j in of])
            for rows in parts_of(S.n):
                f = fit.linear.sides[1][rows] @ some_rows(S.some(of), rows)
                xi = np.linalg.solve(fit.linear.J[rows, :, place], f)
                found[place, place] += (xi @ (np.outer(z, z) + left) @ xi.mT).sum(axis=0) / S.n
    return symmetric_factor(found) if found.any() else None


def without_shared_errors(fit: Fit, noise: Noise, first: Array, second: Array) -> tuple[Array, Array] | None:
    """The measured poses of both sides less the shared errors, as the residuals tell them; None without any."""
    shared = [S if S is None else S.columns for S in map(joint_of, covariances_of(noise))]
    if not any(F is not None and F.shape[-1] for F in shared):
        return None
    found = []
    for k, (T, F) in enumerate(zip((first, second), shared, strict=True)):
        if F is not None:
            T = perturb(T, -times(F, _told(fit, noise, [(k, j) for j in range(F.shape[-1])]).z))
        found.append(T)
    return found[0], found[1]


def group_test(posterior: Posterior, sd: Mapping[ErrorKey, float], error: ErrorKey) -> GroupTest | None:
    """Test whether the estimates of the numbers of an error are as large as assumed, by the standard deviation of each.

    In units of the prior and along the eigenvectors of what the data tell, ``I - P = V diag(v) V^T``, an estimate has
    the variance ``v (1 + (s^2 - 1) v)`` if the standard deviations should have been s times as large: weakly resolved
    numbers say little of s. s is the one of largest likelihood, p that of the likelihood ratio to s = 1 (chi-square
    with one degree of freedom, asymptotically). None where the data say nothing.
    """
    of = [k for k, key in enumerate(posterior.keys) if key.source == error and key in sd]
    unit, at = np.array([sd[posterior.keys[k]] for k in of]), posterior.p + np.array(of, dtype=np.intp)
    left = posterior.covariance[np.ix_(at, at)] / np.outer(unit, unit)
    values, vectors = np.linalg.eigh(np.eye(len(unit)) - left)
    heard = values > MIN_EXPLAINED_RATIO * MIN_RESOLVED_SHARE
    if not heard.any():
        return None
    z = posterior.estimate[at - posterior.p] / unit
    told = values[heard]
    squares = (vectors.T @ z)[heard] ** 2 / told
    variances = 1.0 + (np.append(SD_FACTORS, 1.0)[:, None] ** 2 - 1.0) * told
    costs = np.sum(np.log(variances) + squares / variances, axis=1)
    best = int(np.argmin(costs[:-1]))
    return GroupTest(float(chdtrc(1, max(costs[-1] - costs[best], 0.0))), float(SD_FACTORS[best]))


def estimates_of(posterior: Posterior, errors: Sequence[SharedError], fit: Fit) -> tuple[ErrorEstimate, ...]:
    """Return what the posterior says of the errors, in their order; shares are of the covariance of the fit."""
    place = posterior.place
    parts = [
        (error, key, float(s), place[key])
        for error in errors
        for key, s in zip(error.keys, error.sd, strict=True)
        if key in place
    ]
    if not parts:
        return ()
    to_unit, p, found = _to_unit(fit.covariance[:6, :6]), posterior.p, []
    for error, key, sd, k in parts:
        left = float(np.clip(posterior.covariance[p + k, p + k] / sd**2, EPS, 1.0))
        told, value, effect = 1.0 - left, float(posterior.estimate[k]), posterior.covariance[:6, p + k] / sd
        says = told > CHAIN_ROUNDING
        if error.key in OF_LENGTHS:
            says = says and told > MIN_EXPLAINED_RATIO * 3 * len(fit.residual) * left * sd * sd
        found.append(
            ErrorEstimate(
                key, error.side, error.unit, sd, sd, sd, count=1, resolved=told, estimate=value,
                share=float(min(np.sum((to_unit @ effect) ** 2), 1.0)), sd=sd * float(np.sqrt(left)),
                alone=value / told if says else None, alone_sd=sd * float(np.sqrt(left / told)) if says else None,
                effect=effect, default=error.default, focal_length_px=error.focal_length_px, stated=error.stated,
                accuracy=error.accuracy,
            )
        )  # fmt: skip
    return tuple(found)


def _to_unit(C: Array) -> Array:
    """Return R with ``R C R^T = 1`` on what C (6, 6) determines; rounding may leave a direction without variance."""
    unit = 1.0 / np.sqrt(np.maximum(np.diag(C), 1e-300))
    values, vectors = np.linalg.eigh(C * np.outer(unit, unit))
    known = values > CHAIN_ROUNDING
    return np.asarray((vectors[:, known] / np.sqrt(values[known])).T * unit)


def of_moves(moves: Array) -> Array:
    """Covariance (p, p) of X and W by moves (p,), or (p, r) of r independent errors, of one standard deviation each."""
    each = moves.reshape(len(moves), -1)
    return np.asarray(each @ each.T)
