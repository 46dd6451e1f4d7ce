"""Planning: predictions against the covariance of the enlarged set, choices against brute force, open directions."""

import dataclasses
import json
import os
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from fixtures.few_axes import rig
from scipy.spatial.transform import Rotation
from support import (
    SEED,
    assert_same_covariance,
    difference,
    is_consistent,
    jacobian,
    moved,
    random_covariance,
    transforms,
)

from uq_handeye import (
    DegenerateMotionError,
    InputError,
    NotConvergedError,
    PairNoise,
    PoseNoise,
    PosePairs,
    PosePrior,
    SharedError,
    calibrate,
    read_poses,
    simulate,
)
from uq_handeye.calibration.tolerance import Tolerance, probability_within
from uq_handeye.fit.graph.gauss_helmert import bound, efficient
from uq_handeye.fit.graph.selection import after, covariance_of, exchanged, greedy, value
from uq_handeye.model.errors.models import marginals
from uq_handeye.model.shared_errors.in_noise import shared_columns, with_shared
from uq_handeye.read import read_pose_file
from uq_handeye.trials.simulation.rig import RIGS
from uq_handeye.use.planning import plan as planning
from uq_handeye.use.planning.by_posterior import CRITERIA
from uq_handeye.use.planning.candidates import sample_candidates
from uq_handeye.use.planning.plan import plan
from uq_handeye.use.planning.weak_prior import OPEN_SD, WEAK_PRIOR_SD

NOISE = PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
SETUPS = ("eye-in-hand", "eye-to-hand")
POINT = (0.05, -0.02, 0.4)


def arguments(criterion):
    return {"criterion": criterion} | ({"point": POINT} if criterion == "point" else {})


def enlarged(data, found, steps):
    """The poses so far and the first steps of a plan, without noise."""
    robot = np.concatenate([data.robot, found.robot[:steps]])
    camera = np.concatenate([data.camera, found.camera[:steps]])
    return PosePairs(robot, camera, data.setup)


# ------------------------------------------------------------------------------------------------- what is predicted


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("criterion", CRITERIA)
def test_predicted_covariance_is_that_of_the_enlarged_set(setup, criterion):
    rng = np.random.default_rng(SEED)
    data, others = simulate(6, setup=setup, seed=1), simulate(30, setup=setup, seed=2)
    noise = PoseNoise(robot=random_covariance(rng, sd=3e-4), camera=random_covariance(rng))
    found = plan(data, others.truth.robot, 4, noise=noise, **arguments(criterion))
    assert not len(found.open_directions)
    np.testing.assert_allclose(found.X, data.truth.X, atol=1e-11)
    np.testing.assert_allclose(found.W, data.truth.W, atol=1e-11)
    np.testing.assert_allclose(found.camera, others.truth.camera[found.chosen], atol=1e-11)
    for steps, covariance in enumerate([found.covariance_before, *found.covariances]):
        everything = enlarged(data, found, steps)
        assert_same_covariance(covariance, efficient(everything, noise).covariance_X, 1e-9)
        assert_same_covariance(covariance, bound(everything, noise, data.truth.X), 1e-9)


def test_noise_of_each_pose_goes_on_as_its_mean():
    rng = np.random.default_rng(SEED)
    data = simulate(6, seed=1)
    camera = random_covariance(rng, shape=(6,))
    found = plan(data, k=2, noise=PoseNoise(NOISE.robot, camera))
    np.testing.assert_allclose(found.noise.camera, camera.mean(axis=0))
    later = PoseNoise(NOISE.robot, np.concatenate([camera, [camera.mean(axis=0)] * 2]))
    assert_same_covariance(found.covariances[-1], efficient(enlarged(data, found, 2), later).covariance_X, 1e-9)


