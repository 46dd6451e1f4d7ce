r"""First-order covariance of X: per pair (T3), pose-aware (T4), literal (45).

Model: the data carry Gaussian errors ``xi = (theta, tau)`` (left rotation, additive translation, rad and m);
X carries ``xi_X`` in the same convention, in the frame of ``A`` (gripper for eye-in-hand). To first order
``xi_X = sum_i D_i xi_i`` with ``D_i = dX / d(data of pair i)``, in closed form for 4DPA (`sensitivity`) and by the
delta method for the other estimators (T7, `estimators`), so that for independent pairs

    Sigma_X = sum_i D_i Sigma_i D_i^T                                                           (T3)

and for noise on poses, which pairs share, the derivatives are first summed over the pairs of each pose:

    D_k = sum over pairs p that use pose k of D_p (d xi_p / d xi_k),   Sigma_X = sum_k D_k Sigma_k D_k^T   (T4)

Both hold for 4DPA's limit ``scale=None`` and the paper's route at finite d. The literal form of (45) lets all
pairs carry the *same* noise and averages the derivative; for independent noise it is far too small and is kept
so that this can be shown.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from .errors import InputError, InputWarning
from .estimators.method import (
    Derivatives,
    ErrorFactors,
    Method,
    PoseFactors,
    SolverWithCovariance,
    explained,
    require_converged,
)
from .estimators.registry import find
from .motions import Motions
from .noise import Noise, PairNoise, PoseNoise, factor, is_joint, marginals, require_count
from .octonion_covariance import PAPER_SCALE, literal_covariance
from .poses import PosePairs
from .procrustes import (
    Suspicious,
    as_pairs,
    pair_blocks,
    require_transforms,
    solve_limit,
    solve_scaled,
    trial_blocks,
)
from .scratch import scratch
from .se3 import Array, as_transforms, block, entry_rows, inverse, skew
from .sensitivity import LimitDerivatives, ScaledDerivatives, cross_rows, linearised, trials_first

# Pairs whose derivatives are held at once, about 2 kB each: larger blocks cost more in fresh pages than they save.
BLOCK = 1024
# Pairs times error components of their poses, beyond which not every two pairs are compared.
MOST_SHARED = 5_000_000
# Independent pairs or poses below which the covariance of a method that is not smooth is not to be trusted.
FEW = 10

_EYE = np.eye(3)

Result = TypeVar("Result")


def propagate(
    A: Any,
    B: Any = None,
    noise: Noise | None = None,
    *,
    X: Any = None,
    method: str = "4dpa",
    scale: float | None = None,
    kind: str | None = None,
) -> Array:
    """The 6x6 covariance of an estimator's X to first order.

    Parameters
    ----------
    A, B : (..., N, 4, 4), or one `Motions` in place of both
    noise : PairNoise or PoseNoise
        PoseNoise needs `Motions` that were made from poses.
    X : (..., 4, 4) or None
        The estimate of this method, at which to linearise; None solves for it.
    method : str
        A name in `METHODS`.
    scale : float or None
        As in `solve`.
    kind : "pairs", "poses", "literal" or None
        ``pairs`` takes the pairs as independent (T3), ``poses`` keeps what pairs share (T4), ``literal`` is
        (45) as printed, of 4DPA alone. None takes ``pairs`` for PairNoise and ``poses`` for PoseNoise.

    Returns
    -------
    (..., 6, 6) covariance of ``xi = (theta, tau)``: left rotation in rad, additive translation.

    Raises
    ------
    InputError
        Shapes that do not fit, a noise model that does not fit the motions.
    DegenerateMotionError
        The motions do not determine X: its variance is infinite along the directions named.

    Examples
    --------
    >>> import numpy as np, uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    >>> motions = uq.relative_motions(uq.simulate(n_poses=20, noise=noise, seed=1), "all")
    >>> covariance = uq.propagate(motions, noise)
    >>> np.round(np.sqrt(np.diag(covariance)) * 1e3, 2)  # mrad, mm
    array([0.45, 0.4 , 0.58, 0.51, 0.48, 0.58])
    """
    problem = _problem(A, B, noise, X, method, scale, kind)
    if kind == "literal":
        assert isinstance(problem.noise, PairNoise)  # _data_side has seen to it
        S = literal_covariance(problem.A, problem.B, problem.noise, problem.X, PAPER_SCALE if scale is None else scale)
    elif not find(method).smooth:
        S = _beyond_derivatives(problem, find(method), kind)
    else:
        S = np.concatenate(problem.each(lambda side, Q: np.asarray(Q @ side.covariance() @ Q.mT)))
    return (0.5 * (S + S.mT)).reshape(*problem.batch, 6, 6)


def pose_sensitivities(
    motions: Motions, noise: PoseNoise, X: Array, method: str = "4dpa", scale: float | None = None
) -> list[Array | None]:
    """``d xi_X / d xi_k`` (n, 6, 6) by the error of every pose k, robot and camera (T4); None where it is exact."""

    def weighted(side: _DataSide, Q: Array) -> list[Array | None]:
        assert isinstance(side, _Shared)
        return [None if D is None else Q[0] @ D[0] for D in side.by_error()]

    return _problem(motions, noise, None, X, method, scale, "poses").each(weighted)[0]


class _Problem(NamedTuple):
    """What a covariance is asked of, checked: motions (T, N, 4, 4), and the start of a sum for some of the trials."""

    batch: tuple[int, ...]
    A: Array
    B: Array
    X: Array | None
    method: str
    noise: Noise
    weights: PairNoise | None  # the noise of each pair alone, where the method asks for it
    start: Start
    derivatives: Callable[[slice], Derivatives]
    again: Callable[[slice], Derivatives] | None  # after the second look at odd values

    def each(self, take: Callable[[_DataSide, Array], Result]) -> list[Result]:
        """``take(side of the data, weight Q (T, 6, 6))`` of each block of trials."""
        try:
            with explained(self.method):  # what is ill-conditioned the estimate, refined, may still have solved
                return [take(*sums) for sums in self._sums(self.derivatives)]
        except Suspicious:
            shape = (*self.batch, *self.A.shape[1:])
            require_transforms(self.A.reshape(shape), self.B.reshape(shape))
            assert self.again is not None
            return [take(*sums) for sums in self._sums(self.again)]

    def _sums(self, derivatives: Callable[[slice], Derivatives]) -> Iterator[tuple[_DataSide, Array]]:
        T, N = self.A.shape[:2]
        for trials in trial_blocks(T, N, BLOCK):
            of_X, of_data = derivatives(trials), self.start(trials)
            for pairs in pair_blocks(N, BLOCK):
                of_data.add(of_X.block(self.A[trials, pairs], self.B[trials, pairs], pairs), pairs)
            yield of_data, of_X.weight(N)


def _problem(
    A: Any, B: Any, noise: Noise | None, X: Any, method: str, scale: float | None, kind: str | None
) -> _Problem:
    motions = A if isinstance(A, Motions) else None
    if motions is not None:
        if isinstance(B, PairNoise | PoseNoise) and noise is None:
            noise, B = B, None
        if B is not None:
            raise InputError("Expected no `B` beside Motions, which hold both A and B.")
        A, B = motions.A, motions.B
    if not isinstance(noise, PairNoise | PoseNoise):
        raise InputError(f"Expected `noise` to be PairNoise or PoseNoise, got {type(noise).__name__}.")
    A, B = as_pairs(A, B)
    start = _data_side(noise, kind, motions, A.shape[-3])
    batch, N = A.shape[:-3], A.shape[-3]
    if X is not None:
        X = as_transforms(X, "X", stack=False)
        try:
            X = np.broadcast_to(X, (*batch, 4, 4)).reshape(-1, 4, 4)
        except ValueError as error:
            raise InputError(f"Expected `X` to have shape {(*batch, 4, 4)} or (4, 4), got {X.shape}.") from error
    flat_A, flat_B = A.reshape(-1, N, 4, 4), B.reshape(-1, N, 4, 4)
    again: Callable[[slice], Derivatives] | None = None
    weights: PairNoise | None = None
    derivatives: Callable[[slice], Derivatives]
    if method != "4dpa":
        found = find(method)
        if scale is not None or kind == "literal":
            raise InputError(
                f"Expected neither `scale` nor kind='literal' with method {method!r}: they belong to 4dpa."
            )
        as_transforms(A, "A")
        as_transforms(B, "B")
        if found.weighted or not found.smooth:
            weights = noise if isinstance(noise, PairNoise) else noise_of_pairs(_made_from_poses(motions), noise)
        if X is None:
            X = require_converged(found, found.estimate(flat_A, flat_B, weights if found.weighted else None)).X
        with explained(method):
            derivatives = found.solver.derivatives(flat_A, flat_B, weights, X)
    elif scale is not None:
        linear = linearised(solve_scaled(A, B, scale), X, scale)
        derivatives = lambda trials: ScaledDerivatives(linear, trials)  # noqa: E731
    else:
        at = solve_limit(A, B).reshape(-1, 4, 4) if X is None else X
        # the limit checks the values of A and B on the way; if they look odd, once more and with names
        derivatives = lambda trials: LimitDerivatives(at[trials], motions is not None)  # noqa: E731
        again = lambda trials: LimitDerivatives(at[trials], True)  # noqa: E731
    return _Problem(batch, flat_A, flat_B, X, method, noise, weights, start, derivatives, again)


def _beyond_derivatives(problem: _Problem, method: Method, kind: str | None) -> Array:
    """The covariances (T, 6, 6) of an X that is no smooth function of the data."""
    solver = cast(SolverWithCovariance, method.solver)
    assert problem.X is not None and problem.weights is not None
    pairs_share = isinstance(problem.noise, PoseNoise) and kind != "pairs"
    sources = problem.A.shape[1]
    if pairs_share:
        side = problem.start(slice(0, 1))
        assert isinstance(side, _Shared)
        sources = side.sums[0].shape[1]
    if sources < FEW:
        warnings.warn(
            f"The covariance of method {method.name!r} holds for many data; with {sources} "
            f"{'poses' if pairs_share else 'pairs'} it may be far off either way. Trust it from {FEW} up.",
            InputWarning,
            stacklevel=4,
        )
    found = []
    for t, (A, B, X) in enumerate(zip(problem.A, problem.B, problem.X, strict=True)):
        noise: PairNoise | ErrorFactors | PoseFactors = problem.weights
        if pairs_share:
            side = problem.start(slice(t, t + 1))
            assert isinstance(side, _Shared)
            if side.joint or side.twice:  # any two pairs may be correlated
                if len(A) * side.count > MOST_SHARED:
                    raise InputError(
                        f"The covariance of method {method.name!r} compares every two residuals where all poses share "
                        f"errors; {len(A)} pairs are too many. Choose fewer."
                    )
                noise = side.factors()
            else:
                noise = PoseFactors(side.pairs, side.pose_factors)
        with explained(method.name):
            found.append(solver.covariance(A, B, X, noise))
    return np.stack(found)


# ------------------------------------------------------------------------ noise carried through the derivatives


class _DataSide(Protocol):
    """Takes the derivatives F (2, 6, 6, T, m) of block after block of pairs and sums up F Sigma F^T."""

    def add(self, F: Array, pairs: slice) -> None: ...

    def covariance(self) -> Array: ...


Start = Callable[[slice], _DataSide]


def _data_side(noise: Noise, kind: str | None, motions: Motions | None, N: int) -> Start:
    """What starts a sum for some trials; raises `InputError` where noise, kind and motions do not fit."""
    default, others = ("poses", "pairs") if isinstance(noise, PoseNoise) else ("pairs", "literal")
    if kind not in (None, default, others):
        raise InputError(f"Expected `kind` with {type(noise).__name__} to be {default!r} or {others!r}, got {kind!r}.")
    if isinstance(noise, PairNoise):
        require_count(noise.A, N, "A", "motions")
        require_count(noise.B, N, "B", "motions")
        pair_noise = noise
        return lambda trials: _Independent(pair_noise)
    made = _made_from_poses(motions)
    poses, index, pose_noise = made.poses, made.pairs, noise
    assert poses is not None and index is not None
    require_count(noise.robot, poses.n, "robot", "poses")
    require_count(noise.camera, poses.n, "camera", "poses")
    form = _Unshared if kind == "pairs" else _Shared
    return lambda trials: form(poses, index, pose_noise, trials)


def _made_from_poses(motions: Motions | None) -> Motions:
    if motions is None or motions.poses is None:
        raise InputError(
            "PoseNoise needs Motions that were made from poses (relative_motions); for motions without poses use "
            "PairNoise."
        )
    return motions


def noise_of_pairs(motions: Motions, noise: PoseNoise) -> PairNoise:
    """The covariance of each pair (N, 6, 6) that PoseNoise makes, to first order: what pairs share is lost."""
    poses, index = motions.poses, motions.pairs
    assert poses is not None and index is not None
    side = _Unshared(poses, index, noise, slice(0, 1))
    unit = np.broadcast_to(np.eye(6)[:, :, None, None], (6, 6, 1, len(index)))
    found: list[Array | None] = []
    for k, L in enumerate(side.factors):
        if L is None:
            found.append(None)
            continue
        D = side.by_difference(unit, k, slice(None))[:, :, 0].transpose(2, 0, 1)
        parts = [D @ L[0, pose] for pose in index.T]
        found.append(parts[0] @ parts[0].mT + parts[1] @ parts[1].mT)
    return PairNoise(*found)


class _Independent:
    """``sum_i F_i Sigma_i F_i^T`` for noise of each pair's own (T3)."""

    def __init__(self, noise: PairNoise) -> None:
        self.factors = noise.factors
        self.sum: Array | float = 0.0

    def add(self, F: Array, pairs: slice) -> None:
        for side, L in zip(F, self.factors, strict=True):
            if L is not None:
                self.sum = self.sum + _outer(_times(side, L if L.ndim == 2 else L[None, pairs]))

    def covariance(self) -> Array:
        return np.asarray(self.sum)


