"""Robot and camera as time-stamped poses, wherever they come from: files, a ROS bag, joint values, or one of each."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ...errors import InputError, NotConvergedError
from ...model.poses.stream import Stream
from ..synchronisation.result import Synchronised
from ..synchronisation.synchronise import synchronise

if TYPE_CHECKING:
    from ...model.camera.adjustment.two_minima import Minima

_log = logging.getLogger("uq_handeye")


@dataclass(frozen=True, eq=False)
class Sensors:
    """Streams of robot and camera, and what is known of their clocks.

    Parameters
    ----------
    name : of the files or the bag, for messages
    robot, camera : poses, joint values and times (s)
    recorded : the sides that a bag gives, with stamps of the computer that recorded it. Where neither side has
        anything in time with the other, any offset of their clocks is tried; where both are recorded and no offset is
        found, the stamps are those of one clock.
    minima : both solutions of the poses of a tag, as the camera's stream has them; the robot decides between them
    still : whether one mean pair of poses is wanted for each stop
    """

    name: str
    robot: Stream
    camera: Stream
    recorded: tuple[str, ...] = ()
    minima: Minima | None = None
    still: bool = False

    def synchronised(self, **how: Any) -> Synchronised:
        """Return pairs of poses on one clock; the arguments are those of `synchronise`."""
        how = {"offset": None, "still": self.still} | how
        found = self._on_one_clock(how)
        if self.minima is None or how["still"]:
            return found
        from .tags import decide_stream

        decided = decide_stream(found.poses, self.camera, self.minima)
        if decided is None:
            return found
        _log.info(
            "%s: %d of %d poses of the tag have two solutions that its corners do not decide between; %d were changed "
            "to agree with the robot, %d remain undecided",
            self.name,
            decided.doubtful,
            found.poses.n,
            decided.changed,
            decided.undecided,
        )
        return replace(self, camera=decided.stream)._on_one_clock(how, again=True) if decided.changed else found

    def _on_one_clock(self, how: dict[str, Any], again: bool = False) -> Synchronised:
        """Return the pairs; what was said once is not said ``again``."""
        info, warning = (logging.DEBUG, logging.DEBUG) if again else (logging.INFO, logging.WARNING)
        r, c = self.robot.timestamps, self.camera.timestamps
        apart = bool(self.recorded) and max(r[0], c[0]) > min(r[-1], c[-1])
        if apart and how["offset"] is None and how.get("max_offset") is None:
            words = "the stamps of robot and camera have no time in common; any clock offset is tried"
            _log.log(info, "%s: %s", self.name, words)
            how = how | {"max_offset": math.inf}
        one_clock = len(self.recorded) == 2 and not apart and how["offset"] is None
        failures: list[Exception] = []
        for offset in (how["offset"], 0.0) if one_clock else (how["offset"],):
            try:
                found = synchronise(self.robot, self.camera, **how | {"offset": offset})
            except (InputError, NotConvergedError) as error:
                failures.append(error)
                continue
            if failures:
                _log.log(
                    warning,
                    "The clock offset was not estimated: %s The stamps of the bag are taken as those of one clock, as "
                    "with --offset 0. A delay of the camera is not covered.",
                    failures[0],
                )
            return found
        raise failures[0]
