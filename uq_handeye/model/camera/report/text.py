"""The text on a calibrated camera: the estimates, their uncertainty, and warnings."""

from __future__ import annotations

import numpy as np

from ....core.levels import CONTRADICTED
from ....core.limits import MAX_LISTED, MAX_NAMED
from ....core.presentation.document import Block, Caution, Document, Heading, Paragraph, Table
from ....core.presentation.numbers import concise, fixed, probability
from ....core.presentation.units import MM_PER_M
from ..adjustment.criterion import best
from ..calibrated import Calibrated, covered, distances, tilts
from ..models import LINEAR
from ..residual_pattern import CELLS

# Corners in a smaller share of the cells of the picture leave the distortion extrapolated.
MIN_COVERED_SHARE = 0.5
# Noise that differs by this factor between pictures is mentioned.
MIN_NOISE_RATIO = 1.5
UNITS = dict.fromkeys(LINEAR, "pixels")
NOTATION = "12.345(67) means 12.345 with a standard deviation of 0.067"


def camera_document(cam: Calibrated, details: bool = False) -> Document:
    """The summary: what is known first, then what is wrong, then the numbers; ``details``: lists in full."""
    rows = [[name, value + (f" {unit}" if unit else "") + said] for name, value, unit, said in parameter_rows(cam)]
    return [
        [Heading(title(cam)), Paragraph(answer(cam))],
        *map(Caution, cam.warnings),
        Table(f"Intrinsics ({NOTATION}):", ["", ""], rows, frozenset({1})),
        [Paragraph(noise_words(cam)), *_outlier_lines(cam, None if details else MAX_LISTED)],
        *(Paragraph(str(finding)) for finding in cam.findings if finding.severity == "note"),
        *(Paragraph(text) for text in (pattern_words(cam), board_pattern_words(cam))),
        *(Paragraph(text) for text in (coverage_words(cam), boards_words(cam))),
        *([model_choice(cam, details=details)] if cam.candidates else []),
        Paragraph(scope_words(cam)),
    ]


def scope_words(cam: Calibrated) -> str:
    """Describe what the standard deviations include, and what they do not cover."""
    taken = cam.bundle.shape.q == 0 and not _shapes_compared(cam)
    board = "A board that is not flat or has" if taken else "A board that has"
    covered = "" if cam.bundle.shape.q == 0 else " and the shape of the board that was estimated with them"
    return (
        f"The standard deviations are 1 sigma, to first order, of independent noise of the corners{covered}. {board} "
        "another size than was given, a focus or zoom that changed, blur by motion and a rolling shutter are not "
        "covered."
    )


def board_words(cam: Calibrated) -> str:
    """Describe in one sentence how the board differs from its nominal shape."""
    board, visible = cam.board, cam.board_pattern.visible
    if board.flat:
        if _shapes_compared(cam) and np.isfinite(visible):
            return (
                f"The board is flat as far as the pictures show: a bow of more than {_length(visible)} mm would show."
            )
        return "The board was taken as flat."
    bow, sd = board.bow
    said = "The board does not bow"
    if bow > 0:
        said = f"The board bows by {concise(MM_PER_M * bow, MM_PER_M * sd)} mm over {fixed(board.size, 2)} m"
    if board.in_plane > 0:
        said += f"; in the plane its points are off by {_length(board.in_plane)} mm RMS"
        stretch, sd = board.stretch
        if stretch**2 > CONTRADICTED.chi_square(1) * sd**2:
            longer = "wider than high" if stretch > 0 else "higher than wide"
            said += f", its squares {concise(100 * abs(stretch), 100 * sd)} % {longer}"
    return f"{said}."


def board_pattern_words(cam: Calibrated) -> str:
    """Describe whether the residuals follow the points of the board."""
    found = cam.board_pattern
    share, p = f"{fixed(found.share, 2)} times the pixel noise", probability(found.p_value, 2)
    if found.found and cam.pattern.found:
        return f"The residuals follow the points of the board, too, {share} ({p}), as a wrong model makes them do."
    if found.found:
        return (
            f"The residuals follow the points of the board, {share} ({p}): in all pictures alike points lie elsewhere "
            f"than where a {cam.shape} board has them. The covariance does not contain that."
        )
    if found.p_value < CONTRADICTED.probability:
        return f"The residuals follow the points of the board by {share} ({p}): too small to matter."
    return f"The residuals do not follow the points of the board ({p})."


def _shapes_compared(cam: Calibrated) -> bool:
    """Return whether several shapes of the board were compared."""
    return len({one.shape for one in cam.candidates}) > 1


def _length(value: float) -> str:
    """Millimetres of metres."""
    return fixed(MM_PER_M * value, 2)


def title(cam: Calibrated) -> str:
    """Return the title: what it is and what it was made of."""
    used, n = int(cam.bundle.used.sum()), cam.corners.n
    size = "{} x {} pixels".format(*cam.image_size)
    return f"Camera, model {model_name(cam)}, {size}, from {n} picture{'s' * (n > 1)}, {used:,} corners"


