"""Findings about what a data set can and cannot tell about its noise, worded in `sentences`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from ..findings import Finding, Severity
from ..noise.estimate import CAMERA_EXCESS, CameraFactor, Component, together
from .sentences import CONTRADICTION

# Fewer degrees of freedom than this tell nothing worth saying of the camera's covariance.
TELLING = 4.0
# Pixel noise above or below these, in pixels, is none.
MOST_PIXELS, LEAST_PIXELS = 1.5, 0.015


def noise_findings(
    parts: dict[str, Component], sides: tuple[str, str], rotation_told: bool, sheet: frozenset[str]
) -> tuple[Finding, ...]:
    """Return what the data can and cannot tell; ``sheet`` names what the data sheet decides."""
    found = []
    sums = [parts[together(what, sides)] for what in ("rotation", "translation")]
    for what, which in (
        ("told_by_data", [part for part in sums if part.name not in sheet]),
        ("from_data_sheet", [part for part in sums if part.name in sheet]),
    ):
        if which:
            found.append(_note(what, components=_plain(which)))
    rotations, translations = ([parts[f"{side} {what}"] for side in sides] for what in ("rotation", "translation"))
    known = [part.status in ("fixed", "prior") for part in rotations]
    if not rotation_told:
        found.append(_note("rotation_open", sides=sides, components=_plain(rotations)))
    elif not all(known):
        found.append(_note("rotation_told", sides=sides, components=_plain(rotations), with_data_sheet=any(known)))
        found += [
            _note("rotation_near_zero", component=asdict(part))
            for part in rotations
            if part.low == 0 and part.status != "fixed"
        ]
    else:
        found.append(_by_sheet("rotation", rotations, sides, sheet))
    if translations[0].status == "not told apart":
        found.append(_note("translation_open", sides=sides))
    elif sums[1].name in sheet:
        found.append(_by_sheet("translation", translations, sides, sheet))
    else:
        found.append(_note("translation_by_data_sheet", components=_plain(translations)))
    return tuple(found)


def beside_camera_findings(parts: dict[str, Component], factor: CameraFactor | None) -> tuple[Finding, ...]:
    """Report the robot's noise beside the covariance of the camera poses, and the noise of their pixels."""
    camera, robot = (
        [parts[f"{side} {what}"] for what in ("rotation", "translation") if f"{side} {what}" in parts]
        for side in ("camera", "robot")
    )
    pixels = parts.get("pixel noise")
    if pixels is None:
        found = [
            _note(f"camera_{camera[0].status.replace(' ', '_')}", rotation=camera[0].value, translation=camera[1].value)
        ]
    else:
        found = [_note("camera_by_geometry", component=asdict(pixels), components=_plain(camera))]
        high = float("inf") if pixels.high is None else pixels.high
        if pixels.status == "estimated" and (pixels.low > MOST_PIXELS or high < LEAST_PIXELS):
            found.append(unusual_pixels(pixels))
    if not robot:
        return tuple(found)
    if all(part.status == "zero" for part in robot):
        found.append(_note("robot_shows_none", rotation=robot[0].high, translation=robot[1].high))
    else:
        found.append(_note("robot_shows", components=_plain(robot)))
        found += [_note("near_zero", name=part.name) for part in robot if part.low == 0 and part.status == "estimated"]
    excess = parts.get(CAMERA_EXCESS)
    if excess is not None and excess.value > 0 and factor is not None:
        contradicted = factor.p_value < CONTRADICTION
        values = {"pixels": excess.value, "p_value": factor.p_value, "dof": factor.dof, "wrong": contradicted}
        found.append(Finding("noise_estimation.camera_excess", "caution" if contradicted else "note", values))
    elif pixels is None:
        found.append(against_camera(factor))
    elif pixels.status == "given":
        found.append(against_pixels(pixels, factor))
    return tuple(found)


def against_pixels(pixels: Component, factor: CameraFactor | None) -> Finding:
    """Compare the residuals with the pixel noise given: a caution where they contradict it."""
    if factor is None or factor.dof < TELLING:
        return _note("pixels_hidden")
    values = {"given": pixels.value, "factor": factor.value, "p_value": factor.p_value, "dof": factor.dof}
    severity: Severity = "note" if factor.p_value > CONTRADICTION else "caution"
    return Finding("noise_estimation.pixels_given", severity, values)


def unusual_pixels(pixels: Component) -> Finding:
    """Noise that no detector has: a caution."""
    return Finding("noise_estimation.unusual_pixels", "caution", {"component": asdict(pixels)})


def against_camera(factor: CameraFactor | None) -> Finding:
    """Compare the residuals with the camera's covariance: a caution where they contradict it."""
    if factor is None or factor.dof < TELLING:
        return _note("camera_hidden")
    values = {"factor": factor.value, "p_value": factor.p_value, "dof": factor.dof}
    severity: Severity = "note" if factor.p_value > CONTRADICTION else "caution"
    return Finding("noise_estimation.camera_factor", severity, values)


def _by_sheet(what: str, parts: list[Component], sides: tuple[str, str], sheet: frozenset[str]) -> Finding:
    decided = all(part.name in sheet for part in parts)
    return _note("with_data_sheet", what=what, sides=sides, components=_plain(parts), decided=decided)


def _plain(parts: Iterable[Component]) -> list[dict[str, Any]]:
    return [asdict(part) for part in parts]


def _note(what: str, /, **values: Any) -> Finding:
    return Finding(f"noise_estimation.{what}", "note", values)
