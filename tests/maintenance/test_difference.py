"""Differences of two results: their covariance is consistent, what both hold counts once."""

import json
from dataclasses import replace

import numpy as np
import pytest
from calibration_cases import NOISE, PAIR_NOISE, motions_alone, quietly
from scipy import stats

import uq_handeye as uq
from studies.camera_covariance import ROBOT, poses_of, recorded
from uq_handeye.model.camera.corners import without_pictures

SETS = {
    "independent": (np.arange(14), np.arange(14, 30)),
    "overlapping": (np.arange(18), np.arange(8, 30)),
    "subset": (np.arange(16), np.arange(30)),
}
TRIALS = 25
SIGNS = np.repeat([1.0, -1.0], 6)  # of X and of W


def fitted(poses, **options):
    return quietly(poses, robust=False, **options)


def mean_of(k, squares):
    """Probability of a mean of d^2 of k numbers at least as far from k."""
    p = stats.chi2.cdf(np.sum(squares), k * len(squares))
    return 2 * min(p, 1 - p)


@pytest.mark.statistical
@pytest.mark.parametrize(
    ("case", "setup"), [("independent", "eye-in-hand"), ("overlapping", "eye-to-hand"), ("subset", "eye-in-hand")]
)
def test_the_covariance_is_that_of_the_differences(case, setup):
    """Mean of d^2 over simulated pairs, of X and of X and W together.

    The sum of both covariances counts the common poses twice and is far too large. So is the d^2 of both
    together where W has the wrong sign against X.
    """
    squares, twice, together, reversed_W = [], [], [], []
    signs = np.outer(SIGNS, SIGNS)
    for seed in range(TRIALS):
        poses = uq.simulate(30, noise=NOISE, setup=setup, seed=seed)
        old, new = (fitted(poses.rows(rows), noise=NOISE) for rows in SETS[case])
        found = uq.difference(old, new)
        squares.append(found.d2)
        together.append(stats.chi2.isf(found.p_value, 12))
        reversed_W.append(found.xi @ np.linalg.solve(signs * found.covariance, found.xi))
        twice.append(found.xi[:6] @ np.linalg.solve(old.covariance + new.covariance, found.xi[:6]))
    assert min(mean_of(6, squares), mean_of(12, together)) > 1e-3
    assert case == "independent" or mean_of(6, twice) < 1e-4
    assert mean_of(12, reversed_W) < 1e-4
    assert found.common == len(np.intersect1d(*SETS[case]))


@pytest.mark.parametrize("options", [{}, {"shared": [uq.SharedError.focal_length(0.01)]}], ids=["plain", "shared"])
def test_of_a_part_it_is_the_innovation(options):
    poses = replace(uq.simulate(30, noise=NOISE, seed=1), truth=None)
    part = poses.rows(np.arange(18))
    old, new = (fitted(of, noise=NOISE, **options) for of in (part, poses))
    innovation = (old.posterior.covariance - new.posterior.covariance)[:12, :12]
    found = uq.difference(old, new)
    np.testing.assert_allclose(found.covariance, innovation, atol=0.03 * np.abs(innovation).max())
    bare = [replace(of, data=None, provenance=replace(of.provenance, request=None)) for of in (old, new)]
    together = [{"sha256": old.provenance.data_sha256, "poses": 18}, {"sha256": "other", "poses": 12}]
    bare[1] = replace(bare[1], provenance=replace(bare[1].provenance, options={"together": together}))
    by_hash = uq.difference(*bare)
    assert by_hash.how == "innovation" and "counts once" in by_hash.summary()
    np.testing.assert_allclose(by_hash.covariance, innovation, atol=1e-6 * np.abs(innovation).max())


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


