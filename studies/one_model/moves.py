"""Camera or target that moves or drifts in the middle of a session: how often it is named, and false alarms.

    python -m studies.one_model.moves [--sets 200] [--only step,drift,arms] [--first 0]

Sets of 25 poses with noise of 0.05 deg and 0.3 mm, of which the target or the camera is elsewhere from a pose in the
middle on: by 3 mm or by 0.3 deg in a random direction, in both setups in turn, without and with timestamps. A step is
named if the finding has what moved and a pose within two of the true one. The same numbers of a drift in proportion to
the pose. False alarms are findings of either kind in sets where nothing moved, of 8 to 60 poses and of arms whose
errors are 0, 0.6 and 2 mm. Prints Markdown tables.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.one_model.chains import ARMS, Array
from studies.one_model.rigs import SETUPS, SPREADS, arm_set
from uq_handeye.calibration.moves import DRIFTS, MOVED
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.findings import Finding

NOISE = uq.PoseNoise.isotropic(robot=("0.01deg", "0.03mm"), camera=("0.05deg", "0.3mm"))
PARTS = ("target", "camera")
SIZES = {"3 mm": (3e-3, 0.0), "0.3 deg": (0.0, np.radians(0.3))}  # m and rad
N_POSES, SINCE, MAX_POSES_OFF = 25, 12, 2
COUNTS = (8, 12, 15, 20, 25, 30, 40, 60)
ACCURACIES = {"none": 0.0, "0.6 mm": 0.6e-3, "2 mm": 2e-3}
SECONDS_A_POSE = 7.3


def moved_poses(drawn: uq.PosePairs, part: str, shift: float, angle: float, shares: Array, seed: int) -> uq.PosePairs:
    """Move target or camera by shares (n,) of a shift (m) and an angle (rad) in random directions; without times."""
    axis, along = Rotation.random(2, random_state=seed).as_matrix()[:, :, 0]
    D = np.tile(np.eye(4), (drawn.n, 1, 1))
    D[:, :3, :3] = Rotation.from_rotvec(np.outer(shares * angle, axis)).as_matrix()
    D[:, :3, 3] = np.outer(shares * shift, along)
    camera = drawn.camera @ D if part == "target" else inverse(D) @ drawn.camera
    return uq.PosePairs(drawn.robot, camera, drawn.setup)


def stepped(
    seed: Sequence[int], part: str, shift: float, angle: float, n: int = N_POSES, setup: str = SETUPS[0],
    since: int = SINCE,
) -> uq.PosePairs:  # fmt: skip
    """Poses of which the target or the camera is elsewhere from one on, in a random direction."""
    drawn = uq.simulate(n_poses=n, noise=NOISE, seed=list(seed), setup=setup)
    return moved_poses(drawn, part, shift, angle, (np.arange(n) >= since).astype(float), seed[1])


def drifting(
    seed: Sequence[int], part: str, shift: float, angle: float, n: int = N_POSES, setup: str = SETUPS[0]
) -> uq.PosePairs:
    """Poses between which the target or the camera moves evenly, in a random direction."""
    drawn = uq.simulate(n_poses=n, noise=NOISE, seed=list(seed), setup=setup)
    return moved_poses(drawn, part, shift, angle, np.linspace(0.0, 1.0, n), seed[1])


def timed(poses: uq.PosePairs, seed: Sequence[int]) -> uq.PosePairs:
    """Add times of a session that is recorded by hand."""
    gaps = SECONDS_A_POSE * np.random.default_rng(list(seed)).uniform(0.5, 2.0, poses.n)
    return uq.PosePairs(poses.robot, poses.camera, poses.setup, np.cumsum(gaps))


def found(poses: uq.PosePairs) -> Finding | None:
    """Return the finding about what did not stand still."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        findings = uq.calibrate(poses).findings
    return next((one for one in findings if one.code in (MOVED, DRIFTS)), None)


def _word(finding: Finding | None, part: str) -> str:
    if finding is None:
        return "nothing"
    word = "step" if finding.code == MOVED else "drift"
    if finding.values["name"] != part:
        return f"{word} of other"
    return f"{word} elsewhere" if word == "step" and abs(finding.values["since"] - SINCE) > MAX_POSES_OFF else word


def named(kind: str, sets: Iterable[int], with_times: bool) -> str:
    """Return the table of a step or a drift."""
    draw, rows = {"step": stepped, "drift": drifting}[kind], []
    for part in PARTS:
        for size, (shift, angle) in SIZES.items():
            counts: Counter[str] = Counter()
            for k in sets:
                poses = draw([7, k], part, shift, angle, setup=SETUPS[k % 2])
                counts[_word(found(timed(poses, [7, k]) if with_times else poses), part)] += 1
            others = ", ".join(f"{word} {count}" for word, count in counts.most_common() if word != kind)
            rows.append([kind, part, size, "yes" if with_times else "no", counts[kind], sum(counts.values()), others])
    return _table(["change", "of", "by", "times", "named", "sets", "other answers"], rows)


def false_alarms(sets: Iterable[int], with_times: bool) -> str:
    """Return the table of sets in which nothing moved."""
    rows = []
    for words, accuracy in ACCURACIES.items():
        counts: Counter[str] = Counter()
        for k in sets:
            rng = np.random.default_rng([8, k, int(1e5 * accuracy)])
            arm, spread = list(ARMS)[k % len(ARMS)], list(SPREADS)[k % len(SPREADS)]
            n, setup = COUNTS[k % len(COUNTS)], SETUPS[(k // 2) % 2]
            poses = arm_set(arm, accuracy, rng, n=n, setup=setup, spread=spread).poses
            if (finding := found(timed(poses, [8, k]) if with_times else poses)) is not None:
                counts[f"{finding.code} {arm} {n} {setup}"] += 1
            counts["sets"] += 1
        total = counts.pop("sets")
        said = "; ".join(f"{word}: {count}" for word, count in counts.most_common())
        rows.append([words, "yes" if with_times else "no", sum(counts.values()), total, said])
    return _table(["errors of the arm", "times", "false alarms", "sets", "which"], rows)


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", default="step,drift,arms")
    parser.add_argument("--times", default="no,yes")
    options = parser.parse_args()
    sets = range(options.first, options.first + options.sets)
    for with_times in (of == "yes" for of in options.times.split(",")):
        for kind in options.only.split(","):
            table = false_alarms(sets, with_times) if kind == "arms" else named(kind, sets, with_times)
            print(f"\n{table}", flush=True)


if __name__ == "__main__":
    main()
