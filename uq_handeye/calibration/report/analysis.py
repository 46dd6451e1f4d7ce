"""Analysis of a calibration beyond X, as blocks of text and page: noise, fit, 4DPA, poses, budget, diagnostics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...core.formatting.numbers import column, digits, fixed, multiple, pose_rows, probability
from ...core.formatting.units import DEG_PER_RAD, MM_PER_M, small_unit
from ...core.geometry.pose_numbers import pose_numbers
from ...core.geometry.se3 import Array
from ...core.numbers.levels import RARE
from ...core.numbers.limits import MAX_LISTED
from ...core.presentation.document import Block, Cell, Code, Heading, Paragraph, Points, Table
from ...fit.diagnostics.budget import Budget
from ...fit.diagnostics.pose_table import PoseTable
from ...fit.likelihood.goodness_of_fit import GoodnessOfFit
from ...model.noise.estimate import SHOWN, Component, FoundComponent
from ...model.noise.models import Noise, is_joint, marginals
from ...model.shared_errors.assumed import DRIFT
from ...model.shared_errors.shared_error import VIEW
from ..estimate.analysis import joint_sides
from ..estimate.estimated import deviations_of
from ..result import Calibration
from ..statement.checks import PLAIN

# Rotation or translation residuals are called inconsistent with the noise from this difference of their sigma_0
# from 1 on.
MIN_SIGMA0_EXCESS = 0.1
KINDS = ("rotation", "translation")


def noise_blocks(result: Calibration) -> list[Block]:
    """The noise given or estimated, and what the residuals say of it."""
    blocks: list[Block] = []
    estimate = result.noise_estimate
    if estimate is not None:
        caption = "Noise, estimated from the residuals:"
        if estimate.from_corners:
            caption = "Noise of the robot, estimated; the noise of the camera is known from its corners:"
        if estimate.from_points:
            caption = "Noise of the robot, estimated; the noise of the camera is known from the points of the target:"
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


NO_TEST_OF_NOISE = "The chi-square test of the noise was not run, because the noise comes from the same residuals."
NO_NOISE = "Not known: no noise was given, and none could be estimated from the residuals."


OF_MODEL = (
    "Errors of the model: size (1 sigma) with its interval, how many of its numbers the data determine, and share "
    "of the variance of X in the direction where it matters most."
)


def _of_model(part: FoundComponent) -> list[str]:
    factor, unit = (1e3, "mrad, mm") if part.name == VIEW or DRIFT in part.name else small_unit(part.unit)
    size = f"{fixed(factor * part.size)} {unit}".rstrip()
    between = "known" if part.known else f"{fixed(factor * part.low)} to {fixed(factor * part.high)} {unit}".rstrip()
    numbers = f"{part.determined:.1f} of {part.count}" if part.count else "each pose"
    return [part.name, part.side, size, between, numbers, f"{100 * part.share:.1f} %"]


def _component(component: Component) -> list[str]:
    factor, unit = SHOWN[component.unit]
    high = "not determined" if component.high is None else f"{fixed(factor * component.high)} {unit}"
    if component.high is not None and not np.isfinite(component.high):
        high = "not limited"
    between = f"{fixed(factor * component.low)} to {high}"
    if component.is_given:
        between = ""
    return [component.name, f"{fixed(factor * component.value)} {unit}", between, component.shown_status]


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


def beside_blocks(result: Calibration) -> list[Block]:
    """4DPA's own answer and its efficiency; of a bundle adjustment, how far it is from `efficient`."""
    beside, efficiency = result.fourdpa, result.efficiency
    blocks: list[Block] = [] if result.agreement is None else [Paragraph(result.agreement.sentence)]
    if beside is None or beside.covariance is None or efficiency is None or not np.isfinite(efficiency).all():
        return blocks
    numbers = [
        *pose_rows(*pose_numbers(beside.X, beside.covariance)),
        f"standard deviations    {efficiency.min():.2f} to {efficiency.max():.2f} times the Cramer-Rao bound, which "
        f"{result.method} attains",
    ]
    text = "\n".join(f"  {line}" for line in numbers)
    return [*blocks, Heading("4DPA only, on the same data:"), Code("", text, "")]


def pair_table(result: Calibration) -> Table:
    """Residuals of the pairs."""
    r = result.residuals
    looked_at = "the" if r.pairs == result.n_pairs else f"{r.pairs:,} of the {result.n_pairs:,}"
    less = ", less the estimated shared errors" if result.shared else ""
    caption = f"Residuals of AX = XB over {looked_at} pairs{less}: how well X explains them, not how accurate it is"
    sizes = [
        ["rotation (deg)", *(fixed(DEG_PER_RAD * x) for x in (r.rotation_rms, r.rotation_median, r.rotation_max))],
        [
            "translation (mm)",
            *(fixed(MM_PER_M * x) for x in (r.translation_rms, r.translation_median, r.translation_max)),
        ],
    ]
    return Table(caption, ["", "RMS", "median", "largest"], sizes)


