"""Shared errors: what they do to a pose against a pose found anew with wrong intrinsics, a wrong board, a wrong clock;
units and bad input."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from support import SEED

import uq_handeye as uq
from uq_handeye import InputError, PairNoise, PoseNoise, PosePairs, SharedError
from uq_handeye.model.errors.joint_covariance import JointCovariance
from uq_handeye.model.errors.keys import (
    FOCAL_LENGTH,
    LENS,
    OUTLINE,
    PRINCIPAL_POINT,
    ROBOT_ACCURACY,
    ROBOT_SCALE,
    TARGET_SCALE,
    VIEW,
)
from uq_handeye.model.errors.sizes import SIZES
from uq_handeye.model.poses.timing import Timing
from uq_handeye.model.shared_errors.assumed import (
    assumed_outline,
    bound_again,
    default_errors,
    replace_defaults,
)
from uq_handeye.model.shared_errors.in_noise import shared_columns, with_shared, without_shared
from uq_handeye.model.shared_errors.view import (
    HALF_WIDTH,
    intrinsics_columns,
    median_distance,
    outline_columns,
    target_centre,
)

NOISE = PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
SETUPS = ("eye-in-hand", "eye-to-hand")
FOCAL = 1000.0
SMALL = 1e-5
CENTRE = SharedError.principal_point()


def points(size):
    """(m, 3) of a target that is small in the picture, or not."""
    x, y = np.meshgrid(np.linspace(-size, size, 7), np.linspace(-size, size, 5))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def pixels(T, P, focal=FOCAL, centre=(0.0, 0.0)):
    p = P @ T[:3, :3].T + T[:3, 3]
    return focal * p[:, :2] / p[:, 2:] + centre


def solved(T, seen, P, focal=FOCAL, centre=(0.0, 0.0)):
    """xi = (theta, tau) from T to the pose that explains the pixels with these points and intrinsics."""

    def moved(xi):
        out = T.copy()
        out[:3, :3] = Rotation.from_rotvec(xi[:3]).as_matrix() @ T[:3, :3]
        out[:3, 3] += xi[3:]
        return out

    def residual(xi):
        return (pixels(moved(xi), P, focal, centre) - seen).ravel()

    return least_squares(residual, np.zeros(6), xtol=1e-15, ftol=1e-15, gtol=1e-15, x_scale=1e-3).x


def facing(distance=0.6, n=4):
    """camera_T_target of a target in front of the camera, tilted and beside the axis by little."""
    rng = np.random.default_rng(SEED)
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec(rng.uniform(-0.6, 0.6, (n, 3))).as_matrix()
    T[:, :3, 3] = rng.uniform(-0.02, 0.02, (n, 3))
    T[:, 2, 3] += distance
    return T


def poses_of(camera, setup="eye-in-hand"):
    return PosePairs(uq.simulate(len(camera), seed=1).robot, camera, setup)


@pytest.mark.parametrize("setup", SETUPS)
def test_target_scale_is_that_of_a_board_of_another_size(setup):
    """Squares taken as too long by SMALL, whatever the size of the board in the picture: exact."""
    T, P = facing(), points(0.1)
    F = SharedError.target_scale().at(poses_of(T, setup))
    for pose, column in zip(T, F, strict=True):
        found = solved(pose, pixels(pose, P), (1 + SMALL) * P) / SMALL
        np.testing.assert_allclose(found, column[:, 0], atol=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS)
def test_focal_length_and_principal_point_of_a_target_that_is_fitted(setup):
    """A camera taken as too long in focus, or centred elsewhere: the pose that is found anew, of the target assumed."""
    T = facing()
    poses = poses_of(T, setup)
    side = HALF_WIDTH * median_distance(T) * np.linspace(-1.0, 1.0, 4)
    x, y = np.meshgrid(side, side)
    P = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1) + target_centre(T, median_distance(T))
    of_focal, of_centre = (error.bound(poses).at(poses) for error in (SharedError.focal_length(), CENTRE))
    for i, pose in enumerate(T):
        seen = pixels(pose, P)
        longer = solved(pose, seen, P, focal=(1 + SMALL) * FOCAL) / SMALL
        np.testing.assert_allclose(longer, of_focal[i, :, 0], atol=0.03)
        for k, centre in enumerate(np.eye(2)):
            found = solved(pose, seen, P, centre=SMALL * FOCAL * centre) / SMALL
            np.testing.assert_allclose(found, of_centre[i, :, k], atol=0.06)  # what bounds an edge-on target


def test_columns_of_the_outline_carry_those_of_the_lens_to_a_board_that_is_no_square():
    """k1 moves poses of a board of 5:4 beside the middle otherwise than those of the square: as the columns say."""
    T = facing(n=12)
    distance = median_distance(T)
    half, centre = HALF_WIDTH * distance, target_centre(T, distance)
    u, v = (x.ravel() for x in np.meshgrid(np.linspace(-1, 1, 4), np.linspace(-1, 1, 4)))

    def by_lens(width, height, place):
        P = half * np.stack([np.exp(width) * u + place, np.exp(height) * v, 0 * u], axis=1) + centre
        found = []
        for pose in T:
            x = pixels(pose, P) / FOCAL
            found.append(solved(pose, FOCAL * x * (1 - SMALL * (x * x).sum(axis=1, keepdims=True)), P) / SMALL)
        return np.array(found)

    change = np.array([0.12, -0.1, 0.1, 0.0])
    told = outline_columns(T, distance, centre).reshape(len(T), 6, 4, 8)[..., 3] @ change
    moved = by_lens(*change[:3]) - by_lens(0.0, 0.0, 0.0)
    for rows in (slice(0, 3), slice(3, 6)):
        size, left = (np.linalg.norm(off[:, rows]) for off in (moved, moved - told))
        assert left < 0.3 * size


def test_an_outline_is_bound_to_poses_and_ends_with_them():
    poses = poses_of(facing(n=12))
    error = assumed_outline().bound(poses)
    assert len(error.keys) == 12 == error.at(poses).shape[-1]
    again = bound_again(OUTLINE, poses)
    np.testing.assert_array_equal(again.at(poses.rows([3, 5])), error.at(poses)[[3, 5]])


def test_robot_scale_and_clock_offset():
    data = uq.simulate(9, seed=2)
    F = SharedError.robot_scale().at(data)[..., 0]
    np.testing.assert_allclose(F[:, 3:], data.robot[:, :3, 3])
    assert not F[:, :3].any()
    # a robot that turns and moves steadily, rows in any order
    t = np.random.default_rng(0).permutation(np.arange(9.0)) / 4
    robot = np.tile(np.eye(4), (9, 1, 1))
    w, v = np.array([0.1, -0.2, 0.3]), np.array([0.05, 0.0, -0.1])
    robot[:, :3, :3] = Rotation.from_rotvec(t[:, None] * w).as_matrix()
    robot[:, :3, 3] = t[:, None] * v
    moving = PosePairs(robot, data.camera, "eye-in-hand", timestamps=t)
    rate = SharedError.clock_offset("1ms").at(moving)[..., 0]
    np.testing.assert_allclose(rate, np.tile([*w, *v], (9, 1)), atol=1e-12)


@pytest.mark.parametrize("setup", SETUPS)
def test_estimate_has_the_sign_of_what_was_used(setup):
    """Squares that were taken as 1 % too long: the error of the value used is +1 %, in both setups."""
    small = PoseNoise.isotropic(robot=("0.001deg", "0.002mm"), camera=("0.005deg", "0.02mm"))
    truth = uq.simulate(25, setup=setup, noise=small, seed=3)
    camera = truth.camera.copy()
    camera[:, :3, 3] *= 1.01
    with pytest.warns(uq.InputWarning, match="target is"):
        result = uq.calibrate(
            PosePairs(truth.robot, camera, setup),
            noise=small,
            shared=[SharedError.target_scale("2%"), SharedError.focal_length("0.1%")],
        )
    scale = result.shared[0]
    assert (scale.name, scale.side, scale.unit) == ("target scale", "camera", "")
    assert scale.estimate == pytest.approx(0.01, abs=5 * scale.sd)
    assert scale.sd < 0.002


@pytest.mark.parametrize(
    ("made", "sd"),
    [
        (SharedError.focal_length("0.1%"), [1e-3]),
        (SharedError.focal_length(0.002), [2e-3]),
        (SharedError.focal_length("300ppm"), [3e-4]),
        (SharedError.target_scale("none"), [0.0]),
        (SharedError.robot_scale("Exact"), [0.0]),
        (SharedError.clock_offset("1ms"), [1e-3]),
        (SharedError.clock_offset(0.002), [2e-3]),
        (SharedError.principal_point("1px", focal_length_px=800), [1.25e-3] * 2),
        (SharedError.principal_point("0.5 px", focal_length_px=1000), [5e-4] * 2),
        (SharedError.principal_point("1mrad"), [1e-3] * 2),
        (SharedError.principal_point("0.001"), [1e-3] * 2),
        (SharedError.principal_point(0.002), [2e-3] * 2),
        (SharedError.columns("a", np.ones((3, 6)), 2.0, "robot"), [2.0]),
        (SharedError.columns("a", np.ones((3, 6, 2)), 2.0, "robot"), [2.0, 2.0]),
        (SharedError.columns("a", np.ones((3, 6, 2)), [1, 0], "camera", unit="K"), [1.0, 0.0]),
    ],
    ids=repr,
)
def test_units(made, sd):
    np.testing.assert_allclose(made.sd, sd, rtol=1e-12)
    assert made.is_exact == (not any(sd))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SharedError.focal_length("0.1"), "deviation of the focal length to carry a unit .*%, ppm.*'0.1'"),
        (lambda: SharedError.focal_length("0.1mm"), "Unknown unit 'mm'"),
        (lambda: SharedError.focal_length("-1%"), "deviation of the focal length to be finite and >= 0, got '-1%'"),
        (lambda: SharedError.focal_length(np.nan), "deviation of the focal length to be finite, got nan"),
        (lambda: SharedError.focal_length("nan%"), "'nan%'"),
        (lambda: SharedError.focal_length(None), "deviation of the focal length to be a number or text .*None"),
        (lambda: SharedError.focal_length(True), "got True"),
        (lambda: SharedError.focal_length([0.1]), r"got \[0.1\]"),
        (lambda: SharedError.target_scale("1ms"), "target scale"),
        (lambda: SharedError.robot_scale(np.inf), "robot scale"),
        (lambda: SharedError.clock_offset("1"), "clock offset to carry a unit .*s, ms"),
        (lambda: SharedError.clock_offset(-1e-3), "clock offset to be finite and >= 0, got -0.001"),
        (lambda: SharedError.principal_point("1px"), "focal length in pixels beside .*'1px'"),
        (lambda: SharedError.principal_point("one px"), "such as '1px' or 0.001"),
        (lambda: SharedError.principal_point("-1px", focal_length_px=1000.0), ">= 0, got '-1px'"),
        (lambda: SharedError.principal_point("nanpx", focal_length_px=1000.0), "finite and >= 0"),
        (lambda: SharedError.principal_point("1px", focal_length_px=0.0), "`focal_length_px` to be above 0"),
        (lambda: SharedError.principal_point("1mm"), "Unknown unit 'mm'"),
        (lambda: SharedError.columns("", np.ones((3, 6)), 1.0, "robot"), "`name`"),
        (lambda: SharedError.columns(3, np.ones((3, 6)), 1.0, "robot"), "`name`"),
        (lambda: SharedError.columns("focal length", np.ones((3, 6)), 1.0, "robot"), "another `name`"),
        (lambda: SharedError.columns("a", np.ones((3, 6)), 1.0, "gripper"), "`side` .*'a' .*'gripper'"),
        (lambda: SharedError.columns("a", np.ones((3, 6)), 1.0, "robot", unit=3), "`unit` .*'a'"),
        (lambda: SharedError.columns("a", np.ones((3, 5)), 1.0, "robot"), r"shape \(n, 6, k\), got \(3, 5\)"),
        (lambda: SharedError.columns("a", np.ones((3, 6, 0)), 1.0, "robot"), r"got \(3, 6, 0\)"),
        (lambda: SharedError.columns("a", "text", 1.0, "robot"), "F of the shared error 'a'"),
        (lambda: SharedError.columns("a", np.full((3, 6), np.nan), 1.0, "robot"), "`F` .*'a' to be finite"),
        (lambda: SharedError.columns("a", np.ones((3, 6, 2)), [1, 2, 3], "robot"), r"one number or 2, got \(3,\)"),
        (lambda: SharedError.columns("a", np.ones((3, 6)), -1.0, "robot"), "finite and >= 0"),
        (lambda: SharedError.columns("a", np.ones((3, 6)), np.nan, "robot"), "finite and >= 0"),
        (lambda: SharedError.columns("a", np.ones((3, 6)), "1mm", "robot"), "sd of the shared error 'a'"),
    ],
)
def test_bad_errors(make, message):
    with pytest.raises(InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"shared": SharedError.focal_length()}, "`shared` to be a list of SharedError, got SharedError"),
        ({"shared": 0.001}, "`shared` to be a list of SharedError, got float"),
        ({"shared": ["focal length"]}, "got one of str"),
        ({"shared": [SharedError.focal_length(), SharedError.focal_length(0.1)]}, "got two 'focal length'"),
        (
            {"shared": [SharedError.columns("a", np.ones((12, 6, 2)), 1.0, s) for s in ("robot", "camera")]},
            "got two 'a",
        ),
        ({"shared": [SharedError.columns("a", np.ones((3, 6)), 1.0, "robot")]}, "'a' to cover 12 poses, got 3"),
        ({"shared": [SharedError.focal_length()], "noise": PairNoise(A=np.eye(6))}, "PoseNoise beside `shared`"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_bad_arguments_of_calibrate(options, message):
    data = uq.simulate(12, noise=NOISE, seed=1)
    with pytest.raises(InputError, match=message) as caught:
        uq.calibrate(data, **options)
    assert "\n" not in str(caught.value)


def test_clock_offset_needs_times():
    data = uq.simulate(12, noise=NOISE, seed=1)
    timeless = PosePairs(data.robot, data.camera, data.setup)
    with pytest.raises(InputError, match="timestamps for the shared error 'clock offset', got none"):
        uq.calibrate(timeless, noise=NOISE, shared=[SharedError.clock_offset()])
    assert uq.calibrate(timeless, noise=NOISE, shared=[SharedError.clock_offset("exact")]).shared == ()


def test_what_is_exact_has_no_column(tmp_path):
    data = uq.simulate(12, noise=NOISE, seed=1)
    own = SharedError.columns("own", np.ones((12, 6, 2)), [1e-4, 0.0], "robot")
    found = shared_columns([SharedError.focal_length(0), own, SharedError.target_scale()], data)
    assert tuple(map(str, found["robot"].keys)) == ("own: 1",) and found["camera"].keys == (TARGET_SCALE,)
    result = uq.calibrate(data, noise=NOISE, shared=[SharedError.focal_length("none"), own])
    assert [entry.name for entry in result.shared] == ["own: 1"]
    result.to_json(tmp_path / "result.json")
    assert uq.Calibration.from_json(tmp_path / "result.json").shared[0].size == 1e-4


def test_a_lens_does_not_run_away_where_no_lens_looks():
    """Distortion is powers of the tangent of the angle from the axis: an arm turns a tracker's target anywhere."""
    facing, angles = Rotation.from_euler("xy", [165, 10], degrees=True), np.radians(np.arange(0, 181, 5))
    T = np.tile(np.eye(4), (len(angles), 1, 1))
    T[:, :3, :3] = (Rotation.from_rotvec(np.outer(angles, [0, 1, 0])) * facing).as_matrix()
    T[:, :3, 3] = 0.5 * np.stack([np.sin(angles), np.zeros(len(angles)), np.cos(angles)], axis=-1)
    centre, seen = np.zeros(3), angles <= np.radians(45)
    for columns, most in ((intrinsics_columns(T, 0.5, centre), 3.0), (outline_columns(T, 0.5, centre), 6.0)):
        size = np.abs(columns).max(axis=(1, 2))
        assert size[~seen].max() < most * size[seen].max()


