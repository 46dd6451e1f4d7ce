r"""Covariances of a pose in the conventions of other libraries. Conversions are explicit, never implied.

The toolkit: ``xi = (theta, tau)``, ``R = exp([theta]x) R_hat``, ``t = t_hat + tau``: rotation first, left
rotation, additive translation, rad and the length unit of t. With ``T = (R, t)``, to first order:

============== ================================ ===========================================================
name           order                            perturbation
============== ================================ ===========================================================
``toolkit``    rotation, translation            left rotation, additive translation
``ros``        translation, rotation            the same, in the parent frame about fixed axes
                                                (``geometry_msgs/PoseWithCovariance``)
``se3-left``   rotation, translation            ``T = Exp(xi) T_hat``: ``rho = tau + [t]x theta``
``se3-right``  rotation, translation            ``T = T_hat Exp(xi)``: ``(R^T theta, R^T tau)``
``gtsam``      rotation, translation            as ``se3-right`` (GTSAM ``Pose3``)
``manif``      translation, rotation            as ``se3-right`` (manif, Sophus, jaxlie)
``paper``      Sigma_R, Sigma_t of Wu et al.    ``Sigma_R = <dR dR^T> = tr(Sigma_theta) I - Sigma_theta`` (58)
============== ================================ ===========================================================

For ``paper`` the diagonal blocks are Sigma_R (58) and Sigma_t (59), the off-diagonal block stays
``<theta tau^T>``; it is a way of writing the numbers, not the covariance of any six coordinates.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError
from .checks import as_transforms
from .se3 import Array, block, skew

# In words, for files and reports: that of (theta, tau) in the parent frame of a pose, and that of X.
TOOLKIT = (
    "(theta, tau): R = exp([theta]x) R_hat, t = t_hat + tau; rotation first, left rotation, additive "
    "translation; rad and m; in the parent frame"
)
CONVENTION = f"xi = {TOOLKIT} of X"
# The six components of an error xi, for people.
COMPONENTS = ("rotation x", "rotation y", "rotation z", "translation x", "translation y", "translation z")

CONVENTIONS = ("toolkit", "ros", "se3-left", "se3-right", "gtsam", "manif", "sophus", "paper")

_EYE = np.eye(3)
_SWAP = np.roll(np.eye(6), 3, axis=1)


def paper_from_theta(Sigma_theta: ArrayLike) -> Array:
    """``Sigma_R = <dR dR^T> = tr(Sigma_theta) I - Sigma_theta`` from the covariance of the rotation vector."""
    S = np.asarray(Sigma_theta, dtype=float)
    return np.asarray(np.trace(S, axis1=-2, axis2=-1)[..., None, None] * _EYE - S)


def theta_from_paper(Sigma_R: ArrayLike) -> Array:
    """``Sigma_theta = tr(Sigma_R)/2 I - Sigma_R``: the inverse of `paper_from_theta`."""
    S = np.asarray(Sigma_R, dtype=float)
    return np.asarray(0.5 * np.trace(S, axis1=-2, axis2=-1)[..., None, None] * _EYE - S)


def jacobian(T: ArrayLike, convention: str) -> Array:
    """``d(coordinates of the convention) / d xi`` at ``T`` (..., 4, 4): (..., 6, 6)."""
    T = as_transforms(T, "T", stack=False)
    R_T = T[..., :3, :3].mT
    if convention == "toolkit":
        return np.broadcast_to(np.eye(6), (*T.shape[:-2], 6, 6))
    if convention == "ros":
        return np.broadcast_to(_SWAP, (*T.shape[:-2], 6, 6))
    if convention == "se3-left":
        return block(_EYE, 0.0, skew(T[..., :3, 3]), _EYE)
    if convention in ("se3-right", "gtsam"):
        return block(R_T, 0.0, 0.0, R_T)
    if convention in ("manif", "sophus"):
        return _SWAP @ block(R_T, 0.0, 0.0, R_T)
    raise InputError(f"Unknown convention {convention!r}; expected one of {', '.join(CONVENTIONS)}.")


def to_convention(covariance: ArrayLike, T: ArrayLike, convention: str) -> Array:
    """The toolkit's 6x6 covariance of the pose ``T`` in another convention.

    >>> S = np.diag([1.0, 2, 3, 4, 5, 6])
    >>> np.diag(to_convention(S, np.eye(4), "ros")).tolist()
    [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]
    """
    S = _six_by_six(covariance)
    if convention == "paper":
        S = S.copy()
        S[..., :3, :3] = paper_from_theta(S[..., :3, :3])
        return S
    J = jacobian(T, convention)
    return np.asarray(J @ S @ J.mT)


def from_convention(covariance: ArrayLike, T: ArrayLike, convention: str) -> Array:
    """The covariance of the pose ``T``, given in another convention, in the toolkit's: undoes `to_convention`."""
    S = _six_by_six(covariance)
    if convention == "paper":
        S = S.copy()
        S[..., :3, :3] = theta_from_paper(S[..., :3, :3])
        return S
    J = np.linalg.inv(jacobian(T, convention))
    return np.asarray(J @ S @ J.mT)


def _six_by_six(covariance: ArrayLike) -> Array:
    S = np.asarray(covariance, dtype=float)
    if S.shape[-2:] != (6, 6):
        raise InputError(f"Expected `covariance` to have shape (..., 6, 6), got {S.shape}.")
    return S
