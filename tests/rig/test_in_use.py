"""A rig in use: check, predict, plan, update."""

import itertools
import os
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2

import uq_handeye as uq
from studies.maintenance.moved_commands import arm_rigs, arm_sessions
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.core.geometry.se3 import inverse, perturb
from uq_handeye.model.shared_errors.shared_error import SharedError
from uq_handeye.trials.simulation.several_cameras import simulate_rig, with_noise
from uq_handeye.use.maintenance.check_result import ChangeCheck
from uq_handeye.use.maintenance.check_text import cause_in_words
from uq_handeye.use.maintenance.update_views import update_rig

SEED = int(os.environ.get("UQ_HANDEYE_SEED", "0"))
SIZE = ("0.5mrad", "0.3mm")
HAND = ({"left": "arm", "right": "arm"}, {"board": "world"})


def noise_of(rig):
    return dict.fromkeys((*rig.arms, *rig.cameras), SIZE)


def some(rig, kept):
    """Return a rig with some of its views, (E,) in their order."""
    parts = np.split(kept, np.cumsum([len(view.poses) for view in rig.views])[:-1])
    views = [
        replace(view, poses=view.poses[of], at=tuple(np.array(view.at)[of].tolist()))
        for view, of in zip(rig.views, parts, strict=True) if of.any()
    ]  # fmt: skip
    return replace(rig, views=tuple(views))


def split(exact, first):
    """Return the moments below ``first`` and the others as two rigs."""
    at = np.concatenate([view.at for view in exact.views])
    return some(exact, at < first), some(exact, at >= first)


def drawn(places, n, first, seed, arms=("arm",)):
    exact, truth = simulate_rig(*places, arms=arms, n_poses=n, seed=7)
    old, new = split(exact, first)
    noise = noise_of(exact)
    return with_noise(old, noise, [SEED, seed, 0]), with_noise(new, noise, [SEED, seed, 1]), truth, noise


@pytest.mark.statistical
def test_new_views_agree_as_often_as_the_level_says():
    p, alarms = [], 0
    for k in range(60):
        old, new, _, noise = drawn(HAND, 30, 20, k)
        found = uq.check(calibrate_rig(old, noise, robust=False), new)
        p.append(found.p_value)
        alarms += found.changed
    assert binom.cdf(sum(value < 0.05 for value in p), 60, 0.05) < 0.999
    assert binom.cdf(alarms, 60, 0.05) < 0.999  # of all views and of each move together
    assert chi2.sf(-2 * np.log(p).sum(), 120) > 1e-4  # not too small
    assert chi2.cdf(-2 * np.log(p).sum(), 120) > 1e-4  # not too large


@pytest.mark.statistical
def test_estimated_noise_is_covered():
    p = [
        uq.check(calibrate_rig(old), new).p_value for old, new, *_ in (drawn(HAND, 40, 30, 100 + k) for k in range(25))
    ]
    assert binom.cdf(sum(value < 0.05 for value in p), 25, 0.05) < 0.999
    assert abs(np.mean(p) - 0.5) < 4 / np.sqrt(12 * 25)  # nor is it far too careful


@pytest.mark.slow
@pytest.mark.parametrize("name", ["left", "right", "board"])
def test_the_pose_that_moved_is_named(name):
    exact, truth = simulate_rig(
        {"left": "arm", "right": "arm"}, {"board": "world", "second": "world"}, n_poses=40, seed=7
    )
    old, new = split(exact, 30)
    noise = noise_of(exact)
    move = perturb(truth[name], np.array([4e-3, 0, 0, 0, 3e-3, 0]))
    views = []
    for view in new.views:
        C = view.poses
        if view.camera == name:
            C = inverse(move) @ truth[name] @ C
        if view.target == name:
            C = C @ inverse(truth[name]) @ move
        views.append(uq.View(view.camera, view.target, C, view.at))
    new = uq.Rig(new.arms, new.cameras, new.targets, views)
    result = calibrate_rig(with_noise(old, noise, [SEED, 1]), noise)
    found = uq.check(result, with_noise(new, noise, [SEED, 2]))
    assert found.changed and found.cause == found.moves[0].name == name
    assert found.moves[0].angle == pytest.approx(4e-3, abs=1.5e-3)
    assert found.moves[0].shift == pytest.approx(3e-3, abs=1.5e-3)
    assert f"Cause: {name} moved" in str(found) and str(ChangeCheck.from_dict(found.to_dict())) == str(found)


