"""Tolerances: how they are read, the probability against closed forms, and when PASS may not be said."""

import numpy as np
import pytest
from scipy.special import chdtr, fdtr

import uq_handeye as uq
from uq_handeye.calibration.tolerance import Tolerance, probability_within
from uq_handeye.fit.graph.reference import Reference

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


@pytest.fixture(scope="module")
def result():
    return uq.calibrate(uq.simulate(n_poses=30, noise=NOISE, seed=1), noise=NOISE)


@pytest.mark.parametrize("text", ["1mm,0.1deg", "0.1deg, 1 mm", "1e-3m,0.1deg"])
def test_a_tolerance_is_read_in_any_order_and_unit(text):
    tolerance = Tolerance.read(text, "0.5m")
    np.testing.assert_allclose(
        [tolerance.translation, tolerance.rotation, tolerance.at], [1e-3, np.radians(0.1), 0.5], rtol=1e-12
    )
    assert tolerance == Tolerance.read((tolerance.translation, tolerance.rotation), 0.5)


@pytest.mark.parametrize(
    ("text", "at", "said"),
    [
        ("1,0.1deg", None, "unit"),
        ("1mm,2mm", None, "1mm,0.1deg"),
        ("", None, "tolerance"),
        ("-1mm", None, "above 0"),
        ("0.1deg", "0.5m", "beside"),
        (3, None, "1mm,0.1deg"),
        ("1mm", "-1m", "above 0"),
    ],
)
def test_what_is_no_tolerance_is_refused(text, at, said):
    with pytest.raises(uq.InputError, match=said):
        Tolerance.read(text, at)


@pytest.mark.parametrize("sizes", [0.5, 1.0, 2.5])
@pytest.mark.parametrize("dof", [None, 4.0, 30.0])
def test_the_probability_is_that_of_the_distribution(sizes, dof):
    """Isotropic parts: |tau|^2 / s^2 is chi-square(3), or 3 F(3, nu)."""
    S = np.diag([1e-8] * 3 + [4e-8] * 3)
    reference = Reference() if dof is None else Reference("F", dof)
    limit = sizes * 2e-4
    found = probability_within(S, reference, Tolerance(limit, None), np.eye(3))
    expected = chdtr(3, sizes**2) if dof is None else fdtr(3, dof, sizes**2 / 3)
    assert found == pytest.approx(expected, abs=3e-3)
    both = probability_within(S, Reference(), Tolerance(limit, sizes * 1e-4), np.eye(3))
    assert both == pytest.approx(chdtr(3, sizes**2) ** 2, abs=4e-3)


def test_hotelling_has_five_degrees_of_freedom_less():
    S, dof = np.eye(6) * 1e-8, 20.0
    found = probability_within(S, Reference("Hotelling", dof), Tolerance(2e-4, None), np.eye(3))
    # xi^T S^-1 xi of three components is dof / (dof - 5) times 3 F(3, dof - 5).
    assert found == pytest.approx(fdtr(3, dof - 5, 4 / 3 * (dof - 5) / dof), abs=3e-3)


def test_a_point_ahead_moves_with_the_rotation_of_x():
    """Rotation errors about x alone: a point at distance a moves by a theta."""
    S = np.diag([1e-6, 0, 0, 0, 0, 0])
    R = np.eye(3)
    at = Tolerance(1e-3, None, at=0.5)
    assert probability_within(S, Reference(), at, R) == pytest.approx(chdtr(1, 4.0), abs=2e-3)
    assert probability_within(S, Reference(), Tolerance(1e-3, None), R) == 1.0
    turned = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # the camera looks along x, about which nothing moves
    assert probability_within(S, Reference(), at, turned) == 1.0


def test_the_words(result):
    assert result.verdict("5mm,0.5deg").word == "PASS" and result.verdict("5mm,0.5deg").passed
    assert result.verdict("0.05mm").word == "FAIL"
    middle = result.verdict((0.4e-3, np.radians(0.06)))
    assert middle.word == "NOT SHOWN" and 0.05 < middle.probability < 0.95 and not middle.reasons
    assert "0.4 mm and 0.06 deg" in str(middle) and "needed" in str(middle)
    assert middle.to_dict()["verdict"] == "NOT SHOWN"


def test_the_probability_falls_with_the_tolerance(result):
    found = [result.verdict((size, None)).probability for size in np.geomspace(1e-5, 1e-2, 12)]
    assert (np.diff(found) >= 0).all() and found[0] < 0.01 and found[-1] > 0.99


@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
class TestNeverPass:
    """However wide the tolerance."""

    def test_from_a_lower_limit(self, result):
        alone = uq.calibrate(result.data, shared=[])
        assert alone.accuracy.lower_limit
        verdict = alone.verdict("1m,90deg")
        assert verdict.word == "NOT SHOWN" and "lower limit" in str(verdict)

    def test_with_a_failed_check(self, result):
        small = uq.PoseNoise.isotropic(robot=("0.01deg", "0.02mm"), camera=("0.04deg", "0.2mm"))
        verdict = uq.calibrate(result.data, noise=small).verdict("1m,90deg")
        assert verdict.word == "NOT SHOWN" and "X is not usable: first and second half differ" in str(verdict)

    def test_with_x_that_is_not_usable(self, result):
        inverse = uq.PosePairs(result.data.robot, np.linalg.inv(result.data.camera), setup="eye-in-hand")
        found = uq.calibrate(inverse, noise=NOISE)
        assert not found.usable and found.headline.startswith("NOT USABLE: the camera file seems inverse, or the setup")
        verdict = found.verdict("1m,90deg")
        assert verdict.word == "NOT SHOWN" and verdict.probability is None

    def test_without_a_covariance(self, result):
        exact = uq.simulate(n_poses=8, seed=2)
        found = uq.calibrate(exact)
        assert found.accuracy is None and "not known" in found.headline
        assert found.verdict("1m,90deg").word == "NOT SHOWN"


def test_the_verdict_survives_the_file(result, tmp_path):
    result.to_json(tmp_path / "result.json")
    back = uq.Calibration.from_json(tmp_path / "result.json")
    assert back.verdict("0.4mm,0.06deg") == result.verdict("0.4mm,0.06deg")
    assert back.headline == result.headline and back.accuracy == result.accuracy
    assert [check.text for check in back.checks] == [check.text for check in result.checks]
