"""Result of a cross-check: every covariance of one problem, and the relations between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ....core.files.json_values import JsonObject
from ....core.files.records import attributes
from ....core.geometry.se3 import Array
from ....findings import Finding
from ....model.errors.models import Noise
from ..monte_carlo.run import MonteCarlo
from ..outcome import NoiseOfData, Outcome, one_of
from .relations import Relation
from .rows import Row

if TYPE_CHECKING:
    import pandas as pd

    from ..posterior.result import Posterior


@dataclass(frozen=True, eq=False)
class CrossCheck(Outcome):
    """Every covariance of one problem, and the relations between them; see `cross_check`."""

    title: ClassVar[str] = "Cross-check"
    kind: ClassVar[str] = "cross-check"

    rows: tuple[Row, ...]
    relations: tuple[Relation, ...]
    runs: dict[str, MonteCarlo]  # by method
    posterior: Posterior | None
    X: Array  # (4, 4) around which noise is drawn
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
        return one_of({row.key: row for row in self.rows}, key, "the key of a row, one of")

    def relation(self, name: str) -> Relation:
        """Return a relation by its name. Raises `InputError` with the names there are."""
        return one_of({relation.name: relation for relation in self.relations}, name, "the name of a relation, one of")

    def __repr__(self) -> str:
        state = f"broken: {', '.join(self.broken)}" if self.broken else "no relation broken"
        state += "" if self.complete else f"; not complete: {self.reason}"
        return f"CrossCheck({len(self.rows)} rows, {self.trials:,} trials, {state})"

    def to_text(self, verbose: bool = False) -> str:
        """Return the same as `summary`."""
        return self.summary(verbose)

    def to_dict(self) -> JsonObject:
        """Everything but single trials and samples as plain numbers, lists and text, with units and convention."""
        return self.head(time="s") | attributes(
            self,
            "frame setup origin noise noise_estimated noise_of_data n pairs trials seed seconds complete reason ended "
            "broken rows relations",
        )

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table, one line per row, in rad, m and s; what there is not is missing."""
        import pandas as pd

        names = [f"std_{part}_{axis}" for part in ("rotation", "translation") for axis in "xyz"]
        lines = []
        for row in self.rows:
            plain = row.to_dict()
            for part in ("std", "nees_interval", "covariance"):
                del plain[part]
            plain |= dict(zip(names, [None] * 6 if row.std is None else row.std, strict=True))
            plain |= dict(zip(("nees_low", "nees_high"), row.nees_interval or (None, None), strict=True))
            lines.append(plain)
        return pd.DataFrame(lines).set_index("key")
