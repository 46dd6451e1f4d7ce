"""The loop of `sample_posterior`: burn-in that fits the proposal, rounds of steps, looks at convergence, the file.

All that decides how long a chain becomes depends on the chain only, and a file holds the state of the random numbers:
a run that was interrupted and resumed ends in the same numbers, bit by bit, as one that was not.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import emcee
import numpy as np
from emcee.backends import Backend

from ...geometry.se3 import Array
from .convergence import LENGTHS, PosteriorDiagnostics, autocorrelation_time, diagnose
from .density import Density
from .file import Chain, ChainFile
from .moves import Proposal, around_maxima, fitted, moves_of

# Steps between two possible ends, and how much longer the chain becomes between two looks at its convergence.
ROUND, GROWTH = 20, 1.15
# Rounds of burn-in at least and at most; it ends when a round agrees with the proposal it was made with.
BURN_IN = (2, 20)
# Agreement: of means, in standard deviations, and of log standard deviations.
AGREEMENT = 0.3
# Autocorrelation times that are dropped at the beginning of the chain, after the burn-in.
DROPPED = 2
# Seconds between two writings of the file, unless writing takes more than a tenth of that.
PAUSE = 2.0

Report = Callable[[str], None]


def sample(
    density: Density,
    starts: Array,
    walkers: int,
    seed: int,
    asked: int,
    max_steps: int,
    file: ChainFile | None,
    progress: bool,
) -> tuple[Chain, int, PosteriorDiagnostics]:
    """The chain, how many of its first steps to drop, and what the rest is worth.

    Ends when the chain has converged or is ``max_steps`` long. Ctrl-C writes the file first.
    """
    with _shown(progress) as report:
        chain = None if file is None else file.load()
        state, kept = None, 0  # kept: steps that are in the file
        if chain is None:
            report("burn-in")
            state, proposal, before = burn_in(density, starts, walkers, seed)
            chain = Chain(Backend(), proposal, before) if file is None else file.begin(proposal, before)
        else:
            kept = chain.steps
        sampler = sampler_of(density, chain.proposal, walkers, chain.backend)
        written, pause = time.monotonic(), PAUSE
        try:
            if state is not None:
                sample_steps(sampler, state, min(ROUND, max_steps))
            while True:
                last = chain.steps >= max_steps
                if last or _time_to_look(chain.steps):
                    dropped, found = _judged(density, chain, asked, last)
                    if last or found.converged:
                        break
                    report(_state(chain.steps, found))
                # to a whole number of rounds
                sample_steps(sampler, None, min(ROUND - chain.steps % ROUND, max_steps - chain.steps))
                if file is not None and time.monotonic() - written > pause:
                    started = time.monotonic()
                    file.save(chain)
                    kept = chain.steps
                    written = time.monotonic()
                    pause = max(PAUSE, 10.0 * (written - started))
        finally:
            if file is not None and chain.steps > kept:
                file.save(chain)
    return chain, dropped, found


def _time_to_look(steps: int) -> bool:
    """Return whether the number of steps, in rounds, is the first beyond a power of `GROWTH`."""
    rounds, rest = divmod(steps, ROUND)
    if rest or rounds < 3:
        return False
    now, before = (int(np.log(count) / np.log(GROWTH)) for count in (rounds, rounds - 1))
    return now > before


def sampler_of(density: Density, proposal: Proposal, walkers: int, backend: Backend) -> emcee.EnsembleSampler:
    """emcee's sampler with the moves of `moves`, which goes on with what the backend holds."""
    moves = moves_of(proposal)
    return emcee.EnsembleSampler(walkers, density.d, density, moves=moves, vectorize=True, backend=backend)


def sample_steps(sampler: emcee.EnsembleSampler, state: emcee.State | None, steps: int) -> emcee.State:
    """Sample ``steps`` steps from a state, None where the sampler stands, and return the state after them; Ctrl-C
    waits for them.
    """
    with _interrupt_afterwards():  # emcee prints its arrays where the density is interrupted
        return sampler.run_mcmc(state, steps, skip_initial_state_check=True)


