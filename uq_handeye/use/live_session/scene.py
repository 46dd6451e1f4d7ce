"""Nodes of a scene by their names: made once, moved afterwards, made again only where what they are made of changes.

The rig in three dimensions: robot poses, what the camera saw from them, X with its ellipsoid, the next pose.

World: the robot's base frame, z up, m. Eye-in-hand: camera k is ``G_k X`` and the target ``W``; eye-to-hand: the camera
is ``X`` and target k is ``G_k W``. What moves is drawn once for each pose, in the colour of its residual: the distance
``d`` of the pose from where the others predict it, over the largest that happens by chance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...calibration.evidence.touches import Touches, evidence_of_touches
from ...calibration.result import Calibration
from ...core.formatting.numbers import digits
from ...core.geometry.se3 import Array, inverse
from ...model.kinematics.arms.postures import postures_at
from ..verification.touches_file import read_touches, require_metres
from ..verification.verify import verify
from .question import ONE_AT_A_TIME, Answer, starting_views

if TYPE_CHECKING:
    import viser

Colour = tuple[int, int, int]
# What a picture is told from another by, and a function that returns its pixels (h, w, 3).
Picture = tuple[Any, Callable[[], Any]]

PALE, DARK = (165, 165, 165), (90, 90, 90)
# Field of view of cameras that are drawn (vertical, rad), width over height, and height of the pyramid of scale 1.
FIELD, ASPECT = float(np.radians(40.0)), 4.0 / 3.0
# Field of view of the page (rad); width over height below which the panel covers the lower part of the scene.
SEEN, UPRIGHT = float(np.radians(45.0)), 0.8
# Squares of a board that is drawn.
COLUMNS, ROWS = 7, 5


class Nodes:
    """Drawings of one page; world z up, m."""

    def __init__(self, server: viser.ViserServer) -> None:
        self.scene, self._server = server.scene, server
        self._nodes: dict[str, Any] = {}
        self._made: dict[str, tuple[Any, ...]] = {}  # what the node of a name was made of
        self._named: set[str] = set()
        self.scene.set_up_direction("+z")
        self.scene.configure_default_lights(cast_shadow=False)
        self.scene.add_grid("/grid", 4.0, 4.0, cell_size=0.1, section_size=0.5, cell_color=PALE, section_color=PALE,
                            cell_thickness=0.4, section_thickness=0.8)  # fmt: skip
        server.on_client_connect(self._look_from)
        self._seen = (np.array([0.4, 0.0, 0.2]), 0.7)

    @contextmanager
    def drawing(self) -> Iterator[None]:
        """Draw; nodes that are not drawn again are removed at the end."""
        self._named = set()
        yield
        for name in sorted(self._nodes.keys() - self._named, reverse=True):  # children before their parents
            self._nodes.pop(name).remove()
            del self._made[name]

    def node(self, name: str, made_of: tuple[Any, ...], make: Callable[[], Any], T: Array | None = None) -> Any:
        """Return the node of a name, made if it is new or made of something else, and moved to the pose ``T``."""
        self._named.add(name)
        if self._made.get(name) != made_of:
            self._nodes[name], self._made[name] = make(), made_of
        node = self._nodes[name]
        if T is not None:
            x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
            node.wxyz, node.position = (w, x, y, z), T[:3, 3]
        return node

    def camera(
        self, name: str, T: Array, size: float, colour: Colour, filled: bool = False, picture: Picture | None = None,
        clicked: Callable[[], None] | None = None,
    ) -> None:  # fmt: skip
        """Draw a camera as a pyramid, with its picture."""
        key, pixels = (None, None) if picture is None else picture

        def make() -> Any:
            image = None if pixels is None else pixels()
            aspect = ASPECT if image is None else image.shape[1] / image.shape[0]
            made = self.scene.add_camera_frustum(
                name, FIELD, aspect, scale=size, thickness=0.035 * size, color=colour, image=image, cast_shadow=False,
                receive_shadow=False, variant="filled" if filled else "wireframe",
            )  # fmt: skip
            return _clickable(made, clicked)

        _tint(self.node(name, (round(size, 4), filled, key), make, T), colour)

    def board(
        self, name: str, T: Array, side: float, colour: Colour, opacity: float = 0.8,
        clicked: Callable[[], None] | None = None,
    ) -> None:  # fmt: skip
        """Draw the dark squares of a board and its edge, the middle at the origin."""

        def make() -> Any:
            y, x = np.nonzero(np.indices((ROWS, COLUMNS)).sum(axis=0) % 2 == 0)
            boxes = np.stack([x, y, x + 1, y + 1], axis=-1).astype(float)
            a, b, right, top = 0.5, 0.6, COLUMNS + 0.6, ROWS + 0.6  # the edge
            edge = [(-b, -b, right, -a), (-b, top - 0.1, right, top), (-b, -b, -a, top), (right - 0.1, -b, right, top)]
            boxes = (np.concatenate([boxes, edge]) - 0.5 * np.tile([COLUMNS, ROWS], 2)) * side / COLUMNS
            points = np.pad(boxes[:, [[0, 1], [2, 1], [2, 3], [0, 3]]], ((0, 0), (0, 0), (0, 1))).reshape(-1, 3)
            faces = (4 * np.arange(len(boxes))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
            made = self.scene.add_mesh_simple(name, points, faces, color=colour, opacity=opacity, side="double",
                                              cast_shadow=False, receive_shadow=False)  # fmt: skip
            return _clickable(made, clicked)

        _tint(self.node(name, (round(side, 4), opacity), make, T), colour)

    def frame(self, name: str, T: Array, length: float, text: str) -> None:
        """Draw axes with a label."""
        self.node(name, (round(length, 4),), lambda: self.scene.add_frame(
            name, axes_length=length, axes_radius=0.02 * length, origin_radius=0.04 * length), T)  # fmt: skip
        self.label(f"{name}/name", text, np.eye(4))

    def axes(self, name: str, T: Array, length: float) -> None:
        """Draw axes (n, 4, 4) without labels."""
        q = Rotation.from_matrix(T[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]]
        self.node(name, (T.tobytes(), round(length, 4)), lambda: self.scene.add_batched_axes(
            name, q, T[:, :3, 3], axes_length=length, axes_radius=0.06 * length))  # fmt: skip

    def lines(self, name: str, points: Array, colour: Colour | Array, thickness: float) -> None:
        """Draw segments (n, 2, 3) in one colour, or in that of each end (n, 2, 3)."""
        made_of = (points.tobytes(), np.asarray(colour).tobytes(), round(thickness, 5))
        self.node(name, made_of, lambda: self.scene.add_line_segments(
            name, points.astype(np.float32), np.asarray(colour, dtype=np.uint8), thickness=thickness))  # fmt: skip

    def spheres(self, name: str, points: Array, colours: Any, radius: float) -> None:
        """Draw points (n, 3) in the colour of each."""
        made_of = (points.tobytes(), np.asarray(colours).tobytes(), round(radius, 5))
        self.node(name, made_of, lambda: self.scene.add_point_cloud(
            name, points.astype(np.float32), np.asarray(colours, dtype=np.uint8), point_size=radius,
            point_shape="circle"))  # fmt: skip

    def label(self, name: str, text: str, T: Array, anchor: Any = "bottom-center") -> None:
        """Write at a place: above it, or with ``center-left`` to its right, so that two labels keep clear."""
        node = self.node(name, (text,), lambda: self.scene.add_label(name, text, font_screen_scale=0.85, anchor=anchor))
        node.position = T[:3, 3]

    def ellipsoid(self, name: str, at: Array, S: Array, factor: float, colour: Colour) -> None:
        """Draw ``factor`` times the 1 sigma ellipsoid of a covariance (3, 3) around a point."""
        vertices, faces = ellipsoid(S, factor)
        look: dict[str, Any] = {"color": colour, "opacity": 0.55, "side": "double", "cast_shadow": False}
        made_of = (vertices.tobytes(), at.tobytes())
        self.node(name, made_of, lambda: self.scene.add_mesh_simple(name, vertices, faces, position=at, **look))

    def look_at(self, points: Array) -> None:
        """Look at points (n, 3) from aside and above, so that all are seen."""
        low, high = points.min(axis=0), points.max(axis=0)
        self._seen = (0.5 * (low + high), max(0.5 * float(np.linalg.norm(high - low)), 0.1))
        camera = self._server.initial_camera
        camera.fov = SEEN
        camera.look_at, camera.position = self._view(1.5)
        for client in self._server.get_clients().values():
            self._look_from(client)

    def _look_from(self, client: Any) -> None:
        try:
            aspect = float(client.camera.aspect)
        except (AttributeError, ZeroDivisionError):
            aspect = 1.5
        client.camera.fov = SEEN
        middle, at = self._view(aspect)
        client.camera.position = at  # which moves what is looked at along
        client.camera.look_at = middle

    def _view(self, aspect: float) -> tuple[Array, Array]:
        """Return what is looked at and from where, for a canvas of a width over height."""
        middle, reach = self._seen
        towards = np.array([0.78, -0.5, 0.38])
        far = reach / np.sin(0.5 * SEEN) / min(aspect, 1.0)
        if aspect < UPRIGHT:  # the panel covers the lower part
            far = 1.3 * far
            middle = middle - np.array([0.0, 0.0, 0.55 * far * np.tan(0.5 * SEEN)])
        return middle, middle + far * towards / np.linalg.norm(towards)


def ellipsoid(S: Array, factor: float) -> tuple[Array, Array]:
    """Return vertices (m, 3) and faces of ``factor`` times the 1 sigma ellipsoid of a covariance (3, 3)."""
    values, axes = np.linalg.eigh(0.5 * (S + S.T))
    u, v = np.meshgrid(np.linspace(0, np.pi, 13), np.linspace(0, 2 * np.pi, 25), indexing="ij")
    sphere = np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], axis=-1).reshape(-1, 3)
    corners = np.arange(12 * 25).reshape(12, 25)[:, :-1].ravel()
    faces = np.concatenate([np.stack([corners, corners + 25, corners + 1], 1),
                            np.stack([corners + 1, corners + 25, corners + 26], 1)])  # fmt: skip
    return factor * (sphere * np.sqrt(np.maximum(values, 0.0))) @ axes.T, faces


def _clickable(node: Any, clicked: Callable[[], None] | None) -> Any:
    if clicked is not None:
        node.on_click(lambda _: clicked())
    return node


def _tint(node: Any, colour: Colour) -> None:
    if tuple(node.color) != colour:
        node.color = colour


def nice(value: float) -> int:
    """Return the largest of 1, 2, 5, 10, 20, ... up to a value, at least 1."""
    if not value > 1:
        return 1
    power = 10 ** int(np.floor(np.log10(value)))
    return int(max(factor * power for factor in (1, 2, 5) if factor * power <= value))


# Residual 0, at the limit of chance; outliers; left out; next pose; X.
GOOD, LIMIT, WRONG, OUT, NEXT, OF_X = (
    (0, 114, 178), (230, 159, 0), (213, 0, 50), (150, 150, 150), (0, 158, 115), (204, 121, 167),
)  # fmt: skip
ARM = (120, 130, 145)
# Poses up to which each is drawn by itself and can be clicked; of more, so many are drawn.
MOST_DRAWN = 150
# Wrong poses up to which each has a label.
MOST_LABELS = 5
# Sizes in distances of the target: frustum, ellipsoid, axes, lines.
FRUSTUM, ELLIPSOID, AXES, LINE = 0.075, 0.07, 0.04, 0.004


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
class Beside:
    """Drawings beside the answer: the picture of each pose, and touched points."""

    pictures: Sequence[Picture | None] = ()
    touched: Touched | None = None


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
        self, answer: Answer, selected: int | None = None, in_hand: bool = True, beside: Beside = Beside()
    ) -> None:
        """Draw an answer; before there are poses a sketch of those to start with."""
        poses, result = answer.poses, answer.result
        with self.nodes.drawing():
            self.nodes.frame("/base", np.eye(4), 0.15, "robot base")
            if poses is None or poses.n == 0:
                self._sketch(in_hand)
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
            self._poses(answer, moving, distance, selected, in_hand, beside)
            ends = np.stack([poses.robot[:, :3, 3], moving[:, :3, 3]], axis=1)
            self.nodes.lines("/robot/mounts", ends, PALE, LINE * distance)
            self._fixed(W if in_hand else result.X, distance, in_hand, beside, at)
            self._ellipsoid(result, poses.robot[at] if in_hand else np.eye(4), distance)
            self._arm(result, poses.robot[at], distance)
            self._next(answer, W, distance, in_hand)
            if beside.touched is not None:
                self._touches(beside.touched, distance)
            fixed = (W if in_hand else result.X)[None, :3, 3]
            self._look("rig", np.concatenate([moving[:, :3, 3], poses.robot[:, :3, 3], fixed]), distance)

    def _look(self, what: str, points: Array, distance: float) -> None:
        """Look at the rig when it is first drawn; later it is the user who turns it."""
        if self._placed != what:
            self._placed = what
            self.nodes.look_at(
                np.concatenate([points, np.zeros((1, 3)), points + np.array([0.0, 0.0, 0.1 * distance])])
            )

    def _sketch(self, in_hand: bool) -> None:
        """Draw ten views to start with, around a board that lies before the robot."""
        T = np.array([[1.0, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        views = starting_views()
        moving = T @ (inverse(views) if in_hand else views)
        if in_hand:
            self.nodes.board("/sketch/fixed", T, 0.22, DARK)
        else:
            self.nodes.camera("/sketch/fixed", T, 2 * FRUSTUM, OF_X)
        for k, pose in enumerate(moving):
            name = f"/sketch/{k + 1}"
            if in_hand:
                self.nodes.camera(name, pose, 0.6 * FRUSTUM, NEXT, filled=True)
            else:
                self.nodes.board(name, pose, 0.1, NEXT)
            self.nodes.label(f"{name}/name", str(k + 1), np.eye(4))
        self._look("sketch", np.concatenate([moving[:, :3, 3], T[None, :3, 3]]), 0.5)

    def _poses(
        self, answer: Answer, moving: Array, distance: float, selected: int | None, in_hand: bool, beside: Beside
    ) -> None:
        """Draw what moves once for each pose, and say what is wrong with those that contradict the others."""
        n, tints = len(moving), colours(answer)
        drawn = set(np.unique(np.linspace(0, n - 1, min(n, MOST_DRAWN)).round().astype(int)).tolist())
        labels = [k for k in range(n) if tints[k] == WRONG][:MOST_LABELS]
        for k in sorted({*drawn, *labels, *([] if selected is None else [selected])}):
            wrong, name = tints[k] == WRONG, f"/poses/{k}"
            size = distance * FRUSTUM * (1.5 if k == selected else 1.0)
            click = partial(self._clicked, k)
            if in_hand:
                picture = beside.pictures[k] if k < len(beside.pictures) else None
                self.nodes.camera(name, moving[k], size, tints[k], wrong or k == selected, picture, click)
            else:
                opacity = 0.8 if wrong or k == selected else 0.35
                self.nodes.board(name, moving[k], 3 * size, tints[k], opacity, click)
            if k in labels or k == selected:
                text = f"pose {k}" + (f": {answer.result.table.status(k)}" if wrong else "")  # type: ignore[union-attr]
                self.nodes.label(f"{name}/name", text, np.eye(4), "center-right")

    def _fixed(self, T: Array, distance: float, in_hand: bool, beside: Beside, at: int) -> None:
        """Draw the target or the camera that does not move."""
        if in_hand:
            self.nodes.board("/target/board", T, 0.4 * distance, DARK)
            self.nodes.frame("/target/frame", T, 0.12 * distance, "target")
        else:
            picture = beside.pictures[at] if at < len(beside.pictures) else None
            self.nodes.camera("/camera/body", T, 2 * FRUSTUM * distance, OF_X, picture=picture)
            self.nodes.frame("/camera/frame", T, 0.12 * distance, "camera")

    def _ellipsoid(self, result: Calibration, parent: Array, distance: float) -> None:
        """Draw the translation of X, 1 sigma, at the pose in whose frame ``parent`` it is."""
        S = result.covariance
        if S is None:
            return
        R, at = parent[:3, :3], (parent @ result.X)[:3, 3]
        largest = float(np.sqrt(np.linalg.eigvalsh(S[3:, 3:])[-1]))
        factor = self.enlarged or nice(ELLIPSOID * distance / max(largest, 1e-9))
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

    def _next(self, answer: Answer, W: Array, distance: float, in_hand: bool) -> None:
        """Draw the pose to take next, with what it would bring."""
        if answer.ahead is None or answer.result is None:
            return
        T = answer.ahead.robot @ (answer.result.X if in_hand else W)
        if in_hand:
            self.nodes.camera("/next/pose", T, 1.3 * FRUSTUM * distance, NEXT, filled=True)
        else:
            self.nodes.board("/next/pose", T, 0.3 * distance, NEXT)
        self.nodes.label("/next/words", f"next pose{gain_in_words(answer)}", T, "top-center")

    def _touches(self, touched: Touched, distance: float) -> None:
        """Draw touched points, and as lines how far the calibration has them from there, enlarged."""
        factor = nice(2 * ELLIPSOID * distance / max(float(np.linalg.norm(touched.misses, axis=1).max()), 1e-9))
        tints = np.array([WRONG if wrong else NEXT for wrong in touched.flagged])
        self.nodes.spheres("/touches/points", touched.points, tints, 3 * LINE * distance)
        ends = np.stack([touched.points, touched.points - factor * touched.misses], axis=1)
        self.nodes.lines("/touches/misses", ends, np.repeat(tints[:, None], 2, axis=1), 1.5 * LINE * distance)
        for k, point in enumerate(touched.points[:MOST_LABELS]):
            miss = digits(1e3 * float(np.linalg.norm(touched.misses[k])), 2)
            more = f", miss x {factor}" if k == 0 else ""
            self.nodes.label(f"/touches/{k}", f"touch {touched.names[k]}: {miss} mm{more}", _at(point))


def gain_in_words(answer: Answer) -> str:
    """Return what the next pose would bring: ``: from 0.80 to 0.66 mm``; nothing where it is not known."""
    if answer.ahead is None or answer.size is None or not np.isfinite(answer.ahead.gain):
        return ""
    return f": from {1e3 * answer.size:.2f} to {1e3 * answer.size * (1 - answer.ahead.gain):.2f} mm"


def _at(point: Array) -> Array:
    T = np.eye(4)
    T[:3, 3] = point
    return T
