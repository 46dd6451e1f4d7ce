"""The interface of all sources of poses, and how one feeds a session."""

from __future__ import annotations

import threading
from typing import NamedTuple, Protocol

from ...errors import InputError
from ...geometry.se3 import Array
from ..session import Session


class Pair(NamedTuple):
    """A robot pose base_T_gripper and a camera pose camera_T_target, (4, 4) in m; the time in s, if known."""

    robot: Array
    camera: Array
    time: float | None = None


class Source(Protocol):
    """Something that poses come from.

    ``name`` is said to the user. With ``on_demand`` a pair is taken when the user says that the robot stands still;
    otherwise pairs come by themselves, and ``pending`` says that the next one waits already.
    """

    name: str
    on_demand: bool

    @property
    def pending(self) -> bool: ...

    def take(self) -> Pair | None:
        """Return the next pair; None: there will be no more. Raises `InputError` for one that cannot be used."""

    def close(self) -> None:
        """Let go of what the source holds."""


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