def _times(F: Array, L: Array) -> Array:
    """``F L`` with pairs last: F (6, 6, T, m) and L (6, 6) or (T, m, 6, 6)."""
    out = scratch("times", *F.shape)
    if L.ndim == 2:
        np.matmul(L.T, F.reshape(6, 6, -1), out=out.reshape(6, 6, -1))
    else:
        np.einsum("ijtm,tmjk->iktm", F, np.broadcast_to(L, (*F.shape[2:], 6, 6)), out=out)
    return out


def _outer(FL: Array) -> Array:
    """``sum over pairs of FL FL^T`` per trial: (6, 6, T, m) -> (T, 6, 6)."""
    stacked = trials_first(FL)
    return np.asarray(stacked @ stacked.mT)


class _OnPoses:
    """Derivatives by the left twists of the poses behind the pairs.

    With ``P = G`` (robot) or ``P = inv(C)`` (camera), both motions are ``inv(P_j) P_i``. For left twists
    ``P -> exp(zeta) P`` only ``delta = zeta_i - zeta_j`` enters, so that one 6x6 block serves both poses of a
    pair, with opposite signs:  ``theta = R_j^T delta_theta``, ``tau = R_j^T (delta_rho - [t_i]x delta_theta)``.
    """

    def __init__(self, poses: PosePairs, index: NDArray[np.intp], noise: PoseNoise, trials: slice) -> None:
        self.pairs = index
        self.model, self.noise = noise, (noise.robot, noise.camera)
        frames, self.by_pose = pose_twists(poses, trials)
        entries = [entry_rows(P.reshape(-1, 4, 4)).reshape(4, 4, *P.shape[:2]) for P in frames]
        self.R = [P[:3, :3] for P in entries]
        self.t = [cross_rows(P[:3, 3]) for P in entries]

    def by_difference(self, F: Array, side: int, pairs: slice) -> Array:
        """``F d xi / d delta`` of one side, F (6, 6, T, m)."""
        i, j = self.pairs[pairs].T
        T, m = F.shape[2:]
        by_twist: Array = np.einsum("ajtm,kjtm->aktm", F.reshape(12, 3, T, m), self.R[side].take(j, axis=-1)).reshape(
            6, 6, T, m
        )
        by_twist[:, :3] -= np.einsum("ajtm,jktm->aktm", by_twist[:, 3:], self.t[side].take(i, axis=-1))
        return by_twist


