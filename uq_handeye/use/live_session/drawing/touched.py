"""Points that the tool touched, beside where a calibration has them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ....calibration.evidence.touches import Touches, evidence_of_touches
from ....calibration.result import Calibration
from ....core.geometry.se3 import Array
from ...verification.touches_file import read_touches, require_metres
from ...verification.verify import verify
from ..question import ONE_AT_A_TIME


@dataclass(frozen=True, eq=False)
class Touched:
    """m points in the base frame (m): touched, the miss of each (touch minus the point as the calibration has it)."""

    points: Array  # (m, 3)
    misses: Array  # (m, 3)
    flagged: Array  # (m,) that differ by more than the calibration says
    names: tuple[str, ...]
    words: str


def touched(result: Calibration, touches: Touches | Path) -> Touched:
    """Return touches, or those of a file, against a calibration; raises `InputError` as `verify` does."""
    if isinstance(touches, Path):
        touches = read_touches(touches, None if result.kinematics is None else result.kinematics.chain)
    require_metres(result, touches)
    with ONE_AT_A_TIME:
        found, evidence = verify(result, touches), evidence_of_touches(result, touches)
    difference = found.points.difference
    return Touched(evidence.at + evidence.r, difference, found.points.flagged, touches.names, _first(found.summary()))


def _first(text: str) -> str:
    """Return the first paragraph on one line."""
    return " ".join(text.partition("\n\n")[0].split())
