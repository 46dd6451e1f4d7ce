"""Exchanged views: at some moments the pose by one camera is that of the other, or of the other target.

The relative pose ``D_k`` of two cameras on one carrier, from their poses of one target at the same moment, is constant.
Where both poses are exchanged it is ``D_k^-1``. So no fit is needed, and any number of moments may be exchanged: where
it is more than half, the names of the others are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array, inverse
from ...core.limits import MAJORITY, OUTLIER_MEDIANS
from ...model.poses.residuals import rotation_angles

# Distances (m) that rounding makes.
MIN_DISTANCE = 1e-9
# A relative pose is inverse where it is nearer to the inverse of the others than to the others by this factor.
MIN_NEARNESS_RATIO = 4.0


def exchanged(D: Array, lever: float, most: int = 100) -> NDArray[np.bool_]:
    """Return the moments at which relative poses D (n, 4, 4) are the inverse of most others.

    ``lever`` (m) makes an angle a length: the distance of what is seen. ``most``: relative poses that are compared with
    each other, of which one is that of the others. Nothing is exchanged where too few of them agree with it.
    """

    def apart(T: Array, to: Array) -> Array:
        """(n, m) distances of relative poses (n, 4, 4) from others (m, 4, 4)."""
        shift = np.linalg.norm(T[:, None, :3, 3] - to[None, :, :3, 3], axis=-1)
        return np.asarray(shift + lever * rotation_angles(T[:, None, :3, :3].mT @ to[None, :, :3, :3]))

    some = D[np.unique(np.linspace(0, len(D) - 1, min(len(D), most)).astype(int))]
    nearest = np.minimum(apart(some, some), apart(inverse(some), some))
    best = some[[int(np.argmin(np.median(nearest, axis=0)))]]
    same, other = apart(D, best)[:, 0], apart(inverse(D), best)[:, 0]
    limit = max(OUTLIER_MEDIANS * float(np.median(np.minimum(same, other))), MIN_DISTANCE)
    is_other = (MIN_NEARNESS_RATIO * other < same) & (other <= limit)
    is_same = (MIN_NEARNESS_RATIO * same < other) & (same <= limit)
    decided = int((is_other | is_same).sum())
    if decided < MAJORITY * len(D):
        return np.zeros(len(D), dtype=bool)
    return is_other if 2 * int(is_other.sum()) <= decided else is_same
