"""Pairs of motions ``(A_i, B_i)``: their shapes, and the blocks in which they are processed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..core.geometry.checks import CHUNK, as_numbers
from ..core.geometry.se3 import Array
from ..errors import InputError

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

# Motions (..., N, 4, 4) of robot or camera, as an array or as rigid transforms of SciPy.
MotionsLike: TypeAlias = "ArrayLike | RigidTransform"


def as_pairs(A: MotionsLike, B: MotionsLike) -> tuple[Array, Array]:
    """Shapes made equal; the values are checked where they are read."""
    A = as_numbers(A.as_matrix() if hasattr(A, "as_matrix") else A, "A")
    B = as_numbers(B.as_matrix() if hasattr(B, "as_matrix") else B, "B")
    for T, name in ((A, "A"), (B, "B")):
        if T.ndim < 3 or T.shape[-2:] != (4, 4):
            raise InputError(f"Expected `{name}` to have shape (..., N, 4, 4), got {T.shape}.")
    if A.shape[-3] != B.shape[-3]:
        raise InputError(
            f"Expected `A` and `B` to hold the same number of motions, got {A.shape[-3]} and {B.shape[-3]}."
        )
    if A.shape[-3] < 2:
        raise InputError(f"Expected at least 2 motions to determine X, got {A.shape[-3]}.")
    if 0 in A.shape or 0 in B.shape:
        raise InputError(f"Expected at least one problem, got shapes {A.shape} and {B.shape}.")
    if A.shape != B.shape:
        try:
            A, B = np.broadcast_arrays(A, B)
        except ValueError as error:
            raise InputError(
                f"Expected the leading axes of `A` and `B` to broadcast, got {A.shape} and {B.shape}."
            ) from error
    return A, B


def trial_blocks(T: int, N: int, size: int = CHUNK) -> Iterator[slice]:
    """Trials that are worked on together: about ``size`` pairs."""
    step = max(1, size // N)
    return (slice(i, i + step) for i in range(0, T, step))


def pair_blocks(N: int, size: int = CHUNK) -> Iterator[slice]:
    """Pairs of one trial that are worked on together: ``size`` at most."""
    return (slice(j, j + size) for j in range(0, N, size))
