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
from ..core.read_only import ReadOnlyArrays
from ..errors import NotConvergedError
from .lens import Lens
from .tracks import Tracks

# Damping of the steps, relative to the diagonal, at the start.
START_DAMPING = 1e-4
# Numbers of the dense derivatives of which the normal equations are formed at once.
NUMBERS_AT_ONCE = 1_000_000


@dataclass(frozen=True, eq=False)
class Scene(ReadOnlyArrays):
    """Camera poses, points and lens of tracks."""

    tracks: Tracks
    poses: Array  # (n, 4, 4) camera_T_scene
    points: Array  # (m, 3)
    lens: Lens

    def residuals(self) -> Array:
        """(N, 2) predicted minus seen pixels."""
        return np.asarray(self.lens.project(self._seen(), self.tracks.picture).pixels - self.tracks.pixels)

    def in_camera(self) -> Array:
        """(N, 3) points in the frames of the cameras that see them."""
        C = self.poses[self.tracks.picture]
        return np.asarray((C[:, :3, :3] @ self.points[self.tracks.point][..., None])[..., 0] + C[:, :3, 3])

    def _seen(self) -> Array:
        seen = self.in_camera()
        depth = np.abs(seen[:, 2])
        # points behind a camera count as just in front of it
        seen[:, 2] = np.maximum(seen[:, 2], 1e-3 * np.median(depth) if len(depth) else 1.0)
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
        return Scene(tracks, self.poses[kept], self.points[points], self.lens.of_pictures(kept))


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

    def of_pictures(self, kept: NDArray[np.intp]) -> Pull:
        """Return the knowledge of some of the poses, the others integrated over."""
        index = (6 * kept[:, None] + np.arange(6)).ravel()
        rest = np.setdiff1d(np.arange(len(self.information)), index)
        M = self.information
        gain = M[np.ix_(index, rest)] @ np.linalg.pinv(M[np.ix_(rest, rest)], 1e-12, hermitian=True)
        return Pull(self.poses[kept], M[np.ix_(index, index)] - gain @ M[np.ix_(rest, index)])


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
    return max(float(np.median(size) / np.sqrt(2.0 * np.log(2.0)) * share), 1e-6)  # px, of exact features


def weights_of(residuals: Array, s: float) -> Array:
    """(N,) weights of observations with these residuals."""
    return np.asarray(1.0 / (1.0 + np.sum(residuals**2, axis=-1) / (4.0 * s * s)))


