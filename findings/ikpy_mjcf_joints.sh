#!/usr/bin/env bash
# ikpy 4.2.1: a chain read from MJCF leaves out where the joints are, where they begin and what the defaults say.
#
# `Chain.from_mjcf_file` reads a robot of MuJoCo. Expected: forward kinematics of the same file are those of MuJoCo 4.0.0. Seen:
# right for plain files; silently wrong if a joint has `pos` (100 mm) or `ref` (all of it, 17 deg for 0.3 rad), if the axis comes
# from the unnamed default (32 deg) or the type from a class (a slide turns), if the axis is not of length 1 (20 deg), if
# `eulerseq` is in capitals (fixed axes, 11 deg), and if a `frame` stands around the body (22 deg). Robots of the menagerie have
# classes and defaults throughout. Robot poses from recorded joints differ from station to station, which X cannot take up.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.4.6" "scipy==1.17.1" "ikpy==4.2.1" "mujoco==4.0.0" || exit 2
cd "$folder"
"$folder/env/bin/python" -W ignore - <<'PY'
import sys
from importlib.metadata import version

import mujoco
import numpy as np
from ikpy.chain import Chain
from scipy.spatial.transform import Rotation

ARM = """<mujoco><compiler angle="radian" {compiler}/>{default}<worldbody>{before}<body name="a" pos="0.1 0.2 0.3" {turn}>
<joint name="j1" {joint}/><geom size="0.1"/><body name="b" pos="0.3 0 0.1"><joint name="j2" axis="0 1 0"/><geom size="0.1"/>
</body></body>{after}</worldbody></mujoco>"""
PLAIN = {"compiler": "", "default": "", "before": "", "turn": 'euler="0.5 0.3 0.2"', "joint": 'axis="0 0 1"', "after": ""}
CLASS = '<default><default class="c"><joint axis="1 0 0" type="slide"/></default></default>'
cases = {
    "plain": ({}, True),
    "oblique axis": ({"joint": 'axis="0.6 0 0.8"'}, True),
    "joint pos": ({"joint": 'axis="0 0 1" pos="0.1 0.05 0"'}, False),
    "joint ref": ({"joint": 'axis="0 0 1" ref="0.3"'}, False),
    "slide ref": ({"joint": 'type="slide" axis="0 0 1" ref="0.3"'}, False),
    "axis by default": ({"default": '<default><joint axis="1 0 0"/></default>', "joint": ""}, False),
    "type by class": ({"default": CLASS, "joint": 'class="c"'}, False),
    "axis of length 2.2": ({"joint": 'axis="1 0 2"'}, False),
    "slide of length 2.2": ({"joint": 'type="slide" axis="1 0 2"'}, False),
    "eulerseq XYZ": ({"compiler": 'eulerseq="XYZ"'}, False),
    "frame": ({"before": '<frame pos="0.1 0 0" euler="0.3 0.2 0.1">', "after": "</frame>"}, False),
}
print(f"ikpy {version('ikpy')} against MuJoCo {mujoco.__version__}: the last body of an arm of two joints")
same, q = True, np.array([0.4, -0.3])
for name, (changes, right) in cases.items():
    with open("arm.xml", "w") as file:
        file.write(ARM.format(**PLAIN | changes))
    model = mujoco.MjModel.from_xml_path("arm.xml")
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    chain = Chain.from_mjcf_file("arm.xml", base_elements=["a"])
    pose = chain.forward_kinematics([0.0, *q])
    turned = np.degrees(Rotation.from_matrix(pose[:3, :3] @ data.body("b").xmat.reshape(3, 3).T).magnitude())
    moved = 1e3 * np.linalg.norm(pose[:3, 3] - data.body("b").xpos)
    print(f"  {name:20}: {turned:5.2f} deg and {moved:5.1f} mm off")
    same &= max(turned, moved) < 1e-4 if right else max(turned / 2, moved / 20) > 1
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
