"""Rigs: derivatives, the one camera of `calibrate`, consistency of the joint covariance, what is open, bad input."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

import uq_handeye as uq
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.calibration.evidence.new_views import others_of
from uq_handeye.core.geometry.se3 import logarithm, perturb
from uq_handeye.fit.graph.constraint import Unknowns, constraint_of
from uq_handeye.fit.graph.engine import LatentModel
from uq_handeye.fit.graph.fit import fit
from uq_handeye.fit.graph.graph import Graph
from uq_handeye.fit.graph.noise import RigNoise, given_noise
from uq_handeye.fit.graph.sizes import components_of, model_of
from uq_handeye.fit.graph.start import start_of
from uq_handeye.model.shared_errors.view import median_distance, target_centre, view_block
from uq_handeye.trials.simulation.several_cameras import simulate_rig, with_noise

SEED = int(os.environ.get("UQ_HANDEYE_SEED", "0"))
SIZE = ("0.5mrad", "0.3mm")
ONE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


def noise_of(rig):
    return dict.fromkeys((*rig.arms, *rig.cameras), SIZE)


def error(T, true):
    return np.concatenate([logarithm(T[:3, :3] @ true[:3, :3].T), T[:3, 3] - true[:3, 3]])


def test_derivatives_are_those_of_differences():
    """All kinds of edges: cameras and targets on both arms and in the world."""
    cameras, targets = {"c1": "a", "c2": "b", "c3": "world"}, {"t1": "b", "t2": "world", "t3": "a"}
    rig, truth = simulate_rig(cameras, targets, arms=("a", "b"), n_poses=5, seed=2)
    graph = Graph.of(rig)
    at = np.array([truth[name] for name in graph.names])
    sides = graph.linearise(at)
    np.testing.assert_allclose(sides.r, 0, atol=1e-12)
    J, step = graph.by_unknowns(sides), 1e-6

    def slope(of, count, a):
        move = np.zeros((count, 6))
        move[:, a] = step
        return (of(move) - of(-move)) / (2 * step)

    for u in range(graph.m):

        def moved(xi, u=u):
            T = at.copy()
            T[u] = perturb(T[u], xi[u])
            return graph.linearise(T).r

        for a in range(6):
            np.testing.assert_allclose(J[..., 6 * u + a], slope(moved, graph.m, a), atol=1e-7)
    for a in range(6):
        by_C = slope(lambda xi: graph.linearise(at, C=perturb(graph.C, xi)).r, graph.E, a)
        np.testing.assert_allclose(sides.camera[..., a], by_C, atol=1e-7)
        by_all = slope(lambda xi: graph.linearise(at, robot=perturb(graph.robot, xi)).r, graph.P, a)
        np.testing.assert_allclose((sides.robot[0] + sides.robot[1])[..., a], by_all, atol=1e-7)


def one_camera(poses):
    """The same data as a rig of one camera, its rows exchanged."""
    on, to = ("arm", "world") if poses.setup == "eye-in-hand" else ("world", "arm")
    at = tuple(range(poses.n)) if poses.timestamps is None else tuple(poses.timestamps.tolist())
    return uq.Rig({"arm": uq.ArmPoses(poses.robot, at)}, {"left": on}, {"board": to},
                  [uq.View("left", "board", poses.camera, at)])  # fmt: skip


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize(
    ("method", "given"),
    [
        ("efficient", True),
        *(pytest.param(method, False, marks=pytest.mark.slow) for method in ("ml", "efficient")),
    ],
)
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_one_camera_is_calibrate(setup, method, given):
    """One answer to the same data, by the same names as of several cameras, and the same file read back."""
    drawn = uq.simulate(n_poses=25, seed=3, noise=ONE, setup=setup)
    camera = np.array(drawn.camera)
    camera[:3, :3, 3] += [0.02, 0.0, 0.05]
    poses = uq.PosePairs(drawn.robot, camera, setup, np.arange(25) + 0.5)
    noise = ONE if given else None
    one, single = (uq.calibrate(data, noise=noise, method=method) for data in (one_camera(poses), poses))
    np.testing.assert_array_equal(one.X, single.X)
    np.testing.assert_array_equal(one.covariance, single.covariance)
    assert [finding.code for finding in one.findings] == [finding.code for finding in single.findings]
    np.testing.assert_array_equal(one.cameras["left"].X, single.X)
    np.testing.assert_array_equal(one.targets["board"].covariance, single.covariance_W)
    assert one.names == ("arm", "left", "board") and one.arms["arm"].base[0, 0] == 1
    again = uq.Calibration.from_dict(one.to_dict())
    assert again.names == one.names
    with pytest.raises(uq.InputError, match="not on one carrier"):
        again.relative("left", "board")


@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_what_one_camera_of_a_rig_brings_is_used():
    """Noise by name, a covariance of the views, a prior, and joints."""
    poses = uq.simulate(n_poses=20, seed=3, noise=ONE)
    rig, own = one_camera(poses), np.diag(np.repeat([1e-3, 5e-4], 3) ** 2)
    by_name = uq.calibrate(rig, noise={"arm": ("0.02deg", "0.05mm"), "left": ("0.1deg", "0.5mm")})
    np.testing.assert_allclose(by_name.covariance, uq.calibrate(poses, noise=ONE).covariance, rtol=1e-9)
    seen = replace(rig, views=(replace(rig.views[0], covariance=own),))
    found = uq.calibrate(seen, noise={"arm": ("0.02deg", "0.05mm")})
    robot = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm")).robot
    np.testing.assert_allclose(
        found.covariance, uq.calibrate(poses, noise=uq.PoseNoise(robot, own)).covariance, rtol=1e-9
    )
    known = uq.calibrate(replace(rig, known={"left": (poses.truth.X, 1e-12 * np.eye(6))}), noise=ONE)
    assert known.std.max() < 1.1e-6
    with pytest.raises(uq.InputError, match="`prior_X` once"):
        uq.calibrate(replace(rig, known={"left": (poses.truth.X, np.eye(6))}), prior_X=(poses.truth.X, np.eye(6)))
    new = uq.simulate(n_poses=5, seed=[3, 1], noise=ONE)
    assert uq.check(known, one_camera(new)).d2 == uq.check(known, new).d2
    with pytest.raises(uq.InputError, match="Expected new views of arm, left, board"):
        uq.check(known, uq.Rig({"arm": poses.robot}, {"right": "arm"}, {"board": "world"},
                               [uq.View("right", "board", poses.camera)]))  # fmt: skip


def independent(rig, noise):
    """Return the fit that takes each view as if it had a robot pose of its own."""
    graph = Graph.of(rig)
    of = given_noise(rig, graph, noise)
    side = graph.side[0]
    split = Graph(
        graph.names, graph.C, graph.robot[side], graph.X, graph.W, graph.base,
        (np.arange(graph.E), np.full(graph.E, graph.E)), graph.view, graph.row, graph.arm[side], graph.pose[side],
    )  # fmt: skip
    return fit(split, RigNoise.of_own(of.robot[side], of.camera), start_of(graph)[0])


@pytest.mark.statistical
def test_joint_covariance_is_consistent_and_that_without_correlations_is_not():
    exact, truth = simulate_rig({"c1": "arm", "c2": "arm"}, {"t1": "world", "t2": "world"}, n_poses=20, seed=5)
    noise, trials = noise_of(exact), 150
    joint, apart, relative = 0.0, 0.0, 0.0
    for k in range(trials):
        rig = with_noise(exact, noise, [SEED, k])
        found = calibrate_rig(rig, noise, robust=False)
        xi = np.concatenate([error(T, truth[name]) for T, name in zip(found.poses, found.names, strict=True)])
        joint += xi @ np.linalg.solve(found.covariance, xi)
        pair = found.relative("c1", "c2")
        e = error(pair.pose, np.linalg.inv(truth["c1"]) @ truth["c2"])
        relative += e @ np.linalg.solve(pair.covariance, e)
        other = independent(rig, noise)
        xi = np.concatenate([error(T, truth[name]) for T, name in zip(other.at, other.graph.names, strict=True)])
        apart += xi @ np.linalg.solve(other.covariance, xi)
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 24 * trials)
    assert low < joint < high
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 6 * trials)
    assert low < relative < high
    assert apart > chi2.ppf(1 - 1e-6, 24 * trials)


def test_one_camera_goes_through_the_engine_as_calibrate_does():
    """The same value and derivatives as rows of six by `LatentModel.of`."""
    poses = uq.simulate(n_poses=20, seed=3, noise=ONE)
    rig = uq.Rig({"arm": poses.robot}, {"c": "arm"}, {"t": "world"}, [uq.View("c", "t", poses.camera)])
    graph = Graph.of(rig)
    at = start_of(graph)[0]
    parts = components_of(rig, graph, shared=True)
    by_graph = model_of(rig, graph, parts, at, None)
    constraint = constraint_of(poses, None)
    linear = constraint.linearise(Unknowns(at[0], at[1]), poses.robot, poses.camera)
    single = LatentModel.of(linear, parts)
    theta = single.medians + 0.3
    one, other = by_graph.at(theta), single.at(theta)
    assert one.value == pytest.approx(other.value, rel=1e-10)
    np.testing.assert_allclose(one.gradient, other.gradient, rtol=1e-8, atol=1e-8)
    conditional = by_graph.conditional(theta), single.conditional(theta)
    np.testing.assert_allclose(conditional[0].mean, conditional[1].mean, atol=1e-10)
    np.testing.assert_allclose(conditional[0].covariance, conditional[1].covariance, rtol=1e-7, atol=1e-16)


@pytest.mark.slow
def test_noise_of_arm_and_cameras_is_found():
    exact, truth = simulate_rig({"c1": "world", "c2": "world", "c3": "world"}, {"t": "arm"}, n_poses=60, seed=5)
    noise = {"arm": ("0.5mrad", "0.3mm"), "c1": SIZE, "c2": SIZE, "c3": ("2mrad", "1.2mm")}
    true = {f"{name} {what}": size for name, of in (("arm", (5e-4, 3e-4)), ("c1", (5e-4, 3e-4)), ("c3", (2e-3, 1.2e-3)))
            for what, size in zip(("rotation", "translation"), of, strict=True)}  # fmt: skip
    total, trials, inside = 0.0, 20, []
    for k in range(trials):
        found = calibrate_rig(with_noise(exact, noise, [SEED, k]), shared=False)
        xi = np.concatenate([error(T, truth[name]) for T, name in zip(found.poses, found.names, strict=True)])
        total += xi @ np.linalg.solve(found.covariance, xi)
        inside += [part["low"] < true[part["name"]] < part["high"] for part in found.components if part["name"] in true]
        np.testing.assert_allclose(found.noise["c3"], (2e-3, 1.2e-3), rtol=0.35)
    assert np.mean(inside) > 0.85
    assert 0.85 < total / (24 * trials) < 1.25


@pytest.mark.slow
def test_the_width_of_the_targets_is_found_by_the_noise_of_the_views():
    """A target a quarter as wide as assumed, where cameras look: poses are noisy in tilt and distance."""
    exact, truth = simulate_rig({"c1": "world", "c2": "world"}, {"t": "arm"}, n_poses=60, seed=5)
    rng = np.random.default_rng([SEED, 5])
    C = np.concatenate([view.poses for view in exact.views])
    distance = 0.25 * median_distance(C)
    root = view_block(C, distance, np.mean([target_centre(view.poses, distance) for view in exact.views], axis=0))
    C = perturb(C, 1e-4 * (root @ rng.normal(size=(len(C), 6, 1)))[..., 0])
    views = [uq.View(view.camera, view.target, T, view.at) for view, T in zip(exact.views, np.split(C, 2), strict=True)]
    arms = {"arm": perturb(exact.arms["arm"].poses, rng.normal(size=(60, 6)) * np.repeat([2e-4, 1e-4], 3))}
    found = calibrate_rig(uq.Rig(arms, exact.cameras, exact.targets, tuple(views)), shared=("accuracy",))
    width = next(part["size"] for part in found.components if part["name"] == "half width of targets")
    assert 0.7 < width / (0.25 * 0.15) < 1.4
    xi = np.concatenate([error(T, truth[name]) for T, name in zip(found.poses, found.names, strict=True)])
    assert xi @ np.linalg.solve(found.covariance, xi) < chi2.ppf(1 - 1e-4, 18)
    rig = calibrate_rig(with_noise(exact, noise_of(exact), 1))  # poses of equal noise tell no width
    assert all(part["name"] != "half width of targets" for part in rig.components)


@pytest.mark.slow
def test_a_start_far_away_is_left_by_as_many_steps_as_it_takes():
    """Two arms about two axes near each other: `efficient` stopped after eight steps, 0.8 rad from the minimum."""
    places = {"c1": "a", "c2": "world"}, {"t1": "b", "t2": "a"}
    exact, truth = simulate_rig(*places, arms=("a", "b"), n_poses=15, axes=[[1.0, 0.0, 0.0], [1.0, 0.2, 0.0]], seed=4)
    noise = dict.fromkeys((*exact.arms, *exact.cameras), ("1mrad", "0.6mm"))
    found = calibrate_rig(with_noise(exact, noise, [3, 4]), noise, robust=False)
    xi = np.concatenate([error(T, truth[name]) for T, name in zip(found.poses, found.names, strict=True)])
    assert xi @ np.linalg.solve(found.covariance, xi) < chi2.ppf(1 - 1e-4, 30)
    assert not found.optimality.proven


@pytest.mark.slow
def test_shared_errors_by_name():
    exact, _ = simulate_rig({"c1": "arm", "c2": "arm"}, {"t": "world"}, n_poses=15, seed=5)
    rig = with_noise(exact, noise_of(exact), 1)
    names = {part["name"] for part in calibrate_rig(rig, shared=("accuracy", "scale")).components}
    assert {"arm accuracy", "t scale"} <= names and not any("focal" in name or "principal" in name for name in names)
    with pytest.raises(uq.InputError, match="Expected `shared` to be True, False, SharedError or some of accuracy"):
        calibrate_rig(rig, shared=("focus",))


@pytest.mark.slow
def test_targets_of_one_printer_share_an_error_of_size():
    """All tags 1 % larger than told: the cameras are as far off as stated; by itself each size is drawn to the mean."""
    tags = {f"t{k}": "world" for k in range(8)}
    exact, truth = simulate_rig({"c1": "arm", "c2": "arm"}, tags, n_poses=20, seen=0.5, seed=5)
    noise = {"arm": ("0.05mrad", "0.05mm"), "c1": SIZE, "c2": SIZE}
    rig = with_noise(exact, noise, [SEED, 6])
    scaled = [np.array(view.poses) for view in rig.views]
    for C in scaled:
        C[:, :3, 3] /= 1.01
    views = tuple(replace(view, poses=C) for view, C in zip(rig.views, scaled, strict=True))
    found = calibrate_rig(replace(rig, views=views))
    sizes = {part["name"]: part["size"] for part in found.components}
    assert sizes["all targets scale"] > 4 * max(sizes[f"{name} scale"] for name in tags)
    xi = np.concatenate([error(found.cameras[name].X, truth[name]) for name in ("c1", "c2")])
    S = found.covariance[:12, :12]
    assert found.names[:2] == ("c1", "c2") and xi @ np.linalg.solve(S, xi) < chi2.ppf(1 - 1e-4, 12)
    names = np.array(found.posterior.names)
    anew = names[others_of(found, ["arm", "c1", "c2", "t0"])].tolist()  # another target was measured by itself
    assert anew == [*(f"t{k} scale" for k in range(1, 8)), "all targets scale"]
    assert not others_of(found, "robot, camera, target").any()


@pytest.mark.slow
def test_two_arms_find_their_bases():
    exact, truth = simulate_rig({"c1": "a"}, {"t1": "b"}, arms=("a", "b"), n_poses=30, seed=4)
    found = calibrate_rig(with_noise(exact, noise_of(exact), 1), noise_of(exact))
    for k, (name, T) in enumerate(zip(found.names, found.poses, strict=True)):
        e, some = error(T, truth[name]), slice(6 * k, 6 * k + 6)
        assert e @ np.linalg.solve(found.covariance[some, some], e) < chi2.ppf(1 - 1e-5, 6)
    assert found.arms["a"].covariance.max() == 0


def test_fixed_camera_through_a_board_that_a_camera_on_the_hand_sees():
    exact, truth = simulate_rig({"hand": "arm", "front": "world"}, {"board": "world"}, n_poses=30, seed=4)
    found = calibrate_rig(with_noise(exact, noise_of(exact), 1), noise_of(exact))
    e = error(found.cameras["front"].X, truth["front"])
    assert len(found.open) == 0
    assert e @ np.linalg.solve(found.cameras["front"].covariance, e) < chi2.ppf(1 - 1e-5, 6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cameras", "targets", "pairs", "count", "of_pair"),
    [
        ({"c1": "arm", "c2": "arm"}, {"t1": "world"}, None, 1, 0),
        ({"c1": "world", "c2": "world"}, {"t1": "arm", "t2": "arm"}, [("c1", "t1"), ("c2", "t2")], 2, 1),
    ],
)
def test_open_directions_about_one_axis(cameras, targets, pairs, count, of_pair):
    exact, _ = simulate_rig(cameras, targets, n_poses=40, axes=[[0.0, 0.0, 1.0]], seen=pairs or 1.0, seed=3)
    found = calibrate_rig(with_noise(exact, noise_of(exact), 2), noise_of(exact), robust=False)
    assert len(found.open) == count
    assert len(found.relative("c1", "c2").open) == of_pair
    assert f"Not determined: {count} direction" + "s" * (count > 1) + ", of c1" in found.text()


def test_a_wrong_view_and_a_wrong_robot_pose_are_separated():
    exact, truth = simulate_rig({"c1": "arm", "c2": "arm"}, {"t1": "world", "t2": "world"}, n_poses=30, seed=5)
    noise = noise_of(exact)
    rig = with_noise(exact, noise, 7)
    poses, views = np.array(rig.arms["arm"].poses), list(rig.views)
    poses[4, :3, 3] += 0.05
    seen = np.array(views[1].poses)
    seen[9, :3, 3] += 0.05
    views[1] = uq.View(views[1].camera, views[1].target, seen, views[1].at)
    found = calibrate_rig(uq.Rig({"arm": poses}, rig.cameras, rig.targets, views), noise)
    assert found.rejected == (("c1", "t2", 9),)
    assert found.rejected_poses == (("arm", 4),)
    xi = np.concatenate([error(T, truth[name]) for T, name in zip(found.poses, found.names, strict=True)])
    assert xi @ np.linalg.solve(found.covariance, xi) < chi2.ppf(1 - 1e-5, 24)


@pytest.mark.slow
@pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")
def test_a_robot_pose_without_which_views_contradict_each_other_too_is_not_to_blame():
    """One camera is wrong at pose 245 of the rendered cell: it was the robot's, with a chi-square of 7191 of 930."""
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / "metric_medium"
    robot = uq.read_stream(folder / "robot.csv", "robot")
    views = []
    for k in (1, 2):
        seen = uq.read_stream(folder / f"camera_{k}.csv", "camera")
        views.append(uq.View(f"c{k}", "board", seen.poses, tuple(seen.timestamps.tolist())))
    arm = uq.ArmPoses(robot.poses, tuple(robot.timestamps.tolist()))
    found = calibrate_rig(uq.Rig({"arm": arm}, {"c1": "world", "c2": "world"}, {"board": "arm"}, tuple(views)))
    assert found.rejected_poses == () and ("c2", "board", 245.0) in found.rejected
    assert found.chi_square < 1.3 * found.dof
    assert found.findings == () and min(path.p for path in found.paths) > 1e-4  # by what was not rejected