@pytest.mark.statistical
@pytest.mark.parametrize("setup", SETUPS)
def test_simulated_sessions_scatter_as_predicted(setup):
    data = simulate(6, setup=setup, seed=SEED)
    found = plan(data, k=4, noise=NOISE)
    everything = enlarged(data, found, 4)
    rng = np.random.default_rng(SEED)
    sd_robot, sd_camera = (np.sqrt(np.diag(S)) for S in (NOISE.robot, NOISE.camera))
    trials = 1500
    robot = moved(everything.robot, sd_robot * rng.normal(size=(trials, 10, 6)))
    camera = moved(everything.camera, sd_camera * rng.normal(size=(trials, 10, 6)))
    errors = difference(efficient(PosePairs(robot, camera, setup), NOISE).X, data.truth.X)
    assert is_consistent(errors, found.covariances[-1])
    for wrong in (found.covariance_before, found.covariances[-2]):
        assert not is_consistent(errors, wrong)


def test_criteria_are_mean_squared_errors():
    data = simulate(8, seed=3)
    rng = np.random.default_rng(SEED)
    by_length = plan(data, k=1, noise=NOISE, length="300mm")
    directions = rng.normal(size=(4000, 3))
    points = 0.3 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    points = np.concatenate([points, -points])  # the cross terms then vanish

    def carried(xi):
        return (moved(by_length.X, xi)[:, None, :3, :] @ np.append(points, np.ones((8000, 1)), 1)[..., None])[..., 0]

    for covariance, stated in (
        (by_length.covariance_before, by_length.criterion_before),
        (by_length.covariances[0], by_length.criterion_values[0]),
    ):
        J = jacobian(lambda xi: carried(xi).reshape(len(xi), -1), 6).reshape(8000, 3, 6)
        squares = np.einsum("pai,ij,paj->p", J, covariance, J)
        assert abs(squares.mean() - stated) < 6 * squares.std() / np.sqrt(4000)
        assert squares.mean() == pytest.approx(stated, rel=0.02)
    assert plan(data, k=1, noise=NOISE).length == pytest.approx(
        np.sqrt((np.linalg.norm(data.camera[:, :3, 3], axis=1) ** 2).mean())
    )
    at_point = plan(data, k=1, noise=NOISE, **arguments("point"))
    J = jacobian(lambda xi: moved(data.truth.X, xi)[:, :3] @ np.append(POINT, 1.0), 6)
    assert at_point.criterion_before == pytest.approx(np.trace(J @ at_point.covariance_before @ J.T), rel=1e-9)
    logdet = plan(data, k=1, noise=NOISE, criterion="logdet")
    assert logdet.criterion_values[0] == pytest.approx(np.log(np.linalg.det(logdet.covariances[0])), abs=1e-6)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_each_criterion_is_smallest_for_the_plan_that_was_chosen_by_it(criterion):
    data, others = simulate(5, seed=4), simulate(60, seed=5, tilt="60deg").truth.robot
    plans = {name: plan(data, others, 3, noise=NOISE, **arguments(name)) for name in CRITERIA}
    own = plans[criterion]
    M = np.concatenate([-np.cross(own.X[:3, :3] @ POINT, np.eye(3)).T, np.eye(3)], axis=1)
    measure = {
        "trace": lambda S: np.trace(S[3:, 3:]) + 2 / 3 * plans["trace"].length ** 2 * np.trace(S[:3, :3]),
        "point": lambda S: np.trace(M.T @ M @ S),
        "logdet": lambda S: np.linalg.slogdet(S)[1],
    }[criterion]
    assert own.criterion_values[-1] == pytest.approx(measure(own.covariances[-1]), rel=1e-9)
    assert all(measure(own.covariances[-1]) <= measure(other.covariances[-1]) + 1e-12 for other in plans.values())
    assert (np.diff([own.criterion_before, *own.criterion_values]) < 0).all()


# ---------------------------------------------------------------------------------------------------------- selection


def problem(rng, m):
    """Information (12, 12) of six poses or so, and rows of m candidates."""
    start = rng.normal(size=(36, 12)) * np.exp(rng.normal(size=12))
    return start.T @ start, rng.normal(size=(m, 6, 12)) * np.exp(rng.normal(size=(m, 1, 1)))


