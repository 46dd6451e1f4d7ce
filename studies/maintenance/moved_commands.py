"""Camera or target that moves in the middle of 25 poses: whether it is named by each command that meets the poses.

    python -m studies.maintenance.moved_commands [--sets 200] [--only KIND,...] [--clean] [--accuracy MM] [--store FILE]

Sets as in `studies.one_model.moves`: noise of 0.05 deg and 0.3 mm, target or camera elsewhere from pose 12 on, by 3 mm
or by 0.3 deg in a random direction, both setups. These four changes take turns, so that ``--sets 200`` has 50 of each.
KIND is

    calibrate-2     `calibrate` of a rig of two cameras, 0.1 m apart, that see one target
    check, check-2  `check` of 25 new poses, of one camera and of such a rig, in the middle of which it moved
    update, update-2
    live            the answer of a live session after the last pose, and its buttons

Named: with what moved and a pose within two of the true one. ``--clean`` has sets in which nothing moved, of which
every finding is a false alarm, with 8 to 60 poses, of `check` that many new ones; with ``--accuracy 2`` by true arms of
that error (mm). Prints a Markdown table.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import uq_handeye as uq
from studies.one_model.chains import ARMS, Array
from studies.one_model.moves import (
    COUNTS,
    MAX_POSES_OFF,
    N_POSES,
    NOISE,
    PARTS,
    SIZES,
    Answers,
    moved_poses,
    table,
)
from studies.one_model.rigs import SETUPS, SPREADS, arm_set
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.calibration.moves import DRIFTS, MOVED
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.findings import Finding
from uq_handeye.use.live_session.folder import Folder
from uq_handeye.use.live_session.session import Session
from uq_handeye.use.maintenance.check_result import MOVED_SINCE

KINDS = ("calibrate-2", "check", "check-2", "update", "update-2", "live")
CHANGES = [(part, size) for part in PARTS for size in SIZES]
CLEAN = ("", "nothing")
BETWEEN_CAMERAS_M = 0.1
FOUND = (MOVED, DRIFTS, MOVED_SINCE)


def sessions(k: int, part: str, size: str, old: int, new: int, setup: str) -> tuple[uq.PosePairs, uq.PosePairs]:
    """Poses of one camera before, and later ones in the middle of which something moved."""
    drawn = uq.simulate(n_poses=old + new, noise=NOISE, seed=[41, k], setup=setup)
    shares = (np.arange(old + new) >= old + new // 2).astype(float)
    poses = moved_poses(drawn, part, *SIZES[size], shares, k) if part else drawn
    return poses.rows(np.arange(old)), poses.rows(old + np.arange(new))


def arm_sessions(k: int, old: int, new: int, setup: str, accuracy: float) -> tuple[uq.PosePairs, uq.PosePairs]:
    """Poses of one camera by a true arm of an accuracy (m), before and later; nothing moved."""
    arm, spread = list(ARMS)[k % len(ARMS)], list(SPREADS)[k % len(SPREADS)]
    drawn = arm_set(arm, accuracy, np.random.default_rng([43, k]), n=old + new, setup=setup, spread=spread)
    poses = uq.PosePairs(drawn.poses.robot, drawn.poses.camera, setup)
    return poses.rows(np.arange(old)), poses.rows(old + np.arange(new))


def arm_rigs(k: int, old: int, new: int, setup: str, accuracy: float) -> list[uq.Rig]:
    """The same of two cameras: the second one sees what the first one sees, with noise of its own."""
    arm, spread = list(ARMS)[k % len(ARMS)], list(SPREADS)[k % len(SPREADS)]
    rng = np.random.default_rng([43, k])
    drawn = arm_set(arm, accuracy, rng, n=old + new, setup=setup, spread=spread)
    right = drawn.true_camera.copy()
    right[:, 0, 3] -= BETWEEN_CAMERAS_M
    seen = {"left": drawn.poses.camera, "right": noisy(right, np.asarray(NOISE.camera), rng)}
    robot = np.asarray(drawn.poses.robot)
    return [rig_of(robot, seen, setup, range(old)), rig_of(robot, seen, setup, range(old, old + new))]


def rig_sessions(k: int, part: str, size: str, old: int, new: int, setup: str) -> list[uq.Rig]:
    """Views of two cameras, before and later; where a camera moves it is the second."""
    n, rng = old + new, np.random.default_rng([42, k])
    truth = uq.simulate(n_poses=n, setup=setup, seed=[42, k]).truth
    assert truth is not None
    shares = (np.arange(n) >= old + new // 2).astype(float)
    offset = np.eye(4)
    offset[0, 3] = -BETWEEN_CAMERAS_M
    seen: dict[str, Array] = {}
    for name, of in (("left", truth.camera), ("right", offset @ truth.camera)):
        poses = uq.PosePairs(truth.robot, of, setup)
        if part == "target" or (part == "camera" and name == "right"):
            poses = moved_poses(poses, part, *SIZES[size], shares, k)
        seen[name] = noisy(poses.camera, np.asarray(NOISE.camera), rng)
    robot = noisy(truth.robot, np.asarray(NOISE.robot), rng)
    return [rig_of(robot, seen, setup, range(old)), rig_of(robot, seen, setup, range(old, n))]


def rig_of(robot: Array, seen: Mapping[str, Array], setup: str, rows: Sequence[int] | None = None) -> uq.Rig:
    """Return rows of the poses of an arm, and of cameras that see one board, as a rig."""
    on_arm, in_world = {True: ("arm", "world"), False: ("world", "arm")}[setup == SETUPS[0]]
    names = tuple(range(len(robot)) if rows is None else rows)
    views = tuple(uq.View(name, "board", C[list(names)], names) for name, C in seen.items())
    arm = uq.ArmPoses(robot[list(names)], names)
    return uq.Rig({"arm": arm}, dict.fromkeys(seen, on_arm), {"board": in_world}, views)


def noisy(T: Array, S: Array, rng: np.random.Generator) -> Array:
    """Poses (n, 4, 4) with errors of a diagonal covariance S (6, 6)."""
    return perturb(T, rng.standard_normal((len(T), 6)) * np.sqrt(np.diag(S)))


def findings_of(
    kind: str, k: int, part: str, size: str, n: int, setup: str, accuracy: float | None = None
) -> tuple[tuple[Finding, ...], int]:
    """Return the findings of a command, and the number of the first pose after the move."""
    old = 0 if kind in ("calibrate-2", "live") else N_POSES
    result: Any
    later: Any
    if kind.endswith("-2"):
        rigs = rig_sessions(k, part, size, old, n, setup) if accuracy is None else arm_rigs(k, old, n, setup, accuracy)
        before, later = rigs
        result = calibrate_rig(before if old else later)
        if kind == "calibrate-2":
            return result.findings, n // 2
        since = old + n // 2
    else:
        first, poses = (
            sessions(k, part, size, old, n, setup) if accuracy is None else arm_sessions(k, old, n, setup, accuracy)
        )
        if kind == "live":
            return in_session(poses), n // 2
        since = n // 2 if kind == "check" else old + n // 2
        result, later = uq.calibrate(first), poses
    if kind.startswith("check"):
        check = uq.check(result, later)
        return (check.findings if check.changed else ()), since
    try:
        return uq.update(result, later).findings, since
    except uq.InputError as error:
        return tuple(error.findings), since


def in_session(poses: uq.PosePairs) -> tuple[Finding, ...]:
    """Return the findings of a live session after its last pose, those of a move only with buttons."""
    with TemporaryDirectory() as folder:
        session = Session(Folder(Path(folder), {"setup": poses.setup}))
        for robot, camera in zip(poses.robot, poses.camera, strict=True):
            session.add(robot, camera, ask=False)
        answer = session.update()
        return tuple(one for one in answer.findings if one.code != MOVED or answer.remedies)


def word_of(findings: tuple[Finding, ...], part: str, since: int) -> str:
    """Return "named", or what was said instead."""
    finding = next((one for one in findings if one.code in FOUND), None)
    if finding is None:
        return "nothing"
    names = {"target": ("target", "board"), "camera": ("camera", "right", "X")}.get(part, ())
    if finding.values["name"] not in names:
        return f"{finding.code} of {finding.values['name']}"
    if finding.code == DRIFTS:
        return "drift"
    return "named" if abs(int(finding.values["since"]) - since) <= MAX_POSES_OFF else "elsewhere"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--only", default=",".join(KINDS))
    parser.add_argument("--clean", action="store_true")
    parser.add_argument("--store", help="file with the answers of single sets, to go on from")
    parser.add_argument("--accuracy", type=lambda text: 1e-3 * float(text), help="of true arms (mm); with --clean")
    options = parser.parse_args()
    of_arm = [] if options.accuracy is None else [f"{1e3 * options.accuracy:g} mm"]
    warnings.simplefilter("ignore", uq.InputWarning)
    answers, rows = Answers(options.store), []
    for kind in options.only.split(","):
        counts: dict[str, Counter[str]] = {}
        for k in range(options.sets):
            part, size = CLEAN if options.clean else CHANGES[k % len(CHANGES)]
            n = COUNTS[k % len(COUNTS)] if options.clean else N_POSES
            setup = SETUPS[k // len(CHANGES) % 2]

            def answer(
                k: int = k, kind: str = kind, part: str = part, size: str = size, n: int = n, setup: str = setup
            ) -> str:
                findings, since = findings_of(kind, k, part, size, n, setup, options.accuracy)
                return word_of(findings, part, since)

            counts.setdefault(f"{part} {size}".strip(), Counter())[
                answers.of((kind, part, size, *of_arm, k), answer)
            ] += 1
        expected = "nothing" if options.clean else "named"
        for change, of in counts.items():
            others = ", ".join(f"{word} {count}" for word, count in of.most_common() if word != expected)
            rows.append([kind, change, of[expected], sum(of.values()), others])
        print(f"\n{table(['command', 'change', expected, 'sets', 'other answers'], rows)}", flush=True)


if __name__ == "__main__":
    main()
