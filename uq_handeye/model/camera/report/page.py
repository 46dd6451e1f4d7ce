"""The report of a camera calibration: one self-contained HTML file, in the look of that of a hand-eye calibration."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from datetime import UTC, datetime

import numpy as np

from ...._version import __version__
from ....core.files.source import versions
from ....core.formatting.numbers import column, fixed
from ....core.geometry.conventions import CONVENTION
from ....core.presentation.document import Block, Code, Drawing, Paragraph, Points, Section, Table
from ....core.presentation.ellipses import render
from ....core.presentation.figure_parts import Picture
from ....core.presentation.page import Page, drawing
from ..calibrated import Calibrated, distances, picture_rms, tilts
from ..files.intrinsics_file import PIXELS, camera_snippets
from .figures import camera_pictures
from .text import (
    answer,
    board_words,
    candidate_table,
    choice_words,
    coverage_words,
    model_name,
    noise_words,
    outlier_names,
    parameter_rows,
    scope_words,
)

# Tables list all pictures and outliers up to so many, of more the worst.
MOST_LISTED, WORST = 60, 40


def report_files(cam: Calibrated) -> dict[str, str | bytes]:
    """The report and its figures as files, by name."""
    drawn = camera_pictures(cam)
    figures = {f"{stem}.{kind}": render(drawn[stem].figure, kind) for stem in drawn for kind in ("png", "svg")}
    return {"report.html": _page(cam, drawn, None), **figures}


def camera_report_html(cam: Calibrated, date: str | None = None) -> str:
    """The report as HTML text; ``date`` is written into it, None is now (UTC)."""
    return _page(cam, camera_pictures(cam), date)


def _page(cam: Calibrated, drawn: Mapping[str, Picture], date: str | None) -> str:
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC") if date is None else date
    drawings = {stem: drawing(stem, picture) for stem, picture in drawn.items()}
    sections = [
        _answer(cam),
        _warnings(cam),
        _residuals(cam, drawings),
        _board(cam, drawings),
        _outliers(cam),
        _covered(cam, drawings),
        _choice(cam),
        _poses(cam),
        _forms(cam),
        _repeat(cam, date),
        _scope(cam),
    ]
    width, height = cam.image_size
    facts = [f"{width} x {height} pixels", f"{cam.corners.n:,} pictures", f"{cam.corners.m:,} corners", date]
    return Page("Camera calibration", model_name(cam), facts, sections).html()


def _answer(cam: Calibrated) -> Section:
    rows = [
        [name, f"{value} {unit}".rstrip(), "given, exact" if said else fixed(cam.std[name])]
        for name, value, unit, said in parameter_rows(cam)
    ]
    caption = (
        f"Intrinsics of the model {model_name(cam)}, with one standard deviation in brackets: 12.345(67) means 12.345 "
        f"with a standard deviation of 0.067. {PIXELS}"
    )
    blocks: list[Block] = [
        Paragraph(answer(cam)),
        Table(caption, ["parameter", "value", "1 sigma"], rows),
        Paragraph(noise_words(cam)),
    ]
    return Section("answer", "The camera", blocks)


def _warnings(cam: Calibrated) -> Section:
    found = list(cam.warnings)
    if cam.corners.missing:
        found.append(f"No board was found in these pictures: {', '.join(cam.corners.missing)}.")
    if found:
        return Section("warnings", "Warnings", [Points(found, frozenset(range(len(found))))])
    text = "Nothing looked wrong: the residuals have no pattern that matters, and hardly a corner was left out."
    return Section("warnings", "Warnings", [Paragraph(text)])


def _residuals(cam: Calibrated, drawings: Mapping[str, Drawing]) -> Section:
    blocks = [drawings[stem] for stem in ("pattern", "residuals", "pictures")]
    return Section("residuals", "Residuals: is the model right?", blocks)


def _board(cam: Calibrated, drawings: Mapping[str, Drawing]) -> Section:
    blocks: list[Block] = [drawings["board"]] if "board" in drawings else [Paragraph(board_words(cam))]
    return Section("board", "The board: is it flat?", [*blocks, drawings["board_residuals"]])


def _outliers(cam: Calibrated) -> Section:
    title = "Corners left out"
    found = outlier_names(cam)
    if not found:
        return Section("outliers", title, [Paragraph("None: every corner is where the others put it.")])
    corners = cam.corners
    distance = np.linalg.norm(cam.bundle.residuals, axis=1)
    listed = [j for j, _ in found[: MOST_LISTED if len(found) <= MOST_LISTED else WORST]]
    rows = [
        [
            corners.names[corners.picture[j]], str(corners.place[j]), f"{corners.pixels[j, 0]:.1f}",
            f"{corners.pixels[j, 1]:.1f}", fixed(distance[j]), fixed(distance[j] / cam.pixel_noise),
        ]
        for j in listed
    ]  # fmt: skip
    which = "All" if len(listed) == len(found) else f"The farthest {len(listed)} of {len(found):,}"
    caption = (
        f"{which}, the farthest first: number of the corner within its picture, counted from 0, where it was measured, "
        "and how far that is from where the camera sees it (pixels)"
    )
    head = ["picture", "corner", "u", "v", "distance", "by pixel noise"]
    return Section("outliers", title, [Table(caption, head, rows, verbatim=True)])


def _covered(cam: Calibrated, drawings: Mapping[str, Drawing]) -> Section:
    blocks: list[Block] = [Paragraph(coverage_words(cam))]
    if "certainty" in drawings:
        blocks.append(drawings["certainty"])
    else:
        blocks.append(Paragraph("The intrinsics were given as exact: they have no uncertainty to draw.", empty=True))
    return Section("covered", "What the pictures cover", [*blocks, drawings["boards"]])


def _choice(cam: Calibrated) -> Section:
    title = "Models that were compared"
    if not cam.candidates:
        text = f"None: the model {model_name(cam)} was given. Model 'auto' compares several."
        return Section("models", title, [Paragraph(text, empty=True)])
    caption = "BIC beyond the smallest: 10 and more speaks clearly against a model. All on the same corners."
    table = candidate_table(cam, caption, "chosen")
    return Section("models", title, [Paragraph(choice_words(cam)), table])


def _poses(cam: Calibrated) -> Section:
    corners = cam.corners
    rms = picture_rms(cam)
    if corners.n <= MOST_LISTED:
        shown, which = list(range(corners.n)), f"All {corners.n} pictures"
    else:
        shown = sorted(np.argsort(-rms, kind="stable")[:WORST].tolist())
        which = f"The {WORST} of {corners.n:,} pictures with the largest residuals"
    used = np.bincount(corners.picture[cam.bundle.used], minlength=corners.n)
    every = np.bincount(corners.picture, minlength=corners.n)
    S = cam.covariance
    own, whole = (1e3 * np.sqrt(M[:, 3:, 3:].diagonal(axis1=1, axis2=2)) for M in (S.own, S.blocks))
    columns = (
        [corners.names[i] for i in shown],
        [str(row) for row in corners.rows[shown]],
        [f"{used[i]} of {every[i]}" for i in shown],
        column(rms[shown]),
        column(distances(cam)[shown]),
        [f"{x:.0f}" for x in tilts(cam)[shown]],
        column(own[shown, 2]),
        column(whole[shown, 2]),
    )
    caption = (
        f"{which}. 1 sigma of the distance: by the corners of the picture only, and with the intrinsics, whose error "
        "all pictures share"
    )
    head = [
        "picture", "row", "corners used", "RMS (pixels)", "distance (m)", "tilt (deg)", "own 1 sigma (mm)",
        "with intrinsics (mm)",
    ]  # fmt: skip
    rows = list(zip(*columns, strict=True))
    return Section("poses", "The pictures", [Table(caption, head, rows, verbatim=True)])


def _forms(cam: Calibrated) -> Section:
    blocks: list[Block] = [Paragraph("The intrinsics, ready to copy. Mind the convention beside each.")]
    blocks += [Code(snippet.title, snippet.text, snippet.convention) for snippet in camera_snippets(cam)]
    return Section("forms", "Intrinsics for your program", blocks)


def _repeat(cam: Calibrated, date: str) -> Section:
    """Corners as they were used, what was asked for, versions."""
    corners, digest = cam.corners, hashlib.sha256()
    for values in (corners.row, corners.points, corners.pixels):
        digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
    facts: list[list[str]] = [
        ["corners, SHA-256", digest.hexdigest()],
        ["image size", f"{cam.image_size[0]} x {cam.image_size[1]} pixels"],
        ["estimated", ", ".join(cam.estimated) or "nothing but the poses"],
        ["model", f"auto, out of {len(cam.candidates)}" if cam.candidates else f"{cam.model}, as given"],
        *([f"version of {name}", value] for name, value in versions().items()),
    ]
    caption = "Corners as used (row, points, pixels; float64, little-endian), what was asked for, versions"
    table = Table(caption, ["what", "value"], facts, frozenset({1}), verbatim=True)
    written = Paragraph(f"Report written on {date} by uq-handeye {__version__}.")
    return Section("repeat", "To repeat this run", [table, written])


def _scope(cam: Calibrated) -> Section:
    blocks = [
        Paragraph(scope_words(cam)),
        Paragraph(
            "The errors of the intrinsics are common to all poses and do not average out: hand the poses on with their "
            "joint covariance (the folder as a whole, or PoseNoise(camera=camera.covariance)), not one by one."
        ),
        Paragraph(f"Convention of every covariance of a pose: {CONVENTION}."),
    ]
    return Section("scope", "What the numbers cover", blocks)
