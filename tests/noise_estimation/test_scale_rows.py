"""The restricted likelihood of deviations of groups: against dense matrices, differences, and many draws."""

from __future__ import annotations

import numpy as np
import pytest

from uq_handeye.noise_estimation.scale_rows import OwnPart, ScaleRows

N, P, M, PARAMETERS = 12, 5, 14, 6


def rows_of(rng: np.random.Generator, r: int, prior: bool) -> ScaleRows:
    E = np.broadcast_to(np.eye(r), (N, r, r))
    known = 0.05 * E
    half = rng.normal(size=(P + 1, P + 1))
    return ScaleRows(
        rng.normal(size=(N, r, P)),
        rng.normal(size=(N, r)),
        [OwnPart(0, E[..., :2]), OwnPart(1, E[..., 2:]), OwnPart(2, rng.normal(size=(N, r, 4)))],
        known,
        rng.normal(size=(N, r, M)),
        np.repeat([3, 4, 5, -1, 2], [4, 3, 3, 2, 2]),
        half.T @ half if prior else None,
    )


def dense(rows: ScaleRows, x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Deviance, x and its covariance by ``S + B T^2 B^T`` itself."""
    n, r = rows.y.shape
    S = np.zeros((n * r, n * r))
    assert rows.known is not None
    for i in range(n):
        S[i * r : i * r + r, i * r : i * r + r] = rows.known[i] + sum(
            np.exp(2 * x[k]) * U[i] @ U[i].T for k, U in rows.own
        )
    B = rows.B.reshape(n * r, -1) * rows.scales(x)
    S += B @ B.T
    J, y = rows.J.reshape(n * r, -1), rows.y.ravel()
    sums = np.column_stack([J, y]).T @ np.linalg.solve(S, np.column_stack([J, y]))
    sums = sums if rows.prior is None else sums + rows.prior
    C = np.linalg.inv(sums[:-1, :-1])
    found = C @ sums[:-1, -1]
    d = np.linalg.slogdet(S)[1] - np.linalg.slogdet(C)[1] + sums[-1, -1] - sums[:-1, -1] @ found
    return float(d), found, C


@pytest.mark.parametrize("r", [3, 6])
@pytest.mark.parametrize("prior", [False, True])
def test_deviance_and_estimates_are_those_of_dense_matrices(rng: np.random.Generator, r: int, prior: bool) -> None:
    rows, x = rows_of(rng, r, prior), rng.normal(scale=0.5, size=PARAMETERS)
    at = rows.at(x)
    d, found, C = dense(rows, x)
    assert at.deviance == pytest.approx(d, rel=1e-11)
    np.testing.assert_allclose(at.unknowns, found, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(at.covariance[:P, :P], C, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("r", [3, 6])
def test_gradient_is_the_derivative_of_the_deviance(rng: np.random.Generator, r: int) -> None:
    rows, x = rows_of(rng, r, True), rng.normal(scale=0.5, size=PARAMETERS)
    h = 1e-5 * np.eye(PARAMETERS)
    differences = [(dense(rows, x + step)[0] - dense(rows, x - step)[0]) / 2e-5 for step in h]
    np.testing.assert_allclose(rows.at(x).gradient, differences, rtol=1e-5, atol=1e-5)


def test_sums_that_are_kept_serve_other_deviations_of_groups(rng: np.random.Generator) -> None:
    rows, x = rows_of(rng, 6, False), rng.normal(scale=0.5, size=PARAMETERS)
    moved = x + np.array([0, 0, 0, 0.3, -0.2, 0.1])
    kept, anew = rows.at(moved, rows.sums(x)), rows.at(moved)
    assert kept.deviance == pytest.approx(anew.deviance, rel=1e-12)
    np.testing.assert_allclose(kept.gradient[3:], anew.gradient[3:], rtol=1e-9)
    np.testing.assert_allclose(kept.covariance, anew.covariance, rtol=1e-9, atol=1e-13)
