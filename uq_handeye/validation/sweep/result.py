"""Result of `sweep`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..._version import __version__
from ...errors import InputError
from ...files.atomic import json_text
from ...files.records import attributes
from ...geometry.conventions import CONVENTION
from ...noise.models import Noise
from ...presentation.document import COLUMNS, WIDTH, document_of, to_text
from ...presentation.notebook import to_html
from ..monte_carlo.consistency import PARTS
from ..noise_of_data import NoiseOfData
from .level import CONFIDENCE, KINDS, level_dict
from .limits import MethodSweep, _ends

if TYPE_CHECKING:
    import pandas as pd


_FORMAT = "uq-handeye sweep 1"


@dataclass(frozen=True, eq=False)
class Sweep:
    """Limits of first order and sigma points for some methods; see `sweep`."""

    methods: tuple[MethodSweep, ...]
    factors: tuple[float, ...]  # as asked for, and 1
    noise: Noise  # as it is, factor 1
    noise_estimated: bool
    frame: str  # of X
    count: int  # poses or motions
    item: str  # "poses" or "motions"
    around: str  # "truth of the simulation" or "fit to the data"
    trials: int
    seed: int
    tolerance: float
    noise_of_data: NoiseOfData | None = None  # checks of the noise against the data

    def __getitem__(self, method: str) -> MethodSweep:
        for found in self.methods:
            if found.method == method:
                return found
        known = ", ".join(found.method for found in self.methods)
        raise InputError(f"Expected `method` to be one of {known}, got {method!r}.")

    def __repr__(self) -> str:
        ends = ", ".join(f"{found.method} {_ends(found.limit(KINDS[0]))}" for found in self.methods)
        return f"Sweep({self.trials:,} trials per level, covariance of the noise times a factor; first order: {ends})"

    def _repr_html_(self) -> str:
        """Return the verdict and the sentences of the methods, with their levels folded, for notebooks."""
        return to_html("Sweep of the noise", document_of(self, verbose=True), seen=2 + len(self.methods))

    def summary(self, verbose: bool = False) -> str:
        """Return the noise that each covariance is valid for as text of 80 columns; ``verbose``: all levels, too."""
        return to_text(document_of(self, verbose=verbose), WIDTH if verbose else COLUMNS)

    def __str__(self) -> str:
        return self.summary()

    def figure(self, path: str | Path) -> Path:
        """Write the mean NEES against the noise as ``.png`` or ``.svg``."""
        from .figure import figure

        return figure(self, path)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, lists and text, with units and convention."""
        return {
            "format": _FORMAT,
            "version": __version__,
            "convention": CONVENTION,
            "units": {"rotation": "rad", "translation": "m"},
            **attributes(self, "frame around count item noise noise_estimated factors trials seed tolerance"),
            "confidence": CONFIDENCE,
            **attributes(self, "noise_of_data"),
            "methods": [
                {
                    "method": found.method,
                    "limits": {
                        kind: {"holds": (end := found.limit(kind)).holds, "fails": end.fails, "heavy_tails": end.heavy}
                        for kind in KINDS
                    },
                    "levels": [level_dict(level) for level in found.levels],
                }
                for found in self.methods
            ],
        }

    def to_json(self, path: str | Path | None = None) -> str:
        """JSON text, also written to ``path`` (whole or not at all)."""
        return json_text(self.to_dict(), path)

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table, one row per method, level and kind of covariance; factors are of the noise covariance."""
        import pandas as pd

        rows = []
        for found in self.methods:
            for level in found.levels:
                row = level_dict(level)
                for kind in KINDS:
                    tested = row[kind]
                    nees = tested["mean_nees"] or [None] * len(PARTS)
                    worst = tested["worst"] or [None, None]
                    rows.append(
                        {
                            "method": found.method,
                            "factor": level.factor,
                            "sd_factor": level.deviations,
                            "kind": kind,
                            "holds": tested["holds"],
                            **{f"mean_nees_{part}": value for part, value in zip(PARTS, nees, strict=True)},
                            "least_ratio": worst[0],
                            "largest_ratio": worst[1],
                            "coverage_95": tested["coverage_95"],
                            "bias_sd": level.bias,
                            "failed": level.failed,
                            "heavy_tails": level.heavy,
                            "reason": tested["reason"],
                        }
                    )
        return pd.DataFrame(rows)
