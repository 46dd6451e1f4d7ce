r"""Checks of target, scale and noise by the residuals.

Wrong points: a test of each against all others.

A point of residual r that was used has ``r^T (V - Q)^-1 r``, Q the covariance of its prediction, and one that was left
out ``r^T (V + Q)^-1 r``; both are chi-square distributed with 3 degrees of freedom if it is as the others. A share
`ALPHA` of data sets without a wrong point loses one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ...core.geometry.se3 import Array
from ...errors import InputError
from ...findings import Finding
from .least_squares import Fit, Normal, Sight
from .measured import kabsch, placed

# Tests of which a false alarm is this rare.
RARE = 1e-4
# A scale is told from so many standard deviations and from this share on.
CERTAIN, TELLING = 4.0, 2e-4
# Lengths that differ by one of these factors, within TOLERANCE, are of another unit.
FACTORS = {1000.0: "mm", 100.0: "cm", 0.001: "m", 0.01: "m", 39.37: "in"}
TOLERANCE = 0.2
# A mirror image must fit so many times better to be one.
MIRRORED = 5.0
# Residuals beyond this share of the distances between points are those of another target.
UNLIKE = 0.2
# Points of a target that are tested one by one.
MOST_TESTED = 1000
FEW_DOF = 10.0


def require_scale(sight: Sight, T: Array, p: Array) -> None:
    """Raise `InputError` where target and points are in different units or mirror images."""
    ratio = _spread(sight, sight.y) / max(_spread(sight, p[sight.point]), 1e-300)
    for factor, unit in FACTORS.items():
        # y / p = 1000: the points are in mm and the target in m
        if abs(ratio / factor - 1.0) < TOLERANCE and unit != "in":
            which, verb, option = ("points", "seem", "--units") if factor > 1 else ("target", "seems", "--target-units")
            other = unit if factor > 1 else {0.001: "mm", 0.01: "cm"}[factor]
            raise InputError(
                f"The {which} {verb} to be in {other}: the measured points are {ratio:.3g} times as far apart "
                f"as those of the target. Give {option} {other}."
            )
    if not 0.5 < ratio < 2.0:
        raise InputError(
            f"The measured points are {ratio:.3g} times as far apart as those of the target. Check the names of the "
            "points in both, and the units (--units, --target-units)."
        )
    flipped = p[sight.point] * [1.0, 1.0, -1.0]
    own, flip = (kabsch(sight.y, q, sight.pose, sight.n, np.ones(len(q))) for q in (p[sight.point], flipped))
    straight, mirrored = (
        float(np.median(np.linalg.norm(sight.y - placed(pose, q, sight.pose), axis=-1)))
        for pose, q in ((own, p[sight.point]), (flip, flipped))
    )
    if straight > MIRRORED * mirrored and straight > 1e-2 * _spread(sight, sight.y):
        raise InputError(
            "The points are the mirror image of the target. Check the sign of its axes: the frames of target and "
            "camera must be right-handed."
        )
    left = float(np.median(np.linalg.norm(sight.y - placed(T, p[sight.point], sight.pose), axis=-1)))
    if left > UNLIKE * _spread(sight, sight.y):
        raise InputError(
            f"The points do not fit the target: half of them are more than {1e3 * left:.2g} mm off. Check that the "
            "same point has the same name in both, and the units (--units, --target-units)."
        )


def _spread(sight: Sight, values: Array) -> float:
    """Median over the poses of the distance of neighbouring measurements of one pose."""
    same = sight.pose[1:] == sight.pose[:-1]
    return float(np.median(np.linalg.norm(values[1:] - values[:-1], axis=-1)[same]))


def noise_findings(found: Fit, given: bool) -> list[Finding]:
    """Return a finding if the residuals contradict the noise that was given, or are few to estimate it from."""
    if not given:
        fewest = float(found.dof.sum() if found.model.isotropic else found.dof.min())
        return [Finding("points.few_residuals", "caution", {"dof": fewest})] if fewest < FEW_DOF else []
    value, dof = float((found.squares / found.phi).sum()), float(found.dof.sum())
    p = 2.0 * min(float(chi2.cdf(value, dof)), float(chi2.sf(value, dof))) if dof >= 1 else 1.0
    if p >= RARE:
        return []
    return [Finding("points.noise_differs", "caution", {"ratio": float(np.sqrt(value / dof)), "p_value": p})]


def target_findings(found: Fit, names: NDArray[np.str_]) -> list[Finding]:
    """Return what the residuals say against the target."""
    scale, sd = scale_of(found.normal)
    if abs(scale) > max(CERTAIN * sd, TELLING):
        return [Finding("points.scale", "caution", {"scale": scale, "std": sd})]
    return _target_finding(found.normal, names)


def scale_of(normal: Normal) -> tuple[float, float]:
    """Measured lengths over those of the target, minus 1, and its standard deviation, beside the poses."""
    a = placed(normal.T, normal.p[normal.sight.point], normal.sight.pose) - normal.T[normal.sight.pose, :3, 3]
    Wa = (normal.W @ a[..., None])[..., 0]
    mixed = np.zeros((normal.sight.n, 6))
    np.add.at(mixed, normal.sight.pose, np.einsum("kab,ka->kb", normal.J, Wa))
    solved = np.einsum("nab,nb->na", normal.own, mixed)
    information = float(np.sum(a * Wa) - np.sum(mixed * solved))
    score = float(np.sum(Wa * normal.r) + np.sum(solved * normal.blocks.h))
    if information <= 0:
        return 0.0, float("inf")
    return score / information, information**-0.5


def _target_finding(normal: Normal, names: NDArray[np.str_]) -> list[Finding]:
    """Test whether points of the target lie elsewhere, in all poses alike: the score of each, with the poses free."""
    sight = normal.sight
    seen, point = np.unique(sight.point, return_inverse=True)
    if len(seen) > MOST_TESTED or sight.n * len(seen) > 500_000 or sight.n < 2:
        return []
    own = Sight(sight.y, sight.pose, point, sight.n, len(seen))
    free = Normal(own, normal.T, normal.p[seen], normal.W, True)
    S, gradient = free.reduced
    blocks = S.reshape(len(seen), 3, len(seen), 3)[np.arange(len(seen)), :, np.arange(len(seen))]
    score = -gradient.reshape(-1, 3)
    values, vectors = np.linalg.eigh(blocks)
    sound = values > 1e-6 * values[:, -1:]
    white = np.einsum("jab,ja->jb", vectors, score)
    d2 = np.where(sound, white**2 / np.where(sound, values, 1.0), 0.0).sum(axis=-1)
    bad = np.flatnonzero(d2 > chi2.isf(RARE / len(seen), 3))
    if not len(bad):
        return []
    moved = np.einsum("jab,jb->ja", vectors, np.where(sound, white / np.where(sound, values, 1.0), 0.0))
    worst = bad[np.argsort(-d2[bad], kind="stable")][:5]
    listed = [{"point": str(names[seen[j]]), "distance": float(np.linalg.norm(moved[j]))} for j in worst]
    return [Finding("points.target_off", "caution", {"count": len(bad), "n": len(seen), "far_points": listed})]


ALPHA = 1e-3
MOST_ROUNDS = 40
# A residual that has less than this share of its variance left cannot be tested.
TESTABLE = 1e-3


def distances(found: Fit, sight: Sight, used: NDArray[np.bool_]) -> Array:
    """(k,) test values of all points of ``sight``, those used in the fit and the others."""
    T, p = found.normal.T, found.normal.p
    at = placed(T, p[sight.point], sight.pose)
    r, V, Q = sight.y - at, found.covariance_of(at), found.normal.predicted_covariance(sight)
    S = V + np.where(used, -1.0, 1.0)[:, None, None] * Q
    half = np.linalg.inv(np.linalg.cholesky(V))
    values, vectors = np.linalg.eigh(half @ S @ half.mT)
    white = np.einsum("kba,kbc,kc->ka", vectors, half, r)
    return np.asarray(np.where(values > TESTABLE, white**2 / np.maximum(values, TESTABLE), 0.0).sum(axis=-1))


def next_used(d2: Array, sight: Sight, used: NDArray[np.bool_], limit: float, again: bool) -> NDArray[np.bool_]:
    """Points to use in the next round: the worst of each pose leaves, as it spoils the others; good ones return."""
    bad = np.flatnonzero(used & (d2 > limit))
    order = bad[np.lexsort((-d2[bad], sight.pose[bad]))]
    first = np.ones(len(order), dtype=bool)
    first[1:] = sight.pose[order][1:] != sight.pose[order][:-1]
    result = used.copy()
    result[order[first]] = False
    if again:
        result |= ~used & (d2 < limit)
    return result
