"""`Stream`: poses of one sensor with their times, not yet paired with those of another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.files.source import Source
from ...core.geometry.conventions import CovarianceReading
from ...core.geometry.se3 import Array
from ...errors import InputError
from .pose_pairs import as_joint_values, checked_times, frozen_poses


@dataclass(frozen=True, eq=False)
class Stream:
    """n time-stamped poses, validated once and never changed.

    Parameters
    ----------
    timestamps : (n,)
        Seconds on the clock of this sensor, in any order; no two may be equal.
    poses : (n, 4, 4) array or RigidTransform
        ``base_T_gripper`` of a robot, ``camera_T_target`` of a camera; metres.
    source : Source or None
        The file they came from.
    joints : (n, L) array or None
        Joint values of a robot at each pose (rad, or m for prismatic joints).
    covariance : (n, 6, 6) array or None
        Of the errors of camera poses that come with it.
    read_as : CovarianceReading or None
        In which convention these were read.

    Raises
    ------
    InputError
        Wrong shapes, matrices that are not rigid motions, times that are not finite or repeat, joint values that are
        not finite.
    """

    timestamps: NDArray[np.float64]
    poses: Array
    source: Source | None = None
    joints: Array | None = None
    covariance: Array | None = None
    read_as: CovarianceReading | None = None

    def __post_init__(self) -> None:
        poses = frozen_poses(self.poses, "poses")
        if poses.ndim != 3:
            raise InputError(f"Expected `poses` to have shape (n, 4, 4), got {poses.shape}.")
        times = checked_times(self.timestamps, len(poses))
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "timestamps", times)
        if self.joints is not None:
            object.__setattr__(self, "joints", as_joint_values(self.joints, len(times)))

    def __len__(self) -> int:
        return len(self.timestamps)

    def __repr__(self) -> str:
        return f"Stream({len(self)} poses)"
