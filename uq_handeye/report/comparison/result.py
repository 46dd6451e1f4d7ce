"""All methods on the same data: the result of each, its distance from the reference, and the verdict on all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..._version import __version__
from ...calibration.checks import Check
from ...core.files.atomic import write_atomically
from ...core.files.csv_text import frame_text
from ...core.files.json_files import json_text
from ...core.files.json_values import JsonObject
from ...core.files.records import Record, attributes
from ...core.geometry.conventions import CONVENTION
from ...core.geometry.pose_numbers import pose_numbers, principal_axes
from ...core.geometry.se3 import Array, difference
from ...core.levels import UNUSUAL
from ...core.presentation.document import COLUMNS, WIDTH, document_of, to_text
from ...core.presentation.html import to_html
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M
from ...core.rounding import CHAIN_ROUNDING, SOLUTION_ROUNDING
from ...errors import InputError
from ...model.errors.models import Noise
from ...model.poses.residuals import Residuals

if TYPE_CHECKING:
    import pandas as pd

# 95 % quantile of chi-square with 6 degrees of freedom.
CHI2_95 = UNUSUAL.chi_square(6)
_FORMAT = "uq-handeye comparison 1"


@dataclass(frozen=True, eq=False)
class Comparison:
    """One row per method, in the requested order; see `compare`."""

    rows: tuple[Row, ...]
    reference: str | None  # what the differences are taken from; None: every method failed
    requested_reference: str  # differs from `reference` where that method failed
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
        raise InputError(f"Expected the name of a method compared, one of {names}; got {method!r}.")

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
            for kind, text in zip(row.kinds, row.warnings, strict=True):
                first.setdefault(kind, text.replace(f"method '{row.method}'", "the method"))
                names.setdefault(kind, []).append(row.method)
        return [f"{', '.join(names[kind])}: {text}" for kind, text in first.items()]

    @property
    def most_central(self) -> tuple[str, int] | None:
        """The method with which most others agree as the reference, and their number; None without covariances."""
        rows = [row for row in self.rows if row.covariance is not None and row.failure is None]
        counts = {base.method: sum(bool(against(row, base).agrees) for row in rows) - 1 for base in rows}
        return max(counts.items(), key=lambda item: item[1], default=None)

    @property
    def verdict(self) -> str:
        """Sentence with the methods that agree, differ or failed."""
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

    def to_dict(self) -> JsonObject:
        """Everything as plain numbers, lists and text, with units and convention."""
        return {
            "format": _FORMAT,
            "version": __version__,
            "convention": CONVENTION,
            "units": {"rotation": "rad", "translation": "m", "time": "s"},
            **attributes(
                self,
                "reference requested_reference frame setup n_poses n_pairs n_pairs_available noise noise_estimated",
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


_XYZ = "xyz"
_TURN, _MOVE = slice(0, 3), slice(3, 6)


@dataclass(frozen=True, eq=False)
class Row(Record):
    """Result of one method on the data. Angles in rad, lengths in m."""

    _in_file: ClassVar[str] = (
        "method year structure form status X covariance std difference=xi difference_rotation difference_translation "
        "d2 agrees residuals seconds converged iterations failure warnings"
    )

    method: str
    year: int | None  # None: of this toolkit
    structure: str  # "separated" or "simultaneous"
    form: str  # "closed form", "iterative" or "convex program"
    X: Array | None = None  # (4, 4); with a failure: what the method came to all the same, if anything
    covariance: Array | None = None  # (6, 6) of (theta, tau), the method's own; None without noise
    residuals: Residuals | None = None
    seconds: float | None = None  # of the estimator only
    converged: bool | None = None
    iterations: int | None = None  # 0 in closed form
    not_run: bool = False  # its extra is not installed
    failure: str | None = None  # why there is no result, or none to rely on
    warnings: tuple[str, ...] = ()  # beyond those of the comparison
    kinds: tuple[str, ...] = ()  # of the warnings: codes of their findings, or the text
    xi: Array | None = None  # (6,) difference (theta, tau) from the reference
    d2: float | None = None  # xi^T covariance^-1 xi; infinite where the covariance leaves no room
    agrees: bool | None = None  # d2 <= CHI2_95; None: not known

    @property
    def status(self) -> str:
        """Status of the result: "ok"; "not run", its extra is not installed; "unconverged"; "failed"; or
        "undetermined", where the noise leaves X open and the covariance means nothing.
        """
        if self.failure is None:
            return "ok"
        if self.not_run:
            return "not run"
        if self.converged is False:
            return "unconverged"
        return "failed" if self.X is None else "undetermined"

    def __repr__(self) -> str:
        said = self.status if self.failure is not None or self.agrees is None else f"agrees={self.agrees}"
        apart = ""
        if self.xi is not None:
            rotation, translation = np.degrees(np.linalg.norm(self.xi[:3])), 1e3 * np.linalg.norm(self.xi[3:])
            apart = f", {rotation:.3g} deg and {translation:.3g} mm from the reference"
        name = self.method if self.year is None else f"{self.method} {self.year}"
        return f"Row({name}, {said}{apart})"

    @property
    def std(self) -> Array | None:
        """Standard deviations (6,) of (theta, tau)."""
        return None if self.covariance is None else np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def weakest(self) -> tuple[float, float] | None:
        """Largest standard deviations of the rotation (rad) and of the translation (m), over all directions."""
        if self.covariance is None:
            return None
        rotation, translation = (principal_axes(self.covariance[part, part])[0][0] for part in (_TURN, _MOVE))
        return float(rotation), float(translation)

    @property
    def difference_rotation(self) -> float | None:
        """Angle between the rotation and that of the reference."""
        return None if self.xi is None else float(np.linalg.norm(self.xi[:3]))

    @property
    def difference_translation(self) -> float | None:
        """Distance between the translation and that of the reference."""
        return None if self.xi is None else float(np.linalg.norm(self.xi[3:]))


def against(row: Row, base: Row | None) -> Row:
    """The row with its difference from the reference, and whether it agrees; one of rounding counts as none."""
    if base is None or base.X is None or row.X is None:
        return row
    xi = np.zeros(6) if row.method == base.method else difference(row.X, base.X)
    if row.covariance is None or row.failure is not None:
        return replace(row, xi=xi)
    d2 = 0.0 if is_rounding(xi) else squared_distance(xi, row.covariance)
    return replace(row, xi=xi, d2=d2, agrees=d2 <= CHI2_95)


def is_rounding(xi: Array) -> bool:
    """Return whether a difference (6,) is below 1e-9 degrees and 1e-9 mm."""
    return all(
        float(np.linalg.norm(part)) < least
        for part, least in zip((xi[:3], xi[3:]), (CHAIN_ROUNDING, CHAIN_ROUNDING), strict=True)
    )


def squared_distance(xi: Array, covariance: Array) -> float:
    """``xi^T covariance^-1 xi``; infinite where xi has a part along which the covariance has no variance."""
    std = np.sqrt(np.diag(covariance))
    if (xi[std == 0] != 0).any():
        return math.inf
    xi, covariance, std = xi[std > 0], covariance[np.ix_(std > 0, std > 0)], std[std > 0]
    if not xi.size:
        return 0.0
    values, axes = np.linalg.eigh(covariance / np.outer(std, std))
    parts = axes.T @ (xi / std)
    flat = values <= SOLUTION_ROUNDING
    if (np.abs(parts[flat]) > np.sqrt(SOLUTION_ROUNDING)).any():
        return math.inf
    return float(np.sum(parts[~flat] ** 2 / values[~flat]))


def flat(row: Row, base: Row | None) -> JsonObject:
    """The row of the data frame, with the rotation vector of X next to that of the reference ``base``."""
    missing = np.full(6, np.nan)
    X = np.full((4, 4), np.nan) if row.X is None else row.X
    rotvec = missing[:3] if row.X is None else pose_numbers(row.X, None, None if base is None else base.X)[0][3:]
    std, xi = (missing if value is None else value for value in (row.std, row.xi))
    rms: tuple[float | None, float | None, float | None] = (None, None, None)
    if row.residuals is not None:
        rms = (row.residuals.error, row.residuals.rotation_rms, row.residuals.translation_rms)
    entry: JsonObject = {
        "method": row.method,
        "year": row.year,
        "structure": row.structure,
        "form": row.form,
        "status": row.status,
        "is_reference": base is not None and row.method == base.method,
    }
    entry |= {f"rotation_vector_{a}_deg": rotvec[k] for k, a in enumerate(_XYZ)}
    entry |= {f"translation_{a}_mm": 1e3 * X[k, 3] for k, a in enumerate(_XYZ)}
    entry |= {f"std_theta_{a}_deg": math.degrees(std[k]) for k, a in enumerate(_XYZ)}
    entry |= {f"std_tau_{a}_mm": 1e3 * std[3 + k] for k, a in enumerate(_XYZ)}
    entry |= {
        "difference_rotation_deg": _scaled(row.difference_rotation, 180 / np.pi),
        "difference_translation_mm": _scaled(row.difference_translation, 1e3),
    }
    entry |= {f"difference_theta_{a}_deg": math.degrees(xi[k]) for k, a in enumerate(_XYZ)}
    entry |= {f"difference_tau_{a}_mm": 1e3 * xi[3 + k] for k, a in enumerate(_XYZ)}
    entry |= {
        "d2": row.d2,
        "agrees": row.agrees,
        "error_62": rms[0],
        "residual_rotation_rms_deg": _scaled(rms[1], 180 / np.pi),
        "residual_translation_rms_mm": _scaled(rms[2], 1e3),
        "time_ms": _scaled(row.seconds, 1e3),
        "converged": row.converged,
        "iterations": row.iterations,
        "failure": row.failure,
    }
    entry |= {f"X_{i + 1}{j + 1}" + ("_m" if j == 3 else ""): X[i, j] for i in range(3) for j in range(4)}
    return entry


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value


def verdict(rows: Sequence[Row], reference: str | None, noise_known: bool, most: int | None = None) -> str:
    """State which methods agree with the reference, which differ, and which failed."""
    if reference is None:
        if len(rows) == 1:
            return f"{rows[0].method} gave no result{to_rely_on(rows[0])}."
        rely = next((to_rely_on(row) for row in rows if row.X is not None), "")
        return f"None of the {len(rows)} methods gave a result{rely}."
    others = [row for row in rows if row.method != reference and row.failure is None]
    judged = [row for row in others if row.agrees is not None]
    differ = [row.method for row in judged if not row.agrees]
    if len(judged) == 1:
        parts = [f"{judged[0].method} {'differs from' if differ else 'agrees with'} {reference} at 95 %"]
        differ = []
    elif judged:
        agree = len(judged) - len(differ)
        parts = [f"{agree} of {len(judged)} methods {'agrees' if agree == 1 else 'agree'} with {reference} at 95 %"]
    elif others:
        rotation = max(row.difference_rotation or 0.0 for row in others)
        translation = max(row.difference_translation or 0.0 for row in others)
        parts = [f"Up to {apart(rotation, DEG_PER_RAD)} deg and {apart(translation, MM_PER_M)} mm from {reference}"]
        if not noise_known:
            parts[0] += "; whether that is much cannot be said without noise"
    elif len(rows) == 1:
        parts = [f"{reference} alone, with nothing to compare"]
    else:
        parts = [f"Only {reference} gave a result"]
    silent = [row.method for row in others if row.agrees is None and noise_known]
    by_status = {status: [row.method for row in rows if row.status == status] for status in _STATUS}
    for names, words in (
        (differ, "differs" if len(differ) == 1 else "differ"),
        (silent, "without covariance"),
        *((by_status[status], words) for status, words in _STATUS.items()),
    ):
        if names:
            listed = "" if most is not None and len(names) > most else f": {', '.join(names)}"
            parts.append(f"{len(names)} {words}{listed}")
    return "; ".join(parts) + "."


# What the verdict calls the rows without a result to rely on.
_STATUS = {
    "undetermined": "undetermined",
    "unconverged": "did not converge",
    "failed": "failed",
    "not run": "not run",
}


def to_rely_on(row: Row) -> str:
    return "" if row.X is None else " to rely on"


def apart(value: float | None, factor: float = 1.0) -> str:
    """Format a difference as `digits` does; a rounding error is marked as such."""
    return "<1e-9" if value is not None and 0 < value * factor < 1e-9 else digits(value, factor)


def digits(value: float | None, factor: float = 1.0) -> str:
    """Format three significant digits, all digits of larger numbers; ``-`` for a missing number."""
    if value is None:
        return "-"
    value *= factor
    if not math.isfinite(value):
        return "inf"
    if value == 0:
        return "0"
    if not 1e-4 <= abs(value) < 1e6:
        return f"{value:.1e}"
    exponent = math.floor(math.log10(abs(float(f"{value:.2e}"))))
    return f"{value:.{min(max(0, 2 - exponent), 5)}f}"
