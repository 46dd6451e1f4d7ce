"""Poses in JSON, a form of our own: both sides by name, or a list of one side.

    {"setup": "eye-in-hand", "robot": [POSE, ...], "camera": [POSE, ...], "timestamps": [0.0, ...]}
    [POSE, ...]    {"poses": [POSE, ...]}
    [{"robot": POSE, "camera": POSE}, ...], also below "samples"

A POSE is a 4x4 matrix (four rows, or 16 numbers row by row) or
``{"timestamp": 0.0, "translation": [x, y, z], "quaternion_xyzw": [x, y, z, w]}``; ``quaternion_wxyz`` has the scalar
first. ``rotation`` may be a 3x3 matrix, and a ``geometry_msgs/Pose`` or ``Transform``, with x, y, z, w by names, is a
POSE as well. ``setup`` and all times may be left out. ``robot`` and ``camera`` may be called by their frames
(`pose_name`).

Samples of easy_handeye (ROS 1) and easy_handeye2 (ROS 2), in YAML.

easy_handeye2 saves ``parameters`` and ``samples``, each with ``robot`` and ``tracking``
(marcoesposito1988/easy_handeye2: ``easy_handeye2/easy_handeye2/handeye_sampler.py``, ``save_samples``, and
``easy_handeye2_msgs/msg/SampleList.msg``). easy_handeye saves no samples; its service ``get_sample_list`` prints
``hand_world_samples`` and ``camera_marker_samples`` (IFL-CAMP/easy_handeye:
``easy_handeye/src/easy_handeye/handeye_server.py`` and ``easy_handeye/msg/SampleList.msg``), which
``rosservice call`` writes as YAML.

Each is a ``geometry_msgs/Transform``: metres, quaternion by names. ``tracking`` is ``camera_T_target``. ``robot`` is
what enters AX = XB (``_get_transforms`` in the samplers of both): ``base_T_gripper`` where the camera is on the hand,
``gripper_T_base`` where it is not.

Samples of MoveIt calibration, in YAML: a list of maps with ``effector_wrt_world`` and ``object_wrt_sensor``.

Each is a 4x4 matrix of 16 numbers, row by row, in metres: ``base_T_gripper`` and ``camera_T_target`` for both mounts of
the camera. Source of the rules: moveit/moveit_calibration,
``moveit_calibration_gui/handeye_calibration_rviz_plugin/src/handeye_control_widget.cpp``, ``saveSamplesBtnClicked``.

A prior of X or W in a file: a pose with its covariance, or an earlier result.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..core.files.one_line import short
from ..core.files.open import StrPath, as_path, opened
from ..core.files.pose_names import pose_name
from ..core.files.tree_values import fields_of, got, is_list, is_map, item, items_of, matrix, number, transform, vector
from ..core.files.trees import parse_tree
from ..core.geometry.checks import as_transforms
from ..core.geometry.frames import SETUPS
from ..core.geometry.se3 import Array
from ..core.numbers.limits import MAX_DESCRIPTION_BYTES
from ..errors import InputError
from .contents import Contents, Side, matrices_side
from .controllers.registry import records_side
from .matrices.arrays import is_poses, matrices_of, numbers_of, side_of_array

QUATERNIONS = {"quaternion_xyzw": "xyzw", "quaternion_wxyz": "wxyz"}


ONE_SIDE = "poses"
MESSAGE = ("timestamp", *(f"translation.{axis}" for axis in "xyz"), *(f"rotation.{axis}" for axis in "xyzw"))


def is_message(value: Any) -> bool:
    """Return whether a pose looks like a ``geometry_msgs/Pose`` or ``Transform``, stamped or not."""
    return any(is_map(fields_of(value).get(name)) for name in ("rotation", "orientation", "transform", "pose"))


def read_json(tree: Any, name: str) -> Contents:
    """The poses of a tree."""
    if str(fields_of(tree).get("format", "")).startswith("uq-handeye calibration"):
        raise InputError(f"{name} is a result of uq-handeye; expected poses (the command export reads results).")
    if ONE_SIDE in fields_of(tree) and not any(map(pose_name, tree)):
        return Contents(only=_side(tree[ONE_SIDE], name, f", {ONE_SIDE}", None, tree.get("timestamps")))
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
    samples = items_of(fields_of(tree).get("samples", tree))
    first = fields_of(next(iter(samples), None))
    roles = {known[0] for known in map(pose_name, first) if known is not None}
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
    if "setup" in fields_of(tree):
        turned["setup"] = tree["setup"]
    return turned


def _rigid(value: Any, where: str) -> Array:
    """A 4x4 matrix from ``translation`` and the 3x3 ``rotation``."""
    rows = item(value, "rotation", where)
    if len(items_of(rows)) != 3:
        raise InputError(
            f"{where}, rotation: expected a 3x3 matrix, or a quaternion as quaternion_xyzw, got {got(rows)}."
        )
    T = np.eye(4)
    T[:3, :3] = [vector(row, 3, f"{where}, rotation[{k}]") for k, row in enumerate(rows)]
    T[:3, 3] = vector(item(value, "translation", where), 3, f"{where}, translation")
    return T


def _side(values: Any, name: str, within: str, frame: str | None, times: Any) -> Side:
    if not items_of(values):
        raise InputError(f"{name}{within}: expected a list of poses, got {got(values)}.")
    where = [f"{name}{within}, pose {k}" for k in range(len(values))]
    options: dict[str, Any] = {"frame": frame}
    if times is not None:
        n = 1 if (numbers := numbers_of(values)) is not None and numbers.shape in ((4, 4), (16,)) else len(values)
        options["timestamps"] = np.array(vector(times, n, f"{name}, timestamps"))
    if not is_map(values[0]) and (numbers := numbers_of(values)) is not None and is_poses(numbers.shape):
        return side_of_array(numbers, f"{name}{within}", options["frame"], options.get("timestamps"))[0]
    if not is_map(values[0]):
        T = np.array([matrix(value, at) for value, at in zip(values, where, strict=True)])
        return matrices_side(f"{name}{within}", T, **options)
    if is_message(values[0]):
        parts = np.array([transform(value, at) for value, at in zip(values, where, strict=True)])
        return Side(f"{name}{within}", parts[:, :3], parts[:, 3:], columns=MESSAGE, **options)
    if is_list(next(iter(items_of(values[0].get("rotation"))), None)):
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


FRAMES = ("robot_base_frame", "robot_effector_frame", "tracking_base_frame", "tracking_marker_frame")
FIELDS = ("timestamp", *(f"translation.{a}" for a in "xyz"), *(f"rotation.{a}" for a in "xyzw"))


def read_easy_handeye2(tree: Any, name: str) -> Contents:
    """``samples: [{robot, tracking}, ...]``, with ``parameters``; or the list only."""
    _refuse_result(tree, name)
    samples = tree if is_list(tree) else item(tree, "samples", name)
    if not items_of(samples):
        raise InputError(f"{name}, samples: expected a list of samples, got {got(samples)}.")
    parts = [
        [transform(item(sample, part, f"{name}, sample {k}"), f"{name}, sample {k}, {part}") for part in _parts(sample)]
        for k, sample in enumerate(samples)
    ]
    return _contents(np.array(parts), fields_of(tree).get("parameters"), name)


def _parts(sample: Any) -> tuple[str, str]:
    """The names of both sides; easy_handeye calls the tracking ``optical`` within its server."""
    old = "optical" in fields_of(sample) and "tracking" not in sample
    return "robot", "optical" if old else "tracking"


def read_easy_handeye(tree: Any, name: str) -> Contents:
    """``hand_world_samples`` and ``camera_marker_samples``, also below ``samples``."""
    _refuse_result(tree, name)
    lists = fields_of(fields_of(tree).get("samples")) or tree
    sides = []
    for part in ("hand_world_samples", "camera_marker_samples"):
        values = item(lists, part, name)
        if "transforms" in fields_of(values):  # visp_hand2eye_calibration/TransformArray
            values = values["transforms"]
        if not items_of(values):
            raise InputError(f"{name}, {part}: expected a list of transforms, got {got(values)}.")
        sides.append([transform(value, f"{name}, {part}, sample {k}") for k, value in enumerate(values)])
    if len(sides[0]) != len(sides[1]):
        raise InputError(
            f"{name}: expected as many hand_world_samples as camera_marker_samples, got {len(sides[0])} and "
            f"{len(sides[1])}."
        )
    parameters = tree.get("parameters", tree if "eye_on_hand" in tree else None)
    return _contents(np.array(sides).swapaxes(0, 1), parameters, name)


def _refuse_result(tree: Any, name: str) -> None:
    if {"transform", "transformation"} & set(fields_of(tree)):
        raise InputError(
            f"{name} is a result of easy_handeye, one transform; expected its samples (easy_handeye2: the button Save "
            "samples writes NAME.samples; easy_handeye: rosservice call .../get_sample_list > samples.yaml)."
        )


def _contents(parts: Any, parameters: Any, name: str) -> Contents:
    """Contents from (n, 2, 7) numbers of robot and tracking, and the parameters of the tool."""
    options: dict[str, Any] = {"counted": "sample", "columns": FIELDS}
    robot, camera = (Side(name, parts[:, k, :3], parts[:, k, 3:], **options) for k in range(2))
    setup, notes = _setup(parameters, name)
    return Contents(robot, camera, setup=setup, robot_enters=True, notes=tuple(notes))


def _setup(parameters: Any, name: str) -> tuple[str | None, list[str]]:
    if not is_map(parameters):
        return None, []
    notes = []
    frames = [f"{key} {short(str(parameters[key]))}" for key in FRAMES if parameters.get(key)]
    if frames:
        notes.append(f"frames of the tool: {', '.join(frames)}")
    key = "calibration_type" if "calibration_type" in parameters else "eye_on_hand"
    says = parameters.get(key)
    if says is None or says == "":
        return None, notes
    known = {"eye_in_hand": "eye-in-hand", "eye_on_base": "eye-to-hand", True: "eye-in-hand", False: "eye-to-hand"}
    if (setup := None if is_map(says) or is_list(says) else known.get(says)) is None:
        raise InputError(f"{name}, parameters.{key}: expected eye_in_hand or eye_on_base, got {got(says)}.")
    return setup, [*notes, f"{setup}, from {key}: {says}"]


NAMES = ("effector_wrt_world", "object_wrt_sensor")


def read_moveit(tree: Any, name: str) -> Contents:
    """The samples of a tree."""
    if "joint_values" in fields_of(tree):
        raise InputError(f"{name} holds joint states; expected the samples, which MoveIt saves by 'Save samples'.")
    if not items_of(tree):
        raise InputError(f"{name}: expected a list of samples with {' and '.join(NAMES)}, got {got(tree)}.")
    sides = [
        np.array(
            [matrix(item(s, key, f"{name}, sample {k}"), f"{name}, sample {k}, {key}") for k, s in enumerate(tree)]
        )
        for key in NAMES
    ]
    robot, camera = (
        matrices_side(name, T, counted="sample", frame=frame)
        for T, frame in zip(sides, ("base_T_gripper", "camera_T_target"), strict=True)
    )
    return Contents(robot, camera)


_FORM = (
    "'pose' (4 x 4), or 'translation' and 'quaternion' (x, y, z, w), with 'covariance' (6 x 6) or 'std' (6) of "
    "(theta, tau) in rad and m, null where nothing is known"
)


def read_prior(path: StrPath, of: str = "X") -> tuple[Array, Array]:
    """Read the prior of X or W from a YAML or JSON file, as ``prior_X`` or ``prior_W`` of `calibrate`.

    Parameters
    ----------
    path : path of the file
        Either a mapping with ``pose`` (4 x 4, metres), or ``translation`` (3) and ``quaternion`` (x, y, z, w), and
        ``covariance`` (6 x 6) or ``std`` (6) of ``xi = (theta, tau)`` in rad and m: left rotation, additive
        translation, in the parent frame of the pose. ``null`` in ``std``, and on the diagonal of ``covariance``, is a
        component that is not known. Or the JSON of an earlier result, whose open components are not known.
    of : "X" or "W"
        Which pose of an earlier result.

    Returns
    -------
    (pose (4, 4), covariance (6, 6)), infinite on the diagonal where nothing is known.

    Raises
    ------
    InputError
        A file that cannot be read or that holds something else.
    """
    target = as_path(path)
    with opened(target, MAX_DESCRIPTION_BYTES) as file:
        tree = parse_tree(file.read(), str(target))
    if not is_map(tree):
        raise InputError(f"{target}: expected {_FORM}, or an earlier result.")
    if str(tree.get("format", "")).startswith("uq-handeye calibration"):
        return _of_result(tree, of, str(target))
    if ("covariance" in tree) == ("std" in tree):
        raise InputError(f"{target}: expected either 'covariance' or 'std', {_FORM}.")
    try:
        if "pose" in tree:
            pose = np.array(tree["pose"], dtype=float)
        else:
            pose = np.eye(4)
            pose[:3, :3] = Rotation.from_quat(np.array(tree["quaternion"], dtype=float)).as_matrix()
            pose[:3, 3] = tree["translation"]
        if "std" in tree:
            covariance = np.diag(_numbers(tree["std"], (6,)) ** 2)
        else:
            covariance = _numbers(tree["covariance"], (6, 6))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{target}: expected {_FORM}, got {error}.") from error
    return as_transforms(pose, str(target), stack=False), covariance


def _numbers(value: Any, shape: tuple[int, ...]) -> Array:
    """Infinity for null."""
    S = np.array(value, dtype=object)
    if S.shape != shape:
        raise ValueError(f"an array of shape {S.shape}")
    return np.array([np.inf if x is None else float(x) for x in S.ravel()]).reshape(shape)


def _of_result(tree: dict[str, Any], of: str, name: str) -> tuple[Array, Array]:
    pose, covariance = tree.get(of), tree.get("covariance" if of == "X" else "covariance_W")
    std = tree.get("std" if of == "X" else "std_W")
    if pose is None or covariance is None or std is None:
        raise InputError(f"{name}: this result holds no {of} with a covariance.")
    S = np.array(covariance, dtype=float)
    unknown = np.array([value is None for value in std])
    S[unknown], S[:, unknown] = 0.0, 0.0
    S[unknown, unknown] = np.inf
    return as_transforms(pose, name, stack=False), S
