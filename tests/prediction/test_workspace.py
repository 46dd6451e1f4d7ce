"""Misses over the workspace: the tool is where it is said to be, radii are those of predict, both setups, no arm."""

import numpy as np
import pytest
from fixtures.arms import SIX_AXES, measured, transform
from fixtures.rigs import quietly
from support import SEED

import uq_handeye as uq
from uq_handeye.calibration.prediction.workspace import WorkspacePrediction, brought_to, ends, over_workspace
from uq_handeye.calibration.report.arm import arm_sentences
from uq_handeye.calibration.report.workspace_figure import workspace_figure
from uq_handeye.core.presentation.ellipses import render
from uq_handeye.report.figures import pictures

ARM = uq.Kinematics.from_urdf(SIX_AXES, base="base_link", tip="tool0")
ERRORS = uq.KinematicErrors("declared", robot_class="cobot", joint_sd=2e-4)
CAMERA = (4e-4, 1e-4)


def calibrated(setup="eye-in-hand", errors=ERRORS, near=0.3):
    rng = np.random.default_rng(SEED)
    sd = np.array([0.0 if part.gauge else ERRORS.standard_deviations[part.group] for part in ARM.errors])
    centre = np.array([0.2, -0.5, 0.9, 0.3, 0.9, 0.2])
    q = centre + rng.uniform(-near, near, (20, 6))
    X, view = transform([0.1, -0.2, 0.7], [0.04, -0.02, 0.05]), transform([0.0, 0.0, 0.0], [0.01, 0.02, 0.2])
    G = ARM.poses(centre)
    X = X if setup == "eye-in-hand" else G @ transform([1.0, 2.0, 0.0], [0.3, -0.2, 0.5])
    W = (G if setup == "eye-in-hand" else np.linalg.inv(G)) @ X @ view
    e = sd * rng.normal(size=len(sd))
    poses, _, _ = measured(ARM, rng, q=q, e=e, setup=setup, camera=CAMERA, X=X, W=W)
    noise = uq.PoseNoise(camera=np.diag(np.repeat(CAMERA, 3)) ** 2)
    more = {} if errors is None else {"kinematics": ARM, "kinematic_errors": errors}
    return quietly(poses, noise=noise, robust=False, correlation="none", **more)


@pytest.fixture(scope="module", params=["eye-in-hand", "eye-to-hand"])
def result(request):
    return calibrated(request.param)


@pytest.mark.slow
def test_far_from_the_calibrated_poses_the_tool_misses_by_more(result):
    found = result.over_workspace
    assert found is result.over_workspace  # computed once
    assert len(found.near_radius_95) > 5 and len(found.radius_95) > 100
    assert (found.place[:, 0] >= 0).all() and np.ptp(found.place[:, 1]) > 0.4
    assert found.anywhere > 1.2 * found.near > 0
    assert np.median(found.radius_95[found.away > 0.3]) > np.median(found.near_radius_95)
    # Of a ball that holds 95 % of each, more than 95 % of all are inside: the ellipsoids are no balls.
    assert found.radius_95.min() / 2 < found.anywhere < found.radius_95.max()
    assert found.nominal > 1e-4


@pytest.mark.slow
def test_radii_are_those_of_predict():
    result = calibrated()
    q = result.kinematics.joints[:6]
    X = result.X
    distance = result.over_workspace.distance
    in_flange = X[:3, :3] @ [0, 0, distance] + X[:3, 3]
    G = result.kinematics.poses(q)
    goal = G[:, :3, :3] @ in_flange + G[:, :3, 3]
    low, high = ends(result.kinematics)
    there, arrived = brought_to(result.kinematics, q, goal)
    assert arrived.any() and ((there >= low) & (there <= high)).all()
    at = result.predict([0, 0, distance], q, reached_at=there)
    np.testing.assert_allclose(at.points[arrived], 0.0, atol=2e-4)
    radius = at.radius_95[arrived]
    np.testing.assert_allclose(result.over_workspace.near_radius_95[: len(radius)], radius, rtol=1e-9)


@pytest.mark.slow
def test_words(result, tmp_path, without_rendering):
    said = " ".join(arm_sentences(result))
    assert "anywhere in the workspace" in said and "near the calibrated poses" in said
    assert ("from" in said.split("A point that the camera sees")[1].split(",")[0]) == (result.setup == "eye-in-hand")
    assert "frame of the controller" in said and "With nominal poses" in said
    assert "The arm:" in result.summary(verbose=True) and "wrong robot kinematics" not in result.summary()
    assert "anywhere in the workspace" in result._repr_html_()
    page = result.report(tmp_path / "report.html", comparison=False).read_text()
    assert page.index('id="full"') < page.index('id="arm"') < page.index('id="ellipses"')


@pytest.mark.slow
def test_figure(result):
    assert "workspace" in pictures(result, only=["workspace"])
    assert render(workspace_figure(result.over_workspace), "svg") == render(
        workspace_figure(over_workspace(result, result.over_workspace.distance)), "svg"
    )


@pytest.mark.slow
def test_without_an_arm_there_is_none():
    plain = calibrated(errors=None, near=1.5)
    assert plain.over_workspace is None and arm_sentences(plain) == []
    exact = calibrated(errors=uq.KinematicErrors("exact"), near=1.5)
    said = " ".join(arm_sentences(exact))
    assert exact.kinematics is None or ("taken as exact" in said and "With nominal poses" not in said)


@pytest.mark.slow
def test_the_physical_flange_is_said():
    said = " ".join(arm_sentences(calibrated(errors=uq.KinematicErrors("declared", joint_sd=2e-4, flange="physical"))))
    assert "machined" in said and "frame of the controller" not in said


@pytest.mark.slow
def test_a_turntable_whose_flange_stays_where_it_is_is_drawn():
    k = np.full(40, 1e-3)
    found = WorkspacePrediction(
        0.4, np.full((40, 2), 0.3), k, 0 * k, 0 * k, np.full((5, 2), 0.3), k[:5], k[:5], 1e-3, None
    )
    assert render(workspace_figure(found), "png")
