"""The numbers of a calibrated camera: the estimates, and statistics of its pictures (boards, coverage, residuals)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array, skew
from ...core.levels import CONTRADICTED
from ...errors import InputError
from ...findings import Finding, texts
from ..errors.joint_covariance import JointCovariance
from .adjustment.bundle import Bundle, response_ahead
from .adjustment.criterion import Candidate
from .board_pattern import BoardPattern, board_pattern_of
from .corners import Corners, without_pictures
from .given_intrinsics import GivenIntrinsics
from .measured_board import MeasuredBoard
from .rays import pixel_deviation
from .residual_pattern import MIN_PATTERN_SHARE, Pattern, pattern_of


@dataclass(frozen=True, eq=False)
class Calibrated:
    """The numbers of a `CameraCalibration`, which lies above its words, pictures and files."""

    bundle: Bundle
    corners: Corners
    image_size: tuple[int, int]
    candidates: tuple[Candidate, ...]  # models that were compared; empty if the model was given
    pattern: Pattern  # residuals over the picture
    board_pattern: BoardPattern  # residuals over the board
    findings: tuple[Finding, ...]  # what to know before trusting it
    given: GivenIntrinsics | None = None  # numbers that were given beforehand and are used

    @property
    def warnings(self) -> tuple[str, ...]:
        """The findings that are more than a note, in words."""
        return texts(self.findings)

    @property
    def model(self) -> str:
        """``pinhole``, ``brown`` or ``fisheye``."""
        return self.bundle.model.name

    @cached_property
    def intrinsics(self) -> dict[str, float]:
        """Parameters by name: pixels, coefficients without unit."""
        return dict(zip(self.bundle.model.names, map(float, self.bundle.intrinsics), strict=True))

    @cached_property
    def std(self) -> dict[str, float]:
        """Their standard deviations; 0 where they were not estimated."""
        deviations = np.sqrt(np.diag(self.bundle.intrinsics_covariance))
        return dict(zip(self.bundle.model.names, map(float, deviations), strict=True))

    @property
    def estimated(self) -> tuple[str, ...]:
        """Names of the parameters that were estimated."""
        return tuple(name for name, free in zip(self.bundle.model.names, self.bundle.free, strict=False) if free)

    @property
    def poses(self) -> Array:
        """(n, 4, 4) camera_T_target."""
        return self.bundle.poses

    @property
    def shape(self) -> str:
        """Name of the shape of the board: ``flat``, ``bow2``, ..., or ``measured`` (before)."""
        return self.bundle.shape.name

    @cached_property
    def board(self) -> MeasuredBoard:
        """The points of the board as measured with their covariance, its bow, and how its squares are stretched."""
        return self.bundle.board

    @property
    def board_points(self) -> Array:
        """(u, 3) points of the board as measured, in its frame, m; their covariance is that of ``board.factor``."""
        return self.board.points

    @property
    def rows(self) -> NDArray[np.intp]:
        """(n,) rows of the robot poses that these belong to."""
        return self.corners.rows

    @cached_property
    def covariance(self) -> JointCovariance:
        """Joint covariance of the errors (theta, tau) of all poses: left rotation, additive translation, in the camera
        frame.
        """
        free = self.bundle.free
        factor = np.linalg.cholesky(self.bundle.covariance[np.ix_(free, free)])
        return JointCovariance(self.bundle.own, self.bundle.by_parameters[..., free] @ factor)

    @property
    def per_pixel(self) -> JointCovariance:
        """Covariance of the poses, per pixel^2, for errors that are as large in all pictures, whatever their weights.

        Of each pose by itself ``(B_i^T B_i)^-1``; of the intrinsics ``sum w_i^2 / sum w_i`` times that of the noise,
        as if all pictures determined them equally well.
        """
        w, s = self.bundle.weights, self.bundle.pixel_noise
        found = self.covariance
        own = found.own * (w / s**2)[:, None, None]
        return JointCovariance(own, found.shared * float(np.sqrt(np.sum(w**2) / np.sum(w)) / s), found.keys)

    @property
    def by_shift(self) -> Array:
        """(n, 6, 2) errors (theta, tau) of the poses where all corners of a picture are shifted, per pixel.

        To first order a shift turns the pose about the centre of the camera: ``tau = theta x t``.
        """
        found = np.zeros((len(self.poses), 6, 2))
        found[:, 0, 1] = found[:, 1, 0] = 1.0 / self.intrinsics["fx"]
        found[:, 3:] = -skew(self.poses[:, :3, 3]) @ found[:, :3]
        return found

    def shared_ahead(self, poses: Array, shared: Array) -> Array:
        """(m, 6, q) what errors ``shared`` (n, 6, q) of the poses so far do to ``poses`` (m, 4, 4) yet to be seen.

        They are errors of the parameters that the camera is used with: ``shared_i = G_i T`` gives T, ``G T`` theirs.

        Raises
        ------
        InputError
            Errors of something else.
        """
        points, _ = self.corners.on_board
        T = self.errors_of_parameters(shared)
        return np.asarray(response_ahead(self.bundle, points, poses)[..., self.bundle.free] @ T)

    def errors_of_parameters(self, shared: Array) -> Array:
        """Return T (f, q) of the estimated parameters with ``shared_i = G_i T`` (n, 6, q); raises `InputError`."""
        bundle = self.bundle
        G = bundle.by_parameters[..., bundle.free].reshape(-1, int(bundle.free.sum()))
        flat = shared.reshape(len(G), -1)
        size = np.linalg.norm(G, axis=0)
        T = np.linalg.lstsq(G / size, flat)[0] / size[:, None]
        if not np.linalg.norm(flat - G @ T) <= 1e-3 * np.linalg.norm(flat):
            raise InputError("Expected the errors that the camera poses share to be those of the camera's calibration.")
        return np.asarray(T)

    def with_bundle(self, bundle: Bundle) -> Self:
        """Return the camera with other poses or residuals of the same pictures."""
        of_picture, of_board = pattern_of(bundle, self.corners, self.image_size), board_pattern_of(bundle, self.corners)
        return replace(self, bundle=bundle, pattern=of_picture, board_pattern=of_board)

    def select(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Self:
        """Select pictures by their numbers or a mask: the same camera, nothing is estimated again."""
        numbers = np.arange(self.corners.n)[index]
        kept = np.isin(self.corners.picture, numbers)
        if (np.diff(numbers) <= 0).any():
            raise InputError("Expected pictures in ascending order, each once.")
        corners, bundle = self.corners, self.bundle
        return replace(
            self,
            # The number of pictures is no longer known.
            corners=replace(
                without_pictures(corners, ~np.isin(np.arange(corners.n), numbers)), missing=(), image_size=None
            ),
            bundle=replace(
                bundle,
                poses=bundle.poses[numbers],
                residuals=bundle.residuals[kept],
                used=bundle.used[kept],
                own=bundle.own[numbers],
                by_parameters=bundle.by_parameters[numbers],
                weights=bundle.weights[numbers],
            ),
        )

    @property
    def pixel_noise(self) -> float:
        """Estimated standard deviation of a corner, per coordinate, in pixels."""
        return self.bundle.pixel_noise

    @property
    def outliers(self) -> list[tuple[str, int, float]]:
        """Corners that were left out: picture, number of the corner within it, distance in pixels."""
        distance = np.linalg.norm(self.bundle.residuals, axis=1)
        return [
            (self.corners.names[self.corners.picture[j]], int(self.corners.place[j]), float(distance[j]))
            for j in np.flatnonzero(~self.bundle.used)
        ]


def covered(cam: Calibrated) -> float:
    """Share of the cells of the picture in which there are corners."""
    return float((cam.pattern.count > 0).mean())


def seen_points(cam: Calibrated) -> list[Array]:
    """The corners of each picture in the camera frame, (m_i, 3) each."""
    corners = cam.corners
    parts = np.split(corners.points, np.flatnonzero(corners.place == 0)[1:])
    return [points @ T[:3, :3].T + T[:3, 3] for points, T in zip(parts, cam.poses, strict=True)]


def distances(cam: Calibrated) -> Array:
    """(n,) depth of the middle of the corners of each picture along the optical axis."""
    return np.asarray(np.stack([points.mean(axis=0) for points in seen_points(cam)])[:, 2])


def tilts(cam: Calibrated) -> Array:
    """(n,) degrees between the optical axis and the normal of the points of each picture."""
    normals = [np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][2] for points in seen_points(cam)]
    return np.asarray(np.degrees(np.arccos(np.clip(np.abs(np.array(normals)[:, 2]), 0.0, 1.0))))


def picture_rms(cam: Calibrated) -> Array:
    """(n,) root mean square of the residuals used, per coordinate, of every picture, in pixels."""
    used, picture = cam.bundle.used, cam.corners.picture
    squares = np.bincount(picture[used], np.sum(cam.bundle.residuals[used] ** 2, axis=1), cam.corners.n)
    return np.asarray(np.sqrt(squares / np.maximum(2 * np.bincount(picture[used], minlength=cam.corners.n), 1)))


def cells_that_matter(cam: Calibrated) -> NDArray[np.bool_]:
    """(CELLS, CELLS) where the mean residual is beyond chance and not small compared with the pixel noise."""
    length = np.linalg.norm(cam.pattern.mean, axis=-1)
    s, chance = cam.pixel_noise, np.sqrt(CONTRADICTED.chi_square(2))
    beyond = length > chance * s / np.sqrt(np.maximum(cam.pattern.count, 1))
    return np.asarray(beyond & (length > MIN_PATTERN_SHARE * np.sqrt(2) * s) & (cam.pattern.count > 0))


def radial_means(cam: Calibrated) -> tuple[Array, Array, Array]:
    """Distance from the centre, mean outward residual (pixels) and number of corners of up to 12 rings."""
    used = cam.bundle.used
    away = cam.corners.pixels[used] - cam.bundle.parameters[2:4]
    radius = np.linalg.norm(away, axis=1)
    outward = np.sum(cam.bundle.residuals[used] * away, axis=1) / np.maximum(radius, 1e-9)
    rings = 12
    ring = np.minimum((rings * radius / (radius.max() or 1.0)).astype(int), rings - 1)
    count = np.bincount(ring, minlength=rings)
    some = count > 0
    at, mean = (np.bincount(ring, values, rings)[some] / count[some] for values in (radius, outward))
    return at, mean, count[some].astype(float)


def certainty(cam: Calibrated) -> tuple[Array, Array, Array]:
    """Pixels u, v (rows, columns) of a grid over the picture, and the standard deviation there."""
    width, height = cam.image_size
    nodes = [max(round(49 * length / max(width, height)), 9) for length in (width, height)]
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, nodes[0]), np.linspace(-0.5, height - 0.5, nodes[1]))
    bundle = cam.bundle
    deviation = pixel_deviation(
        bundle.model, bundle.intrinsics, bundle.intrinsics_covariance, np.stack([u, v], axis=-1)
    )
    return u, v, deviation
