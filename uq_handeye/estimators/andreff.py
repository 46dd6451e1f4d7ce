r"""Andreff, Horaud and Espiau (2001): all twelve entries of X by one linear least-squares problem.

The equations of `kronecker` are solved for x = (r, t) without the constraint that r be a rotation; the 3x3 block is
then replaced by the nearest rotation, and t is kept. (The publication also estimates an unknown scale of camera
translations from structure from motion; camera poses here are metric.) The result depends on the unit of length, which
weighs translation against rotation equations.
"""

from __future__ import annotations

import numpy as np

from ..procrustes import DEGENERATE, orthonormalise
from .kronecker import kronecker_factors, normal_equations
from .method import Estimate, Method, closed_form, require
from .moments import Moments, MomentSolver


def _solution(moments: Moments, N: int) -> Estimate:
    G, g = normal_equations(moments[0], N)
    # columns of t to the size of those of r, which changes nothing but the rounding
    diagonal = np.sqrt(np.maximum(np.diagonal(G, axis1=-2, axis2=-1), 1e-300))
    scaled = G / (diagonal[:, :, None] * diagonal[:, None, :])
    values = np.linalg.eigvalsh(scaled)
    require(values[:, 0] > DEGENERATE * values[:, -1], "its linear equations are singular.")
    x = np.linalg.solve(scaled, (g / diagonal)[..., None])[..., 0] / diagonal
    X = np.zeros((len(x), 4, 4))
    X[:, :3, :3] = orthonormalise(x[:, :9].reshape(-1, 3, 3))
    X[:, :3, 3] = x[:, 9:]
    X[:, 3, 3] = 1.0
    return closed_form(X)


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
    solver=MomentSolver(kronecker_factors, _solution, axes=False),
)
