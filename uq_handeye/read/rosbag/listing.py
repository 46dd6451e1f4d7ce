"""Content of a bag as text and as plain data: topics, frames, tags, cameras, joints, and the command to give.

Guesses which frames, tags and topics are the robot and the camera, by their names and by what moves.

Tables of what a bag holds, for commands that read files: joint values as CSV, camera_info as YAML.
"""

from __future__ import annotations

import re
import shlex
from itertools import islice, pairwise, product
from typing import Any, NamedTuple

from ...core.files.lines import csv_text
from ...core.formatting.numbers import digits
from ...core.presentation.html import macros
from ...errors import InputError
from .open import HINT
from .recording import JointTrack, Recording
from .track import CameraInfo, Pair, Tree

# Names of robots' base and tool frames, the usual ones first; then those of cameras and of what they see.
BASES = ("base_link", "base", "panda_link0", "fr3_link0", "link_0", "link_base", "robot_base", "world", "map")
TOOLS = (
    "tool0", "flange", "tcp", "tool0_controller", "ee_link", "end_effector", "panda_hand_tcp", "panda_link8",
    "fr3_hand_tcp", "fr3_link8", "tool_frame", "tool_link", "link_eef", "end_effector_link", "gripper", "hand",
    "wrist_3_link", "link_ee", "link_7", "link_6",
)  # fmt: skip
_CAMERA = re.compile(
    r"cam|optical|rgb|realsense|zed|zivid|phoxi|ensenso|kinect|sensor|tracker|mocap|vicon|vrpn|optitrack|qualisys",
    re.IGNORECASE,
)
_TARGET = re.compile(r"tag|marker|aruco|board|target|object|rigid|checker|charuco|calib", re.IGNORECASE)
# What moves beyond the tool.
_FINGER = re.compile(r"finger|knuckle|jaw|gripper|\bgrip", re.IGNORECASE)
_ROBOT = re.compile(r"tcp|tool|flange|\bee\b|end_?effector|arm|robot|current_?pose|cartesian", re.IGNORECASE)
# Pairs of base and tool that are tried.
MOST_GUESSES = 500
# Placeholders where nothing is found.
ROBOT, CAMERA = "BASE:TOOL", "OPTICAL_FRAME:TARGET"


class Guess(NamedTuple):
    """Arguments to give as --robot and --camera, and what must be added."""

    robot: str
    camera: str
    tag: bool  # the side of the tag
    joints: bool = False  # the model of the robot, whose joint values are meant


def guess(recording: Recording) -> Guess:
    """Return what is most likely meant; placeholders where nothing is."""
    camera, tag = _camera(recording)
    robot = _robot(recording, camera)
    joints = [name for name, topic in recording.joints.items() if topic.sets]
    if robot == ROBOT and joints:
        return Guess(max(joints, key=lambda name: len(recording.joints[name].tracks[0].names)), camera, tag, True)
    return Guess(robot, camera, tag)


def _robot(recording: Recording, camera: str) -> str:
    tree = recording.tree
    frames = tree.frames
    bases, tools = ([frame for name in names for frame in frames if _is(frame, name)] for names in (BASES, TOOLS))
    for base, tool in islice(product(bases, tools), MOST_GUESSES):
        if base != tool and tree.moves(base, tool):
            return f"{base}:{tool}"
    topics = [f"{name}" for name, tracks in recording.poses.items() if len(tracks) == 1 and name != camera]
    named = [name for name in topics if _ROBOT.search(name)]
    if named or len(topics) == 1:
        return (named or topics)[0]
    return _arm(tree) or ROBOT


def _arm(tree: Tree) -> str | None:
    """Return both ends of the longest chain downwards that moves, without fingers and what a camera sees."""
    parent_of = {child: parent for (parent, child), track in tree.edges.items() if not _seen((parent, child))}
    moving = {pair for pair, track in tree.edges.items() if track.moves}
    best: list[str] = []
    for child in sorted(parent_of):
        if (parent_of[child], child) not in moving or _FINGER.search(child):
            continue
        path = {child: None}  # a set in order
        while (last := next(reversed(path))) in parent_of and parent_of[last] not in path:
            path[parent_of[last]] = None
        up = list(path)
        highest = max(k for k, pair in enumerate(pairwise(up)) if pair[::-1] in moving)
        best = max(best, up[: highest + 2][::-1], key=len)
    if not best:
        return None
    base = next((frame for frame in best[:-1] if _is(frame, "base_link")), best[0])
    return f"{base}:{best[-1]}"


def _camera(recording: Recording) -> tuple[str, bool]:
    tags = [
        (-len(track), frame or topic, name)
        for topic, tracks in recording.tags.items()
        for (frame, name), track in tracks.items()
    ]
    if tags:
        _, first, name = min(tags)
        return f"{first}:{name}", True
    found = [(len(track), pair) for pair, track in recording.tree.edges.items() if track.moves and _seen(pair)]
    if found:
        return ":".join(max(found)[1]), False
    for name, tracks in recording.poses.items():
        seen = [pair for pair in tracks if _seen(pair) or _TARGET.search(name) or _CAMERA.search(pair[0] or name)]
        if seen and (_TARGET.search(name) or not _ROBOT.search(name)):
            return (name if len(tracks) == 1 else f"{name}:{seen[0][1]}"), False
    return CAMERA, False


