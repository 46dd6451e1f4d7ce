"""One level of a sweep over the noise: trials of a method, held against first order and against sigma points.

What a covariance has to do in order to hold is written in `sweep`. Errors ``xi = (theta, tau)`` in rad and m, rotation
first; covariances about the truth.

The noise level beyond which a covariance is no longer valid.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import gammainc, gammaincinv

from ....core.files.records import attributes
from ....core.geometry.se3 import Array
from ....core.runtime.read_only import ReadOnlyArrays
from ....errors import InputError, InputWarning, NotConvergedError
from ....findings import Finding
from ....fit.likelihood.constraint import covariances_of
from ...simulation.experiment import Experiment
from ...simulation.sigma_points import sigma_points_of
from ..monte_carlo.chunks import Work, chunk_size, from_bytes, to_bytes
from ..monte_carlo.consistency import LEVELS, PARTS, Consistency, Sums, consistency, heavy_from
from ..monte_carlo.sums import SIZES

KINDS = ("first order", "sigma points")
CONFIDENCE = 0.99

_AT_95 = LEVELS.index(0.95)


@dataclass(frozen=True, eq=False)
class Verdict(ReadOnlyArrays):
    """One covariance against the trials at one level of noise."""

    kind: str  # one of KINDS
    covariance: Array | None  # (6, 6), about the truth; None: there is none, `failure` says why
    consistency: Consistency | None
    failure: Finding | None  # why it fails; None: it holds

    @property
    def holds(self) -> bool:
        """See the module."""
        return self.failure is None

    @property
    def reason(self) -> str | None:
        """Reason in words why it fails."""
        return None if self.failure is None else str(self.failure)

    @property
    def mean_nees(self) -> Array | None:
        """(3,) of joint, rotation, translation: 6, 3, 3 if the covariance is consistent."""
        return None if self.consistency is None else self.consistency.mean_nees

    @property
    def nees_interval(self) -> Array | None:
        """(3, 2) where the mean NEES of a consistent covariance lies."""
        return None if self.consistency is None else self.consistency.nees_interval

    @property
    def coverage(self) -> float | None:
        """Share of the errors inside the joint 95 % ellipsoid."""
        c = self.consistency
        return None if c is None or c.coverage is None else float(c.coverage[0, _AT_95])

    @property
    def worst(self) -> tuple[float, float] | None:
        """Least and largest ratio of an error (root mean square) to its predicted standard deviation, any direction."""
        c = self.consistency
        if self.covariance is None or c is None or c.second_moment is None or c.sums.count < 6:
            return None
        from scipy.linalg import eigh

        unit = np.sqrt(np.diag(self.covariance))
        scale = np.outer(unit, unit)
        values = eigh(c.second_moment / scale, self.covariance / scale, eigvals_only=True)
        return float(np.sqrt(max(values[0], 0.0))), float(np.sqrt(values[-1]))


@dataclass(frozen=True, eq=False)
class Level:
    """A method at one level of noise."""

    factor: float  # of the covariance of the noise
    first_order: Verdict
    sigma_points: Verdict

    @property
    def deviations(self) -> float:
        """The factor of the standard deviations of the noise."""
        return math.sqrt(self.factor)

    def of(self, kind: str) -> Verdict:
        """One of `KINDS`."""
        return self.first_order if kind == KINDS[0] else self.sigma_points

    @property
    def heavy(self) -> bool:
        """True if rare large errors make up the spread, so that no covariance tells how often they come."""
        # in first-order deviations a single direction may outgrow the others
        c = self.sigma_points.consistency or self.first_order.consistency
        return c is not None and c.kurtosis is not None and c.kurtosis > heavy_from(c.sums.count)

    @property
    def bias(self) -> float | None:
        """The mean error of the component that has most of it, in sampled standard deviations."""
        c = self.first_order.consistency
        return None if c is None or c.bias_sd is None else float(np.abs(c.bias_sd).max())

    @property
    def failed(self) -> float:
        """Share of the trials without an estimate."""
        c = self.first_order.consistency
        return 1.0 if c is None else c.failures / c.trials


@dataclass(frozen=True, eq=False)
class Task:
    """A method at one level of noise, to be computed."""

    problem: Experiment
    factor: float
    trials: int
    seed: int
    tolerance: float


def drawn(task: Task) -> dict[str, Any]:
    """The trials and both covariances at one level, as the arrays of a piece of a run.

    The caller keeps linear algebra to one thread. ``points``: sigma points without an estimate, and all of them, where
    there is no covariance by them; empty where they cannot be counted.
    """
    scaled = (None if S is None else task.factor * S for S in covariances_of(task.problem.noise))
    problem = replace(task.problem, noise=type(task.problem.noise)(*scaled))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)  # data as noisy as this look wrong, which is the point
        first_order = problem.predicted()
        # through bytes as in `monte_carlo`: rounding depends on how arrays lie in memory
        work = from_bytes(to_bytes(Work(problem, task.seed, task.trials, chunk_size(problem), first_order)))
        chunks = [work.compute(index) for index in range(work.count)]
        errors, ok = (np.concatenate(parts) for parts in zip(*((c.errors, c.ok) for c in chunks), strict=True))
        found: dict[str, Any] = {"errors": errors, "ok": ok, KINDS[0]: first_order}
        try:
            return found | {KINDS[1]: sigma_points_of(problem, seed=task.seed).mean_square}
        except NotConvergedError as error:
            points = error.partial
            return found | {"points": [] if points is None else [points.failures, points.evaluations]}


def level_of(task: Task, found: Mapping[str, Any]) -> Level:
    """Judge both covariances by what was drawn."""
    first, second = (
        judged(kind, found["errors"], found["ok"], found[kind], task.tolerance) if kind in found else None
        for kind in KINDS
    )
    assert first is not None
    if second is None:
        failures, evaluations = map(int, found["points"]) if len(found["points"]) else (None, None)
        values = {"failures": failures, "evaluations": evaluations}
        second = Verdict(KINDS[1], None, None, Finding("sweep.no_sigma_points", "failure", values))
    return Level(task.factor, first, second)


def judged(kind: str, errors: Array, ok: Any, covariance: Array, tolerance: float) -> Verdict:
    """Errors (m, 6) of trials, where they are ok (m,), against a covariance about the truth."""
    found = consistency(Sums.of(errors, ok, covariance), covariance, CONFIDENCE)
    return Verdict(kind, covariance, found, find_failure(found, tolerance))


def find_failure(c: Consistency, tolerance: float) -> Finding | None:
    """Return why a covariance fails; None: it does not."""
    if c.many_failed:
        return Finding("sweep.no_estimate", "failure", {"failures": c.failures, "trials": c.trials})
    assert c.mean_nees is not None and c.nees_interval is not None
    assert c.coverage is not None and c.coverage_interval is not None
    sizes: list[tuple[float, str, float]] = []  # how far off, part, ratio
    shares: list[tuple[float, str, float]] = []
    for k, (part, size) in enumerate(zip(PARTS, SIZES, strict=True)):
        ratio, (low, high) = math.sqrt(c.mean_nees[k] / size), c.nees_interval[k]
        if not 1 / (1 + tolerance) <= ratio <= 1 + tolerance and not low <= c.mean_nees[k] <= high:
            sizes.append((abs(math.log(ratio)), part, ratio))
        share, (low, high) = float(c.coverage[k, _AT_95]), c.coverage_interval[k, _AT_95]
        fewest, most = coverage_limits(size, tolerance)
        if not fewest <= share <= most and not low <= LEVELS[_AT_95] <= high:
            off = abs(math.log(share / (1 - share) / 19)) if 0 < share < 1 else math.inf
            shares.append((off, part, share))
    if sizes:
        _, part, ratio = max(sizes)
        return Finding("sweep.size", "failure", {"part": part, "ratio": ratio})
    if shares:
        _, part, share = max(shares)
        return Finding("sweep.coverage", "failure", {"part": part, "share": share})
    return None


def coverage_limits(size: int, tolerance: float) -> tuple[float, float]:
    """Shares of Gaussian errors in the 95 % ellipsoid if standard deviations are too small and too large by the
    tolerance.
    """
    edge = float(2 * gammaincinv(size / 2, 0.95))
    few, many = (float(gammainc(size / 2, edge * wrong / 2)) for wrong in ((1 + tolerance) ** -2, (1 + tolerance) ** 2))
    return few, many


def level_dict(level: Level) -> dict[str, Any]:
    """A level as plain numbers, lists and text."""
    row = attributes(level, "factor sd_factor=deviations bias_sd=bias failed heavy_tails=heavy")
    names = "holds reason failure mean_nees nees_interval worst coverage_95=coverage covariance"
    return row | {kind: attributes(level.of(kind), names) for kind in KINDS}


@dataclass(frozen=True)
class Limit:
    """Factors of the covariance of the noise between which a covariance begins to fail."""

    holds: float | None  # the largest below the first failure; None: it fails at the smallest tried
    fails: float | None  # the smallest that fails; None: it holds at all tried
    heavy: bool = False  # errors have heavy tails at either: it is chance which of the levels around pass


@dataclass(frozen=True, eq=False)
class MethodSweep:
    """A method at all levels, by ascending factor, those of the bisection among them."""

    method: str
    levels: tuple[Level, ...]

    def limit(self, kind: str) -> Limit:
        """Return the limit of one of `KINDS`."""
        return limit_of(self.levels, kind)

    def __repr__(self) -> str:
        ends = "; ".join(f"{kind} {_ends(self.limit(kind))}" for kind in KINDS)
        return f"MethodSweep({self.method}, {len(self.levels)} levels: {ends})"

    @property
    def own(self) -> Level:
        """Level at the noise as it is."""
        return next(level for level in self.levels if level.factor == 1)

    def at(self, factor: float) -> Level:
        """Return the level at a factor that was asked for."""
        for level in self.levels:
            if math.isclose(level.factor, factor, rel_tol=1e-12):
                return level
        known = ", ".join(f"{level.factor:.4g}" for level in self.levels)
        raise InputError(f"Expected `factor` to be one of {known}, got {factor!r}.")


def limit_of(levels: Sequence[Level], kind: str) -> Limit:
    """Return the limit of levels by ascending factor: before the first that fails, however it is above."""
    before: Level | None = None
    for level in levels:
        if not level.of(kind).holds:
            heavy = level.heavy or (before is not None and before.heavy)
            return Limit(None if before is None else before.factor, level.factor, heavy)
        before = level
    return Limit(None if before is None else before.factor, None)


def _ends(limit: Limit) -> str:
    """For `repr`."""
    if limit.holds is None:
        return "holds at no factor tried"
    about = "about " if limit.heavy else ""
    factor = float(f"{limit.holds:.1e}")
    return f"holds {'at all tried, ' if limit.fails is None else ''}up to {about}{factor:,.10g}"