POSES = np.tile(np.eye(4), (4, 1, 1))


@pytest.mark.parametrize(
    ("cameras", "targets", "view", "message"),
    [
        (["c"], ["t"], ("x", "t", None), "names the camera 'x', which the rig does not have"),
        (["c"], ["t"], ("c", "x", None), "names the target 'x', which the rig does not have"),
        (["c"], ["t"], ("c", "t", [0, 1, 2, 9]), "names robot pose 9, which the files of the arm 'arm' do not have"),
        (["c"], ["c"], ("c", "c", None), "got 'c' twice"),
        (["c", "d"], ["t"], ("c", "t", None), "The camera 'd' has no view"),
    ],
)
def test_bad_input_is_named(cameras, targets, view, message):
    c, t, at = view
    with pytest.raises(uq.InputError, match=message):  # noqa: PT012
        rig = uq.Rig(
            {"arm": POSES}, dict.fromkeys(cameras, "arm"), dict.fromkeys(targets, "world"), [uq.View(c, t, POSES, at)]
        )
        calibrate_rig(rig, ONE)


@pytest.mark.parametrize(
    ("away", "told"), [(0.004, r"within 0\.004 s of one: .*--time-tolerance 0\.005"), (3.0, "Correct")]
)
def test_times_that_are_nearly_those_of_the_robot_are_to_be_matched_within_a_tolerance(away, told):
    times = [1700000000.5, 1700000007.25, 1700000013.0, 1700000020.5]
    with pytest.raises(uq.InputError, match=told):
        uq.Rig({"arm": uq.ArmPoses(POSES, times)}, {"c": "arm"}, {"t": "world"},
               [uq.View("c", "t", POSES, [time + away for time in times])])  # fmt: skip


