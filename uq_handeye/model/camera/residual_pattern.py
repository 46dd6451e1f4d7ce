r"""Test of the camera model: a pattern of the residuals over the picture shows that it is wrong.

The picture is divided into CELLS x CELLS cells. Where the model is right, the mean residual of cell c with m_c corners
is Gaussian with the variance ``v_c = sum_j s_j^2 / m_c^2`` per coordinate, s_j the noise of the picture of corner j,
and

    T = sum_c |mean_c|^2 / v_c   is about chi-square with 2 (number of cells) - (parameters) degrees of freedom.

The means are plain ones: weights would hide a wrong model, which makes pictures that reach far out look noisy.

With tens of thousands of corners T detects patterns of a hundredth of a pixel, which do no harm. Their size is
therefore judged as well: the root mean square of the cells' means beyond the expectation by chance, as a share of s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.levels import CONTRADICTED
from ...core.read_only import ReadOnlyArrays
from .adjustment.bundle import Bundle
from .corners import Corners

# Cells of the picture along each side.
CELLS = 8
# A pattern matters where it is larger than this share of the pixel noise, and beyond chance.
MIN_PATTERN_SHARE = 0.3


@dataclass(frozen=True, eq=False)
class Pattern(ReadOnlyArrays):
    """Mean residuals over the picture."""

    mean: Array  # (CELLS, CELLS, 2) pixels; rows from the top; 0 where there is no corner
    count: NDArray[np.intp]  # (CELLS, CELLS)
    p_value: float
    share: float  # rms of the pattern beyond chance over s

    @property
    def found(self) -> bool:
        """True if there is a pattern that matters: the model is wrong, or the board is not flat."""
        return self.p_value < CONTRADICTED.probability and self.share > MIN_PATTERN_SHARE


def pattern_of(bundle: Bundle, corners: Corners, image_size: tuple[int, int]) -> Pattern:
    """Return the pattern of the corners that were used."""
    from scipy.special import gammaincc  # slow to import

    pixels, residuals = corners.pixels[bundle.used], bundle.residuals[bundle.used]
    cell = np.clip(CELLS * (pixels + 0.5) / np.array(image_size), 0, CELLS - 1).astype(int)
    number = cell[:, 1] * CELLS + cell[:, 0]
    count = np.bincount(number, minlength=CELLS**2)
    sums = np.stack([np.bincount(number, residuals[:, k], CELLS**2) for k in (0, 1)], axis=-1)
    mean = sums / np.maximum(count, 1)[:, None]
    squares = np.bincount(number, bundle.picture_noise[corners.picture[bundle.used]] ** 2, CELLS**2)
    covered = count > 0
    T = float(np.sum(np.sum(sums[covered] ** 2, axis=1) / squares[covered]))
    dof = max(2 * int(covered.sum()) - int(bundle.free.sum()), 1)
    by_chance = dof / covered.sum() * float(np.sum(squares[covered] / count[covered]))
    found = float(np.sum(count * np.sum(mean**2, axis=1)))
    beyond = max(found - by_chance, 0.0) / (2 * len(pixels)) / bundle.pixel_noise**2  # share of the variance
    shape = (CELLS, CELLS)
    return Pattern(
        mean.reshape(*shape, 2), count.reshape(shape), float(gammaincc(dof / 2, T / 2)), float(np.sqrt(beyond))
    )
