"""Readings of the numbers of poses: the rotation and the length unit, by the convention and by the size of the numbers.

A convention says degrees or radians, millimetres or metres. Numbers of the wrong size contradict it: no robot reaches
20 m, none is calibrated within 5 mm, and no angle in radians exceeds one revolution. Then the size of the numbers
decides, and a note says so; where both units are possible, both are readings, and the other side decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...core.geometry.se3 import Array
from ...core.limits import MAX_PLAIN_ANGLE_RAD
from ...errors import InputError
from ..contents import Contents, Reading, Side
from ..rotations import rotation_form
from .forms import CONTROLLERS, PoseForm, forms_of

# Translations that are all below the first are in m, and beyond the second in mm; between them both may be.
MAX_ROBOT_REACH_M, MIN_ROBOT_REACH_MM = 5.0, 20.0
# An angle in degrees is at most a full circle; the rest is rounding.
MAX_ANGLE_DEG = 360.1
# Possible forms of three numbers whose names do not give the form; and of rx, ry, rz, each about its own axis.
_UNSAID = forms_of("ur", "rpy", "XYZ-rad", "ZYX-rad", "ZYZ-rad", "kuka", "fanuc", "staubli", "kawasaki", "rotvec-deg")
_BY_AXES = forms_of("ur", "rpy", "XYZ-rad", "yaskawa", "staubli", "rotvec-deg")
_BY_KIND = {
    "abc": forms_of("kuka"),
    "wpr": forms_of("fanuc"),
    "oat": forms_of("kawasaki"),
    "aer": forms_of("comau"),
    "uvw": forms_of("epson"),
    "rpy": forms_of("rpy"),
    "rotvec": forms_of("ur"),
    "rxyz": _BY_AXES,
    "euler": _UNSAID,
    "unsaid": _UNSAID,
}


class Interpretation(NamedTuple):
    """Readings of poses, what is to be said of them, and the readings to try where none of the first agrees."""

    readings: tuple[Reading, ...]
    notes: list[str]
    others: tuple[Reading, ...] = ()


def interpret(
    kind: str, translation: Array, rotation: Array, form: PoseForm | None, length: str | None, angle: str | None
) -> Interpretation:
    """Return the readings of poses, and what is to be said of them.

    Of six numbers without names the rotation may stand first: that is tried where nothing else agrees, and taken at
    once where the last three are too large for angles.

    Parameters
    ----------
    kind : what the names of the rotation are, a key of `columns.ROTATIONS` or `columns.QUATERNIONS`; "unsaid"
    translation, rotation : the numbers, (n, 3) and (n, 3) or (n, 4)
    form : the maker that is asked for, or that the file names; None: by ``kind``
    length, angle : units that the file itself says
    """
    found = _readings(kind, translation, rotation, form, length, angle)
    others: tuple[Reading, ...] = ()
    if kind == "unsaid" and rotation.shape[1] == 3 and _largest(translation) <= MAX_ANGLE_DEG:
        turned = _readings(kind, rotation, translation, form, length, angle)
        others = tuple(reading._replace(rotation_first=True) for reading in turned)
        if _largest(rotation) > MAX_ANGLE_DEG:
            note = "the rotation stands before the translation: the last three numbers are too large for angles"
            return Interpretation(others, [note])
        others = others if form is None else ()
    makers = {reading.format for reading in found}
    notes = _contradictions(found, form or (CONTROLLERS.get(makers.pop()) if len(makers) == 1 else None))
    return Interpretation(found, notes, others)


def _readings(
    kind: str, translation: Array, rotation: Array, form: PoseForm | None, length: str | None, angle: str | None
) -> tuple[Reading, ...]:
    """Return the readings of poses, their translation first."""
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
    return tuple(distinct.values())


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
        read = interpret("unsaid", side.translation, side.rotation, form, side.units, angle)
        sides[role] = replace(side, readings=read.readings, others=read.others)
        notes += read.notes
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
        small = translation.size > 0 and np.nanmax(np.abs(translation)) < MIN_ROBOT_REACH_MM
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
    if largest > MAX_PLAIN_ANGLE_RAD:
        return [f"{stem}deg"]
    if text.endswith("rad") and (only or len(rotation) > 1 or stem == "rotvec-"):
        return [text]
    return [text, stem + ("deg" if text.endswith("rad") else "rad")]


def _lengths(translation: Array, usual: str | None) -> tuple[str, ...]:
    """Return the length units that the numbers may be in, the maker's first."""
    largest = _largest(translation)
    if largest < MAX_ROBOT_REACH_M:
        return ("m",)
    if largest > MIN_ROBOT_REACH_MM:
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
