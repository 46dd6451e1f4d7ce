r"""Directions of (X, W) that the data leave open: robots that cannot rotate about two axes (T14).

I (p, p) is the information about the unknowns (xi_X, xi_W). Along an open direction u of exact data ``u^T I u = 0``:
parallel axes leave the translation of X along the axis open together with W's, pure translations all of X's translation
with W's. Measured axes are never parallel: noise tilts them, so that I states a finite and wrong standard deviation.
The information by noise alone is, with ``dJ`` the first-order change of the derivatives J by errors of the poses,

    N = sum_i E[dJ_i^T S_0i^-1 dJ_i],    dJ = [[theta]x, [theta]x] J_X + [[0, 0], [-[f]x R_G, 0]]

theta the error of R_G and f that of ``R_G R_X t_C``, with the remaining covariance of the poses at which J was taken:
all of it at measured poses, ``Cov z - Cov(z, r) S^-1 Cov(r, z)``, ``z = (theta, f)``, at those that the fit
corrected. The split of estimated noise between robot and camera is uncertain, and the errors of the robot tilt its
axes, whatever share the split gives them: there the covariance of theta is that of the rotation of r, the
noise of both. Along a direction of degenerate motions ``u^T I u`` is about ``u^T N u`` (as a mean of squares), along
one that the data determine it is many times that. Both are compared with ``S_0 = diag(s_theta^2 I, s_tau^2 I)``, the
mean variances of the rotation and the translation of each residual: where rotation noise times a lever exceeds the
translation noise, S has nearly exact combinations, and with them I is the noise's, whatever the motions. A direction is
open where, with ``I_0 = sum J^T S_0^-1 J`` and the prior of X and W,

    u^T I_0 u  <  SIGNAL_RATIO (u^T N u) + |theta_X|^2 / MAX_ROTATION_SD_RAD^2

The second term is there as a rotation with a larger standard deviation than MAX_ROTATION_SD_RAD has no first-order
covariance.

*Units.* Directions are compared in units of the rig: an angle times ``lever``, the root mean square distance of camera
and target, against a length. A step does not move along open directions: X and W stay at the representative nearest
to the start. The covariance is that of the unknowns under this constraint, ``Q (Q^T I Q)^-1 Q^T`` with Q a basis of the
other directions, and so that of every function of them that the open directions do not change.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from ...core.files.records import Record
from ...core.geometry.se3 import Array, skew
from ...core.rounding import FIT_ROUNDING, SOLUTION_ROUNDING
from ...errors import DegenerateMotionError, InputError
from ...model.errors.models import Noise
from ...model.errors.square_roots import Covariance, cholesky_of, gram, marginals, weighed_blocks, whiten
from .constraint import Constraint, Linearised, Unknowns, covariances_of, residual_covariance

# A direction is determined if the information on it is above this many times that of noise alone. Along degenerate
# motions of n poses their ratio is about chi-square with 2 n - 2 degrees of freedom over 2 n: above 9 once in 10^14
# cases for n = 3, never for more.
SIGNAL_RATIO = 9.0
# A rotation whose standard deviation is larger than this (rad) has no covariance of first order.
MAX_ROTATION_SD_RAD = np.radians(20.0)
# Where the smallest eigenvalue of the information is above this many times what noise could make, no direction can be
# open, and none is computed.
CLEAR_SIGNAL_RATIO = 2e3
# A part of an open direction below this, in units of the rig, counts as 0, because the axes of the robot are themselves
# measured.
MIN_OPEN_PART = 0.02
# A component of an open direction counts as 0 if it is smaller than this many of its standard deviations.
RESOLVED_SD = 4.5


@dataclass(frozen=True, eq=False)
class OpenDirections(Record):
    """Directions of (X, W) that data and prior leave open.

    ``basis`` (k, 12): errors (theta_X, tau_X, theta_W, tau_W) in rad and m along which X and W move without a trace in
    the residuals, of length 1 and at right angles to each other in units of the rig (theta times lever); of motions
    without poses 0 for W. ``lever``: metres.
    """

    _where: ClassVar[str] = "open"

    basis: Annotated[Array, "k", 12]
    lever: float

    @property
    def of_X(self) -> Array:
        """(j, 6): what of X alone is open, likewise orthonormal; j < k where W alone moves."""
        return self._part(slice(0, 6))

    @property
    def of_W(self) -> Array:
        """(j, 6): what of W alone is open."""
        return self._part(slice(6, 12))

    def _part(self, part: slice) -> Array:
        rig = rig_units(np.asarray(self.lever), 6)
        U = self.basis[:, part] * rig
        return open_basis(U.T @ U, rig)

    def single(self) -> Array:
        """The directions (k, 12) one by one: each with as few components as it may, its largest one 1 or in m 1."""
        rig = rig_units(np.asarray(self.lever), 12)
        U = self.basis * rig
        pivots = qr(U, mode="r", pivoting=True)[1][: len(U)]
        alone = np.linalg.solve(U[:, pivots].T, U).reshape(U.shape) if len(U) else U
        return np.asarray(alone / rig)

    def _possible(self) -> OpenDirections:
        U = self.basis * rig_units(np.asarray(self.lever), 12)
        if not self.lever > 0 or not np.allclose(U @ U.T, np.eye(len(U)), atol=1e-6):
            raise InputError("Expected open directions that are orthonormal in units of the rig, with their lever.")
        return self


_E = skew(np.eye(3))  # (3, 3, 3): [e_a]x


class Solved(NamedTuple):
    """The inverse of the information, and what is open."""

    covariance: Array  # (..., p, p)
    open: Array | None  # (..., p, p): projector onto the open directions, in units of the rig; None: nothing is open


def solve_information(
    information: Array,
    linear: Linearised,
    constraint: Constraint,
    noise: Noise,
    S: Covariance,
    weights: Array | None,
    corrected: bool,
) -> Solved:
    """The covariance of the unknowns on the directions that are not open; see the module.

    ``S`` is the covariance of the residuals without robust ``weights`` (..., n); ``corrected``: J was taken at poses as
    the fit corrected them. Raises `DegenerateMotionError` where nothing of X is determined.
    """
    diagonal = np.diagonal(information, axis1=-2, axis2=-1)
    unit = _unit_factors(diagonal)
    scale = unit[..., :, None] * unit[..., None, :]
    values, vectors = np.linalg.eigh(information * scale)
    lever = lever_of(constraint)
    singular = values[..., 0] <= FIT_ROUNDING
    suspicious = _suspicious(values[..., 0], diagonal, noise, lever)
    if suspicious.any():  # several axes leave nothing open, however large the noise
        suspicious &= constraint.one_axis
    looked = singular | suspicious
    if not looked.any():
        return Solved(_inverted(values, vectors, scale), None)
    p = information.shape[-1]
    weak = np.zeros_like(information)
    tilts = tilts_of(linear, constraint, noise, S, weights, corrected)
    weak[..., :6, :6] = tilts.information
    rough = tilts.rough_information + (0.0 if noise.prior is None else noise.prior.information(p))
    diagonal = np.diagonal(rough, axis1=-2, axis2=-1)
    unit = _unit_factors(diagonal)
    own = unit[..., :, None] * unit[..., None, :]
    some = np.arange(p)
    weak[..., some, some] += FIT_ROUNDING * np.maximum(diagonal, 1e-12 * diagonal.max(axis=-1, keepdims=True))
    weak[..., some[:3], some[:3]] += 1.0 / (SIGNAL_RATIO * MAX_ROTATION_SD_RAD**2)
    root = np.linalg.cholesky((rough + weak) * own)
    half = np.linalg.solve(root, weak * own)
    share, vectors_of_weak = np.linalg.eigh(np.linalg.solve(root, half.mT))
    count = np.where(looked, (share > 1.0 / (1.0 + SIGNAL_RATIO)).sum(axis=-1), 0)
    if not count.any():
        return Solved(_inverted(values, vectors, scale), None)
    directions = unit[..., None] * np.linalg.solve(root.mT, vectors_of_weak[..., ::-1])  # the most open first
    rig = np.broadcast_to(rig_units(lever, p), unit.shape)
    covariance, projector = np.empty_like(information), np.zeros_like(information)
    for k in np.ndindex(count.shape):
        if count[k] == 0:
            covariance[k] = _inverted(values[k], vectors[k], scale[k])
            continue
        exact = _without_noise(rig[k][:, None] * directions[k][:, : count[k]], rig[k], rough[k], tilts[k])
        basis = np.linalg.qr(exact, mode="complete")[0]
        opened, closed = basis[:, : count[k]], basis[:, count[k] :] / rig[k][:, None]
        projector[k] = opened @ opened.T
        covariance[k] = _of_closed(closed, information[k])
        if len(open_basis(projector[k][:6, :6], rig[k][:6])) == 6:
            raise DegenerateMotionError(
                "The data determine nothing of X: the poses (motions) are the same within their noise, or rotate so "
                "little that any X fits. Move the robot.",
                np.eye(6),
            )
    return Solved(0.5 * (covariance + covariance.mT), projector)


class Step(NamedTuple):
    """A step of Gauss-Newton (..., p), along what is not open, with the normal equations that it solves."""

    step: Array
    information: Array  # (..., p, p), with that of the prior
    covariance: Array
    open: Array | None


def step_from(constraint: Constraint, noise: Noise, at: Unknowns) -> Step:
    """Return the step from the unknowns, at the rows of the constraint as they are."""
    linear = constraint.linearise(at, constraint.first, constraint.second)
    S = residual_covariance(linear.sides, noise)
    sums = gram(whiten(cholesky_of(S), np.concatenate([linear.J, linear.r[..., None]], axis=-1)))
    information, gradient = beside_prior(sums[..., :-1, :-1], sums[..., :-1, -1], noise, at)
    covariance, opened = solve_information(information, linear, constraint, noise, S, None, False)
    return Step(-(covariance @ gradient[..., None])[..., 0], information, covariance, opened)


def beside_prior(information: Array, gradient: Array, noise: Noise, at: Unknowns) -> tuple[Array, Array]:
    """Add the normal equations of the prior of X and W, which counts as one more measurement."""
    if noise.prior is None:
        return information, gradient
    more, pull, _ = noise.prior.normal_equations(at.X, at.W)
    return information + more, gradient + pull


def _unit_factors(diagonal: Array) -> Array:
    """Return factors of rows and columns (..., p) that make a diagonal 1, but where it is nearly 0."""
    return np.asarray(1.0 / np.sqrt(np.maximum(diagonal, 1e-300 + 1e-24 * diagonal.max(axis=-1, keepdims=True))))


def _suspicious(smallest: Array, diagonal: Array, noise: Noise, lever: Array) -> NDArray[np.bool_]:
    """Return whether noise could make the smallest eigenvalue of the information, scaled to a unit diagonal."""
    levels = [
        (float(S[..., :3, :3].trace(axis1=-2, axis2=-1).max()), float(S[..., 3:, 3:].trace(axis1=-2, axis2=-1).max()))
        for S in own_covariances(noise)
        if S is not None
    ]
    rotation, travel = (sum(part) for part in zip(*levels, strict=True))
    by_noise = smallest < np.maximum(1e-9, CLEAR_SIGNAL_RATIO * (SOLUTION_ROUNDING + rotation + travel / lever**2))
    return np.asarray(by_noise | (diagonal[..., :3].min(axis=-1) * smallest < MAX_ROTATION_SD_RAD**-2.0))


def _inverted(values: Array, vectors: Array, scale: Array) -> Array:
    """The inverse from the eigenvalues of the matrix that was scaled to a unit diagonal."""
    told = values > FIT_ROUNDING  # where it is not, directions are open and this is not used
    result = (vectors * np.where(told, 1.0 / np.where(told, values, 1.0), 0.0)[..., None, :]) @ vectors.mT
    return np.asarray(0.5 * (result + result.mT) * scale)


def own_covariances(noise: Noise) -> tuple[Array | None, Array | None]:
    """Return the covariances of each pose by itself (6, 6) or (n, 6, 6), without errors that poses share: those tilt
    no axis against another.
    """
    first, second = (None if S is None else weighed_blocks(S) for S in covariances_of(noise))
    return first, second


def _of_closed(closed: Array, information: Array) -> Array:
    """Return ``Q (Q^T H Q)^-1 Q^T``, solved in units in which the diagonal is 1.

    Raises `DegenerateMotionError` where rounding leaves no inverse: residuals of one kind are exact, others are not.
    """
    H = closed.T @ information @ closed
    scaled = closed * _unit_factors(np.diagonal(H))
    try:
        return np.asarray(scaled @ np.linalg.solve(scaled.T @ information @ scaled, scaled.T))
    except np.linalg.LinAlgError as error:
        raise DegenerateMotionError(
            "The data leave directions of X open, and the residuals along the others differ too much in size to solve "
            "for them (exact rotations?). Give the noise, or add poses that rotate about another axis.",
            np.eye(6),
        ) from error


def _without_noise(U: Array, rig: Array, information: Array, tilts: Tilts) -> Array:
    """Return a basis (p, k) of the open directions U in units of the rig, with components within their noise as 0.

    The rows of U that carry most are made the identity; the others follow from ``I u = 0`` with the errors
    ``C dG`` of their least squares, C the inverse of I on those rows and ``Cov dG = sum J^T A Cov(dJ u) A J``.
    """
    p, k = U.shape
    pivots = qr(U.T, mode="r", pivoting=True)[1][:k]
    rest = np.setdiff1d(np.arange(p), pivots)
    basis = U @ np.linalg.inv(U[pivots])
    C = np.linalg.inv(information[np.ix_(rest, rest)] / np.outer(rig[rest], rig[rest]))
    for j in range(k):
        G = tilts.gradient_covariance(basis[:, j] / rig)[np.ix_(rest, rest)] / np.outer(rig[rest], rig[rest])
        deviations = np.sqrt(np.maximum(np.diag(C @ G @ C), 0.0))
        some = np.abs(basis[rest, j]) < np.maximum(RESOLVED_SD * deviations, 1e-9)
        basis[rest[some], j] = 0.0
    return basis


@dataclass(frozen=True, eq=False)
class Tilts:
    """Change of J by errors of the poses, and its size; leading axes are those of the weights, too."""

    J: Array  # (..., n, 6, p)
    A: Array  # (..., n, 6): weights of the rows of r, the inverse of S_0
    B: Array  # (..., n, 6, 6, 6): dJ_X by each component of z
    P: Array  # (..., n, 6, 6): covariance of z

    def __getitem__(self, k: tuple[int, ...]) -> Tilts:
        """Return the tilts of one problem."""
        return Tilts(self.J[k], self.A[k], self.B[k], self.P[k])

    @property
    def information(self) -> Array:
        """N (..., 6, 6) of the module."""
        spread = (self.P @ self.B.reshape(*self.B.shape[:-3], 6, 36)).reshape(self.B.shape)
        weighted = self.A[..., None, :, None] * spread
        flat = (*self.B.shape[:-4], -1, 6)
        return np.asarray(self.B.reshape(flat).mT @ weighted.reshape(flat))

    @property
    def rough_information(self) -> Array:
        """I_0 (..., p, p) of the module."""
        flat = (*self.J.shape[:-3], -1, self.J.shape[-1])
        return np.asarray(self.J.reshape(flat).mT @ (self.A[..., None] * self.J).reshape(flat))

    def gradient_covariance(self, u: Array) -> Array:
        """``sum J^T A Cov(dJ u) A J`` (p, p), A = S_0^-1, of one problem."""
        by_z = (self.B @ u[:6]).mT
        pull = self.J.mT @ (self.A[..., None] * by_z)
        return np.asarray(np.einsum("nia,nab,njb->ij", pull, self.P, pull))


def tilts_of(
    linear: Linearised,
    constraint: Constraint,
    noise: Noise,
    S: Covariance,
    weights: Array | None,
    corrected: bool,
) -> Tilts:
    """Compute tilts at the poses where the constraint was linearised, ``corrected`` or measured."""
    D_1, D_2 = linear.sides
    J = linear.J[..., :6]
    # z = (theta, f): the errors that change J
    z_1, z_2 = np.zeros_like(D_1), np.zeros_like(D_2)
    z_1[..., :3, :], z_2[..., 3:, 3:] = D_1[..., :3, :], D_2[..., 3:, 3:]
    of_z, with_r = np.zeros_like(J), np.zeros_like(J)
    for D, z, own in zip((D_1, D_2), (z_1, z_2), own_covariances(noise), strict=True):
        if own is not None:
            carried = z @ own
            of_z, with_r = of_z + carried @ z.mT, with_r + carried @ D.mT
    if corrected:
        of_z = of_z - with_r @ np.linalg.solve(weighed_blocks(S), with_r.mT)
    if not constraint.split_known:
        of_z[..., :3, :3] = marginals(S)[..., :3, :3]
    index = np.arange(3)
    of_z[..., index, index] = np.maximum(of_z[..., index, index], 0.0) + SOLUTION_ROUNDING
    # dJ by each component of z
    turned = J.copy()
    if constraint.item == "pose":
        R_G = J[..., :3, :3]
        by_f = -_E @ R_G[..., None, :, :]
    else:  # J holds R_A - I, and D_2 the minus of R_X
        turned[..., :3, :3] += np.eye(3)
        turned[..., 3:, 3:] += np.eye(3)
        turned[..., 3:, :3] = 0.0
        by_f = np.broadcast_to(-_E, (*J.shape[:-2], 3, 3, 3))
    B = np.zeros((*J.shape[:-2], 6, 6, 6))  # component of z, row of r, column of X
    B[..., :3, :3, :] = _E @ turned[..., None, :3, :]
    B[..., :3, 3:, :] = _E @ turned[..., None, 3:, :]
    B[..., 3:, 3:, :3] = by_f
    variances = np.diagonal(marginals(S), axis1=-2, axis2=-1)
    A = np.repeat(1.0 / variances.reshape(*variances.shape[:-1], 2, 3).mean(axis=-1), 3, axis=-1)
    if weights is not None:
        A = A * weights[..., None]
    batch = A.shape[:-2]
    return Tilts(*(np.broadcast_to(part, batch + part.shape[part.ndim - size :])
                   for part, size in ((linear.J, 3), (A, 2), (B, 4), (of_z, 3))))  # fmt: skip


def lever_of(constraint: Constraint) -> Array:
    """Root mean square distance (...) of camera and target, of motions length of the camera's; 1 where it is 0 (m)."""
    t = constraint.second[..., :3, 3]
    lever = np.sqrt((t * t).sum(axis=-1).mean(axis=-1))
    return np.asarray(np.where(lever > 0, lever, 1.0))


