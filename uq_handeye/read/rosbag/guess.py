"""Guess of the frames, tags and topics of a bag that are the robot and the camera, by their names and motion."""

from __future__ import annotations

import re
from itertools import islice, product
from typing import NamedTuple

from .recording import Recording
from .track import Pair
from .tree import MAX_FRAME_PAIRS, Tree

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
# Placeholders in the command where nothing is found.
ROBOT_PLACEHOLDER, CAMERA_PLACEHOLDER = "BASE:TOOL", "OPTICAL_FRAME:TARGET"


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
    if robot == ROBOT_PLACEHOLDER and joints:
        return Guess(max(joints, key=lambda name: len(recording.joints[name].tracks[0].names)), camera, tag, True)
    return Guess(robot, camera, tag)


def _robot(recording: Recording, camera: str) -> str:
    tree = recording.tree
    frames = tree.frames
    bases, tools = ([frame for name in names for frame in frames if _is(frame, name)] for names in (BASES, TOOLS))
    for base, tool in islice(product(bases, tools), MAX_FRAME_PAIRS):
        if base != tool and tree.moves(base, tool):
            return f"{base}:{tool}"
    topics = [f"{name}" for name, tracks in recording.poses.items() if len(tracks) == 1 and name != camera]
    named = [name for name in topics if _ROBOT.search(name)]
    if named or len(topics) == 1:
        return (named or topics)[0]
    return _arm(tree) or ROBOT_PLACEHOLDER


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
        highest = next(k for k in reversed(range(len(up) - 1)) if (up[k + 1], up[k]) in moving)
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
    return CAMERA_PLACEHOLDER, False


def _seen(pair: Pair) -> bool:
    """Return whether an edge looks like a target in the frame of a camera."""
    return bool(_TARGET.search(pair[1]) or (_CAMERA.search(pair[0]) and not _CAMERA.search(pair[1])))


def _is(frame: str, name: str) -> bool:
    """Return whether a frame has a name, also behind a prefix: ur5e_tool0, robot/tool0."""
    return frame == name or re.search(rf"[/_]{re.escape(name)}$", frame) is not None
