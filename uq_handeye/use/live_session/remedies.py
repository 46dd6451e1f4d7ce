"""Remedies that the page of a session offers as buttons: another reading of the files, or poses to leave out.

They follow from the findings of the answer, whose sentences name command-line options: a page has none.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

from ...calibration.moves import MOVED
from ...findings import Finding
from ...fit.diagnostics.readings import FRAMES, ReadingValues

# What the camera is on, by the setup.
_MOUNTS = {"eye-in-hand": "on the gripper", "eye-to-hand": "fixed in the cell"}
# Frames of the poses in a file of each side, as they are read by default.
_USUAL = {"robot": "base_T_gripper", "camera": "camera_T_target"}
SIDES = ("robot", "camera")
# Lengths that look like those of another unit.
FAR = "input_checks.far"


# Arguments of `read_poses` that a button chooses: of both files, or of robot and camera.
How: TypeAlias = Mapping[str, str | tuple[str | None, ...]]


class Remedy(NamedTuple):
    """Action of a button: how the files are read, by arguments of `read_poses`, and the poses that are left out."""

    label: str
    how: How
    left_out: tuple[int, ...] = ()


def remedies_of(findings: Sequence[Finding], kept: Sequence[int]) -> tuple[Remedy, ...]:
    """Return what can be done about the findings of an answer; ``kept``: numbers of the poses that count."""
    found: list[Remedy] = []
    readings = [reading for one in findings for reading in one.values.get("readings", ())]
    for reading in readings:
        found += _of_reading(reading)
    if not readings and (units := _of_lengths(findings)):
        found.append(units)
    for one in findings:
        if one.code == MOVED:
            found += _of_move(int(one.values["since"]), kept)
    return tuple({one.label: one for one in found}.values())


def is_remedied(finding: Finding) -> bool:
    """Return whether buttons say what a finding says, in words of the page."""
    return bool(finding.values.get("readings")) or _of_lengths([finding]) is not None


def _of_reading(reading: ReadingValues) -> list[Remedy]:
    kind, found = reading["kind"], list[Remedy]()
    if kind in FRAMES:
        side, frame = FRAMES[kind]
        frame = _USUAL[side] if reading.get("given") else frame
        found.append(Remedy(f"The {side} file holds {frame}", {f"{side}_frame": frame}))
        if (setup := reading.get("setup")) is not None:
            mount = Remedy(f"The camera is {_MOUNTS[setup]}", {"setup": setup})
            found = [mount, *found] if reading.get("likely") == "setup" else [*found, mount]
    elif kind == "scale" and reading.get("file") is not None and reading.get("unit") is not None:
        found.append(_in_unit(reading["unit"], [reading["file"]]))
    elif kind in ("transposed", "quaternion"):
        value = str(reading.get("order") or kind)
        file = reading.get("file")
        whose = "Both files have" if file is None else f"The {file} file has"
        what = "transposed rotations" if kind == "transposed" else f"quaternions as {value}"
        found.append(Remedy(f"{whose} {what}", {"rotation": _of_sides(value, SIDES if file is None else [file])}))
    if (scale := reading.get("scale")) is not None and len(found) == 1:  # both at once
        for more in _of_reading(scale):
            found[0] = Remedy(f"{found[0].label}, in {scale['unit']}", {**found[0].how, **more.how})
    return found


def _of_lengths(findings: Iterable[Finding]) -> Remedy | None:
    far = {one.values["file"]: one.values["unit"] for one in findings if one.code == FAR}
    far = {file: unit for file, unit in far.items() if file in SIDES and unit}
    return _in_unit(next(iter(far.values())), list(far)) if len(set(far.values())) == 1 else None


def _in_unit(unit: str, files: Sequence[str]) -> Remedy:
    whose = "Both files are" if len(files) > 1 else f"The {files[0]} file is"
    return Remedy(f"{whose} in {unit}", {"units": _of_sides(unit, files)})


def _of_sides(value: str, files: Sequence[str]) -> tuple[str | None, str | None]:
    robot, camera = (value if side in files else None for side in SIDES)
    return robot, camera


def _of_move(since: int, kept: Sequence[int]) -> list[Remedy]:
    before, after = (tuple(k for k in kept if (k >= since) == later) for later in (False, True))
    larger = [Remedy(f"Leave out the poses from {since} on", {}, after),
              Remedy(f"Leave out the poses before {since}", {}, before)]  # fmt: skip
    return larger if len(after) <= len(before) else larger[::-1]
