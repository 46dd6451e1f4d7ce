r"""Errors of an arm of which nothing is known: those of a dozen arms, scaled and placed at the poses.

**Model** (T17). The error of the measured robot poses is ``K z``, z ~ N(0, I), with columns K (n, 6, m) shared by all
poses: twists ``(theta, tau)`` (left rotation, rad; additive translation, m; in the base). K is in the unit in which the
3-D RMS position error of the arm over its workspace is 1 m: an arm of 0.6 mm absolute accuracy has the error
``0.6e-3 K z``.

**Arms.** Each geometry of `ARMS` is scaled so that its reach, of the flange from joint 2, is `SCALE` times the distance
of the farthest pose from the base, with the tip of the poses as its flange, and placed at the poses by inverse
kinematics in its usual branch (`WorkPostures`). Columns F of its errors, with the standard deviations

| offsets | tilts | lengths | harmonics 1, 2 | sag |
|---|---|---|---|---|
| 0.6 mrad | 0.3 mrad | 0.25 mm per m of reach | 0.12 mrad | 0.3 mrad |

**Gauge.** What a constant base and a constant flange do over the workspace is taken out: 12 numbers by least squares
for each column at `WORKSPACE` postures spread over the limits of the joints, rotations weighted by `LEVER` of the
reach, with the same 12 numbers at the poses. **Unit**: the RMS over the same postures.

**Mixture.** The columns of all arms that reach at least half of the poses (the `FEWEST` that reach most, if fewer do),
over the square root of their number, have the second moment of the mixture: ``K K^T = mean over arms K_a K_a^T``. A
truncated singular value decomposition with translations over `TRANSLATION` leaves at most `RANK` columns: all but some
0.2 % of the energy for poses of one region, 3 % for 60 poses all over the workspace.

*Scale.* Fourteen arms of the table in turn as the true one, its family left out of `ARMS`, 0.6 mm (known), 30 poses,
camera 0.03 deg and 0.3 mm: with a scale of 1.0, 1.2, 1.4, 1.7 the true X is inside its 95 % region in 94, 91, 88, 83 %
of the sets of one region and in 86, 81, 76, 71 % of those all over the workspace; in 95 % with the arm's own columns.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.se3 import Array
from ..kinematics.arms.known_arms import known_arm
from ..kinematics.arms.stack import ERRORS, SAGS, SHIFTS, TURNS, WAVES, ArmStack
from ..kinematics.arms.work_postures import BLOCK, WorkPostures

ARMS = (
    "irb120",
    "irb2600",
    "kr6r900",
    "lrmate200id",
    "tx260",
    "crx10ia",
    "m1013",
    "ur5e",
    "xarm6",
    "iiwa14",
    "panda",
    "gen3",
)
SCALE = 1.0
OFFSET, TILT, LENGTH, HARMONIC, SAG = 0.6e-3, 0.3e-3, 0.25e-3, 0.12e-3, 0.3e-3
WORKSPACE = 400
LEVER = 0.3
TRANSLATION = 0.5  # m
RANK = 72
# Part of the energy that the columns left out may have: of the mixture, and of each arm over its workspace.
LEFT_OUT, WITHIN_ARM = 1e-3, 1e-4
# Arms that are kept at least, those that reach most poses.
FEWEST = 3
# Further vectors of the range from which the columns are taken.
MORE = 12


@dataclass(frozen=True, eq=False)
class ArmPopulation:
    """Geometries of some arms, with what does not depend on the poses."""

    names: tuple[str, ...]
    stack: ArmStack
    postures: WorkPostures
    mixing: Array  # (A, c, 89) from the 77 columns and those of base and flange to c columns of unit RMS

    @classmethod
    def of(cls, names: tuple[str, ...]) -> ArmPopulation:
        """Return the population of the arms of these names."""
        stack = ArmStack.of([known_arm(name) for name in names])
        unit = np.empty((ERRORS, 1))
        unit[TURNS, 0] = np.tile([TILT, TILT, OFFSET], 7)
        unit[SHIFTS], unit[WAVES], unit[SAGS] = LENGTH, HARMONIC, SAG
        q = stack.workspace(WORKSPACE)
        frames = stack.frames(q)
        F = stack.columns(q, frames).reshape(len(names), ERRORS, -1) * unit
        B = gauge_columns(frames.tip).reshape(len(names), 12, -1)
        weight = np.repeat([LEVER] * 3 + [1.0] * 3, WORKSPACE)
        gauge = (F * weight) @ np.linalg.pinv(B * weight)  # (A, 77, 12)
        free = F - gauge @ B
        rms = np.sqrt((free[:, :, 3 * WORKSPACE :] ** 2).sum(axis=(1, 2)) / WORKSPACE)[:, None, None]
        energy, V = np.linalg.eigh((free * weight) @ (free * weight).mT)  # ascending
        lost = np.cumsum(energy, axis=1) / energy.sum(axis=1, keepdims=True)
        kept = ERRORS - int((lost < WITHIN_ARM).sum(axis=1).min())
        V = V[:, :, ERRORS - kept :].mT / rms
        return cls(names, stack, WorkPostures.of(stack), np.concatenate([V * unit[:, 0], -V @ gauge], axis=2))

    def columns(self, poses: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return columns (A, c, 6, n) at ``poses`` (n, 3, 4), and whether the arms reach them (A, n); lengths over the
        reach, RMS over the workspace 1.
        """
        q, frames, reached = self.postures.find(poses)
        A, _, n = q.shape
        F = np.concatenate([self.stack.columns(q, frames), gauge_columns(frames.tip)], axis=1)
        return (self.mixing @ F.reshape(A, -1, 6 * n)).reshape(A, -1, 6, n), reached


