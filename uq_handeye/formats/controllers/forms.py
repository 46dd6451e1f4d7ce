"""Ways in which controllers write a pose: rotation, length unit, names of the numbers, by ``controllers.toml``.

Poses as texts for a controller, a pendant or software of 3-D cameras: the forms of `forms`, and matrices.

Where the language of a controller has a literal of a pose, a line is that literal (URScript, KRL, RAPID, VAL 3);
otherwise the text is a table with units in its header. Numbers have all digits, so that reading them gives the pose
back to rounding.

Readings of the numbers of poses: the rotation and the length unit, by the convention and by the size of the numbers.

A convention says degrees or radians, millimetres or metres. Numbers of the wrong size contradict it: no robot reaches
20 m, none is calibrated within 5 mm, and no angle in radians is beyond a turn. Then the numbers are right, and a note
says so; where both may be, both are readings, and the other side decides.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...core.files.trees import parse_toml
from ...core.formatting.units import LENGTH_UNITS
from ...core.geometry.se3 import Array
from ...errors import InputError
from ..contents import Contents, Reading, Side, rotation_form


@dataclass(frozen=True)
class PoseForm:
    """A pose as a controller writes it.

    Parameters
    ----------
    name : as ``--format`` takes it
    maker : for people
    rotation : text of a `RotationForm`
    units : length unit
    columns : names of the numbers of the rotation, in their order
    source : the maker's documentation that is followed
    literal : a pose in the language of the controller, if it has one: ``{name}``, and the numbers by their places
    comment : mark of comments in that language
    """

    name: str
    maker: str
    rotation: str
    units: str
    columns: tuple[str, ...]
    source: str
    literal: str = ""
    comment: str = "#"


CONTROLLERS = {
    name: PoseForm(name, **form | {"columns": tuple(form["columns"])})
    for name, form in parse_toml(Path(__file__).with_name("controllers.toml")).items()
}


# HALCON's pose type 0: 'Rp+T', 'gba', 'point', that is Rx(alpha) Ry(beta) Rz(gamma).
_HALCON = rotation_form("XYZ-deg")
# Files of one pose.
SINGLE = ("zivid", "halcon")


def in_form(T: Array, form: PoseForm) -> Array:
    """Numbers (n, 3 + k) of poses (n, 4, 4) in metres as a controller writes them."""
    rotation = rotation_form(form.rotation).encode(T[:, :3, :3])
    return np.concatenate([T[:, :3, 3] / LENGTH_UNITS[form.units], rotation], axis=1) + 0.0


def columns(form: PoseForm) -> tuple[list[str], list[str]]:
    """Return names and units of the numbers of `in_form`."""
    capital = form.columns[0][0].isupper()
    axes = list("XYZ" if capital else "xyz")
    unit = form.rotation.partition("-")[2]
    return [*axes, *form.columns], [form.units] * 3 + [unit] * len(form.columns)


def written_poses(T: Array, format: str, names: Sequence[str], comments: Sequence[str] = ()) -> str:
    """Return poses (n, 4, 4) in metres as text in a format of `WRITTEN`, below lines of comments.

    Raises `InputError` for an unknown format, and for several poses in a format of one per file.
    """
    if format not in WRITTEN:
        raise InputError(f"Expected `format` to be one of {', '.join(WRITTEN)}, got {format!r}.")
    if format in SINGLE and len(T) != 1:
        raise InputError(f"A file of the format {format} holds one pose, not {len(T)}.")
    form = CONTROLLERS.get(format)
    mark = "#" if form is None else form.comment
    lines = _LINES[format](T, names) if form is None else _of_controller(T, form, names)
    return "\n".join([*(f"{mark} {comment}" for comment in comments), *lines, ""])


def _of_controller(T: Array, form: PoseForm, names: Sequence[str]) -> list[str]:
    numbers = in_form(T, form)
    if form.literal:
        return [form.literal.format(*row, name=name) for name, row in zip(names, numbers.tolist(), strict=True)]
    head = [f"{name} [{unit}]" if unit else name for name, unit in zip(*columns(form), strict=True)]
    return [",".join(head), *(",".join(map(repr, row)) for row in numbers.tolist())]


def _franka(T: Array, names: Sequence[str]) -> list[str]:
    head = ",".join(f"O_T_EE_{k}" for k in range(16))
    return [head, *(",".join(map(repr, pose.T.ravel().tolist())) for pose in T)]


def _zivid(T: Array, names: Sequence[str]) -> list[str]:
    in_mm = T[0].copy()
    in_mm[:3, 3] *= 1e3
    rows = ",\n".join(f"    [{', '.join(map(repr, row))}]" for row in in_mm.tolist())
    return ["__version__:", "  serializer: 1", "  data: 1", "FloatMatrix:", "  Data: [", *rows.split("\n"), "  ]"]


def _halcon(T: Array, names: Sequence[str]) -> list[str]:
    angles = (_HALCON.encode(T[:, :3, :3]) + 0.0)[0].tolist()
    return [
        "# 3D POSE PARAMETERS: rotation and translation",
        "",
        "# Used representation type:",
        "f 0",
        "",
        "# Rotation angles [deg] or Rodriguezvector:",
        f"r {' '.join(map(repr, angles))}",
        "",
        "# Translation vector (x y z [m]):",
        f"t {' '.join(map(repr, T[0, :3, 3].tolist()))}",
    ]


_LINES: dict[str, Callable[[Array, Sequence[str]], list[str]]] = {
    "matrix": lambda T, names: [" ".join(map(repr, pose.ravel().tolist())) for pose in T],
    "franka": _franka,
    "zivid": _zivid,
    "halcon": _halcon,
}
# All formats of `written_poses`.
WRITTEN = (*CONTROLLERS, *_LINES)


# Translations: all below the first are in m, some beyond the second in mm; between them both may be.
METRES, MILLIMETRES = 5.0, 20.0
# An angle in rad is at most a turn; the rest is rounding.
TURN = 2.0 * np.pi + 1e-3

# Forms of three numbers whose names do not say which they are.
_UNSAID = (
    ("ur", "rotvec-rad"), ("rpy", "xyz-rad"), ("table", "XYZ-rad"), ("table", "ZYX-rad"), ("table", "ZYZ-rad"),
    ("kuka", "ZYX-deg"), ("fanuc", "xyz-deg"), ("staubli", "XYZ-deg"), ("kawasaki", "ZYZ-deg"),
    ("table", "rotvec-deg"),
)  # fmt: skip
# The same by the names rx, ry, rz (each about its own axis), and alpha, beta, gamma.
_BY_AXES = (
    ("ur", "rotvec-rad"), ("rpy", "xyz-rad"), ("table", "XYZ-rad"),
    ("yaskawa", "xyz-deg"), ("staubli", "XYZ-deg"), ("table", "rotvec-deg"),
)  # fmt: skip
_BY_KIND: dict[str, tuple[tuple[str, str], ...]] = {
    "abc": (("kuka", "ZYX-deg"),),
    "wpr": (("fanuc", "xyz-deg"),),
    "oat": (("kawasaki", "ZYZ-deg"),),
    "aer": (("comau", "ZYZ-deg"),),
    "uvw": (("epson", "ZYX-deg"),),
    "rpy": (("rpy", "xyz-rad"),),
    "rotvec": (("ur", "rotvec-rad"),),
    "rxyz": _BY_AXES,
    "euler": _UNSAID,
    "unsaid": _UNSAID,
}


def interpret(
    kind: str, translation: Array, rotation: Array, form: PoseForm | None, length: str | None, angle: str | None
) -> tuple[tuple[Reading, ...], list[str]]:
    """Return the readings of poses, and what is to be said of them.

    Parameters
    ----------
    kind : what the names of the rotation are, a key of `columns.ROTATIONS` or `columns.QUATERNIONS`; "unsaid"
    translation, rotation : the numbers, (n, 3) and (n, 3) or (n, 4)
    form : the maker that is asked for, or that the file names; None: by ``kind``
    length, angle : units that the file itself says
    """
    readings: list[Reading] = []
    for name, text in _forms(kind, rotation, translation, form):
        maker = CONTROLLERS.get(name)
        for said in _angles(text, rotation, angle, only=form is not None):
            units = (length,) if length else _lengths(translation, None if maker is None else maker.units)
            readings += [Reading(name, said, unit) for unit in units]
    # Those that are the maker's own come first, and what says the same as one before is left out.
    readings.sort(key=lambda one: one.format not in CONTROLLERS or CONTROLLERS[one.format].rotation != one.rotation)
    distinct: dict[tuple[str, str | None], Reading] = {}
    for reading in readings:
        distinct.setdefault((reading.rotation, reading.units), reading)
    found = tuple(distinct.values())
    makers = {reading.format for reading in found}
    return found, _contradictions(found, form or (CONTROLLERS.get(makers.pop()) if len(makers) == 1 else None))


def in_convention(contents: Contents, form: PoseForm) -> Contents:
    """Return poses of arrays or JSON in the convention of a maker that is asked for.

    Raises `InputError` for matrices, and for numbers that the file itself names otherwise.
    """
    sides: dict[str, Any] = {}
    notes: list[str] = []
    for role in ("robot", "camera", "only"):
        side: Side | None = getattr(contents, role)
        if side is None:
            continue
        if got := _against(side, form):
            raise InputError(
                f"{side.name}: expected x, y, z, {', '.join(form.columns)} ({form.maker}), got {got}. Leave --format "
                "out; see docs/how-to/controller.md."
            )
        angle = "deg" if form.rotation.endswith("-deg") else None
        readings, said = interpret("unsaid", side.translation, side.rotation, form, side.units, angle)
        sides[role] = replace(side, readings=readings)
        notes += said
    return replace(contents, notes=(*contents.notes, *notes), **sides)


def _against(side: Side, form: PoseForm) -> str | None:
    """Return what a file holds in place of the numbers of a maker; None where it may hold these."""
    if side.rotation.ndim == 3:
        return "matrices"
    if side.rotation.shape[1] != rotation_form(form.rotation).numbers:
        return f"{side.rotation.shape[1]} numbers per rotation"
    said = {reading.rotation for reading in side.readings} or {side.order}
    names = tuple(name.lower() for name in side.columns[4:])
    if len(said) > 1 or names == tuple(name.lower() for name in form.columns):
        return None
    stem = said.pop().partition("-")[0]
    return None if stem == form.rotation.partition("-")[0] else f"the numbers {', '.join(side.columns[4:])} ({stem})"


def _forms(kind: str, rotation: Array, translation: Array, form: PoseForm | None) -> Sequence[tuple[str, str]]:
    if rotation.shape[1] == 4:
        if form is not None and rotation_form(form.rotation).numbers == 4:
            return ((form.name, form.rotation),)
        small = translation.size > 0 and np.nanmax(np.abs(translation)) < MILLIMETRES
        return {
            "named": (("table", "xyzw"),),
            "q1234": (("abb", "wxyz"), ("table", "xyzw")) if small else (("abb", "wxyz"),),
            "q0123": (("abb", "wxyz"),),
        }.get(kind, (("abb", "wxyz"), ("table", "xyzw")))
    if form is not None:
        return ((form.name, form.rotation),)
    return _BY_KIND[kind]


def _angles(text: str, rotation: Array, unit: str | None, only: bool) -> list[str]:
    """Return the form with the unit, or both units, that the numbers may have."""
    found = rotation_form(text)
    if found.numbers != 3:
        return [text]
    stem = text[:-3]
    if unit is not None:
        return [stem + unit]
    largest = _largest(np.linalg.norm(rotation, axis=1) if stem == "rotvec-" else rotation)
    if largest > TURN:
        return [f"{stem}deg"]
    if text.endswith("rad") and (only or len(rotation) > 1 or stem == "rotvec-"):
        return [text]
    return [text, stem + ("deg" if text.endswith("rad") else "rad")]


def _lengths(translation: Array, usual: str | None) -> tuple[str, ...]:
    """Return the length units that the numbers may be in, the maker's first."""
    largest = _largest(translation)
    if largest < METRES:
        return ("m",)
    if largest > MILLIMETRES:
        return ("mm",)
    return ("mm", "m") if usual == "mm" else ("m", "mm")


def _largest(numbers: Array) -> float:
    finite = np.abs(numbers[np.isfinite(numbers)])
    return float(finite.max()) if finite.size else 0.0


def _contradictions(readings: Sequence[Reading], form: PoseForm | None) -> list[str]:
    """Return notes of units other than those of the convention."""
    if form is None:
        return []
    notes = []
    lengths = {reading.units for reading in readings}
    if form.units not in lengths:
        (other,) = lengths if len(lengths) == 1 else ("several units",)
        notes.append(f"translations in {other}, as their size shows or the file says; {form.name} has {form.units}")
    angles = {reading.rotation for reading in readings}
    if form.rotation not in angles and len(angles) == 1:
        notes.append(f"rotations {angles.pop()}, as their size shows or the file says; {form.name} has {form.rotation}")
    return notes
