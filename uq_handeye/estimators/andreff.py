r"""Andreff, Horaud and Espiau (2001): all twelve entries of X by one linear least-squares problem.

The equations of `kronecker` are solved for x = (r, t) without the constraint that r be a rotation; the 3x3 block is
then replaced by the nearest rotation, and t is kept. (The publication also estimates an unknown scale of camera
translations from structure from motion; camera poses here are metric.) The result depends on the unit of length, which
weighs translation against rotation equations.

The normal equations square the condition of the problem; one step of iterative refinement with the residuals of the
data themselves makes up for it.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ..noise import PairNoise
from ..procrustes import orthonormalise, pair_blocks, trial_blocks
from ..se3 import Array
from .kronecker import kronecker_factors, normal_equations, residual_gradient
from .method import Estimate, Method, closed_form, require
from .moments import Moments, MomentSolver

# Ratio of the eigenvalues of the normal equations, scaled to equal diagonals, below which the least is rounding.
SINGULAR = 1e-13


def _solver_of(G: Array) -> tuple[Array, Array]:
    """``diag(d) G diag(d)`` with the diagonal 1, and d: columns of t to the size of those of r."""
    d = 1.0 / np.sqrt(np.maximum(np.diagonal(G, axis1=-2, axis2=-1), 1e-300))
    scaled = G * d[:, :, None] * d[:, None, :]
    values = np.linalg.eigvalsh(scaled)
    require(values[:, 0] > SINGULAR * values[:, -1], "its linear equations are singular.")
    return scaled, d


def _projected(x: Array) -> Estimate:
    X = np.zeros((len(x), 4, 4))
    X[:, :3, :3] = orthonormalise(x[:, :9].reshape(-1, 3, 3))
    X[:, :3, 3] = x[:, 9:]
    X[:, 3, 3] = 1.0
    return closed_form(X)


def unrefined(moments: Moments, N: int) -> Estimate:
    G, g = normal_equations(moments[0], N)
    scaled, d = _solver_of(G)
    return _projected(np.linalg.solve(scaled, (g * d)[..., None])[..., 0] * d)


class _Refined(MomentSolver):
    def estimate(self, A: Array, B: Array, noise: PairNoise | None) -> Estimate:
        G, g = normal_equations(self.moments(A, B, None)[0], A.shape[1])
        scaled, d = _solver_of(G)
        x = np.linalg.solve(scaled, (g * d)[..., None])[..., 0] * d
        gradient = np.zeros_like(x)
        for trials, pairs in product(trial_blocks(*A.shape[:2]), pair_blocks(A.shape[1])):
            gradient[trials] += residual_gradient(A[trials, pairs], B[trials, pairs], x[trials])
        return _projected(x - np.linalg.solve(scaled, (gradient * d)[..., None])[..., 0] * d)


METHOD = Method(
    name="andreff",
    authors="N. Andreff, R. Horaud and B. Espiau",
    year=2001,
    title="Robot Hand-Eye Calibration Using Structure-from-Motion. Int. J. Robotics Research 20(3), 228-248",
    doi="10.1177/02783640122067372",
    structure="simultaneous",
    form="closed form",
    minimises="sum |R_A R R_B^T - R|^2 + |R t_B + t - R_A t - t_A|^2 over any 3x3 matrix R and t; then R is projected",
    singular="none beyond parallel rotation axes; without any translation R is determined only up to a factor",
    solver=_Refined(kronecker_factors, unrefined, axes=False),
)
