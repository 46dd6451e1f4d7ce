r"""The posterior of X by Markov chain Monte Carlo: a test of the bound that does not linearise in X.

Model: `density` (likelihood of T5, flat prior on the six coordinates of X, W integrated out). For small noise
its covariance is that of the bound (`likelihood.bound`), not 4DPA's, which wastes information (T8). Sampled by emcee
(Foreman-Mackey et al. 2013, doi:10.1086/670067) with the moves of `moves`, until `convergence` says
that there are enough effective samples; before that nothing is reported.

The loop of `sample_posterior`: burn-in that fits the proposal, rounds of steps, looks at convergence, the file.

All that decides how long a chain becomes depends on the chain only, and a file holds the state of the random numbers:
a run that was interrupted and resumed ends in the same numbers, bit by bit, as one that was not.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from types import NoneType
from typing import Any

import emcee
import numpy as np
from emcee.backends import Backend

from ....core.geometry.checks import is_number
from ....core.geometry.frames import SETUPS
from ....core.geometry.se3 import Array
from ....core.runtime.progress import working
from ....errors import InputError, keywords_of, require_integer, require_known, require_type
from ....fit.one_model.noise_of_data import estimate_noise
from ....model.noise.models import Noise, PairNoise, PoseNoise
from ....model.poses.motions import Motions
from ....model.poses.pose_pairs import PosePairs
from ....model.poses.timing import warn_left_out
from ...simulation.experiment import Fitted, problem_of, sides_of
from ..outcome import stated_of
from ..resumable import Run, identity_of
from .chain import Chain, HeldBackend, Proposal, around_maxima, chain_of, content_of, fitted, moves_of, starts_of
from .density import Density, ScalePrior, density_of
from .result import LENGTHS, LONGEST_R_HAT, Posterior, PosteriorDiagnostics, autocorrelation_time, diagnose

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
                if time.monotonic() - written > pause:
                    started = time.monotonic()
                    save()
                    written = time.monotonic()
                    pause = max(PAUSE, 10.0 * (written - started))
        finally:
            save()
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


WALKERS, MAX_STEPS = 128, 10_000


def _free_scales(scales: Any, student_t: Any, estimated: bool) -> ScalePrior | None:
    """Return what is known of the scales of the noise, None where they are held at 1; checks both arguments."""
    if student_t is not None and (not is_number(student_t) or not 1 <= student_t <= 1e6):
        raise InputError(
            f"Expected `student_t` to be None or degrees of freedom from 1 to 1e6, for example 5, got {student_t!r}."
        )
    require_type("scales", scales, (bool, np.bool, ScalePrior, NoneType), "True, False, None or a ScalePrior")
    if isinstance(scales, ScalePrior):
        return scales
    return ScalePrior() if scales or (scales is None and estimated) else None


@dataclass(frozen=True, kw_only=True)
class InFile:
    """File that keeps a chain, and what is shown of it."""

    file: str | os.PathLike[str] | None = None
    resume: bool = False
    progress: bool = False


def sample_posterior(
    data: PosePairs | Motions | Fitted,
    noise: Noise | None = None,
    *,
    seed: int = 0,
    samples: int = 10_000,
    scales: bool | ScalePrior | None = None,
    student_t: float | None = None,
    walkers: int = WALKERS,
    max_steps: int = MAX_STEPS,
    **kept: Any,
) -> Posterior:
    """Samples of the posterior of X with a flat prior, until so many are effective.

    Sampled are X, W and, where ``scales`` is free, one factor on the noise of each side. The sizes of the errors of
    `calibrate` (kinds of noise, view, target, arm, drift) are not sampled: a calibration brings its noise with the
    sizes that it found; of poses alone the noise of both sides is estimated, without errors that they share.

    Parameters
    ----------
    data : PosePairs, Motions or Calibration
        One data set (no leading axes); on poses where there are any, unless the noise is `PairNoise`. A calibration
        gives the poses and the noise that it used, in place of ``noise``.
    noise : PoseNoise, PairNoise or None
        None estimates it from the residuals (`estimate_noise`), and lets its scales be free.
    seed : int
        The same seed and data give the same samples, also where a run was interrupted and resumed.
    samples : int
        Effective samples, in bulk and tail, of every coordinate.
    scales : bool, ScalePrior or None
        Whether a factor on the standard deviations of robot and camera (A and B) is unknown, too; True is a log-normal
        prior within a factor of 3. None: where the noise is estimated.
    student_t : float or None
        Degrees of freedom nu of a heavy-tailed likelihood, against outliers; the noise is then its scale. None is
        Gaussian.
    walkers : int
        At least 16, and two more than twice the number of coordinates.
    file : path or None
        An HDF5 file that keeps the chain, an ``emcee.backends.HDFBackend``; complete at any time, also after kill -9.
    resume : bool
        Go on with the chain in the file, which must be of the same run. It may ask for more samples or steps.
    max_steps : int
        Of every walker, after burn-in.
    progress : bool
        A line on a terminal.

    Returns
    -------
    Posterior

    Raises
    ------
    InputError
        Arguments that do not fit; a file of another run or an earlier version, or that is damaged.
    DegenerateMotionError
        The data do not determine X (or W).
    NotConvergedError
        The chain has not converged in ``max_steps``; ``partial`` holds the `Posterior` with its diagnostics. Or `ml`,
        about which the chain begins, has not.

    Examples
    --------
    >>> import numpy as np, uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    >>> poses = uq.simulate(n_poses=20, noise=noise, seed=1)
    >>> posterior = sample_posterior(poses, noise, samples=4000)
    >>> bool(np.all(np.abs(posterior.std / np.sqrt(np.diag(uq.bound(poses, noise))) - 1) < 0.1))
    True
    """
    require_known("sample_posterior", kept, InFile)
    begun, given, how = time.perf_counter(), data, InFile(**kept)
    data, noise, estimated = problem_of(data, noise)
    require_type("data", data, (PosePairs, Motions), "PosePairs or Motions")
    if sides_of(data)[0].ndim != 3:
        raise InputError("Expected one data set; sample the posterior of each problem of a batch by itself.")
    warn_left_out("sample_posterior()", data)
    require_type("noise", noise, (PoseNoise, PairNoise, NoneType), "PoseNoise, PairNoise or None")
    for name, value, least in (("seed", seed, 0), ("samples", samples, 100), ("max_steps", max_steps, 1)):
        require_integer(name, value, least)
    free = _free_scales(scales, student_t, estimated)
    model = estimate_noise(data).noise if noise is None else noise
    if model is None:
        raise InputError("The data are exact up to rounding: there is no noise to estimate. Give `noise`.")
    poses = data.poses
    density = density_of(data, model, free, student_t)
    require_integer("walkers", walkers, max(16, 2 * density.d + 2))
    starts = starts_of(data if poses is None or model.ITEM == "motion" else poses, model, density)
    identity = _identity(data, noise, free, student_t, int(seed), int(walkers))
    with closing(Run(how.file, identity, how.resume, "chain", pieces=None)) as run:
        steps, length = int(max_steps), int(samples)
        chain, dropped, found = sample(density, starts, int(walkers), int(seed), length, steps, run, how.progress)
    frame = None if poses is None else SETUPS[poses.setup]
    draws = density.coordinates(chain.y[dropped:]), chain.log_density[dropped:]
    degrees = None if student_t is None else float(student_t)
    about = frame, *draws, found, model, estimated, free, degrees, int(seed), time.perf_counter() - begun
    stated = stated_of(given) if estimated else None
    result = Posterior(density.fit.X, density.fit.covariance_X, *about, len(chain.proposal.weight), stated)
    result.require_converged()
    return result


sample_posterior.__signature__ = keywords_of(sample_posterior, InFile)  # type: ignore[attr-defined]


def _identity(
    data: PosePairs | Motions,
    noise: Noise | None,
    scales: ScalePrior | None,
    student_t: float | None,
    seed: int,
    walkers: int,
) -> dict[str, Any]:
    """Return what the chain depends on, except for its length."""
    more = {
        "scale prior": None if scales is None else [scales.robot, scales.camera],
        "Student-t": None if student_t is None else float(student_t),
        "seed": seed,
        "number of walkers": walkers,
        "criteria": [LENGTHS, LONGEST_R_HAT],
        "version of emcee": emcee.__version__,
    }
    return identity_of(data, noise, {}, **more)