def test_defaults_and_what_replaces_them():
    finished, from_corners = default_errors(False), default_errors(True)
    assert [error.name for error in finished] == ["focal length", "principal point", "target scale"]
    assert [error.name for error in from_corners] == ["target scale"]
    of_size = SIZES[TARGET_SCALE]
    assert (finished[2].factor, float(finished[2].sd[0])) == (of_size.factor, of_size.median)
    declared = [SharedError.robot_scale(), SharedError.focal_length("0.5%"), SharedError.target_scale("exact")]
    errors = replace_defaults(declared, False)
    assert [(error.key, float(error.sd[0])) for error in errors] == [
        (FOCAL_LENGTH, 5e-3),
        (PRINCIPAL_POINT, 1e-3),
        (TARGET_SCALE, 0.0),
        (ROBOT_ACCURACY, 1.0),  # per unit of the population, to be bound
        (LENS, SIZES[LENS].median),
        (OUTLINE, SIZES[OUTLINE].median),
        (VIEW, SIZES[VIEW].median),
        (ROBOT_SCALE, 1e-4),
    ]
    assert errors[2].is_exact and errors[2].factor == 1


def test_columns_can_be_taken_out_again():
    data = uq.simulate(12, noise=NOISE, seed=1)
    errors = [SharedError.focal_length(), SharedError.robot_scale()]
    noise = with_shared(NOISE, shared_columns(errors, data))
    again = without_shared(noise, errors)
    for side in ("robot", "camera"):
        np.testing.assert_array_equal(getattr(again, side), np.tile(getattr(NOISE, side), (12, 1, 1)))
    some = without_shared(noise, errors[:1])
    assert some.robot.keys == (ROBOT_SCALE,) and not isinstance(some.camera, JointCovariance)
    alone = with_shared(PoseNoise(robot=NOISE.robot), shared_columns(errors, data))
    assert without_shared(alone, errors).camera is None


