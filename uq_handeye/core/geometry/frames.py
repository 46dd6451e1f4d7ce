"""Names of the frames of X and W for each setup."""

from __future__ import annotations

SETUPS = {"eye-in-hand": "gripper_T_camera", "eye-to-hand": "base_T_camera"}


# The frames of W = G X C, the same for all poses.
TARGETS = {"eye-in-hand": "base_T_target", "eye-to-hand": "gripper_T_target"}
