"""The answer of any result: verdicts on a tolerance, and the last lines of a screen."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from ...core.presentation.document import Answer, Badge, Block
from ...findings import Finding
from ..checks import Check
from ..tolerance import Verdict


class Answered(Protocol):
    """The part that results of one camera and of several have in common."""

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why it cannot be used."""

    @property
    def status(self) -> str:
        """Status of the headline."""

    @property
    def cautions(self) -> tuple[Finding, ...]:
        """Findings that are more than a note, in the order of their effect."""

    @property
    def checks(self) -> tuple[Check, ...]:
        """Checks of data and fit, one line each."""

    @property
    def is_stated(self) -> bool:
        """True if its accuracy is known."""

    @property
    def remedy(self) -> str | None:
        """Remedy of what was found."""

    @property
    def advice(self) -> str | None:
        """The next step about the data or the noise."""


def verdict_blocks(result: Answered, verdicts: Mapping[str, Verdict]) -> list[Block]:
    """Return the verdict on each camera, with its name where there are several."""
    blocks: list[Block] = []
    for name, verdict in verdicts.items():
        text = str(verdict) if not result.reasons else f"{verdict.word}: X is not usable."
        blocks.append(Answer(f"{name}: {text}" if len(verdicts) > 1 else text, verdict.status))
    return blocks


def status_with(result: Answered, verdict: Verdict | None = None) -> str:
    """Return the status of the headline, or that of the verdict on a tolerance where it is worse."""
    of_verdict = "ok" if verdict is None else verdict.status
    return max(result.status, of_verdict, key=("ok", "caution", "failed").index)


def badges_of(result: Answered, verdicts: Mapping[str, Verdict]) -> list[Block]:
    """Return the verdict on each camera as a block of a page, with its name where there are several."""
    return [
        Badge(f"{name}: {one.word}" if len(verdicts) > 1 else one.word, one.sentence, status_with(result, one))
        for name, one in verdicts.items()
    ]


def next_step(result: Answered, report: str | None = None) -> str:
    """Return the next step: for the finding of most effect that has one, else for the largest part of the uncertainty.

    ``report`` is the name of the report that was written.
    """
    if (found := result.remedy) is not None:
        return found.replace("--report report.html", report) if report else found
    if result.is_stated and report is not None:
        return f"open {report}"
    return result.advice or "add --report report.html for two pages to file"


def closing_lines(result: Answered, written: str = "", report: str | None = None, more: str = "") -> list[str]:
    """Return the last paragraphs of a screen: what was written, the next step, and ``more``."""
    return [text for text in (written, f"Next: {next_step(result, report)}.", more) if text]
