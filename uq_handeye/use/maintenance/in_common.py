r"""The covariance of the difference of two results, by their posteriors and by what both of them know from one source.

With the posteriors ``N(0, P_old)`` and ``N(0, P_new)`` of the errors s of two estimates (`posterior`), and the
information I that has one source in both,

    Cov(s_new - s_old) = P_old + P_new - P_old I P_new - (P_old I P_new)^T

since each estimate answers an error eta of a source with the rows B (whitened by its noise) by ``P B^T eta``. I is the
sum of

- what was known beforehand of an error that is one and the same in both, ``1 / (sd_old sd_new)``; of errors whose
  numbers belong to the poses of each, with the correlation of these numbers;
- the poses that both hold, ``B_old^T B_new``: each whitened by the noise that its own estimate has for them;
- a prior of X and W that both were given.

Without poses in common and without errors in common this is the sum of both; where the new result holds all poses of
the old one, I is ``P_old^-1`` and the difference has the covariance ``P_old - P_new`` (J. Hausman, Econometrica 46
(1978)). Intrinsics that were estimated from the pictures of each are correlated by the share of pictures in common.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ...calibration.evidence.new_poses import evidence_of_poses
from ...calibration.prediction.predict import bound_to, errors_of_poses
from ...calibration.result import Calibration
from ...core.geometry.se3 import Array
from ...model.noise.camera_noise import INTRINSICS
from ...model.noise.joint_covariance import JointCovariance, group_of, joint_of
from ...model.noise.models import PoseNoise, is_joint
from ...model.noise.square_roots import cholesky_of, whiten
from ...model.poses.pose_pairs import PosePairs
from ...model.posterior.owners import CAMERA, owner_of
from ...model.shared_errors.population import LENGTH_PER_RAD_M

# Intrinsics whose columns on common poses agree so well were not estimated from the pictures again.
FIXED = 1e-6


def difference_covariance(
    old: Calibration, new: Calibration, common: list[tuple[int, int]], same: frozenset[str]
) -> Array | None:
    """(12, 12) of (xi_X, xi_W) new minus old, or None where the posteriors do not tell it.

    ``common``: numbers of the poses that both hold, (new, old). ``same``: which things (`posterior.owners`) are one
    and the same.
    """
    before, now = old.posterior, new.posterior
    if before is None or now is None or any(map(_is_more_than_its_posterior, (old, new))):
        return None
    between = _of_prior(old, new), _of_errors(old, new, common, same)
    if not common:
        P, sizes = (before.covariance, now.covariance), np.zeros((12, 12))
        rows: list[Array] = []
    else:
        index = np.array(common, dtype=np.intp)[:, ::-1].T  # of old, of new
        rows = [_rows_of(of) for of in (old, new)]
        P = _for_known_sizes(old, rows[0]), _for_known_sizes(new, rows[1])
        sizes = _by_sizes([of.covariance[:12, :12] - C[:12, :12] for of, C in zip((before, now), P, strict=True)],
                          len(common) / len(rows[0]))  # fmt: skip
        rows = [of[at] for of, at in zip(rows, index, strict=True)]
    information = _information(between, rows)
    cross = P[0][:12] @ information @ P[1][:, :12]
    return positive(P[0][:12, :12] + P[1][:12, :12] - cross - cross.T) + sizes


def _information(between: tuple[Array | float, Array], rows: list[Array]) -> Array:
    """(N, N') information of one source: of the prior of X and W, of the errors (q, q'), of rows that both hold."""
    of_poses, of_errors = between
    found = np.zeros((12 + of_errors.shape[0], 12 + of_errors.shape[1]))
    found[:12, :12], found[12:, 12:] = of_poses, of_errors
    return found + np.einsum("nki,nkj->ij", *rows) if rows else found


def _for_known_sizes(result: Calibration, rows: Array) -> Array:
    """(N, N) covariance by the result's own rows, for the sizes of its errors that its noise and priors stand for."""
    prior = np.diag(_errors_of(result)[1] ** -2.0)
    return np.asarray(np.linalg.inv(_information((_of_prior(result, result), prior), [rows, rows])))


def _by_sizes(parts: list[Array], share: float) -> Array:
    """(12, 12) what sizes that were estimated add: of the new result, and of the old one less the data of both.

    ``share`` of the old poses is in the new result: estimates of overlapping data have the covariance share * V_new.
    """
    V_old, V_new = map(positive, parts)
    return positive(V_old + (1.0 - 2.0 * share) * V_new)


def positive(S: Array) -> Array:
    """Return a symmetric matrix without what is below 0."""
    values, vectors = np.linalg.eigh(0.5 * (S + S.T))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _is_more_than_its_posterior(result: Calibration) -> bool:
    """Return whether its poses share errors that the posterior does not hold: of a clock, or of a covariance of all."""
    joint = any(S is not None and joint_of(S) is None and is_joint(S) for S in _sides_of(result))
    return joint or result.covariance_kind != "model" or getattr(result.counted, "timing", None) is not None


