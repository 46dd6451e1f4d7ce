"""The function `poses_from_points`: poses of a target and their covariance from points in the frame of the camera."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.geometry.se3 import Array
from ...core.limits import MAX_LISTED
from ...errors import InputError
from ...findings import Finding, warn
from ..camera.adjustment.setting import Known
from ..camera.given_intrinsics import GivenIntrinsics, with_default_deviations
from ..errors.joint_covariance import JointCovariance
from .checks import noise_findings, require_scale, target_findings
from .closed_form import consensus, placed, sums
from .depth_intrinsics import with_intrinsics
from .least_squares import Fit, Matches, given_variances
from .measured import PointSet, Target
from .outliers import MIN_POINTS_PER_POSE, fit_without_outliers
from .result import PointPoses

PAGE = "docs/how-to/points.md"
# Points whose second extent is below this share of the first lie in a line, for any noise that such points have.
MIN_WIDTH_SHARE = 1e-2
# A rotation about the line of the points that is less certain than this is not determined.
MAX_FITTED_ROTATION_SD_RAD = 0.2
# Degrees of freedom that each estimated variance needs: its standard deviation is then known to a quarter.
MIN_NOISE_DOF = 10.0


def poses_from_points(
    points: PointSet | ArrayLike,
    target: Target | Mapping[str, ArrayLike] | ArrayLike,
    noise: str | ArrayLike | None = None,
    *,
    intrinsics: Known | None = None,
    exact: bool = False,
) -> PointPoses:
    """Poses ``camera_T_target`` and their covariance, from the points of a target measured in 3-D.

    Model: ``y_ij = R_i p_j + t_i + e_ij``, e_ij Gaussian with one standard deviation across the line of sight (lateral)
    and another along it (axial); see `points.least_squares`. Least squares with outlier rejection; the covariance to
    first order in the noise.

    Parameters
    ----------
    points : PointSet, or array (n, m, 3)
        Points in the frame of the camera, m (`read_points`). In an array, NaN marks points that were not seen. A pose
        needs three points that are not in a line.
    target : Target, {name: (x, y, z)} or array (m, 3)
        Points in the frame of the target, m, taken as exact: from a drawing or a measurement of the target.
    noise : None, text or (lateral, axial)
        ``"0.1mm,0.5mm"`` or numbers in m: lateral and axial as given; a single one is both. None: both follow from the
        residuals of all poses, as the same at all distances.
    intrinsics : {name: value or (value, standard deviation)} or None
        fx, fy, cx and cy (px) of the depth camera that made the points: their errors move all poses alike. A value
        without a deviation has 0.1 % of the focal length or 0.001 focal lengths of the centre; the points test each.
        None: points of a tracker, or of a camera without errors of its intrinsics.
    exact : bool
        The `intrinsics` have no error.

    Returns
    -------
    PointPoses

    Raises
    ------
    InputError
        Points, target or noise that make no sense; points that determine no pose; too few residuals for the noise.
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
    phi = given_variances(noise)
    known = Target.of(target)
    measured = _as_named(PointSet.of(points), known)
    findings: list[Finding] = []
    point = known.find(measured.point)
    if not (point >= 0).any():
        found_names, named = (", ".join(names[:5].tolist()) for names in (np.unique(measured.point), known.names))
        raise InputError(
            f"None of the points ({found_names}, ...) is named in the target ({named}, ...). "
            "Give the same point the same name in both."
        )
    if unknown := np.unique(measured.point[point < 0]).tolist():
        findings.append(Finding("points.not_in_target", "caution", {"points": unknown}))
    usable, refused = _usable(measured, point, known)
    while True:
        if not usable.any():
            raise InputError(_no_pose(measured, refused))
        index = np.flatnonzero(usable)
        rows, pose = np.unique(measured.row[index], return_inverse=True)
        matches = Matches(measured.xyz[index], known.xyz[point[index]], pose, len(rows))
        start = consensus(*matches)
        require_scale(matches, start)
        found, used = fit_without_outliers(matches, start, phi)
        bad = _undetermined(found, matches, used)
        if not bad.any():
            break
        out = np.bincount(pose[~used], minlength=len(rows)) > 0
        refused |= {int(rows[i]): "inconsistent" if out[i] else "in line" for i in np.flatnonzero(bad)}
        usable &= ~np.isin(measured.row, rows[bad])
    if phi is None and found.dof.min() < MIN_NOISE_DOF:
        raise InputError(
            f"{int(used.sum())} points leave {found.dof[0]:.0f} degrees of freedom for the noise across and "
            f"{found.dof[1]:.0f} for that along the line of sight, and each needs {MIN_NOISE_DOF:.0f}. Give it: "
            'noise="0.1mm,0.5mm" (--noise 0.1mm,0.5mm, lateral and axial); or measure more than three points per pose.'
        )
    for why in sorted(set(refused.values())):
        poses = sorted(row for row, reason in refused.items() if reason == why)
        findings.append(Finding("points.poses_left_out", "caution", {"poses": poses, "why": why}))
    whole = np.zeros(len(measured), dtype=bool)
    whole[index] = used
    residuals = np.full((len(measured), 3), np.nan)
    residuals[index] = matches.y - placed(found.T, matches.p, pose)
    if not used.all():
        findings.append(_left_out(measured, index[~used], residuals, len(index)))
    findings += target_findings(found, point[index][used], known.names)
    if phi is not None:
        findings += noise_findings(found)
    covariance = JointCovariance(found.covariance, np.zeros((len(rows), 6, 0)))
    if intrinsics is not None:
        known_numbers = intrinsics if not exact else {name: np.ravel(value)[0] for name, value in intrinsics.items()}
        given = GivenIntrinsics.of(known_numbers if exact else with_default_deviations(known_numbers), exact)
        covariance, about_given = with_intrinsics(found, given)
        findings += about_given
    warn(findings)
    return PointPoses(
        poses=found.T,
        rows=rows,
        covariance=covariance,
        target=known,
        sd=np.sqrt(found.phi),
        dof=found.dof,
        noise_given=phi is not None,
        points=measured,
        residuals=residuals,
        used=whole,
        refused=tuple(sorted(refused.items())),
        findings=tuple(findings),
    )


