r"""Restricted likelihood of the variance components that stand beside the covariance of the camera poses.

Model (`constraint`, on poses): the errors of the camera poses have the covariance Sigma_C, in general joint over the
poses; those of the robot are independent and isotropic, with the variances phi_1 of rotation (rad^2) and phi_2 of
translation (m^2), or have a covariance that is given. Sigma_C is known where the poses come from corners (T4b). By the
geometry of the views (T11, `CameraNoise`) it is ``phi_3 (blkdiag(own) + F_1 F_1^T) + F_0 F_0^T`` with the variance
phi_3 of the pixels one more unknown. With ``D_C``, ``D_G = [U_1, U_2]`` the derivatives of the residuals r by both, J
that by X and W,

    S(phi) = K + sum_k phi_k V_k,      V_1, V_2 = blkdiag(U_k U_k^T),   V_3 = D_C (blkdiag(own) + F_1 F_1^T) D_C^T

K what is known of both sides, and ``P = S^-1 - S^-1 J (J^T S^-1 J)^-1 J^T S^-1``, minus twice the restricted
log-likelihood, its derivatives and the expected information are (Patterson and Thompson 1971; Harville 1977)

    d = log|S| + log|J^T S^-1 J| + r^T P r,     dd/dphi_k = tr(P V_k) - r^T P V_k P r,     I_kl = tr(P V_k P V_l) / 2

V_k is block diagonal plus a few columns, so that ``tr(P V_k)`` needs the diagonal blocks of P and its product with the
columns only: O(n) for a `JointCovariance`.

References: H. Patterson, R. Thompson, Biometrika 58 (1971), doi:10.1093/biomet/58.3.545; D. Harville, J. Am. Stat.
Assoc. 72 (1977), doi:10.1080/01621459.1977.10480998.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..geometry.se3 import Array
from ..likelihood.constraint import Linearised, block_diagonal, residual_covariance
from ..likelihood.gauss_helmert import SINGULAR, inverse_information
from ..likelihood.reduced_rows import Reduced
from ..noise.camera_noise import CameraNoise
from ..noise.estimate import CAMERA_EXCESS
from ..noise.joint_covariance import JointCovariance
from ..noise.models import PoseNoise
from ..noise.square_roots import Covariance, cholesky_of, gram, inverse_blocks, log_determinant, pulled, whiten
from ..shared_errors.shared_error import add_columns

# Names and units of the components.
ROBOT_KINDS = (("robot rotation", "rad"), ("robot translation", "m"))
PIXEL_KIND = ("pixel noise", "px")
EXCESS_KIND = (CAMERA_EXCESS, "px")
# Relative step of the differences that give the information.
STEP = 1e-4


class AtVariances(NamedTuple):
    """Restricted likelihood at given variances (m,)."""

    deviance: float
    quadratic: Array  # (m,) q_k
    trace: Array  # (m,) t_k
    squares: float  # r^T P r
    step: Array  # (12,) generalised least squares, of X and W
    moved: float  # its length in standard deviations, squared


class VariancePart(NamedTuple):
    """A variance component, ``V = blkdiag(U U^T) + F F^T``."""

    kind: tuple[str, str]  # name and unit
    U: Array  # (n, 6, a)
    F: Array  # (n, 6, b)


@dataclass(frozen=True, eq=False)
class ComponentRows:
    """The linearised constraint, its m variance components, and the covariance that does not depend on them."""

    y: Array  # (n, 6, 13): J and r
    parts: tuple[VariancePart, ...]
    known: Covariance | None
    reduced: Reduced

    @classmethod
    def of(
        cls,
        linear: Linearised,
        camera: Any,
        robot: Any = None,
        columns: Mapping[str, JointCovariance] | None = None,
        reduced: Reduced | None = None,
        excess: JointCovariance | None = None,
    ) -> ComponentRows:
        """The robot's two variances, unless its covariance is given, and that of the pixels of a `CameraNoise`.

        ``columns`` are errors that all poses of a side share (`shared_columns`); ``excess`` of the camera, per
        pixel^2, is a component, too.
        """
        first, second = linear.sides
        reduced = Reduced(linear.J, None, None) if reduced is None else reduced
        y = np.concatenate([reduced.J, linear.r[..., None]], axis=-1)
        none = np.zeros((*y.shape[:-1], 0))
        parts = []
        if robot is None:
            parts += [
                VariancePart(kind, U, none)
                for kind, U in zip(ROBOT_KINDS, (first[..., :3], first[..., 3:]), strict=True)
            ]
        if isinstance(camera, CameraNoise):
            own, scaled = camera.scaled()
            parts.append(VariancePart(PIXEL_KIND, second @ np.linalg.cholesky(own), second @ scaled))
            fixed = camera.fixed()
            camera = JointCovariance(np.zeros_like(own), fixed) if fixed.shape[-1] else None
        elif excess is not None:
            parts.append(VariancePart(EXCESS_KIND, second @ np.linalg.cholesky(excess.own), second @ excess.shared))
        columns = columns or {}
        robot, camera = add_columns(robot, columns.get("robot")), add_columns(camera, columns.get("camera"))
        given = robot is not None or camera is not None
        known = residual_covariance(linear.sides, PoseNoise(robot, camera)) if given else None
        return cls(y, tuple(parts), known, reduced)

    def sums(self, white: Array) -> Array:
        """``[J, r]^T S^-1 [J, r]`` with what the prior of X and W adds."""
        return gram(white) if self.reduced.known is None else gram(white) + self.reduced.known

    def covariance(self, variances: Array) -> Covariance:
        """S."""
        blocks = np.asarray(sum(v * part.U @ part.U.mT for v, part in zip(variances, self.parts, strict=True)))
        shared = [np.sqrt(v) * part.F for v, part in zip(variances, self.parts, strict=True) if part.F.shape[-1]]
        added = JointCovariance(blocks, np.concatenate(shared, axis=-1)) if shared else blocks
        S = self.known
        if S is None:
            return added
        if isinstance(S, JointCovariance):
            return S.plus(added)
        if S.ndim == 3:
            return added.plus(S) if isinstance(added, JointCovariance) else S + added
        return S + (np.asarray(added) if isinstance(added, JointCovariance) else block_diagonal(added))

    def at(self, variances: Array) -> AtVariances:
        factor = cholesky_of(self.covariance(variances))
        white = whiten(factor, self.y)
        sums = self.sums(white)
        information = sums[:-1, :-1]
        C = inverse_information(information)
        step = -C @ sums[:-1, -1]
        white[..., -1] += white[..., :-1] @ step
        back = pulled(factor, white)
        Q, g = back[..., :-1], back[..., -1]
        P = inverse_blocks(factor) - Q @ C @ Q.mT
        quadratic, trace = np.empty(len(self.parts)), np.empty(len(self.parts))
        for k, (_, U, F) in enumerate(self.parts):
            quadratic[k] = np.sum((U.mT @ g[..., None]) ** 2)
            trace[k] = np.sum((P @ U) * U)
            if F.shape[-1]:
                seen = whiten(factor, F)
                mixed = np.einsum("nij,nik->jk", white[..., :-1], seen)
                quadratic[k] += np.sum(np.einsum("nij,ni->j", F, g) ** 2)
                trace[k] += np.sum(seen**2) - np.sum(mixed * (C @ mixed))
        squares = float(np.sum(white[..., -1] ** 2))
        if self.reduced.known is not None:
            ahead = np.append(step, 1.0)
            squares += float(ahead @ self.reduced.known @ ahead)
        deviance = float(log_determinant(factor)) + float(np.linalg.slogdet(information)[1]) + squares
        return AtVariances(deviance, quadratic, trace, squares, step, float(step @ information @ step))

    def information(self, variances: Array, at: AtVariances) -> Array:
        """I (m, m): ``d t_k / d phi_l = -2 I_kl``, by differences."""
        m = len(variances)
        found = np.empty((m, m))
        for k in range(m):
            h = STEP * (variances[k] + 3 * len(self.y) / at.trace[k])
            ends = variances + h * np.eye(m)[k], variances - min(h, variances[k]) * np.eye(m)[k]
            found[k] = -0.5 * (self.at(ends[0]).trace - self.at(ends[1]).trace) / (ends[0] - ends[1])[k]
        return 0.5 * (found + found.T)

    def spread_of_X(self, variances: Array, covariance: Array) -> float:
        """A of `goodness_of_fit`: how uncertain Sigma_X is, for the covariance (m, m) of the variances."""
        factor = cholesky_of(self.covariance(variances))
        white = whiten(factor, self.y)
        C = inverse_information(self.sums(white)[:-1, :-1])
        by_X = np.eye(12)[:6] if self.reduced.basis is None else self.reduced.basis[:6]
        pull = pulled(factor, white[..., :-1]) @ C @ by_X.T
        derivatives = []
        for _, U, F in self.parts:
            own = U.mT @ pull
            of_all = np.einsum("nij,nik->jk", F, pull)
            derivatives.append(np.einsum("nij,nik->jk", own, own) + of_all.T @ of_all)
        relative = np.linalg.pinv(by_X @ C @ by_X.T, rcond=SINGULAR, hermitian=True) @ np.array(derivatives)
        return float(np.einsum("kl,kij,lji->", covariance, relative, relative))
