"""False alarms of the check of a rig whose noise was estimated, on new views of the same rig.

Run ``python -m studies.rig.level_of_check [DRAWS]``: 30 robot poses to calibrate, 10 to check.
"""

import sys

import numpy as np

import uq_handeye as uq
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.trials.simulation.several_cameras import with_noise

CASES = {
    "two cameras on a hand": ({"c1": "arm", "c2": "arm"}, {"t1": "world", "t2": "world"}),
    "three fixed cameras": ({"c1": "world", "c2": "world", "c3": "world"}, {"t1": "arm"}),
}


def part(rig: uq.Rig, first: int, last: int) -> uq.Rig:
    """Return the views at some of the moments."""
    views = [
        uq.View(view.camera, view.target, view.poses[first:last], (view.at or ())[first:last]) for view in rig.views
    ]
    return uq.Rig(rig.arms, rig.cameras, rig.targets, tuple(views))


def run(draws: int) -> None:
    """Print the shares of p-values below two levels, and the mean."""
    for label, (cameras, targets) in CASES.items():
        exact, _ = uq.simulate_rig(cameras, targets, n_poses=40, seed=7)
        noise, p, ratio = dict.fromkeys(("arm", *cameras), ("0.5mrad", "0.3mm")), [], []
        for k in range(draws):
            rig = with_noise(exact, noise, np.random.default_rng([7, k]))
            found = uq.check(calibrate_rig(part(rig, 0, 30), robust=False), part(rig, 30, 40))
            p.append(found.p_value)
            ratio.append(found.d2 / found.dof)
        below = ", ".join(f"{np.mean(np.array(p) < level):.3f} below {level}" for level in (0.05, 0.2))
        print(f"{label}; {draws} draws: p {below}, mean {np.mean(p):.3f}; d^2 over its number {np.mean(ratio):.3f}")


if __name__ == "__main__":
    run(int(sys.argv[1]) if len(sys.argv) > 1 else 200)
