"""The judge of covariances: sums against SciPy, tests that hold their level, wrong covariances that are rejected."""

import io

import numpy as np
import pytest
from scipy import stats
from support import SEED, draw, mean_interval, nees, random_covariance, whitened_eigenvalues

from uq_handeye.errors import InputError
from uq_handeye.trials.validation.monte_carlo.consistency import LEVELS, PARTS, Sums, consistency
from uq_handeye.trials.validation.monte_carlo.sums import ABOVE, BELOW, COMPONENTS, SIZES, edges, in_words
from uq_handeye.trials.validation.monte_carlo.text import verdict

BLOCKS = (slice(0, 6), slice(0, 3), slice(3, 6))
LR = "likelihood ratio of the covariance"


@pytest.fixture
def rng():
    return np.random.default_rng(SEED)


@pytest.fixture
def P(rng):
    return random_covariance(rng) * np.outer([1, 1, 1, 0.1, 0.1, 0.1], [1, 1, 1, 0.1, 0.1, 0.1])


def sums_of(errors, covariance):
    return Sums.of(errors, np.ones(len(errors), bool), covariance)


def judged(errors, covariance, **options):
    return consistency(sums_of(errors, covariance), covariance, **options)


def same(a, b):
    return all(np.array_equal(x, y) for x, y in zip(a.to_arrays().values(), b.to_arrays().values(), strict=True))


# ------------------------------------------------------------------------------------------------------- sums


