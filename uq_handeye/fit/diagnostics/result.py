"""Result of the diagnostics of a fit: observability, influence, residual tests, systematic errors, and their findings.

All numbers are those of `diagnose`, which has the model. ``findings`` judge them; their texts are in `sentences`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.files.records import INFINITE, Record
from ...core.geometry.se3 import Array
from ...core.levels import CONTRADICTED, RARE
from ...errors import InputError
from ...findings import Finding, renumbered, texts
from ...model.errors.error_estimate import NOT_DECLARED, ErrorEstimate
from ...model.errors.keys import FOCAL_LENGTH, ROBOT_SCALE, TARGET_SCALE
from .residual_patterns import Autocorrelation, Normality, Regression

# What a finding holds.
Value: TypeAlias = str | float | Array | NDArray[np.intp] | list[dict[str, str | float]] | None
PROBED = (FOCAL_LENGTH, TARGET_SCALE, ROBOT_SCALE)
# The frame of X where motions come without poses.
UNKNOWN_FRAME = "parent frame of X"
# A pose that moves X by more standard deviations when it is left out is named.
STRONG_SHIFT_SD = 1.5


@dataclass(frozen=True, eq=False)
class Spectrum(Record):
    """Principal axes of the covariance of X, least certain first; ``axes`` hold one unit vector per row."""

    frame: str
    sd_rotation_deg: Annotated[Array, 3]  # (3,)
    axes_rotation: Annotated[Array, 3, 3]  # (3, 3)
    sd_translation_mm: Annotated[Array, 3]  # (3,)
    axes_translation: Annotated[Array, 3, 3]  # (3, 3)
    length_m: float  # rotations are multiplied by it in the joint spectrum
    length_of: str  # "target", "motions" or "nothing": a key of LENGTHS in `sentences`
    sd_joint_mm: Annotated[Array, 6]  # (6,)
    axes_joint: Annotated[Array, 6, 6]  # (6, 6) of (length theta, tau)
    condition: Annotated[float, INFINITE]  # largest by smallest of sd_joint_mm

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The least certain directions, and rotation and translation at one scale."""
        directions = (
            _note(
                "direction", what=what, largest=sd[0], smallest=sd[-1], axis=axes[0], frame=self.frame
            )
            for what, sd, axes in (
                ("translation", self.sd_translation_mm, self.axes_translation),
                ("rotation", self.sd_rotation_deg, self.axes_rotation),
            )
        )  # fmt: skip
        joint = _note(
            "joint_spectrum",
            length_m=self.length_m,
            length_of=self.length_of,
            largest=self.sd_joint_mm[0],
            smallest=self.sd_joint_mm[-1],
        )
        return (*directions, joint)


@dataclass(frozen=True, eq=False)
class Influence(Record):
    """Influence of each pose (or motion): its share of the information about X, and the change of X when it is left
    out.
    """

    share: Annotated[Array, "n"]  # (n,), sums to 1
    effective_number: float  # 1 / sum share^2
    shift: Annotated[Array, "n", 6, INFINITE]  # of X, rad and m; infinite where X is open without the row
    shift_sd: Annotated[Array, "n", INFINITE]  # (n,) sqrt(shift^T C_XX^-1 shift): in standard deviations of X
    cook: Annotated[Array, "n", INFINITE]  # (n,) shift^T C_XX^-1 shift / 6
    p_value: Annotated[Array, "n"]  # (n,) of the row's residual given all others, chi-square(6) if the noise is right

    def findings(self, n: int, item: str) -> tuple[Finding, ...]:
        """Report how the information is spread over n rows, those that are needed, and those that move X most."""
        most = int(self.share.argmax())
        found = [
            _note(
                "information", item=item, n=n, effective=self.effective_number, row=most, share=self.share[most]
            )
        ]  # fmt: skip
        needed = np.flatnonzero(np.isinf(self.shift_sd))
        if needed.size:
            found.append(_caution("needed_rows", item=item, rows=needed))
        strong = np.flatnonzero(np.isfinite(self.shift_sd) & (self.shift_sd > STRONG_SHIFT_SD))
        for k in strong[np.argsort(-self.shift_sd[strong])][:3].tolist():
            values = {
                "item": item,
                "row": k,
                "shift_sd": self.shift_sd[k],
                "rotation": np.linalg.norm(self.shift[k, :3]),
                "translation": np.linalg.norm(self.shift[k, 3:]),
                "p_value": self.p_value[k],
            }
            wrong = self.p_value[k] < CONTRADICTED.probability / n
            found.append(_caution("wrong_row", **values) if wrong else _note("strong_row", **values))
        return tuple(found)


@dataclass(frozen=True, eq=False)
class Diversity(Record):
    """Eigenvalues and axes (rows) of ``sum u u^T`` scaled to trace 1, ``u = sin(angle/2) axis`` of robot motions."""

    share: Annotated[Array, 3]  # (3,) largest first
    axes: Annotated[Array, 3, 3]  # (3, 3)


