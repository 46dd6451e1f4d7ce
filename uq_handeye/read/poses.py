"""Pose files of any format, paired to `PosePairs` or read as a `Stream`."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypedDict, Unpack

import numpy as np

from ..core.files.open import StrPath, as_path, shown
from ..core.files.source import Source
from ..core.geometry.conventions import CovarianceReading
from ..core.geometry.frames import CAMERA_CONVENTIONS, SETUPS
from ..core.geometry.se3 import Array
from ..core.limits import MAX_PLAIN_LENGTH_M, MIN_POSES
from ..errors import InputError, InputWarning, among, keywords_of, require_known, require_one_of
from ..findings import Finding
from ..fit.diagnostics.repeated_rows import SAME_NUMBER
from ..formats.contents import FRAMES, Contents, Side, finished
from ..formats.csv_poses import warn_if_back
from ..formats.detect import read_contents
from ..formats.rotations import QUATERNIONS, rotation_form
from ..model.errors.joint_covariance import JointCovariance
from ..model.poses.pose_pairs import PosePairs
from ..model.poses.stream import Stream
from .camera_covariance import camera_covariance
from .joints import Joints, give_joints, joints_of
from .known_camera import KnownCamera, known_camera
from .pairing_by_rows import check_rows, require_as_many, warn_if_swapped
from .pairing_by_time import match_times
from .readings import chosen_readings, reading_of_robot

if TYPE_CHECKING:
    from ..model.camera.result import CameraCalibration
    from ..model.kinematics.chain import Kinematics
    from ..model.points.result import PointPoses
    from ..scene.result import ScenePoses


class OfArm(TypedDict, total=False):
    """Arguments of `read_stream` about the joints of the robot."""

    joints: StrPath | None
    kinematics: Kinematics | None
    joint_units: str | None


PAIRINGS = ("rows", "time")
# Something of the robot's side and of the camera's.
Two = tuple[str | None, str | None]

_log = logging.getLogger("uq_handeye")


def read_poses(
    robot: StrPath | None,
    camera: StrPath | CameraCalibration | PointPoses | ScenePoses | None = None,
    **options: Any,
) -> PosePairs:
    """Robot and camera poses from one or two files, paired.

    Parameters
    ----------
    robot : path or None
        ``base_T_gripper``; any of `uq_handeye.read.FORMATS`. None: the poses are those of ``joints``, by forward
        kinematics.
    camera : path, CameraCalibration, PointPoses, ScenePoses or None
        ``camera_T_target``. None: the robot's file holds both sides. A calibrated camera, or the folder that
        `CameraCalibration.write` made of it, brings the joint covariance of its poses along (field
        ``camera_calibration``); its rows number those of the robot's file, and robot poses without a picture are left
        out. Poses from points, or the folder of `PointPoses.write`, bring theirs likewise (``camera_covariance``),
        and so do those of a scene (`scene_poses`), whose scale is unknown. Units, format and rotation are then those
        of the robot's file.
    setup : "eye-in-hand", "eye-to-hand" or None
        None: what a file says, else eye-in-hand.
    units : str, None or (robot, camera)
        Length unit of both sides, or of the robot's and the camera's: m, mm, ...; None: as the format says, else m. The
        poses returned are in metres.
    format : str, None or (robot, camera)
        One of `FORMATS`; None is told by the content.
    rotation : str, None or (robot, camera)
        What the numbers of a rotation are: an order of Euler angles with its unit as SciPy names it (``"ZYX-deg"``:
        about the rotated axes; ``"xyz-rad"``: about the fixed axes), ``"rotvec-rad"``, ``"rotvec-deg"``, ``"xyzw"`` or
        ``"wxyz"``; ``"transposed"`` of matrices. None: as the format or the names of the columns say; where these leave
        several, the one with which robot and camera agree.
    quaternion : "xyzw", "wxyz", None or (robot, camera)
        The same for quaternions only.
    robot_frame : "base_T_gripper" or "gripper_T_base"
        Poses given as ``gripper_T_base`` are inverted.
    camera_frame : "camera_T_target" or "target_T_camera"
        Poses given as ``target_T_camera`` are inverted.
    camera_convention : "optical", "opengl", "ros", "wpilib" or None
        Frame of the camera that the camera poses are of, converted to the optical frame (x right, y down, z ahead):
        opengl looks along -z with y up; ros and wpilib are bodies with x ahead and z up. None: optical, and doubted
        where the camera would not see its target.
    pair : None, "rows" or "time"
        Row k of one side with row k of the other, unless timestamps or numbers of files speak against it (None) or in
        any case ("rows"); or those nearest in time, within ``tolerance``, one to one.
    tolerance : float
        Seconds.
    covariance_convention : str or None
        Convention of the covariances that come with the camera poses, a name in `conventions.CONVENTIONS`, with commas
        also ``information``, ``inverse`` and ``pixel_sd=0.2``. None: that of ROS for its messages, else the toolkit's.
    joints : path or None
        File of joint values (`read_joints`), for the ``joints`` of the pairs. Without ``robot`` its rows are paired as
        those of a robot file; beside it row k belongs to row k of ``robot``, or to the nearest within ``tolerance``
        where timestamps say so, and pairs without joints are left out.
    kinematics : Kinematics or None
        The chain that the joints move.
    joint_units : str or None
        Unit of ``joints`` such as ``"deg"`` or ``"deg,mm"``; None: as the file says, else rad and m.

    What was found out (format, setup, other names) is in the ``notes`` of `PosePairs.sources`, and logged.

    Raises
    ------
    InputError
        A file that cannot be read or is of no format that is known, or whose rotations may be read in several ways
        between which the other side does not decide; a setup other than what a file says; different
        numbers of rows; without ``pair``, timestamps of a row that differ by half the interval between rows or more
        (two row numberings are such timestamps too: if they differ, a row was lost in one file); fewer than three pairs
        by time.

    Warns
    -----
    InputWarning
        Timestamps of a row that differ by more than 1e-6 s but less than that, or that go back; samples of easy_handeye
        that do not say the setup; angles with which robot and camera do not agree, where another order of axes fits.
    """
    require_known("read_poses", options, ReadRequest)
    request = ReadRequest(**options)
    if robot is None:
        if request.arm is None or camera is None:
            missing = "joints and kinematics" if request.arm is None else "a camera"
            raise InputError(f"Expected {missing}, or a file of robot poses.")
        request = request.of_camera()
    seen = known_camera(camera)
    if seen is not None:
        if request.camera_convention not in (None, "optical"):
            raise InputError("A calibrated camera is optical: leave `camera_convention` (--camera-convention) out.")
        return _with_calibrated(robot, seen, request)
    assert camera is None or isinstance(camera, str | PathLike)
    poses = _of_files(robot, camera, request)
    return poses if request.camera_convention is None else in_convention(poses, request.camera_convention)


def in_convention(poses: PosePairs, name: str) -> PosePairs:
    """Return the poses with the camera in the optical frame, from a convention by its name."""
    turn = CAMERA_CONVENTIONS[name]
    if poses.camera_covariance is not None and not np.array_equal(turn, np.eye(4)):
        raise InputError(
            f"Camera poses with covariances are taken in the optical frame, not as {name}: convert both where they are "
            "written, or leave the covariances out."
        )
    said = Finding("poses.camera_convention", "note", {"name": name})
    return replace(poses, camera=turn @ poses.camera, findings=(*poses.findings, said))


@dataclass(frozen=True, eq=False)
class ReadRequest:
    """Keywords of `read_poses`, checked."""

    setup: str | None = None
    units: str | Two | None = None
    format: str | Two | None = None
    rotation: str | Two | None = None
    quaternion: str | Two | None = None
    robot_frame: str = FRAMES["robot"][0]
    camera_frame: str = FRAMES["camera"][0]
    camera_convention: str | None = None
    pair: str | None = None
    tolerance: float = 0.02
    joints: StrPath | None = None
    kinematics: Kinematics | None = None
    joint_units: str | None = None
    covariance_convention: str | CovarianceReading | None = None

    def __post_init__(self) -> None:
        if self.pair is not None and not among(self.pair, PAIRINGS):
            hint = "; async is `uq_handeye.synchronise` of two `read_stream`" if self.pair == "async" else ""
            raise InputError(f"Expected `pair` (--pair) to be {' or '.join(PAIRINGS)}, got {self.pair!r}{hint}.")
        if self.camera_convention is not None:
            require_one_of("camera_convention", self.camera_convention, CAMERA_CONVENTIONS, "--camera-convention")
        if self.setup is not None:
            require_one_of("setup", self.setup, SETUPS, "--setup")
        _ = self.sides, self.arm, self.reading

    @property
    def reading(self) -> CovarianceReading | None:
        """Reading of the covariances of camera poses; None: as the file says."""
        stated = self.covariance_convention
        return CovarianceReading.parse(stated) if isinstance(stated, str) else stated

    @cached_property
    def sides(self) -> tuple[Two, Two, Two]:
        """Units, formats and forms of the rotations, each of robot and camera."""
        return _two(self.units, "units"), _two(self.format, "format"), _rotations(self.rotation, self.quaternion)

    @cached_property
    def arm(self) -> Joints | None:
        """The joint values and the chain that they move."""
        return joints_of(self.joints, self.kinematics, self.joint_units)

    @property
    def frames(self) -> tuple[str, str]:
        """Frames of robot and camera poses."""
        return self.robot_frame, self.camera_frame

    def of_camera(self) -> ReadRequest:
        """Return the request where the poses of the robot are those of joint values."""
        units, formats, forms = ((None, of_camera) for _, of_camera in self.sides)
        return replace(
            self, units=("m", units[1]), format=formats, rotation=forms, quaternion=None, robot_frame=FRAMES["robot"][0]
        )


read_poses.__signature__ = keywords_of(read_poses, ReadRequest)  # type: ignore[attr-defined]


def _of_files(robot_file: StrPath | None, camera: StrPath | None, request: ReadRequest) -> PosePairs:
    """Return the poses of two files, or of one that holds both sides (``camera`` is None)."""
    units, formats, forms = request.sides
    robot = _robot_of(robot_file, request.arm, formats[0])
    first = robot.contents
    sources: tuple[Source, ...] = (robot.source,)
    contents, paths = (first, first), (robot.path, robot.path)
    if camera is not None:
        second, source = read_contents(as_path(camera), formats[1])
        sources, contents, paths = (*sources, source), (first, second), (robot.path, as_path(camera))
    elif first.robot is None or first.camera is None:
        raise InputError(
            f"{shown(robot.path)} holds poses of one side only ({robot.source.format}); give the file of the other "
            "side as well, the robot's first."
        )
    said = request.setup is not None or any(one.setup is not None for one in contents)
    setup = _setup(request.setup, contents, paths)
    if setup == "eye-to-hand":  # with a camera on the hand the length of X shows it
        warn_if_swapped(*paths)
    sides = [side_of(contents[k], role, shown(paths[k])) for k, role in enumerate(FRAMES)]
    frames = list(request.frames)
    if contents[0].robot_enters and setup == "eye-to-hand":
        frames[0] = FRAMES["robot"][1]
        sources = _noted(sources, 0, paths[0], ["robot poses are gripper_T_base in this format, and inverted"])
    inverted = _inverted(request.frames, said)
    if not said and frames[1] != FRAMES["camera"][0]:
        note = (
            "poses inverted, as target_T_camera; if the camera is fixed, give --setup eye-to-hand and no --camera-frame"
        )
        sources = _noted(sources, len(sources) - 1, paths[1], [note])
    robot_times, camera_times = sides[0].timestamps, sides[1].timestamps
    match = match_times(sides[0], sides[1], request.tolerance) if request.pair == "time" else None
    if match is None and min(map(len, sides)) >= MIN_POSES:
        require_as_many(sides[0], sides[1])
    rows = (slice(None), slice(None)) if match is None else (match.robot, match.camera)
    chosen = chosen_readings(sides, units, forms, frames, rows, setup)
    for k, note in enumerate(chosen.notes):
        if note:
            sources = _noted(sources, min(k, len(sources) - 1), paths[k], [note], chosen.sides[k].readings[0].format)
    sides = chosen.sides
    robot_poses, camera_poses = (finished(*side) for side in zip(sides, FRAMES, units, forms, frames, strict=True))
    values, every_camera = robot.joints_at(sides[0], request.tolerance), camera_poses
    if match is not None:
        robot_poses, camera_poses = robot_poses[match.robot], camera_poses[match.camera]
        assert robot_times is not None
        robot_times = robot_times[match.robot]
        values = None if values is None else values[match.robot]
        sources = _noted(sources, 0, paths[0], match.notes)
    else:
        for side in sides if camera is not None else sides[:1]:
            warn_if_back(side)
        sources = _noted(sources, 0, paths[0], check_rows(sides[0], sides[1], request.pair == "rows"))
        robot_times = camera_times if robot_times is None else robot_times
    sources = (*sources, *robot.joint_source)
    findings = (*chosen.findings, *inverted, *_stated_units(units))
    S, reading, note = camera_covariance(sides[1], units[1], forms[1], frames[1], every_camera, request.reading)
    if note:
        sources = _noted(sources, len(sources) - 1 - len(robot.joint_source), paths[1], [note])
    poses = PosePairs(
        robot_poses,
        camera_poses,
        setup,
        robot_times,
        sources=sources,
        findings=findings,
        camera_covariance=None if S is None else JointCovariance.of_each(S if match is None else S[match.camera]),
        camera_read_as=reading,
    )
    return robot.give_joints(poses, values)


def require_robot(robot: StrPath | None, pictures: int, options: Mapping[str, Any]) -> None:
    """Raise `InputError` for robot poses that cannot go with so many pictures: before these are searched, which takes
    long.

    Fewer poses than pictures, or poses that are all the same; joints and options that cannot be read.
    """
    request = ReadRequest(**options)
    if robot is None and request.arm is None:
        return
    found = _robot_of(robot, request.arm, request.sides[1][0])
    side = side_of(found.contents, "robot", shown(found.path))
    if len(side) < pictures:
        raise InputError(
            f"{side.name} has {len(side)} poses, and there are {pictures} pictures: expected a robot pose for each."
        )
    numbers = np.column_stack([side.translation, side.rotation.reshape(len(side), -1)])
    if len(side) > 1 and np.ptp(numbers, axis=0).max() < SAME_NUMBER:
        raise InputError(
            f"{side.name}: all {len(side)} poses are the same. Either the robot did not move, or one pose was written "
            "again and again."
        )


class _Robot(NamedTuple):
    """Robot poses of a file, or of joint values by forward kinematics."""

    path: Path
    contents: Contents
    source: Source
    file: bool  # whether a file holds the poses
    arm: Joints | None

    def joints_at(self, side: Side, tolerance: float) -> Array | None:
        """Return the joint values at the rows of the robot, and those of a longer series of columns behind them."""
        if self.arm is None:
            return None
        arm = self.arm
        if arm.series is not None:
            arm = replace(arm, values=np.hstack([arm.values, arm.series.values]))
        return arm.at_rows(side, tolerance) if self.file else arm.values

    def give_joints(self, poses: PosePairs, values: Array | None) -> PosePairs:
        """Return the pairs with the joint values of `joints_at` at their rows, in the reading that the poses show."""
        if self.arm is None or values is None:
            return poses
        from .joint_readings import read_by_the_poses

        L = self.arm.kinematics.n_joints
        poses = give_joints(poses, values[:, :L], self.arm.name)
        rows = np.isfinite(values[:, :L]).all(axis=1)
        series = None if self.arm.series is None else values[rows, L:]
        return read_by_the_poses(poses, self.arm, series, by_controller=self.file)

    @property
    def joint_source(self) -> tuple[Source, ...]:
        """The source of joints beside a file of robot poses; without one they are the robot's source."""
        return () if self.arm is None or not self.file else (self.arm.source,)


