r"""The posterior of a calibration with open sizes: a mixture over their points, made when it is first asked for.

The fit at the mean logarithms of the sizes gives the estimates and P_0, their covariance at these sizes. At each point
theta_d the `LatentModel` has mean and covariance of all unknowns. Those are taken relative to the model's own at the
mean sizes, ``M = L(P_0) L(C_0)^-1``, since the fit weighs poses that the model leaves out or counts whole,

    m_d = M (mean_d - mean_0),      C_d = M Cov_d M^T,      P = sum_d w_d (C_d + m_d m_d^T)

and the block of X and W is brought to the covariance that the calibration states.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from ...core.geometry.se3 import Array
from ...core.runtime.read_only import ReadOnlyArrays
from ...model.kinematics.kinematic_errors import JOINT_NOISE
from ...model.noise.joint_covariance import JointCovariance
from ...model.noise.models import INTRINSICS
from ...model.posterior.posterior import FreshNoise, Posterior, SizePoints
from ...model.posterior.rows import factor_of
from ...model.shared_errors.view import median_distance
from .engine import LatentModel
from .estimation import BY_VIEW, FoundSizes


@dataclass(frozen=True, eq=False)
class OpenSizes(ReadOnlyArrays):
    """Ingredients of the posterior with open sizes; see the module."""

    base: Posterior  # at the mean sizes, its block of X and W as the calibration states it
    of_poses: Array  # (p, p) that block at the mean sizes
    model: LatentModel
    theta: Array  # (d, k)
    weights: Array  # (d,)
    mean_theta: Array  # (k,)
    names: tuple[str, ...]  # (k,)
    order: NDArray[np.intp]  # (q,) columns of the model in the order of the names of `base`
    unit: Array  # (q,) of each, in place of that of the model

    @cached_property
    def posterior(self) -> Posterior:
        """The mixture."""
        p = self.model.p
        index = np.concatenate([np.arange(p), p + self.order])
        sign = -np.concatenate([np.ones(p), self.unit])  # the model has the opposite signs

        def told(theta: Array) -> tuple[Array, Array]:
            of = self.model.conditional(theta)
            return sign * of.mean[index], of.covariance[np.ix_(index, index)] * np.outer(sign, sign)

        mean, C = told(self.mean_theta)
        P = np.array(self.base.covariance)
        P[:p, :p] = self.of_poses
        M = _carrying(C, P)
        found = [told(theta) for theta in self.theta]
        means = np.array([m - mean for m, _ in found]) @ M.T
        covariances = M @ np.array([S for _, S in found]) @ M.T
        P = np.tensordot(self.weights, covariances, axes=1) + (self.weights * means.T) @ means
        to_stated = np.eye(len(P))
        to_stated[:p, :p] = _carrying(P[:p, :p], self.base.covariance[:p, :p])
        P = to_stated @ P @ to_stated.T
        P[:p, :p] = self.base.covariance[:p, :p]
        back = solve_triangular(factor_of(P), to_stated, lower=True)
        each = back @ covariances @ back.T
        points = SizePoints(self.names, self.theta, self.weights, means @ back.T, 0.5 * (each + each.mT))
        return replace(self.base, covariance=0.5 * (P + P.T), points=points)


def with_open_sizes(base: Posterior, of_poses: Array, found: FoundSizes) -> Posterior | OpenSizes:
    """Return the posterior over the sizes that were found; ``of_poses`` (12, 12) is the block of X and W at their mean.

    ``base`` is the posterior at the mean sizes.
    """
    model, mixture, source = found.model, found.mixture, found.source
    sizes = np.array([model.sizes(theta) for theta in mixture.theta])  # (d, components)
    base = replace(base, noise=_fresh(found, sizes))
    free = [source.components[k].name for k in model.free]
    if not free or found.reduced.basis is not None or model.p != base.p:
        return base
    settled = model.sizes(mixture.mean_theta)
    sd = {part: float(s) for error in found.errors for part, s in zip(error.parts, error.sd, strict=True)}
    place: dict[str, tuple[int, float]] = {}
    column = {"robot": 0, "camera": 0}  # numbers of the columns of a side, by which intrinsics are named
    at = 0
    for k, part in enumerate(source.components):
        for name in part.parts:
            if part.side == "camera" and name in ("", INTRINSICS):
                name = f"{INTRINSICS}: {column[part.side]}"
            place[name] = at, sd.get(name, 1.0) / float(settled[k])
            column[part.side] += 1
            at += 1
    if not set(base.names) <= place.keys():
        return base
    order = np.array([place[name][0] for name in base.names], dtype=np.intp)
    unit = np.array([place[name][1] for name in base.names])
    return OpenSizes(
        base, of_poses, model, mixture.theta, mixture.weights, mixture.mean_theta, tuple(free), order, unit
    )


def _fresh(found: FoundSizes, sizes: Array) -> tuple[FreshNoise, ...]:
    """Return the noise of new poses: what is drawn again, with its sizes; mean covariances over the poses so far."""
    source, listed = found.source, []
    settled = found.model.sizes(found.mixture.mean_theta)
    free = set(found.model.free.tolist())
    for side in ("robot", "camera"):
        if side in source.known and source.known[side].any():
            listed.append(FreshNoise("given", side, _mean(source.known[side]), 1.0, np.ones(len(sizes))))
    for k, part in enumerate(source.components):
        if part.block is None:
            continue
        name, distance = part.name, 0.0
        if name == BY_VIEW and source.poses is not None:
            distance = median_distance(source.poses.camera)
        covariance = np.zeros((6, 6)) if name == JOINT_NOISE else _mean(part.block @ part.block.mT)
        by_point = sizes[:, k] if free else np.zeros(0)
        listed.append(FreshNoise(name, part.side, covariance, float(settled[k]), by_point, distance))
    return tuple(replace(one, by_point=one.by_point if free else np.zeros(0)) for one in listed)


def _mean(S: Array | JointCovariance) -> Array:
    own = S.own if isinstance(S, JointCovariance) else np.asarray(S)
    return np.asarray(own.reshape(-1, 6, 6).mean(axis=0))


def _carrying(C: Array, P: Array) -> Array:
    """M with ``M C M^T = P``, near 1 where they are alike."""
    L = factor_of(C)
    return np.asarray(solve_triangular(L, factor_of(P).T, lower=True, trans="T").T)
