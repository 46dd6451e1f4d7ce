"""Reader of a rig from a TOML file: arms, cameras and targets with their carriers, and the files of the views.

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

An arm has ``poses``, or ``joints`` with a robot model (``robot_model``, a name or an MJCF file, ``urdf``, ``dh`` or
``ur_calibration``, with ``base`` and ``tip``), or both; or ``bag`` with the ``topic`` (or frames) of its poses or
joints. A view has a ``file`` of poses or the folder of ``camera -o`` or ``points -o``; or ``corners`` with known
``intrinsics`` (of the view or its camera); or a ``bag`` with its ``topic``, and ``tag``, the side of a tag seen by its
corners. ``known`` in any of the tables names a file with a pose known beforehand and its covariance. ``units``,
``format``, ``rotation`` and ``frame`` of a file say how it is read, as the options of ``calibrate`` do.

Rows are matched by their timestamps, equal or nearest within ``tolerance`` (s, at the top of the file; default 0), or
by the number of the pose (`pose_rows`), never by their order; files that name no poses only where all have as many. The
poses of an arm from a bag are interpolated at the times of the views. ``offset`` of a camera (s) is the time by which
its clock is behind that of the robot; with a bag it is estimated (`synchronise`) where it is not given.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...core.files.open import StrPath, as_path
from ...core.files.records import read
from ...core.files.tree_values import is_list, is_map
from ...core.files.trees import parse_toml
from ...errors import InputError
from ...formats.priors import read_prior
from ...model.kinematics.chain import Kinematics
from ...model.kinematics.kinematic_errors import KinematicErrors
from ...model.rig.description import WORLD, ArmPoses, Rig, nearest_names, require_in_rig, require_names
from ...model.rig.noise_by_name import require_noise
from .pose_rows import PoseRows, on_one_clock, read_rows, view_of
from .sources import (
    MODELS,
    Bags,
    apart_by_calibration,
    arm_poses,
    at_views,
    clock_offset,
    joint_rows,
    joint_units_of,
    kinematics_of,
    rows_of_corners,
)

READING = ("units", "format", "rotation", "frame")
FILES = tuple[str, ...]  # or one
_READING = dict.fromkeys(READING, str)
_CHAIN = dict.fromkeys((*MODELS, "base", "tip", "joint_units", "robot_class"), str)
# Kinds of the values of each table; Any: checked where it is used.
_TABLES: dict[str, dict[str, Any]] = {
    "arms": {"poses": FILES, "joints": FILES, "bag": FILES, "topic": str, **_CHAIN, "noise": Any, "known": str}
    | _READING,
    "cameras": {"on": Any, "noise": Any, "known": str, "intrinsics": Any, "offset": float},
    "targets": {"on": Any, "known": str},
}
_SOURCES = {"file": str, "corners": str, "bag": FILES}
_VIEW: dict[str, Any] = {"camera": str, "target": str, **_SOURCES, "intrinsics": Any, "topic": str, "tag": Any}
_VIEW |= _READING


def read_rig(path: StrPath) -> tuple[Rig, dict[str, Any] | None]:
    """Read a rig file: the rig, and the noise of its arms and cameras, None where it is to be estimated.

    Raises `InputError`, with the name of the file, for invalid content.
    """
    target = as_path(path)
    try:
        tree = parse_toml(target)
    except InputError as error:
        if twice := re.search(r"Cannot declare \((.*)\) twice \(at line (\d+)", str(error)):
            table = ".".join(part.strip(" '") for part in twice[1].split(","))
            raise InputError(f"{target}: [{table}] is there twice, again in line {twice[2]}. Rename one.") from None
        raise
    try:
        return _Read(tree, target.parent).rig()
    except InputError as error:
        raise InputError(f"{target}: {error}") from error


class _Read:
    """The tables of a rig file, checked, and what its files hold."""

    def __init__(self, tree: dict[str, Any], folder: Path) -> None:
        top = _checked(tree, {**dict.fromkeys((*_TABLES, "views"), Any), "tolerance": float}, "at the top of the file")
        self.folder, self.tolerance = folder, float(top.get("tolerance", 0.0))
        self.tables = {what: _table(tree.get(what), what, kinds) for what, kinds in _TABLES.items()}
        if not self.tolerance >= 0:
            raise InputError(f"Expected `tolerance` to be 0 s or more, got {self.tolerance:g}.")
        if not is_list(views := tree.get("views")) or not views:
            raise InputError("Expected [[views]] with camera, target and file.")
        self.views = [_view(entry, f"in view {k}") for k, entry in enumerate(views, 1)]
        self.rows: dict[str, PoseRows] = {}  # of each arm
        self.chains: dict[str, Kinematics | None] = {}
        self.bags = Bags()

    def rig(self) -> tuple[Rig, dict[str, Any] | None]:
        """Return the rig and its noise."""
        places = {what: {name: _place(what, name, entry, self.tables["arms"])
                         for name, entry in self.tables[what].items()} for what in ("cameras", "targets")}  # fmt: skip
        require_names(self.tables["arms"], places["cameras"], places["targets"])
        for view in self.views:
            for what in ("camera", "target"):
                require_in_rig(view[what], what, places[f"{what}s"], str(view.get("file", "A view")))
        arms = {name: self._arm(name, entry) for name, entry in self.tables["arms"].items()}
        carriers = [[place for place in (places["cameras"][view["camera"]], places["targets"][view["target"]])
                     if place in self.tables["arms"]] for view in self.views]  # fmt: skip
        seen = apart_by_calibration(list(map(self._rows, self.views)), [view["camera"] for view in self.views])
        streams = [name for name, rows in self.rows.items() if rows.stream]
        if streams:
            seen = self._on_one_clock(seen, carriers, places["cameras"])
        for name in streams:
            of = [one for one, on in zip(seen, carriers, strict=True) if name in on]
            if untimed := [one.name for one in of if one.times is None]:
                raise InputError(
                    f"{untimed[0]} has no timestamps, which a view beside an arm from a bag needs. Add them."
                )
            rows = self.rows[name] = at_views(self.rows[name], [np.asarray(one.times) for one in of], self.chains[name])
            arms[name] = arm_poses(rows, self.chains[name], _errors_of(self.tables["arms"][name]))
            seen = [one.some(np.isin(np.asarray(one.times), np.asarray(rows.times))) if name in on else one
                    for one, on in zip(seen, carriers, strict=True)]  # fmt: skip
        views = tuple(
            view_of(view["camera"], view["target"], rows, [self.rows[name] for name in on], self.tolerance)
            for view, rows, on in zip(self.views, seen, carriers, strict=True)
        )
        noise = {name: tuple(value) if is_list(value) else value
                 for what in ("arms", "cameras") for name, entry in self.tables[what].items()
                 if (value := entry.get("noise")) is not None}  # fmt: skip
        known = {name: read_prior(self.folder / entry["known"], "X") for what in _TABLES
                 for name, entry in self.tables[what].items() if "known" in entry}  # fmt: skip
        given = {name: arm for name, arm in arms.items() if arm is not None}
        rig = Rig(given, places["cameras"], places["targets"], views, known or None)
        require_noise(rig, noise)
        return rig, noise or None

    def _arm(self, name: str, entry: Mapping[str, Any]) -> ArmPoses | None:
        """Read the rows of an arm, and return its poses; None of a bag, until the times of the views are known."""
        where = f"[arms.{name}]"
        chain = self.chains[name] = kinematics_of(entry, self.folder, where)
        sources = [key for key in ("bag", "poses", "joints") if key in entry]
        if not sources:
            raise InputError(f"Expected `poses` (files), `joints` with a robot model, or `bag` in {where}, got none.")
        paths = {key: [self.folder / file for file in entry[key]] for key in sources}
        if "bag" in paths:
            if len(paths) > 1:
                raise InputError(f"{where} has both bag and {sources[1]}. Remove one of them.")
            self.rows[name] = self.bags.arm(paths["bag"], _topic(entry, where), chain, entry)
            return None
        if "joints" in paths and chain is None:
            raise InputError(f"{where} has joints and no robot model. Add one of {', '.join(MODELS)}.")
        if len(paths) == 2 and len(paths["poses"]) != len(paths["joints"]):
            raise InputError(f"Expected as many files of `joints` as of `poses` in {where}.")
        found: ArmPoses | None = None
        for k in range(len(paths[sources[0]])):
            rows = read_rows(paths["poses"][k], "robot", **_reading(entry)) if "poses" in paths else None
            if "joints" in paths and chain is not None:
                rows = joint_rows(paths["joints"][k], chain, joint_units_of(entry, self.folder), rows)
            assert rows is not None
            if self.rows and name not in self.rows:
                rows = on_one_clock(rows, next(iter(self.rows.values())), self.tolerance)
            poses = arm_poses(rows, chain, _errors_of(entry))
            found = poses if found is None else found.joined(poses)
            self.rows[name] = self.rows[name].joined(rows) if name in self.rows else rows
        return found

    def _rows(self, view: Mapping[str, Any]) -> PoseRows:
        where = f"The view of {view['target']} by {view['camera']}"
        intrinsics = view.get("intrinsics", self.tables["cameras"][view["camera"]].get("intrinsics"))
        if "file" in view:
            rows = read_rows(self.folder / view["file"], "camera", **_reading(view))
            return replace(rows, name=view["file"])
        if "bag" in view:
            paths = [self.folder / file for file in view["bag"]]
            return self.bags.camera(paths, _topic(view, where), view, intrinsics)
        if intrinsics is None:
            raise InputError(f"{where} has corners and no intrinsics. Add `intrinsics` to it or to its camera.")
        return rows_of_corners(self.folder / view["corners"], intrinsics, self.folder, view.get("units"))

    def _on_one_clock(
        self, seen: list[PoseRows], carriers: list[list[str]], places: Mapping[str, str]
    ) -> list[PoseRows]:
        """Return the rows with times of the robot's clock."""
        offsets = {}
        for name, entry in self.tables["cameras"].items():
            of = [
                ([self.rows[arm] for arm in on], rows)
                for view, rows, on in zip(self.views, seen, carriers, strict=True)
                if view["camera"] == name
            ]
            offsets[name] = clock_offset(name, entry.get("offset"), of, places[name] == WORLD)
        return [rows.later(offsets[view["camera"]]) for rows, view in zip(seen, self.views, strict=True)]


