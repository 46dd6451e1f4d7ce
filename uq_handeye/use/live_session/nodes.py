"""Drawings of a page by name: each is made once, then moved, and made again only where its geometry changes.

World: z up, m. A node is a camera as a pyramid, a board, axes, lines, points, a label or an ellipsoid.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array
from ...core.presentation.colours import rgb

if TYPE_CHECKING:
    import viser

Anchor = Literal["bottom-center", "center-left", "center-right", "top-center", "top-left"]
Colour = tuple[int, int, int]
# A key that tells pictures apart, and a function that returns the pixels (h, w, 3).
Picture = tuple[str, Callable[[], "NDArray[np.uint8] | None"]]

PALE, DARK = rgb("#A5A5A5"), rgb("#5A5A5A")
# Vertical field of view of the page.
FIELD_OF_VIEW_RAD = float(np.radians(45.0))


class Nodes:
    """Drawings of one page; world z up, m."""

    def __init__(self, server: viser.ViserServer) -> None:
        self.scene, self._server = server.scene, server
        self._nodes: dict[str, Any] = {}
        self._made: dict[str, tuple[Hashable, ...]] = {}  # what the node of a name was made of
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

    def node(
        self, name: str, made_of: tuple[Hashable, ...], make: Callable[[], viser.SceneNodeHandle],
        T: Array | None = None, colour: Colour | None = None, clicked: Callable[[], None] | None = None,
    ) -> None:  # fmt: skip
        """Draw the node of a name: made if it is new or made of something else, moved to the pose ``T``, coloured."""
        self._named.add(name)
        if self._made.get(name) != made_of:
            self._nodes[name], self._made[name] = make(), made_of
            if clicked is not None:
                self._nodes[name].on_click(lambda _: clicked())
        node = self._nodes[name]
        if colour is not None and tuple(node.color) != colour:
            node.color = colour
        if T is not None:
            x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
            node.wxyz, node.position = (w, x, y, z), T[:3, 3]

    def camera(
        self, name: str, T: Array, size: float, colour: Colour, filled: bool = False, picture: Picture | None = None,
        clicked: Callable[[], None] | None = None,
    ) -> None:  # fmt: skip
        """Draw a camera as a pyramid, with its picture."""
        key, pixels = (None, None) if picture is None else picture

        def make() -> viser.SceneNodeHandle:
            image = None if pixels is None else pixels()
            aspect = 4 / 3 if image is None else image.shape[1] / image.shape[0]
            return self.scene.add_camera_frustum(
                name, 0.7, aspect, scale=size, thickness=0.035 * size, color=colour, image=image, cast_shadow=False,
                receive_shadow=False, variant="filled" if filled else "wireframe",
            )  # fmt: skip

        self.node(name, (round(size, 4), filled, key), make, T, colour, clicked)

    def board(
        self, name: str, T: Array, side: float, colour: Colour, faint: bool = False,
        clicked: Callable[[], None] | None = None,
    ) -> None:  # fmt: skip
        """Draw the dark squares of a board and its edge, the middle at the origin."""

        def make() -> viser.SceneNodeHandle:
            columns, rows = 7, 5
            y, x = np.nonzero(np.indices((rows, columns)).sum(axis=0) % 2 == 0)
            boxes = np.stack([x, y, x + 1, y + 1], axis=-1).astype(float)
            a, b, right, top = 0.5, 0.6, columns + 0.6, rows + 0.6  # the edge
            edge = [(-b, -b, right, -a), (-b, top - 0.1, right, top), (-b, -b, -a, top), (right - 0.1, -b, right, top)]
            boxes = (np.concatenate([boxes, edge]) - 0.5 * np.tile([columns, rows], 2)) * side / columns
            points = np.pad(boxes[:, [[0, 1], [2, 1], [2, 3], [0, 3]]], ((0, 0), (0, 0), (0, 1))).reshape(-1, 3)
            faces = (4 * np.arange(len(boxes))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
            return self.scene.add_mesh_simple(name, points, faces, color=colour, opacity=0.35 if faint else 0.8,
                                              side="double", cast_shadow=False, receive_shadow=False)  # fmt: skip

        self.node(name, (round(side, 4), faint), make, T, colour, clicked)

    def ball(
        self, name: str, T: Array, radius: float, colour: Colour, faint: bool = False,
        clicked: Callable[[], None] | None = None,
    ) -> None:  # fmt: skip
        """Draw a ball: an object that has no board."""
        self.node(name, (round(radius, 4), faint), lambda: self.scene.add_icosphere(
            name, radius, colour, subdivisions=2, opacity=0.35 if faint else 0.8, cast_shadow=False,
            receive_shadow=False), T, colour, clicked)  # fmt: skip

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

    def spheres(self, name: str, points: Array, colours: ArrayLike, radius: float) -> None:
        """Draw points (n, 3) in the colour of each."""
        made_of = (points.tobytes(), np.asarray(colours).tobytes(), round(radius, 5))
        self.node(name, made_of, lambda: self.scene.add_point_cloud(
            name, points.astype(np.float32), np.asarray(colours, dtype=np.uint8), point_size=radius,
            point_shape="circle"))  # fmt: skip

    def label(self, name: str, text: str, T: Array, anchor: Anchor = "bottom-center") -> None:
        """Write at a place: above it, or with ``center-left`` to its right, so that two labels keep clear."""
        self.node(name, (text,), lambda: self.scene.add_label(name, text, font_screen_scale=0.85, anchor=anchor), T)

    def ellipsoid(self, name: str, at: Array, S: Array, factor: float, colour: Colour) -> None:
        """Draw ``factor`` times the 1 sigma ellipsoid of a covariance (3, 3) around a point."""
        vertices, faces = ellipsoid(S, factor)
        self.node(name, (vertices.tobytes(), at.tobytes()), lambda: self.scene.add_mesh_simple(
            name, vertices, faces, position=at, color=colour, opacity=0.55, side="double",
            cast_shadow=False))  # fmt: skip

    def look_at(self, points: Array) -> None:
        """Look at points (n, 3) from aside and above, so that all are seen."""
        low, high = points.min(axis=0), points.max(axis=0)
        self._seen = (0.5 * (low + high), max(0.5 * float(np.linalg.norm(high - low)), 0.1))
        camera = self._server.initial_camera
        camera.fov = FIELD_OF_VIEW_RAD
        camera.look_at, camera.position = self._view(1.5)
        for client in self._server.get_clients().values():
            self._look_from(client)

    def _look_from(self, client: viser.ClientHandle) -> None:
        try:
            aspect = float(client.camera.aspect)
        except (AttributeError, ZeroDivisionError):
            aspect = 1.5
        client.camera.fov = FIELD_OF_VIEW_RAD
        middle, at = self._view(aspect)
        client.camera.position = at  # which moves what is looked at along
        client.camera.look_at = middle

    def _view(self, aspect: float) -> tuple[Array, Array]:
        """Return what is looked at and from where, for a canvas of a width over height."""
        middle, reach = self._seen
        towards = np.array([0.78, -0.5, 0.38])
        far = reach / np.sin(0.5 * FIELD_OF_VIEW_RAD) / min(aspect, 1.0)
        if aspect < 0.8:  # a phone: the panel covers the lower part
            far = 1.3 * far
            middle = middle - np.array([0.0, 0.0, 0.55 * far * np.tan(0.5 * FIELD_OF_VIEW_RAD)])
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


def nice(value: float) -> int:
    """Return the largest of 1, 2, 5, 10, 20, ... up to a value, at least 1."""
    if not value > 1:
        return 1
    power = 10 ** int(np.floor(np.log10(value)))
    return int(max(factor * power for factor in (1, 2, 5) if factor * power <= value))
