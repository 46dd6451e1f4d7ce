"""Findings that a propagated covariance is not valid: reported on nasty problems, not on ordinary ones, and
measured on both.
"""

import warnings

import numpy as np
import pytest
from support import (
    difference,
    exact_poses,
    jacobian,
    moved,
    random_transforms,
    rotation_vectors,
    rotations,
    transforms,
    whitened_eigenvalues,
)

import uq_handeye as uq
from uq_handeye.methods import zhao
from uq_handeye.methods.noise_transport import noise_of_pairs
from uq_handeye.methods.propagate import propagate_and_check
from uq_handeye.methods.validity import MAX_BEND_SD, MAX_PRECISE_SHARE, bend

# Variances (rotation in rad^2, translation in m^2).
ISOTROPIC = np.full(6, 1e-6)
MOSTLY_TRANSLATION = np.repeat([1e-12, 1e-6], 3)
MOSTLY_ROTATION = np.repeat([1e-6, 1e-12], 3)
ONLY_TRANSLATION = np.repeat([0.0, 1e-6], 3)


def poses_of(rng, n, kind):
    """X and exact poses that are well spread, turn by little, or turn nearly about one axis."""
    X, W = random_transforms(rng), random_transforms(rng)
    G = random_transforms(rng, (n,))
    if kind == "small":
        G = random_transforms(rng, (n,), smallest=0.01, largest=0.05)
    elif kind == "axis":
        vectors = rotation_vectors(rng, (), 1.0, 1.0) * rng.uniform(-1.5, 1.5, (n, 1)) + 0.01 * rng.normal(size=(n, 3))
        G = transforms(rotations(vectors), 0.5 * rng.normal(size=(n, 3)))
    return X, G, np.linalg.inv(X) @ np.linalg.inv(G) @ W


def motions_of(G, C):
    return (
        np.linalg.inv(G[..., 1:, :, :]) @ G[..., :-1, :, :],
        C[..., 1:, :, :] @ np.linalg.inv(C[..., :-1, :, :]),
    )


def codes(findings):
    return [finding.code for finding in findings]


# -------------------------------------------------------------------------------------------------------- zhao


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "variance"),
    [("wide", ISOTROPIC), ("small", ISOTROPIC), ("small", ONLY_TRANSLATION)],
)
def test_zhao_agrees_with_samples_where_nothing_is_said(rng, kind, variance):
    """Ten motions. Noise of translations alone has a second fixed point, 1e10 times as small."""
    trials = 150
    X, G, C = poses_of(rng, 11, kind)
    A, B = motions_of(G, C)
    noise = uq.PairNoise(A=np.diag(variance), B=np.diag(variance))
    covariance, findings = propagate_and_check(A, B, noise, X=X, method="zhao")
    assert findings == []
    errors = np.sqrt(variance) * rng.normal(size=(2, trials, 10, 6))
    xi = difference(uq.METHODS["zhao"](moved(A, errors[0]), moved(B, errors[1])), X)
    ratios = whitened_eigenvalues(xi.T @ xi / trials, covariance)
    assert ratios[0] > 0.5 and ratios[-1] < 2.0, ratios


@pytest.mark.slow
def test_zhao_says_where_residuals_known_better_than_X_hold_it(rng):
    """Nearly one axis and no noise of rotations: sampled variances are ten times as large and more."""
    trials, largest = 80, []
    noise = uq.PairNoise(A=np.diag(ONLY_TRANSLATION), B=np.diag(ONLY_TRANSLATION))
    for _ in range(3):
        X, G, C = poses_of(rng, 11, "axis")
        A, B = motions_of(G, C)
        covariance, findings = propagate_and_check(A, B, noise, X=X, method="zhao")
        assert codes(findings) == ["propagation.precise_residuals"]
        assert findings[0].values["share"] > MAX_PRECISE_SHARE and "known better than X" in str(findings[0])
        errors = np.sqrt(ONLY_TRANSLATION) * rng.normal(size=(2, trials, 10, 6))
        found = uq.METHODS["zhao"].estimate(moved(A, errors[0]), moved(B, errors[1]))
        xi = difference(found.X, X)[found.converged]
        largest.append(whitened_eigenvalues(xi.T @ xi / len(xi), covariance)[-1])
    assert max(largest) > 4.0, largest


def test_zhao_with_few_data_says_so(rng):
    X, G, C = poses_of(rng, 9, "wide")
    A, B = motions_of(G, C)
    noise = uq.PairNoise(A=np.diag(ISOTROPIC))
    assert codes(propagate_and_check(A, B, noise, X=X, method="zhao")[1]) == ["propagation.few_data"]
    with pytest.warns(uq.InputWarning, match="With 8 pairs it may be wrong"):
        uq.propagate(A, B, noise, X=X, method="zhao")


def test_zhao_raises_where_its_covariance_does_not_converge(rng, monkeypatch):
    monkeypatch.setattr(zhao, "MAX_STEPS", 2)
    X, G, C = poses_of(rng, 11, "wide")
    with pytest.raises(uq.NotConvergedError, match="covariance of method 'zhao' did not converge within 2"):
        uq.propagate(*motions_of(G, C), uq.PairNoise(A=np.diag(ISOTROPIC)), X=X, method="zhao")


# ------------------------------------------------------------------------------------------------------ nguyen


