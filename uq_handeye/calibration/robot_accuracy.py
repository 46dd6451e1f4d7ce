r"""The accuracy of a robot of which nothing is declared, by what the residuals show of smooth errors.

Model: errors of the kinematics are nearly the same at neighbouring poses. X takes up most of them and the residuals
keep the rest. They are a smooth field over the pose (`accuracy_field`) with the columns F at the accuracy `TYPICAL`,
beside noise of a covariance known up to a factor. With whitened residuals r, ``M = I - Q Q^T`` of the fit,
``G = F^T M F``, the moments

    E |r|^2 = phi dof + s^2 tr G,        E |F^T r|^2 = phi tr G + s^2 |G|_F^2

give phi and the variance s^2 of the field in units of `TYPICAL` (MINQUE: Rao 1971), with its standard error e. The
residuals show only a part of the errors of an arm: its parameters are few, and X and W absorb their largest effect. The
variance that is assumed is

    HIDDEN (s^2 + min(e, s^2)) + min(HIDDEN e, 1),      s^2 >= 0,    at least `BEST`^2,

so that residuals which exclude a smooth error leave little of it, and those that say nothing leave `TYPICAL`. Smooth
errors of another cause (a board that bows, a wrong camera model) count as well. `HIDDEN` is empirical: with it the
errors of simulated arms with parameters as measured (UR5, IRB 120, Panda; near and wide poses) stay within three
standard deviations in most sets, without it in few (study `headline`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..formatting.numbers import digits
from ..likelihood.gauss_helmert import Fit
from ..noise.square_roots import whiten
from ..poses.pose_pairs import PosePairs
from ..poses.timing import SIDES
from ..shared_errors.accuracy_field import TYPICAL
from ..shared_errors.shared_error import SharedError

HIDDEN = 8.0
BEST = 0.2  # of TYPICAL
# Least share of the noise as assumed that the residuals may have.
_LEAST_NOISE = 0.05


def scaled_by_residuals(fit: Fit, error: SharedError, poses: PosePairs) -> SharedError:
    """Return the robot's accuracy, bound to the poses, with the size that the residuals of the fit leave."""
    s2, e = smooth_variance(fit, error, poses)
    s2 = max(s2, 0.0)
    variance = max(HIDDEN * (s2 + min(e, s2)) + min(HIDDEN * e, 1.0), BEST**2)
    size = float(np.sqrt(variance))
    move, turn = TYPICAL
    words = f"{digits(1e3 * size * move, 2)} mm, {digits(float(np.degrees(size * turn)), 2)} deg"
    accuracy = None if error.accuracy is None else error.accuracy.times(size)
    return replace(error, sd=size * error.sd, stated=words, accuracy=accuracy)


def smooth_variance(fit: Fit, error: SharedError, poses: PosePairs) -> tuple[float, float]:
    """Return the variance of the field in units of its own, by the moments of the module, and its standard error.

    Infinite errors where the residuals have no degrees of freedom for it.
    """
    factor = fit.weighted_factor
    r = whiten(factor, fit.residual[..., None])[..., 0].reshape(-1)
    J = whiten(factor, fit.linear.J).reshape(len(r), -1)
    D = fit.linear.sides[SIDES.index(error.side)]
    F = whiten(factor, D @ (error.at(poses) * error.widest)).reshape(len(r), -1)
    Q = np.linalg.qr(J)[0]
    left = F - Q @ (Q.T @ F)
    g = np.maximum(np.linalg.eigvalsh(left.T @ left), 0.0)
    count = len(fit.residual) if fit.weights is None else float(np.sum(fit.weights))
    dof = 6.0 * count - Q.shape[1]
    if dof <= 0.0 or not g.any():
        return 0.0, float("inf")
    first, second = float(r @ r), float(np.sum((F.T @ r) ** 2))
    t = g.sum() / dof
    determinant = float((g * (g - t)).sum())
    if determinant <= 1e-9 * float((g * g).sum()):
        return 0.0, float("inf")
    s2 = (second - t * first) / determinant
    phi = max((first - s2 * g.sum()) / dof, _LEAST_NOISE)
    # Variance of the quadratic form under Gaussian residuals of the covariance phi M + s^2 M F F^T M.
    along = (g - t) / determinant * (phi + max(s2, 0.0) * g)
    rest = max(dof - len(g), 0.0) * (t / determinant * phi) ** 2
    return float(s2), float(np.sqrt(2.0 * (np.sum(along**2) + rest)))
