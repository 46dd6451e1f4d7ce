"""Sentences of the findings of pictures of a scene."""

from __future__ import annotations

from collections.abc import Sequence

from ..core.limits import MAX_LISTED
from ..findings import CAMERA, digits, sentence


def _listed(names: Sequence[object]) -> str:
    return ", ".join(map(str, names[:MAX_LISTED])) + (", ..." if len(names) > MAX_LISTED else "")


@sentence("scene.found", check=CAMERA, phrase="{pictures} of {given} pictures")
def _(
    pictures: int,
    given: int,
    points: int,
    per_picture: float,
    pixel_noise: float,
    focal: float,
    focal_sd: float | None,
    scale_sd: float | None,
    camera: str | None = None,
) -> str:
    f = f"f = {focal:.2f} px" + ("" if focal_sd is None else f" +- {digits(focal_sd, 2)} px")
    unit = "" if scale_sd is None else f" Unit of the scene from the robot, to {digits(100 * scale_sd, 1)} %."
    by = "" if camera is None else f" by {camera}"
    return (
        f"The scene{by}: {pictures} of {given} pictures, {points:,} points, {per_picture:,.0f} in a picture, "
        f"{digits(pixel_noise, 2)} px; {f}.{unit}"
    )


@sentence("scene.stationary", check=CAMERA, phrase="{share:pct.0f} % of matches stand still in the picture", effect=1.5)
def _(share: float) -> str:
    return (
        f"{100 * share:.0f} % of what matches stands still in the picture: the gripper, or a camera that did not move. "
        "Show more of the scene from other places, or mask the gripper (--mask)."
    )


@sentence("scene.gripper", check=CAMERA, phrase="{share:pct.0f} % of the picture is the gripper")
def _(share: float) -> str:
    return f"{100 * share:.0f} % of the picture stands still in all pictures, as a gripper does, and was left out."


@sentence("scene.moved", check=CAMERA, phrase="an object of the scene moved")
def _(before: Sequence[str], after: Sequence[str], points: int, of: int, length: float | None) -> str:
    by = "" if length is None else f" by {digits(1e3 * length, 2)} mm"
    return (
        f"An object of the scene moved{by}: {points:,} of {of:,} points are at one place in {_listed(before)} and at "
        f"another in {_listed(after)}. Each place was used by itself."
    )


@sentence("scene.left_out", check=CAMERA, phrase=lambda v: f"{len(v['names'])} pictures show too little of the scene")
def _(names: Sequence[str], given: int, least: int) -> str:
    one = len(names) == 1
    return (
        f"{len(names)} of {given} pictures {'shows' if one else 'show'} too little of the scene (fewer than {least} "
        f"points) and {'is' if one else 'are'} left out: {_listed(names)}."
    )


@sentence(
    "scene.focal_open",
    check=CAMERA,
    phrase="focal length not determined by the pictures",
    remedy="tilt the camera by 20 degrees about two axes, or give --intrinsics",
    explains=True,
    rank=2,
)
def _(focal: float, sd: float) -> str:
    return (
        f"The pictures do not tell the focal length ({focal:.0f} +- {digits(sd, 2)} px): the camera looked in one "
        "direction. Tilt it by 20 degrees about two axes, or give --intrinsics."
    )


@sentence(
    "scene.lens",
    check=CAMERA,
    phrase="the lens comes out as no lens is",
    remedy="take the pictures at standstill",
    rank=3,
)
def _(ratio: float, p1: float, p2: float) -> str:
    return (
        f"The lens comes out as no lens is: fx/fy {ratio:.3f}, p1 {p1:.3f}, p2 {p2:.3f}. Were the pictures taken while "
        "the robot moved? Take them at standstill."
    )


@sentence("scene.models", check=CAMERA, phrase="{count} parts without a common match")
def _(count: int, sizes: Sequence[int], joined: bool) -> str:
    text = f"The pictures fall into {count} parts without a common match ({_listed(sizes)} pictures)."
    return text + (" The robot joined them." if joined else " The largest is used.")
