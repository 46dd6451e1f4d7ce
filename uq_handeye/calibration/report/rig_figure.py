r"""The rig of one calibration in three dimensions, as a figure and as an interactive scene.

Drawn are base, grippers, cameras, target and the ellipsoid of X, all in the base frame, by ``base_T_gripper`` of the
poses and the X and W of the result.

    eye-in-hand    cameras G X, one target W
    eye-to-hand    one camera X, targets G W

The ellipsoid holds 95 % of the errors of X's translation. It is drawn about one of the cameras, its axes rotated into
the base frame, enlarged by a round factor. This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from ...core.geometry.se3 import Array
from ...core.levels import UNUSUAL
from ...core.presentation.colours import BLUE, GREEN, INK, ORANGE, QUIET
from ...core.presentation.figure_parts import FIGURE_WIDTH_IN, SMALL, TEXT, NamedFigure, plain, round_number
from ...core.presentation.numbers import digits
from ...fit.diagnostics.pose_table import PoseTable
from ...model.poses.pose_pairs import PosePairs

# Poses drawn with their frames, evenly spread over the recording.
MAX_FRAMES = 30
# Poses drawn as dots.
MAX_DOTS = 400
# Size of a drawn camera, as a share of the scene.
CAMERA_SIZE = 0.05
_AXES = (("#D55E00", "x"), ("#009E73", "y"), ("#0072B2", "z"))
# Half axes of the ellipsoid that holds 95 % of a Gaussian in three dimensions, in standard deviations.
LEVEL = float(np.sqrt(UNUSUAL.chi_square(3)))


class Rig(NamedTuple):
    """Content of the figure, in the base frame."""

    setup: str
    grippers: Array  # (n, 4, 4)
    cameras: Array  # (n, 4, 4), or (1, 4, 4) for eye-to-hand
    targets: Array  # (1, 4, 4), or (n, 4, 4) for eye-to-hand
    rejected: NDArray[np.bool_]  # (n,) no part of the fit
    label: str  # of these: rejected, excluded by request, or both
    X: Array  # (4, 4)
    W: Array  # (4, 4)
    board: Array  # (4, 3) corners of the target in its own frame, m: of its points, or a symbol
    chosen: int  # the pose whose camera has the ellipsoid
    half_of_X: Array  # (3, 3): half axes of the ellipsoid as columns, m, in the parent frame of X; 0: not determined
    factor: float  # by which it is enlarged
    size: float  # of the scene, m

    @property
    def centre(self) -> Array:
        """The middle (3,) of the ellipsoid: where the camera is."""
        return np.asarray(self.cameras[self.chosen if len(self.cameras) > 1 else 0][:3, 3])

    @property
    def half_axes(self) -> Array:
        """The half axes (3, 3) of the ellipsoid as columns, m, in the base frame."""
        return self.grippers[self.chosen, :3, :3] @ self.half_of_X if self.setup == "eye-in-hand" else self.half_of_X

    @property
    def enlarged(self) -> str:
        """Text on the enlargement of the ellipsoid."""
        return f"{self.factor:,.0f} times enlarged" if self.factor > 1 else "in true size"


def rig(
    poses: PosePairs,
    X: Array,
    W: Array,
    covariance: Array | None,
    weight: Array | None,
    level: float = LEVEL,
    excluded: Sequence[int] = (),
) -> Rig:
    """The scene of one calibration.

    Parameters
    ----------
    poses : PosePairs
    X, W : (4, 4)
    covariance : (6, 6) or None
        Of X, rad and m, in its parent frame.
    weight : (n,) or None
        Of the poses; 0 is a rejected or excluded one.
    level : float
        Half axes of the ellipsoid, in standard deviations.
    excluded : sequence of int
        Numbers of the poses that were excluded by request.
    """
    in_hand = poses.setup == "eye-in-hand"
    cameras = poses.robot @ X if in_hand else X[None]
    targets = W[None] if in_hand else poses.robot @ W
    rejected = np.zeros(poses.n, dtype=bool) if weight is None else weight == 0
    kept = [T if len(T) == 1 else T[~rejected] for T in (poses.robot, cameras, targets)]
    points = np.concatenate([np.zeros((1, 3)), *(T[:, :3, 3] for T in kept)])
    size = float(np.ptp(points, axis=0).max()) or 1.0
    # About the camera that is farthest from the others' crowd, where there is room.
    positions = cameras[:, :3, 3] if in_hand else targets[:, :3, 3]
    usable = np.flatnonzero(~rejected)
    chosen = int(usable[np.argmax(np.linalg.norm(positions[usable] - positions[usable].mean(axis=0), axis=1))])
    half, factor = np.zeros((3, 3)), 1.0
    if covariance is not None:
        values, vectors = np.linalg.eigh(covariance[3:, 3:])
        half = vectors * level * np.sqrt(np.maximum(values, 0.0))
        largest = float(np.linalg.norm(half, axis=0).max())
        factor = max(1.0, round_number(0.09 * size / largest)) if largest > 0 else 1.0
    board = _board(poses, (2.2 if in_hand else 1.0) * CAMERA_SIZE * size)
    label = "rejected" if not len(excluded) else "excluded" if rejected.sum() == len(excluded) else "rejected, excluded"
    return Rig(poses.setup, poses.robot, cameras, targets, rejected, label, X, W, board, chosen, half, factor, size)


def _board(poses: PosePairs, size: float) -> Array:
    """Corners (4, 3) about the points that were seen, or those of a square about the origin."""
    seen = poses.camera_calibration
    low, high = np.full(2, -size), np.full(2, size)
    if seen is not None and len(seen.corners.points):
        low, high = seen.corners.points[:, :2].min(axis=0), seen.corners.points[:, :2].max(axis=0)
    return np.array([[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0]])


def rig_figure(scene: Rig) -> Figure:
    """Figure of the scene from the side and from above."""
    figure = NamedFigure(figsize=(FIGURE_WIDTH_IN, 3.5))
    strokes = _strokes(scene)
    side: Any = figure.add_axes((0.0, 0.13, 0.6, 0.84), projection="3d", proj_type="ortho", computed_zorder=False)
    above = figure.add_axes((0.7, 0.27, 0.29, 0.62))
    for points, style in strokes:
        side.plot(*points.T, **style)
        above.plot(*points[:, :2].T, **style)
    for k, (colour, name) in enumerate(_AXES):
        tip = 3.2 * CAMERA_SIZE * scene.size * np.eye(3)[k]
        words: dict[str, Any] = {
            "color": colour,
            "fontsize": TEXT,
            "fontweight": "bold",
            "ha": "center",
            "va": "center",
        }
        side.text(*tip, name, zorder=8, **words)
        if k < 2:
            above.text(tip[0], tip[1], name, zorder=8, **words)
    low, high = _limits(scene)
    side.view_init(22.0, -58.0)
    side.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    tall = (high - low)[2] > 1.2 * (high - low)[:2].max()
    side.set_box_aspect(high - low, zoom=0.84 if tall else 1.0)
    side.tick_params(labelsize=SMALL, pad=-2)
    for direction, name in ((side.xaxis, "x"), (side.yaxis, "y"), (side.zaxis, "z")):
        length = float((high - low)["xyz".index(name)] / (high - low).max())
        direction.set_major_locator(
            MaxNLocator(nbins=4 if length > 0.75 else 3 if length > 0.5 else 2, steps=[1, 2, 5, 10])
        )
        direction.pane.set_facecolor("white")
        direction.pane.set_edgecolor("0.85")
        direction._axinfo["grid"].update(color="0.9", linewidth=0.5)  # there is no public way
        direction.set_label_text(f"{name} (m)", fontsize=SMALL)
        direction.labelpad = -5 if name == "z" else -2
    plain(above)
    above.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    for line, name in ((above.xaxis, "x"), (above.yaxis, "y")):
        line.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 5, 10]))
        line.set_label_text(f"{name} (m)", fontsize=SMALL)
    for axis, x, title in ((side, 0.28, "from the side"), (above, 0.84, "from above")):
        figure.text(x, 0.95, title, fontsize=TEXT, ha="center", color=INK)
        axis.set_label(title)
    _legend(figure, scene)
    return figure


def _evenly(n: int, most: int) -> NDArray[np.intp]:
    """Return the numbers of at most ``most`` of n poses, evenly spread over the recording."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.intp))


