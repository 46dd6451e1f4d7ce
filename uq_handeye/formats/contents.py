"""Content of a pose file as a reader returns it, and its conversion to metres, matrices and one frame.

Rotations as numbers: quaternions, rotation vectors, Euler angles of any order, matrices.

A form is a text: ``xyzw`` and ``wxyz`` (quaternions), ``rotvec-rad`` and ``rotvec-deg`` (rotation vectors), an order of
axes with the unit of the angles, such as ``ZYX-deg`` or ``xyz-rad``, or, for matrices 3x3, ``matrix`` and
``transposed``. The axes are those of SciPy's ``Rotation.from_euler``: capital letters rotate about the rotated axes
(intrinsic), small letters about the fixed axes (extrinsic). ``ZYX`` with angles a, b, c is ``Rz(a) Ry(b) Rx(c)``, and
so is ``xyz`` with c, b, a.

Poses of a folder or a pattern with one file per pose, as if they stood in one file.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from itertools import product
from pathlib import Path, PurePath
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..core.files.folders import numbers_in
from ..core.files.open import shown
from ..core.files.source import Source
from ..core.formatting.units import LENGTH_UNITS
from ..core.geometry.checks import TOO_LONG, as_transforms, first_duplicate
from ..core.geometry.se3 import Array, inverse
from ..errors import InputError, among, require_one_of

# The frames in which poses are used, and those that are inverted first.
FRAMES = {"robot": ("base_T_gripper", "gripper_T_base"), "camera": ("camera_T_target", "target_T_camera")}

# | |q| - 1 | of an accepted quaternion: four decimals pass, Euler angles and shifted columns do not.
NORM_TOLERANCE = 1e-3

COLUMNS = ("timestamp", "x", "y", "z", "qx", "qy", "qz", "qw")


@dataclass(frozen=True)
class Reading:
    """A way to read the numbers of a pose: the ``format`` that says so, the form of the rotation, the length unit.

    ``units`` None: as for any file.
    """

    format: str
    rotation: str
    units: str | None = None

    def __str__(self) -> str:
        return f"{self.format} ({self.rotation}{'' if self.units is None else f', {self.units}'})"


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
        Several: the other side decides (`io.readings`), or who reads.
    labels : where each pose stands, for messages, in place of ``rows``
    numbers : (n,) what each pose is counted by: the number in the name of its file, or in a column such as Nr or image
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
    labels: tuple[str, ...] = ()
    numbers: tuple[int, ...] = ()

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
    poses: Array = np.zeros((len(side), 4, 4))
    poses[:, :3, :3] = form.decode(side.rotation)
    poses[:, :3, 3] = side.translation * factor
    poses[:, 3, 3] = 1.0
    usual, inverted = FRAMES[role]
    if not among(frame, (usual, inverted)):
        raise InputError(f"Expected `{role}_frame` (--{role}-frame) to be {usual} or {inverted}, got {frame!r}.")
    return inverse(poses) if inverted in (frame, side.frame) else poses


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
            f"out for the {role} (--rotation, --quaternion)."
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


QUATERNIONS = ("xyzw", "wxyz")
MATRICES = ("matrix", "transposed")
VECTORS = ("rotvec-rad", "rotvec-deg")
# All orders of axes: no axis twice in a row.
SEQUENCES = tuple(
    "".join(axes)
    for letters in ("XYZ", "xyz")
    for axes in product(letters, repeat=3)
    if axes[0] != axes[1] and axes[1] != axes[2]
)

# How many numbers each form has.
_NUMBERS = {
    **dict.fromkeys(QUATERNIONS, 4),
    **dict.fromkeys(MATRICES, 9),
    **dict.fromkeys((*VECTORS, *(f"{order}-{unit}" for order in SEQUENCES for unit in ("deg", "rad"))), 3),
}


@dataclass(frozen=True)
class RotationForm:
    """One of the forms: its ``text``, how many ``numbers`` it has, 3, 4 or 9."""

    text: str
    numbers: int

    def decode(self, values: Array) -> Array:
        """Rotation matrices (n, 3, 3) of numbers (n, k), or of matrices (n, 3, 3)."""
        if self.text in MATRICES:
            return values if self.text == "matrix" else np.swapaxes(values, -1, -2)
        if self.text in QUATERNIONS:
            rotation = Rotation.from_quat(values, scalar_first=self.text == "wxyz")
        elif self.text in VECTORS:
            rotation = Rotation.from_rotvec(values, degrees=self.degrees)
        else:
            rotation = Rotation.from_euler(cast(Any, self.text[:3]), values, degrees=self.degrees)
        return np.asarray(rotation.as_matrix())

    def encode(self, R: Array) -> Array:
        """Numbers (n, k) of rotation matrices (n, 3, 3), or matrices; a quaternion has a scalar of at least 0."""
        rotation = Rotation.from_matrix(R)
        if self.text in QUATERNIONS:
            return np.asarray(rotation.as_quat(canonical=True, scalar_first=self.text == "wxyz"))
        if self.text in MATRICES:
            return R if self.text == "matrix" else np.swapaxes(R, -1, -2)
        if self.text in VECTORS:
            return np.asarray(rotation.as_rotvec(degrees=self.degrees))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # gimbal lock: SciPy sets the third angle to 0, which is right
            return np.asarray(rotation.as_euler(cast(Any, self.text[:3]), degrees=self.degrees))

    @property
    def degrees(self) -> bool:
        """True for angles and rotation vectors in degrees."""
        return self.text.endswith("-deg")


def rotation_form(text: Any) -> RotationForm:
    """Return the form of a text; raises `InputError` for any other text."""
    if among(text, _NUMBERS):
        return RotationForm(text, _NUMBERS[text])
    hint = ""
    if among(text, (*SEQUENCES, "rotvec")):
        hint = f"; add the unit of the angles: {text}-deg or {text}-rad"
    elif str(text).lower() in ("rpy-deg", "rpy-rad"):
        hint = f"; roll, pitch, yaw are xyz{text[3:].lower()}"
    raise InputError(
        "Expected `rotation` (--rotation) to be an order of Euler angles with its unit (ZYX-deg: rotated "
        f"axes; xyz-rad: fixed axes), rotvec-rad, rotvec-deg, xyzw, wxyz, matrix or transposed, got {text!r}{hint}."
    )


def joined_contents(
    name: str, paths: Sequence[Path], parts: Sequence[tuple[Contents, Source]], left: Sequence[str] = ()
) -> tuple[Contents, Source]:
    """The contents of several files as one, in their order; ``left`` are notes of what is not among them.

    Raises `InputError` for a file that holds more than one pose, and for files of different formats, units or sides, by
    the first name that differs.
    """
    contents, sources = zip(*parts, strict=True)
    for path, one, source in zip(paths, contents, sources, strict=True):
        if any((n := len(getattr(one, role))) != 1 for role in _sides_of(one)):
            raise InputError(
                f"Expected one pose in each file of the folder or pattern {name}, got {n} in {shown(path)}. Give a "
                "file of several poses by its own name."
            )
        same = source.format == sources[0].format and one.setup == contents[0].setup
        if not same or _sides_of(one) != _sides_of(contents[0]):
            raise InputError(
                f"{shown(path)} ({source.format}) is not like {shown(paths[0])} ({sources[0].format}): expected "
                f"files of one format, side and setup in {name}."
            )
    total = sha256()
    for source in sources:
        total.update(bytes.fromhex(source.sha256))
    notes = list(dict.fromkeys(note for source in sources for note in source.notes))[:5]
    notes += left
    notes.append(f"{len(paths)} files, {shown(Path(paths[0].name))} to {shown(Path(paths[-1].name))}, by their names")
    size = sum(source.size for source in sources)
    source = Source(shown(Path(Path(name).name)), sources[0].format, size, total.hexdigest(), tuple(notes))
    joined = {role: _joined(name, paths, [getattr(one, role) for one in contents]) for role in _sides_of(contents[0])}
    return replace(contents[0], **joined, notes=tuple(notes)), source


def _sides_of(contents: Contents) -> list[str]:
    return [role for role in ("robot", "camera", "only") if getattr(contents, role) is not None]


def _joined(name: str, paths: Sequence[Path], sides: Sequence[Side]) -> Side:
    first = sides[0]
    for path, side in zip(paths, sides, strict=True):
        kinds = [(one.rotation.shape[1:], one.order, one.units, one.frame) for one in (first, side)]
        if kinds[0] != kinds[1]:
            raise InputError(
                f"{shown(path)} is not like {shown(paths[0])}: other units, frames or numbers of rotations."
            )
    # Of several readings those are left that hold for every file.
    readings = tuple(reading for reading in first.readings if all(reading in side.readings for side in sides))
    if first.readings and not readings:
        raise InputError(f"The files of {name} leave no common reading of the rotations. Give --format.")
    times = [side.timestamps for side in sides if side.timestamps is not None]
    stamps = np.concatenate(times) if len(times) == len(sides) else None
    if stamps is not None and first_duplicate(stamps) is not None:  # each file counts from 0
        stamps = None
    return replace(
        first,
        name=name,
        translation=np.concatenate([side.translation for side in sides]),
        rotation=np.concatenate([side.rotation for side in sides]),
        timestamps=stamps,
        rows=None,
        readings=readings,
        labels=tuple(shown(Path(path.name)) for path in paths),
        numbers=numbers_in(path.name for path in paths),
    )


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
