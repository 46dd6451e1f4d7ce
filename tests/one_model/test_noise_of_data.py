"""Noise from the data: closed form against dense algebra, intervals and F distribution over simulated sets."""

import json

import numpy as np
import pytest
import support
from scipy import optimize, stats

import uq_handeye as uq
from uq_handeye.likelihood.constraint import constraint_of
from uq_handeye.likelihood.gauss_helmert import Fit, bound, efficient
from uq_handeye.likelihood.goodness_of_fit import effective_dof, goodness_of_fit, spread_of
from uq_handeye.likelihood.starts import start_of
from uq_handeye.noise.estimate import NoiseEstimate, NoisePrior
from uq_handeye.noise_estimation.restricted_likelihood import (
    chi_square_interval,
    covariance_of,
    intervals,
    paired_rows,
    restricted,
)
from uq_handeye.one_model.noise_of_data import estimate_noise, model_of, variance_components

SIDES = ("robot", "camera")
WEAK_ROBOT = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
EQUAL = uq.PoseNoise.isotropic(robot=("0.05deg", "0.3mm"), camera=("0.05deg", "0.3mm"))
STRONG_ROBOT = uq.PoseNoise.isotropic(robot=("0.1deg", "0.5mm"), camera=("0.02deg", "0.05mm"))
PLAIN, _ = model_of(NoisePrior(), SIDES)
TOGETHER = [f"{what}, robot and camera together" for what in ("rotation", "translation")]


def truth_of(noise):
    return np.array([noise.robot[0, 0], noise.camera[0, 0], noise.robot[3, 3] + noise.camera[3, 3]])


def components_of(data):
    constraint = constraint_of(data, None)
    return variance_components(constraint, start_of(data, constraint, None), PLAIN)


def linearised(data):
    constraint = constraint_of(data, None)
    return constraint.linearise(start_of(data, constraint, None), constraint.first, constraint.second)


def directions(linear):
    first, second = linear.sides
    return first[..., :3], second[..., :3], second[..., 3:]


def dense(linear, variances):
    """Deviance, score, information and step from 6n x 6n matrices."""
    n, p = linear.J.shape[0], linear.J.shape[-1]
    V = np.zeros((3, 6 * n, 6 * n))
    for k, U in enumerate(directions(linear)):
        for i in range(n):
            V[k, 6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = U[i] @ U[i].T
    S = np.tensordot(variances, V, 1)
    J, r = linear.J.reshape(-1, p), linear.r.ravel()
    inverse = np.linalg.inv(S)
    A = J.T @ inverse @ J
    P = inverse - inverse @ J @ np.linalg.solve(A, J.T @ inverse)
    deviance = np.linalg.slogdet(S)[1] + np.linalg.slogdet(A)[1] + r @ P @ r
    PV = P @ V
    score = 0.5 * (np.einsum("i,kij,j->k", P @ r, V, P @ r) - np.trace(PV, axis1=1, axis2=2))
    information = 0.5 * np.einsum("kij,lji->kl", PV, PV)
    return deviance, score, information, -np.linalg.solve(A, J.T @ inverse @ r)


def data_of(kind, n=10):
    if kind == "motions":
        _, A, B = support.noisy_motions(np.random.default_rng(support.SEED), n, sd=1e-3)
        return uq.Motions(A, B)
    return uq.simulate(n, noise=WEAK_ROBOT, setup=kind, seed=support.SEED)


@pytest.mark.parametrize("kind", ["eye-in-hand", "eye-to-hand", "motions"])
@pytest.mark.parametrize("variances", [[1e-6, 2e-6, 3e-7], [0.0, 2e-6, 3e-7], [1e-6, 0.0, 3e-7]])
def test_closed_form_is_the_dense_one(kind, variances):
    linear = linearised(data_of(kind))
    found = restricted(paired_rows(linear, None), np.array(variances))
    for value, expected in zip((found.deviance, found.score, found.information, found.step),
                               dense(linear, np.array(variances)), strict=True):  # fmt: skip
        np.testing.assert_allclose(value, expected, rtol=1e-9)


def test_score_and_observed_information_are_derivatives():
    rows, v = paired_rows(linearised(data_of("eye-in-hand")), None), np.array([1e-6, 2e-6, 3e-7])
    at = lambda x: restricted(rows, v * (1 + x))  # noqa: E731
    slope = support.jacobian(lambda x: at(x).deviance[:, None], 3)[0]
    np.testing.assert_allclose(-0.5 * slope, at(np.zeros(3)).score * v, rtol=1e-7)
    bend = support.jacobian(lambda x: at(x).score, 3) / v
    found = at(np.zeros(3))
    np.testing.assert_allclose(0.5 * (found.information - bend), found.average, rtol=1e-6)


def test_weights_count_poses():
    poses = data_of("eye-in-hand", 12)
    kept = uq.PosePairs(poses.robot[:9], poses.camera[:9])
    start = poses.truth.X
    weights = np.r_[np.ones(9), np.zeros(3)]
    with_weights, without = (
        estimate_noise(poses, start=start, weights=weights),
        estimate_noise(kept, start=start),
    )
    np.testing.assert_allclose(with_weights.variances, without.variances, rtol=2e-3)
    assert with_weights.dof == without.dof == 42
    # half the weight on two copies is one pose
    twice = uq.PosePairs(*(np.concatenate([T, T]) for T in (poses.robot, poses.camera)))
    half = estimate_noise(twice, start=start, weights=np.full(24, 0.5))
    np.testing.assert_allclose(half.variances, estimate_noise(poses, start=start).variances, rtol=2e-3)


def test_profile_intervals_against_brute_force():
    poses = uq.simulate(20, noise=EQUAL, seed=5)
    found = components_of(poses)
    low, high, reached = intervals(found.rows, PLAIN, found.state, np.arange(2))
    assert reached.all()

    def objective(v):
        return float(restricted(found.rows, np.asarray(v)).deviance - np.log(v[2]))

    best = optimize.minimize(lambda x: objective(np.exp(x)), np.log(found.state.v), method="Nelder-Mead",
                             options={"xatol": 1e-7, "fatol": 1e-9, "maxiter": 4000})  # fmt: skip
    np.testing.assert_allclose(found.state.v, np.exp(best.x), rtol=2e-3)
    for k, ends in enumerate(zip(low, high, strict=True)):
        for end in ends:
            others = [j for j in range(3) if j != k]
            profile = optimize.minimize(
                lambda x, k=k, end=end, others=others: objective(
                    np.exp(np.insert(x, k, np.log(end)))
                ),
                np.log(found.state.v[others]), method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-8},
            )  # fmt: skip
            assert abs(profile.fun - best.fun - stats.chi2.ppf(0.95, 1)) < 0.03


