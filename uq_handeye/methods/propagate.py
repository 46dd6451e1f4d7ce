"""First-order covariance of X by propagation of the noise: per pair (T3), pose-aware (T4), literal (45).

Model: the data carry Gaussian errors ``xi = (theta, tau)`` (left rotation, additive translation, rad and m);
X carries ``xi_X`` in the same convention, in the frame of ``A`` (gripper for eye-in-hand). To first order
``xi_X = sum_i D_i xi_i`` with ``D_i = dX / d(data of pair i)``, in closed form for 4DPA (`sensitivity`) and by the
delta method for the other estimators (T7, `registry`), so that for independent pairs

    Sigma_X = sum_i D_i Sigma_i D_i^T                                                           (T3)

and for noise on poses, which pairs share, the derivatives are first summed over the pairs of each pose:

    D_k = sum over pairs p that use pose k of D_p (d xi_p / d xi_k),   Sigma_X = sum_k D_k Sigma_k D_k^T   (T4)

Both hold for 4DPA's limit ``scale=None`` and the paper's route at finite d. The literal form of (45) lets all
pairs carry the *same* noise and averages the derivative; for independent noise it is far too small and is kept
so that this can be shown.

Digits near half a turn. 4DPA weights a motion by sin^2(angle), read from differences of entries of R that are rounded
to 1e-16: where *all* motions are within delta of 180 degrees, this rounding of the data alone moves the covariance by a
relative 3e-12 (delta = 1e-4 rad), 1e-10 (1e-5) or 5e-7 (1e-6), and the computation adds up to five times as much
(against 40 digits). Below 1e-7 rad `DegenerateMotionError` says that nothing is determined. Motions by other angles
cure it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from ..core.geometry.checks import CHUNK, as_transforms
from ..core.geometry.se3 import Array
from ..errors import InputError, InputWarning, require_type
from ..findings import Finding
from ..model.errors.models import Noise, PairNoise, PoseNoise
from ..model.poses.motions import Motions
from .limit import Suspicious, require_transforms, solve_limit
from .method import (
    Derivatives,
    ErrorFactors,
    Method,
    PoseFactors,
    explained,
    require_converged,
)
from .noise_transport import DataSide, Shared, Start, data_side, noise_of_pairs
from .pairs import MotionsLike, as_pairs, pair_blocks, trial_blocks
from .paper_covariances import PAPER_SCALE, literal_covariance
from .registry import find
from .scaled import solve_scaled
from .scaled_sensitivity import ScaledDerivatives, linearised
from .sensitivity import LimitDerivatives
from .validity import find_curved, find_few, find_precise_residuals

# Number of pairs whose derivatives are held at once, about 2 kB each: larger blocks cost more in fresh pages.
PAIRS_PER_BLOCK = CHUNK // 8
# Largest number of pairs times error components of their poses for which every two pairs are compared.
MAX_COMPARED = 5_000_000

Result = TypeVar("Result")


def propagate(
    A: MotionsLike | Motions,
    B: MotionsLike | Noise | None = None,
    noise: Noise | None = None,
    *,
    X: ArrayLike | None = None,
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
        (45) as printed, of 4DPA only. None takes ``pairs`` for PairNoise and ``poses`` for PoseNoise.

    Returns
    -------
    (..., 6, 6) covariance of ``xi = (theta, tau)``: left rotation in rad, additive translation.

    Raises
    ------
    InputError
        Shapes that do not fit, a noise model that does not fit the motions.
    DegenerateMotionError
        The motions do not determine X: its variance is infinite along the directions named.
    NotConvergedError
        ``zhao``: too few residuals determine X.

    Warns
    -----
    InputWarning
        The covariance may be off by factors: of ``zhao`` with few data, or where residuals that are known better than X
        determine it; of ``nguyen`` where X is so uncertain that its error is curved (`first_order`).

    Examples
    --------
    >>> import numpy as np, uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    >>> motions = uq.relative_motions(uq.simulate(n_poses=20, noise=noise, seed=1), "all")
    >>> covariance = uq.propagate(motions, noise)
    >>> np.round(np.sqrt(np.diag(covariance)) * 1e3, 2)  # mrad, mm
    array([0.45, 0.4 , 0.58, 0.51, 0.48, 0.58])
    """
    covariance, findings = propagate_and_check(A, B, noise, X=X, method=method, scale=scale, kind=kind)
    for finding in findings:
        warnings.warn(str(finding), InputWarning, stacklevel=2)
    return covariance