def rig_units(lever: Array, p: int) -> Array:
    """Factors (..., p) from errors (rad, m) to units of the rig (m)."""
    lever = np.asarray(lever)[..., None]
    return np.concatenate([lever, lever, lever, np.ones((*lever.shape[:-1], 3))] * (p // 6), axis=-1)


def open_basis(projector: Array, rig: Array) -> Array:
    """The open directions (k, p) of unknowns, or of some of them: orthonormal in units of the rig, in rad and m."""
    values, vectors = np.linalg.eigh(projector)
    return np.asarray(vectors[:, values > MIN_OPEN_PART**2].T[::-1] / rig)


def moves_along(basis: Array, lever: float) -> NDArray[np.bool_]:
    """(6,): which components of a pose move along the open directions (k, 6), by more than the axes found are off."""
    return np.asarray((np.abs(basis * rig_units(np.asarray(lever), 6)) > MIN_OPEN_PART).any(axis=0))


def closed_basis(projector: Array, rig: Array) -> Array:
    """The other directions, as columns (p, p - k), likewise."""
    values, vectors = np.linalg.eigh(projector)
    return np.asarray(vectors[:, values < 0.5] / rig[:, None])


def projection(basis: Array, rig: Array) -> Array:
    """(p, p): an error in rad and m without its part along the open directions, the basis (k, p)."""
    U = basis * rig
    return np.asarray((np.eye(len(rig)) - U.T @ U) * rig / rig[:, None])


def closed_part(covariance: Array, projector: Array, lever: Array | None, part: slice) -> Array:
    """The covariance (..., 6, 6) of X or of W on its directions that are not open: of variance 0 along the others."""
    assert lever is not None
    rig = np.broadcast_to(rig_units(lever, 6), covariance.shape[:-1])
    result = np.array(covariance)
    for k in np.ndindex(result.shape[:-2]):
        P = projection(open_basis(projector[k][part, part], rig[k]), rig[k])
        closed = P @ result[k] @ P.T
        none = np.diag(closed) < 1e-14 * np.diag(result[k])
        closed[none], closed[:, none] = 0.0, 0.0
        result[k] = 0.5 * (closed + closed.T)
    return result