@contextmanager
def _interrupt_afterwards() -> Iterator[None]:
    """Ctrl-C waits for the end of the block; a round takes a moment."""
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGINT) is None:
        yield
        return
    pressed: list[Any] = []
    before = signal.signal(signal.SIGINT, lambda *arguments: pressed.append(arguments))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if pressed and callable(before):
        before(*pressed[0])


def burn_in(density: Density, starts: Array, walkers: int, seed: int) -> tuple[emcee.State, Proposal, int]:
    """The walkers after burn-in, a proposal fitted to its last round, and its steps.

    Walkers begin around the maxima that are found from ``starts`` (k, d), by their shares.
    """
    random = np.random.RandomState(np.random.MT19937(np.random.SeedSequence(seed)))
    proposal = around_maxima(density, starts)
    y = proposal.draw(random, walkers)
    log_density = density(y)
    if not np.isfinite(log_density).all():  # a wild draw of a scale: begin nearer
        centre = proposal.location[np.argmin(proposal.squares(y), axis=0)]
        y = centre + 0.1 * (y - centre)
        log_density = density(y)
    state = emcee.State(y, log_prob=log_density, random_state=random.get_state())
    for done in range(1, BURN_IN[1] + 1):
        sampler = sampler_of(density, proposal, walkers, Backend())
        state = sample_steps(sampler, state, ROUND)
        before, proposal = proposal, fitted(sampler.get_chain(flat=True), proposal)
        if done >= BURN_IN[0] and _agree(before, proposal):
            break
    return state, proposal, done * ROUND


def _agree(one: Proposal, other: Proposal) -> bool:
    """Return whether two proposals are about the same."""
    shift = np.linalg.solve(one.factor, (other.location - one.location)[..., None])
    ratio = np.linalg.svd(np.linalg.solve(one.factor, other.factor), compute_uv=False)
    return bool(np.abs(shift).max() < AGREEMENT and np.abs(np.log(ratio)).max() < AGREEMENT)


def _judged(density: Density, chain: Chain, asked: int, last: bool) -> tuple[int, PosteriorDiagnostics]:
    """The steps to drop and the diagnostics of the rest; ArviZ is asked only where the rest could be enough."""
    x = density.coordinates(chain.y)
    steps, walkers, d = x.shape
    acceptance = float(chain.backend.accepted.mean() / steps)
    tau = autocorrelation_time(x)
    unknown = bool(np.isnan(tau).any())
    dropped = 0 if unknown else min(int(np.ceil(DROPPED * tau.max())), steps // 2)
    kept = steps - dropped
    # R-hat of independent walkers is about 1 + (tau - 1) / steps
    needed = 0.0 if unknown else max(LENGTHS * tau.max(), 80.0 * (tau.max() - 1.0), 0.8 * asked * tau.max() / walkers)
    enough = not unknown and kept >= needed
    burn_in = chain.burn_in + dropped
    if enough or last:
        return dropped, diagnose(x[dropped:], density.names, acceptance, burn_in, asked)
    nothing = np.full(d, np.nan)
    return dropped, PosteriorDiagnostics(
        density.names, tau, nothing, nothing, nothing, acceptance, walkers, kept, burn_in, asked
    )


def _state(steps: int, found: PosteriorDiagnostics) -> str:
    tau = found.autocorrelation_time
    if np.isnan(tau).any():
        return f"{steps} steps"
    samples = found.steps * found.walkers / max(float(tau.max()), 1.0)
    return f"{steps} steps, about {samples:,.0f} of {found.asked:,} effective samples"


@contextmanager
def _shown(progress: bool) -> Iterator[Report]:
    """A line that says where the chain is, on a terminal."""
    if not (progress and sys.stderr.isatty()):
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status("sampling the posterior") as status:
        yield lambda text: status.update(f"sampling the posterior: {text}")
