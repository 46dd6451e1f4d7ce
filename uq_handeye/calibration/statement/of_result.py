"""Statement of a calibration, as properties of its result."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

from ...findings import Finding
from ..estimate.estimated import Estimated
from .accuracy import Accuracy, accuracy_of
from .checks import Check, cautions_of, checks_of, reasons_of
from .headline import headline_of
from .tolerance import Tolerance, Verdict, verdict_of


class Statement(Estimated):
    """Accuracy of X, its checks, whether X can be used and whether it meets a tolerance; a part of `Calibration`."""

    @cached_property
    def accuracy(self) -> Accuracy | None:
        """The total standard uncertainty of X in the worst direction, and what it includes; None: not determined."""
        return accuracy_of(self)

    @cached_property
    def checks(self) -> tuple[Check, ...]:
        """The checks of data and fit, one line each: ok, caution, failed or not run."""
        return checks_of(self)

    @property
    def cautions(self) -> tuple[Finding, ...]:
        """The findings that are more than a note, those of the diagnostics too, in the order of their effect on X."""
        return cautions_of(self)

    @property
    def answered(self) -> Literal["whole", "in part", "no"]:
        """``whole``: X explains the poses and is determined by them. ``in part``: directions of it are open
        (`open_directions`), and the others are known. ``no``: X is of no use (`reasons`).
        """
        if reasons_of(self):
            return "no"
        return "whole" if self.opened is None or not self.opened.of_X.size else "in part"

    @property
    def usable(self) -> bool:
        """True if X explains the poses and is determined by them; `reasons` or `open_directions` say why not."""
        return self.answered == "whole"

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why X cannot be used, the decisive one first; empty where it can."""
        return reasons_of(self)

    @property
    def headline(self) -> str:
        """Accuracy of X in one sentence; or ``NOT USABLE:`` and the decisive reason."""
        return headline_of(self)

    def verdict(
        self, tolerance: str | tuple[float | None, float | None] | Tolerance, at: str | float | None = None
    ) -> Verdict:
        """Return whether X meets a tolerance: PASS, FAIL or NOT SHOWN, with the probability (`statement.tolerance`).

        Parameters
        ----------
        tolerance : str, (m, rad) or Tolerance
            Such as ``"1mm,0.1deg"``, ``"1mm"`` or ``"0.1deg"``: the largest errors that are accepted.
        at : str, float or None
            Distance (m, or text with its unit) of a point ahead of the camera, whose error the length is then of; None:
            the length is of the translation of X.

        Raises
        ------
        InputError
            A tolerance that cannot be read.
        """
        return verdict_of(self, tolerance, at)
