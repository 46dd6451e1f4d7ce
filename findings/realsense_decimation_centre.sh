#!/usr/bin/env bash
# pyrealsense2 2.59.1: the decimation filter scales the principal point as if pixels began at their corner.
#
# librealsense counts pixels by their centres: the deprojection of (ppx, ppy) is the axis. A filter of magnitude n makes one pixel
# of n x n, whose centre is the mean of theirs. Expected: ppx becomes (ppx + 0.5) / n - 0.5. Seen: ppx / n, too large by
# 0.5 - 0.5 / n px of the small picture (0.25 for n = 2, 0.44 for n = 8): every point of the cloud is shifted to the left and up,
# by 1.1 mm at 1 m with n = 2 and 7.8 mm with n = 8 (f = 450), in proportion to its distance. Calibrating by the cloud, or
# checking by touch points, the camera seems to be turned by that angle; it comes and goes with a filter that is there to
# reduce noise. No camera is needed.
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

WIDTH, HEIGHT, FOCAL, CX, CY, SLOPE, UNIT_M = 640, 480, 450.0, 319.5, 239.5, 0.7, 1e-4
columns = np.broadcast_to((np.arange(WIDTH) - CX) / FOCAL, (HEIGHT, WIDTH))


def frame_of(slope):
    """Return a depth frame of the plane z + slope x = 1.5 m."""
    lens = rs.intrinsics()
    lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy = WIDTH, HEIGHT, FOCAL, FOCAL, CX, CY
    lens.model, lens.coeffs = rs.distortion.none, [0.0] * 5
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt, stream.intrinsics = rs.stream.depth, 0, 1, rs.format.z16, lens
    stream.width, stream.height, stream.fps, stream.bpp = WIDTH, HEIGHT, 30, 2
    device = rs.software_device()
    sensor = device.add_sensor("Depth")
    profile = sensor.add_video_stream(stream)
    sensor.add_read_only_option(rs.option.depth_units, UNIT_M)
    queue = rs.frame_queue(5)
    sensor.open(profile)
    sensor.start(queue)
    frame = rs.software_video_frame()
    frame.pixels = np.round(1.5 / (1 + slope * columns) / UNIT_M).astype(np.uint16)
    frame.stride, frame.bpp, frame.timestamp, frame.frame_number, frame.depth_units = 2 * WIDTH, 2, 0.0, 1, UNIT_M
    frame.domain, frame.profile = rs.timestamp_domain.hardware_clock, profile.as_video_stream_profile()
    sensor.on_video_frame(frame)
    arrived = queue.wait_for_frame()
    sensor.stop()
    sensor.close()
    return arrived


def shift(frame, slope):
    """Return how far (m) the points lie beside the plane along x, as a share of their distance."""
    points = np.asanyarray(rs.pointcloud().calculate(frame).get_vertices()).view(np.float32).reshape(-1, 3).astype(float)
    points = points[points[:, 2] > 0]
    return np.median(((points[:, 2] - 1.5) / slope + points[:, 0]) / points[:, 2])


print(f"pyrealsense2 {rs.__version__}: depth of {WIDTH} x {HEIGHT}, f {FOCAL}, ppx {CX}")
frames, same = {slope: frame_of(slope) for slope in (SLOPE, -SLOPE)}, True
for magnitude in (1, 2, 4, 8):
    filtered, lens = [], None
    for slope, frame in frames.items():
        block = rs.decimation_filter()
        block.set_option(rs.option.filter_magnitude, magnitude)
        small = frame if magnitude == 1 else block.process(frame)
        lens = small.profile.as_video_stream_profile().intrinsics
        filtered.append(shift(small, slope))
    seen, right = np.mean(filtered), (CX + 0.5) / magnitude - 0.5
    print(
        f"  n = {magnitude}: {lens.width} x {lens.height}, f {lens.fx:g}, ppx {lens.ppx:.4f} ({right:.4f} of the blocks),"
        f" points {1e3 * seen:+.2f} mm in x at 1 m"
    )
    same &= abs(lens.ppx - CX / magnitude) < 1e-3 and abs(seen + (0.5 - 0.5 / magnitude) / lens.fx) < 3e-4
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
