"""Selection of the poses of a rig: robot poses left out of all views, or of those of one camera."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ...core.limits import MIN_POSES
from ...errors import InputError
from ...findings import Finding
from ..poses.pose_numbers import numbers_of
from .description import ArmPoses, Rig, View


def selected(rig: Rig, exclude: Any = None, only: Any = None) -> tuple[Rig, list[Finding]]:
    """Return a rig without some robot poses, and a note of them.

    Parameters
    ----------
    exclude, only : sequence, text, or None
        Robot poses to leave out, or the only ones to use: by names, or by numbers in order of time, counted
        from 0, where the names are times. Text such as ``"12,14-16,left:20"``; ``left:`` means views of left
        only.

    Raises
    ------
    InputError
        Both given, poses that the rig does not have, fewer than 3 left.
    """
    if exclude is None and only is None:
        return rig, []
    if exclude is not None and only is not None:
        raise InputError("`exclude` and `only` are both given. Give one of them.")
    of = "exclude" if only is None else "only"
    listed = exclude if only is None else only
    tokens = listed.split(",") if isinstance(listed, str) else [str(one) for one in listed]
    moments, timed = rig.moments, any(arm.timed for arm in rig.arms.values())
    named: dict[str, set[Hashable]] = {}
    for token in map(str.strip, tokens):
        owner, _, text = token.rpartition(":")
        if owner and owner not in (*rig.cameras, *rig.targets):
            owner, text = "", token
        named.setdefault(owner, set()).update(_moments(text, moments, timed, of))
    views = []
    for view in rig.views:
        given = {moment for owner in ("", view.camera, view.target) for moment in named.get(owner, ())}
        has = any(owner in named for owner in ("", view.camera, view.target))
        kept = [k for k, moment in enumerate(view.at or ()) if not has or (moment in given) == (of == "only")]
        if kept:
            views.append(some_of(view, kept))
    left = {moment for view in views for moment in view.at or ()}
    if len(left) < MIN_POSES:
        raise InputError(f"`{of}` leaves {len(left)} of {len(moments)} robot poses. At least {MIN_POSES} are needed.")
    whole = [k for k, moment in enumerate(moments) if moment not in left]
    arms = {name: _without(arm, left) if name in {*rig.cameras.values(), *rig.targets.values()} else arm
            for name, arm in rig.arms.items()}  # fmt: skip
    values = {"excluded": whole, "fit": None, "limit": None, "n": len(moments)}
    note = [Finding("calibration.excluded", "note", values)] if whole else []
    return Rig(arms, rig.cameras, rig.targets, tuple(views), rig.known), note


def _moments(text: str, moments: Sequence[Hashable], timed: bool, of: str) -> list[Hashable]:
    """Return the moments that a name, a number or a range of numbers means; of times, their numbers in order."""
    by_name = {str(moment): moment for moment in moments}
    if text in by_name and not (timed and text.isdigit()):
        return [by_name[text]]
    numbered = {moment: moment for moment in moments if type(moment) is int and not timed}
    places: Mapping[int, Hashable] = numbered if len(numbered) == len(moments) else dict(enumerate(moments))
    found = []
    for number in numbers_of(text, f"`{of}`"):
        if number not in places:
            if "-" in text and numbered:  # a range may skip names
                continue
            some = ", ".join(map(str, moments[:3]))
            raise InputError(f"`{of}`: the rig has no robot pose {number}. It has {len(moments)}: {some}, ...")
        found.append(places[number])
    return found


def some_of(view: View, rows: list[int]) -> View:
    """Return some rows of a view."""
    S, F, at = view.covariance, view.intrinsics, view.at or ()
    return replace(
        view,
        poses=view.poses[rows],
        at=tuple(at[k] for k in rows),
        covariance=S if S is None or S.ndim == 2 else S[rows],
        intrinsics=None if F is None else F[rows],
    )


def _without(arm: ArmPoses, left: set[Hashable]) -> ArmPoses:
    rows = [k for k, moment in enumerate(arm.names) if moment in left]
    joints = None if arm.joints is None else arm.joints[rows]
    return replace(arm, poses=arm.poses[rows], names=tuple(arm.names[k] for k in rows), joints=joints)
