r"""Test of the shape of the board: residuals that repeat at its points show that these are displaced.

Model: with point j of the board off by d_j (3,) the residuals of picture i, multiplied by the root of its weight, gain
``D_ij d_j``, ``D_ij = d project / d P_j`` (2, 3). Over all pictures

    M_j = sum_i D_ij^T D_ij,   g_j = sum_i D_ij^T r_ij,   d_j = M_j^-1 g_j          r measured minus predicted
    T = sum_j g_j^T M_j^-1 g_j / s^2 = |P r|^2 / s^2,   P = D M^-1 D^T the projector on displacements of points

The fit has removed a part H of the errors, ``Cov(r) = s^2 (I - H)``: that of the poses, block by block, and that of
the shared parameters with their covariance Sigma_k, ``H = Q Q^T + J Sigma_k J^T / s^2``. So T is about chi-square with

    nu = tr P (I - H) = 3u - sum_i |P^(1/2) Q_i|^2 - sum_j tr M_j^-1 G_j Sigma_k G_j^T / s^2,   G_j = sum_i D_ij^T J_ij

degrees of freedom; the rank of M_j counts where it is less than 3. Its size is judged as that of the pattern over the
picture (`residual_pattern`): the root mean square of the excess of T over nu, per coordinate, as a share of s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.geometry.se3 import Array
from ...core.levels import CONTRADICTED
from ...core.read_only import ReadOnlyArrays
from ...core.rounding import CHAIN_ROUNDING, TINY
from ...errors import InputError
from .adjustment.bundle import Bundle, Sight
from .adjustment.variable_projection import reduced
from .board_shape import BoardShape, polynomial_shape
from .corners import Corners
from .residual_pattern import MIN_PATTERN_SHARE


@dataclass(frozen=True, eq=False)
class BoardPattern(ReadOnlyArrays):
    """Residuals by the points of the board, and what bow they would show."""

    points: Array  # (u, 3) as meant, m
    mean: Array  # (u, 3) d_j, m, in the frame of the board
    deviation: Array  # (u, 3) what chance makes of it, s times the roots of the diagonal of M_j^-1, m
    p_value: float
    share: float  # rms of the pattern beyond chance over s
    visible: float  # bow (m, highest minus lowest) that the pictures distinguish from a flat board; inf where none is

    @property
    def found(self) -> bool:
        """True if there is a pattern that matters."""
        return self.p_value < CONTRADICTED.probability and self.share > MIN_PATTERN_SHARE


def board_pattern_of(bundle: Bundle, corners: Corners) -> BoardPattern:
    """Return the pattern of the corners that were used."""
    from scipy.special import gammaincc  # slow to import

    shape, s = bundle.shape, bundle.pixel_noise
    k, u = len(bundle.model.names), len(shape.points)
    r, A, B = _rows(bundle, corners, _each_point(shape, bundle.bend))
    n, most = len(r), r.shape[1] // 2
    D = A[..., k:].reshape(n, most, 2, 3)
    r, row = -r.reshape(n, most, 2), corners.by_picture(shape.rows(corners.points)).astype(np.intp)

    def summed(values: Array) -> Array:
        """(u, ...) of values (n, most, ...) by corner."""
        total = np.zeros((u, *values.shape[2:]))
        np.add.at(total, row, values)
        return total

    e, V = np.linalg.eigh(summed(D.mT @ D))
    seen = e > CHAIN_ROUNDING * max(float(e.max()), TINY)
    root = np.where(seen, 1.0 / np.sqrt(np.where(seen, e, 1.0)), 0.0)[:, None, :] * V  # (u, 3, 3) root root^T = M^-1
    g = summed((D.mT @ r[..., None])[..., 0])
    own = D @ root[row]  # (n, most, 2, 3)
    Q = np.linalg.qr(B)[0].reshape(n, most, 2, 6)
    of_poses = float(np.sum((own.mT @ Q) ** 2))
    J = np.concatenate([A[..., :k], (D @ shape.fields[row]).reshape(n, 2 * most, -1)], axis=-1)[..., bundle.free]
    G = summed(D.mT @ reduced(J, B)[0].reshape(n, most, 2, -1))
    to_shared = root.mT @ G  # (u, 3, f)
    S = bundle.covariance[np.ix_(bundle.free, bundle.free)]
    of_shared = float(np.einsum("uif,fg,uig->", to_shared, S, to_shared)) / s**2
    nu = max(float(seen.sum()) - of_poses - of_shared, 1.0)
    T = float(np.sum((root.mT @ g[..., None]) ** 2)) / s**2
    share = np.sqrt(max(T - nu, 0.0) / (2 * int(bundle.used.sum())))
    mean = (root @ root.mT @ g[..., None])[..., 0]
    chance = s * np.linalg.norm(root, axis=2)
    return BoardPattern(
        shape.points, mean, chance, float(gammaincc(nu / 2, T / 2)), float(share), visible_bow(bundle, corners)
    )


def visible_bow(bundle: Bundle, corners: Corners) -> float:
    """Return the height (m, highest minus lowest point) from which BIC (of many corners) takes a bow of degree 2.

    With the covariance C of its q coefficients, all others estimated, that is ``w^T C^-1 w = q ln nu``; the largest
    over the principal axes of C. Infinite where the points or the pictures do not show such a bow.
    """
    try:
        shape = polynomial_shape("bow2", corners.points)
    except InputError:
        return float("inf")
    k = len(bundle.model.names)
    _, A, B = _rows(bundle, corners, shape)
    free = np.append(bundle.free[:k], np.ones(shape.q, dtype=bool))
    J = reduced(A[..., free], B)[0]
    information = np.einsum("nij,nik->jk", J, J) / bundle.pixel_noise**2
    if bundle.prior is not None and bundle.free[:k].any():
        of = np.flatnonzero(bundle.free[:k])
        information[: len(of), : len(of)] += np.linalg.inv(bundle.prior.covariance[np.ix_(of, of)])
    size = np.sqrt(np.diag(information))
    e, V = np.linalg.eigh(information / np.outer(size, size))
    if e[0] <= CHAIN_ROUNDING:
        return float("inf")
    C = ((V / e) @ V.T / np.outer(size, size))[-shape.q :, -shape.q :]
    values, vectors = np.linalg.eigh(C)
    height = shape.fields.reshape(-1, shape.q) @ (vectors * np.sqrt(values))
    beyond = np.sqrt(shape.q * np.log(max(bundle.freedom, 2)))
    return float(beyond * np.ptp(height, axis=0).max())


def _each_point(shape: BoardShape, bend: Array) -> BoardShape:
    """A board as it was found, of which every point may move by itself; its fields are for derivatives only."""
    fields = np.broadcast_to(np.eye(3), (len(shape.points), 3, 3))
    return BoardShape("points", ("x", "y", "z"), shape.points, shape.displacement(bend), fields, np.full(3, np.inf))


def _rows(bundle: Bundle, corners: Corners, shape: BoardShape) -> tuple[Array, Array, Array]:
    """Residuals and derivatives of a bundle with another shape, all coefficients 0: rows corner by corner."""
    weight = bundle.used * np.sqrt(bundle.weights)[corners.picture]
    parameters = np.concatenate([bundle.intrinsics, np.zeros(shape.q)])
    r, A, B = Sight.of(bundle.model, shape, corners, weight).rows(parameters, bundle.poses)
    n = len(r)
    r, A, B = (M.reshape(n, 2, r.shape[1] // 2, -1).swapaxes(1, 2).reshape(n, r.shape[1], -1) for M in (r, A, B))
    return r[..., 0], A, B
