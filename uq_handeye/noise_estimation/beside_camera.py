r"""The robot's noise beside the covariance of the camera poses, known or but for the pixel noise: variance components.

The errors of the camera poses have the covariance Sigma_C, known but for the variance phi_3 of the pixels at most; the
robot's two variances phi_1 (rad^2) and phi_2 (m^2) are found beside it, as the minimum of minus twice the restricted
log-likelihood d of `components_beside_camera`, whose symbols stand here.

The minimum is found over the logarithms of the standard deviations; a variance whose best value is 0 is 0 and said so:
unlike the camera's, the robot's poses may be exact. Intervals are profile intervals of d, 95 %.

Pixel noise. log of its standard deviation is Gaussian about that of PIXEL pixels, with ``log(PIXEL_FACTOR)`` as its
standard deviation: what detectors do, from 0.02 to 2 pixels, at 95 %. Residuals of a few poses need it: where they are
the robot's as well as the camera's, d alone may have its minimum at a camera without noise.

A robot that is known. Where both its standard deviations are fixed, poses that disagree by more than they may are the
camera's doing: the corners of one picture share errors (of light, of blur, of a rendering) that residuals within the
picture do not show. Then ``S = K + phi_4 D_C E D_C^T``, phi_4 >= 0 the one unknown (pixels^2) and E what errors of one
pixel, as large in all pictures, do to the poses (`CameraCalibration.per_pixel`).

Whether a known Sigma_C is true. One more component, a factor kappa on Sigma_C, is not estimated but tested at kappa =
1. As ``P S P = P``, all that its score and information need is known already: with ``q_k = r^T P V_k P r``, ``t_k =
tr(P V_k)`` and ``dof = 6 n - 12``

    q_kappa = r^T P r - sum phi_k q_k,   t_kappa = dof - sum phi_k t_k,   score = (q_kappa - t_kappa) / 2
    I_kappa,k = t_k / 2 - sum_l phi_l I_kl,   I_kappa,kappa = dof / 2 - sum phi_k t_k + sum_kl phi_k phi_l I_kl

and with I* what is left of I_kappa,kappa once the estimated phi are accounted for, ``kappa = 1 + score / I*`` is taken
as chi-square distributed with ``nu = 2 I*`` degrees of freedom (over nu), exactly so where the robot has no noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc, gammaincc, ndtr

from ..errors import InputError, NotConvergedError
from ..geometry.se3 import Array
from ..likelihood.constraint import Constraint, OnPoses, Unknowns, constraint_of
from ..likelihood.reduced_rows import reduce_rows
from ..likelihood.starts import start_of
from ..noise.camera_noise import CameraNoise
from ..noise.estimate import CAMERA_EXCESS, CameraFactor, Component, NoiseEstimate, NoisePrior
from ..noise.joint_covariance import JointCovariance
from ..noise.models import PoseNoise, marginals, rows_of
from ..noise.pose_prior import PosePrior
from ..poses.pose_pairs import PosePairs
from ..shared_errors.shared_error import with_shared
from .components_beside_camera import EXCESS_KIND, PIXEL_KIND, ROBOT_KINDS, AtVariances, ComponentRows
from .findings import beside_camera_findings
from .restricted_likelihood import QUANTILE

# Variances below this share of the camera's, as X sees it, are 0: the likelihood cannot tell them from it.
NOTHING = 1e-3
# The first search starts from the best of so many deviations of each, over this range times that of the camera.
TRIED, RANGE = 4, (0.1, 1e3)
PIXELS_TRIED = (0.2, 1.0, 5.0)  # times PIXEL
# The end of a profile interval is not looked for beyond this multiple of the camera's deviation.
FARTHEST = 1e5
# Linearised again until X and W move by less, in standard deviations; and how often at most.
STILL, MOST_ROUNDS = 1e-2, 8
# What is known of the pixel noise beforehand: its standard deviation (pixels) within this factor.
PIXEL, PIXEL_FACTOR = 0.2, 3.0
PIXEL_ENDS = (0.005, 20.0)  # pixels between which it is looked for
# The data tell the pixel noise if they leave less than this share of that deviation.
TOLD = 0.5
FROM_CORNERS, FROM_POINTS, BY_VIEWS = "from corners", "from points", "by geometry"


@dataclass(frozen=True, eq=False)
class _Search:
    """Standard deviations as logarithms x (m,), which of them are free, and what is known of them beforehand."""

    rows: ComponentRows
    free: NDArray[np.bool_]
    given: Array  # (m,) variances where not free
    prior: tuple[Array, Array]  # mean and deviation (m,) of x, infinite where there is none
    scale: Array  # (m,) x at which noise would be as large as the camera's, of pixels that known
    ends: tuple[Array, Array]  # (m,) between which x is looked for
    unit: Array  # (m,) by which x is known about, so that steps of the search have the right length

    def measured(self, x: Array) -> _Search:
        """Measure with the unit at x."""
        v = self.variances(x, np.zeros(len(x), dtype=bool))
        own = np.diag(self.rows.information(v, self.rows.at(v)))
        return replace(self, unit=np.clip(0.5 / (np.maximum(v, 1e-300) * np.sqrt(np.maximum(own, 1e-300))), 0.01, 1.0))

    def variances(self, x: Array, zero: NDArray[np.bool_]) -> Array:
        """(m,) with 0 where that is the answer."""
        return np.where(self.free, np.where(zero, 0.0, np.exp(2 * x)), self.given)

    def objective(self, x: Array, zero: NDArray[np.bool_]) -> tuple[float, Array]:
        """d with the prior, and its derivative (m,) by x."""
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
        low, high = (end[moving] / unit for end in self.ends)
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
    camera : JointCovariance, array (6, 6), (n, 6, 6), (6n, 6n), or CameraNoise
        Covariance of the camera poses, taken as true; positive definite. Of a `CameraNoise` without ``pixel_sd`` the
        pixel noise is estimated as well.
    prior : NoisePrior or None
        What a data sheet says of the robot.
    start : (4, 4) or None
        A consistent estimate of X; None takes 4DPA.

    Returns
    -------
    NoiseEstimate
        ``noise`` holds the robot's covariance (None where it is exact) and that of the camera; ``variances`` and
        ``covariance`` are of the robot's rotation and translation, and of the pixels (pixels^2) where they are
        estimated; ``camera_factor`` says whether the residuals contradict a known ``camera``.

    Raises
    ------
    InputError
        Data that are no poses, too few of them, a covariance that does not fit; a prior for the camera.
    SingularNoiseError
        A camera covariance that leaves a part of the residuals exact.
    DegenerateMotionError
        The data do not determine X and W.
    NotConvergedError
        The components do not converge.
    """
    camera = PoseNoise(camera=camera).camera
    constraint = constraint_of(data, PoseNoise(camera=camera))
    if not isinstance(constraint, OnPoses) or constraint.first.ndim != 3:
        raise InputError("Expected `data` to be one set of PosePairs, got motions or several sets.")
    source = BesideCamera(constraint, camera, NoisePrior() if prior is None else prior)
    return source.find(start_of(data, constraint, start)).describe()


