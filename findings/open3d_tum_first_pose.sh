#!/usr/bin/env bash
# open3d-cpu 0.20.0: a trajectory written as TUM loses its first pose, and every other pose takes the place of the one before.
#
# `write_pinhole_camera_trajectory` writes `.json`, `.log` and `.txt` (TUM: t x y z qx qy qz qw). Expected: a TUM file has one line
# for each camera, and reads back as it was, to its digits. Seen: the first pose stands behind the comment of the first line,
# without a line break, so that open3d and evo read one pose less; nobody says so. Pairing by rows puts each camera pose beside
# the robot pose of the station before. Besides, the numbers have six decimals, times are 0, 1, 2, whatever was read, and
# `.txt` and `.log` read back with an intrinsic matrix of 525, 319.5, 239.5 that nobody gave; `.json` keeps everything.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "scipy==1.15.3" "open3d-cpu==0.20.0" "evo==1.38.1" \
    "libusb-package==1.0.30.0" || exit 2
mkdir "$folder/usb"
cp "$folder"/env/lib/python3*/site-packages/libusb_package/libusb-1.0.so* "$folder/usb/libusb-1.0.so.0"
cd "$folder"
LD_LIBRARY_PATH="$folder/usb" HOME="$folder" "$folder/env/bin/python" -W ignore - <<'PY'
import sys
from importlib.metadata import version

import numpy as np
import open3d
from evo.tools.file_interface import read_tum_trajectory_file
from scipy.spatial.transform import Rotation

POSES = 5
camera = open3d.camera.PinholeCameraIntrinsic(640, 480, 600.0, 601.0, 320.5, 241.5)
rng = np.random.default_rng(0)
poses, cameras = [], []
for turn in Rotation.random(POSES, random_state=1).as_matrix():
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, rng.uniform(-1, 1, 3)
    poses.append(pose)  # of the camera in the world
    one = open3d.camera.PinholeCameraParameters()
    one.intrinsic, one.extrinsic = camera, np.linalg.inv(pose)
    cameras.append(one)
trajectory = open3d.camera.PinholeCameraTrajectory()
trajectory.parameters = cameras
print(f"open3d-cpu {version('open3d-cpu')}, evo {version('evo')}: {POSES} cameras written and read")
read = {}
for ending in ("json", "log", "txt"):
    name = f"trajectory.{ending}"
    open3d.io.write_pinhole_camera_trajectory(name, trajectory)
    found = open3d.io.read_pinhole_camera_trajectory(name).parameters
    read[ending] = [np.linalg.inv(one.extrinsic) for one in found]
    focal = {float(one.intrinsic.intrinsic_matrix[0, 0]) for one in found}
    off = [max(np.abs(a - b).max() for a, b in zip(read[ending], poses[skip:])) for skip in (0, 1)]
    print(f"  {ending}: {len(found)} read, off by {off[0]:.1e} m from its own place and {off[1]:.1e} m from the next; f {focal}")
text = open("trajectory.txt").read().splitlines()
print(f"  first line of the TUM file: {text[0]}")
evo = read_tum_trajectory_file("trajectory.txt")
print(f"  evo reads {evo.num_poses} poses, times {evo.timestamps}")
same = len(read["json"]) == len(read["log"]) == POSES and len(read["txt"]) == evo.num_poses == POSES - 1
same &= np.allclose(read["json"], poses) and np.allclose(read["log"], poses, atol=1e-6)
same &= np.allclose(read["txt"], poses[1:], atol=1e-5) and np.allclose(evo.positions_xyz, [T[:3, 3] for T in poses[1:]], atol=1e-5)
same &= text[0].startswith("#") and len(text[0].split()) > 8
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
