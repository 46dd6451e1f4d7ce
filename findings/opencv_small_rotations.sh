#!/usr/bin/env bash
# OpenCV 4.14 and 5.0: rotations below 0.00001 rad have the rotation vector zero.
#
# `cv2.Rodrigues` turns a matrix into a rotation vector. Expected: to rounding, for all angles. Seen: a matrix of less than 1e-5 rad
# (0.6 mdeg, 2 arc seconds) gives exactly (0, 0, 0); from 1e-5 rad on, and close to half a turn, the vector is right. Residuals of a
# calibration taken as the vector of `A X inv(X B)` are zero where they are small, a numerical derivative with a step of 1e-6 to
# 1e-8 is zero near the solution, so that a solver stops or a covariance has no information on the rotation, and the noise of a
# laser tracker of 5 urad looks like none. SciPy's `Rotation.as_rotvec` has all of them.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
status=0
for opencv in 4.14.0.94 5.0.0.93; do
    python3 -m venv "$folder/$opencv"
    "$folder/$opencv/bin/pip" install -q "numpy==2.2.6" "scipy==1.15.3" "opencv-python-headless==$opencv" || exit 2
    "$folder/$opencv/bin/python" - <<'PY' || status=1
import sys

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

AXIS = np.array([0.6, 0.0, 0.8])
lost = {}
for angle in (1e-3, 2e-5, 9e-6, 5e-6, 1e-6, 1e-8, np.pi - 2e-5):
    matrix = Rotation.from_rotvec(angle * AXIS).as_matrix()
    vectors = cv2.Rodrigues(matrix)[0].ravel(), Rotation.from_matrix(matrix).as_rotvec()
    lost[angle] = [1 - np.linalg.norm(vector) / angle for vector in vectors]
    print(f"OpenCV {cv2.__version__}: {angle:.8g} rad, lost {100 * lost[angle][0]:.4f} % (SciPy {100 * lost[angle][1]:.4f} %)")
step = 1e-6
turned = [Rotation.from_rotvec(sign * step * AXIS).as_matrix() for sign in (1, -1)]
slope = (cv2.Rodrigues(turned[0])[0] - cv2.Rodrigues(turned[1])[0]).ravel() / (2 * step)
print(f"  derivative about the axis by differences of {step} rad: {slope}, should be {AXIS}")
same = all(abs(of_scipy) < 1e-6 for _, of_scipy in lost.values()) and not slope.any()
same &= all(of_cv == 1 if angle < 1e-5 else abs(of_cv) < 1e-5 for angle, (of_cv, _) in lost.items())
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
done
exit "$status"
