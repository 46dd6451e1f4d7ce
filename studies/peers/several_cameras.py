"""Three cameras that see one board: camera 3 in camera 1 by programs for several cameras and by this toolkit.

20 poses of a 9 x 6 board, 0.2 px of noise on each corner, drawn again in each trial: 20 trials (quick: 2). Seed 48.
Every program gets the same corners; the toolkit has the robot poses as well, with 0.5 mrad and 0.3 mm of noise per
axis. Bound: least squares of all corners of all cameras with what is known of the intrinsics, started at the truth.

Each program runs in an interpreter of its own that has it, because they need OpenCV in versions that exclude each
other: --python NAME=PATH for opencv (5.0 or later), vision-calibration, multical, aniposelib and caliscope. A program
without an interpreter is skipped, and named. See docs/studies/peers.md for what to install.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.common.scores import errors, nees, true_means
from studies.common.study import Study, Tables, markdown
from studies.peers import rig_programs
from uq_handeye.core.files.atomic import write_files
from uq_handeye.core.geometry.se3 import Array, inverse, perturb
from uq_handeye.core.progress import progress_bar
from uq_handeye.core.threads import one_thread
from uq_handeye.model.camera.calibration_files import camera_files
from uq_handeye.model.camera.corners import Corners
from uq_handeye.model.camera.corners_file import corners_text
from uq_handeye.model.camera.models import MODELS

SEED, TRIALS, QUICK_TRIALS = 48, 20, 2
POSES, GRID, SQUARE_M, NOISE_PX = 20, (9, 6), 0.025, 0.2
SIZE = (1280, 960)
ROBOT_NOISE = ("0.5mrad", "0.3mm")
STATED_PX = 0.5  # standard deviation of given focal lengths and centres that are not exact
BROWN = MODELS["brown"]
# fx, fy, cx, cy, k1, k2, p1, p2, k3: the centre is 15 px from the middle of the picture.
LENS_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
LENSES = np.array([
    [1100.0, 1100.0, 651.5, 488.5, -0.10, 0.05, 3e-4, -2e-4, 0.0],
    [1090.0, 1090.0, 628.5, 488.5, -0.11, 0.06, -2e-4, 3e-4, 0.0],
    [1110.0, 1110.0, 651.5, 470.5, -0.09, 0.04, 2e-4, 2e-4, 0.0],
])  # fmt: skip
FREE_LENS = len(LENS_NAMES)
PROGRAM_TIMEOUT_S = 3600
OURS = "uq-handeye"
BOUND = "least squares of all corners"
FREE = "all intrinsics free, five coefficients"
LIMITS = {
    "intrinsics known": "Known intrinsics",
    f"f and centre known to {STATED_PX:g} px": f"Focal lengths and centres known to {STATED_PX:g} px",
    FREE: "Intrinsics from the same corners",
}
NAMES = {"opencv": "OpenCV calibrateMultiview", "vision-calibration": "vision-calibration run_rig_extrinsics"}


class Cell(NamedTuple):
    """The truth: poses, and the corners without noise."""

    points: Array  # (m, 3) on the board, m
    cameras: Array  # (3, 4, 4) camera_T_first
    boards: Array  # (n, 4, 4) first_T_board
    world_T_first: Array  # (4, 4)
    gripper_T_board: Array  # (4, 4)
    pixels: Array  # (3, n, m, 2)


def cell() -> Cell:
    """Return the cell: three fixed cameras 150 mm apart, turned towards a board 0.55 to 0.8 m away."""
    rng = np.random.default_rng(SEED)
    columns, rows = GRID
    grid = np.stack([*np.meshgrid(np.arange(columns), np.arange(rows)), np.zeros((rows, columns))], -1)
    points = np.asarray(SQUARE_M * grid.reshape(-1, 3), dtype=float)
    cameras = np.stack([_pose([0, 0, 0], [0, 0, 0]), inverse(_pose([0.02, -0.21, 0.03], [0.15, 0.01, 0.01])),
                        inverse(_pose([-0.03, -0.42, -0.02], [0.30, -0.01, 0.05]))])  # fmt: skip
    boards: list[Array] = []
    while len(boards) < POSES:
        tilt = rng.uniform(np.radians(15), np.radians(40)), rng.uniform(0, 2 * np.pi)
        R = Rotation.from_euler("z", rng.uniform(-0.6, 0.6)).as_matrix()
        R = Rotation.from_rotvec(tilt[0] * np.array([np.cos(tilt[1]), np.sin(tilt[1]), 0])).as_matrix() @ R
        T = np.eye(4)
        T[:3, :3] = R
        T[:3, 3] = rng.uniform([-0.02, -0.12, 0.55], [0.22, 0.12, 0.8]) - R @ points.mean(axis=0)
        seen = project(points, cameras, T[None], LENSES)
        if (seen > 15).all() and (seen < np.array(SIZE) - 15).all():
            boards.append(T)
    found = np.stack(boards)
    world_T_first = _pose([0.4, 2.2, 0.3], [0.9, -0.3, 0.6])
    gripper_T_board = _pose([0.2, -0.1, 0.5], [0.03, 0.02, 0.1])
    return Cell(points, cameras, found, world_T_first, gripper_T_board, project(points, cameras, found, LENSES))


def _pose(rotvec: list[float], t: list[float]) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(rotvec).as_matrix(), t
    return T


def project(points: Array, cameras: Array, boards: Array, lenses: Array) -> Array:
    """Pixels (3, n, m, 2) of points (m, 3) of boards (n, 4, 4) in the first camera, by lenses (3, 9)."""
    T = cameras[:, None] @ boards  # (3, n, 4, 4)
    x, y, z = np.moveaxis(points @ T[..., :3, :3].mT + T[..., None, :3, 3], -1, 0)
    fx, fy, cx, cy, k1, k2, p1, p2, k3 = lenses.T[..., None, None]
    x, y = x / z, y / z
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.asarray(np.stack([fx * u + cx, fy * v + cy], -1))


def least_squares(truth: Cell, pixels: Array, given: Array, sd: Array) -> tuple[Array, Array]:
    """Fit all corners by Gauss and Newton: camera 3 in camera 1 (4, 4) and its covariance (6, 6).

    ``given`` (3, 9) are the lenses and ``sd`` (9,) how well they are known: 0 exact, inf not at all.
    """
    free = np.flatnonzero(sd > 0)
    cameras, boards, lenses = truth.cameras.copy(), truth.boards.copy(), given.copy()
    lenses[:, np.isinf(sd)] = LENSES[:, np.isinf(sd)]
    views, n, size = len(cameras), len(boards), pixels[0, 0].size
    lens_at, board_at = 6 * (views - 1), 6 * (views - 1) + views * len(free)
    step = np.array([1e-6] * 6 + [1e-3] * 4 + [1e-6] * 5)
    for _ in range(20):
        J = np.zeros((views, n, size, board_at + 6 * n))
        seen = partial(project, truth.points)

        for i, axis in enumerate(np.eye(6)):
            h = step[i] * axis
            ahead, back = (seen(perturb(cameras, way * h), boards, lenses) for way in (1, -1))
            by_camera = ((ahead - back) / (2 * step[i])).reshape(views, n, size)
            ahead, back = (seen(cameras, perturb(boards, way * h), lenses) for way in (1, -1))
            by_board = ((ahead - back) / (2 * step[i])).reshape(views, n, size)
            for c in range(1, views):
                J[c, :, :, 6 * (c - 1) + i] = by_camera[c]
            for k in range(n):
                J[:, k, :, board_at + 6 * k + i] = by_board[:, k]
        for j, name in enumerate(free):
            h = step[6 + name] * np.eye(FREE_LENS)[name]
            ahead, back = (seen(cameras, boards, lenses + way * h) for way in (1, -1))
            by_lens = ((ahead - back) / (2 * step[6 + name])).reshape(views, n, size)
            for c in range(views):
                J[c, :, :, lens_at + len(free) * c + j] = by_lens[c]
        J = J.reshape(-1, J.shape[-1]) / NOISE_PX
        r = (pixels - seen(cameras, boards, lenses)).ravel() / NOISE_PX
        weight = np.zeros(J.shape[1])
        weight[lens_at:board_at] = np.tile(sd[free] ** -2.0, views)
        pull = np.zeros(J.shape[1])
        pull[lens_at:board_at] = (given - lenses)[:, free].ravel() * weight[lens_at:board_at]
        H = J.T @ J + np.diag(weight)
        d = np.asarray(np.linalg.solve(H, J.T @ r + pull), dtype=float)
        cameras[1:] = perturb(cameras[1:], d[:lens_at].reshape(-1, 6))
        lenses[:, free] += d[lens_at:board_at].reshape(views, -1)
        boards = perturb(boards, d[board_at:].reshape(-1, 6))
        if d @ H @ d < 1e-8:
            break
    else:
        raise RuntimeError("Least squares did not converge.")
    T = cameras[-1]
    at = slice(lens_at - 6, lens_at)
    D = _of_inverse(T)
    return inverse(T), D @ np.linalg.inv(H)[at, at] @ D.T


def _of_inverse(T: Array) -> Array:
    """(6, 6): error of the inverse of a pose by that of the pose."""
    h = 1e-6
    both = (errors(inverse(perturb(T, s * h * np.eye(6))), inverse(T)) for s in (1, -1))
    plus, minus = both
    return np.asarray((plus - minus).T / (2 * h))


# ----------------------------------------------------------------------------------------------- this toolkit


def _rig_file(folder: Path, truth: Cell, robot: Array, pixels: Array, intrinsics: list[str | None]) -> Path:
    """Write a rig file: folders of ``camera -o`` where no intrinsics are given, else corners with them."""
    uq.write_pose_file(folder / "robot.csv", robot, range(POSES))
    lines = ['[arms.arm]\nposes = "robot.csv"', '[targets.board]\non = "arm"']
    row = np.repeat(np.arange(POSES), len(truth.points))
    for k, (seen, given) in enumerate(zip(pixels, intrinsics, strict=True), 1):
        corners = Corners(row, np.tile(truth.points, (POSES, 1)), seen.reshape(-1, 2), image_size=SIZE)
        lines.append(f'[cameras.cam{k}]\non = "world"')
        view = f'[[views]]\ncamera = "cam{k}"\ntarget = "board"\n'
        if given is None:
            write_files(folder / f"cam{k}", camera_files(uq.calibrate_camera(corners, SIZE)))
            lines.append(f'{view}file = "cam{k}"')
        else:
            text = corners_text(corners, np.ones(len(row), dtype=bool))
            (folder / f"cam{k}.csv").write_text(text, encoding="utf-8")
            lines[-1] += f'\nintrinsics = "{given}"'
            lines.append(f'{view}corners = "cam{k}.csv"')
    path = folder / "rig.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def ours(truth: Cell, robot: Array, pixels: Array, given: Array) -> Iterator[tuple[str, Array, Array]]:
    """Yield setting, camera 3 in camera 1 and its covariance, from files as a user has them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        exact, stated = [], []
        for k, (lens, other) in enumerate(zip(LENSES, given, strict=True), 1):
            for kind, values in (
                ("exact", lens.tolist()),
                ("stated", [[x, STATED_PX] for x in other[:4]] + other[4:].tolist()),
            ):
                (folder / f"{kind}{k}.json").write_text(json.dumps(dict(zip(LENS_NAMES, values, strict=True))))
            exact.append(f"exact{k}.json,exact")
            stated.append(f"stated{k}.json")
        for setting, intrinsics in (
            ("folders of `camera -o`", [None] * len(LENSES)), ("intrinsics known", exact),
            (f"f and centre known to {STATED_PX:g} px", stated),
        ):  # fmt: skip
            rig, noise = uq.read_rig(_rig_file(folder, truth, robot, pixels, list(intrinsics)))
            pair = uq.calibrate(rig, noise=noise).relative("cam1", "cam3")
            yield setting, np.asarray(pair.pose), np.asarray(pair.covariance)


