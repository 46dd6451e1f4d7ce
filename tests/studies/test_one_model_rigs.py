"""The simulator of the study one_model: its arms are as asked for, and its truth is what exact data give."""

import numpy as np
import pytest
from support import SEED

import uq_handeye as uq
from studies.one_model.chains import ARMS, branch, chain, inverse_kinematics, urdf
from studies.one_model.measure import COLUMNS, LISTS, Cell, scored, summary
from studies.one_model.rigs import SETUPS, SIMPLE, SPREADS, arm_set, inverse, simple_set
from studies.one_model.true_arms import aligned, drawn_arm, exponential, left_errors, rms_length
from studies.one_model.views import drawn_camera, drawn_views

pytestmark = pytest.mark.slow

EXACT = {"intrinsics": "exact", "corner_noise": 0.0, "repeatable": False}


@pytest.mark.parametrize("name", ARMS)
def test_the_urdf_has_the_same_forward_kinematics(name, rng):
    of = chain(name)
    kinematics = uq.Kinematics.from_urdf(urdf(of))
    q = of.workspace(50, rng)
    np.testing.assert_allclose(of.poses(q), kinematics.poses(q), atol=1e-12)
    np.testing.assert_allclose(of.limits, kinematics.limits)
    assert ((of.home > of.limits[:, 0]) & (of.home < of.limits[:, 1])).all()
    assert of.poses(of.home[None])[0, 2, 2] < -0.9, "at home the flange looks down"


@pytest.mark.parametrize("name", ARMS)
def test_inverse_kinematics_reach_what_they_say(name, rng):
    of = chain(name)
    q = of.home + rng.uniform(-0.1, 0.1, (20, of.n_joints))
    found, reached = inverse_kinematics(of, of.poses(q), np.tile(of.home, (20, 1)))
    assert reached.mean() > 0.9
    np.testing.assert_allclose(of.poses(found[reached]), of.poses(q[reached]), atol=1e-8)
    if of.n_joints == 6:
        np.testing.assert_allclose(found[reached], q[reached], atol=1e-6)
        np.testing.assert_array_equal(
            branch(of, found[reached]), np.tile(branch(of, of.home[None]), (reached.sum(), 1))
        )


@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("spread", SPREADS)
def test_without_errors_the_truth_is_exact(setup, spread, rng):
    """To 0.1 um, where the pose from exact corners ends in either version of OpenCV."""
    of = arm_set("ur5", 0.0, rng, n=12, setup=setup, spread=spread, **EXACT)
    robot = of.poses.robot if setup == "eye-in-hand" else inverse(of.poses.robot)
    np.testing.assert_allclose(robot @ of.X_true @ of.poses.camera, np.tile(of.W_true, (12, 1, 1)), atol=1e-7)
    motions = uq.relative_motions(of.poses)
    X = uq.solve(motions.A, motions.B, method="park")
    assert np.abs(left_errors(X, of.X_true)).max() < 1e-7
    assert of.near is not None and of.far is not None
    np.testing.assert_allclose(of.far.seen, of.far.true_camera, atol=1e-7)


@pytest.mark.parametrize("name", ["irb120", "panda"])
@pytest.mark.parametrize("accuracy", [0.15e-3, 2e-3])
def test_arms_have_the_accuracy_asked_for(name, accuracy, rng):
    """Over other postures than those that the errors were scaled on, and with the frames found there."""
    arm, A, B = drawn_arm(chain(name), accuracy, rng)
    q = chain(name).workspace(2000, rng)
    true, nominal = arm.poses(q), chain(name).poses(q)
    left = rms_length((true - A @ nominal @ B)[:, :3, 3])
    assert left == pytest.approx(accuracy, rel=0.15)
    assert aligned(true, nominal)[2] == pytest.approx(left, rel=0.05)
    shaken = rms_length((arm.poses(q, rng) - true)[:, :3, 3])
    assert 0.015e-3 < shaken < 0.06e-3


