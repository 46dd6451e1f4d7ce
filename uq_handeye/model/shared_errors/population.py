r"""Prior of the errors of an unknown arm: the errors of a dozen known arms, scaled and placed at the poses.

**Model** (T17). The error of the measured robot poses is ``K z``, z ~ N(0, I), with columns K (n, 6, m) shared by all
poses: twists ``(theta, tau)`` (left rotation, rad; additive translation, m; in the base). K is in the unit in which the
3-D RMS position error of the arm over its workspace is 1 m: an arm of 0.6 mm absolute accuracy has the error
``0.6e-3 K z``.

**Arms.** Each geometry of `ARMS` is scaled so that its reach, of the flange from joint 2, is the distance of the
farthest pose from the base, with the tip of the poses as its flange, and placed at the poses by inverse
kinematics in its usual branch (`WorkPostures`). Columns F of its errors, with the standard deviations

| offsets | tilts | lengths | harmonics 1, 2 | sag |
|---|---|---|---|---|
| 0.6 mrad | 0.3 mrad | 0.25 mm per m of reach | 0.12 mrad | 0.3 mrad |

**Gauge.** The effect of a constant motion of the base and of the flange over the workspace is removed: 12 numbers by
least squares for each column at some hundred postures spread over the limits of the joints, rotations weighted by 0.3
of the reach, with the same 12 numbers at the poses. Another sample of as many postures gives other frames, which 12
further columns describe: motions of base and flange by the contribution of one posture to those numbers; X and W absorb
them. **Unit**: the RMS over the same postures.

**Mixture.** The columns of all arms that reach at least half of the poses (the three that reach most, if fewer do),
over the square root of their number, have the second moment of the mixture: ``K K^T = mean over arms K_a K_a^T``. A
truncated singular value decomposition with translations over `LENGTH_PER_RAD_M` leaves at most 32 columns: all but some
1 % of the energy for poses of one region, 10 % for 60 poses all over the workspace, which are noise of each pose.

*Scale.* Fourteen arms of the table in turn as the true one, its family left out of `ARMS`, 0.6 mm (known), 30 poses,
camera 0.03 deg and 0.3 mm: with a scale of 1.0, 1.2, 1.4, 1.7 the true X is inside its 95 % region in 94, 91, 88, 83 %
of the sets of one region and in 86, 81, 76, 71 % of those all over the workspace; in 95 % with the arm's own columns.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from ..kinematics.known_arms import known_arm
from ..kinematics.stack import ERRORS, SAGS, SHIFTS, TURNS, WAVES, ArmStack
from ..kinematics.work_postures import WorkPostures
from ..kinematics.workspace_gauge import twists

ARMS: tuple[str, ...] = (
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
# Standard deviations (rad, or of the reach) of the errors of each arm.
OFFSET_SD, TILT_SD, LENGTH_SD, HARMONIC_SD, SAG_SD = 0.6e-3, 0.3e-3, 0.25e-3, 0.12e-3, 0.3e-3
# Translations divided by this length count like rotations in rad.
LENGTH_PER_RAD_M = 0.5
# The frames of base and flange are this many times as uncertain between arms as by a sample of the workspace.
# DISTANT_SHARE is the share of the errors far from the poses of the data that is independent of the errors at these
# poses (`unseen`). All three were determined by leaving families of arms out.
BASE_RATIO, FLANGE_RATIO, DISTANT_SHARE = 10.0, 5.0, 0.5
# With noise estimated from the data, this share of the variance of further poses that z does not explain is added to
# theirs. That variance is the mean over the arms, and a few of them have most of it: of translations one arm has 0.29
# of that variance, 0.13 to 0.24 with six axes and 0.5 to 0.8 with seven (`studies.maintenance.what_is_left`, 70 sets of
# 0.6 mm, no noise; 0.22 without the family of the arm in the population). Squared distances by it are 0.88 of the
# expected ones, since small directions hold more. The page `studies/maintenance/unknown_arms.md` has the dependence of
# the p-values of unchanged rigs on it.
LEFT_BESIDE = 0.35
# Of more poses than these, as many over all of them determine the directions that are kept: the effects of an arm's
# errors are smooth, and their memory would grow by 50 kB a pose.
MAX_BOUND_POSES = 1000
# Poses have their errors in common where their tips, in units of the reach, and their orientations are nearer than
# this.
NEAR_TIP_SHARE, NEAR_TURN_RAD = 0.2, 0.5


@dataclass(frozen=True, eq=False)
class ArmPopulation:
    """Geometries of some arms, with the quantities that do not depend on the poses."""

    names: tuple[str, ...]
    stack: ArmStack
    postures: WorkPostures
    mixing: Array  # (A, c, 89) from the 77 columns and those of base and flange to c columns of unit RMS
    frames: Array  # (A, 12, 12) second moments of the motions of base and flange that are open

    @classmethod
    def of(cls, names: tuple[str, ...], n_postures: int = 400, left_out: float = 1e-4) -> ArmPopulation:
        """Return the population of the arms of these names.

        Rotations are weighted by 0.3 of the reach; the columns of each arm hold all but ``left_out`` of its
        energy over the workspace.
        """
        stack = ArmStack.of([known_arm(name) for name in names])
        unit = np.empty((ERRORS, 1))
        unit[TURNS, 0] = np.tile([TILT_SD, TILT_SD, OFFSET_SD], 7)
        unit[SHIFTS], unit[WAVES], unit[SAGS] = LENGTH_SD, HARMONIC_SD, SAG_SD
        q = stack.workspace(n_postures)
        frames = stack.frames(q)
        F = stack.columns(q, frames).reshape(len(names), ERRORS, -1)
        B = gauge_columns(frames.tip).reshape(len(names), 12, -1)
        weight = np.repeat([0.3] * 3 + [1.0] * 3, n_postures)
        inverse = np.linalg.pinv(B * weight)
        gauge, rms, second = np.empty((len(names), ERRORS, 12)), np.empty((len(names), 1, 1)), []
        for a, free in enumerate(F):  # arm by arm, which a cache holds
            free *= unit
            gauge[a] = (free * weight) @ inverse[a]
            free -= gauge[a] @ B[a]
            shifts = free[:, 3 * n_postures :]
            rms[a] = np.sqrt(np.vdot(shifts, shifts) / n_postures)
            free *= weight
            second.append(free @ free.T)
        energy, V = np.linalg.eigh(np.array(second))  # ascending
        lost = np.cumsum(energy, axis=1) / energy.sum(axis=1, keepdims=True)
        kept = ERRORS - int((lost < left_out).sum(axis=1).min())
        V = V[:, :, ERRORS - kept :].mT / rms
        mixing = np.concatenate([V * unit[:, 0], -V @ gauge], axis=2)
        # what the frames of base and flange would be by another sample of the workspace
        moved = np.empty((len(names), 12, 12))
        for a, free in enumerate(F):
            of_posture = (V[a] @ free).reshape(-1, 6, n_postures)
            moments = np.einsum("ekn,eln->kln", of_posture, of_posture)
            by_frame = inverse[a].reshape(6, n_postures, 12)
            moved[a] = inverse[a].T @ np.einsum("kln,lnj->knj", moments, by_frame).reshape(-1, 12)
        unlike = np.repeat([BASE_RATIO, FLANGE_RATIO], 6)
        return cls(names, stack, WorkPostures.of(stack), mixing, moved * np.outer(unlike, unlike))

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


@dataclass(frozen=True, eq=False)
class BoundPopulation(ReadOnlyArrays):
    """The population at the poses of one data set: the same numbers z at these and at other poses."""

    arms: tuple[str, ...]
    reach: float  # m
    kept: NDArray[np.bool_]  # (A,) the arms that reach the poses
    basis: Array  # (M, m - 12) z in units of all errors of these arms
    frames: Array  # (12, 12) motions of base and flange by the last 12 of z
    here: Array  # (n, 6, m) K at the poses
    left: Array  # (n, 6, 6) covariance that z leaves of them
    robot: Array  # (n, 4, 4) the poses

    @classmethod
    def of(
        cls,
        robot: Array,
        reach: float | None = None,
        arms: tuple[str, ...] | None = None,
        rank: int = 32,
        min_arms: int = 3,
    ) -> BoundPopulation:
        """Bind the population to poses ``robot`` (n, 4, 4) base_T_tip; see the module.

        ``reach`` (m) of the arm; None: the distance of the farthest pose. ``rank``: the largest number of columns but
        for those of base and flange. ``min_arms``: of those that reach most poses.
        """
        robot, arms = np.asarray(robot, dtype=float), ARMS if arms is None else tuple(arms)
        if reach is None:
            reach = max(float(np.linalg.norm(robot[:, :3, 3], axis=-1).max()), 1e-6)
        if (n := len(robot)) > MAX_BOUND_POSES:
            some = np.linspace(0, n - 1, MAX_BOUND_POSES).round().astype(np.intp)
            return cls.of(robot[some], reach, arms, rank, min_arms)._at_all(robot)
        G, reached = _of_each_arm(arms, reach, robot)
        share = reached.mean(axis=1)
        kept = (share >= 0.5) | (share >= np.sort(share)[-min(min_arms, len(share))])
        rows = _rows(G[kept])
        # the range is looked for with 12 directions more than are kept
        U, energy = truncated(rows, _sketch(robot, reach, rank + 12), rank)
        basis = rows.T @ U / np.sqrt(np.maximum(energy, 1e-300))
        K = cls._unscaled(U * np.sqrt(energy))
        unit = np.tile(np.repeat([1.0 / reach, 1.0], 3), 2)
        second = population(arms).frames[kept].mean(axis=0) * np.outer(unit, unit)
        frames = np.linalg.cholesky(second + np.diag(1e-12 * np.diag(second) + 1e-30))
        here = np.concatenate([K, twists(robot) @ frames], axis=-1)
        return cls(arms, reach, kept, basis, frames, here, _left(cls._unscaled(rows), K, 1.0), robot)

    def _at_all(self, robot: Array) -> BoundPopulation:
        """Return the population with its columns at all poses ``robot`` (n, 4, 4) of the data, part by part."""
        here, left = [], []
        for start in range(0, len(robot), MAX_BOUND_POSES):
            whole, K = self._at(part := robot[start : start + MAX_BOUND_POSES])
            here.append(np.concatenate([K, twists(part) @ self.frames], axis=-1))
            left.append(_left(whole, K, 1.0))
        return replace(self, here=np.concatenate(here), left=np.concatenate(left), robot=robot)

    def columns(self, robot: Array) -> Array:
        """K (n, 6, m) at poses ``robot`` (n, 4, 4)."""
        K = self._unscaled(self._rows_at(robot) @ self.basis)
        return np.concatenate([K, twists(np.asarray(robot, dtype=float)) @ self.frames], axis=-1)

    def unseen(self, robot: Array, measured: bool = False) -> Array:
        """(n, 6, 6) covariance of errors of other poses (n, 4, 4) that z does not explain.

        A share of their variance is independent of the poses of the data: ``DISTANT_SHARE^2 (1 - rho^2)^4``, rho the
        correlation ``exp(-d^2 / 2)`` with the nearest pose of the data, so that it is 0 at these. The errors of the
        geometries are smooth, and known where they were measured. ``measured``: in addition to noise estimated from the
        data. This noise already contains that share for a pose as far from the others as the poses of the data are from
        each other; only the excess over the share of nine of ten of these poses counts, and `LEFT_BESIDE` of the
        covariance that z does not explain.
        """
        whole, known = self._at(robot)
        share = self._unknown_again(self._apart(robot))[:, None, None]
        if not measured:
            return _left(whole, known, 1.0 + share)
        others = [self._unknown_again(self._apart(self.robot[[k]], k)) for k in range(len(self.robot))]
        more = np.maximum(share - np.quantile(others, 0.9), 0.0)
        return LEFT_BESIDE * _left(whole, known, 1.0) + more * whole @ whole.mT

    def left_at(self, robot: Array) -> Array:
        """(n, 6, 6) covariance that z leaves of other poses, the mean over the arms."""
        return _left(*self._at(robot), 1.0)

    def _at(self, robot: Array) -> tuple[Array, Array]:
        rows = self._rows_at(robot)
        return self._unscaled(rows), self._unscaled(rows @ self.basis)

    @staticmethod
    def _unknown_again(apart: Array) -> Array:
        return np.asarray(DISTANT_SHARE**2 * (1.0 - np.exp(-apart)) ** 4)

    def _apart(self, robot: Array, without: int | None = None) -> Array:
        """(n,) squared distance d^2 of poses from the nearest of the data, over `NEAR_TIP_SHARE`, `NEAR_TURN_RAD`."""
        found = np.empty(len(robot))
        data = self.robot if without is None else np.delete(self.robot, without, axis=0)
        for k, pose in enumerate(np.asarray(robot, dtype=float)):
            tips = np.sum((data[:, :3, 3] - pose[:3, 3]) ** 2, axis=-1) / (NEAR_TIP_SHARE * self.reach) ** 2
            cosine = 0.5 * (np.einsum("nij,ij->n", data[:, :3, :3], pose[:3, :3]) - 1.0)
            found[k] = (tips + (np.arccos(np.clip(cosine, -1.0, 1.0)) / NEAR_TURN_RAD) ** 2).min(initial=np.inf)
        return found

    def _rows_at(self, robot: Array) -> Array:
        return _rows(_of_each_arm(self.arms, self.reach, np.asarray(robot, dtype=float))[0][self.kept])

    @staticmethod
    def _unscaled(rows: Array) -> Array:
        K = rows.reshape(6, -1, rows.shape[-1]).swapaxes(0, 1).copy()
        K[:, 3:] *= LENGTH_PER_RAD_M
        return K


@functools.lru_cache(maxsize=2)  # a result file asks for the poses again that were calibrated or read
def bound_population(robot: bytes, reach: float | None) -> BoundPopulation:
    """Return the population bound to poses (n, 4, 4), float64 in C order, of an arm of this reach (m)."""
    return BoundPopulation.of(np.frombuffer(robot).reshape(-1, 4, 4), reach)


def _left(whole: Array, K: Array, share: float | Array) -> Array:
    """(n, 6, 6) ``share whole whole^T - K K^T``, without negative eigenvalues."""
    found = share * whole @ whole.mT - K @ K.mT
    values, vectors = np.linalg.eigh(0.5 * (found + found.mT))
    return np.asarray((vectors * np.maximum(values, 0.0)[..., None, :]) @ vectors.mT)


def _of_each_arm(arms: tuple[str, ...], reach: float, robot: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Columns (A, c, 6, n) of each arm of this reach, rad and m, and whether it reaches the poses (A, n)."""
    known, poses = population(tuple(arms)), robot[:, :3].copy()
    poses[..., 3] /= reach
    parts = [known.columns(poses[start : start + 64]) for start in range(0, len(robot), 64)]
    G = np.concatenate([part[0] for part in parts], axis=-1)
    G[:, :, :3] /= reach
    return G, np.concatenate([part[1] for part in parts], axis=1)


