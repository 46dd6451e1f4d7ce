r"""Information of the poses so far about X and W, for planning, with a weak prior where they do not determine X.

With ``I`` the information (12, 12) about ``(xi_X, xi_W)`` (T5), W eliminated leaves ``I_XX - I_XW I_WW^-1 I_WX``. An
eigenvector along which that is worth less than a standard deviation of 0.1 rad or 0.1 m is *open*: parallel axes leave
the translation along them, pure translations all of it. There measured motions contain little but noise; an estimate
without a prior would put X a metre away. So

- X is that of `graph.open_start`, with the prior that what the gripper carries (camera, or target for eye-to-hand)
  is within 0.1 m of its origin, where no other one is given;
- the information along open directions is replaced by that of a weak prior, standard deviation 1 rad and 1 m.

A prior of X or W that the noise has is added to the information. Where nothing is open there is no weak prior; X and
the information are those of `graph.efficient`, unless its residuals are so far above the noise that 4DPA may have
started it from a wrong X.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.geometry.se3 import Array
from ...errors import DegenerateMotionError
from ...findings import GROSS_EXCESS
from ...fit.graph.constraint import OnPoses, Unknowns, residual_covariance
from ...fit.graph.gauss_helmert import efficient
from ...fit.graph.posterior import Posterior
from ...fit.graph.selection import covariance_of
from ...fit.graph.starts import start_open
from ...model.errors.error_estimate import ErrorEstimate
from ...model.errors.models import PoseNoise, with_prior
from ...model.errors.pose_prior import PosePrior
from ...model.errors.square_roots import cholesky_of, gram, whiten
from ...model.poses.pose_pairs import PosePairs

# Standard deviation per axis of the weak prior, rad and m.
WEAK_PRIOR_SD = 1.0
# A direction of X with a larger standard deviation is open, rad and m.
OPEN_SD = 0.1


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
    shared: tuple[ErrorEstimate, ...] = ()

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

    X is trusted unless the residuals make a gross misfit (`GROSS_EXCESS`); those of a wrong X are far larger.

    Raises `InputError` for noise that does not fit.
    """
    try:
        found = efficient(data, noise)
        residual, J = found.white
        at, information = found.unknowns, gram(J) + _of_prior(noise, found.unknowns)
        explained = bool(np.sum(residual**2) <= GROSS_EXCESS**2 * (6 * data.n - 12))
    except DegenerateMotionError:
        explained = False
    if not explained or _open_part(information)[0].size:
        constraint = OnPoses(data.robot, data.camera, data.setup == "eye-to-hand")
        at = start_open(
            constraint, noise if noise.prior is not None else with_prior(noise, _on_the_gripper(data.setup))
        )
        linear = constraint.linearise(at, constraint.first, constraint.second)
        factor = cholesky_of(residual_covariance(linear.sides, noise))
        information = gram(whiten(factor, linear.J)) + _of_prior(noise, at)
    values, directions = _open_part(information)
    unknown = np.array(information)
    unknown[:6, :6] += directions.T @ ((WEAK_PRIOR_SD**-2.0 - values)[:, None] * directions)
    return at, unknown, directions


def _on_the_gripper(setup: str, near_m: float = 0.1) -> PosePrior | None:
    """Return the prior that what the gripper carries is near its origin."""
    near = np.eye(4), np.diag([np.inf] * 3 + [near_m**2] * 3)
    return PosePrior.of(X=near) if setup == "eye-in-hand" else PosePrior.of(W=near)


def _of_prior(noise: PoseNoise, at: Unknowns) -> Array | float:
    """Return the information (12, 12) of a prior of X and W about them."""
    return 0.0 if noise.prior is None else noise.prior.normal_equations(at.X, at.W)[0]


def _open_part(information: Array) -> tuple[Array, Array]:
    """Information (r,), once W is eliminated, along the unit vectors (r, 6) in which X is less certain than OPEN_SD."""
    across = information[:6, 6:]
    values, vectors = np.linalg.eigh(information[:6, :6] - across @ np.linalg.solve(information[6:, 6:], across.T))
    return values[values < OPEN_SD**-2.0], vectors[:, values < OPEN_SD**-2.0].T
