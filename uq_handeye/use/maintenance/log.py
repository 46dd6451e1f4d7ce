"""Log of the checks of one calibration: a CSV file with one line for each check.

Columns: ``time`` (ISO 8601), number of ``poses``, ``d2``, ``dof``, ``p_value``, ``answer``, ``cause``; the shift of X
estimated from this check only, with standard deviations (mm and deg, left rotation and additive translation);
``result``, a hash of the calibration. For a rig the shift is that of the pose which explains most.

A line that cannot be read is skipped and named. The file is replaced as a whole, so that a line is never cut.
"""

from __future__ import annotations

import csv
import datetime
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...calibration.stored_result import StoredResult
from ...core.files.atomic import write_atomically
from ...core.files.csv_text import csv_text, plain_text
from ...core.files.locks import held
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.geometry.se3 import Array
from ...core.limits import MAX_ROWS, MAX_TABLE_BYTES
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M
from ...core.read_only import ReadOnlyArrays
from ...core.rounding import CHAIN_ROUNDING
from ...errors import InputError
from ...model.poses.pose_pairs import PosePairs
from ...model.rig.description import Rig
from .causes import CAMERA_MOVED
from .check_result import ChangeCheck

NUMBERS = tuple(f"{axis}_mm" for axis in "xyz") + tuple(f"r{axis}_deg" for axis in "xyz")
SHIFT = tuple(f"X_{name}" for name in NUMBERS)
SHIFT_STD = tuple(f"sd_{name}" for name in SHIFT)
COLUMNS = ("time", "poses", "d2", "dof", "p_value", "answer", "cause", *SHIFT, *SHIFT_STD, "result")
# Codes of the findings of checks whose poses do not test the calibration, by the name of the cause in the log.
WRONG_POSES = {
    "one pose wrong": ("maintenance.one_pose_wrong",),
    "another rig": ("maintenance.another_rig",),
    "misread files": ("maintenance.misread", "maintenance.pairing"),
}


@dataclass(frozen=True, eq=False)
class LoggedCheck(ReadOnlyArrays):
    """One line of the log."""

    time: str  # ISO 8601
    n_poses: int
    d2: float
    dof: int
    p_value: float
    answer: str
    cause: str
    shift: Array  # (6,) of X, as the check by itself estimates it (rad, m)
    shift_std: Array  # (6,)
    result: str  # hash of the calibration

    def line(self) -> str:
        """Return the line of the log, with its line end."""
        numbers = [*_in_columns(self.shift), *_in_columns(self.shift_std)]
        of_test = [_text(self.d2), str(self.dof), _text(self.p_value), self.answer, self.cause]
        return _csv([self.time, str(self.n_poses), *of_test, *map(_text, numbers), self.result])

    @classmethod
    def from_cells(cls, cells: Mapping[str, str]) -> LoggedCheck:
        """Read one line; raises ValueError or `InputError` with what is wrong."""
        time, answer = _checked_time(cells["time"]), cells["answer"]
        d2, p_value = _number(cells, "d2"), _number(cells, "p_value")
        n, dof = (_whole(cells, name) for name in ("poses", "dof"))
        if d2 < 0 or not 0 <= p_value <= 1 or not answer:
            raise ValueError("d2, p_value or answer cannot be")
        shift, std = (_from_columns([_number(cells, name) for name in names]) for names in (SHIFT, SHIFT_STD))
        return cls(time, n, d2, dof, p_value, answer, cells["cause"], shift, std, cells["result"])


def _in_columns(xi: Array) -> list[float]:
    """Return (theta, tau) in rad and m as the columns have it: translation in mm, then rotation in deg."""
    return [*(MM_PER_M * xi[3:]).tolist(), *(DEG_PER_RAD * xi[:3]).tolist()]


def _from_columns(values: Sequence[float]) -> Array:
    """Return (theta, tau) in rad and m of the numbers of the columns."""
    return np.concatenate([np.array(values[3:]) / DEG_PER_RAD, np.array(values[:3]) / MM_PER_M])


def _cause_and_shift(check: ChangeCheck) -> tuple[str, Array, Array]:
    """Return the cause of a check; the move of X, of a rig the one that explains most, and its standard deviations."""
    codes = {finding.code for finding in check.findings}
    wrong = (words for words, of in WRONG_POSES.items() if codes & set(of))
    moved = next((one for one in check.moves if one.name == CAMERA_MOVED), check.moves[0])
    return next(wrong, " or ".join(check.candidates)), moved.estimate, moved.std


@dataclass(frozen=True, eq=False)
class CheckSeries:
    """Checks of one calibration in the order of the log."""

    checks: tuple[LoggedCheck, ...]
    damaged: tuple[tuple[int, str], ...] = ()  # line number and what is wrong

    def __len__(self) -> int:
        return len(self.checks)

    @property
    def result(self) -> str | None:
        """The hash of the calibration; None for an empty log."""
        return self.checks[0].result if self.checks else None

    @property
    def sentences(self) -> list[str]:
        """Sentences that name the lines which were skipped."""
        found = [f"Line {number} of the log was skipped: {what}." for number, what in self.damaged[:3]]
        more = len(self.damaged) - len(found)
        return [*found, f"{more} more lines of the log were skipped."] if more else found


