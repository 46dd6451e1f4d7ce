#!/usr/bin/env bash
# pyrealsense2 2.59.1: a frame's point cloud and the deprojection of its pixels disagree as soon as the lens has coefficients.
#
# Both take the same `rs.intrinsics` of the frame. Expected: `rs.pointcloud().calculate(frame)` puts each pixel where
# `rs2_deproject_pixel_to_point` puts it. Seen: with `brown_conrady` the point cloud is that of a pinhole, the coefficients are
# ignored (7 mm at 1 m, in a corner); with `inverse_brown_conrady` the point cloud applies the polynomial from pixel to ray and
# the deprojection from ray to pixel, in opposite directions (15 mm); with `modified_brown_conrady` neither takes anything out,
# though the projection puts it in. Only without coefficients do they agree, as for the depth of a D400; depth
# aligned to a color stream has that stream's lens. A board or part measured in the cloud, and a touch point measured by
# deprojection, are not in one frame. Issue 10811 of librealsense (2022) is about this. No camera is needed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "pyrealsense2==2.59.1.11053" "libusb-package==1.0.30.0" || exit 2
mkdir "$folder/usb"
cp "$folder"/env/lib/python3*/site-packages/libusb_package/libusb-1.0.so* "$folder/usb/libusb-1.0.so.0"
cd "$folder"
LD_LIBRARY_PATH="$folder/usb" "$folder/env/bin/python" - <<'PY'
import sys

import numpy as np
import pyrealsense2 as rs

WIDTH, HEIGHT, FOCAL, CX, CY, DEPTH_MM, COLUMN, ROW = 640, 480, 450.0, 319.5, 239.5, 1000, 600, 20
COEFFICIENTS = [0.15, -0.45, 0.002, -0.0015, 0.4]
PINHOLE = np.array([(COLUMN - CX) / FOCAL, (ROW - CY) / FOCAL, 1.0])


def of_lens(model, coefficients):
    """Return the point of a pixel at 1 m in the cloud and by deprojection, and where the projection puts each."""
    lens = rs.intrinsics()
    lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy = WIDTH, HEIGHT, FOCAL, FOCAL, CX, CY
    lens.model, lens.coeffs = model, coefficients
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt, stream.intrinsics = rs.stream.depth, 0, 1, rs.format.z16, lens
    stream.width, stream.height, stream.fps, stream.bpp = WIDTH, HEIGHT, 30, 2
    device = rs.software_device()
    sensor = device.add_sensor("Depth")
    profile = sensor.add_video_stream(stream)
    sensor.add_read_only_option(rs.option.depth_units, 0.001)
    queue = rs.frame_queue(5)
    sensor.open(profile)
    sensor.start(queue)
    frame = rs.software_video_frame()
    frame.pixels = np.full((HEIGHT, WIDTH), DEPTH_MM, np.uint16)
    frame.stride, frame.bpp, frame.timestamp, frame.frame_number = 2 * WIDTH, 2, 0.0, 1
    frame.domain, frame.profile = rs.timestamp_domain.hardware_clock, profile.as_video_stream_profile()
    sensor.on_video_frame(frame)
    points = rs.pointcloud().calculate(queue.wait_for_frame())
    cloud = np.asanyarray(points.get_vertices()).view(np.float32).reshape(HEIGHT, WIDTH, 3)[ROW, COLUMN].astype(float)
    sensor.stop()
    sensor.close()
    deprojected = np.array(rs.rs2_deproject_pixel_to_point(lens, [COLUMN, ROW], 1e-3 * DEPTH_MM))
    again = [np.array(rs.rs2_project_point_to_pixel(lens, [float(x) for x in point])) for point in (cloud, deprojected)]
    return cloud, deprojected, [np.linalg.norm(pixel - [COLUMN, ROW]) for pixel in again]


print(f"pyrealsense2 {rs.__version__}: the pixel ({COLUMN}, {ROW}) at 1 m, cloud against deprojection")
found = {}
for name in ("none", "brown_conrady", "inverse_brown_conrady", "modified_brown_conrady"):
    cloud, point, again = of_lens(getattr(rs.distortion, name), COEFFICIENTS if name != "none" else [0.0] * 5)
    apart, bent = 1e3 * np.linalg.norm(cloud - point), 1e3 * np.linalg.norm(cloud - PINHOLE)
    found[name] = apart, bent, again
    print(
        f"  {name:22}: {apart:6.1f} mm apart, cloud {bent:4.1f} mm from a pinhole's,"
        f" projected again {again[0]:.1f} px and {again[1]:.1f} px off"
    )
plain, inverse, modified = (found[f"{name}brown_conrady"] for name in ("", "inverse_", "modified_"))
same = found["none"][0] < 1e-3
same &= plain[0] > 5 and plain[1] < 1e-3 and plain[2][1] < 0.01
same &= inverse[0] > 10 and inverse[1] > 5 and inverse[2][1] < 0.01
same &= modified[0] < 1e-3 and min(modified[2]) > 2
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
