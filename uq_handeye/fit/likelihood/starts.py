"""Start of the fit of X and W: 4DPA, or another start where the data leave directions open."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...errors import DegenerateMotionError
from ...methods.procrustes.limit import solve_limit
from ...methods.propagation.all_pairs import solve_all_pairs
from ...methods.propagation.published_fit import mean_target
from ...model.noise.models import Noise, with_prior, without_prior
from ...model.noise.pose_prior import PosePrior
from ...model.noise.square_roots import cholesky_of, gram, whiten
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from .constraint import Constraint, OnMotions, OnPoses, Unknowns, residual_covariance
from .open_directions import solve_information
from .open_start import isotropic_residuals, start_open


def start_of(data: PosePairs | Motions, constraint: Constraint, X: Array | None) -> Unknowns:
    """X by 4DPA where it is not given, and W as the mean of G X C."""
    if isinstance(constraint, OnMotions):
        return Unknowns(solve_limit(constraint.first, constraint.second) if X is None else X, None)
    poses = data.poses
    assert poses is not None
    X = solve_all_pairs(poses) if X is None else X
    return Unknowns(X, mean_target(poses, X))


def sound_start(
    data: PosePairs | Motions,
    constraint: Constraint,
    noise: Noise | None,
    prior: PosePrior | None = None,
    astray: NDArray[np.bool_] | None = None,
) -> Unknowns:
    """`start_of`, and where the data alone leave directions open, for which 4DPA has no answer, `start_open`.

    ``prior`` is for noise that is not known yet; else that of the noise counts. Problems (...) that are ``astray`` from
    4DPA go to `start_open` as well. Raises `DegenerateMotionError` where data and prior determine nothing of X.
    """
    batch = constraint.first.shape[:-3]
    X, W = np.zeros((*batch, 4, 4)), np.zeros((*batch, 4, 4))
    bad = np.ones(batch, dtype=bool)
    with suppress(DegenerateMotionError):
        at = start_of(data, constraint, None)
        guess = isotropic_residuals(constraint, at) if noise is None else without_prior(noise)
        X, W = np.array(at.X), W if at.W is None else np.array(at.W)
        bad = _open_problems(constraint, guess, at) | (False if astray is None else astray)
    for k in zip(*np.nonzero(bad), strict=True) if batch else [()] * int(bad):
        one = replace(constraint, first=constraint.first[k], second=constraint.second[k])
        try:
            at = start_open(one, noise if noise is None else _of_problem(noise, k), prior)
        except DegenerateMotionError:
            if not X[k].any():  # 4DPA has none either
                raise
            continue
        X[k] = at.X
        if at.W is not None:
            W[k] = at.W
    return Unknowns(X, W if isinstance(constraint, OnPoses) else None)


def leaves_open(constraint: Constraint, noise: Noise | None, at: Unknowns) -> bool:
    """Return whether the data of one problem, without prior, leave a direction open near the unknowns."""
    guess = isotropic_residuals(constraint, at) if noise is None else without_prior(noise)
    try:
        return bool(_open_problems(constraint, guess, at))
    except DegenerateMotionError:
        return True


def _open_problems(constraint: Constraint, noise: Noise, at: Unknowns) -> NDArray[np.bool_]:
    """Return whether the data of each problem (...) leave a direction open."""
    linear = constraint.linearise(at, constraint.first, constraint.second)
    S = residual_covariance(linear.sides, noise)
    information = gram(whiten(cholesky_of(S), linear.J))
    opened = solve_information(information, linear, constraint, noise, S, None, False).open
    if opened is None:
        return np.zeros(constraint.first.shape[:-3], dtype=bool)
    return np.asarray(opened.any(axis=(-2, -1)))


def _of_problem(noise: Noise, k: tuple[int, ...]) -> Noise:
    """Return the noise with the means of the prior of one problem out of many."""
    return noise if noise.prior is None else with_prior(noise, noise.prior.rows(k))
