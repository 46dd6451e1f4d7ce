"""Checks of the rotations of robot and camera: their angles must agree, and must exceed their noise.

Robot and camera see the same rotation angle of a motion, whatever X is.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array, vee
from ...errors import DegenerateMotionError
from ...findings import Finding
from ...methods.degeneracy import MIN_SPREAD_RATIO, infinite_directions
from ...model.errors.models import Noise, marginals
from ...model.poses.motions import Motions
from ...model.poses.residuals import median, rotation_angles
from ..graph.constraint import ONE_AXIS_SIN2, covariances_of, of_motions

# Beyond this RMS difference of their angles the rows of robot and camera are not the same moments, unless the noise
# explains it.
ANGLE_DISAGREEMENT_RAD = np.radians(2.5)
# Noise may be the cause where the difference is below this share of that of rows that do not belong together.
MAX_NOISE_SHARE = 0.15
# Where no two poses are farther apart than this, the noise is amplified.
SMALL_ROTATION_RAD = np.radians(15.0)
# Within this angle of each other, rotation axes are nearly parallel: the rotation
# about them and the translation along them are hardly determined.
SMALL_ANGLE_RAD = np.radians(5.0)
# The angle beyond which 4DPA gives a motion almost no weight.
NEAR_HALF_TURN_RAD = np.radians(150.0)
# The rotations must exceed their noise by this factor; otherwise X is determined by the noise.
SIGNAL_TO_NOISE = 4.0


def check_rotations(motions: Motions, noise: Noise | None, method: str) -> list[Finding]:
    """Check the angles of robot against camera, half turns, small angles, and the spread of the rotation axes."""
    found = []
    R_A, R_B = motions.A[..., :3, :3], motions.B[..., :3, :3]
    angle, angle_B = rotation_angles(R_A), rotation_angles(R_B)
    difference = np.abs(angle - angle_B)
    rms = float(np.sqrt(np.mean(difference**2)))
    # one of the three axes of the noise changes the angle
    explained = 0.0 if noise is None else np.sqrt(_rotation_variance(motions, noise) / 3.0)
    if rms > max(ANGLE_DISAGREEMENT_RAD, 2.0 * explained):
        worst = int(np.argmax(difference))
        few = median(difference) < 0.25 * ANGLE_DISAGREEMENT_RAD
        by_chance = float(np.hypot(np.std(angle), np.std(angle_B)))  # of rows that have nothing to do with each other
        values = {"rms": rms, "largest": difference[worst], "where": _pair(motions, worst), "few": few}
        if noisy := rms < MAX_NOISE_SHARE * by_chance and not few:
            values["noisy"] = True
        found.append(Finding("input_checks.angles_disagree", "caution" if few or noisy else "failure", values))
    half = float(np.mean(angle > NEAR_HALF_TURN_RAD))
    if half > 0.25 and method == "4dpa":
        found.append(Finding("input_checks.half_turns", "caution", {"share": half}))
    largest = float(angle.max(initial=0.0))
    if largest < SMALL_ROTATION_RAD:
        found.append(Finding("input_checks.small_rotations", "caution", {"largest": largest}))
    spread, axis = _axis_spread(R_A)
    if spread[2] > 0 and spread[0] + spread[1] < np.sin(SMALL_ANGLE_RAD) ** 2 * spread[2]:
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
    if spread[0] + spread[1] < ONE_AXIS_SIN2 and (noise is None or shown > 9.0 * variance):
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


def _pair(motions: Motions, k: int) -> str:
    if motions.pairs is None:
        return f"motion {k}"
    i, j = motions.pairs[k]
    return f"poses {i} and {j}"
