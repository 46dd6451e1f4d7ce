"""Wu, Sun, Wang and Liu (2019): 4D Procrustes analysis, in the limit of its scaling factor (`procrustes`)."""

from __future__ import annotations

from collections.abc import Callable

from ...core.geometry.se3 import Array
from ...model.noise.models import PairNoise
from ..procrustes.limit import solve_limit
from ..procrustes.sensitivity import LimitDerivatives
from .common.method import Derivatives, Estimate, Method, closed_form


class _Limit:
    def estimate(self, A: Array, B: Array, noise: PairNoise | None) -> Estimate:
        return closed_form(solve_limit(A, B))

    def derivatives(self, A: Array, B: Array, noise: PairNoise | None, X: Array) -> Callable[[slice], Derivatives]:
        return lambda trials: LimitDerivatives(X[trials], checked=True)


METHOD = Method(
    name="4dpa",
    authors="J. Wu, Y. Sun, M. Wang and M. Liu",
    year=2019,
    title="Hand-Eye Calibration: 4-D Procrustes Analysis Approach. IEEE Trans. Instrumentation and Measurement 69(6), "
    "2966-2981",
    doi="10.1109/TIM.2019.2930710",
    structure="simultaneous",
    form="closed form",
    minimises="sum |u - R_X v|^2 of u, v = sin(angle) axis, and to first order in 1/d the translation part (T2); at "
    "finite d the algebraic error (27) summed over a basis of the other quaternion",
    singular="all motions near 180 degrees",
    solver=_Limit(),
)
