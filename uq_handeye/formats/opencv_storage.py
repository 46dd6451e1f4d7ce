"""Poses in OpenCV's FileStorage (YAML, XML or JSON), under the names of the arguments of ``cv::calibrateHandEye``.

Rotations ``R_gripper2base`` and ``R_target2cam`` are 3x3 matrices or rotation vectors (rad), translations
``t_gripper2base`` and ``t_target2cam`` vectors of three; 4x4 matrices go by `pose_name`. Each is a sequence of
matrices, or one matrix with the poses below each other or flattened to a row each, or n x 4 x 4.
``R_gripper2base`` is ``base_T_gripper``. Other names: `PAIRS`. Source of the rules: opencv/opencv,
``modules/core/src/persistence_yml.cpp``, ``persistence_xml.cpp`` and ``persistence_json.cpp`` for the form,
``modules/calib3d/include/opencv2/calib3d.hpp`` (``calibrateHandEye``, ``calibrateRobotWorldHandEye``) for the names.
"""

from __future__ import annotations

import math
import re

import numpy as np

from ..core.files.one_line import short
from ..core.files.pose_names import pose_name, sides_of_names
from ..core.files.tree_values import Tree, fields_of, got, is_list, is_map, is_plain_number, items_of, number
from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array
from ..errors import InputError
from .contents import FRAMES, Contents, Side, matrices_side

# The names of rotation and translation, the side and the frame that OpenCV documents.
PAIRS = (
    ("R_gripper2base", "t_gripper2base", "robot", "base_T_gripper"),
    ("R_base2gripper", "t_base2gripper", "robot", "gripper_T_base"),
    ("R_target2cam", "t_target2cam", "camera", "camera_T_target"),
    ("R_world2cam", "t_world2cam", "camera", "camera_T_target"),
    ("R_cam2target", "t_cam2target", "camera", "target_T_camera"),
    ("rvecs", "tvecs", "camera", "camera_T_target"),
)
# Names that other poses go by, too: alone in a file they are of the side that the file is given for.
EITHER_SIDE = "rvecs"


_NAMED = {pair[0] for pair in PAIRS if pair[0] != EITHER_SIDE}
# Names of a single pose, in a file per pose.
_SINGULAR = (("rvec", "tvec"), ("R", "t"), ("R", "T"))
# Arrays of quaternions and positions.
_QUATERNIONS = tuple(
    (rotations, positions)
    for rotations in ("quaternions", "orientations", "quats", "rotations", "quaternion", "orientation")
    for positions in ("positions", "translations", "position", "translation")
)
# What OpenCV's program of camera calibration writes: rotation vector and translation of the board in each picture.
_VIEWS = ("extrinsic_parameters", "Extrinsic_Parameters")