# ------------------------------------------------------------------------------------------------ other programs


def by_program(name: str, python: str, truth: Cell, draws: Array) -> tuple[str, dict[str, Array]]:
    """Return version and, by setting, camera 3 in camera 1 (draws, 4, 4) of a program in its interpreter."""
    K = np.zeros((len(LENSES), 3, 3))
    K[:, 0, 0], K[:, 1, 1], K[:, 0, 2], K[:, 1, 2] = LENSES[:, :4].T
    K[:, 2, 2] = 1
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder) / "draws.npz", Path(folder) / "found.npz"
        np.savez(
            given, pixels=draws, points=truth.points, grid=GRID, square=SQUARE_M, size=SIZE, K=K, dist=LENSES[:, 4:]
        )
        done = subprocess.run(
            [python, rig_programs.__file__, name, str(given), str(found)],
            capture_output=True, text=True, cwd=folder, timeout=PROGRAM_TIMEOUT_S, check=False,
        )  # fmt: skip
        if done.returncode:
            raise RuntimeError(f"{name} does not run in {python}:\n{done.stderr[-2000:]}")
        if done.stderr.strip():
            print(f"{name}: {done.stderr.strip()}", file=sys.stderr)
        with np.load(found) as file:
            return done.stdout.split()[-1], {key: inverse(file[key][:, -1]) for key in file}


