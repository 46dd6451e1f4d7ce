"""The text on poses from points."""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array, skew
from ...core.limits import MAX_LISTED, MAX_NAMED
from ...core.presentation.document import Block, Caution, Document, Heading, Paragraph, Table
from ...core.presentation.numbers import concise, fixed
from ...core.presentation.units import MM_PER_M
from ..errors.models import marginals
from .posed import Posed


def points_document(found: Posed, details: bool = False) -> Document:
    """The summary: accuracy of the poses, warnings, noise, points left out; ``details``: lists in full."""
    return [
        [Heading(title(found)), Paragraph(answer(found))],
        *map(Caution, found.warnings),
        noise_table(found),
        Paragraph(noise_words(found)),
        _outlier_lines(found, details),
        Paragraph(f"The target of {len(found.target.xyz)} points was given, and taken as exact."),
        Paragraph(
            "The covariance of each pose is that of first order, for independent noise of the points. Errors that all "
            "points of a pose share, such as a wrong depth scale, are not covered."
        ),
    ]


def title(found: Posed) -> str:
    """Return the title: numbers of poses and points."""
    return f"{found.n} poses of a target from {int(found.used.sum()):,} points"


def pose_deviations(found: Posed) -> tuple[Array, Array]:
    """(n,) standard deviations of rotation (rad) and translation (m, of the points' centroid), the worst direction."""
    S = marginals(found.covariance)
    R, centre = found.poses[:, :3, :3], found.target.xyz.mean(axis=0)
    D = np.concatenate([-skew((R @ centre[:, None])[..., 0]), np.broadcast_to(np.eye(3), (len(S), 3, 3))], axis=-1)
    turn, move = (np.sqrt(np.linalg.eigvalsh(M)[:, -1]) for M in (S[:, :3, :3], D @ S @ D.mT))
    return turn, move


def answer(found: Posed) -> str:
    """State how well the poses are known."""
    turn, move = pose_deviations(found)
    return (
        f"The poses are known to {fixed(np.degrees(np.median(turn)), 2)} deg and "
        f"{fixed(MM_PER_M * np.median(move), 2)} mm (median over the poses, 1 sigma in the worst direction, at the "
        "centroid of the target)."
    )


def noise_table(found: Posed) -> Block:
    """Standard deviations of a point across and along the line of sight, and how well they are known."""
    rows = []
    for name, sd, dof in zip(("lateral, per axis", "axial"), found.sd.tolist(), found.dof.tolist(), strict=True):
        value = fixed(MM_PER_M * sd) if found.noise_given else concise(MM_PER_M * sd, MM_PER_M * sd / np.sqrt(2 * dof))
        rows.append([name, value, "given" if found.noise_given else f"{dof:.0f}"])
    return Table(
        "Noise of a point:", ["direction", "standard deviation", "degrees of freedom"], rows, units=["", "mm", ""]
    )


def noise_words(found: Posed) -> str:
    """State where the noise comes from."""
    if found.noise_given:
        return "The noise was given; it is the same at all distances."
    return "The noise was estimated from the residuals, as the same at all distances."


def _outlier_lines(found: Posed, every: bool) -> list[Block]:
    """Points left out, where the caution does not name them all."""
    outliers = found.outliers
    if len(outliers) <= MAX_NAMED:
        return []
    shown = [f"pose {pose}, point {point}: {fixed(MM_PER_M * distance)} mm" for pose, point, distance in outliers]
    more = 0 if every else len(shown) - MAX_LISTED
    shown = shown[: len(shown) if every else MAX_LISTED] + ([f"and {more:,} more that are nearer"] if more > 0 else [])
    return [Paragraph("Points left out:"), *(Paragraph(text, indent="  ") for text in shown)]
