r"""Information of the poses so far about X and W, for planning: also where they leave a part of X open.

With ``I`` the information (12, 12) about ``(xi_X, xi_W)`` (T5), W eliminated leaves ``I_XX - I_XW I_WW^-1 I_WX``. An
eigenvector along which that is worth less than a standard deviation of OPEN (0.1 rad or 0.1 m) is *open*: parallel axes
leave the translation along them, pure translations all of it. There measured motions say little but noise; an estimate
that believed them would put X a metre away. So

- X is found by Gauss-Newton from all 24 rotations by quarter turns, without steps along open directions: there X keeps
  what it started with, the part that the gripper carries (camera, or target for eye-to-hand) at the gripper's origin;
- the information along open directions is replaced by that of a weak prior, standard deviation PRIOR (1 rad, 1 m).

A prior of X or W that the noise has counts beside the poses. Where nothing is open there is no weak one; X and the
information are those of `likelihood.efficient`, unless its residuals are so far above the noise that 4DPA may have
started it from a wrong X.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.geometry.se3 import Array
from ...errors import DegenerateMotionError
from ...fit.likelihood.constraint import OnPoses, Unknowns, residual_covariance
from ...fit.likelihood.gauss_helmert import efficient
from ...fit.likelihood.shared_estimates import SharedEstimate
from ...methods.propagation.published_fit import mean_target
from ...model.noise.models import PoseNoise
from ...model.noise.square_roots import cholesky_of, gram, whiten
from ...model.poses.pose_pairs import PosePairs
from ...model.posterior.posterior import Posterior
from ...model.posterior.selection import covariance_of

# Standard deviations per axis, rad and m.
PRIOR = 1.0
OPEN = 0.1

# Poses used to try all rotations, steps, rad per step.
_FEW = 50
_STEPS = 25
_LONGEST = 0.5
# Root mean square residual over its noise that 4DPA is trusted with; a wrong X shows far more, wrong noise costs time.
_LARGE_RESIDUAL = 3.0


@dataclass(frozen=True, eq=False)
class WeaklyKnown:
    """X and W with the weak prior where the poses leave them open, in the place of a calibration."""

    X: Array
    W: Array
    noise: PoseNoise
    posterior: Posterior
    data: PosePairs
    open_directions: Array  # (r, 6)
    kinematics: None = None
    opened: None = None
    method: str = ""
    shared: tuple[SharedEstimate, ...] = ()

    @property
    def setup(self) -> str:
        """Setup of the poses."""
        return self.data.setup

    @property
    def counted(self) -> PosePairs:
        """All poses."""
        return self.data

    @classmethod
    def of(cls, data: PosePairs, noise: PoseNoise) -> WeaklyKnown:
        """Find what the poses determine; raises `InputError` for noise that does not fit."""
        at, information, directions = so_far(data, noise)
        assert at.W is not None
        posterior = Posterior((), np.zeros(0), covariance_of(information))
        return cls(at.X, at.W, noise, posterior, data, directions)


def so_far(data: PosePairs, noise: PoseNoise) -> tuple[Unknowns, Array, Array]:
    """X and W, the information (12, 12) with the weak prior where it is needed, and the open directions (r, 6).

    Raises `InputError` for noise that does not fit.
    """
    try:
        found = efficient(data, noise)
        residual, J = found.white
        at, information = found.unknowns, gram(J) + _of_prior(noise, found.unknowns)
        explained = bool(np.sum(residual**2) <= _LARGE_RESIDUAL**2 * (6 * data.n - 12))
    except DegenerateMotionError:
        explained = False
    if not explained or _open_part(information)[0].size:
        at, information = _cautious_fit(data, noise)
    values, directions = _open_part(information)
    unknown = np.array(information)
    unknown[:6, :6] += directions.T @ ((PRIOR**-2.0 - values)[:, None] * directions)
    return at, unknown, directions


def _of_prior(noise: PoseNoise, at: Unknowns) -> Array | float:
    """Return the information (12, 12) of a prior of X and W about them."""
    return 0.0 if noise.prior is None else noise.prior.normal_equations(at.X, at.W)[0]


def _marginal(information: Array) -> tuple[Array, Array]:
    """Eigenvalues (..., 6) and vectors of the information about X once W is eliminated."""
    across = information[..., :6, 6:]
    left = information[..., :6, :6] - across @ np.linalg.solve(information[..., 6:, 6:], across.mT)
    values, vectors = np.linalg.eigh(left)
    return values, vectors


def _open_part(information: Array) -> tuple[Array, Array]:
    """Information (r,) along the unit vectors (r, 6) in which X is less certain than OPEN."""
    values, vectors = _marginal(information)
    return values[values < OPEN**-2.0], vectors[:, values < OPEN**-2.0].T


def _cautious_fit(data: PosePairs, noise: PoseNoise) -> tuple[Unknowns, Array]:
    """Least squares from many rotations of X, leaving open what is open: the best, and its information (12, 12)."""
    few = np.unique(np.linspace(0, data.n - 1, min(data.n, _FEW)).astype(np.intp))
    R_X = Rotation.create_group("O").as_matrix()
    for rows in (few, np.arange(data.n)):
        poses = PosePairs(data.robot[rows], data.camera[rows], data.setup)
        sides = (S if S is None or S.ndim == 2 else S[rows] for S in (noise.robot, noise.camera))
        part = PoseNoise(*sides, prior=noise.prior)
        at, information, cost = _descended(poses, part, _at_gripper(poses, R_X))
        best = int(np.argmin(cost))
        R_X = at.X[best : best + 1, :3, :3]
    assert at.W is not None
    return Unknowns(at.X[best], at.W[best]), information[best]


def _at_gripper(poses: PosePairs, R_X: Array) -> Array:
    """X (s, 4, 4) with the rotations R_X (s, 3, 3): camera, or target for eye-to-hand, at the gripper's origin."""
    X = np.zeros((len(R_X), 4, 4))
    X[:, :3, :3] = R_X
    X[:, 3, 3] = 1.0
    if poses.setup == "eye-to-hand":
        X[:, :3, 3:] = (poses.robot[:, :3, 3:] - R_X[:, None] @ poses.camera[:, :3, 3:]).mean(axis=1)
    return X


