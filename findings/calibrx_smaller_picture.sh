#!/usr/bin/env bash
# calibrx 0.1.0: a picture of another size than the calibration is undistorted rightly for a fisheye, wrongly for a pinhole.
#
# A calibration export has the size of its pictures (image_size). Expected: for a picture of half the size the camera matrix
# is scaled, or the call is refused, whichever the model. Seen: "fisheye" scales it (and refuses another aspect), "pinhole"
# and "pinhole_wide" use the camera matrix of the large picture: the centre of distortion is in the lower right corner of the
# small one, pixels are taken from up to 400 px beside where they are, and the camera matrix that is given back, to be used for
# poses, has twice the focal length. Nothing is said: image_size is read and not used.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.4.6" "opencv-python-headless==5.0.0.93" "pyyaml==6.0.3" || exit 2
"$folder/env/bin/pip" install -q --no-deps "calibrx==0.1.0" || exit 2
"$folder/env/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import cv2
import numpy as np
from calibrx import Calibration, undistort

SIZE = (1280, 960)
K = [[900.0, 0.0, 639.5], [0.0, 900.0, 479.5], [0.0, 0.0, 1.0]]
LENSES = {"pinhole": [-0.25, 0.08, 0.0, 0.0, 0.0], "fisheye": [0.02, -0.01, 0.0, 0.0]}


def look(model, divisor):
    """Return the new focal length and the largest error (px) of where the undistorted pixels were taken from."""
    calibration = Calibration.from_dict(
        {"camera_model": model, "camera_matrix": K, "distortion_coefficients": LENSES[model], "image_size": list(SIZE)}
    )
    width, height = SIZE[0] // divisor, SIZE[1] // divisor
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    result = undistort(np.dstack([columns, rows, columns]), calibration, balance=0.0)
    scaled = np.array(K)
    scaled[:2, :2] /= divisor
    scaled[:2, 2] = (scaled[:2, 2] + 0.5) / divisor - 0.5
    pixels = np.stack([columns, rows, np.ones_like(rows)], -1).reshape(-1, 3).astype(np.float64)
    rays = pixels @ np.linalg.inv(result.camera_matrix).T
    project = cv2.fisheye.projectPoints if model == "fisheye" else cv2.projectPoints
    source, _ = project(rays[:, None], np.zeros(3), np.zeros(3), scaled, np.array(LENSES[model]))
    source = source.reshape(height, width, 2)
    inside = (result.image[..., :2].min(-1) > 1) & (source.min(-1) > 1)
    inside &= (source[..., 0] < width - 2) & (source[..., 1] < height - 2)
    errors = np.linalg.norm(result.image[..., :2] - source, axis=-1)[inside]
    return result.camera_matrix[0, 0], errors.max()


print(f"calibrx {version('calibrx')}, opencv {cv2.__version__}: camera matrix of {SIZE[0]} x {SIZE[1]} pixels, f {K[0][0]:.0f} px")
seen = {}
for model in LENSES:
    for divisor in (1, 2):
        seen[model, divisor] = look(model, divisor)
        focal, error = seen[model, divisor]
        print(f"  {model}, picture of 1/{divisor}: new focal length {focal:.1f} px; pixels taken {error:.2f} px from where they are")
same = all(seen[key][1] < 1 for key in (("pinhole", 1), ("fisheye", 1), ("fisheye", 2)))
same &= abs(seen["fisheye", 2][0] / seen["fisheye", 1][0] - 0.5) < 0.01
same &= seen["pinhole", 2][1] > 10 and seen["pinhole", 2][0] > 0.8 * seen["pinhole", 1][0]
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