def weights(rng):
    M = rng.normal(size=(3, 6))
    return (None, M.T @ M, np.diag([0.3] * 3 + [1.0] * 3))


def direct(information, Q):
    S = np.linalg.inv(information)[:6, :6]
    return np.log(np.linalg.det(S)) if Q is None else np.trace(Q @ S)


def test_rank_six_updates_equal_inversion():
    rng = np.random.default_rng(SEED)
    information, rows = problem(rng, 9)
    for Q in weights(rng):
        values = after(covariance_of(information), rows, Q)
        np.testing.assert_allclose(values, [direct(information + B.T @ B, Q) for B in rows], rtol=1e-9)


@pytest.mark.slow
def test_two_of_eight_against_all_pairs():
    """Over 40 problems and three criteria: never below the optimum, at it in most, near it in the mean."""
    rng = np.random.default_rng(SEED)
    gaps, greedy_gaps = [], []
    for _ in range(40):
        information, rows = problem(rng, 8)
        for Q in weights(rng):
            gram = rows.mT @ rows
            best = min(direct(information + gram[i] + gram[j], Q) for i, j in combinations(range(8), 2))
            scale = 1.0 if Q is None else best
            first = greedy(information, rows, np.arange(8), 2, Q, False)
            for chosen, found in ((first, greedy_gaps), (exchanged(information, rows, first, Q, False), gaps)):
                assert len(set(chosen)) == 2
                reached = direct(information + sum(rows[i].T @ rows[i] for i in chosen), Q)
                found.append((reached - best) / scale)
    gaps, greedy_gaps = np.array(gaps), np.array(greedy_gaps)
    assert gaps.min() > -1e-9
    assert (gaps <= greedy_gaps + 1e-9).all()
    assert (gaps < 1e-9).mean() > 0.85
    assert gaps.mean() < min(0.01, greedy_gaps.mean())


def test_no_single_exchange_improves_the_plan():
    rng = np.random.default_rng(SEED)
    information, rows = problem(rng, 15)
    for Q in weights(rng):
        chosen = exchanged(information, rows, np.arange(4), Q, False)
        reached = direct(information + sum(rows[i].T @ rows[i] for i in chosen), Q)
        for place in range(4):
            for i in set(range(15)) - set(chosen):
                other = [*np.delete(chosen, place), i]
                assert direct(information + sum(rows[j].T @ rows[j] for j in other), Q) > reached - 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("criterion", CRITERIA)
def test_plan_beats_random_choice(criterion):
    data = simulate(6, seed=SEED)
    X, W = data.truth.X, data.truth.W
    candidates = sample_candidates(data, X, W, 100, seed=SEED)
    found = plan(data, candidates, 4, noise=NOISE, **arguments(criterion))
    rng = np.random.default_rng(SEED)
    random = [
        plan(
            data, candidates[rng.choice(100, 4, replace=False)], 4, noise=NOISE, **arguments(criterion)
        ).criterion_values[-1]
        for _ in range(60)
    ]
    assert found.criterion_values[-1] < min(random)


def test_candidates_that_do_not_see_the_target_are_left_out():
    data, others = simulate(8, noise=NOISE, seed=1), simulate(6, seed=2).truth.robot
    turned = others @ data.truth.X @ np.diag([1.0, -1.0, -1.0, 1.0]) @ np.linalg.inv(data.truth.X)  # looks away
    found = plan(data, np.concatenate([turned, others]), 4, noise=NOISE)
    assert found.n_candidates == 12 and (found.chosen >= 6).all()
    with pytest.raises(InputError, match="got 0 of 6: at the others the target is behind the camera"):
        plan(data, turned, 2, noise=NOISE)


def test_repeat():
    data = simulate(6, seed=1)
    candidates = simulate(3, seed=2).truth.robot
    found = plan(data, candidates, 5, noise=NOISE, repeat=True)
    assert len(found.chosen) == 5
    everything = enlarged(data, found, 5)
    assert_same_covariance(found.covariances[-1], efficient(everything, NOISE).covariance_X, 1e-9)
    once = plan(data, candidates, 3, noise=NOISE)
    assert sorted(once.chosen) == [0, 1, 2]
    assert plan(data, candidates, 3, noise=NOISE, repeat=True).criterion_values[-1] <= once.criterion_values[-1]


