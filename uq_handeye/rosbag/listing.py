"""Content of a bag as text and as plain data: topics, frames, tags, cameras, joints, and the command to give."""

from __future__ import annotations

import shlex
from typing import Any

from ..formatting.numbers import digits
from .guess import CAMERA, ROBOT, guess
from .recording import Recording, Topic

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
    count = sum(topic.count for topic in recording.topics.values())
    lines = [f"{recording.name}: {digits(recording.duration)} s, {count} messages", ""]
    lines += _columns([["topic", "type", "messages", "read as"], *(_row(topic) for topic in recording.topics.values())])
    for heading, part in (
        ("Transforms", _transforms(recording)),
        ("Poses", _poses(recording)),
        ("Tags with corners", _tags(recording)),
        ("Cameras", _cameras(recording)),
        ("Joints", _joints(recording)),
    ):
        if part:
            more = [] if len(part) <= MOST else [f"  and {len(part) - MOST} more"]
            lines += ["", f"{heading}:", *part[:MOST], *more]
    lines += [f"\nNote: {note}." for note in recording.notes]
    found = guess(recording)
    if (found.robot, found.camera) == (ROBOT, CAMERA) and not (recording.poses or recording.tree.edges):
        lines += ["", "Nothing in it is read as poses, transforms, joint values or tags (docs/formats.md#ros-bags)."]
    else:
        lines += ["", "Next:", f"  {command_of(recording, files)}"]
    return "\n".join(lines) + "\n"


def dict_of(recording: Recording, files: list[str]) -> dict[str, Any]:
    """Return the listing as plain numbers and texts."""
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
        "poses": [
            {"topic": name, "parent": parent, "child": child, "count": len(track)}
            for name, tracks in recording.poses.items()
            for (parent, child), track in tracks.items()
        ],
        "tags": [
            {"topic": name, "camera": frame, "tag": tag, "count": len(track)}
            for name, tracks in recording.tags.items()
            for (frame, tag), track in tracks.items()
        ],
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
        "joints": [
            {"topic": name, "names": track.names, "count": len(track.times)}
            for name, found in recording.joints.items()
            for track in found.tracks
        ],
        "notes": list(recording.notes),
        "command": command_of(recording, files),
    }


def _row(topic: Topic) -> list[str]:
    short = topic.msgtype.replace("/msg/", "/")
    return [topic.name, short, str(topic.count), topic.kind or topic.problem or "-"]


def _columns(rows: list[list[str]]) -> list[str]:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return [
        "  ".join(
            cell.rjust(width) if k == 2 else cell.ljust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def _transforms(recording: Recording) -> list[str]:
    return [
        f"  {parent}:{child}  {f'{len(track)} poses' if track.moves else 'static'}"
        for (parent, child), track in sorted(recording.tree.edges.items())
    ]


def _poses(recording: Recording) -> list[str]:
    found = []
    for name, tracks in recording.poses.items():
        for (parent, child), track in tracks.items():
            named = name if len(tracks) == 1 else f"{name}:{child}"
            found.append(f"  {named}  {len(track)} poses{f' in {parent}' if parent else ''}")
    return found


def _tags(recording: Recording) -> list[str]:
    return [
        f"  {frame or name}:{tag}  {len(track)} detections in {name}"
        for name, tracks in recording.tags.items()
        for (frame, tag), track in sorted(tracks.items())
    ]


def _cameras(recording: Recording) -> list[str]:
    found = []
    for name, info in recording.infos.items():
        fx, fy, cx, cy = (digits(value, 6) for value in info.linear())
        what = "rectified" if info.rectified else f"distortion {info.model or 'none'}"
        size = "{} x {}".format(*info.image_size)
        found.append(f"  {name}  {info.frame or 'no frame'}, {size} px, fx {fx}, fy {fy}, cx {cx}, cy {cy}, {what}")
    return found


def _joints(recording: Recording) -> list[str]:
    return [
        f"  {name}  {len(track.times)} rows of {', '.join(track.names[:12])}"
        for name, found in recording.joints.items()
        for track in found.tracks
    ]
