"""Checks of the residuals of X: against their noise, against each other, and for another reading of the two files.

The residuals of poses are those of ``W_k = G_k X C_k``, which is the same for every k without noise (G inverted for
eye-to-hand): a rotation and a translation for each pose, so that a bad row can be named.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...core.geometry.se3 import Array
from ...core.limits import MAJORITY, OUTLIER_MEDIANS
from ...findings import GROSS_EXCESS, Finding, Severity
from ...model.errors.models import Noise, PoseNoise, is_joint, marginals
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.residuals import median, pose_residuals
from ..graph.constraint import Constraint, OnMotions, OnPoses, covariances_of
from .agreement import angles_between, typical_difference
from .camera_views import check_views
from .consistency import LARGE_ROTATION_RAD
from .lengths import check_lengths
from .misread_axes import misread_axes
from .misread_files import NOISE_FREE, other_readings
from .misread_scale import scaled_reading
from .rotations import ANGLE_DISAGREEMENT_RAD, MAX_NOISE_SHARE

# Translation residual, as a share of the robot's travel, beyond which another reading of the files is tried. From a
# tenth of it on, a wrong scale of one file shows. The rotation residual is LARGE_ROTATION_RAD.
LARGE_TRANSLATION_SHARE = 0.1
# Large residuals of estimated noise are that noise if they are below these shares of those of unrelated rows (rotation,
# translation). A target that stays in view makes the translations of unrelated rows alike.
MAX_SHARES_OF_CHANCE = np.array([MAX_NOISE_SHARE, 0.7])
# An estimated size of the target is taken up to this ratio to the given one, either way.
MAX_TARGET_RATIO = 1.25


def check_fit(
    poses: PosePairs,
    X: Array,
    noise: PoseNoise | None,
    covariance: Array | None,
    own: PoseNoise | None = None,
    size: float = 1.0,
    sure: bool = True,
    judged: bool = False,
    any_scale: bool = False,
) -> list[Finding]:
    """Check the residuals of poses against their noise and each other; where they are large, look for other readings.

    ``size``: of the target, estimated, as a multiple of the one given. Within `MAX_TARGET_RATIO` the camera poses are
    taken with it, as X is: the size is then a finding of its own. What is farther off is misread.

    ``sure``: it is all but certain (99 %) that the target has another size. Else a factor that is no unit refuses
    nothing.

    ``judged``: the fit has judged each pose, by all that it knows of the errors (`robust`). Single poses are then its
    to name, unless all of them together fit badly.

    ``any_scale``: the camera poses have a scale of their own, which X is estimated with.

    ``own`` is noise that was estimated in units of a covariance of each pose: it explains the residuals as a whole, and
    says how they differ.
    """
    if size != 1.0 and 1 / MAX_TARGET_RATIO < size < MAX_TARGET_RATIO:
        camera = poses.camera.copy()
        camera[:, :3, 3] *= size
        poses = replace(poses, camera=camera, camera_calibration=None)
    G, C = poses.effective_robot, poses.camera
    constraint = OnPoses(poses.robot, C, poses.setup == "eye-to-hand")
    angle, distance = pose_residuals(G, C, X)
    travel = float(np.sqrt(np.mean(np.sum((G[:, :3, 3] - G[:, :3, 3].mean(axis=0)) ** 2, axis=1))))
    reach = float(np.sqrt(np.mean(np.sum(C[:, :3, 3] ** 2, axis=1))))
    turn, shift = float(np.sqrt(np.mean(angle**2))), float(np.sqrt(np.mean(distance**2)))
    found: list[Finding] = []
    most = None
    if noise is not None and covariance is not None:
        least, most = _explained(constraint, X, noise, covariance)
        joint = any(S is not None and is_joint(S) for S in (noise.robot, noise.camera))
        found = _against_noise("poses", poses.n - 1, (angle, distance), None if joint else least, most)
    # Noise turns about all three axes and so makes the residual sqrt(3) times the difference of the angles, which a
    # wrong frame leaves as it is; but where the rows do not belong together, no other reading helps.
    disagreement = typical_difference(angles_between(G[:, :3, :3]), angles_between(C[:, :3, :3]))
    turned = turn > max(LARGE_ROTATION_RAD, 4.0 * disagreement, 3.0 * _rms(most, 0))
    shifted = shift > max(LARGE_TRANSLATION_SHARE * travel, 0.02 * reach, 3.0 * _rms(most, 1), 1e-9)
    misfit = turned or (shifted and disagreement < 2 * ANGLE_DISAGREEMENT_RAD)
    # Outliers are few, so the median pose is good; a wrong reading of the files spoils all of them.
    most_fit = median(angle) < LARGE_ROTATION_RAD and median(distance) < max(
        LARGE_TRANSLATION_SHARE * travel, 0.02 * reach
    )
    each = most
    if most is None and own is not None and covariance is not None:
        each = _explained(constraint, X, own, covariance)[1]
    outliers = _outliers("pose", angle, distance, travel + reach, each) if most_fit else []
    if misfit and not outliers:
        readings = other_readings(poses, turn, shift, any_scale)
        if (axes := misread_axes(poses)) is not None:
            readings = [axes, *(one for one in readings if one["kind"] != "scale")]
        values = {"rotation": turn, "translation": shift, "readings": readings}
        # the fit found their noise: it is large, and X is as uncertain as it says
        below_chance = bool((np.array([turn, shift]) < MAX_SHARES_OF_CHANCE * _by_chance(G, C, X)).all())
        as_noise = judged and noise is None and below_chance
        if readings or not as_noise:
            return [*found, Finding("input_checks.poses_unexplained", "failure", values)]
    shows = max(LARGE_TRANSLATION_SHARE / 10 * travel, 0.005 * reach, 3.0 * _rms(most, 1), 1e-9)
    typical = median(distance) if outliers else shift
    scaled = scaled_reading(G, C, shift, poses.sources) if typical > shows and not any_scale else None
    if scaled is not None and (sure or not scaled.get("target")):
        return [*found, Finding("input_checks.wrong_scale", "failure", {"reading": scaled}), *outliers]
    outliers = [] if judged and not misfit else outliers
    S = np.eye(3) if covariance is None else covariance[3:, 3:]
    if (axes := misread_axes(poses)) is not None:
        severity: Severity = "caution" if "scaled" in axes or "sheared" in axes else "failure"
        return [*found, Finding("input_checks.misread_axes", severity, {"reading": axes}), *outliers]
    known = float(np.linalg.eigvalsh(S)[0]) > 1e-9 * float(np.trace(S))  # else X is one of many, and has no length
    return [*found, *outliers, *([*check_lengths(poses, X), *check_views(poses, X)] if known else [])]


def misread(poses: PosePairs, X: Array, minority: bool = False) -> list[Finding]:
    """Return the readings of the two files that all poses fit, where those that fit X are no majority to rely on.

    ``minority``: fewer than half fit X. Only then is another unit a reading: a good X leaves no factor to explain.
    """
    # by the majority, as the readings are: rows that are left out may be anything
    count = int(np.ceil(MAJORITY * poses.n))
    parts = (np.sort(part)[:count] for part in pose_residuals(poses.effective_robot, poses.camera, X))
    turn, shift = (float(np.sqrt(np.mean(part**2))) for part in parts)
    readings = [one for one in other_readings(poses, turn, shift) if minority or one["kind"] != "scale"]
    values = {"rotation": turn, "translation": shift, "readings": readings}
    return [Finding("input_checks.poses_unexplained", "failure", values)] if readings else []


def _by_chance(G: Array, C: Array, X: Array) -> Array:
    """(2,) RMS residuals of rotation and translation of rows that have nothing to do with each other."""
    n = len(C)
    rolled = [pose_residuals(G, np.roll(C, n // k, axis=0), X) for k in (2, 3)]
    return np.asarray(np.sqrt(np.mean(np.square(rolled), axis=(0, 2))))


def _rms(squares: Array | None, k: int) -> float:
    return 0.0 if squares is None else float(np.sqrt(np.mean(squares[k])))


def _against_noise(what: str, n: int, rows: tuple[Array, Array], least: Array | None, most: Array) -> list[Finding]:
    """RMS rotation and translation residuals of n things against the mean squares that the noise explains.

    ``most`` counts what the error of X adds in full, though the residuals share part of it; ``least`` leaves it
    out, and is None where errors are common to all and leave no trace in the residuals.
    """
    low, high = _chance(3 * n - 3)
    found = []
    for k, part in enumerate(("rotation", "translation")):
        rms, expected = float(np.sqrt(np.mean(rows[k] ** 2))), float(np.sqrt(np.mean(most[k])))
        if rms > 1.3 * high * expected and rms > NOISE_FREE:
            values = {"what": what, "part": part, "rms": rms, "expected": expected}
            severity: Severity = "failure" if rms > GROSS_EXCESS * expected else "caution"
            found.append(Finding("input_checks.noise_too_small", severity, values))
        elif least is not None and NOISE_FREE < rms < min(low, 1 / 3) * (floor := float(np.sqrt(np.mean(least[k])))):
            values = {"what": what, "part": part, "rms": rms, "expected": floor}
            found.append(Finding("input_checks.noise_too_large", "caution", values))
    return found


def _explained(constraint: Constraint, X: Array, noise: Noise, covariance: Array) -> tuple[Array, Array]:
    """Mean squares (2, n) of the rotation and translation residuals: from the noise, and with the error of X (T5)."""
    linear = constraint.linearise(constraint.complete(X), constraint.first, constraint.second)
    squares = np.zeros((2, constraint.n))
    for D, S in zip(linear.sides, covariances_of(noise), strict=True):
        if S is not None:
            squares += _traces(D @ marginals(S) @ D.mT)
    J = linear.J[..., :6]
    return squares, squares + _traces(J @ covariance @ J.mT)


def _traces(S: Array) -> Array:
    """Traces of the rotation and translation blocks of covariances (n, 6, 6): (2, n)."""
    return np.asarray(np.diagonal(S, axis1=-2, axis2=-1).reshape(-1, 2, 3).sum(axis=2).T)


def _chance(degrees_of_freedom: int) -> tuple[float, float]:
    """Between what ratios a RMS of so many numbers lies but once in 10,000 times (Wilson and Hilferty 1931)."""
    f = 2.0 / (9.0 * max(1, degrees_of_freedom))
    low, high = ((max(1.0 - f + z * np.sqrt(f), 0.0)) ** 1.5 for z in (-3.72, 3.72))
    return float(low), float(high)


def _outliers(what: str, angle: Array, distance: Array, size: float, explained: Array | None) -> list[Finding]:
    """Poses or motions whose residual, in units of what its noise explains, stands out of the others."""
    n = len(angle)
    if n < 6:
        return []  # their mean is not sharp enough to tell
    far = np.zeros(n)
    for k, (residual, least) in enumerate(((angle, NOISE_FREE), (distance, NOISE_FREE * size))):
        unit = np.ones(n) if explained is None else np.sqrt(np.maximum(explained[k], least**2))
        relative = np.where(residual > least, residual, 0.0) / unit
        typical = max(median(relative), least / float(unit.max()))
        if typical > 0:
            far = np.maximum(far, relative / typical)
    rows = np.flatnonzero(far > OUTLIER_MEDIANS * (1.0 + 4.0 / n))
    if not rows.size:
        return []
    rows = rows[np.argsort(-far[rows])]
    worst = [{"row": int(k), "rotation": angle[k], "translation": distance[k]} for k in rows[:5]]
    if explained is not None:  # a small residual may be large for the noise of its pose
        worst = [row | {"times": far[k]} for row, k in zip(worst, rows, strict=False)]
    values = {"what": what, "count": rows.size, "n": n, "rotation": median(angle), "translation": median(distance)}
    return [Finding("input_checks.outliers", "caution", values | {"worst": worst})]


def check_motions(
    motions: Motions, noise: Noise | None, covariance: Array | None, angle: Array, distance: Array, X: Array
) -> list[Finding]:
    """Check the residuals (N,) of motions that come without poses: against the noise, their size and each other."""
    found: list[Finding] = []
    A, most = motions.A, None
    if noise is not None and covariance is not None:
        least, most = _explained(OnMotions(A, motions.B), X, noise, covariance)
        found = _against_noise("motions", motions.N, (angle, distance), least, most)
    travel = float(np.sqrt(3.0 * np.mean(A[:, :3, 3] ** 2)))
    turn, shift = float(np.sqrt(np.mean(angle**2))), float(np.sqrt(np.mean(distance**2)))
    if turn > max(LARGE_ROTATION_RAD, 3.0 * _rms(most, 0)) or shift > max(
        LARGE_TRANSLATION_SHARE * travel, 3.0 * _rms(most, 1)
    ):
        values = {"rotation": turn, "translation": shift}
        found.append(Finding("input_checks.motions_unexplained", "failure", values))
    return found + _outliers("motion", angle, distance, travel, most)
