r"""The robot's noise beside a camera covariance that is known, as from corners (T4b): two variance components.

Model (`constraint`, on poses): the errors of the camera poses have the known covariance Sigma_C, in general joint over
the poses; those of the robot are independent and isotropic, with the variances phi_1 of rotation (rad^2) and phi_2 of
translation (m^2). With ``D_C``, ``D_G = [U_1, U_2]`` the derivatives of the residuals r by both, J that by X and W,

    S(phi) = D_C Sigma_C D_C^T + phi_1 V_1 + phi_2 V_2,      V_k = blkdiag(U_k U_k^T)

and ``P = S^-1 - S^-1 J (J^T S^-1 J)^-1 J^T S^-1``, minus twice the restricted log-likelihood, its derivatives and the
expected information are (Patterson and Thompson 1971; Harville 1977)

    d = log|S| + log|J^T S^-1 J| + r^T P r,     dd/dphi_k = tr(P V_k) - r^T P V_k P r,     I_kl = tr(P V_k P V_l) / 2

V_k is block diagonal, so that ``tr(P V_k)`` needs the diagonal blocks of P alone: O(n) for a `JointCovariance`. The
minimum is found over the logarithms of the deviations; a variance whose best value is 0 is 0 and said so: unlike the
camera's, the robot's poses may be exact. Intervals are profile intervals of d, 95 %.

Whether Sigma_C is true. One more component, a factor kappa on Sigma_C, is not estimated but tested at kappa = 1. As
``P S P = P``, all that its score and information need is known already: with ``q_k = r^T P V_k P r``, ``t_k =
tr(P V_k)`` and ``dof = 6 n - 12``

    q_kappa = r^T P r - sum phi_k q_k,   t_kappa = dof - sum phi_k t_k,   score = (q_kappa - t_kappa) / 2
    I_kappa,k = t_k / 2 - sum_l phi_l I_kl,   I_kappa,kappa = dof / 2 - sum phi_k t_k + sum_kl phi_k phi_l I_kl

and with I* what is left of I_kappa,kappa once the estimated phi are accounted for, ``kappa = 1 + score / I*`` is taken
as chi-square distributed with ``nu = 2 I*`` degrees of freedom (over nu), exactly so where the robot has no noise.

References: H. Patterson, R. Thompson, Biometrika 58 (1971), doi:10.1093/biomet/58.3.545; D. Harville, J. Am. Stat.
Assoc. 72 (1977), doi:10.1080/01621459.1977.10480998.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc, gammaincc, ndtr

from ..errors import InputError, NotConvergedError
from ..geometry.se3 import Array
from ..likelihood.constraint import (
    Constraint,
    Linearised,
    OnPoses,
    Unknowns,
    block_diagonal,
    constraint_of,
    residual_covariance,
)
from ..likelihood.gauss_helmert import inverse_information, start_of
from ..noise.estimate import CameraFactor, Component, NoiseEstimate, NoisePrior
from ..noise.joint_covariance import JointCovariance
from ..noise.models import PoseNoise, marginals, rows_of
from ..noise.square_roots import Covariance, cholesky_of, gram, inverse_blocks, log_determinant, pulled, whiten
from ..poses.pose_pairs import PosePairs
from .findings import beside_camera_findings
from .restricted_likelihood import QUANTILE

# Variances below this share of the camera's, as X sees it, are 0: the likelihood cannot tell them from it.
NOTHING = 1e-3
# The first search starts from the best of so many deviations of each, over this range times that of the camera.
TRIED, RANGE = 4, (0.1, 1e3)
# The end of a profile interval is not looked for beyond this multiple of the camera's deviation.
FARTHEST = 1e5
# Linearised again until X and W move by less, in standard deviations; and how often at most.
STILL, MOST_ROUNDS = 1e-2, 8
# Relative step of the differences that give the information.
STEP = 1e-4
_KINDS = (("robot rotation", "rad"), ("robot translation", "m"))


class _At(NamedTuple):
    """At given variances (2,)."""

    deviance: float
    quadratic: Array  # (2,) q_k
    trace: Array  # (2,) t_k
    squares: float  # r^T P r
    step: Array  # (12,) generalised least squares, of X and W
    moved: float  # its length in standard deviations, squared


@dataclass(frozen=True, eq=False)
class _Rows:
    """The linearised constraint and what of its covariance does not depend on the robot."""

    y: Array  # (n, 6, 13): J and r
    U: tuple[Array, Array]  # (n, 6, 3)
    camera: Covariance

    @classmethod
    def of(cls, linear: Linearised, camera: Any) -> _Rows:
        first = linear.sides[0]
        y = np.concatenate([linear.J, linear.r[..., None]], axis=-1)
        known = residual_covariance(linear.sides, PoseNoise(camera=camera))
        return cls(y, (first[..., :3], first[..., 3:]), known)

    def at(self, variances: Array) -> _At:
        blocks = sum(v * U @ U.mT for v, U in zip(variances, self.U, strict=True))
        S = self.camera
        if isinstance(S, JointCovariance):
            S = S.plus(np.asarray(blocks))
        else:
            S = S + (blocks if S.shape[-1] == 6 and S.ndim == 3 else block_diagonal(np.asarray(blocks)))
        factor = cholesky_of(S)
        white = whiten(factor, self.y)
        sums = gram(white)
        information = sums[:-1, :-1]
        C = inverse_information(information)
        step = -C @ sums[:-1, -1]
        white[..., -1] += white[..., :-1] @ step
        back = pulled(factor, white)
        Q, g = back[..., :-1], back[..., -1]
        P = inverse_blocks(factor) - Q @ C @ Q.mT
        quadratic = np.array([np.sum((U.mT @ g[..., None]) ** 2) for U in self.U])
        trace = np.array([np.sum((P @ U) * U) for U in self.U])
        squares = float(np.sum(white[..., -1] ** 2))
        deviance = float(log_determinant(factor)) + float(np.linalg.slogdet(information)[1]) + squares
        return _At(deviance, quadratic, trace, squares, step, float(step @ information @ step))

    def information(self, variances: Array, at: _At) -> Array:
        """I (2, 2): ``d t_k / d phi_l = -2 I_kl``, by differences."""
        found = np.empty((2, 2))
        for k in range(2):
            h = STEP * (variances[k] + 3 * len(self.y) / at.trace[k])
            ends = variances + h * np.eye(2)[k], variances - min(h, variances[k]) * np.eye(2)[k]
            found[k] = -0.5 * (self.at(ends[0]).trace - self.at(ends[1]).trace) / (ends[0] - ends[1])[k]
        return 0.5 * (found + found.T)


@dataclass(frozen=True, eq=False)
class _Search:
    """Deviations as logarithms x (2,), which of them are free, and what is known of them beforehand."""

    rows: _Rows
    free: NDArray[np.bool_]
    given: Array  # (2,) variances where not free
    prior: tuple[Array, Array]  # mean and deviation (2,) of x, infinite where there is none
    scale: Array  # (2,) x at which the robot's noise would be as large as the camera's
    unit: Array  # (2,) by which x is known about, so that steps of the search have the right length

    def measured(self, x: Array) -> _Search:
        """With the unit at x."""
        v = self.variances(x, np.zeros(2, dtype=bool))
        own = np.diag(self.rows.information(v, self.rows.at(v)))
        return replace(self, unit=np.clip(0.5 / (np.maximum(v, 1e-300) * np.sqrt(np.maximum(own, 1e-300))), 0.01, 1.0))

    def variances(self, x: Array, zero: NDArray[np.bool_]) -> Array:
        """(2,) with 0 where that is the answer."""
        return np.where(self.free, np.where(zero, 0.0, np.exp(2 * x)), self.given)

    def objective(self, x: Array, zero: NDArray[np.bool_]) -> tuple[float, Array]:
        """d with the prior, and its derivative (2,) by x."""
        v = self.variances(x, zero)
        at = self.rows.at(v)
        off = (x - self.prior[0]) / self.prior[1]
        return at.deviance + float(off @ off), 2 * v * (at.trace - at.quadratic) + 2 * off / self.prior[1]

    def minimum(self, x: Array, moving: NDArray[np.bool_], zero: NDArray[np.bool_]) -> tuple[float, Array]:
        """The least d over the x that move, and where it is."""
        from scipy.optimize import minimize  # slow to import

        if not moving.any():
            return self.objective(x, zero)[0], x

        def of(part: Array) -> tuple[float, Array]:
            whole = x.copy()
            whole[moving] = part * unit
            value, slope = self.objective(whole, zero)
            return value, slope[moving] * unit

        unit = self.unit[moving]
        low = (self.scale[moving] + np.log(1e-2 * np.sqrt(NOTHING))) / unit
        high = (self.scale[moving] + np.log(FARTHEST)) / unit
        start = np.clip(x[moving] / unit, low, high)
        options: Any = {"ftol": 1e-9, "gtol": 1e-2}
        found = minimize(
            of, start, jac=True, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)), options=options
        )
        best = x.copy()
        best[moving] = found.x * unit
        return float(found.fun), best


def estimate_robot_noise(
    data: PosePairs,
    camera: Any,
    prior: NoisePrior | None = None,
    *,
    start: Array | None = None,
) -> NoiseEstimate:
    """Rotation and translation noise of the robot poses, beside the covariance of the camera poses.

    Parameters
    ----------
    data : PosePairs
        n poses, no leading axes.
    camera : JointCovariance or array (6, 6), (n, 6, 6), (6n, 6n)
        Covariance of the camera poses, taken as true; positive definite.
    prior : NoisePrior or None
        What a data sheet says of the robot.
    start : (4, 4) or None
        A consistent estimate of X; None takes 4DPA.

    Returns
    -------
    NoiseEstimate
        ``noise`` holds the robot's covariance (None where it is exact) and ``camera`` as given; ``variances`` and
        ``covariance`` are of the robot's rotation and translation; ``camera_factor`` says whether the residuals
        contradict ``camera``.

    Raises
    ------
    InputError
        Data that are no poses, too few of them, a covariance that does not fit; a prior for the camera.
    SingularNoiseError
        A camera covariance that leaves a part of the residuals exact.
    DegenerateMotionError
        The data do not determine X and W.
    NotConvergedError
        The components do not stand still.
    """
    camera = PoseNoise(camera=camera).camera
    constraint = constraint_of(data, PoseNoise(camera=camera))
    if not isinstance(constraint, OnPoses) or constraint.first.ndim != 3:
        raise InputError("Expected `data` to be one set of PosePairs, got motions or several sets.")
    source = BesideCamera(constraint, camera, NoisePrior() if prior is None else prior)
    return source.find(start_of(data, constraint, start)).describe()


@dataclass(frozen=True, eq=False)
class BesideCamera:
    """The robot's variances beside the covariance of the camera poses of one data set; see the module."""

    constraint: Constraint
    camera: Any
    prior: NoisePrior

    def find(self, at: Unknowns, weights: Array | None = None) -> FoundRobotNoise:
        """The variances near the unknowns; ``weights`` (n,) of 0 leave poses out. Raises as `estimate_robot_noise`."""
        if not np.isnan(self.prior.values[2:]).all():
            raise InputError(
                "Expected a `prior` for the robot alone: the noise of the camera poses is known from their corners."
            )
        constraint, camera = self.constraint, self.camera
        if weights is not None and not (weights == 1).all():
            kept = np.flatnonzero(weights)
            if (weights[kept] < 1).any():
                raise InputError(
                    "Expected `weights` of 0 or 1 beside the joint covariance of camera poses, got others."
                )
            constraint, camera = constraint.rows(kept), rows_of(camera, kept)
        n = constraint.n
        if 6 * n - 12 <= 0:
            raise InputError(f"Expected residuals to estimate the robot's noise from, got {n} poses. Give more poses.")
        for done in range(MOST_ROUNDS):
            rows = _Rows.of(constraint.linearise(at, constraint.first, constraint.second), camera)
            search = _search(rows, self.prior)
            if done == 0:
                x = _first(search)
            search = search.measured(x)
            best, x, zero = _best(search, x)
            found = search.rows.at(search.variances(x, zero))
            if found.moved < STILL**2 and done > 0:
                return FoundRobotNoise(search, best, x, zero, found, self.camera, camera)
            at = at.moved(found.step)
        raise NotConvergedError(
            "The noise of the robot did not stand still: the residuals are too large for a linear model. Look at the "
            "setup, at the pairing of the poses and for outliers; or give the noise of the robot.",
            found,
        )