class _Shared(_OnPoses):
    """``sum_k D_k Sigma_k D_k^T`` over poses, ``D_k`` summed over the pairs that use pose k (T4).

    A joint covariance of all poses is used whole: ``D = [D_1 .. D_n]``, ``D Sigma D^T`` (T4b).
    """

    def __init__(self, poses: PosePairs, index: NDArray[np.intp], noise: PoseNoise, trials: slice) -> None:
        super().__init__(poses, index, noise, trials)
        self.sums = [np.zeros_like(by_pose) for by_pose in self.by_pose]

    def add(self, F: Array, pairs: slice) -> None:
        incidence = _incidence(self.pairs[pairs], self.sums[0].shape[1])
        for side in (0, 1):
            if self.noise[side] is not None:
                by_difference = self.by_difference(F[side], side, pairs)
                T, m = by_difference.shape[2:]
                spread = incidence @ by_difference.reshape(-1, m).T
                self.sums[side] += spread.reshape(-1, 6, 6, T).transpose(3, 0, 1, 2)

    def by_error(self) -> list[Array | None]:
        """The sums times the derivative of the twist by the error of the pose: (T, n, 6, 6); None: exact."""
        return [
            None if covariance is None else twist @ pose
            for twist, pose, covariance in zip(self.sums, self.by_pose, self.noise, strict=True)
        ]

    def covariance(self) -> Array:
        return covariance_of_poses(self.by_error(), self.model)

    @property
    def joint(self) -> bool:
        """Whether the errors of different poses are correlated."""
        return any(covariance is not None and is_joint(covariance) for covariance in self.noise)

    @property
    def twice(self) -> bool:
        """Whether two pairs have both poses in common."""
        return len(np.unique(np.sort(self.pairs, axis=1), axis=0)) < len(self.pairs)

    def pose_factors(self, pairs: slice) -> Array:
        """``d (xi_A, xi_B) / dz`` (2, m, 12, 12) of pairs of the first trial by their two poses, z standard normal."""
        index = self.pairs[pairs].T
        unit = np.broadcast_to(np.eye(6)[:, :, None, None], (6, 6, 1, index.shape[1]))
        found = np.zeros((2, index.shape[1], 12, 12))
        for side, (by_pose, covariance) in enumerate(zip(self.by_pose, self.noise, strict=True)):
            if covariance is not None:
                D = self.by_difference(unit, side, pairs)[:, :, 0].transpose(2, 0, 1)
                part = slice(6 * side, 6 * side + 6)
                found[:, :, part, part] = D @ (by_pose[0] @ factor(covariance))[index] * [[[[1.0]]], [[[-1.0]]]]
        return found

    @property
    def count(self) -> int:
        """Number of error components of all poses."""
        noisy = sum(1 for covariance in self.noise if covariance is not None)
        return 6 * int(self.sums[0].shape[1]) * noisy

    def factors(self) -> ErrorFactors:
        """``d (xi_A, xi_B) / dz`` (m, 12, k) of pairs of the first trial, z independent standard normal."""
        n = self.sums[0].shape[1]
        of_poses: list[Array | None] = []  # (n, 6, 6n) each
        for by_pose, covariance in zip(self.by_pose, self.noise, strict=True):
            if covariance is None:
                of_poses.append(None)
                continue
            L = factor(covariance)
            whole = L if is_joint(covariance) else block_diag(*np.broadcast_to(L, (n, 6, 6)))
            of_poses.append(by_pose[0] @ whole.reshape(n, 6, 6 * n))

        def of_pairs(pairs: slice) -> Array:
            i, j = self.pairs[pairs].T
            unit = np.broadcast_to(np.eye(6)[:, :, None, None], (6, 6, 1, len(i)))
            found = np.zeros((len(i), 12, self.count))
            first = 0
            for side, L in enumerate(of_poses):
                if L is not None:
                    D = self.by_difference(unit, side, pairs)[:, :, 0].transpose(2, 0, 1)
                    found[:, 6 * side : 6 * side + 6, first : first + 6 * n] = D @ (L[i] - L[j])
                    first += 6 * n
            return found

        return of_pairs