def test_the_accuracy_of_one_robot_counts_once():
    """Poses in common: one field over all of them, of which the most is in both."""
    poses = replace(uq.simulate(24, noise=NOISE, seed=5), truth=None)
    accuracy = uq.SharedError.robot_accuracy("2mm")
    old, new = (fitted(of, noise=NOISE, shared=[accuracy]) for of in (poses.rows(np.arange(20)), poses))
    found = uq.difference(old, new)
    plain = uq.difference(*(fitted(of, noise=NOISE) for of in (poses.rows(np.arange(20)), poses)))
    assert (found.std[:6] > plain.std[:6]).all()  # the field at the four new poses
    assert (found.std[:6] < 0.5 * old.std).all()


def test_pictures_of_both_count_once():
    corners, robot, _ = recorded(np.random.default_rng(11), 12)
    kept = without_pictures(corners, np.arange(12) >= 8)
    old = fitted(poses_of(replace(kept, row=kept.picture), robot[:8]), noise=uq.PoseNoise(robot=ROBOT))
    new = fitted(poses_of(corners, robot), noise=uq.PoseNoise(robot=ROBOT))
    found = uq.difference(old, new)
    innovation = (old.posterior.covariance - new.posterior.covariance)[:12, :12]
    assert found.how == "posterior" and found.common == 8
    values = np.linalg.eigvalsh(np.linalg.solve(found.scale, found.covariance - innovation))
    assert np.abs(values).max() < 0.1  # pixel noise is estimated from the pictures of each


def test_equal_results_and_words():
    poses = uq.simulate(20, noise=NOISE, seed=6)
    old, new = (fitted(poses.rows(rows), noise=NOISE) for rows in (np.arange(12), np.arange(20)))
    same = uq.difference(old, uq.Calibration.from_dict(json.loads(old.to_json())))
    assert same.how == "equal" and not same.covariance.any() and same.p_value == 1.0
    assert "there is nothing to test" in " ".join(same.summary().split())
    text = uq.difference(old, new).summary()
    assert "12 poses are in both and count once" in " ".join(text.split()) and len(text.splitlines()) <= 12
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
    """Poses in common are of one camera; an arm of other kinematics is another robot."""
    poses = uq.simulate(20, noise=NOISE, seed=7)
    old, new = (fitted(poses.rows(np.arange(n)), noise=NOISE) for n in (14, 20))
    with pytest.raises(uq.InputError, match="14 poses in common, which are of one robot, one camera"):
        uq.difference(old, new, same=("robot",))
    assert uq.difference(old, new, same=("robot", "camera", "target")).common == 14
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


def test_independent_results_without_poses_differ_as_with_them():
    poses = replace(uq.simulate(24, noise=NOISE, seed=9), truth=None)
    pair = [quietly(poses.rows(rows)) for rows in (np.arange(12), np.arange(12, 24))]
    bare = [replace(of, data=None, provenance=replace(of.provenance, request=None)) for of in pair]
    whole, without = (uq.difference(*of, same=("robot", "camera", "target")) for of in (pair, bare))
    np.testing.assert_allclose(without.covariance, whole.covariance, rtol=1e-6, atol=1e-16)
    assert whole.how == without.how == "posterior"


@pytest.mark.statistical
@pytest.mark.parametrize(("setup", "n"), [("eye-in-hand", 15), ("eye-to-hand", 20)])
def test_the_difference_of_a_part_with_estimated_noise_is_covered(setup, n):
    """Sizes found again with more poses move X, too: without their part some directions were said to be exact."""
    scores, p = [], []
    for seed in range(10):
        poses = uq.simulate(30, noise=NOISE, seed=seed, setup=setup)
        poses = uq.PosePairs(poses.robot, poses.camera, setup)
        found = uq.difference(quietly(poses.rows(np.arange(n))), quietly(poses))
        assert found.how == "posterior" and found.common == n
        scores.append(found.xi / found.std)
        p.append(found.p_value)
    rms = np.sqrt(np.mean(np.square(scores)))
    assert 0.4 < rms < 1.4 and np.abs(scores).max() < 5.0
    assert stats.binom.sf(np.sum(np.less(p, 0.05)) - 1, len(p), 0.05) > 1e-3