def covariance_table(result: Calibration) -> Table | None:
    """Standard deviations by every covariance, side by side; None where there is only one."""
    analysis = result.analysis
    if analysis is None:
        return None
    meaning = {
        "model": "model (the noise)",
        "sandwich": f"sandwich, by {'pose' if result.table is None else result.table.item}",
    }
    rows: list[list[Cell]] = []
    without: dict[str, list[str]] = {}  # kinds by the reason
    for kind, S in analysis.covariances.items():
        if S is None:
            without.setdefault(analysis.reasons[kind], []).append(kind)
            continue
        sd = deviations_of(S, result.opened, "X")
        name = meaning.get(kind, kind) + (" *" if kind == result.covariance_kind else "")
        shown = ("open" if np.isinf(x) else fixed(x) for x in sd * np.repeat([DEG_PER_RAD, MM_PER_M], 3))
        rows.append([name, *shown])
    rows += [[", ".join(kinds), (f"not determined: {reason}", 6)] for reason, kinds in without.items()]
    caption = (
        "Standard deviations of X by every covariance (* that of the result). All but the first are "
        "computed from the residuals, without a noise model. Where they are much larger, the noise model is wrong."
    )
    groups = [("", 1), ("rotation (deg)", 3), ("translation (mm)", 3)]
    return Table(caption, ["covariance", *"xyz", *"xyz"], rows, groups=groups)


def pose_table(table: PoseTable, shown: Sequence[int], caption: str) -> Table:
    """Residual, distance, leverage, weight and flag of the poses ``shown``."""
    k = list(shown)
    columns = (
        [str(i) for i in k],
        column(DEG_PER_RAD * table.rotation[k]),
        column(MM_PER_M * table.translation[k]),
        column(table.distance2[k]),
        column(100 * table.leverage[k], 2),
        [f"{table.weight[i]:.3f}" for i in k],
        [table.status(i) for i in k],
    )
    head = [table.item, "rotation (deg)", "translation (mm)", "d^2", "leverage (%)", "weight", "flag"]
    marked = frozenset(row for row, i in enumerate(k) if table.flag[i] != "kept")
    return Table(caption, head, list(zip(*columns, strict=True)), frozenset({6}), marked)


def flagged_blocks(result: Calibration) -> list[Block]:
    """The poses that are flagged."""
    table = result.table
    if table is None:
        return []
    if not table.flagged:
        count = len(table.counted)
        none = Paragraph(f"No {table.item} stands out: all {count} lie within their 99.9 % ellipsoids.")
        return [none, *_excluded_blocks(table)]
    order = sorted(table.flagged, key=lambda k: -table.distance2[k])
    caption = (
        f"{len(order)} of {len(table.counted)} {table.item}s stand out (numbered from 0; d^2 is 6 on average, beyond "
        f"{table.limit:.3g} rare):"
    )
    more = len(order) - MAX_LISTED
    rest = [Paragraph(f"and {more} more; see the table of the result", indent="  ")] if more > 0 else []
    return [pose_table(table, order[:MAX_LISTED], caption), *rest, *_excluded_blocks(table)]


def _excluded_blocks(table: PoseTable) -> list[Block]:
    """The poses that were excluded by request."""
    if not table.excluded:
        return []
    caption = f"{len(table.excluded)} of {len(table)} {table.item}s are excluded, with residuals against the fit:"
    more = len(table.excluded) - MAX_LISTED
    rest = [Paragraph(f"and {more} more; see the table of the result", indent="  ")] if more > 0 else []
    return [pose_table(table, table.excluded[:MAX_LISTED], caption), *rest]


def shown_budget(result: Calibration) -> Budget | None:
    """The budget, coupled errors of a side as one source; None where it is not known."""
    if not result.has_budget:
        return None
    budget = result.budget
    for side in ("robot", "camera", "A", "B"):
        parts = [name for what in KINDS if (name := f"{side} {what}") in budget.sources]
        # Where errors are coupled, the shares of one kind may be beyond 100 % and below 0: only the sum counts.
        S = getattr(result.noise, side, None)
        dense = S is not None and is_joint(S) and side not in joint_sides(result.noise)
        if parts and (dense or f"{side} coupling" in budget.sources):
            parts += [name for name in budget.sources if name == f"{side} coupling"]
            merged = budget.merged(parts)
            whole, named = " + ".join(parts), f"{side} (rotation and translation)"
            budget = replace(merged, sources=tuple(named if name == whole else name for name in merged.sources))
    return budget


