r"""The convention in which the covariances of the camera poses fit the data, where they were read in another.

A covariance in another convention has other axes, another order or another lever: its ellipsoids lie across the
residuals that they should explain, and good poses look like outliers. The same numbers are read in every convention
(`core.geometry.conventions`), of the poses and of their inverses, and the readings are compared by the log likelihood
of the residuals, each at its own X and W. With S_i the covariance of the residual r_i (6) of ``G X C = W``,

    l = sum_i log( N(r_i; 0, S_i) + q ),     d_i^2 = r_i^T S_i^-1 r_i

where the constant q, the density of outliers, bounds what single poses say. Noise of the robot that is not known has
two sizes, of rotation and of translation, at which each reading is judged best.

If the given reading is right, the gain of another one is about normal with the mean -K and the variance 2 K, where K is
the Kullback-Leibler divergence of the two: it exceeds ``-K + z sqrt(2 K)`` by chance with the probability of z only.
If that other reading is right, the mean of its gain is the reverse divergence.
A reading is named where its gain is larger than by chance and no small share of that mean, where most poses fit with
it, and where it is about as likely as the given one with its numbers multiplied by a size of their own: numbers that
are merely too small or too large fit no convention better.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from ...core.geometry.conventions import CONVENTIONS, CovarianceReading, same_class
from ...core.geometry.se3 import Array
from ...findings import Finding
from ...model.poses.pose_pairs import PosePairs
from ..graph.constraint import Linearised, Unknowns, constraint_of

CODE = "input_checks.covariance_convention"

# Of more poses these, evenly spaced, decide.
MAX_POSES = 60
# A reading is named where its log likelihood is larger than that of the given one by this,
MIN_GAIN = 1.0
# and by what noise reaches with this quantile of a normal distribution, 1 in 700, where the given one is right.
QUANTILE_OF_CHANCE = 3.0
# The gain is at least this share of what it is on average if the reading is right.
MIN_SHARE_OF_GAIN = 0.1
# It may be less likely by this than the given reading whose numbers have a size of their own.
MAX_LOSS_AGAINST_SIZED = 1.5
# Readings whose log likelihoods are within this of the best are named beside it: the data do not tell them apart.
MAX_TIE = 3.0
# A reading fits if the median of d^2 is below this, where 5.3 is expected.
MAX_MEDIAN_SQUARE = 12.0
# d^2 of a pose from which on it is more probably an outlier.
OUTLIER_SQUARE = 40.0
# Conventions of T Exp(xi) are those of Exp(xi) T of the inverse pose: only one of them is tried.
TWISTS = ("child", "t + R tau", "theta"), ("parent", "left twist", "theta")
# Numbers are the same, and blocks isotropic, if they differ by less than this share of the variances.
SAME_SHARE = 1e-3


@cache
def readings() -> tuple[CovarianceReading, ...]:
    """Return one reading of each class of conventions, of poses and of inverse poses; equal ones once."""
    found, classes = [], set()
    for one in CONVENTIONS.values():
        if one.angle == "Sigma_R" or one.coordinates in classes:
            continue
        classes.add(one.coordinates)
        found.append(CovarianceReading(one.name))
        if one.coordinates[1:] not in TWISTS:
            found.append(CovarianceReading(one.name, inverse=True))
    return tuple(found)


def is_isotropic(S: Array) -> bool:
    """Return whether the blocks of rotation and of translation (..., 6, 6) are multiples of the identity."""
    d = np.sqrt(np.diagonal(S, axis1=-2, axis2=-1))
    d = np.where(d > 0, d, 1.0)
    unit = S / (d[..., :, None] * d[..., None, :])
    same = [np.ptp(part, axis=-1) <= SAME_SHARE * part.max(axis=-1) for part in (d[..., :3], d[..., 3:])]
    return bool(np.all(same) and np.abs(unit - np.eye(6)).max() < SAME_SHARE)


def convention_finding(
    poses: PosePairs, at: Unknowns, robot: Array | None, camera: Array, given: CovarianceReading
) -> Finding | None:
    """Return the finding that names the convention that fits; None where the given one does, or the data do not tell.

    Parameters
    ----------
    poses : PosePairs
    at : Unknowns
        X and W near which the poses are linearised.
    robot : (6, 6) or (n, 6, 6) or None
        Covariance of the robot poses; None: isotropic of unknown sizes.
    camera : (6, 6) or (n, 6, 6)
        Covariance of the camera poses, as it was read.
    given : CovarianceReading
        How it was read.
    """
    camera = np.broadcast_to(camera, (poses.n, 6, 6))
    if poses.n > MAX_POSES:
        rows = np.linspace(0, poses.n - 1, MAX_POSES).astype(np.intp)
        poses, camera = poses.rows(rows), camera[rows]
        robot = robot if robot is None or robot.ndim == 2 else robot[rows]
    try:
        tried = _distinct(poses.camera, camera, given)
        linear = constraint_of(poses, None).linearise(at, poses.robot, poses.camera)
        residuals = _Residuals.of(linear, camera, robot)
        as_is = residuals.judged(np.stack([S for _, S in tried]), sized=False)
        most = float(residuals.judged(camera[None], sized=True).values[0])
    except np.linalg.LinAlgError:  # the noise given leaves residuals exact
        return None
    gain = as_is.values - as_is.values[0]
    bound = poses.n * (0.5 * OUTLIER_SQUARE - 3.0)  # where every pose is an outlier of the given reading
    by_chance, if_right = _divergence(as_is.S), _divergence(as_is.S, reverse=True)
    above = QUANTILE_OF_CHANCE * np.sqrt(2.0 * by_chance) - by_chance
    needed = np.maximum(np.maximum(above, MIN_SHARE_OF_GAIN * np.minimum(if_right, bound)), MIN_GAIN)
    fits = np.median(as_is.squares, axis=-1) < MAX_MEDIAN_SQUARE
    named = fits & (gain > needed) & (as_is.values > most - MAX_LOSS_AGAINST_SIZED)
    best = int(np.argmax(np.where(named, gain, -np.inf)))
    if not named[best]:
        return None
    ties = [int(k) for k in np.argsort(-gain) if named[k] and gain[k] > gain[best] - MAX_TIE]
    step = as_is.steps[best, :6] - as_is.steps[0, :6]
    of_X = np.linalg.inv(as_is.information[0])[:6, :6]
    values = {
        "classes": [_in_words([name for reading in tried[k][0] for name in _libraries(reading)]) for k in ties],
        "given": given.words,
        "next": _words(tried[best][0][0], given),
        "gain": gain[best],
        "off": np.sqrt(step @ np.linalg.solve(of_X, step) / 6),
    }
    return Finding(CODE, "caution", values)


def _distinct(T: Array, camera: Array, given: CovarianceReading) -> list[tuple[list[CovarianceReading], Array]]:
    """Return readings with the covariances (n, 6, 6) that they make of the numbers: the given one first.

    Readings that make the same covariances are one.
    """
    J = given.jacobian(T)
    numbers = J @ camera @ J.mT
    found: list[tuple[list[CovarianceReading], Array]] = [([given], camera)]
    for reading in readings():
        back = np.asarray(np.linalg.inv(reading.jacobian(T)), dtype=float)
        S = back @ numbers @ back.mT
        same = next((one for one, other in found if _is_same(S, other)), None)
        if same is None:
            found.append(([reading], S))
        else:
            same.append(reading)
    return found


def _is_same(S: Array, other: Array) -> bool:
    d = np.sqrt(np.diagonal(other, axis1=-2, axis2=-1))
    return bool((np.abs(S - other) <= SAME_SHARE * d[..., :, None] * d[..., None, :]).all())


def _libraries(reading: CovarianceReading) -> list[str]:
    """Return the names of the libraries of a reading."""
    names = [name for name in same_class(reading.convention) if not name.startswith("se3-")]
    return [f"{names[0]} of the inverse poses"] if reading.inverse else names


def _in_words(names: list[str]) -> str:
    """Return a class with the libraries that it stands for: gtsam (small-gicp)."""
    first, *others = names
    return f"{first} ({', '.join(others)})" if others else first


def _words(reading: CovarianceReading, given: CovarianceReading) -> str:
    """Return the reading as the option takes it, with what was given of information and pixels."""
    name = next(name for name in same_class(reading.convention) if not name.startswith("se3-"))
    pixel_sd = None if CONVENTIONS[name].has_noise else given.pixel_sd
    return CovarianceReading(name, reading.inverse, given.information, pixel_sd).words


def _divergence(S: Array, reverse: bool = False) -> Array:
    """Kullback-Leibler divergences (k,) of normal residuals of S[0] and of each S (k, n, 6, 6); or the reverse ones."""
    first = np.broadcast_to(S[0], S.shape)
    ratio = np.linalg.solve(first, S) if reverse else np.linalg.solve(S, first)
    each = np.trace(ratio, axis1=-2, axis2=-1) - 6.0 - np.linalg.slogdet(ratio)[1]
    return np.asarray(np.maximum(0.5 * each.sum(axis=-1), 0.0))


class _Likelihoods(NamedTuple):
    """Log likelihoods (...) of readings, the step (..., 12) to X and W that each makes, and its information."""

    values: Array
    steps: Array
    information: Array
    S: Array  # (..., n, 6, 6) covariance of the residuals
    squares: Array  # (..., n) d^2


class _Residuals(NamedTuple):
    """Linearised rows, the known part of the robot's noise, its unknown parts, and the log density of outliers."""

    linear: Linearised
    robot: Array  # (n, 6, 6); 0 where it is not known
    unknown: tuple[Array, ...]  # (n, 6, 6) of a unit variance of rotation and of translation
    start: tuple[float, ...]  # logarithms of their sizes to begin with
    outliers: float

    @classmethod
    def of(cls, linear: Linearised, camera: Array, robot: Array | None) -> _Residuals:
        """Return the rows with the camera's covariance as it was read."""
        D_G, D_C = linear.sides
        C = D_C @ camera @ D_C.mT
        unknown: tuple[Array, ...] = ()
        start: tuple[float, ...] = ()
        known = np.zeros_like(C)
        if robot is None:  # at first as large as the camera's part of the residuals
            blocks = slice(0, 3), slice(3, 6)
            unknown = tuple(D_G[..., :, block] @ D_G[..., :, block].mT for block in blocks)
            of_camera = np.diagonal(C, axis1=-2, axis2=-1)
            start = tuple(float(np.log(np.median(of_camera[..., block]))) for block in blocks)
        else:
            known = D_G @ robot @ D_G.mT
        logs = np.linalg.slogdet(C + known)[1]
        return cls(linear, known, unknown, start, -0.5 * (float(np.median(logs)) + OUTLIER_SQUARE))

    def judged(self, camera: Array, sized: bool) -> _Likelihoods:
        """Return the likelihoods of cameras (k, n, 6, 6), each at its best sizes.

        ``sized``: the camera's covariance has a size as well.
        """
        C = self.linear.sides[1] @ camera @ self.linear.sides[1].mT
        parts = [np.broadcast_to(part, C.shape) for part in self.unknown] + [C] * sized
        fixed = self.robot + (np.zeros_like(C) if sized else C)
        if not parts:
            return self.likelihoods(fixed)
        return self.searched(fixed, np.stack(parts), np.array([*self.start, *[0.0] * sized]))

    def searched(
        self, fixed: Array, parts: Array, start: Array, rounds: int = 5, step: float = 0.7, longest: float = 1.5
    ) -> _Likelihoods:
        """Return likelihoods at the best sizes of ``parts`` (p, k, n, 6, 6) in addition to ``fixed`` (k, n, 6, 6).

        Newton's steps in the logarithms of the sizes, along each by differences, of all readings at once; where such a
        step is none upward, the best of the differences is taken.
        """
        p, k = parts.shape[:2]
        every = np.arange(k)
        theta = np.tile(start, (k, 1))

        def at(logs: Array) -> _Likelihoods:
            return self.likelihoods(fixed + np.einsum("...kp,pknij->...knij", np.exp(logs), parts))

        best = at(theta).values
        for _ in range(rounds):
            trials = theta + step * np.concatenate([np.eye(p), -np.eye(p)])[:, None]
            found = at(trials).values
            up, down = found[:p], found[p:]
            slope, curvature = (up - down) / (2 * step), (up - 2 * best + down) / step**2
            newton = theta + np.clip(slope / np.maximum(-curvature, 0.1 * np.abs(slope) + 1e-9), -longest, longest).T
            trials, found = np.concatenate([trials, newton[None]]), np.concatenate([found, at(newton).values[None]])
            chosen = found.argmax(axis=0)
            better = found[chosen, every] > best
            theta = np.where(better[:, None], trials[chosen, every], theta)
            best = np.maximum(best, found[chosen, every])
        return at(theta)

    def likelihoods(self, S: Array, t_degrees: float = 8.0, t_rounds: int = 3, rounds: int = 5) -> _Likelihoods:
        """Return the likelihoods of residual covariances (..., n, 6, 6).

        X and W are fitted with weights: first those of a t distribution, then the probabilities of being no outlier.
        """
        r, J = self.linear.r, self.linear.J
        n, p = r.shape[-2], J.shape[-1]
        L = np.linalg.cholesky(S)
        rows = np.concatenate([J, r[..., None]], axis=-1)
        white = (np.linalg.inv(L) @ rows).reshape(*S.shape[:-3], 6 * n, p + 1)
        logs = 2.0 * np.log(np.diagonal(L, axis1=-2, axis2=-1)).sum(axis=-1)
        weights = np.ones((*S.shape[:-2], 1))
        for k in range(rounds):
            sums = (white * np.repeat(weights, 6, axis=-2)).mT @ white
            information = sums[..., :p, :p]
            step = -np.linalg.solve(information, sums[..., :p, p:])
            left = white[..., :p] @ step + white[..., p:]
            squares = (left.reshape(S.shape[:-1]) ** 2).sum(axis=-1)
            each = -0.5 * (logs + squares)
            total = np.logaddexp(each, self.outliers)
            clean = np.maximum(np.exp(each - total), 1e-6)
            weights = (clean if k >= t_rounds - 1 else (t_degrees + 6) / (t_degrees + squares))[..., None]
        return _Likelihoods(total.sum(axis=-1), step[..., 0], information, S, squares)