def changed_views(change, name, seed):
    """Return the result of a rig, and new views after a change of one of its parts: 2 mm, 1 % or one wrong view."""
    exact, truth = simulate_rig(*HAND, n_poses=40, seed=7)
    old, new = split(exact, 30)
    noise, views = noise_of(exact), []
    for k, view in enumerate(new.views):
        C = view.poses.copy()
        if view.camera == name and change == "X":
            C = inverse(perturb(truth[name], np.array([0, 0, 0, 0, 0, 2e-3]))) @ truth[name] @ C
        if view.camera == name and change == "focal length":
            poses = uq.PosePairs(np.broadcast_to(np.eye(4), C.shape), C, "eye-in-hand")
            C = perturb(C, 0.01 * SharedError.focal_length(1.0).at(poses)[..., 0])
        if change == "target size":
            C[:, :3, 3] *= 1.01
        if change == "one pose" and k == 0:
            C[4, :3, 3] += 0.02
        views.append(uq.View(view.camera, view.target, C, view.at))
    result = calibrate_rig(with_noise(old, noise, [SEED, seed, 1]), noise)
    return result, with_noise(uq.Rig(new.arms, new.cameras, new.targets, views), noise, [SEED, seed, 2])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "part", "words"),
    [
        ("X", "right", "right moved"),
        ("focal length", "right", "the focal length of right changed"),
        ("target size", "board", "board is not of the size"),
        ("one pose", "of board by left at robot pose 34", "nly the view of board by left at robot pose 34"),
    ],
)
def test_causes_of_each_part_have_probabilities(change, part, words):
    result, new = changed_views(change, part, 5)
    found = uq.check(result, new)
    first = found.causes.all[0]
    assert (first.name, first.of) == (change, part) and first.probability > 0.5
    assert found.changed == (change != "one pose")
    assert sum(one.probability for one in found.causes.all) == pytest.approx(1.0)
    assert len({(one.name, one.of) for one in found.causes.all}) == len(found.causes.all) == 9
    assert words in cause_in_words(first, None)
    assert str(ChangeCheck.from_dict(found.to_dict())) == str(found)


@pytest.mark.slow
def test_a_move_shows_among_the_residuals_of_many_views():
    result, _ = changed_views("X", "right", 6)
    changes = []
    for k in range(4):
        exact, truth = simulate_rig(*HAND, n_poses=80, seed=7)
        _, new = split(exact, 40)
        noise, slid = noise_of(exact), perturb(truth["right"], np.array([0, 0, 0, 0, 0, 0.6e-3]))
        views = [
            replace(view, poses=inverse(slid) @ truth["right"] @ view.poses) if view.camera == "right" else view
            for view in new.views
        ]
        changes.append(uq.check(result, with_noise(replace(new, views=tuple(views)), noise, [SEED, 9, k])))
    assert all(found.changed and found.causes.all[0].label == "right" for found in changes)
    assert min(found.moves[0].p for found in changes) < 1e-6 < max(found.p_value for found in changes)


