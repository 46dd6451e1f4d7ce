r"""Bundle adjustment of intrinsics and camera poses on the corners of a board, and the joint covariance of the poses.

Model: corner j of picture i is seen at ``z_ij = project(c, C_i P_j(w)) + e``, ``C_i = camera_T_target``, e Gaussian and
independent with the standard deviation s (pixels) per coordinate. All pictures share ``k = (c, w)``, the intrinsics c
and the shape w of the board (`board_shape`), which may have a Gaussian prior. The sum

    sum_ij w_i |z_ij - project(c, C_i P_j(w))|^2 / s^2  +  (k - k_0)^T Sigma_0^-1 (k - k_0)

is minimised over k and all poses, with a weight w_i for each picture (`picture_weights`; rows of picture i below are
multiplied by its root); the poses are eliminated (`variable_projection`). With the derivatives of the residuals A_i by
k and B_i by the error ``xi_i = (theta, tau)`` of pose i (left rotation, additive translation),

    V_i = B_i^T B_i,   G_i = d xi_i / d k = -V_i^-1 B_i^T A_i,   d r_i / d k = A_i + B_i G_i

To first order

    Sigma_k = ( sum_i (A_i + B_i G_i)^T (A_i + B_i G_i) / s^2 + Sigma_0^-1 )^-1
    Cov(xi_i, xi_j) = delta_ij s^2 V_i^-1 + G_i Sigma_k G_j^T                                                  (T4b)

a block diagonal plus a matrix of the rank of k: never more than n blocks are formed, and time and memory grow with the
number of corners.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ....core.geometry.se3 import Array, perturb
from ....core.read_only import ReadOnlyArrays
from ....core.rounding import SOLUTION_ROUNDING, TINY
from ....errors import InputError
from ..board_shape import BoardShape
from ..corners import MAX_PIXELS, Corners
from ..measured_board import MeasuredBoard
from ..models import CameraModel, Projected
from .variable_projection import MAX_NUMBERS_TOGETHER, Minimum, Problem, minimised


@dataclass(frozen=True, eq=False)
class Prior(ReadOnlyArrays):
    """Prior of the parameters: mean (p,) and covariance (p, p); variance 0 is exact."""

    mean: Array
    covariance: Array


@dataclass(frozen=True, eq=False)
class BundleUnknowns(ReadOnlyArrays):
    """Parameters estimated together with the poses: k intrinsics of a model, q coefficients of the board's shape."""

    model: CameraModel
    shape: BoardShape
    free: NDArray[np.bool_]  # (p,) parameters that are estimated
    prior: Prior | None = None

    @classmethod
    def poses_only(cls, model: CameraModel, shape: BoardShape) -> BundleUnknowns:
        """Return unknowns without any free parameter: only the poses are estimated."""
        return cls(model, shape, np.zeros(len(model.names) + shape.q, dtype=bool))

    @property
    def names(self) -> tuple[str, ...]:
        """(p,) of the parameters."""
        return (*self.model.names, *self.shape.names)


