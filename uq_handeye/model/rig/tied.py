"""Test whether the views of a rig tie all its cameras, targets and arms to each other (T18)."""

from __future__ import annotations

from ...errors import InputError
from .description import WORLD, Rig


def parts_of(rig: Rig) -> list[list[str]]:
    """Return cameras and targets by connected part; those without a view by themselves."""
    parts: list[set[str]] = [{name} for name in (*rig.cameras, *rig.targets)]
    for view in rig.views:
        both = [part for part in parts if view.camera in part or view.target in part]
        parts = [part for part in parts if part not in both] + [set().union(*both)]
    order = [*rig.cameras, *rig.targets]
    return sorted((sorted(part, key=order.index) for part in parts), key=lambda part: order.index(part[0]))


def require_tied(rig: Rig) -> None:
    """Raise `InputError` for a camera or target without views, and for parts and arms not connected to the world."""
    known = rig.known or {}
    views = [view for view in rig.views if len(view.poses)]
    seen = {name for view in views for name in (view.camera, view.target)}
    for what, listed in (("camera", rig.cameras), ("target", rig.targets)):
        if unseen := [name for name in listed if name not in seen]:
            raise InputError(f"The {what} {unseen[0]!r} has no view. Add a view of it, or remove it from the rig.")
    parts = parts_of(rig)
    for part in parts:
        moving = any(len(set(rig.places(view))) > 1 for view in views if view.camera in part)
        if not moving and not any(name in known for name in part):
            place = rig.place(part[0])
            raise InputError(
                f"Nothing ties {_listed(part)} to the rest of the rig: they see each other from {_where(place)} only. "
                "Add a view by or of something that moves against them, or a known pose of one of them."
            )
    require_arms_tied(rig, parts)


def require_arms_tied(rig: Rig, parts: list[list[str]]) -> None:
    """Raise `InputError` for an arm whose base no part relates to the first arm's."""
    arms = list(rig.arms)
    tied = {arms[0], *(name for name in arms if name in (rig.known or {}))}
    places = [{rig.place(name) for name in part} for part in parts]
    known = {name for name in (rig.known or {}) if name not in arms}
    for part, where in zip(parts, places, strict=True):
        if known & set(part):  # a target whose pose in the world is known takes the place of the first arm
            where.add(arms[0])
    grown = True
    while grown:
        more = {name for where in places if where & tied for name in where - {WORLD}} - tied
        tied |= more
        grown = bool(more)
    if loose := [name for name in arms if name not in tied]:
        raise InputError(
            f"Nothing ties the base of the arm {loose[0]!r} to that of {arms[0]!r}. Add views between what is on the "
            "two, or a target that cameras of both see, or a known pose of the base."
        )


def _listed(names: list[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _where(place: str) -> str:
    return "the world" if place == WORLD else f"the arm {place}"
