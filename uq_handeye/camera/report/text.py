"""A calibrated camera in words and numbers: what was found, how well it is known, and what looks wrong."""

from __future__ import annotations

import numpy as np

from ...formatting.numbers import concise, fixed, probability
from ...presentation.document import Block, Caution, Document, Heading, Paragraph, Table
from ..calibrated import Calibrated
from ..model_choice import best
from ..models import LINEAR
from ..residual_pattern import CELLS, RARE
from ..what_was_seen import covered, distances, tilts

# Corners left out that the text lists, the farthest first; the files list them all.
MOST_LISTED = 12
# A picture with corners in fewer of its cells is covered badly.
LITTLE = 0.5
# Noise of the pictures that differs by this factor is told.
UNEQUAL = 1.5
UNITS = dict.fromkeys(LINEAR, "pixels")
NOTATION = "12.345(67) means 12.345 with a standard deviation of 0.067"


def camera_document(cam: Calibrated) -> Document:
    """The summary: what is known first, then what is wrong, then the numbers."""
    rows = [[name, value + (f" {unit}" if unit else "") + said] for name, value, unit, said in parameter_rows(cam)]
    return [
        [Heading(title(cam)), Paragraph(answer(cam))],
        *map(Caution, cam.warnings),
        Table(f"Intrinsics ({NOTATION}):", ["", ""], rows, frozenset({1})),
        [Paragraph(noise_words(cam)), *_outlier_lines(cam)],
        *(Paragraph(str(finding)) for finding in cam.findings if finding.severity == "note"),
        *(Paragraph(text) for text in (pattern_words(cam), coverage_words(cam), boards_words(cam))),
        *([[Paragraph(choice_words(cam)), candidate_table(cam, "")]] if cam.candidates else []),
        Paragraph(NOT_COVERED),
    ]


NOT_COVERED = (
    "The deviations are 1 sigma, to first order, of independent noise of the corners. A board that is not flat or has "
    "another size than was said, a focus or zoom that changed, blur by motion and a rolling shutter are not covered."
)


def title(cam: Calibrated) -> str:
    """What it is and what it was made of."""
    used = int(cam.bundle.used.sum())
    width, height = cam.image_size
    return (
        f"Camera, model {model_name(cam)}, {width} x {height} pixels, from {cam.corners.n} pictures, {used:,} corners"
    )


def model_name(cam: Calibrated) -> str:
    """Model and the coefficients that were estimated, e.g. ``brown (k1, k2)``."""
    names = [name for name in cam.estimated if name not in LINEAR]
    return cam.model + (f" ({', '.join(names)})" if names else "")


def answer(cam: Calibrated) -> str:
    """In a few sentences: how well the camera is known."""
    fx, sd = cam.intrinsics["fx"], cam.std["fx"]
    if "fx" not in cam.estimated:
        first = "The focal length was given, and taken as exact."
    else:
        first = (
            f"The focal length is known to {fixed(sd, 2)} pixels ({fixed(100 * sd / fx, 2)} %, 1 sigma): every "
            f"distance from the camera shares an error of {fixed(1e3 * sd / fx, 2)} mm per m."
        )
    return f"{first} A corner is seen to {fixed(cam.pixel_noise, 2)} pixels. {pattern_words(cam, short=True)}"


def parameter_rows(cam: Calibrated) -> list[tuple[str, str, str, str]]:
    """Name, value with its deviation, unit, and what is to be said; coefficients that are 0 and were not estimated are
    left out."""
    rows = []
    for name, value in cam.intrinsics.items():
        unit = UNITS.get(name, "")
        if name in cam.estimated:
            rows.append((name, concise(value, cam.std[name]), unit, ""))
        elif value != 0 or name in LINEAR:
            rows.append((name, f"{value:.10g}", unit, " (given, exact)"))
    return rows


