"""Near half a turn the covariance of 4DPA is as exact as the rounded data allow: against 40 digits."""

import mpmath as mp
import numpy as np
import pytest
from support import whitened_eigenvalues

import uq_handeye as uq

SD = (1e-3, 2e-3)  # of all components of A, of B
N = 6


def cross(v):
    return mp.matrix([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def rotation(v):
    """exp([v]x)"""
    angle = mp.norm(v)
    K = cross(v / angle)
    return mp.eye(3) + mp.sin(angle) * K + (1 - mp.cos(angle)) * K * K


def transform(R, t):
    T = mp.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def moved(T, axis, step):
    """T with one component of its error xi set."""
    R, t = T[:3, :3], T[:3, 3]
    e = mp.matrix(3, 1)
    e[axis % 3] = step
    return transform(rotation(e) * R, t) if axis < 3 else transform(R, t + e)


def equations(A, B, X):
    """f and h (6,) of one pair, which the estimate makes vanish in the sum (T2)."""

    def parts(T):
        R, t = T[:3, :3], T[:3, 3]
        u = mp.matrix([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
        return u, (t + R.T * t) / 2

    (u, w), (v, z) = parts(A), parts(B)
    R, t = X[:3, :3], X[:3, 3]
    f = cross(u) * (R * v)
    h = cross(u) * (cross(t) * (R * v)) + cross(w) * (R * v) + cross(u) * (R * z)
    return mp.matrix([*f, *h])


def derivative(function, T, step):
    """(6, 6) by the error of T; central differences, exact to the square of the step."""
    columns = [(function(moved(T, k, step)) - function(moved(T, k, -step))) / (2 * step) for k in range(6)]
    return mp.matrix([[column[i] for column in columns] for i in range(6)])


def reference(A, B, X):
    """The covariance by the implicit function theorem on `equations`, of no formula of the package."""
    step = mp.mpf(10) ** -15
    by_X, square = mp.zeros(6), mp.zeros(6)
    for a, b in zip(A, B, strict=True):
        by_X += derivative(lambda T, a=a, b=b: equations(a, b, T), X, step)
        F = derivative(lambda T, b=b: equations(T, b, X), a, step)
        G = derivative(lambda T, a=a: equations(a, T, X), b, step)
        square += SD[0] ** 2 * (F * F.T) + SD[1] ** 2 * (G * G.T)
    inverse = by_X**-1
    return inverse * square * inverse.T


def difference(first, second):
    """Largest relative difference of a variance in any direction; the subtraction is exact."""
    sd = [mp.sqrt(second[i, i]) for i in range(6)]
    apart = [[(first[i, j] - second[i, j]) / (sd[i] * sd[j]) for j in range(6)] for i in range(6)]
    scale = [[second[i, j] / (sd[i] * sd[j]) for j in range(6)] for i in range(6)]
    return np.abs(whitened_eigenvalues(np.array(apart, dtype=float), np.array(scale, dtype=float))).max()


def rounded(T):
    return np.array(T.tolist(), dtype=float)


@pytest.mark.slow
@pytest.mark.parametrize("distance", np.logspace(-6, 0, 7))
def test_no_digit_is_lost_that_the_data_have(rng, distance):
    """All motions within the distance (rad) of half a turn."""
    with mp.workdps(40):
        numbers = lambda values: mp.matrix([mp.mpf(float(value)) for value in values])  # noqa: E731
        X = transform(rotation(numbers(rng.normal(size=3))), numbers(rng.normal(size=3)))
        inverse = transform(X[:3, :3].T, -(X[:3, :3].T * X[:3, 3]))
        axes = rng.normal(size=(N, 3))
        angles = np.pi - distance * rng.uniform(0.3, 1.0, N)
        vectors = axes / np.linalg.norm(axes, axis=1, keepdims=True) * angles[:, None]
        B = [transform(rotation(numbers(v)), numbers(0.5 * rng.normal(size=3))) for v in vectors]
        A = [X * b * inverse for b in B]
        exact = reference(A, B, X)
        data = [np.stack([rounded(T) for T in side]) for side in (A, B)]
        noise = uq.PairNoise(A=SD[0] ** 2 * np.eye(6), B=SD[1] ** 2 * np.eye(6))
        found = mp.matrix(uq.propagate(*data, noise, X=rounded(X)).tolist())
        of_rounded = reference(
            *([mp.matrix(T.tolist()) for T in side] for side in data), mp.matrix(rounded(X).tolist())
        )
        inherent = difference(of_rounded, exact)
        assert difference(found, exact) < 10 * inherent + 2e-14
        assert inherent < 1e-18 / distance**2 + 1e-14 * (1 + 1 / distance)
