"""A rig whose camera or target that moved is two: one before the move and one from it on.

The later one has the name of the first with the robot pose from which on it is there, such as ``board@13``. All views
count in one fit: they share the arm, and what did not move.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import replace

from .description import Rig, View, later_name
from .selection import some_of


def split_rig(rig: Rig, name: str, since: Hashable, label: str | None = None) -> Rig:
    """Return the rig in which a camera or target is another one from a moment on.

    ``since``: the moment, or its name as text, as findings have it. ``label``: what it is called in the new name; None:
    as the rig has it.
    """
    order = rig.moments
    first = next(k for k, moment in enumerate(order) if str(moment) == str(since))
    later = set(order[first:])
    again = later_name(name, since if label is None else label)
    views: list[View] = []
    for view in rig.views:
        if name not in (view.camera, view.target):
            views.append(view)
            continue
        of_after = [moment in later for moment in view.at or ()]
        for after in (False, True):
            if rows := [k for k, one in enumerate(of_after) if one == after]:
                views.append(_some(view, rows, name, again if after else name))
    cameras, targets = (
        {one: place for key, place in of.items() for one in ([key, again] if key == name else [key])}
        for of in (rig.cameras, rig.targets)
    )
    return Rig(rig.arms, cameras, targets, tuple(views), rig.known)


def _some(view: View, rows: list[int], name: str, again: str) -> View:
    """Return some rows of a view, of a camera or target with another name."""
    return replace(
        some_of(view, rows),
        camera=again if view.camera == name else view.camera,
        target=again if view.target == name else view.target,
    )
