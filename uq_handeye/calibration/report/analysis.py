"""What a calibration at the bound knows beyond X, as text: noise, test of fit, 4DPA, poses, budget, diagnostics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...diagnostics.budget import SHARED
from ...formatting.numbers import digits, pose_rows, probability
from ...formatting.paragraphs import wrapped
from ...geometry.pose_numbers import pose_numbers
from ...geometry.se3 import Array
from ...noise.models import PairNoise, is_joint, marginals

if TYPE_CHECKING:
    from ...likelihood.goodness_of_fit import GoodnessOfFit
    from ...noise.models import Noise
    from ..result import Calibration

KINDS = ("rotation", "translation")
# Poses that a text lists; the table of the result has them all.
MOST_LISTED = 12
# A part of the residuals is off beyond so many standard deviations of its sigma_0, and by this share.
FAR, MUCH = 4.0, 0.1


def noise_lines(result: Calibration) -> list[str]:
    """The noise given or estimated, and what the residuals say of it."""
    lines: list[str] = []
    estimate = result.noise_estimate
    if estimate is not None:
        beside = " beside that of the camera" if estimate.from_corners else ""
        lines.append(f"Noise, estimated from the residuals{beside} (standard deviation per axis, 95 % interval):")
        lines += [f"  {component}" for component in estimate.components]
        lines += [line for text in estimate.statement for line in wrapped(text)]
    elif result.noise is not None:
        lines.append("Noise as given (standard deviation per axis, mean over axes and poses):")
        lines += _given(result.noise)
    if result.fit is not None:
        lines.append(_counts(result))
        lines += _fit_lines(result.fit, by_construction=estimate is not None and not estimate.tested)
    elif estimate is not None and estimate.noise is not None:
        lines.append(f"  The residuals have {estimate.dof:.0f} degrees of freedom.")
    return lines


def _counts(result: Calibration) -> str:
    """How many numbers were fitted by how many."""
    variables = "6 variables (of X)" if result.W is None else "12 variables (of X and W)"
    n = result.n_pairs if result.table is None else len(result.table)
    of = "motion" if result.table is None else result.table.item
    return f"Data: {6 * n} residuals (6 of each {of}), {variables}."


def _fit_lines(fit: GoodnessOfFit, by_construction: bool) -> list[str]:
    first, second, *third = fit_sentences(fit, by_construction)
    return [*wrapped(first, first=""), *wrapped(second, first=""), *(line for text in third for line in wrapped(text))]


def fit_sentences(fit: GoodnessOfFit, by_construction: bool) -> list[str]:
    """The chi-square test in words, sigma_0, and where it is so what the noise gets wrong.

    ``by_construction``: the noise is made of the same residuals, so that the test says nothing.
    """
    start = f"Fit: chi-square {fit.chi2:.1f} with {fit.dof:.0f} degrees of freedom (reduced: {fit.chi2 / fit.dof:.2f})"
    if by_construction:
        text = f"{start}; near their number by construction, as the noise comes from them."
    else:
        verdict = "the noise explains the residuals" if fit.p_value > 0.01 else _misfit(fit.sigma0)
        text = f"{start}, {probability(fit.p_value, 2)}: {verdict}."
    parts = {"rotation": fit.rotation_sigma0, "translation": fit.translation_sigma0}
    sentences = [
        text,
        f"sigma_0: 1 before the fit (prior), {fit.sigma0:.2f} after the fit (posterior; "
        f"{', '.join(f'{name} {value:.2f}' for name, value in parts.items())}).",
    ]
    # Each part has about half of the degrees of freedom, and its sigma_0 the deviation 1 / sqrt(2 dof / 2).
    least = max(FAR / np.sqrt(fit.dof), MUCH)
    off = [name for name, value in parts.items() if abs(value - 1) > least]
    if off and (by_construction or fit.p_value > 0.01):
        how = " and ".join(f"{name} {digits(parts[name])} times" for name in off)
        sentences.append(
            f"The residuals are not what this noise makes of them ({how} as large): the model of the noise is wrong."
        )
    return sentences


def _misfit(sigma0: float) -> str:
    if sigma0 > 1:
        return f"the residuals are {digits(sigma0, 2)} times what the noise explains; standard deviations are too small"
    return f"the residuals are {digits(1 / sigma0, 2)} times smaller than the noise explains"


def _given(noise: Noise) -> list[str]:
    return [
        f"  {name}: exact"
        if size is None
        else f"  {name}: rotation {size[0]:.3g} deg, translation {size[1]:.3g} mm{_joint(getattr(noise, name))}"
        for name, size in noise_sizes(noise).items()
    ]


def _joint(S: Any) -> str:
    return ", correlated over the poses by errors that they share" if is_joint(S) else ""


def noise_sizes(noise: Noise) -> dict[str, tuple[float, float] | None]:
    """Standard deviation per axis (deg, mm) of each side, in the mean over axes and poses; None: exact."""
    sizes: dict[str, tuple[float, float] | None] = {}
    for name in ("A", "B") if isinstance(noise, PairNoise) else ("robot", "camera"):
        S = getattr(noise, name)
        if S is None:
            sizes[name] = None
            continue
        variances = np.diagonal(marginals(S), axis1=-2, axis2=-1).reshape(-1, 2, 3).mean(axis=(0, 2))
        sizes[name] = float(np.degrees(np.sqrt(variances[0]))), float(1e3 * np.sqrt(variances[1]))
    return sizes


def beside_lines(result: Calibration) -> list[str]:
    """4DPA's own answer and its efficiency; of a bundle adjustment, how far it is from `efficient`."""
    beside, efficiency = result.fourdpa, result.efficiency
    lines = [] if result.agreement is None else [*wrapped(result.agreement.sentence, first=""), ""]
    if beside is None or beside.covariance is None or efficiency is None:
        return lines[:-1]
    return [
        *lines,
        "4DPA alone, on the same data:",
        *(f"  {line}" for line in pose_rows(*pose_numbers(beside.X, beside.covariance))),
        f"  standard deviations    {efficiency.min():.2f} to {efficiency.max():.2f} times the Cramer-Rao bound, which "
        f"{result.method} attains",
    ]


