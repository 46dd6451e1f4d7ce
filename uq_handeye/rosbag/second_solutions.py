"""Second solutions of the poses of a tag in a stream, decided by the robot as those of pictures are."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..camera.adjustment.initial_guess import Minima
from ..errors import DegenerateMotionError, InputError, NotConvergedError
from ..input_checks.pose_ambiguity import FEWEST, decide
from ..poses.pose_pairs import PosePairs
from ..poses.stream import Stream


class Decided(NamedTuple):
    """The stream with the solutions that the other poses agree with."""

    stream: Stream
    doubtful: int  # poses with two solutions that the corners do not decide between
    changed: int
    undecided: int


def decide_stream(pairs: PosePairs, stream: Stream, minima: Minima) -> Decided | None:
    """Return the camera's stream with the solution of each pose that robot and other poses agree with.

    ``pairs`` are those of the stream as it is, its poses not interpolated. None: nothing is in doubt, the poses of the
    pairs are not those of the stream, or they do not determine X.
    """
    row_of = {pose.tobytes(): k for k, pose in enumerate(np.ascontiguousarray(stream.poses))}
    found = [row_of.get(pose.tobytes()) for pose in np.ascontiguousarray(pairs.camera)]
    if len(found) < FEWEST or any(row is None for row in found):
        return None
    rows = np.array(found, dtype=np.intp)
    here = Minima(minima.poses[:, rows], minima.own[:, rows], minima.squares[:, rows])
    if not here.doubtful.any():
        return None
    try:
        chosen = decide(pairs, here)
    except (DegenerateMotionError, InputError, NotConvergedError):
        return None
    poses = np.array(stream.poses)
    poses[rows] = here.poses[chosen.label, np.arange(len(rows))]
    counts = (int(part.sum()) for part in (chosen.doubtful, chosen.label == 1, chosen.undecided))
    return Decided(replace(stream, poses=poses), *counts)
