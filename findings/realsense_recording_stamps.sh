#!/usr/bin/env bash
# pyrealsense2 2.59.1: the stamps in the headers of a recording (.db3) are not the times of the frames.
#
# Recordings are ROS 2 bags now: CameraInfo and CompressedImage with a header, tf_static. Expected: header.stamp is the time
# that the frame has (here of the system's clock, in milliseconds), so that pictures can be paired with a robot's poses; the
# time of the bag may be that of writing. Seen: header.stamp repeats the time of the bag, which counts from the start of the
# recording; the frame's own time is only in a text, `timestamp=...` of the topic image/metadata. Two frames of the same
# instant that arrive 0.1 s apart are 0.1 s apart, which is 10 mm at 0.1 m/s, and no clock of the robot fits.
# Recordings as ROS 1 bags began at 1970 too (librealsense issue 3417); that a stamp of ROS 2 does so is not documented.
# No camera is needed: frames of a software device.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "pyrealsense2==2.59.1.11053" "rosbags==0.11.9" "libusb-package==1.0.30.0" || exit 2
mkdir "$folder/usb"
cp "$folder"/env/lib/python3*/site-packages/libusb_package/libusb-1.0.so* "$folder/usb/libusb-1.0.so.0"
cd "$folder"
LD_LIBRARY_PATH="$folder/usb" "$folder/env/bin/python" - <<'PY'
import sqlite3
import sys
import time

import numpy as np
import pyrealsense2 as rs
from rosbags.typesys import Stores, get_typestore

WIDTH, HEIGHT, FRAME_MS, LATE_S = 64, 48, 1_790_000_000_000.0, 0.1
device = rs.software_device()
streams = []
for number, (name, kind, form, size) in enumerate(
    (("Depth", rs.stream.depth, rs.format.z16, 2), ("Color", rs.stream.color, rs.format.rgb8, 3))
):
    lens = rs.intrinsics()
    lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy = WIDTH, HEIGHT, 60.0, 60.0, 31.5, 23.5
    lens.model = rs.distortion.brown_conrady
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt, stream.intrinsics = kind, 0, number, form, lens
    stream.width, stream.height, stream.fps, stream.bpp = WIDTH, HEIGHT, 30, size
    sensor = device.add_sensor(name)
    streams.append((sensor, sensor.add_video_stream(stream).as_video_stream_profile(), size))
recorder = rs.recorder("recording.db3", device)
queue, sensors = rs.frame_queue(10), recorder.query_sensors()
for sensor in sensors:
    sensor.open(sensor.get_stream_profiles()[0])
    sensor.start(queue)
for sensor, profile, size in streams:
    frame = rs.software_video_frame()
    frame.pixels = np.zeros((HEIGHT, WIDTH, size), np.uint8)
    frame.stride, frame.bpp, frame.profile, frame.frame_number = WIDTH * size, size, profile, 1
    frame.timestamp, frame.domain = FRAME_MS, rs.timestamp_domain.system_time
    sensor.on_video_frame(frame)
    time.sleep(LATE_S)
time.sleep(0.3)
for sensor in sensors:
    sensor.stop()
    sensor.close()
del sensor, sensors, recorder

store, stamps = get_typestore(Stores.ROS2_HUMBLE), []
rows = sqlite3.connect("recording.db3").execute(
    "select name, type, timestamp, data from messages join topics on topics.id = topic_id where name like '%/image/%'"
)
print(f"pyrealsense2 {rs.__version__}: two frames of the time {FRAME_MS / 1e3:.3f} s, the second {LATE_S} s late")
for name, kind, written, data in rows:
    message = store.deserialize_cdr(data, kind)
    if kind == "std_msgs/msg/String":
        print(f"  {name}: {next(part for part in message.data.split(';') if part.startswith('timestamp='))}")
    elif kind == "sensor_msgs/msg/CameraInfo":
        stamps.append(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
        print(f"  {name}: header.stamp {stamps[-1]:.4f} s, time of the bag {1e-9 * written:.4f} s")
same = len(stamps) == 2 and max(stamps) < 10 and LATE_S < stamps[1] - stamps[0] < LATE_S + 1
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
