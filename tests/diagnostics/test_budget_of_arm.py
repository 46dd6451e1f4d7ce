"""Sources of a calibration with joints: noise of the joints, groups of errors of the arm, their types."""

import json

import numpy as np
import pytest
from fixtures.arms import SIX_AXES, measured
from fixtures.rigs import quietly
from support import SEED

import uq_handeye as uq
from uq_handeye.calibration.result import Calibration
from uq_handeye.fit.diagnostics.budget import budget as budget_of

GROUPS = ["joint offsets", "joint tilts", "link lengths", "transmission", "sag"]
ERRORS = uq.KinematicErrors("declared", robot_class="industrial", joint_sd=3e-4)
CAMERA = (5e-4, 1e-4)


@pytest.fixture(scope="module")
def arm():
    return uq.Kinematics.from_urdf(SIX_AXES, base="base_link", tip="tool0")


@pytest.fixture(scope="module")
def poses(arm):
    rng = np.random.default_rng(SEED)
    sd = np.array([ERRORS.standard_deviations[error.group] for error in arm.errors])
    return measured(arm, rng, e=sd * rng.normal(size=len(sd)), joint_sd=3e-4, camera=CAMERA)[0]


@pytest.fixture(scope="module")
def declared(arm, poses):
    noise = uq.PoseNoise(robot=np.diag([1e-5] * 3 + [2e-5] * 3) ** 2, camera=np.diag(np.repeat(CAMERA, 3)) ** 2)
    return quietly(poses, noise=noise, kinematics=arm, kinematic_errors=ERRORS, robust=False)


@pytest.fixture(scope="module")
def estimated(arm, poses):
    return quietly(poses, kinematics=arm, shared=[], robust=False, correlation="none")


@pytest.mark.slow
def test_noise_of_the_joints_is_a_source_of_its_own(declared):
    budget = declared.budget
    own = ["robot rotation", "robot translation"]
    assert list(budget.sources) == [*own, "joint noise", *GROUPS, "camera rotation", "camera translation"]
    assert set(budget.types) == {"B"}
    np.testing.assert_allclose(budget.covariance[:6, :6], declared.covariance, rtol=1e-9, atol=1e-18)
    assert (budget.standard["X translation"] > 0).all()


@pytest.mark.slow
def test_without_its_source_joint_noise_is_missing_from_the_sum(declared):
    budget = declared.budget
    alone = budget_of(declared.analysis.fit, declared.noise)
    k = budget.sources.index("joint noise")
    together = budget.covariances[:3].sum(axis=0)
    merged = [name for name in alone.sources if name.startswith("robot")]
    assert merged == ["robot rotation", "robot translation", "robot coupling"]
    np.testing.assert_allclose(together, alone.covariances[:3].sum(axis=0), rtol=1e-9, atol=1e-20)
    assert np.diag(budget.covariances[k])[3:6].sum() > 10 * np.diag(budget.covariances[:2].sum(axis=0))[3:6].sum()


@pytest.mark.slow
def test_types_say_where_a_deviation_comes_from(estimated):
    budget = estimated.budget
    types = dict(zip(budget.sources, budget.types, strict=True))
    of_data = ("joint noise", "camera rotation", "camera translation")
    assert {name: types[name] for name in GROUPS} == dict.fromkeys(GROUPS, "A, B")
    assert {types[name] for name in of_data} <= {"A", "B"} and types["camera rotation"] == "A"
    np.testing.assert_allclose(budget.covariance[:6, :6], estimated.covariance, rtol=1e-6, atol=1e-16)


def test_joints_of_an_exact_arm_are_their_noise(arm, poses):
    errors = uq.KinematicErrors("exact", joint_sd=3e-4)
    noise = uq.PoseNoise(camera=np.diag(np.repeat(CAMERA, 3)) ** 2)
    budget = quietly(poses, noise=noise, kinematics=arm, kinematic_errors=errors, robust=False).budget
    assert budget.sources == ("joint noise", "camera rotation", "camera translation")


@pytest.mark.slow
def test_it_comes_back_from_the_file(estimated, tmp_path):
    estimated.to_json(tmp_path / "result.json")
    stored = Calibration.from_json(tmp_path / "result.json")
    assert stored.budget.sources == estimated.budget.sources and stored.budget.types == estimated.budget.types
    json.dumps(estimated.budget.to_dict())
    assert "joint noise" in stored.summary(verbose=True)
