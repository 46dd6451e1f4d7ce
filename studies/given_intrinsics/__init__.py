"""Given intrinsics as people have them: right, half a pixel off, of another crop, inverse coefficients.

    python -m studies.given_intrinsics [--full] [-o results]

Simulated cameras look at a board of 9 x 6 corners from 20 poses each; camera, X and poses are drawn again for every
set, corners have Gaussian noise of 0.1 pixels, the robot little, which is known. The intrinsics are given by a file,
wrong in the way of each row or in the form of another program. Every set is calibrated by the command's own steps: the
file is read for the pictures, the camera is calibrated with it (the board is flat), and X is estimated. 20 sets of each
kind with ``--full`` and 200 of right ones, 1 and 2 without.
"""

from __future__ import annotations

import json
import tempfile
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

import uq_handeye as uq
from studies.camera_covariance import ROBOT, SIZE, error, recorded
from studies.common.study import Study, Tables, markdown
from uq_handeye.calibration.camera_of_result import given_test_with_robot
from uq_handeye.core.presentation.figure_parts import canvas, finished
from uq_handeye.core.progress import progress_bar
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.intrinsics_file import read_intrinsics
from uq_handeye.model.camera.models import LINEAR, MODELS
from uq_handeye.model.camera.picture_region import for_pictures

SEED = 2048
SETS, FULL = 1, 20
RIGHT, FULL_RIGHT = 2, 200
PIXEL = 0.1
# Share of right numbers that a test may blame.
MAX_BLAMED = 0.01
# Standard deviations of the right numbers of a factory, in focal lengths: those that are assumed.
FACTORY_SD = 1e-3
BROWN = ("k1", "k2", "p1", "p2", "k3")
File = dict[str, Any]


def camera_info(k: Any, d: Any, size: tuple[int, int], model: str, **more: Any) -> File:
    """A camera_info of ROS."""
    K = [k[0], 0.0, k[2], 0.0, k[1], k[3], 0.0, 0.0, 1.0]
    named = {"width": size[0], "height": size[1], "distortion_model": model}
    return named | {"k": [float(value) for value in K], "d": [float(value) for value in d]} | more


def plain(k: Any, d: Any) -> File:
    """The numbers by name."""
    return {name: float(value) for name, value in zip((*LINEAR, *BROWN), (*k, *d), strict=True)} | {"model": "brown"}


def of_region(k: Any, offset: tuple[int, int], per: int) -> Any:
    """fx, fy, cx, cy of the full picture whose part from ``offset`` on, ``per`` pixels one, is the picture of ``k``."""
    back = per * (np.asarray(k[2:]) + 0.5) - 0.5 + offset
    return np.array([per * k[0], per * k[1], *back])


def _roi(k: Any, d: Any) -> File:
    roi = {"x_offset": 320, "y_offset": 40, "width": SIZE[0], "height": SIZE[1], "do_rectify": False}
    return camera_info(of_region(k, (320, 40), 1), d, (1920, 1080), "plumb_bob", roi=roi)


def _binning(k: Any, d: Any) -> File:
    size = 2 * SIZE[0], 2 * SIZE[1]
    return camera_info(of_region(k, (0, 0), 2), d, size, "plumb_bob", binning_x=2, binning_y=2)


def _realsense(k: Any, d: Any) -> File:
    numbers = dict(zip(("fx", "fy", "ppx", "ppy"), map(float, k), strict=True)) | {"coeffs": [float(x) for x in d]}
    return {"width": SIZE[0], "height": SIZE[1], "model": "distortion.inverse_brown_conrady"} | numbers


def _resolution(k: Any, d: Any) -> File:
    return camera_info(of_region(k, (0, 0), 2), d, (2 * SIZE[0], 2 * SIZE[1]), "plumb_bob")


def _azure(k: Any, d: Any) -> File:
    """Return a file of the Azure Kinect: shares of the sensor of 4:3, counted from the corner of the first pixel."""
    shares = [(k[2] + 0.5) / SIZE[0], (k[3] + 0.5) / SIZE[1], k[0] / SIZE[0], k[1] / SIZE[1]]
    numbers = [*shares, d[0], d[1], d[4], 0, 0, 0, 0, 0, d[3], d[2]]
    model = {
        "ModelParameterCount": 14, "ModelType": "CALIBRATION_LensDistortionModelBrownConrady",
        "ModelParameters": [float(x) for x in numbers],
    }  # fmt: skip
    sensor = {"SensorWidth": SIZE[0], "SensorHeight": SIZE[1], "Location": "CALIBRATION_CameraLocationPV0"}
    return {"CalibrationInformation": {"Cameras": [sensor | {"Intrinsics": model}]}}


def _projection(k: Any, d: Any) -> File:
    """Return the matrix of the rectified picture, without distortion, in place of that of the raw one."""
    return plain([0.94 * k[0], 0.94 * k[1], k[2] + 6.0, k[3] - 4.0], np.zeros(5))


