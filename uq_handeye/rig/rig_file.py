"""Rig from a TOML file: arms, cameras and targets with what they are on, and the files of the views.

    [arms.arm]
    poses = "robot.csv"              # or several files
    noise = ["0.5mrad", "0.3mm"]     # left out everywhere: estimated
    [cameras.left]
    on = "arm"
    [targets.board]
    on = "world"
    [[views]]
    camera = "left"
    target = "board"
    file = "left.csv"

Rows are matched by their timestamps, equal or nearest within ``tolerance`` (s, at the top of the file; default 0),
never by their order; files without timestamps only where all have as many rows.
"""

from __future__ import annotations

import tomllib
from collections.abc import Hashable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files.open import StrPath, as_path, opened
from ..files.trees import MAX_BYTES
from ..geometry.se3 import Array
from ..io import read_pose_file, read_stream
from .description import WORLD, ArmPoses, Rig, View

_TABLES = {"arms": {"poses", "noise", "units"}, "cameras": {"on", "noise"}, "targets": {"on"}}
_VIEW = {"camera", "target", "file", "units"}


def read_rig(path: StrPath) -> tuple[Rig, dict[str, Any] | None]:
    """Read a rig file: the rig, and the noise of its arms and cameras, None where it is to be estimated.

    Raises `InputError`, with the name of the file, for what it cannot mean.
    """
    target = as_path(path)
    with opened(target, MAX_BYTES) as file:
        data = file.read()
    try:
        tree = tomllib.loads(data.decode("utf-8-sig"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{target}: expected TOML, {error}.") from None
    try:
        return _read(tree, target.parent)
    except InputError as error:
        raise InputError(f"{target}: {error}") from error


def _read(tree: dict[str, Any], folder: Path) -> tuple[Rig, dict[str, Any] | None]:
    tables = {what: _checked(tree.get(what), what, keys) for what, keys in _TABLES.items()}
    if unknown := set(tree) - {*_TABLES, "views", "tolerance"}:
        raise InputError(f"Expected arms, cameras, targets, views and tolerance, got {sorted(unknown)[0]!r}.")
    tolerance = tree.get("tolerance", 0.0)
    if isinstance(tolerance, bool) or not isinstance(tolerance, int | float) or not tolerance >= 0:
        raise InputError(f"Expected `tolerance` to be seconds, 0 or more, got {tolerance!r}.")
    arms: dict[str, ArmPoses] = {}
    for name, entry in tables["arms"].items():
        files = entry.get("poses")
        listed = [files] if isinstance(files, str) else files
        if not isinstance(listed, list) or not listed or not all(isinstance(file, str) for file in listed):
            raise InputError(f"Expected `poses` of the arm {name!r} to name its files, got {files!r}.")
        for file in listed:
            names, poses = _poses(folder / file, "robot", entry.get("units"))
            found = ArmPoses(poses, names or (), file)
            arms[name] = arms[name].joined(found) if name in arms else found
    places = {what: {name: _place(what, name, entry) for name, entry in tables[what].items()} for what in
              ("cameras", "targets")}  # fmt: skip
    views = tree.get("views")
    if not isinstance(views, list) or not views:
        raise InputError("Expected [[views]] with camera, target and file.")
    rows = [_view(entry, k, folder, arms, places, float(tolerance)) for k, entry in enumerate(views)]
    noise = {name: tuple(value) if isinstance(value, list) else value
             for what in ("arms", "cameras") for name, entry in tables[what].items()
             if (value := entry.get("noise")) is not None}  # fmt: skip
    return Rig(arms, places["cameras"], places["targets"], tuple(rows)), noise or None


def _checked(table: Any, what: str, keys: set[str]) -> dict[str, dict[str, Any]]:
    if not isinstance(table, dict) or not table or not all(isinstance(entry, dict) for entry in table.values()):
        raise InputError(f"Expected a table [{what}.NAME] for each of the {what}, got {table!r:.40}.")
    for name, entry in table.items():
        if unknown := set(entry) - keys:
            raise InputError(
                f"Expected {', '.join(sorted(keys))} in [{what}.{name}], got {sorted(unknown)[0]!r}. Correct the name."
            )
    return table


def _place(what: str, name: str, entry: Mapping[str, Any]) -> Any:
    if "on" not in entry:
        raise InputError(f"Expected `on` in [{what}.{name}]: an arm, or {WORLD!r}.")
    return entry["on"]


def _view(
    entry: Any, k: int, folder: Path, arms: dict[str, ArmPoses], places: dict[str, dict[str, Any]], tolerance: float
) -> View:
    if not isinstance(entry, dict) or not {"camera", "target", "file"} <= set(entry) <= _VIEW:
        raise InputError(f"Expected camera, target and file in view {k + 1}, got {entry!r:.60}.")
    names, poses = _poses(folder / str(entry["file"]), "camera", entry.get("units"))
    carriers = [places["cameras"].get(entry["camera"]), places["targets"].get(entry["target"])]
    moving = [arms[place] for place in carriers if isinstance(place, str) and place in arms]
    if names is not None and moving:
        names = _matched(names, moving[0].names, tolerance)
    return View(entry["camera"], entry["target"], poses, names, source=str(entry["file"]))


def _matched(names: tuple[Hashable, ...], among: tuple[Hashable, ...], tolerance: float) -> tuple[Hashable, ...]:
    """Names of the robot poses nearest in time; a view that none is near keeps its own, which is then refused."""
    times = np.array(among, dtype=float)
    found: list[Hashable] = []
    for name in names:
        k = int(np.abs(times - float(str(name))).argmin())
        found.append(among[k] if abs(times[k] - float(str(name))) <= tolerance else name)
    return tuple(found)


def _poses(path: Path, side: str, units: Any) -> tuple[tuple[Hashable, ...] | None, Array]:
    """Timestamps as names, None where there are none, and poses in m."""
    try:
        stream = read_stream(path, side, units=None if units is None else str(units))
    except InputError as error:
        if "has no timestamps" not in str(error) or units is not None:
            raise
        return None, np.asarray(read_pose_file(path)[1])
    return tuple(stream.timestamps.tolist()), stream.poses