@pytest.mark.slow
def test_what_the_calibration_left_open_raises_no_alarm():
    exact, _ = simulate_rig({"left": "arm"}, {"board": "world"}, n_poses=40, axes=np.eye(3)[:1], seed=3)
    old, new = split(exact, 25)
    noise = noise_of(exact)
    result = calibrate_rig(with_noise(old, noise, 1), noise)
    assert len(result.open) == 1
    free, _ = simulate_rig({"left": "arm"}, {"board": "world"}, n_poses=6, seed=3)
    found = uq.check(result, with_noise(new, noise, 2))
    assert not found.changed and found.dof <= 90
    assert free.arms


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: uq.Rig(r.arms, {"third": "arm"}, r.targets,
                          [uq.View("third", "board", r.views[0].poses, r.views[0].at)]),
         "'third'; the calibrated rig has left, right"),
        (lambda r: uq.Rig(r.arms, {"left": "world"}, {"board": "arm"},
                          [uq.View("left", "board", r.views[0].poses, r.views[0].at)]), "was on 'arm' before"),
    ],
)  # fmt: skip
def test_new_views_of_something_else_are_refused(change, message):
    old, new, _, noise = drawn(HAND, 20, 15, 0)
    with pytest.raises(uq.InputError, match=message):
        uq.check(calibrate_rig(old, noise), change(new))


CELL = ({"left": "arm", "right": "arm", "front": "world"}, {"board": "world", "plate": "arm"})
TWO_ARMS = ({"left": "a", "front": "b"}, {"board": "world", "plate": "b"})


@pytest.mark.statistical
def test_predicted_points_are_consistent():
    """d^2 of the error against its covariance is chi-square with 3 degrees of freedom on average."""
    p, draws = np.array([0.02, -0.01, 0.5]), 40
    exact, truth = simulate_rig(*CELL, n_poses=25, seed=7)
    noise, places = noise_of(exact), exact.cameras
    rng = np.random.default_rng([SEED, 5])
    at = {name: arm.poses[3] for name, arm in exact.arms.items()}
    K = {name: at.get(places[name], np.eye(4)) @ truth[name] for name in places}
    asked = [("left", "world"), ("left", "right"), ("left", "front"), ("front", "world")]
    squares = dict.fromkeys(asked, 0.0)
    for k in range(draws):
        result = calibrate_rig(with_noise(exact, noise, [SEED, k]), noise, robust=False)
        sizes = np.repeat([0.5e-3, 0.3e-3], 3)
        robot = {name: perturb(T, sizes * rng.normal(size=6)) for name, T in at.items()}
        for camera, into in asked:
            true = (K[camera] if into == "world" else inverse(K[into]) @ K[camera]) @ np.append(p, 1.0)
            found = result.predict(camera, p, robot, into)
            e = found.points[0, 0] - true[:3]
            squares[camera, into] += float(e @ np.linalg.solve(found.covariance[0, 0], e))
    for pair, square in squares.items():
        assert chi2.ppf(1e-4, 3 * draws) < square < chi2.ppf(1 - 1e-4, 3 * draws), pair


@pytest.mark.slow
@pytest.mark.parametrize("into", ["world", "front"])
def test_derivatives_of_points_with_two_arms_are_those_of_differences(into):
    exact, _ = simulate_rig(*TWO_ARMS, arms=("a", "b"), n_poses=15, seed=7)
    noise = noise_of(exact)
    result = calibrate_rig(with_noise(exact, noise, [SEED, 1]), noise, robust=False)
    p, at = np.array([0.02, -0.01, 0.5]), {name: arm.poses[3] for name, arm in exact.arms.items()}
    step, N = 1e-6, len(result.posterior.covariance)

    def slope(u, a):
        moved = []
        for sign in (step, -step):
            poses = np.array(result.poses)
            poses[u] = perturb(poses[u], sign * np.eye(6)[a])
            moved.append(replace(result, poses=poses).predict("left", p, at, into).points[0, 0])
        return (moved[0] - moved[1]) / (2 * step)

    F = np.array([slope(u, a) for u in range(len(result.poses)) for a in range(6)]).T
    by_robot = []
    for name in ("a", "b") if into == "front" else ("a",):
        for a in range(6):
            near, far = ({**at, name: perturb(at[name], sign * step * np.eye(6)[a])} for sign in (1, -1))
            both = [result.predict("left", p, where, into).points[0, 0] for where in (near, far)]
            by_robot.append((both[0] - both[1]) / (2 * step) * (0.5e-3 if a < 3 else 0.3e-3))
    G = np.array(by_robot).T
    S = F @ result.posterior.covariance[:N, :N] @ F.T + G @ G.T
    np.testing.assert_allclose(result.predict("left", p, at, into).covariance[0, 0], S, rtol=1e-4)