def model_name(cam: Calibrated) -> str:
    """Model and the coefficients that were estimated, e.g. ``brown (k1, k2)``."""
    names = [name for name in cam.estimated if name not in LINEAR]
    return cam.model + (f" ({', '.join(names)})" if names else "")


def answer(cam: Calibrated) -> str:
    """State in a few sentences how well the camera is known."""
    fx, sd = cam.intrinsics["fx"], cam.std["fx"]
    if "fx" not in cam.estimated:
        first = "The focal length was given, and taken as exact."
    else:
        first = (
            f"The focal length is known to {fixed(sd, 2)} pixels ({fixed(100 * sd / fx, 2)} %, 1 sigma): every "
            f"distance from the camera shares an error of {fixed(MM_PER_M * sd / fx, 2)} mm per m."
        )
    corner = f"A corner is seen to {fixed(cam.pixel_noise, 2)} pixels."
    return f"{first} {board_words(cam)} {corner} {pattern_words(cam, short=True)}"


def parameter_rows(cam: Calibrated) -> list[tuple[str, str, str, str]]:
    """Name, value with its standard deviation, unit, and a remark; coefficients that are 0 and were not
    estimated are left out."""
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
    if most > MIN_NOISE_RATIO * least:
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


def _outlier_lines(cam: Calibrated, most: int | None) -> list[Block]:
    distance = np.linalg.norm(cam.bundle.residuals, axis=1)
    lines = [f"{name}: {fixed(distance[j])} pixels" for j, name in outlier_names(cam, most)]
    more = int((~cam.bundle.used).sum()) - len(lines)
    return [Paragraph(text, indent="  ") for text in (*lines, *([f"and {more:,} more that are nearer"] * (more > 0)))]


def pattern_words(cam: Calibrated, short: bool = False) -> str:
    """Describe whether the residuals have a pattern over the picture; ``short``: one line."""
    found = cam.pattern
    share = f"{fixed(found.share, 2)} times the pixel noise"
    if found.found:
        text = f"The model {cam.model} is wrong for these pictures: the residuals have a pattern, {share}."
        more = (
            f" Over the picture their means are not 0 ({probability(found.p_value, 2)}): lines that are straight are "
            "predicted bent, or bent ones straight, or the board has another shape. Poses and X are off by more than "
            "their standard deviations say. "
        )
        several = len({candidate.model for candidate in cam.candidates}) > 1
        more += "No other model that was tried is better." if several else "Use another model ('auto')."
    elif found.p_value < CONTRADICTED.probability:
        text = f"The residuals have a pattern over the picture of {share}: too small to matter."
        more = f" With this many corners it is significant ({probability(found.p_value, 2)})."
    else:
        text = f"The residuals have no pattern over the picture ({probability(found.p_value, 2)})."
        more = f" The model {cam.model} explains the corners."
    return text if short else text + more


def coverage_words(cam: Calibrated) -> str:
    """Describe which part of the picture the corners covered."""
    share = covered(cam)
    text = f"Corners were in {share:.0%} of the picture ({int((cam.pattern.count > 0).sum())} of {CELLS**2} cells)."
    if share < MIN_COVERED_SHARE:
        text += " Where there were none, the distortion is extrapolated: take pictures with the board at the rim."
    return text


def boards_words(cam: Calibrated) -> str:
    """Describe where the board was."""
    z, tilt = distances(cam), tilts(cam)
    return (
        f"The board was {fixed(z.min(), 2)} to {fixed(z.max(), 2)} m away, tilted by {tilt.min():.0f} to "
        f"{tilt.max():.0f} deg against the picture."
    )


def model_choice(cam: Calibrated, caption: str = "", chosen: str = "*", details: bool = True) -> list[Block]:
    """Return why this model, and a table of those that were compared, the one ``chosen`` first, then by BIC.

    Columns: model, board, BIC beyond the smallest, RMS in pixels; failed ones say so. Without ``details`` the nearest
    only.
    """
    words = Paragraph(
        f"Model and shape of the board chosen of {len(cam.candidates)} by the smallest Bayesian information criterion "
        f"(BIC), of a lens that distorts with p1 and p2 at least: {model_name(cam)}, board {cam.bundle.shape.name}."
    )
    most = len(cam.candidates) if details or len(cam.candidates) <= MAX_NAMED + 2 else MAX_NAMED
    least, winner = min((c.bic for c in cam.candidates), default=0.0), best(cam.candidates)
    rows = [
        [
            c.lens,
            c.shape,
            f"{c.bic - least:,.1f}" if np.isfinite(c.bic) else "no fit",
            f"{c.rms:.4f}" if np.isfinite(c.rms) else "",
            chosen if c == winner else "",
        ]
        for c in sorted(cam.candidates, key=lambda c: (c != winner, c.bic))[:most]
    ]
    head = ["model", "board", "BIC beyond", "RMS (pixels)", ""]
    table = Table(caption, head, rows, frozenset({1, 4}), frozenset(k for k, row in enumerate(rows) if row[4]))
    rest = f"The other {len(cam.candidates) - most} were further off; -v (details=True) lists them."
    return [words, table, *([Paragraph(rest)] if most < len(cam.candidates) else [])]