# -------------------------------------------------------------------------------------------------------- open starts


def open_session(setup, turn, noisy, seed):
    """Robot poses that turn about the base's z axis alone (up to ``turn`` degrees) and move."""
    rng = np.random.default_rng(seed)
    X, W = RIGS[setup]
    start = simulate(1, setup=setup, seed=seed).robot[0]
    R = Rotation.from_rotvec(np.outer(rng.uniform(-np.radians(turn), np.radians(turn), 8), [0, 0, 1])).as_matrix()
    G = transforms(R @ start[:3, :3], start[:3, 3] + rng.uniform(-0.15, 0.15, (8, 3)))
    C = np.linalg.inv(X) @ (np.linalg.inv(G) if setup == "eye-in-hand" else G) @ W
    if noisy:
        G = moved(G, np.sqrt(np.diag(NOISE.robot)) * rng.normal(size=(8, 6)))
        C = moved(C, np.sqrt(np.diag(NOISE.camera)) * rng.normal(size=(8, 6)))
    axis = start[:3, :3].T @ [0, 0, 1] if setup == "eye-in-hand" else np.array([0.0, 0.0, 1.0])
    return PosePairs(G, C, setup), X, W, axis


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("noisy", [False, True])
@pytest.mark.parametrize("seed", [SEED, SEED + 1])
def test_parallel_axes(setup, noisy, seed):
    """X is found but for its translation along the axis, which the plan names and the first new pose determines."""
    data, X, W, axis = open_session(setup, 60, noisy, seed)
    found = plan(data, k=3, noise=NOISE, seed=seed)
    ((direction),) = found.open_directions
    assert abs(direction[3:] @ axis) > 0.999
    assert found.worst[0, 1] == pytest.approx(WEAK_PRIOR_SD, rel=1e-3)
    assert found.worst[1, 1] < 3e-3
    error = difference(found.X, X)
    assert np.linalg.norm(error[:3]) < 6e-3
    assert np.linalg.norm(error[3:] - axis * (axis @ error[3:])) < 0.01
    assert "open: translation along" in found.to_text()
    assert "weak prior" in found.to_text()
    # The poses, taken with the true rig: what they bring is near what was predicted from a guess of X.
    camera = np.linalg.inv(X) @ (np.linalg.inv(found.robot) if setup == "eye-in-hand" else found.robot) @ W
    exact, *_ = open_session(setup, 60, False, seed)
    both = PosePairs(*(np.concatenate(pair) for pair in ((exact.robot, found.robot), (exact.camera, camera))), setup)
    ratio = np.sqrt(np.diag(bound(both, NOISE, X)) / np.diag(found.covariances[-1]))
    assert (np.abs(np.log(ratio)) < np.log(1.5)).all(), ratio


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS)
def test_pure_translations(setup):
    data, X, *_ = open_session(setup, 0, True, SEED)
    found = plan(data, k=3, noise=NOISE)
    assert len(found.open_directions) == 3
    assert np.linalg.norm(found.open_directions[:, 3:], axis=1).min() > 0.99
    assert np.linalg.norm(difference(found.X, X)[:3]) < 0.02
    assert np.linalg.norm(difference(found.X, X)[3:]) < 0.15  # the part on the gripper is near its origin
    assert found.worst[-1, 1] < 3e-3