def _robot_of(robot: StrPath | None, arm: Joints | None, format: str | None) -> _Robot:
    if robot is not None:
        path = as_path(robot)
        return _Robot(path, *read_contents(path, format), True, arm)
    assert arm is not None
    return _Robot(Path(arm.name), Contents(robot=arm.side), arm.source, False, arm)


def _with_calibrated(robot_file: StrPath | None, seen: KnownCamera, request: ReadRequest) -> PosePairs:
    """The robot poses of a file that the pictures or points were taken at, and the camera poses."""
    if request.pair == "time" or request.frames[1] != FRAMES["camera"][0]:
        raise InputError(
            "A calibrated camera goes with its rows and as camera_T_target: leave `pair` (--pair) and "
            "`camera_frame` (--camera-frame) out."
        )
    frame, (units, format, rotation) = request.robot_frame, (pair[0] for pair in request.sides)
    robot = _robot_of(robot_file, request.arm, format)
    path, contents, source, *_ = robot
    setup = _setup(request.setup, (contents, contents), (path, path))
    side = side_of(contents, "robot", shown(path))
    sources: tuple[Source, ...] = (source,)
    if contents.robot_enters and setup == "eye-to-hand":
        frame = FRAMES["robot"][1]
        sources = _noted(sources, 0, path, ["robot poses are gripper_T_base in this format, and inverted"])
    rows, notes = seen.rows_of(len(side), side.name, "poses" if robot.file else "rows")
    chosen = reading_of_robot(side, seen.poses, rows, units, rotation, frame, setup)
    side = chosen.sides[0]
    sources = _noted(sources, 0, path, [note for note in chosen.notes if note])
    poses = finished(side, "robot", units, rotation, frame)
    warn_if_back(side)
    values = robot.joints_at(side, request.tolerance)
    sources = _noted(sources, 0, path, notes)
    times = None if side.timestamps is None else side.timestamps[rows]
    sources = (*sources, *robot.joint_source, *seen.source)
    findings = (*chosen.findings, *_inverted(request.frames, True))
    covariance = None if seen.points is None else seen.points.covariance
    pairs = PosePairs(
        poses[rows],
        seen.poses,
        setup,
        times,
        sources=sources,
        findings=findings,
        camera_covariance=covariance,
        camera_calibration=seen.pictures,
    )
    if seen.scene is not None:
        pairs = seen.scene.paired(pairs)
    return robot.give_joints(pairs, None if values is None else values[rows])


