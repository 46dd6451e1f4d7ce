"""Measure what follows a calibration by a scene: checks by later pictures, and two cameras on one hand.

    python -m studies.scene.following [--draws N]

prints one row for each: a scene of 18 pictures of 800 x 600 and 8 later ones is rendered once, and the robot's noise
(0.02 deg, 0.05 mm) is drawn N times. The errors of the pictures are the same in all draws.
"""

from __future__ import annotations

import argparse
import warnings
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import uq_handeye as uq
from studies.scene.sessions import Session, rendered, rendered_right, session, with_kind, with_noise
from uq_handeye.core.geometry.se3 import Array, difference, inverse, perturb

SIZE, OLD, NEW, SEED = (800, 600), 18, 8, 3
# Moves of the camera on the hand that are to be found (rad, m), in the frame of the hand.
MOVES = {"0.1 deg": [0.0, 1.75e-3, 0.0, 0.0, 0.0, 0.0], "0.5 mm": [0.0, 0.0, 0.0, 5e-4, 0.0, 0.0]}


def of_checks(made: Session, pictures: list[Path], draws: int) -> str:
    """Return how often later pictures say that X changed: as it is, and after moves."""
    first = uq.scene_poses(pictures[:OLD], made.robot[:OLD])
    result = uq.calibrate(first.pairs)
    pairs = uq.scene_poses(pictures[OLD:], made.robot[OLD:], result=result).pairs
    counts = dict.fromkeys(["as it was", *MOVES], 0)
    for seed in range(draws):
        robot = with_noise(made.base_T_gripper, np.random.default_rng([60, seed]))
        one = uq.calibrate(replace(first.pairs, robot=robot[first.rows]))
        for name in counts:
            # the pictures are those of a camera that was moved if the robot stood elsewhere by as much
            slid = perturb(made.X, np.array(MOVES.get(name, np.zeros(6))))
            later = robot[OLD:] @ made.X @ inverse(slid)
            counts[name] += bool(uq.check(one, replace(pairs, robot=later[: pairs.n])).changed)
    said = ", ".join(f"{name} {count} of {draws}" for name, count in counts.items())
    return f"check by {NEW} later pictures says changed: {said}"


def of_two(made: Session, left: list[Path], right: Path, left_T_right: Array, draws: int) -> str:
    """Return errors of X and of the relative pose of two cameras, against what is stated."""
    files = {"left": left[:OLD], "right": sorted(right.glob("*.png"))[:OLD]}
    rig = uq.scene_rig(files, made.robot[:OLD]).rig
    found: dict[str, list[list[float]]] = {"left": [], "left_T_right": []}
    for seed in range(draws):
        robot = with_noise(made.base_T_gripper[:OLD], np.random.default_rng([61, seed]))
        result = uq.calibrate(replace(rig, arms={"arm": robot}))
        for name, true, one in (
            ("left", made.X, result.cameras["left"]),
            ("left_T_right", left_T_right, result.relative("left", "right")),
        ):
            off = difference(true, one.pose)
            d2 = float(off @ np.linalg.solve(one.covariance, off))
            turn, shift = (float(np.linalg.norm(part)) for part in np.split(off, 2))
            found[name].append([turn, shift, float(np.sqrt(np.trace(one.covariance[3:, 3:]))), d2])
    lines = []
    for name, rows in found.items():
        turn, shift, stated = np.sqrt(np.mean(np.square(rows), axis=0))[:3].tolist()
        mean = np.mean(np.array(rows)[:, 3])
        lines.append(
            f"two cameras, {name}: RMS {1e3 * shift:.3f} mm, {np.degrees(turn):.4f} deg, stated {1e3 * stated:.3f} mm, "
            f"mean d^2 {mean:.1f} of 6"
        )
    return "\n".join(lines)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=12)
    draws = parser.parse_args().draws
    made = session(with_kind("table", n=OLD + NEW), SEED, size=SIZE)
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        pictures = rendered(made, Path(folder))
        print(of_checks(made, pictures, draws), flush=True)
        between = rendered_right(made, Path(folder) / "right")
        print(of_two(made, pictures, Path(folder) / "right", between, draws), flush=True)


if __name__ == "__main__":
    main()