@functools.lru_cache(maxsize=8)
def population(names: tuple[str, ...] = ARMS) -> ArmPopulation:
    """Return the population of the arms of these names; kept."""
    return ArmPopulation.of(names)


def population_columns(robot: Array, *, arms: tuple[str, ...] = ARMS, rank: int = RANK) -> Array:
    """Return K (n, 6, m) of the poses ``robot`` (n, 4, 4) base_T_tip; see the module.

    ``arms``: the geometries, by their names in the table of known arms. ``rank``: the largest m.
    """
    robot = np.asarray(robot, dtype=float)
    known = population(tuple(arms))
    reach = SCALE * max(float(np.linalg.norm(robot[:, :3, 3], axis=-1).max()), 1e-6)
    poses = robot[:, :3].copy()
    poses[..., 3] /= reach
    n = len(robot)
    parts = [known.columns(poses[start : start + BLOCK]) for start in range(0, n, BLOCK)]
    reached = np.concatenate([part[1] for part in parts], axis=1).mean(axis=1)
    kept = (reached >= 0.5) | (reached >= np.sort(reached)[-min(FEWEST, len(reached))])
    G = np.concatenate([part[0][kept] for part in parts], axis=-1)  # (A, c, 6, n)
    scale = np.repeat([1.0 / reach, 1.0 / TRANSLATION], 3)[:, None] / np.sqrt(len(G))
    K = truncated((G * scale).reshape(-1, 6 * n).T, rank).reshape(6, n, -1)
    K[3:] *= TRANSLATION
    return np.ascontiguousarray(K.swapaxes(0, 1))


def truncated(rows: Array, rank: int) -> Array:
    """Return (N, m), m <= rank, with the second moment of ``rows`` (N, M) but for `LEFT_OUT` of its trace.

    The singular vectors are those within the range of ``rows rows^T rows S`` with a fixed random S (M, rank + `MORE`),
    so that a permutation of the rows permutes the result.
    """
    if min(rows.shape) > rank + MORE:
        rows_of_range = rows @ (rows.T @ (rows @ _sketch(rows.shape[1], rank + MORE)))
    else:
        rows_of_range = rows if rows.shape[1] <= len(rows) else np.eye(len(rows))
    Q = np.linalg.qr(rows_of_range)[0]
    small = Q.T @ rows
    energy, U = np.linalg.eigh(small @ small.T)
    energy, U = np.maximum(energy[::-1], 0.0), U[:, ::-1]
    left = (rows**2).sum() - np.cumsum(energy[:rank])
    m = int(np.count_nonzero(left > LEFT_OUT * energy.sum())) + 1
    return np.asarray((Q @ U[:, :m]) * np.sqrt(energy[:m]))[:, :rank]


@functools.lru_cache(maxsize=8)
def _sketch(size: int, m: int) -> Array:
    return np.random.default_rng(0).normal(size=(size, m))


def gauge_columns(tip: Array) -> Array:
    """(A, 12, 6, n) twists of tips (A, 3, 4, n) by a rotation and a shift of the base, then of the tip."""
    A, _, _, n = tip.shape
    out = np.zeros((A, 12, 6, n))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, i, i] = out[:, 3 + i, 3 + i] = 1.0
        out[:, i, 3 + j], out[:, i, 3 + k] = -tip[:, k, 3], tip[:, j, 3]  # e_i x t
        out[:, 6 + i, :3] = out[:, 9 + i, 3:] = tip[:, :, i]
    return out
