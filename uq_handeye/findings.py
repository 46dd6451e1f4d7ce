"""Findings of tests, fits and runs: code, severity and values of each, from which its sentence is made.

Whoever finds something makes a `Finding`; whoever decides looks at its code, severity and values. A package words the
codes of its topics in its module ``sentences``, by functions that take the values by name, and says there all else of
the code (`Record`); or, where a template says it all (`Template`), by that:

    sentence("input_checks.half_turns", "{share:pct.0f} % of the motions rotate by more than 150 degrees.")

    @sentence("input_checks.repeated_rows", check=INPUT, phrase="{count} repeated {file} row{count:?|s}")
    def _(file: str, count: int, n: int) -> str:
        return f"{count} of {n} {file} poses repeat the row before exactly: they add no information."
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from string import Formatter
from typing import Any, ClassVar, Literal, SupportsFloat, TypeAlias, TypeVar, get_args

from .errors import InputError, InputWarning

# Residuals that are this many times as large as the noise explains make a failure of a caution.
GROSS_EXCESS = 5.0
# Digits of a printed number where nothing else is known of its accuracy.
SIGNIFICANT_DIGITS = 3
# Rank of failures that explain no other ones.
LAST_RANK = 99


Severity = Literal["note", "caution", "failure"]
Words = TypeVar("Words", str, Callable[..., str])


# Checks of a calibration that findings belong to, in the order in which they are shown; that of the camera is rare.
INPUT, OUTLIERS, NOISE, NEIGHBOURS = "input", "outliers", "noise level", "neighbours"
RESIDUALS, HALVES, MOTION, SHARED, CAMERA = "residuals", "two halves", "motion", "shared errors", "camera"
CHECKS = (INPUT, OUTLIERS, NOISE, NEIGHBOURS, RESIDUALS, HALVES, MOTION, SHARED)
# A check of several cameras: whether another set of poses explains the views better.
MINIMUM = "global minimum"

# Values of a finding: numbers, text, arrays, and lists and mappings of these, as its sentence takes them.
Values: TypeAlias = Mapping[str, Any]
# A template (`Template`), or a function of the values.
Said = str | Callable[[Values], str]


def digits(value: SupportsFloat, significant: int = SIGNIFICANT_DIGITS) -> str:
    """Format a number with the given significant digits, without an exponent where that is short."""
    x = float(value)
    if x == 0 or 1e-4 <= abs(x) < 1e6:
        whole = x != 0 and abs(x) >= 10 ** (significant - 1)
        return f"{x:.0f}" if whole else f"{x:.{significant}g}"
    return f"{x:.{significant - 1}e}"


def probability(p: float, significant: int = 1) -> str:
    """``p = 0.02``, or a bound where it is all but 0."""
    return f"p < {1e-15:g}" if p < 1e-15 else f"p = {p:.{significant}g}"


class Template(Formatter):
    """Text with values in braces, as `str.format` writes them, and with three more kinds of format.

    ``{x:deg.2g}``: in degrees where x is in rad (``mm``: of metres, ``pct``: of a share), then as usual.
    ``{x:~2}``, ``{x:mm~2}``: with so many significant digits (`digits`); ``{p:p}``: a probability. Of a list each
    number, with ", " or as ``{x:,}`` with ",". ``{x:?one|many}``: the first where x is 1, True or a list of one.
    """

    UNITS: ClassVar[dict[str, float]] = {"deg": 180.0 / math.pi, "mm": 1e3, "pct": 100.0}

    def format_field(self, value: Any, spec: str) -> str:
        if spec.startswith("?"):
            one = len(value) == 1 if isinstance(value, list) else value == 1
            return spec[1:].split("|")[0 if one else 1]
        if isinstance(value, list):
            return (
                ",".join(map(str, value)) if spec == "," else ", ".join(self.format_field(part, spec) for part in value)
            )
        unit = next((unit for unit in self.UNITS if spec.startswith(unit)), "")
        if unit:
            value, spec = self.UNITS[unit] * value, spec.removeprefix(unit)
        if spec == "p":
            return probability(value)
        return digits(value, int(spec[1:])) if spec.startswith("~") else format(value, spec)


_TEMPLATE = Template()


def filled(template: str, values: Values) -> str:
    """Return a template with its values."""
    return _TEMPLATE.vformat(template, (), values)


@dataclass(frozen=True)
class Record:
    """Texts and effects of the findings of one code, written where its sentence is.

    ``phrase``: at most about 55 characters, without a full stop. ``effect``: by how many of its stated standard
    deviations X may be off, or how many times too small these may be, as far as the finding says; 1 where the
    covariance contains it. It only orders findings. ``rejects``: a test says that the covariance of X is too small.
    ``remedy``: what to do; with ``first`` it is said before those of findings of more effect, which it may explain.
    ``rank``: place among failures, the decisive one first. ``rows``: values that are numbers of rows, or lists of
    these; a "row" is one in every finding. ``explains``: it is the cause of what the fit shows, which is then left out,
    and of other findings of the input that are ``explained`` (`without_consequences`).
    """

    words: str | Callable[..., str]
    check: str = INPUT
    phrase: Said = ""
    effect: float | Callable[[Values], float] = 1.0
    rejects: bool = False
    remedy: Said = ""
    rows: Sequence[str] = ()
    explains: bool | Callable[[Values], bool] = False
    explained: bool = False
    first: bool = False
    rank: int = LAST_RANK


def _said(what: Said, values: Values) -> str:
    try:
        return what(values) if callable(what) else filled(what, values)
    except _OF_ANOTHER_VERSION:
        return ""


# Raised by values that were read from a file of another version.
_OF_ANOTHER_VERSION = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError)

_RECORDS: dict[str, Record] = {}


@dataclass(frozen=True)
class Finding:
    """One thing that was found. Its text is ``str(finding)``; nothing is decided by that.

    Parameters
    ----------
    code : str
        ``package.what``; its sentence is registered by `sentence`.
    severity : "note", "caution" or "failure"
        Worth knowing; to be looked into; the numbers cannot be used as they are.
    values : mapping
        What the sentence says: text, finite numbers, None, and lists and mappings of these. Arrays and tuples become
        lists, so that what is read from JSON equals what was written.
    """

    code: str
    severity: Severity
    values: Values = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", _plain(self.values))

    def __str__(self) -> str:
        """The sentence; where this version has none for the code with these values, both as they are."""
        words = self.record.words
        try:
            return words(**self.values) if callable(words) else filled(words, self.values)
        except _OF_ANOTHER_VERSION:
            return _unworded(self)

    @property
    def record(self) -> Record:
        """Record of the code; an empty record for codes of other versions."""
        if self.code not in _RECORDS:
            _read_sentences()
        return _RECORDS.get(self.code, Record(_unknown))

    @property
    def phrase(self) -> str:
        """The finding in a short phrase; its code in words where there is none."""
        return _said(self.record.phrase, self.values) or self.code.rpartition(".")[2].replace("_", " ")

    @property
    def remedy(self) -> str:
        """Remedy; empty where that is not known."""
        return _said(self.record.remedy, self.values)

    @property
    def effect(self) -> float:
        """Number of standard deviations by which X may be off, as far as the finding says; infinite for a failure."""
        if self.severity == "failure":
            return math.inf
        effect = self.record.effect
        try:
            return float(effect(self.values) if callable(effect) else effect)
        except _OF_ANOTHER_VERSION:
            return 1.0

    @property
    def explains(self) -> bool:
        """True if it is the cause of what the fit shows."""
        explains = self.record.explains
        return bool(explains(self.values) if callable(explains) else explains)

    @property
    def rejects(self) -> bool:
        """True if it says that the covariance of X is too small: a test that failed."""
        if self.severity == "note":
            return False
        return self.severity == "failure" or (self.record.rejects and self.effect > 1.1)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, which `from_dict` reads."""
        return {"code": self.code, "severity": self.severity, "values": dict(self.values)}

    @classmethod
    def from_dict(cls, data: Any) -> Finding:
        """A stored finding, also one whose code this version does not know; raises `InputError` on anything else."""
        if not isinstance(data, Mapping) or set(data) != {"code", "severity", "values"}:
            raise InputError(f"Expected a finding with code, severity and values, got {data!r:.80}.")
        if not isinstance(data["code"], str) or data["severity"] not in get_args(Severity):
            raise InputError(
                f"Expected a finding of severity {', '.join(get_args(Severity))}, got {data['code']!r:.40} of severity "
                f"{data['severity']!r:.40}."
            )
        if not isinstance(data["values"], Mapping):
            raise InputError(f"Expected the values of finding {data['code']!r} by name, got {data['values']!r:.40}.")
        try:
            return cls(data["code"], data["severity"], data["values"])
        except (TypeError, ValueError) as error:
            raise InputError(f"Expected plain finite values in finding {data['code']!r}: {error}.") from error


