#!/usr/bin/env bash
# MuJoCo 4.0.0: a joint of a URDF with one bound written is read with both and limited by none.
#
# In a URDF lower and upper are optional and 0 where absent (wiki.ros.org/urdf/XML/joint), so <limit upper="1.0" .../> is a joint
# from 0 to 1 rad, as Pinocchio reads it. Expected: MuJoCo limits it to this range, or refuses it. Seen: jnt_range is [0, 1] and
# jnt_limited is false, without a word; with lower="0" written as well it is limited. So whoever draws calibration poses from
# jnt_range stays in the range, while the simulation, and inverse kinematics that asks jnt_limited (mink), goes beyond it. The
# rule is that of MJCF (a limit needs a range with two numbers in order): range="60 30" too is no limit unless limited="true".
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.4.6" "mujoco==4.0.0" "pin==4.1.0" "mink==1.3.0" || exit 2
cd "$folder"
"$folder/env/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import mink
import mujoco
import numpy as np
import pinocchio

ROBOT = """<robot name="arm"><link name="base"/><link name="tip"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>
<limit {} effort="1" velocity="1"/></joint></robot>"""

print(", ".join(f"{name} {version(name)}" for name in ("mujoco", "pin", "mink", "numpy")))
limited = []
for bounds, expected in (('lower="0" upper="1"', [0, 1]), ('upper="1"', [0, 1]), ('lower="-1"', [-1, 0])):
    robot = ROBOT.format(bounds)
    other = pinocchio.buildModelFromXML(robot)
    model = mujoco.MjModel.from_xml_string(robot)
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = 1.0 if expected[1] else -1.0
    for _ in range(2000):
        mujoco.mj_step(model, data)
    limits = mink.ConfigurationLimit(model).indices
    print(f"  {bounds:20}: expected {expected}; Pinocchio [{other.lowerPositionLimit[0]:g}, {other.upperPositionLimit[0]:g}]; MuJoCo"
          f" range {model.jnt_range[0].tolist()}, limited {bool(model.jnt_limited[0])}, pushed to {data.qpos[0]:.2f} rad; joints"
          f" that mink limits: {np.asarray(limits).tolist()}")
    read = np.allclose(model.jnt_range[0], expected) and other.upperPositionLimit[0] == expected[1]
    limited.append((bool(read), bool(model.jnt_limited[0])))
described = limited == [(True, True), (True, False), (True, False)]
print("as described" if described else "the behaviour has changed")
sys.exit(0 if described else 1)
PY
