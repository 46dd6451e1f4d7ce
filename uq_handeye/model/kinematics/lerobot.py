"""Joint values and data sets of LeRobot.

*Values.* A motor has `TICKS_PER_TURN` + 1 positions a turn, and the calibration of an arm stores the range that each
was moved through by hand, ``range_min`` to ``range_max``. LeRobot counts angles from the middle of the range and writes
degrees, or the share of the range from -100 to 100:

    degrees = (ticks - middle) 360 / TICKS_PER_TURN
    share = 200 (ticks - range_min) / (range_max - range_min) - 100

SO-100 and SO-101 write degrees by default since LeRobot 0.4.4, and shares before; Koch, LeKiwi and OMX write shares.
``drive_mode`` 1 turns the sign of shares, but not that of degrees, and does so for Feetech motors only.

*Data sets* are parquet files: each column ``observation.state`` or ``action`` holds a list of all motors, whose names
are in ``meta/info.json`` of the data set, and ``timestamp`` starts at 0 in each episode.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...core.files.json_files import parsed
from ...core.files.one_line import short
from ...core.files.open import shown
from ...core.geometry.se3 import Array
from ...errors import InputError, MissingExtraError

# Ticks that LeRobot counts as a turn, which has one position more: 0.02 deg at 90 deg.
TICKS_PER_TURN = 4095
# Largest share of a range (per cent); more is no share, but an angle.
MAX_SHARE = 100.5
# Column of the measured joint values, and the columns that count frames.
STATE, EPISODE = "observation.state", "episode_index"
_COUNTERS = {"frame_index", EPISODE, "index", "task_index"}


class MotorRange(NamedTuple):
    """Range of a motor in ticks."""

    id: int
    low: float
    high: float
    reversed: bool

    def angle(self, share: Array) -> Array:
        """Return angles (rad) from the middle of the range of shares from -100 to 100."""
        half = 0.5 * (self.high - self.low) * 2 * np.pi / TICKS_PER_TURN
        return np.asarray((-1.0 if self.reversed else 1.0) * half * share / 100.0)


def read_motor_ranges(path: Path) -> dict[str, MotorRange]:
    """Read the ranges of the motors by their names: the calibration of an arm, a JSON file that LeRobot writes."""
    name, data = shown(path), parsed(path)
    if isinstance(data, dict) and "calib_mode" in data:
        raise InputError(
            f"{name} is a calibration of LeRobot before 0.3, whose joint values are degrees: --joint-units deg."
        )
    if not isinstance(data, dict) or not data or not all(isinstance(one, dict) for one in data.values()):
        raise InputError(f"{name}: expected a calibration of LeRobot, motors with id, range_min and range_max.")
    found = {}
    for motor, of in data.items():
        low, high, number = (of.get(key) for key in ("range_min", "range_max", "id"))
        if not all(isinstance(value, int) for value in (low, high, number)) or not low < high:
            raise InputError(f"{name}, motor {short(motor)}: expected whole numbers id and range_min < range_max.")
        found[motor] = MotorRange(number, float(low), float(high), bool(of.get("drive_mode")))
    return found


def angles_of_shares(shares: Array, columns: Sequence[str], motors: Mapping[str, MotorRange], name: str) -> Array:
    """Return angles (n, L) in rad of shares (n, L) of the ranges of motors, by the names of their columns.

    Columns without names of motors, such as ``q_0``, are those of the motors in the order of their numbers.
    """
    if (largest := float(np.abs(shares).max())) > MAX_SHARE:
        raise InputError(
            f"{name}: expected shares from -100 to 100 of the range of each motor, got {largest:.4g}. Are the values "
            "degrees (--joint-units deg)?"
        )
    of_columns = [_motor_of(column, motors) for column in columns]
    if not any(of_columns):
        by_number = sorted(motors.values(), key=lambda motor: motor.id)[: len(columns)]
        of_columns = [*by_number, *[None] * (len(columns) - len(by_number))]
    angles = np.empty_like(shares)
    for k, motor in enumerate(of_columns):
        if motor is None:
            known = short(", ".join(motors))
            raise InputError(f"{name}: the calibration has no motor of the column {short(columns[k])}, but {known}.")
        angles[:, k] = motor.angle(shares[:, k])
    return angles


def _motor_of(column: str, motors: Mapping[str, MotorRange]) -> MotorRange | None:
    """Return the motor whose name a column has, with or without words around it; the longest name that is."""
    names = [name for name in motors if f"_{name.lower()}_" in f"_{_joined(column)}_"]
    return motors[max(names, key=len)] if names else None


def _joined(column: str) -> str:
    return column.lower().replace("/", "_").replace(".", "_").replace(" ", "_")


class Frames(NamedTuple):
    """Numbers of a data frame, lists of it one column each."""

    names: list[str]
    values: Array  # (n, columns)
    times: Array | None  # (n,) s
    notes: tuple[str, ...]


def read_frames(path: Path) -> Frames:
    """Read the numbers of a parquet file: its columns, and those of its lists by the names in ``meta/info.json``.

    Commands (``action``) are left out where there are measured values.
    """
    name = shown(path)
    try:
        import pandas as pd

        table = pd.read_parquet(path)
    except ImportError as error:
        raise MissingExtraError(
            f"Reading {name} needs pyarrow: pip install '.[parquet]' in the clone of uq-handeye."
        ) from error
    except (OSError, ValueError) as error:
        raise InputError(f"{name}: not a parquet file that can be read: {str(error).splitlines()[0]:.100}.") from error
    if not len(table):
        raise InputError(f"{name}: the file has no rows.")
    lists = _names_of_lists(path)
    names: list[str] = []
    columns: list[Array] = []
    for column in map(str, table.columns):
        if column in _COUNTERS or column == "timestamp" or (column == "action" and STATE in table.columns):
            continue
        values = _numbers(table[column].to_numpy())
        if values is None:
            continue
        columns += list(values.T)
        of = lists.get(column, ())
        single = values.shape[1] == 1 and not of
        names += [column] if single else [*of] if len(of) == values.shape[1] else _counted(column, values.shape[1])
    if not columns:
        raise InputError(f"{name}: expected columns of numbers or of lists of numbers, got none.")
    times = table["timestamp"].to_numpy(dtype=float) if "timestamp" in table.columns else None
    notes: tuple[str, ...] = ()
    if EPISODE in table.columns and (episodes := table[EPISODE].nunique()) > 1:
        times, notes = None, (f"{episodes} episodes, whose timestamps start at 0: rows are paired in their order",)
    return Frames(names, np.array(columns).T, times, notes)


def _counted(column: str, n: int) -> list[str]:
    return [f"{column}[{k}]" for k in range(n)]


def _numbers(values: Any) -> Array | None:
    """Return a column (n, 1), or lists of one length (n, k); None for other things, such as pictures and text."""
    try:
        array = np.array(values.tolist(), dtype=float)
    except (TypeError, ValueError):
        return None
    return array[:, None] if array.ndim == 1 else array if array.ndim == 2 else None


def _names_of_lists(path: Path) -> dict[str, tuple[str, ...]]:
    """Return the names of motors by columns, of the data set that the file belongs to."""
    for folder in list(path.absolute().parents)[:4]:
        if (info := folder / "meta" / "info.json").is_file():
            data = parsed(info)
            features = data.get("features", {}) if isinstance(data, dict) else {}
            found = {}
            for column, of in features.items() if isinstance(features, dict) else ():
                names = of.get("names") if isinstance(of, dict) else None
                if isinstance(names, dict):  # of earlier data sets: {"motors": [...]}
                    names = next(iter(names.values()), None)
                if isinstance(names, list) and all(isinstance(one, str) for one in names):
                    found[str(column)] = tuple(names)
            return found
    return {}
