r"""The smallest change that measurements would have shown: power of the chi-square test of `reference`.

A change a of columns C, ``E r = C a``, has the noncentrality ``a^T I a``, ``I = C^T Sigma^-1 C``. With lambda the
noncentrality that is found with probability 95 %, the smallest shift (or rotation by itself) that shows in every
direction is ``sqrt(lambda / min eigenvalue of I)`` of its block of I.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.files.records import Record
from ...core.geometry.se3 import Array
from ...model.posterior.reference import PredictiveReference

# The probability of finding it.
POWER = 0.95


@dataclass(frozen=True)
class Detectable(Record):
    """Smallest shifts (m) and rotations (rad) of X and of W that show in every direction with probability ``power``.

    Rotations are about the origin of the pose. Infinite: not at all.
    """

    X_translation: float
    X_rotation: float
    W_translation: float
    W_rotation: float
    power: float
    level: float


def smallest_change(information: Array, noncentrality: float) -> tuple[float, float]:
    """Return the shift (m) and the rotation (rad) of a pose, of the information (6, 6) of (theta, tau), that show."""
    return _worst(information[3:, 3:], noncentrality), _worst(information[:3, :3], noncentrality)


def _worst(information: Array, noncentrality: float) -> float:
    values = np.linalg.eigvalsh(information)
    return float(np.sqrt(noncentrality / values[0])) if values[0] > 1e-12 * values[-1] else float("inf")


def detectable_changes(
    of_X: Array, of_W: Array, reference: PredictiveReference, level: float, power: float = POWER
) -> Detectable:
    """Build it from the information (6, 6) of changes of X and of W."""
    noncentrality = reference.noncentrality(power, level)
    return Detectable(
        *smallest_change(of_X, noncentrality), *smallest_change(of_W, noncentrality), power=power, level=level
    )
