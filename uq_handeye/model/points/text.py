"""Poses from points in words and numbers."""

from __future__ import annotations

import numpy as np

from ...core.formatting.numbers import concise, digits, fixed
from ...core.geometry.se3 import Array, skew
from ...core.presentation.document import Block, Caution, Document, Heading, Paragraph, Table
from ..noise.models import marginals
from .posed import Posed
from .sentences import NAMED

MOST_LISTED = 30


def points_document(found: Posed, details: bool = False) -> Document:
    """The summary: what is known first, then what looks wrong, then the numbers; ``details``: lists in full."""
    return [
        [Heading(title(found)), Paragraph(answer(found))],
        *map(Caution, found.warnings),
        noise_table(found),
        Paragraph(noise_words(found)),
        _outlier_lines(found, details),
        Paragraph(target_words(found)),
        Paragraph(
            "The covariance of the poses is joint, to first order, for independent noise of the points. Errors that "
            "all points of a pose share, such as a wrong depth scale, are not covered."
        ),
    ]


def title(found: Posed) -> str:
    """Return the title: what it is and what it was made of."""
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
        f"The poses are known to {fixed(np.degrees(np.median(turn)), 2)} deg and {fixed(1e3 * np.median(move), 2)} "
        "mm (median over the poses, 1 sigma in the worst direction, at the centroid of the target)."
    )


def noise_table(found: Posed) -> Block:
    """Standard deviations of a point, with what they are known to."""
    names = ["all directions"] if found.model.isotropic else ["lateral, per axis", "axial"]
    dof = [float(found.dof.sum())] if found.model.isotropic else found.dof.tolist()
    rows = []
    for name, sd, freedom in zip(names, found.sd.tolist(), dof, strict=False):
        spread = None if found.noise_given or freedom <= 0 else sd / np.sqrt(2 * freedom)
        value = fixed(1e3 * sd) if spread is None else concise(1e3 * sd, 1e3 * spread)
        rows.append([name, value, "given" if found.noise_given else f"{freedom:.0f}"])
    return Table(
        "Noise of a point:", ["direction", "standard deviation", "degrees of freedom"], rows, units=["", "mm", ""]
    )


def noise_words(found: Posed) -> str:
    """Describe how the noise was found and whether it depends on the distance."""
    if found.noise_given:
        return "The noise was given; it is the same at all distances."
    how = "The noise was estimated from the residuals (REML)"
    if not found.model.growing:
        return f"{how}, as the same at all distances."
    growth = "in proportion to the distance"
    if not found.model.isotropic:
        growth = "laterally in proportion to the distance, axially to its square"
    return f"{how}. It grows with the distance: {growth}. The values are those at {fixed(found.model.distance, 2)} m."


def target_words(found: Posed) -> str:
    """Describe the target and, where it was estimated, how well it is known."""
    m = len(found.target.xyz)
    if found.target_known:
        return f"The target of {m} points was given, and taken as exact."
    sd = np.sqrt((found.target_factor**2).sum(axis=-1))
    return (
        f"The target of {m} points was estimated with the poses, each coordinate to {digits(1e3 * np.median(sd), 2)} "
        "mm (median). Its frame has its origin at the centroid of the points and the axes of the camera at the pose "
        "with most points. All poses share the errors of the shape."
    )


def _outlier_lines(found: Posed, every: bool) -> list[Block]:
    """Points left out, where the caution does not name them all."""
    outliers = found.outliers
    if len(outliers) <= NAMED:
        return []
    shown = [f"pose {pose}, point {point}: {fixed(1e3 * distance)} mm" for pose, point, distance in outliers]
    more = 0 if every else len(shown) - MOST_LISTED
    shown = shown[: len(shown) if every else MOST_LISTED] + ([f"and {more:,} more that are nearer"] if more > 0 else [])
    return [Paragraph("Points left out:"), *(Paragraph(text, indent="  ") for text in shown)]