def _sides_of(result: Calibration) -> tuple[Any, Any]:
    """Return the covariances of robot and camera poses, None for what there is none of."""
    return getattr(result.noise, "robot", None), getattr(result.noise, "camera", None)


def _rows_of(result: Calibration) -> Array:
    """(n, 6, N) derivatives of the result's own poses by its errors, whitened by noise and weights."""
    poses, fitted = cast(PosePairs, result.counted), result.kinematics
    joint = [joint_of(S) for S in _sides_of(result)]
    own = [S if of is None else np.asarray(of.own) for S, of in zip(_sides_of(result), joint, strict=True)]
    joints = None if fitted is None else fitted.joints
    evidence = evidence_of_poses(result, poses, PoseNoise(*own), joints)
    weight = np.ones(poses.n)
    if result.table is not None:
        weight = np.asarray(result.table.weight)[result.table.counted]
    sides = list(zip(evidence.linear.sides, own, joint, strict=True))
    S = sum((D @ of @ D.mT for D, of, _ in sides if of is not None), np.zeros((1, 6, 6)))
    B, (place, sd) = np.array(evidence.by_state), _errors_of(result)
    for D, _, of in sides:
        if of is not None:  # as the estimate itself had them
            there = [(k, j) for j, name in enumerate(_names_in(of)) for k in np.flatnonzero(place == name)]
            if there:
                k, j = np.array(there).T
                B[..., 12 + k] = D @ of.shared[..., j] / sd[k]
    return np.sqrt(weight)[:, None, None] * whiten(cholesky_of(S), B)


def _names_in(S: JointCovariance) -> list[str]:
    """Names of the columns of a covariance, as the posterior has them."""
    return [f"{INTRINSICS}: {j}" if name in ("", INTRINSICS) else name for j, name in enumerate(S.names)]


def _of_errors(old: Calibration, new: Calibration, common: list[tuple[int, int]], same: frozenset[str]) -> Array:
    """(q, q') of what was known beforehand of the errors of both."""
    names, sd = zip(*map(_errors_of, (old, new)), strict=True)
    of_poses = [{error.name: error for error in errors_of_poses(of)} for of in (old, new)]
    kept = np.array([owner_of(name) in same for name in names[0]], dtype=bool)
    correlation = (names[0][:, None] == names[1]) * kept[:, None].astype(float)
    for name in of_poses[0].keys() | of_poses[1].keys():
        i, j = (np.flatnonzero([group_of(one) == name for one in part]) for part in names)
        correlation[np.ix_(i, j)] = 0.0
        if name in of_poses[0] and name in of_poses[1] and owner_of(name) in same:
            first, second = (of[name] for of in of_poses)
            at = bound_to(new)
            assert at is not None
            scale = np.repeat([1.0, 1.0 / LENGTH_PER_RAD_M], 3)[:, None]
            F_old, F_new = ((scale * error.at(at)).reshape(6 * at.n, -1) for error in (first, second))
            correlation[np.ix_(i, j)] = (np.linalg.pinv(F_new) @ F_old).T
    i, j = (np.flatnonzero([group_of(name) == INTRINSICS for name in part]) for part in names)
    if i.size or j.size:
        correlation[np.ix_(i, j)] = _of_intrinsics(old, new, common) if CAMERA in same and len(i) == len(j) else 0.0
    return np.asarray(correlation / np.outer(*sd))


def _errors_of(result: Calibration) -> tuple[NDArray[np.str_], Array]:
    """Names (q,) of the errors of the posterior, and the standard deviations that they had beforehand."""
    assert result.posterior is not None
    prior = {error.name: error.prior_sd for error in result.shared}
    names = result.posterior.names
    return np.array(names, dtype=np.str_), np.array([prior.get(name, 1.0) for name in names])


def _of_intrinsics(old: Calibration, new: Calibration, common: list[tuple[int, int]]) -> Array:
    """Correlation of intrinsics: fixed and the same, or estimated again from pictures that both hold in part."""
    columns = []
    for of, index in zip((new, old), np.array(common, dtype=np.intp).reshape(-1, 2).T, strict=True):
        S = cast(JointCovariance, _sides_of(of)[1])
        lens = [group_of(name) in ("", INTRINSICS) for name in S.names]
        columns.append(S.shared[..., lens][index].reshape(6 * len(index), -1))
    F_new, F_old = columns
    if not common:
        return np.eye(F_new.shape[1])
    turn = np.linalg.lstsq(F_old, F_new, rcond=None)[0]  # of units: k = L_old z_old = L_new z_new
    share = 1.0 if np.abs(turn - np.eye(len(turn))).max() < FIXED else len(common) / len(old.counted or ())
    return np.asarray(share * turn)


def _of_prior(old: Calibration, new: Calibration) -> Array | float:
    """(12, 12) information of prior knowledge of X and W that both were given."""
    priors = [getattr(of.noise, "prior", None) for of in (old, new)]
    if priors[0] is None or priors[1] is None or priors[0].to_dict() != priors[1].to_dict():
        return 0.0
    return np.asarray(priors[0].information(12))