def within(hits, total, level=0.95, lower_only=False):
    tail = (1 - support.CONFIDENCE) / 2
    low, high = stats.binom.ppf([tail, 1 - tail], total, level)
    return low <= hits and (lower_only or hits <= high)


@pytest.mark.parametrize(
    ("noise", "setup", "n", "edge"),
    [
        (EQUAL, "eye-in-hand", 30, ()),
        (WEAK_ROBOT, "eye-in-hand", 30, (0,)),
        (STRONG_ROBOT, "eye-in-hand", 15, (1,)),
        (EQUAL, "eye-to-hand", 30, (0, 1)),
    ],
)
def test_intervals_cover(noise, setup, n, edge):
    """`edge`: components that some sets cannot tell from 0; their intervals may cover more."""
    sets, truth = 100 if edge else 200, truth_of(noise)  # intervals at 0 take longest
    poses = uq.simulate(n, noise=noise, setup=setup, trials=sets, seed=support.SEED)
    found = components_of(poses)
    assert found.converged.all()
    v, covariance = found.state.v, covariance_of(found.state)
    low, high, reached = intervals(found.rows, PLAIN, found.state, np.arange(3))
    assert reached.all()
    for k in range(3):
        hits = ((low[:, k] <= truth[k]) & (truth[k] <= high[:, k])).sum()
        assert within(hits, sets, lower_only=k in edge), (k, hits / sets)
    total, variance, true = v[:, 0] + v[:, 1], covariance[:, :2, :2].sum(axis=(1, 2)), truth[0] + truth[1]
    # intervals that take the estimate for twice as certain are found out
    for factor in (1.0, 4.0):
        low, high = chi_square_interval(total, variance / factor)
        hits = ((low <= true) & (true <= high)).sum()
        assert within(hits, sets) == (factor == 1.0), hits / sets


def fitted(poses, found):
    """The efficient estimate with the noise found of each set, by dense blocks."""
    constraint = constraint_of(poses, None)
    linear = constraint.linearise(found.at, constraint.first, constraint.second)
    v = found.state.v[..., None, None, None]
    S = sum(v[..., k, :, :, :] * (U @ U.mT) for k, U in enumerate(directions(linear)))
    inverse, J = np.linalg.inv(S), linear.J
    covariance = np.linalg.inv((J.mT @ inverse @ J).sum(axis=-3))
    step = -(covariance @ (J.mT @ inverse @ linear.r[..., None]).sum(axis=-3))[..., 0]
    residual = linear.r + (J @ step[..., None, :, None])[..., 0]
    return Fit(found.at.moved(step), covariance, linear, S, residual, 1, np.ones(len(step), dtype=bool))


