"""The headline: how accurate X is in one sentence, or that it cannot be used and why; the statement of a result."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

import numpy as np

from ...core.formatting.numbers import digits
from ...findings import Finding
from ...model.shared_errors.shared_error import FOCAL_LENGTH, LENS, PRINCIPAL_POINT, TARGET_SCALE, VIEW
from ...model.shared_errors.sizes import ROBOT_ACCURACY
from ..estimate.estimated import Estimated
from .accuracy import Accuracy, accuracy_of, amounts
from .checks import Check, cautions_of, checks_of, reasons_of
from .tolerance import Tolerance, Verdict, verdict_of

NOT_USABLE = "NOT USABLE"


def headline_of(result: Estimated) -> str:
    """Return the headline of a calibration."""
    if reasons := reasons_of(result):
        return f"{NOT_USABLE}: {reasons[0]}."
    accuracy = accuracy_of(result)
    if accuracy is None:
        return f"The accuracy of {result.frame} is not known: no noise was given, and none could be estimated."
    if result.opened is not None and result.opened.of_X.size:
        known = f"{amounts(accuracy.translation, accuracy.rotation)} (1 sigma, worst direction that is known)"
        return f"{result.frame} is known to {known}. Not determined: {'; '.join(result.open_words)}."
    known = f"{amounts(accuracy.translation, accuracy.rotation)} (1 sigma, worst direction)"
    if accuracy.lower_limit:
        known = f"no better than {known}"
    return f"{result.frame} is known to {known}; {_ahead(accuracy)}."


def suits_of(accuracy: Accuracy) -> str | None:
    """Return for which tolerance of points X is good enough, and for which it is not; None where that is not known.

    Of the steps 1, 2, 5 mm and so on: the least that 95 % of the errors of a point at the distance of the target are
    within, in the worst direction, and the largest that a third of them are beyond.
    """
    if not np.isfinite(accuracy.point_95) or accuracy.point <= 0:
        return None
    steps = np.outer(10.0 ** np.arange(-7, 4), [1.0, 2.0, 5.0]).ravel()
    good, bad = steps[steps >= accuracy.point_95], steps[steps < accuracy.point]
    if not good.size or not bad.size:
        return None
    far, fails = f"Points {digits(accuracy.distance, 2)} m ahead", f"{digits(1e3 * bad[-1], 1)} mm"
    if accuracy.lower_limit:
        return f"{far}: not for {fails}; no larger tolerance is shown to be met."
    return f"{far}: good for a tolerance of {digits(1e3 * good[0], 1)} mm (95 %); not for {fails}."


# What errors whose size is assumed belong to, and how to say what they are here.
_ASSUMED = {
    ROBOT_ACCURACY: ("an arm of unknown accuracy", "Give joints (--joints, --urdf), --robot-model or --robot-accuracy"),
    FOCAL_LENGTH: ("the focal length", "Give pictures, or --focal-sd"),
    PRINCIPAL_POINT: ("the principal point", "Give pictures, or --principal-point-sd"),
    TARGET_SCALE: ("the size of the target", "Measure it, and give --target-scale-sd"),
    VIEW: ("an unknown camera", "Give pictures or corners"),
    LENS: ("an unknown camera", "Give pictures or corners"),
}


def two_numbers(accuracy: Accuracy) -> str | None:
    """Return what the poses give and what assumed errors add, with what to declare; None where they add little."""
    own = accuracy.from_poses
    if own is None:
        return None
    of, give = _ASSUMED.get(own.assumed[0], (f"the {own.assumed[0]}", "Declare it"))
    known = amounts(own.translation, own.rotation)
    return f"These poses alone give {known}; the rest is assumed of {of}. {give}."


def _ahead(accuracy: Accuracy) -> str:
    """Return how well a point at the distance of the target is known."""
    far = f"{digits(accuracy.distance, 3)} m"
    point = f"{digits(1e3 * accuracy.point, 2)} mm" if np.isfinite(accuracy.point) else "not determined"
    if accuracy.distance_known:
        return f"a point at the target's distance, {far}, to {point}"
    return f"a point {far} ahead of the camera to {point}"


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