@pytest.mark.slow
def test_a_direction_is_open_by_its_standard_deviation():
    """Hardly more than parallel axes: open or not by the covariance that `efficient` gives."""
    rng = np.random.default_rng(SEED)
    X, W = RIGS["eye-in-hand"]
    seen = set()
    for tilt in (2e-4, 2e-3, 2e-2, 0.2):
        data, *_ = open_session("eye-in-hand", 60, False, SEED)
        G = moved(data.robot, np.concatenate([tilt * rng.normal(size=(8, 3)), np.zeros((8, 3))], axis=1))
        C = np.linalg.inv(X) @ np.linalg.inv(G) @ W
        found = plan(PosePairs(G, C), k=1, noise=NOISE)
        smallest, *_, largest = np.linalg.eigvalsh(bound(PosePairs(G, C), NOISE, X))
        largest = np.inf if smallest < 1e-12 * largest else np.sqrt(largest)  # without variance: open
        assert (len(found.open_directions) == 1) == (largest > OPEN_SD)
        if largest <= OPEN_SD:
            assert_same_covariance(found.covariance_before, bound(PosePairs(G, C), NOISE, X), 1e-4)
        seen.add(largest > OPEN_SD)
    assert seen == {True, False}


# --------------------------------------------------------------------------------------------------------- candidates


@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("flip", [False, True])
def test_candidates_stay_near_the_poses_so_far(setup, flip):
    data = simulate(8, setup=setup, seed=SEED)
    X, W = data.truth.X, data.truth.W
    if flip:  # a camera that looks along its -z axis
        turn = np.diag([1.0, -1.0, -1.0, 1.0])
        data, X = PosePairs(data.robot, turn @ data.camera, setup), X @ turn
    robot = sample_candidates(data, X, W, 300, seed=1)
    assert robot.shape == (300, 4, 4)
    np.testing.assert_array_equal(robot, sample_candidates(data, X, W, 300, seed=1))
    G = robot if setup == "eye-in-hand" else np.linalg.inv(robot)
    C = np.linalg.inv(X) @ np.linalg.inv(G) @ W
    distance, before = (np.linalg.norm(T[:, :3, 3], axis=1) for T in (C, data.camera))
    assert distance.min() > 0.8 * before.min() - 1e-9
    assert distance.max() < 1.2 * before.max() + 1e-9
    assert distance.min() < before.min()
    assert distance.max() > before.max()
    image, seen = ((T[:, :2, 3] / T[:, 2:3, 3]) for T in (C, data.camera))
    assert (image > seen.min(axis=0) - 1e-9).all()
    assert (image < seen.max(axis=0) + 1e-9).all()
    # Lines of sight in the target's frame: within 15 degrees of the cone that held those so far.
    line, held = (
        (np.swapaxes(T[:, :3, :3], 1, 2) @ T[:, :3, 3:])[..., 0] / np.linalg.norm(T[:, :3, 3], axis=1)[:, None]
        for T in (C, data.camera)
    )
    centre = held.mean(axis=0) / np.linalg.norm(held.mean(axis=0))
    assert np.degrees(np.arccos(line @ centre).max() - np.arccos(held @ centre).max()) < 25
    assert np.arccos(line @ centre).max() > np.arccos(held @ centre).max()
    low, high = data.robot[:, :3, 3].min(axis=0), data.robot[:, :3, 3].max(axis=0)
    margin = 0.15 * max(np.linalg.norm(high - low), before.max())
    assert (robot[:, :3, 3] > low - margin - 1e-9).all()
    assert (robot[:, :3, 3] < high + margin + 1e-9).all()


def test_candidates_that_cannot_be():
    data = simulate(8, seed=SEED)
    X, W = data.truth.X.copy(), data.truth.W
    X[:3, 3] += 20.0
    with pytest.raises(InputError, match="None of 500 poses"):
        sample_candidates(data, X, W, 10, seed=SEED)
    camera = data.camera.copy()
    camera[3, :3, 3] = 0.0
    with pytest.raises(InputError, match="Camera pose 3 is at the target"):
        sample_candidates(PosePairs(data.robot, camera), data.truth.X, W, 10, seed=SEED)
    for n in (0, 1.5, True, 100_001):
        with pytest.raises(InputError, match="between 1 and 100000"):
            sample_candidates(data, data.truth.X, W, n, seed=SEED)


