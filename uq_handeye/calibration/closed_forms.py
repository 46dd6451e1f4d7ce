"""A check of X against closed-form methods: a finding where one of them fits the poses better than X does."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ..core.geometry.se3 import Array, difference
from ..core.levels import UNUSUAL
from ..core.limits import MIN_POSES_FOR_ROBUST
from ..core.rounding import TINY
from ..errors import InputError, NotConvergedError
from ..findings import Finding
from ..fit.diagnostics.pose_table import PoseTable
from ..methods.registry import solve
from ..model.poses.motions import relative_motions, spread_pairs
from ..model.poses.residuals import median, pose_residuals
from .job import Job
from .result import Calibration

# Closed forms that are compared with X on the poses that were kept.
CLOSED_FORMS = ("4dpa", "tsai", "park", "horaud", "daniilidis")
# A closed form fits better than X where its median residuals are below this share of those of X.
CLEARLY_BETTER = 0.9
# The closed forms are compared only where 4DPA of all poses reaches this share already.
SLIGHTLY_BETTER = 0.97


def closed_forms(job: Job, result: Calibration, table: PoseTable) -> list[Finding]:
    """Return a finding if a closed form fits the poses that count better than X, which it contradicts.

    Better: without any of the errors that were estimated with X, the medians of its rotation and of its translation
    residuals are both below `CLEARLY_BETTER` times those that X leaves with them. The others are computed where 4DPA of
    all poses, which is known already, fits at least a little better (`SLIGHTLY_BETTER`).
    """
    kept = table.weight > 0
    if job.poses is None or result.covariance is None or result.opened is not None or kept.sum() < MIN_POSES_FOR_ROBUST:
        return []
    poses = job.poses if kept.all() else job.poses.rows(kept)
    G, C = poses.effective_robot, poses.camera
    own = np.maximum([median(table.rotation[kept]), median(table.translation[kept])], TINY)
    known = result.fourdpa.X if kept.all() and result.fourdpa is not None else None
    if (
        known is not None
        and (np.array([median(part) for part in pose_residuals(G, C, known)]) > SLIGHTLY_BETTER * own).any()
    ):
        return []
    motions = relative_motions(poses, spread_pairs(poses.n, 500))
    found: list[tuple[float, str, Array, float]] = []
    for name in CLOSED_FORMS:
        with suppress(InputError, NotConvergedError):
            X = solve(motions.A, motions.B, method=name)
            ratio = np.array([median(part) for part in pose_residuals(G, C, X)]) / own
            xi = difference(X, result.X)
            d2 = float(xi @ np.linalg.solve(result.covariance, xi))
            if (ratio < CLEARLY_BETTER).all() and d2 > UNUSUAL.chi_square(6):
                found.append((float(ratio.max()), name, ratio, d2))
    if not found:
        return []
    _, name, ratio, d2 = min(found, key=lambda one: one[0])
    values = {
        "method": name,
        "rotation": float(ratio[0]),
        "translation": float(ratio[1]),
        "d2": d2,
        "count": len(found),
    }
    return [Finding("calibration.closed_form_fits", "caution", values)]
