r"""The errors of a calibration as one Gaussian.

The errors of its estimates ``s = (xi_X, xi_W, e - estimate)`` have the covariance P of the joint posterior, which holds
the errors of robot, camera and target that are the same tomorrow; ``s = A u`` with ``A = P^(1/2)`` and u ~ N(0, I).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..errors import InputError, SingularNoiseError
from ..geometry.se3 import Array
from ..likelihood.constraint import Unknowns, constraint_of
from ..likelihood.gauss_helmert import Fit, fit
from ..likelihood.shared_estimates import JointPosterior, SharedEstimate
from ..noise.models import PoseNoise
from ..poses.motions import Motions
from ..poses.pose_pairs import PosePairs
from ..prediction.predict import Predicting
from ..runtime.read_only import ReadOnlyArrays


class Weighted(Protocol):
    """Interface of a pose table, as far as evidence needs it."""

    @property
    def weight(self) -> Array: ...
    @property
    def counted(self) -> list[int]: ...


class Calibrated(Predicting, Protocol):
    """Interface of a calibration, as far as evidence needs it."""

    @property
    def method(self) -> str: ...
    @property
    def shared(self) -> tuple[SharedEstimate, ...]: ...
    @property
    def table(self) -> Weighted | None: ...


@dataclass(frozen=True, eq=False)
class State(ReadOnlyArrays):
    """Errors of the estimates, ``s = A u`` with u ~ N(0, I)."""

    A: Array  # (12 + q, p)
    estimate: Array  # (q,) of the shared errors
    names: tuple[str, ...]  # (q)

    @property
    def covariance(self) -> Array:
        """(12 + q, 12 + q) of s."""
        return np.asarray(self.A @ self.A.T)


def state_of(result: Calibrated) -> State:
    """Return the errors of a calibration.

    Raises
    ------
    InputError
        No joint covariance of X and W: a published method, motions without poses, an older file; a part of X open.
    """
    posterior = joint_posterior_of(result)
    return State(root(posterior.covariance), posterior.estimate, posterior.names)


def joint_posterior_of(result: Calibrated) -> JointPosterior:
    """Return the joint posterior of X and W; raises `InputError` where there is none, with the reason."""
    if result.opened is not None:
        raise InputError("The motions of this calibration leave a part of X or W open: nothing can be held against it.")
    if result.joint_posterior is None or result.W is None:
        what = "of motions without poses" if isinstance(result.counted, Motions) else f"by method {result.method!r}"
        raise InputError(
            f"Expected a calibration with the joint covariance of X and W, got one {what} without it. Calibrate poses "
            "by method efficient or ml."
        )
    return result.joint_posterior


def refitted(result: Calibrated) -> Fit | None:
    """Return the fit again at the stored estimate, with stored noise and weights; None where the result lacks these."""
    data = result.counted
    if not isinstance(data, PosePairs) or not isinstance(result.noise, PoseNoise) or result.W is None:
        return None
    constraint = constraint_of(data, result.noise)
    weights = None if result.table is None else np.asarray(result.table.weight)[result.table.counted]
    try:
        return fit(constraint, result.noise, Unknowns(result.X, result.W), 1, weights)
    except SingularNoiseError:
        return None


def root(P: Array) -> Array:
    """L with ``P = L L^T``; negative eigenvalues, which are rounding, become 0."""
    scale = np.sqrt(np.maximum(np.abs(np.diag(P)), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(P / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
