"""synchronise(): two streams to pose pairs, what it refuses and says, and the offset in the covariance of X."""

import json
import math
import os
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from fixtures.streams import NOISE, motion, pose_noise, some, streams, triggered
from support import SEED, assert_same_covariance, difference, random_transforms, rotations, transforms

import uq_handeye as uq
from uq_handeye import DegenerateMotionError, InputError, InputWarning, PosePairs, Stream
from uq_handeye.fit.graph.gauss_helmert import efficient, inverse_information, offset_sensitivity
from uq_handeye.model.errors.keys import CLOCK_OFFSET
from uq_handeye.model.errors.square_roots import whiten
from uq_handeye.model.poses.timing import TimeOffset, Timing
from uq_handeye.read.synchronisation.interpolation import interpolate
from uq_handeye.read.synchronisation.refinement import honest

OFFSET, DURATION = 0.123, 12.0
DATA = os.environ.get("UQ_HANDEYE_DATA")
# The noise of the tests about behaviour: large beside what interpolation misses.
LARGER = ((1e-3, 5e-4), (3e-3, 2e-3))


def case(seed=0, **kwargs):
    rng = np.random.default_rng([SEED, seed])
    kwargs = {"noise": LARGER} | kwargs
    return streams(rng, motion(rng, DURATION), OFFSET, DURATION, **kwargs)


def again(stream, scale=1.0, shift=0.0):
    return Stream(stream.timestamps * scale + shift, stream.poses)


def of_sizes(result):
    """Covariance that the open sizes of errors and the motion of the camera in the session add."""
    beside = (move[:6].reshape(6, -1) for key, move in result.analysis.beside.items() if key != CLOCK_OFFSET)
    return sum(moves @ moves.T for moves in beside)


def calibrated(poses, **kwargs):
    """The result; what it warns of beside the offset is not of interest here, nor what else the poses share."""
    kwargs.setdefault("shared", [])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        return uq.calibrate(poses, **kwargs)


@pytest.fixture(scope="module")
def plain():
    X, W, robot, camera = case()
    return X, W, robot, camera, uq.synchronise(robot, camera)


# ------------------------------------------------------------------------------------------------ what it finds


@pytest.mark.slow
@pytest.mark.parametrize("interpolation", ["so4", "geodesic"])
@pytest.mark.parametrize(
    ("setup", "rates", "side"),
    [
        ("eye-in-hand", (200.0, 20.0), "robot"),
        ("eye-to-hand", (100.0, 30.0), "robot"),
        ("eye-in-hand", (25.0, 100.0), "camera"),
        ("eye-to-hand", (25.0, 100.0), "camera"),
    ],
)
def test_offset_and_X(interpolation, setup, rates, side):
    """Whichever stream is the denser is interpolated; offset and X are within 4 standard deviations."""
    X, W, robot, camera = case(setup=setup, rates=rates)
    sync = uq.synchronise(robot, camera, setup=setup, interpolation=interpolation)
    assert sync.side == side and sync.poses.setup == setup
    assert abs(sync.offset - OFFSET) < 4 * sync.offset_std < 2e-3
    result = calibrated(sync.poses)
    xi = difference(result.X, X)
    assert xi @ np.linalg.solve(result.covariance, xi) < 30
    assert result.W is not None and np.abs(difference(result.W, W)).max() < 5e-3
    # on the clock of the camera
    assert camera.timestamps.min() <= sync.poses.timestamps.min()
    assert sync.poses.timestamps.max() <= camera.timestamps.max()


@pytest.mark.slow
def test_both_interpolations_agree(plain):
    *_, robot, camera, sync = plain
    other = uq.synchronise(robot, camera, interpolation="geodesic")
    assert abs(other.offset - sync.offset) < 1e-6
    assert np.abs(other.poses.robot - sync.poses.robot).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(("robot_shift", "camera_shift"), [(1.7e9, 1.7e9), (-5.0, 3.0), (1.7e9, 0.0)])