@dataclass(frozen=True, eq=False)
class BesideCamera:
    """The variances of one data set that the covariance of its camera poses leaves open; see the module."""

    constraint: Constraint
    camera: Any  # covariance, or CameraNoise
    prior: NoisePrior
    robot: Any = None  # covariance, where it is known
    columns: Mapping[str, JointCovariance] = field(default_factory=dict)  # errors that all poses of a side share
    pose_prior: PosePrior | None = None
    how: str = FROM_CORNERS  # where a known covariance comes from
    excess: JointCovariance | None = None  # of the camera beside what corners say, per pixel^2, if the robot is known

    @property
    def _robot_known(self) -> bool:
        return self.robot is not None or (self.prior.factor == 1 and not np.isnan(self.prior.values[:2]).any())

    def find(self, at: Unknowns, weights: Array | None = None) -> FoundRobotNoise:
        """The variances near the unknowns; ``weights`` (n,) of 0 leave poses out. Raises as `estimate_robot_noise`."""
        if not np.isnan(self.prior.values[2:]).all():
            how = self.how.replace("from", "from their")
            how = "but for that of their pixels" if isinstance(self.camera, CameraNoise) else how
            raise InputError(f"Expected a `prior` for the robot only: the noise of the camera poses is known {how}.")
        constraint, camera, robot, columns = self.constraint, self.camera, self.robot, self.columns
        excess = self.excess if self._robot_known else None
        if isinstance(camera, CameraNoise) and camera.pixel_sd is not None:
            camera = camera.covariance()
        if weights is not None and not (weights == 1).all():
            kept = np.flatnonzero(weights)
            if (weights[kept] < 1).any():
                raise InputError(
                    "Expected `weights` of 0 or 1 beside the joint covariance of camera poses, got others."
                )
            constraint = constraint.rows(kept)
            camera = camera.rows(kept) if isinstance(camera, CameraNoise) else rows_of(camera, kept)
            robot = rows_of(robot, kept)
            excess = None if excess is None else excess.rows(kept)
            columns = {side: of_side.rows(kept) for side, of_side in columns.items()}
        n = constraint.n
        if 6 * n - 12 <= 0:
            raise InputError(f"Expected residuals to estimate the noise from, got {n} poses. Give more poses.")
        for done in range(MOST_ROUNDS):
            linear = constraint.linearise(at, constraint.first, constraint.second)
            reduced = reduce_rows(constraint, linear, at, None, self.pose_prior)
            rows = ComponentRows.of(linear, camera, robot, columns, reduced, excess)
            search = _search(rows, self.prior)
            if done == 0:
                x = _first(search)
            search = search.measured(x)
            best, x, zero = _best(search, x)
            found = search.rows.at(search.variances(x, zero))
            if found.moved < STILL**2 and done > 0:
                return FoundRobotNoise(self, search, best, x, zero, found)
            at = at.moved(reduced.unreduced(found.step))
        raise NotConvergedError(
            "Noise estimation did not converge: the residuals are too large for a linear model. Look at the "
            "setup, at the pairing of the poses and for outliers; or give the noise of the robot.",
            found,
        )