def read_robot(
    path: StrPath | None,
    *,
    units: str | None = None,
    format: str | None = None,
    rotation: str | None = None,
    frame: str | None = None,
    setup: str = "eye-in-hand",
    **of_arm: Unpack[OfArm],
) -> Array:
    """Return the robot poses (n, 4, 4) of a file in the order of its rows, with or without timestamps, in metres.

    Arguments are those of `read_poses`; without ``path`` the poses are those of the joints. Raises `InputError` for
    poses without a unit that are no metres: pictures of a scene do not tell the unit.
    """
    arm = joints_of(of_arm.get("joints"), of_arm.get("kinematics"), of_arm.get("joint_units"))
    if path is None:
        if arm is None:
            raise InputError("Expected a file of poses, or joints and kinematics.")
        units, format, rotation, frame = "m", None, None, None
    location, contents, *_ = _robot_of(path, arm, format)
    side = side_of(contents, "robot", shown(location))
    if contents.robot_enters and setup == "eye-to-hand":
        frame = FRAMES["robot"][1]
    poses = finished(side, "robot", units, rotation, FRAMES["robot"][0] if frame is None else frame)
    away = float(np.median(np.linalg.norm(poses[:, :3, 3], axis=-1)))
    if units is None and away > MAX_PLAIN_LENGTH_M:
        raise InputError(
            f"{side.name}: the robot is {away:.0f} m from its base. In millimetres? Give --units robot=mm."
        )
    return poses