@dataclass(frozen=True, eq=False)
class FoundRobotNoise:
    """Variances of one problem; `describe` adds intervals and words."""

    search: _Search
    deviance: float
    x: Array
    zero: NDArray[np.bool_]
    at: _At
    camera: Any  # of all poses
    camera_used: Any  # of those that counted

    @property
    def noise(self) -> PoseNoise:
        """That of the robot beside the camera's."""
        v = self.search.variances(self.x, self.zero)
        return PoseNoise(np.diag(np.repeat(v, 3)) if v.any() else None, self.camera)

    def describe(self) -> NoiseEstimate:
        """Components with intervals and what can be said of them."""
        return _report(self)


def _search(rows: _Rows, prior: NoisePrior) -> _Search:
    values = prior.values[:2]
    known, fixed = ~np.isnan(values), prior.factor == 1
    some = np.where(known & (values > 0), values, 1.0)
    mean = np.where(known, np.log(some), 0.0)
    deviation = np.where(known & (not fixed), np.log(prior.factor) if not fixed else 1.0, np.inf)
    scale = 0.5 * np.log(3 * len(rows.y) / rows.at(np.zeros(2)).trace)
    free = ~known if fixed else np.ones(2, dtype=bool)
    return _Search(rows, free, np.where(known, values, 0.0) ** 2, (mean, deviation), scale, np.ones(2))


