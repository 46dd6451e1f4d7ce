#!/usr/bin/env bash
# compas 2.15.1: rotation vectors within 0.3 deg of zero or of half a turn are rounded to zero or to half a turn.
#
# `Frame.axis_angle_vector` is the rotation vector in rad, which is how a UR arm writes a pose; a tool that points straight down
# is nearly half a turn from the base. Expected: the vector of a frame turns back into the frame to rounding, as its quaternion
# does. Seen: where no two opposite numbers of the matrix differ by 0.01 the rotation is taken for none or for half a turn: up
# to 0.29 deg about x, y or z and 0.49 deg about (1, 1, 1) is lost without a word, 2.5 to 4.3 mm at the end of 0.5 m.
# `Rotation.axis_angle_vector` and `axis_angle_vector_from_matrix` do the same. A correction of a few mrad between two frames is
# exactly zero. Who needs the vector goes by `frame.quaternion`; the frames themselves and their JSON keep every digit.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "scipy==1.15.3" "compas==2.15.1" || exit 2
"$folder/env/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import compas
import numpy as np
from compas.geometry import Frame
from scipy.spatial.transform import Rotation

print(f"compas {version('compas')}: deg between a frame and what its rotation vector, its quaternion and its JSON say")
rows = []
for label, axis in (("x", [1, 0, 0]), ("oblique", [0.6, 0, 0.8]), ("(1, 1, 1)", [3**-0.5] * 3)):
    for short in (1e-3, 4.5e-3, 8e-3, 2e-2):
        for name, angle in (("rad", short), ("rad short of pi", np.pi - short)):
            true = Rotation.from_rotvec(angle * np.array(axis))
            matrix = true.as_matrix()
            frame = Frame([0, 0, 0], matrix[:, 0].tolist(), matrix[:, 1].tolist())
            found = (
                Rotation.from_rotvec(list(frame.axis_angle_vector)),
                Rotation.from_quat(list(frame.quaternion), scalar_first=True),
                Rotation.from_quat(list(compas.json_loads(compas.json_dumps(frame)).quaternion), scalar_first=True),
            )
            off = [np.degrees((one * true.inv()).magnitude()) for one in found]
            rows.append((label, short, *off))
            print(f"  {short:g} {name} about {label}: {off[0]:.3f}, {off[1]:.0e}, {off[2]:.0e}")
same = all(max(quaternion, json) < 1e-6 for *_, quaternion, json in rows)
for label, short, vector, *_ in rows:
    lost = short < 5e-3 or (short < 9e-3 and label == "(1, 1, 1)")
    same &= abs(vector - np.degrees(short)) < 0.01 if lost else vector < 1e-6
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
