"""What a rig says of its cameras: the tolerance of a point at the distance of their targets, what limits it, checks.

The sentences and the names of the checks are those of one camera (`accuracy`, `checks`), as are the rules: a tolerance
is the length that 95 % of the errors of a point straight ahead of the camera are within (`error_of_X`), here of the
least accurate camera. The checks of a rig are made of its own tests: residuals by chi-square, copies of each pose
before and after every moment (`fit.diagnostics.paths`), and the dual bound (`fit.diagnostics.optimality`).
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..core.geometry.pose_numbers import principal_axes
from ..core.geometry.se3 import skew
from ..core.levels import CONTRADICTED, UNUSUAL
from ..core.limits import MIN_POSES_FOR_ROBUST
from ..core.presentation.numbers import digits, probability, times_of_noise
from ..core.presentation.units import MM_PER_M
from ..findings import CHECKS, HALVES, INPUT, MINIMUM, MOTION, NEIGHBOURS, NOISE, OUTLIERS, RESIDUALS
from ..model.errors.key import ErrorKey
from .accuracy import MAX_PRIOR_SHARE, SIZE_MARGIN, from_poses_of, limit_words, rounded_up
from .checks import CAUTION_OF_TEN_TESTS, Check, checks_of
from .error_of_X import moved, points_of, radius_95

if TYPE_CHECKING:
    from .rig_poses import RigPoses

# Of a result it is doubted where a larger share of the views is rejected.
MAX_REJECTED_VIEWS = 0.1


class PointAhead(NamedTuple):
    """A point straight ahead of a camera, at the RMS distance of its targets; m."""

    distance: float
    sd: float  # in the worst direction
    within_95: float  # the length that 95 % of its errors are within


def points_ahead(result: RigPoses) -> dict[str, PointAhead]:
    """Return the point ahead of each camera by its name, of those whose pose is determined."""
    found = {}
    for name, one in result.cameras.items():
        depths = [np.linalg.norm(view.poses[:, :3, 3], axis=-1) for view in result.rig.views if view.camera == name]
        if depths and not len(one.open):
            distance = float(np.sqrt(np.mean(np.concatenate(depths) ** 2)))
            arm = one.pose[:3, 2] * distance
            J = np.hstack([-skew(arm), np.eye(3)])
            sd = float(principal_axes(J @ one.covariance @ J.T)[0][0])
            errors = moved(points_of(one.covariance, result.reference, None), arm)
            found[name] = PointAhead(distance, sd, radius_95(errors))
    return found


def suits_of_rig(result: RigPoses) -> str | None:
    """Return a sentence with the tolerance of a point that all cameras meet; None where they are not usable."""
    ahead = result.points_ahead
    if not result.usable or not ahead or not all(np.isfinite(one.within_95) for one in ahead.values()):
        return None
    far = list(dict.fromkeys(digits(at(one.distance for one in ahead.values()), 3) for at in (min, max)))
    where = f"The target{'' if len(result.targets) == 1 else 's'} {' to '.join(far)} m ahead"
    if result.doubts:
        return f"{where}: no tolerance is shown to be met: {result.doubts[0]}."
    size = rounded_up(max(one.within_95 for one in ahead.values()) * MM_PER_M * (1.0 + SIZE_MARGIN))
    whose = "" if len(ahead) == 1 else "both cameras are " if len(ahead) == 2 else f"all {len(ahead)} cameras are "
    return f"{where}: {whose}good for a tolerance of {size} mm (95 %)."


def limit_of_rig(result: RigPoses) -> str | None:
    """Return a sentence on what limits the accuracy of the least accurate camera, where that is a prior; or None."""
    posterior = result.posterior
    if posterior is None or result.reasons or len(result.open):
        return None
    estimated = {ErrorKey.from_dict(part["key"]) for part in result.components}
    assumed: dict[ErrorKey, list[int]] = {}
    for k, key in enumerate(posterior.keys, start=posterior.p):
        if key.error in estimated and posterior.covariance[k, k] > MAX_PRIOR_SHARE:  # of 1, its prior
            assumed.setdefault(key.error.of(""), []).append(k)
    worst = max(result.cameras, key=lambda name: result.cameras[name].sizes[1])
    k = 6 * result.names.index(worst)
    own = from_poses_of(posterior.covariance, slice(k, k + 6), assumed)
    return None if own is None else limit_words(own)


def checks_of_rig(result: RigPoses) -> tuple[Check, ...]:
    """Return the checks of views and fit, one line each, in the order of those of one camera."""
    checks = checks_of(result.cautions, (*CHECKS, MINIMUM), partial(_without_findings, result))
    return tuple(_rejected(result, one) if one.name == OUTLIERS and result.rejected_words else one for one in checks)


def _rejected(result: RigPoses, check: Check) -> Check:
    views, poses = len(result.rejected), len(result.rejected_poses)
    counts = [f"{views} of {len(result.weights)} views"] if views else []
    counts += [f"{poses} of {len(result.pose_names)} robot poses"] if poses else []
    text = f"{' and '.join(counts)} rejected: {'; '.join(result.rejected_words)}"
    doubted = views > MAX_REJECTED_VIEWS * len(result.weights)
    return Check(check.name, "failed" if doubted else "caution", text, check.findings)


def _without_findings(result: RigPoses, name: str) -> Check:
    """Return the check where nothing was found: passed, or not run and why."""
    if name == INPUT:
        if len(result.pose_names) < MIN_POSES_FOR_ROBUST:
            return Check(name, "not run", f"{len(result.pose_names)} poses fit under several readings of the files")
        return Check(name, "ok", "rows, units and frames fit together")
    if name == OUTLIERS:
        return Check(name, "ok", f"none of {len(result.weights)} views")
    if name == NOISE:
        if result.components:
            return Check(name, "not run", "estimated from the same residuals")
        p = result.p_value
        if p >= CAUTION_OF_TEN_TESTS:
            return Check(name, "ok", f"the residuals agree with it ({probability(p, 2)})")
        text = f"{times_of_noise(float(np.sqrt(result.chi_square / result.dof)))} ({probability(p, 2)})"
        return Check(name, "failed" if p < CONTRADICTED.probability else "caution", text)
    if name == NEIGHBOURS:
        return Check(name, "not run", "not made for several cameras")
    if name == RESIDUALS:
        return Check(name, "ok", f"chi-square {result.chi_square:.0f} of {result.dof:.0f}")
    if name == HALVES:
        if not result.paths:
            return Check(name, "not run", "no two ways lead to one pose")
        least = min(result.paths, key=lambda path: path.p)
        agree = "agree" if least.p >= UNUSUAL.probability else "differ no more than by chance"
        text = f"{len(result.paths)} pairs of ways to one pose {agree}, least {least.words} ({probability(least.p)})"
        return Check(name, "ok", text)
    if name == MOTION:
        if names := [one.name for one in result.singles if len(one.open)]:
            return Check(name, "caution", f"directions of {', '.join(names)} are not determined")
        return Check(name, "ok", f"all directions of {len(result.singles)} poses are determined")
    if name == MINIMUM:
        return Check(name, "ok" if result.optimality.proven else "not run", result.optimality.words)
    included = result.posterior is not None and result.posterior.keys
    return Check(name, "not run", "not tested of several cameras" if included else "none declared or assumed")
