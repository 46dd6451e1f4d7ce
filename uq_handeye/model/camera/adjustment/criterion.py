r"""Bayesian information criterion of camera models and board shapes, and the model that it chooses.

A candidate with p free parameters that all pictures share, and the sum of squares Q of the N coordinates that count in
n pictures, has (G. Schwarz, Annals of Statistics 6 (1978))

    BIC = nu ln(Q / nu) + p ln nu  nu / (nu - p - 2),    nu = N - 6 n

and the smallest is best. nu takes the place of N as the poses of the pictures have 6 numbers each, whatever the
candidate. Their marginal likelihood has the exponent nu / 2; with N the profile likelihood counts the fit of the poses
as evidence (J. Neyman, E. Scott, Econometrica 16 (1948)), which for boards of few corners selects coefficients that are
not there. The last
factor is the correction for few residuals (A. McQuarrie, Statistics & Probability Letters 44 (1999)): ln Q falls by
more than chi-square predicts where p is no small part of nu; with many corners it is 1.
The criterion takes residuals of different corners as independent. Where they are not it selects more coefficients than
there are; that does little harm, as X is then only a little less certain, while a missing one shifts X.

A lens with distortion is never centred exactly. The decentring p1, p2 may be too small for the criterion, and still
rotates X by several standard deviations where it is taken as 0: with k1 = -0.1, p1 = 3e-4, p2 = -2e-4 and 20 pictures
of 54 corners the criterion alone took k1 only, and the truth lay in its 95 % ellipsoid in 6 sets of 24; with p1 and p2
free in 23. Where a radial model has the smallest BIC, `best` therefore takes the best of those that hold p1 and p2
as well. A camera without any distortion, as in rendered pictures, remains a pinhole. For the same reason a fisheye,
which has no decentring, is taken only where its BIC is smaller by `CLEAR_BIC_DIFFERENCE`: through a narrow
lens both fit as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ....core.rounding import TINY
from ..board_shape import FLAT

# A difference of BIC above it is very strong evidence (R. Kass, A. Raftery, J. Amer. Stat. Assoc. 90 (1995)).
CLEAR_BIC_DIFFERENCE = 10.0
DECENTRING = frozenset(("p1", "p2"))


class Candidate(NamedTuple):
    """A model that was tried."""

    model: str
    coefficients: tuple[str, ...]
    bic: float  # infinite where the fit did not succeed
    rms: float  # of the residuals, pixels per coordinate
    shape: str = FLAT  # of the board
    centre: tuple[float, float] | None = None  # cx, cy (px); None where it was read from a file

    @property
    def lens(self) -> str:
        """Model and coefficients."""
        return self.model + (f" ({', '.join(self.coefficients)})" if self.coefficients else "")


def best(candidates: Sequence[Candidate]) -> Candidate | None:
    """The one to take; None if no fit succeeded."""
    fitted = [c for c in candidates if np.isfinite(c.bic)]
    found = min((c for c in fitted if c.model != "fisheye"), key=lambda c: c.bic, default=None)
    if found is not None and found.model == "brown" and not set(found.coefficients) >= DECENTRING:
        whole = [c for c in fitted if c.model == "brown" and set(c.coefficients) >= DECENTRING]
        found = min(whole, key=lambda c: c.bic, default=found)
    wide = min((c for c in fitted if c.model == "fisheye"), key=lambda c: c.bic, default=None)
    return wide if found is None or (wide is not None and wide.bic < found.bic - CLEAR_BIC_DIFFERENCE) else found


def criterion(squares: float, coordinates: int, pictures: int, parameters: int) -> float:
    """BIC of the sum of squares of the residuals; see the module."""
    nu = max(coordinates - 6 * pictures, 1)
    return float(nu * np.log(max(squares, TINY) / nu) + price(parameters, nu))


def price(parameters: int, nu: int) -> float:
    """Return what BIC adds for the parameters, with the correction for few residuals."""
    return float(parameters * np.log(nu) * nu / max(nu - parameters - 2, 1))
