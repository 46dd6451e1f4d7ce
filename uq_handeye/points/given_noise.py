"""The argument `noise` of `poses_from_points`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..formatting.units import parse_length
from ..geometry.se3 import Array

ISOTROPIC = "isotropic"
EXPECTED = (
    "Expected `noise` (--noise) to be standard deviations lateral,axial such as 0.1mm,0.5mm, one such as 0.2mm for "
    "isotropic noise, or 'isotropic' to estimate one"
)


@dataclass(frozen=True)
class GivenNoise:
    """One variance for both directions or two, and the variances (2,) where they are given."""

    isotropic: bool
    phi: Array | None


def given_noise(noise: Any) -> GivenNoise:
    """Read the argument; raises `InputError`."""
    if noise is None or (isinstance(noise, str) and noise.strip() in ("", "auto")):
        return GivenNoise(False, None)
    if isinstance(noise, str) and noise.strip() == ISOTROPIC:
        return GivenNoise(True, None)
    if isinstance(noise, bool):
        raise InputError(f"{EXPECTED}, got {noise!r}.")
    parts = [part.strip() for part in noise.split(",")] if isinstance(noise, str) else list(np.atleast_1d(noise))
    if len(parts) not in (1, 2):
        raise InputError(f"{EXPECTED}, got {noise!r}.")
    try:
        sd = [parse_length(part) if isinstance(part, str) else float(part) for part in parts]
    except (TypeError, ValueError, InputError) as error:
        raise InputError(f"{EXPECTED}, got {noise!r}.") from error
    if not all(1e-9 <= one <= 1.0 for one in sd):
        raise InputError(f"{EXPECTED}, between 1 nm and 1 m, got {noise!r}.")
    return GivenNoise(len(sd) == 1, np.array([sd[0], sd[-1]]) ** 2)
