"""Robot and camera as time-stamped poses, wherever they come from: files, a ROS bag, joint values, or one of each."""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.geometry.se3 import Array
from ...core.limits import MIN_POSES
from ...errors import DegenerateMotionError, InputError, NotConvergedError
from ...findings import Finding
from ...formats.contents import Side
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.residuals import rotation_angles
from ...model.poses.stream import Stream
from ..camera_covariance import with_covariance
from ..pairing_by_time import SYNCHRONOUS_S, Match, match_times
from ..synchronisation.result import Synchronised
from ..synchronisation.stops import offsets_at_rest
from ..synchronisation.stream_checks import MAX_INTERVAL_S
from ..synchronisation.synchronise import synchronise

if TYPE_CHECKING:
    from ...model.camera.adjustment.two_minima import Minima

# Poses that are at least so far apart (s) are taken one by one where the stamps of both sides are the same.
MIN_SINGLE_POSE_INTERVAL_S = 0.3
# Stamps of one pose differ by at most this share of the interval between poses.
MAX_STAMP_SHARE = 0.1
# A rotation (rad) between neighbouring poses across which nothing is interpolated.
JUMP_RAD = 0.15
# An offset that is known to a smaller share of the interval between poses is one of motion, not of single poses.
MAX_OFFSET_SHARE = 0.1

_log = logging.getLogger("uq_handeye")


class Sensors(NamedTuple):
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

    def taken_one_by_one(self, setup: str) -> PosePairs | None:
        """Return the pairs of poses that were recorded one by one, by their stamps; None where the robot was tracked.

        Poses of a recording are taken one by one if both sides have few of them with the same stamps: seconds apart and
        at most a tenth of that from each other; or `MIN_SINGLE_POSE_INTERVAL_S` apart or more, if their motion does not
        tell an offset, and the stamps are equal or the robot is elsewhere each time. Between them nothing is
        interpolated, so an offset of the clocks has no meaning.
        """
        r, c = (np.sort(side.timestamps) for side in (self.robot, self.camera))
        if len(self.recorded) < 2 or self.still or min(len(r), len(c)) < MIN_POSES:
            return None
        interval = float(min(np.median(np.diff(times)) for times in (r, c)))
        elsewhere = interval > MAX_INTERVAL_S or _jumps(self.robot)
        tolerance = MAX_STAMP_SHARE * interval if elsewhere else SYNCHRONOUS_S
        if interval < MIN_SINGLE_POSE_INTERVAL_S:
            return None
        try:
            match = match_times(_side("robot", self.robot), _side("camera", self.camera), tolerance)
        except InputError:
            return None
        few = 2 * len(match.robot) < min(len(r), len(c))
        if few or (interval <= MAX_INTERVAL_S and self._tracked(setup, interval)):
            return None
        late = float(np.abs(self.robot.timestamps[match.robot] - self.camera.timestamps[match.camera]).max())
        for note in match.notes:
            _log.info("%s: %s", self.name, note)
        _log.info(
            "%s: the poses were taken one by one, %.3g s apart: those of one stamp are pairs, and no clock offset is "
            "estimated%s",
            self.name,
            interval,
            "" if late <= SYNCHRONOUS_S else "; that is right if the robot stood still",
        )
        return self._decided(self._pairs(match, setup), match, setup)

    def _tracked(self, setup: str, interval: float) -> bool:
        """Return whether the motion between poses of equal stamps tells the offset of their clocks."""
        try:
            found = synchronise(self.robot, self.camera, setup=setup)
        except (InputError, NotConvergedError, DegenerateMotionError):
            return False
        return found.offset_std < MAX_OFFSET_SHARE * interval and abs(found.offset) < interval

    def _at_rest(self) -> tuple[float, float] | None:
        """Return the offsets within which the robot stands still at every picture, if they include 0."""
        found = offsets_at_rest(*_by_time(self.robot), np.sort(self.camera.timestamps), 0.0)
        return found if found is not None and found[0] <= 0.0 <= found[1] else None

    def _pairs(self, match: Match, setup: str) -> PosePairs:
        robot, camera, times = self.robot, self.camera, self.camera.timestamps[match.camera]
        joints = None if robot.joints is None else robot.joints[match.robot]
        sources = tuple(side.source for side in (robot, camera) if side.source is not None)
        poses = robot.poses[match.robot], camera.poses[match.camera]
        return with_covariance(PosePairs(*poses, setup, times, sources=sources, joints=joints), camera)

    def _decided(self, pairs: PosePairs, match: Match, setup: str) -> PosePairs:
        """Return the pairs with the solution of each pose of a tag that agrees with the robot."""
        if self.minima is None:
            return pairs
        from .tags import decide_stream

        decided = decide_stream(pairs, self.camera, self.minima)
        if decided is None or not decided.changed:
            return pairs
        _log.info("%s: %d poses of the tag were changed to agree with the robot", self.name, decided.changed)
        return self._replace(camera=decided.stream)._pairs(match, setup)

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
        return self._replace(camera=decided.stream)._on_one_clock(how, again=True) if decided.changed else found

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
            if failures and (at_rest := self._at_rest()) is not None:
                low, high = at_rest
                values = {"low": low, "high": high}
                said = Finding("synchronisation.open_within_stops", "note", values)
                _log.log(info, "%s The stamps of the bag are taken as those of one clock.", said)
            elif failures:
                _log.log(
                    warning,
                    "The clock offset was not estimated: %s The stamps of the bag are taken as those of one clock, as "
                    "with --offset 0. A delay of the camera is not covered.",
                    failures[0],
                )
            return found
        raise failures[0]


def _by_time(stream: Stream) -> tuple[Array, Array]:
    """Return times and poses of a stream in the order of time."""
    order = np.argsort(stream.timestamps, kind="stable")
    return stream.timestamps[order], stream.poses[order]


def _jumps(stream: Stream) -> bool:
    """Return whether most poses of a stream are so far from the one before that nothing can be interpolated."""
    R = _by_time(stream)[1][:, :3, :3]
    return bool(np.median(rotation_angles(R[:-1].mT @ R[1:])) > JUMP_RAD)


def _side(role: str, stream: Stream) -> Side:
    """Return the poses of a stream as those of a file."""
    return Side(role, stream.poses[:, :3, 3], stream.poses[:, :3, :3], stream.timestamps)
