"""The lens of a scene's pictures: the model ``brown`` with k1, k2, p1, p2, its start and its prior; of one camera or
several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ..core.geometry.se3 import Array
from ..core.read_only import ReadOnlyArrays
from ..errors import InputError
from ..model.camera.given_intrinsics import OPEN_RADIAL_SD
from ..model.camera.models import MODELS, Projected

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
    def each(self) -> tuple[Lens, ...]:
        """The lenses: this one."""
        return (self,)

    def with_each(self, each: Sequence[Lens]) -> Lens:
        """Return the lens in place of this one."""
        return each[0]

    def of_pictures(self, kept: NDArray[np.intp]) -> Lens:
        """Return the lens of some of its pictures: the same."""
        return self

    def project(self, seen: Array, picture: NDArray[np.intp], derivatives: bool = False) -> Projected:
        """Project points (N, 3) in the frames of the cameras; ``derivatives`` by the free intrinsics, too."""
        return MODEL.project(self.values, seen, self.free if derivatives else np.zeros_like(self.free))

    def stepped(self, step: Array) -> Lens:
        """Return the lens with a step (f,) added to its free intrinsics."""
        values = self.values.copy()
        values[self.free] += step
        return self.at(values)

    @property
    def possible(self) -> bool:
        """Return whether the focal lengths are positive."""
        return bool((self.values[:2] > 0).all())

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


@dataclass(frozen=True, eq=False)
class Lenses(Lens):
    """Lenses of several cameras, one after the other, in place of a `Lens`."""

    camera: NDArray[np.intp]  # (n,) of each picture

    @classmethod
    def of_cameras(cls, each: Sequence[Lens], camera: NDArray[np.intp]) -> Lenses:
        """Join the lenses of cameras; ``camera`` (n,) of each picture."""
        values, free, mean, sd = (
            np.concatenate([getattr(lens, name) for lens in each]) for name in ("values", "free", "mean", "sd")
        )
        return cls(values, free, mean, sd, all(lens.square for lens in each), camera)

    @property
    def each(self) -> tuple[Lens, ...]:
        """The lenses of the cameras."""
        parts = [np.split(of, len(of) // len(MODEL.names)) for of in (self.values, self.free, self.mean, self.sd)]
        return tuple(Lens(values, free, mean, sd, self.square) for values, free, mean, sd in zip(*parts, strict=True))

    def with_each(self, each: Sequence[Lens]) -> Lenses:
        """Return other lenses in place of these."""
        return Lenses.of_cameras(each, self.camera)

    def at(self, values: Array) -> Lenses:
        """Return the lenses at other values, those of the cameras one after the other."""
        return Lenses(values, self.free, self.mean, self.sd, self.square, self.camera)

    def of_pictures(self, kept: NDArray[np.intp]) -> Lenses:
        """Return the lenses of some of the pictures."""
        return Lenses(self.values, self.free, self.mean, self.sd, self.square, self.camera[kept])

    def project(self, seen: Array, picture: NDArray[np.intp], derivatives: bool = False) -> Projected:
        """Project points (N, 3) in the frames of the cameras that took the pictures (N,)."""
        N = len(seen)
        found = Projected(np.zeros((N, 2)), np.zeros((N, 2, self.f if derivatives else 0)), np.zeros((N, 2, 3)))
        start = 0
        for k, lens in enumerate(self.each):
            of = self.camera[picture] == k
            one = lens.project(seen[of], picture[of], derivatives)
            found.pixels[of], found.by_point[of] = one.pixels, one.by_point
            if derivatives:
                found.by_parameters[of, :, start : start + lens.f] = one.by_parameters
                start += lens.f
        return found

    @property
    def possible(self) -> bool:
        """Return whether the focal lengths are positive."""
        return all(lens.possible for lens in self.each)

    def prior_rows(self) -> tuple[Array, Array]:
        """Residuals (q,) of the priors and their derivatives (q, f); see `Lens.prior_rows`."""
        rows, J = zip(*(lens.prior_rows() for lens in self.each), strict=True)
        return np.concatenate(rows), np.asarray(block_diag(*J))
