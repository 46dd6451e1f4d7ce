r"""The second stage of the separated methods: the translation of X by linear least squares, given its rotation.

Minimises ``sum_i |(R_A - I) t_X - (R_X t_B - t_A)|^2``, the translation part of ``A X = X B``.
"""

from __future__ import annotations

import numpy as np

from ....core.geometry.se3 import Array
from ...procrustes.degeneracy import DEGENERATE
from .method import Estimate, closed_form, require

_EYE = np.eye(3)


def translation_factors(A: Array, B: Array) -> tuple[Array, Array]:
    """``(D, D^T t_A)`` (..., 12) with ``D = R_A - I``, and ``(t_B, 1)`` (..., 4)."""
    D, t = A[..., :3, :3] - _EYE, A[..., :3, 3:]
    left = np.concatenate([D.reshape(*D.shape[:-2], 9), (D.mT @ t)[..., 0]], axis=-1)
    right = np.concatenate([B[..., :3, 3], np.ones((*B.shape[:-2], 1))], axis=-1)
    return left, right


def with_translation(R: Array, moments: Array, N: int) -> Estimate:
    """X (T, 4, 4) from its rotation (T, 3, 3) and the moments (T, 12, 4) of `translation_factors`."""
    D = moments[:, :9, 3].reshape(-1, 3, 3)
    M = -(D + D.mT)  # sum D^T D, as R_A^T R_A = I
    values = np.linalg.eigvalsh(M)
    require(values[:, 0] > DEGENERATE * np.maximum(values[:, 2], 1e-4 * N), "the translation is not determined.")
    D_tB = moments[:, :9, :3].reshape(-1, 3, 3, 3)  # sum D[b, a] t_B[c]
    rhs = np.einsum("tbac,tbc->ta", D_tB, R) - moments[:, 9:, 3]
    X = np.zeros((len(R), 4, 4))
    X[:, :3, :3] = R
    X[:, :3, 3] = np.linalg.solve(M, rhs[..., None])[..., 0]
    X[:, 3, 3] = 1.0
    return closed_form(X)