# --------------------------------------------------------------------------------------- the offset of two clocks


def timed(std):
    data = uq.simulate(15, noise=NOISE, seed=4)
    rate = np.random.default_rng(5).normal(size=(15, 6)) * 0.3
    return PosePairs(data.robot, data.camera, data.setup, data.timestamps, timing=Timing(0.1, std, rate, "robot"))


@pytest.mark.parametrize("of_motions", [False, True])
def test_clock_offset_of_synchronised_poses_takes_the_place_of_theirs(of_motions):
    """Counted once: the same as poses that were synchronised so well."""
    data, other = timed(1e-4), timed(5e-3)
    given = uq.relative_motions(data) if of_motions else data
    found = uq.calibrate(given, noise=NOISE, shared=[SharedError.clock_offset("5ms")])
    expected = uq.calibrate(uq.relative_motions(other) if of_motions else other, noise=NOISE)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-12)
    assert found.time_offset.std == 5e-3 and found.shared == ()
    assert found.covariance.trace() > 1.01 * uq.calibrate(given, noise=NOISE).covariance.trace()


def test_clock_offset_that_is_exact():
    found = uq.calibrate(timed(5e-3), noise=NOISE, shared=[SharedError.clock_offset("exact")])
    np.testing.assert_allclose(found.covariance, uq.calibrate(timed(0.0), noise=NOISE).covariance, rtol=1e-12)


@pytest.mark.parametrize("sd", [-1e-3, np.nan, np.inf, "often"])
def test_the_raw_constructor_takes_no_size_below_zero(sd):
    with pytest.raises(InputError, match=r"sd of the shared error 'bend'|standard deviation of the bend"):
        SharedError("bend", "", "robot", np.array([sd]), ("bend",), lambda poses: np.zeros((poses.n, 6, 1)))
    with pytest.raises(InputError, match="robot or camera, got 'arm'"):
        SharedError("bend", "", "arm", np.ones(1), ("bend",), lambda poses: np.zeros((poses.n, 6, 1)))
