"""Boards that are not flat: which shape is chosen, and what X and its covariance are worth with it and without.

    python -m studies.board_shape [--full] [-o results]

Simulated cameras with distortion look at a board of 14 x 9 corners, 0.46 m long, from 20 poses each (camera, X and
poses are drawn again for every set; corners have Gaussian noise, the robot little). The board is flat; or it bows by
0.3 mm from its lowest to its highest point, by a random polynomial of degree 2; or it is printed 0.2 % wider than high
as well. Every set is calibrated with ``shape="auto"`` and ``shape="flat"``. 300 sets of each kind with ``--full``, 4
without.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

import uq_handeye as uq
from studies.camera_covariance import ROBOT, SIZE, board, error, recorded
from studies.common.quantiles import quantile_figure
from studies.common.scores import true_means
from studies.common.study import Study, Tables, markdown
from uq_handeye.core.presentation.colours import BLUE, ORANGE
from uq_handeye.core.progress import progress_bar
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.model.camera.board_shape import polynomial_shape
from uq_handeye.model.camera.calibrate import calibrate_camera

SEED = 2026
SETS, FULL = 4, 300
PIXEL = 0.06
BOW, ASPECT = 3e-4, 2e-3
KINDS = {"flat": "flat", "bowed": "bows by 0.3 mm", "wide": "bows by 0.3 mm, 0.2 % wider than high"}


def bent_board(rng: np.random.Generator, kind: str) -> tuple[Any, Any]:
    """Points (m, 3) of a board as meant, and how they lie beside that."""
    points = board(14, 9, 0.035)
    bent = np.zeros_like(points)
    if kind != "flat":
        shape = polynomial_shape("bow2", points)
        bow = shape.fields[shape.rows(points)] @ rng.normal(size=3)
        bent += bow * BOW / np.ptp(bow[:, 2])
    if kind == "wide":
        middle = points.mean(axis=0)
        bent += 0.5 * ASPECT * (points - middle) * [1.0, -1.0, 0.0]
    return points, bent


def one_set(kind: str, seed: int) -> dict[str, Any]:
    """Shape that was chosen, squared distances of X and errors of one camera."""
    rng = np.random.default_rng([SEED, *map(ord, kind), seed])
    points, bent = bent_board(rng, kind)
    corners, robot, X = recorded(rng, model="brown", pixel=PIXEL, points=points, bent=bent)
    found: dict[str, Any] = {"kind": kind}
    for shape in ("auto", "flat"):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)
            seen = calibrate_camera(corners, SIZE, shape=shape)
        fit = efficient(uq.PosePairs(robot[seen.rows], seen.poses), uq.PoseNoise(ROBOT, seen.covariance))
        e = error(fit.X, X)
        found[f"{shape}_shape"] = seen.bundle.shape.name
        found[f"{shape}_d2"] = float(e @ np.linalg.solve(fit.covariance_X, e))
        found[f"{shape}_mm"] = 1e3 * float(np.linalg.norm(e[3:]))
        found[f"{shape}_sd_mm"] = 1e3 * float(np.sqrt(np.trace(fit.covariance_X[3:, 3:])))
    return found


def measure(full: bool) -> Tables:
    sets = FULL if full else SETS
    rows = []
    with progress_bar("cameras", sets * len(KINDS), "cameras") as advance:
        for kind in KINDS:
            for seed in range(sets):
                rows.append(one_set(kind, seed))
                advance(1)
    return {"sets": pd.DataFrame(rows)}


def findings(tables: Tables) -> str:
    table = tables["sets"]
    rows, shapes = [], []
    for kind, words in KINDS.items():
        part = table[table["kind"] == kind]
        for how in ("auto", "flat"):
            d2 = part[f"{how}_d2"]
            rms, sd = (float(np.sqrt((part[f"{how}_{name}"] ** 2).mean())) for name in ("mm", "sd_mm"))
            inside = 100 * (d2 <= stats.chi2.ppf(0.95, 6)).mean()
            rows.append([words, how, f"{d2.mean():.2f}", f"{inside:.1f} %", f"{rms:.3f}", f"{sd:.3f}"])
        counts = part["auto_shape"].value_counts()
        shapes.append(
            f"{words}: " + ", ".join(f"{name} {100 * count / len(part):.1f} %" for name, count in counts.items())
        )
    n = len(table) // len(KINDS)
    low, high = true_means(n)
    head = ["board", "shape", "mean NEES (6)", "truth inside the 95 % ellipsoid", "RMS error of X (mm)", "stated (mm)"]
    return (
        f"{n:,} simulated cameras of each kind, 20 pictures of a board 0.46 m long, {PIXEL} pixels. The mean NEES of a "
        f"consistent covariance lies between {low:.2f} and {high:.2f} (99.9 %).\n\n{markdown(head, rows)}\n\n"
        f"Chosen by BIC for a board that is, or is\n\n" + "\n".join(f"- {text}" for text in shapes)
    )


def figures(tables: Tables) -> Mapping[str, Any]:
    """The distribution of d^2 against chi-square, for boards that bow."""
    part = tables["sets"][tables["sets"]["kind"] == "bowed"]
    curves = [
        (part["auto_d2"], "shape of the board estimated", BLUE, "-"),
        (part["flat_d2"], "board taken as flat", ORANGE, "--"),
    ]
    return {"board_shape": quantile_figure(curves)}


STUDY = Study("board_shape", measure, findings, figures, packages=("opencv-python-headless",))