def _left_out(measured: PointSet, out: NDArray[np.intp], residuals: Array, n: int) -> Finding:
    """Finding of the points that were left out of ``n``, by their numbers; the farthest are listed."""
    listed = [
        {"pose": int(measured.row[k]), "point": str(measured.point[k]), "distance": float(np.linalg.norm(residuals[k]))}
        for k in out[np.argsort(-np.linalg.norm(residuals[out], axis=1), kind="stable")][:MAX_LISTED]
    ]
    return Finding("points.left_out", "caution", {"count": len(out), "n": n, "far_points": listed})


def _as_named(measured: PointSet, known: Target) -> PointSet:
    """Return the points by their names in the target where these differ in small and capital letters only."""
    names = known.names.tolist()
    by_letters = {str(name).casefold(): name for name in names}
    seen = np.unique(measured.point).tolist()
    if set(seen) & set(names) or len(by_letters) < len(names) or len({name.casefold() for name in seen}) < len(seen):
        return measured
    renamed = [by_letters.get(str(name).casefold(), name) for name in measured.point]
    return PointSet(measured.row, np.array(renamed), measured.xyz)


def _usable(measured: PointSet, point: NDArray[np.intp], known: Target) -> tuple[NDArray[np.bool_], dict[int, str]]:
    """Points of poses that three points that are not in a line determine; the other poses with the reason."""
    rows, pose = np.unique(measured.row, return_inverse=True)
    usable = point >= 0
    matches = Matches(measured.xyz[usable], known.xyz[point[usable]], pose[usable], len(rows))
    few = np.bincount(matches.pose, minlength=len(rows)) < MIN_POINTS_PER_POSE
    bad = few | _in_line(matches.y, matches) | _in_line(matches.p, matches)
    return usable & ~bad[pose], {int(rows[i]): "few points" if few[i] else "in line" for i in np.flatnonzero(bad)}


def _undetermined(found: Fit, matches: Matches, used: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(n,) whether the points that were used do not determine a pose."""
    few = np.bincount(matches.pose[used], minlength=matches.n) < MIN_POINTS_PER_POSE
    sd = np.sqrt(np.linalg.eigvalsh(found.covariance[:, :3, :3])[:, -1])
    kept = matches.where(used)
    return np.asarray(few | (sd > MAX_FITTED_ROTATION_SD_RAD) | _in_line(kept.p, kept))


def _in_line(points: Array, matches: Matches) -> NDArray[np.bool_]:
    """(n,) whether the points (k, 3) of each pose lie in a line."""
    count = np.maximum(np.bincount(matches.pose, minlength=matches.n), 1)[:, None]
    d = points - (sums(points, matches.pose, matches.n) / count)[matches.pose]
    extent = np.linalg.eigvalsh(sums(d[:, :, None] * d[:, None], matches.pose, matches.n))
    return np.asarray(extent[:, 1] <= MIN_WIDTH_SHARE**2 * extent[:, 2])


def _no_pose(measured: PointSet, refused: dict[int, str]) -> str:
    """Describe why there is no pose at all, and what to do."""
    most = int(np.unique(measured.row, return_counts=True)[1].max())
    if most == 1:
        return (
            "One point per pose gives no pose: a point has no rotation. Measure at least three points of the target "
            f"that are not in a line, in every pose ({PAGE}, single points)."
        )
    if "inconsistent" in refused.values():
        return (
            "The points of no pose fit the target. Check that the same point has the same name in both, the units "
            f"(--target-units) and the signs of the axes ({PAGE})."
        )
    few = f"at most {most} points per pose" if most < MIN_POINTS_PER_POSE else "points in a line"
    return (
        f"No pose can be computed: expected at least three points that are not in a line in every pose, got {few}. "
        f"Measure more points of the target ({PAGE})."
    )
