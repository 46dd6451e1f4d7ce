"""Are estimated noise, robust estimation and the tests of a result true? Simulated sets whose truth is known.

    python -m studies.real_cell [--full] [--csv real_cell.csv]

Prints the tables of docs/how-to/real_cell.md and writes them as CSV, with a fixed seed: everything through
`uq.calibrate` without any noise model. 100 sets per row (``--full``: 500).
"""

from __future__ import annotations

import argparse
import csv
import os
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import binom

import uq_handeye as uq
from uq_handeye.io import read_pose_file
from uq_handeye.se3 import Array

SEED = 2026
CELLS = {
    "robot 0.02 deg, 0.05 mm; camera 0.1 deg, 0.5 mm": (("0.02deg", "0.05mm"), ("0.1deg", "0.5mm")),
    "robot 0.1 deg, 0.1 mm; camera 0.1 deg, 0.3 mm": (("0.1deg", "0.1mm"), ("0.1deg", "0.3mm")),
}
KINDS = ("model", "sandwich", "jackknife", "bootstrap", "hac")


def sets(n: int, cell: str, setup: str, count: int) -> Iterator[uq.PosePairs]:
    robot, camera = CELLS[cell]
    noise = uq.PoseNoise.isotropic(robot=robot, camera=camera)
    seed = [SEED, n, list(CELLS).index(cell), len(setup)]
    many = uq.simulate(n, noise=noise, setup=setup, trials=count, seed=seed)
    assert many.truth is not None
    for robot_poses, camera_poses in zip(many.robot, many.camera, strict=True):
        yield uq.PosePairs(robot_poses, camera_poses, setup, truth=many.truth)


def calibrated(poses: uq.PosePairs, **options: object) -> uq.Calibration:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return uq.calibrate(poses, **options)  # type: ignore[arg-type]


def error(X: Array, truth: Array) -> Array:
    turn = Rotation.from_matrix(X[:3, :3] @ truth[:3, :3].T).as_rotvec()
    return np.concatenate([turn, X[:3, 3] - truth[:3, 3]])


def true_components(cell: str) -> dict[str, float]:
    robot, camera = CELLS[cell]
    S = uq.PoseNoise.isotropic(robot=robot, camera=camera)
    assert S.robot is not None and S.camera is not None
    v = {
        f"{side} {what}": of[k, k]
        for side, of in (("robot", S.robot), ("camera", S.camera))
        for what, k in (("rotation", 0), ("translation", 3))
    }
    for what in ("rotation", "translation"):
        v[f"{what}, robot and camera together"] = v[f"robot {what}"] + v[f"camera {what}"]
    return {name: float(np.sqrt(value)) for name, value in v.items()}


COVERED = ("rotation, robot and camera together", "robot rotation", "camera rotation")
TRANSLATION = "translation, robot and camera together"


def coverage(n: int, cell: str, setup: str, count: int) -> dict[str, float]:
    """Shares of sets in which 95 % intervals and ellipsoids hold the truth, and split halves agree at 95 %."""
    truth = true_components(cell)
    hits: dict[str, list[bool]] = {name: [] for name in (*COVERED, TRANSLATION, "ellipsoid of X", "split halves")}
    for poses in sets(n, cell, setup, count):
        result = calibrated(poses)
        assert result.noise_estimate is not None and result.covariance is not None and poses.truth is not None
        for name in (*COVERED, TRANSLATION):
            component = result.noise_estimate[name]
            assert component.high is not None
            hits[name].append(component.low <= truth[name] <= component.high)
        xi = error(result.X, poses.truth.X)
        hits["ellipsoid of X"].append(float(xi @ np.linalg.solve(result.covariance, xi)) <= result.quantile(0.95))
        hits["split halves"].append(bool(result.split_half.passed))
    return {name: float(np.mean(values)) for name, values in hits.items()}


def kinds(n: int, cell: str, count: int) -> dict[str, float]:
    """Shares of sets in which the 95 % ellipsoid of each covariance holds the truth."""
    hits: dict[str, list[bool]] = {kind: [] for kind in KINDS}
    for poses in sets(n, cell, "eye-in-hand", count):
        assert poses.truth is not None
        for kind in KINDS:
            result = calibrated(poses, covariance=kind)
            assert result.covariance is not None
            xi = error(result.X, poses.truth.X)
            hits[kind].append(float(xi @ np.linalg.solve(result.covariance, xi)) <= result.quantile(0.95))
    return {kind: float(np.mean(values)) for kind, values in hits.items()}


