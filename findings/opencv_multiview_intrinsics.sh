#!/usr/bin/env bash
# OpenCV 5.0: calibrateMultiview keeps each camera's own intrinsics, although it is said to minimise the error of all cameras.
#
# Documentation: "Estimates intrinsics and extrinsics ... Similarly to calibrateCamera, the function minimizes the total
# re-projection error for all the points in all the available views from all cameras." Expected of one board that two cameras
# see in 20 poses: a relative pose as good as that of stereoCalibrate with free intrinsics. Seen: the intrinsics are those of
# calibrateCamera for each camera by itself, the adjustment of all cameras holds them, and the relative pose is several times
# worse. With known intrinsics (CALIB_USE_INTRINSIC_GUESS) nothing is lost. Remedy: refine the intrinsics in an adjustment of
# all cameras. By the way, Rs are rotation vectors (3, 1), where the documentation has "NUM_CAMERAS x 3 x 3".
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.4.6" "opencv-python-headless==5.0.0.93" || exit 2
"$folder/env/bin/python" - <<'PY'
import sys

import cv2
import numpy as np

SQUARE_M, SIZE, PICTURES, DRAWS, NOISE_PX = 0.025, (1280, 960), 20, 15, 0.2
K = np.array([[1100.0, 0, 651.5], [0, 1100.0, 488.5], [0, 0, 1]])
LENS = np.array([-0.10, 0.05, 3e-4, -2e-4, 0.0])
board = np.zeros((54, 3), np.float32)
board[:, :2] = SQUARE_M * np.mgrid[:9, :6].T.reshape(-1, 2)
turn, shift = np.array([0.0, 0.42, 0.0]), np.array([-0.28, 0.0, 0.05])  # of the second camera, by the first
R = cv2.Rodrigues(turn)[0]
rng, exact = np.random.default_rng(0), [[], []]
for _ in range(PICTURES):
    B, _ = cv2.Rodrigues(rng.uniform(-0.55, 0.55, 3))
    t = rng.uniform([-0.02, -0.1, 0.55], [0.2, 0.1, 0.8]) - B @ board.mean(axis=0)
    for of, (A, a) in zip(exact, [(np.eye(3), np.zeros(3)), (R, shift)]):
        there = (board @ (A @ B).T + A @ t + a).astype(np.float64)
        of.append(cv2.projectPoints(there, np.zeros(3), np.zeros(3), K, LENS)[0].reshape(-1, 2))
exact = np.array(exact)
objects = [board] * PICTURES


def off(rotation, translation):
    """Return the error of the position of the second camera in the first (mm)."""
    A = cv2.Rodrigues(np.asarray(rotation))[0] if np.size(rotation) == 3 else rotation
    return 1e3 * np.linalg.norm(R.T @ shift - A.T @ np.ravel(translation))


def multiview(seen, K0=None, lens=None, flags=0):
    """Run calibrateMultiview."""
    mask, models = np.ones((2, PICTURES), np.uint8), np.full(2, cv2.CALIB_MODEL_PINHOLE, np.uint8)
    return cv2.calibrateMultiview(
        objects, seen, [SIZE] * 2, mask, models, K0, lens, None, None, flagsForIntrinsics=np.zeros(2, np.int32), flags=flags
    )


errors, moved, shape = [], 0.0, None
for _ in range(DRAWS):
    seen = [list((of + rng.normal(0, NOISE_PX, of.shape)).astype(np.float32)) for of in exact]
    single = [cv2.calibrateCamera(objects, of, SIZE, None, None) for of in seen]
    _, Ks, _, Rs, Ts = multiview(seen)
    shape = np.shape(Rs[1])
    moved = max(moved, *(np.abs(one[1] - own).max() for one, own in zip(single, Ks)))
    _, _, _, Rk, Tk = multiview(seen, [K] * 2, [LENS[None]] * 2, cv2.CALIB_USE_INTRINSIC_GUESS)
    joint = cv2.stereoCalibrate(
        objects, *seen, *(x for one in single for x in one[1:3]), SIZE, flags=cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-9),
    )
    errors.append([off(Rs[1], Ts[1]), off(joint[5], joint[6]), off(Rk[1], Tk[1])])
alone, together, known = np.sqrt(np.mean(np.square(errors), axis=0))
print(f"OpenCV {cv2.__version__}: two cameras, {PICTURES} poses of a 9 x 6 board, {NOISE_PX} px, rms of {DRAWS} draws")
print(f"  position of camera 2 in camera 1, stereoCalibrate with free intrinsics: {together:.2f} mm")
print(f"  calibrateMultiview: {alone:.2f} mm (expected the same); its matrices are those of calibrateCamera to {moved:.1e} px")
print(f"  calibrateMultiview with known intrinsics: {known:.2f} mm")
print(f"  shape of a rotation in Rs: {shape} (expected (3, 3))")
same = moved < 1e-3 and alone > 2 * together and known < together and shape == (3, 1)
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