def _rows(G: Array) -> Array:
    """(6n, M) all columns of the arms (A, c, 6, n), translations over `LENGTH_PER_RAD_M`."""
    scale = np.repeat([1.0, 1.0 / LENGTH_PER_RAD_M], 3)[:, None] / np.sqrt(len(G))
    return np.asarray((G * scale).reshape(-1, 6 * G.shape[-1]).T)


def truncated(rows: Array, sketch: Array, rank: int, left_out: float = 1e-3) -> tuple[Array, Array]:
    """Return U (N, m) and energies (m,), m <= rank: ``U diag(energy) U^T`` is the second moment of ``rows`` (N, M).

    But for ``left_out`` of its trace. The singular vectors are those within the range of ``(rows rows^T)^2 sketch``,
    ``sketch`` (N, k) with k above the rank (Halko, Martinsson, Tropp 2011), or all of them where there are fewer. The
    result depends on ``rows rows^T`` alone, not on the basis of the columns, which is one of rounding.
    """
    if min(rows.shape) > sketch.shape[1]:
        rows_of_range = rows @ (rows.T @ (rows @ (rows.T @ sketch)))
    else:
        rows_of_range = rows if rows.shape[1] <= len(rows) else np.eye(len(rows))
    Q = np.linalg.qr(rows_of_range)[0]
    small = Q.T @ rows
    energy, U = np.linalg.eigh(small @ small.T)
    energy, U = np.maximum(energy[::-1], 0.0), U[:, ::-1]
    left = (rows**2).sum() - np.cumsum(energy[:rank])
    m = int(np.count_nonzero(left > left_out * energy.sum())) + 1
    m = min(m, rank)
    return np.asarray(Q @ U[:, :m]), energy[:m]


