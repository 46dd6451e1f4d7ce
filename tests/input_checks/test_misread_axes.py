"""Axes of one file that are negated, exchanged, scaled or sheared are named; good rigs have none."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.rigs import quietly
from fixtures.rigs_on_arms import rig
from support import SEED

import uq_handeye as uq
from uq_handeye.fit.diagnostics.misread_axes import misread_axes
from uq_handeye.fit.diagnostics.readings import in_words

NOISE = uq.PoseNoise.isotropic(robot=("0.03deg", "0.1mm"), camera=("0.1deg", "0.5mm"))
SETUPS = ("eye-in-hand", "eye-to-hand")
MISTAKES = {
    "x negated": np.diag([-1.0, 1, 1]),
    "z negated": np.diag([1.0, 1, -1]),
    "x and y negated": np.diag([-1.0, -1, 1]),
    "x and y exchanged": np.eye(3)[[1, 0, 2]],
    "y and z exchanged": np.eye(3)[[0, 2, 1]],
    "y scaled by 1.1": np.diag([1.0, 1.1, 1]),
    "z scaled by 0.8": np.diag([1.0, 1, 0.8]),
}


def _mistaken(poses, side, M):
    T = getattr(poses, side).copy()
    T[:, :3, 3] = T[:, :3, 3] @ M.T
    return replace(poses, **{side: T, "truth": None})


@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("side", ["camera", "robot"])
@pytest.mark.parametrize("words", MISTAKES)
def test_the_mistake_is_named(setup, side, words):
    poses = _mistaken(uq.simulate(20, setup=setup, noise=NOISE, seed=SEED), side, MISTAKES[words])
    found = misread_axes(poses)
    assert found is not None
    assert found["file"] == side
    said = in_words(found).full
    if "scaled" in words:
        axis, _, factor = words.partition(" scaled by ")
        assert found["scaled"] == axis and found["factor"] == pytest.approx(float(factor), rel=0.03)
    else:
        assert words.replace(" and ", "") in said.replace(" and ", "")


@pytest.mark.parametrize("side", ["camera", "robot"])
def test_a_scale_is_named_without_noise_and_with_much(side):
    for noise in (None, uq.PoseNoise.isotropic(robot=("0.1deg", "2mm"), camera=("0.2deg", "2mm"))):
        poses = _mistaken(uq.simulate(40, noise=noise, seed=SEED), side, MISTAKES["z scaled by 0.8"])
        found = misread_axes(poses)
        assert found is not None and (found["file"], found["scaled"]) == (side, "z")
        assert found["factor"] == pytest.approx(0.8, rel=1e-9 if noise is None else 0.05)


@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize(("moved", "along"), ["xz", "zx", "xy", "yz"])
@pytest.mark.parametrize("share", [0.02, -0.05])
def test_one_axis_of_the_robot_along_another_is_named(setup, moved, along, share):
    M = np.eye(3)
    M["xyz".index(moved), "xyz".index(along)] = share
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.05deg", "0.3mm"))
    found = misread_axes(_mistaken(uq.simulate(30, setup=setup, noise=noise, seed=SEED), "robot", M))
    assert found is not None and (found["file"], found["sheared"], found["along"]) == ("robot", moved, along)
    assert found["share"] == pytest.approx(share, rel=0.15)
    assert f"the robot translations have {moved} sheared by" in in_words(found).full


@pytest.mark.slow
def test_a_sheared_robot_is_said_and_a_good_one_is_not():
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.05deg", "0.3mm"))
    M = np.eye(3)
    for share, named in ((0.02, True), (0.0, False)):
        M[0, 2] = share
        result = quietly(_mistaken(uq.simulate(30, noise=noise, seed=SEED), "robot", M))
        assert any(one.code == "input_checks.misread_axes" for one in result.findings) == named


@pytest.mark.parametrize("setup", SETUPS)
def test_good_rigs_have_none(setup):
    for seed in range(40):
        assert misread_axes(uq.simulate(12 + seed % 9, setup=setup, noise=NOISE, seed=seed)) is None


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS)
def test_errors_of_an_arm_are_no_scale_of_an_axis(setup):
    """Joint offsets of 20 mrad: a matrix on the translations takes half of them, one scale does not."""
    sd = {"joint offsets": 2e-2, "joint tilts": 1e-2, "link lengths": 2e-3}
    drawn = [rig(np.random.default_rng([SEED, k]), setup, n=15, spread=0.6, sd=sd).poses for k in range(20)]
    assert [misread_axes(poses) for poses in drawn] == [None] * 20


@pytest.mark.slow
def test_the_result_is_not_usable_or_says_so():
    poses = uq.simulate(20, noise=NOISE, seed=SEED)
    for words in ("x negated", "x and y exchanged"):
        result = quietly(_mistaken(poses, "camera", MISTAKES[words]))
        assert not result.usable and words in result.headline
    result = quietly(_mistaken(poses, "camera", MISTAKES["y scaled by 1.1"]))
    assert any("y scaled by 1." in text for text in result.warnings)
