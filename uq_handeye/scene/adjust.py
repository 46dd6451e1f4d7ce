r"""Adjustment of a scene: camera poses, points and lens from tracks, alone or with the robot.

Point j is seen in picture i at ``z_ij = project(k, C_i P_j) + e_ij``. With the rows r of all observations, their
derivatives A by P_j, B by the error ``zeta_i`` of C_i (left rotation, additive translation) and K by the lens, each
times ``sqrt(w_ij) / s``, and ``V_j = sum_i A^T A``, the points are eliminated:

    S = sum (B, K)^T (B, K) - sum_j (sum_i (B, K)^T A) V_j^-1 (...)^T,   g likewise of (B, K)^T r       (6n + f)

which with the prior of the lens is all that the pictures say. S has seven null directions, the similarity of a scene.
Weights are ``w = 1 / (1 + |r|^2 / 4 s^2)``, of a Student-like distribution: SIFT has a narrow core and long tails.

The robot joins as what it says of the camera poses, `Pull`: a Gaussian of all of them together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array, difference, perturb, skew
from ..core.runtime.read_only import ReadOnlyArrays
from ..errors import NotConvergedError
from .lens import MODEL, Lens
from .tracks import Tracks

# Rounds with a new pixel noise, and steps within one.
MAX_ROUNDS, MAX_STEPS = 6, 20
# A round ends where a step decreases the robust cost by less than this; all end where the pixel noise changes by less.
MIN_GAIN, NOISE_ROUNDING = 1e-2, 1e-3
# Damping of the steps, relative to the diagonal: start, least and most.
START_DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-4, 1e-9, 1e6
# Least pixel noise.
LEAST_NOISE = 1e-6
# Depth in front of a camera below which a point counts as behind it, in medians of the depths.
LEAST_DEPTH = 1e-3


@dataclass(frozen=True, eq=False)
class Scene(ReadOnlyArrays):
    """Camera poses, points and lens of tracks."""

    tracks: Tracks
    poses: Array  # (n, 4, 4) camera_T_scene
    points: Array  # (m, 3)
    lens: Lens

    def residuals(self) -> Array:
        """(N, 2) predicted minus seen pixels."""
        return (
            MODEL.project(self.lens.values, self._seen(), np.zeros(len(MODEL.names), bool)).pixels - self.tracks.pixels
        )

    def in_camera(self) -> Array:
        """(N, 3) points in the frames of the cameras that see them."""
        C = self.poses[self.tracks.picture]
        return np.asarray((C[:, :3, :3] @ self.points[self.tracks.point][..., None])[..., 0] + C[:, :3, 3])

    def _seen(self) -> Array:
        seen = self.in_camera()
        depth = np.abs(seen[:, 2])
        seen[:, 2] = np.maximum(seen[:, 2], LEAST_DEPTH * np.median(depth) if len(depth) else 1.0)
        return seen

    def scaled(self, factor: float) -> Scene:
        """Return the scene with all lengths times a factor."""
        poses = self.poses.copy()
        poses[:, :3, 3] *= factor
        return replace(self, poses=poses, points=factor * self.points)

    def moved(self, T: Array) -> Scene:
        """Return the scene in another frame, ``T = new_T_scene``."""
        return replace(self, poses=self.poses @ np.linalg.inv(T), points=self.points @ T[:3, :3].T + T[:3, 3])

    def where(self, kept: NDArray[np.bool_]) -> Scene:
        """Return the scene of the observations that are kept."""
        tracks, points = self.tracks.where(kept)
        return replace(self, tracks=tracks, points=self.points[points])

    def of_pictures(self, kept: NDArray[np.intp]) -> Scene:
        """Return the scene of some of its pictures, by ascending numbers."""
        tracks, points = self.tracks.of_pictures(kept)
        return replace(self, tracks=tracks, points=self.points[points], poses=self.poses[kept])


@dataclass(frozen=True, eq=False)
class Pull(ReadOnlyArrays):
    """Knowledge of all camera poses in addition to the pictures: a Gaussian of their errors about given poses."""

    poses: Array  # (n, 4, 4)
    information: Array  # (6n, 6n), may be singular

    def at(self, poses: Array) -> tuple[float, Array]:
        """Return the cost at camera poses, and its gradient (6n,)."""
        off = difference(poses, self.poses).ravel()
        slope = self.information @ off
        return float(off @ slope), slope


@dataclass(frozen=True, eq=False)
class Reduced(ReadOnlyArrays):
    """Normal equations of camera poses and lens, with the points eliminated; see the module."""

    S: Array  # (6n + f, 6n + f), with the prior of the lens
    g: Array  # (6n + f,)
    own: Array  # (n, 6, 6) information of each pose, points and lens held
    to_points: tuple[Array, Array, Array, Array]  # V^-1 (m, 3, 3), W (N, 3, 6), W_k (m, 3, f), A^T r (m, 3)
    tracks: Tracks

    @property
    def n(self) -> int:
        """Number of pictures."""
        return len(self.own)

    def points_after(self, step: Array) -> Array:
        """Moves of the points (m, 3) that go with a step (6n + f,) of camera poses and lens."""
        V, W, W_k, slope = self.to_points
        zeta = step[: 6 * self.n].reshape(-1, 6)[self.tracks.picture]
        by_poses = self.tracks.by_point((W @ zeta[..., None])[..., 0])
        return -(V @ (slope + by_poses + W_k @ step[6 * self.n :])[..., None])[..., 0]


def pixel_noise(scene: Scene, residuals: Array) -> float:
    """Standard deviation of a coordinate of a feature (px), from the median residual and the numbers of freedom."""
    t = scene.tracks
    free = 2 * len(t) - 3 * t.m - 6 * t.n - scene.lens.f + 7
    size = np.linalg.norm(residuals, axis=-1)
    share = np.sqrt(2 * len(t) / max(free, 1))
    return max(float(np.median(size) / np.sqrt(2.0 * np.log(2.0)) * share), LEAST_NOISE)


def weights_of(residuals: Array, s: float) -> Array:
    """(N,) weights of observations with these residuals."""
    return np.asarray(1.0 / (1.0 + np.sum(residuals**2, axis=-1) / (4.0 * s * s)))


def reduce(scene: Scene, s: float, weights: Array | None = None, damping: float = 0.0) -> Reduced:
    """Form the normal equations at a scene, with pixel noise s; weights None: those of the residuals."""
    from scipy.sparse import csr_array

    t, n = scene.tracks, scene.tracks.n
    C = scene.poses[t.picture]
    seen = scene._seen()
    found = MODEL.project(scene.lens.values, seen, scene.lens.free)
    r = found.pixels - t.pixels
    w = weights_of(r, s) if weights is None else weights
    root = (np.sqrt(w) / s)[:, None, None]
    J = root * found.by_point
    A = J @ C[:, :3, :3]
    B = np.concatenate([-J @ skew(seen - C[:, :3, 3]), J], axis=-1)
    K, r = root * found.by_parameters, root[..., 0] * r
    f = K.shape[-1]
    U = _by_picture(t, B.mT @ B)
    B_K, g_c = _by_picture(t, B.mT @ K), _by_picture(t, (B.mT @ r[..., None])[..., 0])
    K_K, g_k = np.einsum("nak,nal->kl", K, K), np.einsum("nak,na->k", K, r)
    prior, by_lens = scene.lens.prior_rows()
    K_K, g_k = K_K + by_lens.T @ by_lens, g_k + by_lens.T @ prior
    V = t.by_point(A.mT @ A)
    W, W_k = A.mT @ B, t.by_point(A.mT @ K)
    slope = t.by_point((A.mT @ r[..., None])[..., 0])
    own = U.copy()
    if damping:
        for M in (U, V):
            M += damping * M * np.eye(M.shape[-1])
        K_K = K_K + damping * K_K * np.eye(f)
    half = np.linalg.inv(np.linalg.cholesky(V + 1e-12 * np.trace(V, axis1=1, axis2=2)[:, None, None] * np.eye(3)))
    Y, Y_k, y = half[t.point] @ W, half @ W_k, (half @ slope[..., None])[..., 0]  # (N, 3, 6), (m, 3, f), (m, 3)
    columns = np.repeat(6 * t.picture[:, None] + np.arange(6), 3, axis=0)  # one line of Y in each
    lines = (3 * t.point[:, None] + np.arange(3)).ravel()
    order = np.argsort(lines, kind="stable")
    starts = np.concatenate([[0], np.cumsum(6 * np.bincount(lines, minlength=3 * t.m))])
    sparse = csr_array((Y.reshape(-1, 6)[order].ravel(), columns[order].ravel(), starts), shape=(3 * t.m, 6 * n))
    S = np.zeros((6 * n + f, 6 * n + f))
    S[: 6 * n, : 6 * n] = -(sparse.T @ sparse).toarray()
    blocks = S[: 6 * n, : 6 * n].reshape(n, 6, n, 6)
    blocks[np.arange(n), :, np.arange(n), :] += U
    S[: 6 * n, 6 * n :] = B_K.reshape(6 * n, f) - sparse.T @ Y_k.reshape(-1, f)
    S[6 * n :, : 6 * n] = S[: 6 * n, 6 * n :].T
    S[6 * n :, 6 * n :] = K_K - Y_k.reshape(-1, f).T @ Y_k.reshape(-1, f)
    g = np.concatenate([g_c.ravel() - sparse.T @ y.ravel(), g_k - Y_k.reshape(-1, f).T @ y.ravel()])
    return Reduced(0.5 * (S + S.T), g, own, (half.mT @ half, W, W_k, slope), t)


def _by_picture(t: Tracks, values: Array) -> Array:
    """Sum values (N, ...) over the observations of each picture: (n, ...)."""
    found = np.zeros((t.n, *values.shape[1:]))
    np.add.at(found, t.picture, values)
    return found


def adjust(scene: Scene, pull: Pull | None = None) -> tuple[Scene, float]:
    """Adjust camera poses, points and lens to the tracks and to what else is known of the poses.

    Returns the scene and its pixel noise. Each round ends with the pixel noise of its residuals.

    Raises
    ------
    NotConvergedError
        No step decreases the cost from the start, or the numbers are not finite.
    """
    s = pixel_noise(scene, scene.residuals())
    damping = START_DAMPING
    for _ in range(MAX_ROUNDS):
        scene, damping = _round(scene, s, pull, damping)
        before, s = s, pixel_noise(scene, scene.residuals())
        if abs(np.log(s / before)) < NOISE_ROUNDING:
            break
    return scene, s


def _round(scene: Scene, s: float, pull: Pull | None, damping: float) -> tuple[Scene, float]:
    """Minimise the robust cost with pixel noise s by damped Gauss-Newton steps."""
    cost = _cost(scene, s, pull)
    if not np.isfinite(cost):
        raise NotConvergedError("The adjustment of the scene started from numbers that are not finite.", scene)
    for _ in range(MAX_STEPS):
        while True:
            at = reduce(scene, s, damping=damping)
            H, g = np.array(at.S), np.array(at.g)
            if pull is not None:
                k = 6 * at.n
                H[:k, :k] += pull.information
                g[:k] += pull.at(scene.poses)[1]
            unit = 1.0 / np.sqrt(np.diag(H))
            step = -unit * np.linalg.lstsq(H * np.outer(unit, unit), unit * g, rcond=1e-14)[0]
            tried = _stepped(scene, at, step)
            new = _cost(tried, s, pull)
            if new < cost or damping >= MOST_DAMPING:
                break
            damping = max(10.0 * damping, START_DAMPING)
        if not new < cost:
            return scene, START_DAMPING
        gain, scene, cost = cost - new, tried, new
        damping = max(0.1 * damping, LEAST_DAMPING)
        if gain < MIN_GAIN:
            break
    return scene, damping


def _stepped(scene: Scene, at: Reduced, step: Array) -> Scene:
    zeta = step[: 6 * at.n].reshape(-1, 6)
    values = np.array(scene.lens.values)
    values[scene.lens.free] += step[6 * at.n :]
    return replace(
        scene,
        poses=perturb(scene.poses, zeta),
        points=scene.points + at.points_after(step),
        lens=scene.lens.at(values),
    )


def _cost(scene: Scene, s: float, pull: Pull | None) -> float:
    """Robust cost in units of the noise; infinite where a focal length is not positive."""
    if (scene.lens.values[:2] <= 0).any():
        return np.inf
    squares = np.sum(scene.residuals() ** 2, axis=-1) / (s * s)
    rows = scene.lens.prior_rows()[0]
    more = 0.0 if pull is None else pull.at(scene.poses)[0]
    return float(np.sum(4.0 * np.log1p(0.25 * squares)) + rows @ rows + more)


def joint_covariance(at: Reduced, pull: Pull | None = None, gauge: Array | None = None) -> Array:
    """Covariance (6n + f, 6n + f) of the errors of all camera poses and the lens.

    ``gauge`` (6n, 7): directions that the pictures leave open, which are held; None with a ``pull`` that has them.
    """
    H = np.array(at.S)
    if pull is not None:
        H[: 6 * at.n, : 6 * at.n] += pull.information
    unit = 1.0 / np.sqrt(np.diag(H))
    H *= np.outer(unit, unit)
    Q = np.zeros((len(H), 0))
    if gauge is not None:
        Q = np.zeros((len(H), gauge.shape[1]))
        Q[: 6 * at.n] = gauge / unit[: 6 * at.n, None]
        Q = np.linalg.qr(Q)[0]
    inverse = np.linalg.inv(H + Q @ Q.T) - Q @ Q.T
    return np.asarray(np.outer(unit, unit) * 0.5 * (inverse + inverse.T))
