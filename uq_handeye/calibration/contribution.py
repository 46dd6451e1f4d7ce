"""`Contribution`, what one source of error contributes to the uncertainty of X."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from ..core.files.records import Record
from ..fit.diagnostics.budget import Source
from ..model.errors.key import ErrorKey
from ..model.errors.key_text import part_text, text_of_source


class Input(NamedTuple):
    """One input of a budget: its standard uncertainty in words, its distribution, and where both come from."""

    uncertainty: str = ""
    distribution: str = ""
    origin: str = ""


@dataclass(frozen=True)
class Contribution(Record):
    """Standard uncertainty that one source of error gives X, along the directions in which X is least certain.

    A part of the accuracy, or a row of the budget, which has what follows ``stated`` as well.
    """

    _in_file: ClassVar[str] = "name source translation rotation"

    source: Source
    translation: float  # m
    rotation: float  # rad
    stated: str = ""  # the source with its size, where it is one of the errors that are included
    type: str = ""  # "A", "B" or "A, B"
    input: Input = Input()  # noqa: RUF009  # a tuple of texts
    dof: float = float("inf")
    share_translation: float = 0.0
    share_rotation: float = 0.0

    @property
    def key(self) -> ErrorKey:
        """The error, or the first of some that the data cannot separate."""
        return self.source[0]

    @property
    def name(self) -> str:
        """The source in words."""
        return text_of_source(part_text(key.owner, key.kind, str(key)) for key in self.source)
