"""Poses of arms by the kinematics of other libraries, stored for the tests of arms and of rigs. Run by hand:

    pip install crx-kinematics==0.1.2 ur-analytic-ik==0.1.0.post3 frankik==1.0.1
    python tests/kinematics/poses_of_libraries.py

crx-kinematics takes the joints (deg) as FANUC's pendant shows them and gives mm; its authors compare it with poses that
controllers reported. ur-analytic-ik takes rad and gives m, in base and flange of the controller. frankik takes rad and
gives m, at the tool point of the hand, 103.4 mm and -45 deg beyond the flange.
"""

import json
from pathlib import Path

import numpy as np

UR = ("ur3e", "ur5e", "ur7e", "ur10e", "ur12e", "ur15", "ur16e", "ur20", "ur30")
CRX = ("crx3ia", "crx5ia", "crx10ia", "crx10ial", "crx20ial", "crx30ia")


# Joints (deg) in the middle of the poses of a rig, as the arm's own controller counts them.
CENTRES = {
    "crx10ia": (10.0, 15.0, -25.0, 20.0, -70.0, 30.0),
    "ur15": (10.0, -75.0, 80.0, -85.0, -70.0, 30.0),
    "panda": (0.0, 10.0, 5.0, -110.0, 0.0, 110.0, 30.0),
}


def rig(name, rng, n=20, spread=25.0):
    """Return joints (deg) near one posture and the poses (n, 3, 4) in m that the library gives."""
    import frankik
    import ur_analytic_ik
    from crx_kinematics import Crx

    q = np.round(np.array(CENTRES[name]) + rng.uniform(-spread, spread, (n, len(CENTRES[name]))), 3)
    if name == "crx10ia":
        T = np.array([Crx.crx10ia().fk(row) for row in q.tolist()]) * [1, 1, 1, 1e-3]
    elif name == "ur15":
        T = np.array([ur_analytic_ik.ur15.forward_kinematics(*row) for row in np.radians(q)])
    else:
        arm = frankik.FrankaKinematics("panda")
        T = np.array([arm.forward(row) for row in np.radians(q)])
    return {"joints": q.tolist(), "poses": np.round(T[:, :3], 9).tolist()}


def main():
    import ur_analytic_ik
    from crx_kinematics import Crx

    rng = np.random.default_rng(20261127)
    stored = {"crx-kinematics": "0.1.2", "ur-analytic-ik": "0.1.0.post3", "arms": {}}
    for name in (*UR, *CRX):
        of = getattr(ur_analytic_ik, name, None)
        q = np.round(rng.uniform(-3, 3, (3, 6)) if of else rng.uniform(-120, 120, (3, 6)), 3).tolist()
        T = [of.forward_kinematics(*row) if of else getattr(Crx, name)().fk(row) for row in q]
        stored["arms"][name] = {"joints": q, "poses": np.round(np.array(T)[:, :3], 9).tolist()}
    stored |= {"frankik": "1.0.1", "rigs": {name: rig(name, rng) for name in CENTRES}}
    Path(__file__).with_suffix(".json").write_text(json.dumps(stored) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