def sentence(code: str, template: str | None = None, /, **about: Any) -> Callable[[Words], Words]:
    """Register the record of a code with its template, or as a decorator with the function that words it.

    ``about``: the other fields of `Record`.
    """

    def register(words: Words) -> Words:
        if code in _RECORDS:
            raise ValueError(f"{code!r} is worded twice.")
        _RECORDS[code] = Record(words, **about)
        return words

    if template is not None:
        register(template)
    return register


@cache
def _read_sentences() -> None:
    """Import the ``sentences`` of every package: a stored finding may be of one that was not imported yet."""
    top = Path(__file__).parent
    for path in sorted(top.rglob("*sentences.py")):
        import_module(".".join((__package__ or "", *path.relative_to(top).with_suffix("").parts)))


def _unknown(**values: Any) -> str:
    raise LookupError("this version does not know the code")


@sentence("stored.text")
def _(text: str) -> str:
    """Return the text of a file that was written before there were findings."""
    return text


def renumbered(finding: Finding, numbers: Sequence[int]) -> Finding:
    """Return a finding about some poses of a data set with their numbers in it: row k of these is ``numbers[k]``.

    Findings about motions keep their numbers.
    """
    if "motion" in (finding.values.get("item"), finding.values.get("what")):
        return finding
    keys = finding.record.rows

    def of_row(value: Any) -> Any:
        return [of_row(part) for part in value] if type(value) is list else int(numbers[value])

    def walk(value: Any) -> Any:
        match value:
            case list():
                return [walk(part) for part in value]
            case dict():
                return {k: of_row(part) if k == "row" or k in keys else walk(part) for k, part in value.items()}
        return value

    values = walk(finding.values)
    if "stretches" in values:  # first row, first one after it, shift
        values["stretches"] = [[of_row(a), of_row(b - 1) + 1, shift] for a, b, shift in values["stretches"]]
    return Finding(finding.code, finding.severity, values)


