"""Checks of unit, handedness, scale and shape of the target, and of the noise that was given, by the residuals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ...core.geometry.se3 import Array
from ...core.levels import RARE
from ...core.limits import MAX_NAMED
from ...core.presentation.units import LENGTH_UNITS, MM_PER_M
from ...core.rounding import CHAIN_ROUNDING, TINY
from ...errors import InputError
from ...findings import Finding
from .closed_form import kabsch, placed, sums
from .least_squares import Fit, Matches

# Lengths that agree in a unit do so within this factor: another target or swapped names differ by more.
MAX_LENGTH_RATIO = 2.0
# A target is mirrored if its mirror image has residuals smaller by this factor.
MIRROR_IMAGE_RATIO = 5.0
# A median residual beyond this share of the distances between points belongs to another target.
MAX_RESIDUAL_SHARE = 0.2
# A relative error of scale below it, 0.2 mm per metre, is not reported.
MIN_SCALE_ERROR = 2e-4


def require_scale(points: Matches, T: Array) -> None:
    """Raise `InputError` where target and points are in different units, mirror images, or of different shapes."""
    size = _spread(points, points.y)
    ratio = size / max(_spread(points, points.p), TINY)
    for unit in ("cm", "mm"):
        for which, verb, option, per_metre in (
            ("points", "seem", "--units", ratio),
            ("target", "seems", "--target-units", 1.0 / max(ratio, TINY)),
        ):
            if 1 / MAX_LENGTH_RATIO < per_metre * LENGTH_UNITS[unit] < MAX_LENGTH_RATIO:
                raise InputError(
                    f"The {which} {verb} to be in {unit}: the measured points are {ratio:.3g} times as far apart "
                    f"as those of the target. Give {option} {unit}."
                )
    if not 1 / MAX_LENGTH_RATIO < ratio < MAX_LENGTH_RATIO:
        raise InputError(
            f"The measured points are {ratio:.3g} times as far apart as those of the target. Check the names of the "
            "points in both, and the units (--units, --target-units)."
        )
    straight, mirrored = (
        _median_residual(flipped, kabsch(flipped.y, flipped.p, flipped.pose, flipped.n, np.ones(len(flipped.y))))
        for flipped in (points, points._replace(p=points.p * [1.0, 1.0, -1.0]))
    )
    if straight > MIRROR_IMAGE_RATIO * max(mirrored, CHAIN_ROUNDING * size):
        raise InputError(
            "The points are the mirror image of the target. Check the sign of its axes: the frames of target and "
            "camera must be right-handed."
        )
    residual = _median_residual(points, T)
    if residual > MAX_RESIDUAL_SHARE * size:
        raise InputError(
            f"The points do not fit the target: half of them are more than {MM_PER_M * residual:.2g} mm off. Check "
            "that the same point has the same name in both, and the units (--units, --target-units)."
        )


def _median_residual(points: Matches, T: Array) -> float:
    return float(np.median(np.linalg.norm(points.y - placed(T, points.p, points.pose), axis=-1)))


def _spread(points: Matches, values: Array) -> float:
    """Median over the poses of the distance of neighbouring measurements of one pose."""
    same = points.pose[1:] == points.pose[:-1]
    return float(np.median(np.linalg.norm(values[1:] - values[:-1], axis=-1)[same]))


def noise_findings(found: Fit) -> list[Finding]:
    """Return a finding if the residuals contradict the noise that was given."""
    value, dof = float((found.squares / found.phi).sum()), float(found.dof.sum())
    p = 2.0 * min(float(chi2.cdf(value, dof)), float(chi2.sf(value, dof)))
    if p >= RARE.probability:
        return []
    return [Finding("points.noise_differs", "caution", {"ratio": float(np.sqrt(value / dof)), "p_value": p})]


def target_findings(found: Fit, point: NDArray[np.intp], names: NDArray[np.str_]) -> list[Finding]:
    """Return what in the target the residuals contradict; ``point`` (k,) is the index of each point in ``names``."""
    scale, sd = scale_error(found)
    if abs(scale) > max(np.sqrt(RARE.chi_square(1)) * sd, MIN_SCALE_ERROR):
        return [Finding("points.scale", "caution", {"scale": scale, "std": sd})]
    return _shape_findings(found, point, names)


def scale_error(found: Fit) -> tuple[float, float]:
    """Measured lengths over those of the target, minus 1, with its standard deviation, estimated with the poses."""
    pose, n = found.points.pose, found.points.n
    a = placed(found.T, found.points.p, pose) - found.T[pose, :3, 3]
    Wa = (found.W @ a[..., None])[..., 0]
    mixed = sums(np.einsum("kab,ka->kb", found.J, Wa), pose, n)
    solved = np.einsum("nab,nb->na", found.covariance, mixed)
    information = float(np.sum(a * Wa) - np.sum(mixed * solved))
    score = float(np.sum(Wa * found.r) - np.sum(solved * found.score))
    if information <= 0:
        return 0.0, float("inf")
    return score / information, information**-0.5


def _shape_findings(found: Fit, point: NDArray[np.intp], names: NDArray[np.str_]) -> list[Finding]:
    """Test whether points of the target lie elsewhere, in all poses alike: each by its score, with the poses free.

    With ``M = W - W J N^-1 J^T W`` the information on a displacement of point j is ``S_j = sum_i R^T M R``.
    """
    pose, n = found.points.pose, found.points.n
    if n < 2:
        return []
    seen, index = np.unique(point, return_inverse=True)
    R, WJ = found.T[pose, :3, :3], found.W @ found.J
    M = found.W - WJ @ found.covariance[pose] @ WJ.mT
    by_poses = (WJ @ (found.covariance[pose] @ found.score[pose][..., None]))[..., 0]
    pull = (found.W @ found.r[..., None])[..., 0] - by_poses
    values, vectors = np.linalg.eigh(sums(R.mT @ M @ R, index, len(seen)))
    white = np.einsum("jab,ja->jb", vectors, sums((R.mT @ pull[..., None])[..., 0], index, len(seen)))
    determined = values > CHAIN_ROUNDING * values[:, -1:]
    values = np.where(determined, values, np.inf)
    d2 = (white**2 / values).sum(axis=-1)
    bad = np.flatnonzero(d2 > chi2.isf(RARE.probability / len(seen), 3))
    if not len(bad):
        return []
    distance = np.linalg.norm(white / values, axis=-1)
    worst = bad[np.argsort(-d2[bad], kind="stable")][:MAX_NAMED]
    listed = [{"point": str(names[seen[j]]), "distance": float(distance[j])} for j in worst]
    return [Finding("points.target_off", "caution", {"count": len(bad), "n": len(seen), "far_points": listed})]