def read_opencv(tree: Tree, name: str) -> Contents:
    """The poses of a tree."""
    expected = "R_gripper2base, t_gripper2base, R_target2cam and t_target2cam"
    if not is_map(tree):
        raise InputError(f"{name}: expected {expected}, got {got(tree)}.")
    for R_name, t_name in _SINGULAR:
        if {R_name, t_name} <= set(tree) and not set(tree) & {"rvecs", "tvecs"}:
            plural = {R_name: "rvecs", t_name: "tvecs"}
            tree = {plural.get(key, key): value for key, value in tree.items()}
    sides: dict[str, Side] = {}
    notes: list[str] = []

    def take(role: str, key: str, T: Array, frame: str) -> None:
        if role in sides:
            raise InputError(f"{name}: expected the {role} poses once, got {got(tree)}.")
        if key not in ("R_gripper2base", "R_target2cam"):
            notes.append(f"{role} poses from {key}")
        sides[role] = matrices_side(f"{name}, {key}", T, frame=None if key == role else frame)

    used = set()
    for R_name, t_name, role, frame in PAIRS:
        if R_name not in tree:
            continue
        t_found = next(
            (key for key in (t_name, f"T{t_name[1:]}") if key in tree), None
        )  # T_gripper2base: a translation
        if t_found is None:
            raise InputError(f"{name}: expected {t_name} beside {R_name}, got {got(tree)}.")
        used.add(t_found)
        wheres = (f"{name}, {R_name}", f"{name}, {t_found}")
        t = stack(tree[t_found], wheres[1])
        T = joined(stack(tree[R_name], wheres[0]), t, *wheres)
        if R_name == EITHER_SIDE and not {*tree} & _NAMED and not any(map(pose_name, tree)):
            return Contents(only=matrices_side(wheres[0], T), notes=(f"poses from {R_name} and {t_found}",))
        take(role, R_name, T, frame)
    for key, value in tree.items():
        if key in used or (known := pose_name(key)) is None:
            continue
        values = stack(value, f"{name}, {key}").reshape(-1)
        if values.size % 16:
            raise InputError(f"{name}, {key}: expected 16 numbers per pose (4x4), got {values.size}.")
        take(known[0], key, values.reshape(-1, 4, 4), known[1])
    for key in _VIEWS:
        if key in tree and "camera" not in sides:
            values = stack(tree[key], f"{name}, {key}")
            if len(values.shape) != 2 or values.shape[-1] != 6:
                raise InputError(f"{name}, {key}: expected six numbers in each row, got {got(tree[key])}.")
            where = f"{name}, {key}"
            take("camera", key, joined(values[:, :3], values[:, 3:], where, where), "camera_T_target")
    alone = _poses_alone(tree) if not sides and is_storage(tree) else {}
    if len(alone) == 1:
        ((key, T),) = alone.items()
        return Contents(only=matrices_side(f"{name}, {short(key)}", T), notes=(f"poses from {short(key)}",))
    if (roles := sides_of_names(alone)) is not None:
        for key, role in roles.items():
            take(role, key, alone[key], FRAMES[role][0])
    if not sides:
        raise InputError(f"{name}: expected {expected}, got {got(tree)}.")
    return Contents(sides.get("robot"), sides.get("camera"), notes=tuple(notes))


# Endings of the names of a rotation and a translation that make one pose: T_cam_target_rvec, T_cam_target_tvec.
_PARTS = tuple(
    (f"_{rotation}", f"_{translation}")
    for rotation, translation in (
        ("rvec", "tvec"), ("R", "t"), ("rot", "trans"), ("rotation", "translation"), ("rotvec", "translation"),
        ("rotvec", "position"), ("rotation", "position"), ("rotation_vector", "translation_vector"),
        ("orientation", "position"), ("quaternion", "position"), ("quaternion", "translation"), ("quat", "pos"),
        ("q", "t"), ("q", "p"),
    )
)  # fmt: skip
_VECTOR_ENDS = ("_rvec", "_rotvec", "_rotation_vector")


def joined_parts(tree: Tree) -> Tree:
    """Return a tree in which a rotation and a translation of one name are the pose of that name.

    Matrices and rotation vectors (rad) become 4x4 matrices, quaternions a row of seven numbers. Names are those that
    `pose_name` knows, alone or with ``_pose`` behind them. ``rvec`` and ``tvec`` beside a pose of the robot are the
    camera's.
    """
    if is_list(tree):
        return [joined_parts(entry) if is_map(entry) else entry for entry in tree]
    if not is_map(tree):
        return tree
    found: dict[str, Tree] = {}
    for key in tree:
        for R_end, t_end in _PARTS:
            stem = str(key).removesuffix(R_end)
            other = f"{stem}{t_end}"
            named = stem if pose_name(stem) is not None else f"{stem}_pose"
            if stem == key or other not in tree or named in tree or pose_name(named) is None:
                continue
            if (pose := _joined(tree[key], tree[other], R_end in _VECTOR_ENDS)) is not None:
                found |= {str(key): None, other: None, named: pose}
    roles = {known[0] for key in {*tree, *found} if (known := pose_name(str(key))) is not None}
    alone = {"rvec", "tvec"} <= set(tree) and roles == {"robot"}
    if alone and (pose := _joined(tree["rvec"], tree["tvec"], True)) is not None:
        found |= {"rvec": None, "tvec": None, "camera": pose}
    return {key: value for key, value in {**tree, **found}.items() if value is not None} if found else tree


