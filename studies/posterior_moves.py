"""Which moves give most effective samples of the posterior per second: the mix of `validation.posterior_moves`.

    python -m studies.posterior_moves [--full] [--csv posterior_moves.csv]

60 pairs with the noise (70) of the paper in the geometry of studies.efficiency, and 20 simulated poses whose noise is
estimated, so that the data do not tell robot from camera: the hardest of the usual posteriors. Each with a Gaussian and
a Student-t likelihood (nu = 5), with and without noise scales. 128 walkers begin at draws of the fitted proposal, and
run until the chain is 50 autocorrelation times long and has 2,000 effective samples (``--full``: 10,000), or for 4,000
steps (20,000). Columns: acceptance, the longest autocorrelation time of a coordinate (steps), effective samples of the
worst coordinate (ArviZ, bulk), the same per second of sampling. A chain that ended before 50 autocorrelation times is
marked: its numbers flatter it.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import emcee
import numpy as np

import uq_handeye as uq
from studies.efficiency import draws, paper
from uq_handeye.noise_estimation import estimate_noise
from uq_handeye.se3 import Array
from uq_handeye.validation import posterior_moves
from uq_handeye.validation.posterior_convergence import autocorrelation_time, by_arviz
from uq_handeye.validation.posterior_density import Density, ScalePrior, density_of
from uq_handeye.validation.posterior_moves import Proposal, moves_of
from uq_handeye.validation.posterior_run import begun

WALKERS = 128
SEED = 2019


def alone(move: Any) -> Callable[[Proposal], Any]:
    return lambda _: move


MOVES: dict[str, Callable[[Proposal], Any]] = {
    "stretch": alone(emcee.moves.StretchMove()),
    "DE and snooker": alone([(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]),
    "walk": alone(emcee.moves.WalkMove()),
    "KDE": alone(emcee.moves.KDEMove()),
    "independence": lambda proposal: moves_of(proposal, (1.0, 0.0, 0.0)),
    "mix of the package": moves_of,
}


class Measured(NamedTuple):
    acceptance: float
    tau: float
    steps: int
    ess: float
    per_second: float
    long_enough: bool


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


def measure(density: Density, moves: Callable[[Proposal], Any], asked: int, most: int) -> Measured:
    start = begun(density, np.zeros((1, density.d)), WALKERS, SEED)
    sampler = emcee.EnsembleSampler(WALKERS, density.d, density, moves=moves(start.proposal), vectorize=True)
    state: Any = emcee.State(start.y[-1], log_prob=start.log_density[-1], random_state=start.random_state)
    seconds, part = 0.0, 60
    while True:
        before = time.perf_counter()
        state = sampler.run_mcmc(state, part, skip_initial_state_check=True)
        seconds += time.perf_counter() - before
        chain: Array = density.coordinates(sampler.get_chain())
        steps = len(chain)
        tau = float(autocorrelation_time(chain).max())
        if steps >= most or (steps >= 50 * tau and steps * WALKERS >= asked * tau):
            break
        part = min(max(steps // 4, 20), most - steps)
    ess = float(min(by_arviz(chain, density.names)[1]))
    return Measured(float(sampler.acceptance_fraction.mean()), tau, steps, ess, ess / seconds, bool(steps >= 50 * tau))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--full", action="store_true", help="10,000 effective samples instead of 2,000")
    parser.add_argument("--csv", default="posterior_moves.csv")
    options = parser.parse_args()
    asked, most = (10_000, 20_000) if options.full else (2_000, 4_000)
    print(f"Proposal: Student-t of {posterior_moves.DOF:g} degrees of freedom; mix {posterior_moves.SHARES}.\n")
    print("| posterior | moves | acceptance | autocorrelation time | effective samples per second |")
    print("|---|---|---|---|---|")
    with open(options.csv, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["posterior", "moves", *Measured._fields])
        for problem, density in problems().items():
            for name, moves in MOVES.items():
                found = measure(density, moves, asked, most)
                mark = "" if found.long_enough else " (chain too short)"
                print(
                    f"| {problem} | {name} | {found.acceptance:.2f} | {found.tau:.1f}{mark} "
                    f"| {found.per_second:,.0f} |",
                    flush=True,
                )
                writer.writerow([problem, name, *(f"{x:.4g}" if isinstance(x, float) else x for x in found)])


if __name__ == "__main__":
    main()
