r"""Camera poses of a scene with their joint covariance, as `calibrate` takes those of a board.

With S and g of `adjust.reduce`, the lens is integrated over:

    Lambda = S_cc - S_ck S_kk^-1 S_kc,   g_c - S_ck S_kk^-1 g_k                                    (6n), rank 6n - 7

The seven null directions are the similarity of the scene, of which `calibrate` knows nothing either: W and the scale
have flat priors. They are given as little variance as leaves a positive matrix, because the rest of it would be shared
out between them and the true errors. With ``own_i = U_i^-1`` (points and lens held), ``h = sqrt(diag own)`` and Q an
orthonormal basis of the null directions in units of h,

    h^-1 (Lambda^+ + h a^2 Q Q^T h - blkdiag(own)) h^-1 = E diag(e) E^T,      F = h E sqrt(e)

with a = 2, doubled until e > -1e-3. Columns of e < 1 are given to each pose by itself.
"""

from __future__ import annotations

import numpy as np

from ..core.geometry.se3 import Array, left_jacobian, perturb
from ..model.errors.joint_covariance import JointCovariance
from .adjust import Reduced

# Shared variances up to this, in those of a pose's own noise, are not worth a column.
LARGE_SHARED = 1.0


def similarity(poses: Array) -> Array:
    """Errors (6n, 7) of camera poses C (n, 4, 4) by which a similarity of the scene moves them: rotation, translation,
    scale.
    """
    R, t = poses[:, :3, :3], poses[:, :3, 3]
    found = np.zeros((len(poses), 6, 7))
    found[:, :3, :3] = R  # C exp(a): R exp([a]x) = exp([R a]x) R
    found[:, 3:, 3:6] = R
    found[:, 3:, 6] = t
    return found.reshape(-1, 7)


def without_lens(at: Reduced) -> tuple[Array, Array]:
    """Information Lambda (6n, 6n) of the camera poses and its slope (6n,), the lens integrated over."""
    k = 6 * at.n
    if len(at.S) == k:
        return at.S, at.g
    gain = np.linalg.solve(at.S[k:, k:], at.S[k:, :k]).T
    found = at.S[:k, :k] - gain @ at.S[k:, :k]
    return 0.5 * (found + found.T), at.g[:k] - gain @ at.g[k:]


def as_poses(at: Reduced, poses: Array) -> tuple[Array, JointCovariance]:
    """Measured camera poses (n, 4, 4) and the joint covariance of their errors, linearised at ``poses``.

    The poses need not be the minimum of the pictures: they are moved to it, to first order.
    """
    n = at.n
    Lambda, slope = without_lens(at)
    own = np.linalg.inv(at.own)
    h = np.sqrt(np.einsum("nii->ni", own)).ravel()
    Q = np.linalg.qr(similarity(poses) / h[:, None])[0]
    QQ = Q @ Q.T
    rest = np.eye(6 * n) - QQ
    scaled = rest @ (Lambda * np.outer(h, h)) @ rest
    inverse = rest @ np.linalg.inv(scaled + QQ) @ rest
    move = -(h * (inverse @ (h * slope))).reshape(n, 6)
    blocks = own / (h.reshape(n, 6, 1) * h.reshape(n, 1, 6))
    M = 0.5 * (inverse + inverse.T)
    M.reshape(n, 6, n, 6)[np.arange(n), :, np.arange(n), :] -= blocks
    a = 2.0  # standard deviation of the null directions in units of a pose's own noise
    for _ in range(40):
        e, E = np.linalg.eigh(M + a * a * QQ)
        if e[0] > -1e-3:  # positive but for rounding
            break
        a *= 2.0
    large, small = e >= LARGE_SHARED, (e > 1e-9) & (e < LARGE_SHARED)
    F = (E[:, large] * np.sqrt(e[large])).reshape(n, 6, -1)
    faint = (E[:, small] * np.sqrt(e[small])).reshape(n, 6, -1)
    turn = np.tile(np.eye(6), (n, 1, 1))  # errors of the moved poses from those where they are linearised
    turn[:, :3, :3] = np.linalg.inv(left_jacobian(-move[:, :3]))
    turn = turn * h.reshape(n, 1, 6)
    own = turn @ (blocks + faint @ faint.mT) @ turn.mT
    return perturb(poses, move), JointCovariance(0.5 * (own + own.mT), turn @ F)
