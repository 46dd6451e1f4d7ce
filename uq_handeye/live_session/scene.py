"""The rig in three dimensions: robot poses, what the camera saw from them, X with its ellipsoid, the next pose.

World: the robot's base frame, z up, m. Eye-in-hand: camera k is ``G_k X`` and the target ``W``; eye-to-hand: the camera
is ``X`` and target k is ``G_k W``. What moves is drawn once for each pose, in the colour of its residual: the distance
``d`` of the pose from where the others predict it, over the largest that happens by chance.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..geometry.se3 import Array, inverse
from .guide import starting_views
from .question import Answer

if TYPE_CHECKING:
    import viser

Colour = tuple[int, int, int]

# Residual 0, at the limit of chance; outliers; left out; next pose; X.
GOOD, LIMIT, WRONG, OUT, NEXT, OF_X = (
    (0, 114, 178),
    (230, 159, 0),
    (213, 0, 50),
    (150, 150, 150),
    (0, 158, 115),
    (204, 121, 167),
)
PALE = (165, 165, 165)
# Poses up to which each is drawn by itself and can be clicked; of more, so many are drawn.
MOST_DRAWN = 150
# Sizes in distances of the target: frustum, ellipsoid, axes.
FRUSTUM, ELLIPSOID, AXES = 0.08, 0.07, 0.05
FIELD, ASPECT = np.radians(40.0), 4.0 / 3.0


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


def nice(value: float) -> int:
    """Return the largest of 1, 2, 5, 10, 20, ... up to a value, at least 1."""
    if not value > 1:
        return 1
    power = 10 ** int(np.floor(np.log10(value)))
    return int(max(factor * power for factor in (1, 2, 5) if factor * power <= value))


def ellipsoid(S: Array, factor: float) -> tuple[Array, Array]:
    """Return vertices (m, 3) and faces of ``factor`` times the 1 sigma ellipsoid of a covariance (3, 3)."""
    values, axes = np.linalg.eigh(0.5 * (S + S.T))
    u, v = np.meshgrid(np.linspace(0, np.pi, 13), np.linspace(0, 2 * np.pi, 25), indexing="ij")
    sphere = np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], axis=-1).reshape(-1, 3)
    corners = np.arange(12 * 25).reshape(12, 25)[:, :-1].ravel()
    faces = np.concatenate([np.stack([corners, corners + 25, corners + 1], 1),
                            np.stack([corners + 1, corners + 25, corners + 26], 1)])  # fmt: skip
    return factor * (sphere * np.sqrt(np.maximum(values, 0.0))) @ axes.T, faces


class Scene:
    """The nodes of one page; `show` brings them up to the answer, and moves those that are there."""

    def __init__(self, server: viser.ViserServer, clicked: Callable[[int], None]) -> None:
        self._scene, self._server, self._clicked = server.scene, server, clicked
        self._nodes: dict[str, Any] = {}
        self._made: dict[str, tuple[Any, ...]] = {}  # what the node of a name was made of
        self.enlarged: int | None = None  # of the ellipsoid; None: by its size
        self._placed = False
        self._scene.set_up_direction("+z")
        self._scene.configure_default_lights(cast_shadow=False)
        self._scene.add_grid("/grid", 4.0, 4.0, cell_size=0.1, section_size=0.5, cell_color=PALE, section_color=PALE,
                             cell_thickness=0.4, section_thickness=0.8)  # fmt: skip

    def show(self, answer: Answer, selected: int | None = None, in_hand: bool = True) -> int:
        """Draw an answer, and return by which factor the ellipsoid is enlarged; before there are poses a sketch."""
        poses, result = answer.poses, answer.result
        self._frame("/base", np.eye(4), 0.2, "base")
        if poses is None or poses.n == 0:
            self._keep({"/base"} | self._sketch(in_hand))
            return self.enlarged or 1
        distance = float(np.median(np.linalg.norm(poses.camera[:, :3, 3], axis=-1)))
        drawn = self._drawn(poses.n, selected)
        names = {"/base", "/robot"}
        q = Rotation.from_matrix(poses.robot[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]]
        of_robot = (poses.robot.tobytes(), distance)
        self._node("/robot", of_robot, lambda: self._scene.add_batched_axes(
            "/robot", q, poses.robot[:, :3, 3], axes_length=AXES * distance, axes_radius=0.004 * distance))  # fmt: skip
        factor = self.enlarged or 1
        if result is not None:
            in_hand = result.setup == "eye-in-hand"
            W = result.W if result.W is not None else np.mean(poses.robot @ result.X @ poses.camera, axis=0)
            moving = poses.robot @ (result.X if in_hand else W)
            fixed = W if in_hand else result.X
            tints = colours(answer)
            for k in drawn:
                name = f"/poses/{k}"
                names.add(name)
                self._moving(name, k, moving[k], tints[k], distance * (1.5 if k == selected else 1.0), in_hand)
            names |= self._fixed(fixed, distance, in_hand)
            at = selected if selected is not None else drawn[-1]
            frame = poses.robot[at] if in_hand else np.eye(4)
            factor = self._ellipsoid(answer, frame, distance, names)
            names |= self._next(answer, W, distance, in_hand)
            if selected is not None:
                self._label("/selected", f"pose {selected}", moving[selected])
                names.add("/selected")
            if not self._placed:
                self._place(np.concatenate([moving[:, :3, 3], fixed[None, :3, 3]]), distance)
        self._keep(names)
        return factor

    def _drawn(self, n: int, selected: int | None) -> list[int]:
        """Return the poses that are drawn one by one."""
        some = np.unique(np.linspace(0, n - 1, min(n, MOST_DRAWN)).round().astype(int)).tolist()
        return some if selected is None or selected in some else [*some, selected]

    # ------------------------------------------------------------------------------------------------------ nodes

    def _look(self, middle: Array, distance: float) -> None:
        """Look at the rig from aside and above, a little to its right, where the panel is."""
        towards = np.array([0.75, -0.55, 0.5])
        aside = np.cross([0.0, 0.0, 1.0], towards)
        target = middle + 0.22 * distance * aside / np.linalg.norm(aside)
        camera = self._server.initial_camera
        camera.look_at, camera.position = target, target + distance * towards
        for client in self._server.get_clients().values():
            client.camera.position, client.camera.look_at = camera.position, camera.look_at

    def _sketch(self, in_hand: bool) -> set[str]:
        """Draw ten views to start with, around a board that lies before the robot."""
        names = set()
        if "/sketch/fixed" not in self._nodes:
            self._look(np.array([0.4, 0.0, 0.2]), 1.1)
        at = np.array([[1.0, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        fixed = "/sketch/fixed"
        self._node(fixed, (in_hand,), lambda: self._board(fixed, 0.2, (90, 90, 90)) if in_hand
                   else self._camera(fixed, 1.0, OF_X))  # fmt: skip
        _move(self._nodes[fixed], at)
        for k, view in enumerate(starting_views()):
            name, T = f"/sketch/{k + 1}", at @ (inverse(view) if in_hand else view)
            self._node(name, (in_hand,), lambda name=name: self._camera(name, 0.6, NEXT) if in_hand
                       else self._board(name, 0.15, NEXT, 0.5))  # type: ignore[misc]  # fmt: skip
            _move(self._nodes[name], T)
            self._label(f"{name}/name", str(k + 1), np.eye(4))
            names.add(name)
        return names | {fixed}

    def _moving(self, name: str, k: int, T: Array, colour: Colour, distance: float, in_hand: bool) -> None:
        made_of = (in_hand, round(distance, 3))
        if self._made.get(name) != made_of:
            node = self._camera(name, distance, colour) if in_hand else self._board(name, 0.5 * distance, colour)
            self._put(name, made_of, node)
            node.on_click(lambda _: self._clicked(k))
        node = self._nodes[name]
        if tuple(node.color) != colour:
            node.color = colour
        _move(node, T)

    def _fixed(self, T: Array, distance: float, in_hand: bool) -> set[str]:
        """Draw the target or the camera that does not move."""
        made_of = (in_hand, round(distance, 3))
        if in_hand:
            self._node("/target/board", made_of, lambda: self._board("/target/board", 0.4 * distance, (90, 90, 90)))
            _move(self._nodes["/target/board"], T)
            self._frame("/target/frame", T, 0.15 * distance, "target")
            return {"/target/board", "/target/frame", "/target/frame/name"}
        self._node("/camera/body", made_of, lambda: self._camera("/camera/body", 2 * distance, OF_X))
        _move(self._nodes["/camera/body"], T)
        self._frame("/camera/frame", T, 0.15 * distance, "camera")
        return {"/camera/body", "/camera/frame", "/camera/frame/name"}

    def _ellipsoid(self, answer: Answer, parent: Array, distance: float, names: set[str]) -> int:
        """Draw the translation of X, 1 sigma, at the pose in whose frame ``parent`` it is."""
        assert answer.result is not None
        S, X = answer.result.covariance, answer.result.X
        if S is None:
            return self.enlarged or 1
        R = parent[:3, :3]
        largest = float(np.sqrt(np.linalg.eigvalsh(S[3:, 3:])[-1]))
        factor = self.enlarged or nice(ELLIPSOID * distance / max(largest, 1e-9))
        vertices, faces = ellipsoid(R @ S[3:, 3:] @ R.T, factor)
        at = (parent @ X)[:3, 3]
        look: dict[str, Any] = {"color": OF_X, "opacity": 0.55, "side": "double", "cast_shadow": False}
        made_of = (vertices.tobytes(), at.tobytes())
        self._node("/X", made_of, lambda: self._scene.add_mesh_simple("/X", vertices, faces, position=at, **look))
        names.add("/X")
        return factor

    def _next(self, answer: Answer, W: Array, distance: float, in_hand: bool) -> set[str]:
        """Draw the pose to take next, with what it would bring."""
        if answer.ahead is None or answer.result is None:
            return set()
        T = answer.ahead.robot @ (answer.result.X if in_hand else W)
        made_of = (in_hand, round(distance, 3))
        self._node("/next/pose", made_of, lambda: self._camera("/next/pose", 1.2 * distance, NEXT, "filled")
                   if in_hand else self._board("/next/pose", 0.5 * distance, NEXT, 0.4))  # fmt: skip
        _move(self._nodes["/next/pose"], T)
        self._label("/next/words", f"next pose{gain_in_words(answer)}", T)
        return {"/next/pose", "/next/words"}

    def _camera(self, name: str, distance: float, colour: Colour, variant: Any = "wireframe") -> Any:
        return self._scene.add_camera_frustum(
            name, float(FIELD), ASPECT, scale=FRUSTUM * distance, thickness=0.004 * distance, color=colour,
            variant=variant, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    def _board(self, name: str, side: float, colour: Colour, opacity: float = 0.7) -> Any:
        half = 0.5 * side
        corners = half * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        return self._scene.add_mesh_simple(
            name, corners, np.array([[0, 1, 2], [0, 2, 3]]), color=colour, opacity=opacity, side="double",
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

    def _frame(self, name: str, T: Array, length: float, text: str) -> None:
        made_of = (round(length, 3),)
        self._node(name, made_of, lambda: self._scene.add_frame(
            name, axes_length=length, axes_radius=0.02 * length, origin_radius=0.04 * length))  # fmt: skip
        _move(self._nodes[name], T)
        self._label(f"{name}/name", text, np.eye(4))

    def _label(self, name: str, text: str, T: Array) -> None:
        self._node(
            name, (text,), lambda: self._scene.add_label(name, text, font_screen_scale=0.9, anchor="bottom-center")
        )
        self._nodes[name].position = T[:3, 3]

    def _node(self, name: str, made_of: tuple[Any, ...], make: Callable[[], Any]) -> None:
        if self._made.get(name) != made_of:
            self._put(name, made_of, make())

    def _put(self, name: str, made_of: tuple[Any, ...], node: Any) -> None:
        self._nodes[name], self._made[name] = node, made_of

    def _keep(self, names: set[str]) -> None:
        """Remove all nodes of other names."""
        kept = names | {f"{name}/name" for name in names}
        for name in sorted(self._nodes.keys() - kept, reverse=True):  # children before their parents
            self._nodes.pop(name).remove()
            del self._made[name]

    def _place(self, points: Array, distance: float) -> None:
        """Look at the rig from aside and above."""
        self._placed = True
        middle = points.mean(axis=0)
        reach = max(float(np.linalg.norm(points - middle, axis=1).max()), distance)
        self._look(middle, 1.9 * reach)


def gain_in_words(answer: Answer) -> str:
    """Return what the next pose would bring: ``: from 0.80 to 0.66 mm``; nothing where it is not known."""
    if answer.ahead is None or answer.size is None or not np.isfinite(answer.ahead.gain):
        return ""
    return f": from {1e3 * answer.size:.2f} to {1e3 * answer.size * (1 - answer.ahead.gain):.2f} mm"


def _move(node: Any, T: Array) -> None:
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
    node.wxyz, node.position = (w, x, y, z), T[:3, 3]
