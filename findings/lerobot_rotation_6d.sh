#!/usr/bin/env bash
# lerobot 0.6.1: six numbers of a rotation mean one thing to X-VLA and another to GR00T, in one package.
#
# Expected: the 6D rotation of a pose (Zhou et al. 2019: the first two columns of the matrix, one after the other) has one
# order within one package, so that states and actions `xyz+rot6d` of one policy can be read by the other's functions.
# Seen: xvla takes the first two columns, groot the first two rows. Both read the other's numbers without a complaint (any two
# independent vectors make a rotation) and get the inverse rotation: a pose turned by 40 deg comes out 80 deg off, one turned
# by 90 deg half a turn, the position stays right. pytransform3d 3.17.0, new with 6D, takes columns. Rows are those of
# PyTorch3D and UMI (facebookresearch/pytorch3d pull request 2018, universal_manipulation_interface issue 77 ask about it);
# that both forms are in LeRobot is said nowhere. A data set with poses as xyz+rot6d does not tell which one it has.
# The package needs Python 3.12 and torch; two of its modules are read here, which need neither to convert.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "scipy==1.15.3" "pytransform3d==3.17.0" || exit 2
"$folder/env/bin/pip" install -q --no-deps --ignore-requires-python --target "$folder/lerobot" "lerobot==0.6.1" || exit 2
"$folder/env/bin/python" - "$folder/lerobot" <<'PY'
import sys
from importlib.metadata import version
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
from pytransform3d.rotations import matrix_from_rotation_6d
from scipy.spatial.transform import Rotation

sys.modules["torch"] = MagicMock()  # named in annotations only


def policy(name):
    spec = spec_from_file_location(f"{name}_utils", Path(sys.argv[1], "lerobot", "policies", name, "utils.py"))
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


xvla, groot = policy("xvla"), policy("groot")
print(f"lerobot {Path(next(Path(sys.argv[1]).glob('lerobot-*.dist-info'))).name.split('-')[1][:5]}, ", end="")
print(f"pytransform3d {version('pytransform3d')}: angle (deg) between a rotation and what is read from its six numbers")
same = True
for degrees in (10.0, 40.0, 90.0):
    true = Rotation.from_rotvec(np.radians(degrees) * np.array([0.6, -0.48, 0.64]))
    pose = np.eye(4)
    pose[:3, :3] = true.as_matrix()
    written = {"xvla": xvla.mat_to_rotate6d(pose[:3, :3]), "groot": groot.homogeneous_to_xyz_rot6d(pose)[3:]}
    readers = {
        "xvla": lambda six: Rotation.from_rotvec(xvla.rotate6d_to_axis_angle(np.array(six))),
        "groot": lambda six: Rotation.from_matrix(groot.rot6d_to_matrix(six)),
        "pytransform3d": lambda six: Rotation.from_matrix(matrix_from_rotation_6d(six)),
    }
    off = {(by, of): np.degrees((read(six) * true.inv()).magnitude()) for by, read in readers.items() for of, six in written.items()}
    print(f"  turned by {degrees:.0f}: " + ", ".join(f"{by} reads {of} {angle:.2f}" for (by, of), angle in off.items()))
    for (by, of), angle in off.items():
        columns = by != "groot", of != "groot"
        same &= abs(angle - (0 if columns[0] == columns[1] else 2 * degrees)) < 0.01
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
