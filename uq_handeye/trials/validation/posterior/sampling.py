"""Loop of `sample_posterior`: burn-in that fits the proposal, rounds of steps, tests of convergence, the file.

The length of a chain depends on the chain only, and the file holds the state of the random numbers: a run that was
interrupted and resumed ends in the same numbers, bit by bit, as one that was not.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import emcee
import numpy as np
from emcee.backends import Backend

from ....core.geometry.se3 import Array
from ....core.progress import working
from ..resumable import Run
from .chain import Chain, HeldBackend, chain_of, content_of
from .convergence import MIN_AUTOCORRELATION_TIMES, PosteriorDiagnostics, autocorrelation_time, diagnose
from .density import Density
from .proposal import Proposal, around_maxima, fitted, moves_of

# Steps of a round: a chain ends after whole rounds.
ROUND_STEPS = 20
# Seconds between two writings of the file, unless writing takes more than a tenth of that.
MIN_PAUSE_S = 2.0


def sample(
    density: Density, starts: Array, walkers: int, seed: int, asked: int, max_steps: int, kept: Run, progress: bool
) -> tuple[Chain, int, PosteriorDiagnostics]:
    """The chain, how many of its first steps to drop, and what the rest is worth.

    Ends when the chain has converged or is ``max_steps`` long. Ctrl-C writes the file first.
    """
    with working("sampling the posterior", progress) as report:
        chain, state, in_file = kept.load("chain", chain_of), None, 0
        if chain is not None:
            in_file = chain.steps
        else:
            report("burn-in")
            state, proposal, before = burn_in(density, starts, walkers, seed)
            chain = Chain(Backend() if kept.path is None else HeldBackend(), proposal, before)

        def save() -> None:
            nonlocal in_file
            if kept.path is not None and chain.steps > in_file:
                kept.save("chain", content_of(chain))
                in_file = chain.steps

        sampler = sampler_of(density, chain.proposal, walkers, chain.backend)
        written, pause = time.monotonic(), MIN_PAUSE_S
        try:
            if state is not None:
                sample_steps(sampler, state, min(ROUND_STEPS, max_steps))
            while True:
                last = chain.steps >= max_steps
                if last or _time_to_look(chain.steps):
                    dropped, found = _judged(density, chain, asked, last)
                    if last or found.converged:
                        break
                    report(_state(chain.steps, found))
                # to a whole number of rounds
                sample_steps(sampler, None, min(ROUND_STEPS - chain.steps % ROUND_STEPS, max_steps - chain.steps))
                if time.monotonic() - written > pause:
                    started = time.monotonic()
                    save()
                    written = time.monotonic()
                    pause = max(MIN_PAUSE_S, 10.0 * (written - started))
        finally:
            save()
    return chain, dropped, found


def _time_to_look(steps: int, growth: float = 1.15) -> bool:
    """Return whether the number of steps, in rounds, is the first beyond a power of ``growth``."""
    rounds, rest = divmod(steps, ROUND_STEPS)
    if rest or rounds < 3:
        return False
    now, before = (int(np.log(count) / np.log(growth)) for count in (rounds, rounds - 1))
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
    pressed: list[tuple[int, FrameType | None]] = []
    before = signal.signal(signal.SIGINT, lambda *arguments: pressed.append(arguments))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if pressed and callable(before):
        before(*pressed[0])


def burn_in(
    density: Density, starts: Array, walkers: int, seed: int, rounds: tuple[int, int] = (2, 20)
) -> tuple[emcee.State, Proposal, int]:
    """The walkers after burn-in, a proposal fitted to its last round, and its steps.

    Walkers begin around the maxima that are found from ``starts`` (k, d), by their shares. It ends when a round agrees
    with the proposal that it was made with, after the least and before the most ``rounds``.
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
    for done in range(1, rounds[1] + 1):
        sampler = sampler_of(density, proposal, walkers, Backend())
        state = sample_steps(sampler, state, ROUND_STEPS)
        before, proposal = proposal, fitted(sampler.get_chain(flat=True), proposal)
        if done >= rounds[0] and _agree(before, proposal):
            break
    return state, proposal, done * ROUND_STEPS


def _agree(one: Proposal, other: Proposal, tolerance: float = 0.3) -> bool:
    """Return whether two proposals are about the same: means in standard deviations, and log standard deviations."""
    shift = np.linalg.solve(one.factor, (other.location - one.location)[..., None])
    ratio = np.linalg.svd(np.linalg.solve(one.factor, other.factor), compute_uv=False)
    return bool(np.abs(shift).max() < tolerance and np.abs(np.log(ratio)).max() < tolerance)


def _judged(density: Density, chain: Chain, asked: int, last: bool) -> tuple[int, PosteriorDiagnostics]:
    """Return the steps to drop, two autocorrelation times, and the diagnostics of the rest.

    ArviZ computes them only where the rest could be enough.
    """
    x = density.coordinates(chain.y)
    steps, walkers, d = x.shape
    acceptance = float(chain.backend.accepted.mean() / steps)
    tau = autocorrelation_time(x)
    unknown = bool(np.isnan(tau).any())
    dropped = 0 if unknown else min(int(np.ceil(2 * tau.max())), steps // 2)
    kept = steps - dropped
    # R-hat of independent walkers is about 1 + (tau - 1) / steps
    needed = (
        0.0
        if unknown
        else max(MIN_AUTOCORRELATION_TIMES * tau.max(), 80.0 * (tau.max() - 1.0), 0.8 * asked * tau.max() / walkers)
    )
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