def _sketch(robot: Array, reach: float, count: int) -> Array:
    """(6n, count) cosines of random functions of each pose (n, 4, 4), so that a permutation of poses permutes it."""
    numbers, turns = _random_waves(count)
    pose = np.concatenate([robot[:, :3, :3].reshape(-1, 9), robot[:, :3, 3] / reach], axis=-1)
    return np.asarray(np.cos((pose @ numbers).reshape(len(pose), 6, count) + turns).swapaxes(0, 1).reshape(-1, count))


@functools.lru_cache(maxsize=8)
def _random_waves(count: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(0)
    return 3.0 * rng.normal(size=(12, 6 * count)), rng.uniform(0.0, 2.0 * np.pi, size=(6, count))


def gauge_columns(tip: Array) -> Array:
    """(A, 12, 6, n) twists of tips (A, 3, 4, n) by a rotation and a shift of the base, then of the tip."""
    A, _, _, n = tip.shape
    out = np.zeros((A, 12, 6, n))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[:, i, i] = out[:, 3 + i, 3 + i] = 1.0
        out[:, i, 3 + j], out[:, i, 3 + k] = -tip[:, k, 3], tip[:, j, 3]  # e_i x t
        out[:, 6 + i, :3] = out[:, 9 + i, 3:] = tip[:, :, i]
    return out
