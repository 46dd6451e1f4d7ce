"""The report of a camera calibration: one self-contained HTML file, in the style of the hand-eye report."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from datetime import UTC, datetime

import numpy as np

from ...._version import __version__
from ....core.files.source import versions
from ....core.geometry.conventions import CONVENTION
from ....core.limits import MAX_PRINTED_ROWS
from ....core.presentation.document import Block, Code, Paragraph, Points, Section, Table
from ....core.presentation.ellipses import render
from ....core.presentation.figure_parts import Picture
from ....core.presentation.numbers import column, fixed
from ....core.presentation.page import Page, drawing
from ....core.presentation.units import MM_PER_M
from ..calibrated import Calibrated, distances, picture_rms, tilts
from ..intrinsics_file import PIXELS, camera_snippets
from .figures import camera_pictures
from .text import (
    NOTATION,
    answer,
    board_words,
    coverage_words,
    model_choice,
    model_name,
    noise_words,
    outlier_names,
    parameter_rows,
    scope_words,
)


def report_files(cam: Calibrated) -> dict[str, str | bytes]:
    """The report and its figures as files, by name."""
    drawn = camera_pictures(cam)
    figures = {f"{stem}.{kind}": render(drawn[stem].figure, kind) for stem in drawn for kind in ("png", "svg")}
    return {"report.html": camera_report_html(cam, drawn=drawn), **figures}


def camera_report_html(cam: Calibrated, date: str | None = None, drawn: Mapping[str, Picture] | None = None) -> str:
    """The report as HTML text; ``date`` as written into it (None: now, UTC), ``drawn`` its figures, if at hand."""
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC") if date is None else date
    drawn = camera_pictures(cam) if drawn is None else drawn
    figures: dict[str, Block] = {stem: drawing(stem, picture) for stem, picture in drawn.items()}
    exact = Paragraph("The intrinsics were given as exact: they have no uncertainty to draw.", empty=True)
    forms = [Code(snippet.title, snippet.text, snippet.convention) for snippet in camera_snippets(cam)]
    common = (
        "The errors of the intrinsics are common to all poses and do not average out: hand the poses on with their "
        "joint covariance (the folder as a whole, or PoseNoise(camera=camera.covariance)), not one by one."
    )
    scope = [scope_words(cam), common, f"Convention of every covariance of a pose: {CONVENTION}."]
    sections = [
        Section("answer", "The camera", [Paragraph(answer(cam)), _intrinsics(cam), Paragraph(noise_words(cam))]),
        Section("warnings", "Warnings", [_warnings(cam)]),
        Section(
            "residuals",
            "Residuals: is the model right?",
            [figures[stem] for stem in ("pattern", "residuals", "pictures")],
        ),
        Section(
            "board",
            "The board: is it flat?",
            [figures.get("board", Paragraph(board_words(cam))), figures["board_residuals"]],
        ),
        Section("outliers", "Corners left out", [_outliers(cam)]),
        Section(
            "covered",
            "What the pictures cover",
            [Paragraph(coverage_words(cam)), figures.get("certainty", exact), figures["boards"]],
        ),
        Section("models", "Models that were compared", _choice(cam)),
        Section("poses", "The pictures", [_poses(cam)]),
        Section(
            "forms",
            "Intrinsics for your program",
            [Paragraph("The intrinsics, ready to copy. Mind the convention beside each."), *forms],
        ),
        Section(
            "repeat",
            "To repeat this run",
            [_repeat(cam), Paragraph(f"Report written on {date} by uq-handeye {__version__}.")],
        ),
        Section("scope", "What the numbers cover", [Paragraph(text) for text in scope]),
    ]
    width, height = cam.image_size
    facts = [f"{width} x {height} pixels", f"{cam.corners.n:,} pictures", f"{cam.corners.m:,} corners", date]
    return Page("Camera calibration", model_name(cam), facts, sections).html()


def _intrinsics(cam: Calibrated) -> Block:
    rows = [
        [name, f"{value} {unit}".rstrip(), "given, exact" if said else fixed(cam.std[name])]
        for name, value, unit, said in parameter_rows(cam)
    ]
    caption = f"Intrinsics of the model {model_name(cam)}; {NOTATION}. {PIXELS}"
    return Table(caption, ["parameter", "value", "1 sigma"], rows)


def _warnings(cam: Calibrated) -> Block:
    found = list(cam.warnings)
    if cam.corners.missing:
        found.append(f"No board was found in these pictures: {', '.join(cam.corners.missing)}.")
    if found:
        return Points(found, frozenset(range(len(found))))
    return Paragraph(
        "Nothing looked wrong: the residuals have no pattern that matters, and hardly a corner was left out."
    )


def _outliers(cam: Calibrated) -> Block:
    found = outlier_names(cam)
    if not found:
        return Paragraph("None: every corner is where the others put it.")
    corners = cam.corners
    distance = np.linalg.norm(cam.bundle.residuals, axis=1)
    listed = [j for j, _ in found[:MAX_PRINTED_ROWS]]
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
    return Table(caption, ["picture", "corner", "u", "v", "distance", "by pixel noise"], rows, verbatim=True)


def _choice(cam: Calibrated) -> list[Block]:
    if not cam.candidates:
        text = f"None: the model {model_name(cam)} was given. Model 'auto' compares several."
        return [Paragraph(text, empty=True)]
    caption = "BIC beyond the smallest: 10 and more speaks clearly against a model. All on the same corners."
    return model_choice(cam, caption, "chosen")


def _poses(cam: Calibrated) -> Block:
    corners, rms = cam.corners, picture_rms(cam)
    if corners.n <= MAX_PRINTED_ROWS:
        shown, which = list(range(corners.n)), f"All {corners.n} pictures"
    else:
        shown = sorted(np.argsort(-rms, kind="stable")[:MAX_PRINTED_ROWS].tolist())
        which = f"The {MAX_PRINTED_ROWS} of {corners.n:,} pictures with the largest residuals"
    used = np.bincount(corners.picture[cam.bundle.used], minlength=corners.n)
    every = np.bincount(corners.picture, minlength=corners.n)
    S = cam.covariance
    own, whole = (MM_PER_M * np.sqrt(M[:, 3:, 3:].diagonal(axis1=1, axis2=2)) for M in (S.own, S.blocks))
    columns = {
        "picture": [corners.names[i] for i in shown],
        "row": [str(row) for row in corners.rows[shown]],
        "corners used": [f"{used[i]} of {every[i]}" for i in shown],
        "RMS (pixels)": column(rms[shown]),
        "distance (m)": column(distances(cam)[shown]),
        "tilt (deg)": [f"{x:.0f}" for x in tilts(cam)[shown]],
        "own 1 sigma (mm)": column(own[shown, 2]),
        "with intrinsics (mm)": column(whole[shown, 2]),
    }
    caption = (
        f"{which}. 1 sigma of the distance: by the corners of the picture only, and with the intrinsics, whose error "
        "all pictures share"
    )
    return Table(caption, list(columns), list(zip(*columns.values(), strict=True)), verbatim=True)


def _repeat(cam: Calibrated) -> Block:
    """Corners as they were used, settings, versions."""
    digest = hashlib.sha256()
    for values in (cam.corners.row, cam.corners.points, cam.corners.pixels):
        digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
    facts: list[list[str]] = [
        ["corners, SHA-256", digest.hexdigest()],
        ["image size", f"{cam.image_size[0]} x {cam.image_size[1]} pixels"],
        ["estimated", ", ".join(cam.estimated) or "nothing but the poses"],
        ["model", f"auto, out of {len(cam.candidates)}" if cam.candidates else f"{cam.model}, as given"],
        *([f"version of {name}", value] for name, value in versions().items()),
    ]
    caption = "Corners as used (row, points, pixels; float64, little-endian), settings, versions"
    return Table(caption, ["what", "value"], facts, frozenset({1}), verbatim=True)
