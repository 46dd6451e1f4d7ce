r"""The camera that belongs to X: its intrinsics by pictures and robot together, and given ones tested by both.

The calibration of a camera from its pictures gives intrinsics ``k`` with the covariance of T4b. The fit of X holds
their errors as errors that all camera poses share, ``xi_i = G_i T z`` with z standard normal: by its posterior the
intrinsics are ``k - T z``. X belongs to these corrected intrinsics. A user who places points with X and the
uncorrected ones adds their difference.

*Given numbers* (`model.camera.given_intrinsics`) are tested by both data. Camera poses follow from the numbers given by

    d xi_i / d k_0 = G_i Sigma_k e_j / sd_j^2         of a number with a standard deviation
    d xi_i / d k_0 = G_i e_j - G_i Sigma_k H e_j      of a fixed one, H the information of the pictures

because what is estimated follows what is given. With these columns f and the residuals r of the fit, the information
``f^T M f`` and the gradient ``-f^T M r`` (`Fit.told`) add to those of the pictures.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import chdtrc, ndtri

from ..core.geometry.se3 import Array, difference
from ..core.presentation.numbers import short
from ..core.rounding import SOLUTION_ROUNDING
from ..errors import InputError
from ..findings import Finding, Severity
from ..fit.graph.gauss_helmert import Fit, corrected
from ..fit.graph.posterior import Posterior
from ..model.camera.adjustment.bundle import Sight, poses_only
from ..model.camera.adjustment.linearised import linearised
from ..model.camera.calibrated import Calibrated
from ..model.camera.given_intrinsics import CAUTION_SD, GivenTest, finding_of, given_test
from ..model.camera.result import CameraCalibration
from ..model.errors.joint_covariance import joint_of
from ..model.errors.keys import INTRINSICS
from ..model.errors.models import Noise
from ..model.poses.pose_pairs import PosePairs
from .analysis import Analysis
from .estimated import Estimated

# Corners are linearised again where that moves the camera poses by more than this, in standard deviations of X: what
# intrinsics do is common to all poses, and moves X by up to ten times as much.
MAX_CORNER_MOVE_SD = 0.01
# Corners know the rotation of their pose to some mrad: an estimate that turns it by more contradicts them.
MAX_CORNER_TURN_RAD = 0.1


def _moves(seen: Calibrated, noise: Noise | None, posterior: Posterior) -> tuple[Array, list[int]] | None:
    """Return T (p, q) of all parameters of the camera, and which errors of the posterior its columns belong to."""
    index = [k for k, key in enumerate(posterior.keys) if key.error == INTRINSICS]
    S = joint_of(getattr(noise, "camera", None))
    if not index or S is None:
        return None
    shared = S.shared[..., [key in (None, INTRINSICS) for key in S.keys]]
    if shared.shape[-1] != len(index):
        return None
    T = np.zeros((len(seen.bundle.free), len(index)))
    try:
        T[seen.bundle.free] = seen.errors_of_parameters(shared)
    except InputError:
        return None
    return T, index


def corrected_camera(result: Estimated) -> CameraCalibration | None:
    """Return the camera of a result with the intrinsics that X belongs to, and the camera poses by these.

    None where the camera poses came without corners. Intrinsics that are all given as exact stay as they are.
    """
    data = result.data
    seen: CameraCalibration | None = getattr(data, "camera_calibration", None)
    counted = getattr(result.counted, "camera_calibration", None)
    if seen is None or counted is None or result.posterior is None:
        return seen
    found = _moves(counted, result.noise, result.posterior)
    if found is None:
        return seen
    (T, index), posterior, bundle = found, result.posterior, seen.bundle
    at = [posterior.p + k for k in index]
    covariance = T @ posterior.covariance[np.ix_(at, at)] @ T.T
    moved = replace(bundle, parameters=bundle.parameters - T @ posterior.estimate[index])
    fitted = poses_only(moved, seen.corners, bundle.poses, bundle.used, bundle.weights)
    counts = bundle.used * np.sqrt(bundle.weights)[seen.corners.picture]
    _, A, B = Sight.of(bundle.model, bundle.shape, seen.corners, counts).rows(moved.parameters, fitted.poses)
    G = np.asarray(-np.linalg.solve(B.mT @ B, B.mT @ A), dtype=np.float64)
    G[..., ~bundle.free] = 0.0
    corrected = replace(
        fitted,
        unknowns=bundle.unknowns,
        covariance=0.5 * (covariance + covariance.T),
        by_parameters=G,
        pixel_noise=bundle.pixel_noise,
    )
    return replace(seen, bundle=corrected, findings=(*seen.findings, Finding("camera.corrected_by_robot", "note")))


def corners_at_estimate(result: Estimated) -> CameraCalibration | None:
    """Return the camera of a result with its poses linearised at the intrinsics and poses of the estimate.

    None without corners or posterior, and where it makes no difference (`MAX_CORNER_MOVE_SD`).
    """
    analysis, covariance = result.analysis, result.covariance
    data = analysis.data if isinstance(analysis, Analysis) else None
    seen = data.camera_calibration if isinstance(data, PosePairs) else None
    if seen is None or covariance is None or (posterior := result.posterior) is None:
        return None
    assert isinstance(analysis, Analysis) and isinstance(data, PosePairs)
    parameters = np.array(seen.bundle.parameters)
    if (found := _moves(seen, analysis.noise, posterior)) is not None:
        parameters -= found[0] @ posterior.estimate[found[1]]
    _, poses = corrected(analysis.fit, analysis.noise, data.robot, data.camera)
    try:
        bundle = linearised(seen.bundle, seen.corners, parameters, poses)
    except np.linalg.LinAlgError:  # of files that do not belong together: the board lies behind the camera
        return None
    moves = difference(bundle.poses, seen.poses)
    if np.abs(moves[..., :3]).max() > MAX_CORNER_TURN_RAD or is_negligible(moves, covariance, MAX_CORNER_MOVE_SD):
        return None
    return seen.with_bundle(bundle)


def is_negligible(moves: Array, covariance: Array, limit: float) -> bool:
    """Return whether moves (n, 6) of poses are below ``limit`` standard deviations of X, of covariance (6, 6)."""
    of_poses = [float(np.sqrt(np.mean(np.sum(part**2, axis=-1)))) for part in (moves[:, :3], moves[:, 3:])]
    of_X = [float(np.sqrt(np.trace(covariance[k : k + 3, k : k + 3]))) for k in (0, 3)]
    return all(move <= limit * sd for move, sd in zip(of_poses, of_X, strict=True))


def intrinsics_words(result: Estimated) -> str | None:
    """Return the intrinsics that X belongs to in one sentence; None where the camera poses came without corners."""
    seen = corrected_camera(result)
    if seen is None:
        return None
    numbers = ", ".join(f"{name} {short(value)}" for name, value in seen.intrinsics.items())
    how = "as corrected by the robot poses" if seen.estimated else "as given"
    width, height = seen.image_size
    return (
        f"X belongs to the camera model {seen.model} of pictures of {width} x {height} pixels, the first one's centre "
        f"at 0, {how}: {numbers}."
    )


def moved_intrinsics(seen: Calibrated | None, noise: Noise, posterior: Posterior) -> list[Finding]:
    """Return by how much robot and pictures together move the intrinsics of the pictures; a caution from 3 sigma on."""
    found = None if seen is None else _moves(seen, noise, posterior)
    if seen is None or found is None:
        return []
    T, index = found
    T = T[: len(seen.bundle.model.names)]
    at = [posterior.p + k for k in index]
    z, told = posterior.estimate[index], np.eye(len(index)) - posterior.covariance[np.ix_(at, at)]
    values, vectors = np.linalg.eigh(0.5 * (told + told.T))
    kept = values > SOLUTION_ROUNDING
    if not kept.any():
        return []
    chi2 = float(np.sum((vectors.T @ z)[kept] ** 2 / values[kept]))
    sd = np.sqrt(np.maximum(np.diag(T @ told @ T.T), 0.0))
    shift, known = -T @ z, np.sqrt(np.maximum(np.diag(T @ posterior.covariance[np.ix_(at, at)] @ T.T), 0.0))
    numbers = [
        {"name": name, "before": float(before), "after": float(before + d), "std": float(s), "sigma": float(d / of)}
        for name, before, d, s, of in zip(
            seen.bundle.model.names, seen.bundle.intrinsics, shift, known, sd, strict=True
        )
        if of > 0
    ]  # fmt: skip
    p_value = float(chdtrc(int(kept.sum()), chi2))
    sigma = float(-ndtri(0.5 * p_value)) if p_value > 1e-300 else float(np.sqrt(chi2))
    severity: Severity = "caution" if sigma >= CAUTION_SD else "note"
    return [Finding("calibration.intrinsics_moved", severity, {"numbers_moved": numbers, "sigma": sigma})]


def given_by_robot(seen: Calibrated | None, fit: Fit) -> list[Finding]:
    """Return a finding if pictures and robot poses together contradict the intrinsics that were given."""
    if seen is None or seen.given is None or (test := given_test_with_robot(seen, fit)) is None:
        return []
    finding = finding_of(
        test, seen.image_size, seen.bundle.model.name, seen.given.exact, "pictures together with the robot poses"
    )
    return [finding] if finding.severity != "note" else []


def given_test_with_robot(seen: Calibrated, fit: Fit) -> GivenTest | None:
    """Test given intrinsics by pictures and robot poses; None: they say nothing, or the fit is of other poses."""
    if seen.given is None or fit.W is None or fit.residual.ndim != 2:
        return None
    test = given_test(seen.bundle, seen.corners, seen.given.values)
    if test is None or len(fit.residual) != seen.corners.n:
        return None
    told = fit.told(fit.linear.sides[1] @ _columns_of_given(seen, test.names))
    return test.with_more(np.eye(len(test.names)) - told.left, -told.z)


def _columns_of_given(seen: Calibrated, names: tuple[str, ...]) -> Array:
    """(n, 6, m) derivatives of the camera poses by the numbers that were given; see the module."""
    assert seen.given is not None
    bundle, corners = seen.bundle, seen.corners
    counts = bundle.used * np.sqrt(bundle.weights)[corners.picture]
    _, A, B = Sight.of(bundle.model, bundle.shape, corners, counts).rows(bundle.parameters, bundle.poses)
    G = -np.linalg.solve(B.mT @ B, B.mT @ A)
    E = (A + B @ G) / bundle.pixel_noise
    follows = bundle.covariance @ np.einsum("nij,nik->jk", E, E)  # Sigma_k H, 0 where nothing is estimated
    columns = []
    for name in names:
        j, sd = bundle.model.names.index(name), seen.given.values[name][1]
        columns.append(G @ bundle.covariance[:, j] / sd**2 if sd > 0 else G[..., j] - G @ follows[:, j])
    return np.stack(columns, axis=-1)
