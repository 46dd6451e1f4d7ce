"""The noise of a calibration as blocks of text and page, with the chi-square test of the residuals."""

from __future__ import annotations

import numpy as np

from ...core.levels import RARE
from ...core.presentation.document import Block, Paragraph, Points, Table
from ...core.presentation.numbers import digits, fixed, multiple, probability
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M, small_unit
from ...fit.graph.goodness_of_fit import GoodnessOfFit
from ...model.errors.error_estimate import SHOWN, ErrorEstimate
from ...model.errors.keys import DRIFTS, VIEW
from ...model.errors.models import Noise, is_joint, marginals
from ..result import Calibration

# Rotation or translation residuals are called inconsistent with the noise from this difference of their sigma_0
# from 1 on.
MIN_SIGMA0_EXCESS = 0.1
NO_TEST_OF_NOISE = "The chi-square test of the noise was not run, because the noise comes from the same residuals."
NO_NOISE = "Not known: no noise was given, and none could be estimated from the residuals."
OF_MODEL = (
    "Errors of the model: size (1 sigma) with its interval, how many of its numbers the data determine, and share "
    "of the variance of X in the direction where it matters most."
)


def noise_blocks(result: Calibration) -> list[Block]:
    """The noise given or estimated, and the test of the residuals against it."""
    blocks: list[Block] = []
    estimate = result.noise_estimate
    if estimate is not None:
        caption = "Noise, estimated from the residuals:"
        if estimate.from_corners:
            caption = "Noise of the robot, estimated; the noise of the camera is known from its corners:"
        if estimate.from_points:
            caption = "Noise of the robot, estimated; the noise of the camera is known from the points of the target:"
        if estimate.from_scene:
            caption = "Noise of the robot, estimated; the noise of the camera is known from the features of the scene:"
        if estimate.by_geometry:
            caption = "Noise, estimated from the residuals and the geometry of the views:"
        head = ["source", "1 sigma per axis", "95 % interval", "status"]
        blocks.append(Table(caption, head, list(map(_component, estimate.components)), frozenset({3})))
        if estimate.of_model:
            head = ["error", "side", "size", "95 % interval", "determined", "share of X"]
            blocks.append(Table(OF_MODEL, head, list(map(_of_model, estimate.of_model)), frozenset({0, 1})))
        if estimate.statement:
            blocks.append(Points(estimate.statement))
    elif result.noise is not None:
        caption = "Noise as given: standard deviation per axis, on average over axes and poses"
        blocks.append(Table(caption, ["side", "rotation (deg)", "translation (mm)"], _given(result.noise)))
    else:
        blocks.append(Paragraph(NO_NOISE, empty=True))
    if result.fit is not None:
        sentences = _fit_sentences(result.fit)
        blocks += [Paragraph(text) for text in (_counts(result), *sentences)]
    elif estimate is not None and estimate.noise is not None:
        blocks.append(Paragraph(f"The residuals have {estimate.dof:.0f} degrees of freedom."))
    return blocks


def _of_model(part: ErrorEstimate) -> list[str]:
    factor, unit = (1e3, "mrad, mm") if part.key in (VIEW, *DRIFTS.values()) else small_unit(part.unit)
    size = f"{fixed(factor * part.size)} {unit}".rstrip()
    between = (
        "known" if part.known else f"{fixed(factor * part.low)} to {fixed(factor * (part.high or 0.0))} {unit}".rstrip()
    )
    numbers = f"{part.resolved * part.count:.1f} of {part.count}" if part.count else "each pose"
    return [part.name, part.side, size, between, numbers, f"{100 * part.share:.1f} %"]


def _component(component: ErrorEstimate) -> list[str]:
    factor, unit = SHOWN[component.unit]
    high = "not determined" if component.high is None else f"{fixed(factor * component.high)} {unit}"
    if component.high is not None and not np.isfinite(component.high):
        high = "not limited"
    between = f"{fixed(factor * component.low)} to {high}".rstrip()
    if component.is_given:
        between = ""
    return [component.name, f"{fixed(factor * component.size)} {unit}".rstrip(), between, component.shown_status]


def _given(noise: Noise) -> list[list[str]]:
    """Name, rotation (deg) and translation (mm) of each side: standard deviations, on average."""
    rows = []
    for name, S in noise.sides.items():
        if S is None:
            rows.append([name, "exact", "exact"])
            continue
        variances = np.diagonal(marginals(S), axis1=-2, axis2=-1).reshape(-1, 2, 3).mean(axis=(0, 2))
        shared = ", correlated over the poses by errors that they share" if is_joint(S) else ""
        rows.append(
            [name + shared, *(fixed(f * sd) for f, sd in zip((DEG_PER_RAD, MM_PER_M), np.sqrt(variances), strict=True))]
        )
    return rows


def _counts(result: Calibration) -> str:
    """Say how many numbers were fitted by how many."""
    variables = "6 variables (of X)" if result.W is None else "12 variables (of X and W)"
    n = result.n_pairs if result.table is None else len(result.table)
    of = "motion" if result.table is None else result.table.item
    return f"Data: {6 * n} residuals (6 of each {of}), {variables}."


def _fit_sentences(fit: GoodnessOfFit) -> list[str]:
    """The chi-square test in words, sigma_0, and where it is so what the noise gets wrong."""
    start = f"Fit: chi-square {fit.chi2:.1f} with {fit.dof:.0f} degrees of freedom (reduced: {fit.chi2 / fit.dof:.2f})"
    if fit.p_value is None:
        text = f"{start}, near their number by construction. {NO_TEST_OF_NOISE}"
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
    least = max(np.sqrt(RARE.chi_square(1)) / np.sqrt(fit.dof), MIN_SIGMA0_EXCESS)
    off = [name for name, value in parts.items() if abs(value - 1) > least]
    if off and (fit.p_value is None or fit.p_value > 0.01):
        how = " and ".join(f"{name} {digits(parts[name])} times" for name in off)
        sentences.append(f"The residuals do not match this noise ({how} as large): the noise model is wrong.")
    return sentences


def _misfit(sigma0: float) -> str:
    if sigma0 > 1:
        return f"the residuals are {multiple(sigma0)} times what the noise explains; standard deviations are too small"
    return f"the residuals are {multiple(1 / sigma0)} times smaller than the noise explains"
