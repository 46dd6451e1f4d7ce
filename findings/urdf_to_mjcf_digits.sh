#!/usr/bin/env bash
# urdf-to-mjcf 0.1.1 with MuJoCo 3.11: the converted arm has rotations of four decimals, a raised base and a free joint.
#
# Expected: the MJCF is the arm of the URDF to the digits of the file, base at the origin, as MuJoCo's own reader of URDF and
# other converters have it (urdf2any 0.3.0, truerig 0.1.1, urdf-mujoco-converter 0.1.0 write nine digits and more).
# Seen: the positions of the joints keep their digits, the quaternions are rounded to four decimals (format_value). The tip of
# this arm moves by up to 0.15 mm, and a correction of a joint below 0.1 mrad is lost. The base is lifted until its lowest
# collision shape stands on a floor, and floats ("adding a freejoint" in the log): a camera pose in the world of the simulator
# is not one in the base.
# Packages that treat meshes only are replaced by empty modules.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "scipy==1.15.3" "mujoco==3.11.0" "pydantic==2.12.4" || exit 2
"$folder/env/bin/pip" install -q --no-deps "urdf-to-mjcf==0.1.1" || exit 2
cd "$folder"
"$folder/env/bin/python" - <<'PY'
import contextlib
import io
import logging
import sys
from importlib.metadata import version
from pathlib import Path
from unittest.mock import MagicMock

import mujoco
import numpy as np

for name in ("coacd", "trimesh", "pymeshlab", "collada", "fast_simplification", "rtree", "tqdm", "PIL"):
    sys.modules[name] = MagicMock()
from urdf_to_mjcf.cli.convert import main

# Six joints as on a small arm, with last digits as a calibration gives them.
ROWS = [
    ("0 0 0.1625", "0.00013 -0.00021 0.00034"),
    ("0.00018 0 0", "1.57092 0.00016 -0.00027"),
    ("-0.42511 0 0", "0.00023 0.00037 0.00012"),
    ("-0.39224 0 0.1333", "-0.00019 0.00026 0.00033"),
    ("0 -0.0997 0", "1.57064 0.00024 -0.00015"),
    ("0 0.0996 0", "1.57103 3.14142 3.14183"),
]
BOX = '<collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision>'
MASS = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
text = f'<robot name="arm"><link name="link0">{MASS}{BOX}</link>'
for number, (xyz, rpy) in enumerate(ROWS, 1):
    text += f'<link name="link{number}">{MASS}</link><joint name="j{number}" type="revolute">'
    text += f'<parent link="link{number - 1}"/><child link="link{number}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
    text += '<axis xyz="0 0 1"/><limit lower="-6" upper="6" effort="1" velocity="1"/></joint>'
Path("arm.urdf").write_text(text + "</robot>")
logging.disable(logging.WARNING)
sys.argv = ["urdf-to-mjcf", "arm.urdf"]
with contextlib.redirect_stdout(io.StringIO()):
    main()
converted = next(Path("output_mjcf").rglob("*.xml"))


def tips(path, angles):
    """Return the tip in the base for each set of joint angles, and the base in the world."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, found = mujoco.MjData(model), []
    base = [i for i in range(model.nbody) if model.body(i).name == "link0"]
    for row in angles:
        data.qpos[:] = model.qpos0
        for number, angle in enumerate(row, 1):
            data.qpos[model.joint(f"j{number}").qposadr[0]] = angle
        mujoco.mj_forward(model, data)
        origin = data.xpos[base[0]] if base else np.zeros(3)
        found.append(data.body("link6").xpos - origin)
    return np.array(found), origin.copy(), [model.joint(i).name for i in range(model.njnt)]


angles = np.random.default_rng(0).uniform(-np.pi, np.pi, (300, 6))
own, _, joints = tips("arm.urdf", angles)
other, base, more = tips(converted, angles)
error = 1e3 * np.linalg.norm(own - other, axis=1)
print(f"urdf-to-mjcf {version('urdf-to-mjcf')}, MuJoCo {mujoco.__version__}: an arm of six joints")
print(f"  tip in the base against MuJoCo's reading of the URDF: rms {np.sqrt(np.mean(error**2)):.3f} mm, at most {error.max():.3f} mm")
print(f"  base in the world: {base.round(4)} m; joints beside the arm's: {sorted(set(more) - set(joints))}")
same = 0.02 < error.max() < 1 and abs(base[2] - 0.1) < 1e-3 and len(more) == len(joints) + 1
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
