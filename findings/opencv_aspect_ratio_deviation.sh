#!/usr/bin/env bash
# OpenCV 4.14 and 5.0: with a fixed aspect ratio the standard deviation of fx is reported as zero.
#
# `calibrateCameraExtended` with CALIB_FIX_ASPECT_RATIO estimates one focal length: fx is the ratio times fy. Expected: both have a
# standard deviation, of the same ratio; "if a parameter is not estimated, its deviation is zero" holds for the others that are
# fixed. Seen: fy has the deviation of the scatter (2.4 px here) and fx has 0.0, though it scatters as much. Who takes zero for
# known exactly keeps fx and frees fy, and a program that reads `stdDeviationsIntrinsics` believes the depth of every pose to be
# better known than it is. Where fx is zero and fy is not, the deviation of fx is that of fy times fx / fy.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
status=0
for opencv in 4.14.0.94 5.0.0.93; do
    python3 -m venv "$folder/$opencv"
    "$folder/$opencv/bin/pip" install -q "numpy==2.2.6" "opencv-python-headless==$opencv" || exit 2
    "$folder/$opencv/bin/python" - <<'PY' || status=1
import sys

import cv2
import numpy as np

RUNS, VIEWS, NOISE_PX, SIZE = 40, 12, 0.2, (1280, 720)
board = np.zeros((54, 3), np.float32)
board[:, :2] = 0.03 * np.mgrid[0:9, 0:6].T.reshape(-1, 2)
K = np.array([[900.0, 0, 640], [0, 900, 360], [0, 0, 1]])
rng, views = np.random.default_rng(1), []
while len(views) < VIEWS:
    shift = np.array([rng.uniform(-0.25, 0.1), rng.uniform(-0.15, 0.05), rng.uniform(0.5, 0.8)])
    pixels = cv2.projectPoints(board, 0.35 * rng.normal(size=3), shift, K, None)[0].reshape(-1, 2)
    if pixels.min() > 5 and pixels[:, 0].max() < SIZE[0] - 5 and pixels[:, 1].max() < SIZE[1] - 5:
        views.append(pixels)
seen = {}
for name, flag in (("both free", 0), ("ratio fixed", cv2.CALIB_FIX_ASPECT_RATIO)):
    found, stated = [], []
    for _ in range(RUNS):
        noisy = [(p + NOISE_PX * rng.normal(size=p.shape)).astype(np.float32).reshape(-1, 1, 2) for p in views]
        flags = flag | cv2.CALIB_USE_INTRINSIC_GUESS
        result = cv2.calibrateCameraExtended([board] * VIEWS, noisy, SIZE, K.copy(), np.zeros(5), flags=flags)
        found.append([result[1][0, 0], result[1][1, 1]])
        stated.append(np.ravel(result[5])[:2])
    seen[name] = np.std(found, axis=0), np.mean(stated, axis=0)
    scatter, said = (np.round(values, 2) for values in seen[name])
    print(f"OpenCV {cv2.__version__}, {name}: fx and fy scatter by {scatter} px, stated {said} px")
free, fixed = seen["both free"], seen["ratio fixed"]
same = np.allclose(free[1] / free[0], 1, atol=0.4) and abs(fixed[1][1] / fixed[0][1] - 1) < 0.4
same &= abs(fixed[0][0] - fixed[0][1]) < 1e-6 and fixed[0][0] > 1 and fixed[1][0] == 0
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
done
exit "$status"
