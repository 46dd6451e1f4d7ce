"""The method `andreff`: all twelve entries of X by one linear least-squares problem."""

from __future__ import annotations

from itertools import product

import numpy as np

from ..core.geometry.nearest_rotation import orthonormalise
from ..core.geometry.se3 import Array, pose
from .kronecker import kronecker_factors, normal_equations, residual_gradient
from .linear import Normal, normal, require_axes, require_scale, slopes, turn_of
from .method import Estimate, Method, closed_form, published
from .moments import Moments, MomentSolver
from .pairs import pair_blocks, trial_blocks


def _andreff_linear(moments: Moments, N: int) -> tuple[Normal, Array]:
    G, g = normal_equations(moments[0])
    require_axes(G[:, 9:, 9:], N)
    equations = normal(G)
    return equations, equations.solve(g)


def _andreff_projected(x: Array) -> Estimate:
    M = x[:, :9].reshape(-1, 3, 3)
    require_scale(M)
    return closed_form(pose(orthonormalise(M), x[:, 9:]))


def _andreff(moments: Moments, N: int) -> Estimate:
    r"""Andreff, Horaud and Espiau (2001): all twelve entries of X by one linear least-squares problem.

    The equations of the module are solved for x = (r, t) without the constraint that r be a rotation; the 3x3 block is
    then replaced by the nearest rotation, and t is kept. (The publication also estimates an unknown scale of camera
    translations from structure from motion; camera poses here are metric.) The result depends on the unit of length,
    which weighs translation against rotation equations. Nothing but the translations fixes the scale of r: where they
    are small against the noise it shrinks, and t with it.

    The normal equations square the condition of the problem; one step of iterative refinement with the residuals of the
    data themselves makes up for it.
    """
    return _andreff_projected(_andreff_linear(moments, N)[1])


def _andreff_slopes(moments: Moments, N: int) -> list[Array]:
    equations, x = _andreff_linear(moments, N)
    M = x[:, :9].reshape(-1, 3, 3)
    dx = slopes(normal_equations, moments[0].shape[1:], equations, x)
    by_moments = np.concatenate([turn_of(M, orthonormalise(M), dx[:, :9]), dx[:, 9:]], axis=1)
    return [by_moments.reshape(-1, 6, *moments[0].shape[1:])]


def _andreff_refined(A: Array, B: Array, moments: Moments) -> Estimate:
    """Apply one step of iterative refinement by the residuals of the motions (T, N, 4, 4) themselves."""
    equations, x = _andreff_linear(moments, A.shape[1])
    gradient = np.zeros_like(x)
    for trials, pairs in product(trial_blocks(*A.shape[:2]), pair_blocks(A.shape[1])):
        gradient[trials] += residual_gradient(A[trials, pairs], B[trials, pairs], x[trials])
    return _andreff_projected(x - equations.solve(gradient))


ANDREFF = Method(
    **published("andreff"),
    solver=MomentSolver(kronecker_factors, _andreff, slopes=_andreff_slopes, refined=_andreff_refined, axes=False),
    mathematics=_andreff.__doc__,
)
