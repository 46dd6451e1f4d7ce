#!/usr/bin/env bash
# frankik 1.0.1: forward and inverse kinematics of a Franka arm in two different frames.
#
# Expected: by default `inverse` finds the joints of a pose that `forward` gives. Seen: by default `forward` ends at the tool
# point of the hand (103.4 mm beyond the flange, turned by -45 deg about its axis), and `inverse` starts from the flange: at
# the pose of `forward` it finds other joints, unless `tcp_offset=arm.FrankaHandTCPOffset` is given.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "frankik==1.0.1" || exit 2
"$folder/env/bin/python" - <<'PY'
import sys

import frankik
import numpy as np

arm = frankik.FrankaKinematics("panda")
q = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 1.8, 0.6])
# Flange by the maker's Denavit-Hartenberg parameters (Craig): a, d, alpha.
rows = [(0, 0.333, 0), (0, 0, -1), (0, 0.316, 1), (0.0825, 0, 1), (-0.0825, 0.384, -1), (0, 0, 1), (0.088, 0, 1), (0, 0.107, 0)]
flange = np.eye(4)
for (a, d, quarter), angle in zip(rows, [*q, 0.0]):
    ca, sa, ct, st = np.cos(quarter * np.pi / 2), np.sin(quarter * np.pi / 2), np.cos(angle), np.sin(angle)
    flange = flange @ [[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]]
tool = np.linalg.inv(flange) @ arm.forward(q)
turn = np.degrees(np.arctan2(tool[1, 0], tool[0, 0]))


def error(pose, **offset):
    """Return how far (rad) the joints that `inverse` finds are from those of the pose."""
    found = arm.inverse(pose, q0=q, **offset)
    return None if found is None else float(np.abs(np.asarray(found) - q).max())


at_forward, at_flange = error(arm.forward(q)), error(flange)
print(f"frankik 1.0.1: forward is ({', '.join(f'{1e3 * x:.1f}' for x in tool[:3, 3])}) mm and {turn:.1f} deg from the flange")
with_offset = error(arm.forward(q), tcp_offset=arm.FrankaHandTCPOffset)
print(f"  inverse(forward(q), tcp_offset=...): {with_offset} rad")
print(f"  inverse(forward(q)): joints off by {at_forward} rad; inverse(flange): {at_flange} rad")
same = abs(1e3 * tool[2, 3] - 103.4) < 0.1 and abs(turn + 45) < 0.1
same &= with_offset is not None and with_offset < 1e-3
same &= (at_forward is None or at_forward > 0.01) and at_flange is not None and at_flange < 1e-3
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
