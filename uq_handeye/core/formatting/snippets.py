"""Texts to copy, with their language."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Snippet:
    """One text to copy."""

    title: str  # e.g. "ROS 2 static transform: gripper_T_camera"
    convention: str  # one or two sentences: units, order, frames
    text: str
    language: str  # for highlighting: python, bash, yaml or xml


def short(value: float) -> str:
    """Twelve significant digits; never ``-0``.

    >>> short(0.1 + 0.2), short(-0.0)
    ('0.3', '0')
    """
    return f"{value + 0.0:.12g}"
