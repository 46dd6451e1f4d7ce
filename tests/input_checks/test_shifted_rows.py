"""Shifted pairings: found where they are, told truly, and never reported by chance."""

import os
from pathlib import Path

import numpy as np
import pytest
from fixtures.pictures import simulated_rig
from fixtures.rigs import quietly
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline
from support import SEED, moved, random_transforms, transforms

import uq_handeye as uq
from uq_handeye.core.files.source import Source
from uq_handeye.fit.diagnostics import shifted_rows
from uq_handeye.fit.diagnostics.shifted_rows import Shift, _refined, _viterbi, find_shift
from uq_handeye.fit.graph.consensus import consensus
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.model.poses.timing import Timing
from uq_handeye.read import read_poses

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
needs_data = pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")


def still_poses(n, rng):
    return uq.simulate(n, noise=NOISE, setup=("eye-in-hand", "eye-to-hand")[n % 2], seed=rng)


def video(n, rng, every=30):
    """A smooth path through poses that are ``every`` frames apart, with the same noise."""
    key = uq.simulate(n // every + 4, seed=rng)
    knots = np.arange(len(key))
    frames = np.linspace(0, n / every, n)
    R = RotationSpline(knots, Rotation.from_matrix(key.robot[:, :3, :3]))(frames).as_matrix()
    robot = transforms(R, CubicSpline(knots, key.robot[:, :3, 3])(frames))
    camera = np.linalg.inv(robot @ key.truth.X) @ key.truth.W
    deviations = np.sqrt([np.diag(NOISE.robot), np.diag(NOISE.camera)])
    return uq.PosePairs(
        *(moved(T, sd * rng.normal(size=(n, 6))) for T, sd in zip((robot, camera), deviations, strict=True))
    )


def without(poses, robot=(), camera=()):
    """Rows lost in either file; the longer one is cut at its end, as a reader of pairs would."""
    lists = [np.delete(T, list(rows), axis=0) for T, rows in ((poses.robot, robot), (poses.camera, camera))]
    n = min(map(len, lists))
    return uq.PosePairs(*(T[:n] for T in lists), poses.setup)


def dirty(poses, rng):
    """10 % of the camera poses are anything."""
    rows = rng.choice(poses.n, poses.n // 10, replace=False)
    camera = poses.camera.copy()
    camera[rows] = random_transforms(rng, (len(rows),))
    return uq.PosePairs(poses.robot, camera, poses.setup)


@pytest.mark.slow
@pytest.mark.parametrize("make", [still_poses, video])
@pytest.mark.parametrize("k", [1, 2, 5, -1, -3])
def test_whole_file(make, k):
    rng = np.random.default_rng([SEED, k + 5])
    poses = make(45 if make is still_poses else 150, rng)
    for given in (poses, dirty(poses, rng)):
        shifted = without(given, robot=range(k)) if k > 0 else without(given, camera=range(-k))
        found = find_shift(shifted)
        assert found.stretches == ((0, shifted.n, k),)
        assert max(found.ratio) < 0.3
        paired = found.apply(shifted)
        assert paired.n == shifted.n - abs(k) == len(found.robot_rows)
        np.testing.assert_array_equal(found.camera_rows - found.robot_rows, k)
        assert f"belongs to camera row i {'+' if k > 0 else '-'} {abs(k)}" in str(found.finding)
        assert ("camera" if k > 0 else "robot") in str(found.finding).split("begins")[0]
        if given is poses:  # X of the rows paired anew is that of the rig
            truth = uq.simulate(4, setup=poses.setup).truth.X
            np.testing.assert_allclose(efficient(paired, NOISE).X, truth, atol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("n", [30, 61, 200])
def test_rows_lost_in_the_middle(n):
    rng = np.random.default_rng([SEED, n])
    m = int(rng.integers(8, n - 10))
    poses = still_poses(n, rng)
    found = find_shift(without(poses, camera=[m]))
    assert found.stretches == ((0, m, 0), (m, n - 1, -1))
    assert m not in found.robot_rows
    assert f"nothing for robot row {m} (no detection?)" in str(found.finding)
    assert f"from robot row {m + 1} on, robot row i belongs to camera row i - 1" in str(found.finding)
    assert f"leave out robot row {m} and camera row {n - 2}" in str(found.finding)

    found = find_shift(without(poses, robot=[m]))
    assert found.stretches == ((0, m, 0), (m, n - 1, 1))
    assert f"robot file has nothing for camera row {m}" in str(found.finding)
    assert f"leave out robot row {n - 2} and camera row {m}" in str(found.finding)
    np.testing.assert_allclose(found.apply(without(poses, robot=[m])).camera, np.delete(poses.camera, m, 0)[: n - 2])


def test_several_rows_lost():
    rng = np.random.default_rng(SEED)
    poses = still_poses(80, rng)
    found = find_shift(without(poses, camera=[20, 21, 50]))
    assert found.stretches == ((0, 20, 0), (20, 50, -2), (50, 77, -3))
    assert "robot rows 20 to 21" in str(found.finding) and "robot row 50" in str(found.finding)
    assert "leave out robot rows 20 to 21, 50 and camera rows 74 to 76" in str(found.finding)
    np.testing.assert_array_equal(found.robot_rows, np.setdiff1d(np.arange(77), [20, 21, 50]))
    # one lost in each file: the rows after both belong together again
    found = find_shift(without(poses, camera=[20], robot=[60]))
    assert [k for _, _, k in found.stretches] == [0, -1, 0]


def test_drop_in_a_video():
    """Neighbouring frames are alike: the row is found to a few frames, the shift exactly."""
    rng = np.random.default_rng(SEED)
    found = find_shift(without(video(300, rng), camera=range(120, 125)))
    assert [k for _, _, k in found.stretches] == [0, -5]
    assert abs(found.stretches[1][0] - 120) <= 3


@pytest.mark.slow
@pytest.mark.parametrize("make", [still_poses, video])
def test_silent_where_rows_belong_together(make):
    for n in (8, 12, 15, 31, 60, 200):
        for trial in range(6):
            rng = np.random.default_rng([SEED, n, trial])
            poses = make(n, rng)
            assert find_shift(poses) is None
            assert find_shift(dirty(poses, rng)) is None


@pytest.mark.slow
def test_silent_where_no_shift_helps():
    """Camera rows in random order, a wrong setup, poses that never turn, frames that hardly differ."""
    rng = np.random.default_rng(SEED)
    for n in (15, 30, 60):
        for _ in range(5):
            poses = still_poses(n, rng)
            assert find_shift(uq.PosePairs(poses.robot, poses.camera[rng.permutation(n)], poses.setup)) is None
    # Consecutive wrong rows at the end of a file are no shift.
    poses = still_poses(40, rng)
    camera = poses.camera.copy()
    camera[30:] = random_transforms(rng, (10,))
    assert find_shift(uq.PosePairs(poses.robot, camera, poses.setup)) is None
    robot = np.tile(poses.robot[:1], (40, 1, 1))
    assert find_shift(uq.PosePairs(robot, np.tile(poses.camera[:1], (40, 1, 1)))) is None
    for trial in range(5):  # what one frame of it moves is within the noise
        slow = video(100, np.random.default_rng([SEED, trial]), every=400)
        assert find_shift(without(slow, robot=[0])) is None
    with pytest.raises(uq.InputError, match="without leading axes"):
        find_shift(uq.simulate(20, noise=NOISE, trials=2))


def test_path_against_all_paths():
    """The dynamic program finds the cheapest of all paths."""
    rng = np.random.default_rng(SEED)
    for _ in range(10):
        cost = rng.random((7, 3)) * 3
        paths = np.stack(np.meshgrid(*[np.arange(3)] * 7, indexing="ij"), axis=-1).reshape(-1, 7)
        totals = cost[np.arange(7), paths].sum(axis=1) + 3.0 * (np.diff(paths, axis=1) != 0).sum(axis=1)
        np.testing.assert_array_equal(_viterbi(cost), paths[np.argmin(totals)])


def test_change_begins_at_the_rows_without_partner():
    shifts = np.arange(-2, 3)
    cost = np.ones((20, 5))
    cost[:9, 2], cost[11:, 0] = 0.1, 0.1  # k = 0 before row 9, -2 from row 11 on: 9 and 10 have no partner
    for edge in (8, 9, 10, 11, 12):
        assert _refined([(0, edge, 0), (edge, 20, -2)], cost, shifts) == [(0, 9, 0), (9, 20, -2)]


@pytest.mark.slow
def test_rows_that_belong_together_cost_no_robust_fit(monkeypatch):
    fits = []
    monkeypatch.setattr(shifted_rows, "consensus", lambda *arguments: fits.append(arguments) or consensus(*arguments))
    rng = np.random.default_rng(SEED)
    small, large = still_poses(30, rng), video(2000, rng)
    assert find_shift(small) is None and not fits
    assert find_shift(without(large, robot=range(20))).stretches == ((0, 1980, 20),)
    assert len(fits) == 2


@pytest.mark.slow
@needs_data
def test_real_arm():
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / "kuka_1"
    poses = read_poses(folder / "robot.csv", folder / "camera.csv")
    assert find_shift(poses) is None
    for k in (1, 2, 5):
        assert find_shift(without(poses, robot=range(k))).stretches == ((0, 30 - k, k),)
        assert find_shift(without(poses, camera=range(k))).stretches == ((0, 30 - k, -k),)
    for m in range(7, 23):
        assert find_shift(without(poses, camera=[m])).stretches == ((0, m, 0), (m, 29, -1))
    assert find_shift(without(poses, camera=[8, 20])).stretches == ((0, 8, 0), (8, 20, -1), (20, 28, -2))


@needs_data
@pytest.mark.parametrize("name", ["wu_2019_as_published", "ethz_robot_arm_sync", "synthetic_camera_2"])
def test_silent_on_real_data(name):
    """The first is a set whose rows lag by 1 to 16 rows, and whose z is lost: no shift explains it."""
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / name
    assert find_shift(read_poses(folder / "robot.csv", folder / "camera.csv")) is None


def test_two_short_stretches_with_a_large_change_between_them():
    """More rows without partner than both stretches have: the change stays where it is."""
    stretches = [(0, 3, 5), (3, 6, -4), (6, 30, -4)]
    shifts = np.arange(-10, 11)
    assert _refined(stretches, np.zeros((30, len(shifts))), shifts)[0] == stretches[0]


def test_what_is_known_of_the_poses_stays_known():
    """Paired anew they keep their sources, truth, calibrated camera and timing; each side by its own rows."""
    rng = np.random.default_rng(SEED)
    poses, corners = simulated_rig(uq.Board(5, 4, 0.04), rng, n=8)
    seen = uq.calibrate_camera(corners, model="pinhole")
    rate = rng.normal(size=(8, 6))
    late = uq.PosePairs(
        poses.robot,
        seen.poses,
        truth=poses.truth,
        timestamps=np.arange(8.0),
        sources=(Source("robot.csv", "csv", 10, "0" * 64),),
        timing=Timing(0.01, 0.001, rate, "camera"),
        camera_calibration=seen,
    ).rows(np.arange(7), np.arange(1, 8))
    assert late.n == 7 and late.sources[0].name == "robot.csv"
    np.testing.assert_array_equal(late.timestamps, np.arange(7.0))
    np.testing.assert_array_equal(late.robot, poses.robot[:7])
    np.testing.assert_array_equal(late.camera, seen.poses[1:])
    np.testing.assert_array_equal(late.truth.robot, poses.truth.robot[:7])
    np.testing.assert_array_equal(late.truth.camera, poses.truth.camera[1:])
    np.testing.assert_array_equal(late.timing.rate, rate[1:])
    np.testing.assert_array_equal(late.camera_calibration.poses, seen.poses[1:])
    shift = Shift(np.arange(1, 7), np.arange(6), ((1, 7, -1),), (0.1, 0.1), "")
    again = shift.apply(late)  # each row with its own partner, as at first
    np.testing.assert_array_equal(again.truth.camera, poses.truth.camera[1:7])
    np.testing.assert_array_equal(again.truth.robot, poses.truth.robot[1:7])
    assert again.sources == late.sources and again.timing is not None and again.camera_calibration is not None


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_exchanged_rows_are_named_and_the_exchange_mends_them(setup):
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    good = uq.simulate(20, setup=setup, noise=noise, seed=SEED)
    order = np.arange(20)
    order[[5, 6, 2, 11]] = 6, 5, 11, 2
    found = [one for one in quietly(good.rows(np.arange(20), order)).findings if one.severity != "note"]
    (exchanged,) = (one for one in found if one.code == "input_checks.exchanged_rows")
    assert sorted(map(sorted, exchanged.values["pairs"])) == [[2, 11], [5, 6]]
    assert "exchange rows" in exchanged.remedy
    assert not any(one.code == "input_checks.exchanged_rows" for one in quietly(good).findings)
