"""Track: the poses of one pair of frames as they arrive in a recording."""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..formats.contents import FRAMES, Side, finished
from ..geometry.se3 import Array

# Poses of one pair of frames.
MOST = 5_000_000
FIELDS = ("stamp", *(f"translation.{a}" for a in "xyz"), *(f"rotation.{a}" for a in "xyzw"))


class Track:
    """Times and poses of one pair of frames, in the order of their arrival."""

    def __init__(self, name: str) -> None:
        self.name = name  # for messages
        self.static = False  # of /tf_static
        self._values = array("d")

    def __len__(self) -> int:
        return len(self._values) // 8

    def add(self, time: float, numbers: tuple[float, ...]) -> None:
        """Append x, y, z, qx, qy, qz, qw at a time (s)."""
        if len(self) >= MOST:
            raise InputError(f"{self.name}: expected at most {MOST} poses, got more; cut the bag into pieces.")
        self._values.append(time)
        self._values.extend(numbers)

    @property
    def values(self) -> Array:
        """(n, 8) time, translation and quaternion, sorted by time; each time once."""
        table = np.array(self._values).reshape(-1, 8)
        _, first = np.unique(table[:, 0], return_index=True)
        return table[first]

    @property
    def repeated(self) -> int:
        """Number of poses whose time stands there before."""
        return len(self) - len(self.values)

    @property
    def moves(self) -> bool:
        """True if the poses differ: transforms that are always the same are static, too."""
        table = np.array(self._values).reshape(-1, 8)
        return not self.static and bool((table[:, 1:] != table[0, 1:]).any())

    def poses(self) -> tuple[NDArray[np.float64], Array]:
        """Return times (n,) and poses (n, 4, 4) ``parent_T_child``; raises `InputError` for what is none."""
        table = self.values
        side = Side(self.name, table[:, 1:4], table[:, 4:], table[:, 0], None, "pose", "xyzw", FIELDS)
        return table[:, 0].copy(), finished(side, "robot", "m", None, FRAMES["robot"][0])

    def last(self) -> Array:
        """Return the last pose (4, 4)."""
        return np.array(self.poses()[1][-1])