def _strokes(scene: Rig) -> list[tuple[Array, dict[str, Any]]]:
    """Points (m, 3) and the style of each thing drawn, from back to front."""
    n = len(scene.grippers)
    full, dots = _evenly(n, MAX_FRAMES), _evenly(n, MAX_DOTS)
    full, dots = full[~scene.rejected[full]], dots[~scene.rejected[dots]]
    hand, small = scene.grippers[:, :3, 3], CAMERA_SIZE * scene.size
    one_camera, one_target = len(scene.cameras) == 1, len(scene.targets) == 1
    moving = scene.targets if one_camera else scene.cameras
    strokes = [
        (np.stack([hand[k], moving[k, :3, 3]]), {"color": "0.7", "linewidth": 0.6, "zorder": 2}) for k in full.tolist()
    ]
    cameras, size = (scene.cameras, 2.0 * small) if one_camera else (scene.cameras[full], small)
    strokes += [(_camera(T, size), {"color": BLUE, "linewidth": 0.8, "zorder": 3}) for T in cameras]
    targets = scene.targets if one_target else scene.targets[full]
    style = {"color": GREEN, "linewidth": 1.5 if one_target else 0.8, "linestyle": (0, (4, 1)), "zorder": 3}
    strokes += [(_target(T, scene.board), style) for T in targets]
    marks = {"linestyle": "", "zorder": 4}
    strokes.append((hand[dots], {"marker": "o", "color": QUIET, "markersize": 2.6, "markeredgewidth": 0, **marks}))
    bad = np.flatnonzero(scene.rejected)
    inside = bad[np.abs(hand[bad] - scene.centre).max(axis=1) < scene.size] if bad.size else bad
    if inside.size:
        style = {"marker": "X", "color": ORANGE, "markersize": 6.5, "markeredgecolor": "white", **marks}
        strokes.append((hand[inside[:MAX_DOTS]], style))
    for k, (colour, _) in enumerate(_AXES):
        ends = np.zeros((2, 3))
        ends[1, k] = 2.6 * small
        strokes.append((ends, {"color": colour, "linewidth": 1.8, "zorder": 5}))
    strokes.append((np.zeros((1, 3)), {"marker": "s", "color": "black", "markersize": 5, "zorder": 6}))
    if scene.half_axes.any():
        strokes += [(ring, {"color": "black", "linewidth": 1.2, "zorder": 7}) for ring in _ellipsoid(scene)]
    return strokes


