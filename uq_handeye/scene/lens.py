"""The lens of a scene's pictures: the model ``brown`` with k1, k2, p1, p2, its start and its prior."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array
from ..core.runtime.read_only import ReadOnlyArrays
from ..errors import InputError
from ..model.camera.given_intrinsics import OPEN_RADIAL_SD
from ..model.camera.models import MODELS

MODEL = MODELS["brown"]
NAMES = MODEL.names[:8]  # fx, fy, cx, cy, k1, k2, p1, p2; higher coefficients are 0
# Weak prior standard deviations: the principal point about the middle, in widths of the picture; coefficients about 0;
# logarithm of fx / fy.
CENTRE_WIDTHS, TANGENTIAL_SD, ASPECT_SD = 0.03, 0.002, 0.003


@dataclass(frozen=True, eq=False)
class Lens(ReadOnlyArrays):
    """Intrinsics of the model ``brown``, which of them are estimated, and what is known of them beforehand."""

    values: Array  # (12,) in the order of the model
    free: NDArray[np.bool_]  # (12,)
    mean: Array  # (12,) of the prior
    sd: Array  # (12,) of the prior, infinite where nothing is known
    square: bool  # whether fx / fy has the weak prior of square pixels

    @classmethod
    def of(
        cls,
        image_size: tuple[int, int],
        known: Mapping[str, float | tuple[float, float]] | None = None,
        focal: float | None = None,
    ) -> Lens:
        """Lens of pictures of a size (width, height), with ``known`` values, each exact or with its uncertainty."""
        width, height = image_size
        f = 1.2 * width if focal is None else focal
        values = np.zeros(len(MODEL.names))
        values[:4] = f, f, 0.5 * (width - 1), 0.5 * (height - 1)
        sd, free = np.full(len(values), np.inf), np.zeros(len(values), dtype=bool)
        free[: len(NAMES)] = True
        sd[2:4], sd[4:6], sd[6:8] = CENTRE_WIDTHS * width, OPEN_RADIAL_SD, TANGENTIAL_SD
        for name, entry in (known or {}).items():
            if name not in MODEL.names:
                raise InputError(
                    f"Pictures of a scene take the camera model brown; it has no {name!r}. Undistort the pictures, or "
                    "leave the intrinsics out."
                )
            value, spread = (*np.atleast_1d(entry), 0.0)[:2]
            k = MODEL.names.index(name)
            values[k], sd[k], free[k] = value, spread if spread > 0 else np.inf, spread > 0
        square = bool(free[:2].all() and np.isinf(sd[:2]).all())
        return cls(values, free, values.copy(), sd, square)

    def at(self, values: Array) -> Lens:
        """Return the lens at other values (12,)."""
        return Lens(values, self.free, self.mean, self.sd, self.square)

    @property
    def f(self) -> int:
        """Number of estimated intrinsics."""
        return int(self.free.sum())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the estimated intrinsics."""
        return tuple(name for name, free in zip(MODEL.names, self.free, strict=True) if free)

    def prior_rows(self) -> tuple[Array, Array]:
        """Residuals (q,) of the prior and their derivatives (q, f) by the free intrinsics, in standard deviations."""
        rows, J = [], []
        column = np.cumsum(self.free) - 1
        for k in np.flatnonzero(self.free & np.isfinite(self.sd)):
            J.append(np.eye(self.f)[column[k]] / self.sd[k])
            rows.append((self.values[k] - self.mean[k]) / self.sd[k])
        if self.square:
            fx, fy = self.values[:2]
            one = np.zeros(self.f)
            one[column[0]], one[column[1]] = 1.0 / (fx * ASPECT_SD), -1.0 / (fy * ASPECT_SD)
            J.append(one)
            rows.append(np.log(fx / fy) / ASPECT_SD)
        return np.array(rows), np.array(J).reshape(len(rows), self.f)
