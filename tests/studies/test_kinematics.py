"""The simulated arms are wrong by what the study says, and touches are judged by the derivatives of their model."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import uq_handeye as uq
from studies.common.scores import errors
from studies.kinematics import COBOT, INDUSTRIAL, SETUPS, declared, means
from studies.kinematics.arms import ARMS, Unmodelled, arm, drawn_errors, drawn_rig, local_joints, workspace_joints
from studies.kinematics.findings import findings
from studies.kinematics.real_sets import Recorded, subsets
from studies.kinematics.touches import Touches, fitted, nominal
from uq_handeye.core.geometry.se3 import inverse

pytestmark = pytest.mark.slow


def rig(name, setup, seed=1):
    rng = np.random.default_rng(seed)
    return drawn_rig(name, setup, INDUSTRIAL, rng, joint_sd=0.0, camera_sd=np.zeros(6)), rng


@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("name", ARMS)
def test_the_poses_are_those_of_the_rig(name, setup):
    of, rng = rig(name, setup)
    q = local_joints(of, name, 6, rng)
    assert ((q >= of.kinematics.limits[:, 0]) & (q <= of.kinematics.limits[:, 1])).all()
    poses = of.poses(q, rng)
    G = of.kinematics.poses(q, of.e)
    closed = (G if setup == "eye-in-hand" else inverse(G)) @ of.X @ poses.camera
    np.testing.assert_allclose(closed, np.broadcast_to(of.W, closed.shape), atol=1e-9)
    np.testing.assert_allclose(poses.robot, of.kinematics.poses(q))
    assert 1e-3 < np.abs(poses.robot - G)[:, :3, 3].max() < 0.05  # what the URDF does not know
    seen = poses.camera[:, :3, 3]
    assert np.ptp(seen, axis=0).max() < 0.35 and seen[:, 2].min() > 0.2


@pytest.mark.parametrize("name", ARMS)
def test_what_X_and_W_absorb_are_constant_factors(name):
    of, rng = rig(name, "eye-in-hand")
    q = workspace_joints(of.kinematics, 20, rng)
    A, B = of.gauge
    kept = np.where([error.gauge for error in of.errors], 0.0, of.e)
    left = errors(A @ of.kinematics.poses(q, kept) @ B, of.kinematics.poses(q, of.e))
    assert np.abs(left).max() < 1e-4  # products of two errors
    assert np.abs(errors(B, np.eye(4))).max() > 3e-4


def test_errors_have_the_scale_of_their_group():
    kinematics = arm("panda_like")
    many = np.array([drawn_errors(kinematics, COBOT, np.random.default_rng(k)) for k in range(200)])
    for group, sd in COBOT.items():
        of = many[:, [error.group == group for error in kinematics.errors]]
        assert np.std(of) == pytest.approx(sd, rel=5 / np.sqrt(2 * of.size))
    smooth = [Unmodelled.drawn(6, 1e-3, np.random.default_rng(k)) for k in range(50)]
    q = np.random.default_rng(2).uniform(-np.pi, np.pi, (200, 6))
    assert np.std([of.at(q) for of in smooth]) == pytest.approx(1e-3, rel=0.15)


def test_declared_scales_are_those_of_the_groups():
    said = declared(COBOT).standard_deviations
    assert {group: sd for group, sd in said.items() if sd} == COBOT


def test_subsets_hold_out_all_other_rows():
    of, rng = rig("ur5_like", "eye-in-hand")
    q = workspace_joints(of.kinematics, 30, rng)
    real = Recorded(of.kinematics, q, of.seen(q, rng), "eye-in-hand")
    for where in ("local", "anywhere"):
        for chosen, others in subsets(real, where, 8, 3, rng):
            assert len(chosen) == 8 and sorted([*chosen, *others]) == list(range(30))


def touched(rng, n=60, joint_sd=0.0):
    """Joints with which a ball sits in one of three sockets, by an arm with errors."""
    of, _ = rig("panda_like", "eye-in-hand")
    ball, starts = np.array([0.01, -0.005, 0.03]), workspace_joints(of.kinematics, 3, rng)
    sockets = (of.kinematics.poses(starts, of.e) @ np.append(ball, 1.0))[:, :3]
    numbers = np.arange(n) % 3
    q = starts[numbers] + 0.4 * rng.standard_normal((n, 7))
    for _ in range(30):
        T = of.kinematics.poses(q, of.e)
        lever = T[:, :3, :3] @ ball
        J = of.kinematics.jacobian(q, of.e)
        by = J[:, 3:] + np.cross(J[:, :3].mT, lever[:, None]).mT
        off = sockets[numbers] - lever - T[:, :3, 3]
        q = q + np.clip((np.linalg.pinv(by) @ off[..., None])[..., 0], -0.2, 0.2)
    names = np.array(["a/0", "b/0", "c/0"])[numbers]
    return of, ball, sockets, Touches(q + joint_sd * rng.standard_normal(q.shape), names, names)


def test_touches_of_an_exact_model_have_no_residuals():
    of, ball, sockets, touches = touched(np.random.default_rng(4))
    plain = nominal(of.kinematics, touches)
    exact = replace(plain, kept=np.arange(len(of.e)), e=of.e, ball=ball, sockets=sockets)
    exact = replace(exact, covariance=np.zeros((12 + len(of.e),) * 2))
    assert np.abs(exact.known(touches)[0]).max() < 1e-8
    assert np.abs(exact.new(touches)[0]).max() < 1e-8
    assert np.abs(plain.known(touches)[0]).max() > 1e-4
    # derivatives by ball, sockets and errors
    A, r, _ = exact.rows(touches)
    step = 1e-6 * np.random.default_rng(5).standard_normal(A.shape[-1])
    moved = replace(exact, ball=ball + step[:3], sockets=sockets + step[3:12].reshape(3, 3), e=of.e + step[12:])
    np.testing.assert_allclose(moved.rows(touches)[1] - r, A @ step, atol=1e-10)


def test_errors_of_an_arm_are_found_from_touches():
    rng = np.random.default_rng(6)
    of, _, _, touches = touched(rng, 90, joint_sd=1e-4)
    train, test = touches.rows(np.arange(60)), touches.rows(np.arange(60, 90))
    errors_of_arm = uq.KinematicErrors(robot_class="industrial")
    found, plain = fitted(of.kinematics, train, errors_of_arm), nominal(of.kinematics, train)
    (r, S), off = found.known(test), plain.known(test)[0]
    assert np.sqrt(np.mean(r**2)) < 0.5 * np.sqrt(np.mean(off**2))
    d2 = np.einsum("ni,nij,nj->n", r, np.linalg.inv(S), r)
    assert 0.4 < np.mean(d2) / 3 < 2.0


def test_the_findings_count_what_is_refused():
    line = {f"{place}: {what}": 0.5 for place in ("near", "far") for what in ("inside", "mm", "mean inside", "d2/6")}
    line |= {"X: d2": 6.0, "X: inside": 0.9, "X: mm": 1.0, "refused": 0.0}
    line |= {f"{name}: {what}": 1.0 for name in ("controller's", "physical") for what in ("d2", "inside")}
    of = means([line, {"refused": 1.0}])
    assert of["sets"] == 2 and of["refused"] == 1 and of["X: d2"] == 6.0
    ways = ("declared", "estimated", "no joints")
    tables = {
        "simulated": pd.DataFrame([{"arm": "ur5_like", "setup": SETUPS[0], "way": way, **of} for way in ways]),
        "flange": pd.DataFrame([{"arm": "ur5_like", "setup": SETUPS[0], "flange": "physical", **of}]),
        "population": pd.DataFrame([{"poses": 15, "where": "local", "way": "estimated", **of}]),
    }
    assert "in no mean: 5 of 10 fits" in findings(tables)
