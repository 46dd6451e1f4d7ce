"""Adaptive stopping: the numbers of JCGM 102, no stop before they are stable, and none where they drift."""

from decimal import Decimal

import numpy as np
import pytest
from scipy import stats
from support import SEED, draw, random_covariance

from uq_handeye.errors import InputError
from uq_handeye.findings import Finding
from uq_handeye.trials.validation.monte_carlo.consistency import MIN_TRIALS
from uq_handeye.trials.validation.monte_carlo.stopping import (
    BLOCK_TRIALS,
    MIN_BLOCKS,
    NAMES,
    Stability,
    numerical_tolerance,
)
from uq_handeye.trials.validation.sentences import STABLE


@pytest.fixture
def rng():
    return np.random.default_rng(SEED)


def filled(blocks, digits):
    stability = Stability(digits)
    for block in blocks:
        stability.add(block, np.ones(len(block), bool))
    return stability


def until_stable(rng, P, digits, most):
    """Add blocks until stable; return the collector and the number of blocks."""
    stability = Stability(digits)
    for _ in range(most):
        stability.add(draw(rng, P, (BLOCK_TRIALS,)), np.ones(BLOCK_TRIALS, bool))
        if stability.stable:
            break
    return stability


def test_tolerances_are_half_a_unit_of_the_last_digit(rng):
    examples = {
        (12.3, 2): 0.5,
        (0.00035, 1): 0.5e-4,
        (9.97, 2): 0.5,
        (9.94, 2): 0.05,
        (-1.0, 3): 0.005,
        (35000, 2): 500,
    }
    for (value, digits), expected in examples.items():
        assert numerical_tolerance(value, digits) == pytest.approx(expected, rel=1e-12)
    for value in 10 ** rng.uniform(-9, 9, 200) * rng.choice([-1, 1], 200):
        for digits in (1, 2, 3, 4):
            rounded = Decimal(f"{value:.{digits - 1}e}")
            exponent = rounded.adjusted() - digits + 1
            assert numerical_tolerance(value, digits) == pytest.approx(0.5 * 10.0**exponent, rel=1e-12)
    with pytest.raises(InputError, match="other than 0"):
        numerical_tolerance(0.0, 2)


def test_the_numbers_are_those_of_the_standard(rng):
    P = random_covariance(rng)
    blocks = [draw(rng, P, (2000,)) for _ in range(12)]
    summary = filled(blocks, 2).summary()
    rows = []
    for block in blocks:
        U, mean = np.cov(block.T), block.mean(axis=0)
        d = np.sort(np.sqrt(np.einsum("ti,ij,tj->t", block - mean, np.linalg.inv(U), block - mean)))
        eigenvalue = np.linalg.eigvalsh(np.corrcoef(block.T))[-1]
        rows.append([*mean, *np.sqrt(np.diag(U)), eigenvalue, d[1900]])
        assert (d < d[1900]).sum() == 0.95 * 2000
    rows, whole = np.array(rows), np.concatenate(blocks)
    np.testing.assert_allclose(summary.spread, 2 * stats.sem(rows, axis=0), rtol=1e-7)
    expected = [*whole.mean(axis=0), *whole.std(axis=0, ddof=1), np.linalg.eigvalsh(np.corrcoef(whole.T))[-1]]
    np.testing.assert_allclose(summary.values[:13], expected, rtol=1e-7, atol=1e-12)
    assert summary.values[13] == pytest.approx(np.sqrt(stats.chi2.ppf(0.95, 6)), rel=0.02)
    tolerance = [numerical_tolerance(z, 2) for z in summary.values[6:]]
    np.testing.assert_allclose(summary.tolerance, [*tolerance[:6], *tolerance])  # y to the digits of u
    late = [name for name, a, b in zip(NAMES, summary.spread, summary.tolerance, strict=True) if a > b]
    assert list(summary.unstable) == late and summary.stable == (not late)


