"""`poses_from_points`: points in the frame of the camera in, poses of the target and their joint covariance out."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from ...core.geometry.se3 import Array
from ...errors import InputError, NotConvergedError
from ...findings import Finding, warn
from ..noise.joint_covariance import JointCovariance
from .checks import ALPHA, MOST_ROUNDS, distances, next_used, noise_findings, require_scale, target_findings
from .least_squares import (
    Fit,
    GivenNoise,
    NoiseModel,
    Sight,
    fit,
    given_noise,
    refitted,
    robust_variances,
    sight_lines,
    split_squares,
    with_model,
)
from .measured import PointSet, Target, consensus, placed, sums, unknown_shape
from .result import PointPoses, shape_names

PAGE = "docs/how-to/points.md"
FEWEST = 3
# Points whose second extent is below this share of the first lie in a line.
IN_LINE = 1e-3
# The same of a given target: the noise of points so near to a line hides the rotation about it.
NEARLY_IN_LINE = 1e-2
# A rotation about the line of the points that is less certain than this (rad) is open.
UNCERTAIN = 0.2
# Degrees of freedom that a variance of its own needs.
FEWEST_DOF = 5.0
# Distances that differ by this factor can show how the noise grows; so much must the deviance fall.
SPREAD, CLEARLY = 1.25, 6.0
# Sizes that an unknown shape is estimated for: points, and poses times points.
MOST_POINTS, MOST_CELLS = 1000, 500_000


def poses_from_points(points: Any, target: Any = None, noise: Any = None) -> PointPoses:
    """Poses ``camera_T_target`` and their joint covariance, from the points of a target measured in 3-D.

    Model: ``y_ij = R_i p_j + t_i + e_ij``, e_ij Gaussian with one standard deviation across the line of sight (lateral)
    and another along it (axial); see `points.least_squares`. Least squares with outlier rejection; variances by
    restricted maximum likelihood (REML); the covariance to first order in the noise.

    Parameters
    ----------
    points : PointSet, or array (n, m, 3)
        Points in the frame of the camera, m (`read_points`). In an array, NaN marks points that were not seen. A pose
        needs three points that are not in a line.
    target : Target, {name: (x, y, z)}, array (m, 3) or None
        Points in the frame of the target, m, taken as exact. None: the shape is estimated together with the poses; the
        frame of the target then has its origin at the centroid of the points, and the axes of the camera at the pose
        with most points. Its errors are shared by all poses.
    noise : None, "isotropic", text or (lateral, axial)
        None: two standard deviations are estimated, and whether they grow with the distance. "isotropic": one, for
        trackers. ``"0.1mm,0.5mm"`` or numbers in m: lateral and axial as given; a single one is isotropic.

    Returns
    -------
    PointPoses

    Raises
    ------
    InputError
        Points, target or noise that make no sense; points that determine no pose.
    NotConvergedError
        ``partial`` holds the fit that was reached.

    Examples
    --------
    >>> import numpy as np, uq_handeye as uq
    >>> target = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    >>> measured = target + [0, 0, 1.0] + np.random.default_rng(1).normal(scale=[1e-4, 1e-4, 5e-4], size=(4, 3))
    >>> seen = uq.poses_from_points(measured[None], target, noise="0.1mm,0.5mm")
    >>> float(seen.poses[0, 2, 3].round(2)), seen.covariance.shape
    (1.0, (6, 6))
    """
    measured = PointSet.of(points)
    given = given_noise(noise)
    known = None if target is None else Target.of(target)
    findings: list[Finding] = []
    if known is not None:
        measured = _as_named(measured, known)
        mine = known.find(measured.point) >= 0
        unknown_points = np.unique(measured.point[~mine]).tolist()
        if not mine.any():
            named = ", ".join(known.names[:5].tolist())
            raise InputError(
                f"None of the points ({', '.join(unknown_points[:5])}, ...) is named in the target ({named}, ...). "
                "Give the same point the same name in both."
            )
        if unknown_points:
            findings.append(Finding("points.not_in_target", "caution", {"points": unknown_points}))
    names = measured.names if known is None else known.names
    place = Target(names, np.zeros((len(names), 3))).find(measured.point)
    usable, refused = _usable(measured, place, known)
    if not usable.any():
        raise InputError(_no_pose(measured, known))
    found, rows, sight, used, pose_of, kept_points = _solve(measured, place, usable, known, names, given, refused)
    for why in sorted(set(refused.values())):
        poses = sorted(row for row, reason in refused.items() if reason == why)
        findings.append(Finding("points.poses_left_out", "caution", {"poses": poses, "why": why}))
    F = found.normal.shared
    covariance = JointCovariance(found.normal.own, F, shape_names(F.shape[-1]))
    whole = np.zeros(len(measured), dtype=bool)
    whole[pose_of] = used
    residuals = np.full((len(measured), 3), np.nan)
    residuals[pose_of] = sight.y - placed(found.normal.T, found.normal.p[sight.point], sight.pose)
    out = np.flatnonzero(~used)
    if len(out):
        findings.append(_left_out(measured, pose_of[out], residuals, len(sight.y)))
    if known is not None:
        findings += target_findings(found, names[kept_points])
    findings += noise_findings(found, given.phi is not None)
    warn(findings)
    L = found.normal.L if known is None else np.zeros((3 * len(kept_points), 0))
    return PointPoses(
        poses=found.normal.T,
        rows=rows,
        covariance=covariance,
        target=Target(names[kept_points], found.normal.p),
        target_factor=L.reshape(len(kept_points), 3, -1),
        target_known=known is not None,
        model=found.model,
        sd=np.sqrt(found.phi),
        dof=found.dof,
        noise_given=given.phi is not None,
        points=measured,
        residuals=residuals,
        used=whole,
        refused=tuple(sorted(refused.items())),
        findings=tuple(findings),
    )


def _left_out(measured: PointSet, out: NDArray[np.intp], residuals: Array, n: int) -> Finding:
    """Points that were left out of ``n``, by their numbers; the twelve farthest are listed."""
    listed = [
        {"pose": int(measured.row[k]), "point": str(measured.point[k]), "distance": float(np.linalg.norm(residuals[k]))}
        for k in out[np.argsort(-np.linalg.norm(residuals[out], axis=1), kind="stable")][:12]
    ]
    return Finding("points.left_out", "caution", {"count": len(out), "n": n, "far_points": listed})


def _as_named(measured: PointSet, known: Target) -> PointSet:
    """Return the points by their names in the target where these differ in small and capital letters only."""
    names = known.names.tolist()
    of = {str(name).casefold(): name for name in names}
    seen = np.unique(measured.point).tolist()
    if set(seen) & set(names) or len(of) < len(names) or len({name.casefold() for name in seen}) < len(seen):
        return measured
    return PointSet(measured.row, np.array([of.get(str(p).casefold(), p) for p in measured.point]), measured.xyz)


def _solve(
    measured: PointSet,
    place: NDArray[np.intp],
    usable: NDArray[np.bool_],
    known: Target | None,
    names: NDArray[np.str_],
    given: GivenNoise,
    refused: dict[int, str],
) -> tuple[Fit, NDArray[np.int64], Sight, NDArray[np.bool_], NDArray[np.intp], NDArray[np.intp]]:
    """The fit, poses that turn out to be open left out; with what was used of the measurements and where it stands."""
    while True:
        index = np.flatnonzero(usable)
        if not len(index):
            raise InputError(_no_pose(measured, known, refused))
        rows, pose = np.unique(measured.row[index], return_inverse=True)
        kept_points, point = np.unique(place[index], return_inverse=True)
        if known is not None:
            kept_points, point = np.arange(len(names)), place[index]
        sight = Sight(measured.xyz[index], pose, point, len(rows), len(kept_points))
        if known is None:
            if sight.m > MOST_POINTS or sight.n * sight.m > MOST_CELLS:
                raise InputError(
                    f"Expected at most {MOST_POINTS} points of an unknown target, and at most {MOST_CELLS:,} poses "
                    f"times points, got {sight.m} points in {sight.n} poses. Give the target (--target), or some of "
                    "its points."
                )
            largest = int(np.argmax(np.bincount(pose)))
            p, T = unknown_shape(sight.y, pose, point, sight.n, sight.m, largest)
        else:
            p = known.xyz
            T = consensus(sight.y, p[point], pose, sight.n)
            require_scale(sight, T, p)
        found, used = _rounds(sight, T, p, known is None, given)
        left = np.bincount(pose[used], minlength=sight.n)
        sd = np.sqrt(np.linalg.eigvalsh(found.normal.own[:, :3, :3])[:, -1])
        bad = (left < FEWEST) | (sd > UNCERTAIN) | _in_line(p, sight.where(used))
        if not bad.any():
            return found, rows, sight, used, index, kept_points
        for i in np.flatnonzero(bad):
            why = "inconsistent" if np.bincount(pose)[i] > left[i] else "in line"
            refused[int(rows[i])] = why
        usable = usable & ~np.isin(measured.row, rows[bad])
        usable = _twice_seen(measured, place, usable) if known is None else usable


def _rounds(sight: Sight, T: Array, p: Array, shape_open: bool, given: GivenNoise) -> tuple[Fit, NDArray[np.bool_]]:
    """Fit and test in turn, until no point leaves or comes back."""
    used = np.ones(len(sight.y), dtype=bool)
    at = placed(T, p[sight.point], sight.pose)
    u, distance = sight_lines(at), float(np.median(np.linalg.norm(at, axis=-1)))
    model = NoiseModel(given.isotropic, False, max(distance, 1e-9))
    growth = model.growth(at)
    unknowns = 6 * sight.n + (3 * sight.m - 6) * shape_open
    estimate = given.phi is None
    if estimate and 3 * len(sight.y) - unknowns < 1:
        raise InputError(
            f"{len(sight.y)} points leave no residuals to estimate their noise from. Give it: "
            'noise="0.1mm,0.5mm" (--noise 0.1mm,0.5mm, lateral and axial).'
        )
    r = sight.y - at
    share = 1.0 - unknowns / (3 * len(sight.y))
    phi = robust_variances(r, u, growth, given.isotropic, share) if given.phi is None else given.phi
    limit = float(chi2.isf(ALPHA / len(sight.y), 3))
    if estimate:
        # The first fit leaves out what is far off by the medians: it would make the variances too large.
        d2 = (split_squares(r, u, growth) / np.maximum(phi, 1e-300)).sum(axis=-1)
        first = used & (d2 < 2.0 * limit)
        enough = np.bincount(sight.pose[first], minlength=sight.n) > FEWEST
        used = np.where(enough[sight.pose], first, used)
    found = _converged(fit(sight.where(used), T, p, model, phi, shape_open=shape_open, estimate=estimate))
    if estimate and not model.isotropic and found.dof.min() < FEWEST_DOF:
        found = _converged(with_model(found, replace(model, isotropic=True)))
    chosen = False
    for step in range(MOST_ROUNDS):
        d2 = distances(found, sight, used)
        new = next_used(d2, sight, used, limit, step < MOST_ROUNDS // 2)
        few = np.bincount(sight.pose[new], minlength=sight.n) < FEWEST
        if few.any() or (shape_open and (np.bincount(sight.point[new], minlength=sight.m) < 2).any()):
            few_points = np.bincount(sight.point[new], minlength=sight.m) < 2
            new = np.where(few_points[sight.point] & shape_open & ~few[sight.pose], used, new)
        if (new == used).all():
            if chosen or not estimate:
                break
            found, chosen = _growing(found), True
            continue
        used = new
        if few.any():  # such a pose is refused by the caller
            break
        found = _converged(refitted(found, sight.where(used), estimate))
    return found, used


def _growing(found: Fit) -> Fit:
    """The fit with noise that grows with the distance, where the points say so clearly."""
    far = np.linalg.norm(found.normal.sight.y, axis=-1)
    if found.model.growing or np.quantile(far, 0.95) < SPREAD * np.quantile(far, 0.05):
        return found
    other = with_model(found, replace(found.model, growing=True))
    return other if other.converged and other.deviance < found.deviance - CLEARLY else found


def _converged(found: Fit) -> Fit:
    if found.normal.shape_open and not found.normal.determined:
        raise InputError(
            "The poses do not have enough points in common to determine the shape of the target: some of its points "
            f"are only seen together in one pose. Give the target (--target), or more poses ({PAGE})."
        )
    if not found.converged:
        raise NotConvergedError(
            "The fit of the poses to the points did not converge. Look at the names of the points and at the target; "
            "or give the `noise` (--noise).",
            found,
        )
    return found


def _usable(
    measured: PointSet, place: NDArray[np.intp], known: Target | None
) -> tuple[NDArray[np.bool_], dict[int, str]]:
    """Points of poses that three points that are not in a line determine; the other poses with the reason."""
    usable = place >= 0
    if known is None:
        usable = _twice_seen(measured, place, usable)
    rows, pose = np.unique(measured.row, return_inverse=True)
    count = np.bincount(pose[usable], minlength=len(rows))
    line = _in_line(measured.xyz, Sight(measured.xyz[usable], pose[usable], np.flatnonzero(usable), len(rows), 0))
    if known is not None:
        of_target = Sight(measured.xyz[usable], pose[usable], place[usable], len(rows), 0)
        line |= _in_line(known.xyz, of_target, NEARLY_IN_LINE)
    bad = (count < FEWEST) | line
    refused = {int(rows[i]): "few points" if count[i] < FEWEST else "in line" for i in np.flatnonzero(bad)}
    usable = usable & ~bad[pose]
    return (_twice_seen(measured, place, usable) if known is None else usable), refused


def _twice_seen(measured: PointSet, place: NDArray[np.intp], usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Without points that one pose only has: they say nothing where the shape is unknown."""
    while True:
        count = np.bincount(place[usable], minlength=int(place.max(initial=0)) + 1)
        poses, pose = np.unique(measured.row, return_inverse=True)
        of_pose = np.bincount(pose[usable], minlength=len(poses))
        new = usable & (count[place] > 1) & (of_pose[pose] >= FEWEST)
        if (new == usable).all():
            return usable
        usable = new


