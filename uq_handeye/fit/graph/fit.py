r"""Maximum likelihood fit of all poses of a graph, with their joint covariance (T18).

The steps are those of Gauss-Helmert, as with one camera (`graph.gauss_helmert`), with the rows of a group stacked:

    S_k = D_R Sigma_R D_R^T + blkdiag_e(D_C Sigma_C D_C^T),      A = [J, D K],      H = sum_k A^T S^-1 A + P_0
    (x, z) = -H^-1 A^T S^-1 rho,      v = Sigma D^T S^-1 (rho + A (x, z)) - K z,      rho = r + D v

x errors of the unknown poses, z those that poses share (prior N(0, 1)); ``P_0`` the prior of both. ``H^-1`` is the
joint covariance. `efficient` takes two steps, and further ones while the last one moved a pose by a tenth of its
standard deviation; `ml` iterates until it converges.

A robust weight w divides the covariance of a camera pose's own noise, or of a robot pose's, never a row of S. In a
group of one edge both are the same, and one weight divides both.

Directions that the data do not determine are those whose information arises from noise of the measured poses in J alone
(`graph.open_directions`): ``u^T I_0 u < SIGNAL_RATIO u^T N u + |theta|^2 / MAX_ROTATION_SD_RAD^2``, N summed over
columns of the square roots of the covariances of all poses, I_0 and N weighted by the mean variances of an edge's rows.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, qr

from ...core.geometry.se3 import Array, left_jacobian, logarithm, perturb
from ...core.rounding import FIT_ROUNDING
from ...errors import DegenerateMotionError, NotConvergedError
from ...model.errors.cholesky import checked_cholesky, factor
from ...model.errors.square_roots import LEAST_WEIGHT
from ...model.rig.description import Rig
from .gauss_helmert import CLOSED_FORM_STEPS, MAX_ML_STEPS, STEP_ROUNDING, STEP_SD
from .graph import VIEWS_TOGETHER, Batch, Graph, Index, Sides, noise_of_cameras, noise_of_robots
from .noise import RigNoise
from .open_directions import MAX_ROTATION_SD_RAD, MIN_OPEN_PART, SIGNAL_RATIO
from .request import Request
from .starts import MEDIAN_SQUARE

# `efficient` goes on while a step moves a pose by more of its standard deviations.
MAX_STEP_SD = 0.1
# All directions are determined where the smallest eigenvalue of the information, scaled to a unit diagonal, is
# above this.
MIN_CLEAR_EIGENVALUE = 0.01
# Poses of a target or of a robot do not scatter by more (rad); those of which most, or many, are wrong do.
MAX_NOISE_RAD = 0.05
# This weight replaces a robust weight of 0: a smaller one would lose the digits of the other rows of a group.
MIN_POSE_WEIGHT = 1e-6


Prior = dict[int, tuple[Array, Array]]  # mean (4, 4) and information (6, 6) by number of the unknown
Shared = bool | Collection[str]


class Task(NamedTuple):
    """A rig to be estimated, with the options; ``shared``: see `sizes.components_of`."""

    rig: Rig
    graph: Graph
    prior: Prior
    request: Request
    shared: Shared

    @classmethod
    def of(cls, rig: Rig, request: Request, shared: Shared) -> Task:
        """Number the poses, views and unknowns of a rig."""
        graph = Graph.of(rig)
        known = {graph.names.index(name): (of.X, of.information_X) for name, of in (rig.known or {}).items()}
        return cls(rig, graph, known, request, shared)

    @property
    def method(self) -> str:
        """``efficient`` or ``ml``."""
        return self.request.taken_method

    @property
    def robust(self) -> bool:
        """True if views and robot poses that contradict the others are down-weighted."""
        return self.request.robust is not False


class Place(NamedTuple):
    """Point at which rows are linear: unknowns, and poses as they were corrected last."""

    at: Array  # (m, 4, 4)
    robot: Array  # (P, 4, 4)
    C: Array  # (E, 4, 4)
    v: tuple[Array, Array] | None = None  # errors of robot poses (P, 6) and camera poses (E, 6) that they correct
    by_own_errors: bool = False  # derivatives are those by the errors themselves, as `gauss_helmert` has them

    def sides(self, graph: Graph, edges: Index | slice = slice(None)) -> Sides:
        """Residuals of some views, or of all, with their derivatives."""
        sides = graph.linearise(self.at, self.robot, self.C, edges)
        if not self.by_own_errors or self.v is None:
            return sides
        turn = np.concatenate([left_jacobian(-self.v[0][:, :3]), np.eye(3)[None]])
        first, second = (_turned(D, turn[side[edges]]) for D, side in zip(sides.robot, graph.side, strict=True))
        of_cameras = _turned(sides.camera, left_jacobian(-self.v[1][edges, :3]))
        return sides._replace(robot=(first, second), camera=of_cameras)


def _turned(D: Array, J: Array) -> Array:
    return np.concatenate([D[..., :3] @ J, D[..., 3:]], axis=-1)


@dataclass(frozen=True, eq=False)
class White:
    """Rows of one batch: their residuals, and what their derivatives and whitened rows are made of."""

    graph: Graph
    noise: RigNoise
    batch: Batch
    sides: Sides  # of the edges of the batch
    D_R: Array  # (b, d, 6q) derivatives by the robot poses
    half: Array  # (b, d, d) L^-1 with S = L L^T, weights in it
    residual: Array  # (b, d) rho, and after the fit what is left of it

    @property
    def L(self) -> Array:
        """(b, d, d)"""
        return np.asarray(np.linalg.inv(self.half))

    @property
    def D_C(self) -> Array:
        """(b, e, 6, 6) derivatives by the camera poses."""
        return self.sides.camera.reshape(*self.batch.edges.shape, 6, 6)

    @property
    def J(self) -> Array:
        """(b, d, p) derivatives by the unknowns."""
        J = self.graph.by_unknowns(self.sides, self.batch.edges.reshape(-1))
        return J.reshape(*self.residual.shape, self.graph.p)

    @property
    def A(self) -> Array:
        """(b, d, p + m) derivatives by unknowns and shared errors; made at each call: few rows are needed twice."""
        (b, e), q, noise = self.batch.edges.shape, self.batch.robots.shape[1], self.noise
        p = self.graph.p
        A = np.empty((b, 6 * e, p + noise.count))
        A[..., :p] = self.J
        of_robot, of_camera = (p + np.flatnonzero(of) for of in (noise.of_robot, ~noise.of_robot))
        A[..., of_robot] = self.D_R @ noise.by_robot[self.batch.robots].reshape(b, 6 * q, len(of_robot))
        A[..., of_camera] = (self.D_C @ noise.by_camera[self.batch.edges]).reshape(b, 6 * e, len(of_camera))
        return A

    @property
    def white(self) -> Array:
        """``L^-1`` of A and of the residual (b, d, p + m + 1)."""
        return np.asarray(self.half @ np.concatenate([self.A, self.residual[..., None]], axis=-1))

    @property
    def pull(self) -> Array:
        """``S^-1 residual`` (b, d)."""
        return np.asarray(self.half.mT @ (self.half @ self.residual[..., None]))[..., 0]

    def by_errors(self, robot: Array, camera: Array) -> Array:
        """(b, d) changes of the residuals by errors of the robot poses (P, 6) and of the camera poses (E, 6)."""
        (b, e), q = self.batch.edges.shape, self.batch.robots.shape[1]
        of_camera = (self.D_C @ camera[self.batch.edges][..., None]).reshape(b, 6 * e)
        return np.asarray(of_camera + (self.D_R @ robot[self.batch.robots].reshape(b, 6 * q, 1))[..., 0])

    def after(self, x: Array, moves: tuple[Array, Array]) -> White:
        """The rows after a step of the unknowns x (p,) and ``moves`` of the poses by shared errors."""
        by_x = self.graph.moved(self.sides, x, self.batch.edges.reshape(-1)).reshape(self.residual.shape)
        return replace(self, residual=self.residual + by_x + self.by_errors(*moves))


class Weights(NamedTuple):
    """Robust weights, and what a fit with them leaves for the next one."""

    edges: Array  # (E,)
    poses: Array  # (P,)
    v: tuple[Array, Array] | None = None  # errors of robot poses (P, 6) and camera poses (E, 6)
    clear: float = MIN_CLEAR_EIGENVALUE  # scaled eigenvalue of the information above which nothing is open

    def of_views(self, graph: Graph) -> Array:
        """(E,) weights of the views, or of their robot poses where these are smaller."""
        of_poses = np.append(self.poses, 1.0)
        left, right = graph.side
        return np.asarray(np.minimum(self.edges, np.minimum(of_poses[left], of_poses[right])))


@dataclass(frozen=True, eq=False)
class RigFit:
    """Estimate of all poses, with the quantities that tests and weights need."""

    graph: Graph
    noise: RigNoise
    at: Array  # (m, 4, 4)
    whole: Array  # (p + m, p + m) joint covariance of poses and shared errors, 0 along open directions
    z: Array  # (m,) shared errors
    open: Array  # (k, p) basis of open directions, orthonormal in units of the rig
    lever: float
    rows: tuple[White, ...]  # where the last step was taken
    edge_weights: Array  # (E,)
    pose_weights: Array  # (P,)
    iterations: int
    converged: bool
    prior_square: float = 0.0
    prior_rank: int = 0
    clear: float = (
        MIN_CLEAR_EIGENVALUE  # scaled eigenvalue of the information above which nothing is open, as was seen here
    )
    v: tuple[Array, Array] | None = None  # errors of robot poses (P, 6) and camera poses (E, 6)

    @property
    def weights(self) -> Weights:
        """State that another fit near by goes on from."""
        return Weights(self.edge_weights, self.pose_weights, self.v, self.clear)

    @property
    def covariance(self) -> Array:
        """(p, p) of the unknown poses."""
        return self.whole[: self.graph.p, : self.graph.p]

    @property
    def view_weights(self) -> Array:
        """(E,) weights of the views, or of their robot poses where these are smaller."""
        return self.weights.of_views(self.graph)

    @cached_property
    def chi_square(self) -> float:
        """Square of the residuals over their covariance, with the priors."""
        squares = sum(float((part.pull * part.residual).sum()) for part in self.rows)
        return squares + float(self.z @ self.z) + self.prior_square

    @property
    def dof(self) -> int:
        """Degrees of freedom of `chi_square`: the rows that count minus the determined unknowns."""
        counted = int((self.edge_weights > 0).sum())
        return 6 * counted - (self.graph.p - len(self.open)) + self.prior_rank


def fit(
    graph: Graph,
    noise: RigNoise,
    start: Array,
    method: str = "efficient",
    weights: Weights | None = None,
    prior: Prior | None = None,
) -> RigFit:
    """Estimate all poses from ``start`` (m, 4, 4), with robust weights and the errors that a fit near by found.

    Raises `NotConvergedError` where `ml` does not converge, `DegenerateMotionError` where nothing is determined.
    """
    weights = Weights(np.ones(graph.E), np.ones(graph.P)) if weights is None else weights
    w_e, w_k, v, clear = weights
    here = Place(start, graph.robot, graph.C)
    lever, closed, rows = lever_of(graph, start), False, list[White]()
    for done in range(1, MAX_ML_STEPS + 1):
        if v is not None:
            here = Place(here.at, perturb(graph.robot, -v[0]), perturb(graph.C, -v[1]), v, method == "ml")
        rows.clear()
        rows.extend(whitened(graph, batch, here, noise, w_e, w_k) for batch in graph.batches)
        H, pull = _normal_equations(graph, noise, rows)
        known = prior_at(graph, here.at, prior)
        H[: graph.p, : graph.p] += known.information
        pull[: graph.p] += known.gradient
        opened = None if closed else partial(_open, graph, noise, here, known.information, lever)
        whole, open_, smallest = _inverse(graph, H, opened, lever, clear)
        closed = not len(open_)
        if closed:
            clear = min(clear, 0.5 * smallest)
        step = -whole @ pull
        x, z = step[: graph.p], step[graph.p :]
        moves = noise.moves(z)
        for k, part in enumerate(rows):
            rows[k] = part.after(x, moves)
        moved = float(x @ _information_of(H, graph.p) @ x)
        here = here._replace(at=perturb(here.at, x.reshape(-1, 6)))
        each = np.sqrt(np.maximum(np.diag(whole)[: graph.p], 1e-300))
        still = float((np.abs(x) / each)[np.diag(whole)[: graph.p] > 0].max(initial=0.0))
        v = _errors(graph, noise, rows, moves, w_e, w_k)
        if method == "ml":
            longest = max(float(np.abs(T[:, :3, 3]).max(initial=0.0)) for T in (graph.robot, graph.C, here.at))
            last = STEP_ROUNDING * np.tile(np.repeat([1.0, longest], 3), graph.m)
            converged = moved < max(STEP_SD**2, float(np.diag(H)[: graph.p] @ last**2)) and done > 1
        else:
            converged = done >= CLOSED_FORM_STEPS and still < MAX_STEP_SD
        if converged:
            break
    known = prior_at(graph, here.at, prior)
    found = RigFit(
        graph, noise, here.at, whole, z, open_, lever, tuple(rows), w_e, w_k, done, converged, known.square,
        known.rank, clear, v,
    )  # fmt: skip
    if not converged and method == "ml":
        raise NotConvergedError(
            f"Method 'ml' did not converge within {done} iterations: the residuals are too large for the noise given, "
            "or the motions hardly determine the poses. Look at the residuals, and at the noise.",
            found,
        )
    return found


def lever_of(graph: Graph, at: Array) -> float:
    """The length that makes an angle a length: root mean square distance of the targets from the cameras (m)."""
    return float(np.sqrt((graph.C[:, :3, 3] ** 2).sum(axis=-1).mean())) or 1.0


def rig_units(graph: Graph, lever: float) -> Array:
    """(p,) units that make errors lengths."""
    return np.tile(np.repeat([lever, 1.0], 3), graph.m)


def onto_closed(opened: Array, units: Array) -> Array:
    """(p, p) projection along open directions (k, p), which are orthonormal in the units (p,)."""
    U = opened * units
    return np.asarray((np.eye(len(units)) - U.T @ U) * units / units[:, None])


def own_covariances(graph: Graph, batch: Batch, noise: RigNoise, w_e: Array, w_k: Array) -> tuple[Array, Array]:
    """(b, q, 6, 6) of robot poses and (b, e, 6, 6) of camera poses, divided by their weights."""
    e = batch.edges.shape[1]
    of_edge = 1.0 / np.maximum(w_e[batch.edges], MIN_POSE_WEIGHT if e > 1 else LEAST_WEIGHT)
    of_pose = 1.0 / np.maximum(w_k[batch.robots], MIN_POSE_WEIGHT)
    if e == 1:
        of_pose = of_pose * of_edge
    return noise.robot[batch.robots] * of_pose[..., None, None], noise.camera[batch.edges] * of_edge[..., None, None]


def whitened(graph: Graph, batch: Batch, place: Place, noise: RigNoise, w_e: Array, w_k: Array) -> White:
    """Rows of a batch at the unknowns and corrected poses of a place, with the weights of views and robot poses."""
    sides = place.sides(graph, batch.edges.reshape(-1))
    (b, e), D_R = batch.edges.shape, graph.by_robots(batch, sides)
    S_R, S_C = own_covariances(graph, batch, noise, w_e, w_k)
    S = noise_of_robots(D_R, S_R) + noise_of_cameras(sides.camera.reshape(b, e, 6, 6), S_C)
    half = np.asarray(np.linalg.inv(checked_cholesky(S)), dtype=float)
    part = White(graph, noise, batch, sides, D_R, half, sides.r.reshape(b, 6 * e))
    return part if place.v is None else replace(part, residual=part.residual + part.by_errors(*place.v))


def _normal_equations(graph: Graph, noise: RigNoise, rows: list[White]) -> tuple[Array, Array]:
    size = graph.p + noise.count
    gram = np.zeros((size + 1, size + 1))
    for part in rows:
        flat = part.white.reshape(-1, size + 1)
        gram += flat.T @ flat
    H, pull = gram[:-1, :-1], gram[:-1, -1]
    np.einsum("ii->i", H)[graph.p :] += 1.0
    return H, pull


class Known(NamedTuple):
    """Normal equations of the poses that are known beforehand."""

    information: Array  # (p, p)
    gradient: Array  # (p,)
    square: float
    rank: int


def prior_at(graph: Graph, at: Array, prior: Prior | None) -> Known:
    """Return the normal equations of known poses at the unknowns."""
    information, gradient, square, rank = np.zeros((graph.p, graph.p)), np.zeros(graph.p), 0.0, 0
    for u, (mean, known) in (prior or {}).items():
        xi = np.concatenate([logarithm(at[u, :3, :3] @ mean[:3, :3].T), at[u, :3, 3] - mean[:3, 3]])
        K = np.eye(6)
        K[:3, :3] = np.linalg.inv(left_jacobian(xi[:3]))
        place = slice(6 * u, 6 * u + 6)
        information[place, place] = K.T @ known @ K
        gradient[place] = K.T @ known @ xi
        square += float(xi @ known @ xi)
        rank += int(np.linalg.matrix_rank(known, hermitian=True))
    return Known(information, gradient, square, rank)


def _information_of(H: Array, p: int) -> Array:
    """(p, p) of the poses, with the shared errors eliminated."""
    if len(H) == p:
        return H
    return np.asarray(H[:p, :p] - H[:p, p:] @ np.linalg.solve(H[p:, p:], H[p:, :p]))


def _inverse(
    graph: Graph, H: Array, opened: Callable[[], Array | None] | None, lever: float, clear: float
) -> tuple[Array, Array, float]:
    """Return the joint covariance, 0 along the open directions, a basis of these, and the smallest scaled eigenvalue.

    ``opened`` finds them (`_open`); None: nothing is open.
    """
    p = graph.p
    diagonal = np.maximum(np.diag(H), 1e-300 + 1e-24 * float(np.diag(H).max()))
    unit = 1.0 / np.sqrt(diagonal)
    smallest = float(np.linalg.eigvalsh(_information_of(H, p) * np.outer(unit[:p], unit[:p]))[0])
    if opened is None or smallest > clear or (U := opened()) is None:
        factored = cho_factor(H * np.outer(unit, unit))
        return np.asarray(cho_solve(factored, np.diag(unit)) * unit[:, None]), np.zeros((0, p)), smallest
    rig = rig_units(graph, lever)
    if len(U) == p:
        raise DegenerateMotionError("The data determine nothing: the robot did not move.", np.eye(6))
    closed = _closed(U, rig)
    Q = np.zeros((len(H), closed.shape[1] + len(H) - p))
    Q[:p, : closed.shape[1]], Q[p:, closed.shape[1] :] = closed, np.eye(len(H) - p)
    inner = Q.T @ H @ Q
    scale = 1.0 / np.sqrt(np.diag(inner))
    half = Q * scale
    return np.asarray(half @ np.linalg.solve(inner * np.outer(scale, scale), half.T)), U, 0.0


def closed_by_residuals(graph: Graph, at: Array, prior: Prior | None) -> Array | None:
    """(p, q) basis of the directions that are determined with noise of the size of the residuals; None: all, or none.

    The sizes of errors are estimated along these: a step along the others is no smaller than their noise, ever.
    """
    sides = graph.linearise(at)
    squares = (sides.r * sides.r).reshape(-1, 2, 3).sum(axis=-1)
    variances = np.repeat(np.maximum(np.median(squares, axis=0) / MEDIAN_SQUARE, 1e-24), 3)
    known, lever = prior_at(graph, at, prior).information, lever_of(graph, at)
    information = graph.gram(sides, np.broadcast_to(1.0 / variances, (graph.E, 6))) + known
    unit = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-24 * float(np.diag(information).max())))
    if float(np.linalg.eigvalsh(information * np.outer(unit, unit))[0]) > MIN_CLEAR_EIGENVALUE:
        return None
    half = 0.5 * np.diag(np.minimum(variances, np.repeat([MAX_NOISE_RAD**2, np.inf], 3)))
    noise = RigNoise.of_own(np.tile(half, (graph.P, 1, 1)), np.tile(half, (graph.E, 1, 1)))
    U = _open(graph, noise, Place(at, graph.robot, graph.C), known, lever)
    return None if U is None or len(U) == graph.p else _closed(U, rig_units(graph, lever))


def _closed(U: Array, units: Array) -> Array:
    """(p, q) basis of the directions beside open ones U (k, p), orthonormal in units of the rig (p,)."""
    return np.asarray(np.linalg.qr((U * units).T, mode="complete")[0][:, len(U) :] / units[:, None])


def _open(graph: Graph, noise: RigNoise, here: Place, known: Array, lever: float) -> Array | None:
    """(k, p) basis of the directions that noise of the measured poses alone would make known, or None.

    ``known`` (p, p): information of the prior. Where many views are given, those that are evenly spread come first: if
    these determine all directions, all views do.
    """
    if graph.E > 2 * VIEWS_TOGETHER:
        some = np.concatenate([edges[:: graph.E // VIEWS_TOGETHER] for edges, _ in graph.kinds])
        if _open_by(graph, noise, here, known, lever, np.sort(some)) is None:
            return None
    return _open_by(graph, noise, here, known, lever, np.arange(graph.E))


def _open_by(graph: Graph, noise: RigNoise, here: Place, known: Array, lever: float, edges: Index) -> Array | None:
    """`_open` by some views."""
    I_0: Array = np.zeros((graph.p, graph.p))
    N: Array = np.zeros((graph.p, graph.p))
    roots = factor(noise.robot), factor(noise.camera)
    for start in range(0, len(edges), VIEWS_TOGETHER):
        some = edges[start : start + VIEWS_TOGETHER]
        sides, side = here.sides(graph, some), [one[some] for one in graph.side]
        S = sides.camera @ noise.camera[some] @ sides.camera.mT
        for D, of in zip(sides.robot, side, strict=True):
            has = of < graph.P
            S[has] += D[has] @ noise.robot[of[has]] @ D[has].mT
        variances = np.einsum("nii->ni", S).reshape(-1, 2, 3).mean(axis=-1)
        weights = np.repeat(1.0 / np.maximum(variances, 1e-18), 3, axis=-1)
        part = graph.of_edges(some)
        used = graph.used_by(some)
        I_0 += part.gram(sides, weights)
        of_robot = roots[0][used]
        if not noise.split_known:  # its axes may have all of the noise, whatever share the split gives the robot
            turn = np.zeros(graph.P + 1)
            for numbers in side:
                np.maximum.at(turn, numbers, variances[:, 0])
            of_robot[:, :3] = np.sqrt(np.minimum(turn[used], MAX_NOISE_RAD**2))[:, None, None] * np.eye(6)[:3]
        measured = ((part.robot, of_robot), (part.C, roots[1][some]))
        for s, (poses, of_each) in enumerate(measured):
            for a in range(6):
                # errors of both signs, whose mean change is exact to second order
                moved = (perturb(poses, sign * of_each[..., a]) for sign in (1.0, -1.0))
                one, other = (part.linearise(here.at, *((T, None) if s == 0 else (None, T))) for T in moved)
                N += part.gram(one.half_less(other), weights)
    weak = N + np.diag(FIT_ROUNDING * np.maximum(np.diag(I_0), 1e-12 * float(np.diag(I_0).max())))
    turns = np.arange(graph.p) % 6 < 3
    weak[turns, turns] += 1.0 / (SIGNAL_RATIO * MAX_ROTATION_SD_RAD**2)
    rough = I_0 + known
    unit = 1.0 / np.sqrt(np.diag(rough + weak))
    scale = np.outer(unit, unit)
    root = np.linalg.cholesky((rough + weak) * scale)
    share, vectors = np.linalg.eigh(np.linalg.solve(root, np.linalg.solve(root, weak * scale).T))
    found = share > 1.0 / (1.0 + SIGNAL_RATIO)
    if not found.any():
        return None
    rig = rig_units(graph, lever)
    U = rig[:, None] * unit[:, None] * np.linalg.solve(root.T, vectors[:, found])
    pivots = qr(U.T, mode="r", pivoting=True)[1][: U.shape[1]]
    basis = U @ np.linalg.inv(U[pivots])  # the rows that carry most are made the identity
    basis[np.abs(basis) < MIN_OPEN_PART] = 0.0
    return np.asarray(np.linalg.qr(basis)[0].T / rig)


def _errors(
    graph: Graph, noise: RigNoise, rows: list[White], moves: tuple[Array, Array], w_e: Array, w_k: Array
) -> tuple[Array, Array]:
    """Errors v of robot poses (P, 6) and camera poses (E, 6), shared ones in them."""
    v_R, v_C = -moves[0], -moves[1]  # z is their correction, as x that of the poses
    for part in rows:
        batch, g = part.batch, part.pull
        S_R, S_C = own_covariances(graph, batch, noise, w_e, w_k)
        (b, e), q = batch.edges.shape, batch.robots.shape[1]
        by_pose = (part.D_R.mT @ g[..., None]).reshape(b, q, 6, 1)
        v_R[batch.robots] += (S_R @ by_pose)[..., 0]
        v_C[batch.edges] += (S_C @ (part.D_C.mT @ g.reshape(b, e, 6, 1)))[..., 0]
    return v_R, v_C
