#!/usr/bin/env bash
# MuJoCo 3.5.0 and 4.0.0: the principal point of a calibration goes into a camera with both signs turned, one of them since 3.6.
#
# A camera of MJCF takes the numbers of a calibration: resolution, focalpixel and principalpixel, the last from the middle of the
# picture. Expected: principalpixel = (cx - width / 2, cy - height / 2) of OpenCV's camera matrix, x to the right and y down (or
# up, as the camera's y axis points), so that the optical axis meets the picture there. Seen in the frustum that the picture is
# drawn with: in 4.0.0 the axis is as far to the left and as far up as the numbers are positive; in 3.5.0 it is to the left and
# down, which is neither OpenCV's direction nor the opposite (mujoco pull request 3150 turned the vertical one). A principal point
# 20 px off the middle, put in as it is, moves every pixel by 40 px, 4.6 deg at this focal length, and calibrating the pictures
# gives the point mirrored. Write (width / 2 - cx, height / 2 - cy), from 3.6 on.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
status=0
for mujoco in 3.5.0 4.0.0; do
    python3 -m venv "$folder/$mujoco"
    "$folder/$mujoco/bin/pip" install -q "numpy==2.4.6" "mujoco==$mujoco" || exit 2
    (cd "$folder" && "$folder/$mujoco/bin/python" -) <<'PY' || status=1
import sys

import mujoco
import numpy as np

WIDTH, HEIGHT, CAMERA = 640, 480, np.array([[500.0, 0, 340.0], [0, 500.0, 250.0], [0, 0, 1]])
offset = float(CAMERA[0, 2] - WIDTH / 2), float(CAMERA[1, 2] - HEIGHT / 2)
model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody><camera name="camera" resolution="{WIDTH} {HEIGHT}"
sensorsize="0.0064 0.0048" focalpixel="{CAMERA[0, 0]} {CAMERA[1, 1]}" principalpixel="{offset[0]} {offset[1]}"/>
<geom size="0.1" pos="0 0 -1"/></worldbody></mujoco>""")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
scene, view = mujoco.MjvScene(model, 10), mujoco.MjvCamera()
view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, view, mujoco.mjtCatBit.mjCAT_ALL, scene)
drawn = scene.camera[0]
left, right = drawn.frustum_center - drawn.frustum_width, drawn.frustum_center + drawn.frustum_width
column = -left / (right - left) * WIDTH
row = drawn.frustum_top / (drawn.frustum_top - drawn.frustum_bottom) * HEIGHT
print(f"mujoco {mujoco.__version__}, numpy {np.__version__}: cx {CAMERA[0, 2]:.0f}, cy {CAMERA[1, 2]:.0f} of OpenCV as principalpixel"
      f" {offset}: the optical axis is drawn at column {column:.2f}, row {row:.2f}")
old = mujoco.__version__.startswith("3.5")
sys.exit(0 if np.allclose([column, row], [WIDTH / 2 - 20, HEIGHT / 2 + (10 if old else -10)], atol=0.01) else 1)
PY
done
[ "$status" -eq 0 ] && echo "as described" || echo "the behaviour has changed"
exit "$status"
