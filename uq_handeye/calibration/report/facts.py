"""Facts of a calibration that its text, page, notebook and certificate show, computed once.

These are X and W as six numbers with their standard deviations, the least certain directions, and correlations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...core.geometry.conventions import COMPONENTS
from ...core.geometry.pose_numbers import POSE_NUMBERS, pose_numbers, principal_axes
from ...core.geometry.se3 import Array
from ...core.presentation.numbers import concise, digits, plus_minus, value_and_sd
from ...fit.diagnostics.result import UNKNOWN_FRAME
from ...fit.diagnostics.sentences import direction_words
from ..estimated import Estimated

if TYPE_CHECKING:
    pass

_SOURCES = {
    "model": "the noise given",
    "sandwich": "the residuals of the poses (sandwich)",
    "bootstrap": "the poses, drawn with replacement (bootstrap)",
}


class Fact(NamedTuple):
    """A number as people read it, with its standard deviation; its forms are those of every output."""

    name: str  # such as "rotation vector x"
    value: float  # mm or deg
    sd: float | None  # None: not known; infinite: the motions leave it open
    unit: str

    @property
    def concise(self) -> str:
        """Value, standard deviation in brackets and unit."""
        return concise(self._shown, self.sd, self.unit)

    @property
    def bare(self) -> str:
        """Value and standard deviation in brackets, for columns with a unit."""
        return concise(self._shown, self.sd)

    @property
    def plus_minus(self) -> str:
        """``12.345 +- 0.067``; the value alone where nothing is known of it."""
        if self.sd is None:
            return digits(self.value, 6)
        return f"{digits(self.value, 6)} (open)" if np.isinf(self.sd) else plus_minus(self.value, self.sd)

    @property
    def parts(self) -> tuple[str, str]:
        """Value and standard deviation of two digits, to the same place."""
        if self.sd is None or not np.isfinite(self.sd) or self.sd <= 0:
            return f"{self.value + 0.0:.4f}", "?" if self.sd is None else "open" if self.sd > 0 else "0"
        return value_and_sd(self.value, self.sd)

    @property
    def _shown(self) -> float:
        return round(self.value, 9) if self.sd is None else self.value  # what is exact ends in rounding errors


@dataclass(frozen=True)
class Facts:
    """Numbers and texts of a calibration that more than one view shows."""

    X: tuple[Fact, ...]  # translation and rotation vector
    W: tuple[Fact, ...]  # empty where there is no W
    parent: str  # frame that X and its covariance are in
    subject: str  # "camera in the gripper frame"; empty for motions that came without poses
    directions: tuple[str, ...]  # in which translation and rotation are least certain
    correlations: tuple[tuple[float, str, str], ...]  # of the components of (theta, tau), the strongest first
    ellipsoid: str  # what holds 95 % of all errors
    source: str  # where the standard deviations come from


def numbers_of(T: Array, covariance: Array | None, opened: Array | None) -> tuple[Fact, ...]:
    """Return the six numbers of a pose (4, 4), with its covariance (6, 6) and its open directions (k, 6)."""
    values, deviations = pose_numbers(T, covariance, opened=opened)
    known = [None] * 6 if deviations is None else deviations.tolist()
    return tuple(map(Fact, POSE_NUMBERS, values.tolist(), known, ["mm"] * 3 + ["deg"] * 3))


def facts_of(result: Estimated) -> Facts:
    """Return the facts of a calibration."""
    correlation, limit = result.correlation, result.quantile(0.95)
    parent, _, child = result.frame.partition("_T_") if "_T_" in result.frame else (UNKNOWN_FRAME, "", "")
    pairs = [] if correlation is None else [(i, j) for i in range(6) for j in range(i + 1, 6)]
    found = [(float(correlation[i, j]), COMPONENTS[i], COMPONENTS[j]) for i, j in pairs if correlation is not None]
    source = _SOURCES[result.covariance_kind]
    if result.noise_estimate is not None and result.covariance_kind == "model":
        source = "the noise estimated"
    ellipsoid = f"There is no 95 % ellipsoid from so few poses ({result.reference})."
    if np.isfinite(limit):
        ellipsoid = f"95 % of all errors lie within d^2 = {limit:.1f} ({result.reference})."
    return Facts(
        X=numbers_of(result.X, result.covariance, result.open_of_X),
        W=() if result.W is None else numbers_of(result.W, result.covariance_W, result.open_of_W),
        parent=f"{parent} frame" if child else parent,
        subject=f"{child} in the {parent} frame" if child else "",
        directions=() if result.opened is not None else _directions(result, parent),
        correlations=tuple(sorted(found, key=lambda pair: -abs(pair[0]))),
        ellipsoid=ellipsoid,
        source=source,
    )


def _directions(result: Estimated, parent: str) -> tuple[str, ...]:
    """The least certain directions of translation and of rotation, in words; nothing without a covariance."""
    if result.covariance is None:
        return ()
    sentences = []
    for name, part, factor in (("translation", slice(3, 6), 1e3), ("rotation", slice(0, 3), 180 / np.pi)):
        sd, axes = principal_axes(result.covariance[part, part])
        text = direction_words(name, factor * sd[0], factor * sd[-1], axes[0], parent)
        sentences.append(f"{text[0].upper()}{text[1:]}.")
    return tuple(sentences)