def _camera(T: Array, size: float) -> Array:
    """A pyramid that opens along z, where the camera looks."""
    corners = size * np.array([[-0.6, -0.45, 1], [0.6, -0.45, 1], [0.6, 0.45, 1], [-0.6, 0.45, 1]])
    p = corners @ T[:3, :3].T + T[:3, 3]
    return np.stack([p[0], p[1], p[2], p[3], p[0], T[:3, 3], p[1], p[2], T[:3, 3], p[3]])


def _target(T: Array, board: Array) -> Array:
    """The outline of the target, and the half of a diagonal."""
    corners = np.concatenate([board, board[:1], board.mean(axis=0, keepdims=True)])
    return np.asarray(corners @ T[:3, :3].T + T[:3, 3])


def _ellipsoid(scene: Rig) -> list[Array]:
    """Its three principal sections, as rings."""
    angle = np.linspace(0, 2 * np.pi, 73)
    half = scene.factor * scene.half_axes
    return [
        scene.centre + np.outer(np.cos(angle), half[:, i]) + np.outer(np.sin(angle), half[:, j])
        for i, j in ((0, 1), (1, 2), (0, 2))
    ]


def _limits(scene: Rig) -> tuple[Array, Array]:
    """Corners of the box that is shown: all but the rejected poses."""
    kept = ~scene.rejected
    several = [T if len(T) == 1 else T[kept] for T in (scene.grippers, scene.cameras, scene.targets)]
    points = np.concatenate([np.zeros((1, 3)), *(T[:, :3, 3] for T in several)])
    ring = scene.factor * np.linalg.norm(scene.half_axes, axis=1)
    if len(scene.targets) == 1:
        points = np.concatenate([points, _target(scene.targets[0], scene.board)])
    if len(scene.cameras) == 1:
        points = np.concatenate([points, _camera(scene.cameras[0], 2.0 * CAMERA_SIZE * scene.size)])
    room = 0.11 * scene.size
    low = np.minimum(points.min(axis=0) - room, scene.centre - 1.1 * ring)
    high = np.maximum(points.max(axis=0) + room, scene.centre + 1.1 * ring)
    return low, high


def _legend(figure: Figure, scene: Rig) -> None:
    one = len(scene.cameras) == 1
    handles = [
        Line2D([], [], marker="s", linestyle="", color="black", markersize=5, label="base, with its axes"),
        Line2D([], [], marker="o", linestyle="", color=QUIET, markersize=4, label="grippers"),
        Line2D([], [], color=BLUE, linewidth=1.2, label="camera" if one else "cameras"),
        Line2D([], [], color=GREEN, linewidth=1.5, linestyle=(0, (4, 1)), label="targets" if one else "target"),
    ]
    if scene.rejected.any():
        handles.append(Line2D([], [], marker="X", linestyle="", color=ORANGE, markersize=6, label=scene.label))
    if scene.half_axes.any():
        label = f"95 % of X's translation, {scene.enlarged}"
        handles.append(Line2D([], [], color="black", linewidth=1.3, label=label))
    figure.legend(
        handles=handles, loc="lower center", ncols=4, frameon=False, fontsize=SMALL, handlelength=1.8,
        columnspacing=1.4,
    )  # fmt: skip


# ----------------------------------------------------------------------------------------------------- turned


def rig_scene(scene: Rig, table: PoseTable | None, alt: str) -> str:
    """Return the scene as JSON: poses as rows of 3x4 numbers, in metres."""
    n = len(scene.grippers)
    full = np.unique([*_evenly(n, 60), scene.chosen])
    low, high = _limits(scene)
    grid = round_number(0.2 * float((high - low)[:2].max()))
    dots = np.setdiff1d(_evenly(n, MAX_DOTS), np.concatenate([full, np.flatnonzero(scene.rejected)]))
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


def _short(values: ArrayLike) -> Array:
    return np.asarray(values, dtype=float).round(5) + 0.0
