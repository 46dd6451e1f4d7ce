"""The parameters of a camera and its board that are estimated, with their prior and the start of the fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ....core.geometry.se3 import Array
from ....errors import InputError
from ..board_shape import BoardShape
from ..corners import MIN_CORNERS, Corners
from ..models import LINEAR, CameraModel
from ..rays import rays
from .bundle import Bundle, BundleUnknowns, Prior, adjust
from .initial_guess import first_guess, poses_of
from .two_minima import MAX_AMBIGUOUS_POINTS, better_start

# Rays with a smaller part along the axis are too far to the side for the start of a pose.
MIN_RAY_DEPTH = 0.2
# A value, which is exact, or a value and its standard deviation.
Known = Mapping[str, float | tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Setting(BundleUnknowns):
    """Choice of the estimated ones of p parameters, with their start and prior."""

    values: Array = field(default_factory=lambda: np.zeros(0))  # (p,) nan where the start must find them

    @classmethod
    def of(cls, model: CameraModel, coefficients: Sequence[str], known: Known, shape: BoardShape) -> Setting:
        for name in (*coefficients, *known):
            if name not in model.names:
                raise InputError(
                    f"The model {model.name!r} has no parameter {name!r}; it has {', '.join(model.names)}."
                )
        names = (*model.names, *shape.names)
        mean, deviation = np.zeros(len(names)), np.concatenate([np.full(len(model.names), np.inf), shape.sd])
        values = np.where(np.isin(names, LINEAR), np.nan, 0.0)
        free = np.isin(names, (*LINEAR, *coefficients, *shape.names))
        for k, name in enumerate(model.names):
            if name not in known:
                continue
            entry = known[name]
            value, sd = (*np.atleast_1d(entry), 0.0)[:2]
            if not (np.isfinite(value) and np.isfinite(sd) and sd >= 0):
                raise InputError(
                    f"Expected `intrinsics[{name!r}]` to be a number, or one and its standard deviation; got {entry!r}."
                )
            mean[k], deviation[k], values[k] = value, sd, value
            free[k] = sd > 0
        if not np.isfinite(deviation[free]).any():
            return cls(model, shape, free, None, values)
        # A prior so wide that it has no effect stands for one that is not known.
        wide = np.where(np.isin(names, LINEAR), 1e6, 1e3)
        prior = Prior(mean, np.diag(np.where(np.isfinite(deviation), deviation, wide) ** 2))
        return cls(model, shape, free, prior, values)

    def start(self, corners: Corners, size: tuple[int, int]) -> tuple[Array, Array]:
        """Parameters and poses."""
        if np.isnan(self.values).any():
            guess, poses = first_guess(self.model, corners, size)
            parameters = np.concatenate([guess, np.zeros(self.shape.q)])
            if np.isnan(self.values[:4]).all():
                return np.where(np.isnan(self.values) | (self.values == 0), parameters, self.values), poses
            parameters = np.where(np.isnan(self.values), parameters, self.values)
        else:
            parameters = self.values
        seen_at = rays(self.model, parameters[: len(self.model.names)], corners.pixels)
        plain = (corners.pixels - parameters[2:4]) / parameters[:2]
        ahead = np.isfinite(seen_at[:, 2]) & (seen_at[:, 2] > MIN_RAY_DEPTH)
        undistorted = seen_at[:, :2] / np.where(ahead, seen_at[:, 2], 1.0)[:, None]
        if (np.bincount(corners.picture[ahead], minlength=corners.n) >= MIN_CORNERS).all():
            poses = poses_of(corners, np.ascontiguousarray(undistorted), ahead)
        else:  # given coefficients that see nothing at these pixels
            poses = poses_of(corners, plain)
        if len(self.shape.points) < MAX_AMBIGUOUS_POINTS:
            poses = better_start(self.model, parameters, self.shape, corners, poses)
        return parameters, poses

    def after(self, found: Bundle) -> tuple[Array, Array]:
        """Parameters and poses to start from once others were fitted, both of a fisheye or neither."""
        before = dict(zip(found.names, found.parameters, strict=True))
        values = np.array([before.get(name, 0.0) for name in self.names])
        return np.where(self.free, values, self.values), found.poses

    def fit(
        self,
        corners: Corners,
        start: tuple[Array, Array],
        used: NDArray[np.bool_],
        before: Bundle | None = None,
        weights: Array | None = None,
        pixel_noise: float | None = None,
    ) -> Bundle:
        """The bundle from a start, or from one that was fitted ``before`` with this setting."""
        at = start if before is None else (before.parameters, before.poses)
        try:
            unknowns = BundleUnknowns(self.model, self.shape, self.free, self.prior)
            return adjust(unknowns, corners, at, used=used, weights=weights, pixel_noise=pixel_noise)
        except np.linalg.LinAlgError as error:
            raise InputError(
                f"The model {self.model.name!r} does not fit the corners: they look farther to the side than it can "
                "describe (try 'fisheye' or 'auto'), or those of one picture lie on a line."
            ) from error
