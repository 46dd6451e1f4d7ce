"""Problems that the tests of the likelihood share, and an independent maximum of the likelihood to judge by.

The reference knows nothing of residuals r, S or Gauss-Helmert: it minimises the whitened errors of all measured poses
over X, W and every camera pose, the robot poses being those that the constraint leaves, by `scipy.optimize`; its
covariance is the inverse of the Fisher information of all 12 + 6 n unknowns, by numerical differentiation.
"""

from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize
from support import (
    difference,
    draw,
    exact_motions,
    exact_poses,
    jacobian,
    moved,
    random_covariance,
)

import uq_handeye as uq
from uq_handeye.fit.likelihood.constraint import covariances_of
from uq_handeye.fit.likelihood.gauss_helmert import Fit

KINDS = ("eye-in-hand", "eye-to-hand", "motions")


class Problem(NamedTuple):
    kind: str
    data: uq.PosePairs | uq.Motions
    noise: uq.PoseNoise | uq.PairNoise
    X: np.ndarray
    W: np.ndarray | None
    exact: tuple[np.ndarray, np.ndarray]

    @property
    def measured(self):
        return (self.data.A, self.data.B) if self.kind == "motions" else (self.data.robot, self.data.camera)


def problem(kind, rng, n=8, sd=1e-3, joint=False, shape=()):
    """Data of random geometry with full 6x6 (or joint 6n x 6n) covariances on both sides."""
    per_item, whole = random_covariance(rng, 6, (n,), sd), random_covariance(rng, 6 * n if joint else 6, sd=sd)
    if kind == "motions":
        X, *exact = exact_motions(rng, n)
        W, noise = None, uq.PairNoise(per_item, whole)
    else:
        X, *exact = exact_poses(rng, n, kind)
        W = (exact[0] if kind == "eye-in-hand" else np.linalg.inv(exact[0]))[0] @ X @ exact[1][0]
        noise = uq.PoseNoise(per_item, whole)
    first = moved(exact[0], draw(rng, per_item, (*shape, n)))
    xi = draw(rng, whole, shape).reshape(*shape, n, 6) if joint else draw(rng, whole, (*shape, n))
    second = moved(exact[1], xi)
    data = uq.Motions(first, second) if kind == "motions" else uq.PosePairs(first, second, kind)
    return Problem(kind, data, noise, X, W, tuple(exact))


def as_joint(covariance, n):
    if covariance.ndim == 3:
        return linalg.block_diag(*covariance)
    return covariance if len(covariance) == 6 * n else np.kron(np.eye(n), covariance)


def reference(given):
    """The constrained maximum: X, W, their covariance (p, p), and minus twice the log-likelihood there."""
    first, second = given.measured
    n = len(first)
    joint = [as_joint(S, n) for S in covariances_of(given.noise)]
    whitening = [np.linalg.inv(np.linalg.cholesky(S)) for S in joint]
    p = 6 if given.W is None else 12
    size = p + 6 * n
    unit = np.sqrt(np.concatenate([np.tile(np.diag(joint[1])[:6], p // 6), np.diag(joint[1])]))

    def unknowns(x, at):
        x = x * unit
        X, W, C = at
        return (
            moved(X, x[..., :6]),
            None if W is None else moved(W, x[..., 6:12]),
            moved(C, x[..., p:].reshape(*x.shape[:-1], n, 6)),
        )

    def errors(x, at):
        X, W, C = unknowns(x, at)
        X = X[..., None, :, :]
        if W is None:
            G = X @ C @ np.linalg.inv(X)
        else:
            G = W[..., None, :, :] @ np.linalg.inv(C) @ np.linalg.inv(X)
            G = G if given.kind == "eye-in-hand" else np.linalg.inv(G)
        pairs = zip((first, second), (G, C), whitening, strict=True)
        return np.concatenate([difference(T, m).reshape(*x.shape[:-1], 6 * n) @ L.T for T, m, L in pairs], axis=-1)

    at = given.X, given.W, given.exact[1]

    def derivatives(x, at):
        return jacobian(lambda d: errors(x + d, at), size, step=1e-2)

    found = optimize.least_squares(errors, np.zeros(size), derivatives, args=(at,), xtol=1e-9, ftol=1e-12, gtol=1e-12)
    at, here = unknowns(found.x, at), np.zeros(size)
    for _ in range(4):  # the optimiser stops where the sum stands still, before its gradient is 0
        J = derivatives(here, at)
        at = unknowns(-np.linalg.lstsq(J, errors(here, at), rcond=None)[0], at)
    covariance = np.linalg.inv(J.T @ J) * unit * unit[:, None]
    return at[0], at[1], covariance[:p, :p], 2 * found.cost


def distance(found: Fit, X, W, covariance):
    """Between the estimate and X, W, in standard deviations."""
    e = difference(found.X, X)
    if W is not None:
        e = np.concatenate([e, difference(found.W, W)], axis=-1)
    return float(np.sqrt(np.max((e[..., None, :] @ np.linalg.solve(covariance, e[..., None]))[..., 0, 0])))