def scaled_nees(n, noise, sets=1000):
    poses = uq.simulate(n, noise=noise, trials=sets, seed=support.SEED)
    found = components_of(poses)
    fit = fitted(poses, found)
    errors = support.difference(fit.X, poses.truth.X)
    return support.nees(errors, fit.covariance_X), 12.0 / spread_of(fit, covariance_of(found.state))


def test_nees_with_estimated_noise_follows_f():
    distance, nu = scaled_nees(30, EQUAL)
    inside = distance / 6 < stats.f.ppf(0.95, 6, nu)
    assert within(inside.sum(), len(inside)), inside.mean()
    expected = (nu / (nu - 2)).mean()
    error = distance.std() / 6 / np.sqrt(len(distance))
    assert abs(distance.mean() / 6 - expected) < 3.3 * error


def test_with_few_poses_chi_square_is_rejected():
    distance, nu = scaled_nees(8, WEAK_ROBOT)
    by_chi_square = distance < stats.chi2.ppf(0.95, 6)
    assert not within(by_chi_square.sum(), len(distance)), by_chi_square.mean()
    by_f = distance / 6 < stats.f.ppf(0.95, 6, nu)
    assert within(by_f.sum(), len(distance)), by_f.mean()


def test_statement_and_round_trip():
    estimate = estimate_noise(uq.simulate(30, noise=WEAK_ROBOT, seed=2))
    assert [component.name for component in estimate.components][:3] == [TOGETHER[0], "robot rotation",
                                                                         "camera rotation"]  # fmt: skip
    for name in SIDES:
        assert estimate[f"{name} translation"].status == "not told apart"
    assert estimate[TOGETHER[1]].low < np.sqrt(truth_of(WEAK_ROBOT)[2]) < estimate[TOGETHER[1]].high
    assert any("cannot be separated by data of this kind" in sentence for sentence in estimate.statement)
    again = NoiseEstimate.from_dict(json.loads(json.dumps(estimate.to_dict())))
    assert again.to_dict() == estimate.to_dict()
    np.testing.assert_allclose(again.noise.robot, estimate.noise.robot)
    with pytest.raises(uq.InputError, match="to_dict"):
        NoiseEstimate.from_dict({})


def test_the_split_has_no_effect_on_X():
    poses = uq.simulate(30, noise=WEAK_ROBOT, seed=3)
    noise = estimate_noise(poses).noise
    total = noise.robot[3:, 3:] + noise.camera[3:, 3:]
    other = uq.PoseNoise(noise.robot.copy(), noise.camera.copy())
    robot, camera = other.robot.copy(), other.camera.copy()
    robot[3:, 3:], camera[3:, 3:] = 0.9 * total, 0.1 * total
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
    np.testing.assert_allclose(loose.variances, free.variances, rtol=0.03)  # a prior of the split leaves the sum
    part = loose["robot translation"]
    assert part.status == "prior" and part.low < 5e-5 < part.high and 2 < part.high / part.value < 5
    everything = estimate_noise(poses, NoisePrior(("0.02deg", "0.05mm"), ("0.1deg", "0.5mm"), factor=1))
    np.testing.assert_allclose(everything.variances, truth_of(WEAK_ROBOT))
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
    assert large[TOGETHER[1]].status == "prior" and large[TOGETHER[1]].low >= 8e-4
    assert any(text.startswith("From the data sheet: translation") for text in large.statement)
    assert any(text.startswith("Estimated from the data: rotation") for text in large.statement)
    # A side that is exact leaves all of the rotation to the other one.
    exact = estimate_noise(poses, NoisePrior(robot=("0deg", "0mm"), factor=1))
    assert exact["robot rotation"].status == "fixed" and exact["camera rotation"].status == "estimated"


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
    np.testing.assert_allclose(estimate["rotation, A and B together"].value, 1e-3 * np.sqrt(2), rtol=0.15)
    np.testing.assert_allclose(estimate["translation, A and B together"].value, 5e-4 * np.sqrt(2), rtol=0.15)
    assert estimate.dof == 1194


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
        estimate_noise(poses, weights=np.full(10, 0.1))
    with pytest.raises(uq.InputError, match="leading axes"):
        estimate_noise(uq.simulate(10, noise=WEAK_ROBOT, trials=2))
