"""Choice of the lens from few pictures of a ChArUco board, and the error of the focal length that follows.

    python -m studies.camera_covariance.few_pictures [--sets 40] [--pictures]

Cameras with and without distortion look at 6 x 4 corners, of which each is seen with a probability of 80 %, from two to
four poses, and from 30, where lenses with more coefficients must be found. Noise of the corners: 0.15 pixels. "Right":
the board is flat, and the lens has no coefficients but those of the truth and the decentring. ``--pictures``: pictures
of a ChArUco board by a camera without distortion are drawn, with a blur of 0.7 pixels and noise of 3 grey levels, and
the corners are detected.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.camera_covariance import SIZE, board, recorded
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.corners import picked
from uq_handeye.model.camera.dictionaries import dictionary_of
from uq_handeye.model.camera.models import MODELS

SEED, PIXEL, SEEN = 2026, 0.15, 0.8
# Truth by name: model and coefficients, and those that are right to estimate.
LENSES: dict[str, tuple[str, dict[str, float], tuple[str, ...]]] = {
    "none": ("pinhole", {}, ()),
    "k1": ("brown", {"k1": -0.1, "p1": 3e-4, "p2": -2e-4}, ("k1", "k2", "p1", "p2")),
    "k1, k2": ("brown", {"k1": -0.3, "k2": 0.12, "p1": 3e-4, "p2": -2e-4}, ("k1", "k2", "p1", "p2")),
    "k1 to k3": ("brown", {"k1": -0.4, "k2": 1.0, "k3": -4.0, "p1": 3e-4}, ("k1", "k2", "p1", "p2", "k3")),
}
CASES = [*((lens, n) for lens in ("none", "k1", "k1, k2") for n in (2, 3, 4)), *((lens, 30) for lens in LENSES)]


def one(lens: str, n: int, k: int) -> tuple[bool, str, float, float]:
    """Return whether the choice is right, what it is, and the error of fx in pixels and in standard deviations."""
    model, coefficients, wanted = LENSES[lens]
    rng = np.random.default_rng([SEED, n, k, [*LENSES].index(lens)])
    f = rng.uniform(900, 1500)
    truth = {"fx": f, "fy": f, "cx": 0.5 * SIZE[0] + rng.uniform(-30, 30), "cy": 0.5 * SIZE[1] + rng.uniform(-30, 30)}
    parameters = np.array([(truth | coefficients).get(name, 0.0) for name in MODELS[model].names])
    corners, _, _ = recorded(rng, n, model=model, points=board(6, 4), pixel=PIXEL, parameters=parameters)
    found = calibrate_camera(picked(corners, rng.random(corners.m) < SEEN), SIZE)
    free = tuple(name for name in found.bundle.model.coefficients if name in found.estimated)
    off = found.intrinsics["fx"] - f
    choice = f"{found.model} {', '.join(free)}; {found.shape}"
    return free == wanted and found.shape == "flat", choice, off, off / found.std["fx"]


def row(lens: str, n: int, sets: int) -> str:
    """A line of the table."""
    right, choice, off, scaled = zip(*(one(lens, n, k) for k in range(sets)), strict=True)
    wrong = Counter(what for what, good in zip(choice, right, strict=True) if not good).most_common(1)
    median, rms, inside = np.median(np.abs(off)), np.sqrt(np.mean(np.square(off))), np.mean(np.abs(scaled) < 1.96)
    cells = lens, n, f"{np.mean(right):.0%}", f"{median:.2f}", f"{rms:.2f}", f"{inside:.0%}", *(w for w, _ in wrong)
    return f"| {' | '.join(map(str, cells))} |"


def drawn(rng: np.random.Generator, f: float, board: uq.Board) -> Any:
    """Return a picture (960, 1280) of a ChArUco board that lies askew before a camera without distortion."""
    margin, cell = 40, 120  # pixels of the print
    layout = cv2.aruco.CharucoBoard(
        (board.columns, board.rows), board.side, float(board.marker or 0.0), dictionary_of(board.dictionary)
    )
    size = (cell * board.columns + 2 * margin, cell * board.rows + 2 * margin)
    printed = layout.generateImage(size, marginSize=margin)
    metres = np.array([[1, 0, -margin], [0, 1, -margin], [0, 0, cell / board.side]]) * board.side / cell
    tilt, about = np.radians(rng.uniform(15, 40)), rng.uniform(0, 2 * np.pi)
    turn = Rotation.from_rotvec([tilt * np.cos(about), tilt * np.sin(about), 0]) * Rotation.from_rotvec(
        [0, 0, rng.uniform(-0.4, 0.4)]
    )
    middle = 0.5 * board.side * np.array([board.columns, board.rows, 0])
    at = np.array([*rng.uniform(-0.06, 0.06, 2), rng.uniform(0.3, 0.5) * f / 1200]) - turn.apply(middle)
    K = np.array([[f, 0, 0.5 * (SIZE[0] - 1)], [0, f, 0.5 * (SIZE[1] - 1)], [0, 0, 1]])
    twice = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    H = twice @ K @ np.column_stack([turn.as_matrix()[:, :2], at]) @ metres
    large = cv2.warpPerspective(printed, H, (2 * SIZE[0], 2 * SIZE[1]), flags=cv2.INTER_AREA, borderValue=200)
    small = cv2.resize(cv2.GaussianBlur(large, (0, 0), 1.4), SIZE, interpolation=cv2.INTER_AREA)
    return np.clip(small + rng.normal(scale=3.0, size=small.shape), 0, 255).astype(np.uint8)


def picture_row(n: int, sets: int) -> str:
    """A line of the table of pictures."""
    board, choices, off = uq.Board(7, 5, "30mm", kind="charuco", marker="22mm"), Counter[str](), []
    for k in range(sets):
        rng = np.random.default_rng([SEED, n, k])
        f = rng.uniform(1000, 1400)
        with TemporaryDirectory() as folder:
            for i in range(n):
                cv2.imwrite(f"{folder}/{i}.png", drawn(rng, f, board))
            found = calibrate_camera(uq.detect_board(folder, board))
        free = [name for name in found.bundle.model.coefficients if name in found.estimated]
        choices[f"{found.model} {', '.join(free)}; {found.shape}"] += 1
        off.append(100 * abs(found.intrinsics["fx"] / f - 1))
    right = choices.pop("pinhole ; flat", 0)
    wrong = (choice for choice, _ in choices.most_common(1))
    return f"| {n} | {right} of {sets} | {np.median(off):.2f} | {max(off):.2f} | {' '.join(wrong)} |"


def main() -> None:
    options = argparse.ArgumentParser(description="Which lens is chosen from few pictures.")
    options.add_argument("--sets", type=int, default=40)
    options.add_argument("--pictures", action="store_true")
    asked = options.parse_args()
    sets = asked.sets
    warnings.simplefilter("ignore", uq.InputWarning)
    if asked.pictures:
        print("| pictures | right | fx off, median (%) | largest (%) | most frequent wrong choice |")
        print("|---|---|---|---|---|")
        for n in (2, 3, 4):
            print(picture_row(n, sets), flush=True)
        return
    print("| lens | pictures | right | fx off, median (px) | RMS (px) | inside 95 % | most frequent wrong choice |")
    print("|---|---|---|---|---|---|---|")
    for lens, n in CASES:
        print(row(lens, n, sets), flush=True)


if __name__ == "__main__":
    main()
