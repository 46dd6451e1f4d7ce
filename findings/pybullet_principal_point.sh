#!/usr/bin/env bash
# pybullet 3.2.7: the principal point of its pictures is neither the middle of the picture nor the middle of the pixels.
#
# `computeProjectionMatrixFOV` has the optical axis in the middle of the frustum. Expected, for a picture of W x H with pixels
# counted by their centres: the principal point ((W - 1) / 2, (H - 1) / 2), or (W / 2, H / 2) as the guides that turn the matrix
# into K have it. Seen with the software renderer, the one that works without a display: (W / 2, H / 2 - 1), in the picture, the
# depth and the mask alike: half a pixel to the right and half a pixel up of the middle. With K of the middle, poses from such
# pictures are turned by 0.7 px / f, 3.4 mrad at f = 208 (0.8 mm to the side at 0.25 m), in a simulation meant to be exact.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "pybullet==3.2.7" || exit 2
"$folder/env/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import pybullet as bullet

print(f"pybullet {version('pybullet')}, software renderer: middle of a box on the optical axis")
bullet.connect(bullet.DIRECT)
shape = bullet.createVisualShape(bullet.GEOM_BOX, halfExtents=[0.1, 0.08, 0.001], rgbaColor=[0, 0, 0, 1])
box, same = bullet.createMultiBody(0, -1, shape, [0, 0, 1]), True
view = bullet.computeViewMatrix([0, 0, 0], [0, 0, 1], [0, -1, 0])
for width, height in ((320, 240), (640, 480), (321, 241), (640, 360)):
    for fov in (40.0, 60.0):
        projection = bullet.computeProjectionMatrixFOV(fov, width / height, 0.05, 10)
        flags = bullet.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX
        answer = bullet.getCameraImage(width, height, view, projection, renderer=bullet.ER_TINY_RENDERER, flags=flags)
        colour = np.array(answer[2]).reshape(height, width, 4)[..., :3].sum(axis=2) < 300
        near = np.array(answer[3]).reshape(height, width) < 0.999
        mask = np.array(answer[4]).reshape(height, width) == box
        middles = []
        for seen in (colour, near, mask):
            across, down = np.flatnonzero(seen.any(axis=0)), np.flatnonzero(seen.any(axis=1))
            middles.append((float(across[0] + across[-1]) / 2, float(down[0] + down[-1]) / 2))
        off = np.array(middles) - [width / 2, height / 2 - 1]
        print(f"  {width} x {height}, fov {fov:g}: picture, depth, mask {middles}, middle {(width - 1) / 2}, {(height - 1) / 2}")
        same &= np.abs(off).max() <= 0.5
        if (width, height) == (320, 240):
            same &= not off.any()
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
