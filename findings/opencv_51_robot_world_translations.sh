#!/usr/bin/env bash
# opencv-contrib-python 5.1.0: of the two hand-eye functions one takes translations as plain vectors, the other no more.
#
# 5.1 has calibrateHandEye and calibrateRobotWorldHandEye again, which 5.0 had not. Expected: a program that ran with 4.14 runs
# with 5.1. Seen: translations as arrays of shape (n, 3), the form that NumPy slices poses to, are taken by calibrateHandEye as
# before, while calibrateRobotWorldHandEye fails inside a matrix product or with "Can't reallocate Mat", which names no argument.
# As columns, (n, 3, 1), both work in both versions, and give the same to rounding.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
status=0
for version in 4.14.0.94 5.1.0.95; do
    python3 -m venv "$folder/$version"
    "$folder/$version/bin/pip" install -q "numpy==2.4.6" "scipy==1.17.1" "opencv-contrib-python==$version" || exit 2
    "$folder/$version/bin/python" - <<'PY' || status=1
import sys

import cv2
import numpy as np
from scipy.spatial.transform import Rotation, RigidTransform

rng = np.random.default_rng(0)
robot = RigidTransform.from_components(rng.normal(size=(12, 3)), Rotation.random(12, rng=rng))
gripper_T_camera = RigidTransform.from_components([0.05, -0.02, 0.1], Rotation.from_rotvec([0.3, -0.2, 1.0]))
base_T_target = RigidTransform.from_components([0.6, 0.1, 0.02], Rotation.from_rotvec([0.1, 0.2, -0.5]))
camera = (robot * gripper_T_camera).inv() * base_T_target
G, C, B = robot.as_matrix(), camera.as_matrix(), robot.inv().as_matrix()


def error(found):
    return float(np.abs(np.ravel(found) - gripper_T_camera.translation).max())


def hand_eye(t):
    return error(cv2.calibrateHandEye(G[:, :3, :3], t(G), C[:, :3, :3], t(C))[1])


def robot_world(t):
    *_, R, offset = cv2.calibrateRobotWorldHandEye(C[:, :3, :3], t(C), B[:, :3, :3], t(B))
    return error(-R.T @ np.reshape(offset, 3))


seen = {}
for function in (hand_eye, robot_world):
    for form, t in (("columns", lambda T: T[:, :3, 3:]), ("vectors", lambda T: T[:, :3, 3])):
        try:
            seen[function.__name__, form] = f"{function(t):.0e} m off"
        except cv2.error as failure:
            seen[function.__name__, form] = "fails: " + str(failure).split("error: ")[-1].split("\n")[0]
print(f"cv2 {cv2.__version__}:")
for (name, form), result in seen.items():
    print(f"  {name} with {form}: {result}")
fails = [key for key, result in seen.items() if result.startswith("fails")]
sys.exit(0 if fails == ([] if cv2.__version__.startswith("4.") else [("robot_world", "vectors")]) else 1)
PY
done
[ "$status" -eq 0 ] && echo "as described" || echo "the behaviour has changed"
exit "$status"
