"""What a test, a fit or a run found: a code, how serious it is, and its values; the words come last.

Whoever finds something makes a `Finding`; whoever decides looks at its code, severity and values. Each topic words its
own codes in one module, by functions that take the values by name:

    @sentence("monte_carlo.stable")
    def _(digits: int) -> str:
        return f"stable to {digits} digits"
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar, get_args

from .errors import InputError

Severity = Literal["note", "caution", "failure"]
Words = TypeVar("Words", bound=Callable[..., str])

_SENTENCES: dict[str, Callable[..., str]] = {}


@dataclass(frozen=True)
class Finding:
    """One thing that was found. Its text is ``str(finding)``; nothing is decided by that.

    Parameters
    ----------
    code : str
        ``topic.what``; its sentence is registered by `sentence`.
    severity : "note", "caution" or "failure"
        Worth knowing; to be looked into; the numbers cannot be used as they are.
    values : mapping
        What the sentence says, as plain JSON values: numbers, text, lists, None.
    """

    code: str
    severity: Severity
    values: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return _SENTENCES[self.code](**self.values)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON, which `from_dict` reads."""
        return {"code": self.code, "severity": self.severity, "values": dict(self.values)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Finding:
        """A stored finding. Raises `InputError` for a code or severity that is not known, or other fields."""
        if set(data) != {"code", "severity", "values"} or not isinstance(data["values"], Mapping):
            raise InputError(f"Expected a finding with code, severity and values, got {sorted(map(str, data))}.")
        if str(data["code"]) not in _SENTENCES or data["severity"] not in get_args(Severity):
            raise InputError(f"Expected a known finding, got {data['code']!r} of severity {data['severity']!r}.")
        return cls(str(data["code"]), data["severity"], dict(data["values"]))


def sentence(code: str) -> Callable[[Words], Words]:
    """Register the function that words a code; it takes the values by name."""

    def register(words: Words) -> Words:
        if code in _SENTENCES:
            raise ValueError(f"{code!r} is worded twice.")
        _SENTENCES[code] = words
        return words

    return register
