"""Figure of a cross-check: the ellipses of its covariances in the 15 pairs of components (`ellipses`).

It is like Fig. 5 of the paper, and also shows rotation against translation. All ellipses are drawn about 0, including
that of the posterior, so that sizes and directions can be compared.

This module imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ...core.presentation.ellipses import covariance_ellipses
from .cross_check.result import CrossCheck
from .outcome import figure_of

# Rows of a cross-check that are drawn: of each group the first there is, and its name.
DRAWN = (
    (("4dpa-poses", "4dpa-pairs"), "4DPA, first order"),
    (("4dpa-sampled",), "4DPA, Monte Carlo"),
    (("nguyen-own",), "Nguyen and Pham, own"),
    (("bound",), "bound (efficient, ml)"),
    (("posterior",), "posterior"),
)


@figure_of.register
def cross_check_figure(check: CrossCheck) -> Figure:
    """The ellipses, with the errors of the trials of 4DPA."""
    known = {row.key: row.covariance for row in check.rows if row.covariance is not None}
    drawn = {label: known[key] for keys, label in DRAWN if (key := next(filter(known.__contains__, keys), ""))}
    (label, first), *others = drawn.items() or [("none", np.zeros((6, 6)))]
    samples = check.runs["4dpa"].errors if "4dpa" in check.runs else None
    return covariance_ellipses(check.X, first, samples=samples, others=dict(others), label=label, title=check.frame)
