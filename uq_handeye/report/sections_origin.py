"""Sections of the report about where a result comes from: the camera, and what is needed to repeat the run."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

import numpy as np

from ..calibration.report.analysis import KINDS
from ..core.formatting.numbers import fixed
from ..core.presentation.document import Block, Code, Paragraph, Points, Section, Table
from ..fit.diagnostics.budget import EACH, SHARED
from ..model.camera.report.text import answer, boards_words, coverage_words, model_name, noise_words, parameter_rows
from .figures import poses_of

if TYPE_CHECKING:
    from ..calibration.result import Calibration


def camera_sections(result: Calibration) -> list[Section]:
    """One section, or none where the camera poses came without corners."""
    poses = poses_of(result)
    cam = None if poses is None else poses.camera_calibration
    if cam is None:
        return []
    rows = [[name, f"{value} {unit}".rstrip() + said] for name, value, unit, said in parameter_rows(cam)]
    blocks: list[Block] = [
        Paragraph(f"{answer(cam)} {noise_words(cam)} {boards_words(cam)} {coverage_words(cam)}"),
        Table(
            f"Intrinsics of the model {model_name(cam)}, with one standard deviation in brackets (pixels; the centre "
            "of the first pixel is at (0, 0))",
            ["parameter", "value"],
            rows,
        ),
    ]
    if words := shares_words(result):
        blocks.append(Paragraph(words))
    if cam.warnings:
        blocks.append(Points(cam.warnings, frozenset(range(len(cam.warnings)))))
    return [Section("camera", "The camera", blocks, folded=True)]


def shares_words(result: Calibration) -> str:
    """Say which share of the variance of X the intrinsics have, and which the corners; empty where it is not known."""
    if not result.has_budget or f"camera {SHARED}" not in result.budget.sources:
        return ""
    budget = result.budget
    shared, each = (
        [fixed(100 * budget.group_shares[f"X {kind}"][budget.sources.index(f"camera {name}")], 2) for kind in KINDS]
        for name in (SHARED, EACH)
    )
    return (
        f"The errors of the intrinsics, which all camera poses share, make {shared[0]} % of the variance of X's "
        f"rotation and {shared[1]} % of that of its translation; the noise of the corners, of each picture by itself, "
        f"{each[0]} % and {each[1]} %. As the joint covariance says what the intrinsics move, X is estimated from what "
        "they move least."
    )


# Sides of the noise, of poses and of motions.
NAMES = ("robot", "camera", "A", "B")


def repeat_section(result: Calibration, date: str, version: str) -> Section:
    """Files with their hashes, command, options, versions, hash of the data."""
    title = "To repeat this run"
    written = Paragraph(f"Report written on {date} by uq-handeye {version}.")
    found = result.provenance
    if found is None:
        text = "Not known where this result comes from: it was not made by calibrate(), or by an older version."
        return Section("repeat", title, [Paragraph(text, empty=True), written], folded=True)
    blocks: list[Block] = []
    if found.sources:
        rows = [[s.name, s.format, f"{s.size:,}", s.sha256] for s in found.sources]
        caption = "Files that were read, in the order robot, camera"
        blocks.append(Table(caption, ["file", "format", "bytes", "SHA-256"], rows, frozenset({1, 3}), verbatim=True))
        if notes := [f"{source.name}: {note}" for source in found.sources for note in source.notes]:
            blocks += [Paragraph("What the readers found out by themselves:"), Points(notes)]
    else:
        blocks.append(Paragraph("The poses came from arrays, not from files; their hash is below.", empty=True))
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
    return Section("repeat", title, [*blocks, written], folded=True)


def _noise(result: Calibration) -> list[list[str]]:
    """The noise that was given: its standard deviations where they are all there is to it, else a hash."""
    if result.noise is None or result.noise_estimate is not None:
        return [["noise", "not given"]]
    facts = []
    for name in NAMES:
        S = getattr(result.noise, name, None)
        if S is None:
            if hasattr(result.noise, name):
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