def _in_line(points: Array, sight: Sight, limit: float = IN_LINE) -> NDArray[np.bool_]:
    """(n,) whether the points of each pose lie in a line."""
    p = points[sight.point]
    count = np.maximum(np.bincount(sight.pose, minlength=sight.n), 1)[:, None]
    d = p - (sums(p, sight.pose, sight.n) / count)[sight.pose]
    extent = np.linalg.eigvalsh(sums(d[:, :, None] * d[:, None], sight.pose, sight.n))
    return np.asarray(extent[:, 1] <= limit**2 * extent[:, 2])


def _no_pose(measured: PointSet, known: Target | None, refused: dict[int, str] | None = None) -> str:
    """Describe why there is no pose at all, and what to do."""
    most = int(np.unique(measured.row, return_counts=True)[1].max())
    if most == 1:
        return (
            "One point per pose gives no pose: a point has no rotation. Measure at least three points of the target "
            f"that are not in a line, in every pose ({PAGE}, single points)."
        )
    if known is None and len(measured.rows) == 1 and most >= FEWEST:
        return (
            "One pose alone says nothing of the shape of the target. Give the target (--target target.csv), or more "
            "poses."
        )
    if refused and "inconsistent" in refused.values():
        return (
            "The points of no pose fit the target. Check that the same point has the same name in both, the units "
            f"(--target-units) and the signs of the axes ({PAGE})."
        )
    few = f"at most {most} points per pose" if most < FEWEST else "points in a line, or that one pose alone has"
    return (
        f"No pose can be computed: expected at least three points that are not in a line in every pose, got {few}. "
        f"Measure more points of the target ({PAGE})."
    )