def log_check(
    path: StrPath,
    result: StoredResult,
    poses: PosePairs | Rig,
    check: ChangeCheck,
    *,
    time: str | None = None,
) -> CheckSeries:
    """Add a check to a log of checks, and return the whole series.

    Parameters
    ----------
    path : path of the CSV file
        Made if there is none.
    result : Calibration or RigCalibration
        The one that was checked. A log holds the checks of one calibration.
    poses : PosePairs or Rig
        The poses that were checked.
    check : ChangeCheck
        What `check` returned for them.
    time : text or None
        ISO 8601, such as ``"2026-03-02T08:00"``; None: now, in UTC.

    Raises
    ------
    InputError
        A log of another calibration; poses that are in the log already; whatever prevents reading or writing.
    """
    target = as_path(path)
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    at = now if time is None else _checked_time(time)
    count = sum(len(view.poses) for view in poses.views) if isinstance(poses, Rig) else poses.n
    cause, shift, std = _cause_and_shift(check)
    own = result.digest
    line = LoggedCheck(at, count, check.d2, check.dof, check.p_value, check.status, cause, shift, std, own).line()
    logged = _checks_of([line])[0][0]  # as it will be read
    with held(target):  # from reading to writing: no line of another process is lost
        before = _read(path) if target.exists() else ""
        series = _series(before, path) if before.strip() else CheckSeries(())
        if series.result not in (None, own):
            raise InputError(_another(path, series.result, own))
        for k, other in enumerate(series.checks):
            if math.isclose(other.d2, logged.d2, rel_tol=CHAIN_ROUNDING) and np.array_equal(other.shift, logged.shift):
                raise InputError(
                    f"{shown(target)}: these poses were logged as check {k + 1} ({other.time}), and are not logged "
                    "twice. Check new poses, or leave out --log."
                )
        text = before if before.strip() else _csv(COLUMNS)
        write_atomically(target, f"{text}{'' if text.endswith(chr(10)) else chr(10)}{line}")
    return CheckSeries((*series.checks, logged), series.damaged)


def read_checks(path: StrPath, result: StoredResult | None = None) -> CheckSeries:
    """Read a log; lines that are damaged are named in ``damaged``.

    Raises
    ------
    InputError
        No such file, no log of checks, checks of several calibrations, or of another one than ``result``.
    """
    series = _series(_read(path), path)
    if result is not None and series.result not in (None, own := result.digest):
        raise InputError(_another(path, series.result, own))
    return series


def _read(path: StrPath) -> str:
    with opened(as_path(path), MAX_TABLE_BYTES) as file:
        return file.read().decode("utf-8", errors="replace").removeprefix("\ufeff")


def _series(text: str, path: StrPath) -> CheckSeries:
    """Return the checks of the text of a log."""
    lines = text.splitlines()
    where = shown(as_path(path))
    if not lines or next(csv.reader(lines[:1]), None) != list(COLUMNS):
        raise InputError(f"{where}: expected a log of checks, whose first line begins with {','.join(COLUMNS[:5])},...")
    checks, damaged = _checks_of(lines[1:])
    results = list(dict.fromkeys(check.result for check in checks))
    if len(results) > 1:
        raise InputError(f"{where}: holds checks of {len(results)} calibrations. Keep one log for each calibration.")
    return CheckSeries(tuple(checks), tuple(damaged))


def _checks_of(lines: Sequence[str]) -> tuple[list[LoggedCheck], list[tuple[int, str]]]:
    """Return the checks of the lines below the header, and number and fault of the lines that cannot be read."""
    checks, damaged = [], []
    for number, line in enumerate(lines, start=2):
        if not line.strip():
            continue
        try:
            cells = [plain_text(cell) for cell in next(csv.reader([line]), [])]
            if len(cells) != len(COLUMNS):
                raise ValueError(f"{len(cells)} cells, expected {len(COLUMNS)}")
            checks.append(LoggedCheck.from_cells(dict(zip(COLUMNS, cells, strict=True))))
        except (ValueError, InputError, csv.Error) as error:
            damaged.append((number, " ".join(str(error).split())[:160]))
    return checks, damaged


def _checked_time(text: str) -> str:
    try:
        datetime.datetime.fromisoformat(text)
    except (TypeError, ValueError) as error:
        raise InputError(f"Expected a time such as 2026-03-02T08:00, got {text!r:.40}.") from error
    return text


def _another(path: StrPath, logged: str | None, given: str) -> str:
    return (
        f"{shown(as_path(path))} is the log of another calibration ({logged}, got {given}). Start a new log for a new "
        "calibration."
    )


def _csv(cells: Sequence[str]) -> str:
    return csv_text([[" ".join(cell.split()) for cell in cells]])


def _text(value: float) -> str:
    return f"{value:.12g}"


def _number(cells: Mapping[str, str], name: str) -> float:
    value = float(cells[name])
    if not math.isfinite(value):
        raise ValueError(f"{name} is not finite")
    return value


def _whole(cells: Mapping[str, str], name: str) -> int:
    value = int(cells[name])
    if not 0 < value < MAX_ROWS:
        raise ValueError(f"{name} is not a whole number above 0")
    return value
