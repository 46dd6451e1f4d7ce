"""One line per pose (or motion): residual, how far it lies from where the others predict it, leverage, weight, flag."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import chdtri

from ..errors import InputError
from ..formatting.numbers import digits
from ..geometry.se3 import Array
from ..likelihood.gauss_helmert import Fit
from ..likelihood.robust import FULL, RobustFit, pose_distances

if TYPE_CHECKING:
    import pandas as pd


# Poses that a sentence names.
MOST_NAMED = 5


@dataclass(frozen=True, eq=False)
class PoseTable:
    """Arrays (n,), in the order of the data.

    The residual is that of ``G X C = W`` (of ``A X = X B`` for motions) after the fit. ``distance2`` is the squared
    Mahalanobis distance of the pose from where the other poses predict it: chi-square with 6 degrees of freedom for a
    good pose and true noise. ``flag`` is "kept", "outlier" (``distance2`` beyond its 99.9 % quantile, 22.5; no robust
    estimation was asked for), "downweighted (w)" or "rejected".
    """

    item: str  # "pose" or "motion"
    rotation: Array  # length of the rotation residual, rad
    translation: Array  # length of the translation residual, m
    distance2: Array
    leverage: Array  # share in the information about all unknowns; the sum is 1
    weight: Array  # in [0, 1]; 0: rejected
    flag: tuple[str, ...]
    limit: float = FULL  # of distance2, beyond which one is flagged
    scale: float = 1.0  # so many times the noise given was taken to judge by; 1 unless most residuals are that large

    def __len__(self) -> int:
        return len(self.flag)

    @property
    def flagged(self) -> list[int]:
        """Numbers, from 0, of those that are not simply kept."""
        return [k for k, flag in enumerate(self.flag) if flag != "kept"]

    @property
    def rejected(self) -> list[int]:
        """Numbers, from 0, of those that take no part in the estimate."""
        return [int(k) for k in np.flatnonzero(self.weight == 0)]

    @property
    def statements(self) -> list[str]:
        """Which stand out, and what was done about it, in words; nothing if none does (one in 1000 does by chance)."""
        said = []
        for word, what in (
            ("rejected", "not fit the others and took no part in the estimate"),
            ("downweighted", "not fit the others well and counted less"),
            ("outlier", "not fit the others; the estimate has them in, a robust one (robust=True, --robust) would not"),
        ):
            rows = [k for k in np.argsort(-self.distance2).tolist() if self.flag[k].startswith(word)]
            if not rows or (word == "outlier" and self.distance2[rows[0]] < self.limit_of_all):
                continue
            named = ", ".join(
                f"{self.item} {k} ({digits(np.degrees(self.rotation[k]), 2)} degrees, "
                f"{digits(1e3 * self.translation[k])} mm, d^2 = {digits(self.distance2[k])})"
                for k in rows[:MOST_NAMED]
            )
            more = f" and {len(rows) - MOST_NAMED} more" if len(rows) > MOST_NAMED else ""
            said.append(
                f"{len(rows)} of {len(self)} {self.item}s do {what}: {named}{more}, counted from 0. A good {self.item} "
                f"stays below d^2 = {self.limit:.3g} in 999 of 1000 cases. Look for a wrong detection or a row that "
                "belongs to another moment."
            )
        if self.scale > 1:
            said.append(
                f"The noise given is too small: most residuals are {self.scale:.2g} times as large as it allows. They "
                f"were judged by {self.scale:.2g} times the noise; the standard deviations of X are too small by "
                "about that factor."
            )
        return said

    @property
    def limit_of_all(self) -> float:
        """The d^2 that the largest of so many good poses exceeds once in 1000 data sets."""
        return float(chdtri(6, 1e-3 / max(len(self), 1)))

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table, one row per pose, units in the names of the columns."""
        import pandas as pd

        return pd.DataFrame(
            {
                self.item: np.arange(len(self)),
                "rotation_deg": np.degrees(self.rotation),
                "translation_mm": 1e3 * self.translation,
                "distance2": self.distance2,
                "leverage": self.leverage,
                "weight": self.weight,
                "flag": self.flag,
            }
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and text."""
        plain = {
            name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in asdict(self).items()
        }
        return plain | {"flag": list(self.flag)}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> PoseTable:
        """The inverse of `to_dict`."""
        columns = {name: np.asarray(data[name], dtype=float) for name in _COLUMNS}
        flag = tuple(str(text) for text in data["flag"])
        if any(values.shape != (len(flag),) or not np.isfinite(values).all() for values in columns.values()):
            raise InputError("The table of poses is damaged: its columns differ in length or hold NaN.")
        return cls(item=str(data["item"]), flag=flag, limit=float(data["limit"]), scale=float(data["scale"]), **columns)


_COLUMNS = ("rotation", "translation", "distance2", "leverage", "weight")


def pose_table(fit: Fit, robust: RobustFit | None) -> PoseTable:
    """Of a fit, robust or not."""
    n = fit.residual.shape[-2]
    if robust is not None:
        distance2, leverage, weight, flag = robust.distances, robust.leverage, robust.weights, robust.flags
    else:
        distance2, leverage = pose_distances(fit)
        weight = np.ones(n)
        flag = tuple("outlier" if far else "kept" for far in (distance2 > FULL).tolist())
    residual = np.linalg.norm(fit.residual.reshape(n, 2, 3), axis=-1)
    item = "motion" if fit.W is None else "pose"
    columns = (residual[:, 0], residual[:, 1], distance2, leverage, weight)
    judged = (FULL, 1.0) if robust is None else (robust.limit, robust.scale)
    return PoseTable(item, *columns, flag, *judged)
