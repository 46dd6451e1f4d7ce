"""What a calibration at the bound knows beyond X, as text: noise, test of fit, 4DPA, poses, budget, diagnostics."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from ..noise import PairNoise, marginals
from ..se3 import Array

if TYPE_CHECKING:
    from ..result import Calibration

WIDTH = 118
# Poses that a text lists; the table of the result has them all.
MOST_LISTED = 12


def noise_lines(result: Calibration) -> list[str]:
    """The noise given or estimated, and what the residuals say of it."""
    lines: list[str] = []
    estimate = result.noise_estimate
    if estimate is not None:
        lines.append("Noise, estimated from the residuals (standard deviation per axis, 95 % interval):")
        lines += [f"  {component}" for component in estimate.components]
        lines += [line for text in estimate.statement for line in _wrapped(text)]
    elif result.noise is not None:
        lines.append("Noise as given (standard deviation per axis, mean over axes and poses):")
        lines += _given(result)
    if result.fit is not None:
        fit = result.fit
        start = f"Fit: chi-square {fit.chi2:.1f} with {fit.dof:.0f} degrees of freedom, sigma_0 = {fit.sigma0:.2f}"
        parts = f"rotation {fit.rotation_sigma0:.2f}, translation {fit.translation_sigma0:.2f}"
        if estimate is not None and not estimate.has_prior:
            lines += _wrapped(f"{start} ({parts}); close to 1 by construction, as the noise comes from them.", first="")
        else:
            verdict = "the noise explains the residuals" if fit.p_value > 0.01 else _misfit(fit.sigma0)
            lines += _wrapped(f"{start} ({parts}), p = {fit.p_value:.2g}: {verdict}.", first="")
    return lines


def _misfit(sigma0: float) -> str:
    if sigma0 > 1:
        return f"the residuals are {sigma0:.2g} times what the noise explains; standard deviations are too small"
    return f"the residuals are {1 / sigma0:.2g} times smaller than the noise explains"


def _given(result: Calibration) -> list[str]:
    noise = result.noise
    names = ("A", "B") if isinstance(noise, PairNoise) else ("robot", "camera")
    lines = []
    for name in names:
        S = getattr(noise, name)
        if S is None:
            lines.append(f"  {name}: exact")
            continue
        variances = np.diagonal(marginals(S), axis1=-2, axis2=-1).reshape(-1, 2, 3).mean(axis=(0, 2))
        turn, move = np.degrees(np.sqrt(variances[0])), 1e3 * np.sqrt(variances[1])
        lines.append(f"  {name}: rotation {turn:.3g} deg, translation {move:.3g} mm")
    return lines


def beside_lines(result: Calibration) -> list[str]:
    """4DPA's own answer and its efficiency."""
    beside, efficiency = result.fourdpa, result.efficiency
    if beside is None or beside.covariance is None or efficiency is None:
        return []
    sd = np.sqrt(np.diag(beside.covariance))
    t, s = 1e3 * beside.X[:3, 3], 1e3 * sd[3:]
    position = "   ".join(f"{'xyz'[k]} {t[k]:.4f} +- {s[k]:.3g}" for k in range(3))
    return [
        "4DPA alone, on the same data:",
        f"  translation (mm)       {position}",
        f"  standard deviations    {efficiency.min():.2f} to {efficiency.max():.2f} times the Cramer-Rao bound, which "
        f"{result.method} attains",
    ]


def covariance_lines(result: Calibration) -> list[str]:
    """Standard deviations by every covariance, side by side."""
    analysis = result.analysis
    if analysis is None:
        return []
    lines = ["Standard deviations by           rotation x, y, z (deg)        translation x, y, z (mm)"]
    meaning = {
        "model": "model (the noise)",
        "sandwich": "sandwich, by pose",
        "hac": "hac, for neighbours",
        "jackknife": "jackknife",
        "bootstrap": "bootstrap",
    }
    for kind, S in analysis.covariances.items():
        mark = "*" if kind == result.covariance_kind else " "
        label = f"{mark} {meaning.get(kind, kind):28s}"
        if S is None:
            lines += _wrapped(f"{label} not determined: {analysis.reasons[kind]}", indent="    ")
            continue
        sd = np.sqrt(np.diag(S))
        turn = " ".join(f"{np.degrees(x):9.4g}" for x in sd[:3])
        move = " ".join(f"{1e3 * x:9.4g}" for x in sd[3:])
        lines.append(f"{label} {turn}   {move}")
    return [*lines, "* is the covariance of the result; all but the first need no noise model."]


def pose_lines(result: Calibration) -> list[str]:
    """The poses that are flagged."""
    table = result.table
    if table is None:
        return []
    if not table.flagged:
        return [f"No {table.item} stands out: all {len(table)} lie within their 99.9 % ellipsoids."]
    order = sorted(table.flagged, key=lambda k: -table.distance2[k])
    lines = [
        f"{len(order)} of {len(table)} {table.item}s stand out (numbered from 0; d^2 is 6 in the mean, beyond "
        f"{table.limit:.3g} rare):"
    ]
    for k in order[:MOST_LISTED]:
        turn, move = np.degrees(table.rotation[k]), 1e3 * table.translation[k]
        away = f"{turn:.3g} deg, {move:.3g} mm, d^2 = {table.distance2[k]:.4g}"
        lines.append(f"  {table.item} {k}: {away}, {table.flag[k]}")
    if len(order) > MOST_LISTED:
        lines.append(f"  and {len(order) - MOST_LISTED} more; see the table of the result")
    return lines


def budget_lines(result: Calibration) -> list[str]:
    """Which share of the variance of X comes from which source."""
    analysis = result.analysis
    if analysis is None:
        return []
    budget = analysis.budget
    shares: dict[str, Array] = budget.group_shares
    width = max(len(name) for name in budget.sources)
    lines = ["Share of the variance of X by its source:"]
    for k, source in enumerate(budget.sources):
        parts = (f"{100 * shares[f'X {kind}'][k]:5.1f} % of {kind}" for kind in ("rotation", "translation"))
        lines.append(f"  {source:{width}s}  {'   '.join(parts)}")
    return lines


def diagnosis_lines(result: Calibration) -> list[str]:
    """Diagnostics and split halves in words."""
    analysis = result.analysis
    if analysis is None:
        return []
    texts = [*analysis.diagnostics.sentences(), analysis.split_half.sentence, analysis.split_in_time.sentence]
    return ["Diagnostics:", *(line for text in texts for line in _wrapped(f"- {text}", indent="    ", first="  "))]


def _wrapped(text: str, indent: str = "  ", first: str | None = None) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=indent if first is None else first, subsequent_indent=indent)
