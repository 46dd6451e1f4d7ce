"""The accuracy of a robot as its data sheet states it: does X lie within what is stated?

    python -m studies.robot_accuracy [--full] [-o results]

Arms of the study `kinematics`, the scales of whose errors are log-normal by a factor of 2 (`rigs`). The RMS distance
and angle between an arm and its URDF over the workspace, once base and tool are aligned, are declared exactly.
30 poses of one region, or of joints within 50 deg of home, eye-in-hand and eye-to-hand, are calibrated with that
declaration, with the defaults (an arm of unknown accuracy), and with the robot taken as exact (``shared=[]``),
correlation "none"; X is compared with that to the aligned frames.

Seed 20190. 60 arms per cell with ``--full``; quick: 1 arm of the first cell.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import uq_handeye as uq
from studies.common.scores import errors
from studies.common.study import Study, Tables, markdown
from studies.kinematics.arms import ARMS
from studies.kinematics.simulated import calibrated
from studies.robot_accuracy.rigs import PLACES, session
from uq_handeye.core.progress import progress_bar

SEED = 20190
SETUPS = ("eye-in-hand", "eye-to-hand")
WAYS = ("declared", "by default", "taken as exact")
POSES, TRIALS = 30, 60
STATED = 0.95


def measured(full: bool) -> Iterator[dict[str, object]]:
    """One row for each set and way."""
    cells = [(place, setup) for place in PLACES for setup in SETUPS][: None if full else 1]
    trials = TRIALS if full else 1
    with progress_bar("robot accuracy", len(cells) * trials, "arms") as done:
        for number, (place, setup) in enumerate(cells):
            for k in range(trials):
                arm = ARMS[k % len(ARMS)]
                of = session(arm, setup, place, POSES, np.random.default_rng([SEED, number, k]))
                about = {"where": place, "setup": setup, "arm": arm, "accuracy_mm": 1e3 * of.accuracy[0]}
                about["accuracy_deg"] = float(np.degrees(of.accuracy[1]))
                for way in WAYS:
                    shared = {"declared": [uq.SharedError.robot_accuracy(*of.accuracy)], "taken as exact": []}.get(way)
                    started = time.process_time()
                    result = calibrated(of.poses, shared=shared, correlation="none")
                    seconds = time.process_time() - started
                    line = {**about, "way": way, "refused": result is None or result.covariance is None}
                    if result is not None and result.covariance is not None:
                        e = errors(result.X, of.X)
                        d2 = float(e @ np.linalg.solve(result.covariance, e))
                        line |= {"inside": float(d2 <= result.quantile(STATED)), "d2": d2}
                        line |= {"mm": 1e3 * float(np.linalg.norm(e[3:]))}
                        line |= {"stated": 1e3 * float(np.sqrt(np.trace(result.covariance[3:, 3:])))}
                        line |= {"deg": float(np.degrees(np.linalg.norm(e[:3])))}
                    yield {**line, "cpu_s": seconds}
                done(1)


def measure(full: bool) -> Tables:
    return {"sets": pd.DataFrame(list(measured(full)))}


def cells_of(sets: pd.DataFrame) -> pd.DataFrame:
    """Over the arms of a cell."""
    found = []
    for (where, setup, way), of in sets.groupby(["where", "setup", "way"], sort=False):
        kept = of[of["refused"] == 0]
        rms = {name: float(np.sqrt(np.mean(kept[name] ** 2))) for name in ("mm", "deg", "stated")}
        found.append(
            {"where": where, "setup": setup, "way": way, "sets": len(kept), "inside": int(kept["inside"].sum())}
            | {"d2": float(kept["d2"].mean()), "seconds": float(of["cpu_s"].mean())}
            | rms
            | {"ratio": rms["stated"] / rms["mm"]}
        )
    return pd.DataFrame(found)


def findings(tables: Tables) -> str:
    sets = tables["sets"]
    cells = cells_of(sets)
    rows = [
        (c["where"], c["setup"], c["way"], f"{c['inside']} of {c['sets']}", f"{c['d2']:.1f}", f"{c['ratio']:.2f}",
         f"{c['mm']:.2f} mm", f"{c['deg']:.2f}°")
        for _, c in cells.iterrows()
    ]  # fmt: skip
    of = {way: cells[cells["way"] == way] for way in WAYS}
    inside = {way: f"{part['inside'].sum()} of {part['sets'].sum()}" for way, part in of.items()}
    exact = of["taken as exact"]["mm"].to_numpy()
    gain = {way: float(np.mean(of[way]["mm"].to_numpy() / exact)) for way in WAYS[:2]}
    seconds = {way: float(part["seconds"].mean()) for way, part in of.items()}
    return "\n\n".join(
        [
            markdown(("poses", "setup", "robot", "X inside 95 %", "mean d²", "stated over RMS", "RMS of X", ""), rows),
            f"X is inside its 95 % ellipsoid in {inside['declared']} sets with the accuracy declared, in "
            f"{inside['by default']} with nothing said, and in {inside['taken as exact']} with the robot taken as "
            f"exact; mean d² should be 6. X is off by {gain['declared']:.2f} (declared) and {gain['by default']:.2f} "
            "(nothing said) of what it is off with the robot taken as exact (RMS, mean over the rows).",
            f"Of {len(sets)} fits {int(sets['refused'].sum())} were refused as not converged. A fit takes "
            f"{seconds['declared'] / seconds['taken as exact']:.1f} and "
            f"{seconds['by default'] / seconds['taken as exact']:.1f} times the computing time of an exact robot.",
        ]
    )


def figures(tables: Tables) -> dict[str, Figure]:
    """d^2 of each set."""
    sets = tables["sets"]
    sets = sets[sets["refused"] == 0]
    figure = Figure(figsize=(6.4, 3.2), layout="constrained")
    axes = figure.subplots()
    groups = list(sets.groupby(["where", "way"], sort=False))
    for row, ((_, way), of) in enumerate(groups):
        about = np.full(len(of), row) + np.linspace(-0.2, 0.2, len(of))
        axes.plot(of["d2"], about, "o", markersize=4, color=f"C{WAYS.index(way)}")
    axes.axvline(12.59, color="0.4", linewidth=1)
    axes.set_xscale("log")
    axes.set_yticks(range(len(groups)), [f"{where},\n{way}" for (where, way), _ in groups])
    axes.set_ylim(len(groups) - 0.5, -0.5)
    axes.set_xlabel("d² of X; line: 95 % of 6 degrees of freedom")
    return {"coverage": figure}


STUDY = Study("robot_accuracy", measure, findings, figures)