def test_clocks_of_any_origin(plain, robot_shift, camera_shift):
    *_, robot, camera, sync = plain
    moved = uq.synchronise(again(robot, shift=robot_shift), again(camera, shift=camera_shift), max_offset=math.inf)
    assert abs(moved.offset - (sync.offset + robot_shift - camera_shift)) < 1e-6
    assert np.abs(moved.poses.robot - sync.poses.robot).max() < 1e-5
    assert moved.offset_std == pytest.approx(sync.offset_std, rel=1e-3)


@pytest.mark.slow
def test_order_does_not_matter(plain):
    *_, robot, camera, sync = plain
    rng = np.random.default_rng(SEED)
    shuffled = uq.synchronise(*(some(s, rng.permutation(len(s))) for s in (robot, camera)))
    assert shuffled.offset == sync.offset
    assert np.array_equal(shuffled.poses.camera, sync.poses.camera)


@pytest.mark.slow
def test_a_fifth_of_wrong_detections(plain):
    *_, robot, camera, _ = plain
    rng = np.random.default_rng(SEED)
    wrong = rng.choice(len(camera), len(camera) // 5, replace=False)
    poses = camera.poses.copy()
    poses[wrong] = random_transforms(rng, (len(wrong),))
    sync = uq.synchronise(robot, Stream(camera.timestamps, poses))
    assert abs(sync.offset - OFFSET) < 4 * sync.offset_std < 2e-3


@pytest.mark.slow
def test_exact_streams():
    """Without noise what is left is what interpolation misses; the offset is right to a microsecond."""
    _, _, robot, camera = case(noise=((0, 0), (0, 0)), rates=(500.0, 20.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        sync = uq.synchronise(robot, camera)
    assert abs(sync.offset - OFFSET) < 2e-6


def test_noise_of_the_samples_becomes_that_of_the_poses():
    """The mean of two samples has the variance w^2 + (1 - w)^2 times that of one."""
    _, _, robot, camera = case(rates=(50.0, 20.0))
    sync = uq.synchronise(robot, camera, noise=pose_noise(LARGER))
    ratio = sync.noise.robot[:, 0, 0] / LARGER[0][0] ** 2
    assert ratio.min() >= 0.5 and ratio.max() <= 1 and 0.6 < ratio.mean() < 0.73
    assert np.array_equal(sync.noise.camera, pose_noise(LARGER).camera)
    assert calibrated(sync.poses, noise=sync.noise).fit.p_value > 1e-4


def test_samples_that_neighbours_share_count_in_the_noise():
    """Every sample is in two rows at equal rates: together they tell no more than one, whatever the weights."""
    _, _, robot, camera = case(rates=(21.0, 20.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        sync = uq.synchronise(robot, camera, noise=pose_noise(LARGER))
    side = getattr(sync.noise, sync.side)
    S = getattr(pose_noise(LARGER), sync.side)
    assert 0.9 < side[:, 0, 0].mean() / S[0, 0] < 1.1
    # Of the sum over all rows it is the exact variance: that of the weights of each sample.
    found = sync.pairing.interpolated(sync.offset - sync.shift)
    found = found.rows(np.flatnonzero(found.fine))
    used = np.zeros(found.left.max() + 2)
    np.add.at(used, found.left, found.weight)
    np.add.at(used, found.left + 1, 1 - found.weight)
    assert np.allclose(side.sum(axis=0), (used**2).sum() * S, rtol=1e-9)


# --------------------------------------------------------------------------------------- the offset that is given


@pytest.mark.slow
def test_an_offset_taken_as_exact(plain):
    *_, robot, camera, _ = plain
    given = uq.synchronise(robot, camera, offset=OFFSET)
    assert given.offset == OFFSET and given.offset_std == 0 and given.origin == "given"
    result = calibrated(given.poses)
    assert "taken as exact" in result.summary(verbose=True)
    assert_same_covariance(result.covariance, result.bound + of_sizes(result), 1e-9)
    assert uq.synchronise(robot, some(camera, slice(0, None, 100)), offset=OFFSET).poses.n >= 3


@pytest.mark.slow
@pytest.mark.parametrize("offset", [-OFFSET, (-OFFSET, 1e-4)])
def test_an_offset_of_the_wrong_sign_is_contradicted(plain, offset):
    *_, robot, camera, _ = plain
    expect = "Check its sign" if isinstance(offset, float) else "contradicts"
    with pytest.warns(InputWarning, match=expect):
        uq.synchronise(robot, camera, offset=offset, max_offset=1.0)


@pytest.mark.slow
def test_a_prior_weighs_by_its_deviation(plain):
    *_, robot, camera, sync = plain
    at, std = OFFSET + 2e-5, sync.offset_std
    same = uq.synchronise(robot, camera, offset=(at, 100 * std))
    assert abs(same.offset - sync.offset) < 0.01 * std and same.offset_std == pytest.approx(std, rel=0.01)
    half = uq.synchronise(robot, camera, offset=(at, std))
    assert half.offset_std == pytest.approx(std / np.sqrt(2), rel=0.02)
    assert half.offset == pytest.approx(0.5 * (sync.offset + at), abs=0.05 * std)
    tight = uq.synchronise(robot, camera, offset=(at, 1e-3 * std))
    assert abs(tight.offset - at) < 0.01 * std and tight.offset_std < 1.1e-3 * std


@pytest.mark.parametrize("offset", ["0.1", (0.1,), (0.1, -1.0), (math.nan, 1.0), True, math.inf, [1, 2, 3]])
def test_no_offset_is_refused(plain, offset):
    with pytest.raises(InputError, match="`offset`"):
        uq.synchronise(plain[2], plain[3], offset=offset)


# ------------------------------------------------------------------------------------------------- what is left out


@pytest.mark.slow
def test_gaps_and_ends_are_left_out_and_named(plain):
    *_, robot, camera, _ = plain
    begin, end = 5.0, 5.3
    keep = (robot.timestamps > 2) & ((robot.timestamps < begin) | (robot.timestamps > end))
    sync = uq.synchronise(some(robot, keep), camera)
    gone = {part.reason.split(",")[0]: part for part in sync.left_out}
    assert len(gone) == 2
    first = gone["before the first robot pose; nothing is extrapolated"]
    gap = next(part for part in sync.left_out if part.gap)
    assert max(first.times) + sync.offset < 2.01 and gap.side == "camera"
    assert all(begin - 0.01 < t + sync.offset < end + 0.01 for t in gap.times) and len(gap.times) in (5, 6, 7)
    assert sync.poses.n + sum(len(part.times) for part in sync.left_out) == len(camera)
    robot_times = sync.poses.timestamps + sync.offset
    assert not ((robot_times > begin) & (robot_times < end)).any() and robot_times.min() > 2
    assert re.search(r"in a gap of the robot, (4.99|5.00)", sync.summary())
    bridged = uq.synchronise(some(robot, keep), camera, max_gap=1.0)
    assert not any(part.gap for part in bridged.left_out)


def test_many_gaps_are_warned_of(plain):
    *_, robot, camera, _ = plain
    with pytest.warns(InputWarning, match="left out because of gaps of more than 0.015 s"):
        uq.synchronise(some(robot, np.arange(len(robot)) % 10 < 5), camera)


def test_the_wrong_times_are_named(plain):
    *_, robot, camera, _ = plain
    with pytest.raises(InputError, match=r"robot is from 0.00\d to 1\d.\d* s, the camera from 100.\d* to 111"):
        uq.synchronise(robot, again(camera, shift=100.0))
    with pytest.raises(InputError, match="none at an offset of 50 s"):
        uq.synchronise(robot, camera, offset=50.0)
    with pytest.raises(InputError, match=r"Left out: \d camera pose.*in a gap of the robot, \d.* to \d"):
        uq.synchronise(some(robot, slice(0, None, 10)), camera, offset=OFFSET, max_gap=0.01)


@pytest.mark.parametrize(
    ("scale", "unit"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds"), (1e-6, "")]
)
def test_times_in_another_unit(plain, scale, unit):
    *_, robot, camera, _ = plain
    with pytest.raises(InputError, match=f"in seconds.*{unit}"):
        uq.synchronise(again(robot, scale), again(camera, scale))
    with pytest.raises(InputError, match="median interval"):
        uq.synchronise(robot, again(camera, scale * 10 if scale > 1 else 1e-5))


@pytest.mark.slow
def test_a_coarse_clock_is_said(plain):
    *_, robot, camera, _ = plain
    rng = np.random.default_rng(SEED)
    times = np.unique(np.round(np.sort(robot.timestamps + 5e-3 * rng.normal(size=len(robot))), 2), return_index=True)
    sync = uq.synchronise(Stream(times[0], robot.poses[times[1]]), camera)
    assert any("resolution of only 10 ms" in note for note in sync.notes)


# ----------------------------------------------------------------------------------------------- what is refused


def test_motion_that_leaves_the_offset_open(plain):
    *_, robot, camera, _ = plain
    still = Stream(robot.timestamps, np.tile(robot.poses[:1], (len(robot), 1, 1)))
    _, _, _, unrelated = case(seed=7)
    for one, other in ((still, camera), (robot, unrelated), (robot, Stream(20 - camera.timestamps, camera.poses))):
        with pytest.raises(InputError, match="not determined"):
            uq.synchronise(one, other)


def test_constant_rate_about_one_axis():
    rng = np.random.default_rng(SEED)

    def screw(t):
        return transforms(rotations(np.asarray(t)[:, None] * np.array([0.1, 0.3, 0.2])), np.zeros((len(t), 3)))

    _, _, robot, camera = streams(rng, screw, OFFSET, DURATION)
    with pytest.raises((InputError, DegenerateMotionError), match=r"not determine|determine X"):
        uq.synchronise(robot, camera)


def test_arguments_are_checked(plain):
    *_, robot, camera, _ = plain
    for bad in (None, robot.poses, "robot.csv"):
        with pytest.raises(InputError, match="`robot` to be a Stream"):
            uq.synchronise(bad, camera)
    with pytest.raises(InputError, match="at least 3 poses in `camera`"):
        uq.synchronise(robot, some(camera, slice(0, 2)))
    with pytest.raises(InputError, match="not determined"):
        uq.synchronise(robot, some(camera, slice(0, 3)))
    for name, bad in (
        ("setup", "eye"), ("interpolation", "slerp"), ("max_gap", 0.0), ("max_offset", -1), ("max_gap", math.nan),
        ("noise", 1.0), ("still", 1), ("seed", -1),
    ):  # fmt: skip
        with pytest.raises(InputError, match=name):
            uq.synchronise(robot, camera, **{name: bad})
    with pytest.raises(InputError, match=r"`robot` of the samples of a stream to be \(6, 6\)"):
        uq.synchronise(robot, camera, noise=uq.PoseNoise(robot=np.tile(np.eye(6), (len(robot), 1, 1))))


@pytest.mark.slow
def test_a_motion_that_repeats_itself_is_said():
    rng = np.random.default_rng(SEED)

    def pose(t):
        a = np.pi * np.asarray(t)
        return transforms(
            rotations(np.stack([0.5 * np.sin(a), 0.4 * np.sin(a + 1), 0.3 * np.cos(a)], axis=-1)),
            np.stack([0.1 * np.sin(a), 0.1 * np.cos(a), 0.6 + 0.05 * np.sin(2 * a)], axis=-1),
        )

    _, _, robot, camera = streams(rng, pose, OFFSET, 30.0, noise=LARGER)
    with pytest.warns(InputWarning, match="Other time offsets fit nearly as well as 0.123 s"):
        sync = uq.synchronise(robot, camera)
    assert sync.alternatives
    apart = (np.array(sync.alternatives) - OFFSET) % 2.0
    assert np.minimum(apart, 2 - apart).max() < 0.01
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        uq.synchronise(robot, camera, offset=(0.1, 0.05))


@pytest.mark.slow
def test_what_interpolation_does_to_X_is_warned_of():
    rng = np.random.default_rng(SEED)
    pose = motion(rng, DURATION, knot=0.4)
    _, _, robot, camera = streams(rng, pose, OFFSET, DURATION, rates=(40.0, 30.0), noise=NOISE)
    with pytest.warns(InputWarning, match="moves X by about"):
        uq.synchronise(robot, camera)


# ---------------------------------------------------------------------------------------------------------- stops


def stop_and_go(rng):
    keys = random_transforms(rng, (16,), smallest=0.3, largest=0.8)

    def pose(t):
        t = np.asarray(t)
        k = np.clip((t // 2).astype(int), 0, 14)
        s = np.clip(t - 2 * k - 1, 0, 1)
        return interpolate(keys[k], keys[k + 1], 1 - s**3 * (10 - 15 * s + 6 * s * s), "geodesic")

    return pose


@pytest.mark.slow
def test_one_averaged_pose_for_each_stop():
    rng = np.random.default_rng(SEED)
    X, _, robot, camera = streams(rng, stop_and_go(rng), OFFSET, 30.0, rates=(100.0, 20.0), noise=LARGER)
    moving = uq.synchronise(robot, camera)
    assert moving.stops_found == 15 and any("stops 15 times" in note for note in moving.notes)
    sync = uq.synchronise(robot, camera, still=True)
    assert sync.stops == sync.poses.n == 15 and not sync.left_out
    assert "15 stops" in sync.summary() and "hardly matters" in sync.summary()
    result = calibrated(sync.poses)
    assert "stands still" in result.summary(verbose=True)
    assert_same_covariance(result.covariance, result.bound + of_sizes(result), 1e-9)
    xi = difference(result.X, X)
    assert xi @ np.linalg.solve(result.covariance, xi) < result.quantile(0.9999)
    # an offset that is wrong by 50 ms hardly moves X
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        shifted = calibrated(uq.synchronise(robot, camera, offset=OFFSET + 0.05, still=True).poses)
    xi = difference(shifted.X, result.X)
    assert xi @ np.linalg.solve(result.covariance, xi) < 3


def test_a_robot_that_never_stops(plain):
    *_, robot, camera, sync = plain
    assert sync.stops_found == 0
    with pytest.raises(InputError, match="found 0"):
        uq.synchronise(robot, camera, still=True)


# ------------------------------------------------------------------------------------- the offset in X's covariance


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("rates", [(100.0, 20.0), (20.0, 100.0)])
def test_sensitivity_is_the_derivative_of_the_estimate(setup, rates):
    """g = d X / d offset: streams paired at two other offsets, each fitted anew."""
    _, _, robot, camera = case(setup=setup, rates=rates, noise=((1e-5, 1e-5), (1e-5, 1e-5)))
    sync = uq.synchronise(robot, camera, setup=setup, offset=OFFSET, noise=pose_noise(LARGER))
    step, found = 1e-3, []
    fit = efficient(sync.poses, sync.noise)
    for sign in (1, -1):
        other = sync.offset + sign * step
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)  # it is not what the streams show
            moved = uq.synchronise(robot, camera, setup=setup, offset=other, noise=pose_noise(LARGER))
        found.append(efficient(moved.poses, moved.noise))
    numeric = np.concatenate([difference(a, b) for a, b in zip(found[0].unknowns, found[1].unknowns, strict=True)])
    g = offset_sensitivity(fit, sync.poses.timing)
    assert np.abs(numeric / (2 * step) - g).max() < 0.01 * np.abs(g).max()


def test_covariance_is_that_of_the_joint_fit():
    """C + g v g^T with the model's v is the block of X in the inverse of the 13 x 13 information."""
    _, _, robot, camera = case(seed=3, rates=(100.0, 10.0))
    sync = uq.synchronise(robot, camera, noise=pose_noise(LARGER))
    timing = sync.poses.timing
    fit = efficient(sync.poses, sync.noise)
    j = fit.linear.sides[0] @ timing.rate[..., None]
    white = whiten(fit.factor, np.concatenate([fit.linear.J, j], axis=-1)).reshape(-1, 13)
    joint = inverse_information(white.T @ white)
    g = offset_sensitivity(fit, timing)
    assert_same_covariance(fit.covariance + joint[12, 12] * np.outer(g, g), joint[:12, :12], 1e-6)
    assert sync.model_std == pytest.approx(np.sqrt(joint[12, 12]), rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["efficient", "ml"])
@pytest.mark.parametrize("robust", [True, False])
def test_calibrate_takes_the_offset_in(plain, method, robust, tmp_path):
    sync = plain[-1]
    result = calibrated(sync.poses, method=method, robust=robust)
    offset = result.time_offset
    move = offset.std * np.array(offset.sensitivity)
    assert_same_covariance(result.covariance, result.bound + of_sizes(result) + np.outer(move, move), 1e-9)
    assert offset.share == pytest.approx(move @ np.linalg.solve(result.covariance, move))
    assert 0 < offset.share < 1
    for kind, S in result.covariances.items():  # all of them
        assert move @ np.linalg.solve(S, move) > 0.05 * offset.share, kind
    assert np.array_equal(result.covariances["model"], result.covariance)
    assert "Time offset: 12" in result.summary(verbose=True) and "makes up" in result.summary(verbose=True)
    result.to_json(tmp_path / "result.json")
    back = uq.Calibration.from_json(tmp_path / "result.json")
    assert back.time_offset == offset and np.array_equal(back.covariance, result.covariance)
    assert back.to_dict() == result.to_dict()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["sandwich", "bootstrap"])
def test_other_covariances_take_it_in(plain, kind):
    poses = plain[-1].poses.rows(np.arange(0, 220, 10))
    exact = PosePairs(poses.robot, poses.camera, poses.setup, poses.timestamps)
    without, result = (calibrated(one, covariance=kind) for one in (exact, poses))
    move = result.time_offset.std * np.array(result.time_offset.sensitivity)
    assert without.time_offset is None
    assert_same_covariance(result.covariance, without.covariance + np.outer(move, move), 1e-9)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The target is ahead of the camera")
def test_what_does_not_take_it_in_says_so(plain):
    sync = plain[-1]
    with pytest.warns(InputWarning, match="method 'park' takes it as exact"):
        result = uq.calibrate(sync.poses, method="park")
    assert any("takes it as exact" in text for text in result.warnings)
    with pytest.warns(InputWarning, match=r"bound\(\) takes it as exact"):
        uq.bound(sync.poses, pose_noise(LARGER))


@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize(
    ("name", "call"),
    [
        ("plan", lambda poses, noise: uq.plan(poses, noise=noise, k=1)),
        ("monte_carlo", lambda poses, noise: uq.monte_carlo(poses, noise=noise, trials=50, seed=SEED)),
    ],
)
def test_what_takes_the_offset_as_exact_says_so(plain, name, call):
    poses = plain[-1].poses.rows(np.arange(0, plain[-1].poses.n, 10))
    with pytest.warns(InputWarning, match=rf"{name}\(\) takes it as exact"):
        call(poses, pose_noise(LARGER))


@pytest.mark.slow
def test_damaged_files_are_refused(plain):
    data = calibrated(plain[-1].poses).to_dict()
    for name, value in (("share", 2.0), ("side", "left"), ("sensitivity", [1.0]), ("std", "1 ms")):
        with pytest.raises(InputError, match="damaged"):
            uq.Calibration.from_dict(data | {"time_offset": data["time_offset"] | {name: value}})


def test_timing_goes_with_its_poses(plain):
    sync = plain[-1]
    some_of = sync.poses.rows(np.array([3, 5, 9]))
    assert np.array_equal(some_of.timing.rate, sync.poses.timing.rate[[3, 5, 9]])
    assert (some_of.timing.offset, some_of.timing.std) == (sync.offset, sync.offset_std)
    with pytest.raises(InputError, match="`timing` of 3 poses, got one of"):
        PosePairs(some_of.robot, some_of.camera, timing=sync.poses.timing)
    for bad in (
        {"rate": np.zeros((3, 5))},
        {"std": -1.0},
        {"std": math.nan},
        {"side": "x"},
        {"rate": np.full((3, 6), np.nan)},
    ):
        with pytest.raises(InputError):
            Timing(**({"offset": 0.0, "std": 1e-3, "rate": np.zeros((3, 6)), "side": "robot"} | bad))


def test_a_time_offset_is_written_and_read():
    one = TimeOffset(-0.0149, 1e-3, "robot", (0.1, 0.2, 0.3, 0.4, 0.5, 0.6), 0.25)
    assert TimeOffset.from_dict(json.loads(json.dumps(one.to_dict()))) == one


# ------------------------------------------------------------------------------------------------ honest deviations


def test_independent_contributions_leave_the_model_alone():
    rng = np.random.default_rng(SEED)
    grown = np.array([honest(rng.normal(size=200) / 200, 1 / np.sqrt(200)) for _ in range(300)])
    assert (grown[:, 0] * np.sqrt(200) >= 1).all() and 1 < grown[:, 0].mean() * np.sqrt(200) < 1.05
    assert np.mean(grown[:, 1] == 1) > 0.97


def test_correlated_contributions_make_it_larger():
    """AR(1) with 0.8: the variance of the mean is 9 times that of independent values."""
    rng = np.random.default_rng(SEED)
    found = []
    for _ in range(100):
        c = rng.normal(size=2000)
        for k in range(1, len(c)):
            c[k] = 0.8 * c[k - 1] + 0.6 * c[k]
        found.append(honest(c / len(c), 1 / np.sqrt(len(c)))[0] * np.sqrt(len(c)))
    assert 2.6 < np.mean(found) < 3.4
    assert honest(np.zeros(100), 0.5) == (0.5, 1.0)


def test_contributions_larger_than_the_model():
    c = 3.0 * np.random.default_rng(SEED).normal(size=500) / 500
    assert 2.6 < honest(c, 1 / np.sqrt(500))[0] * np.sqrt(500) < 3.4


# --------------------------------------------------------------------------------------------------- what it shows


@pytest.mark.slow
def test_summary_figure_and_json(plain, tmp_path):
    sync = plain[-1]
    text = sync.summary()
    assert text.startswith(f"{sync.poses.n} pose pairs; time offset 12")
    for part in ("robot_time = camera_time + offset", "correlate by", "Rates: robot 200 Hz", "SO(4)", "Not covered"):
        assert part in text.replace("\n  ", " "), part
    assert max(map(len, text.splitlines())) <= 120
    data = json.loads(sync.to_json(tmp_path / "sync.json"))
    assert data["offset"] == sync.offset and data["n_poses"] == sync.poses.n
    assert json.loads((tmp_path / "sync.json").read_text()) == data
    offsets, rotation, translation = sync.residual_curve
    for curve in (rotation, translation):
        assert abs(offsets[np.argmin(curve)] - sync.offset) < 3 * (offsets[1] - offsets[0])
    figure = sync.figure()
    labels = [text.get_text() for axis in figure.axes for text in (axis.xaxis.label, axis.yaxis.label)]
    assert {"angular speed (deg/s)", "offset (ms)", "correlation of angular speeds"} <= set(labels)
    figure.savefig(tmp_path / "sync.svg")
    assert "12" in repr(sync)


def test_figure_and_summary_without_an_estimate(plain, tmp_path):
    *_, robot, camera, _ = plain
    sync = uq.synchronise(robot, some(camera, slice(0, None, 60)), offset=OFFSET)
    assert sync.residual_curve is None and "as given" in sync.summary()
    sync.figure().savefig(tmp_path / "sync.png")
    json.loads(sync.to_json())


# ------------------------------------------------------------------------------------------------------ a real robot


@pytest.mark.slow
@pytest.mark.skipif(DATA is None, reason="UQ_HANDEYE_DATA is not set")
def test_a_real_arm_that_moves_while_it_is_recorded():
    """The offset of the data set's README, -0.0149 s from the least robust residual, lies within three deviations; X is
    that of the streams that were synchronised there, once the difference of the offsets is taken into account."""
    folder = Path(DATA) / "ethz_robot_arm_async"
    robot, camera = (uq.read_stream(folder / f"{name}.csv", name) for name in ("robot", "camera"))
    sync = uq.synchronise(robot, camera)
    assert abs(sync.offset + 0.0149) < 3 * sync.offset_std < 6e-3
    assert sync.offset_std > 2 * sync.model_std  # a video: frames are not independent
    assert sync.poses.n == 1687 and [len(part.times) for part in sync.left_out] == [16]
    other = Path(DATA) / "ethz_robot_arm_sync"
    paired = uq.read_poses(other / "robot.csv", other / "camera.csv", setup="eye-in-hand")
    noise = uq.PoseNoise.isotropic(camera=("0.33deg", "2mm"))
    ours, theirs = efficient(sync.poses, noise), efficient(paired, noise)
    moved = offset_sensitivity(ours, sync.poses.timing)[:6] * (-0.0149 - sync.offset)
    assert np.abs(difference(theirs.X, ours.X) - moved).max() < 2e-5


@pytest.mark.slow
def test_few_poses_at_a_second_have_a_figure(tmp_path):
    """Some rows are at the best offset only; the noise of the others is theirs."""
    poses = uq.simulate(
        30, noise=uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm")), seed=1
    )
    times = np.arange(30.0)
    found = uq.synchronise(Stream(times, poses.robot), Stream(times, poses.camera))
    assert found.figure().axes


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The target is ahead of the camera")
@pytest.mark.filterwarnings("ignore:The camera sees its target")
@pytest.mark.parametrize("at", [0.25, 0.5])
def test_a_picture_at_each_stop_leaves_the_offset_open_within_the_stops(rng, at):
    X, robot, camera = triggered(rng, 25, at=at)
    found = uq.synchronise(robot, camera)
    (note,) = [one for one in found.findings if one.code == "synchronisation.open_within_stops"]
    low, high = note.values["low"], note.values["high"]
    assert found.origin == "open within the stops"
    assert low == pytest.approx(-1.2 * at, abs=0.1) and high == pytest.approx(1.2 * (1 - at), abs=0.1)
    assert found.offset == pytest.approx(0.5 * (low + high)) and abs(found.offset) < 2 * found.offset_std
    assert "any time offset from" in str(note) and found.alternatives == ()
    assert not found.poses.timing.matters  # X does not depend on it
    result = uq.calibrate(found.poses)
    assert np.linalg.norm(result.X[:3, 3] - X[:3, 3]) < 3e-3
    # An offset within the stops is not contradicted.
    given = uq.synchronise(robot, camera, offset=0.0)
    assert not [one for one in given.findings if one.severity != "note"]


@pytest.mark.slow
def test_stops_that_repeat_leave_periods_open(rng):
    _, robot, camera = triggered(rng, 42, cycle=7)
    with pytest.warns(InputWarning, match="Other time offsets fit nearly as well"):
        found = uq.synchronise(robot, camera)
    every = np.array([found.offset, *found.alternatives]) / 14.0
    assert len(every) > 1 and np.abs(every - np.round(every)).max() < 0.05


def test_a_camera_that_runs_free_is_not_triggered(rng):
    moving = motion(rng, DURATION)
    *_, robot, camera = streams(rng, moving, OFFSET, DURATION, rates=(100.0, 3.0))
    assert uq.synchronise(robot, camera).origin == "estimated"
