r"""The covariance of X beyond first order, by sigma points.

Model: the errors of all poses (motions) of both sides are ``L z``, ``L L^T`` their covariance and z standard normal of
dimension D: 6 per pose and side with noise. A method makes of them the error ``xi = f(z)`` of X, ``xi = (theta, tau)``,
left rotation, additive translation, rad and m; ``f(0) = 0`` on exact data. Wanted are ``bias = E f`` and
``mean_square = E f f^T = covariance + bias bias^T``.

With ``z = r q``, q uniform on the unit sphere and ``r^2 / 2`` distributed as gamma(D/2), the spherical-radial rule of
Genz and Monahan (SIAM J. Sci. Comput. 19 (1998) 426-439) replaces q by the 2 D points ``+-Q e_k`` of a random
orthogonal matrix Q (exact to degree 3). Here each of two radii has its own Q; they and their weights are those of the
generalised Gauss-Laguerre rule, exact to degree 7 in r:

    r^2 = D + 2 +- sqrt(2 D + 4),    w_r = (1 -+ 1 / sqrt(D/2 + 1)) / 2
    bias = sum_r w_r / (2 D) sum_k (f(r Q e_k) + f(-r Q e_k)),    mean_square = the same of f f^T

Then, with ``f = linear + quadratic + cubic + ...`` in z:

- For any Q the first-order covariance comes out exactly, without Monte Carlo noise, as ``sum_k Q e_k e_k^T Q^T = I``,
  and so does the bias of the quadratic part. Odd and even parts of f do not mix: ``f f^T`` summed over a pair of points
  is ``2 (f_odd f_odd^T + f_even f_even^T)``.
- On average over Q all polynomials in z of degree 7 are integrated exactly, as ``Q e_k`` is uniform on the sphere: the
  mean square is right to the sixth order in the standard deviations of the noise (first order: to the second), and
  neglected is the eighth. With K directions in all, what is added to first order scatters by about ``sqrt(2 / K)`` of
  itself.
- The points lie where Gaussian draws lie (``|z| = sqrt(D)`` to a part ``1 / sqrt(2 D)``): where no series converges
  they still are a Monte Carlo. They see nothing of what happens to one draw in ten thousand.

Points along the axes of z (Q = I, the unscented transform) miss every product of errors of two poses, or of A and B,
which is much of a bilinear equation, and move one pose by ``sqrt(D)`` standard deviations.

Above `MOST` dimensions Q and its points would cost too much. Then `DIRECTIONS` orthonormal directions q are drawn for
each radius, and the known first-order covariance P stands in for the others, with ``l = df/dr`` at 0 along q by
differences:

    mean_square = P + sum_r w_r mean over q of ((f f^T at r q) + (f f^T at -r q)) / 2 - r^2 l l^T
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.geometry.se3 import Array
from ...core.runtime.read_only import ReadOnlyArrays
from ...errors import NotConvergedError, require_integer
from ...fit.likelihood.constraint import covariances_of
from ...model.noise.models import Noise, factor, with_prior
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.timing import warn_left_out
from .experiment import Experiment, experiment
from .rig import moved
from .run import BLOCK, errors_of, estimates

# Dimensions up to which whole orthogonal matrices are used, and directions per radius beyond.
MOST, DIRECTIONS = 1500, 512
# Directions per radius that few dimensions are brought up to, with several matrices.
FEWEST = 512
# Step of the central differences beyond `MOST`, as a part of the radius: iterated methods stop before the last digit.
STEP = 1e-2


@dataclass(frozen=True, eq=False)
class SigmaPoints(ReadOnlyArrays):
    """Bias and covariance of X (rad and m, rotation first) at a noise that need not be small."""

    covariance: Array  # (6, 6) about the mean
    bias: Array  # (6,) mean error
    mean_square: Array  # (6, 6) about the truth: covariance + bias bias^T; what an estimate without correction has
    failures: int  # points without an estimate; they are left out, together with their opposites
    evaluations: int
    dimensions: int  # D

    @property
    def std(self) -> Array:
        """Root mean square error (6,) of each component."""
        return np.asarray(np.sqrt(np.diag(self.mean_square)))


def sigma_points(
    data: PosePairs | Motions,
    *,
    noise: Noise | None = None,
    method: str = "efficient",
    pairs: str | ArrayLike = "all",
    scale: float | None = None,
    rounds: int | None = None,
    seed: int = 0,
) -> SigmaPoints:
    """The covariance of a method's X beyond first order in the noise.

    Parameters
    ----------
    data : PosePairs or Motions
        One data set. Points lie around the truth where poses carry one, else around the poses (motions) as maximum
        likelihood corrects them.
    noise : PoseNoise, PairNoise or None
        None estimates it from the data.
    method, pairs, scale
        As for `calibrate`.
    rounds : int or None
        Matrices Q per radius, each of D directions. None takes one, or as many as make `FEWEST` directions.
    seed : int
        Of the matrices.

    Returns
    -------
    SigmaPoints

    Raises
    ------
    InputError
        Data, noise and method that do not fit each other.
    DegenerateMotionError
        The data do not determine X.
    NotConvergedError
        The method fails at some points; ``partial`` is the `SigmaPoints` of the others.

    Examples
    --------
    >>> import numpy as np, uq_handeye as uq
    >>> from uq_handeye.trials.simulation.sigma_points import sigma_points
    >>> noise = uq.PoseNoise.isotropic(camera=("3deg", "1mm"))
    >>> found = sigma_points(uq.simulate(n_poses=10, noise=noise, seed=1), noise=noise, method="4dpa")
    >>> found.covariance.shape, found.failures
    ((6, 6), 0)
    """
    warn_left_out("sigma_points()", data)
    return sigma_points_of(experiment(data, noise, method, pairs=pairs, scale=scale), rounds=rounds, seed=seed)


def sigma_points_of(problem: Experiment, *, rounds: int | None = None, seed: int = 0) -> SigmaPoints:
    """The same around the known truth of an experiment; parameters, result and errors as for `sigma_points`."""
    if rounds is not None:
        require_integer("rounds", rounds, 1)
    require_integer("seed", seed, 0)
    prior = problem.noise.prior
    D = sum(6 * problem.count for S in covariances_of(problem.noise) if S is not None)
    D += 0 if prior is None else 6 * len(prior.parts())
    rng = np.random.default_rng(seed)
    first_order = problem.predicted() if D > MOST else None
    found = cubature(_function(problem), D, rng, rounds, first_order)
    bias, mean_square = found.mean, found.mean_square
    covariance = mean_square - np.outer(bias, bias)
    result = SigmaPoints(covariance, bias, mean_square, found.failures, found.evaluations, D)
    if found.failures:
        raise NotConvergedError(
            f"At {found.failures} of {found.evaluations} sigma points method {problem.method!r} gives no X: with this "
            "noise its X has no covariance. Take better data, or another method.",
            result,
        )
    return result


class Moments(NamedTuple):
    """Moments of f(z) under standard normal z."""

    mean: Array  # (k,)
    mean_square: Array  # (k, k)
    failures: int
    evaluations: int


Function = Callable[[Array], tuple[Array, NDArray[np.bool_]]]


def radial_rule(D: int) -> tuple[Array, Array]:
    """Two radii of D-dimensional standard normal vectors and their weights: exact for ``E r^p``, p = 0, 2, 4, 6."""
    half = np.sqrt(D / 2 + 1)
    signs = np.array([-1.0, 1.0])
    return np.sqrt(D + 2 + signs * 2 * half), 0.5 * (1 - signs / half)


def cubature(
    function: Function, D: int, rng: np.random.Generator, rounds: int | None = None, first_order: Array | None = None
) -> Moments:
    """Mean and mean square of ``function(z)`` by the rule of the module.

    Parameters
    ----------
    function : callable
        Takes z (m, D), returns values (m, k) and which of them there are (m,).
    D : int
    rng : numpy Generator
    rounds : int or None
        As for `sigma_points`.
    first_order : (k, k) or None
        P: `DIRECTIONS` directions per round are then taken in place of D.

    Raises `NotConvergedError` where a radius has no pair of points with values.
    """
    directions = D if first_order is None else min(D, DIRECTIONS)
    rounds = rounds or max(1, -(-FEWEST // directions))
    means, squares = [], [] if first_order is None else [first_order]
    failures = evaluations = 0
    for radius, weight in zip(*radial_rule(D), strict=True):
        sums: list[Array] = []
        products: list[Array] = []
        used = 0
        for _ in range(rounds):
            # columns of the Q of a Gaussian matrix are uniform on the sphere up to their signs, and both are used
            z = radius * np.linalg.qr(rng.standard_normal((D, directions)))[0].T
            z = np.concatenate([z, -z] if first_order is None else [z, -z, STEP * z, -STEP * z])
            values, ok = function(z)
            failures += int((~ok).sum())
            evaluations += len(ok)
            whole = ok.reshape(-1, directions).all(axis=0)
            plus, minus, *small = values.reshape(-1, directions, values.shape[-1])[:, whole]
            sums.append((plus + minus).sum(axis=0) / 2)
            products.append((plus.T @ plus + minus.T @ minus) / 2)
            if small:
                linear = (small[0] - small[1]) / (2 * STEP)
                products.append(-linear.T @ linear)
            used += len(plus)
        if not used:
            raise NotConvergedError(f"All of {evaluations} sigma points fail: with this noise X has no covariance.")
        means.append(weight * np.sum(sums, axis=0) / used)
        squares.append(weight * np.sum(products, axis=0) / used)
    return Moments(np.sum(means, axis=0), np.sum(squares, axis=0), failures, evaluations)


def _function(problem: Experiment) -> Function:
    """f(z) of the module, on blocks of points so that memory stays bounded."""
    n = problem.count
    factors = [None if S is None else factor(S) for S in covariances_of(problem.noise)]
    block, prior = max(1, BLOCK // problem.size), problem.noise.prior

    def function(z: Array) -> tuple[Array, NDArray[np.bool_]]:
        parts = [part(z[start : start + block]) for start in range(0, len(z), block)]
        return np.concatenate([errors for errors, _ in parts]), np.concatenate([ok for _, ok in parts])

    def part(z: Array) -> tuple[Array, NDArray[np.bool_]]:
        sides, start = [], 0
        for T, L in zip(problem.sides, factors, strict=True):
            if L is None:
                sides.append(np.array(np.broadcast_to(T, (len(z), *T.shape))))
            else:
                sides.append(moved(T, L, z[:, start : start + 6 * n]))
                start += 6 * n
        found = errors_of(problem, estimates(with_means(z[:, start:]), sides[0], sides[1], each=False))
        return found.errors, found.ok

    def with_means(z: Array) -> Experiment:
        if prior is None:
            return problem
        return replace(problem, noise=with_prior(problem.noise, prior.moved(problem.X, problem.W, z)))

    return function
