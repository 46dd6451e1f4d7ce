"""Simulated points of a target as a depth camera measures them; nothing here calls the package."""

import numpy as np
from support import logarithms, rotation_vectors, rotations, transforms


def rig(rng, n, m, lateral, axial, size=0.1):
    """Points (n, m, 3), the target (m, 3) and camera_T_target (n, 4, 4), 0.5 to 1.2 m away."""
    p = rng.uniform(-size, size, (m, 3))
    t = np.column_stack([rng.uniform(-0.2, 0.2, (n, 2)), rng.uniform(0.5, 1.2, n)])
    T = transforms(rotations(rotation_vectors(rng, (n,), 0.1, 1.5)), t)
    at = np.einsum("nab,mb->nma", T[:, :3, :3], p) + t[:, None]
    return noisy(rng, at, lateral, axial), p, T


def noisy(rng, at, lateral, axial):
    """Points with noise across and along the line of sight."""
    u = at / np.linalg.norm(at, axis=-1, keepdims=True)
    e = rng.normal(size=at.shape)
    along = np.sum(e * u, axis=-1, keepdims=True) * u
    return at + lateral * (e - along) + axial * along


def pose_errors(T, found):
    """xi (n, 6) of true poses against those found: left rotation, additive translation."""
    return np.concatenate([logarithms(T[:, :3, :3] @ found[:, :3, :3].mT), T[:, :3, 3] - found[:, :3, 3]], axis=-1)
