"""Ways in which controllers write a pose: rotation, length unit, names of the numbers, by ``controllers.toml``."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from ...core.files.trees import parse_toml


class PoseForm(NamedTuple):
    """A pose as a controller writes it.

    Parameters
    ----------
    name : as ``--format`` takes it
    maker : for people
    rotation : text of a `RotationForm`
    units : length unit
    columns : names of the numbers of the rotation, in their order
    source : the maker's documentation that is followed
    literal : a pose in the language of the controller, if it has one: ``{name}``, and the numbers by their places
    comment : mark of comments in that language
    """

    name: str
    maker: str
    rotation: str
    units: str
    columns: tuple[str, ...]
    source: str
    literal: str = ""
    comment: str = "#"


CONTROLLERS = {
    name: PoseForm(name, **form | {"columns": tuple(form["columns"])})
    for name, form in parse_toml(Path(__file__).with_name("controllers.toml")).items()
}
# Names of the formats of controllers, and what each is in a few words, for help texts.
NAMES = (*CONTROLLERS, "table")
ABOUT = {
    **{name: f"{form.maker}: x, y, z, {', '.join(form.columns)}" for name, form in CONTROLLERS.items()},
    "table": "numbers of poses in columns, with or without names",
}


def forms_of(*names: str) -> tuple[tuple[str, str], ...]:
    """Return makers with the form of their rotations, by ``controllers.toml``; other names are forms themselves."""
    return tuple((name, CONTROLLERS[name].rotation) if name in CONTROLLERS else ("table", name) for name in names)
