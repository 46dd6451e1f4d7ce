"""Sources of poses for a session: their interface, and the loop that passes their pairs to the session.

A source gives pairs of poses. Some arrive by themselves (a program that writes lines, a bag that is played back);
others are taken on request of the user while the robot does not move, one pose from each side, robot and camera.
"""

from __future__ import annotations

import threading
from typing import NamedTuple, Protocol

from ...core.geometry.se3 import Array
from ...errors import InputError
from .session import Session

MAX_STAMP_DIFFERENCE_S = 0.2  # of the two poses of one pair


class Pair(NamedTuple):
    """A robot pose base_T_gripper and a camera pose camera_T_target, (4, 4) in m; the time in s, if known."""

    robot: Array
    camera: Array
    time: float | None = None


class Source(Protocol):
    """A source of pairs of poses; ``name`` is shown to the user.

    With ``on_demand`` a pair is taken when the user says that the robot stands still; otherwise pairs come by
    themselves, and ``pending`` is true while the next one waits already.
    """

    name: str
    on_demand: bool

    @property
    def pending(self) -> bool: ...

    def take(self) -> Pair | None:
        """Return the next pair; None: there will be no more. Raises `InputError` for one that cannot be used."""

    def close(self) -> None:
        """Release the resources of the source."""


class Side:
    """One side of a pair, robot or camera, whose newest pose can be taken at any time."""

    def newest(self) -> tuple[Array, float | None]:
        """Return the newest pose (4, 4) and its time (s), if it is on a clock; raises `InputError` if there is none."""
        raise NotImplementedError

    def close(self) -> None:
        """Release the resources of the side."""


class Taken:
    """Pairs of two sides, taken on request of the user while the robot does not move."""

    on_demand, pending = True, False

    def __init__(self, name: str, robot: Side, camera: Side) -> None:
        self.name, self._robot, self._camera = name, robot, camera

    def take(self) -> Pair:
        """Return the newest pair; raises `InputError` where the two are of different moments."""
        (robot, at), (camera, seen) = self._robot.newest(), self._camera.newest()
        if at is not None and seen is not None and abs(at - seen) > MAX_STAMP_DIFFERENCE_S:
            raise InputError(f"Robot and camera were stamped {abs(at - seen):.2f} s apart. Let the robot stand still.")
        return Pair(robot, camera, at if seen is None else seen)

    def close(self) -> None:
        """Close both sides."""
        self._robot.close()
        self._camera.close()


def feed(session: Session, source: Source, stop: threading.Event) -> None:
    """Add the pairs of a source that come by themselves, until it ends; what cannot be used is noted in the session."""
    while not stop.is_set():
        try:
            pair = source.take()
            if pair is None:
                return
            session.add(*pair, ask=not source.pending)
        except InputError as error:
            session.note(str(error))
            session.update()
