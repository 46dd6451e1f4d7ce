"""Poses from the programs and data files of controllers, maker by maker, as one side of a pose file."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ..contents import Contents
from .abb import IS_ABB, add_abb_poses, has_lists
from .fanuc import IS_FANUC, add_fanuc_poses
from .forms import CONTROLLERS
from .kawasaki import IS_KAWASAKI, add_kawasaki_poses
from .kuka import add_kuka_poses, is_kuka
from .program_text import ProgramPoses
from .staubli import BRACES, add_staubli_poses, is_staubli
from .universal_robots import IS_UR, add_ur_poses
from .yaskawa import IS_YASKAWA, add_yaskawa_poses


class Program(NamedTuple):
    """The language of a maker: what its texts look like, and what adds their poses and returns their length unit."""

    recognises: Callable[[str], object]
    read: Callable[[ProgramPoses], str | None]
    loose: Callable[[str], object] = lambda head: False  # what is theirs only if the format is asked for


# A text is tested for these formats in this order.
PROGRAMS = {
    "yaskawa": Program(IS_YASKAWA.search, add_yaskawa_poses),
    "fanuc": Program(IS_FANUC.search, add_fanuc_poses),
    "kawasaki": Program(IS_KAWASAKI.search, add_kawasaki_poses),
    "kuka": Program(is_kuka, add_kuka_poses),
    "ur": Program(IS_UR.search, add_ur_poses),
    "staubli": Program(is_staubli, add_staubli_poses, BRACES.search),
    "abb": Program(IS_ABB.search, add_abb_poses, has_lists),
}


def read_program(maker: str, text: str, name: str, sure: bool = True) -> Contents:
    """Return the poses of a text; unless ``sure``, the convention of their rotations is open."""
    found = ProgramPoses(text, name)
    return found.contents(CONTROLLERS[maker], PROGRAMS[maker].read(found), sure)
