"""Given intrinsics: tested by the pictures, replaced where these contradict them, kept where they are exact."""

import warnings

import numpy as np
import pytest
from scipy.special import chdtrc

from studies.camera_covariance import SIZE, board, recorded
from uq_handeye.errors import InputWarning
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.given_intrinsics import (
    DEFAULT_SD_SHARE,
    GivenIntrinsics,
    given_test,
    with_default_deviations,
)
from uq_handeye.model.camera.models import LINEAR, MODELS
from uq_handeye.model.camera.stored_calibration import read_camera
from uq_handeye.model.errors.keys import FOCAL_LENGTH, PRINCIPAL_POINT
from uq_handeye.model.errors.sizes import SIZES

LINEAR_TRUTH = (1000.0, 1002.0, 668.0, 470.0)
D = (-0.15, 0.08, 5e-4, -4e-4, -0.02)
BROWN = ("k1", "k2", "p1", "p2", "k3")


def pictures(seed, coefficients=(0.0,) * 5, n=20):
    parameters = np.array([*LINEAR_TRUTH, *coefficients, 0.0, 0.0, 0.0])
    return recorded(np.random.default_rng(seed), n, model="brown", pixel=0.1, parameters=parameters, points=board())[0]


def found(corners, values, model="brown", **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        camera = calibrate_camera(corners, SIZE, model, coefficients=(), intrinsics=values, shape="flat", **options)
    return camera, camera.findings[0]


def linear(**changes):
    return dict(zip(LINEAR, LINEAR_TRUTH, strict=True)) | changes


def test_numbers_without_a_deviation_have_the_default_one():
    assert SIZES[FOCAL_LENGTH].median == SIZES[PRINCIPAL_POINT].median == DEFAULT_SD_SHARE
    given = with_default_deviations({"fx": 1000.0, "fy": (990.0, 3.0), "cx": 640.0, "cy": (480.0, 0.0), "k1": -0.1})
    assert given == {"fx": (1000.0, 0.995), "fy": (990.0, 3.0), "cx": (640.0, 0.995), "cy": (480.0, 0.0), "k1": -0.1}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "names", "explanation"),
    [
        ({"cx": 1279 - 668.0}, ["cx"], "the offset of cx from the middle has the other sign"),
        ({"cy": 510.0}, ["cy"], "another crop, shifted by"),
        ({name: 0.5 * value for name, value in linear().items()}, list(LINEAR), "another resolution (0.5 times"),
        ({"fx": 1030.0}, ["fx"], None),
    ],
)
def test_a_wrong_number_is_named_with_what_explains_it(changes, names, explanation):
    camera, finding = found(pictures(1), linear(**changes), "pinhole")
    assert finding.code == "camera.given_contradicted" and finding.severity == "failure"
    assert sorted(one["name"] for one in finding.values["contradicted"]) == sorted(names)
    for one in finding.values["contradicted"]:
        assert abs(one["wanted"] - linear()[one["name"]]) < 4 * one["std"]
    explanations = finding.values["explanations"]
    assert explanation in explanations[0] if explanation else not explanations
    truth = np.array(LINEAR_TRUTH)
    off = np.array([camera.intrinsics[name] for name in LINEAR]) - truth
    C = camera.bundle.intrinsics_covariance
    assert off @ np.linalg.solve(C, off) < 23.5  # 99.99 % of chi-square with 4
    kept, finding = found(pictures(1), linear(**changes), "pinhole", exact=True)
    assert finding.severity == "caution" and set(kept.std.values()) == {0.0}
    assert kept.intrinsics == pytest.approx(linear(**changes))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "explanation"),
    [
        ((0, 1, 3, 2, 4), "p1 and p2 are exchanged"),
        ((0, 1, 4, 2, 3), "coefficients in the order k1, k2, k3, p1, p2"),
    ],
)
def test_coefficients_in_another_order_are_recognised(order, explanation):
    given = [D[k] for k in order]
    _, finding = found(pictures(2, D), linear() | dict(zip(BROWN, given, strict=True)))
    assert finding.severity == "failure" and explanation in finding.values["explanations"]


@pytest.mark.slow
def test_coefficients_of_the_inverse_model_are_recognised():
    k = {"k1": 0.15, "k2": -0.3, "p1": 5e-4, "p2": -4e-4, "k3": 0.2}
    brown = MODELS["brown"]
    corners = pictures(3)
    # Pixels of a camera whose coefficients lead from pixels to rays.
    unit = np.array([1.0, 1.0, 0.0, 0.0, *k.values(), 0.0, 0.0, 0.0])
    ideal = (corners.pixels - LINEAR_TRUTH[2:]) / LINEAR_TRUTH[:2]
    at = ideal.copy()
    for _ in range(30):
        ahead = np.append(at, np.ones((len(at), 1)), axis=1)
        at = at - (brown.project(unit, ahead).pixels - ideal)
    object.__setattr__(corners, "pixels", at * LINEAR_TRUTH[:2] + LINEAR_TRUTH[2:])
    _, finding = found(corners, linear() | k)
    assert "coefficients are those of the inverse model (pixel to ray)" in finding.values["explanations"]


@pytest.mark.slow
def test_what_agrees_is_a_prior_and_is_stored(tmp_path, without_rendering):
    camera, finding = found(pictures(4), linear(), "pinhole")
    assert (finding.code, finding.severity) == ("camera.given_agree", "note")
    assert camera.given == GivenIntrinsics.of(with_default_deviations(linear()), False)
    assert read_camera(camera.write(tmp_path / "camera")).given == camera.given


@pytest.mark.statistical
def test_right_numbers_are_blamed_as_often_as_stated():
    """40 sets whose numbers are drawn from their deviations: chi-square over the sets, and no finding."""
    rng, chi2 = np.random.default_rng(5), []
    for seed in range(40):
        given = {name: (value + rng.normal(), 1.0) for name, value in linear().items()}
        camera, finding = found(pictures([6, seed], n=8), given, "pinhole")
        assert finding.code == "camera.given_agree"
        test = given_test(camera.bundle, camera.corners, camera.given.values)
        chi2.append(test.chi2())
    assert 1e-3 < chdtrc(160, sum(chi2)) < 1 - 1e-3
