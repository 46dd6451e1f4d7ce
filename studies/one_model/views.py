"""Camera and board: where the camera stands, the corners that it sees, and the poses by OpenCV's PnP.

The board has 8 x 6 corners 25 mm apart, its frame is at the first corner, x and y along the rows, z away from a camera
that sees it from the front. A view is camera_T_board.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from studies.one_model.chains import Array, turn

SQUARE = 0.025  # m
CORNERS = np.concatenate([np.mgrid[0:8, 0:6].T.reshape(-1, 2) * SQUARE, np.zeros((48, 1))], axis=1)
MIDDLE = CORNERS.mean(axis=0)
WIDTH, HEIGHT, RIM = 1280, 960, 10  # pixels
# Standard deviations of estimated intrinsics: focal length, aspect, centre (of the focal length), k1, k2, p.
FOCAL, ASPECT, CENTRE, K1, K2, TANGENTIAL = 1e-3, 1e-4, 1e-3, 3e-3, 1e-2, 1e-4


@dataclass(frozen=True, eq=False)
class Camera:
    """Intrinsics: focal lengths and centre in pixels, lens in OpenCV's order k1, k2, p1, p2."""

    focal: Array  # (2,)
    centre: Array  # (2,)
    lens: Array  # (4,)

    @property
    def matrix(self) -> Array:
        """(3, 3)."""
        K = np.eye(3)
        K[0, 0], K[1, 1], K[:2, 2] = *self.focal, self.centre
        return K

    def corners(self, views: Array) -> Array:
        """Return the pixels (n, 48, 2) of the corners without noise."""
        points = views[:, None, :3, :3] @ CORNERS[:, :, None] + views[:, None, :3, 3, None]
        x, y = points[..., 0, 0] / points[..., 2, 0], points[..., 1, 0] / points[..., 2, 0]
        r2, (k1, k2, p1, p2) = x**2 + y**2, self.lens
        radial = 1.0 + r2 * (k1 + k2 * r2)
        bent = np.stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
                y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
            ],
            axis=-1,
        )
        return np.asarray(bent * self.focal + self.centre)

    def sees(self, views: Array) -> Array:
        """Return which views (n,) have all corners in the picture, in front of the camera."""
        depth = views[:, 2:3, :3] @ CORNERS.T + views[:, 2:3, 3:]
        pixels = self.corners(views)
        inside = (pixels > RIM) & (pixels < np.array([WIDTH, HEIGHT]) - RIM)
        return np.asarray(inside.all(axis=(1, 2)) & (depth > 0.1).all(axis=(1, 2)))


def drawn_camera(rng: np.random.Generator) -> Camera:
    lens = np.array([rng.uniform(-0.15, 0.05), rng.uniform(-0.05, 0.1), *rng.normal(0.0, 3e-4, 2)])
    centre = np.array([WIDTH / 2, HEIGHT / 2]) + rng.normal(0.0, 15.0, 2)
    return Camera(np.repeat(rng.uniform(1000.0, 1400.0), 2), centre, lens)


def estimated(of: Camera, rng: np.random.Generator) -> Camera:
    """Return the intrinsics that a calibration found, which are slightly wrong."""
    f = 1.0 + FOCAL * rng.standard_normal() + ASPECT * np.array([0.5, -0.5]) * rng.standard_normal()
    lens = of.lens + np.array([K1, K2, TANGENTIAL, TANGENTIAL]) * rng.standard_normal(4)
    return Camera(of.focal * f, of.centre + CENTRE * of.focal * rng.standard_normal(2), lens)


def drawn_views(
    camera: Camera,
    n: int,
    rng: np.random.Generator,
    *,
    tilt: float,
    roll: float,
    distance: tuple[float, float],
    part: float,
) -> Array:
    """Draw n views: angle to the board's normal up to ``tilt``, about the line of sight up to ``roll`` (rad).

    ``part`` is that of the picture, about its middle, in which the board's middle is.
    """
    ray = np.ones((n, 3))
    size = np.array([WIDTH, HEIGHT])
    ray[:, :2] = (rng.uniform(-0.5, 0.5, (n, 2)) * part * size + size / 2 - camera.centre) / camera.focal
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    away = np.cross([0.0, 0.0, 1.0], ray)
    across = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
    to_ray = Rotation.from_rotvec(across * np.arccos(np.clip(ray[:, 2:], -1.0, 1.0))).as_matrix()
    angle, about = tilt * np.sqrt(rng.uniform(size=n)), rng.uniform(0.0, 2 * np.pi, n)
    lean = np.stack([np.cos(about), np.sin(about), np.zeros(n)], axis=-1) * angle[:, None]
    rolled = turn(np.array([0.0, 0.0, 1.0]), rng.uniform(-roll, roll, n))
    T = np.zeros((n, 4, 4))
    T[:, :3, :3] = to_ray @ Rotation.from_rotvec(lean).as_matrix() @ rolled
    T[:, :3, 3] = ray * rng.uniform(*distance, (n, 1)) - T[:, :3, :3] @ MIDDLE
    T[:, 3, 3] = 1.0
    return T


def by_pnp(pixels: Array, camera: Camera) -> Array:
    """Return camera_T_board (n, 4, 4) by OpenCV's iterative PnP, refined."""
    T = np.zeros((len(pixels), 4, 4))
    T[:, 3, 3] = 1.0
    K, lens = camera.matrix, np.append(camera.lens, 0.0)
    until = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 20, 1e-14)
    turns = np.empty((len(pixels), 3))
    for k, seen in enumerate(pixels):
        _, r, t = cv2.solvePnP(CORNERS, seen, K, lens, flags=cv2.SOLVEPNP_ITERATIVE)
        r, t = cv2.solvePnPRefineLM(CORNERS, seen, K, lens, r, t, until)
        turns[k], T[k, :3, 3] = r[:, 0], t[:, 0]
    T[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
    return T