def _descended(poses: PosePairs, noise: PoseNoise, X: Array) -> tuple[Unknowns, Array, Array]:
    """Gauss-Newton from each X (s, 4, 4), no steps along open directions: X and W, information (s, 12, 12), cost."""
    at = Unknowns(X, mean_target(poses, X))
    constraint = OnPoses(poses.robot, poses.camera, poses.setup == "eye-to-hand")
    for k in range(_STEPS + 1):
        linear = constraint.linearise(at, constraint.first, constraint.second)
        factor = cholesky_of(residual_covariance(linear.sides, noise))
        sums = gram(whiten(factor, np.concatenate([linear.J, linear.r[..., None]], axis=-1)))
        information, pull, cost = sums[:, :12, :12], sums[:, :12, 12:], sums[:, 12, 12]
        if noise.prior is not None:
            more, gradient, square = noise.prior.normal_equations(at.X, at.W)
            information, pull, cost = information + more, pull + gradient[..., None], cost + square
        if k == _STEPS:
            break
        values, vectors = _marginal(information)
        inverse = np.where(values < OPEN**-2.0, 0.0, 1.0 / np.maximum(values, OPEN**-2.0))
        of_W = np.linalg.solve(information[:, 6:, 6:], np.concatenate([information[:, 6:, :6], pull[:, 6:]], axis=-1))
        left = pull[:, :6] - information[:, :6, 6:] @ of_W[..., 6:]
        by_X = -vectors @ (inverse[..., None] * (vectors.mT @ left))
        step = np.concatenate([by_X, -of_W[..., 6:] - of_W[..., :6] @ by_X], axis=-2)[..., 0]
        turn = np.linalg.norm(step[:, :3], axis=-1)
        at = at.moved(step / np.maximum(turn / _LONGEST, 1.0)[:, None])
    return at, information, cost
