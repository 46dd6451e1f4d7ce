"""Camera or target that moves or drifts in the middle of a session: how often it is named, and false alarms.

    python -m studies.one_model.moves [--sets 200] [--only step,drift,arms,exchanged] [--first 0] [--store FILE]

Sets of 25 poses with noise of 0.05 deg and 0.3 mm, of which the target or the camera is elsewhere from a pose in the
middle on: by 3 mm or by 0.3 deg in a random direction, in both setups in turn, without and with timestamps. A step is
named if the finding has what moved and a pose within two of the true one. The same numbers of a drift in proportion to
the pose. False alarms are findings of either kind in sets where nothing moved: of 8 to 60 poses and of arms whose
errors are 0, 0.6 and 2 mm, and of 25 poses whose files of robot and camera are exchanged, with the noise given. Prints
Markdown tables. With ``--store`` the answers are kept in a file as they come, and a later run goes on from there.
"""

from __future__ import annotations

import argparse
import json
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
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


def found(poses: uq.PosePairs, noise: uq.PoseNoise | None = None) -> Finding | None:
    """Return the finding about what did not stand still."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        findings = uq.calibrate(poses, noise=noise).findings
    return next((one for one in findings if one.code in (MOVED, DRIFTS)), None)


def word_of(finding: Finding | None, part: str) -> str:
    if finding is None:
        return "nothing"
    word = "step" if finding.code == MOVED else "drift"
    if finding.values["name"] != part:
        return f"{word} of other"
    return f"{word} elsewhere" if word == "step" and abs(finding.values["since"] - SINCE) > MAX_POSES_OFF else word


class Answers:
    """Answers of single sets, kept in a file of JSON lines; those in it are not computed again."""

    def __init__(self, path: str | None) -> None:
        self.path = None if path is None else Path(path)
        self.known: dict[str, str] = {}
        if self.path is not None and self.path.exists():
            lines = self.path.read_text(encoding="utf-8").splitlines()
            self.known = dict(json.loads(line) for line in lines)

    def of(self, case: Sequence[Any], answer: Callable[[], str]) -> str:
        """Return the answer of a case, computed where it is not known."""
        key = " ".join(map(str, case))
        if key not in self.known:
            self.known[key] = answer()
            if self.path is not None:
                with self.path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps([key, self.known[key]]) + "\n")
        return self.known[key]


def named(kind: str, sets: Iterable[int], with_times: bool, answers: Answers) -> str:
    """Return the table of a step or a drift."""
    draw, rows = {"step": stepped, "drift": drifting}[kind], []
    for part in PARTS:
        for size, (shift, angle) in SIZES.items():
            counts: Counter[str] = Counter()
            for k in sets:

                def answer(k: int = k, part: str = part, shift: float = shift, angle: float = angle) -> str:
                    poses = draw([7, k], part, shift, angle, setup=SETUPS[k % 2])
                    return word_of(found(timed(poses, [7, k]) if with_times else poses), part)

                counts[answers.of((kind, part, size, with_times, k), answer)] += 1
            others = ", ".join(f"{word} {count}" for word, count in counts.most_common() if word != kind)
            rows.append([kind, part, size, "yes" if with_times else "no", counts[kind], sum(counts.values()), others])
    return table(["change", "of", "by", "times", "named", "sets", "other answers"], rows)


def false_alarms(sets: Iterable[int], with_times: bool, answers: Answers) -> str:
    """Return the table of sets in which nothing moved."""
    rows = []
    for words, accuracy in ACCURACIES.items():
        counts: Counter[str] = Counter()
        for k in sets:

            def answer(k: int = k, accuracy: float = accuracy) -> str:
                rng = np.random.default_rng([8, k, int(1e5 * accuracy)])
                arm, spread = list(ARMS)[k % len(ARMS)], list(SPREADS)[k % len(SPREADS)]
                n, setup = COUNTS[k % len(COUNTS)], SETUPS[(k // 2) % 2]
                poses = arm_set(arm, accuracy, rng, n=n, setup=setup, spread=spread).poses
                finding = found(timed(poses, [8, k]) if with_times else poses)
                return "" if finding is None else f"{finding.code} {arm} {n} {setup}"

            counts[answers.of(("arms", words, with_times, k), answer)] += 1
        total = sum(counts.values())
        quiet = counts.pop("", 0)
        said = "; ".join(f"{word}: {count}" for word, count in counts.most_common())
        rows.append([words, "yes" if with_times else "no", total - quiet, total, said])
    return table(["errors of the arm", "times", "false alarms", "sets", "which"], rows)


def exchanged(sets: Iterable[int], with_times: bool, answers: Answers) -> str:
    """Return the table of files of robot and camera that are exchanged, in which nothing moved."""
    rows = []
    for given in (False, True):
        counts: Counter[str] = Counter()
        for k in sets:

            def answer(k: int = k, given: bool = given) -> str:
                drawn = uq.simulate(n_poses=N_POSES, noise=NOISE, seed=[9, k], setup=SETUPS[k % 2])
                poses = uq.PosePairs(drawn.camera, drawn.robot, drawn.setup)
                finding = found(timed(poses, [9, k]) if with_times else poses, NOISE if given else None)
                return "" if finding is None else finding.code

            counts[answers.of(("exchanged", given, with_times, k), answer)] += 1
        total = sum(counts.values())
        quiet = counts.pop("", 0)
        said = "; ".join(f"{word}: {count}" for word, count in counts.most_common())
        rows.append(["yes" if given else "no", "yes" if with_times else "no", total - quiet, total, said])
    return table(["files exchanged, noise given", "times", "false alarms", "sets", "which"], rows)


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", default="step,drift,arms")
    parser.add_argument("--times", default="no,yes")
    parser.add_argument("--store", help="file with the answers of single sets, to go on from")
    options = parser.parse_args()
    sets, answers = range(options.first, options.first + options.sets), Answers(options.store)
    of_clean = {"arms": false_alarms, "exchanged": exchanged}
    for with_times in (of == "yes" for of in options.times.split(",")):
        for kind in options.only.split(","):
            clean = of_clean.get(kind)
            table = named(kind, sets, with_times, answers) if clean is None else clean(sets, with_times, answers)
            print(f"\n{table}", flush=True)


if __name__ == "__main__":
    main()
