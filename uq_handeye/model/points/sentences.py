"""Sentences of the findings of poses from points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...core.limits import MAX_LISTED, MAX_NAMED
from ...core.presentation.numbers import concise, digits, multiple, probability
from ...core.presentation.units import MM_PER_M
from ...findings import CAMERA, sentence


def listed(items: Sequence[int] | Sequence[str]) -> str:
    """The first of several, with commas."""
    return ", ".join(map(str, items[:MAX_LISTED])) + (", ..." if len(items) > MAX_LISTED else "")


@sentence("points.left_out", check=CAMERA, phrase="{count} of {n} points left out")
def _(count: int, n: int, far_points: Sequence[Mapping[str, str | float]]) -> str:
    which = "; ".join(
        f"pose {one['pose']}, point {one['point']} ({digits(MM_PER_M * float(one['distance']), 2)} mm)"
        for one in far_points[:MAX_NAMED]
    )
    more = ", and others" if count > min(len(far_points), MAX_NAMED) else ""
    were = "was rejected as an outlier" if count == 1 else "were rejected as outliers"
    return f"{count} of {n} points {were}: {which}{more}. Check how they were measured and named."


@sentence("points.poses_left_out", check=CAMERA, phrase=lambda v: f"{len(v['poses'])} poses left out: {v['why']}")
def _(poses: Sequence[int], why: str) -> str:
    start = (
        f"{'Pose' if len(poses) == 1 else 'Poses'} {listed(poses)} {'was' if len(poses) == 1 else 'were'} left out: "
    )
    return start + {
        "few points": "fewer than three usable points give no pose.",
        "in line": "the points lie in a line, which leaves the rotation about it free. Measure a point off the line.",
        "inconsistent": "the points contradict the target, and fewer than three remain. Check their names.",
    }.get(why, f"{why}.")


@sentence(
    "points.not_in_target", check=CAMERA, phrase=lambda v: f"{len(v['points'])} measured points not in the target"
)
def _(points: Sequence[str]) -> str:
    return (
        f"{len(points)} measured point{'s' if len(points) > 1 else ''} not in the target, not used: {listed(points)}. "
        "Give the same point the same name in both files."
    )


@sentence(
    "points.noise_differs",
    check=CAMERA,
    phrase=lambda v: f"residuals of points {digits(v['ratio'], 2)} times the noise given",
    effect=lambda v: float(max(v["ratio"], 1.0)),
)
def _(ratio: float, p_value: float) -> str:
    return (
        f"The residuals are {multiple(ratio)} times as large as the noise given ({probability(p_value)}). Correct "
        "`noise` (--noise), or leave it out to have it estimated."
    )


@sentence(
    "points.scale",
    check=CAMERA,
    phrase=lambda v: f"scale of the points {digits(100 * abs(v['scale']), 2)} % off the target",
    effect=lambda v: float(abs(v["scale"]) / v["std"]),
)
def _(scale: float, std: float) -> str:
    larger = "larger" if scale > 0 else "smaller"
    return (
        f"The measured distances between points are {concise(100 * abs(scale), 100 * std)} % {larger} than those of "
        "the target: its coordinates or the scale of the camera are wrong. The covariance does not include this error."
    )


@sentence("points.target_off", check=CAMERA, phrase="{count} of {n} points off the target", effect=1.5)
def _(count: int, n: int, far_points: Sequence[Mapping[str, str | float]]) -> str:
    which = ", ".join(f"{one['point']} ({digits(MM_PER_M * float(one['distance']), 2)} mm)" for one in far_points)
    return (
        f"{count} of {n} points lie elsewhere than in the target, in all poses alike: {which}. The covariance does "
        "not include this error. Measure the target again."
    )