def budget_table(result: Calibration, most: int | None = None) -> Table | None:
    """Return standard uncertainties by source, combined and expanded, in the terms of JCGM 100; None: not known.

    Beyond ``most`` sources the smallest are one row.
    """
    budget = shown_budget(result)
    if budget is None:
        return None
    budget = shorten_budget(budget, most)
    factors = {"X translation": MM_PER_M, "X rotation": DEG_PER_RAD}
    standard, shares, whole = budget.standard, budget.group_shares, budget.expanded()
    rows: list[list[Cell]] = []
    largest = np.max([shares[name] for name in factors], axis=0)
    for k in sorted(range(len(largest)), key=lambda k: (budget.sources[k].endswith(OTHERS), -largest[k])):
        source = PLAIN.get(budget.sources[k], budget.sources[k])
        sizes = [fixed(factor * standard[name][k], 2) for name, factor in factors.items()]
        parts = [f"{100 * shares[name][k]:.1f}" for name in factors]
        rows.append([source, budget.types[k], *sizes, *parts, freedom(float(budget.dof[k]))])
    rows.append([])
    of = [(factor, whole[name]) for name, factor in factors.items()]
    for title, cells in (
        ("combined, u_c", [fixed(factor * found.u) for factor, found in of]),
        (DOF, [freedom(found.dof) for _, found in of]),
        ("coverage factor k for 95 %", [f"{found.k:.2f}" for _, found in of]),
        ("expanded, U = k u_c", [fixed(factor * found.U) for factor, found in of]),
    ):
        rows.append([title, "", *cells, "", "", ""])
    head = ["source", "type", "u (mm)", "u (deg)", "% of mm", "% of deg", "dof"]
    if not np.isfinite([*budget.dof, *(found.dof for _, found in of)]).any():  # said once
        rows = [row[:-1] for row in rows if not row or row[0] != DOF]
        return Table(f"{BUDGET_CAPTION}; all degrees of freedom are infinite", head[:-1], rows, frozenset({1}))
    return Table(BUDGET_CAPTION, head, rows, frozenset({1}))


# Ending of the name of the sources that are one row.
OTHERS = " others"


def shorten_budget(budget: Budget, most: int | None) -> Budget:
    """Return the budget with its smallest sources as one, so that ``most`` remain."""
    if most is None or len(budget.sources) <= most:
        return budget
    sizes = np.max([budget.group_shares[f"X {kind}"] for kind in KINDS], axis=0)
    small = set(np.argsort(-sizes, kind="stable")[most - 1 :].tolist())
    names = [name for k, name in enumerate(budget.sources) if k in small]
    merged = budget.merged(names)
    whole = " + ".join(names)
    return replace(merged, sources=tuple(f"{len(names)}{OTHERS}" if n == whole else n for n in merged.sources))


DOF = "effective degrees of freedom"
BUDGET_CAPTION = (
    "Uncertainty budget of X (JCGM 100): standard uncertainties u of translation (mm) and rotation (deg) per axis ("
    "root mean square), share of the variance, degrees of freedom; type A is evaluated from the data, type B declared"
)


def freedom(dof: float) -> str:
    """Return degrees of freedom as a whole number, cut off as in JCGM 100, G.4.1; many count as infinite."""
    return "infinite" if not dof < 1000 else f"{int(dof)}" if dof >= 10 else digits(dof, 2)


def worst_words(result: Calibration) -> str:
    """The expanded uncertainty in the direction in which X is least certain."""
    budget = shown_budget(result)
    if budget is None:
        return ""
    found = budget.expanded(worst=True)
    move, turn = found["X translation"], found["X rotation"]
    return (
        f"In the worst direction U is {digits(MM_PER_M * move.U, 2)} mm (k = {move.k:.2f}) and "
        f"{digits(DEG_PER_RAD * turn.U, 2)} deg (k = {turn.k:.2f}), which covers 95 % of the errors."
    )


def budget_shares(result: Calibration) -> dict[str, Array]:
    """Shares (2,) of the variances of X's rotation and translation by source; nothing where there is no budget."""
    budget = shown_budget(result)
    if budget is None:
        return {}
    shares = np.stack([budget.group_shares[f"X {kind}"] for kind in KINDS], axis=-1)  # (sources, 2)
    return dict(zip(budget.sources, shares, strict=True))


# The directions stand among the numbers of the summary.
_SAID_ELSEWHERE = {"diagnostics.direction"}


def diagnosis_blocks(result: Calibration) -> list[Block]:
    """Diagnostics and split halves in words."""
    analysis = result.analysis
    if analysis is None:
        return [Heading("Diagnostics:"), Points(tests_not_run(result))]
    found = [f for f in analysis.diagnostics.findings if f.code not in _SAID_ELSEWHERE]
    found.sort(key=lambda f: f.code != "diagnostics.joint_spectrum")  # that one first
    found += [analysis.split_half.finding, analysis.split_in_time.finding]
    said = (*result.findings, *result.cautions)
    below = [f for f in found if f not in said]
    title = f"Diagnostics{' (see the cautions above)' if len(below) < len(found) else ''}:"
    return [Heading(title), Points([str(f) for f in below])]


def tests_not_run(result: Calibration) -> list[str]:
    """Sentences that name the tests of the noise, of the residuals and of halves that were not run, and why."""
    found = [] if result.fit is None or result.fit.p_value is not None else [NO_TEST_OF_NOISE]
    analysis = result.analysis
    if analysis is None:
        why = f"they are made by the methods efficient and ml, not by {result.method}"
        if result.covariance is None:
            why = "there is no noise, given or estimated"
        return [*found, f"The tests of the residuals and of two halves of the data were not run, because {why}."]
    reasons = list(analysis.diagnostics.not_run)
    reasons += [half.reason for half in (analysis.split_half, analysis.split_in_time) if half.reason is not None]
    return [*found, *map(str, reasons)]
