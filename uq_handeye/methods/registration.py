"""Registration of two point sets, Problem 1 of the 4DPA paper, equations (13)-(15)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..core.geometry.checks import as_numbers
from ..core.geometry.nearest_rotation import nearest_rotation
from ..core.geometry.se3 import Array
from ..errors import InputError


def register(U: ArrayLike, V: ArrayLike) -> tuple[Array, Array]:
    """Problem 1: the rotation and translation that carry the points U onto V.

    Minimises ``sum |R u_i + t - v_i|^2`` (13) over R in SO(n) and t. By (14)-(15), with the correlation
    ``sum (v_i - v_mean)(u_i - u_mean)^T``: its singular value decomposition, the transpose of the paper's H.

    Parameters
    ----------
    U, V : (..., N, n)
        Corresponding points; n = 4 in the paper, any n >= 2 here.

    Returns
    -------
    R : (..., n, n)
    t : (..., n)

    Raises
    ------
    InputError
        Shapes differ, values are not finite, or more than one rotation fits equally well: the points span
        fewer than n - 1 directions, or are mirror images with equal smallest singular values.
    """
    U, V = as_numbers(U, "U"), as_numbers(V, "V")
    if U.ndim < 2 or U.shape != V.shape or U.shape[-1] < 2 or U.shape[-2] < 1:
        raise InputError(
            f"Expected `U` and `V` to have the same shape (..., N, n) with n >= 2, got {U.shape} and {V.shape}."
        )
    if not (np.isfinite(U).all() and np.isfinite(V).all()):
        raise InputError("Expected `U` and `V` to be finite, got NaN or infinity.")
    U_mean, V_mean = U.mean(axis=-2), V.mean(axis=-2)
    correlation = np.swapaxes(V - V_mean[..., None, :], -1, -2) @ (U - U_mean[..., None, :])
    R, unique = nearest_rotation(correlation)
    if not unique.all():
        raise InputError(
            f"Expected `U` and `V` to span at least {U.shape[-1] - 1} directions and not to be mirror images, so that "
            "one rotation fits best; more than one fits equally well."
        )
    return R, V_mean - (R @ U_mean[..., None])[..., 0]
