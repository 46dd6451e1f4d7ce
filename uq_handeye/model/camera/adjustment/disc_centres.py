r"""Place at which the centre of a disc is seen: the centroid of its image, which is not the image of its centre.

A disc of radius rho about the point P of the board, in its plane, is seen as the region of the pixels ``p(P + d)``,
``|d| <= rho``. Detectors find the centroid of that region,

    c = integral p(P + d) J(d) dd / integral J(d) dd,      J = |det(dp / dd)|

by Gauss-Legendre quadrature over the radius and equal steps of the angle. It holds for every camera model. Without
distortion the region is an ellipse, whose centre is the third column of ``H C^-1 H^T``, ``H = K [r_1, r_2, t]`` and C
the matrix of the circle. On the axis of a camera of focal length f, at the distance d and the tilt alpha, the centroid
lies ``f rho^2 sin(alpha) cos(alpha) / d^2`` from the image of the centre, towards the near side.

Source: J. Heikkila, Geometric camera calibration using circular control points, IEEE PAMI 22 (2000) 1066.
"""

from __future__ import annotations

import numpy as np

from ....core.geometry.se3 import Array
from ..corners import Corners
from .bundle import Bundle

ANGLES = 12


def offset(bundle: Bundle, corners: Corners) -> Array:
    """(m, 2) seen centres of discs less the images of their centres, pixels; 0 without ``corners.diameter``."""
    if corners.diameter is None:
        return np.zeros((corners.m, 2))
    poses = bundle.poses[corners.picture]
    nodes, weights = np.polynomial.legendre.leggauss(3)  # radii
    radius, angle = 0.5 * (nodes + 1.0), 2.0 * np.pi * np.arange(ANGLES) / ANGLES
    unit = (radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)).reshape(-1, 2)
    of_ring = np.repeat(weights * radius, ANGLES)
    d = 0.5 * corners.diameter[:, None, None] * unit  # (m, k, 2)
    axes = poses[:, :3, :2].mT  # (m, 2, 3)
    at = (poses[:, :3, :3] @ corners.points[..., None])[..., 0] + poses[:, :3, 3]
    seen = bundle.model.project(bundle.intrinsics, at[:, None] + d @ axes)
    J = np.abs(np.linalg.det(seen.by_point @ axes[:, None].mT)) * of_ring
    centroid = np.einsum("mk,mki->mi", J, seen.pixels) / J.sum(axis=-1, keepdims=True)
    return np.asarray(centroid - bundle.model.project(bundle.intrinsics, at[:, None]).pixels[:, 0])
