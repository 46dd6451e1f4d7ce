"""Formats of text that their first lines tell: programs of robots, what tools of ROS print, files of one pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .contents import Contents
from .ros.tf_echo import is_tf_echo, read_tf_echo
from .ros.topic import is_ros_topic, read_ros_topic


@dataclass(frozen=True)
class TextFormat:
    """A format of text.

    Parameters
    ----------
    about : what it is in a few words, for help texts
    read : returns the poses of a text; the second argument is the name of the file, for messages
    is_it : whether the first 64 kB of a text are of this format, and of no other
    """

    about: str
    read: Callable[[str, str], Contents]
    is_it: Callable[[str], bool]


TEXTS: dict[str, TextFormat] = {
    "tf-echo": TextFormat("what tf2_echo and tf_echo print", read_tf_echo, is_tf_echo),
    "ros-topic": TextFormat("what ros2 topic echo and rostopic echo print", read_ros_topic, is_ros_topic),
}


def named_by(head: str) -> list[str]:
    """Return the formats that a text may have, by its beginning."""
    return [name for name, known in TEXTS.items() if known.is_it(head)]
