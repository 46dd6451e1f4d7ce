"""All methods on the same data: the result."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..._version import __version__
from ...calibration.statement.checks import Check
from ...core.files.atomic import json_text, write_atomically
from ...core.files.lines import frame_text
from ...core.files.records import attributes
from ...core.geometry.conventions import CONVENTION
from ...core.presentation.document import COLUMNS, WIDTH, document_of, to_text
from ...core.presentation.notebook import to_html
from ...errors import InputError
from ...model.noise.models import Noise
from .row import CHI2_95, Row, against, flat, verdict, without_numbers

if TYPE_CHECKING:
    import pandas as pd


_FORMAT = "uq-handeye comparison 1"


class UnknownMethodError(InputError, KeyError):
    """A comparison was asked for a method that it does not have; the message lists those that it has."""

    def __str__(self) -> str:  # KeyError would quote it
        return str(self.args[0])


@dataclass(frozen=True, eq=False)
class Comparison:
    """One row per method, in the order asked for; see `compare`."""

    rows: tuple[Row, ...]
    reference: str | None  # what the differences are taken from; None: every method failed
    asked_reference: str  # differs from `reference` where that method failed
    frame: str  # e.g. gripper_T_camera
    setup: str | None  # None for motions that came without poses
    n_poses: int | None
    n_pairs: int  # that every method used
    n_pairs_available: int  # more than `n_pairs` where these were thinned out
    noise: Noise | None  # given or estimated
    noise_estimated: bool = False
    warnings: tuple[str, ...] = ()  # about the data, as calibrate() gives them for the reference
    checks: tuple[Check, ...] = ()  # those of calibrate() on the data; empty where it gave no result

    def __getitem__(self, method: str) -> Row:
        for row in self.rows:
            if row.method == method:
                return row
        names = ", ".join(row.method for row in self.rows)
        raise UnknownMethodError(f"Expected the name of a method compared, one of {names}; got {method!r}.")

    def __contains__(self, method: object) -> bool:
        return any(row.method == method for row in self.rows)

    def __repr__(self) -> str:
        return f"Comparison({len(self.rows)} methods, reference {self.reference}, {self.n_pairs} pairs)"

    def _repr_html_(self) -> str:
        """Return verdict and table, with everything else folded, for notebooks."""
        return to_html("Comparison of methods", document_of(self, verbose=True), seen=3 if self.warnings else 2)

    @property
    def base(self) -> Row | None:
        """The row of the reference."""
        return None if self.reference is None else self[self.reference]

    @property
    def origin(self) -> str:
        """Description of the data that the methods were given, e.g. ``300 pairs of 25 poses, eye-in-hand``."""
        pairs = f"{self.n_pairs:,} pairs"
        if self.n_pairs_available > self.n_pairs:
            pairs = f"{self.n_pairs:,} of the {self.n_pairs_available:,} pairs"
        poses = "" if self.n_poses is None else f" of {self.n_poses} poses"
        setup = "" if self.setup is None else f", {self.setup}"
        return f"{pairs}{poses}{setup}" + (", noise estimated from them" if self.noise_estimated else "")

    @property
    def own_warnings(self) -> list[str]:
        """Warnings of single methods beyond the common ones, each kind once with the names of its methods."""
        first: dict[str, str] = {}
        names: dict[str, list[str]] = {}
        for row in self.rows:
            for text in row.warnings:
                first.setdefault(without_numbers(text), text)
                names.setdefault(without_numbers(text), []).append(row.method)
        return [f"{', '.join(names[kind])}: {text}" for kind, text in first.items()]

    @property
    def most_central(self) -> tuple[str, int] | None:
        """The method that most others would agree with as the reference, and how many; None without covariances."""
        rows = [row for row in self.rows if row.covariance is not None and row.failure is None]
        counts = {base.method: sum(bool(against(row, base).agrees) for row in rows) - 1 for base in rows}
        return max(counts.items(), key=lambda item: item[1], default=None)

    @property
    def verdict(self) -> str:
        """Verdict in words: which methods agree, differ or failed."""
        return verdict(self.rows, self.reference, self.noise is not None)

    @property
    def doubts(self) -> tuple[Check, ...]:
        """The checks that warn, failed ones first."""
        return tuple(check for status in ("failed", "caution") for check in self.checks if check.status == status)

    def to_text(self, verbose: bool = False) -> str:
        """Return verdict and table as text of 80 columns; ``verbose``: all numbers, X, the legend and the warnings."""
        return to_text(document_of(self, verbose=verbose), WIDTH if verbose else COLUMNS)

    def __str__(self) -> str:
        return self.to_text()

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, lists and text, with units and convention."""
        return {
            "format": _FORMAT,
            "version": __version__,
            "convention": CONVENTION,
            "units": {"rotation": "rad", "translation": "m", "time": "s"},
            **attributes(
                self,
                "reference asked_reference frame setup n_poses n_pairs n_pairs_available noise noise_estimated",
            ),
            "agrees_up_to_d2": CHI2_95,
            **attributes(self, "verdict warnings checks methods=rows"),
        }

    def to_json(self, path: str | Path | None = None) -> str:
        """JSON text, also written to ``path`` (whole or not at all)."""
        return json_text(self.to_dict(), path)

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table, one row per method, units in the names of the columns."""
        import pandas as pd

        return pd.DataFrame([flat(row, self.base) for row in self.rows])

    def to_csv(self, path: str | Path | None = None) -> str:
        """`to_dataframe` as CSV text, also written to ``path`` (whole or not at all); empty: not known."""
        text = frame_text(self.to_dataframe())
        if path is not None:
            write_atomically(path, text)
        return text
