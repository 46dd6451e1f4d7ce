"""Errors of X from grids of circles, from a chessboard of the same size in the same views, and from discs as points.

    python -m studies.circles [--full] [-o results]

A camera with a little distortion, its X and 20 poses at any roll are drawn again for every set; the robot is exact.
Each view is drawn twice, with noise: with a symmetric grid of 7 x 5 discs of 15 mm, 25 mm apart, and with a chessboard
of 7 x 5 corners, 25 mm apart, at the same place. X is estimated from the discs, as the program takes them and as
points; from the corners of this program; and from those of OpenCV's ``findChessboardCornersSB``, in the order of the
truth. 5 sets with noise of 2 and 5 with noise of 10 grey levels with ``--full``, 1 of each without.
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
from studies.common.study import Study, Tables, markdown
from uq_handeye.core.geometry.se3 import Array, inverse
from uq_handeye.core.presentation.colours import BLUE, ORANGE, PURPLE, QUIET
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.core.progress import progress_bar
from uq_handeye.fit.diagnostics.board_rotation import resolve_board_rotation
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.model.camera.adjustment.opencv import opencv
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.corners import Corners

SEED = 1548
SIZE = (640, 480)
DISCS = uq.Board(7, 5, 0.025, "circles", diameter=0.015)
SQUARES = uq.Board(7, 5, 0.025)
POSES, SETS, FULL = 20, 1, 5
LEVELS = (2.0, 10.0)  # standard deviations of the noise, grey levels
BLUR = 0.7  # pixels
SHOWN_MM = (1e-3, 1e-1)  # errors of X from discs in the figure
RIM = 20  # pixels that all points keep from it
WAYS = {
    "discs": "discs",
    "points": "discs as points",
    "corners": "corners of this program",
    "sb": "findChessboardCornersSB",
}


def lens(rng: np.random.Generator) -> Camera:
    """A camera with distortion."""
    f = rng.uniform(600, 750)
    linear = [f, f * rng.uniform(0.998, 1.002), *(0.5 * (np.array(SIZE) - 1) + rng.uniform(-10, 10, 2))]
    return Camera(
        "brown", np.array([*linear, rng.uniform(-0.1, 0.0), 0.02, *rng.uniform(-5e-4, 5e-4, 2), 0, 0, 0, 0]), SIZE
    )


def views(rng: np.random.Generator, camera: Camera) -> Array:
    """camera_T_board (n, 4, 4): tilted by up to 45 degrees, at any roll, over 30 to 55 % of the picture."""
    found: list[Array] = []
    f, middle = camera.parameters[0], DISCS.points.mean(axis=0)
    around = DISCS.points + 0.05 * (DISCS.points - middle) / np.linalg.norm(middle)
    while len(found) < POSES:
        tilt, axis = np.radians(rng.uniform(0, 45)), rng.uniform(0, 2 * np.pi)
        turn = Rotation.from_rotvec([tilt * np.cos(axis), tilt * np.sin(axis), 0.0])
        turn = turn * Rotation.from_euler("z", rng.uniform(-180, 180), degrees=True)
        away = f * np.ptp(DISCS.points[:, 0]) / (rng.uniform(0.3, 0.55) * SIZE[0])
        aside = rng.uniform(-0.2, 0.2, 2) * SIZE / f * away
        T = transforms(turn, np.array([*aside, away]) - turn.apply(middle))
        seen = camera.seen(around, T)
        if (seen > RIM).all() and (seen < np.array(SIZE) - 1 - RIM).all():
            found.append(T)
    return np.array(found)


def by_opencv(pictures: list[Any], truth: Array) -> Corners:
    """Corners of ``findChessboardCornersSB``, in the order that is nearest to the true pixels (n, m, 2)."""
    cv2 = opencv()
    rows, pixels = [], []
    for k, one in enumerate(pictures):
        ok, found = cv2.findChessboardCornersSB(one, (SQUARES.columns, SQUARES.rows), flags=cv2.CALIB_CB_ACCURACY)
        if ok:
            orders = [np.asarray(found, dtype=float).reshape(-1, 2)[::way] for way in (1, -1)]
            rows.append(k)
            pixels.append(min(orders, key=lambda order: float(np.abs(order - truth[k]).sum())))
    m = len(SQUARES.points)
    return Corners(np.repeat(rows, m), np.tile(SQUARES.points, (len(rows), 1)), np.concatenate(pixels), image_size=SIZE)


def one_set(seed: int, level: float) -> dict[str, Any]:
    """Error of X in each way, and its squared distance in its own covariance."""
    rng = np.random.default_rng([SEED, seed, int(level)])
    camera = lens(rng)
    C = views(rng, camera)
    X = transforms(Rotation.random(rng=rng), rng.normal(size=3) * 0.1)
    W = transforms(Rotation.random(rng=rng), rng.normal(size=3) * 0.5)
    robot = W @ inverse(X @ C)
    found: dict[str, Corners] = {}
    for name, board in (("discs", DISCS), ("corners", SQUARES)):
        pictures = [picture(camera, board, T, rng, noise=level, blur=BLUR) for T in C]
        with TemporaryDirectory() as folder, warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)  # half a turn cannot be seen; a picture without a board
            for k, one in enumerate(pictures):
                opencv().imwrite(f"{folder}/{k:02d}.png", one)
            found[name] = uq.detect_board(folder, board)
    found["points"] = replace(found["discs"], diameter=None)
    found["sb"] = by_opencv(pictures, camera.seen(SQUARES.points, C))
    row: dict[str, Any] = {"level": level, "seed": seed}
    for way in WAYS:
        board = DISCS if way in ("discs", "points") else SQUARES
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)
            seen = calibrate_camera(found[way], SIZE)
            pairs = uq.PosePairs(robot[seen.rows], seen.poses, "eye-in-hand", camera_calibration=seen)
            pairs = resolve_board_rotation(pairs, board)
        assert pairs.camera_calibration is not None
        fit = efficient(pairs, uq.PoseNoise(None, pairs.camera_calibration.covariance))
        e = error(fit.X, X)
        row[f"{way}_pictures"] = pairs.n
        row[f"{way}_rms"] = seen.pixel_noise
        row[f"{way}_mm"] = 1e3 * float(np.linalg.norm(e[3:]))
        row[f"{way}_mrad"] = 1e3 * float(np.linalg.norm(e[:3]))
        row[f"{way}_d2"] = float(e @ np.linalg.solve(fit.covariance_X, e))
    return row


def measure(full: bool) -> Tables:
    sets = FULL if full else SETS
    rows = []
    with progress_bar("cameras", sets * len(LEVELS), "cameras") as advance:
        for level in LEVELS:
            for seed in range(sets):
                rows.append(one_set(seed, level))
                advance(1)
    return {"sets": pd.DataFrame(rows)}


def _rms(values: pd.Series) -> float:
    return float(np.sqrt((values**2).mean()))


def findings(tables: Tables) -> str:
    table, rows = tables["sets"], []
    for level in LEVELS:
        part = table[table["level"] == level]
        for way, words in WAYS.items():
            rows.append([
                f"{level:g}", words, f"{part[f'{way}_pictures'].mean():.1f}", f"{part[f'{way}_rms'].mean():.4f}",
                f"{_rms(part[f'{way}_mm']):.4f}", f"{_rms(part[f'{way}_mrad']):.4f}",
                f"{_rms(part[f'{way}_mm']) / _rms(part['discs_mm']):.2f}", f"{part[f'{way}_d2'].mean():.1f}",
            ])  # fmt: skip
    n, limit = len(table), stats.chi2.ppf(0.9999, 6)
    right = int((table["discs_d2"] < limit).sum())
    shares = "; ".join(
        f"{level:g} levels: {_rms(part['discs_mm']) / _rms(part['sb_mm']):.2f} of the error with "
        f"findChessboardCornersSB, {_rms(part['discs_mm']) / _rms(part['corners_mm']):.2f} of that with the corners of "
        "this program"
        for level in LEVELS
        for part in [table[table["level"] == level]]
    )
    head = ["noise (grey levels)", "taken from", "pictures", "pixel noise (px)", "RMS error of X (mm)", "(mrad)",
            "times that of the discs", "mean d^2 (6)"]  # fmt: skip
    return (
        f"{n // len(LEVELS)} cameras at each noise, {POSES} pictures each.\n\n{markdown(head, rows)}\n\n"
        f"Translation of X from discs, {shares}. The order of the grid was right in {right} of {n} sets, at any roll "
        "of the camera."
    )


def figures(tables: Tables) -> Mapping[str, Any]:
    """Errors of X by discs against those by the corners of the same views."""
    figure, table = canvas(3.4), tables["sets"]
    axes = figure.subplots(1, len(LEVELS), sharey=True)
    colours = {"points": PURPLE, "corners": BLUE, "sb": ORANGE}
    for axis, level in zip(axes, LEVELS, strict=True):
        plain(axis)
        part = table[table["level"] == level]
        for way, colour in colours.items():
            axis.loglog(part["discs_mm"], part[f"{way}_mm"], "o", color=colour, markersize=3.5, label=WAYS[way])
        axis.loglog(SHOWN_MM, SHOWN_MM, color=QUIET, linewidth=0.8)
        axis.set_xlim(*SHOWN_MM)
        axis.set_xlabel("error of X from discs, mm", fontsize=TEXT)
        axis.set_title(f"noise {level:g} grey levels", fontsize=TEXT)
    axes[0].set_ylabel("error of X, mm", fontsize=TEXT)
    axes[0].legend(fontsize=SMALL, frameon=False)
    return {"circles": finished(figure)}


STUDY = Study("circles", measure, findings, figures, packages=("opencv-python-headless",))