def _first(search: _Search) -> Array:
    """The best of a few deviations of each."""
    steps = np.log(np.geomspace(*RANGE, TRIED))
    none = np.zeros(2, dtype=bool)
    tried = [
        search.scale + np.array([a, b])
        for a in (steps if search.free[0] else steps[:1])
        for b in (steps if search.free[1] else steps[:1])
    ]
    return min(tried, key=lambda x: search.objective(x, none)[0])


def _best(search: _Search, x: Array) -> tuple[float, Array, NDArray[np.bool_]]:
    """Least d, x there, and which variances are 0."""
    zero = np.zeros(2, dtype=bool)
    may = search.free & np.isinf(search.prior[1])
    for _ in range(3):
        best, x = search.minimum(x, search.free & ~zero, zero)
        more = may & ~zero & (np.exp(2 * (x - search.scale)) < NOTHING)
        if not more.any():
            break
        zero = zero | more
    return best, x, zero


def _interval(search: _Search, best: float, x: Array, zero: NDArray[np.bool_], k: int) -> tuple[float, float | None]:
    """95 % profile interval of deviation k; None: no upper end."""
    from scipy.optimize import brentq

    other = search.free & (np.arange(2) != k)
    begin = np.where(zero, search.scale + np.log(0.1), x)

    def grown(value: float, at_zero: bool = False) -> float:
        """Growth of d beyond its limit with deviation k held; always from the same start, so that it is a function."""
        at, own = begin.copy(), (np.arange(2) == k) & at_zero
        at[k] = value
        least, _ = search.minimum(at, other, own)
        if zero[other].any():  # the best of the other one may be 0 again
            least = min(least, search.objective(at, own | other)[0])
        return least - best - QUANTILE

    def end(inside: float, step: float) -> float | None:
        if grown(inside) >= 0:  # no more than a flat likelihood leaves undecided
            return float(np.exp(inside))
        outside = inside + step
        while grown(outside) < 0:
            inside, outside = outside, outside + 2 * step
            if not abs(outside - search.scale[k]) < np.log(FARTHEST):
                return None
        return float(np.exp(brentq(grown, inside, outside, xtol=5e-3)))

    middle = search.scale[k] + 0.5 * np.log(NOTHING) if zero[k] else x[k]
    low: float | None = 0.0
    if not zero[k] and (np.isfinite(search.prior[1][k]) or grown(middle, at_zero=True) > 0):
        low = end(middle, -2.5 * search.unit[k])
    return low or 0.0, end(middle, 1.0 if zero[k] else 2.5 * search.unit[k])


