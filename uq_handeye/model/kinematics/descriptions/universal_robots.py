"""The calibrated kinematics of a Universal Robots arm, as ``ur_calibration`` extracts it from the controller.

The file (``my_robot_calibration.yaml``, in the form of ``default_kinematics.yaml`` of ``ur_description``) has the
origins of the six joints, ``x, y, z`` in m and ``roll, pitch, yaw`` in rad about the fixed axes:

    kinematics:
      shoulder: {x: 0, y: 0, z: 0.1625, roll: 0, pitch: 0, yaw: 0}
      upper_arm: ...

The first is in ``base``, the frame of the controller (``base_link`` of ROS is rotated by half a turn about z); the last
joint's frame is ``tool0``. With a URDF the origins replace those of its joints, and base and tip may be any of its
links.
"""

from __future__ import annotations

import numpy as np

from ....core.files.one_line import short
from ....core.files.open import StrPath, as_path, opened, shown
from ....core.files.tree_values import got, is_map, item, number
from ....core.files.trees import parse_tree
from ....core.geometry.rotations import Rotation
from ....core.geometry.se3 import Array
from ....core.limits import MAX_DESCRIPTION_BYTES, MAX_PLAIN_ANGLE_RAD, MAX_PLAIN_LENGTH_M
from ....errors import InputError
from ..joint import REVOLUTE, ChainParts, Joint
from .urdf import Tree, chain_of, read_tree

# The links whose origins the file has, and the joints that move them.
JOINTS = {
    "shoulder": "shoulder_pan_joint",
    "upper_arm": "shoulder_lift_joint",
    "forearm": "elbow_joint",
    "wrist_1": "wrist_1_joint",
    "wrist_2": "wrist_2_joint",
    "wrist_3": "wrist_3_joint",
}
BASES, TIPS = ("base", "base_link"), ("tool0", "flange")


def read_ur_calibration(
    path: StrPath, urdf: StrPath | None = None, base: str | None = None, tip: str | None = None, prefix: str = ""
) -> ChainParts:
    """The chain of a calibrated arm, alone or with the other links of a URDF; raises `InputError`."""
    path = as_path(path)
    origins = _origins(path)
    if urdf is not None:
        return _in_urdf(origins, read_tree(urdf), base, tip, prefix)
    base, tip = base or BASES[0], tip or TIPS[0]
    for name, known in ((base, BASES), (tip, TIPS)):
        if name not in known:
            raise InputError(f"Expected {' or '.join(known)}, got {short(str(name))}; give the URDF for other frames.")
    transforms = list(origins.values())
    if base == "base_link":
        transforms[0] = _transform((0.0, 0.0, 0.0), (0.0, 0.0, np.pi)) @ transforms[0]
    joints = tuple(
        Joint(f"{prefix}{name}", REVOLUTE, T, np.array([0.0, 0.0, 1.0]), -2 * np.pi, 2 * np.pi)
        for name, T in zip(JOINTS.values(), transforms, strict=True)
    )
    end = np.eye(4) if tip == "tool0" else _transform((0.0, 0.0, 0.0), (0.0, -np.pi / 2, -np.pi / 2))
    return ChainParts("universal_robots", base, tip, joints, end)


def _in_urdf(origins: dict[str, Array], tree: Tree, base: str | None, tip: str | None, prefix: str) -> ChainParts:
    replaced = {}
    for link, origin in origins.items():
        wanted = f"{prefix}{JOINTS[link]}"
        found = [joint.name for joint in tree.joints if joint.name == wanted]
        found = found or [joint.name for joint in tree.joints if joint.name.endswith(wanted)]
        if len(found) != 1:
            several = f"{len(found)} of them, {short(', '.join(found))}; give the prefix" if found else "none"
            raise InputError(f"{tree.where}: expected one joint {wanted} of a Universal Robots arm, got {several}.")
        replaced[found[0]] = origin
    return chain_of(tree, base, tip, replaced)


def _origins(path: StrPath) -> dict[str, Array]:
    path = as_path(path)
    name = shown(path)
    with opened(path, MAX_DESCRIPTION_BYTES) as file:
        tree = parse_tree(file.read(), name)
    if not is_map(tree) or "kinematics" not in tree:
        raise InputError(
            f"{name}: expected the field kinematics, as ur_calibration writes it, got {got(tree)}; is it the "
            "calibration of a Universal Robots arm?"
        )
    values, found = tree["kinematics"], {}
    for link in JOINTS:
        where = f"{name}, kinematics.{link}"
        fields = item(values, link, f"{name}, kinematics")
        x, y, z, *angles = (
            number(item(fields, key, where), f"{where}.{key}") for key in ("x", "y", "z", "roll", "pitch", "yaw")
        )
        if max(map(abs, angles)) > MAX_PLAIN_ANGLE_RAD:
            raise InputError(f"{where}: expected roll, pitch and yaw in rad, got {angles}; are they in degrees?")
        if max(map(abs, (x, y, z))) > MAX_PLAIN_LENGTH_M:
            raise InputError(f"{where}: expected x, y and z in m, got {[x, y, z]}; are they in millimetres?")
        found[link] = _transform((x, y, z), tuple(angles))
    return found


def _transform(xyz: tuple[float, ...], rpy: tuple[float, ...]) -> Array:
    T: Array = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    T[:3, 3] = xyz
    return T
