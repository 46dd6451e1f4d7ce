r"""Accuracy and time of 4DPA against other methods, as data grow (Tables II and III of the paper).

Section IV-A runs nine methods on 224 to 500 consecutive motions (6) of a UR10 with a camera, and judges them by

    (62)  Error = sqrt( sum_i |A_i X - X B_i|^2 ) / N     (Frobenius norm, translations in m)

and by time. The recording as it was published is defective (columns y and z of the robot poses are the same, and rows
do not belong to their images), so this study takes (1) a simulation of that rig (`ur10_camera`), where the real
error of X is known, (2) every usable recording in the folder that UQ_HANDEYE_DATA names. The simulation has three
recordings: ``longer`` goes on at the same steps as N grows, ``denser`` is that of N = 224 in shorter steps, and
``late`` is ``denser`` with robot poses 5 of the first steps older than their images, a defect like the published one.

Per number of motions N: 100 draws of the noise (quick: 8), the same for all methods; of zhao and heller, which are
slow, half as many. In ``late`` the noise is nothing beside the defect: 2 draws. Times: the smallest processor time of
interleaved calls on one problem, after one call that is not counted. Seed 2019.
"""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import uq_handeye as uq
from studies.common.paper_tables import PAPER, SIZES, errors_and_times
from studies.common.study import Study, Tables
from studies.tables_2_3 import ur10_camera
from studies.tables_2_3.figures import figures
from studies.tables_2_3.findings import BOUND, PAPER_SCALE, TRUTH, findings
from uq_handeye.core.geometry.se3 import Array, inverse
from uq_handeye.core.progress import progress_bar
from uq_handeye.errors import DegenerateMotionError
from uq_handeye.methods.noise_transport import noise_of_pairs
from uq_handeye.model.poses.motions import pair_indices
from uq_handeye.trials.simulation.experiment import Experiment
from uq_handeye.trials.simulation.rig import disturbed
from uq_handeye.trials.simulation.run import Estimates, errors_of, estimates

SEED = 2019
OURS = ("gwak", "nguyen", "efficient")
METHODS = (*PAPER, *OURS)
SLOW = {"zhao": 0.5, "heller": 0.5}  # share of the draws
SEQUENCES = {"longer": ("longer", 0.0), "denser": ("denser", 0.0), "late": ("denser", 5.0)}
BLOCK = 20  # draws at a time, for the memory


def error62(A: Array, B: Array, X: Array) -> Array:
    """(62) of motions (..., N, 4, 4) and X (..., 4, 4)."""
    difference = A @ X[..., None, :, :] - X[..., None, :, :] @ B
    return np.asarray(np.sqrt(np.sum(difference**2, axis=(-3, -2, -1))) / A.shape[-3])


class Draws(NamedTuple):
    """Result of a method on some draws."""

    error62: Array  # (m,)
    xi: Array  # (m, 6), errors (theta, tau) of X
    ok: NDArray[np.bool_]  # (m,)


def drawn(poses: uq.PosePairs, noise: uq.PoseNoise, count: int) -> Iterator[tuple[Array, Array]]:
    """Blocks of disturbed robot and camera poses (m, n, 4, 4)."""
    rng = np.random.default_rng([SEED, poses.n])
    for first in range(0, count, BLOCK):
        m = (min(BLOCK, count - first),)
        yield disturbed(poses.robot, noise.robot, m, rng), disturbed(poses.camera, noise.camera, m, rng)


def attempt(poses: uq.PosePairs, noise: uq.PoseNoise, count: int) -> dict[str, Draws]:
    """All methods, and the true X, on the same draws of the noise on ``poses`` (true, but for the late robot)."""
    pairs = pair_indices(poses.n)
    parts: dict[str, list[Draws]] = {name: [] for name in (TRUTH, *METHODS)}
    done = 0
    for robot, camera in drawn(poses, noise, count):
        motions = uq.relative_motions(uq.PosePairs(robot, camera))
        for name in parts:
            m = min(len(robot), max(2, int(SLOW.get(name, 1.0) * count)) - done)
            if m <= 0:
                continue
            problem = Experiment(poses, ur10_camera.X, ur10_camera.W, noise, name, None, pairs)
            answer = Estimates(np.broadcast_to(ur10_camera.X, (m, 4, 4)), np.ones(m, dtype=bool), None)
            if name != TRUTH:
                try:
                    answer = estimates(problem, robot[:m], camera[:m], False)
                except DegenerateMotionError:  # not even without noise
                    answer = answer._replace(ok=np.zeros(m, dtype=bool))
            errors = error62(motions.A[:m], motions.B[:m], answer.X)
            parts[name].append(Draws(errors, errors_of(problem, answer).errors, answer.ok))
        done += len(robot)
    return {
        name: Draws(*(np.concatenate(column) for column in zip(*found, strict=True))) for name, found in parts.items()
    }


