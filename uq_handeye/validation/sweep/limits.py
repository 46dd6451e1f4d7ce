"""The noise level beyond which a covariance is no longer valid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from ...errors import InputError
from .level import KINDS, Level


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
