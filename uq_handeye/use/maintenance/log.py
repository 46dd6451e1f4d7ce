"""Log of checks over days: one line of CSV for each, of one calibration.

Columns: ``time`` (ISO 8601), ``poses``, ``d2``, ``dof``, ``p_value``, ``answer``, ``cause``; the shift of X that the
check asks for, by itself, with standard deviations (mm and deg, left rotation and additive translation); ``noise_dof``
(empty where the noise was given); ``result``, a hash of the calibration; then what was measured, so that the checks can
be held against the calibration together (`cusum`): numbers separated by blanks, poses by ``;``. Poses are
``x y z qx qy qz qw`` (m), noise the 21 numbers of the lower triangle of 6 x 6 (empty: that of the calibration). Of a
rig the shift is that of the pose which explains most, and ``robot`` holds the new poses and views as JSON.

A line that cannot be read is skipped and named. The log is replaced as a whole, so that it is never cut.
"""

from __future__ import annotations

import csv
import datetime
import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import numpy as np

from ...calibration.evidence.new_poses import noise_of_pictures
from ...calibration.prediction.predict import own_noise
from ...calibration.result import Calibration
from ...core.files.atomic import write_atomically
from ...core.files.csv_text import csv_text, plain_text
from ...core.files.locks import held
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.geometry.se3 import Array, pose
from ...core.runtime.read_only import ReadOnlyArrays
from ...errors import InputError
from ...model.noise.joint_covariance import JointCovariance, joint_of
from ...model.noise.models import PoseNoise
from ...model.poses.pose_pairs import PosePairs
from ...rig.checks.check import RigCheck
from ...rig.description import Rig
from ...rig.files.result_file import rig_from_dict, rig_to_dict
from ...rig.result import RigCalibration
from .check_result import ChangeCheck

NUMBERS = tuple(f"{axis}_mm" for axis in "xyz") + tuple(f"r{axis}_deg" for axis in "xyz")
SHIFT = tuple(f"X_{name}" for name in NUMBERS)
COLUMNS = (
    *("time", "poses", "d2", "dof", "p_value", "answer", "cause"),
    *SHIFT,
    *(f"sd_{name}" for name in SHIFT),
    *("noise_dof", "result", "setup", "robot", "camera", "robot_noise", "camera_noise", "joints"),
)
MAX_BYTES = 100_000_000
# Checks that say nothing of the calibration, by what the log calls the cause: codes of the findings.
NOT_USED = {
    "one pose wrong": ("maintenance.one_pose_wrong",),
    "another rig": ("maintenance.another_rig",),
    "misread files": ("maintenance.misread", "maintenance.pairing"),
}
# (theta, tau) in rad and m as the columns have them.
_ORDER, _UNIT = np.array([3, 4, 5, 0, 1, 2]), np.array([1e3] * 3 + [180 / np.pi] * 3)
_LOWER = np.tril_indices(6)
# What stands in place of the setup for the views of a rig.
RIG = "rig"


