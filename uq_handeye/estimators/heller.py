r"""Heller, Henrion and Pajdla (2014): global polynomial optimisation by linear matrix inequalities.

With dual quaternions, ``s = (q, q')`` and the Gram matrix ``G = sum M^T M`` of the 8x8 equations of `lu`,

    minimise  s^T G s   subject to  s^T E1 s = |q|^2 = 1,   s^T E2 s = q . q' = 0

The publication relaxes this to a semidefinite program (its variant `dqhec`). Of lowest order, that is Shor's relaxation,
``min tr(G W)``, W for ``s s^T`` (8x8, positive semidefinite), and its dual

    maximise  lambda  subject to  G - lambda E1 - mu E2  positive semidefinite

With two quadratic equations it is exact: some optimal W has rank r with r (r + 1) / 2 <= 2, hence rank 1.

The publication leaves the units and the way back from W open. Here lengths are measured in a unit in which both diagonal
blocks of G have the same trace. Without noise ``(0, q)`` is an unbounded direction of W, so that q is the main axis of
``W_qq`` and ``q' = W_q'q q``, made orthogonal to q; Newton's method on the conditions of stationarity

    (G - lambda E1 - mu E2) s = 0,   |q|^2 = 1,   q . q' = 0

takes it from the tolerance of the solver to rounding. Converged means that the solver reports an optimum, that Newton's
method has ended, and that ``G - lambda E1 - mu E2`` then is positive semidefinite to rounding: lambda is a lower bound
of the minimum, which s attains, so that X is the global minimum. The result depends on the unit of length.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ..errors import MissingExtraError
from ..procrustes import DEGENERATE
from ..se3 import Array
from .axes import dual_quaternions, pose_of
from .lu import dual_factors, dual_gram
from .method import Estimate, Method, require
from .moments import Moments, MomentSolver

ITERATIONS = 30
# Steps of Newton's method in rad and in typical lengths: converged below STEP, or where rounding stops it.
STEP = 1e-14
ROUNDED_STEP = 1e-8
# How negative an eigenvalue rounding may make, relative to the largest.
ROUNDING = 1e-12

E1 = np.diag([1.0] * 4 + [0.0] * 4)
E2 = 0.5 * np.eye(8)[[4, 5, 6, 7, 0, 1, 2, 3]]


def _solution(moments: Moments, N: int) -> Estimate:
    G, unit = scaled_gram(moments[0], N)
    program, lock = _program()
    start, optimal = np.empty((len(G), 8)), np.zeros(len(G), dtype=bool)
    with lock:
        for t in range(len(G)):
            start[t], optimal[t] = _relaxed(program, G[t])
    s, multipliers, ended, iterations = stationary(G, start)
    slack = np.linalg.eigvalsh(G - multipliers[:, :1, None] * E1 - multipliers[:, 1:, None] * E2)
    certified = slack[:, 0] >= -ROUNDING * slack[:, -1]
    require(~(optimal & ended & certified) | unique(slack), "two poses fit equally well.")
    return Estimate(in_units(s, unit), optimal & ended & certified, iterations)


def nearby(moments: Moments, N: int, X: Array) -> Array:
    """The stationary point (T, 4, 4) of s^T G s next to X."""
    G, unit = scaled_gram(moments[0], N)
    q = Rotation.from_matrix(X[:, :3, :3], assume_valid=True).as_quat(scalar_first=True)
    s = dual_quaternions(X, q)
    s[:, 4:] /= unit[:, None]
    return in_units(stationary(G, s)[0], unit)


def scaled_gram(moments: Array, N: int) -> tuple[Array, Array]:
    """G (T, 8, 8), its diagonal blocks of trace 1, for q' in the unit of length (T,) returned too."""
    G = dual_gram(moments)
    real, dual = (np.trace(G[:, k : k + 4, k : k + 4], axis1=1, axis2=2) for k in (0, 4))
    spread = np.linalg.eigvalsh(G[:, 4:, 4:])
    require((spread[:, 1] > DEGENERATE * spread[:, 3]) & (dual > 1e-14 * N), "the rotation axes are parallel.")
    scale = np.repeat(1.0 / np.sqrt(np.stack([real, dual], axis=1)), 4, axis=1)
    return G * scale[:, :, None] * scale[:, None, :], np.sqrt(real / dual)


def in_units(s: Array, unit: Array) -> Array:
    """The poses (T, 4, 4) of ``(q, q' / unit)`` (T, 8)."""
    return pose_of(np.concatenate([s[:, :4], s[:, 4:] * unit[:, None]], axis=1))


def unique(slack: Array) -> NDArray[np.bool_]:
    """Whether no more than two eigenvalues (T, 8) vanish: s and, without noise, (0, q)."""
    return np.asarray(slack[:, 2] > DEGENERATE * slack[:, -1])


def stationary(G: Array, start: Array) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.intp]]:
    """Newton's method from ``start`` (T, 8): s, (lambda, mu) (T, 2), whether it ended, and after how many steps."""
    T = len(G)
    s, converged, iterations = np.array(start), np.zeros(T, dtype=bool), np.zeros(T, dtype=np.intp)
    previous, active = np.full(T, np.inf), np.arange(T)
    multipliers = np.zeros((T, 2))
    for count in range(1, ITERATIONS + 1):
        x, g = _feasible(s[active]), G[active]
        gx = (g @ x[..., None])[..., 0]
        # the multipliers that leave the least of the gradient
        mu = 2.0 * np.einsum("ti,ti->t", x[:, :4], gx[:, 4:])
        lam = np.einsum("ti,ti->t", x[:, :4], gx[:, :4])
        K = np.zeros((len(active), 10, 10))
        K[:, :8, :8] = g - lam[:, None, None] * E1 - mu[:, None, None] * E2
        K[:, :8, 8] = K[:, 8, :8] = x @ E1
        K[:, :8, 9] = K[:, 9, :8] = x @ E2
        right = np.zeros((len(active), 10, 1))
        right[:, :8, 0] = -(K[:, :8, :8] @ x[..., None])[..., 0]
        # dividing by the largest entry keeps a singular matrix from raising: its step is then no step of a solution
        step = np.linalg.lstsq(K[0], right[0], rcond=None)[0][None] if len(K) == 1 else _solved(K, right)
        move = step[:, :8, 0]
        s[active] = _feasible(x + move)
        multipliers[active] = np.stack([lam, mu], axis=1)
        length = np.abs(move).max(axis=1)
        ends = (length < STEP) | ((length < ROUNDED_STEP) & (length >= 0.25 * previous[active]))
        previous[active] = length
        iterations[active] = count
        converged[active[ends]] = True
        active = active[~ends]
        if not active.size:
            break
    return s, multipliers, converged, iterations
