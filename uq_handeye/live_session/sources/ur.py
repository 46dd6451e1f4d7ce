"""Poses of an arm of Universal Robots by RTDE, with camera poses of a function of the user's.

RTDE gives the pose of the tool as x, y, z (m) and a rotation vector (rad), base_T_gripper.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...errors import InputError, MissingExtraError
from ...geometry.se3 import Array
from .source import Pair

# Largest speed of the tool (m/s, rad/s) at which a pose is taken.
STILL = 1e-3


class Ur:
    """Pairs of the arm at ``host`` and of ``camera()``, which returns camera_T_target (4, 4); taken on demand.

    ``receiver`` stands in for that of ur_rtde.
    """

    on_demand, pending = True, False

    def __init__(self, host: str, camera: Callable[[], Array], receiver: Any = None) -> None:
        if receiver is None:
            try:
                from rtde_receive import RTDEReceiveInterface
            except ImportError as error:
                raise MissingExtraError("Poses by RTDE need ur_rtde: pip install ur_rtde.") from error
            receiver = RTDEReceiveInterface(host)
        self.name, self._receiver, self._camera = f"UR {host}", receiver, camera

    def take(self) -> Pair:
        """Return the pair of this moment; raises `InputError` while the arm moves."""
        speed = float(np.abs(self._receiver.getActualTCPSpeed()).max())
        if speed > STILL:
            raise InputError(f"The arm moves ({speed:.3f} m/s or rad/s). Take the pose when it stands still.")
        pose = np.asarray(self._receiver.getActualTCPPose(), dtype=float)
        robot = np.eye(4)
        robot[:3, :3], robot[:3, 3] = Rotation.from_rotvec(pose[3:]).as_matrix(), pose[:3]
        return Pair(robot, np.asarray(self._camera(), dtype=float), float(self._receiver.getTimestamp()))

    def close(self) -> None:
        """End the connection."""
        self._receiver.disconnect()
