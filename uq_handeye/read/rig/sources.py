r"""Sources of poses of a rig file other than pose files: joints, corners with known intrinsics, ROS bags.

*Corners.* Only the poses are estimated; with the derivatives ``A_i`` and ``B_i`` of the pixels of picture i by the
intrinsics and by its pose, an error of the intrinsics, of covariance ``S = T T^T``, moves the pose by

    xi_i = G_i T u,      G_i = -(B_i^T B_i)^-1 B_i^T A_i,      u ~ N(0, I)

the same u in all views by this camera. *Bags.* The poses of an arm are interpolated at the times of the views; views
outside the recording, and in its gaps, are left out.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.geometry.se3 import Array
from ...core.presentation.units import parse_length
from ...errors import DegenerateMotionError, InputError, NotConvergedError
from ...model.kinematics.chain import Kinematics
from ...model.kinematics.descriptions.mjcf import is_mjcf
from ...model.kinematics.kinematic_errors import KinematicErrors
from ...model.poses.pose_pairs import joint_values_at
from ...model.poses.stream import Stream
from ...model.poses.timing import MAX_GAP_INTERVALS
from ...model.rig.description import ArmPoses
from ..joints import read_joint_file
from .pose_rows import PoseRows

if TYPE_CHECKING:
    from ...model.camera.adjustment.bundle import Bundle
    from ...model.camera.corners import Corners

MODELS = ("robot_model", "urdf", "dh", "ur_calibration")
_log = logging.getLogger("uq_handeye")


# ------------------------------------------------------------------------------------------- arms


def kinematics_of(entry: Mapping[str, Any], folder: Path, where: str) -> Kinematics | None:
    """Return the chain that a table names, None without a robot model."""
    given = [name for name in MODELS if name in entry]
    base, tip = entry.get("base"), entry.get("tip")
    if not given:
        if wrong := [key for key in ("base", "tip", "joint_units", "robot_class") if key in entry]:
            raise InputError(f"{where} has {wrong[0]} and no robot model. Add one of {', '.join(MODELS)}.")
        return None
    mjcf = given == ["robot_model"] and is_mjcf(entry["robot_model"])
    ends = [] if mjcf else [key for key in ("base", "tip") if entry.get(key) is not None]
    if set(given) - {"urdf", "ur_calibration"} and (len(given) > 1 or ends):
        others = [*given[1:], *ends]
        raise InputError(
            f"{where} has {others[0]} beside {given[0]}, which describes the whole arm. Remove one of them."
        )
    file = {name: folder / entry[name] for name in given}
    if mjcf:
        return Kinematics.from_mjcf(file["robot_model"], base, tip)
    if "robot_model" in entry:
        return Kinematics.from_name(entry["robot_model"])
    if "dh" in entry:
        return Kinematics.from_dh(file["dh"])
    if "ur_calibration" in entry:
        return Kinematics.from_ur_calibration(file["ur_calibration"], file.get("urdf"), base, tip)
    return Kinematics.from_urdf(file["urdf"], base, tip)


def joint_units_of(entry: Mapping[str, Any], folder: Path) -> str | None:
    """Return the unit of the joint values of an arm; a calibration file of LeRobot is one of the folder."""
    units: str | None = entry.get("joint_units")
    return str(folder / units) if units is not None and units.endswith(".json") else units


def joint_rows(path: Any, chain: Kinematics, units: str | None, rows: PoseRows | None = None) -> PoseRows:
    """Return the poses of a file of joint values; with ``rows``, those poses with their joints."""
    q = read_joint_file(path, chain, units)
    if rows is None:
        return PoseRows(chain.poses(q.values), q.name, q.source, q.timestamps, joints=q.values, by_joints=True)
    values = q.at_rows(rows.side, 0.0)
    if (lacking := np.flatnonzero(np.isnan(values).any(axis=1))).size:
        raise InputError(f"{q.name} has no joint values at {rows.names[lacking[0]]!s} of {rows.name}. Add them.")
    return replace(rows, joints=values)


def arm_poses(rows: PoseRows, chain: Kinematics | None, errors: KinematicErrors | None = None) -> ArmPoses:
    """Return the poses of an arm with its kinematics, if there is a chain."""
    names, timed = rows.names if rows.named else (), rows.times is not None
    if chain is None:
        return ArmPoses(rows.poses, names, rows.name, timed=timed)
    poses = None if rows.by_joints else rows.poses
    return ArmPoses.by_kinematics(chain, poses, rows.joints, names, rows.name, errors, timed)


# ------------------------------------------------------------------------------------------- corners


def rows_of_corners(path: Path, intrinsics: Any, folder: Path, units: str | None) -> PoseRows:
    """Return the poses of a board from its corners by known intrinsics: a folder, a file, or fx, fy, cx, cy; behind a
    file or the numbers the word exact.

    Corners that were detected in the wrong place are left out, pictures of which most are as a whole; each picture
    has noise of its own (`model.camera.adjustment.outliers`).
    """
    from ...core.files.source import Source
    from ...model.camera.adjustment.bundle import Sight
    from ...model.camera.corners_file import read_corners

    given = read_corners(path, units or "m")
    model, values, root = _intrinsics(intrinsics, folder)
    corners, found = _adjusted(model, values, given)
    if not found.converged:
        raise NotConvergedError(f"The poses of {path.name} do not converge with the intrinsics given.", found)
    said = [f"{corners.n} poses by known intrinsics"]
    if out := [row for row in given.rows.tolist() if row not in corners.rows]:
        said.append(f"pictures left out, whose corners fit no pose of the board: {', '.join(map(str, out))}")
        _log.warning("%s: %s", path.name, said[-1])
    shared = np.zeros((corners.n, 6, 0))  # exact: no errors, and none are assumed
    if root.shape[1]:
        counts = found.used * np.sqrt(found.weights)[corners.picture]
        _, A, B = Sight.of(model, found.shape, corners, counts).rows(values, found.poses)
        shared = -np.linalg.solve(B.mT @ B, B.mT @ A) @ root
    return PoseRows(
        found.poses, path.name, Source(path.name, "corners", path.stat().st_size, "", tuple(said)),
        rows=tuple(corners.rows.tolist()), covariance=found.own, intrinsics=shared,
        calibration=values.tobytes() + root.tobytes(),
    )  # fmt: skip


def _adjusted(model: Any, values: Array, corners: Corners) -> tuple[Corners, Bundle]:
    """Poses by the good corners of the good pictures, with the noise of each picture, and the corners of these."""
    from ...model.camera.adjustment.bundle import BundleUnknowns, adjust
    from ...model.camera.adjustment.initial_guess import poses_of
    from ...model.camera.adjustment.outliers import spoilt, without_outliers
    from ...model.camera.adjustment.picture_weights import picture_weights
    from ...model.camera.adjustment.two_minima import better_start
    from ...model.camera.board_shape import flat_shape
    from ...model.camera.corners import without_pictures
    from ...model.camera.rays import rays

    shape = flat_shape(corners.on_board[0])
    unknowns = BundleUnknowns.poses_only(model, shape)
    seen = rays(model, values, corners.pixels)
    start = poses_of(corners, np.ascontiguousarray(seen[:, :2] / seen[:, 2:]))
    start = better_start(model, values, shape, corners, start)
    found, good = without_outliers(
        corners,
        lambda used, before: adjust(unknowns, corners, (values, start if before is None else before.poses), used=used),
    )
    if found.converged and (bad := spoilt(corners, found)).any() and not bad.all():
        return _adjusted(model, values, without_pictures(corners, bad))
    weights = picture_weights(found, corners)
    return corners, adjust(unknowns, corners, (values, found.poses), used=good, weights=weights)


def _intrinsics(given: Any, folder: Path) -> tuple[Any, Array, Array]:
    """Model, parameters (p,) and a root T (p, q) of their covariance; (p, 0) where none is given."""
    from ...model.camera.calibration_files import is_camera_folder
    from ...model.camera.intrinsics_file import read_intrinsics
    from ...model.camera.models import LINEAR
    from ...model.camera.stored_calibration import read_camera

    text, comma, word = str(given).strip("[]").rpartition(",")
    exact = bool(comma) and word.strip(" '") == "exact"
    text = text.strip(" '") if exact else str(given).strip("[]")
    try:
        plain = [float(part) for part in text.split(",")]
    except ValueError:
        plain = []
    if len(plain) == len(LINEAR):
        return _with_deviations("pinhole", dict(zip(LINEAR, plain, strict=True)), exact)
    if given != str(given):
        raise InputError(f"Expected `intrinsics` to be fx, fy, cx, cy, a file or a folder, got {given!r:.40}.")
    path = folder / text
    if is_camera_folder(path):
        seen = read_camera(path).bundle
        free = seen.free[: len(seen.intrinsics)]
        root = np.zeros((len(free), int(free.sum())))
        root[free] = np.linalg.cholesky(seen.intrinsics_covariance[np.ix_(free, free)])
        return seen.model, np.array(seen.intrinsics), root
    known = read_intrinsics(path)
    if lacks := [name for name in LINEAR if name not in known.values]:
        raise InputError(f"{path.name} lacks {', '.join(lacks)}. Give all of {', '.join(LINEAR)}.")
    model = known.model or ("brown" if set(known.values) - set(LINEAR) else "pinhole")
    return _with_deviations(model, known.values, exact)


def _with_deviations(model: str, values: Any, exact: bool) -> tuple[Any, Array, Array]:
    """Model, parameters and root of their covariance; a number alone has the deviation that --intrinsics gives it."""
    from ...model.camera.given_intrinsics import GivenIntrinsics, with_default_deviations
    from ...model.camera.models import MODELS

    given = GivenIntrinsics.of(values if exact else with_default_deviations(values), exact).values
    each = [given.get(name, (0.0, 0.0)) for name in MODELS[model].names]
    mean, sd = np.array(each, dtype=float).T
    if exact:
        sd = np.zeros(len(mean))
    return MODELS[model], mean, np.diag(sd)[:, sd > 0]


def apart_by_calibration(seen: Sequence[PoseRows], cameras: Sequence[str]) -> list[PoseRows]:
    """Return rows whose columns of intrinsics are those of one camera: one calibration, the same errors.

    Views of two calibrations of one camera, such as of a folder for each board, have independent errors.
    """
    found = list(seen)
    for camera in dict.fromkeys(cameras):
        of = [k for k, name in enumerate(cameras) if name == camera and seen[k].intrinsics is not None]
        kinds = list(dict.fromkeys(seen[k].calibration for k in of))
        if len(kinds) < 2:
            continue
        widths = {kind: next(seen[k].count for k in of if seen[k].calibration == kind) for kind in kinds}
        for k in of:
            before = sum(widths[kind] for kind in kinds[: kinds.index(seen[k].calibration)])
            after = sum(widths.values()) - before - seen[k].count
            padded = np.pad(np.asarray(seen[k].intrinsics), [(0, 0), (0, 0), (before, after)])
            found[k] = replace(seen[k], intrinsics=padded)
    return found


# ------------------------------------------------------------------------------------------- bags


class Bags:
    """Recordings of a rig file, each read once."""

    def __init__(self) -> None:
        self._read: dict[tuple[Path, ...], Any] = {}

    def recording(self, paths: Sequence[Path]) -> Any:
        """Return the recording of the bags of one session."""
        from ..rosbag.recording import read_recording

        key = tuple(paths)
        if key not in self._read:
            self._read[key] = read_recording(paths)
        return self._read[key]

    def arm(self, paths: Sequence[Path], topic: str, chain: Kinematics | None, entry: Mapping[str, Any]) -> PoseRows:
        """Return the stream of an arm: poses, or joint values of its chain."""
        from ...model.kinematics.joints_file import NamedJoints
        from ..rosbag.streams import robot_stream

        recording = self.recording(paths)
        if chain is not None and (topic in recording.joints or f"/{topic}" in recording.joints):
            track = recording.joint_tracks(topic)[0]
            times, *values = track.values.T
            named = NamedJoints(f"{topic} in {recording.name}", tuple(track.names), times, np.array(values).T)
            return replace(joint_rows(named, chain, entry.get("joint_units")), stream=True)
        stream = robot_stream(recording, topic, frame=entry.get("frame"))
        return replace(_rows_of(stream, f"{topic} in {recording.name}"), stream=True)

    def camera(self, paths: Sequence[Path], topic: str, view: Mapping[str, Any], intrinsics: Any) -> PoseRows:
        """Return the poses of a target in a bag, by the corners of a tag where its side is given."""
        from ..rosbag.streams import camera_stream

        recording = self.recording(paths)
        tag = None if view.get("tag") is None else parse_length(view["tag"], "`tag`")
        if intrinsics not in (None, "raw", "rectified"):
            raise InputError(f"Expected `intrinsics` beside a bag to be raw or rectified, got {intrinsics!r}.")
        found = camera_stream(recording, topic, tag=tag, info=intrinsics, frame=view.get("frame")).stream
        return _rows_of(found, f"{topic} in {recording.name}")


def _rows_of(stream: Stream, name: str) -> PoseRows:
    assert stream.source is not None  # of a bag
    order = np.argsort(stream.timestamps)
    return PoseRows(stream.poses[order], name, stream.source, stream.timestamps[order])


def clock_offset(camera: str, given: Any, views: Iterable[tuple[Sequence[PoseRows], PoseRows]], fixed: bool) -> float:
    """Return the offset added to the times of a camera (s): as given, or estimated by a view of it (`synchronise`)."""
    from ..synchronisation.synchronise import synchronise

    if given is not None:
        if not np.isfinite(given):
            raise InputError(f"Expected `offset` of the camera {camera!r} in seconds, got {given!r}.")
        return float(given)
    reason = "no view of it leads from one arm in a bag to the world"
    for arms, rows in views:
        if rows.times is None or len(arms) != 1 or not arms[0].stream or arms[0].times is None:
            continue
        setup = "eye-to-hand" if fixed else "eye-in-hand"
        try:
            both = [Stream(np.asarray(one.times), one.poses) for one in (arms[0], rows)]
            found = synchronise(both[0], both[1], setup=setup)
        except (InputError, NotConvergedError, DegenerateMotionError) as error:
            reason = str(error)
            continue
        _log.info("clock of %s: %.6g s behind that of the robot, +- %.2g s", camera, found.offset, found.offset_std)
        return float(found.offset)
    raise InputError(
        f"The clock offset of the camera {camera!r} was not estimated: {reason.rstrip('.')}. Give it, such as offset = "
        f"0 in [cameras.{camera}]."
    )


def at_views(rows: PoseRows, times: Sequence[Array], chain: Kinematics | None) -> PoseRows:
    """Return the poses of an arm of a bag at the times of the views; those without one are left out."""
    from ..synchronisation.interpolation import at_times

    assert rows.times is not None
    wanted = np.unique(np.concatenate(times)) if times else np.zeros(0)
    gap = MAX_GAP_INTERVALS * float(np.median(np.diff(rows.times))) if len(rows.times) > 1 else 0.0
    found = at_times(rows.times, rows.poses, wanted, max_gap=gap)
    fine = found.fine
    if not fine.any():
        raise InputError(
            f"{rows.name}: no view was taken while it was recorded ({rows.times[0]:.3f} to {rows.times[-1]:.3f} s)."
        )
    if chain is None or rows.joints is None:
        return replace(rows, poses=found.poses[fine], times=wanted[fine])
    q = joint_values_at(rows.times, rows.joints, wanted[fine])
    return replace(rows, poses=chain.poses(q), times=wanted[fine], joints=q)