# ------------------------------------------------------------------------------------------------------- tables


def measure(pythons: Mapping[str, str], full: bool) -> Tables:
    """Run everything; ``pythons`` has the interpreters of the programs by name."""
    trials = TRIALS if full else QUICK_TRIALS
    truth = cell()
    rng = np.random.default_rng([SEED, 1])
    draws = truth.pixels + rng.normal(0, NOISE_PX, (trials, *truth.pixels.shape))
    robot = truth.world_T_first @ truth.boards @ inverse(truth.gripper_T_board)
    robots = perturb(robot, rng.normal(0, np.repeat([0.5e-3, 0.3e-3], 3), (trials, POSES, 6)))
    givens = LENSES + np.where(np.arange(FREE_LENS) < 4, STATED_PX, 0.0) * rng.normal(size=(trials, *LENSES.shape))
    target = inverse(truth.cameras[-1])
    rows: list[dict[str, Any]] = []
    found: dict[tuple[str, str], list[tuple[Array, Array]]] = {}
    limits = {
        "intrinsics known": (np.zeros(FREE_LENS), False),
        f"f and centre known to {STATED_PX:g} px": (np.where(np.arange(FREE_LENS) < 4, STATED_PX, 0.0), True),
        FREE: (np.full(FREE_LENS, np.inf), False),
    }
    with one_thread(), progress_bar("several cameras", trials, "draws") as advance:
        for pixels, G, given in zip(draws, robots, givens, strict=True):
            for setting, (sd, drawn) in limits.items():
                one = least_squares(truth, pixels, given if drawn else LENSES, sd)
                found.setdefault((BOUND, setting), []).append(one)
            for setting, T, S in ours(truth, G, pixels, given):
                found.setdefault((OURS, setting), []).append((T, S))
            advance(1)
    versions = {BOUND: "", OURS: uq.__version__}
    for (program, setting), results in found.items():
        T, S = (np.stack(part) for part in zip(*results, strict=True))
        rows.append(_row(program, versions[program], setting, T, target, S))
    for name in rig_programs.PROGRAMS:
        if name not in pythons:
            print(f"{name} is skipped: no interpreter (--python {name}=PATH).", file=sys.stderr)
            continue
        version, of = by_program(name, pythons[name], truth, draws)
        rows += [_row(NAMES.get(name, name), version, setting, T, target) for setting, T in of.items()]
    order = {BOUND: 0, OURS: 2}
    rows.sort(key=lambda row: order.get(row["program"], 1))
    return {"cameras": pd.DataFrame(rows)}


