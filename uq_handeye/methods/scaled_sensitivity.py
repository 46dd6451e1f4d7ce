"""Derivatives of X by the errors of its data at a finite scaling factor d, through the octonion, (39)-(48), (53)-(59).

Model: ``E = F2(A)``, ``Z = F2(B)`` on SO(4) carry the errors of A and B; the octonion ``sigma = (q_L, q_R)/sqrt(2)``
moves by ``delta q_L = -(F11 - lambda_min I)^+ delta F11 q_L`` (39), (44) and likewise for q_R, to first order. With the
notation of `sensitivity.py`, F is the derivative of X itself and Q the unit matrix.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.geometry.se3 import Array
from . import _closed_form
from .scaled import Scaled, octonion


class Linearised(NamedTuple):
    """Quantities that the derivatives at finite d need, for trials T."""

    sigma: Array  # (T, 8)
    pinv: Array  # (T, 2, 4, 4): (F11 - lambda_min I)^+ and that of F22
    to_X: Array  # (T, 6, 8): d xi_X / d sigma
    scale: float


def linearised(solution: Scaled, X: Array | None, scale: float) -> Linearised:
    """Linearise at the solution, or at X (T, 4, 4) where it is given."""
    sigma = solution.sigma.reshape(-1, 8) if X is None else octonion(X, scale)
    pinv = np.stack([solution.pinv_L.reshape(-1, 4, 4), solution.pinv_R.reshape(-1, 4, 4)], axis=1)
    return Linearised(sigma, pinv, pose_from_octonion_jacobian(sigma, scale), scale)


class ScaledDerivatives:
    """Derivatives of X at finite d through the octonion, (39)-(48) and (53)-(59), for some of the trials."""

    def __init__(self, at: Linearised, trials: slice) -> None:
        self.sigma, self.pinv, self.to_X, self.scale = (
            at.sigma[trials],
            at.pinv[trials],
            at.to_X[trials],
            at.scale,
        )

    def by_image(self, A: Array, B: Array) -> Array:
        """``d sigma / d b`` with ``b = (vec E, vec Z)`` (45): (T, m, 8, 32)."""
        E, Z = _closed_form.F2(A, self.scale), _closed_form.F2(B, self.scale)
        q = np.sqrt(2.0) * self.sigma[:, None]
        result = np.empty((*A.shape[:2], 8, 32))
        # (39) with M = -F11: delta q = -(F11 - lambda I)^+ (q^T kron I) delta vec(F11), and sigma = q / sqrt(2)
        result[..., :4, :] = self.pinv[:, None, 0] @ _closed_form.dF11q_db(E, Z, q[..., :4])
        result[..., 4:, :] = self.pinv[:, None, 1] @ _closed_form.dF22q_db(E, Z, q[..., 4:])
        result *= -np.sqrt(0.5)
        return result

    def of_octonion(self, A: Array, B: Array) -> Array:
        """``d sigma / d xi``: (2, T, m, 8, 6)."""
        by_image = self.by_image(A, B)
        return np.stack(
            [
                by_image[..., :16] @ _closed_form.dF2_dxi(A, self.scale),
                by_image[..., 16:] @ _closed_form.dF2_dxi(B, self.scale),
            ]
        )

    def block(self, A: Array, B: Array, pairs: slice) -> Array:
        return np.moveaxis(self.to_X[:, None] @ self.of_octonion(A, B), (3, 4), (1, 2))

    def weight(self, N: int) -> Array:
        return np.broadcast_to(np.eye(6), (len(self.sigma), 6, 6))


def columns_by_octonion(sigma: Array) -> Array:
    """P_1 .. P_4, (..., 8) -> (..., 4, 4, 8): c_i = P_i sigma (20), delta c_i = 2 P_i delta sigma (55)."""
    factors = (_closed_form.P_1, _closed_form.P_2, _closed_form.P_3, _closed_form.P_4)
    return np.stack([P(sigma) for P in factors], axis=-3)


def pose_from_octonion_jacobian(sigma: Array, scale: float) -> Array:
    """``d xi_X / d sigma``, (..., 8) -> (..., 6, 8), from ``delta c_i = 2 P_i(sigma) delta sigma`` (55).

    The columns c_1, c_2, c_3 hold the rotation, ``[theta]x = dR R^T``; the fourth holds the translation,
    ``tau = d delta c_4`` (59).
    """
    R = _closed_form.sigma_to_R(sigma)[..., :3, :3]
    by_octonion = 2.0 * columns_by_octonion(sigma)[..., :3, :]  # (..., column, row, 8)
    dR = by_octonion[..., :3, :, :].swapaxes(-3, -2)
    dR_Rt = np.einsum("...ija,...kj->...ika", dR, R)
    J = np.empty((*sigma.shape[:-1], 6, 8))
    J[..., 0, :] = 0.5 * (dR_Rt[..., 2, 1, :] - dR_Rt[..., 1, 2, :])
    J[..., 1, :] = 0.5 * (dR_Rt[..., 0, 2, :] - dR_Rt[..., 2, 0, :])
    J[..., 2, :] = 0.5 * (dR_Rt[..., 1, 0, :] - dR_Rt[..., 0, 1, :])
    J[..., 3:, :] = scale * by_octonion[..., 3, :, :]
    return J
