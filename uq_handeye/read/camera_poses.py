"""Camera poses of a rig in the files of other programs, each as ``camera_T_common``.

| program | where | pose | unit |
|---|---|---|---|
| caliscope, aniposelib (TOML) | ``rotation`` (rotation vector), ``translation`` | world to camera | m; of the square |
| multical (JSON) | ``camera_poses``: ``c_to_a`` with ``R``, ``T`` | points of a to those of c | of the square |
| vision-calibration (JSON) | ``cam_se3_rig``: ``rotation`` (x, y, z, w), ``translation`` | rig to camera | m |
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.files.json_values import Json, JsonObject
from ..core.files.open import StrPath, as_path, opened, shown
from ..core.files.tree_values import fields_of, items_of, number, vector
from ..core.files.trees import parse_toml, parse_tree
from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array
from ..core.limits import MAX_TABLE_BYTES
from ..errors import InputError


class CameraPoses(NamedTuple):
    """Poses of the cameras of a file, by their names there."""

    program: str
    poses: dict[str, Array]  # camera_T_common (4, 4), in the unit of the file


def read_camera_poses(path: StrPath) -> CameraPoses:
    """Read the camera poses of a file of another program; raises `InputError` for a file that has none."""
    location = as_path(path)
    tree = fields_of(_tree(location))
    for program, read in (("multical", _multical), ("vision-calibration", _vision), ("caliscope, aniposelib", _tables)):
        if found := read(tree, shown(location)):
            return CameraPoses(program, found)
    raise InputError(
        f"{shown(location)} holds no camera poses of caliscope, aniposelib, multical or vision-calibration: expected "
        "rotation and translation of each camera, camera_poses or cam_se3_rig."
    )


def _tree(location: Path) -> Json:
    if location.suffix.lower() == ".toml":
        return parse_toml(location)
    with opened(location, MAX_TABLE_BYTES) as file:
        return parse_tree(file.read(), shown(location))


def _pose(rotation: Array, translation: Json, where: str) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, vector(translation, 3, f"{where}, translation")
    return T


def _multical(tree: JsonObject, name: str) -> dict[str, Array]:
    found = {}
    for key, of in fields_of(tree.get("camera_poses")).items():
        one, where = fields_of(of), f"{name}, {key}"
        R = np.reshape([number(x, where) for row in items_of(one.get("R")) for x in items_of(row)], (-1, 3))
        if R.shape != (3, 3):
            raise InputError(f"{where}: expected R to be a matrix of 3 x 3.")
        found[key.partition("_to_")[0]] = _pose(R, one.get("T"), where)
    return found


def _vision(tree: JsonObject, name: str) -> dict[str, Array]:
    found = {}
    for k, of in enumerate(items_of(tree.get("cam_se3_rig"))):
        one, where = fields_of(of), f"{name}, cam_se3_rig {k}"
        q = vector(one.get("rotation"), 4, f"{where}, rotation")
        found[str(k)] = _pose(Rotation.from_quat(q).as_matrix(), one.get("translation"), where)
    return found


def _tables(tree: JsonObject, name: str) -> dict[str, Array]:
    found = {}
    for key, of in (fields_of(tree.get("cameras")) or tree).items():
        one, where = fields_of(of), f"{name}, {key}"
        if {"rotation", "translation"} <= set(one):
            r = vector(one["rotation"], 3, f"{where}, rotation")
            found[str(one.get("name", key))] = _pose(Rotation.from_rotvec(r).as_matrix(), one["translation"], where)
    return found