# ------------------------------------------------------------------------------------------------ arguments and output


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"k": 0}, "`k` to be an integer of at least 1, got 0"),
        ({"k": 2.5}, "`k`"),
        ({"k": 6, "candidates": RIGS["eye-in-hand"][0][None]}, "k = 6 and 1 candidates"),
        ({"candidates": np.eye(4)}, "candidates"),
        ({"candidates": np.zeros((3, 4, 4))}, "candidates"),
        ({"candidates": np.zeros((0, 4, 4))}, "m >= 1"),
        ({"candidates": np.broadcast_to(np.eye(4), (100_001, 4, 4))}, "at most 100000 candidates, got 100001"),
        ({"criterion": "magic"}, "trace, logdet, point"),
        ({"criterion": "point"}, "go together"),
        ({"point": POINT}, "go together"),
        ({"criterion": "point", "point": (1, 2)}, "`point`"),
        ({"criterion": "point", "point": (1, 2, "3")}, "unit"),
        ({"criterion": "logdet", "length": 1.0}, "length"),
        ({"length": 0.0}, "above 0"),
        ({"sample": 0}, "between 1 and"),
        ({"noise": PairNoise.isotropic(A=("1mrad", "1mm"))}, "PairNoise"),
        ({"noise": PoseNoise(camera=np.eye(60))}, "marginals"),
        ({"noise": PoseNoise(camera=np.broadcast_to(np.eye(6), (4, 6, 6)))}, "cover 10 poses, got 4"),
        ({"noise": PoseNoise(camera=np.diag([1.0, 1, 1, 0, 0, 0]))}, "exact"),
        ({"data": simulate(2)}, "at least 3 poses"),
        ({"data": simulate(4, trials=2)}, "batch"),
        ({"data": "poses"}, "PosePairs"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, dict) else None,
)
def test_bad_arguments(change, message):
    given = {"data": simulate(10), "noise": NOISE} | change
    with pytest.raises(InputError, match=message):
        plan(given.pop("data"), **given)


@pytest.mark.slow
def test_the_number_of_poses_until_a_tolerance_is_met():
    poses = simulate(n_poses=10, noise=NOISE, seed=4)
    found = plan(poses, k=3, noise=NOISE, shared=[], tolerance="0.6mm", seed=1)
    assert found.needed is not None and 1 <= found.needed <= 60
    assert f"PASS for 0.6 mm after {found.needed} more pose" in found.to_text()
    assert json.loads(found.to_json())["poses_until_pass"] == found.needed
    taken = plan(poses, k=found.needed, noise=NOISE, shared=[], repeat=True, seed=1)
    reference, R = calibrate(poses, noise=NOISE, shared=[]).reference, taken.X[:3, :3]
    wanted = Tolerance.read("0.6mm")
    before, after = (probability_within(S, reference, wanted, R) for S in taken.of_cameras[-2:, 0])
    assert before < 0.95 <= after
    assert plan(poses, k=1, noise=NOISE, shared=[], tolerance="50mm").needed == 0
    hopeless = plan(poses, k=1, noise=NOISE, tolerance="0.005mm")
    said = " ".join(hopeless.to_text().split())
    assert hopeless.needed is None and "More poses will not reach 0.005 mm" in said
    assert "60 more do not. Accept a larger tolerance." in said
    for shared, remedies in (  # only for errors that the plan includes
        (("focal length", "target scale"), "Measure the target, give the intrinsics, or accept a larger tolerance."),
        (("robot accuracy",), "Give the arm or accept a larger tolerance."),
    ):
        assert remedies in " ".join(dataclasses.replace(hopeless, shared=shared).to_text().split())


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_a_result_that_leaves_a_part_of_X_open_is_planned_from_as_its_poses_are():
    poses = simulate(n_poses=3, noise=NOISE, seed=5)
    result = calibrate(poses)
    assert result.opened is not None
    of_poses, of_result = plan(poses, k=2, sample=30), plan(result, k=2, sample=30)
    np.testing.assert_array_equal(of_result.chosen, of_poses.chosen)
    np.testing.assert_allclose(of_result.of_cameras, of_poses.of_cameras, rtol=1e-9)


