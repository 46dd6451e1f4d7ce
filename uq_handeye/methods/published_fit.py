"""X, W and their covariances by a published method of METHODS or ROBOT_WORLD_METHODS, for `calibrate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np

from ..core.geometry.se3 import Array
from ..errors import InputError
from ..findings import Finding
from ..model.errors.models import Noise, PoseNoise
from ..model.poses.motions import Motions
from .all_pairs import AllPairs
from .method import require_converged
from .noise_transport import covariance_of_poses, noise_of_pairs
from .propagate import pose_sensitivities, propagate_and_check
from .registry import METHODS, ROBOT_WORLD_METHODS, find, solve
from .target_pose import mean_target, target_by_X, target_sensitivities
from .validity import find_curved


class Covariances(NamedTuple):
    """First-order covariances, and what speaks against them."""

    of_X: Array  # (6, 6)
    of_W: Array | None  # (6, 6)
    findings: list[Finding]


@dataclass(frozen=True, eq=False)
class Published:
    """X (4, 4) of a published method on the motions, and W where there are poses."""

    motions: Motions
    method: str
    scale: float | None
    X: Array
    W: Array | None
    iterations: int
    everything: AllPairs | None  # 4DPA of all pairs, without forming them

    def covariances(self, noise: Noise, kind: str | None = None) -> Covariances:
        """The covariances of X and, for noise on poses, of W (6, 6), to first order; ``kind`` as in `propagate`."""
        motions, method, poses = self.motions, self.method, self.motions.poses
        of_poses = noise.ITEM == "pose" and kind in (None, "poses")
        if method in ROBOT_WORLD_METHODS and not of_poses:
            raise InputError(f"Method {method!r} works on poses: its covariance needs PoseNoise and kind 'poses'.")
        if poses is None or not of_poses:
            S, findings = propagate_and_check(
                motions, noise=noise, X=self.X, method=method, scale=self.scale, kind=kind
            )
            return Covariances(S, None, findings)
        noise, findings = cast(PoseNoise, noise), []
        by_error: Sequence[Array | None]
        by_error_W: Sequence[Array | None]
        if method in ROBOT_WORLD_METHODS:
            by_error, by_error_W = ROBOT_WORLD_METHODS[method].sensitivities(poses)
        else:
            if self.everything:
                by_error = self.everything.sensitivities(self.X)
            else:
                by_error = pose_sensitivities(motions, noise, self.X, method, self.scale)
            by_error_W = target_sensitivities(poses, self.X, by_error)
        covariance, covariance_W = (covariance_of_poses(D, noise) for D in (by_error, by_error_W))
        if method in METHODS and not METHODS[method].smooth:
            # what is uncorrelated with the errors of the poses reaches W through X alone
            whole, findings = propagate_and_check(motions, noise, X=self.X, method=method)
            rest = whole - covariance
            J = target_by_X(poses, self.X)
            added = J @ rest @ J.T
            covariance, covariance_W = covariance + rest, covariance_W + 0.5 * (added + added.T)
        elif method in METHODS:
            findings = find_curved(METHODS[method], motions.A[None], motions.B[None], self.X[None], covariance[None])
        return Covariances(covariance, covariance_W, findings)


def fit_published(
    motions: Motions, noise: Noise | None, method: str, scale: float | None, everything: AllPairs | None
) -> Published:
    """X and W; ``noise`` weights the methods that take weights. Raises as `calibrate` does."""
    poses = motions.poses
    if method in ROBOT_WORLD_METHODS:
        if poses is None:
            raise InputError(f"Method {method!r} solves G X C = W: it needs poses, got motions without poses.")
        both = ROBOT_WORLD_METHODS[method](poses)
        return Published(motions, method, None, *both, 0, None)
    iterations = 0
    if everything:
        X = everything.solve()
    elif method == "4dpa":
        X = solve(motions.A, motions.B, scale=scale)
    else:
        found = find(method)
        weights = None
        if found.weighted and noise is not None:
            weights = noise_of_pairs(motions, noise)
        estimate = require_converged(found, found.estimate(motions.A, motions.B, weights))
        X, iterations = np.asarray(estimate.X), int(estimate.iterations)
    W = None if poses is None else mean_target(poses, X)
    return Published(motions, method, scale, X, W, iterations, everything)
