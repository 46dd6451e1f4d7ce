r"""Definition of a simulated trial: exact data, the noise that is added to them, and the method that is tested.

Model: true poses with ``G_i X C_i = W``, or true motions with ``A_i X = X B_i``; the measured ones are
``R = exp([theta]x) R_true``, ``t = t_true + tau`` with ``xi = (theta, tau)`` drawn from the noise (rad, m). The true
data are those of a simulation where the poses carry them. Around real data they are the poses (motions) as maximum
likelihood corrects them, which fit the constraint to second order in the noise, and exactly once one side is computed
from the other.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.geometry.se3 import Array, inverse
from ...core.rounding import CHAIN_ROUNDING, TINY
from ...errors import DegenerateMotionError, InputError, NotConvergedError, SingularNoiseError, among, require_type
from ...fit.graph.constraint import constraint_of, require_noise_fits
from ...fit.graph.gauss_helmert import ESTIMATORS, Fit, bound, corrected, maximum_likelihood
from ...fit.graph.noise_of_data import estimate_noise
from ...methods.all_pairs import AllPairs, solve_all_pairs
from ...methods.limit import solve_limit
from ...methods.noise_transport import noise_of_pairs
from ...methods.published_fit import Published
from ...methods.registry import METHODS, ROBOT_WORLD_METHODS
from ...methods.target_pose import mean_target
from ...model.errors.models import Noise, PairNoise, PoseNoise
from ...model.errors.noise_estimate import NoiseEstimate
from ...model.poses.motions import Motions, pair_indices, relative_motions
from ...model.poses.pose_pairs import PosePairs, Truth


@dataclass(frozen=True, eq=False)
class Experiment:
    """One problem with known truth, its noise and a method."""

    truth: PosePairs | Motions  # exact; poses for PoseNoise, motions for PairNoise
    X: Array  # (4, 4)
    W: Array | None  # (4, 4); None on motions
    noise: Noise
    method: str
    scale: float | None = None
    pairs: NDArray[np.intp] | None = None  # (N, 2), the pairs that are made of the poses; None: all

    def __post_init__(self) -> None:  # rounding follows the order in memory
        object.__setattr__(self, "X", np.ascontiguousarray(self.X))
        object.__setattr__(self, "W", None if self.W is None else np.ascontiguousarray(self.W))

    @property
    def on_poses(self) -> bool:
        """True if errors are those of poses, rather than of motions."""
        return self.truth.poses is self.truth

    @property
    def plain_motions(self) -> bool:
        """True if it is 4DPA in its limit on motions, which has an engine of its own."""
        return not self.on_poses and self.method == "4dpa" and self.scale is None

    @property
    def count(self) -> int:
        """Number of poses, or of motions."""
        return len(self.truth)

    @property
    def sides(self) -> tuple[Array, Array]:
        """True poses or motions (n, 4, 4) of robot and camera."""
        return sides_of(self.truth)

    def measured(self, first: Array, second: Array) -> PosePairs | Motions:
        """Poses or motions (..., n, 4, 4) of robot and camera as data of the same kind."""
        poses = self.truth.poses
        return Motions(first, second) if poses is None or not self.on_poses else PosePairs(first, second, poses.setup)

    @property
    def choice(self) -> str | NDArray[np.intp]:
        """Pairs to make of the poses, as `relative_motions` takes them."""
        return "all" if self.pairs is None else self.pairs

    @cached_property
    def everything(self) -> AllPairs | None:
        """4DPA of all pairs of the true poses without forming them; None otherwise, and where digits are lost."""
        poses = self.truth.poses
        if poses is not self.truth or self.method != "4dpa" or self.pairs is not None or self.scale is not None:
            return None
        assert poses is not None
        return everything if (everything := AllPairs(poses)).precise else None

    @property
    def number_of_pairs(self) -> int:
        """Number of the motions, without forming them."""
        if not self.on_poses:
            return self.count
        return self.count * (self.count - 1) // 2 if self.pairs is None else len(self.pairs)

    @property
    def forms_pairs(self) -> bool:
        """True if every trial works on the pairs, rather than on the poses themselves."""
        return self.method in METHODS and self.everything is None

    @property
    def size(self) -> int:
        """Pairs or poses that every trial works on."""
        return self.number_of_pairs if self.forms_pairs else self.count

    @cached_property
    def motions(self) -> Motions:
        """The true motions: those given, or of the pairs of the true poses."""
        return motions_of(self.truth, self.choice)

    @cached_property
    def weights(self) -> PairNoise | None:
        """The noise of each pair for a method that weights by it, to first order at the true data."""
        if self.method not in METHODS or not METHODS[self.method].weighted:
            return None
        return noise_of_pairs(self.motions, self.noise)

    def predicted(self, kind: str | None = None) -> Array:
        """The first-order covariance (6, 6) of X by the method, at the true data; ``kind`` as in `propagate`.

        Raises `InputError` where the method has none for this noise.
        """
        if self.method in ESTIMATORS:
            if kind not in (None, "poses" if self.on_poses else "pairs"):
                raise InputError(f"Expected no kind={kind!r} with method {self.method!r}: it is for published methods.")
            found = bound(self.truth, self.noise, None if self.on_poses else self.X)
            _require_rank(found)
            return found
        everything = self.everything if kind in (None, "poses") else None
        if everything is not None:
            return everything.propagate(cast(PoseNoise, self.noise), self.X)
        published = Published(self.motions, self.method, self.scale, self.X, self.W, 0, None)
        return published.covariances(self.noise, kind)[0]


def sides_of(data: PosePairs | Motions) -> tuple[Array, Array]:
    """Poses or motions (..., n, 4, 4) of robot and camera."""
    return (data.robot, data.camera) if data.poses is data else (data.A, data.B)  # type: ignore[union-attr]


def motions_of(data: PosePairs | Motions, pairs: str | ArrayLike = "all") -> Motions:
    """The motions that ``pairs`` makes of poses, or the motions given."""
    return relative_motions(data, pairs) if isinstance(data, PosePairs) else data


class Fitted(Protocol):
    """The part of a `Calibration`, which is defined in a higher package, that is read here."""

    @property
    def noise_estimate(self) -> NoiseEstimate | None: ...

    @property
    def used(self) -> tuple[PosePairs | Motions, Noise]: ...


def problem_of(
    data: PosePairs | Motions | Fitted, noise: Noise | None
) -> tuple[PosePairs | Motions, Noise | None, bool]:
    """Data, noise, and whether the noise is estimated: as given, or those that a calibration used.

    Raises `InputError` for a calibration together with other noise, or one without poses or noise.
    """
    if isinstance(data, PosePairs | Motions) or not hasattr(data, "used"):
        return cast(PosePairs | Motions, data), noise, noise is None  # what is neither is refused where it is used
    if noise is not None:
        raise InputError("Expected no `noise` beside a calibration, which brings the noise that it used.")
    used, of_used = data.used
    return used, of_used, data.noise_estimate is not None


def experiment(
    data: PosePairs | Motions,
    noise: Noise | None,
    method: str = "4dpa",
    *,
    pairs: str | ArrayLike = "all",
    scale: float | None = None,
) -> Experiment:
    """Return the experiment to repeat, around the truth of simulated poses or around real data as they were fitted.

    Parameters
    ----------
    data : PosePairs or Motions
        One data set, without leading axes.
    noise : PoseNoise, PairNoise or None
        None estimates it from the data (`estimate_noise`). PairNoise on poses is noise of the motions that ``pairs``
        makes of them.
    method : str
        ``efficient``, ``ml``, or a name in `METHODS` or `ROBOT_WORLD_METHODS`.
    pairs : "all", "consecutive", "disjoint" or (N, 2) integers
        Pairs that are made of poses; Motions come with theirs.
    scale : float or None
        Scaling factor d of 4DPA.

    Raises
    ------
    InputError
        Data, noise and method that do not fit each other.
    DegenerateMotionError
        The data do not determine X.
    NotConvergedError
        The fit around which the noise would be drawn did not converge.
    """
    require_type("data", data, (PosePairs, Motions), "PosePairs or Motions")
    known = [*ESTIMATORS, *METHODS, *ROBOT_WORLD_METHODS]
    if not among(method, known):
        raise InputError(f"Expected `method` to be one of {', '.join(known)}, got {method!r}.")
    if scale is not None and method != "4dpa":
        raise InputError(f"Expected no `scale` with method {method!r}: it is the scaling factor of 4dpa.")
    if noise is not None and noise.prior is not None and method not in ESTIMATORS:
        raise InputError(f"Method {method!r} takes no prior of X or W, which the noise has; use efficient or ml.")
    poses = data.poses
    if sides_of(data)[0].ndim != 3:
        raise InputError("Expected one data set, got a batch.")
    if poses is not None and poses.n < 3:
        raise InputError(f"Expected at least 3 poses, which make 2 motions, got {poses.n}.")
    if noise is None:
        noise = estimate_noise(data if poses is None else poses).noise
        if noise is None:
            raise InputError("The data fit exactly, so that they show no noise to draw: give `noise`.")
    of_pairs = noise.ITEM == "motion"
    if of_pairs and method in ROBOT_WORLD_METHODS:
        raise InputError(f"Method {method!r} solves G X C = W on poses: it needs PoseNoise, got PairNoise.")
    index = getattr(data, "pairs", None)  # poses have none
    if poses is not None and not of_pairs:
        if index is None and not np.array_equal(pairs, "all"):
            index = pair_indices(poses.n, pairs)
        require_noise_fits(noise, Motions(poses.robot[:2], poses.camera[:2], pair_indices(poses.n)[:2], poses))
        exact = poses if poses.truth is not None else _exact_poses(poses, noise)
        truth = exact.truth
        assert truth is not None
        truth = Truth(*(np.ascontiguousarray(T) for T in truth))
        true_poses = PosePairs(truth.robot, truth.camera, poses.setup, poses.timestamps, truth)
        _require_closed(true_poses, noise)
        return Experiment(true_poses, truth.X, truth.W, noise, method, scale, index)
    motions = motions_of(data, pairs)
    if motions.N < 2:
        raise InputError(f"Expected at least 2 motions to determine X, got {motions.N}.")
    require_noise_fits(noise, motions)
    if poses is not None and poses.truth is not None:
        true_poses = PosePairs(poses.truth.robot, poses.truth.camera, poses.setup)
        of_truth = relative_motions(true_poses, "all" if motions.pairs is None else motions.pairs)
        _require_closed(Motions(of_truth.A, of_truth.B), noise, poses.truth.X)
        return Experiment(Motions(of_truth.A, of_truth.B), poses.truth.X, None, noise, method, scale)
    A, B, X = _exact_motions(motions, cast(PairNoise, noise))  # motions without poses take no other
    _require_closed(Motions(A, B), noise, X)
    return Experiment(Motions(A, B), X, None, noise, method, scale)


def _require_closed(truth: PosePairs | Motions, noise: Noise, X: Array | None = None) -> None:
    """Raise `DegenerateMotionError` where true motions about one axis leave a part of X open, whatever the method."""
    if constraint_of(truth, noise).one_axis.all():
        with suppress(SingularNoiseError):  # only published methods run on such noise, and judge motions themselves
            _require_rank(bound(truth, noise, X))


def _require_rank(found: Array) -> None:
    """Raise `DegenerateMotionError` where a covariance of X (6, 6) has open directions: there is none to be tested."""
    unit = np.sqrt(np.maximum(np.diag(found), TINY))
    values, vectors = np.linalg.eigh(found / np.outer(unit, unit))
    open_ = values < CHAIN_ROUNDING
    if open_.any():
        directions = vectors[:, open_].T / unit
        raise DegenerateMotionError(
            "The motions leave a part of X open, for which there is no covariance to be tested. With a prior of X or W "
            "(--known, --prior-x; `prior_X`, `prior_W` of calibrate()) that of efficient and ml can be tested.",
            directions / np.linalg.norm(directions, axis=1, keepdims=True),
        )


def _fitted(data: PosePairs | Motions, noise: Noise) -> Fit | None:
    """Maximum likelihood; None where the noise leaves a part of the residuals exact, so that there is none."""
    found: Fit | None = None
    try:
        with suppress(SingularNoiseError):
            found = maximum_likelihood(data, noise)
    except NotConvergedError as error:
        raise NotConvergedError(
            "The poses around which noise is to be drawn are those that maximum likelihood finds, which did not "
            f"converge. {error}",
            error.partial,
        ) from None
    return found


def _exact_poses(poses: PosePairs, noise: Noise) -> PosePairs:
    """The poses as fitted, with one side computed from the other so that they fit exactly; they carry their truth.

    The side that is computed is one that has noise.
    """
    fit = _fitted(poses, noise)
    robot, camera = poses.robot, poses.camera
    if fit is None:
        X = solve_all_pairs(poses)
        W = mean_target(poses, X)
    else:
        assert fit.W is not None
        X, W = fit.X, fit.W
        robot, camera = corrected(fit, noise, robot, camera)
    if cast(PoseNoise, noise).camera is not None:
        G = robot if poses.setup == "eye-in-hand" else inverse(robot)
        camera = inverse(G @ X) @ W
    else:
        G = W @ inverse(X @ camera)
        robot = G if poses.setup == "eye-in-hand" else inverse(G)
    return PosePairs(robot, camera, poses.setup, poses.timestamps, Truth(X, W, robot, camera))


def _exact_motions(motions: Motions, noise: PairNoise) -> tuple[Array, Array, Array]:
    """The motions A and B as fitted, likewise, and X."""
    fit = _fitted(motions, noise)
    A, B = motions.A, motions.B
    if fit is None:
        X = solve_limit(A, B)
    else:
        X = fit.X
        constraint = constraint_of(motions, noise)
        A, B = corrected(fit, noise, constraint.first, constraint.second)
    if noise.B is not None:
        return A, inverse(X) @ A @ X, X
    return X @ B @ inverse(X), B, X
