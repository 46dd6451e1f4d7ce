r"""Covariances of X and W of any estimator that need no noise model, by pose.

Each pose is one draw from an unknown distribution of errors, independent of the others. Motions that came without poses
take the place of poses. Units and conventions: ``xi = (theta, tau)``, left rotation, additive translation, rad and m.

A published method enters by the first derivatives of X and W by the residual of each pose. For pairs of poses these
are the sums over the pairs that a pose is in. `studies.real_cell` prints the coverage of the 95 % ellipsoid of each
kind.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.geometry.checks import as_transforms
from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from ...errors import InputError, require_type
from ...methods.all_pairs import AllPairs, solve_all_pairs
from ...methods.method import require_converged
from ...methods.noise_transport import noise_of_pairs
from ...methods.pairs import pair_blocks
from ...methods.propagate import pose_sensitivities
from ...methods.registry import METHODS, ROBOT_WORLD_METHODS, find
from ...methods.target_pose import mean_target, target_by_X
from ...model.errors.models import Noise, PairNoise, PoseNoise, is_joint
from ...model.poses.motions import Motions, relative_motions
from ...model.poses.pose_pairs import PosePairs
from ..graph.constraint import OnMotions, OnPoses, Unknowns
from ..graph.gauss_helmert import ESTIMATORS, Fit
from ..graph.request import OF_RESIDUALS
from .sandwich import JOINT, Influence, influence_of, of_known, pooled_influence


@dataclass(frozen=True, eq=False)
class Resampled(ReadOnlyArrays):
    """A covariance of X and W from the data only; see the module."""

    kind: str  # one of OF_RESIDUALS
    # (p, p) of (xi_X, xi_W), p = 12; of xi_X, p = 6, where there is no W. Regular on the whole if clusters > p.
    covariance: Array
    clusters: int
    cluster: str  # "poses" or "motions": what was taken as independent
    freedom: float  # nu of `reference`, Hotelling

    @property
    def covariance_X(self) -> Array:
        """(6, 6)"""
        return self.covariance[:6, :6]

    @property
    def covariance_W(self) -> Array | None:
        """(6, 6); None for motions without poses."""
        return None if len(self.covariance) == 6 else self.covariance[6:, 6:]


def resampled(
    data: PosePairs | Motions,
    method: str = "efficient",
    kind: str = "sandwich",
    *,
    X: Array | None = None,
    fit: Fit | None = None,
    noise: Noise | None = None,
    replicates: int = 2000,
    seed: int | np.random.Generator = 0,
) -> Resampled:
    """The covariance of any method's X and W from the data only, clustered by pose.

    Parameters
    ----------
    data : PosePairs or Motions
        One data set. Of PosePairs the methods on pairs use all. Motions that were made from poses are clustered by
        pose, other motions by motion.
    method : str
        "efficient", "ml", or a name in `METHODS` or `ROBOT_WORLD_METHODS`.
    kind : "sandwich" or "bootstrap"
    X : (4, 4) or None
        The estimate of this method; None solves for it. Of no use to "efficient", "ml" and the methods with a W of
        their own.
    fit : Fit or None
        Of "efficient" and "ml", where it is at hand; None makes it with ``noise``.
    noise : PoseNoise, PairNoise or None
        What "efficient", "ml" and ``nguyen`` weight by.
    replicates, seed
        Of "bootstrap".

    Raises
    ------
    InputError
        An unknown method or kind; a method whose X is no smooth function of the data; fewer than 7 clusters; poses
        whose noise is joint.
    DegenerateMotionError
        The data, or the data without one pose, do not determine X; or most bootstrap draws do not.
    NotConvergedError
        An iterative method did not converge.

    Examples
    --------
    >>> import numpy as np, uq_handeye as uq
    >>> from uq_handeye.fit.diagnostics.resampled import resampled
    >>> noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    >>> found = resampled(uq.simulate(n_poses=40, noise=noise, seed=1), "4dpa")
    >>> found.clusters, found.covariance_X.shape
    (40, (6, 6))
    """
    if kind not in OF_RESIDUALS:
        raise InputError(f"Expected `kind` to be one of {', '.join(OF_RESIDUALS)}, got {kind!r}.")
    known = (*ESTIMATORS, *METHODS, *ROBOT_WORLD_METHODS)
    if method not in known:
        raise InputError(f"Expected `method` to be one of {', '.join(known)}, got {method!r}.")
    require_type("data", data, (PosePairs, Motions), "PosePairs or Motions")
    first = data.A if isinstance(data, Motions) else data.robot
    if first.ndim != 3:
        raise InputError(f"Expected one data set, got leading axes {first.shape[:-3]}.")
    known_beforehand: Array | float = 0.0
    if method in ESTIMATORS:
        if fit is None:
            if noise is None:
                raise InputError(f"Method {method!r} weights by the noise: give `noise`, or the `fit`.")
            fit = ESTIMATORS[method](data, noise)
        if fit.W is None and data.poses is not None:
            raise InputError(
                "The fit was made on motions that share poses, so that no two of them are independent. Fit on the "
                "poses: give PoseNoise."
            )
        influence, p, of_poses = influence_of(fit), fit.covariance.shape[-1], fit.W is not None
        known_beforehand = of_known(fit)
    else:
        at = None if X is None else as_transforms(X, "X", stack=False)
        influence = pooled_influence(*OfMethod(data, method, at, noise).first_order())
        p, of_poses = influence.J.shape[-1], data.poses is not None
    covariance = influence.sandwich() if kind == "sandwich" else influence.bootstrap(replicates, seed)
    cluster = "poses" if of_poses else "motions"
    return Resampled(kind, covariance[:p, :p] + known_beforehand, influence.n, cluster, float(influence.freedom))


class OfMethod:
    """One data set and one method of `METHODS` or `ROBOT_WORLD_METHODS`: its X and W and their derivatives."""

    def __init__(self, data: PosePairs | Motions, method: str, X: Array | None, noise: Noise | None) -> None:
        if noise is not None and any(S is not None and is_joint(S) for S in noise.sides.values()):
            raise InputError(JOINT)
        self.method, self.noise, self.poses = method, noise, data.poses
        self.both = ROBOT_WORLD_METHODS.get(method)
        self.motions: Motions | None = None
        self.of_all_pairs = method == "4dpa" and data is self.poses
        if self.both is not None:
            if self.poses is None:
                raise InputError(f"Method {method!r} solves G X C = W: it needs poses, got motions without poses.")
            self.at = Unknowns(*self.both(self.poses))
            return
        found = find(method)
        if not found.smooth:
            raise InputError(
                f"The X of method {method!r} is no smooth function of the data, so that neither sandwich "
                "nor bootstrap is known to hold for it. Give the noise, or choose another method."
            )
        if found.weighted and noise is None:
            raise InputError(f"Method {method!r} weights by the noise: give the `noise` that it was estimated with.")
        if found.weighted and self.poses is not None and noise is not None and noise.ITEM == "motion":
            raise InputError("Give PoseNoise: the motions share poses, and so do their errors.")
        if not self.of_all_pairs:
            self.motions = data if isinstance(data, Motions) else relative_motions(data, "all")
        if X is None and self.of_all_pairs:
            assert self.poses is not None
            X = solve_all_pairs(self.poses)
        elif X is None:
            assert self.motions is not None
            X = require_converged(found, found.estimate(self.motions.A, self.motions.B, self.of_pairs())).X
        self.at = Unknowns(X, None if self.poses is None else mean_target(self.poses, X))

    def of_pairs(self) -> PairNoise | None:
        """Return the noise of the motions, of a method that weights by it."""
        if self.noise is None or not METHODS[self.method].weighted:
            return None
        assert self.motions is not None
        return self.noise if isinstance(self.noise, PairNoise) else noise_of_pairs(self.motions, self.noise)

    def influence(self) -> Influence:
        """Return the `Influence` of the module `sandwich`, by pose (by motion where there are no poses)."""
        return pooled_influence(*self.first_order())

    def first_order(self) -> tuple[Array, Array, Array]:
        """Residuals (n, 6) at X and W, J (n, 6, p) and B (n, p, 6), in rad and m."""
        X, _ = self.at
        if self.poses is None:
            assert self.motions is not None
            A, B = self.motions.A, self.motions.B
            linear = OnMotions(A, B).linearise(self.at, A, B)
            return linear.r, linear.J, self._by_motions(A, B, X) @ np.linalg.inv(linear.sides[0])
        poses = self.poses
        on_poses = OnPoses(poses.robot, poses.camera, poses.setup == "eye-to-hand")
        linear = on_poses.linearise(self.at, poses.robot, poses.camera)
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
        # for methods that do not weight it only says which derivatives are computed
        noise = self.noise if isinstance(self.noise, PoseNoise) else PoseNoise(robot=np.eye(6))
        if noise.robot is None:
            noise = PoseNoise(robot=np.zeros((6, 6)), camera=noise.camera)
        by_robot = pose_sensitivities(motions, noise, X, self.method)[0]
        assert by_robot is not None
        return by_robot

    def _by_motions(self, A: Array, B: Array, X: Array, at_once: int = 1024) -> Array:
        """``d xi_X / d xi_A`` (N, 6, 6); derivatives of ``at_once`` motions are held at once."""
        A, B, N = A[None], B[None], len(A)
        derivatives = METHODS[self.method].solver.derivatives(A, B, self.of_pairs(), X[None])(slice(0, 1))
        F = [
            derivatives.block(A[:, pairs], B[:, pairs], pairs)[0, :, :, 0].transpose(2, 0, 1).copy()
            for pairs in pair_blocks(N, at_once)
        ]
        return np.asarray(derivatives.weight(N)[0] @ np.concatenate(F))