def by_derivatives(G, C, weights, X, variance):
    """The covariance by numerical derivatives of the estimate at these data."""
    n = len(G)

    def errors(z):
        z = z.reshape(-1, 2, n, 6)
        A, B = motions_of(moved(G, z[:, 0]), moved(C, z[:, 1]))
        return difference(uq.METHODS["nguyen"].estimate(A, B, weights).X, X)

    D = jacobian(errors, 12 * n, 1e-5) * np.sqrt(np.tile(variance, 2 * n))
    return D @ D.T


def nguyen_case(rng, kind, variance, size):
    """Data with noise: the covariance over that by derivatives, and what is said."""
    _, G, C = poses_of(rng, 11, kind)
    variance = size**2 * variance
    G, C = (moved(T, np.sqrt(variance) * rng.normal(size=(11, 6))) for T in (G, C))
    noise = uq.PoseNoise(robot=np.diag(variance), camera=np.diag(variance))
    motions = uq.relative_motions(uq.PosePairs(G, C, "eye-in-hand"), "consecutive")
    weights = noise_of_pairs(motions, noise)
    X = uq.METHODS["nguyen"].estimate(motions.A, motions.B, weights).X
    covariance, findings = propagate_and_check(motions, noise, X=X, method="nguyen")
    return whitened_eigenvalues(covariance, by_derivatives(G, C, weights, X, variance)), findings


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["wide", "small"])
@pytest.mark.parametrize("variance", [ISOTROPIC, MOSTLY_TRANSLATION, MOSTLY_ROTATION])
def test_nguyen_is_the_derivative_where_nothing_is_said(rng, kind, variance):
    for _ in range(5):
        ratios, findings = nguyen_case(rng, kind, variance, 0.3 if kind == "small" else 1.0)
        if not findings:
            assert ratios[0] > 0.5 and ratios[-1] < 2.0, ratios
        if kind == "wide":
            assert findings == [] and np.abs(ratios - 1.0).max() < 0.1, (ratios, findings)


@pytest.mark.slow
@pytest.mark.parametrize("variance", [ISOTROPIC, MOSTLY_ROTATION])
def test_nguyen_says_where_its_error_is_curved(rng, variance):
    cases = [nguyen_case(rng, "axis", variance, 1.0) for _ in range(5)]
    assert all(codes(findings) == ["propagation.curved"] for _, findings in cases)
    assert all(findings[0].values["bend"] > MAX_BEND_SD for _, findings in cases)
    assert max(ratios[-1] for ratios, _ in cases) > 2.0  # it is worth saying


def test_bend_is_that_of_translations_fitted_to_drawn_rotations(rng):
    """The best translation for each of many rotations, without its linear part, in standard deviations given R."""
    X, G, C = poses_of(rng, 8, "wide")
    A, B = motions_of(G, C)
    L = rng.normal(size=(6, 6)) * np.repeat([0.05, 0.3], 3)[:, None]
    S = L @ L.T
    D = (A[:, :3, :3] - np.eye(3)).reshape(-1, 3)

    def translation(R):
        q = np.einsum("...ij,mj->...mi", R, B[:, :3, 3]) - A[:, :3, 3]
        return np.linalg.lstsq(D, q.reshape(len(q), -1).T, rcond=None)[0].T

    theta = 1e-2 * rng.normal(size=(20_000, 3)) @ np.linalg.cholesky(S[:3, :3]).T  # so small that second order is all
    even = 0.5 * (translation(rotations(theta) @ X[:3, :3]) + translation(rotations(-theta) @ X[:3, :3]))
    even = 1e4 * (even - translation(X[None, :3, :3]))
    given = S[3:, 3:] - S[3:, :3] @ np.linalg.solve(S[:3, :3], S[:3, 3:])
    drawn = whitened_eigenvalues(even.T @ even / len(even), given)[-1]
    found = bend(A[None], B[None], X[None], S[None])
    np.testing.assert_allclose(found, np.sqrt(drawn), rtol=0.05)


@pytest.mark.parametrize("method", ["nguyen", "zhao"])
def test_calibrate_says_it_too(rng, method):
    _, G, C = poses_of(rng, 11, "axis")
    variance = ISOTROPIC if method == "nguyen" else MOSTLY_TRANSLATION
    G, C = (moved(T, np.sqrt(variance) * rng.normal(size=(11, 6))) for T in (G, C))
    noise = uq.PoseNoise(robot=np.diag(variance), camera=np.diag(variance))
    said = "along a curve" if method == "nguyen" else "known better than X"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = uq.calibrate(uq.PosePairs(G, C, "eye-in-hand"), noise=noise, method=method, pairs="consecutive")
    assert sum(said in text for text in result.warnings) == 1


@pytest.mark.slow
def test_nothing_is_said_of_ordinary_data():
    """Real sizes of noise, few poses and many, both methods, all pairs and consecutive ones."""
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    for n in (10, 20):
        poses = uq.simulate(n_poses=n, noise=noise, seed=n)
        for pairs in ("all", "consecutive"):
            motions = uq.relative_motions(poses, pairs)
            for method in ("nguyen", "zhao"):
                assert propagate_and_check(motions, noise, method=method)[1] == []


def test_exact_data_bend_finitely(rng):
    """A translation without variance, given the rotation, leaves no NaN and no infinity."""
    X, G, C = exact_poses(rng, 5)
    A, B = motions_of(G, C)
    S = np.zeros((6, 6))
    assert bend(A[None], B[None], X[None], S[None])[0] == 0.0
    S[:3, :3] = 1e-6 * np.eye(3)
    assert np.isfinite(bend(A[None], B[None], X[None], S[None])).all()
