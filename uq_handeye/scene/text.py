"""Text of camera poses from pictures of a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..core.presentation.document import Caution, Document, Heading, Paragraph, Table
from ..core.presentation.numbers import concise
from ..findings import Finding, texts
from ..model.poses.scene_facts import SceneFacts


def scene_document(
    facts: SceneFacts,
    intrinsics: Mapping[str, float],
    sd: Mapping[str, float],
    findings: Sequence[Finding],
    shown_in: Mapping[str, int],
    details: bool = False,
) -> Document:
    """Return pictures, points, lens and warnings; ``details``: ``shown_in``, the points that each picture shows."""
    said = (
        f"{len(shown_in)} of {facts.pictures} pictures show the scene: {facts.points:,} points, "
        f"{facts.per_picture:,.0f} in a picture, pixel noise {facts.pixel_noise:.2g} px."
    )
    rows = []
    for name, value in intrinsics.items():
        spread = sd.get(name)
        rows.append([name, concise(value, spread) if spread else f"{value:.7g}", "estimated" if spread else "given"])
    notes = [Paragraph(str(one)) for one in findings if one.severity == "note" and one.code != "scene.found"]
    shown = [[name, f"{count:,}"] for name, count in shown_in.items()]
    return [
        [Heading(f"{len(shown_in)} camera poses from pictures of a scene"), Paragraph(said)],
        *map(Caution, texts(findings)),
        Table("Intrinsics, model brown (px)", ["", "value", ""], rows),
        *notes,
        *([Table("Points by picture", ["picture", "points"], shown)] if details else []),
    ]
