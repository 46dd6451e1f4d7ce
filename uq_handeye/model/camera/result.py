"""Result of `calibrate_camera`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.files.open import StrPath
from ...core.geometry.se3 import Array, skew
from ...core.presentation.document import to_text
from ...core.presentation.notebook import to_html
from ...errors import InputError
from ...findings import Finding, texts
from ..noise.joint_covariance import JointCovariance
from .adjustment.bundle import Bundle, response_ahead
from .adjustment.model_choice import Candidate
from .corners import Corners, without_pictures
from .measured_board import MeasuredBoard, measured_board
from .report.text import camera_document
from .residual_pattern import BoardPattern, Pattern

# A focal length less certain than this share of it is warned of.
UNCERTAIN = 0.01


# Estimates of coefficients within so many standard deviations of 0 are not told apart from it.
SMALL = 2.0


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """A calibrated camera, the poses it saw the board at, and how well all of that is known; see `calibrate_camera`."""

    bundle: Bundle
    corners: Corners
    image_size: tuple[int, int]
    candidates: tuple[Candidate, ...]  # models that were compared; empty if the model was given
    pattern: Pattern  # residuals over the picture
    board_pattern: BoardPattern  # residuals over the board
    findings: tuple[Finding, ...]  # what to know before trusting it

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
        return measured_board(self.bundle)

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
        as if all pictures told as much of them.
        """
        w, s = self.bundle.weights, self.bundle.pixel_noise
        found = self.covariance
        own = found.own * (w / s**2)[:, None, None]
        return JointCovariance(own, found.shared * float(np.sqrt(np.sum(w**2) / np.sum(w)) / s), found.names)

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
        bundle = self.bundle
        G = bundle.by_parameters[..., bundle.free].reshape(-1, int(bundle.free.sum()))
        flat = shared.reshape(len(G), -1)
        size = np.linalg.norm(G, axis=0)
        T = np.linalg.lstsq(G / size, flat)[0] / size[:, None]
        if not np.linalg.norm(flat - G @ T) <= 1e-3 * np.linalg.norm(flat):
            raise InputError("Expected the errors that the camera poses share to be those of the camera's calibration.")
        points, _ = self.corners.on_board
        return np.asarray(response_ahead(bundle, points, poses)[..., bundle.free] @ T)

    def summary(self) -> str:
        """Model, intrinsics with their standard deviations, pixel noise, corners that were left out, warnings:
        as text.
        """
        return to_text(camera_document(self))

    def _repr_html_(self) -> str:
        """For notebooks."""
        return to_html("Camera calibration", camera_document(self))

    def figure(self, path: StrPath, name: str = "pattern") -> Path:
        """Write a figure as ``.png`` or ``.svg``; see `camera_figures` for the names."""
        from .report.figures import save_figure

        return save_figure(self, path, name)

    def write(self, folder: StrPath) -> Path:
        """Everything as files in a folder, all or none, which `read_camera` and `read_poses` take; see `folder`."""
        from .files.folder_writer import write_camera
        from .report.page import report_files

        return write_camera(self, folder, report_files(self))

    def select(self, index: NDArray[Any]) -> CameraCalibration:
        """Select pictures by their numbers or a mask: the same camera, nothing is estimated again."""
        numbers = np.arange(self.corners.n)[index]
        kept = np.isin(self.corners.picture, numbers)
        if (np.diff(numbers) <= 0).any():
            raise InputError("Expected pictures in ascending order, each once.")
        corners, bundle = self.corners, self.bundle
        return replace(
            self,
            # How many pictures there were is no longer known.
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
