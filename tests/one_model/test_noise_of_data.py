"""Noise from the data: intervals and the distribution of X over simulated sets, data sheets, bad input."""

import json
import warnings

import numpy as np
import pytest
import support
from fixtures.rigs import quietly
from scipy import stats

import uq_handeye as uq
from uq_handeye.fit.graph.gauss_helmert import bound, efficient
from uq_handeye.fit.graph.goodness_of_fit import effective_dof, goodness_of_fit
from uq_handeye.fit.graph.noise_of_data import estimate_noise
from uq_handeye.model.errors.noise_estimate import NoiseEstimate
from uq_handeye.model.errors.sizes import NoisePrior

SIDES = ("robot", "camera")
WEAK_ROBOT = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
EQUAL = uq.PoseNoise.isotropic(robot=("0.05deg", "0.3mm"), camera=("0.05deg", "0.3mm"))
STRONG_ROBOT = uq.PoseNoise.isotropic(robot=("0.1deg", "0.5mm"), camera=("0.02deg", "0.05mm"))
TOGETHER = [f"{what}, robot and camera together" for what in ("rotation", "translation")]


def truth_of(noise):
    return np.array([noise.robot[0, 0], noise.camera[0, 0], noise.robot[3, 3] + noise.camera[3, 3]])


def data_of(kind, n=10):
    if kind == "motions":
        _, A, B = support.noisy_motions(np.random.default_rng(support.SEED), n, sd=1e-3)
        return uq.Motions(A, B)
    return uq.simulate(n, noise=WEAK_ROBOT, setup=kind, seed=support.SEED)


def test_weights_count_poses():
    poses = data_of("eye-in-hand", 12)
    kept = uq.PosePairs(poses.robot[:9], poses.camera[:9])
    start = poses.truth.X
    weights = np.r_[np.ones(9), np.zeros(3)]
    with_weights, without = (
        estimate_noise(poses, start=start, weights=weights),
        estimate_noise(kept, start=start),
    )
    np.testing.assert_allclose(with_weights.variances, without.variances, rtol=0.1)  # the width of the target is of all
    assert with_weights.dof == without.dof == 42


def within(hits, total, level=0.95, lower_only=False):
    tail = (1 - support.CONFIDENCE) / 2
    low, high = stats.binom.ppf([tail, 1 - tail], total, level)
    return low <= hits and (lower_only or hits <= high)


@pytest.mark.statistical
@pytest.mark.parametrize(("noise", "setup", "n"), [(EQUAL, "eye-in-hand", 30), (WEAK_ROBOT, "eye-to-hand", 15)])
def test_intervals_cover(noise, setup, n):
    """Check both sides together, which all data tell; those of an estimate that is twice as certain are found out."""
    sets, truth = 60, truth_of(noise)
    poses = uq.simulate(n, noise=noise, setup=setup, trials=sets, seed=support.SEED)
    found = [estimate_noise(uq.PosePairs(G, C, setup)) for G, C in zip(poses.robot, poses.camera, strict=True)]
    for name, true in zip(TOGETHER, np.sqrt([truth[0] + truth[1], truth[2]]), strict=True):
        parts = [one[name] for one in found]
        # a share of the views' noise is counted on average over the poses: intervals may cover more
        hits = sum(part.low <= true <= part.high for part in parts)
        assert within(hits, sets, lower_only=True), (name, hits)
        logs = np.array([np.log([part.size, part.high / part.low]) for part in parts])
        half = 0.25 * logs[:, 1]
        narrow = int((np.abs(logs[:, 0] - np.log(true)) < 0.5 * half).sum())
        assert not within(narrow, sets, lower_only=True), (name, narrow)


@pytest.mark.statistical
@pytest.mark.parametrize(("noise", "n", "sets"), [(EQUAL, 30, 80), (WEAK_ROBOT, 8, 80)])
def test_nees_with_estimated_noise(noise, n, sets):
    """X inside its 95 % region as often as said, and d^2 / 6 as its reference distribution has it on average."""
    inside, ratio = 0, []
    for seed in range(sets):
        poses = uq.simulate(n, noise=noise, seed=[support.SEED, n, seed])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)
            result = uq.calibrate(uq.PosePairs(poses.robot, poses.camera), shared=[], robust=False)
        d2 = support.nees(support.difference(result.X, poses.truth.X)[None], result.covariance)[0]
        inside += d2 < result.quantile(0.95)
        ratio.append(d2 / 6)
    assert within(inside, sets), inside / sets
    error = np.std(ratio) / np.sqrt(sets)
    nu = result.reference.dof
    expected = 1.0 if nu is None or not np.isfinite(nu) else nu / (nu - 2)
    assert 1 - 3.3 * error < np.mean(ratio) < expected + 3.3 * error, (np.mean(ratio), expected, error)


