"""Noise files: both ways to state a covariance, and the one line that every bad file ends in."""

import numpy as np
import pytest
from support import random_covariance

import uq_handeye as uq
from uq_handeye.core.geometry.conventions import CovarianceReading
from uq_handeye.errors import InputError
from uq_handeye.model.errors.models import PairNoise, PoseNoise
from uq_handeye.model.errors.noise_toml import read_stated_noise
from uq_handeye.read import read_noise_file

UNIT = np.eye(6).tolist()


@pytest.fixture
def file(tmp_path):
    def make(content):
        path = tmp_path / "noise.toml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return make


def test_deviations_and_covariance(file):
    covariance = (np.eye(6) + 0.5 * np.ones((6, 6))).tolist()
    text = f'[robot]\nrotation = "0.02deg" # rad\ntranslation = 5e-5\n[camera]\ncovariance = {covariance}\n'
    noise = read_noise_file(file("\ufeff" + text.replace("\n", "\r\n")))
    assert isinstance(noise, PoseNoise)
    np.testing.assert_allclose(np.sqrt(np.diag(noise.robot)), [np.radians(0.02)] * 3 + [5e-5] * 3)
    np.testing.assert_array_equal(noise.camera, covariance)


def test_motions_and_exact_quantities(file):
    noise = read_noise_file(file(f"[B]\ncovariance = {[UNIT] * 3}\n"))
    assert isinstance(noise, PairNoise)
    assert noise.A is None
    np.testing.assert_array_equal(noise.B, [UNIT] * 3)


def test_joint_covariance_of_poses(file):
    noise = read_noise_file(file(f"camera.covariance = {np.eye(12).tolist()}\n"))
    assert noise.robot is None
    assert noise.camera.shape == (12, 12)


def with_entry(i, j, value):
    S = np.eye(6).tolist()
    S[i][j] = value
    return S


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        ("", ["no noise given", "[robot]"]),
        ("# nothing\n", ["no noise given"]),
        ("[gripper]\nrotation = 1\n", ["unknown table 'gripper'", "[camera]"]),
        ('"a\\nb" = 1\n', ["unknown table"]),
        ("robot = 3\n", ["[robot]", "table"]),
        ("[[robot]]\nrotation = 1\n", ["[robot]", "table"]),
        ("[robot]\nrotation=1\ntranslation=1\n[A]\nrotation=1\ntranslation=1\n", ["mixed", "[robot], [A]"]),
        ("[robot]\nrotation = \n", ["line 2"]),
        ("[robot]\nrotation = 1\nrotation = 2\n", ["line 3"]),
        ("[robot]\nrotation = " + "9" * 5000, ["TOML"]),
        ("[robot]\nrotation = " + "[" * 100_000, ["nested too deeply"]),
        ("[robot]\nrotation = 1\n", ["[robot]", "translation is missing"]),
        ("[robot]\ntranslation = 1\n", ["[robot]", "rotation is missing"]),
        ("[robot]\n", ["[robot]", "rotation is missing", "covariance"]),
        ("[robot]\nrotaton = 1\n", ["[robot]", "unknown key 'rotaton'", "rotation"]),
        (f"[robot]\nrotation = 1\ncovariance = {UNIT}\n", ["[robot]", "both"]),
        ('[robot]\nrotation = "0.02"\ntranslation = 0\n', ["[robot]", "rotation", "unit", "'0.02'"]),
        ('[robot]\nrotation = "1mm"\ntranslation = 0\n', ["[robot]", "rotation", "'mm'"]),
        ('[robot]\nrotation = 0\ntranslation = "1deg"\n', ["[robot]", "translation", "'deg'"]),
        ('[robot]\nrotation = 0\ntranslation = "a\\nb"\n', ["[robot]", "translation"]),
        ("[robot]\nrotation = -1\ntranslation = 1\n", ["[robot]", ">= 0", "-1"]),
        ("[robot]\nrotation = nan\ntranslation = 1\n", ["[robot]", "finite"]),
        ("[robot]\nrotation = true\ntranslation = 1\n", ["[robot]", "rotation", "True"]),
        ("[robot]\nrotation = 2020-01-01\ntranslation = 1\n", ["[robot]", "rotation"]),
        ("[robot]\nrotation = [1]\ntranslation = 1\n", ["[robot]", "rotation"]),
        (f"[robot]\nrotation = 1{'0' * 400}\ntranslation = 1\n", ["[robot]", "1e308"]),
        (f"[camera]\ncovariance = [[1{'0' * 400}]]\n", ["[camera]", "1e308"]),
        ("[camera]\ncovariance = 1\n", ["[camera]", "covariance", "(6, 6)"]),
        ("[camera]\ncovariance = [[1, 2], [3]]\n", ["[camera]", "covariance", "(6, 6)"]),
        ("[camera]\ncovariance = [[1, 0], [0, 1]]\n", ["[camera]", "covariance", "(2, 2)"]),
        (f"[A]\ncovariance = {np.eye(12).tolist()}\n", ["[A]", "covariance", "(12, 12)"]),
        ('[camera]\ncovariance = "1e-6"\n', ["[camera]", "covariance", "numbers", "'1e-6'"]),
        (f"[camera]\ncovariance = {with_entry(0, 0, '1')}\n", ["[camera]", "numbers", "'1'"]),
        ("[camera]\ncovariance = [[true]]\n", ["[camera]", "numbers", "True"]),
        (f"[camera]\ncovariance = {with_entry(0, 1, 0.5)}\n", ["[camera]", "symmetric"]),
        (f"[camera]\ncovariance = {with_entry(0, 0, -1.0)}\n", ["[camera]", "variances", "-1"]),
        (f"[camera]\ncovariance = {with_entry(0, 0, float('inf'))}\n", ["[camera]", "finite"]),
        (f"[camera]\ncovariance = {(3 * np.ones((6, 6)) - 2.5 * np.eye(6)).tolist()}\n", ["semidefinite"]),
        (f'[camera]\ncovariance = {UNIT}\nconvention = "gtsm"\n', ["[camera]", "'gtsm'", "Did you mean 'gtsam'"]),
        (f"[camera]\ncovariance = {UNIT}\nconvention = 3\n", ["[camera]", "name of a convention, got 3"]),
        (f"[camera]\ncovariance = {UNIT}\ninformation = 1\n", ["[camera]", "information to be true or false"]),
        (f'[camera]\ncovariance = {UNIT}\nof = "target"\n', ["[camera]", "pose, inverse"]),
        (f'[camera]\ncovariance = {UNIT}\npixel_sd = "1px"\n', ["[camera]", "number of pixels"]),
        (f"[camera]\ncovariance = {UNIT}\npixel_sd = true\n", ["[camera]", "number of pixels"]),
        (
            f'[camera]\ncovariance = {UNIT}\nconvention = "opencv"\npixel_sd = 0.2\n',
            ["[camera]", "factor of their own"],
        ),
        (
            '[camera]\nconvention = "gtsam"\nrotation = 1\ntranslation = 1\n',
            ["[camera]", "convention is for a covariance"],
        ),
        (f'[A]\ncovariance = {UNIT}\nconvention = "gtsam"\n', ["[A]", "convention is for a covariance"]),
        ('[camera]\ncovariance = [[1, 2], [3]]\nconvention = "ros"\n', ["[camera]", "rows of different lengths"]),
        (b"[robot]\n# \xff\n", ["line 2", "UTF-8"]),
        (b"[robot]\n\0\n", ["line 2"]),
    ],
)
def test_one_line_says_what_is_wrong(file, content, parts):
    with pytest.raises(InputError) as caught:
        read_noise_file(file(content))
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 500
    for part in ("noise.toml", *parts):
        assert part in text


