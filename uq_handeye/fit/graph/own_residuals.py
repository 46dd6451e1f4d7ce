r"""Residuals of each pose without the errors that all poses share.

Residuals after a fit with shared errors are alike in all poses. With ``S = blkdiag(S_i) + F F^T``, r the residuals
after the fit and z the estimate of the shared errors (`Fit.told`), the own residuals are ``e = r - F z``, whitened by
S_i. They belong to one pose each, as residuals of independent noise do, with the unknowns (X, W, z).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...errors import InputError
from ...model.errors.columns import some_rows, times
from ...model.errors.joint_covariance import joint_of
from ...model.errors.keys import CAMERA_SCALE
from ...model.errors.square_roots import cholesky_of, whiten
from ...model.poses.pose_pairs import PosePairs
from .constraint import MIN_RESOLVED_SHARE
from .gauss_helmert import Fit

# Neighbouring residuals are those of a walk if their correlation exceeds both, as itself and over its standard error.
MIN_WALK_CORRELATION, MIN_WALK_SD = 0.15, 5.0
MIN_POSES_OF_WALK = 20


class OwnResiduals(NamedTuple):
    """Own residuals of one fit, in units of each pose's own noise, without the weights."""

    e: Array  # (n, 6)
    J: Array  # (n, 6, p + q), q combinations of shared errors of which the data tell something
    M: Array  # (p + q, p + q) covariance of the unknowns, with weights and priors
    known: Array  # (p + q, p + q) information of the priors


def own_errors(fit: Fit) -> Array:
    """(n, 6) the own residuals of one fit alone."""
    S = joint_of(fit.S)
    assert S is not None
    off = fit.residual - times(S.columns, fit.told_of_shared.z)
    return np.asarray(whiten(cholesky_of(S.own), off[..., None])[..., 0])


def own_residuals(fit: Fit, rows: NDArray[np.intp] | None = None) -> OwnResiduals:
    """Return the own residuals of one fit, of all ``rows`` or of some; raises `InputError` on fits of several data
    sets.
    """
    S = joint_of(fit.S)
    assert S is not None
    if fit.covariance.ndim != 2:
        raise InputError(f"Expected one data set beside shared errors, got leading axes {fit.covariance.shape[:-2]}.")
    z, response, left = fit.told_of_shared
    # The z are N(0, I) in any axes: those of what the data tell. 1: X and W, or other columns, take it in.
    share, axes = np.linalg.eigh(left)
    axes = axes[:, share * (1.0 + MIN_RESOLVED_SHARE) < 1.0]
    p, q = fit.covariance.shape[-1], axes.shape[-1]
    J, residual = fit.linear.J, fit.residual
    if rows is not None:
        S, J, residual = S.rows(rows), J[rows], residual[rows]
    F, off = times(S.columns, axes), residual - times(S.columns, z)
    white = whiten(cholesky_of(S.own), np.concatenate([J, F, off[..., None]], axis=-1))
    M = np.block([[fit.covariance, response @ axes], [(response @ axes).T, axes.T @ left @ axes]])
    known = np.diag((np.arange(p + q) >= p).astype(float))
    if fit.prior is not None:
        known[:p, :p] = fit.prior.normal_equations(fit.X, fit.W)[0]
    return OwnResiduals(white[..., -1], white[..., :-1], M, known)


def walks(fit: Fit, poses: PosePairs) -> bool:
    """Return whether residuals of neighbouring poses are so much alike that their noise is that of a walk.

    Looked at are all components together. Camera poses of a scale of their own are those of odometry: then also each
    component by itself, and what a change of the scale would do.
    """
    rows = np.arange(poses.n) if fit.weights is None else np.flatnonzero(fit.weights > 0.5)
    if poses.timestamps is not None:
        rows = rows[np.argsort(poses.timestamps[rows], kind="stable")]
    if len(rows) < MIN_POSES_OF_WALK:
        return False
    S = joint_of(fit.S)
    white = fit.white[0] if S is None else own_errors(fit)
    series = [white]
    if S is not None and CAMERA_SCALE in S.keys:
        series += [*white.T[..., None]]
        by_scale = whiten(cholesky_of(S.own), some_rows(S.some([S.keys.index(CAMERA_SCALE)]), slice(None)))[..., 0]
        series.append((by_scale * white).sum(axis=-1, keepdims=True))
    return any(_neighbours_alike(values[rows]) for values in series)


def _neighbours_alike(values: Array) -> bool:
    values = values / np.maximum(np.sqrt(np.mean(values**2, axis=0)), 1e-12)
    correlation = float(np.mean(values[1:] * values[:-1]))
    return bool(correlation > max(MIN_WALK_CORRELATION, MIN_WALK_SD / np.sqrt(values[1:].size)))
