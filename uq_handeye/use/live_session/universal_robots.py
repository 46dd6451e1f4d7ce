"""Poses of an arm of Universal Robots by RTDE.

RTDE gives the pose of the tool as x, y, z (m) and a rotation vector (rad), base_T_gripper.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array
from ...errors import InputError, MissingExtraError
from .sources import Side

# Largest speed of the tool (m/s, rad/s) at which a pose is taken.
MAX_TOOL_SPEED = 1e-3


class Receiver(Protocol):
    """The part of ``rtde_receive.RTDEReceiveInterface`` that is used."""

    def getActualTCPSpeed(self) -> list[float]: ...

    def getActualTCPPose(self) -> list[float]: ...

    def disconnect(self) -> None: ...


class Ur(Side):
    """The arm at ``host``, as a side of a pair; its clock is not that of other programs.

    ``receiver`` replaces that of ur_rtde in tests.
    """

    def __init__(self, host: str, receiver: Receiver | None = None) -> None:
        if receiver is None:
            try:
                from rtde_receive import RTDEReceiveInterface
            except ImportError as error:
                raise MissingExtraError("Poses by RTDE need ur_rtde: pip install ur_rtde.") from error
            try:
                receiver = RTDEReceiveInterface(host)
            except RuntimeError as error:
                raise InputError(f"No arm answers by RTDE at {host}: {error}. Check the address.") from error
        self._receiver: Receiver = receiver

    def newest(self) -> tuple[Array, float | None]:
        """Return the pose of this moment; raises `InputError` while the arm moves."""
        speed = float(np.abs(self._receiver.getActualTCPSpeed()).max())
        if speed > MAX_TOOL_SPEED:
            raise InputError(f"The arm moves ({speed:.3f} m/s or rad/s). Take the pose when it stands still.")
        pose = np.asarray(self._receiver.getActualTCPPose(), dtype=float)
        robot = np.eye(4)
        robot[:3, :3], robot[:3, 3] = Rotation.from_rotvec(pose[3:]).as_matrix(), pose[:3]
        return robot, None

    def close(self) -> None:
        """End the connection."""
        self._receiver.disconnect()
