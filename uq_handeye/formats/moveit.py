"""Samples of MoveIt calibration, in YAML: a list of maps with ``effector_wrt_world`` and ``object_wrt_sensor``.

Each is a 4x4 matrix of 16 numbers, row by row, in metres: ``base_T_gripper`` and ``camera_T_target`` for both mounts of
the camera. Source of the rules: moveit/moveit_calibration,
``moveit_calibration_gui/handeye_calibration_rviz_plugin/src/handeye_control_widget.cpp``, ``saveSamplesBtnClicked``.
"""

from __future__ import annotations

import numpy as np

from ..core.files.tree_values import Tree, fields_of, got, item, items_of, matrix
from ..errors import InputError
from .contents import Contents, matrices_side

NAMES = ("effector_wrt_world", "object_wrt_sensor")


def read_moveit(tree: Tree, name: str) -> Contents:
    """The samples of a tree."""
    if "joint_values" in fields_of(tree):
        raise InputError(f"{name} holds joint states; expected the samples, which MoveIt saves by 'Save samples'.")
    if not items_of(tree):
        raise InputError(f"{name}: expected a list of samples with {' and '.join(NAMES)}, got {got(tree)}.")
    sides = [
        np.array(
            [
                matrix(item(s, key, f"{name}, sample {k}"), f"{name}, sample {k}, {key}")
                for k, s in enumerate(items_of(tree))
            ]
        )
        for key in NAMES
    ]
    robot, camera = (
        matrices_side(name, T, counted="sample", frame=frame)
        for T, frame in zip(sides, ("base_T_gripper", "camera_T_target"), strict=True)
    )
    return Contents(robot, camera)
