"""Errors of X from rendered pictures: corners that bent edges move, and the rest after they are moved back.

    python -m studies.rendered_corners [--full] [-o results]

Cameras with distortion, their X and the poses of the robot are drawn again for every set; 15 pictures of a board of 9 x
6 corners are rendered, with blur and noise, and go all the way: detection, calibration of the camera with the model
chosen by ``auto``, X by ``efficient`` with the robot known to be exact. Each set twice: with the corners as they were
found, and with the shift that bent edges give them taken out (`camera.adjustment.bent_edges`), as is the default. 60
sets of each kind of lens with ``--full``, 1 without.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.camera_covariance import error, transforms
from studies.common.pictures import Camera, picture
from studies.common.scores import true_means
from studies.common.study import Study, Tables, markdown
from uq_handeye.core.geometry.se3 import Array, inverse
from uq_handeye.core.presentation.colours import BLUE, GRID, ORANGE
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.core.progress import progress_bar
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.model.camera.adjustment.opencv import opencv
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.corners import Corners

SEED = 12
SIZE = (640, 480)
BOARD = uq.Board(9, 6, 0.025)
PICTURES, SETS, FULL = 15, 1, 60
NOISE = 2.0  # grey levels
RIM = 12  # pixels that all corners keep from it
LENSES = {"brown": "Brown, k1 -0.2 to -0.3", "fisheye": "fisheye, f 280 to 360 pixels"}
WAYS = {"found": "as found", "moved": "moved back"}


def lens(rng: np.random.Generator, kind: str) -> Camera:
    """A camera with distortion."""
    f = rng.uniform(600, 900) if kind == "brown" else rng.uniform(280, 360)
    linear = [f, f * rng.uniform(0.995, 1.005), *(0.5 * (np.array(SIZE) - 1) + rng.uniform(-10, 10, 2))]
    if kind == "brown":
        bent = [rng.uniform(-0.3, -0.2), rng.uniform(0.02, 0.08), *rng.uniform(-5e-4, 5e-4, 2), 0, 0, 0, 0]
    else:
        bent = [rng.uniform(-0.03, 0.03), rng.uniform(-0.01, 0.01), rng.uniform(-0.003, 0.003), 0]
    return Camera(kind, np.array([*linear, *bent]), SIZE)


def views(rng: np.random.Generator, camera: Camera) -> Array:
    """camera_T_board (n, 4, 4): tilted by up to 40 degrees, rolled by up to 60, over 40 to 75 % of the picture."""
    found: list[Array] = []
    f, middle = camera.parameters[0], BOARD.points.mean(axis=0)
    while len(found) < PICTURES:
        tilt, axis = np.radians(rng.uniform(0, 40)), rng.uniform(0, 2 * np.pi)
        turn = Rotation.from_rotvec([tilt * np.cos(axis), tilt * np.sin(axis), 0.0])
        turn = turn * Rotation.from_euler("z", rng.uniform(-60, 60), degrees=True)
        away = f * np.ptp(BOARD.points[:, 0]) / (rng.uniform(0.4, 0.75) * SIZE[0])
        aside = rng.uniform(-0.25, 0.25, 2) * SIZE / f * away
        T = transforms(turn, np.array([*aside, away]) - turn.apply(middle))
        seen = camera.seen(BOARD.points, T)
        if (seen > RIM).all() and (seen < np.array(SIZE) - 1 - RIM).all():
            found.append(T)
    return np.array(found)


def rendered(seed: int, kind: str) -> tuple[Corners, Array, Array, float, float]:
    """Corners as detected, robot poses, the true X, the blur, and the RMS distance of corners from the truth."""
    rng = np.random.default_rng([SEED, seed, kind == "fisheye"])
    camera = lens(rng, kind)
    C = views(rng, camera)
    blur = float(rng.uniform(0, 1))
    with TemporaryDirectory() as folder:
        for k, T in enumerate(C):
            opencv().imwrite(f"{folder}/img{k}.png", picture(camera, BOARD, T, rng, noise=NOISE, blur=blur))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)  # of a picture without a board
            corners = uq.detect_board(folder, BOARD)
    X = transforms(Rotation.random(rng=rng), rng.normal(size=3) * 0.1)
    W = transforms(Rotation.random(rng=rng), rng.normal(size=3) * 0.5)
    truth = camera.seen(corners.points[:, None], C[corners.row])[:, 0]
    return corners, W @ inverse(X @ C), X, blur, float(np.sqrt(np.mean((corners.pixels - truth) ** 2)))


def one_set(seed: int, kind: str) -> dict[str, Any]:
    """Squared distance of X from the truth, and its error along the optical axis, either way."""
    corners, robot, X, blur, rms = rendered(seed, kind)
    row: dict[str, Any] = {"lens": kind, "seed": seed, "blur": blur, "corner_rms": rms}
    for way in WAYS:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)
            seen = calibrate_camera(corners if way == "moved" else replace(corners, window=None), SIZE)
        poses = uq.PosePairs(robot[seen.rows], seen.poses, "eye-in-hand", camera_calibration=seen)
        fit = efficient(poses, uq.PoseNoise(None, seen.covariance))
        e = error(fit.X, X)
        row[f"{way}_d2"] = float(e @ np.linalg.solve(fit.covariance_X, e))
        row[f"{way}_mm"] = 1e3 * float(np.linalg.norm(e[3:]))
        row[f"{way}_axis_um"] = 1e6 * float(X[:3, 2] @ e[3:])
        row[f"{way}_model"] = f"{seen.model}, {len(seen.estimated)} parameters, board {seen.bundle.shape.name}"
    row["largest"] = max(
        (one.values["largest"] for one in seen.findings if one.code == "camera.bent_edges"), default=0.0
    )
    return row


def measure(full: bool) -> Tables:
    sets = FULL if full else SETS
    rows = []
    with progress_bar("cameras", sets * len(LENSES), "cameras") as advance:
        for kind in LENSES:
            for seed in range(sets):
                rows.append(one_set(seed, kind))
                advance(1)
    return {"sets": pd.DataFrame(rows)}


def findings(tables: Tables) -> str:
    table = tables["sets"]
    limit = stats.chi2.ppf(0.95, 6)
    rows = []
    for kind, name in LENSES.items():
        part = table[table["lens"] == kind]
        for way, words in WAYS.items():
            d2, axis = part[f"{way}_d2"], part[f"{way}_axis_um"]
            rows.append(
                [
                    name,
                    words,
                    f"{d2.mean():.1f}",
                    f"{100 * (d2 <= limit).mean():.0f} %",
                    f"{np.sqrt((part[f'{way}_mm'] ** 2).mean()):.4f}",
                    f"{axis.mean():.1f}"
                    + (f" +- {axis.std(ddof=1) / np.sqrt(len(axis)):.1f}" if len(axis) > 1 else ""),
                ]
            )
    head = ["lens", "corners", "mean d^2 (6)", "inside 95 %", "RMS error of translation (mm)", "along the axis (um)"]
    n = len(table) // len(LENSES)
    low, high = true_means(n)
    moved = ", ".join(f"{table.loc[table['lens'] == kind, 'largest'].mean():.3f} ({kind})" for kind in LENSES)
    flat = table["moved_model"].str.endswith("flat").mean()
    return (
        f"{n} cameras of each lens, {PICTURES} pictures each; the mean d^2 of a consistent covariance lies between "
        f"{low:.2f} and {high:.2f} (99.9 %).\n\n{markdown(head, rows)}\n\n"
        f"The corners of a set were moved by at most {moved} pixels, on average over the sets. `auto` took the board "
        f"as flat, as it is, in {100 * flat:.0f} % of the sets."
    )


def figures(tables: Tables) -> Mapping[str, Any]:
    """Error of X along the optical axis, set by set."""
    figure = canvas(3.2)
    table = tables["sets"]
    axes = figure.subplots(1, len(LENSES), sharey=True)
    for axis, (kind, name) in zip(axes, LENSES.items(), strict=True):
        plain(axis)
        part = table[table["lens"] == kind].sort_values("blur")
        axis.axhline(0.0, color=GRID, linewidth=1.0)
        for way, colour, mark in (("found", ORANGE, "o"), ("moved", BLUE, "s")):
            axis.plot(part["blur"], part[f"{way}_axis_um"], mark, color=colour, markersize=3.5, label=WAYS[way])
        axis.set_xlabel("blur of the lens, pixels", fontsize=TEXT)
        axis.set_title(name, fontsize=TEXT)
    axes[0].set_ylabel("error of X along the optical axis, um", fontsize=TEXT)
    axes[0].legend(fontsize=SMALL, frameon=False, title="corners", title_fontsize=SMALL)
    return {"rendered_corners": finished(figure)}


STUDY = Study("rendered_corners", measure, findings, figures, packages=("opencv-python-headless",))
