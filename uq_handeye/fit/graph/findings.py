"""Findings about the noise of a data set: sizes that the data resolve, contradict or cannot resolve."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.special import ndtr

from ...core.files.json_values import Json, JsonObject
from ...core.geometry.se3 import Array
from ...core.levels import RARE, UNUSUAL
from ...findings import Finding, Severity
from ...model.errors.error_estimate import ErrorEstimate
from ...model.errors.key import ErrorKey, Kind, Owner
from ...model.errors.keys import CAMERA_EXCESS, PICTURE_SHIFT, PIXELS
from ...model.errors.noise_estimate import together
from ...model.errors.sizes import SIZES
from .estimation import INTERVAL_SD, FoundSizes

# Errors that the corners of one picture share are reported if they are surely above this many times their usual size.
PICTURE_EXCESS_RATIO = 2.0
# An error that X (or W) absorbs is a caution if it has more than this share of its variance.
ABSORBED_CAUTION_SHARE = 0.1
# The noise of no detector of corners is above this, or below a hundredth of it.
MAX_NOISE_PX = 1.5

# A size above what is assumed by more than this many of its standard deviations (logarithms of the factor).
FAR_OUTSIDE_SD = 3.0


def noise_findings(
    parts: dict[ErrorKey, ErrorEstimate], sides: tuple[Owner, Owner], rotation_told: bool, sheet: frozenset[ErrorKey]
) -> tuple[Finding, ...]:
    """Return what the data can and cannot tell; ``sheet`` names what the data sheet decides."""
    found = []
    sums = [parts[together(what, sides)] for what in (Kind.ROTATION, Kind.TRANSLATION)]
    for what, which in (
        ("told_by_data", [part for part in sums if part.key not in sheet]),
        ("from_data_sheet", [part for part in sums if part.key in sheet]),
    ):
        if which:
            found.append(_note(what, components=_plain(which)))
    rotations, translations = (
        [parts[ErrorKey(side, what)] for side in sides] for what in (Kind.ROTATION, Kind.TRANSLATION)
    )
    known = [part.status in ("fixed", "prior") for part in rotations]
    if not rotation_told:
        found.append(_note("rotation_open", sides=sides, components=_plain(rotations)))
    elif not all(known):
        found.append(_note("rotation_told", sides=sides, components=_plain(rotations), with_data_sheet=any(known)))
        found += [
            _note("rotation_near_zero", component=_values(part))
            for part in rotations
            if part.low == 0 and part.status != "fixed"
        ]
    else:
        found.append(_by_sheet("rotation", rotations, sides, sheet))
    if translations[0].status == "not told apart":
        found.append(_note("translation_open", sides=sides))
    elif sums[1].key in sheet:
        found.append(_by_sheet("translation", translations, sides, sheet))
    else:
        found.append(_note("translation_by_data_sheet", components=_plain(translations)))
    return tuple(found)


def beside_camera_findings(parts: dict[ErrorKey, ErrorEstimate], dof: float) -> tuple[Finding, ...]:
    """Report the robot's noise, given the covariance of the camera poses, the noise of their pixels, and what the
    corners of one picture share.
    """
    camera, robot = (
        [parts[key] for what in (Kind.ROTATION, Kind.TRANSLATION) if (key := ErrorKey(side, what)) in parts]
        for side in (Owner.CAMERA, Owner.ROBOT)
    )
    pixels = parts.get(PIXELS)
    if len(camera) < 2:
        return ()
    if pixels is None and camera[0].status not in ("from corners", "from points"):
        return ()  # what was given needs no word
    if pixels is None:
        how = camera[0].status.replace(" ", "_")
        found = [_note(f"camera_{how}", rotation=camera[0].size, translation=camera[1].size)]
    else:
        found = [_note("camera_by_geometry", component=_values(pixels), components=_plain(camera))]
        high = float("inf") if pixels.high is None else pixels.high
        if pixels.status == "estimated" and (pixels.low > MAX_NOISE_PX or high < MAX_NOISE_PX / 100):
            found.append(unusual_pixels(pixels))
    if robot:
        found.append(_note("robot_shows", components=_plain(robot)))
    for key in (CAMERA_EXCESS, PICTURE_SHIFT):
        excess = parts.get(key)
        if excess is None or excess.high is None or not 0 < excess.low < excess.high:
            continue
        sd = float(np.log(excess.high / excess.low)) / (2.0 * INTERVAL_SD)
        p = float(ndtr((np.log(PICTURE_EXCESS_RATIO * SIZES[key].median) - np.log(excess.size)) / sd))
        if p < UNUSUAL.probability:
            wrong = p < RARE.probability
            values = {"pixels": excess.size, "p_value": p, "dof": dof, "wrong": wrong}
            values |= {"shifted": True} if key == PICTURE_SHIFT else {}
            found.append(Finding("noise_estimation.camera_excess", "caution" if wrong else "note", values))
    return tuple(found)


def size_findings(found: FoundSizes) -> tuple[Finding, ...]:
    """Report sizes that the data push to the end of their range, and errors that X and W absorb."""
    source, model, mode = found.source, found.model, found.mode
    ends: list[JsonObject] = []
    low: list[JsonObject] = []  # of them, those that are smaller than usual
    for place in mode.at_bound:
        part = source.components[int(model.free[place])]
        unit = SIZES[part.key].unit if part.key in SIZES else part.size.unit
        value, usual = (float(np.exp(x[place])) for x in (mode.theta, model.medians))
        ends.append({"error": part.name, "of": unit, "value": value, "usual": usual, "factor": part.size.factor})
        if value < usual:
            low.append(ends[-1])
    listed = []
    if len(low) > 1:  # less noise than assumed: one finding for all
        listed.append(Finding("noise_estimation.sizes_at_low_end", "caution", {"ends": low}))
        ends = [values for values in ends if values not in low]
    listed += [Finding("noise_estimation.size_at_end", "caution", values) for values in ends]
    for place, k in enumerate(model.free):
        part = source.components[int(k)]
        if part.size.factor <= 1.0 or place in mode.at_bound:
            continue
        beyond = float(mode.theta[place] - model.medians[place]) / np.log(part.size.factor)
        if beyond > FAR_OUTSIDE_SD:
            unit = SIZES[part.key].unit if part.key in SIZES else part.size.unit
            value, usual = (float(np.exp(x[place])) for x in (mode.theta, model.medians))
            far: JsonObject = {
                "error": part.name,
                "of": unit,
                "value": value,
                "usual": usual,
                "factor": part.size.factor,
            }
            listed.append(Finding("noise_estimation.size_far_outside", "caution", far))
            ends.append(far)
    said = {values["error"] for values in (*low, *ends)}
    for error in source.errors:
        if error.default or error.factor == 1:
            continue
        ratio = found.sizes.get(error.key, error.size.median) / error.size.median
        if abs(np.log(ratio)) <= np.log(error.factor) or error.name in said:
            continue
        declared, of = float(error.sd[0]), SIZES[error.key].unit if error.key in SIZES else error.unit
        values = {"error": error.name, "of": of, "value": declared * ratio, "usual": declared, "factor": error.factor}
        severity: Severity = "caution" if ratio > 1 else "note"
        listed.append(Finding("noise_estimation.size_at_end", severity, values | {"declared": True}))
    for k, moves in model.absorbed(mode.theta).items():
        moves = found.reduced.unreduced(moves.T).T
        which = ["X", "W"][: len(moves) // 6]
        rms = [np.sqrt((moves[at : at + 3] ** 2).sum()) for at in range(0, len(moves), 3)]
        for number, unknown in enumerate(which):
            turn, shift = (float(value) for value in rms[2 * number : 2 * number + 2])
            if max(turn, shift) < 1e-3 * max(rms):
                continue
            own = moves[6 * number : 6 * number + 6]
            axes = [np.linalg.svd(own[part])[0][:, 0].tolist() for part in (slice(0, 3), slice(3, 6))]
            values = {"error": source.components[k].name, "unknown": unknown, "turn": turn, "shift": shift}
            values |= {"axis": axes[0], "along": axes[1], "alone": source.components[k].count == 1}
            counts = (
                len(moves) != model.p
                or _share(own, model.of_poses(mode.theta).covariance, number) > ABSORBED_CAUTION_SHARE
            )
            listed.append(Finding("noise_estimation.absorbed", "caution" if counts else "note", values))
            break
    return tuple(listed)


def _share(moves: Array, C: Array, number: int) -> float:
    """Largest share of the variance of an unknown pose that moves (6, m) have."""
    part = slice(6 * number, 6 * number + 6)
    unit = 1.0 / np.sqrt(np.diag(C)[part])
    half = np.linalg.solve(np.linalg.cholesky(C[part, part] * np.outer(unit, unit)), unit[:, None] * moves)
    return float(np.linalg.norm(half, 2) ** 2)


def unusual_pixels(pixels: ErrorEstimate) -> Finding:
    """Noise that no detector has: a caution."""
    return Finding("noise_estimation.unusual_pixels", "caution", {"component": _values(pixels)})


def _by_sheet(what: str, parts: list[ErrorEstimate], sides: tuple[Owner, Owner], sheet: frozenset[ErrorKey]) -> Finding:
    decided = all(part.key in sheet for part in parts)
    return _note("with_data_sheet", what=what, sides=sides, components=_plain(parts), decided=decided)


def _plain(parts: Iterable[ErrorEstimate]) -> list[JsonObject]:
    return [_values(part) for part in parts]


def _values(part: ErrorEstimate) -> JsonObject:
    """Return what a sentence says of a standard deviation, with what it is called."""
    return {"name": part.name, "unit": part.unit, "value": part.size, "low": part.low, "high": part.high,
            "status": part.status}  # fmt: skip


def _note(what: str, /, **values: Json) -> Finding:
    return Finding(f"noise_estimation.{what}", "note", values)
