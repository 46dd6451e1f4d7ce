"""Priors of X and W: what they add to the normal equations, what they refuse, and what people write."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import difference, moved, random_covariance, random_transforms

import uq_handeye as uq
from uq_handeye.model.errors.models import noise_from_dict, noise_to_dict

KNOWN_Z = np.diag([np.inf] * 5 + [1e-6])


def test_normal_equations_are_those_of_the_square_by_differences(rng):
    """``xi^T Lambda xi`` of a pose that is moved: gradient and curvature by finite differences."""
    X, W = random_transforms(rng), random_transforms(rng)
    S_X, S_W = random_covariance(rng, sd=1e-1), random_covariance(rng, sd=1e-1)
    prior = uq.PosePrior.of((moved(X, 1e-2 * rng.normal(size=6)), S_X), (moved(W, 1e-2 * rng.normal(size=6)), S_W))

    def square(step):
        at = moved(X, step[:6]), moved(W, step[6:])
        parts = ((at[0], prior.X, S_X), (at[1], prior.W, S_W))
        return sum(difference(T, mean) @ np.linalg.solve(S, difference(T, mean)) for T, mean, S in parts)

    information, gradient, value = prior.normal_equations(X, W)
    assert_allclose(value, square(np.zeros(12)), rtol=1e-10)
    h = 1e-5
    by_differences = [(square(h * e) - square(-h * e)) / (4 * h) for e in np.eye(12)]
    assert_allclose(gradient, by_differences, rtol=1e-5, atol=1e-6 * np.abs(gradient).max())
    for k in (0, 4, 7, 11):
        e = np.eye(12)[k]
        bent = (square(1e-3 * e) - 2 * square(0 * e) + square(-1e-3 * e)) / 2e-6
        assert_allclose(information[k, k], bent, rtol=1e-2)  # but for the curvature of the logarithm


def test_draws_have_the_covariance_of_what_is_known(rng):
    X = random_transforms(rng)
    S = random_covariance(rng)
    S[2], S[:, 2] = 0.0, 0.0
    S[2, 2] = np.inf
    drawn = uq.PosePrior.of((X, S)).drawn(X, None, (20_000,), rng)
    errors = difference(drawn.X, np.broadcast_to(X, drawn.X.shape))
    kept = [0, 1, 3, 4, 5]
    assert_allclose(np.cov(errors[:, kept].T), S[np.ix_(kept, kept)], rtol=0.1, atol=0.05 * np.diag(S)[kept].max())
    assert (np.abs(errors[:, 2]) < 1e-12).all()


def test_it_survives_rows_weights_and_the_file(rng):
    prior = uq.PosePrior.of(W=(random_transforms(rng), KNOWN_Z))
    noise = uq.PoseNoise(np.tile(np.eye(6), (5, 1, 1)), np.eye(6), prior=prior)
    for other in (noise.rows(np.arange(3)), noise.weighted(np.ones(5)), noise.dense()):
        assert other.prior is prior
    again = noise_from_dict(noise_to_dict(noise)).prior
    assert_allclose(again.W, prior.W)
    assert_allclose(again.information_W, prior.information_W)
    assert again.X is None and again.rank == 1


@pytest.mark.parametrize(
    ("covariance", "words"),
    [
        (np.diag([1.0, 1, 1, 1, 1, 0]), "variances"),
        (np.ones((6, 6)), "singular"),
        (np.eye(6) + 1.2 * (np.eye(6)[[1, 0, 2, 3, 4, 5]] - np.diag([0, 0, 1, 1, 1, 1])), "indefinite"),
        (np.eye(3), "shape"),
        (np.diag([np.inf] * 6), "finite variances"),
    ],
)
def test_covariances_that_are_none_are_refused(covariance, words):
    with pytest.raises(uq.InputError, match=words):
        uq.PosePrior.of((np.eye(4), covariance))


def test_known_values_are_arguments_of_calibrate():
    found = uq.parse_known_values("target z = 120mm +- 1mm", "camera x=3.5 cm ± 0.5mm", "camera y = -1mm +/- 1e-1 mm")
    pose, covariance = found["prior_X"]
    assert_allclose(pose[:3, 3], [0.035, -0.001, 0])
    assert_allclose(np.diag(covariance), [np.inf] * 3 + [0.25e-6, 1e-8, np.inf])
    assert found["prior_W"][0][2, 3] == 0.12


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("target z = 120 +- 1mm", "unit"),
        ("target z = 120mm", "NAME AXIS = VALUE"),
        ("board z = 120mm +- 1mm", "'camera' or 'target'"),
        ("target w = 120mm +- 1mm", "x, y or z"),
        ("camera yaw = 90deg +- 1deg", "angles"),
        ("target z = 120mm +- 0mm", "above 0"),
        ("target z = 120kg +- 1mm", "Unknown unit"),
    ],
)
def test_known_values_that_are_none_are_refused_in_one_line(text, words):
    with pytest.raises(uq.InputError, match=words) as caught:
        uq.parse_known_values(text)
    assert "\n" not in str(caught.value)


def test_a_component_is_known_once():
    with pytest.raises(uq.InputError, match="once"):
        uq.parse_known_values("target z = 1m +- 1mm", "target z = 2m +- 1mm")


def test_prior_files(tmp_path, rng):
    X = random_transforms(rng)
    file = tmp_path / "x.yaml"
    file.write_text(f"pose: {X.tolist()}\nstd: [null, null, null, 0.001, 0.002, null]\n")
    pose, covariance = uq.read_prior(file)
    assert_allclose(pose, X)
    assert_allclose(np.diag(covariance), [np.inf] * 3 + [1e-6, 4e-6, np.inf])
    for text, words in (
        ("pose: [1, 2]\nstd: [1, 1, 1, 1, 1, 1]\n", "x.yaml"),
        ("std: [1]\n", "translation"),
        ("[]", "earlier"),
    ):
        file.write_text(text)
        with pytest.raises(uq.InputError, match=words):
            uq.read_prior(file)


# ------------------------------------------------------------------------- priors in the conventions of other programs


def test_a_prior_file_in_the_convention_of_a_library(tmp_path, rng):
    T, S, file = random_transforms(rng), random_covariance(rng), tmp_path / "prior.json"
    numbers = uq.to_convention(S, T, "g2o", information=True, of="inverse")
    tree = {"pose": T.tolist(), "covariance": numbers.tolist(), "convention": "g2o", "information": True}
    file.write_text(json.dumps(tree | {"of": "inverse"}))
    pose, covariance = uq.read_prior(file)
    np.testing.assert_allclose(pose, T)
    np.testing.assert_allclose(covariance, S, rtol=1e-5, atol=1e-12)


@pytest.mark.slow
def test_the_ros_file_of_a_result_is_a_prior(tmp_path):
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    result = uq.calibrate(uq.simulate(12, noise=noise, seed=1), noise=noise)
    pose, covariance = uq.read_prior(result.export(tmp_path / "x.yaml"))
    np.testing.assert_allclose(pose, result.X, atol=1e-12)
    np.testing.assert_allclose(covariance, result.covariance, rtol=1e-9)
    message = (tmp_path / "x.yaml").read_text().partition("pose_with_covariance_stamped:\n")[2]
    (tmp_path / "echoed.yaml").write_text("\n".join(line.removeprefix("  ") for line in message.splitlines()))
    np.testing.assert_allclose(uq.read_prior(tmp_path / "echoed.yaml")[1], result.covariance, rtol=1e-9)


UNIT = np.eye(6).tolist()
POSE = np.eye(4).tolist()


@pytest.mark.parametrize(
    ("tree", "message"),
    [
        ({"pose": POSE, "covariance": UNIT, "conventions": "ros"}, "unknown key 'conventions'"),
        ({"pose": POSE, "covariance": UNIT, "convention": "rs"}, "Unknown convention 'rs'"),
        ({"pose": POSE, "std": [1.0] * 6, "convention": "ros"}, "convention is for a covariance"),
        ({"pose": POSE, "covariance": UNIT, "of": "target"}, "'target' in place of pose or inverse"),
        ({"pose": POSE, "covariance": UNIT, "information": "yes"}, "'yes' in place of false or true"),
        ({"pose": POSE, "covariance": UNIT, "convention": "opencv", "pixel_sd": 0.2}, "factor of their own"),
        ({"pose": POSE, "covariance": np.diag([1.0, 1, 1, 1, 1, 0]).tolist(), "information": True}, "singular"),
        ({"pose": POSE, "covariance": [[None] * 6] * 6, "convention": "ros"}, "got null"),
        ({"pose": {"pose": {"position": {"x": 0}}}}, "PoseWithCovariance"),
        ({"pose": {"position": dict.fromkeys("xyz", 0), "orientation": {**dict.fromkeys("xyz", 0), "w": 1}}}, "36"),
    ],
)
def test_priors_that_are_refused(tmp_path, tree, message):
    (tmp_path / "prior.json").write_text(json.dumps(tree))
    with pytest.raises(uq.InputError, match=message):
        uq.read_prior(tmp_path / "prior.json")