def _camera_factor(
    found: _At, v: Array, information: Array, by_prior: Array, free: NDArray[np.bool_], n: int
) -> CameraFactor | None:
    """kappa of the module; None where the robot's noise hides the camera's."""
    dof = 6.0 * n - 12
    score = 0.5 * (found.squares - v @ found.quadratic - dof + v @ found.trace)
    own = 0.5 * dof - v @ found.trace + v @ information @ v
    mixed = (0.5 * found.trace - information @ v)[free]
    beside = (information + np.diag(by_prior))[np.ix_(free, free)]
    left = own - float(mixed @ np.linalg.solve(beside, mixed)) if free.any() else own
    nu = 2.0 * float(left)
    if nu < 1.0:
        return None
    value = max(1.0 + float(score) / float(left), 0.0)
    tails = float(gammainc(nu / 2, nu * value / 2)), float(gammaincc(nu / 2, nu * value / 2))
    return CameraFactor(value, nu, min(1.0, 2.0 * min(tails)))


def _above_zero(v: Array, covariance: Array) -> Array:
    """(2, 2) factors on the covariance of estimates near 0, which cannot be below it.

    Of ``max(Z, 0)`` with Z normal about v: between 1 far from 0 and 0.34 at 0.
    """
    sd = np.sqrt(np.diag(covariance))
    a = np.where(sd > 0, v / np.where(sd > 0, sd, 1.0), np.inf)
    a = np.minimum(a, 10.0)
    below, density = ndtr(a), np.exp(-0.5 * a * a) / np.sqrt(2 * np.pi)
    mean, square = a * below + density, (a * a + 1) * below + a * density
    root = np.sqrt(square - mean * mean)
    return np.outer(root, root)


