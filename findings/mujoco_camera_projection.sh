#!/usr/bin/env bash
# MuJoCo 4.0.0: the sensor that says where a point is in a camera's picture leaves the principal point out.
#
# The sensor camprojection gives the pixel of a site in the picture of a camera. Expected: the pixel at which the camera draws it,
# with the focal lengths and the principal point that the camera has (focalpixel, principalpixel). Seen: both focal lengths count,
# the principal point does not: with one off the middle every pixel of the sensor is that far from where the frustum of the
# picture has it. Corners of a board "seen" by this sensor, the shortest way to a simulated hand-eye calibration, belong to another
# camera than the pictures of the same model and than its cam_intrinsic; poses from them with the camera matrix of the pictures are
# turned by 2.3 deg here, at 20 px and a focal length of 500 px.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.4.6" "mujoco==4.0.0" || exit 2
cd "$folder"
"$folder/env/bin/python" - <<'PY'
import sys

import mujoco
import numpy as np

WIDTH, HEIGHT = 640, 480
POINTS = np.array([[0.0, 0.0, -1.0], [0.2, 0.1, -1.0], [-0.3, -0.2, -1.5]])
sites = "".join(f'<site name="{k}" pos="{p[0]} {p[1]} {p[2]}"/>' for k, p in enumerate(POINTS))
sensors = "".join(f'<camprojection camera="camera" site="{k}"/>' for k in range(len(POINTS)))


def pixels(intrinsics):
    """The pixels of the sensor, and those of the frustum that the picture is drawn with."""
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><worldbody><camera name="camera" resolution="{WIDTH} {HEIGHT}"
    {intrinsics}/>{sites}<geom size="0.1" pos="0 0 -1"/></worldbody><sensor>{sensors}</sensor></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene, view = mujoco.MjvScene(model, 10), mujoco.MjvCamera()
    view.type, view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
    mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, view, mujoco.mjtCatBit.mjCAT_ALL, scene)
    drawn = scene.camera[0]
    high = drawn.frustum_top - drawn.frustum_bottom
    half = drawn.frustum_width or high / 2 * WIDTH / HEIGHT  # 0: from the shape of the picture
    x, y = (drawn.frustum_near * POINTS[:, k] / -POINTS[:, 2] for k in (0, 1))
    column = (x - drawn.frustum_center + half) / (2 * half) * WIDTH
    return data.sensordata.reshape(-1, 2), np.column_stack([column, (drawn.frustum_top - y) / high * HEIGHT])


print(f"mujoco {mujoco.__version__}, numpy {np.__version__}")
differences = []
for intrinsics in (
    'fovy="50"',
    'sensorsize="0.0064 0.0048" focalpixel="500 500" principalpixel="20 10"',
    'sensorsize="0.0064 0.0048" focalpixel="550 500"',
):
    sensor, drawn = pixels(intrinsics)
    differences.append(np.abs(sensor - drawn).max(0))
    print(f"  {intrinsics}:\n    sensor {np.round(sensor, 1).tolist()}\n    drawn  {np.round(drawn, 1).tolist()}")
described = differences[0].max() < 0.01 and np.allclose(differences[1], [20, 10], atol=0.01) and differences[2].max() < 0.01
print("as described" if described else "the behaviour has changed")
sys.exit(0 if described else 1)
PY
