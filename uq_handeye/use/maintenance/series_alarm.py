"""CUSUM alarm of a series of checks, with a stated false-alarm rate.

Charts of scores that are independent while nothing changes (`cusum`): the shift of X, the shift of the target (of a rig
those of each camera, target and base), and all residuals. Each of m charts has the limit at which it alone raises one
false alarm in m times ``every`` checks on average; together they raise at most one in ``every``.

After an alarm, a shift of X or of the target that is constant from check j on is estimated for each j up to the alarm
(generalised least squares over all checks); the j and the cause that lower d^2 most are the answer. A drift is answered
by its mean since about its middle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import singledispatch
from typing import Any, ClassVar, cast

import numpy as np

from ...calibration.evidence.new_poses import evidence_of_poses
from ...calibration.result import Calibration
from ...core.files.records import Record
from ...core.formatting.numbers import digits
from ...core.geometry.se3 import Array
from ...core.presentation.document import Answer, Block, Document, Paragraph, document_of
from ...core.presentation.shown import Shown
from ...core.runtime.read_only import ReadOnlyArrays
from ...errors import InputError
from ...model.poses.pose_pairs import PosePairs
from ...model.posterior.rows import Explained, NewRows
from ...rig.checks.check import evidence_of_views
from ...rig.description import Rig
from ...rig.result import RigCalibration
from .check_result import move_in_words
from .cusum import Innovations, Scores, cusum, limit_for, scores_of, vector_cusum
from .log import CheckSeries, LoggedCheck, hash_of_result

# One false alarm in so many checks on average.
EVERY = 500.0
X, TARGET, RESIDUALS = "X", "target", "residuals"
# Starts of a change that are looked at, before an alarm.
MOST_STARTS = 60
# Causes whose gains differ by less are not separated: odds of 50 to 1.
LEAD = 2.0 * float(np.log(50.0))


@dataclass(frozen=True, eq=False)
class Chart(ReadOnlyArrays):
    """One CUSUM chart."""

    name: str
    path: Array  # (n,) after each check
    limit: float

    @property
    def alarm(self) -> int | None:
        """Index of the first check above the limit."""
        above = np.flatnonzero(self.path > self.limit)
        return int(above[0]) if above.size else None


@dataclass(frozen=True, eq=False)
class SeriesAlarm(Record, Shown):
    """Charts of a series, and what they found. ``str(alarm)`` is its text.

    Attributes
    ----------
    times : of the n checks that the charts use
        Without those whose poses were wrong or misread.
    every : float
        Checks for each false alarm, on average.
    charts : tuple of Chart
        Of the shift of X, of the target, and of all residuals; none without checks.
    alarm : int or None
        Index of the check that raised the alarm.
    chart : str
        Name of the chart that did.
    since : int or None
        Index of the check from which on it moved, about.
    causes : tuple of str
        "X", "target", or both where they cannot be separated; none where only the residuals have grown.
    shifts : mapping or None
        Of X and of the target, over the checks since then, relative to the calibration and the checks before.
    """

    _in_file: ClassVar[str] = "times checks_per_false_alarm=every charts=_by_chart alarm chart since causes shifts"

    times: tuple[str, ...]
    every: float
    charts: tuple[Chart, ...]
    alarm: int | None = None
    chart: str = ""
    since: int | None = None
    causes: tuple[str, ...] = ()
    shifts: dict[str, Explained] | None = None

    @property
    def _by_chart(self) -> dict[str, Any]:
        return {chart.name: {"path": chart.path, "limit": chart.limit} for chart in self.charts}

    __str__ = Shown.summary


def series_alarm(result: Calibration | RigCalibration, series: CheckSeries, every: float = EVERY) -> SeriesAlarm:
    """Evaluate the charts of a series.

    Parameters
    ----------
    result : Calibration or RigCalibration
        The one that was checked.
    series : CheckSeries
        As `log_check` or `read_checks` return it.
    every : float
        Checks for each false alarm, on average.
    """
    if hash_of_result(result) != (series.result or hash_of_result(result)):
        raise InputError(f"Expected the calibration of the series ({series.result}), got {hash_of_result(result)}.")
    checks = [check for check in series.checks if check.used]
    times = tuple(check.time for check in checks)
    each = float(every)
    if not checks:
        return SeriesAlarm(times, each, ())
    evidence, columns = _rows_of(result, checks)
    charts = charts_of(scores_of(evidence, columns, checks[0].noise_dof), each)
    first = min((c for c in charts if c.alarm is not None), key=lambda c: c.alarm or 0, default=None)
    if first is None or first.alarm is None:
        return SeriesAlarm(times, each, charts)
    at = first.alarm
    starts = range(max(0, at + 1 - MOST_STARTS), at + 1)
    by_start = {name: shifts_since(evidence, C, starts) for name, C in columns.items()}
    best = max((of.gain, j) for found in by_start.values() for j, of in enumerate(found))[1]
    shifts = {name: found[best] for name, found in by_start.items()}
    causes: tuple[str, ...] = ()
    if first.name != RESIDUALS:
        largest = max(of.gain for of in shifts.values())
        causes = tuple(name for name, of in shifts.items() if of.gain > largest - LEAD)
    return SeriesAlarm(times, each, charts, at, first.name, starts[best], causes, shifts)


@singledispatch
def _rows_of(result: Any, checks: Sequence[LoggedCheck]) -> tuple[list[NewRows], dict[str, list[Array]]]:
    """Rows of each check, and columns of shifts by cause."""
    found = [evidence_of_poses(result, cast(PosePairs, check.poses), check.noise) for check in checks]
    columns = {X: [-of.linear.J[..., :6] for of in found], TARGET: [-of.linear.J[..., 6:] for of in found]}
    return list(found), columns


@_rows_of.register
def _(result: RigCalibration, checks: Sequence[LoggedCheck]) -> tuple[list[NewRows], dict[str, list[Array]]]:
    found = [evidence_of_views(result, cast(Rig, check.poses)) for check in checks]  # of each pose that a check saw
    columns = {name: [of.moved(name) for of in found] for name in result.names}
    return [of.rows for of in found], {name: of for name, of in columns.items() if any(part.any() for part in of)}


def charts_of(scores: Scores, every: float = EVERY) -> tuple[Chart, ...]:
    """Return the charts of scores, each with its limit."""
    each = (len(scores.by_cause) + 1) * float(every)
    vectors = [Chart(name, vector_cusum(u), limit_for(each, components=6)) for name, u in scores.by_cause.items()]
    return (*vectors, Chart(RESIDUALS, cusum(scores.total), limit_for(each)))


def shifts_since(evidence: Sequence[NewRows], columns: Sequence[Array], starts: Sequence[int]) -> list[Explained]:
    """Estimate a shift that is the same in all checks from j on, and none before, for each j of ``starts``."""
    filter_ = Innovations(evidence)
    moved = [
        np.concatenate([C.reshape(of.dof, -1) * (k >= j) for j in starts], axis=1)
        for k, (of, C) in enumerate(zip(evidence, columns, strict=True))
    ]
    e = np.concatenate(filter_.whitened([of.r.reshape(-1, 1) for of in evidence]))[:, 0]
    A = np.concatenate(filter_.whitened(moved))
    found = []
    for part in np.split(A, len(starts), axis=1):
        covariance, score = np.asarray(np.linalg.pinv(part.T @ part, hermitian=True), dtype=float), part.T @ e
        estimate = covariance @ score
        found.append(Explained(estimate, covariance, float(estimate @ score)))
    return found


WORDS = {X: "X", TARGET: "the target", RESIDUALS: "the residuals"}


def _words(name: str) -> str:
    return WORDS.get(name, name)


@document_of.register
def alarm_document(found: SeriesAlarm) -> Document:
    """Return the answer, what has moved, and the rate of false alarms."""
    n = len(found.times)
    if not n:
        return [[Answer("Series: no check that can be used yet.", "caution")]]
    rate = f"False alarms: at most one in {digits(found.every)} checks on average."
    if found.alarm is None or found.since is None:
        levels = ", ".join(f"{_words(c.name)} {100 * c.path[-1] / c.limit:.0f} %" for c in found.charts)
        many = "1 check" if n == 1 else f"{n} checks"
        return [[Answer(f"Series of {many}: no alarm.", "ok"), Paragraph(f"Of the limit: {levels}. {rate}", hang="  ")]]
    blocks: list[Block] = [
        Answer(f"ALARM of the series, at check {found.alarm + 1} of {n} ({day(found.times[found.alarm])}).", "failed")
    ]
    start = f"since about check {found.since + 1} ({day(found.times[found.since])})"
    if not found.causes:
        blocks.append(Paragraph(f"The residuals have grown, {start}: no shift explains it.", hang="  "))
    for cause in found.causes:
        assert found.shifts is not None
        name, of = _words(cause), found.shifts[cause]
        first = f"{name[0].upper()}{name[1:]}" if cause in WORDS else name
        words = first if cause == found.causes[0] else f"Or {name}"
        size = move_in_words(of.estimate, of.covariance)
        blocks.append(Paragraph(f"{words} has moved, {start}: {size} (mean since then).", hang="  "))
    return [[*blocks, Paragraph(rate, hang="  ")]]


def series_sentences(series: CheckSeries) -> list[str]:
    """Say which lines and checks of the log the charts do not use."""
    found = [f"Line {number} of the log was skipped: {what}." for number, what in series.damaged[:3]]
    if (more := len(series.damaged) - 3) > 0:
        found.append(f"{more} more lines of the log were skipped.")
    if left := [str(k + 1) for k, check in enumerate(series.checks) if not check.used]:
        which = f"check {left[0]}" if len(left) == 1 else f"checks {', '.join(left)}"
        found.append(f"The charts do not use {which}, with wrong or misread poses.")
    return found


def day(time: str) -> str:
    """Return the date of a time."""
    return time[:10]