def pose_twists(poses: PosePairs, trials: slice) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """The frames P = G and P = inv(C), each (T, n, 4, 4), and d zeta / d xi of their left twists, (T, n, 6, 6).

    The left twist of T is ``(theta, tau + [t]x theta)``; that of inv(T) is minus the right twist of T,
    ``-(R^T theta, R^T tau)``.
    """
    robot = poses.robot.reshape(-1, poses.n, 4, 4)[trials]
    camera = poses.camera.reshape(-1, poses.n, 4, 4)[trials]
    by_camera = _minus_right_twist(camera)
    if poses.setup == "eye-in-hand":
        return (robot, inverse(camera)), (block(_EYE, 0.0, skew(robot[..., :3, 3]), _EYE), by_camera)
    return (inverse(robot), inverse(camera)), (_minus_right_twist(robot), by_camera)


def covariance_of_poses(by_error: Iterable[Array | None], noise: PoseNoise) -> Array:
    """``sum_k D_k Sigma_k D_k^T`` (..., 6, 6) over robot and camera poses, or ``D Sigma D^T`` if their noise is joint.

    D (..., n, 6, 6) are the derivatives by the error of each pose; None: that side is exact.
    """
    result: Array | float = 0.0
    for D, covariance in zip(by_error, (noise.robot, noise.camera), strict=True):
        if D is not None and covariance is not None:
            if not is_joint(covariance):
                D = D @ factor(covariance)
            row = D.swapaxes(-3, -2).reshape(*D.shape[:-3], 6, -1)
            result = result + (row @ covariance @ row.mT if is_joint(covariance) else row @ row.mT)
    result = np.asarray(result)
    return np.asarray(0.5 * (result + result.mT))


