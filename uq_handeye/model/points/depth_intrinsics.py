r"""Effect of the intrinsics of a depth camera on its points, and the test of the numbers that were given.

Model: a depth camera makes the point ``p = z ((u - cx) / fx, (v - cy) / fy, 1)`` of the pixel (u, v) with the depth z.
Errors of the intrinsics k, those used less the true ones, move the points of all poses alike,

    d p / d k = D = [[-x/fx, 0, -z/fx, 0], [0, -y/fy, 0, -z/fy], [0, 0, 0, 0]]        of (fx, fy, cx, cy)

and, through the weighted fit with derivatives J and weights W, the poses by ``G_i = N_i^-1 sum J^T W D``. What no pose
explains, ``E = D - J G``, tests the numbers: information ``sum E^T W E`` and gradient ``-sum E^T W r``
(`model.camera.given_intrinsics`).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...core.geometry.se3 import Array
from ...errors import InputError
from ...findings import Finding
from ..camera.given_intrinsics import GivenIntrinsics, GivenTest, finding_of
from ..camera.models import LINEAR
from ..errors.joint_covariance import JointCovariance
from ..errors.keys import INTRINSICS
from .closed_form import sums
from .least_squares import Fit


def with_intrinsics(found: Fit, given: GivenIntrinsics) -> tuple[JointCovariance, list[Finding]]:
    """Return the joint covariance of the poses with the errors of the intrinsics, and whether the points agree.

    Raises `InputError` without fx, fy, cx and cy.
    """
    k = _linear(given.values)
    sd = np.array([given.values[name][1] for name in LINEAR])
    points = found.points
    D = np.zeros((len(points.y), 3, 4))
    x, y, z = points.y.T
    D[:, 0, 0], D[:, 1, 1], D[:, 0, 2], D[:, 1, 3] = -x / k[0], -y / k[1], -z / k[0], -z / k[1]
    G = np.linalg.solve(found.N, sums(found.J.mT @ found.W @ D, points.pose, points.n))
    E = D - found.J @ G[points.pose]
    information = np.einsum("kia,kij,kjb->ab", E, found.W, E)
    of_prior = np.eye(4) + information * sd**2
    precision = np.linalg.solve(of_prior, information)
    pull = np.linalg.solve(of_prior, -np.einsum("kia,kij,kj->a", E, found.W, found.r))
    test = GivenTest(LINEAR, k, sd, 0.5 * (precision + precision.T), pull)
    size = int(2 * k[2] + 1), int(2 * k[3] + 1)
    shared = G[..., sd > 0] * sd[sd > 0]
    keys = (INTRINSICS,) * shared.shape[-1]
    finding = finding_of(test, size, "pinhole", given.exact, "points")
    return JointCovariance(found.covariance, shared, keys), [finding]


def _linear(values: Mapping[str, tuple[float, float]]) -> Array:
    if missing := [name for name in LINEAR if name not in values]:
        raise InputError(f"Expected fx, fy, cx and cy of the depth camera, got none of {', '.join(missing)}.")
    k = np.array([values[name][0] for name in LINEAR])
    if not (np.isfinite(k).all() and k[:2].min() > 0):
        raise InputError(f"Expected focal lengths above 0 in pixels, got {k[0]:g} and {k[1]:g}.")
    return k
