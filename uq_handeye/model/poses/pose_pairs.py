"""`PosePairs`: robot and camera poses taken at the same moments, with joint values where there are any.

Frames: ``robot[k] = base_T_gripper(k)``, ``camera[k] = camera_T_target(k)``. Two setups:

- ``eye-in-hand``: the camera sits on the gripper, the target does not move; ``X = gripper_T_camera`` and
  ``base_T_gripper X camera_T_target = base_T_target`` is constant.
- ``eye-to-hand``: the camera does not move, the target sits on the gripper; ``X = base_T_camera`` and
  ``gripper_T_base X camera_T_target = gripper_T_target`` is constant. It is the same equation with the
  robot poses inverted.

Rows are selected by their numbers, counted from 0 in the order of the data.

"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ...core.files.one_line import require_name
from ...core.files.source import Source
from ...core.geometry.checks import as_numbers, as_transforms, first_duplicate
from ...core.geometry.conventions import CovarianceReading
from ...core.geometry.frames import SETUPS
from ...core.geometry.se3 import Array, inverse
from ...core.read_only import read_only
from ...errors import InputError, require_one_of
from ...findings import Finding
from ..errors.joint_covariance import Index, JointCovariance
from .scene_facts import SceneFacts
from .timing import Timing

if TYPE_CHECKING:
    from ..camera.result import CameraCalibration


def as_joint_values(value: ArrayLike, n: int) -> Array:
    """Return the joint values of n poses as a read-only array (n, L); raise `InputError` for anything else."""
    joints = np.array(as_numbers(value, "joints"))
    if joints.ndim != 2 or len(joints) != n or joints.shape[1] == 0:
        raise InputError(
            f"Expected `joints` to have shape ({n}, L), a row of joint values for each pose, got {joints.shape}."
        )
    if not np.isfinite(joints).all():
        row, column = (int(k) for k in np.argwhere(~np.isfinite(joints))[0])
        raise InputError(f"Expected finite `joints`, got {joints[row, column]} in pose {row}, joint {column}.")
    joints.flags.writeable = False
    return joints


def joint_values_at(times: Array, joints: Array, wanted: Array) -> Array:
    """Interpolate joint values (n, L) at increasing ``times`` (n,) linearly: (m, L) at the times ``wanted`` (m,).

    A step of a joint by more than half a turn is taken as it is in the data, not the short way round: joint values
    count turns.
    """
    return np.stack([np.interp(wanted, times, column) for column in joints.T], axis=-1)


class Truth(NamedTuple):
    """True values of a simulation."""

    X: Array  # (4, 4)
    W: Array  # (4, 4): base_T_target (eye-in-hand) or gripper_T_target (eye-to-hand)
    robot: Array  # (n, 4, 4), without noise
    camera: Array  # (n, 4, 4), without noise


class Names(NamedTuple):
    """Names of arm, camera and target, as those of a rig have them."""

    arm: str = "arm"
    camera: str = "camera"
    target: str = "target"


NAMES = Names()


@dataclass(frozen=True, eq=False)
class PosePairs:
    """n pairs of poses, validated once and never changed.

    Parameters
    ----------
    robot : (..., n, 4, 4) array or RigidTransform
        ``base_T_gripper``.
    camera : (..., n, 4, 4) array or RigidTransform
        ``camera_T_target``.
    setup : "eye-in-hand" or "eye-to-hand"
    timestamps : (n,) array or None
        Seconds; no two may be equal.
    truth : Truth or None
        Known for simulated poses.
    sources : tuple of Source
        The files they came from.
    timing : Timing or None
        Of poses that `synchronise` paired: their time offset and how it moves them.
    camera_calibration : CameraCalibration or None
        Where the camera poses come from corners (`calibrate_camera`): their joint covariance, and the corners.
    camera_covariance : JointCovariance or None
        Where the camera poses come from points in 3-D (`poses_from_points`): the joint covariance of their errors.
    camera_read_as : CovarianceReading or None
        Where ``camera_covariance`` was read with the poses from a file of another program: in which convention. It does
        not contain errors of the intrinsics then.
    scene : SceneFacts or None
        Where the camera poses come from pictures of a scene (`scene_poses`): their scale is one more unknown.
    joints : (n, L) array or None
        Joint values of the robot at each pose (rad, or m for prismatic joints), in the order of its chain.
    findings : tuple of Finding
        What looked wrong when the files were read; `calibrate` adds it to the findings of its result.
    names : Names
        What arm, camera and target are called.

    Raises
    ------
    InputError
        Wrong shapes, matrices that are not rigid motions, different numbers of poses, repeated timestamps, a timing of
        other poses, joint values that are not finite or of another number of poses.
    """

    robot: Array
    camera: Array
    setup: str = "eye-in-hand"
    timestamps: NDArray[np.float64] | None = None
    truth: Truth | None = None
    sources: tuple[Source, ...] = ()
    timing: Timing | None = None
    camera_calibration: CameraCalibration | None = None
    joints: Array | None = None
    camera_covariance: JointCovariance | None = None
    findings: tuple[Finding, ...] = ()
    names: Names = NAMES
    camera_read_as: CovarianceReading | None = None
    scene: SceneFacts | None = None

    def __post_init__(self) -> None:
        require_one_of("setup", self.setup, SETUPS)
        for name in self.names:
            require_name(name)
        robot, camera = frozen_poses(self.robot, "robot"), frozen_poses(self.camera, "camera")
        if robot.shape != camera.shape:
            raise InputError(
                "Expected `robot` and `camera` to hold the same number of poses, "
                f"got shapes {robot.shape} and {camera.shape}."
            )
        object.__setattr__(self, "robot", robot)
        object.__setattr__(self, "camera", camera)
        object.__setattr__(self, "truth", read_only(self.truth))
        if self.timestamps is not None:
            object.__setattr__(self, "timestamps", checked_times(self.timestamps, self.n))
        if self.timing is not None and (self.robot.ndim != 3 or len(self.timing) != self.n):
            raise InputError(f"Expected the `timing` of {self.n} poses, got one of {len(self.timing)}.")
        if self.joints is not None:
            object.__setattr__(self, "joints", as_joint_values(self.joints, self.n))
        seen = self.camera_calibration
        if seen is not None and not np.array_equal(seen.poses, self.camera):
            raise InputError("Expected the `camera` poses to be those of the `camera_calibration`, got others.")
        S = self.camera_covariance
        if S is not None and (seen is not None or S.own.ndim != 3 or self.robot.ndim != 3 or S.n != self.n):
            raise InputError(
                f"Expected `camera_covariance` of these {self.n} poses and no `camera_calibration` beside it, got that "
                f"of {S.n} poses."
            )

    @property
    def poses(self) -> PosePairs:
        """Itself: motions have the poses that they were made of by this name."""
        return self

    @property
    def n(self) -> int:
        """Number of poses."""
        return int(self.robot.shape[-3])

    def __len__(self) -> int:
        return self.n

    def __getitem__(self, index: int | slice | Index | list[int]) -> PosePairs:
        """Some of the poses, as `rows`: by a number, a slice, numbers or a mask."""
        return self.rows(np.atleast_1d(np.arange(self.n)[index]))

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Array:
        raise InputError("Expected an array of poses, got PosePairs, which hold two: `robot` and `camera`.")

    def __repr__(self) -> str:
        return f"PosePairs({self.n} poses, {self.setup})"

    def rows(self, index: Index, camera_index: Index | None = None) -> PosePairs:
        """Some of the poses, by their numbers or a mask, with all that is known about them.

        Camera rows other than those of the robot pair the two again; timestamps and joints are those of the robot rows.
        """
        of = {"robot": index, "camera": index if camera_index is None else camera_index}
        robot, camera = (getattr(self, side)[..., rows, :, :] for side, rows in of.items())
        truth = self.truth
        if truth is not None:
            truth = truth._replace(**{side: getattr(truth, side)[..., rows, :, :] for side, rows in of.items()})
        times = None if self.timestamps is None else self.timestamps[index]
        timing = None if self.timing is None else self.timing.rows(of[self.timing.side])
        seen = None if self.camera_calibration is None else self.camera_calibration.select(of["camera"])
        joints = None if self.joints is None else self.joints[index]
        S = None if self.camera_covariance is None else self.camera_covariance.rows(of["camera"])
        return replace(
            self,
            robot=robot,
            camera=camera,
            timestamps=times,
            truth=truth,
            timing=timing,
            camera_calibration=seen,
            joints=joints,
            camera_covariance=S,
        )

    def scaled(self, factor: float) -> PosePairs:
        """Return the poses with the lengths of the camera, and their errors, times a factor."""
        camera = self.camera.copy()
        camera[..., :3, 3] *= factor
        S = self.camera_covariance
        if S is not None:
            D = np.repeat([1.0, factor], 3)
            S = JointCovariance(D[:, None] * S.own * D, D[:, None] * S.shared, S.keys)
        return replace(self, camera=camera, camera_covariance=S)

    @property
    def known_camera(self) -> JointCovariance | None:
        """Covariance that the camera poses come with, from corners or from points in 3-D."""
        return self.camera_covariance if self.camera_calibration is None else self.camera_calibration.covariance

    def require_same_scene(self, new: PosePairs) -> None:
        """Raise `InputError` where new camera poses are not in the frame and unit of the scene of these."""
        if self.scene is None and new.scene is None:
            return
        if self.scene is None or new.scene is None or not self.scene.known or new.scene.known != self.scene.known:
            raise InputError(
                "Poses of a scene have the frame and unit of one run. Place new pictures in the scene of the result: "
                "uq-handeye check RESULT ROBOT --images PATTERN --scene, or scene_poses(pictures, robot, result=...)."
            )

    @property
    def camera_known(self) -> bool:
        """True if the camera poses come with their covariance."""
        return self.camera_calibration is not None or self.camera_covariance is not None

    @property
    def intrinsics_covered(self) -> bool:
        """True if the camera poses come with their covariance from corners or points, with errors of the intrinsics."""
        return self.camera_known and self.camera_read_as is None

    @property
    def effective_robot(self) -> Array:
        """The robot poses as they enter AX = XB: inverted for eye-to-hand."""
        return self.robot if self.setup == "eye-in-hand" else inverse(self.robot)


def checked_times(values: ArrayLike, n: int) -> Array:
    """Times of n poses, finite and each once."""
    times = np.array(as_numbers(values, "timestamps"))
    if times.shape != (n,) or not np.isfinite(times).all():
        raise InputError(f"Expected `timestamps` to be {n} finite numbers, got shape {times.shape}.")
    if (twins := first_duplicate(times)) is not None:
        raise InputError(
            f"Expected a timestamp of its own for every pose, got {times[twins[0]]} for poses {twins[0]} and "
            f"{twins[1]}."
        )
    times.flags.writeable = False
    return times


def frozen_poses(value: ArrayLike, name: str) -> Array:
    T = np.array(as_transforms(value, name), order="C")  # rounding follows the order in memory
    T.flags.writeable = False
    return T


def pairs_of(data: Any, camera: Any, setup: str | None) -> Any:
    """Return the pairs of robot and camera poses that are given side by side; without ``camera`` the data."""
    if camera is None and setup is None:
        return data
    if camera is None or isinstance(data, PosePairs):
        raise InputError("Expected `camera` and `setup` beside an array of robot poses only: PosePairs hold them.")
    for name, value in (("robot", data), ("camera", camera)):
        if isinstance(value, str | Path):
            raise InputError(
                f"Expected `{name}` to be poses (n, 4, 4), got a path: read_poses(robot, camera) reads files."
            )
        if not hasattr(value, "__len__"):
            raise InputError(f"Expected `{name}` to be poses (n, 4, 4), got {type(value).__name__}.")
    return PosePairs(data, camera, "eye-in-hand" if setup is None else setup)
