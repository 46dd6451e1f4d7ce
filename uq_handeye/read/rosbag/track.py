"""Track: the poses of one pair of frames as they arrive in a recording.

Tree of frames of ``/tf`` and ``/tf_static``: the pose of any frame in any other, at the times of what moves.

A chain runs from the base up to the first common frame and down to the tip; an edge that is run through upwards is
inverted. Edges that never change are static. The times are those of the moving edge that has the fewest; the others
are interpolated at them (`synchronisation.interpolation`), never beyond their ends nor across gaps. tf2 interpolates
likewise (ros2/geometry2, ``tf2/src/cache.cpp`` and ``buffer_core.cpp``). Of a frame with several parents, of which tf2
takes the latest, the shortest chain is used, and a note names them.

Intrinsics of a camera as ``sensor_msgs/CameraInfo`` has them.

Fields of ROS 1 (K, D, P) and ROS 2 (k, d, p) as in ``sensor_msgs/msg/CameraInfo.msg`` of ros2/common_interfaces: K and
D are of the picture as taken, P of the rectified one, in which no distortion is left.
"""

from __future__ import annotations

import difflib
from array import array
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array, inverse
from ...errors import InputError
from ...formats.contents import FRAMES, Side, finished
from ...formats.ros_messages import MessageError, frame_name, pair_text, part
from ...model.camera.models import LINEAR, MODELS, CameraModel
from ..synchronisation.interpolation import at_times

# Rows of one pair of frames, tag or set of joints.
MOST = 5_000_000
FIELDS = ("stamp", *(f"translation.{a}" for a in "xyz"), *(f"rotation.{a}" for a in "xyzw"))


class Samples:
    """Rows of ``width`` numbers at times (s), in the order of their arrival, at most `MOST`."""

    def __init__(self, name: str, width: int) -> None:
        self.name, self._width = name, 1 + width  # the name is for messages
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._values) // self._width

    def add(self, time: float, numbers: Iterable[float]) -> None:
        """Append one row."""
        if len(self) >= MOST:
            raise InputError(f"{self.name}: expected at most {MOST} rows, got more; cut the bag into pieces.")
        self._values.append(time)
        self._values.extend(numbers)

    @property
    def rows(self) -> Array:
        """(n, 1 + width) time and numbers, as they arrived."""
        return np.array(self._values).reshape(-1, self._width)

    @property
    def values(self) -> Array:
        """The same sorted by time; each time once."""
        table = self.rows
        return np.asarray(table[np.unique(table[:, 0], return_index=True)[1]])


class Track(Samples):
    """Times and poses of one pair of frames: x, y, z, qx, qy, qz, qw."""

    def __init__(self, name: str) -> None:
        super().__init__(name, 7)
        self.static = False  # of /tf_static

    @property
    def repeated(self) -> int:
        """Number of poses whose time stands there before."""
        return len(self) - len(self.values)

    @property
    def moves(self) -> bool:
        """True if the poses differ: transforms that are always the same are static, too."""
        table = self.rows
        return not self.static and bool((table[:, 1:] != table[0, 1:]).any())

    def poses(self) -> tuple[NDArray[np.float64], Array]:
        """Return times (n,) and poses (n, 4, 4) ``parent_T_child``; raises `InputError` for what is none."""
        table = self.values
        side = Side(self.name, table[:, 1:4], table[:, 4:], table[:, 0], None, "pose", "xyzw", FIELDS)
        return table[:, 0].copy(), finished(side, "robot", "m", None, FRAMES["robot"][0])


class Found(NamedTuple):
    """Times, poses and notes of one side."""

    times: NDArray[np.float64]
    poses: Array
    notes: list[str]


