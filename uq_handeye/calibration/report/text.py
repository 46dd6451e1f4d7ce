"""A calibration in words: the long text with all that is known, a unit on every number; and the form in notebooks.

Errors that all poses share, as a table, and what the total includes of them; the time offset; the arm: what X means,
what the data told of it, how far the tool misses.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.formatting.numbers import concise, digits, pose_rows, row
from ...core.geometry.pose_numbers import pose_numbers, quaternion_deviations
from ...core.geometry.se3 import Array, difference
from ...core.numbers.limits import MAX_LISTED
from ...core.presentation.document import (
    Block,
    Caution,
    Cell,
    Checks,
    Code,
    Document,
    Heading,
    Paragraph,
    Points,
    Table,
    document_of,
)
from ...core.presentation.html import blocks_html, heat_html, html_of, matrix_html, to_html
from ...fit.diagnostics.result import ScaleError
from ...fit.diagnostics.sentences import relative
from ...fit.likelihood.shared_estimates import SharedEstimate, SharedGroup
from ...model.kinematics.kinematic_errors import DECLARED, ESTIMATE, EXACT, PHYSICAL
from ...model.shared_errors.shared_error import CLOCK_OFFSET, ROBOT_SCALE, TARGET_SCALE, WRONG_SIZE
from ..estimate.analysis import FittedKinematics
from ..result import Calibration
from ..statement.checks import included, shared_groups, sizes_of
from ..statement.tolerance import Verdict
from .analysis import (
    beside_blocks,
    budget_table,
    covariance_table,
    diagnosis_blocks,
    flagged_blocks,
    noise_blocks,
    pair_table,
    worst_words,
)
from .first_screen import accuracy_blocks, answer_blocks, checks_block, data_words, first_screen, matrix_block, title_of

# The mean error of nominal poses is stated from this share of the 95 % radius on.
MIN_NOMINAL_SHARE = 0.05
# Notes that the long text shows beside the cautions.
SHOWN_NOTES = ("calibration.excluded", "kinematics.against_controller")


@document_of.register(Calibration)
def calibration_document(result: Calibration, verbose: bool = False, threshold: float = 0.5) -> Document:
    """Return the first screen, or with ``verbose`` all that is known (`long_document`)."""
    return long_document(result, threshold) if verbose else first_screen(result)


def long_document(result: Calibration, threshold: float = 0.5, verdict: Verdict | None = None) -> Document:
    """Return all that is known: the statement, cautions, X, noise, fit, poses, diagnostics, other forms of X.

    Correlations at or above ``threshold`` are listed.
    """
    tables = [table for table in (covariance_table(result), budget_table(result)) if table is not None]
    return [
        [Heading(title_of(result, 118)), *answer_blocks(result, verdict, why=False)],
        accuracy_blocks(result),
        checks_block(result),
        *(Caution(str(found)) for found in result.cautions),
        *(Paragraph(str(found)) for found in result.findings if found.code in SHOWN_NOTES),
        *_numbers(result, threshold),
        *([arm] if (arm := arm_blocks(result)) else []),
        *([beside] if (beside := beside_blocks(result)) else []),
        noise_blocks(result),
        pair_table(result),
        shared_blocks(result),
        flagged_blocks(result),
        *tables,
        Paragraph(worst_words(result)),
        diagnosis_blocks(result),
        *_scope(result),
        *_other_forms(result),
    ]


def _numbers(result: Calibration, threshold: float) -> list[list[Block]]:
    """X and its standard deviations, correlations and directions."""
    numbers: list[Block] = [_lines(pose_rows(*pose_numbers(result.X, result.covariance, opened=result.open_of_X)))]
    if result.std is not None:
        turn = row("rotation about axes (deg)", "xyz", None, np.degrees(result.std[:3]), 5)
        numbers += [_lines([turn]), *map(Paragraph, result.facts.directions), _lines(_correlations(result, threshold))]
    return [[matrix_block(result.X)], numbers]


def _scope(result: Calibration) -> list[Block]:
    """Return what the standard deviations mean."""
    if result.std is None:
        return []
    facts = result.facts
    within = facts.ellipsoid
    if result.analysis is not None:
        within += " Shifts of X above are given as d, in standard deviations."
    shared = " and of the shared errors in the table" if result.shared else ""
    scope = f"The standard deviations are 1 sigma, to first order, of {facts.source}{shared}."
    return [Paragraph(within), Paragraph(f"{scope} {included_words(result)}")]


def _other_forms(result: Calibration) -> list[Block | list[Block]]:
    """The inverse of X, its quaternion, and W."""
    frame, S = result.frame, result.covariance
    inverse_name = "_T_".join(reversed(frame.split("_T_"))) if "_T_" in frame else f"inv({frame})"
    of_quaternion = None if S is None else quaternion_deviations(result.quaternion, S)
    quaternion = row("quaternion", "xyzw", result.quaternion, of_quaternion, 7, width=10)
    blocks: list[Block | list[Block]] = [
        [Heading(f"{frame} as quaternion"), _lines([quaternion])],
        Heading(f"{inverse_name} (inverse of X)"),
        matrix_block(result.inverse),
    ]
    if result.W is not None:
        blocks += [
            Heading(f"{result.frame_W} (the target, from all poses)"),
            matrix_block(result.W),
            _lines(
                pose_rows(*pose_numbers(result.W, result.covariance_W, opened=result.open_of_W)),
            ),
        ]
    return blocks


def against_truth(result: Calibration, truth: Array) -> str:
    """Return the error of X against a known one (4, 4) in a sentence, and whether it lies inside the ellipsoid."""
    xi = difference(result.X, truth)
    text = (
        f"Truth: X is off by {digits(1e3 * float(np.linalg.norm(xi[3:])))} mm and "
        f"{digits(np.degrees(float(np.linalg.norm(xi[:3]))))} deg"
    )
    if result.covariance is None:
        return f"{text}."
    inside = float(xi @ np.linalg.solve(result.covariance, xi)) <= result.quantile(0.95)
    return f"{text}, {'inside' if inside else 'outside'} its 95 % ellipsoid."


def _lines(lines: Sequence[str]) -> Code:
    return Code("", "\n".join(lines), "")


def _correlations(result: Calibration, threshold: float) -> list[str]:
    strong = [f"  {i} with {j}: {x:+.2f}" for x, i, j in result.facts.correlations if abs(x) >= threshold]
    if not strong:
        return [f"No correlation is {threshold:g} or larger."]
    return [f"Correlations of {threshold:g} and larger:", *strong]


@html_of.register(Calibration)
def calibration_html(result: Calibration) -> str:
    """Return the headline, the checks and the six numbers; full sentences, parts and matrices folded away."""
    origin = f"{result.n_pairs} pairs" if result.n_poses is None else data_words(result)
    setup = "" if result.setup is None else f", {result.setup}"
    checks = Checks.of(result.checks)
    document: Document = [answer_blocks(result, why=False), [checks], [_six(result)]]
    folded = [(title, blocks_html(blocks)) for title, blocks in _folds(result).items() if blocks]
    folded.append(("Matrix X (translation in m)", matrix_html(result.X)))
    if result.covariance is not None and result.correlation is not None:
        S, correlation = result.covariance, result.correlation
        folded += [
            ("Covariance of (theta, tau), rad and m", heat_html(S, correlation, "{:.3e}")),
            ("Correlation", heat_html(correlation.round(2) + 0.0, correlation, "{:+.2f}")),
        ]
    title = f"{result.frame} by {result.method}"
    return to_html(title, document, beside=f"{origin}{setup}", seen=len(document), folded=folded)


def _six(result: Calibration) -> Table:
    """Return the six numbers of X."""
    rows = [
        [one.name, concise(one.value, one.sd), "?" if one.sd is None else digits(one.sd), one.unit]
        for one in result.facts.X
    ]
    return Table("", [f"X = {result.frame}" if result.setup else "X", "value", "1 sigma", "unit"], rows)


def _folds(result: Calibration) -> dict[str, list[Block]]:
    """Return what is folded away by title; what `calibrate` warned of is not opened again."""
    count, accuracy = len(result.cautions), accuracy_blocks(result, most=MAX_LISTED)
    return {
        f"Cautions in full ({count})": [Points([str(finding) for finding in result.cautions])] if count else [],
        "Parts of the accuracy": [*accuracy, Paragraph(included_words(result))] if accuracy else [],
        "Directions": [Paragraph(text) for text in [*result.facts.directions, *arm_sentences(result)]],
        "Shared errors": [*shared_blocks(result)] if result.shared else [],
    }


CAPTION = (
    "Errors that all poses share: standard deviation assumed, estimate with its standard deviation in brackets after "
    "the fit, and share of the variance of X in the direction where it counts most. An error is used / true - 1 for "
    "lengths: +1 % says that the true value is 1 % smaller than the one used."
)
OF_MANY = (
    " An error of many numbers is one row: the standard deviation assumed of each, the root mean square (RMS) of the "
    "estimates, how much of the variance assumed the data took away, and the share of all numbers together."
)
# Findings that belong to the table.
SHARED_CODES = ("calibration.shared_confounded", "calibration.shared_opens")


def shared_table(result: Calibration) -> Table | None:
    """One row for each error that was declared or assumed, then those that were not; None where nothing is known."""
    groups = shared_groups(result)
    parts = () if result.noise_estimate is None else result.noise_estimate.components
    of_population = {part.name for part in parts if part.status == "population"}
    rows: list[list[Cell]] = [_declared(group, group.parts[0].error in of_population) for group in groups]
    if (found := result.time_offset) is not None and found.std > 0:
        known = concise(1e3 * found.offset, 1e3 * found.std, "ms")
        rows.append([CLOCK_OFFSET, "estimated from the streams", known, f"{100 * found.share:.1f} %"])
    if result.analysis is not None:
        names = {error.name for error in result.shared}
        rows += [
            [probe.name, (_undeclared(probe), 3)] for probe in result.analysis.diagnostics.probes
            if probe.name not in names
        ]  # fmt: skip
    caption = CAPTION + (OF_MANY if any(group.count > 1 for group in groups) else "")
    return Table(caption, ["error", "assumed", "found", "share"], rows, frozenset({1})) if rows else None


def shared_blocks(result: Calibration) -> list[Block]:
    """The table, and what is to be known beside it."""
    table = shared_table(result)
    notes = [str(found) for found in result.findings if found.code in SHARED_CODES and found.severity == "note"]
    if look_alike(result):
        notes.append("Target scale and robot scale have the same effect on the residuals and cannot be separated.")
    if text := offset_sentence(result):
        notes.append(text)
    return [*([] if table is None else [table]), *([Points(notes)] if notes else [])]


def look_alike(result: Calibration) -> bool:
    """Return whether the residuals indicate a scale that may be the target's or the robot's."""
    probes = () if result.analysis is None else result.analysis.diagnostics.probes
    asked = {probe.name for probe in probes if probe.asked_for}
    asked |= {error.name for error in result.shared if error.name == TARGET_SCALE and error.beyond(WRONG_SIZE) > 0.5}
    return bool(asked & {TARGET_SCALE, ROBOT_SCALE})


def _declared(group: SharedGroup, estimated: bool) -> list[Cell]:
    how = "estimated" if estimated else "default" if group.default else "declared"
    share = f"{100 * group.share:.1f} %"
    if group.count > 1:
        return [f"{group.name} ({group.count})", f"{sizes_of(group)} ({how})", found_of(group), share]
    error = group.parts[0]
    factor, unit = error.shown
    found = concise(factor * error.estimate, factor * error.sd, unit)
    return [error.name, f"{amount(error)} ({how})", found, share]


def found_of(group: SharedGroup) -> str:
    """RMS of the estimates of a group, and how much the data told of it."""
    sizes = (f"{digits(float(np.sqrt(np.mean(group.of_unit(unit)[1] ** 2))), 2)} {unit}" for unit in group.units)
    if group.parts[0].stated:
        return f"told {100 * group.told:.0f} %"
    rms = ", ".join(size.rstrip() for size in sizes)
    return f"RMS {rms}; told {100 * group.told:.0f} %"


def _undeclared(probe: ScaleError) -> str:
    if probe.covered:
        return "in the covariance of the camera poses, with the other intrinsics"
    if probe.reason is not None:
        return "not declared: the distances from camera to target are not known"
    move = f"0.1 % moves X by {digits(probe.shift_sd, 2)} of its standard deviations"
    if not probe.visible:
        return f"not declared: the residuals do not show it; {move}"
    return f"not declared: the residuals indicate {relative(probe.estimate, probe.sd)}; {move}"


def amount(error: SharedEstimate) -> str:
    """The standard deviation assumed, in the unit that people read."""
    factor, unit = error.shown
    return f"{digits(factor * error.prior_sd, 2)} {unit}".rstrip()


# -------------------------------------------------------------------------------------------- what the total includes


def included_words(result: Calibration) -> str:
    """Say which shared errors the covariance of X includes, as a sentence."""
    parts = included(result)
    defaults = sum(default for _, default in parts)
    if not parts:
        return "Errors that all poses share are not included."
    said = {0: "", len(parts): " (defaults)" if len(parts) > 1 else " (default)"}.get(defaults)
    named = [part if said is not None or not default else f"{part} (default)" for part, default in parts]
    return f"This total includes what all poses share: {', '.join(named)}{said or ''}."


def offset_sentence(result: Calibration) -> str:
    """Say what the time offset of the poses adds to the covariance of X; empty where there is none."""
    found = result.time_offset
    if found is None:
        return ""
    if found.std == 0:
        said = "taken as exact, as given: its uncertainty is not in the covariance of X."
        return f"Time offset: {1e3 * found.offset:.6g} ms, {said}"
    move = found.std * np.array(found.sensitivity)
    if not move.any():
        said = "The robot stands still at these poses: the offset does not matter for X."
        return f"Time offset: {concise(1e3 * found.offset, 1e3 * found.std, 'ms')}. {said}"
    turn, shift = np.degrees(np.linalg.norm(move[:3])), 1e3 * np.linalg.norm(move[3:])
    return (
        f"Time offset: {concise(1e3 * found.offset, 1e3 * found.std, 'ms')} (robot_time = camera_time + offset; the "
        f"{found.side} was interpolated). One standard deviation of it moves X by {digits(turn, 2)} deg and "
        f"{digits(float(shift), 2)} mm; this is in the covariance of X, where it makes up "
        f"{100 * found.share:.2g} % of the variance in the direction in which it counts most."
    )


_HOW = {
    ESTIMATE: "standard deviations estimated from the data and what such arms have",
    DECLARED: "standard deviations as declared",
    EXACT: "taken as exact",
}


def arm_blocks(result: Calibration) -> list[Block]:
    """The arm under its heading; nothing where the calibration knows no joints."""
    sentences = arm_sentences(result)
    return [Heading("The arm:"), *map(Paragraph, sentences)] if sentences else []


def arm_sentences(result: Calibration) -> list[str]:
    """Describe what is known of the arm, what X means, and what a prediction is worth."""
    fitted = result.kinematics
    if fitted is None:
        return []
    chain = fitted.chain
    text = f"{chain.name}, {chain.n_joints} joints from {chain.base} to {chain.tip}; its errors: {_HOW[fitted.how]}."
    if fitted.joint_noise > 0:
        text += f" Joint noise {digits(np.degrees(fitted.joint_noise), 2)} deg."
    if told := told_words(fitted):
        text += f" {told}"
    meaning = [] if fitted.how == EXACT else [meaning_words(result, fitted)]
    return [text, *meaning, *([said] if (said := prediction_words(result)) else [])]


def told_words(fitted: FittedKinematics) -> str:
    """Say how much of what was assumed of each group the data took away."""
    told = [f"{group} {100 * share:.0f} %" for group, share in fitted.told().items()]
    return f"Share of the assumed variance that the data resolved: {', '.join(told)}." if told else ""


def meaning_words(result: Calibration, fitted: FittedKinematics) -> str:
    """Say which flange (or base) X belongs to, and what it is to be used with."""
    frame = result.frame.split("_T_")[0]
    if fitted.flange == PHYSICAL:
        return f"X is the camera in the machined {frame}; errors of the first and last joint are in its covariance."
    return (
        f"X is the camera in the {frame} frame of the controller: use it with the corrected kinematics "
        "(`result.predict`, `uq-handeye predict`), and do not compare it with drawings of the mount "
        '(`flange="physical"` is for that).'
    )


def prediction_words(result: Calibration) -> str:
    """Say how far the tool misses what the camera sees, near the calibrated poses and anywhere; and with nominal
    poses.
    """
    found = result.over_workspace
    if found is None:
        return ""
    at = f" from {found.distance:.2g} m away" if result.setup == "eye-in-hand" else ""
    text = f"A point that the camera sees{at}, and the flange brought to it: within {_mm(found.anywhere)} mm (95 %) "
    text += "anywhere in the workspace"
    text += "." if found.near is None else f", within {_mm(found.near)} mm near the calibrated poses."
    if found.nominal > MIN_NOMINAL_SHARE * found.anywhere:
        text += (
            f" With nominal poses in place of the corrected ones add {_mm(found.nominal)} mm (RMS): a mean error, "
            "which is not part of the covariance."
        )
    return text


def workspace_caption(result: Calibration) -> str:
    """Explain how to read the figure of the workspace."""
    reached = "the flange is brought to a point that the camera sees"
    if result.setup == "eye-in-hand" and result.over_workspace is not None:
        reached += f" {result.over_workspace.distance:.2g} m ahead"
    return (
        f"How far the tool misses where {reached}: 95 % radius, with errors of X and of the arm and the noise of the "
        "joints; the camera's own error of the point comes on top. Postures are drawn over the joint limits; "
        "obstacles and collisions are not looked at. Left by the place of the flange, as the mean about each; "
        "right by its distance from the nearest calibrated pose. The dashed line is the mean error of who goes on "
        "with the nominal poses; it is not in the radius."
    )


def _mm(length: float) -> str:
    return digits(1e3 * length, 2)