def test_relative_points_of_one_arm_do_not_depend_on_its_pose():
    old, _, _, noise = drawn(HAND, 20, 15, 0)
    result = calibrate_rig(old, noise)
    p = np.array([[0.0, 0.0, 0.4]])
    near, far = (result.predict("left", p, {"arm": old.arms["arm"].poses[k]}, "right") for k in (1, 9))
    np.testing.assert_allclose(near.points, far.points, atol=1e-12)
    pair = result.relative("right", "left")
    np.testing.assert_allclose(near.points[0, 0], pair.pose[:3, :3] @ p[0] + pair.pose[:3, 3], atol=1e-12)
    with pytest.raises(uq.InputError, match="robot poses of the arm 'arm'"):
        result.predict("left", p)


def test_planned_views_help_as_predicted_and_more_than_others():
    exact, _ = simulate_rig({"left": "arm", "right": "arm"}, {"board": "world"}, n_poses=60, seed=7)
    noise = noise_of(exact)
    old, _ = split(exact, 12)
    result = calibrate_rig(with_noise(old, noise, 1), noise, robust=False)
    found = uq.plan(result, {"arm": exact.arms["arm"].poses}, k=4)
    errors = np.sqrt([found.criterion_before, *found.criterion_values])
    assert all(a > b for a, b in itertools.pairwise(errors))
    assert {camera for camera, _ in found.views} <= {"left", "right"}
    assert found.of_cameras.shape == (5, 2, 6, 6) and len(found.to_dict()["steps"]) == len(found.views) == 4
    np.testing.assert_allclose(found.robot, exact.arms["arm"].poses[found.chosen])
    worst = uq.plan(result, {"arm": np.tile(old.arms["arm"].poses[:1], (5, 1, 1))}, k=4)
    assert found.criterion_values[-1] < worst.criterion_values[-1]
    drawn = uq.plan(result, k=3, sample=50, floor=0.1, tolerance="0.01mm")
    assert len(drawn.chosen) == 3 and (drawn.robot[:, 2, 3] >= 0.1).all() and "will not reach" in drawn.to_text()
    assert uq.plan(result, k=1, sample=50, tolerance="20mm,5deg").needed == 0


@pytest.mark.slow
def test_the_public_functions_take_rigs():
    """`uq.check` and the others say of a rig what its own functions do."""
    exact, _ = simulate_rig(*HAND, n_poses=40, seed=7)
    noise = noise_of(exact)
    old, new = split(with_noise(exact, noise, [SEED, 3]), 30)
    result = uq.calibrate(old, noise=noise)
    assert result.to_dict() == calibrate_rig(old, noise).to_dict()
    found = uq.check(result, new, tolerance="0.3mm,0.03deg")
    assert found.limits == pytest.approx((3e-4, np.radians(0.03))) and found.status == "cannot tell"
    np.testing.assert_allclose(uq.update(result, new).poses, update_rig(result, new).poses)
    for call in (
        lambda: uq.check(result, new, noise=uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))),
        lambda: uq.plan(result, criterion="logdet"),
        lambda: uq.calibrate(old, setup="eye-in-hand"),
        lambda: uq.calibrate(old, pairs="consecutive"),
        lambda: uq.calibrate(old, camera_scale="unknown"),
        lambda: uq.update(result, new, same="robot"),
    ):
        with pytest.raises(uq.InputError, match="is not an argument for the result of"):
            call()
    with pytest.raises(uq.InputError, match="Expected new views of a rig as a Rig"):
        uq.check(result, uq.simulate(n_poses=5, seed=1))