@dataclass(frozen=True, eq=False)
class LoggedCheck(ReadOnlyArrays):
    """One check as the log has it."""

    time: str  # ISO 8601
    d2: float
    dof: int
    p_value: float
    answer: str
    cause: str
    shift: Array  # (6,) of X, as the check asks for it (rad, m)
    shift_std: Array  # (6,)
    noise_dof: float
    result: str
    poses: PosePairs | Rig
    noise: PoseNoise | None = None  # None: that of the calibration

    @classmethod
    def of(
        cls,
        check: ChangeCheck | RigCheck,
        result: Calibration | RigCalibration,
        poses: PosePairs | Rig,
        noise: PoseNoise | None = None,
        time: str | None = None,
    ) -> LoggedCheck:
        """Build it from the check of ``poses`` against ``result``; ``time`` None is now."""
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        at = now if time is None else _checked_time(time)
        nu = math.inf if check.noise_dof is None else check.noise_dof
        cause, shift, std, noise = _said(check, result, poses, noise)
        return cls(
            at, check.d2, check.dof, check.p_value, check.status, cause, np.asarray(shift), np.asarray(std), nu,
            hash_of_result(result), poses, noise,
        )  # fmt: skip

    @property
    def used(self) -> bool:
        """True if the charts use it: not a check whose poses were wrong or misread."""
        return self.cause not in NOT_USED

    def line(self) -> str:
        """The line of the log, with its line end."""
        numbers, count = [_UNIT * of[_ORDER] for of in (self.shift, self.shift_std)], sum(map(len, _seen(self.poses)))
        return _csv([
            self.time, str(count), _text(self.d2), str(self.dof), _text(self.p_value), self.answer, self.cause,
            *(_text(x) for of in numbers for x in of),
            _text(self.noise_dof) if math.isfinite(self.noise_dof) else "", self.result,
            *_measured(self.poses, self.noise),
        ])  # fmt: skip

    @classmethod
    def from_cells(cls, cells: Mapping[str, str]) -> LoggedCheck:
        """Read one line; raises ValueError or `InputError` with what is wrong."""
        time, answer = _checked_time(cells["time"]), cells["answer"]
        d2, p_value = _number(cells, "d2"), _number(cells, "p_value")
        n, dof = (_whole(cells, name) for name in ("poses", "dof"))
        if d2 < 0 or not 0 <= p_value <= 1 or dof < 1 or not answer:
            raise ValueError("d2, dof, p_value or answer cannot be")
        shift, std = (
            np.array([_number(cells, name) for name in names])
            for names in (SHIFT, tuple(f"sd_{name}" for name in SHIFT))
        )
        back = np.argsort(_ORDER)
        if cells["setup"] == RIG:
            poses: PosePairs | Rig = rig_from_dict(json.loads(cells["robot"]))
        else:
            robot, camera = (_poses(cells[side], n, side) for side in ("robot", "camera"))
            joints = _matrix(cells["joints"], n, "joints") if cells["joints"] else None
            poses = PosePairs(robot, camera, cells["setup"], joints=joints)
        noise_dof = _number(cells, "noise_dof") if cells["noise_dof"] else math.inf
        if not noise_dof > 0:
            raise ValueError("noise_dof is not above 0")
        S = {side: _noise(cells[f"{side}_noise"], n, side) for side in ("robot", "camera")}
        noise = None if all(part is None for part in S.values()) else PoseNoise(**S)
        return cls(
            time, d2, dof, p_value, answer, cells["cause"], (shift / _UNIT)[back], (std / _UNIT)[back], noise_dof,
            cells["result"], poses, noise,
        )  # fmt: skip


@singledispatch
def _said(check: Any, result: Any, poses: Any, noise: PoseNoise | None) -> tuple[str, Any, Any, Any]:
    """Return cause, shift with deviations, and noise of a check."""
    if noise is None and poses.camera_known:  # of other intrinsics: their errors in addition to those so far
        noise = PoseNoise(own_noise(result, "robot"), noise_of_pictures(result, poses))
    codes, moved = {finding.code for finding in check.findings}, check.causes["X"]
    wrong = (words for words, of in NOT_USED.items() if codes & set(of))
    return next(wrong, " or ".join(check.candidates)), moved.estimate, np.sqrt(np.diag(moved.covariance)), noise


@_said.register
def _(check: RigCheck, result: Any, poses: Any, noise: PoseNoise | None) -> tuple[str, Any, Any, Any]:
    return check.cause or "", check.moves[0].estimate, check.moves[0].std, None


@singledispatch
def _measured(poses: Any, noise: PoseNoise | None) -> list[str]:
    """Return the cells of what was measured, from the setup on."""
    sides = ("robot", "camera")
    return [
        poses.setup,
        *(_rows(_pose_numbers(getattr(poses, side))) for side in sides),
        *(_rows(_noise_numbers(noise, side, poses.n)) for side in sides),
        "" if poses.joints is None else _rows(poses.joints),
    ]


@_measured.register
def _(poses: Rig, noise: PoseNoise | None) -> list[str]:
    return [RIG, json.dumps(rig_to_dict(poses), separators=(",", ":")), "", "", "", ""]


