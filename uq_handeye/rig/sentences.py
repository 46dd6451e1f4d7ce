"""Sentences about rigs. Values in rad and m."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..core.formatting.numbers import probability
from ..findings import RESIDUALS, sentence


def _by(angle: float, shift: float) -> str:
    return f"{math.degrees(angle):.3g} deg, {1e3 * shift:.3g} mm"


def _or(others: Sequence[str]) -> str:
    return f" As likely: {'; '.join(others)}." if others else ""


@sentence(
    "rig.moved",
    check=RESIDUALS,
    phrase="the {kind} {name} moved at robot pose {since}",
    remedy="Calibrate the views before and after the move by themselves, or give the {kind} two names.",
    explains=True,
)
def _(
    kind: str, name: str, since: str, angle: float, shift: float, chi_square: float, p: float, others: Sequence[str]
) -> str:
    return (
        f"The {kind} {name} did not stand still: from robot pose {since} on it is elsewhere by {_by(angle, shift)} "
        f"(chi-square {chi_square:.0f} of 6, {probability(p)}).{_or(others)} Calibrate the views before and after by "
        "themselves, or give it two names."
    )


@sentence(
    "rig.paths_disagree",
    check=RESIDUALS,
    phrase="two ways to the {kind} {name} disagree",
    remedy="Look at the size of the target {by}, the intrinsics, and whether both stood still between their views.",
)
def _(
    kind: str, name: str, by: str, angle: float, shift: float, chi_square: float, p: float, others: Sequence[str]
) -> str:
    return (
        f"The pose of the {kind} {name} with {by} and that from its other views differ by {_by(angle, shift)} "
        f"(chi-square {chi_square:.0f} of 6, {probability(p)}).{_or(others)} Look at the size of the target, the "
        "intrinsics, and whether both stood still between their views."
    )


@sentence(
    "rig.path_rings",
    check=RESIDUALS,
    phrase="two ways to one pose disagree, and no move explains it",
    remedy="Look at the intrinsics, the sizes of the targets, the accuracy of the arm and the noise given.",
)
def _(path: str, angle: float, shift: float, chi_square: float, p: float) -> str:
    return (
        f"Two ways to one pose disagree ({path}): by {_by(angle, shift)} (chi-square {chi_square:.0f}, "
        f"{probability(p)}), and no move of one pose explains it. Look at the intrinsics, the sizes of the targets, "
        "the accuracy of the arm and the noise given."
    )
