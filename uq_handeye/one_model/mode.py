r"""The most probable sizes: Newton's method with the average information, damped.

The second derivatives of f (`engine`) by log sizes are replaced by their average information, which is positive
definite with the priors in it. A step moves no logarithm by more than `LONGEST`, stays within `REACH` deviations of
the prior, and is halved until f falls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.se3 import Array
from .engine import LatentModel, State

# Deviations of the prior between which a size is looked for; largest change of a logarithm in one step.
REACH, LONGEST = 5.0, 1.5
# The mode is found when a step promises less; steps and halvings at most.
GAIN, MOST, HALVINGS = 1e-7, 60, 8


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


def find_mode(model: LatentModel, start: Array | None = None) -> Mode:
    """Minimise f from ``start`` (the medians by default)."""
    low, high = model.medians - REACH * model.spreads, model.medians + REACH * model.spreads
    theta = model.medians if start is None else np.clip(start, low, high)
    state = model.at(theta)
    if not len(theta):
        return Mode(state, True, ())
    converged = False
    for _ in range(MOST):
        held = ((state.theta <= low) & (state.gradient > 0)) | ((state.theta >= high) & (state.gradient < 0))
        move = np.zeros(len(theta))
        open_ = ~held
        if not open_.any():
            converged = True
            break
        move[open_] = -np.linalg.solve(state.information[np.ix_(open_, open_)], state.gradient[open_])
        move *= min(1.0, LONGEST / max(float(np.abs(move).max()), 1e-300))
        promised = -float(state.gradient @ move)
        if promised < GAIN:
            converged = True
            break
        share, tried = 1.0, state
        for _ in range(HALVINGS):
            at = np.clip(state.theta + share * move, low, high)
            tried = model.at(at)
            if tried.value < state.value + 1e-12 * abs(state.value):
                break
            share *= 0.4
        else:
            converged = promised < 1e-3  # what is left is rounding
            break
        state = tried
    at_bound = tuple(np.flatnonzero(((state.theta <= low + 1e-6) & (state.gradient > 0)) |
                                    ((state.theta >= high - 1e-6) & (state.gradient < 0))).tolist())  # fmt: skip
    return Mode(state, converged, at_bound)
