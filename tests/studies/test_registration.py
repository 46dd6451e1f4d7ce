"""The study of registration: its forms, its covariance, its kinship to attitude determination, and its verdicts."""

import numpy as np
import pytest
from fixtures.study_tables import quick_tables
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.common.scores import nees, true_means
from studies.registration import covariance as covariance
from studies.registration import findings
from studies.registration import forms as forms

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def tables():
    return quick_tables("registration")


@pytest.mark.parametrize("n", [3, 4])
def test_point_sets_are_what_they_are_called(n):
    rng = np.random.default_rng(1)
    for case, rank in (("generic", n), ("n - 1 directions", n - 1), ("n - 2 directions", n - 2), ("mirrored", n)):
        U, V = forms.point_sets(rng, n, case, 3)
        assert all(np.linalg.matrix_rank(u, tol=1e-9) == rank for u in U)
        assert U.shape == V.shape == (3, forms.POINTS, n)
    sign = np.linalg.det(np.linalg.lstsq(U[0] - U[0].mean(0), V[0] - V[0].mean(0), rcond=None)[0])
    assert sign == pytest.approx(-1)  # mirrored
    Q = forms.rotations(rng, n, 50)
    np.testing.assert_allclose(Q @ Q.mT, np.broadcast_to(np.eye(n), Q.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(Q), 1)


@pytest.mark.parametrize(("n", "name"), [(n, name) for n, some in forms.FORMS.items() for name in some])
def test_forms_register(n, name):
    rng = np.random.default_rng(2)
    U, R, t = rng.normal(size=(10, 20, n)), forms.rotations(rng, n, 10), rng.normal(size=(10, 1, n))
    found, shift = forms.by_form(forms.FORMS[n][name], U, U @ R.mT + t)
    np.testing.assert_allclose(found, R, atol=1e-12)
    np.testing.assert_allclose(shift, t[:, 0], atol=1e-12)


def test_davenport_is_that_of_the_textbook():
    rng = np.random.default_rng(3)
    H = rng.normal(size=(5, 3, 3))
    np.testing.assert_allclose(forms.davenport(H), forms.textbook_davenport(H), atol=1e-12)
    q = rng.normal(size=(5, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    R = Rotation.from_quat(q, scalar_first=True).as_matrix()
    form = np.einsum("ka,kab,kb->k", q, forms.davenport(H), q)
    np.testing.assert_allclose(form, np.trace(R @ H, axis1=1, axis2=2), atol=1e-12)


@pytest.mark.parametrize("n", [3, 4])
def test_slopes_against_central_differences(n):
    rng = np.random.default_rng(4)
    U, R, t = rng.normal(size=(7, n)) + 1.0, forms.rotations(rng, n, 1)[0], rng.normal(size=n)
    D, h = covariance.registration_slopes(U, R), 1e-6
    for side, to_residual in (("V", np.eye(n)), ("U", -R)):
        for i, a in np.ndindex(7, n):
            found = []
            for sign in (1, -1):
                points = {"U": U.copy(), "V": U @ R.T + t}
                points[side][i, a] += sign * h
                turn, shift = uq.register(points["U"], points["V"])
                found.append(np.r_[covariance.coordinates(turn @ R.T), shift])
            slope = (found[0] - found[1]) / (2 * h)
            np.testing.assert_allclose(slope, D[i] @ to_residual[:, a], atol=1e-8)


def test_coordinates_are_those_of_the_logarithm():
    rng = np.random.default_rng(5)
    omega = 1e-2 * rng.normal(size=(20, 3))
    np.testing.assert_allclose(covariance.coordinates(Rotation.from_rotvec(omega).as_matrix()), omega, atol=1e-8)
    E = covariance.generators(4)
    np.testing.assert_allclose(np.einsum("kab,lab->kl", E, E), 2 * np.eye(6))
    np.testing.assert_array_equal(E, -E.mT)


def test_the_papers_covariance_and_full_noise():
    rng = np.random.default_rng(6)
    U, R = rng.normal(size=(forms.POINTS, 4)), forms.rotations(rng, 4, 1)[0]
    S = covariance.full_covariances(rng, 4)
    deviations = np.sqrt(np.linalg.eigvalsh(S))
    assert deviations.min() > 0.999e-3 and deviations.max() < 10.001e-3 and np.ptp(S[:, 0, 0]) > 0
    np.testing.assert_allclose(
        covariance.by_octonion(U, R, S),
        covariance.registration_covariance(U, R, None, S)[:6, :6],
        rtol=1e-9,
        atol=1e-18,
    )


@pytest.mark.parametrize(("n", "full"), [(3, True), (4, False)])
def test_covariance_against_monte_carlo(n, full):
    of = covariance.noisy(np.random.default_rng(7), n, full, 2000)
    S = covariance.registration_covariance(of.U, of.R, of.S_U, of.S_V)
    low, high = true_means(2000, len(S))
    assert low < nees(of.errors, S).mean() < high
    assert not low < nees(of.errors, 0.8 * S).mean() < high


def test_right_angles_give_unit_vectors_with_the_noise_of_quest():
    """A rotation error of sd s moves u by s / sqrt(2) across it."""
    rng = np.random.default_rng(8)
    A = covariance.right_angles(rng, 1)
    u = covariance.sines(A)[0]
    assert np.linalg.norm(u) == pytest.approx(1)
    noisy = np.tile(A, (50_000, 1, 1))
    noisy[:, :3, :3] = Rotation.from_rotvec(1e-3 * rng.normal(size=(50_000, 3))).as_matrix() @ noisy[:, :3, :3]
    e = covariance.sines(noisy) - u
    np.testing.assert_allclose(e.T @ e / len(e), 0.5e-6 * (np.eye(3) - np.outer(u, u)), atol=1.5e-8)


def test_quest_is_sigma_squared_times_the_inverse():
    b = np.eye(3)
    np.testing.assert_allclose(covariance.quest(b, 2e-3), 4e-6 * np.eye(3) / 2)


def test_key_facts(tables):
    wahba = tables["wahba"].set_index("d")["from Wahba on (u, v) (rad)"]
    assert wahba[np.inf] < 1e-12 < wahba[1e3] < wahba[1e2]
    quest = tables["quest"].set_index("motions")["QUEST from 4DPA's, relative"]
    assert quest["90 degrees"] < 1e-9 < 0.1 < quest["23 to 149 degrees"]
    printed = tables["printed"]
    assert (printed["largest difference of the transpose from uq.register"] < 1e-12).all()
    assert (tables["covariance"].groupby("covariance")["NEES / components"].mean()["first order"] - 1) < 0.05


def test_verdicts_can_fail(tables):
    text = findings(tables)
    assert "they agree to rounding" in text and "T1 and T2 hold" in text and "covariance is that of 4DPA" in text
    assert "consistent with Monte Carlo in 4 of 4" in text and "6 are rejected" in text and "is the inverse" in text
    other = {name: table.copy() for name, table in tables.items()}
    other["agreement"]["largest difference from SVD"] = 0.1
    printed = other["printed"]
    printed["RMS residual as printed (m)"], printed["det(U V) less det(U V^T)"] = 0.004, 2.0
    first = other["covariance"]["covariance"] == "first order"
    other["covariance"].loc[first, "NEES / components"] = 3.0
    ones = ["NEES / components", "least whitened eigenvalue", "largest whitened eigenvalue"]
    other["covariance"].loc[~first, ones] = 1.0
    other["covariance"]["by (39)-(48), relative difference"] = 0.3
    other["wahba"]["from Wahba on (u, v) (rad)"] = 1e-3
    other["quest"]["QUEST from 4DPA's, relative"] = 0.2
    other["quest"]["NEES / 3 with QUEST's"] = 1.0
    opposite = findings(other)
    assert "they do not agree to rounding" in opposite and "T1 and T2 do not hold" in opposite
    assert "covariance is not that of 4DPA" in opposite and "cannot be rejected at this size" in opposite
    assert "in 0 of 4 cases" in opposite and "0 are rejected" in opposite and "only roughly" in opposite
    assert "det(UV) is not det(UV^T)" in opposite and "is the inverse" not in opposite
