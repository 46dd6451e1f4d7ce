r"""Groups of shared errors: the numbers of one error, such as one for each joint, and their share of the variance of X.

With the moves
``E = [d_1 .. d_k]`` (6, k) of X for one prior standard deviation of each after the fit, the variance of X along u that
comes from all of them is ``u^T E E^T u``, and the largest share of the variance ``u^T C u`` along any u the largest
eigenvalue of ``E^T C^-1 E``. It is not the sum of the shares of the single numbers: directions differ.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...core.geometry.se3 import Array
from ...core.numbers.rounding import SOLUTION_ROUNDING
from ...model.error_terms.key import ErrorKey
from .shared_estimates import SharedEstimate


@dataclass(frozen=True)
class SharedGroup:
    """The numbers of one error; or one number by itself, whose ``key`` is its own then."""

    key: ErrorKey
    parts: tuple[SharedEstimate, ...]
    share: float  # of the variance of X by all parts, in the direction where it matters most

    @property
    def name(self) -> str:
        """The error in words."""
        return str(self.key)

    @property
    def count(self) -> int:
        """Number of the parts."""
        return len(self.parts)

    @property
    def default(self) -> bool:
        """Assumed, not declared."""
        return self.parts[0].default

    @property
    def told(self) -> float:
        """Mean share of the prior variances that the data took away: 0 nothing, 1 everything."""
        return float(np.mean([part.resolved for part in self.parts]))

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the numbers as people read them, in order."""
        return tuple(dict.fromkeys(part.shown[1] for part in self.parts))

    def of_unit(self, unit: str) -> tuple[Array, Array, Array]:
        """Prior standard deviations, estimates and standard deviations after the fit of the numbers of a unit."""
        parts = [part for part in self.parts if part.shown[1] == unit]
        rows = [[part.shown[0] * x for x in (part.prior_sd, part.estimate, part.sd)] for part in parts]
        prior, estimate, sd = np.array(rows).T
        return prior, estimate, sd


def grouped(estimates: Iterable[SharedEstimate], covariance: Array | None) -> list[SharedGroup]:
    """Group the estimates in their order; ``covariance`` (6, 6) of X is the one that their effects were found
    beside.
    """
    groups: dict[ErrorKey, list[SharedEstimate]] = {}
    for estimate in estimates:
        groups.setdefault(estimate.key.source, []).append(estimate)
    found = []
    for key, parts in groups.items():
        if len(parts) == 1:
            found.append(SharedGroup(parts[0].key, (parts[0],), parts[0].share))
        else:
            found.append(SharedGroup(key, tuple(parts), joint_share(parts, covariance)))
    return found


def joint_share(parts: Iterable[SharedEstimate], covariance: Array | None) -> float:
    """Return the share of all parts together in the variance of X; without its covariance the largest of the single
    shares.
    """
    parts = list(parts)
    if covariance is None:
        return max(part.share for part in parts)
    sd = np.sqrt(np.diag(covariance))
    scale = np.where(sd > 0, sd, 1.0)
    E = np.stack([part.effect for part in parts], axis=-1) / scale[:, None]
    inverse = np.linalg.pinv(covariance / np.outer(scale, scale), SOLUTION_ROUNDING, hermitian=True)
    return float(np.clip(np.linalg.eigvalsh(E.T @ inverse @ E)[-1], 0.0, 1.0))
