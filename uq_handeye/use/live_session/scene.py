"""The scene of a session in three dimensions: robot poses, camera views, X with its ellipsoid, and the next pose.

World: the robot's base frame, z up, m. Eye-in-hand: camera k is ``G_k X`` and the target ``W``; eye-to-hand: the camera
is ``X`` and target k is ``G_k W``. A moving part is drawn once for each pose, in the colour of its residual: the
distance ``d`` of the pose from its prediction by the others, over the largest that happens by chance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...calibration.evidence.touches import Touches, evidence_of_touches
from ...calibration.result import Calibration
from ...core.geometry.se3 import Array, inverse
from ...core.limits import MAX_NAMED
from ...core.presentation.colours import AMBER, BLUE, GREEN, PURPLE, rgb
from ...core.presentation.numbers import digits
from ...core.presentation.units import MM_PER_M
from ...core.rounding import EPS
from ...model.kinematics.newton import postures_at
from ...model.poses.pose_pairs import PosePairs
from ..verification.touches_file import read_touches, require_metres
from ..verification.verify import verify
from .nodes import DARK, PALE, Colour, Nodes, Picture, nice
from .question import ONE_AT_A_TIME, Answer
from .starting_views import starting_views

if TYPE_CHECKING:
    import viser

# Residual 0, at the limit of chance; outliers; left out; next pose; X; arm.
GOOD, LIMIT, WRONG, OUT, NEXT, OF_X, ARM = map(rgb, (BLUE, AMBER, "#D50032", "#969696", GREEN, PURPLE, "#788291"))
# Poses that are drawn and can be clicked; of more, this many that are spread evenly.
MAX_DRAWN_POSES = 150
# Points of a scene that are drawn.
MAX_VIEWED_POINTS = 1500
# Height of a camera that is drawn, and length of an enlarged ellipsoid, relative to the distance of the target.
FRUSTUM = 0.075
# Length of axes and thickness of lines, relative to the same.
AXES, LINE = 0.5 * FRUSTUM, 0.05 * FRUSTUM


@dataclass(frozen=True, eq=False)
class Touched:
    """m points in the base frame (m): touched, the miss of each (touch minus the point as the calibration has it)."""

    points: Array  # (m, 3)
    misses: Array  # (m, 3)
    flagged: Array  # (m,) that differ by more than the calibration says
    names: tuple[str, ...]
    words: str


def touched(result: Calibration, touches: Touches | Path) -> Touched:
    """Return touches, or those of a file, against a calibration; raises `InputError` as `verify` does."""
    if isinstance(touches, Path):
        touches = read_touches(touches, None if result.kinematics is None else result.kinematics.chain)
    require_metres(result, touches)
    with ONE_AT_A_TIME:
        found, evidence = verify(result, touches), evidence_of_touches(result, touches)
    difference = found.points.difference
    first = " ".join(found.summary().partition("\n\n")[0].split())  # paragraph
    return Touched(evidence.at + evidence.r, difference, found.points.flagged, touches.names, first)


@dataclass(frozen=True)
class Extras:
    """Drawings that are shown with the answer: the picture of each pose, touched points, and the scene.

    ``scene`` (m, 3): points of a scene without a board in its frame, none where they are not known; None: a board.
    """

    pictures: Sequence[Picture | None] = ()
    touched: Touched | None = None
    scene: Array | None = None


def scene_of(poses: PosePairs | None) -> Array | None:
    """Return the points of the scene that camera poses are of (see `Extras`); None: they are of a board."""
    if poses is None or poses.scene is None:
        return None
    return _points_of(poses.scene.known) if poses.scene.known else np.zeros((0, 3))


@lru_cache(maxsize=2)
def _points_of(known: str) -> Array:
    from ...scene.known import points_in_frame, unpacked

    return points_in_frame(unpacked(known), MAX_VIEWED_POINTS)


def colours(answer: Answer) -> list[Colour]:
    """Return the colour of each pose."""
    n = 0 if answer.poses is None else answer.poses.n
    table = None if answer.result is None else answer.result.table
    found: list[Colour] = []
    for k in range(n):
        if k in answer.left_out:
            found.append(OUT)
        elif table is None:
            found.append(GOOD)
        elif table.flag[k] != "kept":
            found.append(WRONG)
        else:
            share = float(min(np.sqrt(table.distance2[k] / table.limit), 1.0))
            found.append(tuple(round(a + share * (b - a)) for a, b in zip(GOOD, LIMIT, strict=True)))  # type: ignore[arg-type]
    return found


class Scene:
    """One rig on one page; `show` brings it up to the answer."""

    def __init__(self, server: viser.ViserServer, clicked: Callable[[int], None]) -> None:
        self.nodes, self._clicked = Nodes(server), clicked
        self.enlarged: int | None = None  # of the ellipsoid; None: by its size
        self._placed: str = ""

    def show(
        self, answer: Answer, selected: int | None = None, in_hand: bool = True, extras: Extras = Extras()
    ) -> None:
        """Draw an answer; before there are poses a sketch of those to start with."""
        poses, result = answer.poses, answer.result
        with self.nodes.drawing():
            self.nodes.frame("/base", np.eye(4), 0.15, "robot base")
            if poses is None or poses.n == 0:
                self._sketch(in_hand, extras)
                return
            distance = float(np.median(np.linalg.norm(poses.camera[:, :3, 3], axis=-1)))
            self.nodes.axes("/robot", poses.robot, AXES * distance)
            at = selected if selected is not None else poses.n - 1
            if result is None:
                self._look("robot", poses.robot[:, :3, 3], distance)
                return
            in_hand = result.setup == "eye-in-hand"
            W = result.W if result.W is not None else np.mean(poses.robot @ result.X @ poses.camera, axis=0)
            moving = poses.robot @ (result.X if in_hand else W)
            self._poses(answer, moving, distance, selected, in_hand, extras)
            ends = np.stack([poses.robot[:, :3, 3], moving[:, :3, 3]], axis=1)
            self.nodes.lines("/robot/mounts", ends, PALE, LINE * distance)
            self._fixed(W if in_hand else result.X, distance, in_hand, extras, at)
            if extras.scene is not None:
                self._points("/scene", W if in_hand else moving[at], extras.scene, 0.7 * LINE * distance)
            self._ellipsoid(result, poses.robot[at] if in_hand else np.eye(4), distance)
            self._arm(result, poses.robot[at], distance)
            self._next(answer, W, distance, in_hand, extras)
            if extras.touched is not None:
                self._touches(extras.touched, distance)
            fixed = (W if in_hand else result.X)[None, :3, 3]
            self._look("rig", np.concatenate([moving[:, :3, 3], poses.robot[:, :3, 3], fixed]), distance)

    def _look(self, what: str, points: Array, distance: float) -> None:
        """Look at the rig when it is first drawn; later it is the user who turns it."""
        if self._placed != what:
            self._placed = what
            self.nodes.look_at(
                np.concatenate([points, np.zeros((1, 3)), points + np.array([0.0, 0.0, 0.1 * distance])])
            )

    def _target(
        self, name: str, T: Array, side: float, colour: Colour, extras: Extras, faint: bool = False,
        clicked: Callable[[], None] | None = None,
    ) -> None:  # fmt: skip
        """Draw what the camera sees, where it moves: a board, or a ball for an object without one."""
        if extras.scene is None:
            self.nodes.board(name, T, side, colour, faint, clicked)
        else:
            self.nodes.ball(name, T, 0.25 * side, colour, faint, clicked)

    def _points(self, name: str, T: Array, points: Array, radius: float) -> None:
        """Draw the points of a scene at its pose."""
        if len(points):
            at = points @ T[:3, :3].T + T[:3, 3]
            self.nodes.spheres(name, at, np.tile(DARK, (len(at), 1)), radius)

    def _sketch(self, in_hand: bool, extras: Extras) -> None:
        """Draw ten views to start with, around a board or things that lie before the robot."""
        T = np.array([[1.0, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        views = starting_views()
        moving = T @ (inverse(views) if in_hand else views)
        if in_hand and extras.scene is not None:
            rng = np.random.default_rng(0)
            heap = rng.normal(size=(300, 3)) * [0.07, 0.05, 0.03]
            heap[:, 2] = np.abs(heap[:, 2])  # things on a table
            self._points("/sketch/fixed", T, heap, 0.004)
        elif in_hand:
            self.nodes.board("/sketch/fixed", T, 0.22, DARK)
        else:
            self.nodes.camera("/sketch/fixed", T, 2 * FRUSTUM, OF_X)
        for k, pose in enumerate(moving):
            name = f"/sketch/{k + 1}"
            if in_hand:
                self.nodes.camera(name, pose, 0.6 * FRUSTUM, NEXT, filled=True)
            else:
                self._target(name, pose, 0.1, NEXT, extras)
            self.nodes.label(f"{name}/name", str(k + 1), np.eye(4))
        self._look("sketch", np.concatenate([moving[:, :3, 3], T[None, :3, 3]]), 0.5)

    def _poses(
        self, answer: Answer, moving: Array, distance: float, selected: int | None, in_hand: bool, extras: Extras
    ) -> None:
        """Draw what moves once for each pose, and say what is wrong with those that contradict the others."""
        n, tints = len(moving), colours(answer)
        drawn = set(np.unique(np.linspace(0, n - 1, min(n, MAX_DRAWN_POSES)).round().astype(int)).tolist())
        labels = [k for k in range(n) if tints[k] == WRONG][:MAX_NAMED]
        for k in sorted({*drawn, *labels, *([] if selected is None else [selected])}):
            wrong, name = tints[k] == WRONG, f"/poses/{k}"
            size = distance * FRUSTUM * (1.5 if k == selected else 1.0)
            click = partial(self._clicked, k)
            if in_hand:
                picture = extras.pictures[k] if k < len(extras.pictures) else None
                self.nodes.camera(name, moving[k], size, tints[k], wrong or k == selected, picture, click)
            else:
                faint = not wrong and k != selected
                self._target(name, moving[k], 3 * size, tints[k], extras, faint, click)
            if k in labels or k == selected:
                text = f"pose {k}" + (f": {answer.result.table.status(k)}" if wrong else "")  # type: ignore[union-attr]
                self.nodes.label(f"{name}/name", text, np.eye(4), "center-right")

    def _fixed(self, T: Array, distance: float, in_hand: bool, extras: Extras, at: int) -> None:
        """Draw the target or the camera that does not move."""
        if in_hand:
            if extras.scene is None:
                self.nodes.board("/target/board", T, 0.4 * distance, DARK)
            self.nodes.frame("/target/frame", T, 0.12 * distance, "target" if extras.scene is None else "scene")
        else:
            picture = extras.pictures[at] if at < len(extras.pictures) else None
            self.nodes.camera("/camera/body", T, 2 * FRUSTUM * distance, OF_X, picture=picture)
            self.nodes.frame("/camera/frame", T, 0.12 * distance, "camera")

    def _ellipsoid(self, result: Calibration, parent: Array, distance: float) -> None:
        """Draw the translation of X, 1 sigma, at the pose in whose frame ``parent`` it is."""
        S = result.covariance
        if S is None:
            return
        R, at = parent[:3, :3], (parent @ result.X)[:3, 3]
        largest = float(np.sqrt(np.linalg.eigvalsh(S[3:, 3:])[-1]))
        factor = self.enlarged or nice(FRUSTUM * distance / max(largest, EPS))
        self.nodes.ellipsoid("/X", at, R @ S[3:, 3:] @ R.T, factor, OF_X)
        self.nodes.label("/X/name", f"X, 1 sigma x {factor}", np.eye(4), "center-left")

    def _arm(self, result: Calibration, pose: Array, distance: float) -> None:
        """Draw the links of the arm from joint to joint, at a robot pose, where its kinematics are known."""
        arm = result.kinematics
        if arm is None:
            return
        starts = np.asarray(arm.joints)
        found = postures_at(arm.chain, np.broadcast_to(pose, (len(starts), 4, 4)), starts)
        if not found.reached.any():
            return
        change = np.abs(found.q - starts).max(axis=1)
        q = found.q[np.argmin(np.where(found.reached, change, np.inf))]
        joints = np.concatenate([np.zeros((1, 3)), arm.chain.frames(q)[:, :3, 3], pose[None, :3, 3]])
        self.nodes.lines("/arm/links", np.stack([joints[:-1], joints[1:]], axis=1), ARM, 6 * LINE * distance)
        self.nodes.spheres("/arm/joints", joints, np.tile(ARM, (len(joints), 1)), 7 * LINE * distance)

    def _next(self, answer: Answer, W: Array, distance: float, in_hand: bool, extras: Extras) -> None:
        """Draw the pose to take next, with what it would bring."""
        if answer.ahead is None or answer.result is None:
            return
        T = answer.ahead.robot @ (answer.result.X if in_hand else W)
        if in_hand:
            self.nodes.camera("/next/pose", T, 1.3 * FRUSTUM * distance, NEXT, filled=True)
        else:
            self._target("/next/pose", T, 0.3 * distance, NEXT, extras)
        self.nodes.label("/next/words", f"next pose{gain_in_words(answer)}", T, "top-center")

    def _touches(self, touched: Touched, distance: float) -> None:
        """Draw touched points, and as lines how far the calibration has them from there, enlarged."""
        factor = nice(2 * FRUSTUM * distance / max(float(np.linalg.norm(touched.misses, axis=1).max()), EPS))
        tints = np.array([WRONG if wrong else NEXT for wrong in touched.flagged])
        self.nodes.spheres("/touches/points", touched.points, tints, 3 * LINE * distance)
        ends = np.stack([touched.points, touched.points - factor * touched.misses], axis=1)
        self.nodes.lines("/touches/misses", ends, np.repeat(tints[:, None], 2, axis=1), 1.5 * LINE * distance)
        for k, point in enumerate(touched.points[:MAX_NAMED]):
            miss = digits(MM_PER_M * float(np.linalg.norm(touched.misses[k])), 2)
            more = f", miss x {factor}" if k == 0 else ""
            self.nodes.label(f"/touches/{k}", f"touch {touched.names[k]}: {miss} mm{more}", _at(point))


def gain_in_words(answer: Answer) -> str:
    """Return what the next pose would bring: ``: from 0.80 to 0.66 mm``; nothing where it is not known."""
    if answer.ahead is None or answer.size is None or not np.isfinite(answer.ahead.gain):
        return ""
    return f": from {MM_PER_M * answer.size:.2f} to {MM_PER_M * answer.size * (1 - answer.ahead.gain):.2f} mm"


def _at(point: Array) -> Array:
    T = np.eye(4)
    T[:3, 3] = point
    return T
