"""Constrained minimum of the dual-quaternion equations by two steps in turn: the method `zhang`."""

from __future__ import annotations

import numpy as np

from ..core.geometry.se3 import Array
from ..core.iterations import MAX_STEPS
from ..core.rounding import HALF_DIGITS, PRODUCT_ROUNDING
from .degeneracy import MIN_SPREAD_RATIO
from .dual_quaternions import dual_factors
from .heller import in_units, nearby, scaled_gram
from .method import Estimate, Method, published, require
from .moments import Moments, MomentSolver


def _zhang(moments: Moments, N: int) -> Estimate:
    r"""Zhang, Zhang and Yang (2017): dual quaternions, their real and dual parts by two steps in turn.

    With the equations of `lu`, ``E q = 0`` and ``F q + E q' = 0``, and the blocks ``N = sum E^T E``, ``K = sum E^T F``
    and ``C = sum (E^T E + F^T F)`` of their Gram matrix, stationary points of

        q^T C q + 2 q'^T K q + q'^T N q'    subject to  |q| = 1,  q . q' = 0

    satisfy, with multipliers lambda and mu,

        (i)   N q' + K q + mu q = 0,  q . q' = 0         (ii)  C q + K^T q' + mu q' = lambda q

    The publication recovers the two parts by iteration, in two steps and with a pseudo-inverse. Chosen here, as one
    reading of that:

    (i)  q' given q, by the pseudo-inverse of ``P N P``, ``P = I - q q^T``:  ``q' = H q``,  ``H = -(P N P)^+ K``, and
         ``mu = -q . (N q' + K q)``.
    (ii) q given H and mu: the eigenvector of the smallest eigenvalue of ``C + K^T H + mu (H + H^T)``, which is (ii)
         because ``H^T q = 0``.

    It starts from the rotation only, the eigenvector of the smallest eigenvalue of N. Without noise one iteration ends
    it, as mu is 0 whatever q; else the error shrinks by a constant factor that grows with the noise. (Minimising over
    q' and then over q for fixed q' would not do: the constraint joins them, and the steps would rest where (i) and (ii)
    hold with different mu.) The fixed point is a constrained minimum of the sum of squares, the one that `heller`
    certifies on all but wild data: the two then agree. Converged means that a step is below 1e-14, or below 1e-8 where
    rounding keeps it from shrinking further. The result depends on the unit of length.
    """
    G, unit = scaled_gram(moments[0], N)
    T = len(G)
    q = np.linalg.eigh(G[:, 4:, 4:])[1][..., 0]
    dual = np.empty((T, 4))
    gap, previous = np.empty(T), np.full(T, np.inf)
    converged, iterations, active = np.zeros(T, dtype=bool), np.zeros(T, dtype=np.intp), np.arange(T)
    for count in range(1, MAX_STEPS + 1):
        g, at = G[active], q[active]
        H, mu = _dual_step(g, at)
        spectrum, axes = np.linalg.eigh(_reduced(g, H, mu))
        found = axes[..., 0] * np.where(np.einsum("ti,ti->t", axes[..., 0], at) < 0, -1.0, 1.0)[:, None]
        length = np.abs(found - at).max(axis=1)
        q[active], gap[active] = found, (spectrum[:, 1] - spectrum[:, 0]) / spectrum[:, -1]
        ends = (length < PRODUCT_ROUNDING) | ((length < HALF_DIGITS) & (length >= previous[active]))
        previous[active], iterations[active] = length, count
        converged[active[ends]] = True
        active = active[~ends]
        if not active.size:
            break
    require(~converged | (gap > MIN_SPREAD_RATIO), "two rotations fit equally well.")
    dual = (_dual_step(G, q)[0] @ q[..., None])[..., 0]
    return Estimate(in_units(np.concatenate([q, dual], axis=1), unit), converged, iterations)


def _dual_step(G: Array, q: Array) -> tuple[Array, Array]:
    """H (T, 4, 4) with ``q' = H q``, and mu (T,)."""
    N, K = G[:, 4:, 4:], G[:, 4:, :4]
    P = np.eye(4) - q[:, :, None] * q[:, None, :]
    # P N P has the eigenvalue 0 along q; with one there instead, the pseudo-inverse is an inverse
    size = np.trace(N, axis1=1, axis2=2)[:, None, None]
    H = -P @ np.linalg.solve(P @ N @ P + size * (np.eye(4) - P), P @ K)
    mu = -np.einsum("ti,tij,tj->t", q, N @ H + K, q)
    return H, mu


def _reduced(G: Array, H: Array, mu: Array) -> Array:
    S = G[:, :4, :4] + G[:, :4, 4:] @ H + mu[:, None, None] * (H + H.mT)
    return np.asarray(0.5 * (S + S.mT))


ZHANG = Method(
    **published("zhang"),
    solver=MomentSolver(dual_factors, _zhang, nearby),
    mathematics=_zhang.__doc__,
)
