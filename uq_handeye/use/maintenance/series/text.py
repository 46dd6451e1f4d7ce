"""The alarm of a series of checks in a few lines."""

from __future__ import annotations

import numpy as np

from ....core.formatting.numbers import digits, plus_minus
from ....core.presentation.document import Answer, Block, Document, Paragraph, document_of
from .alarm import RESIDUALS, TARGET, SeriesAlarm, Shift, X
from .log import CheckSeries

WORDS = {X: "X", TARGET: "the target", RESIDUALS: "the residuals"}


@document_of.register
def alarm_document(found: SeriesAlarm) -> Document:
    """Return the answer, what has moved, and the rate of false alarms."""
    n = len(found.times)
    if not n:
        return [[Answer("Series: no check that can be used yet.", "caution")]]
    rate = f"False alarms: at most one in {digits(found.every)} checks on average."
    if found.alarm is None or found.since is None:
        levels = ", ".join(f"{WORDS[c.name]} {100 * c.path[-1] / c.limit:.0f} %" for c in found.charts)
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
        name = WORDS[cause]
        words = f"{name[0].upper()}{name[1:]}" if cause == found.causes[0] else f"Or {name}"
        blocks.append(
            Paragraph(f"{words} has moved, {start}: {_size(found.shifts[cause])} (mean since then).", hang="  ")
        )
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


def _size(shift: Shift) -> str:
    """Translation and rotation, by axis."""
    sd = np.sqrt(np.diag(shift.covariance))
    move, turn = (
        ", ".join(plus_minus(float(unit * shift.estimate[k]), float(unit * sd[k])) for k in part)
        for part, unit in ((range(3, 6), 1e3), (range(3), float(np.degrees(1.0))))
    )
    return f"translation x, y, z {move} mm; rotation {turn} deg"
