"""Text formats that are recognised by their first lines: robot programs, output of ROS tools, files of one pose."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from .contents import Contents
from .controllers.forms import ABOUT, NAMES
from .controllers.tables import names_a_pose
from .matrices.franka import is_franka, read_franka
from .matrices.halcon import is_halcon, read_halcon
from .matrices.text import is_matrix_text, read_matrix_text
from .matrices.zivid import is_zivid, read_zivid
from .ros_topic import is_ros_topic, read_ros_topic
from .tf_echo import is_tf_echo, read_tf_echo

# These formats hold only numbers, which the others may hold as well, and are tested last.
_LAST = ("matrix", "table")


class TextFormat(NamedTuple):
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


def _is_kind(name: str, head: str) -> bool:
    from .controllers.registry import kind_of  # slow to import: patterns of the languages of all makers

    return kind_of(head) == name


def _read_controller(format: str, text: str, name: str) -> Contents:
    from .controllers.registry import read_controller

    return read_controller(format, text, name)


TEXTS: dict[str, TextFormat] = {
    "tf-echo": TextFormat("what tf2_echo and tf_echo print", read_tf_echo, is_tf_echo),
    "ros-topic": TextFormat("what ros2 topic echo and rostopic echo print", read_ros_topic, is_ros_topic),
    "franka": TextFormat("O_T_EE of Franka robots: tables, JSON, printed states", read_franka, is_franka),
    "zivid": TextFormat("a transform of Zivid, YAML, in mm", read_zivid, is_zivid),
    "halcon": TextFormat("what write_pose of HALCON writes", read_halcon, is_halcon),
    **{name: TextFormat(ABOUT[name], partial(_read_controller, name), partial(_is_kind, name)) for name in NAMES},
    "matrix": TextFormat("4x4 or 3x4 matrices in text, also KITTI", read_matrix_text, is_matrix_text),
}


def named_by(head: str) -> list[str]:
    """Return the formats that a text may have, by its beginning."""
    named = [name for name, known in TEXTS.items() if name not in _LAST and known.is_it(head)]
    last = ("table",) if names_a_pose(head) else _LAST
    return named or [name for name in last if TEXTS[name].is_it(head)][:1]
