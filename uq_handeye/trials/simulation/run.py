"""Trials of any method: noise drawn on exact data, X estimated from each draw, and its error.

Trials are computed in blocks of a fixed number, so that memory is bounded and the results depend on the generator only.
4DPA on motions has its own implementation (`fourdpa_on_drawn`); every other method runs on leading batch axes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.checks import CHUNK
from ...core.geometry.se3 import Array, difference
from ...errors import InputError
from ...fit.graph.constraint import constraint_of, covariances_of
from ...fit.graph.gauss_helmert import CLOSED_FORM_STEPS, ESTIMATORS, MAX_ML_STEPS, fit_data
from ...methods.all_pairs import solve_all_pairs
from ...methods.noise_transport import covariance_of_poses
from ...methods.propagate import propagate_and_check
from ...methods.registry import METHODS, ROBOT_WORLD_METHODS
from ...methods.scaled import solve_4dpa
from ...model.errors.models import with_prior
from ...model.poses.pose_pairs import PosePairs
from .experiment import Experiment, motions_of
from .fourdpa import fourdpa_on_drawn
from .rig import disturbed

# Poses or motions of all trials of a block together, which bounds the memory.
BLOCK_POSES = 2 * CHUNK


class Trials(NamedTuple):
    """Errors ``xi = (theta, tau)`` of X in each trial; those that failed have a row of zeros and are not ``ok``."""

    errors: Array  # (m, 6)
    ok: NDArray[np.bool_]  # (m,)
    covariances: Array | None = None  # (m, 6, 6), each trial's own; identity where it is not ok


class Estimates(NamedTuple):
    """X of some trials (m, 4, 4), whether they converged, and each one's covariance (m, 6, 6) or None."""

    X: Array
    ok: NDArray[np.bool_]
    covariances: Array | None


def run(experiment: Experiment, rng: np.random.Generator, trials: int, each: bool = False) -> Trials:
    """Draw the noise ``trials`` times and run the method on each draw.

    Parameters
    ----------
    experiment : Experiment
    rng : numpy Generator
    trials : int
    each : bool
        Also the first-order covariance that each trial would report of itself.

    Returns
    -------
    Trials

    Raises
    ------
    InputError
        The method cannot be run on such data at all, or has no covariance.
    """
    noise = experiment.noise
    if experiment.plain_motions and noise.prior is None and not each:
        return Trials(*fourdpa_on_drawn(*experiment.sides, experiment.X, noise, rng, trials))  # type: ignore[arg-type]
    step = max(1, BLOCK_POSES // experiment.size)
    parts = []
    for first in range(0, trials, step):
        problem, batch = experiment, (min(step, trials - first),)
        if noise.prior is not None:  # its means are measured, too
            drawn = noise.prior.drawn(experiment.X, experiment.W, batch, rng)
            problem = replace(experiment, noise=with_prior(noise, drawn))
        pairs = zip(experiment.sides, covariances_of(noise), strict=True)
        one, other = (disturbed(T, S, batch, rng) for T, S in pairs)
        parts.append(estimates(problem, one, other, each))
    return errors_of(experiment, _joined(parts))


def errors_of(experiment: Experiment, found: Estimates) -> Trials:
    """``(log(R_hat R^T), t_hat - t)`` of the estimates."""
    errors = difference(found.X, experiment.X)
    errors[~found.ok] = 0.0
    return Trials(errors, found.ok, found.covariances)


def _joined(parts: list[Estimates]) -> Estimates:
    X, ok, covariances = zip(*parts, strict=True)
    return Estimates(
        np.concatenate(X), np.concatenate(ok), None if covariances[0] is None else np.concatenate(covariances)
    )


def estimates(experiment: Experiment, first: Array, second: Array, each: bool) -> Estimates:
    """The method on disturbed poses or motions (m, n, 4, 4) of robot and camera.

    A method refuses a whole batch for one bad trial; the batch is then halved until that one is alone.
    """
    try:
        return _estimates(experiment, first, second, each)
    except (InputError, np.linalg.LinAlgError):
        m, prior = len(first), experiment.noise.prior
        if m == 1:
            true_first, true_second = experiment.sides
            _estimates(
                experiment, true_first[None], true_second[None], each
            )  # raises where it is no matter of the draw
            return Estimates(np.eye(4)[None], np.zeros(1, dtype=bool), np.eye(6)[None] if each else None)
    found = []
    for part in (slice(m // 2), slice(m // 2, m)):
        problem = experiment
        if prior is not None:  # with the means as they were drawn in these trials
            problem = replace(experiment, noise=with_prior(experiment.noise, prior.rows(part)))
        found.append(estimates(problem, first[part], second[part], each))
    return _joined(found)


def _estimates(experiment: Experiment, first: Array, second: Array, each: bool) -> Estimates:
    method, noise = experiment.method, experiment.noise
    every = np.ones(len(first), dtype=bool)
    data = experiment.measured(first, second)
    if method in ESTIMATORS:
        steps = CLOSED_FORM_STEPS if method == "efficient" else MAX_ML_STEPS
        found = fit_data(data, constraint_of(data, noise), noise, steps)
        return Estimates(found.X, np.asarray(found.converged), found.covariance_X if each else None)
    poses = data.poses
    if poses is not None and method in ROBOT_WORLD_METHODS:
        both = ROBOT_WORLD_METHODS[method]
        if not each:
            return Estimates(both(poses).X, every, None)
        single = (PosePairs(*sides, poses.setup) for sides in zip(first, second, strict=True))  # no leading axes
        own = [covariance_of_poses(both.sensitivities(one)[0], noise) for one in single]  # type: ignore[arg-type]
        return Estimates(both(poses).X, every, np.stack(own))
    if poses is not None and experiment.everything is not None and not each:
        return Estimates(solve_all_pairs(poses), every, None)
    motions = motions_of(data, experiment.choice)
    if method == "4dpa":
        X, ok = solve_4dpa(motions.A, motions.B, experiment.scale), every
    else:
        estimate = METHODS[method].estimate(motions.A, motions.B, experiment.weights)
        X, ok = estimate.X, np.asarray(estimate.converged)
    if not each:
        return Estimates(X, ok, None)
    return Estimates(X, ok, propagate_and_check(motions, noise=noise, X=X, method=method, scale=experiment.scale)[0])