Pair = tuple[str, str]
# A gap is longer than so many median intervals.
GAPS = 3.0
# Pairs of frames.
MOST_PAIRS = 5000
# Frames that a message names.
NAMED = 12


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
            if len(self.edges) >= MOST_PAIRS:
                raise InputError(f"Expected transforms between at most {MOST_PAIRS} pairs of frames, got more.")
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

    def poses(self, base: str, tip: str) -> Found:
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
            gap = GAPS * float(np.median(np.diff(own))) if len(own) > 1 else 0.0
            found = at_times(own, poses, times, max_gap=gap)
            steps[pair] = found.poses
            fine &= found.fine
        if not fine.any():
            ends = [(pair, tracks[pair][0][[0, -1]]) for pair in moving[:NAMED]]
            spans = ", ".join(f"{pair_text(*pair)} from {first:.3f} to {last:.3f} s" for pair, (first, last) in ends)
            raise InputError(f"The transforms between {base} and {tip} have no time in common: {spans}.")
        parts = [
            (steps[pair][fine] if pair in steps else self.edges[pair].poses()[1][-1], down) for pair, down in chain
        ]
        T = reduce(np.matmul, [step if down else inverse(step) for step, down in parts])
        notes = self._notes(base, tip, chain, moving, leading, len(fine) - int(fine.sum()))
        return Found(times[fine], np.array(T), notes)

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


def listed(names: list[str], nothing: str = "none") -> str:
    """Return the names that a message lists."""
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"{', '.join(names[:NAMED]) or nothing}{more}"


# What ROS calls the models.
NAMES = {
    "plumb_bob": "brown",
    "rational_polynomial": "brown",
    "fisheye": "fisheye",
    "equidistant": "fisheye",
    "": "brown",
}


@dataclass(frozen=True, eq=False)
class CameraInfo:
    """Camera matrix and distortion of the picture as taken, and the matrix of the rectified one."""

    frame: str
    image_size: tuple[int, int]
    model: str
    K: Array  # (4,) fx, fy, cx, cy
    D: Array
    P: Array  # (4,) fx, fy, cx, cy; 0 where it is not given

    def like(self, other: CameraInfo) -> bool:
        """Return whether the numbers are the same."""
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in ("K", "D", "P"))

    @property
    def rectified(self) -> bool:
        """True if there is a matrix of the rectified picture."""
        return bool(self.P[0] > 0 and self.P[1] > 0)

    @property
    def distorted(self) -> bool:
        """True if the picture as taken has a distortion of a model that is known."""
        return bool(self.D.any()) and self.model in NAMES

    def linear(self) -> Array:
        """(4,) fx, fy, cx, cy of the picture in which tags are detected: the rectified one where it is known."""
        return self.P if self.rectified else self.K

    def lens(self) -> tuple[CameraModel, Array]:
        """Return the model and its parameters for pixels of that picture."""
        if self.rectified or not self.D.any():
            return MODELS["pinhole"], self.linear()
        if self.model not in NAMES:
            raise InputError(
                f"The camera_info of {self.frame} has the distortion model {self.model}; known are "
                f"{', '.join(filter(None, NAMES))}. Detect in rectified pictures, or give --camera-matrix."
            )
        model = MODELS[NAMES[self.model]]
        parameters = np.zeros(len(model.names))
        parameters[: len(LINEAR)] = self.K
        count = min(len(self.D), len(model.names) - len(LINEAR))
        parameters[len(LINEAR) : len(LINEAR) + count] = self.D[:count]
        return model, parameters

    def text(self) -> str:
        """Return the matrix as --camera-matrix takes it: ``fx,fy,cx,cy``."""
        return ",".join(f"{float(value)!r}" for value in self.linear())


def camera_info_of(message: Any) -> CameraInfo:
    """Return the intrinsics of a message; raises `MessageError` if it has none."""

    def numbers(*names: str) -> Array:
        value = next((found for name in names if (found := part(message, name)) is not None), ())
        return np.asarray(value, dtype=float).ravel()

    K, D, P = numbers("k", "K"), numbers("d", "D"), numbers("p", "P")
    if K.size != 9 or not np.isfinite(K).all() or K[0] <= 0 or K[4] <= 0 or not np.isfinite(D).all():
        raise MessageError("a camera matrix")
    P = P if P.size == 12 and np.isfinite(P).all() else np.zeros(12)
    size = int(part(message, "width") or 0), int(part(message, "height") or 0)
    frame = frame_name(part(part(message, "header"), "frame_id"))
    model = str(part(message, "distortion_model") or "")
    return CameraInfo(frame, size, model, K[[0, 4, 2, 5]], D, P[[0, 5, 2, 6]])
