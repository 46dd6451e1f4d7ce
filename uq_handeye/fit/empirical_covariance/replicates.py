r"""Any published estimator on resampled poses: its influence in closed form, and real re-solves in batches.

A resampled data set is a row of counts (n): how often each pose (or motion, where motions came without poses) takes
part. All rows of one call have the same sum, so that their problems have the same size and are solved together.

What counts do to a pair of poses: both must take part. Where a pose is drawn twice, the pair of it with itself says
nothing about X, yet it would enter a method that weights all motions alike. `4dpa` gives a pair the product of the
counts of its poses, under which it vanishes; the methods on ``G X C = W`` need no pairs; the others take each pose once
or not at all.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.se3 import Array
from ...errors import DegenerateMotionError, InputError
from ...methods.estimators.method import require_converged
from ...methods.estimators.registry import METHODS, ROBOT_WORLD_METHODS, find
from ...methods.procrustes.limit import pair_blocks
from ...methods.propagation.noise_transport import noise_of_pairs
from ...methods.propagation.propagate import pose_sensitivities
from ...methods.propagation.published_fit import AllPairs, mean_target, solve_all_pairs, target_by_X
from ...model.noise.models import Noise, PairNoise, PoseNoise, is_joint
from ...model.poses.motions import Motions, relative_motions
from ...model.poses.pose_pairs import PosePairs
from ..likelihood.constraint import OnMotions, OnPoses, Unknowns
from .sandwich import JOINT, Influence, pooled_influence

Counts = NDArray[np.intp]

# Motions or poses that are solved in one call, some 300 B each and a multiple of that while at work.
AT_ONCE = 40_000
# Motions whose derivatives are held at once.
BLOCK = 1024


class Solved(NamedTuple):
    """Solution for T resampled data sets, or for the original one without the leading axis."""

    X: Array  # (T, 4, 4)
    W: Array | None  # (T, 4, 4); None for motions without poses


class Problem:
    """One data set and one method of `METHODS` or `ROBOT_WORLD_METHODS`."""

    def __init__(self, data: PosePairs | Motions, method: str, X: Array | None, noise: Noise | None) -> None:
        if isinstance(noise, PoseNoise) and any(S is not None and is_joint(S) for S in (noise.robot, noise.camera)):
            raise InputError(JOINT)
        self.method, self.noise = method, noise
        self.motions: Motions | None = None
        self.poses: PosePairs | None
        if isinstance(data, PosePairs):
            self.poses, self.n = data, data.n
        else:
            self.poses, self.motions = data.poses, data
            self.n = data.N if data.poses is None else data.poses.n
        self.of_all_pairs = method == "4dpa" and self.motions is None
        self.both = ROBOT_WORLD_METHODS.get(method)
        if self.both is not None:
            if self.poses is None:
                raise InputError(f"Method {method!r} solves G X C = W: it needs poses, got motions without poses.")
        else:
            found = find(method)
            if not found.smooth:
                raise InputError(
                    f"The X of method {method!r} is no smooth function of the data, so that neither sandwich, "
                    "jackknife nor bootstrap is known to hold for it. Give the noise, or choose another method."
                )
            if found.weighted and self.poses is not None and isinstance(noise, PairNoise):
                raise InputError("Give PoseNoise: the motions share poses, and so do their errors.")
            if isinstance(data, PosePairs) and not self.of_all_pairs:
                self.motions = relative_motions(data, "all")
        self.at = self._at(X)

    def _at(self, X: Array | None) -> Solved:
        if self.both is not None:
            assert self.poses is not None
            return Solved(*self.both(self.poses))
        if X is None:
            found = self.solve(np.ones((1, self.n), dtype=np.intp))
            return Solved(found.X[0], None if found.W is None else found.W[0])
        return Solved(X, None if self.poses is None else mean_target(self.poses, X))

    # ------------------------------------------------------------------------------------------ in closed form

    def influence(self) -> Influence:
        """Return the `Influence` of the module `sandwich`, by pose (by motion where there are no poses)."""
        return pooled_influence(*self.first_order())

    def first_order(self) -> tuple[Array, Array, Array]:
        """Residuals (n, 6) at X and W, J (n, 6, p) and B (n, p, 6), in rad and m."""
        weighted = self.both is None and METHODS[self.method].weighted
        if weighted and self.noise is None:
            raise InputError(
                f"Method {self.method!r} weights by the noise: give the `noise` that it was estimated with, or choose "
                "kind='jackknife'."
            )
        X, W = self.at
        if self.poses is None:
            assert self.motions is not None
            A, B = self.motions.A, self.motions.B
            linear = OnMotions(A, B).linearise(Unknowns(X, None), A, B)
            by_X = self._by_motions(self.motions, X)
            return linear.r, linear.J, by_X @ np.linalg.inv(linear.sides[0])
        poses = self.poses
        on_poses = OnPoses(poses.robot, poses.camera, poses.setup == "eye-to-hand")
        linear = on_poses.linearise(Unknowns(X, W), poses.robot, poses.camera)
        by_error = np.linalg.inv(linear.sides[0])
        if self.both is not None:
            of_X, of_W = self.both.sensitivities(poses)
            return linear.r, linear.J, np.concatenate([of_X[0], of_W[0]], axis=1) @ by_error
        by_X = self._by_poses(poses, X) @ by_error
        by_W = np.eye(6) / poses.n + target_by_X(poses, X) @ by_X
        return linear.r, linear.J, np.concatenate([by_X, by_W], axis=1)

    def _by_poses(self, poses: PosePairs, X: Array) -> Array:
        """``d xi_X / d xi_G`` (n, 6, 6)."""
        if self.of_all_pairs and (everything := AllPairs(poses)).precise:
            return everything.sensitivities(X)[0]
        motions = relative_motions(poses, "all") if self.motions is None else self.motions
        # for methods that do not weight it only says whose derivatives are asked for
        noise = self.noise if isinstance(self.noise, PoseNoise) else PoseNoise(robot=np.eye(6))
        if noise.robot is None:
            noise = PoseNoise(robot=np.zeros((6, 6)), camera=noise.camera)
        by_robot = pose_sensitivities(motions, noise, X, self.method)[0]
        assert by_robot is not None
        return by_robot

    def _by_motions(self, motions: Motions, X: Array) -> Array:
        """``d xi_X / d xi_A`` (N, 6, 6)."""
        noise = self._noise_of_pairs(motions)
        A, B = motions.A[None], motions.B[None]
        derivatives = METHODS[self.method].solver.derivatives(A, B, noise, X[None])(slice(0, 1))
        F = [
            derivatives.block(A[:, pairs], B[:, pairs], pairs)[0, :, :, 0].transpose(2, 0, 1).copy()
            for pairs in pair_blocks(motions.N, BLOCK)
        ]
        return np.asarray(derivatives.weight(motions.N)[0] @ np.concatenate(F))

    def _noise_of_pairs(self, motions: Motions) -> PairNoise | None:
        if self.noise is None or not METHODS[self.method].weighted:
            return None
        return self.noise if isinstance(self.noise, PairNoise) else noise_of_pairs(motions, self.noise)

    # ------------------------------------------------------------------------------------------------ re-solved

    def require_repeatable(self) -> None:
        """Raise where a pose (or motion) cannot be drawn twice."""
        if self.poses is not None and not self.of_all_pairs and self.both is None:
            raise InputError(
                f"Bootstrap over poses is not available for method {self.method!r} on pairs: a pose drawn twice makes "
                "pairs with itself, which say nothing and which this method would weight. Choose kind='jackknife' or "
                "'sandwich', or one of the methods 4dpa (on PosePairs), shah, li, efficient, ml."
            )

    def require_all_pairs(self) -> None:
        """Raise where leaving a pose out takes more from the data than that pose."""
        if self.poses is None or self.motions is None or self.both is not None:
            return
        assert self.motions.pairs is not None
        pairs, n = np.sort(self.motions.pairs, axis=1), self.n
        if len(pairs) != n * (n - 1) // 2 or len(np.unique(pairs, axis=0)) != len(pairs):
            raise InputError(
                "The jackknife over poses needs all pairs: where a pose has few partners, leaving it out takes their "
                "share too. Give PosePairs, or relative_motions(poses, 'all'), or choose kind='sandwich'."
            )

    def solve(self, counts: Counts) -> Solved:
        """X and W of resampled data sets, counts (T, n); raises DegenerateMotionError if any of them is degenerate."""
        if self.of_all_pairs:
            assert self.poses is not None
            X = solve_all_pairs(self.poses, counts.astype(float))
            return Solved(X, self._targets(X, counts))
        if self.both is not None:
            assert self.poses is not None
            at = _repeated(counts)
            drawn = PosePairs(self.poses.robot[at], self.poses.camera[at], self.poses.setup)
            return Solved(*self.both(drawn))
        assert self.motions is not None
        found = METHODS[self.method]
        if self.poses is None:
            at = _repeated(counts)
        else:
            assert self.motions.pairs is not None
            at = _repeated(np.asarray((counts[:, self.motions.pairs] > 0).all(axis=-1), dtype=np.intp))
        noise = self._noise_of_pairs(self.motions)
        if noise is None:
            X = require_converged(found, found.estimate(self.motions.A[at], self.motions.B[at])).X
        else:  # covariances of their own for every motion: one data set at a time
            A, B = self.motions.A, self.motions.B
            X = np.stack([require_converged(found, found.estimate(A[row], B[row], noise.rows(row))).X for row in at])
        return Solved(X, self._targets(X, counts))

    def _targets(self, X: Array, counts: Counts) -> Array | None:
        """The means of ``G X C`` with so many of each pose (T, 4, 4)."""
        if self.poses is None:
            return None
        sums = counts @ self._products / counts.sum(axis=1, keepdims=True)
        turned = np.einsum("tabcd,tbc->tad", sums[:, :108].reshape(-1, 3, 3, 3, 4), X[:, :3, :3])
        mean = sums[:, 108:].reshape(-1, 3, 4)
        W = np.zeros_like(X)
        W[:, :3, :3] = orthonormalise(turned[..., :3])
        W[:, :3, 3] = turned[..., 3] + (mean[..., :3] @ X[:, :3, 3:])[..., 0] + mean[..., 3]
        W[:, 3, 3] = 1.0
        return W

    @cached_property
    def _products(self) -> Array:
        """Products that ``G X C`` is linear in, (n, 120): those of entries of R_G and C, and the entries of G."""
        assert self.poses is not None
        G, C = self.poses.effective_robot[:, :3], self.poses.camera[:, :3]
        products = G[:, :, :3, None, None] * C[:, None, None]
        return np.concatenate([products.reshape(self.n, 108), G.reshape(self.n, 12)], axis=1)

    @property
    def rows_at_once(self) -> int:
        """Resampled data sets per call, for bounded memory."""
        size = self.n if self.both is not None or self.motions is None else self.motions.N
        return max(1, AT_ONCE // size)

    def deletions(self) -> Iterator[Counts]:
        """Counts of all poses but one, one after the other, so many rows at once."""
        for start in range(0, self.n, self.rows_at_once):
            left_out = np.arange(start, min(start + self.rows_at_once, self.n))
            counts = np.ones((len(left_out), self.n), dtype=np.intp)
            counts[np.arange(len(left_out)), left_out] = 0
            yield counts

    def solve_each(self, counts: Counts) -> tuple[Solved, NDArray[np.bool_]]:
        """Solve as `solve`, and return which rows (T,) are determined; X = W = 1 in the others."""
        rows = len(counts)
        X = np.tile(np.eye(4), (rows, 1, 1))
        W = None if self.poses is None else X.copy()
        ok = np.zeros(rows, dtype=bool)

        def attempt(part: slice) -> None:
            try:
                found = self.solve(counts[part])
            except DegenerateMotionError:
                middle = (part.start + part.stop) // 2
                if middle > part.start:  # halve until the degenerate rows are alone
                    attempt(slice(part.start, middle))
                    attempt(slice(middle, part.stop))
                return
            X[part], ok[part] = found.X, True
            if W is not None:
                assert found.W is not None
                W[part] = found.W

        attempt(slice(0, rows))
        return Solved(X, W), ok


def _repeated(counts: Counts) -> Counts:
    """Return the rows of the data (T, m) that the counts (T, n) ask for; all sums must be m."""
    T, n = counts.shape
    return np.repeat(np.tile(np.arange(n), T), counts.ravel()).reshape(T, -1)
