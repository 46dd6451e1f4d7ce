#!/usr/bin/env bash
# pycolmap 4.2.1: the covariance of a camera's pose after bundle adjustment has half the rotation.
#
# BACovariance.get_cam_cov_from_world is documented as "Tangent space covariance in the order [rotation, translation]".
# Expected: the rotation is a small rotation vector in rad. Seen: it is half of one, as that is the tangent of the quaternion that
# the solver keeps: deviations of the rotation are half as large as those of the same least squares written out here, variances a
# quarter, cross terms a half; the translation is right. `refine_absolute_pose(..., return_covariance=True)` does the same. As
# weights of a hand-eye calibration such covariances give the rotations four times the weight they have.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "pycolmap==4.2.1" || exit 2
"$folder/env/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import pycolmap

pycolmap.logging.minloglevel = 2
pycolmap.set_random_seed(1)
FOCAL = 1000.0
dataset = pycolmap.SyntheticDatasetOptions(num_rigs=1, num_frames_per_rig=5, num_points3D=60, num_points2D_without_point3D=0)
dataset.camera_model_id, dataset.camera_params = pycolmap.CameraModelId.PINHOLE, [FOCAL, FOCAL, 512.0, 384.0]
scene = pycolmap.synthesize_dataset(dataset)
images = sorted(scene.images)
config = pycolmap.BundleAdjustmentConfig()
for name in images:
    config.add_image(name)
for camera in scene.cameras:
    config.set_constant_cam_intrinsics(camera)
config.fix_gauge(pycolmap.BundleAdjustmentGauge.THREE_POINTS)
adjuster = pycolmap.create_default_ceres_bundle_adjuster(pycolmap.BundleAdjustmentOptions(), config, scene)
adjuster.solve()
stated = pycolmap.estimate_ba_covariance(pycolmap.BACovarianceOptions(), scene, adjuster)


def cross(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


# The same problem by hand: a rotation vector and a shift for each camera, the three fixed points known.
points = [name for name in sorted(scene.points3D) if stated.get_point_cov(name) is not None]
column = {name: 6 * len(images) + 3 * k for k, name in enumerate(points)}
rows = []
for k, name in enumerate(images):
    pose = scene.images[name].cam_from_world()
    for seen in scene.images[name].points2D:
        turned = pose.rotation.matrix() @ scene.points3D[seen.point3D_id].xyz
        x, y, z = turned + pose.translation
        projection = FOCAL / z * np.array([[1, 0, -x / z], [0, 1, -y / z]])
        row = np.zeros((2, 6 * len(images) + 3 * len(points)))
        row[:, 6 * k : 6 * k + 3], row[:, 6 * k + 3 : 6 * k + 6] = -projection @ cross(turned), projection
        if seen.point3D_id in column:
            row[:, column[seen.point3D_id] :][:, :3] = projection @ pose.rotation.matrix()
        rows.append(row)
covariance = np.linalg.inv(np.vstack(rows).T @ np.vstack(rows))

print(f"pycolmap {version('pycolmap')}, numpy {np.__version__}: stated deviations over those of the rotation vector and the shift")
half, described = np.diag([0.5] * 3 + [1.0] * 3), True
for k, name in enumerate(images):
    given, truth = stated.get_cam_cov_from_world(name), covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6]
    print(f"  bundle adjustment, camera {name}: {np.round(np.sqrt(np.diag(given) / np.diag(truth)), 3)}")
    described &= bool(np.allclose(given, half @ truth @ half, rtol=0, atol=1e-4 * np.abs(given).max()))

name = images[0]
image, camera = scene.images[name], scene.cameras[scene.images[name].camera_id]
pixels = np.array([seen.xy for seen in image.points2D])
world = np.array([scene.points3D[seen.point3D_id].xyz for seen in image.points2D])
inliers = np.ones(len(world), bool)
given = pycolmap.refine_absolute_pose(image.cam_from_world(), pixels, world, inliers, camera, return_covariance=True)["covariance"]
jacobian = np.vstack(rows[: len(world)])[:, :6]
truth = np.linalg.inv(jacobian.T @ jacobian)
print(f"  refine_absolute_pose:        {np.round(np.sqrt(np.diag(given) / np.diag(truth)), 3)}")
described &= bool(np.allclose(given, half @ truth @ half, rtol=0, atol=1e-4 * np.abs(given).max()))
print("as described" if described else "the behaviour has changed")
sys.exit(0 if described else 1)
PY
