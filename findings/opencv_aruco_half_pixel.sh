#!/usr/bin/env bash
# OpenCV 4.14 and 5.0: one of the four refinements of aruco counts pixels from another origin than the others.
#
# DetectorParameters.cornerRefinementMethod chooses how the corners of a marker are refined. Expected: four estimates of the same
# points, with the centre of the first pixel at 0, as everywhere in OpenCV (a picture's corner is at -0.5). Seen, in pictures
# rendered exactly: the mean error of NONE, SUBPIX and CONTOUR over all corners is some hundredths of a pixel, that of
# CORNER_REFINE_APRILTAG is 0.46 px to the right and as much down, at any size of marker, as in AprilTag, where the first pixel's
# corner is at 0. Take those from its corners, and it is the best of the four by far; as they come they are worse than those of
# SUBPIX. With a camera matrix from OpenCV's chessboards every pose is off by half a pixel to the side, 0.3 mm at 0.5 m with a
# focal length of 800 px, and who calibrates with one refinement and measures with another has it in X; a camera calibrated with
# such corners alone hides it in the principal point. That the AprilTag library counts so is known (AprilRobotics/apriltag 121).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
status=0
for opencv in 4.14.0.94 5.0.0.93; do
    python3 -m venv "$folder/$opencv"
    "$folder/$opencv/bin/pip" install -q "numpy==2.4.6" "opencv-python-headless==$opencv" || exit 2
    "$folder/$opencv/bin/python" - <<'PY' || status=1
import sys

import cv2
import numpy as np

cv2.setNumThreads(1)
SIZE, SAMPLES, MODULES, PICTURES = 200, 8, 7, 16
METHODS = ("NONE", "SUBPIX", "CONTOUR", "APRILTAG")
rng = np.random.default_rng(0)
dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
u, v = np.meshgrid(np.arange(SIZE), np.arange(SIZE))


def picture(side):
    """A marker on white and its corners, the centre of the first pixel at 0: each pixel is the mean of 64 points in it."""
    modules = cv2.aruco.generateImageMarker(dictionary, int(rng.integers(100)), MODULES, borderBits=1)
    modules = np.pad(modules, 1, constant_values=255)
    angle, scale = rng.uniform(-0.5, 0.5), side / MODULES
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ np.diag([1, rng.uniform(0.8, 1)])
    view, centre = np.eye(3), np.eye(3)
    view[:2, :2], view[2, :2] = scale * turn, rng.uniform(-0.01, 0.01, 2)
    centre[:2, 2] = -MODULES / 2
    shift = np.array([[1, 0, rng.uniform(95, 105)], [0, 1, rng.uniform(95, 105)], [0, 0, 1]])
    onto = shift @ view @ centre
    back, light = np.linalg.inv(onto), np.zeros((SIZE, SIZE))
    for k in range(SAMPLES**2):
        x, y = u + (k % SAMPLES + 0.5) / SAMPLES - 0.5, v + (k // SAMPLES + 0.5) / SAMPLES - 0.5
        p = [row[0] * x + row[1] * y + row[2] for row in back]
        column, line = (np.clip(np.floor(q / p[2]).astype(int) + 1, 0, MODULES + 1) for q in p[:2])
        light += np.where(modules[line, column] > 0, 220.0, 30.0)
    grey = cv2.GaussianBlur(light / SAMPLES**2, (0, 0), 0.8) + 2.0 * rng.normal(size=light.shape)
    corners = np.array([[0, 0, 1], [MODULES, 0, 1], [MODULES, MODULES, 1], [0, MODULES, 1.0]]) @ onto.T
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8), corners[:, :2] / corners[:, 2:]


print(f"cv2 {cv2.__version__}, numpy {np.__version__}: {PICTURES} pictures of a marker each")
described = True
for side in (50, 80, 100):
    errors = {method: [] for method in METHODS}
    for _ in range(PICTURES):
        grey, true = picture(side)
        for method in METHODS:
            options = cv2.aruco.DetectorParameters()
            options.cornerRefinementMethod = getattr(cv2.aruco, f"CORNER_REFINE_{method}")
            found = cv2.aruco.ArucoDetector(dictionary, options).detectMarkers(grey)[0]
            if len(found) == 1:
                errors[method].append(min((np.roll(found[0][0], k, 0) - true for k in range(4)), key=lambda e: np.abs(e).sum()))
    for method, parts in errors.items():
        e = np.array(parts)
        mean = e.mean((0, 1))
        print(f"  sides of about {side} px, {method:8}: {len(e)} found, mean error {mean[0]:+.2f}, {mean[1]:+.2f} px, RMS"
              f" {np.sqrt((e**2).mean()):.2f} px, without its mean {np.sqrt(((e - mean) ** 2).mean()):.2f} px")
        described &= bool((np.abs(mean - 0.46) < 0.1).all() if method == "APRILTAG" else (np.abs(mean) < 0.15).all())
sys.exit(0 if described else 1)
PY
done
[ "$status" -eq 0 ] && echo "as described" || echo "the behaviour has changed"
exit "$status"
