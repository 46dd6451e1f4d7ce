r"""Covariances of poses that follow from others: of the inverse, of a relative pose, and of two estimates of one pose.

All covariances are those of ``xi = (theta, tau)`` in the parent frame of their pose (`conventions.TOOLKIT`); those of
other libraries are converted first (`from_convention`). To first order, with ``T = (R, t)``:

- of the inverse, ``theta' = -R^T theta``, ``tau' = -R^T (tau + [t]x theta)``;
- of the relative pose ``D = A^-1 B``, R_A the rotation of A and d the translation of D,
  ``xi_D = R_A^T ( theta_B - theta_A,  tau_B - tau_A + [R_A d]x theta_A )``;
- of the fusion of estimates T_1, T_2 of one pose, ``S = (K_1^T S_1^-1 K_1 + K_2^T S_2^-1 K_2)^-1`` about the pose of
  least squares, K_i the derivative of the error of T_i by a move of the pose.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError, NotConvergedError
from ..rounding import CHAIN_ROUNDING, SOLUTION_ROUNDING
from .checks import as_covariance, as_pose, as_transforms, checked_covariance
from .se3 import Array, block, difference, inverse, inverse_jacobian, left_jacobian, perturb, skew


def covariance_of_inverse(T: ArrayLike, covariance: ArrayLike) -> Array:
    """Return the covariance of ``inv(T)`` (..., 6, 6) from that of T.

    Parameters
    ----------
    T : (..., 4, 4)
    covariance : (..., 6, 6) of (theta, tau), rad and the length unit of T

    >>> T = np.eye(4)
    >>> T[0, 3] = 2.0
    >>> np.diag(covariance_of_inverse(T, np.diag([0, 0, 1e-6, 0, 0, 0]))).round(9).tolist()
    [0.0, 0.0, 1e-06, 0.0, 4e-06, 0.0]
    """
    T = as_transforms(T, "T", stack=False)
    S = np.asarray(covariance, dtype=float)
    if S.shape[-2:] != (6, 6):
        raise InputError(f"Expected `covariance` to have shape (..., 6, 6), got {S.shape}.")
    checked_covariance(S.reshape(-1, 6, 6), "covariance", joint=False)
    J = inverse_jacobian(T)
    return np.asarray(J @ S @ J.mT)


def relative_pose(A: ArrayLike, B: ArrayLike, joint: ArrayLike) -> tuple[Array, Array]:
    """Return ``A^-1 B`` (4, 4), the pose of B in A, and its covariance (6, 6).

    Parameters
    ----------
    A, B : (4, 4)
        Poses in one parent frame, such as two cameras in a rig.
    joint : (12, 12)
        Joint covariance of ``(xi_A, xi_B)``; poses that are independent have zero blocks beside the diagonal.

    Errors that both poses share cancel in part: without the blocks beside the diagonal the covariance is too large.
    """
    A, B = as_pose(A, "A"), as_pose(B, "B")
    S = checked_covariance(joint, "joint", joint=True)
    if S.shape != (12, 12):
        raise InputError(f"Expected `joint` to have shape (12, 12), of A and B, got {S.shape}.")
    R_T = A[:3, :3].T
    J = np.hstack([-block(R_T, 0.0, -R_T @ skew(B[:3, 3] - A[:3, 3]), R_T), block(R_T, 0.0, 0.0, R_T)])
    return inverse(A) @ B, np.asarray(J @ S @ J.T)


def fused_pose(
    T1: ArrayLike, covariance1: ArrayLike, T2: ArrayLike, covariance2: ArrayLike
) -> tuple[Array, Array, float]:
    """Return the pose of least squares of two independent estimates, its covariance (6, 6), and the sum of squares.

    Parameters
    ----------
    T1, T2 : (4, 4)
        Estimates of one pose in one parent frame.
    covariance1, covariance2 : (6, 6)
        Their covariances, positive definite; the errors of the two are independent.

    Returns
    -------
    (pose (4, 4), covariance (6, 6), square)
        ``square`` is chi-square distributed with 6 degrees of freedom if both covariances hold: above 16.8 in 1 %.

    Raises
    ------
    InputError
        A matrix that is no pose or no covariance, or is singular.
    NotConvergedError
        The two poses are too far apart.
    """
    means = as_pose(T1, "T1"), as_pose(T2, "T2")
    weights = []
    for S, name in ((covariance1, "covariance1"), (covariance2, "covariance2")):
        S = as_covariance(S, name)
        d = np.sqrt(np.diag(S))
        if not (d > 0).all() or np.linalg.eigvalsh(S / np.outer(d, d))[0] < SOLUTION_ROUNDING:
            raise InputError(f"Expected `{name}` to be positive definite, got a singular one.")
        weights.append(np.linalg.inv(S / np.outer(d, d)) / np.outer(d, d))
    found = means[0]
    for _ in range(20):  # steps at most to the pose of least squares
        information, gradient, square = np.zeros((6, 6)), np.zeros(6), 0.0
        for mean, L in zip(means, weights, strict=True):
            xi = difference(found, mean)
            K = np.eye(6)
            K[:3, :3] = np.linalg.inv(left_jacobian(xi[:3]))
            information += K.T @ L @ K
            gradient += K.T @ L @ xi
            square += float(xi @ L @ xi)
        covariance = np.linalg.inv(information)
        step = -covariance @ gradient
        found = perturb(found, step)
        if float(step @ information @ step) < CHAIN_ROUNDING:
            return found, 0.5 * (covariance + covariance.T), square
    raise NotConvergedError("The two poses are too far apart to be fused: are they of one pose, in one frame?")
