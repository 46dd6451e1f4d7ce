"""The log of checks behind ``check --log``: one more line, and the alarm of the series."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..calibration.result import Calibration
    from ..maintenance.check_result import ChangeCheck
    from ..maintenance.series.alarm import SeriesAlarm
    from ..maintenance.series.log import CheckSeries
    from ..poses.pose_pairs import PosePairs
    from ..presentation.document import Block


@dataclass(frozen=True)
class Logged:
    """The series with the check that was added, and its alarm."""

    series: "CheckSeries"
    alarm: "SeriesAlarm"

    def document(self, short: bool) -> "list[list[Block]]":
        """Return the answer of the series, below that of the check."""
        from ..maintenance.series.text import alarm_document, series_sentences
        from ..presentation.document import Paragraph, groups_of

        blocks = [block for part in groups_of(alarm_document(self.alarm)) for block in part]
        if short:
            return [blocks[:1]]
        return [[*blocks, *(Paragraph(text, hang="  ") for text in series_sentences(self.series))]]

    def figure(self) -> "Figure":
        """Return the figure of the series."""
        from ..maintenance.series.figure import series_figure

        return series_figure(self.series, self.alarm)


def logged(path: Path, result: "Calibration", poses: "PosePairs", check: "ChangeCheck", every: float | None) -> Logged:
    """Add a check to the log, and evaluate the series."""
    from ..maintenance.series.alarm import EVERY, series_alarm
    from ..maintenance.series.log import log_check

    series = log_check(path, result, poses, check)
    return Logged(series, series_alarm(result, series, EVERY if every is None else every))