def test_a_convention_needs_the_poses(file, rng):
    poses = uq.simulate(n_poses=4, seed=1)
    S = random_covariance(rng)
    L = np.linalg.inv(uq.to_convention(S, poses.camera, "g2o", of="inverse"))
    text = f"""[robot]
rotation = "0.02deg"
translation = "0.05mm"
[camera]
covariance = {L.tolist()}
convention = "g2o"
information = true
of = "inverse"
pixel_sd = 0.5
"""
    with pytest.raises(InputError, match=r"noise\.toml: the convention of a covariance depends on the poses"):
        read_noise_file(file(text))
    noise = read_noise_file(file(text), poses)
    np.testing.assert_allclose(noise.camera, np.tile(0.25 * S, (4, 1, 1)), rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(np.sqrt(np.diag(noise.robot)), [np.radians(0.02)] * 3 + [5e-5] * 3)
    assert noise.read_as["camera"].words == "g2o,information,inverse,pixel_sd=0.5"
    assert noise.rows(np.array([1, 2])).read_as == noise.read_as
    with pytest.raises(InputError, match=r"`camera` to cover 3 poses, got 4"):
        read_noise_file(file(text), poses.rows(np.arange(3)))


ASYMMETRIC, INDEFINITE = np.triu(np.ones((6, 6))), 3 * np.ones((6, 6)) - 2.5 * np.eye(6)


@pytest.mark.parametrize(
    ("S", "information", "message"),
    [
        (np.diag([1.0, 1, 1, 1, 1, 0]), "true", "singular"),
        (ASYMMETRIC, "true", "symmetric"),
        (ASYMMETRIC, "false", "symmetric"),
        (INDEFINITE, "true", "indefinite"),
        (INDEFINITE, "false", "semidefinite"),
    ],
)
def test_a_matrix_that_is_no_covariance(file, S, information, message):
    text = f'camera.covariance = {S.tolist()}\ncamera.convention = "gtsam"\ncamera.information = {information}\n'
    with pytest.raises(InputError, match=message):
        read_noise_file(file(text), uq.simulate(n_poses=4, seed=1))


def test_one_reading_in_place_of_that_of_the_file(file):
    text = f'[camera]\ncovariance = {UNIT}\nconvention = "gtsam"\n[robot]\nrotation = 1\ntranslation = 1\n'
    noise = read_stated_noise(file(text), CovarianceReading("ros"))
    assert noise.readings == {"camera": CovarianceReading("ros")}


def test_files_that_cannot_be_read(tmp_path, file, monkeypatch):
    with pytest.raises(InputError, match=r"nothing\.toml: there is no such file"):
        read_noise_file(tmp_path / "nothing.toml")
    with pytest.raises(InputError, match="folder"):
        read_noise_file(tmp_path)
    monkeypatch.setattr("uq_handeye.core.files.trees.MAX_DESCRIPTION_BYTES", 10)
    with pytest.raises(InputError, match=r"noise\.toml: expected at most"):
        read_noise_file(file("#" * 100))
