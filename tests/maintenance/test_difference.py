"""Differences of two results: their covariance is consistent, what both hold counts once."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fixtures.rigs import NOISE, PAIR_NOISE, motions_alone, quietly
from scipy import stats

import uq_handeye as uq
from studies.camera_covariance import ROBOT, poses_of, recorded
from uq_handeye.model.camera.corners import without_pictures

TRIALS = 25
SIGNS = np.repeat([1.0, -1.0], 6)  # of X and of W


def fitted(poses, **options):
    return quietly(poses, robust=False, **options)


def mean_of(k, squares):
    """Probability of a mean of d^2 of k numbers at least as far from k."""
    p = stats.chi2.cdf(np.sum(squares), k * len(squares))
    return 2 * min(p, 1 - p)


def halves(n, seed, setup="eye-in-hand", **options):
    """Two results of the first and the last poses of one rig."""
    poses = uq.simulate(n, noise=NOISE, setup=setup, seed=seed)
    return [fitted(poses.rows(rows), noise=NOISE, **options) for rows in (np.arange(n // 2), np.arange(n // 2, n))]


@pytest.mark.statistical
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_the_covariance_is_that_of_the_differences(setup):
    """Mean of d^2 over simulated pairs, of X and of X and W together; not with W of the wrong sign against X."""
    squares, together, reversed_W = [], [], []
    signs = np.outer(SIGNS, SIGNS)
    for seed in range(TRIALS):
        found = uq.difference(*halves(30, seed, setup))
        squares.append(found.d2)
        together.append(stats.chi2.isf(found.p_value, 12))
        reversed_W.append(found.xi @ np.linalg.solve(signs * found.covariance, found.xi))
    assert min(mean_of(6, squares), mean_of(12, together)) > 1e-3
    assert mean_of(12, reversed_W) < 1e-4


def test_results_with_poses_in_common_are_refused():
    """Poses in common are found by their numbers, or by hashes where the files hold no poses; `update` is named."""
    poses = replace(uq.simulate(30, noise=NOISE, seed=1), truth=None)
    old, new = (fitted(poses.rows(np.arange(n)), noise=NOISE) for n in (18, 30))
    with pytest.raises(uq.InputError, match=r"have 18 poses in common.*uq-handeye update"):
        uq.difference(old, new)
    bare = [replace(of, data=None, provenance=replace(of.provenance, request=None)) for of in (old, new)]
    together = [{"sha256": old.provenance.data_sha256, "poses": 18}, {"sha256": "other", "poses": 12}]
    bare[1] = replace(bare[1], provenance=replace(bare[1].provenance, options={"together": together}))
    with pytest.raises(uq.InputError, match="have data in common"):
        uq.difference(*bare)
    again = uq.Calibration.from_dict(json.loads(old.to_json()))
    with pytest.raises(uq.InputError, match="have 18 poses in common"):
        uq.difference(old, again)


def test_an_error_of_one_camera_cancels():
    """A focal length that is wrong is one error for both; of two cameras it is two."""
    error = uq.SharedError.focal_length(0.02)
    first, second = (replace(uq.simulate(12, noise=NOISE, seed=s), truth=None) for s in (3, 4))
    old, new = (fitted(of, noise=NOISE, shared=[error]) for of in (first, second))
    apart, one = (uq.difference(old, new, same=same) for same in ((), ("camera",)))
    assert np.linalg.eigvalsh(apart.covariance - one.covariance).max() > 0
    assert one.same == ("camera",) and "The same in both: camera" in " ".join(one.summary().split())
    sums = old.posterior.covariance + new.posterior.covariance
    np.testing.assert_allclose(apart.covariance, sums[:12, :12], atol=0.03 * np.abs(sums).max())


@pytest.mark.slow
def test_the_accuracy_of_one_robot_is_one_error():
    """Said to be one robot, its field is one over all poses; of two robots it is two."""
    accuracy = uq.SharedError.robot_accuracy("2mm")
    old, new = halves(24, 5, shared=[accuracy])
    apart, one = (uq.difference(old, new, same=same) for same in ((), ("robot",)))
    assert np.linalg.slogdet(one.covariance)[1] < np.linalg.slogdet(apart.covariance)[1]
    assert (one.same, apart.same) == (("robot",), ())


def test_words():
    old, new = halves(24, 6)
    text = uq.difference(old, new).summary()
    assert "Assumed: independent errors, also of robot" in " ".join(text.split()) and len(text.splitlines()) <= 12
    moved = replace(new, X=new.X @ np.block([[np.eye(3), np.array([[0.0], [0.0], [0.01]])], [np.zeros(3), 1]]))
    assert "differ clearly" in uq.difference(old, moved).summary()
    assert uq.difference(old, moved).to_dict()["p_value_X"] < 1e-6


def test_other_methods_are_taken_as_independent():
    poses = uq.simulate(20, noise=NOISE, seed=7)
    old, new = (quietly(poses.rows(rows), noise=NOISE, method=method)
                for rows, method in ((np.arange(10), "park"), (np.arange(10, 20), "efficient")))  # fmt: skip
    found = uq.difference(old, new)
    assert found.how == "independent" and found.p_value_X > 1e-3
    np.testing.assert_allclose(found.covariance[:6, :6], old.covariance + new.covariance)
    assert "(methods park and efficient)" in " ".join(found.summary().split())


def test_what_has_no_difference_is_refused():
    poses = uq.simulate(12, noise=NOISE, seed=8)
    result = fitted(poses, noise=NOISE)
    other = fitted(uq.simulate(12, noise=NOISE, setup="eye-to-hand", seed=8), noise=NOISE)
    for old, new, words in (
        (result, other, "X of two frames has no difference"),
        (result, quietly(motions_alone()[1], noise=PAIR_NOISE), "its frames are not known"),
        (replace(result, covariance=None), result, "The old result has no covariance"),
        (result, poses, "Expected `new` to be a Calibration"),
    ):
        with pytest.raises(uq.InputError, match=words):
            uq.difference(old, new)
    with pytest.raises(uq.InputError, match="names out of robot, camera, target, got 'lens'"):
        uq.difference(result, result, same=("lens",))


def test_names_that_contradict_the_results_are_refused():
    """Pictures with other intrinsics are of another camera."""
    corners, robot, _ = recorded(np.random.default_rng(11), 16)
    parts = [np.arange(16) < 8, np.arange(16) >= 8]
    first, second = (without_pictures(corners, ~kept) for kept in parts)
    results = [fitted(poses_of(replace(of, row=of.picture), robot[kept]), noise=uq.PoseNoise(robot=ROBOT))
               for of, kept in zip((first, second), parts, strict=True)]  # fmt: skip
    with pytest.raises(uq.InputError, match=r"other intrinsics\. Leave the camera out"):
        uq.difference(*results, same=("camera",))


def test_a_file_without_a_posterior_is_taken_as_independent_and_predicts_nothing():
    poses = uq.simulate(20, noise=NOISE, seed=7)
    old, new = (fitted(poses.rows(rows), noise=NOISE) for rows in (np.arange(10), np.arange(10, 20)))
    bare = replace(old, joint_posterior=None)
    found = uq.difference(bare, new)
    assert found.how == "independent" and found.p_value_X > 1e-3
    assert uq.difference(old, new).how == "posterior"
    with pytest.raises(uq.InputError, match="joint covariance of X and W"):
        bare.predict_camera(robot=poses.robot)
    with pytest.raises(uq.InputError, match="joint covariance of X and W"):
        uq.verify(bare, np.full((4, 3), 0.3), np.full((4, 3), 0.5), robot=poses.robot[:4], touch_sd="0.2mm")


@pytest.mark.slow
def test_independent_results_without_poses_differ_as_with_them():
    poses = replace(uq.simulate(24, noise=NOISE, seed=9), truth=None)
    pair = [quietly(poses.rows(rows)) for rows in (np.arange(12), np.arange(12, 24))]
    bare = [replace(of, data=None, provenance=replace(of.provenance, request=None)) for of in pair]
    whole, without = (uq.difference(*of, same=("robot", "camera", "target")) for of in (pair, bare))
    np.testing.assert_allclose(without.covariance, whole.covariance, rtol=1e-6, atol=1e-16)
    assert whole.how == without.how == "posterior"
