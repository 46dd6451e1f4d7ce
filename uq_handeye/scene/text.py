"""Text of camera poses from pictures of a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..core.formatting.numbers import concise
from ..core.presentation.document import Caution, Document, Heading, Paragraph, Table

if TYPE_CHECKING:
    from .result import ScenePoses


def scene_document(found: ScenePoses, details: bool = False) -> Document:
    """Return pictures, points, lens and warnings; ``details``: the points that each picture shows."""
    facts = found.facts
    said = (
        f"{found.n} of {len(found.names)} pictures show the scene: {facts.points:,} points, {facts.per_picture:,.0f} "
        f"in a picture, pixel noise {facts.pixel_noise:.2g} px."
    )
    rows = []
    for name, value in found.intrinsics.items():
        sd = found.sd.get(name)
        rows.append([name, concise(value, sd) if sd else f"{value:.7g}", "estimated" if sd else "given"])
    notes = [Paragraph(str(one)) for one in found.findings if one.severity == "note" and one.code != "scene.found"]
    shown = [[found.names[row], f"{count:,}"] for row, count in zip(found.rows, found.shown_in, strict=True)]
    return [
        [Heading(f"{found.n} camera poses from pictures of a scene"), Paragraph(said)],
        *map(Caution, found.warnings),
        Table("Intrinsics, model brown (px)", ["", "value", ""], rows),
        *notes,
        *([Table("Points by picture", ["picture", "points"], shown)] if details else []),
    ]
