#!/usr/bin/env bash
# depthai 3.12.0: the intrinsics for a picture of another aspect belong to no crop of the sensor.
#
# `CalibrationHandler.getCameraIntrinsics(socket, width, height)` keeps the aspect by default, which "will scale on width or height
# depending on which provides the max resolution and crops the remaining part of the other side". Expected, for a camera
# calibrated at 1280 x 720 with its principal point in the middle: a picture of 640 x 480 is scaled by 480 / 720 and cut on both
# sides: f = 606.7, principal point in the middle (320, 240). Seen: f = 455, as if the picture were scaled by 640 / 1280 and padded
# with 60 black rows above and below; 300 x 300 likewise (f = 213 for 379). For 640 x 400 and 1280 x 800 f is that of the cut, but
# the principal point is not moved by it: 355.6 in a picture 640 wide, 36 px off. A sensor of 4:3 is cut as described. A pose from a
# board seen with such a matrix is a quarter too near, or turned by 4 deg; ask for the size of the calibration, or scale by hand.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "depthai==3.12.0" || exit 2
"$folder/env/bin/python" - 2>/dev/null <<'PY'
import sys

import depthai
import numpy as np

SOCKET = depthai.CameraBoardSocket.CAM_A
print(f"depthai {depthai.__version__}: f, cx, cy as stated, and of a picture that is scaled and cut on both sides")
same = True
for (wide, high, focal), sizes in {
    (1280, 720, 910.0): {(640, 360): "cut", (640, 480): "padded", (300, 300): "padded", (640, 400): "left", (1280, 800): "left"},
    (1280, 800, 800.0): {(640, 400): "cut", (1280, 720): "cut", (640, 480): "padded"},
    (4056, 3040, 3000.0): {(2028, 1520): "cut", (1920, 1080): "cut", (1280, 720): "cut"},
}.items():
    handler = depthai.CalibrationHandler()
    handler.setCameraIntrinsics(SOCKET, [[focal, 0.0, wide / 2], [0.0, focal, high / 2], [0.0, 0.0, 1.0]], wide, high)
    for (width, height), kind in sizes.items():
        matrix = np.array(handler.getCameraIntrinsics(SOCKET, width, height))
        stated = matrix[0, 0], matrix[0, 2], matrix[1, 2]
        fill, fit = max(width / wide, height / high), min(width / wide, height / high)
        cut = focal * fill, width / 2, height / 2
        described = {"cut": cut, "padded": (focal * fit, *cut[1:]), "left": (focal * fill, fill * wide / 2, height / 2)}[kind]
        same &= np.allclose(stated, described, atol=0.1)
        print(f"  {wide} x {high} as {width} x {height}: {np.round(stated, 1)}, expected {np.round(cut, 1)}")
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