@dataclass(frozen=True, eq=False)
class Diagnostics(Record):
    """All of `diagnose`, and in ``findings`` what it comes to; ``sentences()`` says it in words."""

    _if_any: ClassVar[str] = "numbers"

    n: int
    item: str  # "pose" or "motion"
    sigma_0: float  # root of chi-square of the fit by its degrees of freedom
    spectrum: Spectrum
    influence: Influence
    diversity: Diversity
    autocorrelation: Autocorrelation
    normality: Normality
    regression: Regression
    probes: tuple[ErrorEstimate, ...]  # of the errors `PROBED`, as `scale_errors` makes them
    numbers: tuple[int, ...] | None = None  # of the rows in the data, where some of the data are excluded

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """Everything that was found; what a user should act upon is more than a note."""
        found = self._findings()
        return found if self.numbers is None else tuple(renumbered(finding, self.numbers) for finding in found)

    def _findings(self) -> tuple[Finding, ...]:
        turning = _note("turning", share=self.diversity.share, axis=self.diversity.axes[0], frame=self.frame)
        return (
            *self.spectrum.findings,
            *self.influence.findings(self.n, self.item),
            turning,
            *self._of_residuals(),
            *self._of_shared_errors(),
        )

    @property
    def asked_for(self) -> tuple[ErrorEstimate, ...]:
        """Shared errors that were not declared and that the residuals indicate beyond chance."""
        return tuple(
            probe
            for probe in self.probes
            if probe.status == NOT_DECLARED
            and probe.alone is not None
            and probe.alone_sd is not None
            and probe.alone**2 > RARE.chi_square(1) * probe.alone_sd**2
        )

    @property
    def correlated(self) -> bool:
        """True if neighbouring residuals are correlated beyond chance."""
        p_value = self.autocorrelation.p_value
        return p_value is not None and p_value < CONTRADICTED.probability

    @property
    def not_run(self) -> tuple[Finding, ...]:
        """Reasons why tests of the residuals were not run."""
        tests = (self.autocorrelation, self.normality, self.regression)
        return tuple(test.reason for test in tests if test.reason is not None)

    def sentences(self) -> list[str]:
        """All findings in words."""
        return [str(finding) for finding in self.findings]

    def warnings(self) -> list[str]:
        """Return the sentences that a user should act upon."""
        return list(texts(self.findings))

    def _possible(self) -> Diagnostics:
        numbers = self.numbers
        if numbers is not None and (len(numbers) != self.n or min(numbers, default=0) < 0):
            raise InputError(f"Expected {self.n} row numbers among the diagnostics, got {numbers!r:.60}.")
        if tuple(probe.key for probe in self.probes) != PROBED:
            raise InputError(f"Expected the errors of {', '.join(map(str, PROBED))} among the diagnostics.")
        for name in ("autocorrelation", "normality", "regression"):
            test = getattr(self, name)
            empty = any(value is None or np.size(value) == 0 for key, value in vars(test).items() if key != "reason")
            if test.reason is None and empty:
                raise InputError(f"Expected the {name} of the residuals among the diagnostics, or why it is not known.")
        return self

    @property
    def frame(self) -> str:
        """The parent frame of X."""
        return self.spectrum.frame

    def _of_residuals(self) -> list[Finding]:
        a, m = self.autocorrelation, self.normality
        found = []
        if a.reason is not None:
            found.append(a.reason)
        elif self.correlated:
            values = {"lag_1": a.correlation[0], "p_value": a.p_value, "growth": a.growth, "n": self.n}
            values |= {"untimed": True} if a.untimed else {}
            found.append(_caution("correlated", item=self.item, **values))
        else:
            found.append(_note("uncorrelated", lag_1=a.correlation[0], standard_error=a.standard_error[0]))
        if m.reason is not None:
            found.append(m.reason)
            return found + self._of_pattern()
        assert m.p_value is not None and m.p_kurtosis is not None and m.p_skewness is not None
        if m.p_value < CONTRADICTED.probability:
            tails = m.excess_kurtosis if m.p_kurtosis < max(m.p_skewness, CONTRADICTED.probability) else None
            skewed = np.abs(m.skewness).max() if m.p_skewness < max(m.p_kurtosis, CONTRADICTED.probability) else None
            found.append(_caution("not_gaussian", p_value=m.p_value, excess_kurtosis=tails, skewness=skewed))
        else:
            found.append(_note("gaussian", p_value=m.p_value))
        return found + self._of_pattern()

    def _of_pattern(self) -> list[Finding]:
        g = self.regression
        if g.reason is not None:
            return [g.reason]
        assert g.p_value is not None
        if g.p_value >= RARE.probability:
            return [_note("no_pattern", item=self.item)]
        values = {"r_squared": g.r_squared, "chance": g.chance, "p_value": g.p_value}
        return [_caution("pattern", item=self.item, correlated=self.correlated, **values)]

    def _of_shared_errors(self) -> list[Finding]:
        errors: list[dict[str, str | float]] = [
            {"name": probe.name, "estimate": probe.alone, "sd": probe.alone_sd}
            for probe in self.asked_for
            if probe.alone is not None and probe.alone_sd is not None
        ]
        return [_caution("undeclared", errors=errors)] if errors else []


def _note(what: str, /, **values: Value) -> Finding:
    return Finding(f"diagnostics.{what}", "note", values)


def _caution(what: str, /, **values: Value) -> Finding:
    return Finding(f"diagnostics.{what}", "caution", values)