def _joined(rotation: Tree, translation: Tree, vector: bool) -> Tree:
    """Return the pose of a rotation and a translation; None unless they are numbers of one. ``vector``: three numbers
    are a rotation vector in rad.
    """
    R, t = (np.array(numbers, dtype=float) for numbers in map(_flat, (rotation, translation)))
    if t.size != 3 or not (np.isfinite(R).all() and np.isfinite(t).all()):
        return None
    if R.size == 4:
        return [*t.tolist(), *R.tolist()]
    if R.size == 9 or (R.size == 3 and vector):
        return [list(map(float, row)) for row in joined(R, t, "a pose", "a pose")[0]]
    return None


def _flat(value: Tree) -> list[float]:
    """Return the numbers of a list, of a list of lists, or of a matrix of OpenCV; none of anything else."""
    entries = items_of(fields_of(value)["data"] if _is_matrix(value) else value)[:9]
    parts = [items_of(one) if is_list(one) else [one] for one in entries]
    return [one for part in parts for one in part if is_plain_number(one)]


def _poses_alone(tree: dict[str, Tree]) -> dict[str, Array]:
    """Return the entries that hold 16 numbers per pose, under whatever names."""
    found = {}
    for key, value in tree.items():
        if is_storage({key: value}):
            values = stack(value, key)
            if values.size and not values.size % 16:
                found[key] = values.reshape(-1, 4, 4)
    return found


def joined(rotations: Array, translations: Array, R_where: str, t_where: str) -> Array:
    """Poses (n, 4, 4) from matrices or rotation vectors, and translations, in any of the shapes that are read."""
    t = _vectors(translations, t_where)
    T = np.zeros((len(t), 4, 4))
    T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = _rotations(rotations, len(t), R_where), t, 1.0
    return T


# Poses by the name of their rotations, with side and frame; and those that may be of either side.
Joined = tuple[list[tuple[str, str, str, Array]], tuple[str, Array] | None]


def joined_pairs(arrays: dict[str, Array], name: str) -> Joined:
    """Return poses of arrays of rotations and translations by name, and those that may be of either side.

    Each of the first is name of the rotations, side, frame, poses (n, 4, 4); of quaternions the poses are (n, 7).
    """
    found: list[tuple[str, str, str, Array]] = []
    either = None
    for R_key, t_key in _QUATERNIONS:
        if {R_key, t_key} <= set(arrays) and arrays[R_key].shape == (len(arrays[t_key]), 4):
            return [], (R_key, np.hstack([arrays[t_key].reshape(-1, 3), arrays[R_key]]))
    for R_key, t_key, role, frame in (*PAIRS, ("R", "t", "", ""), ("R", "T", "", "")):
        if R_key not in arrays or t_key not in arrays:
            continue
        T = joined(arrays[R_key], arrays[t_key], f"{name}, {R_key}", f"{name}, {t_key}")
        if R_key in (EITHER_SIDE, "R"):
            either = (R_key, T)
        else:
            found.append((R_key, role, frame, T))
    return found, either


def _rotations(values: Array, n: int, where: str) -> Array:
    """Matrices (n, 3, 3) from matrices or rotation vectors."""
    if values.size == 9 * n:
        return values.reshape(n, 3, 3)
    if values.size != 3 * n:
        raise InputError(
            f"{where}: expected a 3x3 matrix or a rotation vector for each of the {n} translations, got {values.size} "
            "numbers."
        )
    vectors = _vectors(values, where)
    longest = float(np.linalg.norm(vectors, axis=1).max())
    if longest > 4 * math.pi:
        raise InputError(f"{where}: expected rotation vectors in rad, got one of length {longest:.4g}: degrees?")
    return np.asarray(Rotation.from_rotvec(vectors).as_matrix())