@dataclass(frozen=True, eq=False)
class CheckSeries:
    """Checks of one calibration in the order of the log."""

    checks: tuple[LoggedCheck, ...]  # in the order of the log
    damaged: tuple[tuple[int, str], ...] = ()  # line number and what is wrong

    def __len__(self) -> int:
        return len(self.checks)

    @property
    def result(self) -> str | None:
        """The hash of the calibration; None for an empty log."""
        return self.checks[0].result if self.checks else None


def hash_of_result(result: Calibration | RigCalibration) -> str:
    """Return 16 hexadecimal digits that identify all poses, their covariance and the setup."""
    parts: tuple[Array | None, ...]
    if isinstance(result, RigCalibration):
        kind, parts = RIG, (result.poses, result.covariance)
    else:
        kind, parts = str(result.setup), (result.X, result.W, result.covariance)
    digest = hashlib.sha256(kind.encode())
    for part in parts:
        digest.update(b"-" if part is None else np.ascontiguousarray(part, dtype="<f8").tobytes())
    return digest.hexdigest()[:16]


def log_check(
    path: StrPath,
    result: Calibration | RigCalibration,
    poses: PosePairs | Rig,
    check: ChangeCheck | RigCheck,
    *,
    noise: PoseNoise | None = None,
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
    check : ChangeCheck or RigCheck
        What `check` said of them.
    noise : PoseNoise or None
        The one given to `check`.
    time : text or None
        ISO 8601, such as ``"2026-03-02T08:00"``; None: now, in UTC.

    Raises
    ------
    InputError
        A log of another calibration; poses that are in the log already; whatever prevents reading or writing.
    """
    target, logged = as_path(path), LoggedCheck.of(check, result, poses, noise, time)
    with held(target):  # from reading to writing: no line of another process is lost
        before = _read(path) if target.exists() else ""
        series = _series(before, path) if before.strip() else CheckSeries(())
        if series.result not in (None, logged.result):
            raise InputError(_another(path, series.result, logged.result))
        same = next((k for k, of in enumerate(series.checks) if _same(of.poses, poses)), None)
        if same is not None:
            raise InputError(
                f"{shown(target)}: these poses were logged as check {same + 1} ({series.checks[same].time}), and are "
                "not logged twice. Check new poses, or leave out --log."
            )
        text = before if before.strip() else _csv(COLUMNS)
        line = logged.line()
        write_atomically(target, f"{text}{'' if text.endswith(chr(10)) else chr(10)}{line}")
    written = LoggedCheck.from_cells(dict(zip(COLUMNS, _cells(line), strict=True)))
    return CheckSeries((*series.checks, written), series.damaged)


def read_checks(path: StrPath, result: Calibration | RigCalibration | None = None) -> CheckSeries:
    """Read a log; lines that are damaged are named in ``damaged``.

    Raises
    ------
    InputError
        No such file, no log of checks, checks of several calibrations, or of another one than ``result``.
    """
    series = _series(_read(path), path)
    if result is not None and series.result not in (None, own := hash_of_result(result)):
        raise InputError(_another(path, series.result, own))
    return series


def _read(path: StrPath) -> str:
    with opened(as_path(path), MAX_BYTES) as file:
        return file.read().decode("utf-8", errors="replace").removeprefix("\ufeff")


def _series(text: str, path: StrPath) -> CheckSeries:
    lines = text.splitlines()
    csv.field_size_limit(MAX_BYTES)  # the views of a rig stand in one cell
    where = shown(as_path(path))
    if not lines or next(csv.reader(lines[:1]), None) != list(COLUMNS):
        raise InputError(f"{where}: expected a log of checks, whose first line begins with {','.join(COLUMNS[:5])},...")
    checks, damaged = [], []
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        cells = _cells(line)
        try:
            if len(cells) != len(COLUMNS):
                raise ValueError(f"{len(cells)} cells, expected {len(COLUMNS)}")
            checks.append(LoggedCheck.from_cells(dict(zip(COLUMNS, cells, strict=True))))
        except (ValueError, InputError) as error:
            damaged.append((number, " ".join(str(error).split())[:160]))
    results = list(dict.fromkeys(check.result for check in checks))
    if len(results) > 1:
        raise InputError(f"{where}: holds checks of {len(results)} calibrations. Keep one log for each calibration.")
    return CheckSeries(tuple(checks), tuple(damaged))


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


def _seen(poses: PosePairs | Rig) -> list[Array]:
    """Return what the cameras saw, (n, 4, 4) of each view."""
    return [view.poses for view in poses.views] if isinstance(poses, Rig) else [poses.camera]


def _same(a: PosePairs | Rig, b: PosePairs | Rig) -> bool:
    one, other = _seen(a), _seen(b)
    alike = [len(x) for x in one] == [len(y) for y in other]
    return alike and all(np.allclose(x, y, rtol=0, atol=1e-9) for x, y in zip(one, other, strict=True))


def _csv(cells: Any) -> str:
    return csv_text([[" ".join(str(cell).split()) for cell in cells]])


def _cells(line: str) -> list[str]:
    return [plain_text(cell) for cell in next(csv.reader([line]), [])]


def _text(value: float) -> str:
    return f"{value:.12g}"


def _rows(values: Array) -> str:
    return "; ".join(" ".join(map(_text, row)) for row in values)


def _pose_numbers(poses: Array) -> Array:
    from scipy.spatial.transform import Rotation

    return np.concatenate([poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat()], axis=-1)


def _noise_numbers(noise: PoseNoise | None, side: str, n: int) -> Array:
    """(n, 21 + 6 z) lower triangles, with the columns of what the poses share; (0, 21) for that of the calibration."""
    S: Any = None if noise is None else getattr(noise, side)
    if S is None:
        return np.zeros((0 if noise is None else n, 21))
    joint, shared = joint_of(S), np.zeros((n, 6, 0))
    if joint is not None:
        S, shared = joint.own, np.asarray(joint.shared)
    if np.shape(S) not in ((6, 6), (n, 6, 6)):
        raise InputError(f"Expected the noise of new {side} poses as (6, 6) or ({n}, 6, 6), got {np.shape(S)}.")
    lower = np.broadcast_to(S, (n, 6, 6))[:, _LOWER[0], _LOWER[1]]
    return np.concatenate([lower, shared.reshape(n, -1)], axis=-1)


def _noise(text: str, n: int, side: str) -> Any:
    if not text:
        return None
    values = _matrix(text, n, f"{side}_noise")
    if values.shape[1] < 21 or (values.shape[1] - 21) % 6:
        raise ValueError(f"{side}_noise has {values.shape[1]} numbers for each pose, expected 21")
    S = np.zeros((n, 6, 6))
    S[:, _LOWER[0], _LOWER[1]] = values[:, :21]
    S = S + np.tril(S, -1).mT
    return S if values.shape[1] == 21 else JointCovariance(S, values[:, 21:].reshape(n, 6, -1))


def _poses(text: str, n: int, side: str) -> Array:
    from scipy.spatial.transform import Rotation

    values = _matrix(text, n, side)
    if values.shape[1] != 7 or np.abs(np.linalg.norm(values[:, 3:], axis=-1) - 1.0).max() > 1e-6:
        raise ValueError(f"{side} poses are not x y z qx qy qz qw with unit quaternions")
    return pose(Rotation.from_quat(values[:, 3:]).as_matrix(), values[:, :3])


def _matrix(text: str, n: int, name: str) -> Array:
    rows = [[float(part) for part in row.split()] for row in text.split(";")]
    if len(rows) != n or len({len(row) for row in rows}) != 1:
        raise ValueError(f"{name} has {len(rows)} rows, or rows of different lengths, expected {n}")
    values = np.array(rows)
    if not np.isfinite(values).all():
        raise ValueError(f"{name} has numbers that are not finite")
    return values


def _number(cells: Mapping[str, str], name: str) -> float:
    value = float(cells[name])
    if not math.isfinite(value):
        raise ValueError(f"{name} is not finite")
    return value


def _whole(cells: Mapping[str, str], name: str) -> int:
    value = int(cells[name])
    if not 0 < value < 1_000_000:
        raise ValueError(f"{name} is not a whole number above 0")
    return value
