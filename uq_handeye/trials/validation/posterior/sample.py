"""Sampling of the posterior of X by Markov chain Monte Carlo, a test of the bound that does not linearise in X.

Model: `density` (likelihood of T5, flat prior on the six coordinates of X, W integrated out). For small noise its
covariance is that of the bound (`graph.bound`), not 4DPA's, which wastes information (T8). It is sampled by emcee
(Foreman-Mackey et al. 2013, doi:10.1086/670067) with the moves of `proposal`, until `convergence` finds enough
effective samples; before that nothing is reported.
"""

from __future__ import annotations

import os
import time
from contextlib import closing
from types import NoneType
from typing import Any, NamedTuple

import emcee
import numpy as np

from ....core.files.json_values import JsonObject
from ....core.geometry.checks import is_number
from ....core.geometry.frames import SETUPS
from ....errors import InputError, keywords_of, require_integer, require_known, require_type
from ....fit.graph.noise_of_data import estimate_noise
from ....model.errors.models import Noise, PairNoise, PoseNoise
from ....model.poses.motions import Motions
from ....model.poses.pose_pairs import PosePairs
from ....model.poses.timing import warn_left_out
from ...simulation.experiment import Fitted, problem_of, sides_of
from ..outcome import stated_of
from ..resumable import Run, identity_of
from . import text as text  # registers the text of a result
from .convergence import MAX_R_HAT, MIN_AUTOCORRELATION_TIMES
from .density import ScalePrior, density_of
from .result import Posterior
from .sampling import sample
from .starts import starts_of


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


class InFile(NamedTuple):
    """File that stores a chain, and the display of its progress."""

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
    walkers: int = 128,
    max_steps: int = 10_000,
    **kept: Any,
) -> Posterior:
    """Sample the posterior of X with a flat prior, until ``samples`` are effective.

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
) -> JsonObject:
    """Return what the chain depends on, except for its length."""
    more = {
        "scale prior": None if scales is None else [scales.robot, scales.camera],
        "Student-t": None if student_t is None else float(student_t),
        "seed": seed,
        "number of walkers": walkers,
        "criteria": [MIN_AUTOCORRELATION_TIMES, MAX_R_HAT],
        "version of emcee": emcee.__version__,
    }
    return identity_of(data, noise, {}, **more)
