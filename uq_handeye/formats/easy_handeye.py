"""Samples of easy_handeye (ROS 1) and easy_handeye2 (ROS 2), in YAML.

easy_handeye2 saves ``parameters`` and ``samples``, each with ``robot`` and ``tracking``
(marcoesposito1988/easy_handeye2: ``easy_handeye2/easy_handeye2/handeye_sampler.py``, ``save_samples``, and
``easy_handeye2_msgs/msg/SampleList.msg``). easy_handeye saves no samples; its service ``get_sample_list`` prints
``hand_world_samples`` and ``camera_marker_samples`` (IFL-CAMP/easy_handeye:
``easy_handeye/src/easy_handeye/handeye_server.py`` and ``easy_handeye/msg/SampleList.msg``), which
``rosservice call`` writes as YAML.

Each is a ``geometry_msgs/Transform``: metres, quaternion by names. ``tracking`` is ``camera_T_target``. ``robot`` is
what enters AX = XB (``_get_transforms`` in the samplers of both): ``base_T_gripper`` where the camera is on the hand,
``gripper_T_base`` where it is not.
"""

from __future__ import annotations

import numpy as np

from ..core.files.one_line import short
from ..core.files.tree_values import Tree, fields_of, got, is_list, is_map, item, items_of, transform
from ..core.geometry.se3 import Array
from ..errors import InputError
from .contents import Contents, Side

FRAMES = ("robot_base_frame", "robot_effector_frame", "tracking_base_frame", "tracking_marker_frame")
FIELDS = ("timestamp", *(f"translation.{a}" for a in "xyz"), *(f"rotation.{a}" for a in "xyzw"))


def read_easy_handeye2(tree: Tree, name: str) -> Contents:
    """``samples: [{robot, tracking}, ...]``, with ``parameters``; or the list only."""
    _refuse_result(tree, name)
    samples = tree if is_list(tree) else item(tree, "samples", name)
    if not items_of(samples):
        raise InputError(f"{name}, samples: expected a list of samples, got {got(samples)}.")
    parts = [
        [transform(item(sample, part, f"{name}, sample {k}"), f"{name}, sample {k}, {part}") for part in _parts(sample)]
        for k, sample in enumerate(items_of(samples))
    ]
    return _contents(np.array(parts), fields_of(tree).get("parameters"), name)


def _parts(sample: Tree) -> tuple[str, str]:
    """The names of both sides; easy_handeye calls the tracking ``optical`` within its server."""
    old = "optical" in fields_of(sample) and "tracking" not in fields_of(sample)
    return "robot", "optical" if old else "tracking"


def read_easy_handeye(tree: Tree, name: str) -> Contents:
    """``hand_world_samples`` and ``camera_marker_samples``, also below ``samples``."""
    _refuse_result(tree, name)
    lists = fields_of(fields_of(tree).get("samples")) or tree
    sides = []
    for part in ("hand_world_samples", "camera_marker_samples"):
        values = item(lists, part, name)
        if "transforms" in fields_of(values):  # visp_hand2eye_calibration/TransformArray
            values = fields_of(values)["transforms"]
        if not items_of(values):
            raise InputError(f"{name}, {part}: expected a list of transforms, got {got(values)}.")
        sides.append([transform(value, f"{name}, {part}, sample {k}") for k, value in enumerate(items_of(values))])
    if len(sides[0]) != len(sides[1]):
        raise InputError(
            f"{name}: expected as many hand_world_samples as camera_marker_samples, got {len(sides[0])} and "
            f"{len(sides[1])}."
        )
    fields = fields_of(tree)
    parameters = fields.get("parameters", tree if "eye_on_hand" in fields else None)
    return _contents(np.array(sides).swapaxes(0, 1), parameters, name)


def _refuse_result(tree: Tree, name: str) -> None:
    if {"transform", "transformation"} & set(fields_of(tree)):
        raise InputError(
            f"{name} is a result of easy_handeye, one transform; expected its samples (easy_handeye2: the button Save "
            "samples writes NAME.samples; easy_handeye: rosservice call .../get_sample_list > samples.yaml)."
        )


def _contents(parts: Array, parameters: Tree, name: str) -> Contents:
    """Contents from (n, 2, 7) numbers of robot and tracking, and the parameters of the tool."""
    robot, camera = (Side(name, parts[:, k, :3], parts[:, k, 3:], counted="sample", columns=FIELDS) for k in range(2))
    setup, notes = _setup(parameters, name)
    return Contents(robot, camera, setup=setup, robot_enters=True, notes=tuple(notes))


def _setup(parameters: Tree, name: str) -> tuple[str | None, list[str]]:
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
