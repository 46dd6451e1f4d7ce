r"""The posterior of X by Markov chain Monte Carlo: a test of the bound that does not linearise in X.

Model: `density` (likelihood of T5, flat prior on the six coordinates of X, W integrated out). For small noise
its covariance is that of the bound (`likelihood.bound`), not 4DPA's, which wastes information (T8). Sampled by emcee
(Foreman-Mackey et al. 2013, doi:10.1086/670067) with the moves of `moves`, until `convergence` says
that there are enough effective samples; before that nothing is reported.
"""

from __future__ import annotations

import os
import time
from contextlib import ExitStack, closing
from typing import Any

import numpy as np

from ...errors import InputError, require_integer
from ...geometry.checks import is_number
from ...geometry.frames import SETUPS
from ...noise.models import Noise, PairNoise, PoseNoise
from ...one_model.noise_of_data import estimate_noise
from ...poses.motions import Motions
from ...poses.pose_pairs import PosePairs
from ...poses.timing import warn_left_out
from ...simulation.experiment import Fitted, problem_of
from ..monte_carlo.store import sha256, sha256_of_noise
from .convergence import LENGTHS, LONGEST_R_HAT
from .density import ScalePrior, density_of
from .file import ChainFile
from .result import Posterior
from .run import sample
from .starts import starts_of

WALKERS, MAX_STEPS = 128, 10_000


def sample_posterior(
    data: PosePairs | Motions | Fitted,
    noise: Noise | None = None,
    *,
    seed: int = 0,
    samples: int = 10_000,
    scales: bool | ScalePrior | None = None,
    student_t: float | None = None,
    walkers: int = WALKERS,
    file: str | os.PathLike[str] | None = None,
    resume: bool = False,
    max_steps: int = MAX_STEPS,
    progress: bool = False,
) -> Posterior:
    """Samples of the posterior of X with a flat prior, until so many are effective.

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
    begun = time.perf_counter()
    data, noise, estimated = problem_of(data, noise)
    if not isinstance(data, PosePairs | Motions):
        raise InputError(f"Expected `data` to be PosePairs or Motions, got {type(data).__name__}.")
    if (data.robot if isinstance(data, PosePairs) else data.A).ndim != 3:
        raise InputError("Expected one data set; sample the posterior of each problem of a batch by itself.")
    warn_left_out("sample_posterior()", data)
    if noise is not None and not isinstance(noise, PoseNoise | PairNoise):
        raise InputError(f"Expected `noise` to be PoseNoise, PairNoise or None, got {type(noise).__name__}.")
    for name, value, least in (("seed", seed, 0), ("samples", samples, 100), ("max_steps", max_steps, 1)):
        require_integer(name, value, least)
    if student_t is not None and (not is_number(student_t) or not 1 <= student_t <= 1e6):
        raise InputError(
            f"Expected `student_t` to be None or degrees of freedom from 1 to 1e6, for example 5, got {student_t!r}."
        )
    if not (scales is None or isinstance(scales, bool | np.bool | ScalePrior)):
        raise InputError(f"Expected `scales` to be True, False, None or a ScalePrior, got {scales!r}.")
    if resume and file is None:
        raise InputError("resume=True needs the `file` to go on with.")
    free = scales if isinstance(scales, ScalePrior) else None
    if (not isinstance(scales, ScalePrior) and scales) or (scales is None and estimated):
        free = ScalePrior()
    model = noise
    if model is None:
        model = estimate_noise(data).noise
        if model is None:
            raise InputError("The data are exact up to rounding: there is no noise to estimate. Give `noise`.")
    poses = data if isinstance(data, PosePairs) else data.poses
    density = density_of(data, model, free, student_t)
    require_integer("walkers", walkers, max(16, 2 * density.d + 2))
    starts = starts_of(data if poses is None or isinstance(model, PairNoise) else poses, model, density)
    with ExitStack() as stack:
        kept = None
        if file is not None:
            identity = _identity(data, noise, free, student_t, seed, walkers)
            kept = stack.enter_context(closing(ChainFile(file, identity, resume)))
        steps, length = int(max_steps), int(samples)
        chain, dropped, found = sample(density, starts, int(walkers), int(seed), length, steps, kept, progress)
    result = Posterior(
        density.fit.X,
        density.fit.covariance_X,
        None if poses is None else SETUPS[poses.setup],
        density.coordinates(chain.y[dropped:]),
        chain.log_density[dropped:],
        found,
        model,
        estimated,
        free,
        None if student_t is None else float(student_t),
        int(seed),
        time.perf_counter() - begun,
        len(chain.proposal.weight),
    )
    result.require_converged()
    return result


def _identity(
    data: PosePairs | Motions,
    noise: Noise | None,
    scales: ScalePrior | None,
    student_t: float | None,
    seed: int,
    walkers: int,
) -> dict[str, Any]:
    """Return what the chain depends on, except for its length."""
    import emcee

    poses = data if isinstance(data, PosePairs) else data.poses
    arrays = {"A": data.A, "B": data.B} if isinstance(data, Motions) else {}
    if poses is not None:
        arrays |= {"robot": poses.robot, "camera": poses.camera}
    setup = None if poses is None else poses.setup
    return {
        "data": [type(data).__name__, setup, sha256(arrays)],
        "noise": "estimated" if noise is None else [type(noise).__name__, sha256_of_noise(noise)],
        "scale prior": None if scales is None else [scales.robot, scales.camera],
        "Student-t": None if student_t is None else float(student_t),
        "seed": int(seed),
        "number of walkers": int(walkers),
        "criteria": [LENGTHS, LONGEST_R_HAT],
        "version of emcee": emcee.__version__,
        "version of numpy": np.__version__,
    }
