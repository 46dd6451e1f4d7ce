r"""Errors of an arm without those of its base and its flange: the gauge in which X is stated (T17).

A constant motion of the base or of the flange is in W or X, whatever the arm. The base and flange of an arm are a
matter of definition; here they are the frames in which the arm, over its whole workspace, moves as closely as possible
to its nominal kinematics. With the twists ``B_i (12)`` of base and flange at postures spread over the joint limits, the
flange above the floor, rotations weighted by `LEVER_M`, the motion of base and flange in a column F is

    g = argmin sum_i |w (F_i - B_i g)|^2        (12 numbers for each error)

A joint that rotates by more than one revolution passes the same postures again: its range is one revolution. The
workspace is not a sharply defined set: a stated accuracy refers to some postures, a few hundred, and others would give
other frames, which adds to the uncertainty of X (`frames_of`). The errors that count are ``F - B g`` at any posture,
the poses ``FK(q; e)`` minus ``B g e``.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ...core.geometry.se3 import Array, perturb, skew
from ...core.rounding import CHAIN_ROUNDING
from .chain import Kinematics
from .forward import LEVER_M, spread_postures


def twists(T: Array) -> Array:
    """(..., 6, 12) errors of poses (..., 4, 4) by a rotation and a shift of the base, then of the flange."""
    found = np.zeros((*T.shape[:-2], 6, 12))
    found[..., :3, :3] = found[..., 3:, 3:6] = np.eye(3)
    found[..., 3:, :3] = -skew(T[..., :3, 3])
    found[..., :3, 6:9] = found[..., 3:, 9:] = T[..., :3, :3]
    return found


def workspace_postures(chain: Kinematics) -> Array:
    """(k, L) joint values spread over the limits, with the flange above the first joint; at most 1,600.

    The origin of the base counts for nothing: controllers may have theirs on the floor.
    """
    limits, n = chain.limits.copy(), 1600
    limits[chain.revolute & (np.ptp(limits, axis=1) > 2.0 * np.pi)] = [-np.pi, np.pi]
    q = spread_postures(limits, chain.revolute, 3 * n)
    above = (chain.poses(q)[:, :3, 3] - chain.frames(q)[:, 0, :3, 3]) @ chain.up > 0
    return np.asarray(q[above][:n] if above.sum() > n // 4 else q[:n])


@lru_cache(maxsize=16)
def gauge_of(chain: Kinematics) -> Array:
    """(12, m) motions of base and flange in the errors of a chain."""
    q = workspace_postures(chain)
    F, B = chain.columns(q), twists(chain.poses(q))
    weight = np.repeat([LEVER_M, 1.0], 3)[:, None]
    found = np.linalg.pinv((weight * B).reshape(-1, 12), CHAIN_ROUNDING) @ (weight * F).reshape(-1, F.shape[-1])
    return np.asarray(found)


@lru_cache(maxsize=16)
def counting(chain: Kinematics) -> Array:
    """(m,) whether anything is left of an error."""
    q = workspace_postures(chain)
    whole, left = (np.sqrt((of**2).sum(axis=(0, 1))) for of in (chain.columns(q), aligned_columns(chain, q)))
    return np.asarray(left > 1e-6 * np.maximum(whole, CHAIN_ROUNDING))


@lru_cache(maxsize=16)
def frames_of(chain: Kinematics) -> dict[str, Array]:
    """(12, 12) motions of base and flange that a sample of the workspace would give, by errors of each group.

    The frames are a least squares fit to n postures: each contributes ``(sum B^T w^2 B)^-1 B_i^T w^2 f_i`` to them, f_i
    the errors there without these frames, of standard deviation 1 each. The columns are a root of the sum of the
    squares of these contributions, the variance of the fit over samples, times ``n / 400``, for samples of 400
    postures.
    """
    q = workspace_postures(chain)
    left, B = aligned_columns(chain, q), twists(chain.poses(q))
    weight = np.repeat([LEVER_M, 1.0], 3)[:, None]
    gain = np.linalg.pinv((weight * B).reshape(-1, 12), CHAIN_ROUNDING).reshape(12, len(q), 6)
    moves = gain.transpose(1, 0, 2) @ (weight * left)  # (n, 12, m)
    found: dict[str, Array] = {}
    for group in dict.fromkeys(error.group for error in chain.errors):
        of = moves[..., [error.group == group for error in chain.errors]].transpose(1, 0, 2).reshape(12, -1)
        values, vectors = np.linalg.eigh(of @ of.T)
        found[group] = np.asarray(vectors * np.sqrt(np.maximum(values, 0.0) * len(q) / 400))
    return found


def frame_columns(chain: Kinematics, q: Array, group: str) -> Array:
    """(..., 6, 12) effects of `frames_of` on poses at joints q (..., L)."""
    return np.asarray(twists(chain.poses(q)) @ frames_of(chain)[group])


def aligned_columns(chain: Kinematics, q: Array, e: Array | None = None) -> Array:
    """(..., 6, m) effects of the errors on the true poses at joints q (..., L), without base and flange."""
    return np.asarray(chain.columns(q, e) - twists(chain.poses(q, e)) @ gauge_of(chain))


def aligned_poses(chain: Kinematics, q: Array, e: Array) -> Array:
    """(..., 4, 4) poses of the arm with the errors e (m,), in the frames of its nominal kinematics."""
    T = chain.poses(q, e)
    return perturb(T, -(twists(T) @ (gauge_of(chain) @ e)))
