"""Playback of a bag as a source of poses: its streams on one clock, pair by pair, as in a running session."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

from ...model.poses.stream import Stream
from ...read.synchronisation.synchronise import synchronise
from .sources import Pair


class Playback:
    """Pairs of two streams in the order of time; ``how`` are further arguments of `synchronise`.

    ``pause`` waits ``interval`` seconds before each pair but the first; 0: as fast as the answers.
    """

    on_demand = False

    def __init__(
        self, robot: Stream, camera: Stream, interval: float, how: Mapping[str, Any] | None = None,
        name: str = "bag", pause: Callable[[float], None] = time.sleep,
    ) -> None:  # fmt: skip
        self.name, self._interval, self._pause, self._next = name, interval, pause, 0
        self._poses = synchronise(robot, camera, **(how or {})).poses

    @property
    def pending(self) -> bool:
        """True if the next pair is shown without a pause."""
        return self._interval == 0 and self._next < self._poses.n

    def take(self) -> Pair | None:
        """Return the next pair; None at the end."""
        k = self._next
        if k >= self._poses.n:
            return None
        if k and self._interval:
            self._pause(self._interval)
        self._next += 1
        times = self._poses.timestamps
        return Pair(self._poses.robot[k], self._poses.camera[k], None if times is None else float(times[k]))

    def close(self) -> None:
        """Nothing is held."""
