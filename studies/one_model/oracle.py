"""Least error of X on rigs without an arm: that of an estimate to which every size is known.

    python -m studies.one_model.oracle [--sets 24]

Generalised least squares about the truth, with the standard deviations that the set was drawn from: of both sides, of a
step of the drift and of what drifts, of the wrong square. Prints, per cell, the 3-D RMS of the translation of X of this
oracle, of the oracle that leaves the drift or the square out, and of `uq.calibrate` with default settings, in mm.
"""

from __future__ import annotations

import argparse
import zlib
from typing import Any

import numpy as np

import uq_handeye as uq
from studies.one_model import rigs
from studies.one_model.chains import Array
from studies.one_model.measure import Cell
from studies.one_model.rigs import DataSet, simple_set
from studies.one_model.true_arms import left_errors
from uq_handeye.fit.graph.constraint import OnPoses, Unknowns

CELLS = ("white,15", "white,40", "drift,15", "drift,40", "wrong_square,15", "wrong_square,40")


def drawn_with_sizes(kind: str, n: int, number: int) -> tuple[DataSet, list[Array]]:
    """Draw a set of `measure` and what its sizes are: of robot and camera, before them of a step where it drifts."""
    sizes: list[Array] = []
    original = rigs._drawn_sizes

    def kept(*given: Any) -> Array:
        sizes.append(original(*given))
        return sizes[-1]

    rigs._drawn_sizes = kept  # type: ignore[assignment]
    try:
        rng = np.random.default_rng([zlib.crc32(Cell.parse(f"{kind},{n}").sets.encode()), number])
        return simple_set(kind, rng, n=n), sizes
    finally:
        rigs._drawn_sizes = original


def oracle(of: DataSet, robot: Array, camera: Array, columns: Array) -> tuple[Array, float]:
    """Error (6,) of X by least squares with known covariances, and the logarithm of their likelihood.

    ``columns`` (n, 6, m): errors of the camera's poses that are shared, per standard deviation.
    """
    linear = OnPoses(of.poses.robot, of.poses.camera, False).linearise(
        Unknowns(of.X_true, of.W_true), of.poses.robot, of.poses.camera
    )
    n = len(linear.r)
    white = sum(D @ (s[:, None] ** 2 * D.mT) for D, s in zip(linear.sides, (robot, camera), strict=True))
    V = np.zeros((n, 6, n, 6))
    V[np.arange(n), :, np.arange(n)] = white
    K = (linear.sides[1] @ columns).reshape(6 * n, -1)
    V = V.reshape(6 * n, 6 * n) + K @ K.T
    J, r = linear.J.reshape(6 * n, 12), linear.r.ravel()
    half = np.linalg.inv(np.linalg.cholesky(V))
    x, square, *_ = np.linalg.lstsq(half @ J, -half @ r)
    return np.asarray(x[:6], dtype=float), float(np.log(np.diag(half)).sum() - square[0] / 2)


def shared_columns(kind: str, of: DataSet, sizes: list[Array]) -> list[Array]:
    """Candidates of what the poses of a set share: the drift of the camera and of the target, or the square."""
    camera, n = of.poses.camera, of.poses.n
    if kind == "drift":
        walk = np.tril(np.ones((n, n)))
        walk -= walk.mean(axis=0)
        turned = np.zeros((n, 6, 6))
        turned[:, :3, :3] = turned[:, 3:, 3:] = camera[:, :3, :3]
        return [
            np.einsum("ij,iab->iajb", walk, E * sizes[0]).reshape(n, 6, -1)
            for E in (np.broadcast_to(np.eye(6), (n, 6, 6)), turned)
        ]
    if kind == "wrong_square":
        column = np.zeros((n, 6, 1))
        column[:, 3:, 0] = rigs.WRONG_SQUARE * camera[:, :3, 3]
        return [column]
    return [np.zeros((n, 6, 1))]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=24)
    sets = parser.parse_args().sets
    print("cell, RMS mm: sizes known, and without what is shared, calibrate")
    for cell in CELLS:
        kind, n = cell.split(",")
        errors = []
        for number in range(sets):
            of, sizes = drawn_with_sizes(kind, int(n), number)
            robot, camera = sizes[-2:]
            tried = [oracle(of, robot, camera, K) for K in shared_columns(kind, of, sizes)]
            left_out = oracle(of, robot, camera, np.zeros((of.poses.n, 6, 1)))
            result = uq.calibrate(of.poses)
            found = (max(tried, key=lambda one: one[1])[0], left_out[0], left_errors(of.X_true, np.asarray(result.X)))
            errors.append([1e3 * np.linalg.norm(e[3:]) for e in found])
        print(f"{cell}: " + ", ".join(f"{x:.2f}" for x in np.sqrt(np.mean(np.square(errors), axis=0))), flush=True)


if __name__ == "__main__":
    main()
