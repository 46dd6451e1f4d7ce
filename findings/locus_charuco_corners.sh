#!/usr/bin/env bash
# locus-tag 0.10.0: the "refined" corners of a ChArUco board are not looked for in the picture.
#
# CharucoRefiner "extracts and refines saddle points", and its result calls them "refined image coordinates". Expected: the
# corners of the squares as the picture shows them, each with an error of its own. Seen: each is the image of the corner under
# the homography of one neighbouring marker, extrapolated (to 0.001 px); the squares themselves are only asked whether there
# is any contrast. Shift the squares by 1.8 px against the markers, and OpenCV's corners follow while those of locus stay. So
# up to four corners share the errors of one marker, and 35 corners of 24 markers are not 35 independent measurements, as the
# covariance of the board's pose takes them for. The source says it (charuco.rs: the refinement "is empirically inert"), the
# documentation does not.
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

SQUARE_M, MARKER_M, TEXTURE_PX, WIDTH, HEIGHT, FOCAL_PX, SUPER = 0.04, 0.03, 80, 1280, 960, 1100.0, 3
COLUMNS, ROWS, SHIFT_TEXTURE_PX, PICTURES = 8, 6, 2, 3
K = np.array([[FOCAL_PX, 0, (WIDTH - 1) / 2], [0, FOCAL_PX, (HEIGHT - 1) / 2], [0, 0, 1]])
R, _ = cv2.Rodrigues(np.array([0.4, -0.5, 0.2]))
board = cv2.aruco.CharucoBoard((COLUMNS, ROWS), SQUARE_M, MARKER_M, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
board.setLegacyPattern(True)  # the layout of locus: markers where row + column is even
usual = board.generateImage((COLUMNS * TEXTURE_PX, ROWS * TEXTURE_PX), marginSize=0)
shifted = np.roll(usual, SHIFT_TEXTURE_PX, axis=1)
objects = [np.asarray(points) for points in board.getObjPoints()]
for points in objects:  # the markers, with their white margin, stay where they were
    left, top = np.round(points[0, :2] / SQUARE_M * TEXTURE_PX).astype(int) - 4
    size = round(MARKER_M / SQUARE_M * TEXTURE_PX) + 8
    shifted[top : top + size, left : left + size] = usual[top : top + size, left : left + size]


def picture(texture, corner, rng):
    """Draw the board as the camera sees it: smoothed by 0.7 px, with a noise of 3 levels."""
    scale = SQUARE_M / TEXTURE_PX
    to_board = np.array([[scale, 0, scale / 2], [0, scale, scale / 2], [0, 0, 1]])
    finer = np.array([[SUPER, 0, (SUPER - 1) / 2], [0, SUPER, (SUPER - 1) / 2], [0, 0, 1]])
    H = finer @ K @ np.column_stack([R[:, 0], R[:, 1], corner]) @ to_board
    large = cv2.warpPerspective(texture, H, (WIDTH * SUPER, HEIGHT * SUPER), borderValue=255)
    large = cv2.GaussianBlur(large.astype(np.float32), (0, 0), 0.7 * SUPER)
    small = 0.7 * cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA) + 30
    return np.clip(small + rng.normal(0, 3, small.shape), 0, 255).round().astype(np.uint8)


detector = locus.Detector(families=[locus.TagFamily.ArUco4x4_50])
lens = locus.CameraIntrinsics(fx=FOCAL_PX, fy=FOCAL_PX, cx=K[0, 2] + 0.5, cy=K[1, 2] + 0.5)
refiner = locus.CharucoRefiner(locus.CharucoBoard(ROWS, COLUMNS, SQUARE_M, MARKER_M, locus.TagFamily.ArUco4x4_50))
errors, far = {"locus": [], "opencv": []}, 0.0
moved = {}
for number in range(PICTURES):
    corner = np.array([-0.15, -0.1, 0.55]) + np.random.default_rng(number).uniform(-1e-3, 1e-3, 3)
    truth = (np.asarray(board.getChessboardCorners()) @ R.T + corner) @ K.T
    truth = truth[:, :2] / truth[:, 2:]
    for texture in (usual, shifted):
        image = picture(texture, corner, np.random.default_rng(100 + number))
        found = refiner.estimate(detector, image, lens)
        corners, ids, *_ = cv2.aruco.CharucoDetector(board).detectBoard(image)
        both = {
            "locus": found.saddle_pts - 0.5 - truth[found.saddle_ids],
            "opencv": corners.reshape(-1, 2) - truth[ids.ravel()],
        }
        if texture is shifted:
            moved = {name: moved.get(name, 0) + np.linalg.norm(both[name].mean(0)) / PICTURES for name in both}
            continue
        for name in both:
            errors[name].append(both[name])
        extrapolated = {}
        for tag, image_points in zip(found.ids, found.corners):
            H, _ = cv2.findHomography(objects[tag][:, :2], image_points.astype(np.float64))
            extrapolated[int(tag)] = cv2.perspectiveTransform(np.asarray(board.getChessboardCorners())[None, :, :2], H)[0]
        for saddle, point in zip(found.saddle_ids, found.saddle_pts):
            far = max(far, min(np.linalg.norm(of[saddle] - point) for of in extrapolated.values()))
rms = {name: float(np.sqrt(np.mean(np.concatenate(values) ** 2))) for name, values in errors.items()}
print(f"locus-tag {version('locus-tag')}, opencv {cv2.__version__}: {PICTURES} pictures of a board of {COLUMNS} x {ROWS}")
print(f"  corner of locus to the extrapolation of a marker: at most {far:.5f} px")
print(f"  rms error of a coordinate: locus {rms['locus']:.2f} px, opencv {rms['opencv']:.2f} px")
print(f"  squares shifted against the markers: locus moves by {moved['locus']:.2f} px, opencv by {moved['opencv']:.2f} px")
same = far < 1e-3 and max(rms.values()) < 0.1 and moved["locus"] < 0.2 and moved["opencv"] > 1
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