@dataclass(frozen=True, eq=False)
class Bundle(ReadOnlyArrays):
    """Parameters and poses at the minimum, residuals, and the covariance to first order.

    The p parameters are the k intrinsics of the model and the q coefficients of the board's shape, in this order.
    """

    unknowns: BundleUnknowns
    parameters: Array  # (p,)
    poses: Array  # (n, 4, 4) camera_T_target
    residuals: Array  # (m, 2) measured minus predicted pixels, also of corners that were left out
    used: NDArray[np.bool_]  # (m,)
    pixel_noise: float  # s, pixels per coordinate
    covariance: Array  # (p, p) of the parameters; 0 where fixed
    own: Array  # (n, 6, 6) s^2 V_i^-1
    by_parameters: Array  # (n, 6, p) G_i
    weights: Array  # (n,) w_i of the pictures
    converged: bool
    iterations: int

    @property
    def model(self) -> CameraModel:
        """Camera model."""
        return self.unknowns.model

    @property
    def shape(self) -> BoardShape:
        """Shape of the board."""
        return self.unknowns.shape

    @property
    def free(self) -> NDArray[np.bool_]:
        """(p,) parameters that were estimated."""
        return self.unknowns.free

    @property
    def prior(self) -> Prior | None:
        """Prior that the parameters were fitted with."""
        return self.unknowns.prior

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self.unknowns.names

    @property
    def intrinsics(self) -> Array:
        """(k,)"""
        return self.parameters[: len(self.model.names)]

    @property
    def intrinsics_covariance(self) -> Array:
        """(k, k)"""
        return self.covariance[: len(self.model.names), : len(self.model.names)]

    @property
    def bend(self) -> Array:
        """(q,) coefficients of the board's shape, m."""
        return self.parameters[len(self.model.names) :]

    @property
    def bend_covariance(self) -> Array:
        """(q, q)"""
        return self.covariance[len(self.model.names) :, len(self.model.names) :]

    @cached_property
    def board(self) -> MeasuredBoard:
        """The board as measured."""
        return self.shape.measured(self.bend, self.bend_covariance)

    @property
    def picture_noise(self) -> Array:
        """(n,) ``s / sqrt(w_i)``, pixels per coordinate."""
        return np.asarray(self.pixel_noise / np.sqrt(self.weights))

    @property
    def freedom(self) -> int:
        """Degrees of freedom: coordinates of the corners used minus unknowns."""
        return 2 * int(self.used.sum()) - 6 * len(self.poses) - int(self.free.sum())


@dataclass(frozen=True, eq=False)
class Sight:
    """Content of the pictures, padded to the same number of corners: see `Corners.by_picture`.

    In memory the corners of a picture lie together, component by component.
    """

    model: CameraModel
    shape: BoardShape
    row: NDArray[np.intp]  # (n, most) which of the shape's points each corner is
    pixels: Array  # (n, 2, most)
    weights: Array  # (n, most): what residuals are multiplied by, 0 for corners that do not count

    @classmethod
    def of(cls, model: CameraModel, shape: BoardShape, corners: Corners, used: NDArray[np.bool_] | Array) -> Sight:
        points, which = corners.on_board
        row = corners.by_picture(shape.rows(points)[which]).astype(np.intp)
        pixels = np.ascontiguousarray(corners.by_picture(corners.pixels).mT)
        return cls(model, shape, row, pixels, corners.by_picture(used))

    def pictures(self, part: slice) -> Sight:
        """Return a subset of the pictures."""
        return Sight(self.model, self.shape, self.row[part], self.pixels[part], self.weights[part])

    @property
    def names(self) -> NDArray[np.str_]:
        """(p,) of the parameters."""
        return np.array((*self.model.names, *self.shape.names))

    def rows(
        self, parameters: Array, poses: Array, free: NDArray[np.bool_] | None = None
    ) -> tuple[Array, Array, Array]:
        """r (n, 2 most), A (n, 2 most, f) by the ``free`` parameters and B (n, 2 most, 6) by the poses, in pixels.

        Rows of corners that do not count are 0.
        """
        k, (n, most) = len(self.model.names), self.weights.shape
        free = np.ones(len(parameters), dtype=bool) if free is None else free
        turned, seen, in_front = self._projected(parameters, poses, free[:k])
        # Behind the camera a point has a residual that no step accepts.
        r = np.where(in_front[:, None], seen.pixels.mT - self.pixels, MAX_PIXELS) * self.weights[:, None]
        weight = (self.weights * in_front)[:, None, None]
        B = np.empty((n, 6, 2, most))
        x, y, z = (turned[:, [axis]] for axis in range(3))
        by_x, by_y, by_z = (B[:, axis] for axis in (3, 4, 5))
        np.multiply(seen.by_point.swapaxes(-1, -3), weight, out=B[:, 3:])
        B[:, 0], B[:, 1], B[:, 2] = y * by_z - z * by_y, z * by_x - x * by_z, x * by_y - y * by_x
        A = np.empty((n, int(free.sum()), 2, most))
        first = int(free[:k].sum())
        np.multiply(seen.by_parameters.swapaxes(-1, -3), weight, out=A[:, :first])
        if first < A.shape[1]:
            on_board = poses[:, :3, :3].mT @ B[:, 3:].reshape(n, 3, -1)  # derivatives by a point of the board
            on_board = on_board.reshape(n, 3, 2, most)
            for column, q in enumerate(np.flatnonzero(free[k:]), first):
                parts = [on_board[:, axis] * np.take(by, self.row)[:, None] for axis, by in self.shape.moves[q]]
                A[:, column] = sum(parts[1:], start=parts[0]) if parts else 0.0
        return r.reshape(n, -1), A.reshape(n, -1, 2 * most).mT, B.reshape(n, 6, -1).mT

    def predicted(self, parameters: Array, poses: Array) -> Array:
        """Pixels (n, most, 2) of all points, also of those that do not count."""
        return self._projected(parameters, poses, np.zeros(len(self.model.names), dtype=bool))[1].pixels

    def _projected(
        self, parameters: Array, poses: Array, free: NDArray[np.bool_]
    ) -> tuple[Array, Projected, NDArray[np.bool_]]:
        k = len(self.model.names)
        board = (self.shape.points + self.shape.displacement(parameters[k:])).T
        turned = poses[:, :3, :3] @ np.moveaxis(np.take(board, self.row, axis=-1), 1, 0)
        points = turned + poses[:, :3, 3:]
        in_front = np.asarray((points[:, 2] > 0) | self.model.wide)
        if not in_front.all():
            points = np.where(in_front[:, None], points, np.array([0.0, 0.0, 1.0])[:, None])
        return turned, self.model.project(parameters[:k], points.mT, free), in_front


