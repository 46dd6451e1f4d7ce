r"""Points of a target in CSV, one per line: ``x,y,z``, and for a measured board also their covariance.

``x_mm,y_mm,z_mm`` and ``x [mm]`` are read as well. Such a file describes any target that no `Board` describes: circles,
tags on a plate, marks.

``board.csv`` of a calibrated camera has, in metres, the points as measured, their nominal places, and the q columns of
a factor F (3u, q) of the covariance ``F F^T`` of all of them: no column where the board was taken as flat. A comment
before the header names the board, where it is known:

    # board: kind=chessboard columns=9 rows=6 square=0.02
    x,y,z,nominal_x,nominal_y,nominal_z,dx_1,dy_1,dz_1,dx_2,...
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.files.one_line import short
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.files.table import Places, Schema, read_table
from ...core.geometry.se3 import Array
from ...core.limits import MAX_DESCRIPTION_BYTES
from ...core.presentation.units import LENGTH_UNITS
from ...errors import InputError
from ...formats.columns import meaning_and_unit
from .board_shape import MEASURED, BoardShape
from .measured_board import MeasuredBoard

HEADER = "x,y,z"
AXES = ("x", "y", "z")
NOMINAL = tuple(f"nominal_{axis}" for axis in AXES)
BOARD = "board: "
# No board is bent by more than this share of its size.
MAX_BEND_SHARE = 0.1


class BoardTable(NamedTuple):
    """Content of a file of points."""

    name: str
    points: Array  # (u, 3) m
    nominal: Array | None  # (u, 3) m; None where the file has points only
    factor: Array  # (u, 3, q) m
    board: str  # `Board.text`; empty where it is not known


def read_board_points(path: StrPath) -> Array:
    """The points (m, 3) of a target in its own frame, in metres; of a board that was measured, those as measured.

    Raises
    ------
    InputError
        One line that names the file and the line: a file that cannot be read, or is no such table.
    """
    return read_board_table(path).points


def read_board(path: StrPath) -> BoardShape:
    """Return the board that an earlier calibration measured, from its ``board.csv``, for ``calibrate_camera(shape=)``.

    The shape is known with the covariance of that calibration: the next one takes it as a Gaussian prior.

    Raises
    ------
    InputError
        One line that names the file and the line: a file that cannot be read, is damaged, or has no measured points.
    """
    return shape_of(read_board_table(path))


def shape_of(table: BoardTable) -> BoardShape:
    """The shape of a board that was measured; raises `InputError` where the file has no nominal points."""
    if table.nominal is None:
        raise InputError(
            f"{table.name}: expected the board.csv of uq-handeye camera -o, with the columns {', '.join(NOMINAL)}, "
            "got only points."
        )
    if len(np.unique(table.nominal, axis=0)) < len(table.nominal):
        raise InputError(f"{table.name}: expected every point of the board once, got one twice; write the file again.")
    moved = table.points - table.nominal
    if (most := float(np.abs(moved).max())) > MAX_BEND_SHARE * float(np.ptp(table.nominal, axis=0).max()):
        raise InputError(
            f"{table.name}: expected points as measured near to those as meant, got one that is {most:.3g} m off: were "
            "columns changed, or their unit?"
        )
    factor = table.factor[..., np.any(table.factor != 0, axis=(0, 1))]  # a column of zeros is no coefficient
    q = factor.shape[2]
    names = tuple(f"measured {k + 1}" for k in range(q))
    return BoardShape(MEASURED, names, table.nominal, moved, factor, np.ones(q))


def read_board_table(path: StrPath) -> BoardTable:
    """Read a file of points in full; raises `InputError` as `read_board_points` does."""
    location = as_path(path)
    name = shown(location)
    with opened(location, MAX_DESCRIPTION_BYTES) as file:
        table = read_table(file, name, SCHEMA)
    table.require_finite()
    values = table.values * _factors(table.names, name)
    columns = values[:, 6:].reshape(len(values), max(values.shape[1] - 6, 0) // 3, 3)
    nominal = None if values.shape[1] == 3 else values[:, 3:6]
    board = [text.removeprefix(BOARD) for text in table.comments if text.startswith(BOARD)]
    return BoardTable(name, values[:, :3], nominal, columns.swapaxes(1, 2), "".join(board[:1]))


def _places(titles: list[str], line: str, where: str) -> Places:
    return Places(range(len(_factors(titles, where))))


SCHEMA = Schema(f"the header {HEADER}", "point of the board", _places, marks=";,")


def _factors(titles: list[str], where: str) -> list[float]:
    """Return the factor that converts the numbers of each column to metres."""
    found = [meaning_and_unit(title) for title in titles[:3]]
    if [column for column, _ in found] == [*AXES]:
        if len(titles) == 3:
            return [LENGTH_UNITS[unit or "m"] for _, unit in found]
        q = (len(titles) - 6) // 3
        further = (*NOMINAL, *(f"d{axis}_{k + 1}" for k in range(q) for axis in AXES))
        if titles == [*AXES, *further]:
            return [1.0] * len(titles)
    raise InputError(
        f"{where}: expected the header {HEADER}, or that of board.csv of uq-handeye camera -o, got "
        f"{short(','.join(titles))}."
    )


def board_text(board: MeasuredBoard, printed: str) -> str:
    """Format a board as `read_board_table` reads it, points bit by bit; ``printed`` is `Board.text`, empty where not
    known.
    """
    u, _, q = board.factor.shape
    header = ",".join((*AXES, *NOMINAL, *(f"d{axis}_{k + 1}" for k in range(q) for axis in AXES)))
    exact = np.concatenate([board.points, board.nominal], axis=1).tolist()
    rounded = board.factor.swapaxes(1, 2).reshape(u, -1).tolist()
    lines = (
        ",".join([*map(repr, points), *(f"{value:.9g}" for value in columns)])
        for points, columns in zip(exact, rounded, strict=True)
    )
    first = [
        f"# points of a board as measured by uq-handeye camera (shape: {board.shape}), and as meant, in metres",
        "# covariance of all points (3u, 3u): F F^T, F of the columns dx_1, dy_1, dz_1, ... below each other",
        *([f"# {BOARD}{printed}"] if printed else []),
    ]
    return "\n".join([*first, header, *lines, ""])