@pytest.mark.slow
def test_drawn_poses_stay_above_the_floor():
    poses = simulate(n_poses=10, noise=NOISE, seed=4)
    lowest = plan(poses, k=5, noise=NOISE).robot[:, 2, 3].min()
    floor = lowest + 0.02
    found = plan(poses, k=5, noise=NOISE, floor=floor)
    assert min(found.robot[:, 2, 3].min(), (found.robot @ found.X)[:, 2, 3].min()) >= floor


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS)
def test_more_poses_do_not_average_out_what_all_share(setup):
    data, others = simulate(6, setup=setup, seed=1), simulate(30, setup=setup, seed=2)
    errors = [SharedError.focal_length("0.2%"), SharedError.robot_scale("0.1%"), SharedError.principal_point("2mrad")]
    found = plan(data, others.truth.robot, 4, noise=NOISE, shared=[*errors, SharedError.target_scale("none")])
    assert found.shared == tuple(error.name for error in errors) == tuple(found.to_dict()["shared"])
    assert "for what all poses share of focal length, robot scale" in " ".join(found.to_text().split())
    for steps, covariance in enumerate([found.covariance_before, *found.covariances]):
        everything = enlarged(data, found, steps)
        noise = with_shared(NOISE, shared_columns([error.bound(data) for error in errors], everything))
        assert_same_covariance(covariance, efficient(everything, noise).covariance_X, 1e-8)
    assert (found.std > 1.05 * plan(data, others.truth.robot, 4, noise=NOISE).std).any(axis=1).all()


@pytest.mark.slow
def test_shared_errors_by_default():
    data = simulate(20, noise=NOISE, seed=SEED)
    found = plan(data, k=1)
    assert found.shared == ("focal length", "principal point", "target scale")
    result = calibrate(data)
    np.testing.assert_allclose(found.std[0], result.std, rtol=1e-6)  # one number
    own = SharedError.columns("bend", np.ones((20, 6, 1)), 1e-4, "robot")
    with pytest.raises(InputError, match="without 'bend'"):
        plan(data, k=1, noise=NOISE, shared=[own])


def test_the_robot_stands_still_at_new_poses():
    data = simulate(8, noise=NOISE, seed=1)
    found = plan(data, k=2, noise=NOISE, shared=[SharedError.clock_offset("20ms"), SharedError.focal_length()])
    noise = with_shared(NOISE, shared_columns([SharedError.clock_offset("20ms"), SharedError.focal_length()], data))
    assert_same_covariance(found.covariance_before, efficient(data, noise).covariance_X, 5e-3)  # linearised elsewhere


def test_noise_from_the_poses_so_far(monkeypatch):
    data = simulate(30, noise=NOISE, seed=SEED)
    found = plan(data, k=2, shared=[])
    given = plan(data, k=2, noise=NOISE)
    assert (found.noise_estimated, given.noise_estimated) == (True, False)
    assert (np.abs(np.log(found.std / given.std)) < np.log(2.5)).all()
    with pytest.raises(InputError, match="cannot be estimated from poses that fit exactly"):
        plan(simulate(10))
    for error in (DegenerateMotionError("open", np.eye(6)), NotConvergedError("no end")):

        def fail(_, error=error, **__):
            raise error

        monkeypatch.setattr(planning, "calibrate", fail)
        with pytest.raises(InputError, match="which may leave a part of X open"):
            plan(data)


def test_marginals_are_the_way_out_for_joint_noise():
    data = simulate(5, seed=1)
    joint = random_covariance(np.random.default_rng(SEED), 30)
    assert plan(data, k=1, noise=PoseNoise(camera=marginals(joint))).worst[1, 1] > 0


