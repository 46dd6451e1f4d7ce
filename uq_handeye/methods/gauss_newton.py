"""Gauss-Newton steps of many trials at once for `nguyen`: damping, counting, and the end of each trial.

Model: at each state a stage gives its gradient g and information F; the full step is ``F^-1 g``, of the length
``sqrt(g^T F^-1 g)`` in standard deviations, which has no unit. Two rules end an iteration: ``scaled`` by that length,
with damped steps where full ones do not lead down; ``published`` by the length in rad or in the length unit of the
data, undamped.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.packed3x3 import EYE
from ..core.geometry.se3 import Array
from ..core.rounding import EPS, HALF_DIGITS, THIRD_DIGITS
from .method import require

Stop = Literal["scaled", "published"]


# Number of iterations that the publication allows in each stage, under the rule 'published'.
PUBLISHED_ITERATIONS = 10
# Largest ratio of a step of the second stage to the last one, which pointed the other way, without damping. The second
# stage has no sum of squares by which a step could be judged.
MAX_SWING = 0.3


class Descent:
    """Gauss-Newton steps of the trials that have not yet ended: damped, counted, and judged.

    The full step is ``F^-1 g``, a damped one ``(F + d diag F)^-1 g``. In the first stage a step that raised the sum of
    squares is undone and tried again with more damping. In the second, where the sum is known for linearised latents
    only, damping grows while the steps swing to and fro. Convergence is judged by the full step only.
    """

    def __init__(self, T: int, stop: Stop, max_iterations: int, published: float) -> None:
        self.stop, self.max_iterations, self.published = stop, max_iterations, published
        self.trials: NDArray[np.intp] = np.arange(T)
        self.converged = np.zeros(T, dtype=bool)
        self.iterations = np.zeros(T, dtype=np.intp)
        self.count = 0
        self.squares: Array = np.full(T, np.inf)
        self.length: Array = self.squares
        self.damping: Array = np.zeros(T)
        self.gradient = self.information = self.last = np.empty(0)
        self.rejected: NDArray[np.bool_] | None = None

    def note(self, gradient: Array, information: Array) -> None:
        """Take note of the state reached."""
        self.count += 1
        self.gradient, self.information, self.rejected = gradient, information, None

    def judge(self, squares: Array, gradient: Array, information: Array) -> NDArray[np.bool_] | None:
        """Take note of the state reached, or tell which trials are to go back to the state before."""
        before = self.gradient, self.information
        self.note(gradient, information)
        # near the minimum rounding alone raises the sum, and must not undo good steps
        rejected = ~(squares <= (1.0 + HALF_DIGITS) * self.squares + EPS)
        if self.stop == "published" or self.count == 1 or not rejected.any():
            self.squares = squares
            if self.damping.any():
                self.damping = _less(self.damping)
            return None
        self.squares = np.where(rejected, self.squares, squares)
        self.gradient = np.where(rejected[:, None], before[0], gradient)
        self.information = np.where(rejected[:, None, None], before[1], information)
        self.damping = np.where(rejected, np.maximum(10.0 * self.damping, 1e-2), _less(self.damping))
        self.rejected = rejected
        return rejected

    def step(self) -> tuple[Array, NDArray[np.bool_]]:
        """The step (T, 3) of the first stage, and which trials end with it."""
        step, length, converged = self._full_step()
        return self._ended(self._damped(step, converged), length, converged)

    def relaxed_step(self, impossible: NDArray[np.bool_] | None) -> tuple[Array, NDArray[np.bool_]]:
        """The step (T, 3) of the second stage, and which trials end with it; impossible ones without convergence."""
        step, length, converged = self._full_step()
        if self.stop == "scaled" and self.count > 2:
            swings = (length > MAX_SWING * self.length) & ((self.last * self.gradient).sum(axis=-1) < 0)
            if swings.any() or self.damping.any():
                self.damping = np.where(swings, np.clip(2.0 * self.damping, 0.5, 8.0), 0.7 * self.damping)
        if impossible is not None:
            converged &= ~impossible
        step, ended = self._ended(self._damped(step, converged), length, converged)
        self.last = step
        if impossible is not None:
            ended |= impossible & (self.count >= PUBLISHED_ITERATIONS)
        return step, ended

    def _full_step(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """The full step, its length in standard deviations, and whether it is so short that the iteration converged."""
        try:
            solved = np.linalg.solve(self.information, self.gradient[:, :, None])
        except np.linalg.LinAlgError:  # say which problem it is
            singular = np.linalg.matrix_rank(self.information) < self.information.shape[-1]
            require(~singular, "the information about X is singular: its motions leave a direction open.")
            raise
        step = np.asarray(solved[:, :, 0], dtype=float)
        length = np.sqrt(np.maximum((step * self.gradient).sum(axis=-1), 0.0))
        if self.stop == "published":
            return step, length, np.sqrt((step * step).sum(axis=-1)) < self.published
        # Near the minimum, a step that is no shorter than the last one is rounding.
        stalled = (length < THIRD_DIGITS) & (length >= self.length)
        if self.rejected is not None:
            stalled &= ~self.rejected
        # Where steps shrink, the next one, which is not taken, is shorter than this one by their ratio once more.
        shrinking = (length < self.length) & np.isfinite(self.length)
        next_step = length * np.where(shrinking, length / np.where(shrinking, self.length, 1.0), 1.0)
        return step, length, (next_step < HALF_DIGITS) | stalled

    def _damped(self, step: Array, converged: NDArray[np.bool_]) -> Array:
        if not self.damping.any():
            return step
        diagonal = np.einsum("tii->ti", self.information)[:, :, None] * EYE
        damped = np.linalg.solve(self.information + self.damping[:, None, None] * diagonal, self.gradient[:, :, None])
        return np.where(converged[:, None], step, damped[:, :, 0])

    def _ended(self, step: Array, length: Array, converged: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
        self.length = length
        self.iterations[self.trials] = self.count
        self.converged[self.trials] = converged
        return step, converged | (self.count >= self.max_iterations)

    def keep(self, keep: NDArray[np.bool_]) -> None:
        """Go on with some of the trials."""
        self.trials, self.squares, self.damping = self.trials[keep], self.squares[keep], self.damping[keep]
        self.length = self.length[keep]
        self.gradient, self.information = self.gradient[keep], self.information[keep]
        self.last = self.last[keep] if len(self.last) else self.last
        self.rejected = None


def _less(damping: Array) -> Array:
    return np.where(damping > 1e-3, 0.1 * damping, 0.0)