def _checked(entry: Mapping[str, Any], kinds: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return the values of a table as their kinds say; raises `InputError` for names that it does not have."""
    if unknown := sorted(set(entry) - set(kinds)):
        raise InputError(f"Unknown name {unknown[0]!r} {where}. {nearest_names(unknown[0], kinds)}")
    listed = {key: [value] if kinds[key] is FILES and not is_list(value) else value for key, value in entry.items()}
    return {key: read(kinds[key], value, f"`{key}` {where}") for key, value in listed.items()}


def _table(table: Any, what: str, kinds: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    if not is_map(table) or not table or not all(map(is_map, table.values())):
        got = "none" if table is None else f"{table!r:.40}"
        raise InputError(f"Expected a table [{what}.NAME] for each of the {what}, got {got}.")
    return {name: _checked(entry, kinds, f"in [{what}.{name}]") for name, entry in table.items()}


def _view(entry: Any, where: str) -> dict[str, Any]:
    if not is_map(entry) or not {"camera", "target"} <= set(entry):
        raise InputError(f"Expected names of camera and target {where}, got {entry!r:.60}.")
    if len(given := [key for key in _SOURCES if key in entry]) != 1:
        got = " and ".join(given) or "none of them"
        if wrong := [key for key in ("poses", "csv", "path") if key in entry]:
            raise InputError(
                f"`{wrong[0]}` {where}: the poses of a view are its `file`. Write file = {entry[wrong[0]]!r}."
            )
        raise InputError(f"Expected one of {', '.join(_SOURCES)} {where}, got {got}.")
    return _checked(entry, _VIEW, where)


def _place(what: str, name: str, entry: Mapping[str, Any], arms: Mapping[str, Any]) -> Any:
    if "on" not in entry:
        raise InputError(f"Expected `on` in [{what}.{name}]: {', '.join(arms)} or {WORLD}.")
    return entry["on"]


def _errors_of(entry: Mapping[str, Any]) -> KinematicErrors:
    return KinematicErrors(robot_class=entry.get("robot_class"))


def _topic(entry: Mapping[str, Any], where: str) -> str:
    if "topic" not in entry:
        raise InputError(f"{where} has a bag and no topic. Add `topic`, frames such as base:tool0 or a topic.")
    return str(entry["topic"])


def _reading(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {key: entry.get(key) for key in READING}
