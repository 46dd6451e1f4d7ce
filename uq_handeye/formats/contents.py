"""Content of a pose file as a reader returns it, and its conversion to metres, matrices and one frame."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.checks import TOO_LONG, as_transforms, first_duplicate, repeats_note, rows_once
from ..core.geometry.conventions import CovarianceReading, convention_of
from ..core.geometry.se3 import Array, inverse
from ..core.presentation.units import LENGTH_UNITS
from ..errors import InputError, among, require_one_of
from .rotations import MATRICES, QUATERNIONS, RotationForm, rotation_form

# The frames in which poses are used, and those that are inverted first.
FRAMES = {"robot": ("base_T_gripper", "gripper_T_base"), "camera": ("camera_T_target", "target_T_camera")}
# | |q| - 1 | of an accepted quaternion: four decimals pass, Euler angles and shifted columns do not.
NORM_TOLERANCE = 1e-3
COLUMNS = ("timestamp", "x", "y", "z", "qx", "qy", "qz", "qw")


class Reading(NamedTuple):
    """A way to read the numbers of a pose: the ``format`` that says so, the form of the rotation, the length unit.

    ``units`` None: as for any file. ``rotation_first``: three numbers of the rotation stand before those of the
    translation.
    """

    format: str
    rotation: str
    units: str | None = None
    rotation_first: bool = False

    def __str__(self) -> str:
        order = ", rotation before translation" if self.rotation_first else ""
        return f"{self.format} ({self.rotation}{'' if self.units is None else f', {self.units}'}{order})"


@dataclass(frozen=True, eq=False)
class Side:
    """n poses of one sensor as they stand in a file.

    Parameters
    ----------
    name : the file, for messages
    translation : (n, 3), in the unit of the file
    rotation : (n, 3, 3) matrices, or the numbers (n, 4) or (n, 3) of each as they stand in the file
    timestamps : (n,) seconds, or None
    rows : (n,) line or item number of each pose, for messages
    counted : what ``rows`` number: "line", "sample", "pose"
    order : order of the quaternions, by their names or the rules of the format
    columns : names of timestamp, translation and quaternion in messages
    frame : what the file itself says the poses are, one of `FRAMES`, or None
    units : length unit that the file itself says, or None
    readings : what the numbers of the rotation may be. None: matrices, or quaternions of ``order``. One: no doubt.
        Several: the other side decides (`read.readings`), or who reads.
    others : readings that are tried where robot and camera agree with none of ``readings``
    labels : where each pose stands, for messages, in place of ``rows``
    numbers : (n,) what each pose is counted by: the number in the name of its file, or in a column such as Nr or image
    covariance : (n, 6, 6) numbers of the covariance of each pose as they stand in the file, or None
    convention : how these are read where nothing else is said
    """

    name: str
    translation: Array
    rotation: Array
    timestamps: NDArray[np.float64] | None = None
    rows: NDArray[np.int64] | None = None
    counted: str = "pose"
    order: str = "xyzw"
    columns: tuple[str, ...] = COLUMNS
    frame: str | None = None
    units: str | None = None
    readings: tuple[Reading, ...] = ()
    others: tuple[Reading, ...] = ()
    labels: tuple[str, ...] = ()
    numbers: tuple[int, ...] = ()
    covariance: Array | None = None
    convention: str = "toolkit"

    def __len__(self) -> int:
        return len(self.translation)

    def at(self, k: int) -> str:
        """Pose k in words: ``robot.csv, line 12``."""
        if self.labels:
            return f"{self.name}, {self.labels[k]}"
        number = k if self.rows is None else self.rows[k]
        return f"{self.name}, {self.counted} {number}"


@dataclass(frozen=True, eq=False)
class Contents:
    """Content of one file: both sides, each by its name, or poses of one side that the file does not name."""

    robot: Side | None = None
    camera: Side | None = None
    only: Side | None = None
    setup: str | None = None  # where the file says it
    robot_enters: bool = False  # the robot poses are those of AX = XB: gripper_T_base for eye-to-hand
    notes: tuple[str, ...] = field(default=())


def rows_of_side(side: Side, rows: NDArray[np.intp]) -> Side:
    """Return some of the poses of a side, which keep their places for messages."""
    return replace(
        side,
        translation=side.translation[rows],
        rotation=side.rotation[rows],
        timestamps=None if side.timestamps is None else side.timestamps[rows],
        rows=rows if side.rows is None else side.rows[rows],
        labels=tuple(side.labels[k] for k in rows) if side.labels else (),
        numbers=tuple(side.numbers[k] for k in rows) if side.numbers else (),
        covariance=None if side.covariance is None else side.covariance[rows],
    )


def without_repeats(contents: Contents) -> Contents:
    """Return the poses of one side without rows that repeat time and numbers of another, as recorders write them.

    ur-rtde writes rows at a rate of its own, whether the controller has sent new values or not. Rows with one time and
    other numbers stay, and are refused.
    """
    side = contents.only
    if side is None or side.timestamps is None or len(side) < 2:
        return contents
    table = np.column_stack([side.timestamps, side.translation, side.rotation.reshape(len(side), -1)])
    rows = rows_once(table)
    if len(rows) == len(side):
        return contents
    notes = (*contents.notes, repeats_note(len(side) - len(rows)))
    return replace(contents, only=rows_of_side(side, rows), notes=notes)


def matrices_side(name: str, T: Array, **options: Any) -> Side:
    """Poses given as matrices (n, 4, 4): refused, by their number, if they are no rigid motions."""
    side = Side(name, T[:, :3, 3], T[:, :3, :3], **options)
    with np.errstate(all="ignore"):  # huge numbers overflow before they are refused
        try:
            as_transforms(T, "the matrix")
        except InputError as error:
            found = re.search(r"`the matrix`\[(\d+)\]", str(error))
            text = re.sub(r"`the matrix`\[\d+\]", "the matrix", str(error))
            raise InputError(f"{side.at(int(found[1]) if found else 0)}: {text[0].lower()}{text[1:]}") from error
    return side


def require_units(units: Any) -> float:
    """Metres per unit."""
    require_one_of("units", units, LENGTH_UNITS)
    return LENGTH_UNITS[units]


def finished(side: Side, role: str, units: str | None, rotation: str | None, frame: str) -> Array:
    """Poses (n, 4, 4) in metres, ``base_T_gripper`` or ``camera_T_target``.

    Parameters
    ----------
    side : what the file holds
    role : "robot" or "camera"
    units : unit of the translations; None: as the file says, or its only reading, else m
    rotation : text of a `RotationForm`, what the numbers of the rotation are; None: as the file says
    frame : one of `FRAMES`; the first is that of the file, if the file names one, and the second inverts

    Raises
    ------
    InputError
        Numbers that are not finite, repeated timestamps, quaternions whose norm is not 1 within 1e-3 (the others are
        normalised), a form of rotation that the numbers cannot have, several readings.
    """
    form, reading = _form(side, role, rotation)
    unit = units or side.units or (None if reading is None else reading.units) or "m"
    factor = require_units(unit)
    if side.units is not None:
        if units not in (None, "m", side.units):  # m may be meant for the other file
            raise InputError(
                f"{side.name} names its translations in {side.units}, and `units` (--units) says "
                f"{units}: leave `units` out, or correct the names of the columns."
            )
        factor = require_units(side.units)
    check_numbers(side)
    translation, numbers = side.translation, side.rotation
    if reading is not None and reading.rotation_first:
        translation, numbers = numbers, translation
    poses: Array = np.zeros((len(side), 4, 4))
    poses[:, :3, :3] = form.decode(numbers)
    poses[:, :3, 3] = translation * factor
    poses[:, 3, 3] = 1.0
    usual, inverted = FRAMES[role]
    if not among(frame, (usual, inverted)):
        raise InputError(f"Expected `{role}_frame` (--{role}-frame) to be {usual} or {inverted}, got {frame!r}.")
    return inverse(poses) if inverted in (frame, side.frame) else poses


def known_covariance(side: Side) -> Array | None:
    """Return the numbers of the covariances of a side; None where they are not known for every pose.

    All zero, and -1 in the first place, mean that a covariance is not known.
    """
    S = side.covariance
    if S is None or not np.isfinite(S).all():
        return None
    unknown = (S == 0.0).all(axis=(-2, -1)) | (S[:, 0, 0] == -1.0)
    return None if unknown.any() else S


def finished_covariance(
    side: Side, role: str, units: str | None, rotation: str | None, frame: str, poses: Array, reading: CovarianceReading
) -> Array | None:
    """Covariances (n, 6, 6) of the ``poses`` that `finished` made of the side; None where they are not known.

    ``reading``: how the numbers are read. Raises `InputError` for numbers that are no covariances.
    """
    S = known_covariance(side)
    if S is None:
        return None
    reading_of_rotation = _form(side, role, rotation)[1]
    unit = side.units or units or (None if reading_of_rotation is None else reading_of_rotation.units) or "m"
    factor = require_units(unit)
    lengths = np.array([1.0, 1, 1, factor, factor, factor])
    if convention_of(reading.convention).order.startswith("translation"):
        lengths = np.roll(lengths, 3)
    scale = np.outer(lengths, lengths)
    S = S / scale if reading.information else S * scale
    if FRAMES[role][1] in (frame, side.frame):
        reading = replace(reading, inverse=not reading.inverse)
    return reading.read(S, poses, f"covariance of {side.name}")


def _form(side: Side, role: str, rotation: str | None) -> tuple[RotationForm, Reading | None]:
    """The form of the rotation, and the reading that it is of where the file leaves no doubt."""
    k = 9 if side.rotation.ndim == 3 else side.rotation.shape[1]
    if rotation is not None:
        form = rotation_form(rotation)
        if form.numbers == k:
            same = [reading for reading in side.readings if reading.rotation == rotation]
            readings = same or list(side.readings)
            units = {reading.units for reading in readings}
            return form, readings[0] if len(units) == 1 else None
        what = {9: "rotation matrices", 4: "quaternions", 3: "three numbers per rotation"}[k]
        known = {9: " or ".join(MATRICES), 4: " or ".join(QUATERNIONS), 3: "Euler angles or a rotation vector"}[k]
        raise InputError(
            f"{side.name} holds {what}, and {rotation} does not apply to it: expected {known}. Leave `rotation` "
            f"out for the {role} (--rotation {role}=..., --quaternion {role}=...)."
        )
    if not side.readings:
        return rotation_form({9: "matrix", 4: side.order}[k]), None
    if len(side.readings) > 1:
        raise doubtful(side, role)
    return rotation_form(side.readings[0].rotation), side.readings[0]


def doubtful(side: Side, role: str, why: str = "") -> InputError:
    """Return the error of several readings of one file, with the options that choose one of them."""
    names = ", ".join(map(str, side.readings))
    first = side.readings[0]
    same = all(reading.format == first.format for reading in side.readings)
    option = f"--rotation {role}={first.rotation}" if same else f"--format {role}={first.format}"
    return InputError(
        f"{side.name}: the rotations may be {names}{why}. Say which, e.g. {option} (docs/how-to/controller.md)."
    )


def check_numbers(side: Side) -> None:
    """Raise `InputError` for numbers that are not finite, repeated timestamps, bad norms."""
    parts = [np.full((len(side), 1), 0.0) if side.timestamps is None else side.timestamps[:, None], side.translation]
    table = np.concatenate([*parts, side.rotation.reshape(len(side), -1)], axis=1)
    finite = np.isfinite(table)
    if not finite.all():
        row, column = divmod(int(np.argmin(finite)), table.shape[1])
        field_name = "the matrix" if side.rotation.ndim == 3 and column > 3 else f"column {side.columns[column]}"
        raise InputError(
            f"{side.at(row)}, {field_name}: expected a finite number, got {table[row, column]}; leave out poses that "
            "were not measured, in both files."
        )
    if (far := np.abs(side.translation).max()) > TOO_LONG:
        row = int(np.argmax(np.abs(side.translation).max(axis=1)))
        raise InputError(f"{side.at(row)}: expected a translation below {TOO_LONG:g}, got {far:g}.")
    if side.timestamps is not None and (twins := first_duplicate(side.timestamps)) is not None:
        first = side.at(twins[0]).removeprefix(f"{side.name}, ")
        raise InputError(
            f"{side.at(twins[1])}, column {side.columns[0]}: {side.timestamps[twins[1]].item()!r} repeats the one of "
            f"{first}; every pose needs its own (without times, number the rows 0, 1, 2, ...)."
        )
    if side.rotation.shape[1:] != (4,):
        return
    with np.errstate(over="ignore"):  # an infinite norm is as wrong as a large one
        norms = np.sqrt(np.einsum("ij,ij->i", side.rotation, side.rotation))
    wrong = np.abs(norms - 1.0) > NORM_TOLERANCE
    if wrong.any():
        row = int(np.argmax(wrong))
        where = f"{side.at(row)}, columns {','.join(side.columns[4:])}"
        if norms[row] < NORM_TOLERANCE:
            hint = "the orientation is missing; leave out poses that were not measured, in both files."
        else:
            hint = "are the columns shifted, or are these Euler angles, a rotation vector or rounded numbers?"
        raise InputError(f"{where}: expected a unit quaternion, got the norm {norms[row]:.6g}: {hint}")


def conversion(name: str, load: str) -> str:
    """Return the sentence with the Python line that converts a trusted file, which is FILE in ``load``."""
    path = PurePath(name.partition(", ")[0])
    module = load.partition(".")[0]
    imports = "numpy as np" if "np." in load else f"{module}, numpy as np"
    target = path.stem + ("_poses.npy" if path.suffix == ".npy" else ".npy")
    return (
        f"If you trust it, convert it: import {imports}; "
        f"np.save('{target}', np.array({load.replace('FILE', repr(path.name))}, dtype=float))"
    )
