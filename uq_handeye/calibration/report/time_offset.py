"""The time offset of a result as text."""

from __future__ import annotations

import numpy as np

from ...core.formatting.numbers import concise, digits
from ..result import Calibration


def offset_sentence(result: Calibration) -> str:
    """Say what the time offset of the poses adds to the covariance of X; empty where there is none."""
    found = result.time_offset
    if found is None:
        return ""
    if found.std == 0:
        said = "taken as exact, as given: its uncertainty is not in the covariance of X."
        return f"Time offset: {1e3 * found.offset:.6g} ms, {said}"
    move = found.std * np.array(found.sensitivity)
    if not move.any():
        said = "The robot stands still at these poses: the offset does not matter for X."
        return f"Time offset: {concise(1e3 * found.offset, 1e3 * found.std, 'ms')}. {said}"
    turn, shift = np.degrees(np.linalg.norm(move[:3])), 1e3 * np.linalg.norm(move[3:])
    return (
        f"Time offset: {concise(1e3 * found.offset, 1e3 * found.std, 'ms')} (robot_time = camera_time + offset; the "
        f"{found.side} was interpolated). One standard deviation of it moves X by {digits(turn, 2)} deg and "
        f"{digits(shift, 2)} mm; this is in the covariance of X, where it makes up "
        f"{100 * found.share:.2g} % of the variance in the direction in which it counts most."
    )
