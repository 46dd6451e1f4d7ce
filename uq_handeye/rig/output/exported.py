"""Poses of a rig for other programs: each in its parent frame, and the relative poses of the cameras."""

from __future__ import annotations

import re
from typing import Any

from ...core.files.atomic import json_text
from ...formats.export.several import Several
from ...formats.export.snippets import OPEN_DEVIATION, Transform, with_open


def several_of(result: Any) -> Several:
    """Return the poses of cameras, targets and bases, and the relative poses, of a `RigCalibration`."""
    singles = [*result.cameras.values(), *result.targets.values(), *list(result.arms.values())[1:]]
    comments = []
    if opened := [one.frame for one in (*singles, *result.pairs) if len(one.open)]:
        comments = [
            f"Open, not determined by the motions in all directions: {', '.join(opened)}.",
            f"Along open directions the covariance has a standard deviation of {OPEN_DEVIATION:g} m (angles: times "
            f"{result.lever:.3g} m), which stands for infinity.",
        ]
    first = next(iter(result.rig.arms))
    if len(result.rig.arms) > 1:
        comments.append(f"The world is the base of the arm {first}.")
    return Several(
        [_transform(one) for one in singles], [_transform(one) for one in result.pairs], comments,
        json_text(result.to_dict()),
    )  # fmt: skip


def _transform(one: Any) -> Transform:
    parent, _, child = (re.sub(r"[^A-Za-z0-9_]", "_", part) for part in one.frame.partition("_T_"))
    return Transform(one.pose + 0.0, with_open(one.covariance, one.open), parent, child)