@pytest.mark.parametrize("digits", [1, 2])
def test_a_run_stops_and_its_numbers_are_as_good_as_asked(rng, digits):
    """Tolerances are 2 standard errors or more: most numbers are within, all within twice that."""
    P = random_covariance(rng)
    summary = until_stable(rng, P, digits, 150).summary()
    assert summary.stable and summary.reason == "" and summary.unstable == ()
    assert summary.blocks >= MIN_BLOCKS and summary.blocks_expected <= summary.blocks
    correlation = P / np.sqrt(np.outer(np.diag(P), np.diag(P)))
    truth = [*np.zeros(6), *np.sqrt(np.diag(P)), np.linalg.eigvalsh(correlation)[-1], np.sqrt(stats.chi2.ppf(0.95, 6))]
    off = np.abs(summary.values - truth) / summary.tolerance
    assert (off < 2).all() and (off < 1).mean() > 0.7


def test_no_stop_before_the_first_test_nor_with_few_trials(rng):
    P = random_covariance(rng)
    stability = Stability(1)
    assert not stability.stable and stability.summary().values is None
    for _ in range(1, MIN_BLOCKS):
        stability.add(draw(rng, P, (BLOCK_TRIALS,)), np.ones(BLOCK_TRIALS, bool))
        assert not stability.stable and f"{MIN_BLOCKS} are needed" in stability.summary().reason
    few = filled([draw(rng, P, (BLOCK_TRIALS,)) for _ in range(MIN_BLOCKS)], 4).summary()
    assert not few.stable and few.blocks_expected > 100 and "not to 4 digits yet" in few.reason


def test_one_digit_is_singular(rng):
    blocks = [(1 + 9 * (k % 2)) * draw(rng, np.eye(6), (500,)) for k in range(MIN_BLOCKS)]
    assert "not to 1 digit yet" in filled(blocks, np.int64(1)).summary().reason
    assert [str(Finding(STABLE, "note", {"digits": k})) for k in (1, 2)] == ["stable to 1 digit", "stable to 2 digits"]


@pytest.mark.slow
def test_numbers_that_drift_do_not_become_stable(rng):
    """A run whose spread grows from block to block never gets two digits, where a steady one does."""
    P = np.eye(6)
    steady = [draw(rng, P, (BLOCK_TRIALS,)) for _ in range(40)]
    assert filled(steady, 2).stable
    drifting = [block * (1 + 0.02 * k) for k, block in enumerate(steady)]
    summary = filled(drifting, 2).summary()
    assert not summary.stable and any("standard deviation" in name for name in summary.unstable)


def test_the_same_blocks_give_the_same_bits_and_failures_are_left_out(rng):
    P = random_covariance(rng)
    blocks = [draw(rng, P, (500,)) for _ in range(MIN_BLOCKS)]
    a, b = filled(blocks, 2).summary(), filled(blocks, 2).summary()
    assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
    failed, alone = Stability(2), Stability(2)
    for block in blocks:
        ok = np.arange(500) % 5 > 0
        failed.add(np.where(ok[:, None], block, np.nan), ok)
        alone.add(block[ok], np.ones(400, bool))
    assert all(np.array_equal(x, y) for x, y in zip(failed.summary(), alone.summary(), strict=True))


def test_blocks_without_estimates_are_never_stable(rng):
    stability = filled([draw(rng, np.eye(6), (BLOCK_TRIALS,)) for _ in range(20)], 1)
    assert stability.stable
    stability.add(np.zeros((BLOCK_TRIALS, 6)), np.zeros(BLOCK_TRIALS, bool))
    assert not stability.stable and f"fewer than {MIN_TRIALS} estimates" in stability.summary().reason
    alone = Stability(1)
    alone.add(np.zeros((10, 6)), np.zeros(10, bool))
    assert alone.summary().values is None and "1 of 1 blocks" in alone.summary().reason


def test_what_cannot_be_used_is_named(rng):
    for digits in (0, 5, 1.0, True, "2"):
        with pytest.raises(InputError, match="`digits`"):
            Stability(digits)
    stability = filled([draw(rng, np.eye(6), (500,))], 2)
    with pytest.raises(InputError, match="blocks of 500 trials"):
        stability.add(np.zeros((400, 6)), np.ones(400, bool))
    with pytest.raises(InputError, match="rotation about y"):
        stability.add(draw(rng, np.eye(6), (500,)) * [1, 0, 1, 1, 1, 1], np.ones(500, bool))
