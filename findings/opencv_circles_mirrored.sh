#!/usr/bin/env bash
# OpenCV 5.0: the circles of a symmetric grid are listed as a mirror image when the camera has turned by 60 to 120 deg.
#
# `findCirclesGrid` gives the centres of a grid of 7 columns and 5 rows. Expected: row by row as on the board, perhaps from the
# other end (half a turn), as nothing on the grid says where it begins. Seen: with the default flag the rows run the other way
# once the picture is turned by 60 to 120 or 240 to 300 deg: a mirror image, which no turn of the board gives. `solvePnP` does
# not complain, and the rms of the residuals is the same 0.06 px: the pose is that of a board seen from behind, half a turn about
# an axis in the board away. With `CALIB_CB_CLUSTERING` the list is never mirrored, and half a turn from that of the default. A
# hand-eye calibration turns the camera about its axis on purpose: some of its poses contradict the others. The robot or the
# other pictures have to settle which of four readings is meant, or an asymmetric grid is used, which begins at one circle.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "scipy==1.15.3" "opencv-python-headless==5.0.0.93" || exit 2
"$folder/env/bin/python" - <<'PY'
import sys

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

WIDTH, HEIGHT, FOCAL, COLUMNS, ROWS, PITCH, RADIUS = 1280, 960, 1000.0, 7, 5, 0.03, 0.009
K = np.array([[FOCAL, 0, 639.5], [0, FOCAL, 479.5], [0, 0, 1]])
board = np.array([(PITCH * (column - 3), PITCH * (row - 2), 0.0) for row in range(ROWS) for column in range(COLUMNS)])
around = np.linspace(0, 2 * np.pi, 72, endpoint=False)
disc = RADIUS * np.column_stack([np.cos(around), np.sin(around), 0 * around])
tilt, place = Rotation.from_euler("xyz", [20, 10, 0], degrees=True), np.array([0, 0, 0.5])


def pixels(points, rotation):
    seen = (rotation.apply(points) + place) @ K.T
    return seen[:, :2] / seen[:, 2:]


print(f"OpenCV {cv2.__version__}: {COLUMNS} x {ROWS} circles, the camera turned about its axis")
flags = {"default": cv2.CALIB_CB_SYMMETRIC_GRID, "clustering": cv2.CALIB_CB_SYMMETRIC_GRID | cv2.CALIB_CB_CLUSTERING}
mirrored, turned, worst = {}, {}, 0.0
for roll in range(0, 360, 30):
    truth = tilt * Rotation.from_euler("z", roll, degrees=True)
    picture = np.full((HEIGHT, WIDTH), 255, np.uint8)
    for centre in board:
        ring = np.round(256 * pixels(centre + disc, truth)).astype(np.int32)
        cv2.fillPoly(picture, [ring.reshape(-1, 1, 2)], 0, lineType=cv2.LINE_AA, shift=8)
    text = f"  {roll:3} deg:"
    for name, flag in flags.items():
        found, centres = cv2.findCirclesGrid(picture, (COLUMNS, ROWS), flags=flag)
        centres = np.asarray(centres, float).reshape(-1, 2)
        _, vector, shift = cv2.solvePnP(board, centres, K, None)
        again = cv2.projectPoints(board, vector, shift, K, None)[0].reshape(-1, 2)
        rms = np.sqrt(((again - centres) ** 2).sum(axis=1).mean())
        facing = (Rotation.from_rotvec(vector.ravel()).as_matrix() @ [0, 0, 1])[2] > 0
        mirrored[name, roll] = not facing
        turned[name, roll] = np.degrees((truth.inv() * Rotation.from_rotvec(vector.ravel())).magnitude())
        worst = max(worst, rms) if found else np.inf
        text += f" {name}{' mirrored,' if not facing else ''} {turned[name, roll]:.0f} deg off, rms {rms:.3f} px;"
    print(text)
same = worst < 0.2 and not any(mirrored["clustering", roll] for roll in range(0, 360, 30))
same &= all(mirrored["default", roll] == (45 < roll % 180 < 135) for roll in range(0, 360, 30))
same &= all(min(abs(turn), abs(turn - 180)) < 1 for turn in turned.values())
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
