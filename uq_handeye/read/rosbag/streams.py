"""Streams of robot and camera poses from a recording, by frames of tf, by a tag, or by a topic."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

from ...core.files.open import StrPath
from ...core.geometry.se3 import inverse
from ...core.geometry.uncertain_poses import covariance_of_inverse
from ...core.presentation.units import parse_length
from ...errors import InputError, InputWarning
from ...formats.contents import FRAMES
from ...formats.ros_messages import frame_name, pair_text
from ...model.camera.adjustment.two_minima import Minima
from ...model.poses.stream import Stream
from ..camera_covariance import camera_covariance
from .bag import HINT
from .camera_info import CameraInfo
from .lens import RAW, RECTIFIED, Lens, lens_of
from .recording import Recording, read_recording
from .tags import TagTrack, plain_name, same_tag, tag_poses
from .track import Pair, TimedPoses, Track, listed

EXAMPLE = {"robot": "base_link:tool0", "camera": "camera_optical_frame:tag36h11_0"}


class BagStream(NamedTuple):
    """Stream of one side, and of tags with corners the camera and the side that its poses were made with."""

    stream: Stream
    info: CameraInfo | None = None
    tag: float | None = None
    hint: str = ""  # what the bag holds beyond that
    minima: Minima | None = None  # both solutions of the poses of a tag
    by_corners: bool = False  # poses of a tag that were computed here


def read_bag(
    path: StrPath | Iterable[StrPath],
    *,
    robot: str,
    camera: str,
    tag: float | str | None = None,
    camera_matrix: str | None = None,
    robot_frame: str | None = None,
    camera_frame: str | None = None,
) -> tuple[Stream, Stream]:
    """Streams of robot and camera from a ROS bag, for `synchronise`; ROS is not needed.

    Parameters
    ----------
    path : path or several
        ``.bag`` of ROS 1; of ROS 2 the folder, ``.mcap`` or ``.db3``; or texts of ``ros2 topic echo``.
    robot : str
        Frames ``"base_link:tool0"`` of ``/tf`` and ``/tf_static``, or a topic of poses such as ``"/tcp_pose"``.
    camera : str
        Frames ``"camera_optical_frame:marker"``, the optical frame first; a topic of poses; or a tag that was detected,
        ``"camera_optical_frame:tag36h11_0"``.
    tag : float, str or None
        Side of the tag (m, or text such as "40mm"), for detections with corners in pixels: poses are then computed from
        these and the ``camera_info``.
    camera_matrix : {"raw", "rectified"} or None
        Picture in which the corners were detected: K and D of the ``camera_info``, or P. None: as the corners fit,
        rectified if they do not decide.
    robot_frame, camera_frame : str or None
        What topics hold, as in `read_stream`.

    Raises
    ------
    InputError
        A bag that cannot be read; frames or topics that it does not have, with those that it has.
    MissingExtraError
        rosbags is not installed.

    Warns
    -----
    InputWarning
        The corners do not decide in which picture they were detected, and it matters.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> robot, camera = uq.read_bag("cell.mcap", robot="base:tool0", camera="camera:tag36h11_0")  # doctest: +SKIP
    >>> poses = uq.synchronise(robot, camera).poses                                               # doctest: +SKIP
    """
    recording = read_recording(path)
    side = None if tag is None else parse_length(tag, "`tag`")
    if camera_matrix not in (None, RAW, RECTIFIED):
        raise InputError(f'Expected `camera_matrix` to be "raw", "rectified" or None, got {camera_matrix!r}.')
    return (
        robot_stream(recording, robot, frame=robot_frame),
        camera_stream(recording, camera, tag=side, info=camera_matrix, frame=camera_frame).stream,
    )


def robot_stream(recording: Recording, spec: str, *, frame: str | None = None) -> Stream:
    """Return the robot's stream ``base_T_gripper``."""
    name, pair = _asked(recording, spec, "robot")
    if name in recording.joints:
        raise InputError(
            f"--robot {spec}: the topic holds joint values. Give the robot model, --urdf robot.urdf (or --dh FILE), or "
            "frames of /tf."
        )
    found = _of_topic(recording, name, pair, "robot") if name else _of_frames(recording, pair, "robot", spec)
    return _stream(recording, found, "robot", frame)