# What is given: words, the true lens, and the file of the true linear parameters and coefficients.
KINDS: dict[str, tuple[str, str, Callable[[Any, Any], File]]] = {
    "right": ("right, off by their deviations", "brown", lambda k, d: plain(k, d)),
    "half": ("half a pixel off", "brown", lambda k, d: plain(np.subtract(k, [0, 0, 0.5, 0.5]), d)),
    "half_exact": ("half a pixel off, exact, no distortion", "pinhole",
                   lambda k, d: plain(np.subtract(k, [0, 0, 0.5, 0.5]), np.zeros(5))),
    "half_barrel": ("half a pixel off, exact, k1 of -0.1 to -0.2", "brown",
                    lambda k, d: plain(np.subtract(k, [0, 0, 0.5, 0.5]), d)),
    "sign": ("offset of cx with the other sign", "brown", lambda k, d: plain([*k[:2], SIZE[0] - 1 - k[2], k[3]], d)),
    "crop": ("another crop, cy 40 px off", "brown", lambda k, d: plain(np.add(k, [0, 0, 0, 40.0]), d)),
    "inverse": ("inverse coefficients as OpenCV's", "inverse_brown", lambda k, d: plain(k, d)),
    "realsense": ("RealSense's file of inverse coefficients", "inverse_brown", _realsense),
    "roi": ("camera_info with roi", "brown", _roi),
    "binning": ("camera_info with binning", "brown", _binning),
    "resolution": ("file of twice the resolution", "brown", _resolution),
    "azure": ("Azure Kinect's file", "brown", _azure),
    "shares": ("centre in shares of the picture", "brown",
               lambda k, d: plain([*k[:2], (k[2] + 0.5) / SIZE[0], (k[3] + 0.5) / SIZE[1]], d)),
    "other_size": ("camera_info of another aspect, no roi", "brown",
                   lambda k, d: camera_info(of_region(k, (0, 32), 1), d, (1280, 1024), "plumb_bob")),
    "count": ("fisheye of five coefficients", "brown", lambda k, d: camera_info(k, d, SIZE, "equidistant")),
    "projection": ("matrix of the rectified picture", "brown", _projection),
    "tilt": ("camera_info of 14 coefficients, sensor tilted", "brown_full",
             lambda k, d: camera_info(k, d, SIZE, "rational_polynomial")),
    "tilt_cut": ("the same, cut to 8", "brown_full", lambda k, d: camera_info(k, d[:8], SIZE, "rational_polynomial")),
}  # fmt: skip
# What a finding must name for the wrong ones: a number, or a part of the reading.
NAMES = {
    "half_exact": ("half a pixel",), "half_barrel": ("half a pixel",), "sign": ("has the other sign",),
    "crop": ("another crop", "cy"), "inverse": ("inverse model",), "tilt_cut": ("cx", "cy", "p1", "p2"),
    "shares": ("cx", "cy"), "other_size": ("--roi",), "count": ("expected the 4 coefficients",),
    "projection": ("fx", "fy", "k1"),
}  # fmt: skip


def truth(rng: np.random.Generator, lens: str) -> tuple[Any, Any]:
    """fx, fy, cx, cy, off the middle by 30 pixels and more, and the coefficients of a lens."""
    f = rng.uniform(800, 1200)
    away = rng.choice([-1.0, 1.0], 2) * rng.uniform(15, 30, 2)
    k = np.array([f, f * rng.uniform(0.998, 1.002), *(0.5 * np.array(SIZE) - 0.5 + away)])
    d = np.array([rng.uniform(-0.2, -0.1), rng.uniform(0.05, 0.1), *rng.normal(0, 5e-4, 2), 0.0])
    if lens == "pinhole":
        d = d[:0]
    if lens == "inverse_brown":
        d = -d
    if lens == "brown_full":
        d = np.array([*d, *np.zeros(7), *np.radians([0.3, -0.2])])
    return k, d


