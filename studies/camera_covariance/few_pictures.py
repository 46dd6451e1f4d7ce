"""Choice of the lens from few pictures of a ChArUco board, and the error of the focal length that follows.

    python -m studies.camera_covariance.few_pictures [--sets 40]

Cameras with and without distortion look at 6 x 4 corners, of which each is seen with a probability of 80 %, from two to
four poses, and from 30, where lenses with more coefficients must be found. Noise of the corners: 0.15 pixels. "Right":
the board is flat, and the lens has no coefficients but those of the truth and the decentring.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter

import numpy as np

import uq_handeye as uq
from studies.camera_covariance import SIZE, board, recorded
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.corners import picked
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


def main() -> None:
    options = argparse.ArgumentParser(description="Which lens is chosen from few pictures.")
    options.add_argument("--sets", type=int, default=40)
    sets = options.parse_args().sets
    warnings.simplefilter("ignore", uq.InputWarning)
    print("| lens | pictures | right | fx off, median (px) | RMS (px) | inside 95 % | most frequent wrong choice |")
    print("|---|---|---|---|---|---|---|")
    for lens, n in CASES:
        print(row(lens, n, sets), flush=True)


if __name__ == "__main__":
    main()