def _report(of: FoundRobotNoise) -> NoiseEstimate:
    search, best, x, zero, found = of.search, of.deviance, of.x, of.zero, of.at
    n = len(search.rows.y)
    v = search.variances(x, zero)
    information = search.rows.information(v, found)
    known = np.isfinite(search.prior[1])
    by_prior = np.where(known, 0.25 / (np.where(v > 0, v, 1.0) * search.prior[1]) ** 2, 0.0)
    factor = _camera_factor(found, v, information, by_prior, search.free & ~zero, n)
    covariance = np.zeros((2, 2))
    free = np.ix_(search.free, search.free)
    covariance[free] = np.linalg.inv((information + np.diag(by_prior))[free])
    covariance *= _above_zero(v, covariance)
    components = []
    for k, (name, unit) in enumerate(_KINDS):
        value = float(np.sqrt(v[k]))
        if not search.free[k]:
            components.append(Component(name, unit, value, value, value, "fixed"))
            continue
        low, high = _interval(search, best, x, zero, k)
        status = "prior" if known[k] else "zero" if zero[k] else "estimated"
        components.append(Component(name, unit, value, low, high, status))
    variances = np.diagonal(marginals(of.camera_used), axis1=-2, axis2=-1).reshape(-1, 2, 3).mean(axis=(0, 2))
    for what, unit, variance in zip(("rotation", "translation"), ("rad", "m"), variances, strict=True):
        sd = float(np.sqrt(variance))
        components.append(Component(f"camera {what}", unit, sd, sd, sd, "from corners"))
    findings = beside_camera_findings({part.name: part for part in components}, factor)
    return NoiseEstimate(of.noise, tuple(components), findings, v, covariance, 6.0 * n - 12, factor)
