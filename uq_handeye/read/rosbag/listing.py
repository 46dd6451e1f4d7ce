"""Content of a bag as text and as plain data: topics, frames, tags, cameras, joints, and the command to give next."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import TypeVar

from ...core.files.json_values import JsonObject
from ...core.limits import MAX_PRINTED_ROWS
from ...core.presentation.html import macros
from ...core.presentation.numbers import digits
from .guess import CAMERA_PLACEHOLDER, ROBOT_PLACEHOLDER, Guess, guess
from .joints import JointTrack
from .recording import Recording
from .track import Pair, Samples

SomeTrack = TypeVar("SomeTrack", bound=Samples)


def command_of(recording: Recording, files: list[str]) -> str:
    """Return the command to give, with placeholders for what the bag does not show."""
    return _command(guess(recording), files)


def _command(found: Guess, files: list[str]) -> str:
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
    nothing = (found.robot, found.camera) == (ROBOT_PLACEHOLDER, CAMERA_PLACEHOLDER) and not (
        recording.poses or recording.tree.edges
    )
    template = macros(__package__, "listing.j2", html=False, digits=digits, MOST=MAX_PRINTED_ROWS)
    order = list(recording.tags)
    tags = sorted(_tracks(recording.tags), key=lambda one: (order.index(one[0]), one[1:3]))
    parts = (sorted(recording.tree.edges.items()), _tracks(recording.poses), tags)
    command = None if nothing else _command(found, files)
    return str(template.listing(recording, aligned, *parts, _joints(recording), command))


def _tracks(topics: Mapping[str, Mapping[Pair, SomeTrack]]) -> list[tuple[str, str, str, SomeTrack]]:
    """Return topic, both names and track of each pair."""
    return [(name, a, b, track) for name, tracks in topics.items() for (a, b), track in tracks.items()]


def _joints(recording: Recording) -> list[tuple[str, JointTrack]]:
    return [(name, track) for name, found in recording.joints.items() for track in found.tracks]


def dict_of(recording: Recording, files: list[str]) -> JsonObject:
    """Return the listing as plain numbers and texts."""

    def counts(topics: Mapping[str, Mapping[Pair, SomeTrack]], first: str, second: str) -> list[JsonObject]:
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
