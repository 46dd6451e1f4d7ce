"""Result of `cross_check`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...._version import __version__
from ....core.files.atomic import json_text
from ....core.files.records import attributes
from ....core.geometry.conventions import CONVENTION
from ....core.presentation.document import COLUMNS, WIDTH, document_of, to_text
from ....core.presentation.notebook import to_html
from ....errors import InputError
from ....findings import Finding
from ....model.noise.models import Noise
from ..monte_carlo.run import MonteCarlo
from ..noise_of_data import NoiseOfData
from .relations import Relation
from .rows import Row

if TYPE_CHECKING:
    import pandas as pd

    from ..posterior.result import Posterior


_FORMAT = "uq-handeye cross-check 1"


@dataclass(frozen=True, eq=False)
class CrossCheck:
    """Every covariance of one problem and what they have to do with each other; see `cross_check`."""

    rows: tuple[Row, ...]
    relations: tuple[Relation, ...]
    runs: dict[str, MonteCarlo]  # by method
    posterior: Posterior | None
    frame: str  # of X, e.g. gripper_T_camera
    setup: str | None  # None for motions
    origin: str  # "truth of the simulation" or "fit to the data"
    noise: Noise
    noise_estimated: bool
    n: int  # poses, or motions
    pairs: int
    trials: int  # asked of every method
    seed: int
    seconds: float
    noise_of_data: NoiseOfData | None = None  # checks of the noise against the data
    ended: Finding | None = None  # how, if not all trials that were wanted, or not the posterior, were done

    @property
    def complete(self) -> bool:
        """True if all trials that were wanted, and the posterior, were done."""
        return self.ended is None

    @property
    def reason(self) -> str:
        """Reason in words why it is not complete; empty if it is."""
        return "" if self.ended is None else str(self.ended)

    @property
    def broken(self) -> tuple[str, ...]:
        """Names of the relations that must hold and do not; claims are not among them."""
        return tuple(relation.name for relation in self.relations if relation.law and relation.holds is False)

    def row(self, key: str) -> Row:
        """Return a row by its key. Raises `InputError` with the keys there are."""
        for row in self.rows:
            if row.key == key:
                return row
        raise InputError(f"Expected the key of a row, one of {', '.join(row.key for row in self.rows)}, got {key!r}.")

    def relation(self, name: str) -> Relation:
        """Return a relation by its name. Raises `InputError` with the names there are."""
        for relation in self.relations:
            if relation.name == name:
                return relation
        names = ", ".join(relation.name for relation in self.relations)
        raise InputError(f"Expected the name of a relation, one of {names}, got {name!r}.")

    def __repr__(self) -> str:
        state = f"broken: {', '.join(self.broken)}" if self.broken else "no relation broken"
        state += "" if self.complete else f"; not complete: {self.reason}"
        return f"CrossCheck({len(self.rows)} rows, {self.trials:,} trials, {state})"

    def _repr_html_(self) -> str:
        """Return the verdict, with everything else folded, for notebooks."""
        return to_html("Cross-check", document_of(self, verbose=True))

    def to_text(self, verbose: bool = False) -> str:
        """Return the verdict and the table as text of 80 columns; ``verbose``: also the relations with numbers."""
        return to_text(document_of(self, verbose=verbose), WIDTH if verbose else COLUMNS)

    def __str__(self) -> str:
        return self.to_text()

    summary = to_text

    def figure(self, path: str | Path) -> None:
        """Write the ellipses of all 15 pairs of components as PNG or SVG, by the ending of the name."""
        from .figure import save

        save(self, path)

    def to_dict(self) -> dict[str, Any]:
        """Everything but single trials and samples as plain numbers, lists and text, with units and convention."""
        return {
            "format": _FORMAT,
            "version": __version__,
            "convention": CONVENTION,
            "units": {"rotation": "rad", "translation": "m", "time": "s"},
            **attributes(
                self,
                "frame setup origin noise noise_estimated noise_of_data n pairs trials seed seconds complete reason "
                "ended broken rows relations",
            ),
        }

    def to_json(self, path: str | Path | None = None) -> str:
        """JSON text, also written to ``path`` (whole or not at all)."""
        return json_text(self.to_dict(), path)

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table, one line per row, in rad, m and s; what there is not is missing."""
        import pandas as pd

        names = [f"std_{part}_{axis}" for part in ("rotation", "translation") for axis in "xyz"]
        lines = []
        for row in self.rows:
            plain = row.to_dict()
            std, interval = plain.pop("std"), plain.pop("nees_interval")
            del plain["covariance"]
            plain |= dict(zip(names, std or [None] * 6, strict=True))
            plain |= dict(zip(("nees_low", "nees_high"), interval or (None, None), strict=True))
            lines.append(plain)
        return pd.DataFrame(lines).set_index("key")
