#!/usr/bin/env bash
# opencv-python-headless 5.0.0: names of hand-eye methods without the function that takes them.
#
# Expected: cv2.calibrateHandEye and cv2.calibrateRobotWorldHandEye, as in OpenCV 4, or neither the functions nor the
# names of their methods. Seen: the functions are absent and the names are kept, so that a program that looks for
# cv2.CALIB_HAND_EYE_TSAI believes that OpenCV can calibrate. 4.14 has both.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
status=0
for version in 4.14.0.94 5.0.0.93; do
    python3 -m venv "$folder/$version"
    "$folder/$version/bin/pip" install -q "numpy==2.4.6" "opencv-python-headless==$version" || exit 2
    "$folder/$version/bin/python" - <<'PY' || status=1
import sys

import cv2

functions = [name for name in ("calibrateHandEye", "calibrateRobotWorldHandEye") if hasattr(cv2, name)]
names = sorted(name for name in dir(cv2) if "HAND_EYE" in name)
print(f"cv2 {cv2.__version__}: functions {functions or 'none'}, names {names or 'none'}")
old = cv2.__version__.startswith("4.")
sys.exit(0 if (len(functions) == 2) == old else 1)
PY
done
[ "$status" -eq 0 ] && echo "as described" || echo "the behaviour has changed"
exit "$status"