def adjust(
    unknowns: BundleUnknowns,
    corners: Corners,
    start: tuple[Array, Array],
    *,
    used: NDArray[np.bool_] | None = None,
    weights: Array | None = None,
    pixel_noise: float | None = None,
) -> Bundle:
    """Minimise from ``start`` (parameters, poses) over the free parameters and all poses.

    ``used`` (m,) are the corners that count, ``weights`` (n,) those of the corners of each picture. ``pixel_noise``
    None: estimated from the corners used, ``s^2 = |r|^2 / (coordinates - parameters)``; with a prior it weighs the
    prior too, and the fit is repeated until both agree.
    """
    used = np.ones(corners.m, dtype=bool) if used is None else used
    weights = np.ones(corners.n) if weights is None else weights
    sight = Sight.of(unknowns.model, unknowns.shape, corners, used * np.sqrt(weights)[corners.picture])
    parameters, free, prior = start[0].copy(), unknowns.free, unknowns.prior

    def rows(values: Array, poses: Array, part: slice) -> tuple[Array, Array, Array]:
        parameters[free] = values
        return sight.pictures(part).rows(parameters, poses, free)

    problem = Problem(2 * int(sight.weights.shape[1]), rows, perturb)
    values, poses = parameters[free], start[1]
    s = 1.0 if pixel_noise is None else pixel_noise
    rounds = 1 if prior is None or pixel_noise is not None else 4
    for _ in range(rounds):
        found = minimised(problem, values, poses, None if prior is None else prior_rows(prior, free, s))
        parameters[free] = found.values
        bundle = _bundle(unknowns, sight, parameters.copy(), corners, used, weights, found, pixel_noise)
        values, poses = found.values, found.blocks
        if abs(bundle.pixel_noise - s) <= 1e-3 * s:
            break
        s = bundle.pixel_noise
    return bundle


