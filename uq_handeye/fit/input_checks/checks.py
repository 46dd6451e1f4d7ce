"""Checks whether the input looks like a hand-eye data set, with warnings that say why not and what to try.

Nothing here changes a result. Each ``check_`` returns findings, which `calibrate` gives as `InputWarning` and keeps in
the result; `require_signal` refuses data whose X would be an accident of the noise.

The residuals of poses are those of ``W_k = G_k X C_k``, which is the same for every k without noise (robot-world
constancy; G inverted for eye-to-hand): a rotation and a translation per pose, so that a bad row has a name.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...core.geometry.se3 import Array, inverse, vee
from ...errors import DegenerateMotionError
from ...findings import GROSS_EXCESS, Finding, Severity
from ...methods.procrustes.degeneracy import MIN_SPREAD_RATIO, infinite_directions
from ...model.noise.models import Noise, PoseNoise, is_joint, marginals
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.residuals import median, pose_residuals, rotation_angles
from ...model.poses.target_views import STEADY_VIEW, direction_spread
from ..likelihood.constraint import Constraint, OnMotions, OnPoses, covariances_of, of_motions
from .misread_files import EXACT, LARGE_ROTATION, inverted_on_request, other_readings, scaled_reading
from .readings import OTHER_SETUP
from .shifted_rows import rows_again, said_again

# Robot and camera see the same rotation angle; beyond this RMS difference (rad) the rows are not the same moments,
# unless the noise explains it.
ANGLE_DISAGREEMENT = np.radians(2.5)
# ... but noise may be the cause where it is below this share of what rows give that have nothing to do with each other.
RELATED = 0.15
# Translation residual, as a share of the robot's travel, beyond which another reading of the files is looked for; the
# rotation residual is LARGE_ROTATION.
LARGE_TRANSLATION = 0.1
# Translation residual, as a share of the robot's travel, from which on a wrong scale of one file would show.
SCALE_SHOWS = 0.01
# Sizes of the target, as multiples of the one given, that an estimate of the size makes good.
ESTIMATED_SIZES = (0.8, 1.25)
# Below this spread of the rotation axes, rotation about and translation along them are hardly determined.
AXIS_SPREAD = np.radians(5.0)
SMALL_ANGLE = np.radians(5.0)
NEAR_HALF_TURN = np.radians(150.0)
# The rotations must stand out of their noise by this factor, or X is an accident of the noise.
SIGNAL_TO_NOISE = 4.0
# Rotations whose sum of squared sines across the main axis stays below this are suspected of being noise.
POOR = 0.03
# Farther from its base than any arm reaches, in metres.
FAR = 20.0
# Rigs whose longest translation (m) is below these are unusually small, and none at all.
TINY, NO_RIG = 0.02, 2e-3
# Single rows that are so far and are named.
MOST_ROWS = 5
# Numbers above this are millimetres: in centimetres they would be farther than most arms reach.
IN_MILLIMETRES = 250.0
# What sits farther from the gripper than this, and than the fixed part from the base, is unusual (m).
LONG_BRACKET = 0.4
# ... what few grippers carry, and a fixed camera is farther from the base;
UNLIKELY_BRACKET = 0.7
# ... and what no gripper carries.
IMPOSSIBLE_BRACKET = 1.0
# A pose whose residual exceeds the median by this factor is no chance: Gaussian noise reaches 3 in 1000 poses.
OUTLIER = 6.0


# ------------------------------------------------------------------------------------ what the columns look like


def check_poses(poses: PosePairs) -> list[Finding]:
    """Units, constant and equal columns and repeated rows of the pose lists; the same list given twice."""
    found: list[Finding] = []

    def note(what: str, **values: object) -> None:
        found.append(Finding(f"input_checks.{what}", "caution", values))

    if again := rows_again(poses):
        found.append(said_again(again, poses.n))
    new = np.setdiff1d(np.arange(1, poses.n), [row for row, _ in again])
    for name, T in (("robot", poses.robot), ("camera", poses.camera)):
        t = T[:, :3, 3]
        far = float(np.abs(t).max())
        if far > FAR:
            from_corners = name == "camera" and poses.camera_calibration is not None
            rows = np.flatnonzero(np.abs(t).max(axis=1) > FAR)
            few = {"rows": rows[:MOST_ROWS].tolist()} if 2 * len(rows) <= len(t) else {}
            unit = "mm" if far > IN_MILLIMETRES else "cm"
            note("far", file=name, reach=far, unit=unit, from_corners=from_corners, **few)
        span = np.ptp(t, axis=0)
        if len(t) > 2 and float(np.ptp(T, axis=0).max()) <= 1e-9 * max(far, 1e-3):
            found.append(Finding("input_checks.still", "failure", {"file": name, "n": len(t)}))
            continue
        for axis in range(3):
            if len(t) > 1 and span[axis] <= 1e-9 * max(far, 1e-3):
                note("constant_column", file=name, column="xyz"[axis], value=t[0, axis] + 0.0)
        for a, b in ((0, 1), (0, 2), (1, 2)):
            if len(t) > 2 and span[a] > 1e-9 * max(far, 1e-3) and np.array_equal(t[:, a], t[:, b]):
                note("identical_columns", file=name, columns=["xyz"[a], "xyz"[b]], n=len(t))
        if same := int((T[new] == T[new - 1]).all(axis=(1, 2)).sum()):
            note("repeated_rows", file=name, count=same, n=len(T))
    reach = max(float(np.abs(T[:, :3, 3]).max(initial=0.0)) for T in (poses.robot, poses.camera))
    if 0.0 < reach < TINY and poses.truth is None:
        found.append(Finding("input_checks.tiny", "failure" if reach < NO_RIG else "caution", {"reach": reach}))
    if np.array_equal(poses.robot, poses.camera):
        found.append(Finding("input_checks.same_file", "failure"))
    return found


# --------------------------------------------------------------------------------- what the rotations look like


def check_rotations(motions: Motions, noise: Noise | None, method: str) -> list[Finding]:
    """Angles of robot against camera, half turns, small angles, spread of the rotation axes."""
    found = []
    R_A, R_B = motions.A[..., :3, :3], motions.B[..., :3, :3]
    angle, angle_B = rotation_angles(R_A), rotation_angles(R_B)
    difference = np.abs(angle - angle_B)
    rms = float(np.sqrt(np.mean(difference**2)))
    # one of the three axes of the noise changes the angle
    explained = 0.0 if noise is None else np.sqrt(_rotation_variance(motions, noise) / 3.0)
    if rms > max(ANGLE_DISAGREEMENT, 2.0 * explained):
        worst = int(np.argmax(difference))
        few = median(difference) < 0.25 * ANGLE_DISAGREEMENT
        by_chance = float(np.hypot(np.std(angle), np.std(angle_B)))  # of rows that have nothing to do with each other
        values = {"rms": rms, "largest": difference[worst], "where": _pair(motions, worst), "few": few}
        if noisy := rms < RELATED * by_chance and not few:
            values["noisy"] = True
        found.append(Finding("input_checks.angles_disagree", "caution" if few or noisy else "failure", values))
    half = float(np.mean(angle > NEAR_HALF_TURN))
    if half > 0.25 and method == "4dpa":
        found.append(Finding("input_checks.half_turns", "caution", {"share": half}))
    largest = float(angle.max(initial=0.0))
    if largest < SMALL_ANGLE:
        found.append(Finding("input_checks.small_rotations", "caution", {"largest": largest}))
    spread, axis = _axis_spread(R_A)
    if spread[2] > 0 and spread[0] + spread[1] < np.sin(AXIS_SPREAD) ** 2 * spread[2]:
        within = np.sqrt(max(spread[0] + spread[1], 0.0) / spread[2])
        found.append(Finding("input_checks.parallel_axes", "caution", {"axis": axis, "within": within}))
    return found


def require_signal(motions: Motions, noise: Noise | None, angle: Array) -> None:
    """Raise unless the rotations stand out of their noise in two directions.

    4DPA finds R_X from the cross moment ``H / N = sum u v^T / N``, ``u, v = sin(angle) axis`` of robot and camera.
    Noise of variances s_A^2, s_B^2 per axis leaves about ``s_A s_B / sqrt(n)`` in it, n the number of independent
    motions; if the smallest eigenvalue of M / N is not well above that, the axes found are those of the noise
    (parallel axes, half turns, no rotation) and no covariance can tell. The variances are those of the noise given.
    Where the rotations are that poor, and the noise is not given or far below what the median rotation residual
    ``angle`` shows, they are those that it shows.
    """
    spread, axis = _axis_spread(motions.A[..., :3, :3])
    variance = 0.0 if noise is None else _rotation_variance(motions, noise) / 3.0
    shown = (median(angle) / 1.54) ** 2  # 1.54: median length of a Gaussian vector of three standard deviations 1
    given = noise is not None
    if spread[0] + spread[1] < POOR and (noise is None or shown > 9.0 * variance):
        variance, given = shown, False
    independent = motions.N if motions.poses is None else min(motions.N, motions.poses.n - 1)
    u, v = (0.5 * vee(T[..., :3, :3]).T for T in (motions.A, motions.B))
    H = u @ v.T / motions.N
    s = np.linalg.svd(H, compute_uv=False)
    across = float(s[1] + np.sign(np.linalg.det(H)) * s[2])
    level = variance / np.sqrt(independent)
    if across > SIGNAL_TO_NOISE * level:
        return
    if given and variance > 9.0 * shown:
        raise DegenerateMotionError(
            f"The noise given hides the motions: {np.degrees(np.sqrt(variance)):.3g} degrees per axis of a motion, "
            f"where the residuals show {np.degrees(np.sqrt(shown)):.2g}. Check its units (numbers are rad and m, or "
            'write "0.1deg"), or leave it out: it is then estimated.',
            infinite_directions(axis[None]),
        )
    raise DegenerateMotionError(
        f"The motions do not determine X: across their main rotation axis, ({', '.join(f'{x:.3f}' for x in axis)}) in "
        f"the frame of `A`, the mean of sin(angle)^2 is {across:.2g}, and noise by itself gives {level:.2g}. The "
        "rotation of X about this axis and its translation along it would be accidents of the noise. Rotate about "
        "other axes, by 30 to 150 degrees, and check that the rows of the two files belong together.",
        infinite_directions(axis[None]),
    )


def _axis_spread(R: Array) -> tuple[Array, Array]:
    """Eigenvalues of ``sum u u^T / N``, ascending, and the main axis; below rounding they are 0."""
    u = 0.5 * vee(R).T  # sin(angle) axis, as columns
    values, vectors = np.linalg.eigh(u @ u.T / max(1, u.shape[1]))
    axis = vectors[:, 2] if vectors[np.argmax(np.abs(vectors[:, 2])), 2] > 0 else -vectors[:, 2]
    return np.where(values > MIN_SPREAD_RATIO * values[2], values, 0.0), np.round(axis, 12) + 0.0


def _rotation_variance(motions: Motions, noise: Noise) -> float:
    """Mean square of the rotation residual of a pair that the noise explains (rad^2).

    To first order it is ``theta_A - R_X theta_B``, and theta of a motion is the difference of those of its two
    poses (up to rotations): the traces add.
    """
    sides = [np.trace(marginals(S)[..., :3, :3], axis1=-2, axis2=-1) for S in covariances_of(noise) if S is not None]
    if of_motions(noise):
        return float(sum(np.mean(side) for side in sides))
    if motions.pairs is None or motions.poses is None:
        return 0.0  # PoseNoise without poses: propagate() refuses it
    traces = np.zeros(motions.poses.n) + sum(sides, np.zeros(()))
    return float(np.mean(traces[motions.pairs].sum(axis=1)))


# ------------------------------------------------------------------------------------------ how well X fits them


def check_fit(
    poses: PosePairs,
    X: Array,
    noise: PoseNoise | None,
    covariance: Array | None,
    own: PoseNoise | None = None,
    size: float = 1.0,
    sure: bool = True,
    judged: bool = False,
) -> list[Finding]:
    """Residuals of the poses against their noise and each other; if they are large, which other reading would fit.

    ``size``: of the target, estimated, as a multiple of the one given. Within `ESTIMATED_SIZES` the camera poses are
    taken with it, as X is: the size is then a finding of its own. What is farther off is misread.

    ``sure``: it is all but certain (99 %) that the target has another size. Else a factor that is no unit refuses
    nothing.

    ``judged``: the fit has judged each pose, by all that it knows of the errors (`robust`). Single poses are then its
    to name, unless all of them together fit badly.

    ``own`` is noise that was estimated in units of a covariance of each pose: it explains the residuals as a whole, and
    says how they differ.
    """
    if size != 1.0 and ESTIMATED_SIZES[0] < size < ESTIMATED_SIZES[1]:
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
    disagreement = float(np.sqrt(np.mean((_turns(G) - _turns(C)) ** 2)))
    turned = turn > max(LARGE_ROTATION, 4.0 * disagreement, 3.0 * _rms(most, 0))
    shifted = shift > max(LARGE_TRANSLATION * travel, 0.02 * reach, 3.0 * _rms(most, 1), 1e-9)
    misfit = turned or (shifted and disagreement < 2 * ANGLE_DISAGREEMENT)
    # Outliers are few, so the median pose is good; a wrong reading of the files spoils all of them.
    most_fit = median(angle) < LARGE_ROTATION and median(distance) < max(LARGE_TRANSLATION * travel, 0.02 * reach)
    each = most
    if most is None and own is not None and covariance is not None:
        each = _explained(constraint, X, own, covariance)[1]
    outliers = _outliers("pose", angle, distance, travel + reach, each) if most_fit else []
    if misfit and not outliers:
        values = {"rotation": turn, "translation": shift, "readings": other_readings(poses, turn, shift)}
        return [*found, Finding("input_checks.poses_unexplained", "failure", values)]
    shows = max(SCALE_SHOWS * travel, 0.005 * reach, 3.0 * _rms(most, 1), 1e-9)
    typical = median(distance) if outliers else shift
    scaled = scaled_reading(G, C, shift, poses.sources) if typical > shows else None
    if scaled is not None and (sure or not scaled.get("target")):
        return [*found, Finding("input_checks.wrong_scale", "failure", {"reading": scaled}), *outliers]
    outliers = [] if judged and not misfit else outliers
    S = np.eye(3) if covariance is None else covariance[3:, 3:]
    known = float(np.linalg.eigvalsh(S)[0]) > 1e-9 * float(np.trace(S))  # else X is one of many, and has no length
    return [*found, *outliers, *(_check_lengths(poses, X) if known else [])]


def misread(poses: PosePairs, X: Array) -> list[Finding]:
    """Return the readings of the two files that all poses fit, where those that fit X are no majority to rely on."""
    G = poses.effective_robot
    turn, shift = (float(np.sqrt(np.mean(part**2))) for part in pose_residuals(G, poses.camera, X))
    readings = [one for one in other_readings(poses, turn, shift) if one["kind"] != "scale"]
    values = {"rotation": turn, "translation": shift, "readings": readings}
    return [Finding("input_checks.poses_unexplained", "failure", values)] if readings else []


def _rms(squares: Array | None, k: int) -> float:
    return 0.0 if squares is None else float(np.sqrt(np.mean(squares[k])))


def _turns(T: Array) -> Array:
    """Rotation angles from each pose to the next."""
    return rotation_angles(T[:-1, :3, :3].mT @ T[1:, :3, :3])


def _against_noise(what: str, n: int, rows: tuple[Array, Array], least: Array | None, most: Array) -> list[Finding]:
    """RMS rotation and translation residuals of n things against the mean squares that the noise explains.

    ``most`` counts what the error of X adds in full, though the residuals share part of it; ``least`` leaves it
    out, and is None where errors are common to all and leave no trace in the residuals.
    """
    low, high = _chance(3 * n - 3)
    found = []
    for k, part in enumerate(("rotation", "translation")):
        rms, expected = float(np.sqrt(np.mean(rows[k] ** 2))), float(np.sqrt(np.mean(most[k])))
        if rms > 1.3 * high * expected and rms > EXACT:
            values = {"what": what, "part": part, "rms": rms, "expected": expected}
            severity: Severity = "failure" if rms > GROSS_EXCESS * expected else "caution"
            found.append(Finding("input_checks.noise_too_small", severity, values))
        elif least is not None and EXACT < rms < min(low, 1 / 3) * (floor := float(np.sqrt(np.mean(least[k])))):
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
    for k, (residual, least) in enumerate(((angle, EXACT), (distance, EXACT * size))):
        unit = np.ones(n) if explained is None else np.sqrt(np.maximum(explained[k], least**2))
        relative = np.where(residual > least, residual, 0.0) / unit
        typical = max(median(relative), least / float(unit.max()))
        if typical > 0:
            far = np.maximum(far, relative / typical)
    rows = np.flatnonzero(far > OUTLIER * (1.0 + 4.0 / n))
    if not rows.size:
        return []
    rows = rows[np.argsort(-far[rows])]
    values: dict[str, Any] = {
        "what": what,
        "count": rows.size,
        "n": n,
        "rotation": median(angle),
        "translation": median(distance),
        "worst": [{"row": int(k), "rotation": angle[k], "translation": distance[k]} for k in rows[:5]],
    }
    if explained is not None:  # a small residual may be large beside the noise of its pose
        for worst, row in zip(values["worst"], rows, strict=False):
            worst["times"] = far[row]
    return [Finding("input_checks.outliers", "caution", values)]


def _check_lengths(poses: PosePairs, X: Array) -> list[Finding]:
    """Report a sensor bracket that is longer than the arm, and another reading of the files by which it is not.

    Two lists in the wrong place fit ``G X C = W`` exactly, with X and W exchanged: both inverse, ``inv(G) W inv(C) =
    X``; or swapped, ``C inv(W) G = inv(X)``, where G is the robot's own list (eye-in-hand; eye-to-hand it gives inv(X)
    for X, of the same length). Lengths alone cannot tell a long bracket from that. But a camera looks at its target:
    where the list read as camera poses shows the target in nearly the same direction throughout, and what would be the
    camera poses by the other reading does not, the files are as they should be; then it is the other setup, with the
    robot poses inverted, that gives the same matrix X its other name.
    """
    said = all(finding.values.get("said", True) for finding in poses.findings)  # the setup
    if inverted_on_request(poses) == ["camera"] and not said:
        seen, as_given = (direction_spread(T) for T in (poses.camera, inverse(poses.camera)))
        if as_given < STEADY_VIEW * seen:
            values = {"setup": OTHER_SETUP[poses.setup], "seen": seen, "as_given": as_given}
            return [Finding("input_checks.setup_not_said", "caution", values)]
    W = poses.effective_robot @ X @ poses.camera
    long_X = float(np.linalg.norm(X[:3, 3]))
    long_W = float(np.linalg.norm(np.median(W[:, :3, 3], axis=0)))  # whatever single rows are in another unit
    in_hand = poses.setup == "eye-in-hand"
    on_gripper, fixed = (long_X, long_W) if in_hand else (long_W, long_X)
    if on_gripper < LONG_BRACKET or on_gripper < 2.0 * fixed:
        return []
    others = [inverse(poses.camera), poses.robot] if in_hand else [inverse(poses.camera)]
    what = "camera" if in_hand else "target"
    longer = on_gripper > 3.0 * fixed
    if direction_spread(poses.camera) < STEADY_VIEW * min(direction_spread(T) for T in others):
        values = {
            "what": what,
            "length": on_gripper,
            "fixed": fixed,
            "setup": OTHER_SETUP[poses.setup],
            "inverted": "robot" in inverted_on_request(poses),
        }
        found = [Finding("input_checks.setup_by_lengths", "caution", values)]
        return found if longer and on_gripper > UNLIKELY_BRACKET else []
    severity: Severity = "failure" if longer and on_gripper > IMPOSSIBLE_BRACKET else "caution"
    return [Finding("input_checks.long_bracket", severity, {"what": what, "length": on_gripper, "fixed": fixed})]


def check_motions(
    motions: Motions, noise: Noise | None, covariance: Array | None, angle: Array, distance: Array, X: Array
) -> list[Finding]:
    """Residuals (N,) of motions that come without poses: against the noise, their size and each other."""
    found: list[Finding] = []
    A, most = motions.A, None
    if noise is not None and covariance is not None:
        least, most = _explained(OnMotions(A, motions.B), X, noise, covariance)
        found = _against_noise("motions", motions.N, (angle, distance), least, most)
    travel = float(np.sqrt(3.0 * np.mean(A[:, :3, 3] ** 2)))
    turn, shift = float(np.sqrt(np.mean(angle**2))), float(np.sqrt(np.mean(distance**2)))
    if turn > max(LARGE_ROTATION, 3.0 * _rms(most, 0)) or shift > max(LARGE_TRANSLATION * travel, 3.0 * _rms(most, 1)):
        values = {"rotation": turn, "translation": shift}
        found.append(Finding("input_checks.motions_unexplained", "failure", values))
    return found + _outliers("motion", angle, distance, travel, most)


def _pair(motions: Motions, k: int) -> str:
    if motions.pairs is None:
        return f"motion {k}"
    i, j = motions.pairs[k]
    return f"poses {i} and {j}"