def _seen(pair: Pair) -> bool:
    """Return whether an edge looks like a target in the frame of a camera."""
    return bool(_TARGET.search(pair[1]) or (_CAMERA.search(pair[0]) and not _CAMERA.search(pair[1])))


def _is(frame: str, name: str) -> bool:
    """Return whether a frame has a name, also behind a prefix: ur5e_tool0, robot/tool0."""
    return frame == name or re.search(rf"[/_]{re.escape(name)}$", frame) is not None


# Frames, tags and names that are listed.
MOST = 40


def command_of(recording: Recording, files: list[str]) -> str:
    """Return the command to give, with placeholders for what the bag does not show."""
    found = guess(recording)
    words = ["uq-handeye", "calibrate"]
    for file in files:
        words += ["--bag", file]
    words += ["--robot", found.robot, *(["--urdf", "robot.urdf"] if found.joints else []), "--camera", found.camera]
    return shlex.join(words) + (" --tag LENGTH" if found.tag else "")


def text_of(recording: Recording, files: list[str]) -> str:
    """Return the listing as lines."""
    rows = [["topic", "type", "messages", "read as"]]
    for topic in recording.topics.values():
        short = topic.msgtype.replace("/msg/", "/")
        rows.append([topic.name, short, str(topic.count), topic.kind or topic.problem or "-"])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    aligned = [f"{a:<{widths[0]}}  {b:<{widths[1]}}  {c:>{widths[2]}}  {d}" for a, b, c, d in rows]
    found = guess(recording)
    nothing = (found.robot, found.camera) == (ROBOT, CAMERA) and not (recording.poses or recording.tree.edges)
    template = macros(__package__, "listing.j2", html=False, digits=digits, MOST=MOST)
    order = list(recording.tags)
    tags = sorted(_tracks(recording.tags), key=lambda one: (order.index(one[0]), one[1:3]))
    parts = (sorted(recording.tree.edges.items()), _tracks(recording.poses), tags)
    command = None if nothing else command_of(recording, files)
    return str(template.listing(recording, aligned, *parts, _joints(recording), command))


def _tracks(topics: Any) -> list[tuple[str, str, str, Any]]:
    """Return topic, both names and track of each pair."""
    return [(name, a, b, track) for name, tracks in topics.items() for (a, b), track in tracks.items()]


def _joints(recording: Recording) -> list[tuple[str, JointTrack]]:
    return [(name, track) for name, found in recording.joints.items() for track in found.tracks]


def dict_of(recording: Recording, files: list[str]) -> dict[str, Any]:
    """Return the listing as plain numbers and texts."""

    def counts(topics: Any, first: str, second: str) -> list[dict[str, Any]]:
        return [{"topic": name, first: a, second: b, "count": len(track)} for name, a, b, track in _tracks(topics)]

    return {
        "name": recording.name,
        "duration": recording.duration,
        "topics": [
            {"name": topic.name, "type": topic.msgtype, "messages": topic.count, "read_as": topic.kind}
            for topic in recording.topics.values()
        ],
        "transforms": [
            {"parent": parent, "child": child, "count": len(track), "moves": track.moves}
            for (parent, child), track in recording.tree.edges.items()
        ],
        "poses": counts(recording.poses, "parent", "child"),
        "tags": counts(recording.tags, "camera", "tag"),
        "cameras": [
            {
                "topic": name,
                "frame": info.frame,
                "image_size": list(info.image_size),
                "camera_matrix": info.linear().tolist(),
                "rectified": info.rectified,
            }
            for name, info in recording.infos.items()
        ],
        "joints": [{"topic": name, "names": track.names, "count": len(track)} for name, track in _joints(recording)],
        "notes": list(recording.notes),
        "command": command_of(recording, files),
    }


def joint_tracks(recording: Recording, topic: str) -> list[JointTrack]:
    """Return the joint values of a topic, those of most joints first."""
    found = recording.joints.get(topic) or recording.joints.get(f"/{topic}")
    if found is None or not found.sets:
        there = ", ".join(recording.joints) or "none"
        raise InputError(
            f"--joints {topic}: {recording.name} has no such topic of JointState; there are: {there}. {HINT}."
        )
    return found.tracks


def joints_csv(track: JointTrack) -> str:
    """Return joint values as a table with the header ``timestamp`` and the names of the joints."""
    return csv_text([["timestamp", *track.names], *track.values.tolist()])


def camera_info_yaml(info: CameraInfo) -> str:
    """Return the intrinsics as --camera-matrix reads them, in the names of ``camera_calibration``."""
    fx, fy, cx, cy = info.linear().tolist()
    d = [] if info.rectified else info.D.tolist()
    lines = [
        f"image_width: {info.image_size[0]}",
        f"image_height: {info.image_size[1]}",
        f"distortion_model: {'plumb_bob' if info.rectified or not info.model else info.model}",
        f"camera_matrix: {{rows: 3, cols: 3, data: [{fx!r}, 0, {cx!r}, 0, {fy!r}, {cy!r}, 0, 0, 1]}}",
        f"distortion_coefficients: {{rows: 1, cols: {max(len(d), 5)}, data: {d or [0.0] * 5}}}",
    ]
    return "\n".join(lines) + "\n"