def _vectors(values: Array, where: str) -> Array:
    """Vectors (n, 3)."""
    if values.size % 3:
        raise InputError(f"{where}: expected three numbers per pose, got {values.size}.")
    if values.ndim == 2 and values.shape[0] == 3 and values.shape[1] not in (1, 3):
        raise InputError(f"{where}: expected the poses below each other, n x 3, got {values.shape[1]} side by side.")
    return values.reshape(-1, 3)


def stack(value: Tree, where: str) -> Array:
    """The numbers of a matrix, or of a sequence of matrices or numbers, in their order."""
    if _is_matrix(value):
        return _matrix(value, where)
    if items_of(value):
        entries = items_of(value)
        if all(_is_matrix(entry) for entry in entries):
            return np.concatenate([_matrix(entry, f"{where}[{k}]").reshape(-1) for k, entry in enumerate(entries)])
        if all(map(is_list, entries)):
            return np.concatenate([stack(entry, f"{where}[{k}]").reshape(-1) for k, entry in enumerate(entries)])
        return np.array([number(entry, f"{where}[{k}]") for k, entry in enumerate(entries)])
    raise InputError(f"{where}: expected a matrix of OpenCV or a list of them, got {got(value)}.")


def _is_matrix(value: Tree) -> bool:
    found = set(fields_of(value))
    return "data" in found and ({"rows", "cols"} <= found or "sizes" in found)


def is_of_opencv(tree: Tree) -> bool:
    """Return whether a list holds a map per pose under the names of the arguments of ``cv::calibrateHandEye``."""
    names = {name for R_name, t_name, *_ in PAIRS[:-1] for name in (R_name, t_name)}
    return bool(items_of(tree)) and all(len(names & set(fields_of(entry))) > 1 for entry in items_of(tree))


def is_storage(tree: Tree) -> bool:
    """Return whether a tree holds a matrix of OpenCV, directly or in a list."""
    return any(_is_matrix(next(iter(items_of(value)), value)) for value in fields_of(tree).values())


def _matrix(tree: Tree, where: str) -> Array:
    """The numbers of an ``opencv-matrix`` or ``opencv-nd-matrix``."""
    value = fields_of(tree)
    dt = value.get("dt", "d")
    kind = re.fullmatch(r"(\d*)([ucwsifdh])", str(dt))
    if kind is None:
        raise InputError(f"{where}, dt: expected a type of numbers such as d, got {got(dt)}.")
    sizes = value["sizes"] if "sizes" in value else [value["rows"], value["cols"]]
    shape = [number(size, f"{where}, size") for size in (sizes if is_list(sizes) else [sizes])]
    data = value["data"] if is_list(value["data"]) else [value["data"]]
    expected = math.prod(shape) * int(kind[1] or 1)
    if len(data) != expected:
        hint = " (base64: write the storage as text)" if type(value["data"]) is str else ""
        shown = " x ".join(f"{size:g}" for size in shape)
        raise InputError(f"{where}: expected {expected:g} numbers for {shown}, got {got(value['data'])}{hint}.")
    numbers = np.array([number(entry, f"{where}, data[{k}]") for k, entry in enumerate(data)])
    return numbers.reshape(int(shape[0]), -1) if numbers.size else numbers


def yaml_number(value: float, digits: int | None = None) -> str:
    """A float that YAML 1.1 takes for one: with a point, also before an exponent.

    >>> yaml_number(1e-5), yaml_number(2.0), yaml_number(-0.0)
    ('1.0e-05', '2.0', '0.0')
    """
    text = repr(float(value) + 0.0 if digits is None else float(f"{value + 0.0:.{digits}g}"))
    mantissa, e, exponent = text.partition("e")
    return text if not e or "." in mantissa else f"{mantissa}.0e{exponent}"


def matrix_lines(name: str, values: Array) -> list[str]:
    """A matrix (rows, columns) as an entry of OpenCV's YAML."""
    rows, columns = values.shape
    data = ",\n       ".join(", ".join(map(yaml_number, row)) for row in values)
    return [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d", f"   data: [ {data} ]"]
