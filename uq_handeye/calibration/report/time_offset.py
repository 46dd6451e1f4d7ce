"""The time offset of a result as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...formatting.numbers import concise, digits
from ...formatting.paragraphs import wrapped

if TYPE_CHECKING:
    from ..result import Calibration


def offset_lines(result: Calibration) -> list[str]:
    """Of a calibration: what the time offset of its poses adds to the covariance of X."""
    found = result.time_offset
    if found is None:
        return []
    if found.std == 0:
        said = "taken as exact, as given: its uncertainty is not in the covariance of X."
        return wrapped(f"Time offset: {1e3 * found.offset:.6g} ms, {said}", first="")
    move = found.std * np.array(found.sensitivity)
    if not move.any():
        said = "The robot stands still at these poses: the offset does not matter for X."
        return wrapped(f"Time offset: {concise(1e3 * found.offset, 1e3 * found.std, 'ms')}. {said}", first="")
    turn, shift = np.degrees(np.linalg.norm(move[:3])), 1e3 * np.linalg.norm(move[3:])
    return wrapped(
        f"Time offset: {concise(1e3 * found.offset, 1e3 * found.std, 'ms')} (robot_time = camera_time + offset; the "
        f"{found.side} was interpolated). One standard deviation of it moves X by {digits(turn, 2)} deg and "
        f"{digits(shift, 2)} mm; this is in the covariance of X, where it makes up "
        f"{100 * found.share:.2g} % of the variance in the direction in which it counts most.",
        first="",
    )