def without_consequences(findings: Iterable[Finding]) -> list[Finding]:
    """Return findings without those that are explained by a wrong reading of the files, a wrong file or wrong rows.

    Where one `explains` them all that is left out which the fit shows, such as the sizes of errors.
    """
    found = list(findings)
    causes = [finding for finding in found if finding.explains]
    if not causes:
        return found
    first = min(finding.record.rank for finding in causes)
    causes = [finding for finding in causes if finding.record.rank == first]
    of_input = [finding for finding in found if finding.record.check == INPUT and not finding.record.explained]
    return [finding for finding in found if any(finding is one for one in (*causes, *of_input))]


def step_after(findings: Sequence[Finding]) -> str | None:
    """Return the advice of the first of some findings that has one."""
    return next(filter(None, (finding.remedy for finding in findings)), None)


def texts(findings: Iterable[Finding]) -> tuple[str, ...]:
    """The sentences of those that are more than a note."""
    return tuple(str(finding) for finding in findings if finding.severity != "note")


def warn(findings: Iterable[Finding], stacklevel: int = 2) -> None:
    """Give an `InputWarning` for each that is more than a note; ``stacklevel`` as seen from the caller."""
    for finding in findings:
        if finding.severity != "note":
            warning = InputWarning(str(finding))
            warning.code = finding.code
            warnings.warn(warning, stacklevel=stacklevel + 1)


def _unworded(finding: Finding) -> str:
    values = ", ".join(f"{name} = {value!r}" for name, value in finding.values.items())
    return f"{finding.code}{': ' if values else ''}{values} (this version has no sentence for it)."


def _plain(value: Any) -> Any:
    """Lists, dictionaries and plain numbers; raises TypeError or ValueError on what JSON cannot hold."""
    if hasattr(value, "tolist"):  # of NumPy
        value = value.tolist()
    match value:
        case Mapping():
            return {str(name): _plain(part) for name, part in value.items()}
        case tuple() | list():
            return [_plain(part) for part in value]
        case float() if not math.isfinite(value):
            raise ValueError(f"{value!r} is not finite")
        case None | bool() | int() | float() | str():
            return value
    raise TypeError(f"{value!r:.40} is no plain value")
