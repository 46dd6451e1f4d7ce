r"""Shift of a corner where a lens bends the edges that meet in it.

``cornerSubPix`` gives the p at which ``sum_q w(q) (g(q) . (q - p))^2`` is smallest: g is the gradient of the picture at
the pixel q, ``w(q) = exp(-|q - p|^2 / a^2)`` over the square of half width a around p. Along an edge through the corner
c, with the unit tangent t, the unit normal n and the curvature kappa,

    q(s) = c + s t + s^2 kappa n / 2,    g ~ n - s kappa t,    g . (q - c) = -s^2 kappa / 2

to second order in s: not zero, as it would be on a straight edge. The two edges of a corner therefore move it by the d
with

    n_e . d = -kappa_e l_e / 2,    l = <s^2> (1 + 2 sigma^2 / a^2) - sigma^2,    e = 1, 2

where sigma is by how many pixels the picture is blurred, and ``<s^2>`` the mean along the edge, within the square, with
the weights ``exp(-s^2 / a^2) h(s)^2``. Those with sigma are small: blur moves a bent edge by ``kappa sigma^2 / 2``
towards its inner side, and w is smaller off the edge, and is centred at p. h is the gradient along an edge that another
meets at the angle phi:

    h(s) = erf(s |sin phi| / (sqrt(2) sigma))

Near the corner there is none, which makes ``<s^2>`` a third larger than in a sharp picture where a is 10. The edges of
a board run along its x and y axes; the camera model says where they go in the picture, and its second differences how
they bend. All pictures of a lens bend edges towards the same side: the effect of d on X does not average out.

Corners of tags may come from straight lines through their edges (`tags`; ``window`` -L, L the geometric mean of
the lengths of both edges). Such a line through an edge of length L is off by ``-kappa L^2 / 12`` at its ends, so that
``l = L^2 / 6``, with the length of each edge by the scale of the picture along it.

In rendered pictures d is the shift within 4 % where a is 8 and more, within 12 % where a is 6 and d is too small to
matter.

Source of the functional: documentation of OpenCV's cornerSubPix; the weights are those of its source.
"""

from __future__ import annotations

import numpy as np
from scipy.special import erf

from ....core.geometry.se3 import Array
from ..corners import Corners, smoothing
from .bundle import Bundle

# Blur of a picture before it is smoothed: of a lens in focus (0.5), pixels (0.3), and the differences and the
# interpolation that `cornerSubPix` takes gradients from (0.7).
BLUR_PX = 0.9


def bias(bundle: Bundle, corners: Corners) -> Array:
    """(m, 2) displacement of detected corners from their true places, pixels; 0 where no ``window`` is known."""
    d = np.zeros((corners.m, 2))
    if corners.window is None:
        return d
    known = corners.window != 0
    a = np.abs(corners.window[known]).astype(float)
    by_lines = corners.window[known] < 0
    poses = bundle.poses[corners.picture[known]]
    at = (poses[:, :3, :3] @ corners.points[known][..., None])[..., 0] + poses[:, :3, 3]
    axes = poses[:, :3, :2].mT  # (m, 2, 3): x and y of the board in the camera frame
    model, parameters = bundle.model, bundle.intrinsics
    seen = model.project(parameters, at)
    scale = np.linalg.norm(axes @ seen.by_point.mT, axis=-1)  # (m, 2) pixels per length along the board
    step = 0.5 * a[:, None] / scale  # second differences over half the window: near the root of <s^2>
    after, before = (model.project(parameters, at[:, None] + way * step[..., None] * axes).pixels for way in (1, -1))
    first, second = 0.5 * (after - before), after - 2 * seen.pixels[:, None] + before  # by one step
    length = np.linalg.norm(first, axis=-1)
    tangent = first / length[..., None]
    curvature = np.sum(_normal(tangent) * second, axis=-1) / length**2
    edges = a[:, None] * np.sqrt(scale / scale[:, ::-1])
    d[known] = np.where(by_lines[:, None], _solved(tangent, curvature, edges**2 / 6.0), shift(a, tangent, curvature))
    return d


def shift(a: Array, tangent: Array, curvature: Array) -> Array:
    """d (m, 2) of corners between edges with the unit ``tangent`` (m, 2, 2) and the ``curvature`` (m, 2) per pixel,
    positive towards ``n = (-t_v, t_u)``, in windows of half width ``a`` (m,) pixels."""
    x, y = tangent[..., 0, :], tangent[..., 1, :]
    apart = np.abs(x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0])  # sine of the angle between the edges
    end = (a[:, None] + 0.5) / np.abs(tangent).max(axis=-1)  # the outermost pixels reach half a pixel further
    nodes, weights = np.polynomial.legendre.leggauss(12)  # on (-1, 1)
    s = 0.5 * end[..., None] * (1 + nodes)
    met = erf(s * (apart / (np.sqrt(2) * blur(a)))[:, None, None])
    weight = weights * np.exp(-((s / a[:, None, None]) ** 2)) * met**2
    mean_square = np.sum(weight * s**2, axis=-1) / np.sum(weight, axis=-1)
    wide = (blur(a) ** 2)[:, None]
    lever = mean_square * (1 + 2 * wide / a[:, None] ** 2) - wide
    return _solved(tangent, curvature, lever)


def _solved(tangent: Array, curvature: Array, lever: Array) -> Array:
    """d (m, 2) with ``n_e . d = -kappa_e l_e / 2``."""
    return np.asarray(np.linalg.solve(_normal(tangent), (-0.5 * curvature * lever)[..., None])[..., 0])


def blur(a: Array) -> Array:
    """sigma of the pictures in which corners were refined in windows of half width ``a``."""
    return np.asarray(np.hypot(BLUR_PX, smoothing(a)))


def _normal(tangent: Array) -> Array:
    return np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