def test_a_target_on_two_things_a_part_that_floats_and_files_that_disagree_are_named():
    with pytest.raises(uq.InputError, match="is on two things"):
        uq.Rig({"arm": POSES}, {"c": "arm"}, {"t": ["arm", "world"]}, [uq.View("c", "t", POSES)])
    with pytest.raises(uq.InputError, match="Nothing ties c and t to the rest"):
        calibrate_rig(uq.Rig({"arm": POSES}, {"c": "world"}, {"t": "world"}, [uq.View("c", "t", POSES)]), ONE)
    other = POSES.copy()
    other[2, 0, 3] = 0.01
    with pytest.raises(uq.InputError, match="one and two disagree on robot pose 2"):
        uq.ArmPoses(POSES, source="one").joined(uq.ArmPoses(other, source="two"))


def test_relative_pose_of_things_on_different_carriers_is_refused():
    rig, _ = simulate_rig({"hand": "arm", "front": "world"}, {"board": "world"}, n_poses=10, seed=4)
    with pytest.raises(uq.InputError, match="not constant"):
        calibrate_rig(rig, noise_of(rig)).relative("hand", "front")


def with_intrinsics(rig, camera, q=3):
    """The rig whose camera comes with a covariance of each pose and errors of its calibration."""
    rng = np.random.default_rng(3)
    views = []
    for view in rig.views:
        if view.camera != camera:
            views.append(view)
            continue
        F = 1e-3 * rng.normal(size=(len(view.poses), 6, q)) + 2e-3 * np.eye(6)[:, :q]
        views.append(uq.View(view.camera, view.target, view.poses, view.at, np.diag([2.5e-7] * 3 + [9e-8] * 3), "", F))
    return uq.Rig(rig.arms, rig.cameras, rig.targets, tuple(views))


