#!/usr/bin/env bash
# ikdh 1.2.0: the joints of its FANUC arms are not those of the controller, and two files of one arm count them differently.
#
# `load_robot("fanuc_crx_10ia.yaml")` has the arm's limits, and `forward_kin` takes degrees. Expected: the pose that a pendant shows
# for the six angles it shows, up to the height of the base. Seen: on a FANUC the third angle counts from the horizon, so J2 alone
# leaves the forearm level, and these tables have serial joints: the third angle is -(J2 + J3), and J4, J5 and J6 have the other
# sign (`crx10ia.yaml` of the same arm: J4 alone). J2 = 30 deg as the pendant shows it puts the flange 362 mm from where it is. No
# field of the files says so. Poses computed from recorded joints are wrong by a different amount at each station, which a
# hand-eye calibration cannot take up. The reference is crx-kinematics 0.1.2, whose angles are "as they appear in the controller".
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q "numpy==2.2.6" "ikdh==1.2.0" "crx-kinematics==0.1.2" || exit 2
"$folder/env/bin/python" - <<'PY'
import sys
from importlib.metadata import version

import crx_kinematics
import ikdh
import numpy as np

BASE_M = 0.245  # from the floor to J2, which FANUC's z counts from
arm = crx_kinematics.Crx.crx10ia()
signs = {"fanuc_crx_10ia.yaml": (1, 1, -1, -1, -1, -1), "crx10ia.yaml": (1, 1, -1, -1, 1, 1)}


def pendant(joints):
    T = np.array(arm.fk(joints))
    T[:3, 3] = 1e-3 * T[:3, 3] + [0, 0, BASE_M]
    return T


print(f"ikdh {version('ikdh')} against crx-kinematics {version('crx-kinematics')}, CRX-10iA")
rng, same = np.random.default_rng(0), True
for name, sign in signs.items():
    table = ikdh.load_robot(name).dh
    off = []
    for joints in ([0, 0, 0, 0, 0, 0], [0, 30, 0, 0, 0, 0], [0, 0, 30, 0, 0, 0], [20, 10, -15, 30, 40, 50]):
        as_shown = np.array(ikdh.forward_kin(table, np.array(joints, float)))
        off.append(1e3 * np.linalg.norm(as_shown[:3, 3] - pendant(joints)[:3, 3]))
    worst = 0.0
    for _ in range(20):
        joints = rng.uniform(-90, 90, 6)
        changed = joints * sign
        changed[2] -= joints[1]
        worst = max(worst, np.abs(np.array(ikdh.forward_kin(table, changed)) - pendant(joints)).max())
    print(f"  {name}: {np.round(off)} mm off with the pendant's angles; with -(J2 + J3) and the signs {sign} {worst:.0e}")
    same &= off[0] < 1e-6 and min(off[1:]) > 50 and worst < 1e-9
print("as described" if same else "the behaviour has changed")
sys.exit(0 if same else 1)
PY
