"""Simulation-based calibration of the one model: X and the sizes of all errors, drawn from what `calibrate` assumes.

    python -m studies.one_model.ranks [--sets 200] [--cells default15 ...] [--figure FILE.svg]

Talts et al. 2018 (arXiv:1804.06788). Per set: a rig; a size of each error from its prior; the errors from their sizes;
`uq.calibrate` with default settings on the poses with these errors. Where the stated posterior is that of the model,
the share of it below the truth is uniform between 0 and 1 over the sets, for

- each of the six numbers of X (left rotation, additive translation): by the mixture over the sizes;
- d^2 of X, by `result.reference`, which sees a covariance that is too large or too small as a whole;
- the size of each error, by the log-normal whose 95 % interval is shown.

X has a flat prior: any X is like any other. Sizes are those of all errors that have a prior: noise of both sides,
noise by the view, target, view, drift of camera and target, accuracy of the arm.

Probabilities of another target (``P(|scale| > 0.3 %)``, over sizes and modes) are held against the share of sets whose
target was so wrong.

The cell that is wrong on purpose is told known sizes, half of those drawn. It must be rejected.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy import stats
from scipy.special import ndtr, ndtri

import uq_handeye as uq
from studies.one_model.chains import Array
from studies.one_model.true_arms import left_errors
from uq_handeye.calibration.by_likelihood import joint_model_of
from uq_handeye.calibration.job import job_of
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.core.presentation.colours import BLUE, GRID, INK, ORANGE, PURPLE
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.fit.graph.estimation import JointModel
from uq_handeye.fit.graph.request import Request
from uq_handeye.model.errors.columns import times
from uq_handeye.model.errors.keys import TARGET_SCALE
from uq_handeye.model.errors.sizes import Size

SEED = 2904
AXES = ("theta x", "theta y", "theta z", "tau x", "tau y", "tau z")
WRONG_SIZE = 3e-3
LEVEL = 0.001  # of the test of all quantities of a cell together


class Cell(NamedTuple):
    """Way of drawing sets, and what `calibrate` is told: known sizes, so many times those drawn; None: defaults."""

    n: int
    setup: str = "eye-in-hand"
    told: float | None = None
    wrong: bool = False


CELLS = {
    "15 poses": Cell(15),
    "30 poses": Cell(30),
    "15 poses, eye-to-hand": Cell(15, "eye-to-hand"),
    "15 poses, sizes told": Cell(15, told=1.0),
    "15 poses, sizes told half": Cell(15, told=0.5, wrong=True),
}


class Ranked(NamedTuple):
    """One set: shares of the posterior below the truth, by quantity; the target's probability and truth."""

    shares: dict[str, float]
    probability: float = 0.0
    is_wrong: bool = False


def model_of(poses: uq.PosePairs) -> JointModel:
    """Return the model that `calibrate` gives these poses."""
    job = job_of(Request(), poses)
    return joint_model_of(job, job.constraint)


def drawn(cell: Cell, rng: np.random.Generator) -> tuple[uq.PosePairs, Array, dict[str, float], float]:
    """Return poses with errors, the true X, the sizes by component, and the error of the target's scale."""
    truth = uq.simulate(cell.n, setup=cell.setup, seed=rng)
    exact = uq.PosePairs(truth.robot, truth.camera, cell.setup, timestamps=np.arange(cell.n, dtype=float))
    xi = {side: np.zeros((cell.n, 6)) for side in ("robot", "camera")}
    sizes, scale = {}, 0.0
    source = model_of(exact)
    for part in source.components:
        log = np.log(part.size.median) + (0.0 if cell.told else np.log(part.size.factor)) * rng.standard_normal()
        size = float(np.exp(log))
        sizes[part.name] = size
        if part.columns is not None:
            z = rng.standard_normal(part.count)
            xi[part.side] += size * times(part.columns, z)
            scale = sizes[part.name] * float(z[0]) if part.key == TARGET_SCALE else scale
        if part.block is not None:
            z = rng.standard_normal((cell.n, part.block.shape[-1], 1))
            xi[part.side] += size * (part.block @ z)[..., 0]
    robot, camera = perturb(exact.robot, xi["robot"]), perturb(exact.camera, xi["camera"])
    assert truth.truth is not None
    return uq.PosePairs(robot, camera, cell.setup, timestamps=exact.timestamps), truth.truth.X, sizes, scale


