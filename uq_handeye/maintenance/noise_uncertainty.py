r"""Dependence of the covariance of new residuals on the variances that the calibration estimated.

Sigma = by_state P by_state^T + own noise is linear in the variances phi once the weights of the estimate are what they
were: with the gain K (12 + q, 6n) of the errors s of the estimates by the residuals of the calibration's own poses, and
``V_k = blkdiag(U_k U_k^T)`` what component k brings to a pose's residual,

    dP / dphi_k = K V_k K^T,        d Sigma / dphi_k = by_state (K V_k K^T) by_state^T + blkdiag(U_k U_k^T)

with the U_k of the new poses in the last term.

K of X and W is ``-C J^T S^-1``; of a shared error, ``e - estimate`` with ``e = sd z`` and the column f, ``-sd f^T P``,
``P = S^-1 - S^-1 J C J^T S^-1`` (`likelihood.shared_estimates`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ..evidence.new_poses import PoseEvidence
from ..evidence.state import Calibrated, joint_posterior_of, refitted
from ..geometry.se3 import Array
from ..likelihood.gauss_helmert import Fit
from ..noise.camera_noise import INTRINSICS
from ..noise.estimate import CAMERA_EXCESS, NoiseEstimate
from ..noise.joint_covariance import JointCovariance
from ..noise.models import PoseNoise, marginals
from ..noise.square_roots import LEAST_WEIGHT, pulled, whiten
from .reference import PredictiveReference

# Components that `NoiseEstimate.variances` are of where it does not name them.
_PLAIN = ("robot rotation", "camera rotation", "translation")
_PARTS = {
    "robot rotation": (0, slice(0, 3)),
    "robot translation": (0, slice(3, 6)),
    "camera rotation": (1, slice(0, 3)),
    "camera translation": (1, slice(3, 6)),
    "translation": (1, slice(3, 6)),
}


class Estimated(Calibrated, Protocol):
    """Interface of a calibration whose noise may have been estimated."""

    @property
    def noise_estimate(self) -> NoiseEstimate | None: ...


def reference_of_poses(result: Estimated, evidence: PoseEvidence) -> PredictiveReference:
    """Return the distribution of d^2 of new poses if nothing has changed."""
    estimate = result.noise_estimate
    if estimate is None or not estimate.covariance.any():
        return PredictiveReference.given(evidence.dof)
    derivatives = noise_derivatives(result, estimate, evidence)
    return PredictiveReference.estimated(derivatives, np.asarray(estimate.covariance))


def noise_derivatives(result: Estimated, estimate: NoiseEstimate, evidence: PoseEvidence) -> list[Array]:
    """``L^-1 (d Sigma / d phi_k) L^-T`` (6m, 6m) by each of the variances of the estimate."""
    names = component_names(estimate)
    before = refitted(result)
    gain = None if before is None else _gain(result, before)
    found = []
    for name, variance in zip(names, estimate.variances.tolist(), strict=True):
        white = _whitened_blocks(evidence, _new_part(name, result, evidence, variance))
        derivative = white @ white.T
        if before is not None and gain is not None:
            U = _old_part(name, result, before, variance)
            by_noise = np.einsum("snr,nrk->snk", gain, U).reshape(len(gain), -1)
            moved = evidence.whitened(evidence.by_state @ by_noise)
            derivative = derivative + moved @ moved.T
        found.append(derivative)
    return found


def component_names(estimate: NoiseEstimate) -> tuple[str, ...]:
    """Names of the components that the variances are of."""
    if estimate.names:
        return estimate.names
    of = tuple(part.name for part in estimate.components)
    free = [part.name for part in estimate.components if not part.is_given]
    beside = estimate.camera_known or estimate.by_geometry or CAMERA_EXCESS in of
    if not beside and len(estimate.variances) == 3:
        return _PLAIN
    return tuple(free[: len(estimate.variances)]) if len(free) >= len(estimate.variances) else _PLAIN


def _new_part(name: str, result: Estimated, evidence: PoseEvidence, variance: float) -> Array:
    """U (m, 6, a) of a component at the new poses."""
    return _part(name, evidence.linear.sides, result, variance, None)


def _old_part(name: str, result: Estimated, before: Fit, variance: float) -> Array:
    """U (n, 6, a) of a component at the poses of the calibration; a pose of weight w counts as w poses."""
    U = _part(name, before.linear.sides, result, variance, before)
    if before.weights is not None:
        U = U / np.sqrt(np.maximum(before.weights, LEAST_WEIGHT))[:, None, None]
        U = U * (np.asarray(before.weights) > 0)[:, None, None]
    return U


def _part(name: str, sides: Sequence[Array], result: Estimated, variance: float, before: Fit | None) -> Array:
    if name in _PARTS:
        side, part = _PARTS[name]
        return np.asarray(sides[side][..., part])
    fitted = result.kinematics
    if fitted is not None and name not in ("pixel noise", CAMERA_EXCESS):  # of the joints
        J = fitted.chain.jacobian(fitted.joints, fitted.e)
        J = J if before is not None else np.broadcast_to(_root(np.mean(J @ J.mT, axis=0)), (len(sides[0]), 6, 6))
        return np.asarray(sides[0] @ J)
    # Pixels: the camera's own covariance in proportion.
    assert isinstance(result.noise, PoseNoise)
    S = result.noise.camera
    own = np.zeros((6, 6)) if S is None else np.asarray(S.own if isinstance(S, JointCovariance) else marginals(S))
    own = own.reshape(-1, 6, 6)
    if before is None or len(own) != len(sides[1]):
        own = np.broadcast_to(own.mean(axis=0), (len(sides[1]), 6, 6))
    return np.asarray(sides[1] @ _root(own) / np.sqrt(variance if variance > 0 else 1.0))


def _root(S: Array) -> Array:
    values, vectors = np.linalg.eigh(S)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])


def _whitened_blocks(evidence: PoseEvidence, U: Array) -> Array:
    """``L^-1 blkdiag(U)`` (6m, m a)."""
    m, k, a = U.shape
    columns = np.zeros((m, k, m, a))
    index = np.arange(m)
    columns[index, :, index] = U
    return evidence.whitened(columns.reshape(m, k, m * a))


def _gain(result: Estimated, before: Fit) -> Array:
    """K (12 + q, n, 6) of the errors of the estimates by the residuals of the calibration's poses."""
    posterior = joint_posterior_of(result)
    assert isinstance(result.noise, PoseNoise)
    factor, J, C = before.weighted_factor, before.linear.J, before.covariance
    back = pulled(factor, whiten(factor, J))  # S^-1 J (n, 6, 12)
    gain = np.zeros((12 + len(posterior.names), *J.shape[:2]))
    gain[:12] = -np.einsum("ij,nrj->inr", C, back)
    named: dict[str, Array] = {}
    for side, (S, D) in enumerate(zip((result.noise.robot, result.noise.camera), before.linear.sides, strict=True)):
        if isinstance(S, JointCovariance):
            for j, name in enumerate(S.names):
                name = f"{INTRINSICS}: {j}" if side == 1 and name in ("", INTRINSICS) else name
                named[name] = (D @ S.shared[..., j, None])[..., 0]
    sd = {error.name: error.prior_sd for error in result.shared}
    for k, name in enumerate(posterior.names):
        if name in named:
            f = named[name]
            own = pulled(factor, whiten(factor, f[..., None]))[..., 0]
            across = np.einsum("nr,nrj->j", f, back) @ C
            gain[12 + k] = -sd.get(name, 1.0) * (own - np.einsum("nrj,j->nr", back, across))
    return gain
