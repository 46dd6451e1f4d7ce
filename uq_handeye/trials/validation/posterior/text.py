"""Text of a posterior: the six axes of X, the shape, the scales of the noise, and the diagnostics of the chain."""

from __future__ import annotations

import numpy as np

from ....core.geometry.se3 import Array
from ....core.presentation.document import Block, Document, Paragraph, Table, document_of
from ....core.presentation.numbers import digits
from ..monte_carlo.sums import LEVELS, UNITS
from ..outcome import part_of
from .result import Posterior


@document_of.register(Posterior)
def posterior_document(posterior: Posterior, verbose: bool = False) -> Document:
    """A headline, a table of the six axes, the shape, the scales and the diagnostics; or what is missing."""
    part = part_of("noise whose sizes are known but for these scales" if posterior.scales else "noise of known sizes",
                   posterior.stated)  # fmt: skip
    about = f"Posterior of {posterior.frame or 'X'}, {_model(posterior)}.{part}"
    start: list[Block | list[Block]] = [Paragraph(about)]
    diagnostics = Paragraph(_diagnostics(posterior))
    if not posterior.converged:
        faults = "; ".join(posterior.diagnostics.faults)
        return [*start, Paragraph(f"NOT CONVERGED, so that there are no numbers to report: {faults}."), diagnostics]
    if posterior.maxima > 1:
        start.append(Paragraph(_maxima(posterior)))
    shape: list[Block] = [Paragraph(_shape(posterior))]
    for side, s in posterior.scale_samples.items():
        low, middle, high = np.quantile(s, [0.025, 0.5, 0.975])
        text = f"Noise of {side}: {digits(middle)} times the standard deviations given "
        shape.append(Paragraph(f"{text}({digits(low)} to {digits(high)} with 95 %)."))
    return [*start, _table(posterior), shape, [diagnostics, Paragraph(_not_covered(posterior))]]


def _maxima(posterior: Posterior) -> str:
    """Say that no ellipsoid describes the posterior."""
    which = "neither" if posterior.maxima == 2 else "none of them"
    return (
        f"The posterior has {posterior.maxima} separate maxima: the data contradict each other. Mean and covariance "
        f"describe {which}; look at the corner plot and the samples."
    )


def _model(posterior: Posterior) -> str:
    likelihood = (
        "Gaussian" if posterior.student_t is None else f"Student-t ({posterior.student_t:g} degrees of freedom)"
    )
    noise = "noise estimated from the data" if posterior.noise_estimated else "noise given"
    scales = "" if posterior.scales is None else ", its scales free"
    return f"{likelihood} likelihood, flat prior on X, {noise}{scales}"


def _table(posterior: Posterior) -> Table:
    intervals = posterior.hpd(0.95).intervals
    bound = np.sqrt(np.diag(posterior.bound))
    head = ["", "unit", "mean - ml", "sd", "sd of ml", "ratio", "95 % from", "to", "R-hat", "ESS bulk", "ESS tail"]
    rows = []
    found = posterior.diagnostics
    for k, axis in enumerate(posterior.names[:6]):
        values: Array = np.array([posterior.mean[k], posterior.std[k], bound[k]]) * UNITS[k]
        low, high = intervals[k] * UNITS[k]
        rows.append(
            [
                axis,
                "deg" if k < 3 else "mm",
                f"{values[0]:+.2g}",
                digits(values[1]),
                digits(values[2]),
                f"{values[1] / values[2]:.3f}",
                f"{low:+.3g}",
                f"{high:+.3g}",
                f"{found.r_hat[k]:.4f}",
                f"{found.ess_bulk[k]:.0f}",
                f"{found.ess_tail[k]:.0f}",
            ]
        )
    return Table("", head, rows)


def _shape(posterior: Posterior) -> str:
    regions = [posterior.hpd(level) for level in LEVELS]
    contents = ", ".join(f"{100 * region.content:.1f} %" for region in regions)
    levels = ", ".join(f"{100 * level:g} %" for level in LEVELS)
    verdict = (
        "as those of a Gaussian do"
        if all(region.gaussian for region in regions)
        else "which is not what those of a Gaussian do: rely on the samples and intervals, not on the covariance alone"
    )
    return f"The {levels} ellipsoids of the samples' mean and covariance hold {contents} of the samples, {verdict}."


def _diagnostics(posterior: Posterior) -> str:
    found = posterior.diagnostics
    tau = found.autocorrelation_time
    longest = "unknown" if np.isnan(tau).any() else f"{tau.max():.1f} steps"
    return (
        f"{found.walkers} walkers, {found.steps} steps each after {found.burn_in} of burn-in; longest autocorrelation "
        f"time {longest}; {100 * found.acceptance:.0f} % of the proposals accepted; seed {posterior.seed}; "
        f"{posterior.seconds:.1f} s."
    )


def _not_covered(posterior: Posterior) -> str:
    student = "" if posterior.student_t is None else " Standard deviations given are the scale of the Student-t."
    return (
        "theta: left rotation, tau: translation, in the parent frame of X. Errors that poses share and the noise does "
        f"not say (wrong intrinsics, wrong robot kinematics) are not covered.{student}"
    )