def read_stream(
    path: StrPath | None,
    side: str,
    *,
    units: str | None = None,
    format: str | None = None,
    rotation: str | None = None,
    quaternion: str | None = None,
    frame: str | None = None,
    **of_arm: Unpack[OfArm],
) -> Stream:
    """The time-stamped poses of one sensor.

    Parameters
    ----------
    path : path
        Any of `uq_handeye.read.FORMATS` that has timestamps; of a file with both sides, ``side`` is taken.
    side : "robot" or "camera"
        The poses returned are ``base_T_gripper`` or ``camera_T_target``, in metres.
    units, format, rotation, quaternion
        As in `read_poses`; streams do not decide between several readings.
    frame : "base_T_gripper", "gripper_T_base", "camera_T_target", "target_T_camera" or None
        What the file holds; None: what it says, else the first of the side.
    joints, kinematics, joint_units
        As in `read_poses`, of the robot: without ``path`` the poses are theirs; beside it they are interpolated at the
        times of the poses, and poses outside of their times are left out.

    Raises
    ------
    InputError
        A file that cannot be read or is of no format that is known, or that has no timestamps.
    """
    if not among(side, FRAMES):
        raise InputError(f"Expected `side` to be robot or camera, got {side!r}.")
    require_known("read_stream", of_arm, OfArm)
    arm = joints_of(of_arm.get("joints"), of_arm.get("kinematics"), of_arm.get("joint_units"))
    if arm is not None and side != "robot":
        raise InputError("Expected `joints` of the robot, not of the camera.")
    if path is None:
        if arm is None:
            raise InputError("Expected a file of poses, or joints and kinematics.")
        units, format, rotation, quaternion, frame = "m", None, None, None, None
    location, contents, source, *_ = _robot_of(path, arm, format)
    found = side_of(contents, side, shown(location))
    form = _rotations(rotation, quaternion)[0]
    poses = finished(found, side, units, form, FRAMES[side][0] if frame is None else frame)
    if found.timestamps is None:
        raise InputError(
            f"{found.name} has no timestamps ({source.format}), and streams are put together by time; if its rows "
            "belong to those of the other file, use --pair rows."
        )
    if contents.setup is not None:
        note = f"it says {contents.setup}, which a stream does not carry: give it to synchronise() as setup (--setup)"
        (source,) = _noted((source,), 0, location, [note])
    if arm is None:
        S, reading, note = None, None, ""
        if side == "camera":
            S, reading, note = camera_covariance(found, units, form, frame or FRAMES[side][0], poses)
        if note:
            (source,) = _noted((source,), 0, location, [note])
        return Stream(found.timestamps, poses, source, covariance=S, read_as=reading)
    values = arm.values if path is None else arm.at_times(found)
    rows = np.flatnonzero(np.isfinite(values).all(axis=1))
    if len(rows) < len(found):
        note = f"{len(found) - len(rows)} of {len(found)} poses are outside of the times of {arm.name}, and left out"
        (source,) = _noted((source,), 0, location, [note])
    return Stream(found.timestamps[rows], poses[rows], source, values[rows])