def poses_only(
    bundle: Bundle,
    corners: Corners,
    poses: Array,
    used: NDArray[np.bool_] | None = None,
    weights: Array | None = None,
) -> Bundle:
    """Return the poses of least squares from these on, with the parameters of a bundle; the rest as in `adjust`."""
    unknowns = BundleUnknowns.poses_only(bundle.model, bundle.shape)
    start = np.array(bundle.parameters), poses
    return adjust(unknowns, corners, start, used=used, weights=weights, pixel_noise=bundle.pixel_noise)


def response_ahead(bundle: Bundle, points: Array, poses: Array) -> Array:
    """G (m, 6, p) of poses (m, 4, 4) that are yet to be seen: their error for one of the parameters.

    ``points`` (u, 3) of the board are all taken as seen, alike, also where they would lie beyond the picture.
    """
    row = bundle.shape.rows(points)
    found = []
    together = max(1, MAX_NUMBERS_TOGETHER // (2 * len(points) * (len(bundle.parameters) + 6)))
    for start in range(0, len(poses), together):
        some = poses[start : start + together]
        m, u = len(some), len(points)
        every = np.tile(row.astype(np.intp), (m, 1))
        sight = Sight(bundle.model, bundle.shape, every, np.zeros((m, 2, u)), np.ones((m, u)))
        _, A, B = sight.rows(bundle.parameters, some)
        found.append(-np.linalg.solve(B.mT @ B, B.mT @ A))
    return np.concatenate(found)


def prior_rows(prior: Prior, free: NDArray[np.bool_], s: float) -> tuple[Array, Array]:
    """Mean of the free parameters, and R with ``R^T R = s^2 Sigma_0^-1``."""
    S = prior.covariance[np.ix_(free, free)]
    return prior.mean[free], s * np.linalg.cholesky(np.linalg.inv(S)).T


def _bundle(
    unknowns: BundleUnknowns,
    sight: Sight,
    parameters: Array,
    corners: Corners,
    used: NDArray[np.bool_],
    weights: Array,
    found: Minimum,
    pixel_noise: float | None,
) -> Bundle:
    """The covariances at the minimum."""
    free, poses = unknowns.free, found.blocks
    freedom = 2 * int(used.sum()) - 6 * len(poses) - int(free.sum())
    off = sight.pixels.mT - sight.predicted(parameters, poses)
    squares = float(np.sum((sight.weights[..., None] * off) ** 2))
    s = pixel_noise if pixel_noise is not None else float(np.sqrt(squares / max(freedom, 1)))
    information = found.information / s**2
    if (prior := unknowns.prior) is not None:
        information = information + np.linalg.inv(prior.covariance[np.ix_(free, free)])
    p = len(free)
    covariance, by_parameters = np.zeros((p, p)), np.zeros((len(poses), 6, p))
    covariance[np.ix_(free, free)] = _inverse(information, sight.names[free])
    by_parameters[..., free] = found.G
    own = s**2 * np.linalg.inv(found.V)
    return Bundle(
        unknowns,
        parameters,
        poses,
        off[corners.picture, corners.place],
        used,
        s,
        0.5 * (covariance + covariance.T),
        0.5 * (own + own.mT),
        by_parameters,
        weights,
        found.converged,
        found.steps,
    )


def _inverse(information: Array, names: NDArray[np.str_]) -> Array:
    """The covariance of the parameters; raises `InputError` that names those which are not determined."""
    unit = 1.0 / np.sqrt(np.maximum(np.diag(information), TINY))
    values, vectors = np.linalg.eigh(information * unit[:, None] * unit)
    if not (len(values) == 0 or values[0] > SOLUTION_ROUNDING):
        part = np.abs(vectors[:, 0]) > 0.1
        raise InputError(
            f"The pictures do not determine {', '.join(names[part])}: only some combination of them. Take pictures in "
            "which the board is tilted in different ways and reaches the rim, give `intrinsics`, or leave out "
            "`coefficients`."
        )
    return np.asarray((vectors / values) @ vectors.T * unit[:, None] * unit)