def camera_stream(
    recording: Recording,
    spec: str,
    *,
    tag: float | None = None,
    info: CameraInfo | str | None = None,
    frame: str | None = None,
) -> BagStream:
    """Return the camera's stream ``camera_T_target``; by corners, if the tag that is meant has some and a side.

    ``info`` is the intrinsics, or says in which picture the corners lie (`lens`), None: those of the bag.
    """
    own, picture = (None, info) if isinstance(info, str) else (info, None)
    name, pair = _asked(recording, spec, "camera")
    seen = _detected(recording, name, pair)
    if seen is not None:
        topic, track = seen
        known = own or _info_of_detections(recording, topic, track[0])
        connected = not name and recording.tree.chain(*pair) is not None
        if tag is not None:
            if known is None:
                raise InputError(
                    f"{recording.name}: no camera_info belongs to {topic}. Give the camera matrix: --camera-matrix "
                    "FX,FY,CX,CY."
                )
            lens = lens_of(track[1], known, tag, picture) if own is None else Lens(own, "intrinsics as given")
            if lens.warning:
                warnings.warn(lens.warning, InputWarning, stacklevel=2)
            seen_tag = tag_poses(track[1], lens.info, tag)
            found = seen_tag._replace(notes=[*seen_tag.notes, lens.note])
            minima = seen_tag.minima if frame in (None, FRAMES["camera"][0]) else None
            return BagStream(_stream(recording, found, "camera", frame), lens.info, tag, minima=minima, by_corners=True)
        if not connected:
            raise InputError(
                f"--camera {spec}: {topic} holds corners of the tag in pixels, not its poses. Give the side of its "
                "black square, e.g. --tag 40mm."
            )
    found = _of_topic(recording, name, pair, "camera") if name else _of_frames(recording, pair, "camera", spec)
    if seen is None and tag is not None:
        own = own or _info_of_detections(recording, name, pair)
        if own is None:
            raise InputError(
                f"--tag: {recording.name} holds no corners of {spec} in pixels, and no camera_info. Remove it, or add "
                "--camera-matrix FX,FY,CX,CY, with which the noise of finished poses follows from the tag."
            )
    hint = (
        "" if seen is None else f"{seen[0]} holds corners of this tag; with --tag LENGTH they are used, which says more"
    )
    return BagStream(_stream(recording, found, "camera", frame), own, tag, hint)


def _stream(recording: Recording, found: TimedPoses, role: str, frame: str | None) -> Stream:
    usual, inverted = FRAMES[role]
    if frame not in (None, usual, inverted):
        raise InputError(f"Expected `{role}_frame` (--{role}-frame) to be {usual} or {inverted}, got {frame!r}.")
    found = _inverted(found, found.notes) if frame == inverted else found
    return Stream(
        found.times, found.poses, recording.source(found.notes), covariance=found.covariance, read_as=found.read_as
    )


def _inverted(found: TimedPoses, notes: list[str]) -> TimedPoses:
    """Return the inverse poses, with their covariances."""
    S, reading = found.covariance, found.read_as
    if S is not None and reading is not None:
        S, reading = covariance_of_inverse(found.poses, S), replace(reading, inverse=not reading.inverse)
    return found._replace(poses=inverse(found.poses), notes=notes, covariance=S, read_as=reading)


# ------------------------------------------------------------------------------------------- what is asked for


def _asked(recording: Recording, spec: str, role: str) -> tuple[str, Pair]:
    """Return the topic that is meant, or "" , and the frames."""
    if not isinstance(spec, str) or not spec.strip():
        raise InputError(f"Expected --{role} to be frames such as {EXAMPLE[role]}, or a topic, got {spec!r}.")
    spec = spec.strip()
    for name in (spec, f"/{spec}"):
        if name in recording.topics:
            return name, ("", "")
    frames = recording.tree.frames
    parts = [(spec[:k], frame_name(spec[k + 1 :])) for k, letter in enumerate(spec) if letter == ":"]
    for before, after in parts:
        for name in (before, f"/{before}"):
            if name in recording.topics and frame_name(before) not in frames:
                return name, ("", after)
    pairs = [(frame_name(before), after) for before, after in parts]
    for pair in pairs:
        if set(pair) <= set(frames):
            return "", pair
    if pairs and all(pairs[0]):  # tag36h11:0 as tag36h11_0
        like = [frame for frame in frames if plain_name(frame) == plain_name(pairs[0][1])]
        return "", (pairs[0][0], like[0] if len(like) == 1 else pairs[0][1])
    tags = [one for one in tag_specs(recording) if role == "camera"]
    if not pairs and tags and not spec.startswith("/"):
        named = [one for one in tags if same_tag(one.rpartition(":")[2], spec)]
        raise InputError(
            f"--camera {spec}: name the tag with the frame of its camera. The tags that were detected are "
            f"{listed(named or tags)}."
        )
    if spec.startswith("/") or not pairs:
        readable = [name for name, topic in recording.topics.items() if topic.kind]
        raise InputError(
            f"--{role} {spec}: {recording.name} has no topic of this name that is read; there are "
            f"{listed(readable)}. Give a topic of poses, or two frames such as {EXAMPLE[role]}; {HINT}."
        )
    raise InputError(f"Expected --{role} to be frames such as {EXAMPLE[role]}, or a topic, got {spec!r}.")


