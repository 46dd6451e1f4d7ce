r"""`ErrorTerm`, one error of the poses: its side, its effect on each pose, and the prior of its size.

The error enters on one side, as errors ``xi = (theta, tau)`` of the robot's or the camera's
poses (left rotation in rad, additive translation in m), in one of two ways or both:

- ``columns`` K (n, 6, m), shared by all poses: ``xi_i = s K_i z``, z ~ N(0, I_m) drawn once;
- ``block`` B (6, b) or (..., 6, b), drawn at each pose: ``xi_i = s B_i z_i``, z_i ~ N(0, I_b).

A covariance of camera poses that share their intrinsics has both, with one size. The size s is a number that is known,
or log-normal with a median and a factor (one sigma of its logarithm).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from ...errors import InputError
from .cholesky import factor
from .columns import Columns, some_rows
from .key import ErrorKey, Kind, Owner
from .sizes import Size, SizeLike, checked_sizes

SIDES = ("robot", "camera")


@dataclass(frozen=True, eq=False)
class ErrorTerm(ReadOnlyArrays):
    """An error of all poses of a side, with its size; see the module."""

    key: ErrorKey
    side: str
    size: Size
    columns: Array | Columns | None = None
    block: Array | None = None
    keys: tuple[ErrorKey, ...] = ()  # of the m columns; empty: counted from 1, or the key of the error where m = 1

    def __post_init__(self) -> None:
        if self.side not in SIDES:
            raise InputError(
                f"Expected `side` of the component {self.name!r} to be robot or camera, got {self.side!r}."
            )
        if self.columns is None and self.block is None:
            raise InputError(f"Expected `columns` or `block` of the component {self.name!r}.")
        for name in ("columns", "block"):
            if not isinstance(getattr(self, name), Columns | None):
                object.__setattr__(self, name, self._checked(name))
        m = self.count
        keys = tuple(self.keys) or ((self.key,) if m == 1 else tuple(self.key.number(k + 1) for k in range(m)))
        if len(keys) != m:
            raise InputError(f"Expected {m} `parts` of the component {self.name!r}, got {len(keys)}.")
        object.__setattr__(self, "keys", keys)
        super().__post_init__()

    def _checked(self, name: str) -> Array:
        given = np.asarray(getattr(self, name), dtype=float)
        fits = given.ndim == 3 if name == "columns" else given.ndim >= 2
        if not fits or given.shape[-2] != 6 or not np.isfinite(given).all():
            shape = "(n, 6, m)" if name == "columns" else "(6, b) or (..., 6, b)"
            raise InputError(
                f"Expected `{name}` {shape} of the component {self.name!r}, finite, got shape {given.shape}."
            )
        return given

    @classmethod
    def given(cls, side: str, covariance: Array, name: str = "") -> ErrorTerm:
        """Return the whole noise of a side as it was given, (6, 6) or (..., 6, 6); ``name`` of an arm or a camera."""
        return cls(ErrorKey(Owner(side), Kind.GIVEN, name=name), side, Size(1.0), block=factor(covariance))

    @property
    def name(self) -> str:
        """The error in words."""
        return str(self.key)

    @property
    def covariance(self) -> Array:
        """(6, 6) or (..., 6, 6) covariance of what is drawn at each pose, for a size of 1."""
        return np.zeros((6, 6)) if self.block is None else np.asarray(self.block @ self.block.mT)

    @property
    def count(self) -> int:
        """Number of columns m."""
        return 0 if self.columns is None else int(self.columns.shape[-1])

    def rows(self, kept: NDArray[np.intp]) -> ErrorTerm:
        """Return the component of some of the poses."""
        columns = None if self.columns is None else some_rows(self.columns, kept)
        block = self.block if self.block is None or self.block.ndim == 2 else self.block[kept]
        return replace(self, columns=columns, block=block)


def Component(  # one of the ways to make an error, as users call it
    name: str,
    side: str,
    size: SizeLike,
    columns: Array | None = None,
    block: Array | None = None,
    parts: Sequence[str] = (),
) -> ErrorTerm:
    """Return an error of the user's own, on all poses of a side; see `ErrorTerm`.

    Parameters
    ----------
    name : str
    side : "robot" or "camera"
        Whose poses it moves; for motions that come without poses A is the robot.
    size : Size, (median, factor) or a number that is known
    columns : (n, 6, m) or None
    block : (6, b), (n, 6, b) or None
        At least one of the two is given.
    parts : sequence of str
        Names of the m columns, added to that of the error; empty: 1 and so on.
    """
    if side not in SIDES:
        raise InputError(f"Expected `side` of the component {name!r} to be robot or camera, got {side!r}.")
    key = ErrorKey(Owner(side), Kind.OWN, name=name)
    return ErrorTerm(key, side, checked_sizes({name: size})[name], columns, block, tuple(map(key.number, parts)))