def one_set(kind: str, seed: int) -> dict[str, Any]:
    """Return what is found of the numbers given, and the error of X."""
    rng = np.random.default_rng([SEED, *map(ord, kind), seed])
    _, lens, given = KINDS[kind]
    k, d = truth(rng, lens)
    names = MODELS[lens].names
    parameters = np.pad([*k, *d], (0, max(len(names) - 4 - len(d), 0)))
    corners, robot, X = recorded(rng, model=lens, pixel=PIXEL, parameters=parameters)
    stated = k + FACTORY_SD * k[0] * rng.normal(size=4) * (kind == "right")
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        path = Path(folder) / "camera.json"
        path.write_text(json.dumps(given(stated, d)), encoding="utf-8")
        try:
            known = for_pictures(read_intrinsics(path), SIZE, None, path.name)
        except uq.InputError as refusal:
            return {
                "kind": kind, "found": True, "usable": False, "named": str(refusal).removeprefix(folder),
                "right_name": any(name in str(refusal) for name in NAMES.get(kind, ())),
            }  # fmt: skip
        exact = kind in ("half_exact", "half_barrel")
        seen = calibrate_camera(
            corners, SIZE, known.model or "brown", coefficients=(), intrinsics=known.values, exact=exact, shape="flat"
        )
        poses = uq.PosePairs(robot[seen.rows], seen.poses, camera_calibration=seen)
        result = uq.calibrate(poses, noise=uq.PoseNoise(ROBOT, seen.covariance))
    best = np.nan
    if exact and seen.given is not None:
        test = given_test_with_robot(seen, efficient(poses, uq.PoseNoise(ROBOT, seen.covariance)))
        assert test is not None
        best = 0.5 * float(np.sqrt(test.precision[2:4, 2:4].sum()))
    found = [one for one in result.findings if one.code == "camera.given_contradicted"]
    text = "; ".join([*found[0].values["explanations"], *(one["name"] for one in found[0].values["contradicted"])]) if (
        found
    ) else ""  # fmt: skip
    e, S = error(result.X, X), np.asarray(result.covariance)
    return {
        "kind": kind, "found": bool(found), "usable": result.usable, "named": text,
        "right_name": bool(found) and any(name in text for name in NAMES.get(kind, ())),
        "sigma": found[0].values["sigma"] if found else 0.0,
        "best_sigma": best,
        "d2": float(e @ np.linalg.solve(S, e)),
        "deg": float(np.degrees(np.linalg.norm(e[:3]))), "mm": 1e3 * float(np.linalg.norm(e[3:])),
        "sd_deg": float(np.degrees(np.sqrt(np.trace(S[:3, :3])))),
        "sd_mm": 1e3 * float(np.sqrt(np.trace(S[3:, 3:]))),
    }  # fmt: skip


def measure(full: bool) -> Tables:
    counts = dict.fromkeys(KINDS, FULL if full else SETS) | {"right": FULL_RIGHT if full else RIGHT}
    rows = []
    with progress_bar("cameras", sum(counts.values()), "cameras") as advance:
        for kind, count in counts.items():
            for seed in range(count):
                rows.append(one_set(kind, seed))
                advance(1)
    return {"sets": pd.DataFrame(rows)}


def _with_stated(errors: pd.Series, stated: pd.Series) -> str:
    """Format RMS errors, in parentheses what was stated."""
    if errors.isna().all():
        return "-"
    return f"{np.sqrt((errors**2).mean()):.3g} ({np.sqrt((stated**2).mean()):.3g})"


def findings(tables: Tables) -> str:
    table, rows = tables["sets"], []
    limit = stats.chi2.ppf(0.95, 6)
    for kind, (words, _, _) in KINDS.items():
        part = table[table["kind"] == kind]
        n = len(part)
        named = f"{(part['right_name'] == True).sum()} of {n}" if kind in NAMES else "-"  # noqa: E712
        rms = [_with_stated(part[name], part[sd]) for name, sd in (("deg", "sd_deg"), ("mm", "sd_mm"))]
        inside = "-" if part["d2"].isna().all() else f"{100 * (part['d2'] <= limit).mean():.0f} %"
        refused = f"{n - part['usable'].sum()} of {n}"
        rows.append([words, f"{part['found'].sum()} of {n}", named, refused, inside, *rms])
    head = ["given", "contradiction found", "named", "not usable", "X inside 95 %", "X off, deg (stated)",
            "mm (stated)"]  # fmt: skip
    bounds = []
    for kind, words in (("half_exact", "without distortion"), ("half_barrel", "with barrel distortion")):
        best = table.loc[table["kind"] == kind, "best_sigma"]
        share = 100 * float(stats.norm.sf(stats.norm.isf(0.5 * MAX_BLAMED) - best).mean())
        bounds.append(f"{best.min():.1f} to {best.max():.1f} standard deviations {words}, found in {share:.0f} %")
    return (
        f"Simulated cameras, 20 pictures of a board of 9 x 6 corners, {PIXEL} pixels; RMS errors of X, in parentheses "
        f"what was stated.\n\n{markdown(head, rows)}\n\n"
        "Were half a pixel the only doubt, pictures and robot together "
        f"would show it by {'; '.join(bounds)}. That is the likelihood ratio, the best of all tests, where it blames "
        f"{100 * MAX_BLAMED:.0f} % of the right numbers."
    )


def figures(tables: Tables) -> Mapping[str, Any]:
    """The sigmas of the contradictions by kind."""
    figure = canvas(3.4)
    axes = figure.subplots()
    kinds = list(KINDS)
    for place, kind in enumerate(kinds):
        part = tables["sets"][tables["sets"]["kind"] == kind]
        axes.plot(np.maximum(part["sigma"], 1.0), np.full(len(part), place), "o", markersize=3, alpha=0.5)
    axes.set_yticks(range(len(kinds)), [KINDS[kind][0] for kind in kinds])
    axes.set_xscale("log")
    axes.axvline(3.0, color="gray", linewidth=0.8)
    axes.axvline(5.0, color="gray", linewidth=0.8, linestyle="--")
    axes.set_xlabel("contradiction (sd; 1: none)")
    return {"given_intrinsics": finished(figure)}


STUDY = Study("given_intrinsics", measure, findings, figures, packages=("opencv-python-headless",))
