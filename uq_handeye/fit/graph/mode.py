r"""The most probable sizes: a quasi-Newton search that starts from the average information.

The second derivatives of f (`engine`) by log sizes are near their average information I where the sizes are near the
mode, and differ from it farther away. The search takes steps ``-B^-1 df``, B = I at the start and after long steps,
updated by the changes of the gradient after short ones (BFGS). A step moves no logarithm by more than `MAX_LOG_STEP`,
stays within `REACH_SD` standard deviations of the prior, and is shortened until f falls. SciPy's L-BFGS-B cannot start
from a given B, and needs twice the evaluations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from .engine import LatentModel, State
from .starts import MAX_START_STEPS

# The logarithm of a size is sought within this many standard deviations of its prior.
REACH_SD = 5.0
# One step changes the logarithm of a size by at most this; after a step of more than a sixth of it the curvature of f
# is computed again, not updated.
MAX_LOG_STEP = 1.5
# The tail of the prior of a size begins at this many times its median.
FAR_RATIO = 10.0
# Sizes within this many standard deviations of each other belong to one mode. A single error is resolved if it exceeds
# twice this many of its own standard deviations.
NEAR_SD = 2.0
# A search that comes within this many standard deviations of a mode would end there.
ARRIVED_SD = 0.3
# The search ends when the next step is expected to decrease f, minus the logarithm of the density, by less than this.
GAIN = 1e-5
# The sizes need not be exact before the unknowns and the robust weights are final, nor in the less probable modes: a
# step that would decrease f by less than this is not taken, and shared errors whose energy in the whitened rows is
# below it count as noise of each pose for the weights (the noise itself has the energy 1 in each number).
ROUGH_GAIN = 1e-2


@dataclass(frozen=True, eq=False)
class Mode:
    """A maximum of the posterior of the sizes."""

    state: State
    converged: bool
    at_bound: tuple[int, ...]  # numbers of free sizes that the data push against the end of their range

    @property
    def theta(self) -> Array:
        """(k,) logarithms of the free sizes."""
        return self.state.theta

    @property
    def log_evidence(self) -> float:
        """Logarithm of the probability of the data about this mode, up to a constant that all modes share."""
        return -self.state.value - 0.5 * float(np.linalg.slogdet(self.state.information)[1])


def find_mode(
    model: LatentModel,
    start: Array | None = None,
    gain: float = GAIN,
    reach: float = REACH_SD,
    known: Sequence[Mode] = (),
) -> Mode:
    """Minimise f from ``start`` (the medians by default), until the predicted decrease by a step is below ``gain``.

    ``reach``: standard deviations of the prior within which the sizes are searched. ``known``: other modes; a search
    that comes near one of them ends with it (`_apart` by less than `ARRIVED_SD`).
    """
    low, high = model.medians - reach * model.spreads, model.medians + reach * model.spreads
    state = model.solved(model.medians if start is None else np.clip(start, low, high))
    slope = model.slope(state)
    B, converged = model.information(state, slope), not len(low)
    information: Array | None = B  # at the state; None: B is an update, not it
    for _ in range(0 if converged else 2 * MAX_START_STEPS):
        open_ = ~_held(state.theta, slope.gradient, low, high)
        move = np.zeros(len(low))
        if open_.any():
            move[open_] = -np.linalg.solve(B[np.ix_(open_, open_)], slope.gradient[open_])
        promised = -float(slope.gradient @ move)
        if promised < gain:
            converged = True
            break
        share = min(1.0, MAX_LOG_STEP / float(np.abs(move).max()))
        for _ in range(12):
            tried = model.solved(np.clip(state.theta + share * move, low, high))
            if tried.value < state.value - 1e-4 * share * promised:
                break
            # the minimum of the parabola through both values and the slope
            curved = tried.value - state.value + share * promised
            share *= float(np.clip(0.5 * share * promised / max(curved, 1e-300), 0.1, 0.5))
        else:
            converged = promised < 1e-2  # the rest is rounding
            break
        moved, slope_before = tried.theta - state.theta, slope
        if arrived := [mode for mode in known if not _apart(tried.theta, mode, ARRIVED_SD)]:
            return arrived[0]
        state, slope = tried, model.slope(tried)
        if share <= 0.1 or np.abs(moved).max() > MAX_LOG_STEP / 6.0:  # the curvature there is another one
            information = B = model.information(state, slope)
        else:
            information, B = None, _updated(B, moved, slope.gradient - slope_before.gradient)
    at_bound = tuple(np.flatnonzero(_held(state.theta, slope.gradient, low, high)).tolist())
    if information is None:
        information = model.information(state, slope)
    return Mode(State(state.theta, state.value, slope.gradient, information, slope.determined), converged, at_bound)


def other_modes(model: LatentModel, mode: Mode) -> list[Mode]:
    """Return further modes, each by a search that starts with an error of one number in its tail, or out of it.

    Of a shared error of one number with a free size, such as the scale of the target, the size may be its usual one,
    the rest of the residuals being the arm's, or as large as the number itself (an inch for 25 mm), the arm being
    better. A search starts there where a size of 15 `FAR_RATIO` medians, with the other sizes at the mode or at their
    medians, makes the number larger than twice `NEAR_SD` of its standard deviations and than `FAR_RATIO` medians;
    where the mode itself is there, the search starts at the median.
    Noise of each pose has as many explanations: where a size is in its tail, another search starts with the usual one
    and the other noise as large as the residuals.
    Modes that are not apart count once.
    """
    found: list[Mode] = []
    free = model.free.tolist()
    noise = [place for place, number in enumerate(free) if number in model.blocks]
    for place in noise:
        if mode.theta[place] > model.medians[place] + np.log(FAR_RATIO):
            start = mode.theta.copy()
            start[noise] = [np.log(_of_residuals(model, free[k])) for k in noise]
            start[place] = model.medians[place]
            other = _other_mode(model, start, (mode, *found))
            if other.converged and all(_apart(other.theta, known) for known in (mode, *found)):
                found.append(other)
    for place, number in enumerate(free):
        if model.components[number].count != 1:
            continue
        usual, at = model.medians[place], model.place(number)
        starts = []
        for start in (mode.theta.copy(), model.medians.copy()):
            if mode.theta[place] > usual + np.log(FAR_RATIO):
                start[place] = usual
                starts.append(start)
                break
            start[place] = usual + np.log(15.0 * FAR_RATIO)
            wide = model.conditional(start)
            size = abs(float(wide.mean[at]))
            if size > max(2.0 * NEAR_SD * float(np.sqrt(wide.covariance[at, at])), FAR_RATIO * float(np.exp(usual))):
                start[place] = np.log(size)
                starts.append(start)
        for start in starts:
            other = _other_mode(model, start, (mode, *found))
            if (
                other.converged
                and place not in other.at_bound
                and all(_apart(other.theta, known) for known in (mode, *found))
            ):
                found.append(other)
    return found


def followed(model: LatentModel, mode: Mode, known: Sequence[Mode]) -> list[Mode]:
    """Return the modes beside ``mode`` that searches from those of a model like this one end at."""
    found: list[Mode] = []
    for one in known:
        other = _other_mode(model, one.theta, (mode, *found))
        if other.converged and all(_apart(other.theta, near) for near in (mode, *found)):
            found.append(other)
    return found


def _other_mode(model: LatentModel, start: Array, known: Sequence[Mode], log_odds: float = 5.0) -> Mode:
    """Return the mode where a search beside known ones ends, the first of them the main one.

    It is exact where the logarithm of its evidence is smaller than that of the main one by less than ``log_odds``.
    """
    found = find_mode(model, start, ROUGH_GAIN, known=known)
    if found in known or found.log_evidence < known[0].log_evidence - log_odds:
        return found
    return find_mode(model, found.theta)


def _of_residuals(model: LatentModel, number: int) -> float:
    """Return the size of a noise of each pose at which it is as large as the residuals, where it is the least part."""
    variance, square = np.zeros(6), np.zeros(6)
    for rows in model.groups:
        if number in rows.blocks:
            each = np.einsum("nii->ni", rows.blocks[number]).reshape(-1, 6)
            has = each.any(axis=-1)  # rows of other owners have none of it
            variance += each[has].sum(axis=0)
            square += (rows.r.reshape(-1, 6)[has] ** 2).sum(axis=0)
    some = variance > 1e-12 * variance.max()
    return float(np.sqrt((square[some] / variance[some]).max()))


def _apart(theta: Array, known: Mode, least: float = NEAR_SD) -> bool:
    """Return whether sizes are apart from a mode by more than ``least`` standard deviations."""
    off = theta - known.theta
    return float(off @ known.state.information @ off) > least**2


def _held(theta: Array, gradient: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    """(k,) sizes at the end of their range that would go beyond it."""
    return np.asarray(((theta <= low + 1e-9) & (gradient > 0)) | ((theta >= high - 1e-9) & (gradient < 0)))


def _updated(B: Array, s: Array, y: Array) -> Array:
    """Damped BFGS update (Powell 1978): B stays positive definite."""
    Bs = B @ s
    curvature, change = float(s @ Bs), float(s @ y)
    if curvature <= 0:
        return B
    if change < 0.2 * curvature:
        weight = 0.8 * curvature / (curvature - change)
        y = weight * y + (1.0 - weight) * Bs
        change = float(s @ y)
    return np.asarray(B - np.outer(Bs, Bs) / curvature + np.outer(y, y) / change)
