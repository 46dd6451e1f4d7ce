r"""Test whether X meets a tolerance: PASS, FAIL or NOT SHOWN, with the probability.

Model: the error ``xi = (theta, tau)`` of X has the distribution of `calibration.error_of_X`. The probability is that of

    |theta| <= rotation    and    |tau| <= translation,   or of a point p straight ahead of the camera
    |theta| <= rotation    and    |theta x R p + tau| <= translation

by its 2^14 points (an error below 0.001). PASS from a probability of 95 %, FAIL up to
5 % (JCGM 106, acceptance by a limit of the probability of conformity), else NOT SHOWN. It is never PASS where X is not
usable, a direction of X is not determined, the accuracy is a lower limit, or a check failed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Literal, TypeAlias

import numpy as np

from ..core.files.records import Record
from ..core.geometry.se3 import Array
from ..core.levels import INTERVAL
from ..core.presentation.numbers import digits
from ..core.presentation.units import ANGLE_UNITS, parse_angle, parse_length
from ..errors import InputError
from ..fit.graph.reference import Reference
from ..model.poses.estimated_pose import EstimatedPose
from .checks import Checked, lower_limit_of
from .error_of_X import moved, points_of
from .estimated import Estimated

# A tolerance is met from this probability on.
MET = INTERVAL.probability
# A tolerance is missed where the probability is not above this.
MISSED = 1 - MET


Word = Literal["PASS", "FAIL", "NOT SHOWN"]
PASS: Word = "PASS"
FAIL: Word = "FAIL"
NOT_SHOWN: Word = "NOT SHOWN"


# A tolerance as it is given: text such as "1mm,0.1deg", numbers (m, rad), or itself.
ToleranceLike: TypeAlias = "Tolerance | str | Sequence[str | float | None]"


@dataclass(frozen=True)
class Tolerance:
    """Largest errors that are accepted: a translation (m), a rotation (rad), or both.

    With ``at`` (m) the length is that of a point so far ahead of the camera, else that of X itself.
    """

    translation: float | None
    rotation: float | None
    at: float | None = None

    def __post_init__(self) -> None:
        if self.translation is None and self.rotation is None:
            raise InputError("Expected a tolerance such as 1mm,0.1deg, got neither a length nor an angle.")
        for name in ("translation", "rotation", "at"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise InputError(f"Expected the tolerance to have a {name} above 0, got {value!r}.")
        if self.at is not None and self.translation is None:
            raise InputError("Expected a length in the tolerance beside `at` (--at), which is of a point; got none.")

    @classmethod
    def read(cls, tolerance: ToleranceLike, at: str | float | None = None) -> Tolerance:
        """Return a tolerance from text such as ``"1mm,0.1deg"``, numbers (m, rad), or as it is.

        Raises `InputError` on anything else.
        """
        distance = None if at is None else _length(at, "at")
        parts: list[str | float | None]
        match tolerance:
            case Tolerance():
                return tolerance if at is None else cls(tolerance.translation, tolerance.rotation, distance)
            case str():
                parts = [part.strip() for part in tolerance.split(",")]
            case _ if np.iterable(tolerance):
                parts = list(tolerance)
            case _:
                raise InputError(f"Expected a tolerance such as '1mm,0.1deg', got {tolerance!r}.")
        match parts:
            case [int() | float() | None as translation, int() | float() | None as rotation]:
                return cls(translation, rotation, distance)
        lengths, angles = [], []
        for part in parts:
            text = str(part)
            if text.endswith(tuple(ANGLE_UNITS)):
                angles.append(parse_angle(text, "tolerance"))
            else:
                lengths.append(_length(text, "tolerance"))
        if len(lengths) > 1 or len(angles) > 1:
            raise InputError(f"Expected a tolerance such as '1mm,0.1deg', got {tolerance!r}.")
        return cls(lengths[0] if lengths else None, angles[0] if angles else None, distance)

    def __str__(self) -> str:
        parts = []
        if self.translation is not None:
            parts.append(f"{digits(1e3 * self.translation, 3)} mm")
        if self.rotation is not None:
            parts.append(f"{digits(float(np.degrees(self.rotation)), 3)} deg")
        return " and ".join(parts)


@dataclass(frozen=True)
class Verdict(Record):
    """PASS, FAIL or NOT SHOWN, the probability that X lies within the tolerance, and why it is not shown."""

    _in_file: ClassVar[str] = (
        "verdict=word probability translation=tolerance.translation rotation=tolerance.rotation at=tolerance.at "
        "reasons sentence=shown"
    )

    word: Word
    probability: float | None  # None: not known
    tolerance: Tolerance
    reasons: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """True if the word is PASS."""
        return self.word == PASS

    @property
    def status(self) -> str:
        """The word as the status of an answer: ok, caution or failed."""
        return {PASS: "ok", FAIL: "failed"}.get(self.word, "caution")

    def __str__(self) -> str:
        return f"{self.word}: {self.sentence}"

    shown = property(__str__)

    @property
    def sentence(self) -> str:
        """Meaning of the word, with the probability."""
        of, tolerance = "X lies", str(self.tolerance)
        if self.tolerance.at is not None:
            of = f"a point {digits(self.tolerance.at, 3)} m ahead of the camera lies"
        known = "" if self.probability is None else f" with a probability of {percent(self.probability)}"
        if self.word == NOT_SHOWN and self.reasons:
            reached = f"; {of} within {tolerance}{known}, if that were all" if known else ""
            return f"{'; '.join(self.reasons)}{reached}."
        needs = f" ({percent(MET)} are needed)" if self.word != PASS else ""
        return f"{of} within {tolerance}{known}{needs}."


# A verdict on X, or on each camera by its name.
Verdicts: TypeAlias = Verdict | Mapping[str, Verdict]
# Of a result without a tolerance.
NO_VERDICTS: Mapping[str, Verdict] = MappingProxyType({})


def verdict_of(result: Checked, tolerance: ToleranceLike, at: str | float | None = None) -> Verdict:
    """Return whether X meets a tolerance; see the module.

    Raises `InputError` for a tolerance that cannot be read.
    """
    wanted = Tolerance.read(tolerance, at)
    reasons = [f"X is not usable: {reason}" for reason in result.reasons[:1]]
    probability = None
    if result.covariance is None:
        reasons.append("the covariance of X is not determined")
    elif result.opened is not None and result.opened.of_X.size:
        reasons.append(f"not determined: {'; '.join(result.open_words)}")
    elif not result.reference.determined:
        reasons.append("too few poses for this covariance")
    elif not reasons:
        probability = probability_of(result, wanted)
    if probability is not None and probability <= MISSED:  # what is not included would only add to the error
        return Verdict(FAIL, probability, wanted)
    failed = [check for check in result.checks if check.status == "failed"]
    if not reasons and failed:
        named = " and ".join(check.name for check in failed[:2])
        reasons.append(f"check failed: {named} ({failed[0].findings[0].phrase})")
    if not reasons and lower_limit_of(result):
        reasons.append("the accuracy is a lower limit: no shared error is included")
    if reasons or probability is None:
        return Verdict(NOT_SHOWN, probability, wanted, tuple(reasons))
    return Verdict(PASS if probability >= MET else NOT_SHOWN, probability, wanted)


def verdict_of_pose(one: EstimatedPose, reference: Reference, wanted: Tolerance, reasons: Sequence[str]) -> Verdict:
    """Return whether a pose of several meets a tolerance; ``reasons``: why it is not shown to meet any."""
    if len(one.open):
        return Verdict(NOT_SHOWN, None, wanted, (f"{one.name} is not determined in all directions",))
    probability = probability_within(one.covariance, reference, wanted, one.pose[:3, :3])
    if probability <= MISSED:
        return Verdict(FAIL, probability, wanted)
    if reasons:
        return Verdict(NOT_SHOWN, probability, wanted, tuple(reasons))
    return Verdict(PASS if probability >= MET else NOT_SHOWN, probability, wanted)


def probability_of(result: Estimated, tolerance: Tolerance) -> float:
    """Return the probability that X of a result with a covariance lies within a tolerance, by its posterior."""
    return _share_within(result.error_points, tolerance, result.X[:3, :3])


def probability_within(S: Array, reference: Reference, tolerance: Tolerance, R: Array) -> float:
    """Return the probability that an error of covariance S (6, 6) of X stays within the tolerance; R rotates X."""
    return _share_within(points_of(S, reference, None), tolerance, R)


def _share_within(xi: Array, tolerance: Tolerance, R: Array) -> float:
    """Return the share of errors (N, 6) that stay within the tolerance."""
    theta, move = xi[:, :3], xi[:, 3:] if tolerance.at is None else moved(xi, R[:, 2] * tolerance.at)
    inside = np.ones(len(xi), dtype=bool)
    if tolerance.rotation is not None:
        inside &= np.linalg.norm(theta, axis=1) <= tolerance.rotation
    if tolerance.translation is not None:
        inside &= np.linalg.norm(move, axis=1) <= tolerance.translation
    return float(inside.mean())


def percent(probability: float) -> str:
    """Return a probability in percent, 0 and 100 only as limits."""
    if probability > 0.999:
        return "more than 99.9 %"
    if probability < 0.001:
        return "less than 0.1 %"
    return f"{digits(100 * probability, 3)} %"


def _length(value: str | float, name: str) -> float:
    return parse_length(value, name) if isinstance(value, str) else float(value)