def reduce(scene: Scene, s: float, weights: Array | None = None, damping: float = 0.0) -> Reduced:
    """Form the normal equations at a scene, with pixel noise s; weights None: those of the residuals."""
    t, n, f = scene.tracks, scene.tracks.n, scene.lens.f
    seen = scene._seen()
    found = scene.lens.project(seen, t.picture, derivatives=True)
    r = found.pixels - t.pixels
    w = weights_of(r, s) if weights is None else weights
    root = (np.sqrt(w) / s)[:, None, None]
    J = root * found.by_point
    A = J @ scene.poses[t.picture, :3, :3]
    # of each observation: B (2, 6), K (2, f), r (2,)
    rows = np.empty((len(t), 2, 7 + f))
    rows[..., :3] = -J @ skew(seen - scene.poses[t.picture, :3, 3])
    rows[..., 3:6] = J
    rows[..., 6 : 6 + f] = root * found.by_parameters
    rows[..., 6 + f] = root[..., 0] * r
    del found, J, seen  # memory: there are up to some 100,000 observations
    normal = np.zeros((n, 7 + f, 7 + f))
    for k, of_picture in enumerate(t.of_each_picture):
        some = rows[of_picture].reshape(-1, 7 + f)
        normal[k] = some.T @ some
    prior, by_lens = scene.lens.prior_rows()
    U, V = normal[:, :6, :6].copy(), t.by_point(A.mT @ A)
    lens, slope_of_lens = normal[:, 6:-1, 6:-1].sum(axis=0), normal[:, 6:-1, -1].sum(axis=0)
    lens, slope_of_lens = lens + by_lens.T @ by_lens, slope_of_lens + by_lens.T @ prior
    W = A.mT @ rows[..., :6]  # (N, 3, 6)
    of_points = t.by_point(A.mT @ rows[..., 6:])  # (m, 3, f + 1)
    del A, rows
    own = U.copy()
    if damping:
        for M in (U, V, lens[None]):
            M += damping * M * np.eye(M.shape[-1])
    ridge = 1e-12 * np.trace(V, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    half = np.linalg.inv(np.linalg.cholesky(V + ridge))
    y = half @ of_points  # (m, 3, f + 1)
    S, g = np.zeros((6 * n + f, 6 * n + f)), np.zeros(6 * n + f)
    blocks = S[: 6 * n, : 6 * n].reshape(n, 6, n, 6)
    blocks[np.arange(n), :, np.arange(n), :] = U
    S[: 6 * n, 6 * n :], g[: 6 * n] = normal[:, :6, 6:-1].reshape(6 * n, f), normal[:, :6, -1].ravel()
    S[6 * n :, 6 * n :], g[6 * n :] = lens, slope_of_lens
    ends = np.append(t.first, len(t))
    at_once = max(NUMBERS_AT_ONCE // (18 * n), 1)
    for start in range(0, t.m, at_once):
        stop = min(start + at_once, t.m)
        part = slice(ends[start], ends[stop])
        dense = np.zeros((stop - start, 3, n, 6))
        dense[t.point[part] - start, :, t.picture[part]] = half[t.point[part]] @ W[part]
        whole = np.concatenate([dense.reshape(-1, 6 * n), y[start:stop].reshape(-1, f + 1)], axis=-1)
        product = whole.T @ whole
        S -= product[:-1, :-1]
        g -= product[:-1, -1]
    S[6 * n :, : 6 * n] = S[: 6 * n, 6 * n :].T
    return Reduced(0.5 * (S + S.T), g, own, (half.mT @ half, W, of_points[..., :-1], of_points[..., -1]), t)


def adjust(scene: Scene, pull: Pull | None = None) -> tuple[Scene, float]:
    """Adjust camera poses, points and lens to the tracks and to what else is known of the poses.

    Returns the scene and its pixel noise. Each round ends with the pixel noise of its residuals.

    Raises
    ------
    NotConvergedError
        No step decreases the cost from the start, or the numbers are not finite.
    """
    s, damping, length = pixel_noise(scene, scene.residuals()), START_DAMPING, 1.0
    for _ in range(15):  # rounds at most, each with a new pixel noise
        scene, damping, settled = _round(scene, s, pull, damping, length)
        before, s = s, pixel_noise(scene, scene.residuals())
        change = abs(np.log(s / before))
        if settled and change < 5e-3:  # relative change of the pixel noise
            break
        # near the end: weights that decrease with the residual make steps by them alone too short, by about this factor
        length = 1.5 if change < 0.1 else 1.0
    return scene, s


def _round(scene: Scene, s: float, pull: Pull | None, damping: float, length: float) -> tuple[Scene, float, bool]:
    """Decrease the robust cost with pixel noise s by damped Gauss-Newton steps; return whether these converged."""
    cost = _cost(scene, s, pull)
    if not np.isfinite(cost):
        raise NotConvergedError("The adjustment of the scene started from numbers that are not finite.", scene)
    for _ in range(3):  # steps at most
        while True:
            at = reduce(scene, s, damping=damping)
            H, g = np.array(at.S), np.array(at.g)
            if pull is not None:
                k = 6 * at.n
                H[:k, :k] += pull.information
                g[:k] += pull.at(scene.poses)[1]
            unit = 1.0 / np.sqrt(np.diag(H))
            H *= np.outer(unit, unit)
            step = -length * np.linalg.lstsq(H, unit * g, rcond=1e-14)[0]
            tried = _stepped(scene, at, unit * step)
            new = _cost(tried, s, pull)
            if new < cost or damping >= 1e6:  # the most
                break
            damping, length = max(10.0 * damping, START_DAMPING), 1.0
        if not new < cost:
            return scene, START_DAMPING, True
        scene, cost = tried, new
        damping = max(0.1 * damping, 1e-9)
        if step @ H @ step < 2e-2:  # squared length of the step in standard deviations
            return scene, damping, True
    return scene, damping, False


def _stepped(scene: Scene, at: Reduced, step: Array) -> Scene:
    zeta = step[: 6 * at.n].reshape(-1, 6)
    return replace(
        scene,
        poses=perturb(scene.poses, zeta),
        points=scene.points + at.points_after(step),
        lens=scene.lens.stepped(step[6 * at.n :]),
    )


def _cost(scene: Scene, s: float, pull: Pull | None) -> float:
    """Robust cost in units of the noise; infinite where a focal length is not positive."""
    if not scene.lens.possible:
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
