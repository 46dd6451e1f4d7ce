#!/usr/bin/env bash
# calibsense 0.1.0a1: the covariance of its hand-eye calibration knows nothing of the robot's errors.
#
# solve_hand_eye gives X with a covariance, by default from resampled calibrations ("monte_carlo": the camera's intrinsics and poses
# are drawn again from their covariance, as their errors are alike in all views). Expected: deviations that grow when the robot
# is worse, since its errors are in the residuals. Seen: the resamples keep the robot's poses as they are, and their spread takes
# the place of the covariance from the residuals, so that an arm that is 0.2 deg and 1 mm off at every pose has the same stated
# deviations as an exact one (0.2 mm here), while X moves by 2 mm from one draw of the robot's errors to the next, without any
# error of the camera. The covariance from the residuals (residual_covariance) grows; it lacks what the views share. The two have
# to be added to state what X is worth.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q "numpy==2.4.6" "scipy==1.17.1" "opencv-contrib-python==4.14.0.94" "calibsense==0.1.0a1" || exit 2
status=0
"$folder/venv/bin/python" - <<'PY' || status=1
import importlib.metadata
import sys

import calibsense
import numpy as np
from calibsense import synthetic
from calibsense.core.session import CalibrationSession, RobotPoses
from calibsense.handeye import solve_hand_eye
from scipy.spatial.transform import RigidTransform, Rotation

print("calibsense", importlib.metadata.version("calibsense"))
board = calibsense.Checkerboard(9, 6, 25.0)
camera = calibsense.PinholeBrownConrady(900.0, 900.0, 640.0, 360.0, np.zeros(5))
poses = synthetic.diverse_poses(board, 10, seed=1)
capture = synthetic.synthesise(camera, board, poses, noise_px=0.02, seed=1)
fit = calibsense.instrument(CalibrationSession(capture.observations))
X = RigidTransform.from_components([40.0, -20.0, 90.0], Rotation.from_rotvec([0.1, -0.2, 0.5]))
W = RigidTransform.from_components([500.0, 100.0, 30.0], Rotation.from_rotvec([0.2, 0.1, -0.4]))
# the robot's poses that go with the camera's poses of the fit: without noise of the robot nothing is left over
exact = W * (X * RigidTransform.from_matrix(np.array([pose.matrix for pose in fit.poses]))).inv()
rng = np.random.default_rng(0)
n = len(capture.poses)


def solved(deg, mm, **options):
    turn = Rotation.from_rotvec(np.radians(deg) * rng.normal(size=(n, 3)))
    robot = (exact * RigidTransform.from_components(mm * rng.normal(size=(n, 3)), turn)).as_matrix()
    session = CalibrationSession(
        capture.observations, robot=RobotPoses.from_matrices(robot, capture.observations.view_ids)
    )
    return solve_hand_eye(fit, session, **options)


def deviation(covariance):
    return float(np.sqrt(np.diag(covariance)[3:6].sum()))


stated = {}
for deg, mm in ((0.0, 0.0), (0.2, 1.0)):
    found = solved(deg, mm, n_samples=40)
    stated[deg] = deviation(found.covariance)
    print(
        f"robot {deg} deg, {mm} mm: stated by default {stated[deg]:.2f} mm, by the residuals "
        f"{deviation(found.residual_covariance):.2f} mm"
    )
moves = np.array([solved(0.2, 1.0, monte_carlo=False).camera.translation - X.translation for _ in range(10)])
spread = float(np.sqrt((moves**2).sum(axis=1).mean()))
print(f"with the robot 0.2 deg and 1 mm off, and the camera as it is, X moves by {spread:.2f} mm (ten draws)")
sys.exit(0 if abs(stated[0.2] / stated[0.0] - 1.0) < 0.1 and spread > 2.0 * stated[0.2] else 1)
PY
[ "$status" -eq 0 ] && echo "as described" || echo "the behaviour has changed"
exit "$status"