def noise_words(cam: Calibrated) -> str:
    """Pixel noise, and how many corners it is made of."""
    used, m = int(cam.bundle.used.sum()), cam.corners.m
    text = (
        f"Pixel noise: {fixed(cam.pixel_noise)} pixels per coordinate (1 sigma), estimated from {used:,} corners; "
        f"{cam.bundle.freedom:,} degrees of freedom."
    )
    least, most = cam.bundle.picture_noise.min(), cam.bundle.picture_noise.max()
    if most > UNEQUAL * least:
        text += f" Pictures differ, from {fixed(least, 2)} to {fixed(most, 2)} pixels, and count accordingly."
    left = m - used
    if not left:
        return f"{text} No corner was left out."
    pictures = len({name for name, *_ in cam.outliers})
    return (
        f"{text} Left out: {left:,} of {m:,} corners, in {pictures} picture{'s' if pictures > 1 else ''}, that lie "
        "farther from where the others put them than chance allows."
    )


def outlier_names(cam: Calibrated, most: int | None = None) -> list[tuple[int, str]]:
    """Corners that were left out, the farthest first: their index in ``cam.corners``, and picture with number."""
    corners = cam.corners
    out = np.flatnonzero(~cam.bundle.used)
    out = out[np.argsort(-np.linalg.norm(cam.bundle.residuals[out], axis=1), kind="stable")][:most]
    return [(int(j), f"{corners.names[corners.picture[j]]}, corner {corners.place[j]}") for j in out]


def _outlier_lines(cam: Calibrated) -> list[Block]:
    distance = np.linalg.norm(cam.bundle.residuals, axis=1)
    lines = [f"{name}: {fixed(distance[j])} pixels" for j, name in outlier_names(cam, MOST_LISTED)]
    more = int((~cam.bundle.used).sum()) - len(lines)
    return [Paragraph(text, indent="  ") for text in (*lines, *([f"and {more:,} more that are nearer"] * (more > 0)))]


def pattern_words(cam: Calibrated, short: bool = False) -> str:
    """Whether the residuals have a pattern over the picture; ``short``: one line."""
    found = cam.pattern
    share = f"{fixed(found.share, 2)} times the pixel noise"
    if found.found:
        text = f"The model {cam.model} is wrong for these pictures: the residuals have a pattern, {share}."
        more = (
            f" Over the picture their means are not 0 ({probability(found.p_value, 2)}): lines that are straight are "
            "predicted bent, or bent ones straight, or the board is not flat. Poses and X are off by more than their "
            "deviations say. Use another model ('auto')."
        )
    elif found.p_value < RARE:
        text = f"The residuals have a pattern over the picture of {share}: too small to matter."
        more = f" With so many corners it is told from chance ({probability(found.p_value, 2)})."
    else:
        text = f"The residuals have no pattern over the picture ({probability(found.p_value, 2)})."
        more = f" The model {cam.model} explains the corners."
    return text if short else text + more


def coverage_words(cam: Calibrated) -> str:
    """Which part of the picture the corners were in."""
    share = covered(cam)
    text = f"Corners were in {share:.0%} of the picture ({int((cam.pattern.count > 0).sum())} of {CELLS**2} cells)."
    if share < LITTLE:
        text += " Where there were none, the distortion is extrapolated: take pictures with the board at the rim."
    return text


def boards_words(cam: Calibrated) -> str:
    """Where the board was."""
    z, tilt = distances(cam), tilts(cam)
    return (
        f"The board was {fixed(z.min(), 2)} to {fixed(z.max(), 2)} m away, tilted by {tilt.min():.0f} to "
        f"{tilt.max():.0f} deg against the picture."
    )


def choice_words(cam: Calibrated) -> str:
    """Why this model."""
    return (
        f"Model and shape of the board chosen of {len(cam.candidates)} by the smallest Bayesian information criterion "
        f"(BIC), of a lens that distorts with p1 and p2 at least: {model_name(cam)}, board {cam.bundle.shape.name}."
    )


def candidate_table(cam: Calibrated, caption: str, chosen: str = "*") -> Table:
    """Model, BIC beyond the smallest, RMS in pixels, ``chosen`` beside the best; failed ones say so."""
    least, winner = min((c.bic for c in cam.candidates), default=0.0), best(cam.candidates)
    rows = [
        [
            c.label,
            f"{c.bic - least:,.1f}" if np.isfinite(c.bic) else "no fit",
            f"{c.rms:.4f}" if np.isfinite(c.rms) else "",
            chosen if c == winner else "",
        ]
        for c in cam.candidates
    ]
    head = ["model", "BIC beyond", "RMS (pixels)", ""]
    return Table(caption, head, rows, frozenset({3}), frozenset(k for k, row in enumerate(rows) if row[3]))