def covariance_lines(result: Calibration) -> list[str]:
    """Standard deviations by every covariance, side by side."""
    analysis = result.analysis
    if analysis is None:
        return []
    lines = ["Standard deviations by           rotation x, y, z (deg)        translation x, y, z (mm)"]
    meaning = covariance_names(result)
    without: dict[str, list[str]] = {}  # kinds by the reason
    for kind, S in analysis.covariances.items():
        if S is None:
            without.setdefault(analysis.reasons[kind], []).append(kind)
            continue
        mark = "*" if kind == result.covariance_kind else " "
        label = f"{mark} {meaning.get(kind, kind):28s}"
        sd = np.sqrt(np.diag(S))
        turn = " ".join(f"{np.degrees(x):9.4g}" for x in sd[:3])
        move = " ".join(f"{1e3 * x:9.4g}" for x in sd[3:])
        lines.append(f"{label} {turn}   {move}")
    for reason, kinds in without.items():
        lines += wrapped(f"  {', '.join(kinds)}: not determined: {reason}", indent="    ", first="")
    return [*lines, "* is the covariance of the result; all but the first need no noise model."]


def covariance_names(result: Calibration) -> dict[str, str]:
    """What each of the covariances is called in a table."""
    return {
        "model": "model (the noise)",
        "sandwich": f"sandwich, by {'pose' if result.table is None else result.table.item}",
        "hac": "hac, for neighbours",
        "jackknife": "jackknife",
        "bootstrap": "bootstrap",
    }


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
        away = f"{digits(turn)} deg, {digits(move)} mm, d^2 = {digits(table.distance2[k], 4)}"
        lines.append(f"  {table.item} {k}: {away}, {table.status(k)}")
    if len(order) > MOST_LISTED:
        lines.append(f"  and {len(order) - MOST_LISTED} more; see the table of the result")
    return lines


def budget_lines(result: Calibration) -> list[str]:
    """Which share of the variance of X comes from which source."""
    rows = budget_shares(result)
    if not rows:
        return []
    width = max(len(name) for name in rows)
    lines = ["Share of the variance of X by its source:"]
    for name, share in rows.items():
        parts = (f"{100 * part:5.1f} % of {kind}" for part, kind in zip(share, KINDS, strict=True))
        lines.append(f"  {name:{width}s}  {'   '.join(parts)}")
    return lines


def budget_shares(result: Calibration) -> dict[str, Array]:
    """Shares (2,) of the variances of X's rotation and translation by source; nothing where there is no budget."""
    if result.analysis is None:
        return {}
    budget = result.analysis.budget
    shares = np.stack([budget.group_shares[f"X {kind}"] for kind in KINDS], axis=-1)  # (sources, 2)
    # Where errors are coupled, the shares of one side may be beyond 100 % and below 0: only their sum means something.
    coupled = [side for side in ("robot", "camera", "A", "B") if _coupled(result, side, budget.sources)]
    rows: dict[str, Array] = {}
    for source, share in zip(budget.sources, shares, strict=True):
        side = source.split()[0]
        name = f"{side} (rotation and translation)" if side in coupled else source
        rows[name] = rows.get(name, 0.0) + share
    return rows


def _coupled(result: Calibration, side: str, sources: tuple[str, ...]) -> bool:
    S = getattr(result.noise, side, None)
    split = f"{side} {SHARED}" in sources  # into what has no coupling
    return f"{side} coupling" in sources or (S is not None and is_joint(S) and not split)


# The directions stand among the numbers of the summary, what is not covered at its end.
_SAID_ELSEWHERE = {"diagnostics.direction", "diagnostics.systematic"}


def diagnosis_lines(result: Calibration) -> list[str]:
    """Diagnostics and split halves in words."""
    analysis = result.analysis
    if analysis is None:
        return []
    lower_bound = any(finding.code == "diagnostics.lower_bound" for finding in result.findings)
    elsewhere = _SAID_ELSEWHERE | ({"diagnostics.independent_camera"} if lower_bound else set())
    found = [f for f in analysis.diagnostics.findings if f.code not in elsewhere]
    found.sort(key=lambda f: f.code != "diagnostics.joint_spectrum")  # that one first
    found += [analysis.split_half.finding, analysis.split_in_time.finding]
    below = [f for f in found if f not in result.findings]
    title = f"Diagnostics{' (see the cautions above)' if len(below) < len(found) else ''}:"
    return [title, *(line for f in below for line in wrapped(f"- {f}", indent="    ", first="  "))]
