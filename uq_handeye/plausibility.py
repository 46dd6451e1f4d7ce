"""Does the input look like a hand-eye data set? Residuals of AX = XB and warnings that say why and what to try.

Nothing here changes a result. Each check returns sentences for a person; `calibrate` raises them as
`InputWarning` and keeps them in the result.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .errors import DegenerateMotionError
from .motions import Motions
from .noise import Noise, PairNoise, marginals
from .poses import PosePairs
from .procrustes import solve_limit
from .se3 import Array, inverse

# Robot and camera see the same rotation angle; beyond this RMS difference the rows are not the same moments.
ANGLE_DISAGREEMENT = np.radians(2.5)
# Rotation residual beyond which another frame direction is looked for.
LARGE_RESIDUAL = np.radians(2.0)
# Below this spread of the rotation axes, rotation about and translation along them are hardly determined.
AXIS_SPREAD = np.radians(5.0)
SMALL_ANGLE = np.radians(5.0)
NEAR_HALF_TURN = np.radians(150.0)
# Farther from its base than any arm reaches, in metres.
FAR = 20.0
# What sits farther from the gripper than this, and than the fixed part from the base, is unusual (m).
LONG_BRACKET = 0.4
# Residuals beyond this multiple (or below this fraction) of what the noise explains are not chance.
NOISE_RATIO = 3.0
# Data without noise, from a simulation, are not a sign of overstated noise (rad).
EXACT = 1e-7
# Pairs that the search for another frame direction looks at.
SEARCH_PAIRS = 2000


class Residuals(NamedTuple):
    """How well X explains the motions: rotation in rad, translation in the unit of the input, over pairs."""

    rotation_rms: float
    rotation_median: float
    rotation_max: float
    translation_rms: float
    translation_median: float
    translation_max: float
    error: float  # (62): sqrt(sum |A X - X B|^2) / N
    pairs: int  # how many pairs were looked at


def rotation_angles(R: Array) -> Array:
    """Rotation angle in [0, pi] of R (..., 3, 3), exact also at 0 and pi: ``atan2(|vee R|, tr R - 1)``."""
    x, y, z = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    return np.asarray(np.arctan2(np.sqrt(x * x + y * y + z * z), np.trace(R, axis1=-2, axis2=-1) - 1.0))


def residuals(A: Array, B: Array, X: Array) -> tuple[Array, Array]:
    """Rotation angle of ``(A X)(X B)^-1`` and length of ``t(A X) - t(X B)`` per pair: two arrays (N,)."""
    difference = A[..., :3, :] @ X - X[..., :3, :] @ B
    squares = np.einsum("...ij,...ij->...", difference[..., :3], difference[..., :3])
    # |R_1 - R_2| = 2 sqrt(2) sin(angle / 2) in the Frobenius norm
    angle = 2.0 * np.arcsin(np.minimum(np.sqrt(squares / 8.0), 1.0))
    offset = difference[..., 3]
    return angle, np.sqrt(np.einsum("...i,...i->...", offset, offset))


def summarise(angle: Array, distance: Array) -> Residuals:
    """`Residuals` from those of each pair."""
    frobenius = 8.0 * np.sin(0.5 * angle) ** 2 + distance**2
    return Residuals(
        float(np.sqrt(np.mean(angle**2))),
        float(np.median(angle)),
        float(angle.max()),
        float(np.sqrt(np.mean(distance**2))),
        float(np.median(distance)),
        float(distance.max()),
        float(np.sqrt(frobenius.sum()) / len(angle)),
        len(angle),
    )


def check_poses(poses: PosePairs) -> list[str]:
    """Units, constant, equal and repeated columns of the pose lists."""
    found = []
    for name, T in (("robot", poses.robot), ("camera", poses.camera)):
        t = T[..., :3, 3].reshape(-1, 3)
        far = float(np.abs(t).max(initial=0.0))
        if far > FAR:
            found.append(
                f"The {name} translations reach {far:.4g} m: they look like millimetres. "
                "Convert them to metres (--units mm)."
            )
        span = np.ptp(t, axis=0) if len(t) else np.zeros(3)
        for axis in range(3):
            if len(t) > 1 and span[axis] <= 1e-9 * max(far, 1e-3):
                found.append(f"Column {'xyz'[axis]} of the {name} poses is constant ({t[0, axis]:.6g}).")
        for a, b in ((0, 1), (0, 2), (1, 2)):
            if len(t) > 2 and span[a] > 1e-9 * max(far, 1e-3) and np.array_equal(t[:, a], t[:, b]):
                found.append(
                    f"Columns {'xyz'[a]} and {'xyz'[b]} of the {name} poses are identical in all {len(t)} rows: "
                    "one of them was lost when the file was written."
                )
        rows = T.reshape(-1, 16)
        same = int((rows[1:] == rows[:-1]).all(axis=1).sum()) if len(rows) > 1 else 0
        if same:
            found.append(f"{same} of {len(rows)} {name} poses repeat the row before exactly: they add no information.")
    return found


def check_rotations(motions: Motions) -> list[str]:
    """Angles of robot against camera, half turns, small angles, spread of the rotation axes."""
    found = []
    R_A, R_B = motions.A[..., :3, :3].reshape(-1, 3, 3), motions.B[..., :3, :3].reshape(-1, 3, 3)
    angle, angle_B = rotation_angles(R_A), rotation_angles(R_B)
    difference = np.abs(angle - angle_B)
    rms = float(np.sqrt(np.mean(difference**2)))
    if rms > ANGLE_DISAGREEMENT:
        worst = int(np.argmax(difference))
        found.append(
            f"Robot and camera disagree on how far they turned: rotation angles differ by {np.degrees(rms):.1f} "
            f"degrees RMS, {np.degrees(difference[worst]):.1f} at most (pair {_pair(motions, worst)}). "
            + (
                "Few pairs differ: look for wrong detections."
                if np.median(difference) < 0.25 * ANGLE_DISAGREEMENT
                else "The rows of the two files do not belong together (wrong pairing, a shift, a time offset)."
            )
        )
    half = float(np.mean(angle > NEAR_HALF_TURN))
    if half > 0.25:
        found.append(
            f"{100 * half:.0f} % of the motions turn by more than 150 degrees. 4DPA weights a motion by "
            "sin^2(angle), so they count almost nothing; choose pairs that turn by 30 to 150 degrees."
        )
    largest = float(angle.max(initial=0.0))
    if largest < SMALL_ANGLE:
        found.append(
            f"The robot turns by {np.degrees(largest):.2g} degrees at most: noise is amplified. Turn it by 30 "
            "degrees and more, about different axes."
        )
    u = np.stack([R_A[:, 2, 1] - R_A[:, 1, 2], R_A[:, 0, 2] - R_A[:, 2, 0], R_A[:, 1, 0] - R_A[:, 0, 1]])
    spread = np.linalg.eigvalsh(u @ u.T)
    # The ratio of M's eigenvalues is the squared sine of the typical angle between the axes.
    if spread[2] > 0 and spread[1] + spread[0] < np.sin(AXIS_SPREAD) ** 2 * spread[2]:
        found.append(
            "The rotation axes of the robot are nearly parallel (within "
            f"{np.degrees(np.sqrt((spread[1] + spread[0]) / spread[2])):.2g} degrees): rotation about this axis and "
            "translation along it are hardly determined. Add motions that turn about another axis."
        )
    return found


def check_frames(motions: Motions, angle: Array) -> list[str]:
    """Large rotation residuals ``angle`` (N,): would inverted poses fit?

    If ``G X C = W`` is constant, so is ``inv(G) W inv(C) = X``: inverting one of the two lists breaks the fit,
    inverting the other as well restores it with the roles of X and W exchanged. So there are two readings to
    offer, which fit equally well and differ in what X is.
    """
    rms = float(np.sqrt(np.mean(angle**2)))
    # Noise turns about all three axes and so makes the residual sqrt(3) times the difference of the angles, which
    # a wrong frame leaves as it is.
    A, B = motions.A[..., :3, :3], motions.B[..., :3, :3]
    difference = rotation_angles(A) - rotation_angles(B)
    if rms < max(LARGE_RESIDUAL, 4.0 * float(np.sqrt(np.mean(difference**2)))):
        return []
    start = f"X does not explain the rotations: residual {np.degrees(rms):.1f} degrees RMS. "
    poses = motions.poses
    if poses is None or poses.robot.ndim != 3 or motions.pairs is None:
        return [start + "Check the directions of `A` and `B` and that they belong together."]
    index = motions.pairs[:: max(1, len(motions.pairs) // SEARCH_PAIRS)]
    readings = []
    for G, C in (
        (inverse(poses.effective_robot), poses.camera),
        (poses.effective_robot, inverse(poses.camera)),
    ):
        i, j = index[:, 0], index[:, 1]
        A, B = inverse(G)[j] @ G[i], C[j] @ inverse(C)[i]
        try:
            X = solve_limit(A, B)
        except DegenerateMotionError:
            continue
        fit = residuals(A, B, X)[0]
        readings.append((float(np.sqrt(np.mean(fit**2))), float(np.linalg.norm(X[:3, 3]))))
    if len(readings) < 2 or readings[0][0] > 0.4 * rms:
        return [start + "Inverted poses do not fit either: the rows may not belong together."]
    other = "eye-to-hand" if poses.setup == "eye-in-hand" else "eye-in-hand"
    return [
        f"{start}Two other readings fit ({np.degrees(readings[0][0]):.2g} degrees): the setup is {other} or the robot "
        f"file holds inverse poses, which makes X {readings[0][1]:.3g} m long; or the camera file holds inverse poses, "
        f"target_T_camera, which makes X {readings[1][1]:.3g} m long."
    ]


def check_lengths(poses: PosePairs, X: Array) -> list[str]:
    """Is the sensor bracket longer than the arm? Swapped files fit AX = XB exactly and give inv(W) for X."""
    W = poses.effective_robot @ X @ poses.camera
    long_X = float(np.linalg.norm(X[:3, 3]))
    long_W = float(np.linalg.norm(np.mean(W[..., :3, 3], axis=-2)))
    on_gripper, fixed = (long_X, long_W) if poses.setup == "eye-in-hand" else (long_W, long_X)
    if on_gripper < LONG_BRACKET or on_gripper < 2.0 * fixed:
        return []
    what = "camera" if poses.setup == "eye-in-hand" else "target"
    return [
        f"The {what} would sit {on_gripper:.3g} m from the gripper, and the fixed part of the rig only {fixed:.3g} m "
        "from the base. If that is not so, the two files are swapped or both hold inverse poses: such data fit equally "
        "well, with another X."
    ]


def check_noise(motions: Motions, noise: Noise, angle: Array) -> list[str]:
    """Rotation residuals ``angle`` (N,) against what the noise given explains.

    To first order the rotation residual of a pair is ``theta_A - R_X theta_B``, and theta of a motion is the
    difference of those of its two poses (up to rotations): its mean square is the sum of the traces.
    """
    if isinstance(noise, PairNoise):
        variance = sum(
            float(np.mean(np.trace(S[..., :3, :3], axis1=-2, axis2=-1))) for S in (noise.A, noise.B) if S is not None
        )
    else:
        assert motions.pairs is not None and motions.poses is not None  # PoseNoise was accepted
        traces = np.zeros(motions.poses.n)
        for S in (noise.robot, noise.camera):
            if S is not None:
                traces += np.trace(marginals(S)[..., :3, :3], axis1=-2, axis2=-1)
        variance = float(np.mean(traces[motions.pairs].sum(axis=1)))
    rms, expected = float(np.sqrt(np.mean(angle**2))), float(np.sqrt(variance))
    if rms > NOISE_RATIO * expected and rms > np.radians(1e-4):
        factor = f"{rms / expected:.3g} times as large as" if expected > 0 else "there, while"
        return [
            f"The rotation residuals ({np.degrees(rms):.3g} degrees RMS) are {factor} the noise given explains"
            + (f" ({np.degrees(expected):.3g} degrees). " if expected > 0 else " none. ")
            + "Either the noise is larger than given or the data are wrong; the standard deviations of X are too "
            "small by about this factor."
        ]
    if EXACT < rms < expected / NOISE_RATIO:
        return [
            f"The rotation residuals ({np.degrees(rms):.3g} degrees RMS) are {expected / rms:.3g} "
            f"times smaller than the noise given explains ({np.degrees(expected):.3g} degrees): the noise seems "
            "overstated, and with it the standard deviations of X. Check the units."
        ]
    return []


def _pair(motions: Motions, k: int) -> str:
    if motions.pairs is None:
        return str(k)
    i, j = motions.pairs[k % motions.N]
    return f"of poses {i} and {j}"
