"""Sentences of the findings of the synchronisation of two streams. Values are in s, rad and m."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ...findings import Finding, sentence


@sentence("synchronisation.before_other")
def _(other: str) -> str:
    return f"before the first {other} pose; nothing is extrapolated"


@sentence("synchronisation.after_other")
def _(other: str) -> str:
    return f"after the last {other} pose; nothing is extrapolated"


@sentence("synchronisation.in_gap")
def _(other: str, begin: float, end: float, max_gap: float) -> str:
    return f"in a gap of the {other}, {begin:.3f} to {end:.3f} s, longer than max_gap = {max_gap:.3g} s"


@sentence("synchronisation.in_half_turn")
def _(other: str, begin: float, end: float) -> str:
    return f"the {other} rotates by about 180 degrees between {begin:.3f} and {end:.3f} s"


def left_out_words(side: str, times: Sequence[float], why: Finding) -> str:
    """Poses of one stream that have no partner in the other, and why."""
    span = f"at {times[0]:.3f} s" if len(times) == 1 else f"{times[0]:.3f} to {times[-1]:.3f} s"
    return f"{len(times)} {side} pose{'s' if len(times) > 1 else ''} ({span}): {why}"


@sentence("synchronisation.gaps")
def _(lost: int, n: int, max_gap: float, parts: Sequence[Mapping[str, Any]], more: bool) -> str:
    named = "; ".join(left_out_words(part["side"], part["times"], Finding.from_dict(part["why"])) for part in parts)
    return (
        f"{lost} of the {n} poses that both streams have in time were left out because of gaps of more than "
        f"{max_gap:.3g} s: {named}{'; and more' if more else ''}."
    )


@sentence("synchronisation.other_offsets")
def _(offset: float, others: Sequence[float]) -> str:
    named = ", ".join(f"{value:.3f}" for value in others)
    return (
        f"Other time offsets fit nearly as well as {offset:.3f} s: {named} s. The motion repeats itself, which the "
        "standard deviation does not cover. Give `offset` or `max_offset` (--offset, --max-offset), or move without "
        "repetition."
    )


@sentence("synchronisation.open_within_stops")
def _(low: float, high: float) -> str:
    return (
        f"Every picture was taken while the robot stood still: any time offset from {1e3 * low:.0f} to "
        f"{1e3 * high:.0f} ms fits alike, and X does not depend on it. Where the offset itself is wanted, record more "
        "pictures while the robot moves."
    )


@sentence("synchronisation.prior_contradicted")
def _(prior: float, prior_std: float, offset: float, std: float) -> str:
    return (
        f"The time offset expected, {1e3 * prior:.4g} +- {1e3 * prior_std:.2g} ms, contradicts the streams, which show "
        f"{1e3 * offset:.4g} +- {1e3 * std:.2g} ms (robot_time = camera_time + offset). Check its sign."
    )


@sentence("synchronisation.offset_contradicted")
def _(given: float, offset: float, std: float) -> str:
    return (
        f"The time offset given, {1e3 * given:.4g} ms, contradicts the streams, which show {1e3 * offset:.4g} +- "
        f"{1e3 * std:.2g} ms (robot_time = camera_time + offset). Check its sign."
    )


@sentence("synchronisation.coarse_interpolation")
def _(side: str, rotation: float, translation: float, bias: float) -> str:
    return (
        f"Interpolation of the {side} misses the motion by up to {math.degrees(rotation):.2g} deg and "
        f"{1e3 * translation:.2g} mm. This is not noise; it moves X by about {bias:.1f} standard deviations. Sample "
        f"the {side} faster, or move more slowly."
    )


@sentence("synchronisation.coarse_clock")
def _(side: str, resolution: float) -> str:
    return (
        f"The {side}'s clock has a resolution of only {1e3 * resolution:g} ms. If its times were truncated, not "
        f"rounded, {1e3 * resolution / 2:g} ms of the offset are due to that, and each time is off by up to as much."
    )


@sentence("synchronisation.stops")
def _(count: int) -> str:
    return (
        f"The robot stops {count} times. Use still=True (--still) to average each stop into one pose pair, for which "
        "the time offset does not matter."
    )