def rms(lengths: Array) -> tuple[float, float]:
    """Root mean square with its standard error."""
    squares = lengths**2
    root = float(np.sqrt(squares.mean()))
    return root, float(squares.std() / np.sqrt(len(squares)) / (2 * root)) if root > 0 else 0.0


def accuracy(full: bool) -> pd.DataFrame:
    rows = []
    sizes = SIZES if full else (224, 342, 500)
    with progress_bar("tables 2 and 3", len(SEQUENCES) * len(sizes), "cells") as advance:
        for sequence, (sampling, late) in SEQUENCES.items():
            count = 2 if late else 100 if full else 8
            for N in sizes:
                poses = ur10_camera.recording(N, sampling, late)
                noise = ur10_camera.noise_of(poses)
                found = attempt(poses, noise, count)
                reference = found["4dpa"]
                for name, (errors, xi, ok) in found.items():
                    row = {"sequence": sequence, "N": N, "method": name, "draws": len(ok), "failed": int((~ok).sum())}
                    if ok.any():
                        both = ok & reference.ok[: len(ok)]
                        ratio = errors[both] / reference.error62[: len(ok)][both]
                        turn, turn_error = rms(1e3 * np.linalg.norm(xi[ok, :3], axis=1))
                        shift, shift_error = rms(1e3 * np.linalg.norm(xi[ok, 3:], axis=1))
                        row |= {
                            "error62": float(errors[ok].mean()),
                            "error62_low": float(np.quantile(errors[ok], 0.05)),
                            "error62_high": float(np.quantile(errors[ok], 0.95)),
                            "error62_over_4dpa": float(ratio.mean()),
                            "rotation_mrad": turn,
                            "rotation_se_mrad": turn_error,
                            "rotation_bias_mrad": 1e3 * float(np.linalg.norm(xi[ok, :3].mean(axis=0))),
                            "translation_mm": shift,
                            "translation_se_mm": shift_error,
                            "translation_bias_mm": 1e3 * float(np.linalg.norm(xi[ok, 3:].mean(axis=0))),
                        }
                    rows.append(row)
                if not late:
                    exact = uq.PosePairs(poses.robot, poses.camera)
                    variance = 1e6 * np.diag(uq.bound(exact, noise, ur10_camera.X))
                    limits = np.sqrt([variance[:3].sum(), variance[3:].sum()])
                    rows.append(
                        {"sequence": sequence, "N": N, "method": BOUND, "draws": 0, "failed": 0}
                        | {"rotation_mrad": limits[0], "translation_mm": limits[1]}
                    )
                advance(1)
    return pd.DataFrame(rows)


def calls(poses: uq.PosePairs, noise: uq.PoseNoise) -> dict[str, Callable[[], object]]:
    """Return the calls to time: from motions to X; `efficient` from poses, with its covariance."""
    motions = uq.relative_motions(poses)
    weights = noise_of_pairs(motions, noise)
    A, B = motions.A, motions.B

    def of(name: str) -> Callable[[], object]:
        method = uq.METHODS[name]
        return lambda: method.estimate(A, B, weights if method.weighted else None)

    table = {name: of(name) for name in METHODS if name != "efficient"}
    return table | {PAPER_SCALE: lambda: uq.solve(A, B, scale=1e4), "efficient": lambda: uq.efficient(poses, noise)}


