"""Noise of a rig as it is given: by the names of arms and cameras."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ...core.files.json_values import Json
from ...core.files.records import plain
from ...core.geometry.checks import checked_covariance
from ...core.geometry.se3 import Array
from ...core.presentation.units import parse_deviations
from ...errors import InputError, require_type
from ..errors.models import PoseNoise
from .description import Rig

EXACT = "exact"


# Noise of one arm or camera: standard deviations of rotation and translation, a covariance, or "exact".
NoiseOfOne: TypeAlias = tuple[str | float, str | float] | ArrayLike


NoiseByName: TypeAlias = Mapping[str, NoiseOfOne] | PoseNoise


def require_noise(rig: Rig, noise: Mapping[str, NoiseOfOne]) -> None:
    """Raise `InputError` for a value that is no noise of its arm or camera."""
    for name in noise:
        covariance_of(noise, name, len(rig.arms[name].poses) if name in rig.arms else None)


def by_name(rig: Rig, noise: NoiseByName) -> Mapping[str, NoiseOfOne]:
    """Return noise by names of arms and cameras, of a `PoseNoise` the same of all; raises `InputError` for others."""
    if isinstance(noise, PoseNoise):
        sides = zip((noise.robot, noise.camera), (rig.arms, rig.cameras), strict=True)
        return {name: EXACT if S is None else S for S, names in sides for name in names}
    require_type("noise", noise, Mapping, "a mapping of names of arms and cameras, or PoseNoise")
    if unknown := [name for name in noise if name not in rig.arms and name not in rig.cameras]:
        raise InputError(f"Expected `noise` of arms and cameras of the rig, got {unknown[0]!r}.")
    return noise


def plain_noise(rig: Rig, noise: NoiseByName | None) -> Json:
    """Return the given noise as plain values of a file, which `given_noise` takes; None where it is estimated."""
    found: Json = None if noise is None else plain(by_name(rig, noise))
    return found


def covariance_of(noise: Mapping[str, NoiseOfOne], name: str, count: int | None) -> Array:
    """Return the covariance (6, 6) of an arm or a camera, or (count, 6, 6) of an arm's poses."""
    if name not in noise:
        raise InputError(
            f'Expected `noise` of {name!r}, such as ("0.5mrad", "0.3mm") or "exact"; or no noise, to estimate all.'
        )
    value: Any = noise[name]
    if np.ndim(value) == 0 and value == EXACT:
        return np.zeros((6, 6))
    if np.shape(value) == (2,):
        return np.diag(np.repeat(parse_deviations((value[0], value[1]), name), 3) ** 2)
    if np.ndim(value) < 2:
        raise InputError(f'Expected the noise of {name!r} to be ("0.5mrad", "0.3mm") or "exact", got {value!r:.60}.')
    S = checked_covariance(value, name, joint=False)
    if S.ndim == 3 and (count is None or len(S) != count):
        expected = "(6, 6); give those of each view as View(covariance=...)" if count is None else f"({count}, 6, 6)"
        raise InputError(f"Expected the noise of {name!r} to be {expected}, got {S.shape}.")
    return S
