"""Helpers of the numerical tests: seeds, geometries, independent references, and judges of covariances.

Nothing here calls the package. ``UQ_HANDEYE_SEED`` in the environment changes every random number of the tests.
"""

import os
from dataclasses import fields, is_dataclass
from functools import cache

import numpy as np
import pytest
from hypothesis import given, seed, settings
from scipy import linalg, stats
from scipy.spatial.transform import Rotation

SEED = int(os.environ.get("UQ_HANDEYE_SEED", "20190508"))

# Markers that ``-m`` names: what their tests need must be there.
DEMANDED: set[str] = set()


def missing(marker, text):
    """Skip a test that needs a tool which is not installed; fail where ``-m`` names its marker, as the gate does."""
    if marker in DEMANDED:
        pytest.fail(text, pytrace=False)
    pytest.skip(text, allow_module_level=True)


def fast(config):
    """Return the expression of ``-m`` that selects the fast subset."""
    options = config.getini("addopts")
    return options[options.index("-m") + 1]


# Two-sided probability of every statistical interval.
CONFIDENCE = 0.999


def holds_for(examples=60, **strategies):
    """A Hypothesis property with the seed of the tests, no example database and no deadline."""

    def decorate(function):
        return settings(deadline=None, database=None, max_examples=examples)(seed(SEED)(given(**strategies)(function)))

    return decorate


# ------------------------------------------------------------------------------------------------- geometries