@pytest.mark.slow
def test_what_is_not_the_same_widens_the_test():
    """Another right camera has another focal length: with its own errors drawn again less is a contradiction."""
    old, new, *_ = drawn(HAND, 40, 30, 8)
    result = calibrate_rig(old)
    all_same, other = uq.check(result, new), uq.check(result, new, same=["arm", "left", "board"])
    assert other.d2 < all_same.d2
    assert uq.check(result, new, same="robot,camera,target").d2 == pytest.approx(all_same.d2)
    least = {one.name: one.least_shift for one in all_same.moves}
    assert all(one.least_shift >= least[one.name] - 1e-12 for one in other.moves)


@pytest.mark.slow
def test_a_log_of_checks_of_a_rig_shows_what_moves(tmp_path):
    exact, truth = simulate_rig(*HAND, n_poses=40, seed=7)
    noise = noise_of(exact)
    result = calibrate_rig(with_noise(exact, noise, [SEED, 0]), noise)
    shifted = perturb(truth["right"], np.array([0, 0, 0, 2e-3, 0, 0]))
    for day in range(4):
        rng = np.random.default_rng([SEED, day])
        rows = rng.permutation(40)[:6]
        views = [
            uq.View(v.camera, v.target, inverse(shifted) @ truth["right"] @ v.poses[rows]
                    if day >= 2 and v.camera == "right" else v.poses[rows], tuple(range(6)))
            for v in exact.views
        ]  # fmt: skip
        new = with_noise(uq.Rig({"arm": exact.arms["arm"].poses[rows]}, *HAND, views), noise, rng)
        series = uq.log_check(tmp_path / "log.csv", result, new, uq.check(result, new))
    assert [check.cause for check in series.checks] == ["", "", "right", "right"]
    for check in series.checks[2:]:
        assert np.abs(check.shift[3:] - [2e-3, 0, 0]).max() < 4 * check.shift_std[3:].max()
    again = uq.read_checks(tmp_path / "log.csv", result)
    assert not again.damaged and len(again) == 4 and again.checks[3].n_poses == sum(len(v.poses) for v in new.views)
    with pytest.raises(uq.InputError, match="another calibration"):
        uq.read_checks(tmp_path / "log.csv", calibrate_rig(exact, noise))


@pytest.mark.slow
def test_an_update_is_the_calibration_of_all_views():
    exact, _ = simulate_rig(*HAND, n_poses=30, seed=7)
    noise = noise_of(exact)
    whole = with_noise(exact, noise, [SEED, 3])
    old, new = split(whole, 20)
    result = calibrate_rig(old, noise)
    found = update_rig(result, new)
    alone = calibrate_rig(whole, noise)
    np.testing.assert_allclose(found.poses, alone.poses, atol=1e-10)
    np.testing.assert_allclose(found.covariance, alone.covariance, rtol=1e-6, atol=1e-16)
    with pytest.raises(uq.InputError, match="has already"):
        update_rig(found, new)


@pytest.mark.parametrize("unit", [int, float])
def test_new_poses_with_the_numbers_of_old_ones_count_as_later(unit):
    """Files without times number their rows from 0, and a session its seconds."""
    exact, _ = simulate_rig(*HAND, n_poses=24, seed=7)
    whole, noise = with_noise(exact, noise_of(exact), [SEED, 1]), noise_of(exact)

    def session(rig, first, until):
        arm = rig.arms["arm"]
        arms = {"arm": uq.ArmPoses(arm.poses[first:until], [unit(k) for k in range(until - first)])}
        views = [replace(one, at=tuple(unit(at - first) for at in one.at)) for one in rig.views]
        return uq.Rig(arms, rig.cameras, rig.targets, tuple(views))

    old, new = split(whole, 14)
    result, again = calibrate_rig(session(old, 0, 14), noise), session(new, 14, 24)
    found = uq.update(result, again)
    assert found.rig.moments == list(range(24))
    assert [one.values["later"] for one in found.findings if one.code == "maintenance.later_numbers"] == [14]
    np.testing.assert_allclose(found.poses, calibrate_rig(whole, noise).poses, atol=1e-9)
    with pytest.raises(uq.InputError, match="has already"):  # poses of the result, by their own numbers
        uq.update(result, session(old, 0, 14))


