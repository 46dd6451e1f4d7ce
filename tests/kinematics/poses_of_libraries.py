"""Poses of arms by the kinematics of other libraries, stored for `test_known_arms`. Run by hand:

    pip install crx-kinematics==0.1.2 ur-analytic-ik==0.1.0.post3
    python tests/kinematics/poses_of_libraries.py

crx-kinematics takes the joints (deg) as FANUC's pendant shows them and gives mm; its authors compare it with poses that
controllers reported. ur-analytic-ik takes rad and gives m, in base and flange of the controller.
"""

import json
from pathlib import Path

import numpy as np

UR = ("ur3e", "ur5e", "ur7e", "ur10e", "ur12e", "ur15", "ur16e", "ur20", "ur30")
CRX = ("crx3ia", "crx5ia", "crx10ia", "crx10ial", "crx20ial", "crx30ia")


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
    Path(__file__).with_suffix(".json").write_text(json.dumps(stored) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