def test_statement_and_round_trip():
    estimate = estimate_noise(uq.simulate(30, noise=WEAK_ROBOT, seed=2))
    assert [component.name for component in estimate.components][:3] == [TOGETHER[0], "robot rotation",
                                                                         "camera rotation"]  # fmt: skip
    for k, side in enumerate((WEAK_ROBOT.robot, WEAK_ROBOT.camera)):
        part = estimate[f"{SIDES[k]} translation"]
        assert part.low < np.sqrt(side[3, 3]) < part.high
    assert estimate[TOGETHER[1]].low < np.sqrt(truth_of(WEAK_ROBOT)[2]) < estimate[TOGETHER[1]].high
    again = NoiseEstimate.from_dict(json.loads(json.dumps(estimate.to_dict())))
    assert again.to_dict() == estimate.to_dict()
    np.testing.assert_allclose(again.noise.robot, estimate.noise.robot)
    with pytest.raises(uq.InputError, match="components"):
        NoiseEstimate.from_dict({})


def test_the_split_has_no_effect_on_X():
    poses = uq.simulate(30, noise=WEAK_ROBOT, seed=3)
    noise = estimate_noise(poses).noise
    robot, camera = (np.broadcast_to(S, (30, 6, 6)).copy() for S in (noise.robot, noise.camera))
    isotropic = 0.5 * np.diag(camera[:, 3:, 3:].min(axis=0)).min() * np.eye(3)  # of one side as of the other
    robot[:, 3:, 3:] += isotropic
    camera[:, 3:, 3:] -= isotropic
    a, b = efficient(poses, noise), efficient(poses, uq.PoseNoise(robot, camera))
    moved = support.difference(a.X, b.X) / np.sqrt(np.diag(a.covariance_X))
    assert np.abs(moved).max() < 2e-3
    support.assert_same_covariance(a.covariance_X, b.covariance_X, 2e-3)


def test_priors():
    poses = uq.simulate(30, noise=WEAK_ROBOT, seed=2)
    free = estimate_noise(poses)
    fixed = estimate_noise(poses, NoisePrior(robot=("0.02deg", "0.05mm"), factor=1))
    assert fixed["robot rotation"].status == fixed["robot translation"].status == "fixed"
    assert fixed["camera translation"].status == "estimated"
    np.testing.assert_allclose(np.sqrt(fixed.noise.robot[3, 3]), 5e-5)
    loose = estimate_noise(poses, NoisePrior(robot=(None, "0.05mm")))
    for name in TOGETHER:  # a prior of the split leaves the sum
        assert loose[name].size == pytest.approx(free[name].size, rel=0.05)
    part = loose["robot translation"]
    assert part.status == "prior" and part.low < 5e-5 < part.high and 2 < part.high / part.size < 5
    everything = estimate_noise(poses, NoisePrior(("0.02deg", "0.05mm"), ("0.1deg", "0.5mm"), factor=1))
    assert everything.keys == () and {part.status for part in everything.components} == {"fixed"}
    np.testing.assert_allclose(everything[TOGETHER[1]].size ** 2, truth_of(WEAK_ROBOT)[2])
    assert np.isinf(effective_dof(efficient(poses, everything.noise), everything))
    both = estimate_noise(poses, NoisePrior(("0.02deg", "0.05mm"), ("0.1deg", "0.5mm")))
    assert {c.status for c in both.components} == {"prior"}