def test_errors_that_frames_take_up_are_no_errors(rng):
    nominal = chain("irb120").poses(chain("irb120").workspace(100, rng))
    A, B = (exponential(0.01 * rng.standard_normal(6)) for _ in range(2))
    found_A, found_B, left = aligned(A @ nominal @ B, nominal)
    assert left < 1e-6
    np.testing.assert_allclose(found_A, A, atol=1e-6)
    np.testing.assert_allclose(found_B, B, atol=1e-6)


@pytest.mark.parametrize("setup", SETUPS)
def test_X_is_that_of_the_aligned_frames(setup, rng):
    """The chain of nominal poses and true views closes to the accuracy and the lever of its angle."""
    of = arm_set("lrmate200id", 0.6e-3, rng, n=40, setup=setup, spread="anywhere", **EXACT)
    robot = of.poses.robot if setup == "eye-in-hand" else inverse(of.poses.robot)
    off = left_errors(robot @ of.X_true @ of.true_camera, np.tile(of.W_true, (40, 1, 1)))
    assert 0.1e-3 < rms_length(off[:, 3:]) < 3e-3


def test_a_sag_hangs_on_the_weights(rng):
    arm, _, _ = drawn_arm(chain("ur5"), 0.6e-3, rng)
    q = np.tile(chain("ur5").home, (2, 1))
    q[1, 0] += 1.0  # about the vertical
    own = arm.moved(q) - q
    np.testing.assert_allclose(own[0, 1:], own[1, 1:], atol=1e-12)
    assert abs(own[0, 0] - own[1, 0]) > 1e-6  # its harmonics


def test_views_are_as_asked_for(rng):
    camera = drawn_camera(rng)
    views = drawn_views(camera, 200, rng, tilt=0.4, roll=0.3, distance=(0.4, 0.5), part=0.3)
    assert camera.sees(views).mean() > 0.9
    middle = views[:, :3, :3] @ [0.0875, 0.0625, 0.0] + views[:, :3, 3]
    distance = np.linalg.norm(middle, axis=1)
    assert distance.min() > 0.4 - 1e-12 and distance.max() < 0.5 + 1e-12
    cos = np.sum(middle / distance[:, None] * views[:, :3, 2], axis=1)
    assert np.arccos(cos).max() < 0.4 + 1e-9


@pytest.mark.parametrize("kind", SIMPLE)
@pytest.mark.parametrize("setup", SETUPS)
def test_rigs_without_an_arm(kind, setup, rng):
    of = simple_set(kind, rng, n=40, setup=setup)
    robot = of.poses.robot if setup == "eye-in-hand" else inverse(of.poses.robot)
    off = left_errors(robot @ of.X_true @ of.poses.camera, np.tile(of.W_true, (40, 1, 1)))
    assert 0.0 < rms_length(off[:, 3:]) < 0.03
    assert (of.poses.timestamps is not None) == (kind == "drift")
    assert of.poses.truth is None


def test_sets_depend_on_the_cell_and_not_on_what_is_told():
    a, b = Cell.parse("0.6,local,12,six"), Cell.parse("six,urdf,12,local,0.6mm")
    assert a.sets == b.sets and str(b) == f"{a}, urdf"
    assert Cell.parse("wrong_focal,15") == Cell("wrong_focal", n=15)
    assert len(set(map(str, LISTS["all"]))) == len(LISTS["all"])
    with pytest.raises(ValueError, match="nowhere"):
        Cell.parse("nowhere,30")


def test_failed_sets_are_counted(monkeypatch):
    cell = Cell("white", n=10)
    good = scored(cell, SEED)

    def refuse(*args, **options):
        raise uq.NotConvergedError("no")

    monkeypatch.setattr(uq, "calibrate", refuse)
    bad = scored(cell, SEED)
    assert bad["failed"] == "NotConvergedError: no"
    line = dict(zip(COLUMNS, summary(cell, [good, bad]), strict=True))
    assert line["sets"] == "2" and line["failed"] == "1"
    assert float(line["mean d²"]) == pytest.approx(good["d2"], abs=0.06)
    assert summary(cell, [bad])[4] == "-"