def _two(value: str | Two | None, name: str) -> Two:
    """Return one value for both sides, or a pair."""
    if isinstance(value, tuple | list):
        if len(value) != 2:
            raise InputError(f"Expected `{name}` to be one value or a pair (robot, camera), got {len(value)} values.")
        return value[0], value[1]
    return value, value


def _rotations(rotation: str | Two | None, quaternion: str | Two | None) -> Two:
    """Return the forms of the rotations of both sides, by either name of the argument."""
    forms = []
    for form, order in zip(_two(rotation, "rotation"), _two(quaternion, "quaternion"), strict=True):
        if order is not None and order not in QUATERNIONS:
            raise InputError(f"Expected `quaternion` (--quaternion) to be xyzw or wxyz, got {order!r}.")
        if form is not None:
            rotation_form(form)
            if order not in (None, form):
                raise InputError(f"The rotations are given twice, as {form} and as quaternions {order}. Give one.")
        forms.append(order if form is None else form)
    return forms[0], forms[1]


def side_of(contents: Contents, role: str, name: str) -> Side:
    """Return the poses of one side of a file; raises `InputError` where it holds the other one only."""
    side: Side | None = getattr(contents, role) or contents.only
    if side is None:
        other = "camera" if role == "robot" else "robot"
        raise InputError(f"{name} holds {other} poses only; expected {role} poses. Are the two files swapped?")
    return side


