r"""Diagnostics of the data of a fit: observability, influence, residual tests, systematic errors.

Model: the linearised `Fit`. Its residuals r (n rows of 6) have the covariance S, its unknowns x = (xi_X, xi_W) the
derivatives J and the covariance ``C = (J^T S^-1 J)^-1``; an error e of the residuals moves the estimate by
``-C J^T S^-1 e``. All statements are of first order in the errors; X in its parent frame (the gripper for
eye-in-hand, the base for eye-to-hand), rad and m inside, deg and mm where the name of a field says so.

*Leaving a row out.* With ``F F^T = (S^-1)_ii``, ``B_i = F^-1 (S^-1 J)_i``, ``e_i = F^-1 (S^-1 r)_i`` (for independent
rows their whitened J and r) X moves by the block of X of ``C B_i^T (I - B_i C B_i^T)^-1 e_i``, exactly so for the
linearised problem (R. D. Cook, Technometrics 1977, for rows of several numbers that may be correlated). The
information that row i brings to X alone is ``tr(C_XX^-1 C_X B_i^T B_i C_X^T) / 6``, C_X the rows of C that belong to X.

A shift d of X is stated "in standard deviations" as its length ``sqrt(d^T C_XX^-1 d)`` over all six directions.

*Errors that all rows share* (focal length, target scale, robot scale): the relative error s of a length that all rows
share adds ``k s`` to r. It moves X by ``-C J^T S^-1 k s``; as one more unknown it is estimated by ``s = k' . r' /
|k'|^2`` with the standard deviation ``1 / |k'|``, where k' is the whitened k minus the part that X and W explain (a
score test). The lengths are those of the poses as the fit corrects them, whose noise is independent of r. Columns of
errors that were declared are in S: the score of another error is in addition to theirs.

The tests of the residuals are in `residual_patterns`, the findings from all of it in `result`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc

from ...core.geometry.pose_numbers import principal_axes
from ...core.geometry.rotations import quaternions
from ...core.geometry.se3 import Array, skew
from ...core.levels import CONTRADICTED
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M
from ...core.rounding import TINY
from ...errors import InputError
from ...model.errors.error_estimate import IN_NOISE, NOT_DECLARED, ErrorEstimate
from ...model.errors.joint_covariance import joint_of
from ...model.errors.key import ErrorKey
from ...model.errors.keys import FOCAL_LENGTH, INTRINSICS, ROBOT_SCALE, TARGET_SCALE
from ...model.errors.models import Noise
from ...model.errors.square_roots import Factor, inverse_blocks, is_joint, pulled, whiten
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ..graph.constraint import covariances_of
from ..graph.gauss_helmert import Fit, corrected
from ..graph.shared_estimates import MIN_EXPLAINED_RATIO
from .residual_patterns import Autocorrelation, residual_tests
from .result import PROBED, UNKNOWN_FRAME, Diagnostics, Diversity, Influence, Spectrum

# A pose that sees the target this many times as far away as the median pose is in another unit.
OTHER_UNIT_RATIO = 10.0
# The relative error of a shared length whose effect on X is reported.
REPORTED_SCALE = 1e-3


def diagnose(fit: Fit, data: PosePairs | Motions, noise: Noise, correlation_estimated: bool = False) -> Diagnostics:
    """Diagnostics of one fit, in O(n) time and memory, O(n^3) and O(n^2) for a joint covariance.

    Parameters
    ----------
    fit : Fit
        Of `efficient` or `maximum_likelihood`, without leading axes.
    data : PosePairs or Motions
        What it was fitted to; timestamps give the order for the autocorrelation.
    noise : PoseNoise or PairNoise
        What it was fitted with.
    correlation_estimated : bool
        The noise holds a correlation of neighbouring poses that was estimated from these residuals: it is not tested.

    Raises
    ------
    InputError
        A fit of several problems at once, or data of another size.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> from uq_handeye.fit.graph.gauss_helmert import efficient
    >>> noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    >>> poses = uq.simulate(n_poses=20, noise=noise, seed=1)
    >>> found = diagnose(efficient(poses, noise), poses, noise)
    >>> found.item, found.frame, round(found.influence.effective_number)
    ('pose', 'gripper', 15)
    """
    if fit.covariance.ndim != 2:
        raise InputError(f"Expected the `fit` of one problem, got leading axes {fit.covariance.shape[:-2]}.")
    poses = data.poses
    n, on_poses = len(fit.residual), fit.W is not None
    count = poses.n if on_poses and poses is not None else len(data)
    if count != n:
        raise InputError(f"Expected `data` to be what was fitted, {n} rows, got {count}.")
    joint = is_joint(fit.S)
    factor = fit.weighted_factor
    stacked = np.concatenate([fit.linear.J, fit.residual[..., None]], axis=-1)
    white = whiten(factor, stacked)
    counted = float(n if fit.weights is None else fit.weights.sum())
    freedom = max(6 * counted - fit.covariance.shape[-1], 1.0)
    sigma_0 = float(np.sqrt(np.sum(white[..., -1] ** 2) / freedom))

    # Tests must not take the noise of the poses for a pattern: that of the corrected ones is independent of residuals.
    measured = (poses.robot, poses.camera) if on_poses and poses is not None else (data.A, data.B)  # type: ignore[union-attr]
    first, second = corrected(fit, noise, *measured)
    lengths = shared_lengths(first, second, data, poses, on_poses)
    tests = residual_tests(fit, poses if on_poses else None, second, correlation_estimated)
    frame = UNKNOWN_FRAME if poses is None else "base" if poses.setup == "eye-to-hand" else "gripper"
    counts = second if fit.weights is None else second[fit.weights > 0.5]  # one in another unit weighs nothing
    away = np.linalg.norm(counts[:, :3, 3], axis=-1)
    distance = float(np.sqrt(np.mean(away[away <= OTHER_UNIT_RATIO * np.median(away)] ** 2)))
    return Diagnostics(
        n=n,
        item="pose" if on_poses else "motion",
        sigma_0=sigma_0,
        spectrum=_spectrum(fit.covariance_X, frame, distance, on_poses),
        influence=_influence(fit.covariance, *_own_parts(white, factor, joint)),
        diversity=_diversity(measured[0], poses),
        autocorrelation=tests[0],
        normality=tests[1],
        regression=tests[2],
        probes=scale_errors(fit, lengths, max(1.0, sigma_0) * inflation(tests[0]), _covered(noise, poses)),
    )


def _covered(noise: Noise, poses: PosePairs | None) -> set[ErrorKey]:
    """Return those of `PROBED` that the noise holds: columns of it, or of all intrinsics."""
    joint = [joint_of(S) for S in covariances_of(noise)]
    found = {key for S in joint if S is not None for key in S.keys if key in PROBED}
    seen, camera = None if poses is None else poses.camera_calibration, covariances_of(noise)[1]
    by_views = joint[1] is not None and INTRINSICS in joint[1].keys
    by_corners = camera is not None and is_joint(camera) and seen is not None and "fx" in seen.estimated
    return found | {FOCAL_LENGTH} if by_views or by_corners else found


# ------------------------------------------------------------------------------------------- what X is known to


def _spectrum(S: Array, frame: str, distance: float, on_poses: bool) -> Spectrum:
    length, of = distance, "target" if on_poses else "motions"
    if not length > 0:
        length, of = 1.0, "nothing"
    units = np.array([length] * 3 + [1.0] * 3)
    (rotation, axes_r), (translation, axes_t), (joint, axes_j) = (
        principal_axes(block) for block in (S[:3, :3], S[3:, 3:], S * units[:, None] * units)
    )
    return Spectrum(
        frame, rotation * DEG_PER_RAD, axes_r, translation * MM_PER_M, axes_t, length, of, joint * MM_PER_M, axes_j,
        float(joint[0] / joint[-1]),
    )  # fmt: skip


def _own_parts(white: Array, factor: Factor, joint: bool) -> tuple[Array, Array]:
    """B (n, 6, p) and e (n, 6) of the module: each row given all others."""
    if not joint:
        return white[..., :-1], white[..., -1]
    parts = np.linalg.solve(np.linalg.cholesky(inverse_blocks(factor)), pulled(factor, white))
    return parts[..., :-1], parts[..., -1]


def _influence(C: Array, B: Array, e: Array) -> Influence:
    by_X = B @ C[:, :6]  # (n, 6, 6)
    to_unit = np.linalg.inv(np.linalg.cholesky(C[:6, :6]))  # of X
    share = np.sum((by_X @ to_unit.T) ** 2, axis=(1, 2))
    share = share / share.sum()
    values, vectors = np.linalg.eigh(np.eye(6) - B @ C @ B.mT)
    needed = values[:, 0] < 1e-9
    turned = (vectors.mT @ e[..., None])[..., 0]
    rotated = turned / np.where(needed[:, None], 1.0, values)
    p_value = np.where(needed, 1.0, chdtrc(6, np.sum(turned * rotated, axis=1)))
    shift = (by_X.mT @ (vectors @ rotated[..., None]))[..., 0]
    cook = np.sum((shift @ to_unit.T) ** 2, axis=1) / 6
    shift_sd = np.sqrt(6 * cook)
    shift[needed] = shift_sd[needed] = cook[needed] = np.inf
    return Influence(share, float(1.0 / np.sum(share**2)), shift, shift_sd, cook, p_value)


def _diversity(A: Array, poses: PosePairs | None) -> Diversity:
    if poses is None:
        u = quaternions(A[:, :3, :3])[:, :3]
        total = u.T @ u
    else:
        # u = vec(conj(q_j) q_i) is bilinear, u_a = q_j^T E_a q_i: the sum over all pairs is tr(Q E_a Q E_b^T).
        q = quaternions(poses.effective_robot[:, :3, :3])
        Q = q.T @ q
        total = np.einsum("apq,bpq->ab", Q @ _TURNS @ Q, _TURNS)
    values, axes = principal_axes(total / max(float(np.trace(total)), TINY))
    return Diversity(values**2, axes)


def _turns() -> Array:
    """E (3, 4, 4) for quaternions (x, y, z, w): ``w_j v_i - w_i v_j - v_j x v_i``."""
    E = np.zeros((3, 4, 4))
    E[:, :3, :3] = -skew(np.eye(3)).transpose(1, 0, 2)
    E[:, 3, :3] = np.eye(3)
    E[:, :3, 3] = -np.eye(3)
    return E


_TURNS = _turns()


# -------------------------------------------------------------------------------------- errors that all rows share


def inflation(found: Autocorrelation) -> float:
    """Factor on the standard deviations of the estimates below; 1 where no correlation was found."""
    if found.p_value is None or found.factor is None or found.p_value >= CONTRADICTED.probability:
        return 1.0
    return float(np.sqrt(max(found.factor, 1.0)))


def shared_lengths(
    first: Array, second: Array, data: PosePairs | Motions, poses: PosePairs | None, on_poses: bool
) -> dict[ErrorKey, tuple[int, Array] | None]:
    """Side and change of its translations (n, 3) for a relative error 1; None where it is not known.

    ``first`` and ``second`` are the poses (motions) of robot and camera, corrected by the fit.
    """
    depth: Array | None = None
    if on_poses:
        depth = second[:, :3, 3] * np.array([0.0, 0.0, 1.0])
    elif poses is not None and (pairs := getattr(data, "pairs", None)) is not None:
        along = poses.camera[:, :3, 3] * np.array([0.0, 0.0, 1.0])
        i, j = pairs.T
        depth = along[j] - (second[:, :3, :3] @ along[i, :, None])[..., 0]
    return {
        FOCAL_LENGTH: None if depth is None else (1, depth),  # the distances from camera to target
        TARGET_SCALE: (1, second[:, :3, 3]),
        ROBOT_SCALE: (0, first[:, :3, 3]),
    }


def scale_errors(
    fit: Fit,
    lengths: dict[ErrorKey, tuple[int, Array] | None],
    inflation: float,
    covered: Collection[ErrorKey] = (),
) -> tuple[ErrorEstimate, ...]:
    """Return the effect of each of the ``lengths`` for a size of `REPORTED_SCALE`, and what the residuals say of it.

    There is no effect where the change is not known. ``covered`` are those that the noise holds.
    """
    known = {key: value for key, value in lengths.items() if value is not None}
    changes = [(fit.linear.sides[side][..., 3:] @ change[..., None]) for side, change in known.values()]
    k = np.concatenate(changes, axis=-1)  # (n, 6, probes)
    score, response, left = fit.told(k)
    before, after = np.sum(whiten(fit.weighted_factor, k) ** 2, axis=(0, 1)), 1.0 - np.diag(left)
    to_unit = np.linalg.inv(np.linalg.cholesky(fit.covariance[:6, :6]))
    found = []
    for key, value in lengths.items():
        status = IN_NOISE if key in covered else NOT_DECLARED
        probe = ErrorEstimate(key, "robot" if key == ROBOT_SCALE else "camera", "", REPORTED_SCALE, status=status)
        if value is not None:
            m = list(known).index(key)
            effect = REPORTED_SCALE * response[:6, m]
            probe = replace(probe, effect=effect, share=float(np.sum((to_unit @ effect) ** 2)))
            if after[m] > max(1e-9 * before[m], MIN_EXPLAINED_RATIO * 3 * len(k)):
                estimate, sd = float(score[m] / after[m]), inflation / float(np.sqrt(after[m]))
                probe = replace(probe, alone=estimate, alone_sd=sd)
        found.append(probe)
    return tuple(found)