def _row(program: str, version: str, setting: str, T: Array, target: Array, S: Array | None = None) -> dict[str, Any]:
    """rms of the length of both parts of the error, and what the program states for it."""
    good = np.isfinite(T).all(axis=(1, 2))
    e = errors(T[good], target)
    mrad, mm = 1e3 * np.sqrt(np.sum(e.reshape(-1, 2, 3) ** 2, axis=2).mean(axis=0))
    row = {"program": program, "version": version, "setting": setting, "draws": len(T), "failed": int((~good).sum()),
           "mm": mm, "mrad": mrad}  # fmt: skip
    if S is not None:
        variances = np.diagonal(S, axis1=1, axis2=2).reshape(-1, 2, 3).sum(axis=2).mean(axis=0)
        row["stated mrad"], row["stated mm"] = 1e3 * np.sqrt(variances)
        row["NEES"] = nees(e, S[good]).mean()
    return row


def findings(tables: Tables) -> str:
    """Return the table and what follows from it."""
    rows = tables["cameras"]
    lines = []
    for row in rows.to_dict("records"):
        none = pd.isna(row["NEES"])
        lines.append([
            row["program"], row["version"], row["setting"], f"{row['mm']:.3f}", f"{row['mrad']:.3f}",
            "no" if none else f"{row['stated mm']:.3f}, {row['stated mrad']:.3f}", "" if none else f"{row['NEES']:.1f}",
            f"{row['failed']} of {row['draws']}",
        ])  # fmt: skip
    draws = int(rows.draws.max())
    low, high = true_means(draws)
    return "\n\n".join([
        f"**Camera 3 in camera 1**, {POSES} poses of a {GRID[0]} x {GRID[1]} board, {NOISE_PX:g} px; rms of the length "
        f"of the error over {draws} draws. NEES of a consistent covariance: {low:.1f} to {high:.1f} (99.9 %).",
        markdown(["program", "version", "intrinsics", "mm", "mrad", "stated mm, mrad", "NEES", "failed"], lines),
        "\n".join(f"- {line}" for line in _said(rows)),
    ])  # fmt: skip


