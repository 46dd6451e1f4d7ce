"""Pictures of textured scenes as a known camera of any lens takes them, with the truth.

A scene is made of bodies, a body of textured rectangles. Each ray of a camera (`studies.common.pictures`), four per
pixel, meets the rectangles in closed form: with corner o and edges a, b in the camera frame the ray d meets their plane
at the shares ``(u, v) = (m_1, m_2) / m_3`` of the edges with ``m = [a b o]^-1 d``, at the distance ``1 / m_3``. The
nearest wins. Textures are sampled at the level of a pyramid that belongs to the size of a pixel on the rectangle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.common.pictures import Camera
from uq_handeye.core.geometry.se3 import Array
from uq_handeye.model.camera.adjustment.opencv import opencv

# Rays along each side of a pixel.
RAYS = 2
BACKGROUND = 90.0
# Rays per edge that bound where a rectangle can be seen.
EDGE_POINTS = 9
# Rays from one to the next at which the size of a pixel on a rectangle is taken.
SPARSE = 7
LIGHT = np.array([0.3, -0.45, 0.84])
AMBIENT = 0.6
Picture = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Face:
    """A rectangle seen from the side that ``along x across`` points to; metres, in the frame of its body."""

    corner: Array
    along: Array
    across: Array
    texture: Picture

    @cached_property
    def levels(self) -> tuple[NDArray[np.float32], ...]:
        """The texture, each level half as fine as the one before."""
        cv2 = opencv()
        found = [self.texture.astype(np.float32)]
        while min(found[-1].shape) >= 16:
            # Means over areas: the middle of a pixel of pyrDown is that of every second one, not between two.
            height, width = (length // 2 for length in found[-1].shape)
            found.append(np.asarray(cv2.resize(found[-1], (width, height), interpolation=cv2.INTER_AREA)))
        return tuple(found)


@dataclass(frozen=True, eq=False)
class Body:
    """Faces and camera_T_body (n, 4, 4), where the body is in each of n pictures."""

    faces: Sequence[Face]
    camera_T_body: Array


class Renderer:
    """The rays of one camera."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        f, centre = RAYS * camera.parameters[:2], RAYS * (camera.parameters[2:4] + 0.5) - 0.5
        width, height = camera.size
        fine = Camera(camera.model, np.concatenate([f, centre, camera.parameters[4:]]), (RAYS * width, RAYS * height))
        self.rays = fine.directions.astype(np.float32)
        del fine.__dict__["directions"]
        self.field = np.abs(self.rays[:2] / self.rays[2]).max(axis=(1, 2))

    def picture(self, bodies: Sequence[Body], i: int) -> NDArray[np.float32]:
        """Return the grey levels (height, width) of picture ``i``, without blur and noise."""
        _, height, width = self.rays.shape
        grey = np.full((height, width), BACKGROUND, np.float32)
        nearest = np.zeros((height, width), np.float32)
        for body in bodies:
            T = body.camera_T_body[i]
            for face in body.faces:
                self._draw(face, T, grey, nearest)
        return np.asarray(grey.reshape(height // RAYS, RAYS, width // RAYS, RAYS).mean(axis=(1, 3)))

    def _draw(self, face: Face, T: Array, grey: NDArray[np.float32], nearest: NDArray[np.float32]) -> None:
        cv2 = opencv()
        a, b, o = T[:3, :3] @ face.along, T[:3, :3] @ face.across, T[:3, :3] @ face.corner + T[:3, 3]
        normal = np.cross(a, b)
        if normal @ o >= 0:
            return
        window = self._window(a, b, o)
        if window is None:
            return
        rows, columns = window
        M = np.linalg.inv(np.stack([a, b, o], axis=1)).astype(np.float32)
        m = np.tensordot(M, self.rays[:, rows, columns], axes=1)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            near = m[2]
            u, v = m[0] / near, m[1] / near
        seen = (near > nearest[rows, columns]) & (u >= 0) & (u < 1) & (v >= 0) & (v < 1)
        if not seen.any():
            return
        height, width = face.texture.shape
        some = seen[::SPARSE, :-1:SPARSE]
        by_u, by_v = (
            (part[::SPARSE, 1::SPARSE] - part[::SPARSE, :-1:SPARSE])[some] for part in (width * u, height * v)
        )
        texel = float(np.median(np.hypot(by_u, by_v))) if some.any() else 1.0
        level = int(np.clip(np.rint(np.log2(max(texel, 1e-6))), 0, len(face.levels) - 1))
        texture = face.levels[level]
        at_u = np.where(seen, u, np.float32(0)) * np.float32(texture.shape[1]) - np.float32(0.5)
        at_v = np.where(seen, v, np.float32(0)) * np.float32(texture.shape[0]) - np.float32(0.5)
        drawn = cv2.remap(texture, at_u, at_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        world_normal = np.cross(face.along, face.across)
        light = AMBIENT + (1 - AMBIENT) * abs(float(world_normal @ LIGHT)) / float(np.linalg.norm(world_normal))
        part = grey[rows, columns]
        part[seen] = np.float32(light) * drawn[seen]
        nearest[rows, columns][seen] = near[seen]

    def _window(self, a: Array, b: Array, o: Array) -> tuple[slice, slice] | None:
        """Rows and columns of rays that may meet the rectangle; none where it is outside the picture."""
        _, height, width = self.rays.shape
        share = np.linspace(0, 1, EDGE_POINTS)
        low, high = np.zeros(EDGE_POINTS), np.ones(EDGE_POINTS)
        u, v = np.concatenate([share, share, low, high]), np.concatenate([low, high, share, share])
        rim = o + u[:, None] * a + v[:, None] * b
        if (rim[:, 2] <= 0).all():
            return None
        # A lens folds points far outside its field of view back into the picture, so those are not projected.
        if (rim[:, 2] <= 0.05 * np.linalg.norm(rim, axis=1)).any():
            return slice(0, height), slice(0, width)
        plain = rim[:, :2] / rim[:, 2:]
        if (np.abs(plain) > 1.2 * self.field).any():
            return slice(0, height), slice(0, width)
        pixels = RAYS * (self.camera.seen(rim, np.eye(4)) + 0.5)
        (left, top), (right, bottom) = pixels.min(axis=0) - 3 * RAYS, pixels.max(axis=0) + 3 * RAYS
        if right < 0 or bottom < 0 or left > width or top > height:
            return None
        rows = slice(max(int(top), 0), min(int(bottom) + 1, height))
        columns = slice(max(int(left), 0), min(int(right) + 1, width))
        return (rows, columns) if rows.stop - rows.start > 2 and columns.stop - columns.start > 2 else None


def as_taken(
    grey: NDArray[np.float32], rng: np.random.Generator, *, noise: float = 2.0, blur: float = 0.5, smear: float = 0.0
) -> Picture:
    """Add the lens's Gaussian ``blur``, ``smear`` of a moving camera (both px) and ``noise`` (grey levels)."""
    cv2 = opencv()
    if smear:
        angle, half = rng.uniform(0, np.pi), smear / 2
        side = 2 * int(np.ceil(half)) + 1
        kernel = np.zeros((8 * side, 8 * side), np.uint8)
        middle, reach = 4 * side, 8 * half
        ends = [(int(middle + s * reach * np.cos(angle)), int(middle + s * reach * np.sin(angle))) for s in (-1, 1)]
        cv2.line(kernel, ends[0], ends[1], 255, 8)
        small = kernel.reshape(side, 8, side, 8).mean(axis=(1, 3))
        grey = np.asarray(cv2.filter2D(grey, -1, small / small.sum()), np.float32)
    if blur:
        grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), blur), np.float32)
    noisy = grey + noise * rng.standard_normal(grey.shape, dtype=np.float32)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def rich(rng: np.random.Generator, shape: tuple[int, int], contrast: float = 1.0, middle: float = 120.0) -> Picture:
    """Return a texture with something to see at every scale: noise of all octaves, discs, bars and letters."""
    cv2 = opencv()
    height, width = shape
    grey = np.zeros(shape, np.float32)
    for octave in range(3, 8):
        rows, columns = max(height >> octave, 2), max(width >> octave, 2)
        coarse = rng.standard_normal((rows, columns), dtype=np.float32)
        grey += (1.0 + 2.0 * octave) * np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC))
    things = max(height * width // 6_000, 6)
    for _ in range(things):
        at = int(rng.integers(width)), int(rng.integers(height))
        size, change = float(np.exp(rng.uniform(np.log(3), np.log(30)))), float(rng.uniform(-75, 75))
        kind = rng.integers(3)
        side = int(3 * size) + 4
        left, top = max(at[0] - side, 0), max(at[1] - side, 0)
        part = grey[top : at[1] + side, left : at[0] + side]
        drawn = np.zeros(part.shape, np.uint8)
        here = at[0] - left, at[1] - top
        if kind == 0:
            axes = max(int(size), 1), max(int(size * rng.uniform(0.4, 1)), 1)
            cv2.ellipse(drawn, here, axes, float(rng.uniform(0, 180)), 0, 360, 255, -1, cv2.LINE_AA)
        elif kind == 1:
            corners = np.array(
                cv2.boxPoints((here, (2 * size, size * float(rng.uniform(0.3, 2))), float(rng.uniform(0, 90))))
            )
            cv2.fillConvexPoly(drawn, np.rint(corners).astype(np.int32), 255, cv2.LINE_AA)
        else:
            letter = chr(int(rng.integers(65, 91)))
            cv2.putText(
                drawn, letter, here, cv2.FONT_HERSHEY_SIMPLEX, size / 12, 255, max(int(size / 6), 1), cv2.LINE_AA
            )
        part += change / 255 * drawn.astype(np.float32)
    return _grey(middle + contrast * grey)


def weak(rng: np.random.Generator, shape: tuple[int, int], contrast: float = 0.2) -> Picture:
    """Return a texture as of a plain table: the same with little contrast."""
    return rich(rng, shape, contrast, middle=140.0)


def tiles(rng: np.random.Generator, shape: tuple[int, int], tile: int = 120) -> Picture:
    """Return one tile repeated, with slight differences of brightness and a little dirt."""
    one = rich(rng, (tile, tile))
    times = -(-shape[0] // tile), -(-shape[1] // tile)
    repeated = np.tile(one, times)[: shape[0], : shape[1]].astype(np.float32)
    return _grey(repeated + 0.15 * (rich(rng, shape).astype(np.float32) - 120))


def dull(rng: np.random.Generator, shape: tuple[int, int]) -> Picture:
    """Return a texture with few things to see, far apart."""
    cv2 = opencv()
    grey = np.full(shape, 150, np.float32)
    for _ in range(max(shape[0] * shape[1] // 10_000, 2)):
        at, size = (int(rng.integers(shape[1])), int(rng.integers(shape[0]))), int(rng.uniform(4, 14))
        drawn = np.zeros(shape, np.uint8)
        cv2.ellipse(
            drawn, at, (size, max(int(size * rng.uniform(0.3, 1)), 1)), float(rng.uniform(0, 180)), 0, 360, 255, -1
        )
        grey += float(rng.uniform(-35, 35)) / 255 * drawn.astype(np.float32)
    return _grey(grey)


def _grey(values: Any) -> Picture:
    return np.asarray(np.clip(np.rint(values), 8, 247).astype(np.uint8))


def box(
    lower: Sequence[float],
    size: Sequence[float],
    textures: Sequence[Picture],
    *,
    turn: float = 0.0,
    bottom: bool = False,
) -> list[Face]:
    """Return the faces of a box that is turned about z by ``turn`` (rad): top and sides, or all six."""
    c, s = np.cos(turn), np.sin(turn)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    at, (x, y, z) = np.asarray(lower, float), np.diag(np.asarray(size, float))
    faces = [(z, x, y), (0 * z, x, z), (x, y, z), (x + y, -x, z), (y, -y, z)]
    if bottom:
        faces.append((y, x, -y))
    return [Face(at + R @ o, R @ a, R @ b, textures[k % len(textures)]) for k, (o, a, b) in enumerate(faces)]
