"""Sentences about rigs. Values in rad and m."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ..core.formatting.numbers import probability
from ..findings import INPUT, RESIDUALS, Finding, Values, sentence

# Poses with the views of their copy: name, and by which partner or since which robot pose.
Paths = Sequence[Mapping[str, Any]]


def _by(angle: float, shift: float) -> str:
    return f"{math.degrees(angle):.3g} deg, {1e3 * shift:.3g} mm"


def path_words(name: str, by: str | None, since: str | int | None) -> str:
    """Name a pose and the views of its copy."""
    return f"{name}, by {by}" if by is not None else f"{name}, from robot pose {since} on"


def _or(others: Paths) -> str:
    words = [path_words(**one) for one in others]
    return f" As likely: {'; '.join(words)}." if words else ""


def _named(values: Mapping[str, Any]) -> str:
    """Name the pose by what it is, and by its name where that says more."""
    kind, name = values["kind"], values["name"]
    return kind if kind == name else f"{kind} {name}"


@sentence(
    "rig.moved",
    check=RESIDUALS,
    phrase=lambda values: f"the {_named(values)} moved at robot pose {values['since']}",
    remedy=lambda values: f"Calibrate the poses before and after the move of the {_named(values)} by themselves.",
    explains=True,
    rows=("since",),
)
def _(
    kind: str, name: str, since: str | int, angle: float, shift: float, chi_square: float, p: float, others: Paths
) -> str:
    what = _named({"kind": kind, "name": name})
    return (
        f"The {what} did not stand still: from robot pose {since} on it is elsewhere by {_by(angle, shift)} "
        f"(chi-square {chi_square:.0f} of 6, {probability(p)}).{_or(others)} Calibrate the poses before and after by "
        "themselves."
    )


@sentence(
    "rig.paths_disagree",
    check=RESIDUALS,
    phrase="two ways to the {kind} {name} disagree",
    remedy="Look at the size of the target {by}, the intrinsics, and whether both stood still between their views.",
)
def _(kind: str, name: str, by: str, angle: float, shift: float, chi_square: float, p: float, others: Paths) -> str:
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


def _of_file(values: Values) -> Finding:
    return Finding.from_dict(values["finding"])


def _named_phrase(camera: str, phrase: str) -> str:
    return phrase if camera in phrase.split() else f"{camera}: {phrase}"


@sentence(
    "rig.of_camera",
    check=INPUT,
    phrase=lambda values: _named_phrase(values["camera"], _of_file(values).phrase),
    remedy=lambda values: _of_file(values).remedy,
    effect=lambda values: _of_file(values).effect,
    explains=lambda values: _of_file(values).explains,
    rank=0,
)
def _(camera: str, target: str, finding: Mapping[str, Any]) -> str:
    return f"Camera {camera} with {target}: {Finding.from_dict(finding)}"


@sentence(
    "rig.same_views",
    check=INPUT,
    phrase="{one} and {two} hold the same poses",
    explains=True,
    rank=0,
    remedy="give the file of each {what}: --camera NAME=FILE, or `file` of its view in the rig file",
)
def _(what: str, one: str, two: str, count: int, sources: Sequence[str]) -> str:
    files = f" ({', '.join(dict.fromkeys(sources))})" if sources else ""
    return (
        f"The {what}s {one} and {two} hold the same poses, {count} of them{files}: one file was given for both. Give "
        f"the file of each {what} (--camera NAME=FILE, or `file` of its view in the rig file)."
    )
