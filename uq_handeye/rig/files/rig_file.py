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

``known`` in any of the tables names a file with a pose known beforehand and its covariance. ``units``, ``format``,
``rotation`` and ``frame`` beside a file say how it is read, as the options of ``calibrate`` do. Rows are matched by
their timestamps, equal or nearest within ``tolerance`` (s, at the top of the file; default 0), or by the number of the
pose (`pose_rows`), never by their order; files that name no poses only where all have as many rows.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...core.files.open import StrPath, as_path, opened
from ...core.files.trees import MAX_BYTES
from ...errors import InputError
from ...formats.prior_file import read_prior
from ..description import WORLD, ArmPoses, Rig, View
from .pose_rows import PoseRows, on_one_clock, read_rows, view_of

READING = ("units", "format", "rotation", "frame")
_TABLES = {
    "arms": {"poses", "noise", "known", *READING},
    "cameras": {"on", "noise", "known"},
    "targets": {"on", "known"},
}
_VIEW = {"camera", "target", "file", *READING}


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
    rows: dict[str, PoseRows] = {}
    for name, entry in tables["arms"].items():
        files = entry.get("poses")
        listed = [files] if isinstance(files, str) else files
        if not isinstance(listed, list) or not listed or not all(isinstance(file, str) for file in listed):
            raise InputError(f"Expected `poses` of the arm {name!r} to name its files, got {files!r}.")
        for file in listed:
            found = read_rows(folder / file, "robot", **_reading(entry))
            if arms and name not in arms:
                found = on_one_clock(found, next(iter(rows.values())), float(tolerance))
            poses = ArmPoses(found.poses, found.names if found.named else (), file)
            arms[name] = arms[name].joined(poses) if name in arms else poses
            rows[name] = rows[name].joined(found) if name in rows else found
    places = {what: {name: _place(what, name, entry) for name, entry in tables[what].items()} for what in
              ("cameras", "targets")}  # fmt: skip
    views = tree.get("views")
    if not isinstance(views, list) or not views:
        raise InputError("Expected [[views]] with camera, target and file.")
    seen = [_view(entry, k, folder, rows, places, float(tolerance)) for k, entry in enumerate(views)]
    noise = {name: tuple(value) if isinstance(value, list) else value
             for what in ("arms", "cameras") for name, entry in tables[what].items()
             if (value := entry.get("noise")) is not None}  # fmt: skip
    known = {name: _known(folder, name, entry["known"]) for what in _TABLES
             for name, entry in tables[what].items() if "known" in entry}  # fmt: skip
    return Rig(arms, places["cameras"], places["targets"], tuple(seen), known or None), noise or None


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


def _known(folder: Path, name: str, file: Any) -> Any:
    if not isinstance(file, str):
        raise InputError(f"Expected `known` of {name!r} to name a file with pose and covariance, got {file!r:.40}.")
    return read_prior(folder / file, "X")


def _view(
    entry: Any, k: int, folder: Path, arms: dict[str, PoseRows], places: dict[str, dict[str, Any]], tolerance: float
) -> View:
    if not isinstance(entry, dict) or not {"camera", "target", "file"} <= set(entry) <= _VIEW:
        raise InputError(f"Expected camera, target and file in view {k + 1}, got {entry!r:.60}.")
    file = str(entry["file"])
    rows = read_rows(folder / file, "camera", **_reading(entry))
    carriers = [places["cameras"].get(entry["camera"]), places["targets"].get(entry["target"])]
    moving = [arms[place] for place in carriers if isinstance(place, str) and place in arms]
    return view_of(entry["camera"], entry["target"], rows, moving, tolerance, file)


def _reading(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {key: None if entry.get(key) is None else str(entry[key]) for key in READING}