def test_sums_are_those_of_their_definition(rng, P):
    errors = draw(rng, 1.3 * P, (500,))
    sums = sums_of(errors, P)
    assert (sums.count, sums.failures, sums.trials) == (500, 0, 500)
    np.testing.assert_allclose(sums.error, errors.sum(axis=0), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(sums.outer, errors.T @ errors, rtol=1e-10, atol=1e-18)
    for k, (block, size) in enumerate(zip(BLOCKS, SIZES, strict=True)):
        d2 = nees(errors[:, block], P[block, block])
        np.testing.assert_allclose([sums.nees[k], sums.nees_squared[k]], [d2.sum(), (d2**2).sum()], rtol=1e-10)
        np.testing.assert_array_equal(sums.inside[k], [(d2 <= stats.chi2.ppf(p, size)).sum() for p in LEVELS])
        counts = np.histogram(d2, [-1, *stats.chi2.ppf(BELOW, size), np.inf])[0]
        assert np.abs(counts - sums.histogram[k]).sum() <= 2  # one trial on an edge may move


def test_edges_are_quantiles_in_both_tails():
    for size in (3, 6):
        np.testing.assert_allclose(stats.chi2.cdf(edges(size), size), BELOW, rtol=1e-9)
        np.testing.assert_allclose(stats.chi2.sf(edges(size), size), ABOVE, rtol=1e-9)
        assert (np.diff(edges(size)) > 0).all()
    assert BELOW[0] == pytest.approx(1e-8) and ABOVE[-1] == pytest.approx(1e-8)
    assert all(np.abs(BELOW - level).min() < 1e-12 for level in LEVELS)


def test_a_covariance_of_each_trial(rng, P):
    own = P * np.exp(0.3 * rng.normal(size=(400, 1, 1)))
    errors = draw(rng, own, (400,))
    sums = sums_of(errors, own)
    for k, block in enumerate(BLOCKS):
        d2 = nees(errors[:, block], own[:, block, block])
        np.testing.assert_allclose([sums.nees[k], sums.nees_squared[k]], [d2.sum(), (d2**2).sum()], rtol=1e-10)
    assert same(sums_of(errors, P), sums_of(errors, np.broadcast_to(P, (400, 6, 6))))


def test_failed_trials_are_counted_and_not_looked_at(rng, P):
    errors, ok = draw(rng, P, (300,)), np.arange(300) % 3 > 0
    own = np.where(ok[:, None, None], P, 0.0)
    errors[~ok] = np.nan
    sums, alone = Sums.of(errors, ok, P), sums_of(errors[ok], P)
    assert sums.failures == 100 and sums.count == 200
    assert all(np.array_equal(x, y) for k, x, y in _pairs(sums, alone) if k != "failures")
    assert same(sums, Sums.of(errors, ok, own))


def _pairs(a, b):
    return [(k, x, b.to_arrays()[k]) for k, x in a.to_arrays().items()]


def test_addition_in_order_gives_the_same_bits_and_the_whole(rng, P):
    errors = draw(rng, P, (1000,))
    parts = [sums_of(errors[k : k + 250], P) for k in range(0, 1000, 250)]
    total = parts[0] + parts[1] + parts[2] + parts[3]
    assert same(total, ((parts[0] + parts[1]) + parts[2]) + parts[3])
    whole = sums_of(errors, P)
    np.testing.assert_array_equal(total.histogram, whole.histogram)
    for name in ("error", "outer", "nees", "nees_squared"):
        np.testing.assert_allclose(getattr(total, name), getattr(whole, name), rtol=1e-9, atol=1e-16)


def test_sums_survive_a_file_to_the_bit(rng, P):
    sums = Sums.of(draw(rng, P, (50,)), np.arange(50) > 4, P)
    file = io.BytesIO()
    np.savez(file, **sums.to_arrays())
    file.seek(0)
    with np.load(file) as arrays:
        assert same(sums, Sums.from_arrays(arrays))
    whole = sums.to_arrays()
    for change in ({"error": np.zeros(5)}, {"outer": np.zeros((6, 6), int)}, {"histogram": whole["histogram"] + 1}):
        with pytest.raises(InputError, match="Expected"):
            Sums.from_arrays(whole | change)
    del whole["nees"]
    with pytest.raises(InputError, match="`nees`"):
        Sums.from_arrays(whole)


def test_what_cannot_be_used_is_named(rng, P):
    errors, ok = draw(rng, P, (5,)), np.ones(5, bool)
    flat = P.copy()
    flat[4, :] = flat[:, 4] = 0.0
    with pytest.raises(InputError, match="no error in translation along y"):
        Sums.of(errors, ok, flat)
    own = np.array([P] * 5)
    own[3, :, 0] = own[3, 0, :] = own[3, 1]
    own[3, 0, 0] = own[3, 0, 1] = own[3, 1, 0] = own[3, 1, 1]
    with pytest.raises(InputError, match=r"of trial 3.*mixture of rotation about"):
        Sums.of(errors, ok, own)
    for bad in ((errors[:, :5], ok, P), (errors, ok[:4], P), (errors, ok.astype(int), P), (errors, ok, P[:5, :5])):
        with pytest.raises(InputError, match="Expected"):
            Sums.of(*bad)
    with pytest.raises(InputError, match="finite"):
        Sums.of(np.full((5, 6), np.inf), ok, P)
    with pytest.raises(InputError, match="positive definite"):
        consistency(sums_of(errors, P), flat)
    with pytest.raises(InputError, match="`confidence`"):
        consistency(sums_of(errors, P), P, confidence=1.0)
    with pytest.raises(InputError, match=r"\(6, 6\)"):
        consistency(sums_of(errors, P), np.array([P, P]))


# ------------------------------------------------------------------------------------------- statistics, by SciPy


def test_statistics_are_those_of_scipy(rng, P):
    T = 800
    errors = draw(rng, 1.1 * P, (T,)) + 0.02 * np.sqrt(np.diag(P))
    c = judged(errors, P)
    np.testing.assert_allclose(c.bias, errors.mean(axis=0), rtol=1e-9)
    np.testing.assert_allclose(c.covariance, np.cov(errors.T), rtol=1e-8, atol=1e-18)
    np.testing.assert_allclose(c.second_moment, errors.T @ errors / T, rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(c.bias_error, errors.std(axis=0, ddof=1) / np.sqrt(T), rtol=1e-8)
    squared = T * nees(errors.mean(axis=0)[None], np.cov(errors.T))[0]
    assert c.bias_p_value == pytest.approx(stats.f.sf(squared * (T - 6) / (6 * (T - 1)), 6, T - 6), rel=1e-6)
    for k, (part, size, block) in enumerate(zip(PARTS, SIZES, BLOCKS, strict=True)):
        d2 = nees(errors[:, block], P[block, block])
        assert c.mean_nees[k] == pytest.approx(d2.mean())
        np.testing.assert_allclose(c.nees_interval[k], stats.chi2.ppf([0.005, 0.995], T * size) / T, rtol=1e-9)
        tails = stats.chi2.cdf(d2.sum(), T * size), stats.chi2.sf(d2.sum(), T * size)
        assert c.p_values[f"mean NEES, {part}"] == pytest.approx(2 * min(tails), rel=1e-6)
        smallest = 1.0
        for j, level in enumerate(LEVELS):
            inside = int((d2 <= stats.chi2.ppf(level, size)).sum())
            exact = stats.binomtest(inside, T, level).proportion_ci(0.99, method="exact")
            np.testing.assert_allclose(c.coverage_interval[k, j], [exact.low, exact.high], rtol=1e-9)
            p = 2 * min(stats.binom.cdf(inside, T, level), stats.binom.sf(inside - 1, T, level))
            smallest = min(smallest, p)
            assert c.coverage_p_values[k, j] == pytest.approx(min(1, p), rel=1e-6)
        assert c.p_values[f"coverage, {part}"] == pytest.approx(min(1.0, 5 * smallest), rel=1e-6)
    values = whitened_eigenvalues(np.cov(errors.T), P)
    np.testing.assert_allclose(c.eigenvalues, values, rtol=1e-8)
    raw = (T - 1) * (values.sum() - np.log(values).sum() - 6)
    assert c.likelihood_ratio == pytest.approx(raw * (1 - (2 * 36 + 18 - 1) / (6 * (T - 1) * 7)), rel=1e-6)
    assert c.p_values[LR] == pytest.approx(stats.chi2.sf(c.likelihood_ratio, 21), rel=1e-6)
    for value, direction in zip(c.eigenvalues, c.directions, strict=True):
        weights = direction / np.sqrt(np.diag(P))
        assert weights @ np.cov(errors.T) @ weights / (weights @ P @ weights) == pytest.approx(value, rel=1e-6)
    assert c.overall == pytest.approx(np.sqrt(values.mean()) - 1)
    ratio = np.sqrt(np.diag(np.cov(errors.T)) / np.diag(P))
    limits = np.sqrt((T - 1) / stats.chi2.ppf([0.995, 0.005], T - 1))
    np.testing.assert_allclose(c.std_ratio_interval, ratio[:, None] * limits, rtol=1e-8)


def test_no_estimate_and_all_inside_have_one_sided_intervals(P):
    c = judged(np.zeros((40, 6)) + 1e-9 * np.eye(6)[np.arange(40) % 6], P)
    assert (c.coverage == 1).all() and (c.coverage_interval[..., 1] == 1).all()
    np.testing.assert_allclose(c.coverage_interval[..., 0], 0.005 ** (1 / 40), rtol=1e-9)
    assert c.consistent is False and "too large" in verdict(c)


# ------------------------------------------------------------------------------------- the level of the tests


@pytest.mark.statistical
@pytest.mark.parametrize(("trials", "replications"), [(30, 1500), (200, 1500), (10_000, 150)])
def test_a_true_covariance_is_accepted(rng, P, trials, replications):
    """All tests together reject at most 1 %; each exact test by itself, the likelihood ratio and the eigenvalues in
    1 %.
    """
    names = [*(f"mean NEES, {part}" for part in PARTS), LR]
    alone, rejected, outside, tails = np.zeros(4), 0, 0, []
    for _ in range(replications):
        c = judged(draw(rng, P, (trials,)), P)
        rejected += not c.consistent
        alone += [c.p_values[name] < 0.01 for name in names]
        low, high = c.eigenvalue_interval
        outside += not low <= c.eigenvalues[0] <= c.eigenvalues[-1] <= high
        tails.append(c.kurtosis / c.kurtosis_error)
    assert rejected <= stats.binom.ppf(0.999, replications, 0.01)
    low, high = stats.binom.ppf([0.0002, 0.9998], replications, [0.009, 0.012])
    assert ((low <= alone) & (alone <= high)).all(), alone
    assert outside <= stats.binom.ppf(0.999, replications, 0.011)
    if trials == 200:
        assert np.std(tails) == pytest.approx(1.0, abs=0.2)


def rotated(rng, covariance):
    """Another covariance with mean NEES 6: variances 15 % more and less in a random direction each."""
    L = np.linalg.cholesky(covariance)
    U = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    return L @ U @ np.diag([1.15, 0.85, 1, 1, 1, 1]) @ U.T @ L.T


WRONG = {
    "larger": lambda P, rng: 1.1**2 * P,
    "smaller": lambda P, rng: 0.9**2 * P,
    **{f"axis {k}": lambda P, rng, k=k: _scaled(P, k, 1.1) for k in range(6)},
    "rotated": lambda P, rng: rotated(rng, P),
}


def _scaled(P, k, factor):
    D = np.ones(6)
    D[k] = factor
    return P * np.outer(D, D)


@pytest.mark.statistical
@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_covariance_is_rejected_at_ten_thousand_trials(rng, P, case):
    """Standard deviations 10 % off in all or in one axis, or the mean NEES of a true covariance with another shape."""
    for _ in range(12):
        truth = WRONG[case](P, rng)
        c = judged(draw(rng, truth, (10_000,)), P)
        assert not c.consistent and LR in c.rejected and not c.harmless
        if case in ("larger", "smaller"):
            assert abs(abs(c.overall) - 0.1) < 4 * 1.1 / np.sqrt(12 * 10_000)
            assert ("too small" if case == "larger" else "too large") in verdict(c)
            assert "in all directions alike" in verdict(c) and "mean NEES (joint, rotation, translation)" in verdict(c)
        if case == "rotated":
            low, high = mean_interval(10_000)
            assert low < c.mean_nees[0] < high and "wrong" in verdict(c)
        if case.startswith("axis"):
            assert f"single axes off: {COMPONENTS[int(case[-1])]} (+" in verdict(c)


def test_one_independent_axis_is_named_as_the_worst_direction(rng):
    P = np.diag([1e-3, 2e-3, 3e-3, 1e-4, 2e-4, 3e-4]) ** 2
    c = judged(draw(rng, _scaled(P, 4, 1.2), (10_000,)), P)
    assert c.worst == 5 and in_words(c.directions[5]) == "translation along y"
    assert "too small" in verdict(c) and "in the worst, translation along y" in verdict(c)
    assert abs(c.size - 0.2) < 4 * c.size_error


@pytest.mark.slow
def test_the_error_of_the_size_is_that_of_replications(rng):
    P = np.eye(6)
    found = [judged(draw(rng, _scaled(P, 1, 1.5), (500,)), P) for _ in range(400)]
    sizes = [c.size for c in found]
    assert np.std(sizes) == pytest.approx(np.mean([c.size_error for c in found]), rel=4 / np.sqrt(800))


# -------------------------------------------------------------------------------------------------- the verdict


def heavy(rng, covariance, trials, freedom=5):
    """Student errors of that covariance."""
    scale = np.sqrt((freedom - 2) / rng.chisquare(freedom, size=(trials, 1)))
    return draw(rng, covariance, (trials,)) * scale


def test_heavy_tails_with_the_right_covariance_are_named_so(rng, P):
    c = judged(heavy(rng, P, 10_000, freedom=9), P)
    assert not c.consistent and "coverage, joint" in c.rejected
    assert c.same_spread and "right in size" in verdict(c) and "not Gaussian, their tails are heavier" in verdict(c)
    assert f"the 99 % ellipsoid holds {100 * c.coverage[0, -1]:.1f} % of the errors" in verdict(c)
    assert c.coverage[0, -1] < 0.985


def test_a_bias_is_named_as_such_and_counts_through_the_nees_alone(rng, P):
    shift = np.sqrt(np.diag(P)) * np.linalg.norm(np.linalg.solve(np.linalg.cholesky(P), np.sqrt(np.diag(P)))) ** -1
    small = judged(draw(rng, P, (10_000,)) + 0.07 * shift, P)
    assert small.bias_p_value < 0.01 and small.rejected in ((), ("mean NEES, joint",))
    large = judged(draw(rng, P, (10_000,)) + 0.6 * shift, P)
    assert not large.consistent and LR not in large.rejected
    assert "right in size, but the estimate is biased" in verdict(large) and "Gaussian" not in verdict(large)
    np.testing.assert_allclose(large.bias_sd, large.bias / large.std)


@pytest.mark.slow
def test_a_tiny_difference_is_significant_and_harmless(rng):
    P = np.diag([1e-3] * 3 + [1e-4] * 3) ** 2
    total = None
    for _ in range(5):
        part = sums_of(draw(rng, 1.004**2 * P, (200_000,)), P)
        total = part if total is None else total + part
    c = consistency(total, P)
    assert not c.consistent and c.harmless
    assert "significant with 1,000,000 trials, but of no practical weight below 5 %" in verdict(c)
    assert abs(c.overall - 0.004) < 4 / np.sqrt(12e6)


@pytest.mark.parametrize("offset", [0.0, 1.0])
def test_errors_that_do_not_vary_are_rejected_and_not_divided_by(P, offset):
    c = judged(np.full((200, 6), offset) * np.sqrt(np.diag(P)), P)
    assert c.consistent is False and c.bias_p_value is None and c.bias_sd is None
    assert np.isfinite(c.likelihood_ratio) and np.isfinite(c.kurtosis) and c.size == pytest.approx(-1.0, abs=1e-3)
    assert verdict(c).startswith("The covariance is too large")


@pytest.mark.parametrize("count", [0, 1, 2, 6, 29, 30, 99])
def test_few_trials_say_what_they_cannot_tell(rng, P, count):
    ok = np.arange(120) < count
    c = consistency(Sums.of(draw(rng, P, (120,)), ok, P), P)
    assert (c.trials, c.failures) == (120, 120 - count)
    for value in vars(c).values():
        if isinstance(value, float | np.ndarray):
            assert np.isfinite(value).all()
    assert (c.bias is None) == (count == 0)
    assert (c.covariance is None) == (c.std_ratio_interval is None) == (count < 2)
    assert (c.eigenvalues is None) == (c.size is None) == (c.kurtosis is None) == (LR not in c.p_values) == (count < 30)
    if count == 0:
        assert c.consistent is None and verdict(c).startswith("Nothing can be said") and "none of 120" in verdict(c)
    else:
        assert not c.rejected and c.consistent is None
        assert verdict(c).startswith(f"Only {count} of 120 trials gave an estimate: all that follows is of these")
        assert f". Only {count} estimate" in verdict(c) and "left out" not in verdict(c)
        assert ("single directions cannot be judged" in verdict(c)) == (count < 30)


@pytest.mark.slow
def test_trials_without_an_estimate_come_first_and_nothing_is_called_consistent(rng, P):
    errors = draw(rng, P, (500,))
    few = consistency(Sums.of(errors, np.arange(500) >= 4, P), P)  # 0.8 %
    assert few.consistent is True and verdict(few).startswith(
        "The covariance is consistent with this noise, as far as 496 estimates can tell"
    )
    assert "4 of 500 trials (0.8 %) gave no estimate" in verdict(few)
    many = consistency(Sums.of(errors, np.arange(500) >= 20, P), P)
    assert many.consistent is None and not many.rejected and many.many_failed
    assert verdict(many).startswith("Only 480 of 500 trials gave an estimate: all that follows is of these, and the")
    assert "does not describe the other 20 (4 %)." in verdict(many)
    most = consistency(Sums.of(errors, np.arange(500) >= 487, P), P)
    assert most.consistent is None and "Only 13 estimates" in verdict(most) and "Only 13 trials" not in verdict(most)
    wrong = consistency(Sums.of(errors, np.arange(500) >= 20, 4 * P), 4 * P)
    assert wrong.consistent is False and "too large" in verdict(wrong)


@pytest.mark.parametrize("size", [1e-300, 1e-170])
def test_a_covariance_far_below_the_errors_is_named(rng, size):
    with pytest.raises(InputError, match=r"`covariance` to be of the size of the errors.*Is it in rad and m"):
        sums_of(rng.normal(size=(50, 6)), size * np.eye(6))


@pytest.mark.parametrize("axes", [[0], [4], [0, 1, 2], [0, 1, 2, 3, 4, 5]])
@pytest.mark.parametrize("trials", [5, 40, 500])
def test_errors_that_are_zero_in_a_direction_are_no_warning(rng, P, axes, trials):
    errors = draw(rng, P, (trials,))
    errors[:, axes] = 0.0
    c = judged(errors, P)  # warnings are errors here
    assert verdict(c) and "e+0" not in verdict(c)
    assert c.std_ratio_interval[axes].max() == 0.0


def test_without_prediction_or_with_own_covariances(rng, P):
    sums = sums_of(draw(rng, 1.2 * P, (5000,)), P)
    c = consistency(sums, None)
    assert c.eigenvalues is None and LR not in c.p_values and not c.consistent
    assert verdict(c).startswith("The covariance is too small for this noise: mean NEES 7.")
    own = consistency(sums, P, own=True)
    assert verdict(own).startswith("The covariances that the trials report are too small")
    assert "than they say" in verdict(own)


def test_directions_in_words():
    assert in_words([0, 0, 1, 0, 0, 0]) == "rotation about z"
    assert in_words([0, 0, 0.05, -3, 0, 0.2]) == "translation along x"
    assert in_words([1, 0, 0, 0, -1, 0]) == "the mixture of rotation about x (+0.7), translation along y (-0.7)"
