r"""Start of the fit of X and W: 4DPA, or another start where the data leave directions open.

*Open directions.* Where the motions do not determine a part of X, 4DPA has no solution. The candidates for the rotation
of X, from all motions of a few rows (residuals of ``A X = X B``), are:

- parallel axes a and b of robot and camera, the first singular vectors of ``sum u v^T``, u and v = sin(angle) axis:
  ``R = exp([phi a]x) R_0`` with ``R_0 b = a``. The translations are linear in ``(cos phi, sin phi, t)``,

      (R_A - I) t - cos(phi) q_perp - sin(phi) a x q = a (a . q) - t_A,    q = R_0 t_B

  and give one more phi; where they do not determine it, phi is one of eight;
- pure translations ``t_A = R t_B``, and rotations and translations together: Procrustes;
- the rotation of the prior, if there is one.

The translation of X is the shortest of those that fit best: along open directions the camera is at the origin of the
frame that carries it. The candidate with the smallest weighted residuals is iterated (Gauss-Newton without steps along
open directions, `open_directions`), with the prior, until it converges.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, vee
from ...core.rounding import CHAIN_ROUNDING, SOLUTION_ROUNDING
from ...errors import DegenerateMotionError
from ...methods.all_pairs import solve_all_pairs
from ...methods.limit import solve_limit
from ...methods.target_pose import mean_target
from ...model.errors.models import Noise, with_prior, without_prior
from ...model.errors.pose_prior import PosePrior
from ...model.errors.square_roots import cholesky_of, gram, whiten
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs
from .constraint import MAX_AXIS_ROWS, MIN_RESOLVED_SHARE, Constraint, Unknowns, residual_covariance
from .open_directions import beside_prior, lever_of, own_covariances, step_from

# Largest number of steps of a search for a start.
MAX_START_STEPS = 30
# A start has converged when a step moves X and W by less than this, in standard deviations.
ROUGH_STEP_SD = 0.1
# Where no noise is known, a search begins with this noise of rotations; of translations with the same per metre from
# camera to target.
FIRST_NOISE_RAD = 3e-3
# Median of the squared length of a vector of three standard normal numbers.
MEDIAN_SQUARE = float(chdtri(3, 0.5))


def start_of(data: PosePairs | Motions, constraint: Constraint, X: Array | None) -> Unknowns:
    """X by 4DPA where it is not given, and W as the mean of G X C."""
    poses = data.poses
    if poses is None or constraint.p == 6:
        return Unknowns(solve_limit(constraint.first, constraint.second) if X is None else X, None)
    X = solve_all_pairs(poses) if X is None else X
    return Unknowns(X, mean_target(poses, X))


def sound_start(
    data: PosePairs | Motions,
    constraint: Constraint,
    noise: Noise | None,
    astray: NDArray[np.bool_] | None = None,
) -> Unknowns:
    """`start_of`, and where the data alone leave directions open, for which 4DPA has no answer, `start_open`.

    Problems (...) that are ``astray`` from 4DPA go to `start_open` as well. Raises `DegenerateMotionError` where data
    and prior determine nothing of X.
    """
    batch = constraint.first.shape[:-3]
    X, W = np.zeros((*batch, 4, 4)), np.zeros((*batch, 4, 4))
    bad = np.ones(batch, dtype=bool)
    with suppress(DegenerateMotionError):
        at = start_of(data, constraint, None)
        guess = isotropic_residuals(constraint, at) if noise is None else without_prior(noise)
        X, W = np.array(at.X), W if at.W is None else np.array(at.W)
        bad = _open_problems(constraint, guess, at) | (False if astray is None else astray)
    for k in zip(*np.nonzero(bad), strict=True) if batch else [()] * int(bad):
        one = replace(constraint, first=constraint.first[k], second=constraint.second[k])
        try:
            at = start_open(one, noise if noise is None else _of_problem(noise, k))
        except DegenerateMotionError:
            if not X[k].any():  # 4DPA has none either
                raise
            continue
        X[k] = at.X
        if at.W is not None:
            W[k] = at.W
    return Unknowns(X, W if constraint.p == 12 else None)


def leaves_open(constraint: Constraint, noise: Noise | None, at: Unknowns) -> bool:
    """Return whether the data of one problem, without prior, leave a direction open near the unknowns."""
    guess = isotropic_residuals(constraint, at) if noise is None else without_prior(noise)
    try:
        return bool(_open_problems(constraint, guess, at))
    except DegenerateMotionError:
        return True


def _open_problems(constraint: Constraint, noise: Noise, at: Unknowns) -> NDArray[np.bool_]:
    """Return whether the data of each problem (...) leave a direction open."""
    opened = step_from(constraint, noise, at).open
    if opened is None:
        return np.zeros(constraint.first.shape[:-3], dtype=bool)
    return np.asarray(opened.any(axis=(-2, -1)))


def _of_problem(noise: Noise, k: tuple[int, ...]) -> Noise:
    """Return the noise with the means of the prior of one problem out of many."""
    return noise if noise.prior is None else with_prior(noise, noise.prior.rows(k))


def start_open(constraint: Constraint, noise: Noise | None, prior: PosePrior | None = None) -> Unknowns:
    """X and W of one data set, at the representative nearest to the origin, or to the prior, along what is open.

    ``noise`` brings its own prior; ``prior`` is for noise that is not known yet. Raises `DegenerateMotionError` where
    the data determine nothing of X.
    """
    if constraint.n < constraint.fewest - 1:
        raise DegenerateMotionError(f"Expected several {constraint.item}s to determine X, got 1.", np.eye(6))
    known = prior if noise is None else noise.prior
    few = constraint.rows(np.unique(np.linspace(0, constraint.n - 1, min(constraint.n, MAX_AXIS_ROWS)).astype(np.intp)))
    X = _candidates(few, known)
    at = few.complete(X)
    guess = _rough(few, known) if noise is None else _isotropic(noise)
    if known is not None:
        at = _translated(few, guess, at)
    order = np.argsort(_cost(few, guess, at))[:2]
    best: tuple[float, Unknowns] | None = None
    for k in order.tolist():
        one = Unknowns(at.X[k], None if at.W is None else at.W[k])
        for _ in range(2 if noise is None else 1):
            if noise is None:
                guess = with_prior(isotropic_residuals(few, one), known)
            one = descend(few, guess, one)
        cost = float(_cost(few, guess, one))
        if noise is None:  # each by its own noise: the smaller one is better
            cost = float(np.log(_variances(few, one)).sum())
        if best is None or cost < best[0]:
            best = cost, one
    assert best is not None
    guess = with_prior(isotropic_residuals(constraint, best[1]), known) if noise is None else _isotropic(noise)
    return descend(constraint, guess, best[1])


def _translated(constraint: Constraint, noise: Noise, at: Unknowns) -> Unknowns:
    """Return candidates (k, 4, 4) with the translations that data and prior ask for, each at its rotations.

    Along what the data leave open the prior decides. Far from it, a step would turn a right rotation away.
    """
    linear = constraint.linearise(at, constraint.first, constraint.second)
    S = residual_covariance(linear.sides, noise)
    sums = gram(whiten(cholesky_of(S), np.concatenate([linear.J, linear.r[..., None]], axis=-1)))
    information, gradient = beside_prior(sums[..., :-1, :-1], sums[..., :-1, -1], noise, at)
    places = np.flatnonzero(np.arange(information.shape[-1]) % 6 >= 3)
    step = np.zeros_like(gradient)
    inner = information[..., places[:, None], places]
    step[..., places] = -(np.linalg.pinv(inner, rcond=SOLUTION_ROUNDING, hermitian=True) @ gradient[..., places, None])[
        ..., 0
    ]
    return at.moved(step)


def isotropic_residuals(constraint: Constraint, at: Unknowns) -> Noise:
    """Isotropic noise with robust scales of the residuals, half of its variance on either side."""
    S = 0.5 * np.diag(np.repeat(_variances(constraint, at), 3))
    return constraint.noise(S, S)


def _variances(constraint: Constraint, at: Unknowns) -> Array:
    """Return variances of the residuals per axis (2,), rotation and translation, from their medians."""
    r = constraint.residual(at, constraint.first, constraint.second)
    squares = (r * r).reshape(-1, 2, 3).sum(axis=-1)
    return np.asarray(np.maximum(np.median(squares, axis=0) / MEDIAN_SQUARE, 1e-24))


def descend(constraint: Constraint, noise: Noise, at: Unknowns) -> Unknowns:
    """Gauss-Newton without steps along what is open, until it converges."""
    for _ in range(MAX_START_STEPS):
        found = step_from(constraint, noise, at)
        turn = float(np.linalg.norm(found.step[:3]))
        at = at.moved(found.step * min(1.0, 0.5 / max(turn, 1e-300)))  # X rotates by 0.5 rad at most
        if found.step @ found.information @ found.step < ROUGH_STEP_SD**2:
            break
    return at


def _rough(constraint: Constraint, prior: PosePrior | None) -> Noise:
    S = FIRST_NOISE_RAD**2 * np.diag(np.repeat([1.0, float(lever_of(constraint)) ** 2], 3))
    return with_prior(constraint.noise(S, S), prior)


def _cost(constraint: Constraint, noise: Noise, at: Unknowns) -> Array:
    """Weighted squares of the residuals (...), with those of the prior."""
    linear = constraint.linearise(at, constraint.first, constraint.second)
    white = whiten(cholesky_of(residual_covariance(linear.sides, noise)), linear.r[..., None])
    cost = np.minimum((white * white).sum(axis=(-2, -1)), 1e3).sum(axis=-1)
    return np.asarray(cost if noise.prior is None else cost + noise.prior.normal_equations(at.X, at.W)[2])


def _candidates(constraint: Constraint, prior: PosePrior | None) -> Array:
    """X (k, 4, 4)."""
    A, B = constraint.motions()
    u, v = (0.5 * vee(T[:, :3, :3]) for T in (A, B))
    t_A, t_B = A[:, :3, 3], B[:, :3, 3]
    length = max(float(np.abs(t_A).max(initial=0.0)), float(np.abs(t_B).max(initial=0.0)), 1e-100)
    of_turns, of_moves = u.T @ v, t_A.T @ t_B / length**2
    U, _, Vt = np.linalg.svd(of_turns)
    a, b = U[:, 0], Vt[0]
    R_0 = Rotation.align_vectors(a, b)[0].as_matrix()  # the shortest one
    q = t_B @ R_0.T
    along = np.outer(q @ a, a)
    rows = np.concatenate(
        [A[:, :3, :3] - np.eye(3), -(q - along)[..., None], -np.cross(a, q)[..., None]], axis=-1
    ).reshape(-1, 5)
    rows[:, :3] *= length
    solved = _pseudoinverse(rows) @ (along - t_A).ravel()
    angles = np.append(np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False), np.arctan2(solved[4], solved[3]))
    about = Rotation.from_rotvec(angles[:, None] * a).as_matrix()
    rotations = [*(about @ R_0), *orthonormalise(np.stack([of_moves + 1e-12 * of_turns, of_moves + of_turns]))]
    if prior is not None and prior.X is not None:
        rotations.append(prior.X[:3, :3])
    R = np.stack(rotations)
    # (R_A - I) t = R t_B - t_A
    left = (A[:, :3, :3] - np.eye(3)).reshape(-1, 3)
    right = (t_B @ R.mT - t_A).reshape(len(R), -1)
    X = np.zeros((len(R), 4, 4))
    X[:, :3, :3], X[:, 3, 3] = R, 1.0
    X[:, :3, 3] = right @ _pseudoinverse(left).T
    return X


def _pseudoinverse(M: Array) -> Array:
    """Pseudoinverse without the directions that are not resolved, or determined by the rounding of equal rotations."""
    largest = max(float(np.linalg.norm(M, 2)), 1e-300)
    return np.asarray(np.linalg.pinv(M, rcond=max(np.sqrt(MIN_RESOLVED_SHARE), CHAIN_ROUNDING / largest)), dtype=float)


def _isotropic(noise: Noise) -> Noise:
    """Return noise of the same size, one for every row: a start is not made better by details, and biased by nearly
    exact ones.
    """
    parts: list[Array | None] = []
    for S in own_covariances(noise):
        if S is not None:
            variances = np.diagonal(S.reshape(-1, 6, 6).mean(axis=0)).reshape(2, 3).mean(axis=1)
            S = np.diag(np.repeat(variances, 3))
        parts.append(S)
    return with_prior(type(noise)(*parts), noise.prior)
