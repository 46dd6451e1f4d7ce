"""The section of a hand-eye report about the camera, where its poses come from corners."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..calibration.report.analysis import KINDS
from ..core.formatting.numbers import fixed
from ..core.presentation.document import Block, Paragraph, Points, Section, Table
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
    if result.analysis is None or f"camera {SHARED}" not in result.analysis.budget.sources:
        return ""
    budget = result.analysis.budget
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