@dataclass(frozen=True, eq=False)
class FoundRobotNoise:
    """Variances of one problem; `describe` adds intervals and words."""

    source: BesideCamera
    search: _Search
    deviance: float
    x: Array
    zero: NDArray[np.bool_]
    at: AtVariances

    @cached_property
    def variances(self) -> dict[str, float]:
        """Variances by the names of the components."""
        v = self.search.variances(self.x, self.zero)
        return {part.kind[0]: float(value) for part, value in zip(self.search.rows.parts, v, strict=True)}

    @cached_property
    def noise(self) -> PoseNoise:
        """Noise of all poses."""
        robot = self.source.robot
        if robot is None:
            v = np.array([self.variances[name] for name, _ in ROBOT_KINDS])
            robot = np.diag(np.repeat(v, 3)) if v.any() else None
        return with_shared(PoseNoise(robot, self.camera), self.source.columns)

    @cached_property
    def camera(self) -> Any:
        """The covariance of all camera poses, without errors that are declared beside it."""
        camera = self.source.camera
        if not isinstance(camera, CameraNoise):
            excess, size = self.source.excess, self.variances.get(CAMERA_EXCESS, 0.0)
            return camera if excess is None or size == 0 else camera.plus(excess * size)
        pixels = self.variances.get(PIXEL_KIND[0])
        return camera.covariance(None if pixels is None else float(np.sqrt(pixels)))

    def describe(self) -> NoiseEstimate:
        """Components with intervals and what can be said of them."""
        return _report(self)


def _search(rows: ComponentRows, prior: NoisePrior) -> _Search:
    kinds = [part.kind for part in rows.parts]
    pixels = PIXEL_KIND in kinds
    given = dict(zip(ROBOT_KINDS, [(value, prior.factor) for value in prior.values[:2]], strict=True))
    given |= {PIXEL_KIND: (PIXEL, PIXEL_FACTOR), EXCESS_KIND: (np.nan, prior.factor)}
    values, factor = np.array([given[kind] for kind in kinds]).reshape(-1, 2).T
    known, fixed = ~np.isnan(values), factor == 1
    some = np.where(known & (values > 0), values, 1.0)
    mean = np.where(known, np.log(some), 0.0)
    deviation = np.where(known & ~fixed, np.log(np.where(fixed, 2.0, factor)), np.inf)
    usual = np.zeros(len(values))
    if pixels:
        usual[-1] = PIXEL**2
    scale = 0.5 * np.log(3 * len(rows.y) / rows.at(usual).trace)
    low, high = scale + np.log(1e-2 * np.sqrt(NOTHING)), scale + np.log(FARTHEST)
    if pixels:
        scale[-1], low[-1], high[-1] = np.log([PIXEL, *PIXEL_ENDS])
    held = np.where(known, values, 0.0) ** 2
    return _Search(rows, ~(known & fixed), held, (mean, deviation), scale, (low, high), np.ones_like(scale))


def _first(search: _Search) -> Array:
    """The best of a few standard deviations of each."""
    steps = np.log(np.geomspace(*RANGE, TRIED))
    none = np.zeros(len(search.scale), dtype=bool)
    starts = [
        np.log(PIXELS_TRIED) if part.kind == PIXEL_KIND else steps if free else steps[:1]
        for part, free in zip(search.rows.parts, search.free, strict=True)
    ]
    return min((search.scale + np.array(step) for step in product(*starts)), key=lambda x: search.objective(x, none)[0])


def _best(search: _Search, x: Array) -> tuple[float, Array, NDArray[np.bool_]]:
    """Least d, x there, and which variances are 0."""
    zero = np.zeros(len(x), dtype=bool)
    may = search.free & np.isinf(search.prior[1])
    for _ in range(3):
        best, x = search.minimum(x, search.free & ~zero, zero)
        more = may & ~zero & (np.exp(2 * (x - search.scale)) < NOTHING)
        if not more.any():
            break
        zero = zero | more
    return best, x, zero


