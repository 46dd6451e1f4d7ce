"""Sentences of the findings of `maintenance`. Values are in rad and m."""

from __future__ import annotations

import math
from collections.abc import Hashable, Sequence

from ...core.presentation.numbers import digits, probability
from ...findings import sentence
from ...fit.diagnostics.readings import in_words


@sentence("maintenance.misread")
def _(
    kind: str,
    file: str | None,
    unit: str | None = None,
    given: str | None = None,
    order: str | None = None,
    factor: float = 1.0,
    shift: int = 0,
) -> str:
    of, side = ("both files", "") if file is None else (f"the {file} file", f"{file}=")
    if kind in ("quaternion", "transposed", "mirrored"):
        return f"The poses agree with the calibration if {in_words({'kind': kind, 'file': file, 'order': order})}."
    early, late = ("camera", "robot") if shift > 0 else ("robot", "camera")
    rows = "1 row" if abs(shift) == 1 else f"{abs(shift)} rows"
    frames = {"robot": "--robot-frame gripper_T_base", "camera": "--camera-frame target_T_camera"}
    options = " ".join(frames.values() if file is None else [frames.get(file, "")])
    by_kind = {
        "unit": f"{of} {'are' if file is None else 'is'} in {unit}, not {given}: give the unit (--units {side}{unit}).",
        "scale": f"the {file} translations are multiplied by {factor:.4g}: "
        + (
            "they are of another arm, or were scaled."
            if file == "robot"
            else "the size of the target, or the focal length, is not that of the calibration. Measure the target."
        ),
        "swapped": "the two files are exchanged: give that of the robot first.",
        "rows": f"the {early} file begins {rows} before the {late} file. Leave out the first {rows.removeprefix('1 ')} "
        f"of the {early} file and the last of the {late} file.",
    }
    inverse = f"{of} hold{'' if file is None else 's'} inverse poses ({options})."
    return f"The poses agree with the calibration if {by_kind.get(kind, inverse)}"


@sentence("maintenance.another_rig")
def _(things: str) -> str:
    return f"By the files these poses are of another rig than the result: another {things}. Calibrate that one."


@sentence("maintenance.pairing")
def _(rows: Sequence[int], count: int, n: int) -> str:
    listed = ", ".join(map(str, rows)) + (", ..." if count > len(rows) else "")
    return (
        f"The poses agree with the calibration in another order: {count} of {n} camera poses belong to other robot "
        f"poses (rows {listed}). Pair the files again."
    )


@sentence("maintenance.one_pose_wrong")
def _(n: int, row: int | None = None, of: str = "") -> str:
    what = f"pose {row} of {n}" if not of else f"the view {of}"
    return (
        f"Only {what} contradicts the calibration, and no change explains it: probably a wrong detection or "
        "robot pose. Measure it again, or leave it out."
    )


@sentence("maintenance.unexplained")
def _(p_value: float) -> str:
    return (
        f"No single cause explains these poses (best: {probability(p_value)}). Several things have changed, poses are "
        "wrong (new ones, or some of the calibration), or the noise is larger than that of the calibration. Calibrate "
        "again."
    )


@sentence("maintenance.few_poses")
def _(n: int) -> str:
    what = "One pose" if n == 1 else f"{n} poses"
    return (
        f"{what} cannot separate a change from one wrong measurement. Check {3 - n} more, at other orientations, "
        "before you calibrate again."
    )


@sentence("maintenance.coarse")
def _(
    translation: float | None,
    rotation: float | None,
    translation_limit: float | None,
    rotation_limit: float | None,
    given: bool,
    name: str = "X",
) -> str:
    parts = []
    for value, limit, scale, unit in (
        (translation, translation_limit, 1e3, "mm"),
        (rotation, rotation_limit, math.degrees(1.0), "deg"),
    ):
        if limit is not None and (value is None or value > limit):
            shown = "any size" if value is None else f"{digits(scale * value, 2)} {unit}"
            parts.append(f"{shown}, with {digits(scale * limit, 2)} {unit} {'accepted' if given else 'as the limit'}")
    missed = " and ".join(parts)
    return f"These poses could miss a change of {name} of {missed}. Add poses, at more orientations and distances."


@sentence("maintenance.overstated")
def _() -> str:
    return (
        "The poses agree better than they should: the robot accuracy that the calibration assumes is larger than they "
        "show. Declare it (calibrate --robot-accuracy), and smaller changes show."
    )


@sentence("maintenance.by_posterior")
def _(old: int, new: int) -> str:
    return (
        f"{new} new pose{'' if new == 1 else 's'} updated the joint covariance of the result of {old} poses, which "
        "were not fitted again: its file lacks them, or not all is the same. Residuals are of the old poses."
    )


sentence(
    "maintenance.later_numbers",
    "The new robot poses have the numbers of old ones and are others: here their numbers are larger by {later}.",
)


@sentence("maintenance.moved_since", phrase="{name} moved among the new poses, from pose {since} on", rows=("since",))
def _(name: str, since: Hashable, n: int | None, rotation: float, translation: float, p_value: float) -> str:
    what = {"X": "The camera", "target": "The target"}.get(name, name)
    counted = " on" if n is None else f" of {n} on (counted from 0)"  # of a rig by the name of its robot pose
    by = f"{digits(1e3 * translation, 2)} mm and {digits(math.degrees(rotation), 2)} deg"
    return (
        f"{what} moved among the new poses, from pose {since}{counted}, by {by} ({probability(p_value)}): the poses "
        f"before agree with the calibration. Fix it, and calibrate again."
    )
