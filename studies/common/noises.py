"""Covariances that several studies share: that of the paper's experiment, and multiples of the unit matrix."""

from __future__ import annotations

import numpy as np

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import Array


def diagonal(*deviations: float) -> Array:
    """(6, 6) from milliradians and millimetres: of all rotations and all translations, or of all six."""
    return np.diag((1e-3 * np.repeat(deviations, 6 // len(deviations))) ** 2)


def both(rotation: float, translation: float) -> uq.PairNoise:
    """The same for A and B, mrad and mm per axis."""
    S = diagonal(rotation, translation)
    return uq.PairNoise(S, S)


def paper() -> uq.PairNoise:
    """(70) of the paper, of the motions A and B: rad^2 and m^2."""
    B = np.diag([4.15625, 32.0952, 1.43937, 19.52937, 4.44314426, 2.13070])
    for i, j, value in (
        (0, 1, -2.88693),
        (0, 2, -0.60653),
        (1, 2, -0.14482),
        (3, 4, 2.12627),
        (3, 5, -1.06675),
        (4, 5, 0.38679),
    ):
        B[i, j] = B[j, i] = value
    return uq.PairNoise(1e-10 * np.eye(6), 1e-5 * B)
