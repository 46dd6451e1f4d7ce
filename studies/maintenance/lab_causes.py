"""Causes that `check` gives for changes of a lab: a bracket that slid by 1 mm, a focal length that changed by 0.5 %.

    python -m studies.maintenance.lab_causes [--sets 60] [--first 500] [--cameras 1]

Each set is calibrated with 25 poses and default options, with noise of 0.05 deg and 0.3 mm, and checked by eight new
poses whose depths spread by 80 mm or more, in both setups in turn. The camera slid along its optical axis, or across it
in a random direction; the target slid in its plane; the focal length grew. Prints in how many sets the true cause has
more than half of the probability, its mean probability, and the smallest probability that was listed. The prior
probabilities (`use.maintenance.causes`) were chosen by sets below 500.

With ``--cameras 2`` or more the cameras are side by side, each 0.1 m from the one before, and see one target at every
pose, and what changes is the second one: the truth is the cause of that camera.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter

import numpy as np

import uq_handeye as uq
from studies.one_model.chains import Array
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.core.geometry.se3 import inverse, perturb
from uq_handeye.model.shared_errors.shared_error import SharedError
from uq_handeye.use.maintenance.causes import CAMERA_MOVED, FOCAL_LENGTH, TARGET_MOVED

NOISE = uq.PoseNoise.isotropic(robot=("0.01deg", "0.03mm"), camera=("0.05deg", "0.3mm"))
SETUPS = ("eye-in-hand", "eye-to-hand")
N_CALIBRATED, N_CHECKED, N_CANDIDATES = 25, 8, 60
MIN_DEPTH_SPREAD_M, SLIDE_M, FOCAL_CHANGE = 0.08, 1e-3, 0.005
TRUTH = {
    "slid along its axis": CAMERA_MOVED,
    "slid across its axis": CAMERA_MOVED,
    "target pushed by 3 mm": TARGET_MOVED,
    "focal length + 0.5 %": FOCAL_LENGTH,
    "nothing": "",
}


def _noisy(G: Array, C: Array, setup: str, rng: np.random.Generator) -> uq.PosePairs:
    robot, camera = (
        perturb(T, rng.standard_normal((len(T), 6)) * np.sqrt(np.diag(np.asarray(S))))
        for T, S in ((G, NOISE.robot), (C, NOISE.camera))
    )
    return uq.PosePairs(robot, camera, setup)


def _changed(name: str, X: Array, W: Array, G: Array, setup: str, rng: np.random.Generator) -> Array:
    """Camera poses (m, 4, 4) after a change."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    across = np.array([np.cos(angle), np.sin(angle), 0.0])
    X, W = X.copy(), W.copy()
    if name.startswith("slid"):
        X[:3, 3] += (
            SLIDE_M * X[:3, :3] @ (across if "across" in name else np.array([0.0, 0.0, rng.choice([-1.0, 1.0])]))
        )
    if name.startswith("target"):
        W[:3, 3] += 3.0 * SLIDE_M * W[:3, :3] @ across
    C = inverse(X) @ inverse(inverse(G) if setup == "eye-to-hand" else G) @ W
    if name.startswith("focal"):
        C = perturb(C, SharedError.focal_length(1.0).at(uq.PosePairs(G, C, setup)) @ np.array([FOCAL_CHANGE]))
    return C


def probabilities(k: int) -> dict[str, dict[str, float]]:
    """Return for each change of one set the probabilities of the causes; empty where nothing was found."""
    setup, rng = SETUPS[k % 2], np.random.default_rng([20, k])
    truth = uq.simulate(n_poses=N_CALIBRATED + N_CANDIDATES, setup=setup, seed=rng).truth
    assert truth is not None
    first = slice(0, N_CALIBRATED)
    result = uq.calibrate(_noisy(truth.robot[first], truth.camera[first], setup, rng))
    while True:
        rows = N_CALIBRATED + rng.permutation(N_CANDIDATES)[:N_CHECKED]
        if np.ptp(truth.camera[rows, 2, 3]) >= MIN_DEPTH_SPREAD_M:
            break
    found = {}
    for name in TRUTH:
        C = _changed(name, truth.X, truth.W, truth.robot[rows], setup, rng)
        check = uq.check(result, _noisy(truth.robot[rows], C, setup, rng))
        found[name] = {one.name: one.probability for one in check.causes.all} if check.changed else {}
        found[name] |= {f"listed {one.name}": one.probability for one in check.causes.candidates}
    return found


