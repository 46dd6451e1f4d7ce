"""Trials of any method: noise drawn on exact data, X estimated from each draw, and its error.

Work goes in blocks of a fixed number of trials, so that memory is bounded and the numbers depend on the generator
only. 4DPA on motions has an engine of its own (`fourdpa_pairs`); every other method runs on leading batch axes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array, logarithm
from ...errors import InputError
from ...fit.likelihood.constraint import constraint_of
from ...fit.likelihood.gauss_helmert import CLOSED_FORM_STEPS, ESTIMATORS, MOST_STEPS, fit_data
from ...methods.estimators.registry import METHODS, ROBOT_WORLD_METHODS
from ...methods.procrustes.limit import solve_4dpa
from ...methods.propagation.all_pairs import solve_all_pairs
from ...methods.propagation.noise_transport import covariance_of_poses
from ...methods.propagation.propagate import propagate_and_check
from ...model.noise.models import PairNoise, with_prior
from ...model.poses.motions import Motions, relative_motions
from ...model.poses.pose_pairs import PosePairs
from .experiment import Experiment
from .fourdpa_pairs import fourdpa_on_drawn
from .rig import disturbed

# Poses or motions of all trials of a block together.
BLOCK = 16_384


class Trials(NamedTuple):
    """Errors ``xi = (theta, tau)`` of X in each trial; those that failed have a row of zeros and are not ``ok``."""

    errors: Array  # (m, 6)
    ok: NDArray[np.bool_]  # (m,)
    covariances: Array | None = None  # (m, 6, 6), each trial's own; identity where it is not ok


class Estimates(NamedTuple):
    """X of some trials (m, 4, 4), whether they converged, and each one's covariance (m, 6, 6) if asked for."""

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
    truth, noise = experiment.truth, experiment.noise
    plain = experiment.method == "4dpa" and experiment.scale is None and noise.prior is None and not each
    if plain and isinstance(truth, Motions) and isinstance(noise, PairNoise):
        return Trials(*fourdpa_on_drawn(truth.A, truth.B, experiment.X, noise, rng, trials))
    step = max(1, BLOCK // experiment.size)
    parts = [_block(experiment, rng, min(step, trials - first), each) for first in range(0, trials, step)]
    return Trials(
        np.concatenate([part.errors for part in parts]),
        np.concatenate([part.ok for part in parts]),
        np.concatenate([part.covariances for part in parts if part.covariances is not None]) if each else None,
    )


def _block(experiment: Experiment, rng: np.random.Generator, trials: int, each: bool) -> Trials:
    truth, noise = experiment.truth, experiment.noise
    if noise.prior is not None:  # its means are measured, too
        drawn = noise.prior.drawn(experiment.X, experiment.W, (trials,), rng)
        experiment = replace(experiment, noise=with_prior(noise, drawn))
    if isinstance(noise, PairNoise):
        assert isinstance(truth, Motions)
        A = disturbed(truth.A, noise.A, (trials,), rng)
        B = disturbed(truth.B, noise.B, (trials,), rng)
        return errors_of(experiment, estimates(experiment, A, B, each))
    assert isinstance(truth, PosePairs)
    robot = disturbed(truth.robot, noise.robot, (trials,), rng)
    camera = disturbed(truth.camera, noise.camera, (trials,), rng)
    return errors_of(experiment, estimates(experiment, robot, camera, each))


def errors_of(experiment: Experiment, found: Estimates) -> Trials:
    """``(log(R_hat R^T), t_hat - t)`` of the estimates."""
    X = experiment.X
    errors = np.zeros((len(found.X), 6))
    errors[:, :3] = logarithm(found.X[:, :3, :3] @ X[:3, :3].T)
    errors[:, 3:] = found.X[:, :3, 3] - X[:3, 3]
    errors[~found.ok] = 0.0
    return Trials(errors, found.ok, found.covariances)


def estimates(experiment: Experiment, first: Array, second: Array, each: bool) -> Estimates:
    """The method on disturbed poses or motions (m, n, 4, 4) of robot and camera.

    A method refuses a whole batch for one bad trial; the batch is then halved until that one is alone.
    """
    try:
        return _estimates(experiment, first, second, each)
    except (InputError, np.linalg.LinAlgError):
        m = len(first)
        if m == 1:
            _estimates(experiment, *_true_sides(experiment), each)  # raises where it is no matter of the draw
            eye = np.eye(6)[None] if each else None
            return Estimates(np.eye(4)[None], np.zeros(1, dtype=bool), eye)
    parts = (slice(m // 2), slice(m // 2, m))
    one, other = (estimates(_of_trials(experiment, part), first[part], second[part], each) for part in parts)
    covariances = None
    if one.covariances is not None and other.covariances is not None:
        covariances = np.concatenate([one.covariances, other.covariances])
    return Estimates(np.concatenate([one.X, other.X]), np.concatenate([one.ok, other.ok]), covariances)


def _of_trials(experiment: Experiment, part: slice) -> Experiment:
    """Return the experiment with the means of the prior as they were drawn in some of the trials."""
    prior = experiment.noise.prior
    return experiment if prior is None else replace(experiment, noise=with_prior(experiment.noise, prior.rows(part)))


def _true_sides(experiment: Experiment) -> tuple[Array, Array]:
    truth = experiment.truth
    one, other = (truth.robot, truth.camera) if isinstance(truth, PosePairs) else (truth.A, truth.B)
    return one[None], other[None]


def _estimates(experiment: Experiment, first: Array, second: Array, each: bool) -> Estimates:
    method, noise, truth = experiment.method, experiment.noise, experiment.truth
    every = np.ones(len(first), dtype=bool)
    data: PosePairs | Motions
    data = PosePairs(first, second, truth.setup) if isinstance(truth, PosePairs) else Motions(first, second)
    if method in ESTIMATORS:
        constraint = constraint_of(data, noise)
        steps = CLOSED_FORM_STEPS if method == "efficient" else MOST_STEPS
        found = fit_data(data, constraint, noise, steps)
        return Estimates(found.X, np.asarray(found.converged), found.covariance_X if each else None)
    if method in ROBOT_WORLD_METHODS:
        assert isinstance(data, PosePairs)
        X = ROBOT_WORLD_METHODS[method](data).X
        return Estimates(X, every, _each_robot_world(experiment, data) if each else None)
    if experiment.everything is not None and not each:
        assert isinstance(data, PosePairs)
        return Estimates(solve_all_pairs(data), every, None)
    pairs = "all" if experiment.pairs is None else experiment.pairs
    motions = relative_motions(data, pairs) if isinstance(data, PosePairs) else data
    if method == "4dpa":
        X, ok = solve_4dpa(motions.A, motions.B, experiment.scale), every
    else:
        estimate = METHODS[method].estimate(motions.A, motions.B, experiment.weights)
        X, ok = estimate.X, np.asarray(estimate.converged)
    covariances = None
    if each:
        covariances, _ = propagate_and_check(motions, noise=noise, X=X, method=method, scale=experiment.scale)
    return Estimates(X, ok, covariances)


def _each_robot_world(experiment: Experiment, data: PosePairs) -> Array:
    """One by one: these methods have no sensitivities over leading axes."""
    method, noise = ROBOT_WORLD_METHODS[experiment.method], experiment.noise
    assert not isinstance(noise, PairNoise)
    found = []
    for robot, camera in zip(data.robot, data.camera, strict=True):
        by_error, _ = method.sensitivities(PosePairs(robot, camera, data.setup))
        found.append(covariance_of_poses(by_error, noise))
    return np.stack(found)
