r"""Covariance of the difference of two results from different poses, which may have errors in common.

With the posteriors ``N(0, P_old)`` and ``N(0, P_new)`` of the errors s of two estimates (`posterior`), and the
information I that has one source in both,

    Cov(s_new - s_old) = P_old + P_new - P_old I P_new - (P_old I P_new)^T

since each estimate answers an error eta of a source with the rows B (whitened by its noise) by ``P B^T eta``. I is the
sum of

- the prior information about an error that is the same in both, ``1 / (sd_old sd_new)``; for errors whose numbers
  belong to the poses of each, with the correlation of these numbers;
- a prior of X and W that both were given.

Without errors in common this is the sum of both covariances.
"""

from __future__ import annotations

import numpy as np

from ...calibration.evidence.same_things import CAMERA
from ...calibration.prediction.predict import bound_to, errors_of_poses
from ...calibration.result import Calibration
from ...core.geometry.se3 import Array
from ...model.errors.joint_covariance import joint_of
from ...model.errors.key import ErrorKey
from ...model.errors.keys import INTRINSICS
from ...model.errors.models import is_joint
from ...model.shared_errors.population import LENGTH_PER_RAD_M


def difference_covariance(old: Calibration, new: Calibration, same: frozenset[str]) -> Array | None:
    """(12, 12) of (xi_X, xi_W) new minus old, or None where the posteriors do not determine it.

    ``same``: which things (`same_things`) are one and the same.
    """
    before, now = old.posterior, new.posterior
    if before is None or now is None or any(map(_is_more_than_its_posterior, (old, new))):
        return None
    of_errors = _information_of_errors(old, new, same)
    information = np.zeros((12 + of_errors.shape[0], 12 + of_errors.shape[1]))
    information[:12, :12], information[12:, 12:] = _information_of_prior(old, new), of_errors
    P_old, P_new = before.covariance[:12, :12], now.covariance[:12, :12]
    cross = _as_covariance(before.covariance[:12] @ information @ now.covariance[:, :12], P_old, P_new)
    return np.asarray(P_old + P_new - cross - cross.T)


def _as_covariance(cross: Array, P_old: Array, P_new: Array) -> Array:
    """Return the covariance of two estimates with the covariances P_old and P_new, no canonical correlation above 1.

    Where sizes of errors were estimated, P holds their uncertainty too, and ``P_old I P_new`` is too large.
    """
    L_old, L_new = np.linalg.cholesky(P_old), np.linalg.cholesky(P_new)
    U, values, V = np.linalg.svd(np.linalg.solve(L_old, np.linalg.solve(L_new, cross.T).T))
    return np.asarray(L_old @ (U * np.minimum(values, 1.0)) @ V @ L_new.T)


def _is_more_than_its_posterior(result: Calibration) -> bool:
    """Return whether its poses share errors that the posterior does not hold: of a clock, or of a covariance of all."""
    sides = [getattr(result.noise, side, None) for side in ("robot", "camera")]
    joint = any(S is not None and joint_of(S) is None and is_joint(S) for S in sides)
    return joint or result.covariance_kind != "model" or getattr(result.counted, "timing", None) is not None


def _information_of_errors(old: Calibration, new: Calibration, same: frozenset[str]) -> Array:
    """(q, q') of what was known beforehand of the errors of both."""
    keys, sd = zip(*map(_errors_of, (old, new)), strict=True)
    of_poses = [{error.key: error for error in errors_of_poses(of)} for of in (old, new)]
    alike = [[key.owner in same and key == other for other in keys[1]] for key in keys[0]]
    correlation = np.array(alike, dtype=float).reshape(len(keys[0]), len(keys[1]))
    for error in of_poses[0].keys() | of_poses[1].keys():
        i, j = (np.flatnonzero([key.error == error for key in part]) for part in keys)
        correlation[np.ix_(i, j)] = 0.0
        if error in of_poses[0] and error in of_poses[1] and error.owner in same:
            first, second = (of[error] for of in of_poses)
            at = bound_to(new)
            assert at is not None
            scale = np.repeat([1.0, 1.0 / LENGTH_PER_RAD_M], 3)[:, None]
            F_old, F_new = ((scale * one.at(at)).reshape(6 * at.n, -1) for one in (first, second))
            correlation[np.ix_(i, j)] = (np.linalg.pinv(F_new) @ F_old).T
    i, j = (np.flatnonzero([key.error == INTRINSICS for key in part]) for part in keys)
    if i.size or j.size:  # fixed and the same: the numbers of both are the errors of one calibration of the camera
        correlation[np.ix_(i, j)] = np.eye(len(i)) if CAMERA in same and len(i) == len(j) else 0.0
    return np.asarray(correlation / np.outer(*sd))


def _errors_of(result: Calibration) -> tuple[tuple[ErrorKey, ...], Array]:
    """Keys (q,) of the errors of the posterior, and the standard deviations that they had beforehand."""
    assert result.posterior is not None
    prior = {error.key: error.size for error in result.shared}
    keys = result.posterior.keys
    return keys, np.array([prior.get(key, 1.0) for key in keys])


def _information_of_prior(old: Calibration, new: Calibration) -> Array | float:
    """(12, 12) information of prior knowledge of X and W that both were given."""
    priors = [getattr(of.noise, "prior", None) for of in (old, new)]
    if priors[0] is None or priors[1] is None or priors[0].to_dict() != priors[1].to_dict():
        return 0.0
    return np.asarray(priors[0].information(12))
