"""Moves of an ensemble sampler by effective samples per second: basis of the mix of `validation.posterior.chain`.

Posteriors: 60 pairs with the noise (70) of the paper's section IV-C in the geometry of `studies.likelihood`, and 20
simulated poses whose noise is estimated, so that the data do not tell robot from camera: the hardest of the usual ones.
Each with a Gaussian and a Student-t likelihood (nu = 5), with and without noise scales. Seed 2019. 128 walkers begin at
draws of the fitted proposal and run until the chain is 50 autocorrelation times long and has 2,000 effective samples,
or for 4,000 steps (quick: 200 and 120 steps, the first posterior). Measured: acceptance, the longest autocorrelation
time of a coordinate (steps), effective samples of the worst coordinate (ArviZ, bulk), and these per second of sampling.
A chain that ended before 50 autocorrelation times is marked: its numbers flatter it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import emcee
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import uq_handeye as uq
from studies.common.noises import paper
from studies.common.study import Study, Tables, markdown
from studies.likelihood import draws
from uq_handeye.core.geometry.se3 import Array
from uq_handeye.core.presentation.colours import BLUE, GREEN, INK, ORANGE, PURPLE, SKY
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.core.presentation.numbers import digits
from uq_handeye.core.progress import progress_bar
from uq_handeye.fit.graph.noise_of_data import estimate_noise
from uq_handeye.trials.validation.posterior import proposal as posterior_moves
from uq_handeye.trials.validation.posterior.convergence import autocorrelation_time, by_arviz
from uq_handeye.trials.validation.posterior.density import Density, ScalePrior, density_of
from uq_handeye.trials.validation.posterior.proposal import Proposal, moves_of
from uq_handeye.trials.validation.posterior.sampling import ROUND_STEPS, burn_in, sample_steps, sampler_of

WALKERS = 128
LONG_ENOUGH = 50  # autocorrelation times
MIX = "mix of the package"
QUICK = ("60 pairs (70)",)
SEED = 2019


def alone(move: Any) -> Callable[[Proposal], Any]:
    return lambda _: move


MOVES: dict[str, Callable[[Proposal], Any]] = {
    "stretch": alone(emcee.moves.StretchMove()),
    "DE and snooker": alone([(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]),
    "walk": alone(emcee.moves.WalkMove()),
    "KDE": alone(emcee.moves.KDEMove()),
    "independence": lambda proposal: moves_of(proposal, (1.0, 0.0, 0.0)),
    MIX: moves_of,
}


def problems() -> dict[str, Density]:
    noise = paper()
    pairs = next(draws(11, "60 pairs, random", noise, 1).blocks)
    assert isinstance(pairs, uq.Motions)
    motions = uq.Motions(pairs.A[0], pairs.B[0])
    simulated = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("1mrad", "1mm"))
    poses = uq.simulate(20, noise=simulated, seed=1)
    estimated = estimate_noise(poses).noise
    assert estimated is not None
    return {
        "60 pairs (70)": density_of(motions, noise),
        "60 pairs (70), scales": density_of(motions, noise, ScalePrior()),
        "60 pairs (70), Student-t": density_of(motions, noise, None, 5.0),
        "60 pairs (70), Student-t, scales": density_of(motions, noise, ScalePrior(), 5.0),
        "20 poses": density_of(poses, estimated),
        "20 poses, noise estimated": density_of(poses, estimated, ScalePrior()),
        "20 poses, noise estimated, Student-t": density_of(poses, estimated, ScalePrior(), 5.0),
    }


def sampled(density: Density, moves: Callable[[Proposal], Any], asked: int, most: int) -> dict[str, Any]:
    state, proposal, _ = burn_in(density, np.zeros((1, density.d)), WALKERS, SEED)
    state = sample_steps(sampler_of(density, proposal, WALKERS, emcee.backends.Backend()), state, ROUND_STEPS)
    sampler = emcee.EnsembleSampler(WALKERS, density.d, density, moves=moves(proposal), vectorize=True)
    seconds, part = 0.0, 60
    while True:
        before = time.perf_counter()
        state = sampler.run_mcmc(state, part, skip_initial_state_check=True)
        seconds += time.perf_counter() - before
        chain: Array = density.coordinates(sampler.get_chain())
        steps = len(chain)
        tau = float(autocorrelation_time(chain).max())
        if steps >= most or (steps >= LONG_ENOUGH * tau and steps * WALKERS >= asked * tau):
            break
        part = min(max(steps // 4, 20), most - steps)
    ess = float(min(by_arviz(chain)[1]))
    return {
        "acceptance": float(sampler.acceptance_fraction.mean()),
        "autocorrelation_steps": tau,
        "steps": steps,
        "effective_samples": ess,
        "sampling_ms": 1e3 * seconds,
        "long_enough": bool(steps >= LONG_ENOUGH * tau),
    }


def measure(full: bool) -> Tables:
    asked, most = (2_000, 4_000) if full else (200, 120)
    chosen = {name: density for name, density in problems().items() if full or name in QUICK}
    rows = []
    with progress_bar("chains", len(chosen) * len(MOVES), "chains") as advance:
        for problem, density in chosen.items():
            for name, moves in MOVES.items():
                rows.append({"posterior": problem, "moves": name, **sampled(density, moves, asked, most)})
                advance(1)
    return {"moves": pd.DataFrame(rows)}


def per_second(table: pd.DataFrame) -> pd.Series[float]:
    """Effective samples per second as multiples of those of the stretch move, emcee's own, on the same posterior."""
    rate = table["effective_samples"] / table["sampling_ms"]
    stretch = rate.where(table["moves"] == "stretch").groupby(table["posterior"]).transform("max")
    return rate / stretch


