r"""Groups of shared errors: the numbers of one error, such as one for each joint, and their share of the variance of X.

With the moves
``E = [d_1 .. d_k]`` (6, k) of X for one prior standard deviation of each after the fit, the variance of X along u that
comes from all of them is ``u^T E E^T u``, and the largest share of the variance ``u^T C u`` along any u the largest
eigenvalue of ``E^T C^-1 E``. It is not the sum of the shares of the single numbers: directions differ.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ...core.geometry.se3 import Array
from ...core.rounding import SOLUTION_ROUNDING
from ...model.errors.error_estimate import ErrorEstimate
from ...model.errors.key import ErrorKey


def grouped(estimates: Iterable[ErrorEstimate], covariance: Array | None) -> list[ErrorEstimate]:
    """Return one estimate for each error, in their order, with its numbers; ``covariance`` (6, 6) of X is the one that
    their effects were found beside.
    """
    groups: dict[ErrorKey, list[ErrorEstimate]] = {}
    for estimate in estimates:
        groups.setdefault(estimate.key.source, []).append(estimate)
    return [parts[0] if len(parts) == 1 else _together(key, parts, covariance) for key, parts in groups.items()]


def _together(key: ErrorKey, parts: Sequence[ErrorEstimate], covariance: Array | None) -> ErrorEstimate:
    first = parts[0]
    return ErrorEstimate(
        key, first.side, first.unit, max(part.size for part in parts), count=len(parts), default=first.default,
        resolved=float(np.mean([part.resolved for part in parts])), share=joint_share(parts, covariance),
        stated=first.stated, accuracy=first.accuracy, numbers=tuple(parts),
    )  # fmt: skip


def joint_share(parts: Iterable[ErrorEstimate], covariance: Array | None) -> float:
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