def test_what_the_data_sheet_decides_is_not_told_by_the_data():
    poses = uq.simulate(30, noise=WEAK_ROBOT, seed=2)
    everything = ("0.02deg", "0.05mm"), ("0.1deg", "0.5mm")
    for prior in (NoisePrior(*everything, factor=1), NoisePrior(*everything, factor=1.01)):
        said = " ".join(estimate_noise(poses, prior).statement)
        assert said.startswith("From the data sheet: rotation, robot and camera together 0.1 deg")
        assert (
            "Estimated from the data" not in said and "Translation of robot and camera follows the data sheet" in said
        )
    loose = " ".join(estimate_noise(poses, NoisePrior(*everything)).statement)
    assert "From the data sheet" not in loose and "Estimated from the data: rotation" in loose
    # A fixed part that makes up all of a sum; it is no lower than that part.
    large = estimate_noise(poses, NoisePrior(robot=(None, "0.8mm"), factor=1))
    assert large["robot translation"].status == "fixed" and large[TOGETHER[1]].low >= 8e-4
    assert any(text.startswith("Estimated from the data: rotation") for text in large.statement)
    # A side that is exact leaves all of the rotation to the other one.
    exact = estimate_noise(poses, NoisePrior(robot=("0deg", "0mm"), factor=1))
    assert exact["camera rotation"].status == "estimated"


@pytest.mark.parametrize(
    "arguments", [{"factor": 0.5}, {"robot": ("0deg", "1mm")}, {"camera": (None, "-1mm")}, {"robot": "1mm"}]
)
def test_bad_priors(arguments):
    with pytest.raises(uq.InputError):
        NoisePrior(**arguments)


@pytest.mark.parametrize("noise", [None, uq.PoseNoise.isotropic(camera=(0.0, "1mm"))])
def test_exact_data_have_no_noise(noise):
    estimate = estimate_noise(uq.simulate(20, noise=noise))
    assert estimate.noise is None
    assert "rounding" in estimate.statement[0]
    assert NoiseEstimate.from_dict(estimate.to_dict()).noise is None


def test_three_poses_say_little():
    estimate = estimate_noise(uq.simulate(3, noise=WEAK_ROBOT, seed=1))
    assert estimate.dof == 6
    whole = estimate[TOGETHER[0]]
    assert whole.status == "estimated" and whole.high > 2 * whole.low
    assert np.isfinite(estimate.variances).all() and np.isfinite(estimate.covariance).all()
    json.dumps(estimate.to_dict(), allow_nan=False)


def test_motions_without_poses():
    _, A, B = support.exact_motions(np.random.default_rng(support.SEED), 200)
    rng = np.random.default_rng(support.SEED)
    sd = np.repeat([1e-3, 5e-4], 3)
    A, B = (support.moved(T, sd * rng.normal(size=(200, 6))) for T in (A, B))
    estimate = estimate_noise(uq.Motions(A, B))
    assert isinstance(estimate.noise, uq.PairNoise)
    np.testing.assert_allclose(estimate["rotation, A and B together"].size, 1e-3 * np.sqrt(2), rtol=0.15)
    np.testing.assert_allclose(estimate["translation, A and B together"].size, 5e-4 * np.sqrt(2), rtol=0.15)
    assert estimate.dof == 1194


@pytest.mark.statistical
def test_goodness_of_fit():
    poses = uq.simulate(30, noise=WEAK_ROBOT, trials=200, seed=support.SEED)
    fits = [efficient(uq.PosePairs(G, C), WEAK_ROBOT) for G, C in zip(poses.robot, poses.camera, strict=True)]
    found = [goodness_of_fit(fit) for fit in fits]
    chi2 = np.array([one.chi2 for one in found])
    assert found[0].dof == 168
    low, high = support.mean_interval(200, 168)
    assert low < chi2.mean() < high
    assert stats.kstest([one.p_value for one in found], "uniform").pvalue > 1e-3
    for part in ("rotation_sigma0", "translation_sigma0", "sigma0"):
        assert abs(np.mean([getattr(one, part) ** 2 for one in found]) - 1) < 0.05
    twice = uq.PoseNoise(4 * WEAK_ROBOT.robot, 4 * WEAK_ROBOT.camera)
    doubtful = goodness_of_fit(efficient(uq.PosePairs(poses.robot[0], poses.camera[0]), twice))
    assert doubtful.p_value < 1e-6 and abs(doubtful.sigma0 - 0.5) < 0.1


