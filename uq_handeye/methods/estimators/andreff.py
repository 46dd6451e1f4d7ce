r"""Andreff, Horaud and Espiau (2001): all twelve entries of X by one linear least-squares problem.

The equations of `kronecker` are solved for x = (r, t) without the constraint that r be a rotation; the 3x3 block is
then replaced by the nearest rotation, and t is kept. (The publication also estimates an unknown scale of camera
translations from structure from motion; camera poses here are metric.) The result depends on the unit of length, which
weighs translation against rotation equations. Nothing but the translations fixes the scale of r: where they are small
against the noise it shrinks, and t with it.

The normal equations square the condition of the problem; one step of iterative refinement with the residuals of the
data themselves makes up for it.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.se3 import Array
from ...model.noise.models import PairNoise
from ..procrustes.limit import pair_blocks, trial_blocks
from .common.linear import (
    SHAPE,
    Normal,
    kronecker_factors,
    normal,
    normal_equations,
    require_axes,
    require_scale,
    residual_gradient,
    slopes,
    turn_of,
)
from .common.method import Estimate, Method, closed_form
from .common.moments import Moments, MomentSolver


def _linear(moments: Moments, N: int) -> tuple[Normal, Array]:
    G, g = normal_equations(moments[0])
    require_axes(G[:, 9:, 9:], N)
    equations = normal(G)
    return equations, equations.solve(g)


def _projected(x: Array) -> Estimate:
    M = x[:, :9].reshape(-1, 3, 3)
    require_scale(M)
    X = np.zeros((len(x), 4, 4))
    X[:, :3, :3] = orthonormalise(M)
    X[:, :3, 3] = x[:, 9:]
    X[:, 3, 3] = 1.0
    return closed_form(X)


def _solution(moments: Moments, N: int) -> Estimate:
    return _projected(_linear(moments, N)[1])


def _slopes(moments: Moments, N: int) -> list[Array]:
    equations, x = _linear(moments, N)
    M = x[:, :9].reshape(-1, 3, 3)
    dx = slopes(normal_equations, SHAPE, equations, x)
    by_moments = np.concatenate([turn_of(M, orthonormalise(M), dx[:, :9]), dx[:, 9:]], axis=1)
    return [by_moments.reshape(-1, 6, *SHAPE)]


class _Refined(MomentSolver):
    def estimate(self, A: Array, B: Array, noise: PairNoise | None) -> Estimate:
        equations, x = _linear(self.moments(A, B, None), A.shape[1])
        gradient = np.zeros_like(x)
        for trials, pairs in product(trial_blocks(*A.shape[:2]), pair_blocks(A.shape[1])):
            gradient[trials] += residual_gradient(A[trials, pairs], B[trials, pairs], x[trials])
        return _projected(x - equations.solve(gradient))


METHOD = Method(
    name="andreff",
    authors="N. Andreff, R. Horaud and B. Espiau",
    year=2001,
    title="Robot Hand-Eye Calibration Using Structure-from-Motion. Int. J. Robotics Research 20(3), 228-248",
    doi="10.1177/02783640122067372",
    structure="simultaneous",
    form="closed form",
    minimises="sum |R_A R R_B^T - R|^2 + |R t_B + t - R_A t - t_A|^2 over any 3x3 matrix R and t; then R is projected",
    singular="translations that are zero, or small against the noise: only they fix the scale of R",
    solver=_Refined(kronecker_factors, _solution, slopes=_slopes, axes=False),
)
