"""Poses in JSON, a form of our own: both sides by name, or a list of one side.

    {"setup": "eye-in-hand", "robot": [POSE, ...], "camera": [POSE, ...], "timestamps": [0.0, ...]}
    [POSE, ...]    {"poses": [POSE, ...]}
    [{"robot": POSE, "camera": POSE}, ...], also below "samples"

A POSE is a 4x4 matrix (four rows, or 16 numbers row by row) or
``{"timestamp": 0.0, "translation": [x, y, z], "quaternion_xyzw": [x, y, z, w]}``; ``quaternion_wxyz`` has the scalar
first. ``rotation`` may be a 3x3 matrix, and a ``geometry_msgs/Pose`` or ``Transform``, with x, y, z, w by names, is a
POSE as well. ``setup`` and all times may be left out. ``robot`` and ``camera`` may be called by their frames
(`pose_name`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..core.files.pose_names import pose_name, poses_named
from ..core.files.tree_values import (
    Tree,
    fields_of,
    got,
    is_list,
    is_map,
    item,
    items_of,
    matrix,
    number,
    transform,
    vector,
)
from ..core.geometry.frames import SETUPS
from ..core.geometry.se3 import Array
from ..errors import InputError
from .contents import Contents, Side, matrices_side
from .controllers.records import records_side
from .declared import Declared, believed, of_tree
from .matrices.arrays import is_poses, side_of_array
from .matrices.matrix_trees import matrices_of, numbers_of

QUATERNIONS = {"quaternion_xyzw": "xyzw", "quaternion_wxyz": "wxyz"}
ONE_SIDE = "poses"
BOTH = {"robot", "camera"}
MESSAGE = ("timestamp", *(f"translation.{axis}" for axis in "xyz"), *(f"rotation.{axis}" for axis in "xyzw"))


def is_message(value: Tree) -> bool:
    """Return whether a pose looks like a ``geometry_msgs/Pose`` or ``Transform``, stamped or not."""
    return any(is_map(fields_of(value).get(name)) for name in ("rotation", "orientation", "transform", "pose"))


def read_json(tree: Tree, name: str) -> Contents:
    """The poses of a tree."""
    if str(fields_of(tree).get("format", "")).startswith("uq-handeye calibration"):
        raise InputError(f"{name} is a result of uq-handeye; expected poses (the command export reads results).")
    fields = fields_of(tree)
    if ONE_SIDE in fields and not any(map(pose_name, fields)) and not samples_of(tree):
        return Contents(only=_side(fields[ONE_SIDE], name, f", {ONE_SIDE}", None, fields.get("timestamps")))
    if samples_of(tree):
        tree = _turned(tree, name)
    if is_list(tree):
        return Contents(only=_side(tree, name, "", None, None))
    if not is_map(tree):
        raise InputError(f'{name}: expected a list of poses or {{"robot": [...], "camera": [...]}}, got {got(tree)}.')
    setup = tree.get("setup")
    if setup is not None and setup not in SETUPS:
        raise InputError(f"{name}, setup: expected {' or '.join(SETUPS)}, got {got(setup)}.")
    notes = [] if setup is None else [f"{setup}, as the file says"]
    times = tree.get("timestamps")
    sides: dict[str, Side] = {}
    for key, (role, frame) in poses_named(tree).items():
        if role in sides:
            raise InputError(f"{name}: expected the {role} poses once, got {got(tree)}.")
        if key != role:
            notes.append(f"{role} poses from {key}")
        given, own = _poses_in(tree[key])
        side = _side(given, name, f", {key}", None if key == role else frame, times)
        said = believed(Contents(only=side), own, f"{name}, {key}")
        assert said.only is not None
        sides[role] = said.only
        notes += [f"{role}: {note}" for note in said.notes]
    if not sides:
        raise InputError(f"{name}: expected the keys robot and camera, got {got(tree)}.")
    return Contents(sides.get("robot"), sides.get("camera"), setup=setup, notes=tuple(notes))


def samples_of(tree: Tree) -> list[dict[str, Tree]]:
    """The samples, maps that hold both sides by `poses_named`, also below one name; none if there are no such."""
    lists = [items_of(one) for one in (tree, *fields_of(tree).values())]
    roles = [{role for role, _ in poses_named(fields_of(next(iter(one), None))).values()} for one in lists]
    found = [one for one, of in zip(lists, roles, strict=True) if of == BOTH]
    return found[0] if len(found) == 1 else []


def _poses_in(value: Tree) -> tuple[Tree, Declared]:
    """Return the poses of one side, and what a map says in which they stand as its only list: its units, its frames."""
    lists = [one for one in fields_of(value).values() if len(items_of(one)) > 1 and not _is_number(items_of(one)[0])]
    if is_map(value) and not is_message(value) and len(lists) == 1:
        return lists[0], of_tree(value)
    return value, Declared()


def _is_number(value: Tree) -> bool:
    return isinstance(value, int | float)


def _turned(tree: Tree, name: str) -> dict[str, Tree]:
    """Samples as a list of each side."""
    samples = samples_of(tree)
    keys = list(poses_named(samples[0]))
    turned: dict[str, Tree] = {
        key: [item(sample, key, f"{name}, sample {k}") for k, sample in enumerate(samples)] for key in keys
    }
    if "timestamp" in samples[0]:
        turned["timestamps"] = [item(sample, "timestamp", f"{name}, sample {k}") for k, sample in enumerate(samples)]
    if "setup" in fields_of(tree):
        turned["setup"] = fields_of(tree)["setup"]
    return turned


def _rigid(value: Tree, where: str) -> Array:
    """A 4x4 matrix from ``translation`` and the 3x3 ``rotation``."""
    rows = item(value, "rotation", where)
    if len(items_of(rows)) != 3:
        raise InputError(
            f"{where}, rotation: expected a 3x3 matrix, or a quaternion as quaternion_xyzw, got {got(rows)}."
        )
    T = np.eye(4)
    T[:3, :3] = [vector(row, 3, f"{where}, rotation[{k}]") for k, row in enumerate(items_of(rows))]
    t = item(value, "translation", where)
    column = [items_of(one)[0] if len(items_of(one)) == 1 else one for one in items_of(t)]  # 3 x 1
    T[:3, 3] = vector(column or t, 3, f"{where}, translation")
    return T


def _side(given: Tree, name: str, within: str, frame: str | None, times: Tree) -> Side:
    values = items_of(given)
    if not values:
        raise InputError(f"{name}{within}: expected a list of poses, got {got(given)}.")
    where = [f"{name}{within}, pose {k}" for k in range(len(values))]
    stamps: Array | None = None
    if times is not None:
        n = 1 if (numbers := numbers_of(values)) is not None and numbers.shape in ((4, 4), (16,)) else len(values)
        stamps = np.array(vector(times, n, f"{name}, timestamps"))
    if not is_map(values[0]) and (numbers := numbers_of(values)) is not None and is_poses(numbers.shape):
        return side_of_array(numbers, f"{name}{within}", frame, stamps)[0]
    if not is_map(values[0]):
        T = np.array([matrix(value, at) for value, at in zip(values, where, strict=True)])
        return matrices_side(f"{name}{within}", T, frame=frame, timestamps=stamps)
    if is_message(values[0]):
        parts = np.array([transform(value, at) for value, at in zip(values, where, strict=True)])
        return Side(f"{name}{within}", parts[:, :3], parts[:, 3:], columns=MESSAGE, frame=frame, timestamps=stamps)
    if is_list(next(iter(items_of(values[0].get("rotation"))), None)):
        T = np.array([_rigid(value, at) for value, at in zip(values, where, strict=True)])
        return matrices_side(f"{name}{within}", T, frame=frame, timestamps=stamps)
    keys = [key for key in QUATERNIONS if key in values[0]]
    if len(keys) != 1:
        if (found := matrices_of(values)) is not None:
            return side_of_array(found[0], f"{name}{within}", frame, stamps)[0]
        if (side := records_side(values, f"{name}{within}")) is not None:
            return replace(side, frame=frame, timestamps=side.timestamps if stamps is None else stamps)
        raise InputError(
            f"{where[0]}: expected a 4x4 matrix, or translation and quaternion_xyzw or quaternion_wxyz, got "
            f"{got(values[0])}."
        )
    rows = [
        vector(item(value, "translation", at), 3, f"{at}, translation")
        + vector(item(value, keys[0], at), 4, f"{at}, {keys[0]}")
        for value, at in zip(values, where, strict=True)
    ]
    if "timestamp" in values[0]:
        if times is not None:
            raise InputError(f"{name}: expected either timestamps or a timestamp in each pose, got both.")
        each = [
            number(item(value, "timestamp", at), f"{at}, timestamp") for value, at in zip(values, where, strict=True)
        ]
        stamps = np.array(each)
    order = QUATERNIONS[keys[0]]
    columns = ("timestamp", *(f"translation[{k}]" for k in range(3)), *(f"{keys[0]}[{k}]" for k in range(4)))
    table = np.array(rows)
    return Side(
        f"{name}{within}", table[:, :3], table[:, 3:], order=order, columns=columns, frame=frame, timestamps=stamps
    )
