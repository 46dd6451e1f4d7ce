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
from typing import Any

import numpy as np

from ..core.files.trees import got, item, matrix, number, pose_name, transform, vector
from ..core.geometry.frames import SETUPS
from ..core.geometry.se3 import Array
from ..errors import InputError
from .contents import Contents, Side, matrices_side
from .controllers.records import records_side
from .matrices.arrays import is_poses, matrices_of, numbers_of, side_of_array

QUATERNIONS = {"quaternion_xyzw": "xyzw", "quaternion_wxyz": "wxyz"}


ONE_SIDE = "poses"
MESSAGE = ("timestamp", *(f"translation.{axis}" for axis in "xyz"), *(f"rotation.{axis}" for axis in "xyzw"))


def is_message(value: Any) -> bool:
    """Return whether a pose looks like a ``geometry_msgs/Pose`` or ``Transform``, stamped or not."""
    if not isinstance(value, dict):
        return False
    parts = (value.get("rotation"), value.get("orientation"), value.get("transform"), value.get("pose"))
    return any(isinstance(part, dict) for part in parts)


def read_json(tree: Any, name: str) -> Contents:
    """The poses of a tree."""
    if isinstance(tree, dict) and str(tree.get("format", "")).startswith("uq-handeye calibration"):
        raise InputError(f"{name} is a result of uq-handeye; expected poses (the command export reads results).")
    if isinstance(tree, dict) and ONE_SIDE in tree and not any(map(pose_name, tree)):
        return Contents(only=_side(tree[ONE_SIDE], name, f", {ONE_SIDE}", None, tree.get("timestamps")))
    if samples_of(tree):
        tree = _turned(tree, name)
    if isinstance(tree, list):
        return Contents(only=_side(tree, name, "", None, None))
    if not isinstance(tree, dict):
        raise InputError(f'{name}: expected a list of poses or {{"robot": [...], "camera": [...]}}, got {got(tree)}.')
    setup = tree.get("setup")
    if setup is not None and setup not in SETUPS:
        raise InputError(f"{name}, setup: expected {' or '.join(SETUPS)}, got {got(setup)}.")
    notes = [] if setup is None else [f"{setup}, as the file says"]
    times = tree.get("timestamps")
    sides: dict[str, Side] = {}
    for key in tree:
        if (known := pose_name(key)) is None:
            continue
        role, frame = known
        if role in sides:
            raise InputError(f"{name}: expected the {role} poses once, got {got(tree)}.")
        if key != role:
            notes.append(f"{role} poses from {key}")
        sides[role] = _side(tree[key], name, f", {key}", None if key == role else frame, times)
    if not sides:
        raise InputError(f"{name}: expected the keys robot and camera, got {got(tree)}.")
    return Contents(sides.get("robot"), sides.get("camera"), setup=setup, notes=tuple(notes))


def samples_of(tree: Any) -> list[Any]:
    """The samples, maps that hold both sides by `pose_name`; none if the tree is no such list."""
    samples = tree.get("samples") if isinstance(tree, dict) else tree
    if not isinstance(samples, list) or not samples or not isinstance(samples[0], dict):
        return []
    roles = {known[0] for known in map(pose_name, samples[0]) if known is not None}
    return samples if roles == {"robot", "camera"} else []


def _turned(tree: Any, name: str) -> dict[str, Any]:
    """Samples as a list of each side."""
    samples = samples_of(tree)
    keys = [key for key in samples[0] if pose_name(key) is not None]
    turned: dict[str, Any] = {
        key: [item(sample, key, f"{name}, sample {k}") for k, sample in enumerate(samples)] for key in keys
    }
    if "timestamp" in samples[0]:
        turned["timestamps"] = [item(sample, "timestamp", f"{name}, sample {k}") for k, sample in enumerate(samples)]
    if isinstance(tree, dict) and "setup" in tree:
        turned["setup"] = tree["setup"]
    return turned


def _rigid(value: Any, where: str) -> Array:
    """A 4x4 matrix from ``translation`` and the 3x3 ``rotation``."""
    rows = item(value, "rotation", where)
    if not isinstance(rows, list) or len(rows) != 3:
        raise InputError(
            f"{where}, rotation: expected a 3x3 matrix, or a quaternion as quaternion_xyzw, got {got(rows)}."
        )
    T = np.eye(4)
    T[:3, :3] = [vector(row, 3, f"{where}, rotation[{k}]") for k, row in enumerate(rows)]
    T[:3, 3] = vector(item(value, "translation", where), 3, f"{where}, translation")
    return T


def _side(values: Any, name: str, within: str, frame: str | None, times: Any) -> Side:
    if not isinstance(values, list) or not values:
        raise InputError(f"{name}{within}: expected a list of poses, got {got(values)}.")
    where = [f"{name}{within}, pose {k}" for k in range(len(values))]
    options: dict[str, Any] = {"frame": frame}
    if times is not None:
        n = 1 if (numbers := numbers_of(values)) is not None and numbers.shape in ((4, 4), (16,)) else len(values)
        options["timestamps"] = np.array(vector(times, n, f"{name}, timestamps"))
    if not isinstance(values[0], dict) and (numbers := numbers_of(values)) is not None and is_poses(numbers.shape):
        return side_of_array(numbers, f"{name}{within}", options["frame"], options.get("timestamps"))[0]
    if not isinstance(values[0], dict):
        T = np.array([matrix(value, at) for value, at in zip(values, where, strict=True)])
        return matrices_side(f"{name}{within}", T, **options)
    if is_message(values[0]):
        parts = np.array([transform(value, at) for value, at in zip(values, where, strict=True)])
        return Side(f"{name}{within}", parts[:, :3], parts[:, 3:], columns=MESSAGE, **options)
    if isinstance(rows := values[0].get("rotation"), list) and rows and isinstance(rows[0], list):
        T = np.array([_rigid(value, at) for value, at in zip(values, where, strict=True)])
        return matrices_side(f"{name}{within}", T, **options)
    keys = [key for key in QUATERNIONS if key in values[0]]
    if len(keys) != 1:
        if (found := matrices_of(values)) is not None:
            return side_of_array(found[0], f"{name}{within}", frame, options.get("timestamps"))[0]
        if (side := records_side(values, f"{name}{within}")) is not None:
            return replace(side, **options)
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
        stamps = [
            number(item(value, "timestamp", at), f"{at}, timestamp") for value, at in zip(values, where, strict=True)
        ]
        options["timestamps"] = np.array(stamps)
    order = QUATERNIONS[keys[0]]
    columns = ("timestamp", *(f"translation[{k}]" for k in range(3)), *(f"{keys[0]}[{k}]" for k in range(4)))
    table = np.array(rows)
    return Side(f"{name}{within}", table[:, :3], table[:, 3:], order=order, columns=columns, **options)