def _said(rows: pd.DataFrame) -> Iterator[str]:
    others = rows[~rows.program.isin((BOUND, OURS))]
    bounds = rows[rows.program == BOUND].set_index("setting")
    some = rows[rows.program != BOUND]
    of = some.setting.where(some.setting.isin(bounds.index), FREE)
    for setting, words in LIMITS.items():
        each = "; ".join(
            f"{row['program']}{'' if row['setting'] == setting else ', ' + row['setting']}: "
            f"{row['mm'] / bounds.mm[setting]:.2f}, {row['mrad'] / bounds.mrad[setting]:.2f}"
            for row in some[of == setting].to_dict("records")
        )
        yield f"{words}, error over that of least squares on the same draws, position and rotation: {each or 'none'}."
    own = rows[rows.program == OURS]
    low, high = true_means(int(rows.draws.max()))
    good = own[own.NEES.between(low, high)]
    stated = "none states an uncertainty" if len(others) and others.NEES.isna().all() else "not run"
    yield (
        f"Uncertainty: of the other programs {stated}. That of this toolkit is consistent (NEES, 99.9 %) in "
        f"{len(good)} of {len(own)} settings; its stated rms is "
        + ", ".join(f"{row['stated mm'] / row['mm']:.2f}" for row in own.to_dict("records"))
        + " times the actual one (mm), "
        + ", ".join(f"{row['stated mrad'] / row['mrad']:.2f}" for row in own.to_dict("records"))
        + " times (mrad), in the order of the table."
    )


def study(pythons: Mapping[str, str]) -> Study:
    """Return the study with interpreters of the programs."""
    return Study(
        "peers.several_cameras", partial(measure, pythons), findings, lambda tables: {}, ("opencv-python-headless",)
    )


def main() -> None:
    """Read ``--python`` and run the study."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--python", action="append", default=[], metavar="NAME=PATH")
    options, rest = parser.parse_known_args()
    pythons = dict(text.split("=", 1) for text in options.python)
    if unknown := set(pythons) - set(rig_programs.PROGRAMS):
        parser.error(f"--python: no program is named {', '.join(sorted(unknown))}.")
    study(pythons).run(__doc__, rest)


if __name__ == "__main__":
    main()
