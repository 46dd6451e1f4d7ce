r"""Errors that all poses share and of which the data are not asked: carried to X and W as they are (type B).

A smooth error of the robot over its poses is no unknown that residuals of one region could tell: what they seem to say
of it is what the model of it happens to be. X stays as it is estimated without it; its covariance grows.
"""

from __future__ import annotations

import numpy as np

from ..geometry.se3 import Array
from ..noise.square_roots import pulled, whiten
from ..poses.pose_pairs import PosePairs
from ..poses.timing import SIDES
from ..shared_errors.shared_error import SharedError
from .gauss_helmert import Fit
from .shared_estimates import SharedEstimate


def carried_moves(fit: Fit, error: SharedError, poses: PosePairs) -> Array:
    """(p, r) how X and W move with an error of the data's poses of which the data are not asked.

    With the gain ``K_i = -C J_i^T S^-1 D_i`` of the estimate they move by
    ``sum_i K_i F_i z``, z ~ N(0, I); r <= p moves have the same covariance.
    """
    factor = fit.weighted_factor
    back = pulled(factor, whiten(factor, fit.linear.J))  # S^-1 J
    D = fit.linear.sides[SIDES.index(error.side)]
    by_error = np.einsum("nri,nrk->ik", back, D @ (error.at(poses) * error.widest))
    U, s, _ = np.linalg.svd(-(fit.closed_projection @ fit.covariance) @ by_error, full_matrices=False)
    return np.asarray(U * s)


def carried_estimates(error: SharedError, moves: Array, covariance: Array) -> tuple[SharedEstimate, ...]:
    """One for each of the moves (p, r); ``covariance`` (6, 6) of X holds them."""
    to_unit = np.linalg.pinv(covariance, hermitian=True)
    return tuple(
        SharedEstimate(
            f"{error.name}: {k + 1}", error.name, error.side, "", 1.0, 0.0, 1.0, None, None, move,
            float(np.clip(move @ to_unit @ move, 0.0, 1.0)), stated=error.stated, default=error.default,
            accuracy=error.accuracy,
        )
        for k, move in enumerate(moves[:6].T)
    )  # fmt: skip