def times(full: bool) -> pd.DataFrame:
    rows = []
    for N in SIZES if full else (224, 342, 500):
        exact = ur10_camera.recording(N, "longer")
        noise = ur10_camera.noise_of(exact)
        robot, camera = next(drawn(exact, noise, 1))
        timed = calls(uq.PosePairs(robot[0], camera[0]), noise)
        taken: dict[str, list[float]] = {name: [] for name in timed}
        repeats = 31 if full else 3
        for call in timed.values():
            call()
        for repeat in range(repeats):
            for name, call in timed.items():
                if repeat >= 7 and name in SLOW:
                    continue
                started = time.process_time()
                call()
                taken[name].append(1e3 * (time.process_time() - started))
        reference = min(taken["4dpa"])
        for name, values in taken.items():
            ms = min(values)
            rows.append({"N": N, "method": name, "repeats": len(values), "ms": ms, "over_4dpa": ms / reference})
    return pd.DataFrame(rows)


class Recording(NamedTuple):
    folder: str
    sizes: tuple[int, ...]
    inverted: bool = False  # the file holds target_T_camera of an eye-to-hand set


REAL = (
    Recording("kuka_1", (15, 22, 29)),
    Recording("synthetic_camera_2", (9, 13, 18)),
    Recording("nguyen_pham", (*SIZES[:-1], 499), inverted=True),
    Recording("ethz_robot_arm_sync", SIZES),
)
DEFECTIVE = "wu_2019_as_published"


def read(root: Path, folder: str, inverted: bool = False) -> uq.PosePairs:
    poses = uq.read_poses(root / folder / "robot.csv", root / folder / "camera.csv")
    return uq.PosePairs(poses.robot, inverse(poses.camera), "eye-to-hand") if inverted else poses


def solved(poses: uq.PosePairs, motions: uq.Motions, name: str) -> tuple[Array | None, str]:
    """X and "converged", or None and why not."""
    try:
        if name == "efficient":
            noise = uq.estimate_noise(poses).noise
            assert noise is not None  # real data do not fit exactly
            return uq.efficient(poses, noise).X, "converged"
        answer = uq.METHODS[name].estimate(motions.A, motions.B)
    except (uq.DegenerateMotionError, uq.InputError) as refusal:
        return None, "refused: " + str(refusal).partition(":")[0]
    return (answer.X, "converged") if answer.converged else (None, "not converged")


def real(root: Path, full: bool) -> pd.DataFrame:
    """(62) of the first N consecutive motions of every recording; against the truth where one is published."""
    rows = []
    for folder, sizes, inverted in REAL:
        if not (root / folder).exists():
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)
            everything = read(root, folder, inverted)
            truth_file = root / folder / "truth.csv"
            truth = uq.read_stream(truth_file, "robot").poses[0] if truth_file.exists() else None
            for N in sizes if full else sizes[-1:]:
                poses = uq.PosePairs(everything.robot[: N + 1], everything.camera[: N + 1], everything.setup)
                motions = uq.relative_motions(poses)
                for name in METHODS:
                    X, status = solved(poses, motions, name)
                    row = {"data": folder, "N": N, "method": name, "status": status}
                    if X is not None:
                        row["error62"] = float(error62(motions.A, motions.B, X))
                        if truth is not None:
                            row["translation_mm"] = 1e3 * float(np.linalg.norm(X[:3, 3] - truth[:3, 3]))
                    rows.append(row)
    return pd.DataFrame(rows)


def verdict(root: Path) -> pd.DataFrame:
    """Tabulate what the toolkit says of the recording as published."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            uq.calibrate(read(root, DEFECTIVE), method="4dpa")
            said = "flagged" if caught else "accepted"
        except DegenerateMotionError:
            said = "refused"
    return pd.DataFrame([{"data": DEFECTIVE, "verdict": said, "warnings": len(caught)}])


def recordings(full: bool) -> Tables:
    """Return the tables of the folder that UQ_HANDEYE_DATA names; no tables without one."""
    folder = os.environ.get("UQ_HANDEYE_DATA")
    if not folder:
        return {}
    root, tables = Path(folder), {}
    if not root.is_dir():
        raise uq.InputError(f"UQ_HANDEYE_DATA names {folder}, which is not a folder.")
    measured = real(root, full)
    if len(measured):
        tables["real"] = measured
    if (root / DEFECTIVE).exists():
        tables["published"] = verdict(root)
    return tables


def measure(full: bool) -> Tables:
    found = recordings(full)  # first, as they are quick and may be unreadable
    return {"paper": errors_and_times(), "accuracy": accuracy(full), "times": times(full), **found}


STUDY = Study("tables_2_3", measure, findings, figures, packages=("cvxpy",))