def test_estimated_noise_gives_the_bound():
    poses = uq.simulate(60, noise=EQUAL, seed=support.SEED)
    estimate = estimate_noise(poses)
    fit = efficient(poses, estimate.noise)
    assert 60 < effective_dof(fit, estimate) < 348
    eigenvalues = support.whitened_eigenvalues(fit.covariance_X, bound(poses, EQUAL))
    assert eigenvalues.min() > 0.6 and eigenvalues.max() < 1.6


def test_bad_input():
    poses = uq.simulate(10, noise=WEAK_ROBOT)
    for weights in (np.ones(9), np.full(10, 2.0), np.full(10, np.nan)):
        with pytest.raises(uq.InputError, match="weights"):
            estimate_noise(poses, weights=weights)
    with pytest.raises(uq.InputError, match="degrees of freedom"):
        estimate_noise(poses, weights=np.r_[np.ones(2), np.zeros(8)])
    with pytest.raises(uq.InputError, match="leading axes"):
        estimate_noise(uq.simulate(10, noise=WEAK_ROBOT, trials=2))


# -------------------------------------------------------------------------------------------------- sizes as declared


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize(("side", "unknown"), [("camera", "X"), ("robot", "W")])
@pytest.mark.parametrize("known", [True, False])
def test_an_error_that_an_unknown_pose_absorbs_is_named_with_its_way(setup, side, unknown, known):
    """The same shift of all camera poses in the camera's frame, of all robot poses in the base's."""
    poses = uq.simulate(20, noise=WEAK_ROBOT, setup=setup, seed=support.SEED)
    if setup == "eye-to-hand":
        unknown = {"X": "X", "W": "X"}[unknown]
    columns = np.zeros((20, 6, 1))
    columns[:, 5] = 1.0
    part = uq.Component("shift of the mount", side, (2e-3, 1 if known else 2), columns=columns)
    result = quietly(poses, components=[part])
    found = [one for one in result.findings if one.code == "noise_estimation.absorbed"]
    assert [one.values["unknown"] for one in found] == [unknown]
    assert found[0].values["shift"] == pytest.approx(2e-3, rel=1e-3) and found[0].values["turn"] < 1e-8
    assert "cannot be separated from" in str(found[0]) and "2 mm along (" in str(found[0])
    assert [one for one in quietly(poses).findings if one.code == "noise_estimation.absorbed"] == []


@pytest.mark.slow
def test_a_size_that_the_data_push_to_its_end_is_named():
    poses = uq.simulate(20, noise=WEAK_ROBOT, seed=support.SEED)
    (found,) = size_findings(poses, sizes={"camera rotation": ("20deg", 1.1)})
    assert (found.code, found.values["error"]) == ("noise_estimation.size_at_end", "camera rotation")
    assert "--size 'camera rotation=SIZE,FACTOR'" in str(found) and "20 deg within a factor of 1.1" in str(found)
    assert size_findings(poses) == []


def size_findings(poses, **options):
    return [one for one in quietly(poses, **options).findings if one.code.startswith("noise_estimation.size")]


def test_sizes_at_their_low_ends_are_said_once():
    tiny = uq.PoseNoise.isotropic(robot=("1e-7deg", "1e-7mm"), camera=("1e-7deg", "1e-7mm"))
    poses = uq.simulate(20, noise=tiny, seed=support.SEED)
    (found,) = size_findings(poses)
    assert found.code == "noise_estimation.sizes_at_low_end" and len(found.values["ends"]) > 2
    assert all(one["value"] < one["usual"] / one["factor"] for one in found.values["ends"])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"camera rotation": 0}, "above 0 and finite, got 0"),
        ({"camera rotation": (np.nan, 2)}, "above 0 and finite"),
        ({"camera rotation": ("0.1deg", 0.5)}, "factor of 'camera rotation' to be a number >= 1"),
        ({"camera rotation": "1mm"}, "Unknown unit 'mm' in the size of 'camera rotation'"),
        ({"camera rotation": (1, 2, 3)}, r"or \(median, factor\)"),
        ({"camera rotatoin": 1e-3}, "of no known error. Near it: camera rotation"),
        ({"pixel noise": "0.1px"}, "that is known, but not here"),
    ],
)
def test_sizes_that_are_none_are_refused(given, message):
    with pytest.raises(uq.InputError, match=message):
        quietly(uq.simulate(10, noise=WEAK_ROBOT, seed=support.SEED), sizes=given)
