"""The most useful next step after a calibration, in one line."""

from __future__ import annotations

from collections.abc import Sequence

from ...findings import Finding
from ...fit.diagnostics.sentences import DECLARE
from ..result import Calibration
from ..statement.accuracy import Accuracy

# Poses below which more of them are the first thing to try where noise limits X.
FEW = 25


def next_step(result: Calibration, report: str | None = None) -> str:
    """Return the next step: about the finding of most effect that asks for one, else about the largest part.

    ``report`` is the name of the report that was written.
    """
    first = [finding for finding in result.cautions if finding.record.first]  # explain the others
    if found := step_after([*first, *result.cautions]):
        return found.replace("--report report.html", report) if report else found
    accuracy = result.accuracy
    if accuracy is None:
        return "give the noise: --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm"
    if report is not None:
        return f"open {report}"
    return (
        _about_largest(accuracy, result.n_poses or result.n_pairs) or "add --report report.html for two pages to file"
    )


def step_after(findings: Sequence[Finding]) -> str | None:
    """Return what to do about the first of some findings that asks for something."""
    return next(filter(None, (finding.remedy for finding in findings)), None)


def _about_largest(accuracy: Accuracy, count: int) -> str | None:
    """Return what to do about the largest part of the accuracy."""
    if not accuracy.parts:
        return None
    name = accuracy.parts[0].name
    if name.startswith("noise of") and count < FEW:
        return "take more poses to reduce the noise: uq-handeye plan chooses them"
    assumed = any(text.startswith(name) and text.endswith("assumed)") for text in accuracy.included)
    if assumed and name in DECLARE:
        return f"measure the {name}, which limits X, and declare how well: such as {' '.join(DECLARE[name])}"
    return None
