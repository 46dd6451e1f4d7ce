r"""Chains from tables of Denavit-Hartenberg parameters, in arrays, CSV or TOML.

Each row has theta, d, a, alpha. In the *standard* convention a row takes the frame before a joint to the one behind it,

    A_k = Rot_z(q_k + theta_k) Trans_z(d_k) Trans_x(a_k) Rot_x(alpha_k)

and in the *modified* one (Craig) a and alpha come first,

    A_k = Rot_x(alpha_k) Trans_x(a_k) Rot_z(q_k + theta_k) Trans_z(d_k)

where row k holds what Craig writes a_(k-1), alpha_(k-1). A prismatic joint adds q_k to d_k; a row of the type "fixed"
does not move. The joint offset, if there is one, is added to what moves. rad and m, unless the file says otherwise.

CSV, with a comment that names the convention, and TOML:

    # convention: standard
    joint,theta [deg],d [mm],a [mm],alpha [deg],type,lower,upper,offset
    shoulder,0,89.159,0,90,revolute,-360,360,0

    convention = "modified"
    angle = "deg"                     # of numbers; "90deg" carries its own
    length = "mm"
    [[joints]]
    name = "shoulder"
    d = 89.159
    alpha = "90deg"
    lower = -360
    upper = 360

Further keys of the TOML file, all optional: name, base, tip (names of the frames) and up.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from ....core.files.json_values import Json
from ....core.files.lines import is_number
from ....core.files.one_line import short
from ....core.files.open import StrPath, as_path, opened, shown
from ....core.files.table import Places, Schema, in_order, name_and_unit, read_table
from ....core.files.tree_values import is_list, is_map, is_plain_number
from ....core.files.trees import parse_toml
from ....core.geometry.checks import as_numbers
from ....core.geometry.rotations import Rotation
from ....core.geometry.se3 import Array
from ....core.limits import MAX_DESCRIPTION_BYTES, MAX_PLAIN_ANGLE_RAD, MAX_PLAIN_LENGTH_M
from ....core.presentation.units import ANGLE_UNITS, LENGTH_UNITS
from ....errors import InputError, among
from ..joint import MAX_JOINTS, PRISMATIC, REVOLUTE, ChainParts, Joint

CONVENTIONS = ("standard", "modified")
KINDS = (REVOLUTE, PRISMATIC, "fixed")
# Largest limit of a joint without a unit (rad); larger ones are in degrees.
MAX_PLAIN_LIMIT_RAD = 8 * np.pi + 1e-3

# A field of a row: a number, text, or text with the unit of its column.
Cell: TypeAlias = float | str | tuple[str, str | None]
Row: TypeAlias = dict[str, Cell]

_ANGLES, _LENGTHS = ("theta", "alpha"), ("d", "a")
_PARTNER = {"theta": "alpha", "alpha": "theta", "d": "a", "a": "d"}
_FIELDS = ("joint", *_ANGLES, *_LENGTHS, "type", "lower", "upper", "offset")
_OF_FILE = ("convention", "angle", "length", "name", "base", "tip", "up", "joints")
_NAMES = {"name": "joint", "kind": "type", "\u03b8": "theta", "\u03b1": "alpha"}
_VARIABLE = re.compile(r"\*?|(?:q|theta|\u03b8|d)_?\d*\*?", re.IGNORECASE)
_UNITS = {*ANGLE_UNITS, *LENGTH_UNITS}
_SAID = re.compile(r"\bconvention\s*[:=]?\s*\"?(\w+)", re.IGNORECASE)
_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s.+-]\S*)\s*")


def read_dh(
    table: StrPath | ArrayLike | Sequence[Mapping[str, Cell]],
    convention: str | None,
    *,
    names: Sequence[str] | None,
    kinds: Sequence[str] | None,
    limits: ArrayLike | None,
    angle: str | None,
    length: str | None,
) -> ChainParts:
    """The chain of a table: an array (L, 4), rows as dicts, or the path of a file; raises `InputError`."""
    about: dict[str, Any] = {}
    if isinstance(table, str | PathLike):
        if names is not None or kinds is not None or limits is not None:
            raise InputError("A file of DH parameters names its joints, types and limits: leave these arguments out.")
        path = as_path(table)
        where = shown(path)
        rows, about = _toml(path) if path.suffix.lower() == ".toml" else _csv(path)
        says = about.get("convention")
        if says is None and convention is None:
            raise InputError(
                f"{where} does not say the convention of its DH parameters; add the line '# convention: standard' (or "
                'modified, after Craig) to a CSV file, convention = "standard" to TOML.'
            )
        if convention not in (None, says) and says is not None:
            raise InputError(f"{where} is in the {says} convention, and `convention` says {convention!r:.40}.")
        convention = says or convention
    else:
        where = "the DH table"
        rows = _rows(table, names, kinds, limits)
        convention = convention or "standard"
    if convention not in CONVENTIONS:
        raise InputError(f"Expected the convention of {where} to be standard or modified, got {convention!r:.40}.")
    if not 1 <= len(rows) <= 2 * MAX_JOINTS:
        raise InputError(f"{where}: expected 1 to {2 * MAX_JOINTS} rows, got {len(rows)}.")
    units = {
        "angle": _unit(about.get("angle"), angle, "angle", ANGLE_UNITS, where),
        "length": _unit(about.get("length"), length, "length", LENGTH_UNITS, where),
    }
    joints: list[Joint] = []
    T: Array = np.eye(4)
    for k, row in enumerate(rows):
        at = f"{where}, {row.pop('where', f'row {k}')}"
        before, after, joint = _row(row, convention, units, at, f"joint_{k + 1}")
        T = T @ before
        if joint is not None:
            try:
                joints.append(Joint(joint[0], joint[1], T, np.array([0.0, 0.0, 1.0]), *joint[2]))
            except InputError as error:
                raise InputError(f"{at}: {error}") from error
            T = np.eye(4)
        T = T @ after
    up = None if "up" not in about else as_numbers(about["up"], "up")
    name, base, tip = (about.get(key, default) for key, default in (("name", "arm"), ("base", "base"), ("tip", "tip")))
    return ChainParts(name, base, tip, tuple(joints), T, up)


def _rows(
    table: ArrayLike | Sequence[Mapping[str, Cell]],
    names: Sequence[str] | None,
    kinds: Sequence[str] | None,
    limits: ArrayLike | None,
) -> list[Row]:
    """Rows of fields from an array, or from dicts."""
    if isinstance(table, Sequence) and table and all(isinstance(row, Mapping) for row in table):
        if names is not None or kinds is not None or limits is not None:
            raise InputError("Rows of DH parameters given as dicts hold names, types and limits themselves.")
        return _known(cast("Sequence[Mapping[str, Cell]]", table), "the DH table, row")
    numbers = as_numbers(table, "the DH table")
    if numbers.ndim != 2 or numbers.shape[1] != 4:
        raise InputError(f"Expected the DH table to have shape (L, 4), theta, d, a, alpha; got {numbers.shape}.")
    rows: list[Row] = [dict(zip(("theta", "d", "a", "alpha"), row, strict=True)) for row in numbers.tolist()]
    for values, keys in ((names, "joint"), (kinds, "type")):
        if values is not None:
            if isinstance(values, str) or len(values) != len(rows):
                raise InputError(f"Expected a {keys} for each of {len(rows)} rows of the DH table, got {values!r:.80}.")
            for row, value in zip(rows, values, strict=True):
                row[keys] = value
    if limits is not None:
        bounds = as_numbers(limits, "limits")
        if bounds.shape != (len(rows), 2):
            raise InputError(f"Expected `limits` to have shape ({len(rows)}, 2), got {bounds.shape}.")
        for row, (lower, upper) in zip(rows, bounds.tolist(), strict=True):
            row.update(lower=lower, upper=upper)
    return _known(rows, "the DH table, row")


def _known(rows: Sequence[Mapping[str, Cell]], where: str) -> list[Row]:
    """Rows by the names of fields, without those that are empty."""
    found: list[Row] = []
    for k, row in enumerate(rows):
        names = [_NAMES.get(str(key).lower(), str(key).lower()) for key in row]
        for name, key in zip(names, row, strict=True):
            if name not in _FIELDS:
                raise InputError(f"{where} {k}: unknown field {short(str(key))}; expected {', '.join(_FIELDS)}.")
            if names.count(name) > 1:
                raise InputError(f"{where} {k}: the field {name} is given twice.")
        values = [value.strip() if isinstance(value, str) else value for value in row.values()]
        found.append({name: value for name, value in zip(names, values, strict=True) if value not in (None, "")})
    return found


def _unit(says: Json, asked: str | None, what: str, known: dict[str, float], where: str) -> str | None:
    for unit in (says, asked):
        if unit is not None and not among(unit, known):
            raise InputError(f"Expected the {what} unit of {where} to be one of {', '.join(known)}, got {unit!r:.40}.")
    if None not in (says, asked) and says != asked:
        raise InputError(f"{where} has its {what}s in {says}, and `{what}` says {asked}.")
    return asked if says is None else str(says)


# One row


def _row(
    row: Row, convention: str, units: dict[str, str | None], at: str, default: str
) -> tuple[Array, Array, tuple[str, str, tuple[float, float]] | None]:
    """The fixed transforms before and behind the motion of a row, and name, kind and limits of its joint."""
    kind = str(row.get("type", REVOLUTE)).lower()
    kind = {"r": REVOLUTE, "p": PRISMATIC, "continuous": REVOLUTE}.get(kind, kind)
    if kind not in KINDS:
        raise InputError(f"{at}: expected the type to be one of {', '.join(KINDS)}, got {kind!r:.40}.")
    moving = {REVOLUTE: "theta", PRISMATIC: "d"}.get(kind)
    value = {}
    for name in (*_ANGLES, *_LENGTHS):
        given = row.get(name, 0.0)
        if name == moving and _VARIABLE.fullmatch(str(given)):
            given = 0.0  # q1, theta_1 or *: the variable itself
        largest = MAX_PLAIN_ANGLE_RAD if name in _ANGLES else MAX_PLAIN_LENGTH_M
        value[name] = _quantity(given, "angle" if name in _ANGLES else "length", units, largest, f"{at}, {name}")
    limits = (-np.inf, np.inf)
    if moving is not None:
        of = "angle" if kind == REVOLUTE else "length"
        largest = MAX_PLAIN_LIMIT_RAD if kind == REVOLUTE else MAX_PLAIN_LENGTH_M
        value[moving] += _quantity(row.get("offset", 0.0), of, units, largest, f"{at}, offset")
        lower, upper = (
            end if row.get(name, end) == end else _quantity(row[name], of, units, largest, f"{at}, {name}")
            for name, end in (("lower", -np.inf), ("upper", np.inf))
        )
        limits = (lower, upper)
    along = _screw(2, value["theta"], value["d"])
    across = _screw(0, value["alpha"], value["a"])
    # What moves commutes with the screw along z: the joint acts before that in both conventions.
    before, after = (np.eye(4), along @ across) if convention == "standard" else (across, along)
    if moving is None:
        return before, after, None
    return before, after, (cast(str, row.get("joint", default)), kind, limits)


def _screw(axis: int, turn: float, shift: float) -> Array:
    """Rotation about and shift along x (0) or z (2)."""
    T: Array = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(turn * np.eye(3)[axis]).as_matrix()
    T[axis, 3] = shift
    return T


def _quantity(value: Cell, of: str, units: dict[str, str | None], largest: float, at: str) -> float:
    """A number in rad or m, from a number or text with or without a unit."""
    known, unit = (ANGLE_UNITS, units["angle"]) if of == "angle" else (LENGTH_UNITS, units["length"])
    if isinstance(value, tuple):  # a field of a CSV file, with the unit of its column
        value, named = value
        if named is not None and named not in known:
            raise InputError(
                f"{at}: expected {'an angle' if of == 'angle' else 'a length'}, got {short(value)} {named}."
            )
        unit = named or unit
        value = 0.0 if not value.strip() else value
    if isinstance(value, str):
        if is_number(value.encode("utf-8", "replace")):
            value = float(value)
        elif (match := _QUANTITY.fullmatch(value[:100])) is not None and match[2] in known:
            value, unit = float(match[1]), match[2]
        else:
            raise InputError(f"{at}: expected a number or one with a unit ({', '.join(known)}), got {short(value)}.")
    if not is_plain_number(value) or not abs(value) < 1e300:
        raise InputError(f"{at}: expected a finite number, got {short(str(value))}.")
    if unit is None and abs(value) > largest:
        other, plain, flag = ("degrees", "rad", "angle") if of == "angle" else ("millimetres", "m", "length")
        raise InputError(
            f"{at}: {value:g} {plain} is too large; is it in {other}? Name the unit in the header, beside the number "
            f"or as `{flag}`."
        )
    return float(value) * (1.0 if unit is None else known[unit])


# Files


def _toml(path: Path) -> tuple[list[Row], dict[str, Any]]:
    about, where = parse_toml(path), shown(path)
    for key in about:
        if key not in _OF_FILE:
            raise InputError(f"{where}: unknown key {short(key)}; expected {', '.join(_OF_FILE)}.")
    joints = about.pop("joints", None)
    if not is_list(joints) or not all(map(is_map, joints)):
        raise InputError(f"{where}: expected tables [[joints]] of DH parameters.")
    return _known(joints, f"{where}, joint"), about


def _csv(path: Path) -> tuple[list[Row], dict[str, Any]]:
    with opened(path, MAX_DESCRIPTION_BYTES) as file:
        table = read_table(file, shown(path), SCHEMA)
    said = [found for text in table.comments if (found := _SAID.search(text[:200])) is not None]
    if len(table.lines) > 2 * MAX_JOINTS:
        raise InputError(f"{table.at(2 * MAX_JOINTS)}: expected at most {2 * MAX_JOINTS} rows.")
    header = [_column(name) for name in table.names]
    units = dict(header)
    rows: list[Row] = []
    for k, texts in enumerate(table.texts):
        row = {name: value for value, (name, _) in zip(texts, header, strict=True) if value}
        moving = "d" if row.get("type", "").lower().startswith("p") else "theta"
        rows.append({"where": f"line {table.lines[k]}"})
        for name, value in row.items():
            if name in ("joint", "type") or (name == moving and _VARIABLE.fullmatch(value)):
                rows[-1][name] = value.strip()
            else:  # limits and offset are in the unit of what moves, unless they name their own
                other = _PARTNER.get(name)
                if other and not units[name] and units[other] and value.strip("0.+-"):
                    raise InputError(
                        f"{table.at(k)}: {name} {short(value)} has no unit, and {other} is in {units[other]}."
                    )
                own = units[name] or (units[moving] if name in ("lower", "upper", "offset") else None)
                rows[-1][name] = (value, own)
    return rows, {"convention": said[-1][1].lower()} if said else {}


def _column(text: str) -> tuple[str, str | None]:
    """The field of a column, "" for one that is unknown, and the unit that it names."""
    name, unit = name_and_unit(text[:100], _UNITS)
    small = name.lower()
    found = _NAMES.get(small, small)
    return (found if found in _FIELDS and unit in (None, "", *_UNITS) else ""), unit or None


def _places(names: list[str], line: str, where: str) -> Places:
    found = [_column(name) for name in names]
    for text, (name, unit) in zip(names, found, strict=True):
        if not name:
            raise InputError(
                f"{where}: unknown column {short(text)}; expected {', '.join(_FIELDS)}, units in brackets."
            )
        if (unit in LENGTH_UNITS and name in _ANGLES) or (unit in ANGLE_UNITS and name in _LENGTHS):
            raise InputError(f"{where}: {name} is {'an angle' if name in _ANGLES else 'a length'}, not in {unit}.")
    missing, twice = in_order([name for name, _ in found], _FIELDS)
    if twice:
        raise InputError(f"{where}: the column {twice[0]} is given twice.")
    if missing := [name for name in missing if name in (*_ANGLES, *_LENGTHS)]:
        raise InputError(f"{where}: expected the columns theta, d, a and alpha; missing: {', '.join(missing)}.")
    return Places([], range(len(names)))


SCHEMA = Schema("the header joint,theta,d,a,alpha", "joint", _places)
