#!/usr/bin/env bash
# pinocchio 4.1.0: two ways of writing a rotation in MJCF are read as another rotation, or as none.
#
# `buildModelFromMJCF` reads the robots of MuJoCo. Expected: forward kinematics of the same file are those of MuJoCo 4.0.0, as they
# are for quat, euler, xyaxes, zaxis, joint pos, ref, classes and oblique axes. Seen: `axisangle` with an axis that is not of
# length 1, which MuJoCo normalises, gives a matrix that is no rotation (0 1 1 40: determinant 20, 0.4 m off; 0 0 2 40: 2.6 m);
# and `eulerseq` in capitals, which is about fixed axes, is taken as about moving ones (12 deg off). No error, no warning. Robot
# poses from recorded joints are wrong from the first such body on, and with them X. Write such rotations as quat.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.4.6" "scipy==1.17.1" "pin==4.1.0" "mujoco==4.0.0" || exit 2
cd "$folder"
"$folder/env/bin/python" - <<'PY'
import sys

import mujoco
import numpy as np
import pinocchio
from scipy.spatial.transform import Rotation

BODY = '<inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>'
ARM = """<mujoco><compiler {compiler}/><worldbody><body name="a" pos="0.1 0.2 0.3" {turn}><joint name="j1" axis="0 0 1"/>{body}
<body name="b" pos="0.3 0 0.1"><joint name="j2" axis="0 1 0"/>{body}<site name="tool" pos="0.05 0.02 0.1"/></body></body>
</worldbody></mujoco>"""
cases = {
    "quat": ("", 'quat="2 0.5 0 1"', True),
    "euler in deg": ("", 'euler="30 20 10"', True),
    "eulerseq zyx": ('eulerseq="zyx"', 'euler="30 20 10"', True),
    "eulerseq XYZ": ('eulerseq="XYZ"', 'euler="30 20 10"', False),
    "eulerseq ZYX": ('eulerseq="ZYX"', 'euler="30 20 10"', False),
    "axisangle 0 0.6 0.8": ("", 'axisangle="0 0.6 0.8 40"', True),
    "axisangle 0 1 1": ("", 'axisangle="0 1 1 40"', False),
    "axisangle 0 0 2": ("", 'axisangle="0 0 2 40"', False),
    "xyaxes": ("", 'xyaxes="0 2 0 -1 0.2 3"', True),
    "zaxis": ("", 'zaxis="0 1 1"', True),
}
print(f"pinocchio {pinocchio.__version__} against MuJoCo {mujoco.__version__}: the tool of an arm of two joints")
same, q = True, np.array([0.4, -0.3])
for name, (compiler, turn, right) in cases.items():
    with open("arm.xml", "w") as file:
        file.write(ARM.format(compiler=compiler, turn=turn, body=BODY))
    model = mujoco.MjModel.from_xml_path("arm.xml")
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    other = pinocchio.buildModelFromMJCF("arm.xml")
    found = other.createData()
    pinocchio.framesForwardKinematics(other, found, q)
    tool = found.oMf[other.getFrameId("tool")]
    off = tool.rotation @ data.site("tool").xmat.reshape(3, 3).T
    turned = np.degrees(Rotation.from_matrix(off).magnitude())
    moved, determinant = 1e3 * np.linalg.norm(tool.translation - data.site("tool").xpos), np.linalg.det(tool.rotation)
    print(f"  {name:20}: {turned:5.2f} deg and {moved:6.1f} mm off, determinant {determinant:.3f}")
    same &= max(turned, moved) < 1e-4 if right else turned > 5 and moved > 20
    same &= abs(determinant - 1) > 0.05 if "axisangle" in name and not right else abs(determinant - 1) < 1e-9
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