def test_an_update_that_contradicts_is_refused():
    exact, truth = simulate_rig(*HAND, n_poses=30, seed=7)
    old, new = split(exact, 20)
    noise = noise_of(exact)
    move = inverse(truth["left"]) @ perturb(truth["left"], np.array([0.02, 0, 0, 0, 0.01, 0]))
    views = [
        uq.View(v.camera, v.target, inverse(move) @ v.poses if v.camera == "left" else v.poses, v.at) for v in new.views
    ]
    new = with_noise(uq.Rig(new.arms, new.cameras, new.targets, views), noise, 2)
    result = calibrate_rig(with_noise(old, noise, 1), noise)
    with pytest.raises(uq.InputError, match=r"contradict the result .*probably left"):
        update_rig(result, new)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["right", "board"])
def test_a_move_among_the_new_views_is_named_with_its_pose(name):
    exact, truth = simulate_rig({"left": "arm", "right": "arm"}, {"board": "world"}, n_poses=46, seed=7)
    old, new = split(exact, 30)
    noise, move = noise_of(exact), perturb(truth[name], np.array([0, 0, 0, 3e-3, 0, 0]))
    after = inverse(move) @ truth[name] if name == "right" else inverse(truth[name]) @ move
    views = []
    for view in new.views:
        C, late = view.poses.copy(), np.array([int(moment) >= 38 for moment in view.at])
        if name in (view.camera, view.target):
            C[late] = after @ C[late] if name == "right" else C[late] @ after
        views.append(replace(view, poses=C))
    new = with_noise(replace(new, views=tuple(views)), noise, [SEED, 2])
    result = calibrate_rig(with_noise(old, noise, [SEED, 1]), noise)
    found = uq.check(result, new)
    assert found.changed and found.moved_since.values["name"] == name
    assert abs(int(found.moved_since.values["since"]) - 38) <= 1
    assert f"{name} moved among the new poses" in " ".join(str(found).split())
    assert found.moved_since.values["translation"] == pytest.approx(3e-3, abs=1e-3)
    with pytest.raises(uq.InputError, match="contradict") as error:
        uq.update(result, new)
    assert any("since" in one.values and one.severity == "failure" for one in error.value.findings)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_a_point_seen_from_elsewhere_is_as_uncertain_as_by_one_camera():
    """Errors of an unknown arm at poses of which those so far say nothing are in both predictions."""
    rig, _ = arm_rigs(11, 25, 8, "eye-in-hand", 2e-3)
    views = tuple(view for view in rig.views if view.camera == "left")
    of_rig = calibrate_rig(uq.Rig(rig.arms, {"left": "arm"}, rig.targets, views))
    poses, later = arm_sessions(11, 25, 8, "eye-in-hand", 2e-3)
    of_camera, point, elsewhere = uq.calibrate(poses), np.array([0.0, 0.0, 0.5]), later.robot[0].copy()
    elsewhere[:3, 3] *= 0.8
    sizes = [
        np.sqrt(np.trace(np.reshape(covariance, (3, 3))))
        for covariance in (
            of_rig.predict("left", point[None], {"arm": elsewhere}).covariance,
            of_camera.predict(point, robot=elsewhere).covariance,
        )
    ]
    assert sizes[0] == pytest.approx(sizes[1], rel=0.12)
