"""Trials of 16 tags with sizes that are wrong by one factor, each by its own, or both: cameras against the truth.

Two cameras on an arm see each tag at 40 % of 30 robot poses. Noise of the arm 0.05 mrad and 0.05 mm, of a view 0.6 mrad
and 0.4 mm. Sizes are estimated.

Run ``python -m studies.rig.printed_targets [RIGS]``.
"""

import sys
from dataclasses import replace

import numpy as np

import uq_handeye as uq
from uq_handeye.trials.simulation.several_cameras import simulate_rig, with_noise

from .consistency import error

TAGS, POSES, SEEN = 16, 30, 0.4
NOISE = {"arm": ("0.05mrad", "0.05mm"), "c1": ("0.6mrad", "0.4mm"), "c2": ("0.6mrad", "0.4mm")}
# Standard deviations of the factor of all tags and of that of each.
FACTORS = ((0.0, 0.0), (0.01, 0.0), (0.0, 0.003), (0.003, 0.001))


def drawn(seed: int, common: float, own: float) -> tuple[uq.Rig, dict[str, np.ndarray]]:
    """Return a rig whose tags are larger than told by ``1 + common`` and by a factor of each, and the true poses."""
    tags = {f"t{k}": "world" for k in range(TAGS)}
    rig, truth = simulate_rig({"c1": "arm", "c2": "arm"}, tags, n_poses=POSES, seen=SEEN, seed=seed)
    rng = np.random.default_rng([seed, 1])
    size = {name: (1 + common) * (1 + own * rng.normal()) for name in tags}
    views = []
    for view in with_noise(rig, NOISE, seed).views:
        C = np.array(view.poses)
        C[:, :3, 3] /= size[view.target]
        views.append(replace(view, poses=C))
    return replace(with_noise(rig, NOISE, seed), views=tuple(views)), truth


def main(rigs: int) -> None:
    for common, own in FACTORS:
        off, stated, d2 = [], [], []
        for seed in range(rigs):
            rig, truth = drawn(seed, common, own)
            for name, one in uq.calibrate(rig).cameras.items():
                xi = error(one.X, truth[name])
                off.append(xi[3:] @ xi[3:])
                stated.append(np.trace(one.covariance[3:, 3:]))
                d2.append(xi @ np.linalg.solve(one.covariance, xi) / 6)
        print(
            f"all {100 * common:g} %, each {100 * own:g} %: off {1e3 * np.sqrt(np.mean(off)):.2f} mm, stated "
            f"{1e3 * np.sqrt(np.mean(stated)):.2f} mm, mean d^2/6 {np.mean(d2):.2f}, largest {np.max(d2):.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