def propagate_and_check(
    A: MotionsLike | Motions,
    B: MotionsLike | Noise | None = None,
    noise: Noise | None = None,
    *,
    X: ArrayLike | None = None,
    method: str = "4dpa",
    scale: float | None = None,
    kind: str | None = None,
) -> tuple[Array, list[Finding]]:
    """The covariance of `propagate`, and what speaks against it."""
    problem = _problem(A, B, noise, X, method, scale, kind)
    findings: list[Finding] = []
    if kind == "literal":
        of_pairs = cast(PairNoise, problem.noise)  # data_side has seen to it
        S = literal_covariance(problem.A, problem.B, of_pairs, problem.X, PAPER_SCALE if scale is None else scale)
    elif not find(method).smooth:
        S, findings = _beyond_derivatives(problem, find(method), kind)
    else:
        S = np.concatenate(problem.each(lambda side, Q: np.asarray(Q @ side.covariance() @ Q.mT)))
        if problem.X is not None:
            findings = find_curved(find(method), problem.A, problem.B, problem.X, S)
    return (0.5 * (S + S.mT)).reshape(*problem.batch, 6, 6), findings


def pose_sensitivities(
    motions: Motions, noise: PoseNoise, X: Array, method: str = "4dpa", scale: float | None = None
) -> list[Array | None]:
    """``d xi_X / d xi_k`` (n, 6, 6) by the error of every pose k, robot and camera (T4); None where it is exact."""

    def weighted(side: DataSide, Q: Array) -> list[Array | None]:
        return [None if D is None else Q[0] @ D[0] for D in cast(Shared, side).by_error()]

    return _problem(motions, noise, None, X, method, scale, "poses").each(weighted)[0]


class _Problem(NamedTuple):
    """Checked problem of a covariance: motions (T, N, 4, 4), and the start of a sum for some of the
    trials.
    """

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

    def each(self, take: Callable[[DataSide, Array], Result]) -> list[Result]:
        """``take(side of the data, weight Q (T, 6, 6))`` of each block of trials."""
        try:
            with explained(self.method):  # what is ill-conditioned the estimate, refined, may still have solved
                return [take(*sums) for sums in self._sums(self.derivatives)]
        except Suspicious:
            shape = (*self.batch, *self.A.shape[1:])
            require_transforms(self.A.reshape(shape), self.B.reshape(shape))
            assert self.again is not None
            return [take(*sums) for sums in self._sums(self.again)]

    def _sums(self, derivatives: Callable[[slice], Derivatives]) -> Iterator[tuple[DataSide, Array]]:
        T, N = self.A.shape[:2]
        for trials in trial_blocks(T, N, PAIRS_PER_BLOCK):
            of_X, of_data = derivatives(trials), self.start(trials)
            for pairs in pair_blocks(N, PAIRS_PER_BLOCK):
                of_data.add(of_X.block(self.A[trials, pairs], self.B[trials, pairs], pairs), pairs)
            yield of_data, of_X.weight(N)


def _problem(
    A: MotionsLike | Motions,
    B: MotionsLike | Noise | None,
    noise: Noise | None,
    X: ArrayLike | None,
    method: str,
    scale: float | None,
    kind: str | None,
) -> _Problem:
    motions: Motions | None = None
    if isinstance(A, Motions):
        motions = A
        if isinstance(B, PairNoise | PoseNoise) and noise is None:
            noise, B = B, None
        if B is not None:
            raise InputError("Expected no `B` beside Motions, which hold both A and B.")
        A, B = motions.A, motions.B
    require_type("noise", noise, (PairNoise, PoseNoise), "PairNoise or PoseNoise")
    assert noise is not None
    A, B = as_pairs(A, cast(MotionsLike, B))
    start = data_side(noise, kind, motions, A.shape[-3])
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
            weights = noise_of_pairs(motions, noise)
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


def _beyond_derivatives(problem: _Problem, method: Method, kind: str | None) -> tuple[Array, list[Finding]]:
    """The covariances (T, 6, 6) of an X that is no smooth function of the data, and what speaks against them."""
    assert method.covariance is not None and problem.X is not None and problem.weights is not None
    pairs_share = problem.noise.ITEM == "pose" and kind != "pairs"
    count, item = problem.A.shape[1], "pairs"
    if pairs_share:
        side = cast(Shared, problem.start(slice(0, 1)))
        count, item = side.sums[0].shape[1], "poses"
    found = []
    for t, (A, B, X) in enumerate(zip(problem.A, problem.B, problem.X, strict=True)):
        noise: PairNoise | ErrorFactors | PoseFactors = problem.weights
        if pairs_share:
            side = cast(Shared, problem.start(slice(t, t + 1)))
            if side.joint or side.twice:  # any two pairs may be correlated
                if len(A) * side.count > MAX_COMPARED:
                    raise InputError(
                        f"The covariance of method {method.name!r} compares every two residuals where all poses share "
                        f"errors; {len(A)} pairs are too many. Choose fewer."
                    )
                noise = side.factors()
            else:
                noise = PoseFactors(side.pairs, side.pose_factors)
        with explained(method.name):
            found.append(method.covariance(A, B, X, noise))
    findings = find_few(method, count, item) + find_precise_residuals(method, max(each.share for each in found))
    return np.stack([each.value for each in found]), findings