def tag_specs(recording: Recording) -> list[str]:
    """Return how to ask for each tag that was detected: frame and tag, or the topic where the frame is not named."""
    found = [(frame or topic, tag) for topic, tracks in recording.tags.items() for frame, tag in tracks]
    return [f"{first}:{tag}" for first, tag in found]


def _of_frames(recording: Recording, pair: Pair, role: str, spec: str) -> TimedPoses:
    """Return the poses of one frame in another, by transforms, or by messages that name both frames."""
    tree = recording.tree
    connected = tree.chain(*pair) is not None
    for name, tracks in recording.poses.items():
        for own, track in tracks.items() if not connected else ():
            if own[0] == pair[0] and own[1] and (own[1] == pair[1] or same_tag(own[1], pair[1])):
                return _of_track(name, own, track, role)
            if all(pair) and own == pair[::-1]:
                turned = _of_track(name, own, track, role)
                return _inverted(turned, [*turned.notes, "inverted"])
    tags = tag_specs(recording)
    if not tree.edges and not (role == "camera" and tags):
        raise InputError(
            f"--{role} {spec}: {recording.name} has no transforms (/tf). Give a topic of poses: "
            f"{listed(list(recording.poses))}; {HINT}."
        )
    if role == "camera" and not connected and tags:
        raise InputError(
            f"--camera {spec}: {recording.name} has no such frames or tag. The tags that were detected are "
            f"{listed(tags)}; {HINT}."
        )
    try:
        return tree.poses(*pair)
    except InputError as error:
        raise InputError(f"--{role} {spec}: {error} ({HINT})") from None


def _of_topic(recording: Recording, name: str, pair: Pair, role: str) -> TimedPoses:
    """Return the poses of a topic: of its only pair of frames, or of the child that is named."""
    topic = recording.topics[name]
    tracks = recording.poses.get(name, {})
    if pair[1]:
        tracks = {own: track for own, track in tracks.items() if own[1] == pair[1] or same_tag(own[1], pair[1])}
    if topic.kind == "transforms":
        raise InputError(
            f"--{role} {name}: this topic holds transforms. Name two frames, e.g. {EXAMPLE[role]}; {HINT}."
        )
    if not tracks:
        what = topic.problem or ("no messages" if not topic.count else f"messages of {topic.msgtype}, and no poses")
        raise InputError(f"--{role} {name}: the topic has {what}. Give a topic of poses, or two frames; {HINT}.")
    if len(tracks) > 1:
        children = sorted({own[1] for own in tracks})
        named = [f"{name}:{child}" for child in children] if len(children) > 1 else [pair_text(*own) for own in tracks]
        raise InputError(f"--{role} {name}: the topic has poses of several frames. Choose one: {listed(named)}.")
    (own, track), *_ = tracks.items()
    return _of_track(name, own, track, role)


def _of_track(name: str, pair: Pair, track: Track, role: str) -> TimedPoses:
    times, poses = track.poses()
    notes = [f"{len(times)} poses of {name} ({pair_text(*pair)})"]
    if track.repeated:
        notes.append(f"{track.repeated} poses that repeat a time are left out")
    if role == "robot":
        return TimedPoses(times, poses, notes)
    S, reading, note = camera_covariance(track.side, "m", None, FRAMES["camera"][0], poses)
    return TimedPoses(times, poses, notes + [note] * bool(note), covariance=S, read_as=reading)


def _detected(recording: Recording, name: str, pair: Pair) -> tuple[str, tuple[Pair, TagTrack]] | None:
    """Return the topic and the corners of the tag that is meant."""
    for topic, tags in recording.tags.items():
        if name and name != topic:
            continue
        for own, track in tags.items():
            meant = not pair[1] and len(tags) == 1
            if (meant or (pair[1] and same_tag(own[1], pair[1]))) and (name or own[0] == pair[0]):
                return topic, (own, track)
        if name:
            named = [f"{name}:{own[1]}" for own in tags]
            raise InputError(f"--camera {name}: several tags were detected. Choose one: {listed(named)}.")
    return None


def _info_of_detections(recording: Recording, topic: str, pair: Pair) -> CameraInfo | None:
    """Return the camera_info of the detections: of the same frame, else of the same namespace, else the only one."""
    infos = recording.infos
    same = [info for info in infos.values() if info.frame and info.frame == pair[0]]
    if not same:
        space = topic.rpartition("/")[0]
        same = [info for name, info in infos.items() if name.rpartition("/")[0] == space]
    if not same and len(infos) == 1:
        same = list(infos.values())
    if len(same) > 1 and not all(same[0].like(other) for other in same[1:]):
        raise InputError(
            f"{recording.name}: several camera_info belong to {topic}, with different numbers: {listed(list(infos))}. "
            "Give the camera matrix: --camera-matrix FX,FY,CX,CY."
        )
    return same[0] if same else None
