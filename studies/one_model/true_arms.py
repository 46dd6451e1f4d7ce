"""Arms as they are: nominal chain plus errors, scaled to an accuracy over the workspace, and frames aligned to it.

Model: with e_k = (a_k, l_k) the tilt and shift of joint k and its angle

    q'_k = q_k + offset_k + sum over m = 1, 2 of (s_km sin m q_k + c_km cos m q_k) + kappa_k g_k(q) + noise
    true base_T_flange = O_1 E_1 M_1(q'_1) .. O_L E_L M_L(q'_L) O_flange

g_k is the torque about joint k of link weights drawn for each arm, as a share of its largest over the workspace. The
*accuracy* is the RMS distance of the flange over `ALIGNED_ON` postures of the workspace after the constant transforms A
and B of base and flange that explain most are taken out:

    true = A nominal B        (least squares of 12 numbers, rotations weighted with `LEVER`)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from studies.one_model.chains import Array, Chain, cross_matrix, frames

LEVER = 0.3  # m: what a rotation counts for where frames are aligned
ALIGNED_ON = 400  # postures of the workspace
FACTOR = 1.8  # one sigma, from arm to arm, of the size of each group
# Relative sizes of the groups before they are scaled to the accuracy: rad, m.
OFFSETS, TILTS, LENGTHS, HARMONICS, SAG = 0.7e-3, 0.4e-3, 0.15e-3, 0.2e-3, 0.6e-3
REPEATABILITY = (0.02e-3, 0.05e-3)  # m, RMS at the flange


@dataclass(frozen=True, eq=False)
class TrueArm:
    """One arm with its errors, which are drawn once."""

    nominal: Chain
    offsets: Array  # (L,) rad
    tilts: Array  # (L, 3) rad, in the joint's frame, across its axis
    lengths: Array  # (L, 3) m
    harmonics: Array  # (L, 4) rad: sin q, cos q, sin 2q, cos 2q
    sag: Array  # (L,) rad at the largest torque
    weights: Array  # (L,) of the links, relative
    largest: Array  # (L,) torque, relative
    joint_sd: float = 0.0  # rad

    def scaled(self, factor: float) -> TrueArm:
        """Return the arm with all errors times ``factor``; the noise of its joints stays."""
        parts = ("offsets", "tilts", "lengths", "harmonics", "sag")
        return replace(self, **{name: factor * getattr(self, name) for name in parts})

    def moved(self, q: Array) -> Array:
        """Return the joint angles (n, L) that the arm takes where its controller says q, without noise."""
        waves = np.stack([np.sin(q), np.cos(q), np.sin(2 * q), np.cos(2 * q)], axis=-1)
        own = self.offsets + np.sum(self.harmonics * waves, axis=-1)
        return np.asarray(q + own + self.sag * torques(self.nominal, q, self.weights) / self.largest)

    def poses(self, q: Array, rng: np.random.Generator | None = None) -> Array:
        """Return the true base_T_flange (n, 4, 4) at reported joints q; with ``rng``, with noise of the joints."""
        moved = self.moved(q)
        if rng is not None:
            moved = moved + self.joint_sd * rng.standard_normal(q.shape)
        origins = []
        for origin, tilt, length in zip(self.nominal.origins, self.tilts, self.lengths, strict=True):
            E = np.eye(4)
            E[:3, :3], E[:3, 3] = Rotation.from_rotvec(tilt).as_matrix(), length
            origins.append(origin @ E)
        return frames(self.nominal, moved, origins)[2]


def torques(of: Chain, q: Array, weights: Array) -> Array:
    """Return torques (n, L) about the joints: each weight hangs at the next joint, the last one at the flange."""
    z, at, T = frames(of, q)
    hangs = np.concatenate([at[:, 1:], T[:, None, :3, 3]], axis=1)
    found = np.empty(q.shape)
    for k in range(of.n_joints):
        lever = hangs[:, k:] - at[:, k, None]
        found[:, k] = np.einsum(
            "m,nm->n", weights[k:], z[:, k, None, 0] * lever[..., 1] - z[:, k, None, 1] * lever[..., 0]
        )
    return found


def drawn_arm(of: Chain, accuracy: float, rng: np.random.Generator) -> tuple[TrueArm, Array, Array]:
    """Draw an arm of an accuracy (m; 0: it only repeats), and return it with A and B of its frames."""
    L = of.n_joints
    q = of.workspace(ALIGNED_ON, rng)
    nominal = of.poses(q)
    size = np.array([OFFSETS, TILTS, LENGTHS, HARMONICS, SAG]) * FACTOR ** rng.standard_normal(5)
    tilts = size[1] * rng.standard_normal((L, 3)) * (1.0 - np.abs(of.axes))
    weights = np.exp(0.5 * rng.standard_normal(L)) * np.linspace(2.0, 1.0, L)
    largest = np.maximum(np.abs(torques(of, q, weights)).max(axis=0), 1e-3)
    found = TrueArm(
        of,
        size[0] * rng.standard_normal(L),
        tilts,
        size[2] * rng.standard_normal((L, 3)),
        size[3] * rng.standard_normal((L, 4)),
        size[4] * rng.standard_normal(L),
        weights,
        largest,
    )
    if accuracy == 0.0:
        found = found.scaled(0.0)
        A, B = np.eye(4), np.eye(4)
    else:
        for _ in range(6):
            A, B, rms = aligned(found.poses(q), nominal)
            if abs(rms / accuracy - 1.0) < 1e-6:
                break
            found = found.scaled(accuracy / rms)
    shaken = of.poses(q + 1e-4 * rng.standard_normal(q.shape))[:, :3, 3] - nominal[:, :3, 3]
    wanted = float(np.exp(rng.uniform(*np.log(REPEATABILITY))))
    return replace(found, joint_sd=1e-4 * wanted / rms_length(shaken)), A, B


def aligned(true: Array, nominal: Array) -> tuple[Array, Array, float]:
    """Return A, B of ``true = A nominal B`` (n, 4, 4) by least squares, and the RMS distance (m) that is left."""
    A, B = np.eye(4), np.eye(4)
    for _ in range(3):
        now = A @ nominal @ B
        R, n = now[:, :3, :3], len(now)
        F = np.zeros((n, 6, 12))
        # columns: rotation and shift of A about the base's origin, rotation and shift of B in the flange
        F[:, :3, :3], F[:, :3, 6:9] = LEVER * np.eye(3), LEVER * R
        F[:, 3:, :3], F[:, 3:, 3:6], F[:, 3:, 9:] = -cross_matrix(now[:, :3, 3]), np.eye(3), R
        y = left_errors(true, now)
        y[:, :3] *= LEVER
        rows = F.reshape(-1, 12)
        a = np.asarray(np.linalg.solve(rows.T @ rows, rows.T @ y.ravel()))
        A, B = exponential(a[:6]) @ A, B @ exponential(a[6:])
    return A, B, rms_length(true[:, :3, 3] - (A @ nominal @ B)[:, :3, 3])


def exponential(a: Array) -> Array:
    """Return the pose (4, 4) of a rotation vector and a translation."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(a[:3]).as_matrix(), a[3:]
    return T


def left_errors(T: Array, of: Array) -> Array:
    """Return (theta, tau) (..., 6) with ``R = exp([theta]x) R_of``, ``t = t_of + tau``: rad and m."""
    turned = T[..., :3, :3] @ of[..., :3, :3].mT
    theta = Rotation.from_matrix(turned.reshape(-1, 3, 3)).as_rotvec().reshape(*turned.shape[:-2], 3)
    return np.concatenate([theta, T[..., :3, 3] - of[..., :3, 3]], axis=-1)


def rms_length(vectors: Array) -> float:
    """Return the RMS of the lengths of vectors (n, 3)."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))
