r"""Errors of an arm of which nothing is known: those of a dozen arms, scaled and placed at the poses.

**Model** (T17). The error of the measured robot poses is ``K z``, z ~ N(0, I), with columns K (n, 6, m) shared by all
poses: twists ``(theta, tau)`` (left rotation, rad; additive translation, m; in the base). K is in the unit in which the
3-D RMS position error of the arm over its workspace is 1 m: an arm of 0.6 mm absolute accuracy has the error
``0.6e-3 K z``.

**Arms.** Each geometry of `ARMS` is scaled to reach `SCALE` times the farthest pose, with the tip of the poses as its
flange, and placed at the poses by inverse kinematics in its usual branch (`WorkPostures`). Columns F of its errors, with
the standard deviations

| offsets | tilts | lengths | harmonics 1, 2 | sag |
|---|---|---|---|---|
| 0.6 mrad | 0.3 mrad | 0.25 mm per m of reach | 0.12 mrad | 0.3 mrad |

**Gauge.** What a constant base and a constant flange do over the workspace is taken out: 12 numbers by least squares
for each column at `WORKSPACE` postures spread over the limits of the joints, rotations weighted by `LEVER` of the
reach, with the same 12 numbers at the poses. **Unit**: the RMS over the same postures.

**Mixture.** The columns of all arms that reach at least half of the poses (all arms, if none does), over the square
root of their number, have the second moment of the mixture of the arms: ``K K^T = mean over arms K_a K_a^T``. A
truncated singular value decomposition with translations over `TRANSLATION` leaves at most `RANK` columns.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from ..geometry.se3 import Array
from ..kinematics.arms.known_arms import known_arm
from ..kinematics.arms.stack import ERRORS, SAGS, SHIFTS, TURNS, WAVES, ArmStack, Frames
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
SCALE = 1.2
OFFSET, TILT, LENGTH, HARMONIC, SAG = 0.6e-3, 0.3e-3, 0.25e-3, 0.12e-3, 0.3e-3
WORKSPACE = 400
LEVER = 0.3
TRANSLATION = 0.5  # m
RANK = 72
# Energy that the columns left out may have.
LEFT_OUT = 1e-3


@dataclass(frozen=True, eq=False)
class ArmPopulation:
    """Geometries of some arms, with what does not depend on the poses."""

    names: tuple[str, ...]
    stack: ArmStack
    postures: WorkPostures
    sizes: Array  # (A, 77) standard deviations, of errors whose RMS over the workspace is the reach
    gauge: Array  # (A, 12, 77) base and flange that are taken out of the columns times their sizes

    @classmethod
    def of(cls, names: tuple[str, ...]) -> ArmPopulation:
        """Return the population of the arms of these names."""
        stack = ArmStack.of([known_arm(name) for name in names])
        unit = np.empty(ERRORS)
        unit[TURNS] = np.tile([TILT, TILT, OFFSET], 7)
        unit[SHIFTS], unit[WAVES], unit[SAGS] = LENGTH, HARMONIC, SAG
        q = stack.workspace(WORKSPACE)
        frames = stack.frames(q)
        F = (stack.columns(q, frames) * unit).reshape(len(names), -1, ERRORS)
        weight = np.tile([LEVER] * 3 + [1.0] * 3, WORKSPACE)[:, None]
        B = gauge_columns(frames.tip).reshape(len(names), -1, 12)
        gauge = np.linalg.pinv(B * weight) @ (F * weight)
        free = (F - B @ gauge).reshape(len(names), WORKSPACE, 6, ERRORS)
        rms = np.sqrt((free[:, :, 3:] ** 2).sum(axis=(1, 2, 3)) / WORKSPACE)[:, None]
        return cls(names, stack, WorkPostures.of(stack), unit / rms, gauge / rms[..., None])

    def columns(self, q: Array, frames: Frames) -> Array:
        """(A, n, 6, 77) columns at postures q (A, n, 7), gauge taken out; lengths over the reach."""
        F = self.stack.columns(q, frames)
        F *= self.sizes[:, None, None]
        A, n = F.shape[:2]
        F -= (gauge_columns(frames.tip).reshape(A, -1, 12) @ self.gauge).reshape(F.shape)
        return F


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
    farthest = max(float(np.linalg.norm(robot[:, :3, 3], axis=-1).max()), 1e-6)
    reach = SCALE * farthest
    wanted = robot[:, :3].copy()
    wanted[..., 3] /= reach
    n, A = len(robot), len(known.names)
    G, reached = np.empty((A, n, 6, ERRORS)), np.zeros((A, n), dtype=bool)
    for start in range(0, n, BLOCK):
        part = slice(start, start + BLOCK)
        q, frames, reached[:, part] = known.postures.find(np.broadcast_to(wanted[part], (A, *wanted[part].shape)))
        G[:, part] = known.columns(q, frames)
    kept = reached.mean(axis=1) >= 0.5
    if not kept.any():
        kept[:] = True
    G = G[kept]
    G[:, :, :3] /= reach
    G[:, :, 3:] /= TRANSLATION
    rows = np.moveaxis(G, 0, 2).reshape(6 * n, -1) / np.sqrt(len(G))
    K = truncated(rows, rank).reshape(n, 6, -1)
    K[:, 3:] *= TRANSLATION
    return K


def truncated(rows: Array, rank: int) -> Array:
    """Return (N, m) with m <= rank whose second moment is that of ``rows`` (N, M) but for `LEFT_OUT`."""
    if len(rows) <= 2 * rank:
        energy, U = np.linalg.eigh(rows @ rows.T)
    else:
        sketch = _sketch(rows.shape[1], rank + 12)
        Q = np.linalg.qr(rows @ (rows.T @ (rows @ sketch)))[0]
        small = Q.T @ rows
        energy, U = np.linalg.eigh(small @ small.T)
        U = Q @ U
    energy, U = np.maximum(energy[::-1], 0.0), U[:, ::-1]
    lost = (rows**2).sum() - np.cumsum(energy)
    m = min(int(np.argmax(lost <= LEFT_OUT * energy.sum())) + 1 if (lost <= LEFT_OUT * energy.sum()).any() else rank, rank)
    return U[:, :m] * np.sqrt(energy[:m])


@functools.lru_cache(maxsize=4)
def _sketch(size: int, m: int) -> Array:
    return np.random.default_rng(0).normal(size=(size, m))


def gauge_columns(tip: Array) -> Array:
    """(..., 6, 12) twists of poses (..., 3 or 4, 4) by a rotation and a shift of the base, then of the tip."""
    R, t = tip[..., :3, :3], tip[..., :3, 3]
    out = np.zeros((*tip.shape[:-2], 6, 12))
    out[..., :3, :3] = out[..., 3:, 3:6] = np.eye(3)
    x, y, z = np.moveaxis(t, -1, 0)
    out[..., 3, 1], out[..., 3, 2] = z, -y  # theta x t
    out[..., 4, 0], out[..., 4, 2] = -z, x
    out[..., 5, 0], out[..., 5, 1] = y, -x
    out[..., :3, 6:9] = out[..., 3:, 9:] = R
    return out
