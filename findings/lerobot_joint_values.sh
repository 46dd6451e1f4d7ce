#!/usr/bin/env bash
# lerobot 0.4.3 and 0.4.4: what the numbers of an SO-101 in a data set are.
#
# Expected: the same column `shoulder_pan.pos` means the same in two patch versions, and `drive_mode` of a calibration
# turns the sign of a joint or does not. Seen: by default 0.4.3 writes -100 to 100 of the calibrated range and 0.4.4
# degrees, and no file of the data set says which; drive_mode 1 turns the sign of -100 to 100 for Feetech motors, not for
# Dynamixel motors, and never that of degrees. A turn is counted as 4,095 ticks, though the motors have 4,096 positions.
# torch and what else only training needs is replaced by an empty module.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "pyserial==3.5" "deepdiff==8.6.1" "tqdm==4.67.1" "draccus==0.10.0" \
    "huggingface_hub==0.35.3" "packaging==25.0" || exit 2
status=0
for version in 0.4.3 0.4.4; do
    "$folder/env/bin/pip" install -q --no-deps "lerobot==$version" || exit 2
    "$folder/env/bin/python" - "$version" <<'PY' || status=1
import re
import sys
from importlib.metadata import files, version
from unittest.mock import MagicMock

for name in ("torch", "accelerate", "datasets", "datasets.utils", "datasets.utils.logging", "scservo_sdk", "dynamixel_sdk"):
    sys.modules[name] = MagicMock()
from lerobot.motors import Motor, MotorCalibration, MotorNormMode
from lerobot.motors.dynamixel import DynamixelMotorsBus
from lerobot.motors.feetech import FeetechMotorsBus

config = next(file for file in files("lerobot") if file.name == "config_so_follower.py").read_text()
degrees = re.search(r"use_degrees: bool = (\w+)", config)[1] == "True"


def value(bus_class, model, mode, drive_mode):
    """Tick 2600 of a range from 800 to 3300."""
    bus = bus_class.__new__(bus_class)
    bus.motors = {"m": Motor(1, model, mode)}
    bus.calibration = {"m": MotorCalibration(1, drive_mode, 0, 800, 3300)}
    bus._id_to_model_dict, bus._id_to_name_dict = {1: model}, {1: "m"}
    return round(bus._normalize({1: 2600})[1], 4)


motors = ((FeetechMotorsBus, "sts3215"), (DynamixelMotorsBus, "xl430-w250"))
found = [value(*of, mode, drive) for mode in (MotorNormMode.RANGE_M100_100, MotorNormMode.DEGREES) for of in motors for drive in (0, 1)]
print(f"lerobot {version('lerobot')}: SO-101 in degrees by default: {degrees}")
print(f"  -100..100, Feetech drive_mode 0, 1: {found[0]}, {found[1]}; Dynamixel: {found[2]}, {found[3]}")
print(f"  degrees,   Feetech drive_mode 0, 1: {found[4]}, {found[5]}; Dynamixel: {found[6]}, {found[7]}")
described = [44.0, -44.0, 44.0, 44.0] + 4 * [round(550 * 360 / 4095, 4)]
sys.exit(0 if found == described and degrees == (sys.argv[1] == "0.4.4") else 1)
PY
done
[ "$status" -eq 0 ] && echo "as described" || echo "the behaviour has changed"
exit "$status"
