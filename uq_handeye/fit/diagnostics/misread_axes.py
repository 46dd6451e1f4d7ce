r"""Translations of one side whose axes are negated, exchanged, scaled or sheared against its rotations.

Given the rotation of X, the translations obey an equation that is linear in those of X and W and in a matrix M on the
translations of one side, which is a factor times the identity where nothing is wrong:

    R_G (R_X M t_C + t_X) + t_G = t_W          or, for the robot,     R_G (R_X t_C + t_X) + M t_G = t_W

(eye-to-hand: the robot's equation is that of the inverse, ``R_X t_C + t_X = R_G t_W + M t_G`` with its own poses). M is
estimated by least squares from the poses that agree in rotation. It is reported where it explains the translations far
better than a factor does, and is near a matrix that negates, exchanges or scales axes, or moves one along another
(shear: a linear axis that is not square, a base that is out of plumb in the translations only). Errors of an arm that
grow over its workspace look like a matrix, too: an axis is scaled or sheared only where that one number explains as
much as the matrix. A principal point that is off shears the camera's x or y along z, and is an error of its own.
"""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from ...core.geometry.se3 import Array, vee
from ...core.levels import CONTRADICTED
from ...model.poses.pose_pairs import PosePairs
from .agreement import OUTLIER_RATIO, Agreement, agreement, motions_between
from .readings import Reading

# Fewest poses that determine the matrix and show whether it is needed.
MIN_POSES_FOR_AXES = 10
# The matrix is needed where it divides the root mean square of the translations by this or more, and by more than
# chance would with this probability (F test).
NEEDED_RATIO, MAX_CHANCE = 1.3, 1e-5
# Unknowns of the matrix that a factor leaves out.
BEYOND_A_FACTOR = 8
# The scale of one axis explains as much as the matrix where the root mean square is larger by less than this, or by no
# more than chance makes it (CONTRADICTED).
AS_GOOD_RATIO = 1.1
# Rotations across the main axis have at least this share of the squares.
MIN_ACROSS_SHARE = 0.02
# Axes scaled by less than this, or moved into each other by more than this, are no mistake of the file. The accuracy of
# an arm does not strain its translations by as much as `MIN_STRAIN`.
MIN_SCALED, MAX_SHEAR, MIN_STRAIN = 0.03, 0.2, 0.005
AXES = "xyz"
# M that is a factor, row by row.
FACTOR = np.eye(3).reshape(9, 1)


def misread_axes(poses: PosePairs) -> Reading | None:
    """Return the axes of one file that seem negated, exchanged or scaled, with the misfit before and after; or None."""
    if poses.n < MIN_POSES_FOR_AXES or not _several_axes(poses.robot):
        return None
    found = []
    now = agreement(poses.effective_robot, poses.camera)
    if now is None or now.counts is None or now.counts.sum() < MIN_POSES_FOR_AXES:
        return None
    dof = 3 * int(now.counts.sum()) - 15  # minus the unknowns: translations of X and W, and the matrix
    for side in ("camera", "robot"):
        system = _system(poses, side, now)
        before, _, _ = _solved(*system, FACTOR, now.counts)
        after, M, trusted = _solved(*system, np.eye(9), now.counts)
        if trusted and _needed(before, after, dof):
            found.append((after, before, side, M, system))
    for after, before, side, M, system in sorted(found, key=lambda one: one[0]):
        if (said := _kind(M, MIN_SCALED if side == "camera" else MIN_STRAIN)) is None:
            if (sheared := _sheared(side, M, system, now.counts, (before, after), dof)) is not None:
                return {"kind": "axes", "file": side, "before": before, **sheared}
            continue
        if "scaled" in said:
            axis = AXES.index(str(said["scaled"]))
            alone, M, trusted = _solved(*system, np.column_stack([FACTOR, np.eye(9)[:, 4 * axis]]), now.counts)
            if not (trusted and _needed(before, alone, dof, 1) and _as_well(before, alone, after, dof)):
                continue
            said = _kind(M, MIN_SCALED if side == "camera" else MIN_STRAIN)
            if said is None or said.get("scaled") != AXES[axis]:
                continue
            after = alone
        return {"kind": "axes", "file": side, "before": before, "after": after, **said}
    return None


def _sheared(
    side: str,
    M: Array,
    system: tuple[Array, Array, Array],
    counts: NDArray[np.bool_],
    misfit: tuple[float, float],
    dof: int,
) -> dict[str, object] | None:
    """Return the axis that is moved along another one, where that alone explains the translations; None for others.

    ``misfit``: RMS with a factor and with the matrix M.
    """
    before, after = misfit
    unit = M / np.cbrt(np.linalg.det(M))
    others = np.abs(unit - np.diag(np.diag(unit)))
    if side == "camera":
        others[:, 2] = others[2] = 0.0
    moved, along = np.unravel_index(int(others.argmax()), (3, 3))
    if not MIN_STRAIN < others[moved, along] < MAX_SHEAR:
        return None
    alone, M, trusted = _solved(*system, np.column_stack([FACTOR, np.eye(9)[:, 3 * moved + along]]), counts)
    if not (trusted and _needed(before, alone, dof, 1) and _as_well(before, alone, after, dof)):
        return None
    # M brings the file to what was there: the file has less of the axis by this much
    share = -float(M[moved, along] / M[moved, moved])
    return (
        {"sheared": AXES[moved], "along": AXES[along], "share": share, "after": alone}
        if abs(share) > MIN_STRAIN
        else None
    )


