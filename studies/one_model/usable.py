"""Results of data that contradict an assumption: how many are usable although X is outside its 99.9 % region.

    python -m studies.one_model.usable [--sets 300] [--first 0] [--cameras 2]

Sets of 12 to 40 poses in both setups, of one kind in turn: noise given three times too small, a declared size of the
target that is wrong by 1 %, 40 to 70 % outliers, two sessions with another X in the second half, a few poses with a
wrong row. A set is *wrong* if the result is usable and the true X of the kept poses is outside the region that holds
99.9 % of all errors. Prints a Markdown table.

With ``--cameras 2`` the sets are rigs of two cameras, 0.1 m apart, that see one target: what is wrong is so for the
second camera, but for a target that moved and a noise or a size of the target that is wrong.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.maintenance.moved_commands import BETWEEN_CAMERAS_M, noisy, rig_of
from studies.one_model.moves import NOISE, moved_poses
from studies.one_model.rigs import SETUPS
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.core.geometry.se3 import difference, inverse

KINDS = ("noise too small", "wrong target size", "most rejected", "halves disagree", "wrong rows")
OUTSIDE = 0.999


def drawn(kind: str, k: int) -> tuple[uq.PosePairs, dict[str, Any], Any]:
    """Return poses, arguments of `calibrate`, and the true X."""
    rng = np.random.default_rng([31, k])
    n, setup = int(rng.integers(12, 41)), SETUPS[k // len(KINDS) % 2]
    poses = uq.simulate(n_poses=n, noise=NOISE, seed=[31, k], setup=setup)
    assert poses.truth is not None
    X, robot, camera = poses.truth.X, poses.robot, poses.camera.copy()
    options: dict[str, Any] = {}
    if kind == "noise too small":
        third = uq.PoseNoise.isotropic(robot=("0.0033deg", "0.01mm"), camera=("0.017deg", "0.1mm"))
        options = {"noise": third}
    elif kind == "wrong target size":
        camera[:, :3, 3] *= 1.01
        options = {"noise": NOISE, "shared": []}
    elif kind == "most rejected":
        bad = rng.permutation(n)[: int(n * rng.uniform(0.4, 0.7))]
        camera[bad, :3, 3] += rng.normal(size=(len(bad), 3)) * rng.uniform(3e-3, 0.1)
        turn = Rotation.from_rotvec(rng.normal(size=(len(bad), 3)) * rng.uniform(0.01, 0.3)).as_matrix()
        camera[bad, :3, :3] = turn @ camera[bad, :3, :3]
    elif kind == "halves disagree":
        part = ("camera", "target")[k // len(KINDS) // 2 % 2]
        size = float(np.exp(rng.uniform(np.log(1.0), np.log(10.0))))
        shares = (np.arange(n) >= n // 2).astype(float)
        camera = moved_poses(poses, part, 1e-3 * size, np.radians(0.1) * size, shares, k).camera
    else:
        bad = rng.permutation(n)[: max(2, n // 6)]
        camera[bad] = camera[np.roll(bad, 1)]
    return uq.PosePairs(robot, camera, setup), options, X


def drawn_rig(kind: str, k: int) -> tuple[uq.Rig, dict[str, Any], dict[str, Any]]:
    """Return a rig of two cameras, arguments of `calibrate_rig`, and the true X of each camera."""
    rng = np.random.default_rng([32, k])
    n, setup = int(rng.integers(12, 41)), SETUPS[k // len(KINDS) % 2]
    truth = uq.simulate(n_poses=n, setup=setup, seed=[32, k]).truth
    assert truth is not None
    offset = np.eye(4)
    offset[0, 3] = -BETWEEN_CAMERAS_M
    exact = {"left": truth.camera, "right": offset @ truth.camera}
    X = {"left": truth.X, "right": truth.X @ inverse(offset)}
    robot, noise = noisy(truth.robot, np.asarray(NOISE.robot), rng), [("0.01deg", "0.03mm"), ("0.05deg", "0.3mm")]
    seen, options = {}, dict[str, Any]()
    if kind == "noise too small":
        noise = [("0.0033deg", "0.01mm"), ("0.017deg", "0.1mm")]
    part = ("camera", "target")[k // len(KINDS) // 2 % 2]
    size = float(np.exp(rng.uniform(np.log(1.0), np.log(10.0))))
    shares = (np.arange(n) >= n // 2).astype(float)
    bad = rng.permutation(n)[: int(n * rng.uniform(0.4, 0.7)) if kind == "most rejected" else max(2, n // 6)]
    for name, of in exact.items():
        one = uq.PosePairs(truth.robot, of, setup)
        if kind == "halves disagree" and (part == "target" or name == "right"):
            one = moved_poses(one, part, 1e-3 * size, np.radians(0.1) * size, shares, k)
        camera = noisy(one.camera, np.asarray(NOISE.camera), rng)
        if kind == "wrong target size":
            camera[:, :3, 3] *= 1.01
        elif name == "right" and kind == "most rejected":
            camera[bad, :3, 3] += rng.normal(size=(len(bad), 3)) * rng.uniform(3e-3, 0.1)
            turn = Rotation.from_rotvec(rng.normal(size=(len(bad), 3)) * rng.uniform(0.01, 0.3)).as_matrix()
            camera[bad, :3, :3] = turn @ camera[bad, :3, :3]
        elif name == "right" and kind == "wrong rows":
            camera[bad] = camera[np.roll(bad, 1)]
        seen[name] = camera
    if kind in ("noise too small", "wrong target size"):
        options = {"noise": {"arm": noise[0], "left": noise[1], "right": noise[1]}}
    return rig_of(robot, seen, setup), options, X


def answered_rig(k: int) -> tuple[str, str]:
    """Return kind and answer of one rig."""
    kind = KINDS[k % len(KINDS)]
    rig, options, X = drawn_rig(kind, k)
    try:
        result = calibrate_rig(rig, **options)
    except (uq.InputError, uq.NotConvergedError):
        return kind, "refused"
    if not result.usable:
        return kind, "not usable"
    inside = True
    for name, T in X.items():
        xi = difference(result.cameras[name].X, T)
        far = xi @ np.linalg.solve(result.cameras[name].covariance, xi)
        inside &= bool(far <= result.reference.quantile(OUTSIDE))
    return kind, "usable, inside" if inside else "usable, outside"


def answered(k: int) -> tuple[str, str]:
    """Return kind and answer of one set."""
    kind = KINDS[k % len(KINDS)]
    poses, options, X = drawn(kind, k)
    try:
        result = uq.calibrate(poses, **options)
    except (uq.InputError, uq.NotConvergedError):
        return kind, "refused"
    if not result.usable:
        return kind, "not usable"
    xi = difference(result.X, X)
    inside = result.covariance is not None and xi @ np.linalg.solve(result.covariance, xi) <= result.quantile(OUTSIDE)
    return kind, "usable, inside" if inside else "usable, outside"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cameras", type=int, choices=(1, 2), default=1)
    options = parser.parse_args()
    warnings.simplefilter("ignore", uq.InputWarning)
    found, counts = [], Counter[tuple[str, str]]()
    for k in range(options.first, options.first + options.sets):
        kind, answer = answered(k) if options.cameras == 1 else answered_rig(k)
        counts[kind, answer] += 1
        if answer == "usable, outside":
            found.append(k)
    answers = ("refused", "not usable", "usable, inside", "usable, outside")
    print(f"| data | {' | '.join(answers)} |\n|{' --- |' * 5}")
    for kind in KINDS:
        print(f"| {kind} | {' | '.join(str(counts[kind, answer]) for answer in answers)} |")
    print(f"\nUsable and outside: {', '.join(map(str, found)) or 'none'}.")


if __name__ == "__main__":
    main()
