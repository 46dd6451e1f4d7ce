r"""Errors of an arm whose nominal kinematics are known, in the gauge of its workspace.

Columns of `Kinematics.columns`, by group (joint offsets, joint tilts, link lengths, transmission, sag), at joint values
that were recorded or found by `postures_by_branch`: twists ``(theta, tau)`` (left rotation, rad; additive translation,
m; in the base) of the *true* pose per rad or m of each error.

**Gauge.** What a constant base and a constant flange do over the workspace is taken out of each column: 12 numbers B by
least squares at `WORKSPACE` postures spread over the joint limits, rotations weighted by `LEVER`, then ``F - G B`` with
the twists G of base and flange at the poses. X and W are then those of the frames that fit the whole workspace best.
Columns that nothing is left of (all geometric errors of the first joint, offset and axial length of the last) are
dropped.

**Elbow.** Seven axes reach a pose in a line of postures, ``dq = v psi`` with ``J v = 0``, v a unit vector whose largest
joint is that of the elbow's roll. Where the joints are not recorded, psi is unknown: with psi ~ N(0, sd) common to the
poses the second moment of the errors is the mean of ``F(psi) F(psi)^T``, by Gauss-Hermite quadrature of `ELBOWS` nodes.
Each group has the columns at all nodes, times the roots of the weights, truncated.
"""

from __future__ import annotations

import functools
from typing import Literal, NamedTuple

import numpy as np

from ..errors import InputError
from ..geometry.se3 import Array
from ..kinematics.chain import Kinematics
from ..kinematics.errors import GROUPS
from ..kinematics.gravity import spread_postures
from ..kinematics.inverse import postures_at
from .population import LEVER, WORKSPACE, gauge_columns, truncated

VANISHES = 1e-9
ELBOWS = 5

Gauge = Literal["workspace", "none"]


class ArmColumns(NamedTuple):
    """Columns of the errors of one group."""

    group: str
    names: tuple[str, ...]  # (m)
    F: Array  # (n, 6, m) per rad or m of each error
    rms: Array  # (m,) 3-D RMS position error (m) over the workspace per rad or m


def arm_columns(
    kinematics: Kinematics, joints: Array, gauge: Gauge = "workspace", *, elbow_sd: float = 0.0
) -> tuple[ArmColumns, ...]:
    """Return the columns at ``joints`` (n, L), group by group; see the module.

    Parameters
    ----------
    gauge : "workspace" or "none"
    elbow_sd : float
        Standard deviation of psi, rad, for an arm of seven axes whose joints were not recorded. The columns of a group
        are then mixed over psi and have no names of their own; ``rms`` is the RMS of the group's unit errors, alike for
        each of its columns.

    Raises
    ------
    InputError
        For another number of joints, and for an elbow that the arm does not have.
    """
    q = np.asarray(joints, dtype=float)
    if q.ndim != 2 or q.shape[1] != kinematics.n_joints:
        raise InputError(f"Expected `joints` to have shape (n, {kinematics.n_joints}), got {q.shape}.")
    if elbow_sd and kinematics.n_joints < 7:
        raise InputError(f"{kinematics.name} has {kinematics.n_joints} joints: one pose leaves no elbow to move.")
    base_and_flange, rms, kept = _workspace(kinematics)
    if gauge == "none":
        base_and_flange, rms, kept = np.zeros_like(base_and_flange), rms, np.ones_like(kept)
    nodes, weights = np.polynomial.hermite_e.hermegauss(ELBOWS if elbow_sd else 1)
    at = [q if not node else elbow_postures(kinematics, q, elbow_sd * node) for node in nodes]
    F = [_without(kinematics, one, base_and_flange) for one in at]
    of = np.array([error.group for error in kinematics.errors])
    found = []
    for group in GROUPS:
        index = np.flatnonzero((of == group) & kept)
        names = tuple(kinematics.errors[k].name for k in index)
        if len(F) == 1:
            found.append(ArmColumns(group, names, F[0][..., index], rms[index]))
            continue
        rows = np.concatenate(
            [f[..., index] * w for f, w in zip(F, np.sqrt(weights / weights.sum()), strict=True)], axis=2
        )
        mixed = truncated(rows.reshape(6 * len(q), -1), 2 * len(index)).reshape(len(q), 6, -1)
        m = mixed.shape[-1]
        size = np.sqrt((rms[index] ** 2).sum() / max(m, 1))
        found.append(ArmColumns(group, tuple(f"{group} {k + 1}" for k in range(m)), mixed, np.full(m, size)))
    return tuple(found)


def null_directions(kinematics: Kinematics, joints: Array) -> Array:
    """Return v (n, L), unit vectors along which the joints of an arm of seven axes move and the tip stays.

    Their signs agree: the component of the largest mean size is positive. Where the arm has two such directions (a
    singular posture), one of them.
    """
    J = kinematics.jacobian(joints)
    J[:, 3:] /= max(kinematics.reach, 1e-3)
    v = np.linalg.svd(J)[2][:, -1]
    largest = np.abs(v).mean(axis=0).argmax()
    return np.asarray(v * np.where(v[:, largest, None] < 0, -1.0, 1.0))


def elbow_postures(kinematics: Kinematics, joints: Array, psi: float, step: float = 0.15) -> Array:
    """Return joint values (n, L) of the same poses with the elbow moved by ``psi`` (rad) along the null direction.

    Steps of at most ``step`` rad; the last one is taken back to the pose. A posture that runs into a limit or away from
    its pose stays where it was.
    """
    q = np.array(joints, dtype=float)
    poses = kinematics.poses(q)
    n = max(1, int(np.ceil(abs(psi) / step)))
    for _ in range(n):
        q = q + psi / n * null_directions(kinematics, q)
    found = postures_at(kinematics, poses, q)
    return np.where(found.reached[:, None], found.q, joints)


def _without(kinematics: Kinematics, q: Array, base_and_flange: Array) -> Array:
    """(n, 6, m) columns with the motions of base and flange taken out."""
    return np.asarray(kinematics.columns(q) - _gauge(kinematics, q) @ base_and_flange)


def _gauge(kinematics: Kinematics, q: Array) -> Array:
    """(n, 6, 12) twists by base and flange."""
    tip = np.moveaxis(kinematics.poses(q)[:, :3], 0, -1)[None]
    return np.moveaxis(gauge_columns(tip)[0], (0, 2), (2, 0))


@functools.lru_cache(maxsize=16)
def _workspace(kinematics: Kinematics) -> tuple[Array, Array, Array]:
    """Motions of base and flange (12, m) in the columns, RMS position error (m,) without them, and what is left."""
    q = spread_postures(kinematics.limits, np.array([joint.is_revolute for joint in kinematics.joints]), WORKSPACE)
    F, B = kinematics.columns(q), _gauge(kinematics, q)
    weight = np.tile([LEVER] * 3 + [1.0] * 3, WORKSPACE)[:, None]
    flat = F.reshape(-1, F.shape[-1]) * weight
    found = np.linalg.pinv(B.reshape(-1, 12) * weight) @ flat
    free = F - B @ found
    rms = np.sqrt((free[:, 3:] ** 2).sum(axis=(0, 1)) / WORKSPACE)
    size = np.linalg.norm(free.reshape(flat.shape) * weight, axis=0)
    return found, rms, size > VANISHES * np.maximum(np.linalg.norm(flat, axis=0), 1e-12)
