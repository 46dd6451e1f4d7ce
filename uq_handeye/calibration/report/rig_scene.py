"""The rig as data of a picture that can be turned: `presentation/turn.js` draws it."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from ...diagnostics.pose_table import PoseTable
from ...formatting.numbers import digits
from ...geometry.se3 import Array
from ...presentation.figure_parts import round_number
from .rig_figure import MOST_DOTS, Rig, evenly, limits

# Poses drawn in full, of which one can be chosen.
MOST_CHOICES = 60


def rig_scene(scene: Rig, table: PoseTable | None, alt: str) -> str:
    """Return the scene as JSON: poses as rows of 3x4 numbers, in metres."""
    n = len(scene.grippers)
    full = np.unique([*evenly(n, MOST_CHOICES), scene.chosen])
    low, high = limits(scene)
    grid = round_number(0.2 * float((high - low)[:2].max()))
    dots = np.setdiff1d(evenly(n, MOST_DOTS), np.concatenate([full, np.flatnonzero(scene.rejected)]))
    found: dict[str, Any] = {
        "hand": scene.setup == "eye-in-hand",
        "X": _rows(scene.X),
        "W": _rows(scene.W),
        "poses": [_rows(T) for T in scene.grippers[full]],
        "names": [_name(int(k), table) for k in full],
        "rejected": np.flatnonzero(scene.rejected[full]).tolist(),
        "chosen": int(np.flatnonzero(full == scene.chosen)[0]),
        "dots": _short(scene.grippers[dots, :3, 3]),
        "board": _short(scene.board),
        "middle": _short(scene.board.mean(axis=0)),
        "size": float(_short(scene.size)),
        "low": _short(low),
        "high": _short(high),
        "grid": grid,
        "grid_text": f"grid {grid:g} m",
        "half": _short(scene.factor * scene.half_of_X).ravel() if scene.half_of_X.any() else None,
        "item": "Pose",
        "label": "The rig, to be turned",
        "alt": alt,
        "help": "Drag, or use the arrow keys, to turn; + and \N{MINUS SIGN} to zoom. The slider selects a pose.",
    }
    plain = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in found.items()}
    return json.dumps(plain, separators=(",", ":")).replace("<", "\\u003c")


def _name(k: int, table: PoseTable | None) -> str:
    if table is None or table.item != "pose":
        return f"pose {k}"
    turn, move = digits(np.degrees(table.rotation[k]), 2), digits(1e3 * table.translation[k], 2)
    flag = "" if table.flag[k] == "kept" else f", {table.status(k)}"
    return f"pose {k}: {move} mm, {turn} deg{flag}"


def _rows(T: Array) -> list[float]:
    return [float(f"{x:.5g}") for x in np.asarray(T)[:3].ravel().round(6)]


def _short(values: Any) -> Any:
    return np.asarray(values, dtype=float).round(5) + 0.0