def _setup(setup: str | None, contents: tuple[Contents, Contents], paths: tuple[Path, Path]) -> str:
    """Return the setup: what is given, what the files say, eye-in-hand. They must not contradict each other."""
    said = setup
    by = "`setup` (--setup)"
    for one, path in zip(contents, paths, strict=True):
        if one.setup is None:
            continue
        if said is not None and said != one.setup:
            raise InputError(
                f"{shown(path)} says {one.setup}, and {by} says {said}: the camera cannot be both. Correct the one "
                "that is wrong: X, and for easy_handeye the direction of the robot poses, depend on it."
            )
        said, by = one.setup, shown(path)
    if said is None and contents[0].robot_enters:
        warnings.warn(
            f"{shown(paths[0])} does not say whether the camera is on the hand, and is taken as eye-in-hand; for eye "
            'on base give setup="eye-to-hand" (--setup eye-to-hand).',
            InputWarning,
            stacklevel=4,
        )
    return said or "eye-in-hand"


def _inverted(frames: tuple[str, str], said: bool) -> tuple[Finding, ...]:
    """Return a finding where poses are inverted on request; ``said``: the setup is given, or a file says it."""
    sides = [role for role, frame in zip(FRAMES, frames, strict=True) if frame == FRAMES[role][1]]
    return (Finding("poses.inverted", "note", {"sides": sides, "said": said}),) if sides else ()


def _stated_units(units: Two) -> tuple[Finding, ...]:
    """Return a finding where the length units are given: they are then not doubted for the size of the numbers."""
    sides = [role for role, unit in zip(FRAMES, units, strict=True) if unit is not None]
    return (Finding("poses.units", "note", {"sides": sides}),) if sides else ()


def _noted(
    sources: tuple[Source, ...], k: int, path: Path, notes: Iterable[str], format: str | None = None
) -> tuple[Source, ...]:
    """Return the sources with notes of one of them, which are logged, and the format of the reading that was taken."""
    source = sources[k]
    for note in notes:
        _log.info("%s: %s", shown(path), note)
    new = source._replace(notes=(*source.notes, *notes), format=format or source.format)
    return (*sources[:k], new, *sources[k + 1 :])
