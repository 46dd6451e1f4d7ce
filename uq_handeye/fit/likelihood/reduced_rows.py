"""The linearised constraint without the directions that stay open, for estimates of the noise."""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from ...core.geometry.se3 import Array
from ...errors import DegenerateMotionError
from ...model.noise.models import with_prior
from ...model.noise.pose_prior import PosePrior
from ...model.noise.square_roots import cholesky_of, gram, weighted, whiten
from .constraint import Constraint, Linearised, Unknowns, residual_covariance
from .open_directions import closed_basis, lever_of, rig_units, solve_information
from .open_start import isotropic_residuals


class Reduced(NamedTuple):
    """Rows of one problem by what the data and the prior determine, for estimates of the noise."""

    J: Array  # (n, 6, q), by unknowns along the directions that are not open
    basis: Array | None  # (p, q): unknowns of those; None: they are the same
    known: Array | None  # (q + 1, q + 1): what the prior adds to ``[J, r]^T S^-1 [J, r]``

    def unreduced(self, step: Array) -> Array:
        """A step of all unknowns."""
        return step if self.basis is None else step @ self.basis.T


def reduce_rows(
    constraint: Constraint,
    linear: Linearised,
    at: Unknowns,
    weights: Array | None,
    prior: PosePrior | None,
    nothing_open: bool = False,
) -> Reduced:
    """Rows without the directions that are open beside isotropic noise of the size of the residuals.

    Leading axes are kept as they are: all directions count then, as where ``nothing_open`` is known.
    """
    known: Array | None = None
    if prior is not None:
        more, pull, square = prior.normal_equations(at.X, at.W)
        known = np.block([[more, pull[:, None]], [pull, square]])
    if linear.r.ndim > 2 or nothing_open:
        return Reduced(linear.J, None, known)
    noise = with_prior(isotropic_residuals(constraint, at), prior)
    S = residual_covariance(linear.sides, noise)
    factor = cholesky_of(S if weights is None else weighted(S, weights))
    information = gram(whiten(factor, linear.J)) + (0.0 if known is None else known[:-1, :-1])
    opened: Array | None = None
    with suppress(DegenerateMotionError):  # residuals that large are those of data that do not fit
        opened = solve_information(information, linear, constraint, noise, S, weights, False).open
    if opened is None:
        return Reduced(linear.J, None, known)
    basis = closed_basis(opened, rig_units(lever_of(constraint), len(opened)))
    if known is not None:
        wide = np.pad(basis, [(0, 1), (0, 1)])
        wide[-1, -1] = 1.0
        known = wide.T @ known @ wide
    return Reduced(linear.J @ basis, basis, known)