def of_rig(k: int, cameras: int) -> dict[str, dict[str, float]]:
    """Return for each change of one rig the probabilities of the causes, by kind and part."""
    setup, rng = SETUPS[k % 2], np.random.default_rng([21, k])
    truth = uq.simulate(n_poses=N_CALIBRATED + N_CANDIDATES, setup=setup, seed=rng).truth
    assert truth is not None
    names, G, W = [f"camera {j + 1}" for j in range(cameras)], truth.robot, truth.W
    on_arm, in_world = {True: ("arm", "world"), False: ("world", "arm")}[setup == "eye-in-hand"]
    X = {}
    for j, name in enumerate(names):
        X[name] = truth.X.copy()
        X[name][:3, 3] += 0.1 * j * truth.X[:3, 0]

    def rig(rows: list[int], change: str) -> uq.Rig:
        views, robot, seed = [], _noisy(G[rows], G[rows], setup, rng).robot, int(rng.integers(1 << 31))
        for name in names:
            of_part = change.startswith("target") or name == names[1]
            direction = np.random.default_rng(seed)  # one of all cameras
            C = _changed(change if of_part else "nothing", X[name], W, G[rows], setup, direction)
            views.append(uq.View(name, "board", _noisy(C, C, setup, rng).camera, tuple(rows)))
        arm = uq.ArmPoses(robot, tuple(rows))
        return uq.Rig({"arm": arm}, dict.fromkeys(names, on_arm), {"board": in_world}, tuple(views))

    result = calibrate_rig(rig(list(range(N_CALIBRATED)), "nothing"))
    while True:
        rows = N_CALIBRATED + rng.permutation(N_CANDIDATES)[:N_CHECKED]
        if np.ptp(truth.camera[rows, 2, 3]) >= MIN_DEPTH_SPREAD_M:
            break
    found = {}
    for change, cause in TRUTH.items():
        check = uq.check(result, rig(rows.tolist(), change))
        part = "board" if cause == TARGET_MOVED else names[1]
        found[change] = {cause if (one.name, one.of) == (cause, part) else f"{one.name} of {one.of}": one.probability
                         for one in (check.causes.all if check.changed else ())}  # fmt: skip
        found[change] |= {f"listed {one.name} {one.of}": one.probability for one in check.likely}
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=60)
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--cameras", type=int, default=1)
    options = parser.parse_args()
    warnings.simplefilter("ignore", uq.InputWarning)
    several = options.cameras > 1
    numbers = range(options.first, options.first + options.sets)
    sets = [of_rig(k, options.cameras) if several else probabilities(k) for k in numbers]
    print("| change | above half | sets | mean probability | first otherwise | least listed |\n" + "| --- " * 6 + "|")
    for name, cause in TRUTH.items():
        of = [one[name] for one in sets]
        right = [one.get(cause, 0.0) for one in of]
        plain = [{key: p for key, p in one.items() if not key.startswith("listed")} for one in of]
        others = Counter(
            max(one, key=lambda key: one[key]) if one else "no change found"
            for one, p in zip(plain, right, strict=True) if p <= 0.5
        )  # fmt: skip
        least = min((p for one in of for key, p in one.items() if key.startswith("listed")), default=1.0)
        words = ", ".join(f"{key} {count}" for key, count in others.most_common())
        above = sum(p > 0.5 for p in right)
        print(f"| {name} | {above} | {len(of)} | {np.mean(right):.2f} | {words} | {least:.3f} |")


if __name__ == "__main__":
    main()