def ratio(row: Any) -> str:
    return digits(row.ratio, 2)


def findings(tables: Tables) -> str:
    table = tables["moves"].assign(ratio=per_second(tables["moves"]))
    rows = [
        [
            row.posterior,
            row.moves,
            f"{row.acceptance:.2f}",
            f"{row.autocorrelation_steps:.1f}{'' if row.long_enough else ' (chain too short)'}",
            ratio(row),
        ]
        for row in table.itertuples()
    ]
    best = table.loc[table.groupby("posterior", sort=False)["ratio"].idxmax()]
    mix = table[table["moves"] == MIX]
    firsts = (best["moves"] == MIX).sum()
    others = table.pivot(index="posterior", columns="moves", values="ratio")
    behind = (others.max(axis=1) / others[MIX]).max()
    named = "; ".join(f"{moves} in {count}" for moves, count in best["moves"].value_counts().items())
    short = (~table["long_enough"].astype(bool)).sum()
    shares = ", ".join(f"{100 * share:g} %" for share in (moves_of.__defaults__ or ((),))[0])
    return "\n\n".join(
        [
            f"Proposal of the independence move: Student-t of {posterior_moves.PROPOSAL_DOF:g} degrees of freedom; "
            f"mix of the package: {shares} independence, "
            "differential "
            "evolution, snooker. Effective samples of the worst coordinate per second of sampling, as multiples of the "
            "stretch move's on the same posterior.",
            markdown(
                ["posterior", "moves", "acceptance", "autocorrelation time (steps)", "effective samples per second"],
                rows,
            ),
            f"The mix has at least {digits(mix['ratio'].min(), 2)} and up to {digits(mix['ratio'].max(), 2)} times the "
            f"effective samples per second of the stretch move. It is the fastest in {firsts} of {len(mix)} "
            f"posteriors (fastest: {named}) and at "
            f"most {behind:.1f} times slower than the fastest. "
            f"{short} of {len(table)} chains are shorter than {LONG_ENOUGH} autocorrelation times.",
        ]
    )


LOOKS = dict(zip(MOVES, ((PURPLE, "v"), (GREEN, "^"), (SKY, "P"), (ORANGE, "s"), (INK, "D"), (BLUE, "o")), strict=True))


def figures(tables: Tables) -> dict[str, Figure]:
    table = tables["moves"].assign(ratio=per_second(tables["moves"]))
    names = list(dict.fromkeys(table["posterior"]))
    figure = canvas(1.3 + 0.34 * len(names))
    steps, rate = figure.subplots(1, 2, sharey=True)
    for moves, (colour, marker) in LOOKS.items():
        own = table[table["moves"] == moves]
        y = np.array([names.index(name) for name in own["posterior"]])
        for axis, column in ((steps, "autocorrelation_steps"), (rate, "ratio")):
            for k, x, enough in zip(y, own[column], own["long_enough"], strict=True):
                face = colour if enough else "white"
                axis.plot(x, k, color=colour, marker=marker, markersize=5.5, linestyle="none", markerfacecolor=face)
        rate.plot([], [], color=colour, marker=marker, markersize=5.5, linestyle="none", label=moves)
    for axis, label in (
        (steps, "autocorrelation time (steps)"),
        (rate, "effective samples per second / stretch"),
    ):
        plain(axis)
        axis.set_xscale("log")
        axis.xaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_formatter("")
        axis.set_xlabel(label, fontsize=TEXT)
        axis.tick_params(axis="y", length=0)
    steps.set_ylim(len(names) - 0.5, -0.5)
    steps.set_yticks(range(len(names)), names, fontsize=SMALL)
    handles, labels = rate.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=6, fontsize=SMALL, frameon=False)
    return {"moves": finished(figure)}


STUDY = Study("posterior_moves", measure, findings, figures, packages=("emcee", "arviz-stats"))