def _interval(search: _Search, best: float, x: Array, zero: NDArray[np.bool_], k: int) -> tuple[float, float | None]:
    """95 % profile interval of standard deviation k; None: no upper end."""
    from scipy.optimize import brentq

    other = search.free & (np.arange(len(x)) != k)
    begin = np.where(zero, search.scale + np.log(0.1), x)

    def grown(value: float, at_zero: bool = False) -> float:
        """Growth of d beyond its limit with standard deviation k held; always from the same start, so that it is a
        function.
        """
        at, own = begin.copy(), (np.arange(len(x)) == k) & at_zero
        at[k] = value
        least, _ = search.minimum(at, other, own)
        if zero[other].any():  # the best of those that were 0 may be it again
            least = min(least, search.minimum(at, other & ~zero, own | (other & zero))[0])
        return least - best - QUANTILE

    def end(inside: float, step: float) -> float | None:
        if grown(inside) >= 0:  # no more than a flat likelihood leaves undecided
            return float(np.exp(inside))
        outside = inside + step
        while grown(outside) < 0:
            inside, outside = outside, outside + 2 * step
            if not search.ends[0][k] < outside < search.ends[1][k]:
                return None
        return float(np.exp(brentq(grown, inside, outside, xtol=5e-3)))

    middle = search.scale[k] + 0.5 * np.log(NOTHING) if zero[k] else x[k]
    low: float | None = 0.0
    if not zero[k] and (np.isfinite(search.prior[1][k]) or grown(middle, at_zero=True) > 0):
        low = end(middle, -2.5 * search.unit[k])
    return low or 0.0, end(middle, 1.0 if zero[k] else 2.5 * search.unit[k])


def _camera_factor(
    found: AtVariances, v: Array, information: Array, by_prior: Array, free: NDArray[np.bool_], n: int
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
    rows, camera = search.rows, of.source.camera
    n = len(rows.y)
    v = search.variances(x, zero)
    information = rows.information(v, found)
    known = np.isfinite(search.prior[1])
    by_prior = np.where(known, 0.25 / (np.where(v > 0, v, 1.0) * search.prior[1]) ** 2, 0.0)
    pixels = rows.parts[-1].kind == PIXEL_KIND
    factor = None
    if rows.parts[-1].kind == EXCESS_KIND:  # the covariance is tested as it was given
        given = replace(rows, parts=rows.parts[:-1])
        at, held = given.at(v[:-1]), np.zeros(len(v) - 1, dtype=bool)
        factor = _camera_factor(at, v[:-1], given.information(v[:-1], at), by_prior[:-1], held, n)
    elif not pixels:
        factor = _camera_factor(found, v, information, by_prior, search.free & ~zero, n)
    covariance = np.zeros_like(information)
    free = np.ix_(search.free, search.free)
    covariance[free] = np.linalg.inv((information + np.diag(by_prior))[free])
    spread = np.diag(covariance)
    covariance = covariance * _above_zero(v, covariance)
    components = []
    for k, part in enumerate(rows.parts):
        value = float(np.sqrt(v[k]))
        if not search.free[k]:
            components.append(Component(*part.kind, value, value, value, "fixed"))
            continue
        low, high = _interval(search, best, x, zero, k)
        status = "prior" if known[k] else "zero" if zero[k] else "estimated"
        if part.kind == PIXEL_KIND:
            status = "estimated" if np.sqrt(spread[k]) / (2 * v[k]) < TOLD * search.prior[1][k] else "not told apart"
        components.append(Component(*part.kind, value, low, high, status))
    if isinstance(camera, CameraNoise) and camera.pixel_sd is not None:
        s = camera.pixel_sd
        components.append(Component(*PIXEL_KIND, s, s, s, "given"))
    how = BY_VIEWS if isinstance(camera, CameraNoise) else of.source.how
    variances = np.diagonal(marginals(of.camera), axis1=-2, axis2=-1).reshape(-1, 2, 3).mean(axis=(0, 2))
    for what, unit, variance in zip(("rotation", "translation"), ("rad", "m"), variances, strict=True):
        sd = float(np.sqrt(variance))
        components.append(Component(f"camera {what}", unit, sd, sd, sd, how))
    findings = beside_camera_findings({part.name: part for part in components}, factor)
    of_X = rows.spread_of_X(v, covariance)
    return NoiseEstimate(of.noise, tuple(components), findings, v, covariance, 6.0 * n - 12, factor, of_X)
