#!/usr/bin/env bash
# locus-tag 0.10.0 with boards of opencv 5.0: a ChArUco board whose markers are in the other squares gives a wrong pose.
#
# The documentation of locus says that it follows "modern OpenCV (cv2.aruco) conventions"; its ChArUco boards have markers
# where row + column is even, OpenCV's (from 4.6 on) where it is odd. Expected: a board of OpenCV gives no pose, as OpenCV
# itself gives no corners when the pattern is the other one (setLegacyPattern), or a pose that is right but for a shift by one
# square and a covariance to match. Seen: every tag is decoded; the markers of every second row are taken for one square too
# far to the left, the others for one too far to the right; the larger camp wins, and the pose is a whole square (40 mm) off
# with a stated deviation of 0.04 mm. With an even number of rows setLegacyPattern(True) draws the board of locus; with an odd number no
# board of OpenCV is one of locus. Half a pixel is added to the principal point, which locus counts from the picture's corner.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.4.6" "opencv-python-headless==5.0.0.93" "locus-tag==0.10.0" || exit 2
"$folder/env/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import cv2
import locus
import numpy as np

np.set_printoptions(suppress=True)
SQUARE_M, MARKER_M, TEXTURE_PX, WIDTH, HEIGHT, FOCAL_PX, SUPER = 0.04, 0.03, 80, 1280, 960, 1100.0, 3
K = np.array([[FOCAL_PX, 0, (WIDTH - 1) / 2], [0, FOCAL_PX, (HEIGHT - 1) / 2], [0, 0, 1]])
lens = locus.CameraIntrinsics(fx=FOCAL_PX, fy=FOCAL_PX, cx=K[0, 2] + 0.5, cy=K[1, 2] + 0.5)
detector = locus.Detector(families=[locus.TagFamily.ArUco4x4_50])
R, _ = cv2.Rodrigues(np.array([0.4, -0.5, 0.2]))
print(f"locus-tag {version('locus-tag')}, opencv {cv2.__version__}; board: {1e3 * SQUARE_M:.0f} mm squares at 0.55 m")


def picture(board, columns, rows):
    """Draw the board as the camera sees it: smoothed by 0.7 px, with a noise of 2 levels."""
    texture = board.generateImage((columns * TEXTURE_PX, rows * TEXTURE_PX), marginSize=0)
    scale = SQUARE_M / TEXTURE_PX
    to_board = np.array([[scale, 0, scale / 2], [0, scale, scale / 2], [0, 0, 1]])
    finer = np.array([[SUPER, 0, (SUPER - 1) / 2], [0, SUPER, (SUPER - 1) / 2], [0, 0, 1]])
    H = finer @ K @ np.column_stack([R[:, 0], R[:, 1], corner]) @ to_board
    large = cv2.warpPerspective(texture, H, (WIDTH * SUPER, HEIGHT * SUPER), borderValue=255)
    large = cv2.GaussianBlur(large.astype(np.float32), (0, 0), 0.7 * SUPER)
    small = 0.7 * cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA) + 30
    return np.clip(small + np.random.default_rng(0).normal(0, 2, small.shape), 0, 255).round().astype(np.uint8)


seen = []
for columns, rows, legacy in ((8, 6, True), (8, 6, False), (9, 7, False)):
    half = SQUARE_M / 2 * np.array([columns, rows, 0])
    corner = np.array([0, 0, 0.55]) - R @ half
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((columns, rows), SQUARE_M, MARKER_M, markers)
    board.setLegacyPattern(legacy)
    image = picture(board, columns, rows)
    found = locus.CharucoRefiner(locus.CharucoBoard(rows, columns, SQUARE_M, MARKER_M, locus.TagFamily.ArUco4x4_50)).estimate(
        detector, image, lens
    )
    other = cv2.aruco.CharucoBoard((columns, rows), SQUARE_M, MARKER_M, markers)
    other.setLegacyPattern(not legacy)
    refused = cv2.aruco.CharucoDetector(other).detectBoard(image)[1]
    # locus: origin in the middle of the board, quaternion w x y z
    error = None if found.board_pose is None else R.T @ (found.board_pose[:3] - np.array([0, 0, 0.55])) * 1e3
    stated = None if found.board_cov is None else 1e3 * np.sqrt(np.diag(found.board_cov)[3:])
    seen.append((error, stated, len(found.ids), len(found.saddle_ids)))
    print(f"{columns} x {rows}, {'legacy' if legacy else 'usual '} pattern of OpenCV: {seen[-1][2]} tags, {seen[-1][3]} corners;")
    print(f"    position off by {error.round(2)} mm, stated deviation {stated.round(3)} mm")
    if rows % 2 == 0:
        print(f"    OpenCV with the other pattern: {'no' if refused is None else len(refused)} corners")
right, wrong, odd = (np.linalg.norm(error) for error, *_ in seen)
same = right < 0.6 and wrong > 20 and odd > 20 and max(seen[1][1].max(), seen[2][1].max()) < 0.5
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
