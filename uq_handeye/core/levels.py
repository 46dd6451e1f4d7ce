"""Statistical levels: the probability at which a test triggers a statement, and that statement.

A test compares the p-value of what was observed with one of these levels. A lower level triggers a stronger
statement, or belongs to a test that is repeated for many poses, patterns or causes. This is the only table of
levels in the package; the page `statistical levels` of the documentation is generated from it.
"""

from __future__ import annotations

from typing import NamedTuple

from scipy.special import chdtri


class Level(NamedTuple):
    """A probability and what follows where a p-value falls below it, or a probability rises above it."""

    probability: float
    triggers: str  # what the program says or does
    source: str  # why this value: a convention of the field, or where it was measured

    def chi_square(self, dof: float) -> float:
        """Return the value that a chi-square of ``dof`` degrees of freedom exceeds with this probability."""
        return float(chdtri(dof, self.probability))


INTERVAL = Level(
    0.95,
    "Stated intervals contain the true value with this probability; PASS above it, FAIL below its complement.",
    "JCGM 100:2008, 6.2.2 and annex G: the usual coverage probability of an expanded uncertainty",
)
POWER = Level(
    0.95,
    "The smallest change that a check would have detected is stated for this probability of detection.",
    "The power that belongs to 5 % false alarms when both errors count the same",
)
UNUSUAL = Level(
    0.05,
    "A check of a stored result reports a change; a caution is printed beside a result.",
    "Fisher 1925: one false alarm in twenty",
)
DOUBTFUL = Level(
    0.01,
    "A declared or assumed value is doubted; a check that could not have seen the change says so.",
    "A fifth of the level of a caution, because a value that a user gave is doubted",
)
CONTRADICTED = Level(
    1e-3,
    "Data and an assumption contradict each other; a pose or a view is down-weighted.",
    "Baarda 1968: the level of data snooping in geodesy",
)
RARE = Level(
    1e-4,
    "The same, for a test that is repeated for many poses, points or patterns.",
    "The level of data snooping over ten repetitions (Bonferroni)",
)
IMPOSSIBLE = Level(
    1e-6,
    "A result is not usable; two readings of a file cannot both be right.",
    "One false alarm in a million results: a right result is not refused by chance",
)

LEVELS: dict[str, Level] = {name: level for name, level in globals().items() if isinstance(level, Level)}
