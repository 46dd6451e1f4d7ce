"""The difference of two results in words."""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np

from ....core.formatting.numbers import concise, digits, probability
from ....core.geometry.se3 import Array
from ....core.presentation.document import Answer, Block, Document, Paragraph

# p-values below which a difference is said to be one, and to be clear.
DIFFERS, CLEARLY = 0.05, 0.001


class Different(Protocol):
    """Interface of a difference, as far as its text needs it."""

    @property
    def xi(self) -> Array: ...
    @property
    def std(self) -> Array: ...
    @cached_property
    def p_value_X(self) -> float: ...
    @cached_property
    def p_value_W(self) -> float | None: ...
    @property
    def at_target(self) -> tuple[Array, Array]: ...
    @property
    def point(self) -> Array: ...
    @property
    def how(self) -> str: ...
    @property
    def common(self) -> int: ...
    @property
    def same(self) -> tuple[str, ...]: ...
    @property
    def n_poses(self) -> tuple[int | None, int | None]: ...
    @property
    def methods(self) -> tuple[str, str]: ...
    @property
    def frame(self) -> str: ...
    @property
    def frame_W(self) -> str: ...


def difference_document(found: Different) -> Document:
    """A sentence, the numbers of X and W, and what counted once."""
    lines: list[Block] = [_answer(found)]
    if found.how != "equal":
        lines += [Paragraph(text, hang="  ") for text in (*_pose(found, 0), _point(found))]
        if found.p_value_W is not None:
            lines += [Paragraph(text, hang="  ") for text in _pose(found, 6)]
    return [lines, [Paragraph(text) for text in _made_of(found)]]


def _answer(found: Different) -> Answer:
    p = found.p_value_X
    if found.how == "equal":
        return Answer(f"{found.frame}: the two results are one: the difference is 0, and there is nothing to test.")
    if p < DIFFERS:
        clearly = "differ clearly" if p < CLEARLY else "differ"
        words = f"The results of {found.frame} {clearly}: by more than their uncertainty explains ({probability(p)})."
        return Answer(words, "caution")
    return Answer(f"The results of {found.frame} agree within their uncertainty ({probability(p, 2)}).")


def _pose(found: Different, start: int) -> list[str]:
    """Two lines: translation in mm and rotation in deg."""
    frame, p = (found.frame, found.p_value_X) if start == 0 else (found.frame_W, found.p_value_W)
    xi, std = np.asarray(found.xi), np.asarray(found.std)
    parts = [_three("translation", 1e3 * xi[start + 3 : start + 6], 1e3 * std[start + 3 : start + 6], "mm")]
    parts.append(_three("rotation", np.degrees(xi[start : start + 3]), np.degrees(std[start : start + 3]), "deg"))
    assert p is not None
    return [f"{frame}, new minus old ({probability(p, 2)}):", *(f"  {part}" for part in parts)]


def _three(what: str, values: Array, std: Array, unit: str) -> str:
    numbers = [f"{axis} {concise(float(values[k]), float(std[k]))}" for k, axis in enumerate("xyz")]
    return f"{what} {', '.join(numbers)} {unit}; {digits(float(np.linalg.norm(values)), 2)} {unit} in all"


def _point(found: Different) -> str:
    move, S = found.at_target
    size = float(np.linalg.norm(move))
    along = move / size if size > 0 else np.array([0.0, 0.0, 1.0])
    sd = float(np.sqrt(max(float(along @ S @ along), 0.0)))
    return (
        f"A point at the target, {digits(float(found.point[2]), 2)} m ahead of the camera, moves by "
        f"{concise(1e3 * size, 1e3 * sd, 'mm')}."
    )


def _made_of(found: Different) -> list[str]:
    n_old, n_new = found.n_poses
    methods = "" if found.methods[0] == found.methods[1] else f" (methods {found.methods[0]} and {found.methods[1]})"
    poses = f"Old: {n_old} poses; new: {n_new} poses{methods}."
    if found.how == "equal":
        return [poses]
    if found.how == "innovation":
        return [f"{poses} One result holds all data of the other: what both hold counts once (C_old - C_new)."]
    if found.how == "independent":
        overlap = f" They share {found.common} poses, so that it is too large." if found.common else ""
        return [f"{poses} Assumed: the errors of both are independent, and the covariances add up.{overlap}"]
    if found.common:
        return [f"{poses} {found.common} poses are in both and count once, as do errors of robot, camera and target."]
    if found.same:
        rest = [name for name in ("robot", "camera", "target") if name not in found.same]
        others = f" Assumed: independent errors of {' and '.join(rest)}." if rest else ""
        return [f"{poses} No pose is in both. The same in both: {' and '.join(found.same)}.{others}"]
    return [f"{poses} No pose is in both. Assumed: independent errors, also of robot, camera and target."]
