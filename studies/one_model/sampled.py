r"""The posterior of the one model by emcee, sizes and poses together, against the one integrated over the sizes.

    python -m studies.one_model.sampled [--steps 12000] [--figure FILE.svg]

One set of `ranks` (15 poses, all errors that `calibrate` assumes, their sizes drawn). The states of the chain are the
12 numbers of X and W and the logarithms of all free sizes; their density is written out by dense algebra, without the
engine: with r + J x the linear rows, D K and D B what a component of size s does to them,

    S = known + sum_c s_c^2 (D K K^T D^T + blockdiag D B B^T D^T)
    log p = -log|S| / 2 - (r + J x)^T S^-1 (r + J x) / 2 - sum ((log s - log median) / log factor)^2 / 2

What the rows share is not sampled: given the sizes it is Gaussian, and S holds it. Printed are means and standard
deviations of the chain beside those of the mixture, and how far quantiles are apart.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import emcee
import numpy as np
from matplotlib.figure import Figure
from scipy.special import ndtr

from studies.one_model.chains import Array
from studies.one_model.ranks import AXES, CELLS, drawn, model_of
from uq_handeye.core.presentation.colours import BLUE, ORANGE
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.fit.graph.engine import LatentModel
from uq_handeye.fit.graph.integration import Mixture
from uq_handeye.model.errors.columns import some_rows

SEED = 2905
# Deviations of the prior between which sizes are looked for, as by the mode; share of the diagonal against rounding.
REACH, RIDGE = 5.0, 1e-12
Density = Callable[[Array], Array]


def density_of(model: LatentModel, sides: dict[str, Array], centre: Array, unit: Array) -> Density:
    """Logarithm of the density of states (..., p + k): x in ``unit`` about ``centre``, and logarithms of the sizes.

    ``sides``: D (n, 6, 6) by side.
    """
    n, p = len(model.r), model.p
    J, r = model.J.reshape(6 * n, p), model.r.reshape(-1)
    each = []
    for part in model.components:
        D, S = sides[part.side], np.zeros((6 * n, 6 * n))
        if part.columns is not None:
            K = (D @ some_rows(part.columns, slice(None))).reshape(6 * n, -1)
            S += K @ K.T
        if part.block is not None:
            for i, B in enumerate(D @ part.block):
                S[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] += B @ B.T
        each.append(S.ravel() * (part.size.median**2 if part.size.is_known else 1.0))
    free = [not part.size.is_known for part in model.components]
    of_free, known = np.array(each)[free], np.sum(np.array(each)[np.logical_not(free)], axis=0)

    def density(states: Array) -> Array:
        x, theta = centre + unit * states[:, :p], states[:, p:]
        off = (theta - model.medians) / model.spreads
        inside = np.all(np.abs(off) < REACH, axis=1)
        theta = np.where(inside[:, None], theta, model.medians)
        S = (known + np.exp(2.0 * theta) @ of_free).reshape(-1, 6 * n, 6 * n)
        L = np.linalg.cholesky(S + RIDGE * np.diagonal(S, axis1=1, axis2=2)[:, None] * np.eye(6 * n))
        e = np.linalg.solve(L, (r + x @ J.T)[..., None])[..., 0]
        logs = np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
        found = -logs - 0.5 * (e * e).sum(axis=1) - 0.5 * (off * off).sum(axis=1)
        return np.where(inside, found, -np.inf)

    return density


def chain_of(density: Density, first: Array, steps: int, seed: int) -> tuple[Array, float]:
    """Return samples (steps, walkers, d) after a burn-in of a fifth, and effective ones of the worst coordinate."""
    moves = [(emcee.moves.DEMove(), 0.9), (emcee.moves.DESnookerMove(), 0.1)]
    sampler = emcee.EnsembleSampler(*first.shape, density, moves=moves, vectorize=True)
    sampler.random_state = np.random.RandomState(seed).get_state()
    sampler.run_mcmc(first, steps)
    chain = np.asarray(sampler.get_chain(discard=steps // 5))
    tau = sampler.get_autocorr_time(discard=steps // 5, quiet=True).max()
    return chain, chain.shape[0] * chain.shape[1] / tau


def below(mixture: Mixture, at: Array) -> Array:
    """Shares (m, p) of the mixture below errors ``at`` (m, p) of the unknown poses."""
    sd = np.sqrt(np.einsum("dii->di", mixture.covariances))
    return np.asarray(np.einsum("d,mdj->mj", mixture.weights, ndtr((at[:, None] - mixture.means) / sd)))


def figure_of(names: Sequence[str], chain: Array, curves: Sequence[Callable[[Array], Array]]) -> Figure:
    """Draw histograms of the chain (m, d) with the densities (curves) of the integrated answer."""
    rows = -(-len(names) // 6)
    figure = canvas(1.5 * rows)
    for axis, name, of, curve in zip(np.ravel(figure.subplots(rows, 6)), names, chain.T, curves, strict=False):
        plain(axis)
        low, high = np.quantile(of, [0.002, 0.998])
        at = np.linspace(low, high, 120)
        axis.hist(of, bins=40, range=(low, high), density=True, color=BLUE, alpha=0.35, linewidth=0)
        axis.plot(at, np.gradient(curve(at), at), color=ORANGE, linewidth=1.2)
        axis.set_title(name, fontsize=SMALL)
        axis.set_yticks([])
        axis.tick_params(labelsize=6)
    for axis in figure.axes[len(names) :]:
        axis.set_axis_off()
    figure.supxlabel("X: standard deviations about the mean; sizes: logarithm over the median", fontsize=TEXT)
    return finished(figure)


def main(argv: Sequence[str] | None = None) -> None:
    """Sample, print the comparison, and draw it."""
    parser = argparse.ArgumentParser(prog="python -m studies.one_model.sampled", description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=12_000)
    parser.add_argument("--walkers", type=int, default=60)
    parser.add_argument("--figure", type=Path, metavar="FILE")
    options = parser.parse_args(argv)
    rng = np.random.default_rng(SEED)
    poses, X, _, _ = drawn(CELLS["15 poses"], rng)
    source = model_of(poses)
    found = source.find(source.constraint.complete(X))
    model, mixture = found.model, found.mixture
    linear = source.constraint.linearise(found.at, source.constraint.first, source.constraint.second)
    unit = np.sqrt(np.diag(mixture.covariance))
    density = density_of(model, dict(zip(("robot", "camera"), linear.sides, strict=True)), mixture.mean, unit)
    p, k = model.p, len(model.medians)
    spread = np.sqrt(np.diag(mixture.covariance_theta))
    first = [rng.normal(size=(options.walkers, p)), mixture.mean_theta + spread * rng.normal(size=(options.walkers, k))]
    chain, effective = chain_of(density, np.concatenate(first, axis=1), options.steps, SEED)
    flat = chain.reshape(-1, p + k)
    names = [*AXES, *(model.components[number].name for number in model.free)]
    print(f"{effective:.0f} effective samples of the worst coordinate, {len(mixture.weights)} points of the mixture\n")
    print("| quantity | mean apart, in sd | sd of the chain over that stated | quantiles apart by at most |")
    print("|---|---|---|---|")
    means, sds = [*np.zeros(6), *mixture.mean_theta], [*np.ones(6), *spread]
    curves: list[Callable[[Array], Array]] = []
    columns = [*range(6), *range(p, p + k)]
    for place, column in enumerate(columns):
        of, mean, sd = flat[:, column], means[place], sds[place]

        def curve(at: Array, j: int = place, mean: float = float(mean), sd: float = float(sd)) -> Array:
            if j < 6:
                return below(mixture, mixture.mean + unit * np.asarray(at)[:, None])[:, j]
            return np.asarray(ndtr((at - mean) / sd))

        curves.append(curve)
        level = np.array([0.025, 0.16, 0.5, 0.84, 0.975])
        apart = np.abs(curve(np.quantile(of, level)) - level).max()
        apart_by, wider = (of.mean() - mean) / sd, of.std() / sd
        print(f"| {names[place]} | {apart_by:+.2f} | {wider:.2f} | {100 * apart:.1f} % |")
    if options.figure is not None:
        shown = flat[:, columns] - np.array([*np.zeros(6), *model.medians])
        moved = [
            curve if place < 6 else (lambda at, c=curve, m=model.medians[place - 6]: c(at + m))
            for place, curve in enumerate(curves)
        ]
        figure_of(names, shown, moved).savefig(options.figure)


if __name__ == "__main__":
    main()