def _incidence(pairs: NDArray[np.intp], n: int) -> Any:
    """The (n, m) matrix with +1 at pose i and -1 at pose j of each pair."""
    from scipy.sparse import csc_array  # slow to import and needed here only

    m = len(pairs)
    return csc_array((np.tile([1.0, -1.0], m), pairs.ravel(), np.arange(0, 2 * m + 1, 2)), shape=(n, m))


class _Unshared(_OnPoses):
    """Noise of the poses, but each pair as if its poses were its own: what T3 makes of PoseNoise."""

    def __init__(self, poses: PosePairs, index: NDArray[np.intp], noise: PoseNoise, trials: slice) -> None:
        super().__init__(poses, index, noise, trials)
        self.sum: Array | float = 0.0
        self.factors = [
            None if covariance is None else by_pose @ factor(marginals(covariance))
            for by_pose, covariance in zip(self.by_pose, self.noise, strict=True)
        ]

    def add(self, F: Array, pairs: slice) -> None:
        for side, L in enumerate(self.factors):
            if L is not None:
                by_difference = self.by_difference(F[side], side, pairs)
                for pose in self.pairs[pairs].T:
                    self.sum = self.sum + _outer(_times(by_difference, L[:, pose]))

    def covariance(self) -> Array:
        return np.asarray(self.sum)


def _minus_right_twist(T: Array) -> Array:
    R_T = T[..., :3, :3].mT
    return -block(R_T, 0.0, 0.0, R_T)
