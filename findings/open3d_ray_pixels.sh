#!/usr/bin/env bash
# open3d-cpu 0.20.0: rays of a pinhole camera begin half a pixel away from where depth images have their pixels.
#
# Expected: rays of `RaycastingScene.create_rays_pinhole` with a matrix K go through the pixels of the images of K, so that a depth
# image drawn with them turns into points on the surface again. Seen: the ray of the pixel (0, 0) goes through (0.5, 0.5) of K, and
# `create_from_depth_image` and `project_to_depth_image` have the pixel's centre at (0, 0), as OpenCV has: points of a drawn depth
# image are half a pixel off in u and v, 1.2 mm at 1 m with f = 600, and 0.6 mm in front of a plane at 45 deg. Neither says so. A
# depth image drawn to register a camera against, or K of a file with the other count, shifts the camera by as much: the
# principal point in K has to be 0.5 larger for the rays.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "open3d-cpu==0.20.0" "libusb-package==1.0.30.0" || exit 2
mkdir "$folder/usb"
cp "$folder"/env/lib/python3*/site-packages/libusb_package/libusb-1.0.so* "$folder/usb/libusb-1.0.so.0"
cd "$folder"
LD_LIBRARY_PATH="$folder/usb" HOME="$folder" "$folder/env/bin/python" -W ignore - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import open3d

WIDTH, HEIGHT, FOCAL, CX, CY, DISTANCE = 640, 480, 600.0, 319.5, 239.5, 1.0
NORMAL = np.array([1.0, 0.0, -1.0]) / np.sqrt(2)
Tensor = open3d.core.Tensor
corners = np.array([(s, t, DISTANCE + s) for s in (-0.6, 0.6) for t in (-0.8, 0.8)], np.float32)
plane = open3d.t.geometry.TriangleMesh(Tensor(corners), Tensor(np.array([(0, 1, 2), (1, 3, 2)], np.int32)))
scene = open3d.t.geometry.RaycastingScene()
scene.add_triangles(plane)
print(f"open3d-cpu {version('open3d-cpu')}: a plane at 45 deg, {DISTANCE} m away, drawn by rays and turned into points")
means = {}
for shift in (0.0, 0.5):
    K = np.array([[FOCAL, 0, CX + shift], [0, FOCAL, CY + shift], [0, 0, 1]])
    rays = scene.create_rays_pinhole(Tensor(K), Tensor(np.eye(4)), WIDTH, HEIGHT)
    x, y, z = rays.numpy()[0, 0, 3:]
    first = FOCAL * x / z + CX, FOCAL * y / z + CY
    hit = scene.cast_rays(rays)["t_hit"].numpy() * rays.numpy()[..., 5]
    depth = open3d.geometry.Image(np.where(np.isfinite(hit), hit, 0).astype(np.float32))
    lens = open3d.camera.PinholeCameraIntrinsic(WIDTH, HEIGHT, FOCAL, FOCAL, CX, CY)
    cloud = open3d.geometry.PointCloud.create_from_depth_image(depth, lens, depth_scale=1.0)
    points = np.asarray(cloud.points)
    means[shift] = 1e3 * ((points - [0, 0, DISTANCE]) @ NORMAL).mean()
    print(f"  {shift} added for the rays: pixel (0, 0) at ({first[0]:.2f}, {first[1]:.2f}), points {means[shift]:+.3f} mm off the plane")
    if not shift:
        corner = first
same = abs(corner[0] - 0.5) < 0.01 and abs(corner[1] - 0.5) < 0.01
same &= abs(abs(means[0.0]) - 1e3 * 0.5 * DISTANCE / FOCAL / np.sqrt(2)) < 0.05 and abs(means[0.5]) < 0.01
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
