"""Tests of touches: false alarms, power, and what a tool hides."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.touches import ROBOT, TIP, calibration, touches
from scipy.stats import chi2, kstest, ncx2
from support import SEED

import uq_handeye as uq
from uq_handeye.calibration.evidence.touches import evidence_of_touches
from uq_handeye.use.verification.power import (
    bias_of,
    level_of_each,
    limit,
    touches_needed,
)

SETUPS = ("eye-in-hand", "eye-to-hand")
SETS = 30


@pytest.mark.statistical
@pytest.mark.parametrize("setup", SETUPS)
def test_p_values_are_uniform_and_a_bias_is_found(setup):
    """Each set has a calibration of its own; half of the standard deviations are rejected."""
    rng = np.random.default_rng(SEED)
    found, wrong, power = [], [], []
    for k in range(SETS):
        result = calibration(setup, rng)
        tool = {"tool": TIP, "tool_sd": 3e-4, "tool_error": rng.normal(size=3) * 3e-4} if k % 2 else {}
        case = touches(setup, rng, **tool)
        evidence = evidence_of_touches(result, case)
        tested = bias_of(evidence)
        found.append(tested.p_value)
        half = replace(evidence, own=evidence.own / 4, by_unit=evidence.by_unit / 2)
        wrong.append(bias_of(half).p_value)
        size = tested.detectable(tested.level)
        moved = replace(evidence, r=evidence.r + size * tested.worst[1])
        power.append(bias_of(moved).p_values[0] < tested.level)
    assert kstest(found, "uniform").pvalue > 1e-3
    assert kstest(wrong, "uniform").pvalue < 1e-6
    assert abs(np.mean(power) - 0.95) < 4 * np.sqrt(0.95 * 0.05 / SETS)


@pytest.mark.slow
def test_bias_and_scatter_add_to_the_whole():
    rng = np.random.default_rng(SEED)
    evidence = evidence_of_touches(calibration("eye-in-hand", rng), touches("eye-in-hand", rng))
    found = bias_of(evidence)
    assert found.d2 + found.rest == pytest.approx(evidence.d2)
    assert (found.dof, found.dof_rest) == (3, 21)
    by_hand = evidence.explained_by(np.broadcast_to(np.eye(3), (8, 3, 3)))
    np.testing.assert_allclose(found.estimate, by_hand.estimate)
    np.testing.assert_allclose(found.covariance, by_hand.covariance)
    assert found.d2 == pytest.approx(by_hand.gain)


@pytest.mark.statistical
def test_a_bias_of_known_noise_shows_by_the_noncentral_chi_square():
    rng = np.random.default_rng(SEED)
    evidence = evidence_of_touches(calibration("eye-in-hand", rng), touches("eye-in-hand", rng))
    level = level_of_each(2)
    size = (bias_of(evidence).detectable(level) / bias_of(evidence).worst[0]) ** 2
    assert ncx2.sf(chi2.isf(level, 3), 3, size) == pytest.approx(0.95)


def test_touches_needed_reach_the_size_and_no_number_passes_the_limit():
    rng = np.random.default_rng(SEED)
    evidence = evidence_of_touches(calibration("eye-to-hand", rng), touches("eye-to-hand", rng))
    level = level_of_each(2)
    least = limit(evidence, True, level)
    n = touches_needed(evidence, True, 1.2 * least, level)
    assert n is not None and n > 1
    sizes = [bias_of(evidence.repeated(k / 8)).detectable(level) for k in (n - 1, n)]
    assert sizes[1] <= 1.2 * least < sizes[0]
    assert touches_needed(evidence, True, 0.9 * least, level) is None


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS)
def test_an_unknown_tool_is_estimated_where_orientations_differ(setup):
    rng = np.random.default_rng(SEED)
    result = calibration(setup, rng)
    error = np.array([3e-3, -2e-3, 1e-3])
    case = touches(setup, rng, 12, tool=TIP, tool_sd=np.inf, tool_error=error)
    found = uq.verify(result, case)
    assert not found.contradicted and np.isfinite(found.std).all()
    assert (np.abs(found.tool - error) < 4 * found.tool_std).all() and (found.tool_std < 1e-3).all()
    assert uq.verify(result, touches(setup, rng, 12, tool=TIP, tool_error=error)).contradicted


def test_an_unknown_tool_hides_the_bias_of_points():
    rng = np.random.default_rng(SEED)
    result = calibration("eye-to-hand", rng)
    case = touches("eye-to-hand", rng, bias=(0.01, 0, 0))
    hidden = replace(case, tool_sd=np.inf)
    found = uq.verify(result, hidden)
    assert found.bias_p_value is None and not found.contradicted and found.dof == 21
    assert np.isinf(np.diag(found.covariance)).all() and found.needed[0].touches is None
    assert [one.code for one in found.findings] == ["verification.tool_hides_bias"]
    assert uq.verify(result, case).contradicted
    prior = uq.verify(result, replace(case, tool_sd=0.02))
    assert not prior.contradicted and (prior.std > 0.019).all()


@pytest.mark.statistical
def test_estimated_noise_widens_the_distribution():
    rng = np.random.default_rng(SEED)
    result = calibration("eye-to-hand", rng, noise=None)
    found = uq.verify(result, touches("eye-to-hand", rng))
    assert found.noise_dof is not None and 5 < found.noise_dof < 1e4
    evidence = evidence_of_touches(result, touches("eye-to-hand", rng, bias=(0, 0, 2e-3)))
    bias = bias_of(evidence)
    assert bias.p_values[0] > chi2.sf(bias.d2, 3)


def test_the_noise_of_a_view_is_shared_by_its_points():
    """Ten points of one view tell no more of the robot's noise than its one pose."""
    rng = np.random.default_rng(SEED)
    result = calibration("eye-in-hand", rng)
    case = touches("eye-in-hand", rng, 12)
    one = replace(case, robot=np.broadcast_to(case.robot[:1], (12, 4, 4)))
    loud = np.diag(np.repeat([1e-9, 1e-3], 3) ** 2)
    sd = [
        np.sqrt(np.diag(bias_of(evidence_of_touches(result, replace(of, robot_noise=loud))).covariance))
        for of in (case, one)
    ]
    assert (sd[1] > 1e-3).all() and (sd[0] < 0.75 * sd[1]).all()


def test_stated_deviations_are_read():
    rng = np.random.default_rng(SEED)
    result = calibration("eye-in-hand", rng)
    case = touches("eye-in-hand", rng)
    by_text = uq.verify(
        result, case.seen, case.touched, robot=case.robot, touch_sd="0.2mm", point_sd="0.3mm", robot_noise=ROBOT
    )
    assert by_text.p_value == pytest.approx(uq.verify(result, case).p_value)