@pytest.mark.slow
def test_errors_of_a_camera_calibration_are_shared_by_its_views():
    """NEES with them is one; without them, as if each pose had its own noise alone, it is not."""
    exact, truth = simulate_rig({"c1": "arm", "c2": "arm"}, {"t1": "world", "t2": "world"}, n_poses=20, seed=5)
    exact = with_intrinsics(exact, "c1")
    noise, trials, total, apart = {"arm": SIZE, "c2": SIZE}, 60, 0.0, 0.0
    for k in range(trials):
        rig = with_noise(exact, noise, [SEED, k])
        graph = Graph.of(rig)
        of, at = given_noise(rig, graph, noise), np.array([truth[name] for name in graph.names])
        for given in (of, RigNoise.of_own(of.robot, of.camera)):
            found = fit(graph, given, at)
            xi = np.concatenate([error(T, truth[name]) for T, name in zip(found.at, graph.names, strict=True)])
            square = xi @ np.linalg.solve(found.covariance, xi)
            total, apart = (total + square, apart) if given is of else (total, apart + square)
    low, high = chi2.ppf([1e-4, 1 - 1e-4], 24 * trials)
    assert low < total < high
    assert apart > 1.5 * high


def test_a_calibrated_camera_has_no_intrinsics_of_the_table_beside_its_own(tmp_path):
    exact, _ = simulate_rig({"c1": "arm", "c2": "arm"}, {"t1": "world"}, n_poses=15, seed=5)
    rig = with_noise(with_intrinsics(exact, "c1"), {"arm": SIZE, "c2": SIZE}, [SEED, 1])
    names = [part.name for part in components_of(rig, Graph.of(rig), shared=True)]
    assert "c1 intrinsics" in names and "c1 focal length" not in names and "c2 focal length" in names
    found = calibrate_rig(rig, {"arm": SIZE, "c2": SIZE})
    found.save(tmp_path / "result.json")
    stored = uq.load(tmp_path / "result.json").rig.views[0]
    np.testing.assert_array_equal(stored.intrinsics, rig.views[0].intrinsics)
    with pytest.raises(uq.InputError, match=r"intrinsics .* \(m, 6, q\)"):
        uq.View("c", "t", POSES, None, np.eye(6), "", np.zeros((3, 6, 2)))


@pytest.mark.slow
def test_a_wrong_robot_pose_does_not_make_the_noise_of_the_arm():
    """It takes the blame for its views, whose weights stay 1: they say nothing of the noise."""
    noise = dict.fromkeys(("arm", "one", "two"), ("0.5mrad", "0.3mm"))
    rig, truth = simulate_rig({"one": "world", "two": "world"}, {"board": "arm"}, n_poses=30, noise=noise, seed=11)
    poses = rig.arms["arm"].poses.copy()
    poses[[4, 17]] = perturb(poses[[4, 17]], np.array([0.2, 0.0, 0.1, 0.05, 0.0, 0.05]))
    result = calibrate_rig(replace(rig, arms={"arm": poses}))
    assert {at for _, at in result.rejected_poses} == {4, 17}
    sizes = {line["name"]: line["size"] for line in result.components}
    assert sizes["arm rotation"] < 1e-3 and sizes["arm translation"] < 6e-4
    pair = result.relative("one", "two")
    e = error(pair.pose, np.linalg.inv(truth["one"]) @ truth["two"])
    assert e @ np.linalg.solve(pair.covariance, e) < 16.8