def ranked(cell: Cell, seed: int, number: int) -> Ranked:
    """Draw one set and calibrate it."""
    poses, X, sizes, scale = drawn(cell, np.random.default_rng([seed, number]))
    told = None if cell.told is None else {name: Size(cell.told * size) for name, size in sizes.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = uq.calibrate(poses, sizes=told)
    off = left_errors(np.asarray(result.X), X)
    assert result.covariance is not None
    found = dict(zip(AXES, _of_mixture(result, off), strict=True))
    found["d²"] = 1.0 - float(result.reference.p_value(float(off @ np.linalg.solve(result.covariance, off))))
    for part in result.components:
        if not part.known and part.high is not None:
            spread = np.log(part.high / part.low) / (2 * ndtri(0.975))
            found[part.name] = float(ndtr(np.log(sizes[part.name] / part.size) / spread))
    if cell.told is not None:
        return Ranked(found)
    source = model_of(poses)
    at = source.constraint.complete(np.asarray(result.X))
    return Ranked(found, source.find(at).probability_of(TARGET_SCALE, WRONG_SIZE), abs(scale) > WRONG_SIZE)


def _of_mixture(result: Any, off: Array) -> Array:
    """Shares (6,) of the posterior of the error of X below ``off``."""
    points = result.posterior.points
    if points is None:
        return np.asarray(ndtr(off / np.sqrt(np.diag(result.covariance))))
    L = result.posterior.A
    means = points.means @ L.T[:, :6]
    variances = np.einsum("ij,djk,ik->di", L[:6], points.covariances, L[:6])
    return np.asarray(points.weights @ ndtr((off - means) / np.sqrt(variances)))


def verdict(shares: dict[str, Array]) -> tuple[dict[str, float], bool]:
    """Return p of the Kolmogorov-Smirnov test by quantity, and whether all are uniform at `LEVEL` together."""
    p = {name: float(stats.kstest(values, "uniform").pvalue) for name, values in shares.items()}
    return p, min(p.values()) > LEVEL / len(p)


def lines(name: str, sets: Sequence[Ranked]) -> list[str]:
    """Return one row of the table, and p of each size that is not uniform."""
    kinds = [key for key in sets[0].shares if all(key in one.shares for one in sets)]
    shares = {key: np.array([one.shares[key] for one in sets]) for key in kinds}
    p, uniform = verdict({key: shares[key] for key in (*AXES, "d²")})
    sizes = [key for key in kinds if key not in p]
    least = min(AXES, key=lambda key: p[key])
    inside = 100 * np.mean(shares["d²"] <= 0.95)
    words = [name, str(len(sets)), f"{p[least]:.2g} ({least})", f"{p['d²']:.2g}", f"{inside:.0f} %"]
    words.append("yes" if uniform else "no")
    if sizes:
        covered = {key: 100 * np.mean(np.abs(shares[key] - 0.5) <= 0.475) for key in sizes}
        words.append(f"{min(covered.values()):.0f} to {max(covered.values()):.0f} %")
        expected = sum(one.probability for one in sets)
        spread = np.sqrt(sum(one.probability * (1 - one.probability) for one in sets))
        words.append(f"{expected:.1f} ± {spread:.1f}; {sum(one.is_wrong for one in sets)}")
    else:
        words += ["-", "-"]
    text = ["| " + " | ".join(words) + " |"]
    for key in sizes:
        of = stats.kstest(shares[key], "uniform").pvalue
        text.append(f"    {key}: p {of:.2g}, inside its 95 % interval {covered[key]:.0f} %")
    return text


def figure_of(found: dict[str, list[Ranked]]) -> Figure:
    """Draw the distributions of the shares less uniform, in the 99 % band of one quantity."""
    figure = canvas(2.6 * -(-len(found) // 3))
    axes = np.ravel(figure.subplots(-(-len(found) // 3), 3, sharex=True, sharey=True))
    for axis, (name, sets) in zip(axes, found.items(), strict=False):
        plain(axis)
        m = len(sets)
        at = (np.arange(m) + 0.5) / m
        half = float(stats.kstwobign.ppf(0.99)) / np.sqrt(m)
        axis.axhspan(-half, half, color=GRID, linewidth=0, label="99 % of one quantity")
        for key in sets[0].shares:
            kind = key.split()[0] if key in AXES else key if key == "d²" else "size"
            look = LOOKS[kind]
            values = np.sort([one.shares[key] for one in sets if key in one.shares])
            if len(values) == m:
                axis.plot(values, at - values, color=look[0], linestyle=look[1], linewidth=look[2], label=look[3])
        axis.set_title(name + (" (wrong on purpose)" if CELLS[name].wrong else ""), fontsize=SMALL)
    for axis in axes[len(found) :]:
        axis.set_axis_off()
    handles: dict[str, Any] = {}
    for axis in axes[: len(found)]:
        handles.update(dict(zip(*reversed(axis.get_legend_handles_labels()), strict=True)))
    axes[-1].legend(handles.values(), handles.keys(), loc="center", fontsize=SMALL, frameon=False)
    figure.supxlabel("share of the posterior below the truth", fontsize=TEXT)
    figure.supylabel("distribution of the shares less uniform", fontsize=TEXT)
    return finished(figure)


LOOKS = {
    "theta": (BLUE, "-", 0.9, "X, rotation"),
    "tau": (ORANGE, "--", 0.9, "X, translation"),
    "d²": (INK, "-", 1.7, "X together"),
    "size": (PURPLE, ":", 1.0, "sizes"),
}


def main(argv: Sequence[str] | None = None) -> None:
    """Print the table, and draw the figure."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.one_model.ranks", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--cells", nargs="+", default=list(CELLS), choices=CELLS, metavar="CELL")
    parser.add_argument("--sets", type=int, default=200)
    parser.add_argument("--figure", type=Path, metavar="FILE")
    options = parser.parse_args(argv)
    print("| " + " | ".join(COLUMNS) + " |\n" + "|---" * len(COLUMNS) + "|", flush=True)
    found = {}
    for cell in options.cells:
        found[cell] = [ranked(CELLS[cell], SEED, number) for number in range(options.sets)]
        print("\n".join(lines(cell, found[cell])), flush=True)
    if options.figure is not None:
        figure_of(found).savefig(options.figure)


COLUMNS = (
    "cell", "sets", "smallest p of X", "p of d²", "inside 95 %", "uniform", "sizes inside 95 %",
    "targets of another size: expected; drawn",
)  # fmt: skip


if __name__ == "__main__":
    main()