def _several_axes(robot: Array) -> bool:
    """Return whether the robot rotates about two axes; about one the rotation of X is open, and any axes may fit."""
    i, j = motions_between(len(robot))
    u = vee(robot[i, :3, :3].mT @ robot[j, :3, :3])
    spread = np.linalg.eigvalsh(u.T @ u)
    return bool(spread[0] + spread[1] > MIN_ACROSS_SHARE * spread[2])


def _needed(before: float, after: float, dof: int, more: int = BEYOND_A_FACTOR) -> bool:
    """Return whether so many more unknowns explain the translations far better than a factor: RMS before and after."""
    return before > NEEDED_RATIO * after and dof > 0 and _chance(before, after, dof, more) < MAX_CHANCE


def _as_well(before: float, alone: float, after: float, dof: int) -> bool:
    """Return whether the scale of one axis explains the translations as well as the whole matrix does."""
    if alone < AS_GOOD_RATIO * after or alone < 1e-6 * before:  # or rounding
        return True
    return alone < NEEDED_RATIO * after and _chance(alone, after, dof, BEYOND_A_FACTOR - 1) > CONTRADICTED.probability


def _chance(before: float, after: float, dof: int, more: int) -> float:
    """Return the probability that chance lets so many more unknowns reduce the RMS as much (F test)."""
    return float(fdtrc(more, dof, max(before**2 / max(after**2, 1e-300) - 1.0, 0.0) * dof / more))


def _system(poses: PosePairs, side: str, at: Agreement) -> tuple[Array, Array, Array]:
    """Return columns of the translations of X and W (n, 3, 6), those of M (n, 3, 9), and the rest (n, 3)."""
    G, R_X = poses.robot, at.rotation
    n = poses.n
    eye = np.broadcast_to(np.eye(3), (n, 3, 3))
    in_hand = poses.setup == "eye-in-hand"
    R_E, t_E = poses.effective_robot[:, :3, :3], poses.effective_robot[:, :3, 3]
    t_C, t_G = poses.camera[:, :3, 3], G[:, :3, 3]
    if side == "camera" or in_hand:
        fixed = np.concatenate([R_E, -eye], axis=2)
    else:
        fixed = np.concatenate([eye, -G[:, :3, :3]], axis=2)
    if side == "camera":
        return fixed, _columns(R_E @ R_X, t_C), t_E
    seen = (R_X @ t_C[..., None])[..., 0]
    if in_hand:
        return fixed, _columns(eye, t_G), (R_E @ seen[..., None])[..., 0]
    return fixed, -_columns(eye, t_G), seen


def _columns(left: Array, t: Array) -> Array:
    """Return the columns (n, 3, 9) of ``left M t`` by the entries of M, row by row."""
    return np.asarray(np.einsum("nij,nk->nijk", left, t).reshape(len(t), 3, 9))


def _solved(
    fixed: Array, columns: Array, rest: Array, basis: Array, counts: NDArray[np.bool_]
) -> tuple[float, Array, bool]:
    """Return the RMS of the translations, M in the span of a basis (9, k), and whether it is determined."""
    columns = columns @ basis
    A = np.concatenate([fixed, columns], axis=2)
    among, M, trusted = counts, np.eye(3), True
    distance = np.zeros(len(rest))
    for _ in range(3):
        left, right = A[among].reshape(-1, A.shape[2]), -rest[among].reshape(-1)
        scale = np.maximum(np.linalg.norm(left, axis=0), 1e-300)
        solution, _, rank, _ = np.linalg.lstsq(left / scale, right, rcond=1e-4)
        solution = solution / scale
        trusted = bool(rank == A.shape[2])
        M = (basis @ solution[6:]).reshape(3, 3)
        distance = np.linalg.norm(A @ solution + rest, axis=1)
        level = OUTLIER_RATIO * float(np.median(distance[among]))
        kept = counts & (distance <= level)
        if kept.sum() < 0.6 * counts.sum():
            break
        among = kept
    return float(np.sqrt(np.mean(distance[among] ** 2))), M, trusted


def _kind(M: Array, least: float) -> dict[str, object] | None:
    """Return what is wrong with the axes: ``negated``, ``exchanged`` or ``scaled``; None: nothing that has a name.

    ``least``: the smallest scale of one axis, as a logarithm, that has one.
    """
    size = float(np.cbrt(np.abs(np.linalg.det(M))))
    if not size > 0.0:
        return None
    unit = M / size
    best = min(
        (np.diag(signs)[list(order)] for order in permutations(range(3)) for signs in product((1.0, -1.0), repeat=3)),
        key=lambda P: float(np.linalg.norm(unit - P)),
    )
    scales = np.abs(unit[np.nonzero(best)])
    others = np.abs(unit[best == 0.0]).max()
    if others > MAX_SHEAR or scales.min() < 0.2:
        return None
    order, signs = np.argmax(np.abs(best), axis=1), best[np.arange(3), np.argmax(np.abs(best), axis=1)]
    if (signs < 0).all():  # the factor would be negative
        return None
    found: dict[str, object] = {}
    if (order != np.arange(3)).any():
        found["exchanged"] = "".join(AXES[k] for k in np.flatnonzero(order != np.arange(3)))
    if (signs < 0).any():
        found["negated"] = "".join(AXES[k] for k in np.flatnonzero(signs < 0))
    if found:
        return found
    middle = float(np.median(scales))
    axis = int(np.argmax(np.abs(np.log(scales / middle))))
    factor = float(middle / scales[axis])
    return {"scaled": AXES[axis], "factor": factor} if abs(np.log(factor)) > least else None
