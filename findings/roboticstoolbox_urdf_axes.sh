#!/usr/bin/env bash
# roboticstoolbox-python 1.5.0: a URDF joint whose axis is not exactly x, y or z ends up 57.3 deg off.
#
# Expected: `Robot.URDF` reads any axis, as yourdfpy does, and a joint at zero leaves its child where `origin` says. Seen: as soon
# as two numbers of the axis are not zero, whatever their size, the joint's frame is turned by 1 rad (57.3 deg), at zero and
# elsewhere, and nothing is said; axes of x, y or z, of either sign and any length, are right. Axes of calibrated kinematics
# are oblique, and exporters of CAD write 1e-17 for zero. The positions of the flange, and with them a hand-eye calibration
# whose robot poses come from joints, are wrong by decimetres. Pull request 441 (2024, closed) is about such axes.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.4.6" "scipy==1.17.1" "roboticstoolbox-python==1.5.0" "yourdfpy==0.0.60" || exit 2
cd "$folder"
"$folder/env/bin/python" -W ignore - <<'PY'
import os
import sys
from importlib.metadata import version

import numpy as np
import roboticstoolbox
import yourdfpy
from scipy.spatial.transform import Rotation

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/><link name="arm"/><link name="tool"/>
  <joint name="joint" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0.1 0.2 0.3" rpy="0.1 -0.2 0.3"/>
    <axis xyz="{axis}"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="end" type="fixed"><parent link="arm"/><child link="tool"/><origin xyz="0.5 0 0.1" rpy="0 0 0"/></joint>
</robot>
"""
print(f"roboticstoolbox-python {version('roboticstoolbox-python')} and yourdfpy {version('yourdfpy')} against Rodrigues' formula")
off = {}
for axis in ("0 0 1", "0 -1 0", "0 0 2", "0.001 0 0.9999995", "1e-17 0 1", "0.6 0 0.8"):
    with open("arm.urdf", "w") as file:
        file.write(URDF.format(axis=axis))
    robot, other = roboticstoolbox.Robot.URDF(os.path.abspath("arm.urdf")), yourdfpy.URDF.load("arm.urdf")
    direction = np.array(axis.split(), float)
    for angle in (0.0, 0.5):
        turn = Rotation.from_rotvec(angle * direction / np.linalg.norm(direction))
        truth = np.eye(4)
        truth[:3, :3] = (Rotation.from_euler("xyz", [0.1, -0.2, 0.3]) * turn).as_matrix()
        truth[:3, 3] = [0.1, 0.2, 0.3] + truth[:3, :3] @ [0.5, 0, 0.1]
        other.update_cfg({"joint": angle})
        poses = [np.asarray(robot.fkine([angle], end="tool").A), other.get_transform("tool", "base")]
        errors = [np.linalg.inv(truth) @ pose for pose in poses]
        off[axis, angle] = [np.degrees(Rotation.from_matrix(error[:3, :3]).magnitude()) for error in errors]
        lengths = [1e3 * np.linalg.norm(error[:3, 3]) for error in errors]
        ours, theirs = (f"{a:.2f} deg, {b:.1f} mm" for a, b in zip(off[axis, angle], lengths))
        print(f"  axis {axis:18} at {angle} rad: {ours} off (yourdfpy {theirs})")
same = all(other < 1e-5 for _, other in off.values())
for (axis, angle), (error, _) in off.items():
    oblique = sum(float(x) != 0 for x in axis.split()) > 1
    same &= error > 50 if oblique else error < 1e-5
    same &= not oblique or angle > 0 or abs(error - np.degrees(1)) < 0.01
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
