#!/usr/bin/env bash
# aniposelib 0.8.0: CameraGroup.load returns more than ten cameras in another order than CameraGroup.dump wrote them.
#
# Every function of a group takes pixels as an array (cameras, points, 2) in the order of its cameras. dump writes the tables
# cam_0, cam_1, ..., cam_11; load takes them in the order of their sorted names. Expected: the group that was written. Seen:
# 0, 1, 10, 11, 2, ...: from the third camera on each is taken for another, without a message. Points are then triangulated
# by the wrong cameras. With ten cameras or fewer nothing happens. caliscope 0.11.8 (CameraArray.to_aniposelib_toml) names the
# tables of its cameras alike. Remedy: look up cameras by their names (subset_cameras_names), which load keeps.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "scipy==1.17.1" "numba==0.68.1" "pandas==3.1.1" "toml==0.10.2" "tqdm==4.70.1" \
  "opencv-contrib-python-headless==4.12.0.88" || exit 2
"$folder/env/bin/pip" install -q --no-deps "aniposelib==0.8.0" || exit 2
FOLDER=$folder "$folder/env/bin/python" - <<'PY'
import os
import sys
from importlib.metadata import version

import numpy as np
from aniposelib.cameras import Camera, CameraGroup

FOCAL_PX, SIZE = 900.0, (1280, 720)
K = np.array([[FOCAL_PX, 0, 639.5], [0, FOCAL_PX, 359.5], [0, 0, 1]])
points = np.random.default_rng(0).uniform([-0.1, -0.1, 0.9], [0.1, 0.1, 1.1], (20, 3))
print(f"aniposelib {version('aniposelib')}: a group of cameras written and read again")
seen = {}
for count in (10, 12):
    cameras = [Camera(K, np.zeros(5), SIZE, tvec=[-0.05 * k, 0, 0], name=f"camera {k}") for k in range(count)]
    group = CameraGroup(cameras)
    pixels = np.stack([camera.project(points)[:, 0] for camera in cameras])
    file = os.path.join(os.environ["FOLDER"], "cameras.toml")
    group.dump(file)
    again = CameraGroup.load(file)
    errors = np.linalg.norm(again.reprojection_error(points, pixels), axis=2).mean(axis=1)
    seen[count] = again.get_names() == group.get_names(), errors
    print(f"  {count} cameras, in the order {', '.join(name.split()[1] for name in again.get_names())}")
    print(f"    reprojection error of exact points, expected 0 px: up to {errors.max():.1f} px")
same = seen[10][0] and not seen[12][0] and seen[10][1].max() < 1e-6 and (seen[12][1][2:] > 10).all()
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
