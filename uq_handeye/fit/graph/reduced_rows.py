"""Rows of the linearised constraint without the directions of (X, W) that stay open, for estimates of the noise.

Along an open direction (`open_directions`) the residuals do not change. With Q a basis of the other directions, the
rows ``r + J x`` become ``r + (J Q) y``, ``x = Q y``, and a prior of X and W becomes one of y.
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from ...core.geometry.se3 import Array
from ...errors import DegenerateMotionError
from ...model.errors.models import with_prior
from ...model.errors.pose_prior import PosePrior
from .constraint import Constraint, Linearised, Unknowns
from .open_directions import closed_basis, lever_of, rig_units, step_from
from .starts import isotropic_residuals


class Reduced(NamedTuple):
    """Rows of one problem by the unknowns that the data and the prior determine."""

    J: Array  # (n, 6, q), by unknowns along the directions that are not open
    basis: Array | None  # (p, q): unknowns of those; None: they are the same
    known: Array | None  # (q + 1, q + 1): what the prior adds to ``[J, r]^T S^-1 [J, r]``

    def unreduced(self, step: Array) -> Array:
        """Return a step of all unknowns."""
        return step if self.basis is None else step @ self.basis.T


def reduce_rows(
    constraint: Constraint,
    linear: Linearised,
    at: Unknowns,
    prior: PosePrior | None,
    nothing_open: bool = False,
) -> Reduced:
    """Remove the directions that are open with isotropic noise of the size of the residuals.

    Rows with leading axes are returned as they are, and so are rows of which ``nothing_open`` is known.
    """
    known: Array | None = None
    if prior is not None:
        more, pull, square = prior.normal_equations(at.X, at.W)
        known = np.block([[more, pull[:, None]], [pull, square]])
    if linear.r.ndim > 2 or nothing_open:
        return Reduced(linear.J, None, known)
    opened: Array | None = None
    with suppress(DegenerateMotionError):  # no X fits data with such large residuals
        opened = step_from(constraint, with_prior(isotropic_residuals(constraint, at), prior), at).open
    if opened is None:
        return Reduced(linear.J, None, known)
    basis = closed_basis(opened, rig_units(lever_of(constraint), len(opened)))
    if known is not None:
        wide = np.pad(basis, [(0, 1), (0, 1)])
        wide[-1, -1] = 1.0
        known = wide.T @ known @ wide
    return Reduced(linear.J @ basis, basis, known)
