"""Tree of the frames of ``/tf`` and ``/tf_static``: the pose of any frame in any other, at the times of what moves.

A chain runs from the base up to the first common frame and down to the tip; an edge that is run through upwards is
inverted. Edges that never change are static. The times are those of the moving edge that has the fewest; the others
are interpolated at them (`synchronisation.interpolation`), never beyond their ends nor across gaps. tf2 interpolates
likewise (ros2/geometry2, ``tf2/src/cache.cpp`` and ``buffer_core.cpp``). Of a frame with several parents, of which tf2
takes the latest, the shortest chain is used, and a note names them.
"""

from __future__ import annotations

import difflib
from collections import deque
from dataclasses import dataclass, field
from functools import reduce

import numpy as np

from ...core.geometry.se3 import Array, inverse
from ...core.limits import MAX_LISTED
from ...errors import InputError
from ...formats.ros_messages import pair_text
from ...model.poses.timing import MAX_GAP_INTERVALS
from ..synchronisation.interpolation import at_times
from .track import Pair, TimedPoses, Track, listed

# Pairs of frames that a recording may have; each needs memory of its own.
MAX_FRAME_PAIRS = 5000


@dataclass
class Tree:
    """Edges ``parent_T_child`` by their frames."""

    edges: dict[Pair, Track] = field(default_factory=dict)
    _near: dict[str, list[tuple[str, Pair, bool]]] = field(default_factory=dict)

    @property
    def frames(self) -> list[str]:
        """Every frame, sorted."""
        return sorted({frame for pair in self.edges for frame in pair})

    def track(self, pair: Pair) -> Track:
        """Return the track of an edge, a new one if there is none."""
        if pair not in self.edges:
            if len(self.edges) >= MAX_FRAME_PAIRS:
                raise InputError(f"Expected transforms between at most {MAX_FRAME_PAIRS} pairs of frames, got more.")
            self.edges[pair] = Track(f"the transform {pair_text(*pair)}")
            self._near.setdefault(pair[0], []).append((pair[1], pair, True))
            self._near.setdefault(pair[1], []).append((pair[0], pair, False))
        return self.edges[pair]

    def chain(self, base: str, tip: str) -> list[tuple[Pair, bool]] | None:
        """Return the edges from base to tip, each with whether it is run through downwards; None: not connected."""
        before = self._reached(base)
        if tip not in before:
            return None
        found: list[tuple[Pair, bool]] = []
        frame = tip
        while frame != base:
            frame, pair, down = before[frame]
            found.append((pair, down))
        return found[::-1]

    def _reached(self, base: str) -> dict[str, tuple[str, Pair, bool]]:
        """Return the frames that are connected to one, the nearest first: by which, and the edge between."""
        before: dict[str, tuple[str, Pair, bool]] = {}
        queue = deque([base])
        while queue:
            frame = queue.popleft()
            for other, pair, down in self._near.get(frame, []):
                if other not in before and other != base:
                    before[other] = (frame, pair, down)
                    queue.append(other)
        return before

    def moves(self, base: str, tip: str) -> bool:
        """Return whether any edge between two frames moves."""
        return any(self.edges[pair].moves for pair, _ in self.chain(base, tip) or [])

    def poses(self, base: str, tip: str) -> TimedPoses:
        """Return times (n,), poses (n, 4, 4) ``base_T_tip``, and notes."""
        chain = self._require_chain(base, tip)
        moving = [pair for pair, _ in chain if self.edges[pair].moves]
        if not moving:
            raise InputError(f"The frame {tip} never moves in {base}: every transform between them is static.")
        tracks = {pair: self.edges[pair].poses() for pair in moving}
        leading = min(moving, key=lambda pair: len(tracks[pair][0]))
        times = tracks[leading][0]
        steps: dict[Pair, Array] = {}
        fine = np.ones(len(times), dtype=bool)
        for pair in moving:
            own, poses = tracks[pair]
            gap = MAX_GAP_INTERVALS * float(np.median(np.diff(own))) if len(own) > 1 else 0.0
            found = at_times(own, poses, times, max_gap=gap)
            steps[pair] = found.poses
            fine &= found.fine
        if not fine.any():
            ends = [(pair, tracks[pair][0][[0, -1]]) for pair in moving[:MAX_LISTED]]
            spans = ", ".join(f"{pair_text(*pair)} from {first:.3f} to {last:.3f} s" for pair, (first, last) in ends)
            raise InputError(f"The transforms between {base} and {tip} have no time in common: {spans}.")
        parts = [
            (steps[pair][fine] if pair in steps else self.edges[pair].poses()[1][-1], down) for pair, down in chain
        ]
        T = reduce(np.matmul, [step if down else inverse(step) for step, down in parts])
        notes = self._notes(base, tip, chain, moving, leading, len(fine) - int(fine.sum()))
        return TimedPoses(times[fine], np.array(T), notes)

    def _require_chain(self, base: str, tip: str) -> list[tuple[Pair, bool]]:
        for frame in (base, tip):
            if frame not in self.frames:
                close = difflib.get_close_matches(frame, self.frames, n=1)
                hint = f"Did you mean {close[0]}?" if close else f"There are: {listed(self.frames, 'nothing')}."
                raise InputError(f"There is no frame {frame} in the transforms. {hint}")
        if base == tip:
            raise InputError(f"Expected two frames, got {base} twice.")
        if (chain := self.chain(base, tip)) is None:
            raise InputError(
                f"The frames {base} and {tip} are not connected by transforms: {base} is connected to "
                f"{listed(sorted(self._reached(base)), 'nothing')}, {tip} to "
                f"{listed(sorted(self._reached(tip)), 'nothing')}."
            )
        return chain

    def _notes(
        self, base: str, tip: str, chain: list[tuple[Pair, bool]], moving: list[Pair], leading: Pair, left: int
    ) -> list[str]:
        notes = [f"the pose of {tip} in {base}, of one transform"]
        if len(chain) > 1:
            notes = [f"{base} to {tip} by {len(chain)} transforms, {len(moving)} of which move"]
        if len(moving) > 1:
            notes.append(f"at the times of {pair_text(*leading)}; the other transforms are interpolated")
        if left:
            notes.append(f"{left} poses are left out: another transform of the chain has none near that time")
        if again := sum(self.edges[pair].repeated for pair in moving):
            notes.append(f"{again} transforms that repeat a time are left out")
        for pair, _ in chain:
            others = [parent for parent, child in self.edges if child == pair[1] and parent != pair[0]]
            if others:
                notes.append(f"{pair[1]} has several parents: {', '.join([pair[0], *others])}; used: {pair[0]}")
        return notes
