r"""The sizes of the errors and the unknown poses, found in turns.

The rows are linearised at the unknowns (`LatentModel`), the most probable sizes are found there (`mode`), and the
unknowns take the step of these sizes, until it is short in its standard deviations. At the end further modes are looked
for; from a more probable one the search goes on. One camera and any number of cameras, targets and arms are searched
alike: they differ in how rows are linearised and unknowns moved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from ...core.geometry.se3 import Array
from ...errors import NotConvergedError
from .engine import LatentModel
from .fit import MAX_NOISE_RAD
from .mode import GAIN, NEAR_SD, REACH_SD, ROUGH_GAIN, Mode, find_mode, followed, other_modes
from .reduced_rows import Reduced

# Largest number of times that the rows are linearised; from the fourth on the unknowns go half of the way, since some
# would go to and fro.
MAX_LINEARISATIONS, FULL_STEPS = 10, 3
# A size is far in its tail beyond this many standard deviations of its prior.
FAR_SD = 3.0
# The unknowns have converged where a step moves them by less, root mean square in their standard deviations; and by
# less than the second where the rows were linearised as often as they may be.
SETTLED_STEP_SD, LAST_STEP_SD = 0.006, 0.03
# The rows are linear up to a step of the rotations whose square is below this share of the residuals of rotation.
MAX_SHARE_OF_SECOND_ORDER = 0.01

At = TypeVar("At")


class Linear(NamedTuple):
    """The model at one place of the unknowns, and the directions of these that it has."""

    model: LatentModel
    reduced: Reduced


@dataclass(frozen=True, eq=False)
class Searched(Generic[At]):
    """The most probable sizes, where the rows are linear, and the other modes there."""

    linear: Linear
    mode: Mode
    at: At
    others: tuple[Mode, ...] = ()  # modes where an error of one number is in its tail, or out of it (`other_modes`)


def search(
    linear_at: Callable[[At], Linear],
    moved: Callable[[At, Array], At],
    at: At,
    theta: Array | None = None,
    gain: float = GAIN,
    known: Sequence[Mode] | None = None,
    first: Linear | None = None,
) -> Searched[At]:
    """Find the sizes and the unknowns near ``at``.

    Parameters
    ----------
    linear_at, moved : functions
        Rows at given unknowns; unknowns moved by a step of all of them.
    theta : (k,)
        Logarithms of sizes near those that are sought; None: the medians.
    gain : float
        What a further step may still promise (`find_mode`); above `GAIN` no further modes are looked for.
    known : modes
        The further modes of almost the same rows, which are followed and not searched for again.
    first : Linear
        The rows at ``at``, where they are there already.

    Raises
    ------
    NotConvergedError
        Unknowns or sizes that do not converge.
    """
    first = linear_at(at) if first is None else first
    try:
        found = _converged(linear_at, moved, at, theta, gain, first)
    except NotConvergedError:  # sizes far in their tails may let errors grow beyond first order: held nearer
        found = _converged(linear_at, moved, at, None, gain, first, NEAR_SD)
    else:
        found = _nearer(found, linear_at, moved, at, gain, first)
    if gain > GAIN:
        return found
    model = found.linear.model
    others = other_modes(model, found.mode) if known is None else followed(model, found.mode, known)
    best = max((found.mode, *others), key=lambda one: one.log_evidence)
    if best is not found.mode:  # go on from the more probable one, if it still is so where the poses settle
        step = found.linear.reduced.unreduced(model.of_poses(best.theta).mean)
        try:
            there = moved(found.at, step)
            again = _converged(linear_at, moved, there, best.theta, gain, linear_at(there))
        except NotConvergedError:
            again = None
        if again is not None and again.mode.log_evidence > found.mode.log_evidence:
            found = again
            others = other_modes(found.linear.model, found.mode)
        else:
            others = [other for other in others if other.log_evidence < found.mode.log_evidence]
    return replace(found, others=tuple(others))


def _nearer(
    found: Searched[At],
    linear_at: Callable[[At], Linear],
    moved: Callable[[At, Array], At],
    at: At,
    gain: float,
    first: Linear,
) -> Searched[At]:
    """Return the mode that sizes near their priors lead to, where some of those found are far, if it is more probable.

    At the first unknowns rows may be far from linear: sizes in their tails then take the unknowns to where nothing
    leads back from. Residuals beyond `MAX_NOISE_RAD` are of poses that contradict each other, which no sizes explain.
    """
    model = found.linear.model
    if ((found.mode.theta - model.medians) < FAR_SD * model.spreads).all() or _turn(first.model) > MAX_NOISE_RAD:
        return found
    every = [found]
    with suppress(NotConvergedError):
        every.append(_converged(linear_at, moved, at, None, gain, first, NEAR_SD))
        every.append(_converged(linear_at, moved, every[1].at, every[1].mode.theta, gain, every[1].linear))
    return max(every, key=lambda one: one.mode.log_evidence)


def _converged(
    linear_at: Callable[[At], Linear],
    moved: Callable[[At, Array], At],
    at: At,
    theta: Array | None,
    gain: float,
    linear: Linear,
    reach: float = REACH_SD,
) -> Searched[At]:
    """Find sizes and unknowns in turns from ``at``, where the rows are ``linear``, until the unknowns do not move."""
    for done in range(MAX_LINEARISATIONS):
        model = linear.model
        exactly = min(gain, GAIN) if done > 2 else gain if done or theta is not None else max(gain, ROUGH_GAIN)
        mode = find_mode(model, theta, exactly, reach)
        theta = mode.theta
        with np.errstate(over="ignore", invalid="ignore"):  # of data that do not fit at all
            found = model.of_poses(theta)
        step, C = linear.reduced.unreduced(found.mean), found.covariance
        if not (np.isfinite(step).all() and np.isfinite(C).all()):
            break
        enough = LAST_STEP_SD if done == MAX_LINEARISATIONS - 1 else SETTLED_STEP_SD
        as_linear = exactly <= gain and _second_order(step) < MAX_SHARE_OF_SECOND_ORDER * _turn(model)
        square = float(found.mean @ np.linalg.lstsq(C, found.mean, rcond=None)[0])
        if as_linear or (done and square < enough**2 * len(found.mean)):
            return Searched(linear, mode, at)
        at = moved(at, step if done < FULL_STEPS else 0.5 * step)
        linear = linear_at(at)
    turn, shift = _turn(linear.model), float(np.sqrt(np.mean(linear.model.r.reshape(-1, 2, 3)[:, 1] ** 2)))
    raise NotConvergedError(
        f"Noise estimation did not converge; the residuals are {np.rad2deg(turn):.2g} deg and "
        f"{shift * 1e3:.2g} mm (root mean square). If that is too much, look at the setup, at the pairing of the "
        "poses and for outliers; or give the noise.",
        mode,
    )


def _second_order(step: Array) -> float:
    """The first term that linear rows leave out: the largest squared rotation of an unknown pose."""
    return float((step.reshape(-1, 6)[:, :3] ** 2).sum(axis=-1).max())


def _turn(model: LatentModel) -> float:
    """Root mean square of the residuals of rotation (rad)."""
    return float(np.sqrt(np.mean(model.r.reshape(-1, 2, 3)[:, 0] ** 2)))
