"""The folded sections of the report, in three groups: X, the data, and their origin.

About X: ellipses, points in task space, forms to copy, the errors that the covariance includes. About the data:
residuals, budget, methods, observability, noise, other covariances. About the origin: the camera, and how to repeat
the run.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .._version import __version__
from ..calibration.checks import not_included
from ..calibration.report.analysis import not_shown_yet, tests_not_run
from ..calibration.report.arm import arm_sentences
from ..calibration.report.budget import KINDS
from ..calibration.report.points_ahead import ahead
from ..calibration.report.residuals import pose_table
from ..calibration.report.shared_errors import included_words
from ..calibration.report.text import blocks_of
from ..core.geometry.conventions import CONVENTION
from ..core.limits import MAX_LISTED, MAX_NAMED, MAX_PRINTED_ROWS, MIN_SHOWN_CORRELATION
from ..core.presentation.document import Block, Code, Drawing, Paragraph, Points, Section, Table
from ..core.presentation.numbers import concise, digits, fixed
from ..model.camera.report.text import answer, boards_words, coverage_words, model_name, noise_words, parameter_rows
from ..model.errors.key import ErrorKey, Kind, Owner
from ..model.poses.scene_facts import SceneView
from ..scene.lens import NAMES as LENS_NAMES
from ..trials.validation.cross_check.text import state, verdict
from .budget import gum_table
from .comparison.text import methods_table
from .figures import poses_of

if TYPE_CHECKING:
    from ..calibration.result import Calibration
    from ..trials.validation.cross_check.result import CrossCheck
    from .comparison.compare import Compared

_NOT_CONTAINED = "The numbers do not contain:"
NO_COVARIANCE = "Not known: the noise of the poses was not given, and the residuals show none."
_AXES = "xyz"


def folded(anchor: str, title: str, *blocks: Block | str | None) -> Section:
    """Return a section that is folded on the screen; a text gives the reason for a missing part, None is left out."""
    shown = [Paragraph(block, empty=True) if isinstance(block, str) else block for block in blocks if block is not None]
    return Section(anchor, title, shown, folded=True)


def full_section(result: Calibration) -> Section:
    """X and W with their standard deviations, and the directions in which X is least certain."""
    facts = result.facts
    blocks: list[Block] = [Paragraph(text) for text in facts.directions]
    head = ["", result.frame, *([result.frame_W] if facts.W else [])]
    poses = [facts.X, *([facts.W] if facts.W else [])]
    cells = [[fact.concise for fact in pose] for pose in poses]
    rows = [[x.name, *row] for x, *row in zip(facts.X, *cells, strict=True)]
    subject = facts.subject or "camera side in the frame of the robot side (AX = XB)"
    about = f"{result.frame} is the pose of the {subject}"
    if result.W is not None:
        about += f"; {result.frame_W} that of the target, as all poses see it"
    if result.covariance is None:
        caption = f"X; (?) says that its standard deviations are not determined. {about}."
    else:
        caption = (
            "X, with one standard deviation in brackets: 12.345(67) means 12.345 with a standard deviation of 0.067. "
            f"{about}."
        )
    blocks.append(Table(caption, head, rows))
    if result.covariance is not None and result.std is not None:
        axes, worst = facts.select("axis"), facts.select("accuracy")
        lines = [
            [name, *(fixed(fact.value) for fact in (*axes[3 * k : 3 * k + 3], worst[k]))]
            for k, name in enumerate(("translation (mm)", "rotation (deg)"))
        ]
        blocks.append(
            Table(
                f"Standard deviations of X, along and about the axes of the {facts.parent}",
                ["1 sigma", "x", "y", "z", "worst direction"],
                lines,
            )
        )
    return folded("full", "X and the target", *blocks)


def arm_sections(result: Calibration, drawings: Mapping[str, Drawing]) -> list[Section]:
    """Sections on the arm and on the miss distance of the tool; none where the calibration has no joints."""
    sentences = arm_sentences(result)
    if not sentences:
        return []
    of_joints = (one for one in result.findings if one.code == "kinematics.against_controller")
    beside_joints = [str(one) for one in of_joints if one not in result.cautions]
    return [folded("arm", "The arm", *map(Paragraph, [*sentences, *beside_joints]), drawings.get("workspace"))]


def ellipses_section(result: Calibration, drawings: Mapping[str, Drawing], cross_check: CrossCheck | None) -> Section:
    """Ellipses, correlations, and the relations of a cross-check."""
    title = "All ellipses of the error of X"
    if result.covariance is None:
        return folded("ellipses", title, NO_COVARIANCE)
    blocks: list[Block | str] = [drawings["ellipses"], _correlations(result)]
    if cross_check is None:
        blocks.append("No cross-check was run.")
    else:
        blocks.append(Paragraph(f"Cross-check, {cross_check.trials:,} trials: {verdict(cross_check)}"))
        rows = [[r.statement, state(r), r.text + (f" {r.advice}" if r.advice else "")] for r in cross_check.relations]
        caption = "Relations of the cross-check: what must hold between the covariances, and whether it does"
        blocks.append(Table(caption, ["relation", "found", "in numbers"], rows, frozenset({1, 2})))
    return folded("ellipses", title, *blocks)


def _correlations(result: Calibration) -> Block:
    named = [f"{i} with {j} {x:+.2f}" for x, i, j in result.facts.correlations if abs(x) >= MIN_SHOWN_CORRELATION]
    if not named:
        return Paragraph(f"No two components are correlated by {MIN_SHOWN_CORRELATION:g} or more.")
    more = f", and {len(named) - MAX_NAMED} more from {MIN_SHOWN_CORRELATION:g} up" if len(named) > MAX_NAMED else ""
    return Paragraph(f"Strongest correlations: {'; '.join(named[:MAX_NAMED])}{more}.")


def task_space_section(result: Calibration, drawings: Mapping[str, Drawing]) -> Section:
    """The uncertainty of points in front of the camera."""
    title = "Points in front of the camera, in full"
    if result.covariance is None:
        return folded("task-space", title, NO_COVARIANCE)
    if result.opened is not None:
        said = f"Points move without limit along what is open: {'; '.join(result.open_words)}."
        return folded("task-space", title, Paragraph(said))
    points = ahead(result)
    rows = [[f"{z:g}", *(fixed(1e3 * x) for x in numbers)] for z, *numbers in zip(*points, strict=True)]
    table = Table(
        f"Uncertainty of a point on the optical axis, in the {result.facts.parent} (mm, 1 sigma; last column: radius "
        "of a sphere that holds 95 %)",
        ["distance (m)", "worst direction", "across the line of sight", "along it", "95 % radius"],
        rows,
    )
    return folded("task-space", title, drawings["task_space"], table)


def forms_section(result: Calibration) -> Section:
    """X and its inverse for other programs."""
    from ..formats.snippets import texts

    said = Paragraph("X and its inverse, ready to copy. Each states its units and convention.")
    codes = (Code(snippet.title, snippet.text, snippet.convention) for snippet in texts(result))
    return folded("forms", "X for other software", said, *codes)


def scope_section(result: Calibration) -> Section:
    """Section on the meaning of the numbers, and the errors that they do not contain."""
    facts = result.facts
    meaning = f"All standard deviations are 1 sigma, to first order, of {facts.source}."
    known = [] if result.std is None else [Paragraph(meaning), Paragraph(facts.ellipsoid)]
    missing: Sequence[str] = (
        f"Systematic errors: {', '.join(not_included(result))}. All poses share them, they do not average out, and "
        "residuals hardly show them.",
        "Errors that are common to many poses but not to all, such as those of one part of the workspace.",
        "What changed during or after the recording: a camera or target that was moved, temperature, a wrong time.",
        "Residuals are no accuracy: they say how well the data fit together, not how near X is to the truth.",
    )
    last = Paragraph(f"Convention of every covariance: {CONVENTION}.")
    return folded("scope", "What the numbers cover", *known, Paragraph(_NOT_CONTAINED), Points(missing), last)


def needs(what: str, result: Calibration) -> str:
    """Say why ``what``, e.g. "Diagnostics are known", is missing from a result without analysis."""
    if result.covariance is None:
        return f"{what} where the noise of the poses is given or can be estimated; here it is not."
    return f"{what} by the methods efficient and ml, not by {result.method}."


def residuals_section(result: Calibration, drawings: Mapping[str, Drawing]) -> Section:
    """Residuals of the poses and of the pairs."""
    blocks: list[Block | str] = []
    table = result.table
    if table is None or "residuals" not in drawings:
        item = "motion" if result.setup is None else "pose"
        blocks.append(needs(f"Residuals of each {item} are found", result))
    else:
        blocks.append(drawings["residuals"])
        if not table.flagged:
            blocks.append(Paragraph(f"No {table.item} is flagged: none of the {len(table.counted):,} stands out."))
        blocks += [
            Paragraph(str(one))
            for one in result.findings
            if one.code == "calibration.excluded" and one not in result.cautions
        ]
        order = np.argsort(-table.distance2, kind="stable").tolist()
        if len(table) <= MAX_PRINTED_ROWS:
            shown, which = list(range(len(table))), f"All {len(table)} {table.item}s"
        else:
            flagged = [k for k in order if table.flag[k] not in ("kept", "excluded")][:MAX_PRINTED_ROWS]
            excluded = [k for k in order if table.flag[k] == "excluded"][:MAX_PRINTED_ROWS]
            shown = sorted({*flagged, *excluded, *order[:MAX_LISTED]}, key=order.index)
            also = "flagged ones, excluded ones" if excluded else "flagged ones"
            which = f"{len(shown)} of {len(table):,} {table.item}s: {also} and those of largest d², worst first"
            if len(flagged) < len(table.flagged):
                which += f" ({len(table.flagged) - len(flagged)} more are flagged)"
        blocks.append(pose_table(table, shown, f"{which}. Numbers count from 0."))
    return folded("residuals", "Residuals in full", *blocks, *blocks_of(result, "pairs"))


def budget_section(result: Calibration, drawings: Mapping[str, Drawing]) -> Section:
    """Section of the shares of the variance by noise."""
    title = "Uncertainty budget in full"
    tables = blocks_of(result, "budget")
    if not tables or "budget" not in drawings:
        return folded("full-budget", title, needs("The budget is computed", result))
    return folded("full-budget", title, drawings["budget"], *tables, gum_table(result))


def shared_section(result: Calibration, drawings: Mapping[str, Drawing]) -> Section:
    """Section on the errors that all poses share: their priors and their estimates."""
    said = Paragraph(included_words(result))
    return folded("shared", "Errors that all poses share", said, drawings.get("shared"), *blocks_of(result, "shared"))


def methods_section(found: Compared, drawing: Drawing | None) -> Section:
    """The published methods on the same data, or why there are none."""
    title, comparison = "Other methods on the same data", found.comparison
    if comparison is None:
        return folded("methods", title, found.reason)
    text = f"{comparison.verdict} All on the same {comparison.origin}.{found.note}"
    text += " Methods that agree may be wrong together."
    more = Points(comparison.own_warnings) if comparison.own_warnings else None
    return folded("methods", title, Paragraph(text), drawing, methods_table(comparison), more)


def observability_section(result: Calibration) -> Section:
    """Section on the information of the data about X, in numbers and in text."""
    title = "Observability and tests of the residuals"
    not_run = tests_not_run(result)
    skipped: list[Block] = [Paragraph("Tests that were not run:"), Points(not_run)] if not_run else []
    if result.analysis is None:
        text = needs("Observability, influence and tests of the residuals are computed", result)
        return folded("observability", title, text, *skipped)
    found = result.analysis.diagnostics
    s = found.spectrum
    rows = [
        [f"{name}, {word}", f"{fixed(sd[k])} {unit}", f"({', '.join(f'{x:+.2f}' for x in axes[k])})"]
        for name, unit, sd, axes in (
            ("translation", "mm", s.sd_translation_mm, s.axes_translation),
            ("rotation", "deg", s.sd_rotation_deg, s.axes_rotation),
        )
        for k, word in enumerate(("least certain", "middle", "most certain"))
    ]
    frame = s.frame if "frame" in s.frame else f"{s.frame} frame"
    table = Table(
        f"Principal directions of X, in the {frame}{_of_noise_alone(result)}",
        ["direction", "1 sigma", "unit vector"],
        rows,
    )
    said = [one for one in not_shown_yet(result, found.findings) if one not in found.not_run]
    return folded("observability", title, table, *([Points.of_findings(said)] if said else []), *skipped)


def _of_noise_alone(result: Calibration) -> str:
    """Say what the covariance of the result includes and the diagnostics, which are those of the noise model, do
    not.
    """
    offset = result.time_offset
    if offset is not None and offset.share > 0:
        return (
            f"; by the noise alone: the time offset, which the answer contains, adds to it (share {offset.share:.0%})"
        )
    if result.covariance_kind != "model":
        return "; by the model of the noise, not by the covariance of the answer"
    return ""


def noise_section(result: Calibration) -> Section:
    """Section on the noise given or estimated, and the test of the residuals against it."""
    untested = result.fit is None and result.noise is not None
    why = needs("The chi-square test of the residuals is made", result) if untested else None
    return folded("noise", "The noise", *blocks_of(result, "noise"), why)


def covariances_section(result: Calibration) -> Section:
    """The covariances that need no noise model, and X of two halves of the data."""
    title = "Covariances without a noise model, and two halves of the data"
    analysis, tables = result.analysis, blocks_of(result, "covariances")
    if analysis is None or not tables:
        return folded("covariances", title, needs("Other covariances and tests of two halves are computed", result))
    run = [half.finding for half in (analysis.split_half, analysis.split_in_time) if half.possible]
    said = not_shown_yet(result, run)
    return folded("covariances", title, *tables, *([Points.of_findings(said)] if said else []))


def camera_sections(result: Calibration) -> list[Section]:
    """One section, or none where the camera poses came without corners."""
    poses = poses_of(result)
    cam = None if poses is None else poses.camera_calibration
    if cam is None:
        return []
    rows = [[name, f"{value} {unit}".rstrip() + said] for name, value, unit, said in parameter_rows(cam)]
    caption = (
        f"Intrinsics of the model {model_name(cam)}, with one standard deviation in brackets (pixels; the centre "
        "of the first pixel is at (0, 0))"
    )
    said = Paragraph(f"{answer(cam)} {noise_words(cam)} {boards_words(cam)} {coverage_words(cam)}")
    shares = Paragraph(words) if (words := shares_words(result)) else None
    warned = Points(cam.warnings, frozenset(range(len(cam.warnings)))) if cam.warnings else None
    return [folded("camera", "The camera", said, Table(caption, ["parameter", "value"], rows), shares, warned)]


def scene_sections(result: Calibration) -> list[Section]:
    """One section on the pictures of a scene, or none where there were none."""
    poses = poses_of(result)
    facts = None if poses is None else poses.scene
    if poses is None or facts is None:
        return []
    said = (
        f"No board: the camera poses come from {facts.points:,} points of a scene that stands still, found in the same "
        f"{poses.n} of {facts.pictures} pictures, {facts.per_picture:,.0f} in a picture, with a pixel noise of "
        f"{digits(facts.pixel_noise, 2)} px. Their scale is that of the robot."
    )
    scale = next((str(one) for one in result.findings if one.code == "calibration.scene_scale"), "")
    rows = [
        [name, concise(value, sd) if sd else f"{value:.7g}, given"]
        for name, value, sd in zip(LENS_NAMES, facts.lens, facts.lens_sd, strict=False)
    ]
    caption = "Intrinsics of the model brown that belong to X, with one standard deviation in brackets"
    table = Table(caption, ["parameter", "value"], rows) if rows else None
    return [folded("scene", "The scene", Paragraph(f"{said} {scale}".strip()), table, *map(_drawn, facts.views))]


def _drawn(view: SceneView) -> Drawing:
    """Return a picture of the scene with its points."""
    xy = zip(view.at[::2], view.at[1::2], strict=True)
    dots = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="1.6" fill="none" stroke="#ffb000"/>' for x, y in xy)
    svg = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {view.width} {view.height}" width="{view.width}">'
        f'<image href="data:image/jpeg;base64,{view.jpeg}" width="{view.width}" height="{view.height}"/>{dots}</svg>'
    )
    caption = f"{view.name}, with some of the points of the scene that it shows."
    return Drawing(f"scene-{view.name}", svg, f"Picture {view.name} with points of the scene", caption, small=True)


def shares_words(result: Calibration) -> str:
    """State the shares of the variance of X from the intrinsics and from the corners; empty where they are unknown."""
    if not result.has_budget or (ErrorKey(Owner.CAMERA, Kind.SHARED),) not in result.budget.keys:
        return ""
    budget = result.budget
    shared, each = (
        [
            fixed(100 * budget.group_shares[f"X {kind}"][budget.keys.index((ErrorKey(Owner.CAMERA, of),))], 2)
            for kind in KINDS
        ]
        for of in (Kind.SHARED, Kind.EACH_POSE)
    )
    return (
        f"The errors of the intrinsics, which all camera poses share, make {shared[0]} % of the variance of X's "
        f"rotation and {shared[1]} % of that of its translation; the noise of the corners, of each picture by itself, "
        f"{each[0]} % and {each[1]} %. As the joint covariance says what the intrinsics move, X is estimated from what "
        "they move least."
    )


def repeat_section(result: Calibration, date: str) -> Section:
    """Files with their hashes, command, options, versions, hash of the data."""
    title = "To repeat this run"
    written = Paragraph(f"Report written on {date} by uq-handeye {__version__}.")
    found = result.provenance
    if found is None:
        text = "Not known where this result comes from: it was not made by calibrate()."
        return folded("repeat", title, text, written)
    blocks: list[Block | str] = []
    if found.sources:
        rows = [[s.name, s.format, f"{s.size:,}", s.sha256] for s in found.sources]
        caption = "Files that were read, in the order robot, camera"
        blocks.append(Table(caption, ["file", "format", "bytes", "SHA-256"], rows, frozenset({1, 3}), verbatim=True))
        if notes := [f"{source.name}: {note}" for source in found.sources for note in source.notes]:
            blocks += [Paragraph("What the readers found out by themselves:"), Points(notes)]
    else:
        blocks.append("The poses came from arrays, not from files; their hash is below.")
    if found.command is not None:
        blocks.append(Code("Command line", found.command, "Run it in the folder of the files."))
    facts: list[list[str]] = [["data, SHA-256", found.data_sha256]]
    facts += [[f"option {name}", "not given" if value is None else str(value)] for name, value in found.options.items()]
    facts += _noise(result)
    if (offset := result.time_offset) is not None:
        facts += [["time offset (s)", repr(offset.offset)], ["its standard deviation (s)", repr(offset.std)]]
    facts += [[f"version of {name}", value] for name, value in found.versions.items()]
    caption = "Data as used (float64, little-endian, robot first), arguments of calibrate(), versions"
    blocks.append(Table(caption, ["what", "value"], facts, frozenset({1}), verbatim=True))
    return folded("repeat", title, *blocks, written)


def _noise(result: Calibration) -> list[list[str]]:
    """The noise that was given: its standard deviations where they are all there is to it, else a hash."""
    if result.noise is None or result.noise_estimate is not None:
        return [["noise", "not given"]]
    facts = []
    for name, S in result.noise.sides.items():
        if S is None:
            facts.append([f"noise of {name}", "exact"])
            continue
        S = np.ascontiguousarray(S, dtype="<f8")
        sizes = np.sqrt([S[..., 0, 0].flat[0], S[..., 3, 3].flat[0]]) if S.shape[-1] == 6 else np.zeros(2)
        if S.shape == (6, 6) and np.allclose(S, np.diag(np.repeat(sizes**2, 3)), rtol=1e-14, atol=0):
            text = f"{float(sizes[0])!r} rad, {float(sizes[1])!r} m, 1 sigma per axis"
        else:
            text = f"{' x '.join(map(str, S.shape))}, SHA-256 {hashlib.sha256(S.tobytes()).hexdigest()}"
        facts.append([f"noise of {name}", text])
    return facts


def folded_sections(
    result: Calibration, drawings: Mapping[str, Drawing], found: Compared, cross_check: CrossCheck | None, date: str
) -> list[Section]:
    """Return the sections that follow the two pages, in the order of the contents."""
    return [
        full_section(result),
        *arm_sections(result, drawings),
        ellipses_section(result, drawings, cross_check),
        residuals_section(result, drawings),
        budget_section(result, drawings),
        shared_section(result, drawings),
        task_space_section(result, drawings),
        *camera_sections(result),
        *scene_sections(result),
        observability_section(result),
        noise_section(result),
        covariances_section(result),
        methods_section(found, drawings.get("methods")),
        scope_section(result),
        forms_section(result),
        repeat_section(result, date),
    ]
