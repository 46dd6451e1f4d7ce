#!/usr/bin/env bash
# spatialmath-python 1.1.18: the axis and angle of a rotation that is nearly a half turn are degrees off.
#
# A tool that points straight down has a rotation of half a turn in the base of most arms, and a controller writes its rotation
# vector with six or seven digits: (2.2214414, 0, 2.2214414) is 1e-7 rad short of pi. Expected: tr2angvec, trlog and SO3.log give
# this vector back to rounding, as SciPy and spatialmath's own UnitQuaternion do. Seen: more than 1 deg off at 1e-7 rad, 0.04 deg
# at 7e-7 rad, without a word; within 5e-8 rad it is right again. The axis is taken from (R - R^T) / (2 sin theta), and theta
# from the arc cosine of the trace, which near pi has half of the digits. What stands on it has the same errors: the rotation
# vector and the quaternion of airo_spatial_algebra 2026.10.1 for such a pose. Who needs the logarithm goes by the quaternion.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q "numpy==2.4.6" "scipy==1.17.1" "spatialmath-python==1.1.18" \
    "airo_spatial_algebra==2026.10.1" || exit 2
status=0
"$folder/venv/bin/python" -W ignore - <<'PY' || status=1
import importlib.metadata
import sys

import numpy as np
import spatialmath.base as base
from airo_spatial_algebra import SE3Container
from scipy.spatial.transform import Rotation
from spatialmath import SO3, UnitQuaternion

print("spatialmath-python", importlib.metadata.version("spatialmath-python"))
off = {}
for short, vector in (
    ("1e-1", [2.15, 0.0, 2.15]),
    ("7e-7", [2.221441, 2.221441, 0.0]),
    ("1e-7", [2.2214414, 0.0, 2.2214414]),
    ("5e-8", [3.1415926, 0.0, 0.0]),
):
    true = Rotation.from_rotvec(vector)
    R = true.as_matrix()
    angle, axis = base.tr2angvec(R)
    pose = SE3Container.from_rotation_matrix_and_translation(R, np.zeros(3))
    found = {
        "tr2angvec": Rotation.from_rotvec(angle * axis),
        "SO3.log": Rotation.from_rotvec(SO3(R).log(twist=True)),
        "UnitQuaternion": Rotation.from_quat(UnitQuaternion(SO3(R)).A, scalar_first=True),
        "airo quaternion": Rotation.from_quat(pose.orientation_as_quaternion),
    }
    off[short] = {name: np.degrees((one * true.inv()).magnitude()) for name, one in found.items()}
    print(f"{short} rad from a half turn:", ", ".join(f"{name} {error:.1e} deg off" for name, error in off[short].items()))
wrong = ("tr2angvec", "SO3.log", "airo quaternion")
right = [off[short][name] < 1e-5 for short in ("1e-1", "5e-8") for name in off[short]]
right += [off[short]["UnitQuaternion"] < 1e-5 for short in off]
seen = [off["7e-7"][name] > 0.01 for name in wrong] + [off["1e-7"][name] > 0.5 for name in wrong]
sys.exit(0 if all(right) and all(seen) else 1)
PY
[ "$status" -eq 0 ] && echo "as described" || echo "the behaviour has changed"
exit "$status"