def rotation_vectors(rng, shape, smallest=0.4, largest=2.6):
    """Rotation vectors with axes uniform on the sphere and angles uniform in [smallest, largest] rad."""
    axis = rng.normal(size=(*shape, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    return axis * rng.uniform(smallest, largest, (*shape, 1))


def rotations(vectors):
    """exp([v]x) by SciPy, for any leading axes."""
    vectors = np.asarray(vectors, dtype=float)
    turns = Rotation.from_rotvec(np.array(vectors).reshape(-1, 3))  # SciPy refuses arrays that are read-only
    return turns.as_matrix().reshape(*vectors.shape, 3)


def logarithms(R):
    return Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(R.shape[:-1])


def transforms(R, t):
    T = np.zeros((*R.shape[:-2], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = R, t, 1.0
    return T


def random_transforms(rng, shape=(), smallest=0.4, largest=2.6, length=0.5):
    return transforms(rotations(rotation_vectors(rng, shape, smallest, largest)), length * rng.normal(size=(*shape, 3)))


def moved(T, xi):
    """``exp([theta]x) R, t + tau``: the error convention, written down once more."""
    return transforms(rotations(xi[..., :3]) @ T[..., :3, :3], T[..., :3, 3] + xi[..., 3:])


def difference(T, reference):
    """xi = (theta, tau) with ``T = moved(reference, xi)``."""
    theta = logarithms(T[..., :3, :3] @ np.swapaxes(reference[..., :3, :3], -1, -2))
    return np.concatenate([theta, T[..., :3, 3] - reference[..., :3, 3]], axis=-1)


def exact_motions(rng, N, shape=(), **kwargs):
    """X and motions A, B without noise."""
    X = random_transforms(rng)
    B = random_transforms(rng, (*shape, N), **kwargs)
    return X, X @ B @ np.linalg.inv(X), B


def noisy_motions(rng, N, sd=1e-2, shape=(), **kwargs):
    """Motions disturbed so much that terms that vanish without noise would show."""
    X, A, B = exact_motions(rng, N, shape, **kwargs)
    return X, *(moved(T, sd * rng.normal(size=(*T.shape[:-2], 6))) for T in (A, B))


def exact_poses(rng, n, setup="eye-in-hand"):
    """X, robot and camera poses with ``G X C = W`` constant (G inverted for eye-to-hand)."""
    X, W = random_transforms(rng), random_transforms(rng)
    G = random_transforms(rng, (n,))
    C = np.linalg.inv(X) @ np.linalg.inv(G) @ W
    return X, (G if setup == "eye-in-hand" else np.linalg.inv(G)), C


def random_covariance(rng, size=6, shape=(), sd=1e-3, spread=3.0):
    """Full covariances with correlations and deviations of about ``sd`` over a factor ``spread``."""
    L = rng.normal(size=(*shape, size, size)) / np.sqrt(size) + 0.5 * np.eye(size)
    L *= sd * np.exp(rng.uniform(-np.log(spread), np.log(spread), (*shape, size, 1)))
    return L @ np.swapaxes(L, -1, -2)


def draw(rng, covariance, shape):
    """Zero-mean Gaussian samples ``(*shape, k)``; the covariance may have leading axes that fit the end of shape."""
    L = np.linalg.cholesky(covariance)
    return (L @ rng.normal(size=(*shape, covariance.shape[-1], 1)))[..., 0]


# The covariances of A and B in the paper's experiment (70).
EQUATION_70 = (
    1e-10 * np.eye(6),
    1e-5
    * np.array(
        [
            [4.15625, -2.88693, -0.60653, 0, 0, 0],
            [-2.88693, 32.0952, -0.14482, 0, 0, 0],
            [-0.60653, -0.14482, 1.43937, 0, 0, 0],
            [0, 0, 0, 19.52937, 2.12627, -1.06675],
            [0, 0, 0, 2.12627, 4.44314426, 0.38679],
            [0, 0, 0, -1.06675, 0.38679, 2.13070],
        ]
    ),
)


# ------------------------------------------------------------------------------------------------- references


def cross_matrix(v):
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def jacobian(function, size, step=1e-3):
    """``d function(x)/dx`` at 0 by central differences of fourth order, all in one batched call.

    ``function`` maps (m, size) to (m, k); returns (k, size). Truncation is of order step^4, rounding of
    order eps/step.
    """
    unit = step * np.eye(size)
    values = function(np.concatenate([2 * unit, unit, -unit, -2 * unit]))
    a, b, c, d = values.reshape(4, size, -1)
    return ((8 * (b - c) - (a - d)) / (12 * step)).T


@cache
def _product_table():
    """Hamilton products e_i e_j of the basis quaternions 1, i, j, k: table[i, j] holds the result."""
    table = np.zeros((4, 4, 4))
    for i in range(4):
        table[i, 0, i] = table[0, i, i] = 1.0
    for i, j, k in ((1, 2, 3), (2, 3, 1), (3, 1, 2)):
        table[i, j, k], table[j, i, k] = 1.0, -1.0
    for i in range(1, 4):
        table[i, i, 0] = -1.0
    return table


def left_matrix(q):
    """R_L: q x = R_L(q) x."""
    return np.einsum("...i,ijk->...kj", q, _product_table())


def right_matrix(q):
    """R_R: x q = R_R(q) x."""
    return np.einsum("...j,ijk->...ki", q, _product_table())


# ------------------------------------------------------------------------------------- judges of covariances


def whitened_eigenvalues(covariance, reference):
    """Eigenvalues of ``reference^-1 covariance``: all 1 if and only if the two are equal. Unit-free."""
    scale = 1.0 / np.sqrt(np.diag(reference))
    return linalg.eigh(covariance * scale[:, None] * scale, reference * scale[:, None] * scale, eigvals_only=True)


def assert_same_covariance(covariance, reference, tolerance, symmetry=1e-9):
    """Relative agreement: |eigenvalues of reference^-1 covariance - 1| < tolerance, and symmetry."""
    assert covariance.shape == reference.shape
    sd = np.sqrt(np.diag(covariance))
    assert np.abs((covariance - covariance.T) / sd / sd[:, None]).max() < symmetry
    eigenvalues = whitened_eigenvalues(covariance, reference)
    assert np.abs(eigenvalues - 1.0).max() < tolerance, eigenvalues


def nees(errors, covariances):
    """``e^T Sigma^-1 e`` of each trial."""
    covariances = np.broadcast_to(covariances, (len(errors), *covariances.shape[-2:]))
    return np.einsum("ti,ti->t", errors, np.linalg.solve(covariances, errors[..., None])[..., 0])


def mean_interval(trials, freedom=6):
    """Return the interval of the mean of that many chi-square variables with probability CONFIDENCE."""
    tail = (1 - CONFIDENCE) / 2
    low, high = stats.chi2.ppf([tail, 1 - tail], trials * freedom) / trials
    return float(low), float(high)


def is_consistent(errors, covariances):
    """Return whether the mean NEES is that of a consistent covariance."""
    low, high = mean_interval(*errors.shape)
    return low < nees(errors, covariances).mean() < high


def covers(errors, covariances, levels=(0.5, 0.68, 0.9, 0.95, 0.99)):
    """For each level whether the share of trials inside the ellipsoid is in its binomial interval."""
    trials, freedom = errors.shape
    distances = nees(errors, covariances)
    tail = (1 - CONFIDENCE) / 2
    return [
        bool(low <= (distances <= stats.chi2.ppf(level, freedom)).sum() <= high)
        for level in levels
        for low, high in [stats.binom.ppf([tail, 1 - tail], trials, level)]
    ]


def writable(value, path="", seen=None):
    """Paths to the arrays within a value that can be written to."""
    seen = set() if seen is None else seen
    if isinstance(value, np.ndarray):
        return [path] if value.flags.writeable else []
    if id(value) in seen:
        return []
    seen.add(id(value))
    if is_dataclass(value) and not isinstance(value, type):
        parts = {f".{field.name}": getattr(value, field.name) for field in fields(value)}
    elif isinstance(value, dict):
        parts = {f"[{key!r}]": item for key, item in value.items()}
    elif isinstance(value, tuple | list):
        parts = {f"[{k}]": item for k, item in enumerate(value)}
    else:
        return []
    return [found for name, part in parts.items() for found in writable(part, path + name, seen)]