@pytest.mark.slow
def test_output(tmp_path):
    noise = NOISE
    data = simulate(10, noise=noise, seed=SEED)
    found = plan(data, k=3, noise=noise)
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.length = 1.0
    assert found.std.shape == (4, 6)
    assert found.worst.shape == (4, 2)
    np.testing.assert_allclose(found.std[-1] ** 2, np.diag(found.covariances[-1]))
    values = json.loads(found.to_json(tmp_path / "plan.json"))
    assert values == json.loads((tmp_path / "plan.json").read_text())
    np.testing.assert_array_equal(values["before"]["covariance"], found.covariance_before)
    np.testing.assert_array_equal([step["robot"] for step in values["steps"]], found.robot)
    np.testing.assert_array_equal([step["covariance"] for step in values["steps"]], found.covariances)
    assert [step["candidate"] for step in values["steps"]] == found.chosen.tolist()
    assert (values["prior_std"], values["open_directions"]) == (None, [])
    assert found.to_csv(tmp_path / "next.csv") == (tmp_path / "next.csv").read_text()
    np.testing.assert_allclose(read_pose_file(tmp_path / "next.csv")[1], found.robot, atol=1e-14)
    for criterion in CRITERIA:
        text = plan(data, k=3, noise=noise, **arguments(criterion)).to_text()
        assert text.startswith("3 more poses would bring the translation of gripper_T_camera from ")
        assert max(map(len, text.splitlines())) <= 120
        assert "first order" in text
    assert repr(found) == "Plan(3 poses after 10, criterion trace)"


@pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")
@pytest.mark.parametrize(("name", "tolerance", "is_open"), [("kuka_1", 0.3, True), ("nguyen_pham", 0.05, False)])
def test_real_poses_bring_what_was_predicted(name, tolerance, is_open):
    """Plan 5 poses after the first 8: predicted without their camera poses, then calibrated with them."""
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / name
    data = read_poses(folder / "robot.csv", folder / "camera.csv")
    noise = PoseNoise.isotropic(robot=("0.05deg", "0.2mm"), camera=("0.2deg", "1mm"))
    found = plan(PosePairs(data.robot[:8], data.camera[:8]), data.robot[8:], 5, noise=noise)
    assert bool(len(found.open_directions)) == is_open
    rows = np.append(np.arange(8), 8 + found.chosen)
    later = efficient(PosePairs(data.robot[rows], data.camera[rows]), noise)
    assert (np.abs(np.log(np.sqrt(np.diag(later.covariance_X)) / found.std[-1])) < tolerance).all()


def test_value_of_a_stack():
    S = random_covariance(np.random.default_rng(SEED), shape=(4,), sd=1.0)
    np.testing.assert_allclose(value(S, np.eye(6)), np.trace(S, axis1=1, axis2=2))
    np.testing.assert_allclose(value(S, None), np.log(np.linalg.det(S)))


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS)
def test_a_prior_of_x_closes_what_parallel_axes_leave_open(setup):
    """The plan starts from what `efficient` knows with the prior; without, from the weak one."""
    data = rig("scara", 8, np.random.default_rng([SEED, 19]), setup)
    known = PosePrior.of((data.truth.X, np.diag([np.inf] * 5 + [1e-6])))
    noise = PoseNoise(NOISE.robot, NOISE.camera, prior=known)
    without = plan(data, noise=NOISE, k=2, sample=40)
    found = plan(data, noise=noise, k=2, sample=40)
    assert len(without.open_directions) == 1 and len(found.open_directions) == 0
    assert_same_covariance(found.covariance_before, efficient(data, noise).covariance_X, 0.05)
    assert np.sqrt(found.covariance_before[5, 5]) < 1.01e-3 < np.sqrt(without.covariance_before[5, 5])
    assert (np.diff([found.criterion_before, *found.criterion_values]) < 0).all()


def test_a_weak_prior_of_x_is_no_obstacle():
    """One that leaves the direction open all the same (standard deviation 0.5 m)."""
    data = rig("scara", 8, np.random.default_rng([SEED, 20]))
    known = PosePrior.of((data.truth.X, np.diag([np.inf] * 5 + [0.25])))
    found = plan(data, noise=PoseNoise(NOISE.robot, NOISE.camera, prior=known), k=2, sample=40)
    assert len(found.open_directions) == 1 and found.criterion_values[-1] < found.criterion_before
