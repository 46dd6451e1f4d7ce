"""Names of the frames of X and W for each setup."""

from __future__ import annotations

import numpy as np

SETUPS = {"eye-in-hand": "gripper_T_camera", "eye-to-hand": "base_T_camera"}


# The frames of W = G X C, the same for all poses.
TARGETS = {"eye-in-hand": "base_T_target", "eye-to-hand": "gripper_T_target"}

# Conventions of the camera's frame: the rotation (4, 4) from it to the optical frame, x right, y down, z ahead.
# opengl: x right, y up, looking along -z (Blender, MuJoCo); ros and wpilib: a body, x ahead, y left, z up.
_OF_BODY = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
CAMERA_CONVENTIONS = {
    "optical": np.eye(4),
    "opengl": np.diag([1.0, -1.0, -1.0, 1.0]),
    "ros": _OF_BODY,
    "wpilib": _OF_BODY,
}
# Those that differ from the optical frame and from each other.
OTHER_CONVENTIONS = ("opengl", "ros")