def spoilt(poses: uq.PosePairs, wrong: Array, kind: str, rng: np.random.Generator) -> uq.PosePairs:
    camera = poses.camera.copy()
    for k in wrong:
        if kind == "half turn of the board":
            camera[k, :3, :3] = camera[k, :3, :3] @ Rotation.from_rotvec([0, 0, np.pi]).as_matrix()
        elif kind == "5 cm":
            direction = rng.normal(size=3)
            camera[k, :3, 3] += 0.05 * direction / np.linalg.norm(direction)
        else:
            camera[k, :3, :3] = Rotation.random(rng=rng).as_matrix()
            camera[k, :3, 3] += rng.normal(scale=0.1, size=3)
    return uq.PosePairs(poses.robot, camera, poses.setup, truth=poses.truth)


def outliers(n: int, bad: int, kind: str, count: int) -> tuple[int, float, int, float]:
    """Sets with X within 1.2 times its error without the wrong poses, the largest ratio, sets in which all wrong poses
    were rejected, and the share of good ones that were flagged."""
    rng = np.random.default_rng([SEED, n, bad, len(kind)])
    ratios, found, flagged = [], 0, 0
    for poses in sets(n, next(iter(CELLS)), "eye-in-hand", count):
        assert poses.truth is not None
        wrong = rng.choice(n, bad, replace=False)
        result = calibrated(spoilt(poses, wrong, kind, rng))
        clean = calibrated(poses.rows(np.setdiff1d(np.arange(n), wrong)))
        size, least = (np.linalg.norm(error(X, poses.truth.X)[3:]) for X in (result.X, clean.X))
        ratios.append(float(size / least))
        assert result.table is not None
        found += set(wrong.tolist()) <= set(result.table.rejected)
        flagged += len(set(result.table.flagged) - set(wrong.tolist()))
    return sum(ratio <= 1.2 for ratio in ratios), max(ratios), found, flagged / (count * (n - bad))


def rendered() -> str | None:
    """d^2 of the truth of rendered images under noise that is independent per pose, where the data are at hand."""
    if "UQ_HANDEYE_DATA" not in os.environ:
        return None
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / "synthetic_camera_2"
    poses = uq.read_poses(folder / "robot.csv", folder / "camera.csv")
    truth = read_pose_file(folder / "truth.csv")[1][0]
    found = []
    for robust in (True, False):
        result = calibrated(poses, robust=robust)
        assert result.covariance is not None
        xi = error(result.X, truth)
        d2 = float(xi @ np.linalg.solve(result.covariance, xi))
        off = 1e3 * float(np.linalg.norm(xi[3:]))
        found.append(f"{d2:.0f} (95 % of true ones below {result.quantile(0.95):.0f}), X off by {off:.1f} mm")
    return f"Rendered images, synthetic_camera_2: d^2 of the truth {found[0]}; with robust=False {found[1]}."


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--full", action="store_true", help="500 sets per row instead of 100")
    parser.add_argument("--csv", default="real_cell.csv")
    options = parser.parse_args()
    count = 500 if options.full else 100
    rows: list[list[object]] = []
    low, high = binom.ppf([0.0005, 0.9995], count, 0.95) / count
    print(f"{count} sets per row; a true 95 % lies between {low:.3f} and {high:.3f} with probability 99.9 %.\n")
    names = (*COVERED, TRANSLATION, "ellipsoid of X", "split halves")
    print(f"| noise | setup | poses | {' | '.join(names)} |\n|{'---|' * (3 + len(names))}")
    for cell in CELLS:
        for setup, n in (("eye-in-hand", 15), ("eye-in-hand", 30), ("eye-to-hand", 30)):
            shares = coverage(n, cell, setup, count)
            print(f"| {cell} | {setup} | {n} | {' | '.join(f'{shares[name]:.3f}' for name in names)} |", flush=True)
            rows += [["coverage", cell, setup, n, name, share] for name, share in shares.items()]
    print(f"\n| poses | {' | '.join(KINDS)} |\n|{'---|' * (1 + len(KINDS))}")
    for n in (15, 30):
        shares = kinds(n, next(iter(CELLS)), count)
        print(f"| {n} | {' | '.join(f'{shares[kind]:.3f}' for kind in KINDS)} |", flush=True)
        rows += [["ellipsoid", next(iter(CELLS)), "eye-in-hand", n, kind, share] for kind, share in shares.items()]
    print("\n| poses | wrong | kind | X within 1.2 | largest ratio | all found | good ones flagged |\n|" + "---|" * 7)
    for n, bad in ((40, 4), (20, 1), (10, 1), (6, 1)):
        for kind in ("half turn of the board", "5 cm", "anything"):
            good, largest, found, flagged = outliers(n, bad, kind, count)
            print(
                f"| {n} | {bad} | {kind} | {good} of {count} | {largest:.2f} | {found} of {count} | "
                f"{100 * flagged:.2f} % |",
                flush=True,
            )
            rows.append(["outliers", kind, "eye-in-hand", n, bad, good / count, largest, found / count, flagged])
    if (text := rendered()) is not None:
        print(f"\n{text}")
    with open(options.csv, "w", newline="") as file:
        csv.writer(file).writerows(rows)


if __name__ == "__main__":
    main()
