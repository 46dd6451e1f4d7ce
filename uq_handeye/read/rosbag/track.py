"""Rows of numbers at times as they arrive in a recording, and the poses of one pair of frames among them."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.conventions import CovarianceReading
from ...core.geometry.se3 import Array
from ...core.limits import MAX_LISTED, MAX_ROWS
from ...errors import InputError
from ...formats.contents import FRAMES, Side, finished
from ...formats.ros_messages import Stamped
from ...model.camera.adjustment.two_minima import Minima

FIELDS = ("stamp", *(f"translation.{a}" for a in "xyz"), *(f"rotation.{a}" for a in "xyzw"))
# Parent and child of a transform.
Pair = tuple[str, str]


class Samples:
    """Rows of ``width`` numbers at times (s), in the order of their arrival, at most `MAX_ROWS`."""

    def __init__(self, name: str, width: int) -> None:
        self.name, self._width = name, 1 + width  # the name is for messages
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._values) // self._width

    def add(self, time: float, numbers: Iterable[float]) -> None:
        """Append one row."""
        if len(self) >= MAX_ROWS:
            raise InputError(f"{self.name}: expected at most {MAX_ROWS} rows, got more; cut the bag into pieces.")
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
        self._covariances = array("d")

    def add_pose(self, time: float, record: Stamped) -> None:
        """Append a pose, with its covariance where it has one."""
        self.add(time, record.numbers)
        if record.covariance is not None:
            self._covariances.extend(record.covariance)

    @property
    def covariances(self) -> Array | None:
        """(n, 6, 6) of `values`, in the convention of ROS; None where not every pose has one."""
        if not len(self) or len(self._covariances) != 36 * len(self):
            return None
        S = np.array(self._covariances).reshape(-1, 6, 6)
        return np.asarray(S[np.unique(self.rows[:, 0], return_index=True)[1]])

    @property
    def repeated(self) -> int:
        """Number of poses that repeat a time."""
        return len(self) - len(self.values)

    @property
    def moves(self) -> bool:
        """True if the poses differ: transforms that are always the same are static, too."""
        table = self.rows
        return not self.static and bool((table[:, 1:] != table[0, 1:]).any())

    def poses(self) -> tuple[NDArray[np.float64], Array]:
        """Return times (n,) and poses (n, 4, 4) ``parent_T_child``; raises `InputError` for rows that are no poses."""
        side = self.side
        assert side.timestamps is not None
        return side.timestamps.copy(), finished(side, "robot", "m", None, FRAMES["robot"][0])

    @property
    def side(self) -> Side:
        """The poses as those of a file."""
        table = self.values
        return Side(
            self.name, table[:, 1:4], table[:, 4:], table[:, 0], None, "pose", "xyzw", FIELDS,
            covariance=self.covariances, convention="ros",
        )  # fmt: skip


class TimedPoses(NamedTuple):
    """Poses of one side of the calibration, and notes on where they come from."""

    times: NDArray[np.float64]  # (n,) s
    poses: Array  # (n, 4, 4)
    notes: list[str]
    minima: Minima | None = None  # both solutions of the poses of a tag; ``poses`` are the better ones
    covariance: Array | None = None  # (n, 6, 6) of the poses as they are here
    read_as: CovarianceReading | None = None  # how it was read


def listed(names: list[str], nothing: str = "none") -> str:
    """Return the names that a message lists."""
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    return f"{', '.join(names[:MAX_LISTED]) or nothing}{more}"
