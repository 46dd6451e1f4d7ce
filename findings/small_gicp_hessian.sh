#!/usr/bin/env bash
# small_gicp 1.0.1: the Hessian of a registration does not know the noise of the points.
#
# GICP weights each pair of points by their covariances, and the result has `H`, "Final Hessian matrix". Expected: as the weights
# are covariances in m^2, inv(H) is the covariance of the pose, and grows with the noise. Seen: the covariances are replaced by the
# shape of a surface, 1 m^2 along it and 0.001 m^2 across, whatever the points' scatter, so that inv(H) says 2 to 3 mrad for points
# of 0.5 mm and of 5 mm, where 25 repetitions scatter by 0.04 and 0.4 mrad: 60 and 8 times too large. With ICP and PLANE_ICP it
# is the Hessian for a variance of 1 m^2. As weights of the camera poses in a hand-eye calibration such matrices favour the views
# with many points, not the good ones. The scale has to come from the residuals or from the sensor.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "scipy==1.15.3" "small_gicp==1.0.1" || exit 2
"$folder/env/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import small_gicp
from scipy.spatial.transform import Rotation

RUNS = 25


def corner_of_a_room(rng, count, noise):
    points = rng.uniform(-1, 1, (count, 3))
    points[np.arange(count), rng.integers(0, 3, count)] = -1.2
    return points + noise * rng.normal(size=points.shape)


print(f"small_gicp {version('small_gicp')}: rotation, scatter of {RUNS} runs and as inv(H) says")
ratio, stated = {}, {}
for kind in ("GICP", "PLANE_ICP"):
    for noise in (5e-4, 5e-3):
        found, said = [], []
        for run in range(RUNS):
            rng = np.random.default_rng(run)
            clouds = corner_of_a_room(rng, 4000, noise), corner_of_a_room(rng, 1500, noise)
            result = small_gicp.align(
                *clouds, registration_type=kind, max_correspondence_distance=0.2, downsampling_resolution=0.01, num_threads=1
            )
            found.append(Rotation.from_matrix(result.T_target_source[:3, :3]).as_rotvec())
            said.append(np.diag(np.linalg.inv(result.H))[:3])
        scatter, stated[kind, noise] = np.sqrt(np.mean(np.var(found, axis=0))), np.sqrt(np.mean(said))
        ratio[kind, noise] = stated[kind, noise] / scatter
        print(f"  {kind}, points of {1e3 * noise} mm: {1e3 * scatter:.3f} mrad, inv(H) {1e3 * stated[kind, noise]:.2f} mrad")
tree = small_gicp.PointCloud(corner_of_a_room(np.random.default_rng(0), 4000, 5e-4))
small_gicp.estimate_covariances(tree)
shape = np.linalg.eigvalsh(np.array(tree.cov(0))[:3, :3])
print(f"  eigenvalues of a point's covariance: {np.round(shape, 4)} m^2")
same = np.allclose(shape, [1e-3, 1, 1], rtol=1e-3) and ratio["GICP", 5e-4] > 20 and ratio["GICP", 5e-3] > 4
same &= all(0.5 < stated[kind, 5e-3] / stated[kind, 5e-4] < 2 for kind in ("GICP", "PLANE_ICP"))
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
