"""The accuracy of a robot as a field over the pose: covariance, the same unknowns at other poses, what it covers."""

import numpy as np
import pytest
from calibration_cases import quietly
from scipy.spatial.transform import Rotation
from support import SEED

import uq_handeye as uq
from uq_handeye import InputError, SharedError
from uq_handeye.calibration.report.shared_errors import included_words, shared_table
from uq_handeye.calibration.robot_accuracy import smooth_variance
from uq_handeye.geometry.se3 import inverse, perturb
from uq_handeye.shared_errors.accuracy_field import LENGTH, MARGIN, MOST_FEATURES, TYPICAL, features, kernel
from uq_handeye.shared_errors.shared_error import assumed_accuracy, default_errors, shared_columns

NOISE = uq.PoseNoise.isotropic(robot=("0.01deg", "0.03mm"), camera=("0.03deg", "0.1mm"))
# Standard Denavit-Hartenberg rows (theta, d, a, alpha) of a small arm with six joints.
ARM = np.array(
    [[0, 0.29, 0, -np.pi / 2], [-np.pi / 2, 0, 0.27, 0], [0, 0, 0.07, -np.pi / 2], [0, 0.302, 0, np.pi / 2],
     [0, 0, 0, -np.pi / 2], [np.pi, 0.072, 0, 0]]
)  # fmt: skip
LOW, HIGH = np.radians([-150, -60, -60, -90, 15, -180]), np.radians([150, 80, 50, 90, 115, 180])


def near(n=30, spread=0.1, seed=SEED):
    """Robot poses of one region."""
    rng = np.random.default_rng(seed)
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec(rng.normal(0, 0.3, (n, 3))).as_matrix()
    T[:, :3, 3] = [0.5, 0.1, 0.4] + spread * rng.normal(size=(n, 3))
    return T


def pairs(robot):
    return uq.PosePairs(robot, np.tile(np.eye(4), (len(robot), 1, 1)))


def test_features_are_the_kernel():
    T = near()
    K = kernel(T, T, LENGTH * float(np.linalg.norm(T[:, :3, 3], axis=1).max()))
    np.testing.assert_allclose(np.diag(K), 1.0, atol=1e-6)
    assert np.linalg.eigvalsh(K)[0] > -1e-9
    phi = features(T)(T)
    assert phi.shape[1] <= MOST_FEATURES
    np.testing.assert_allclose(np.mean(phi**2) * phi.shape[1], 1.0)
    assert np.abs(phi @ phi.T - K).max() < 0.15 and np.sqrt(np.mean((phi @ phi.T - K) ** 2)) < 0.015


def test_the_variance_is_a_third_of_the_stated_accuracy_with_the_margin():
    T = near()
    error = SharedError.robot_accuracy("0.5mm", "0.05deg").bound(pairs(T))
    F = error.at(pairs(T))
    sd = np.sqrt((F**2).sum(axis=-1).mean(axis=0))
    np.testing.assert_allclose(sd[3:], MARGIN * 0.5e-3 / np.sqrt(3))
    np.testing.assert_allclose(sd[:3], MARGIN * np.radians(0.05) / np.sqrt(3))
    np.testing.assert_allclose(error.sd, 1.0)
    assert {name.split(": ")[0] for name in error.parts} == {"robot accuracy"}
    assert shared_columns([error], pairs(T)) == {}  # no unknown of a fit


def test_other_poses_have_columns_of_the_same_unknowns():
    T = near()
    error = SharedError.robot_accuracy("0.5mm,0.05deg").bound(pairs(T))
    F = error.at(pairs(T))
    np.testing.assert_allclose(error.at(pairs(T[5:9])), F[5:9], atol=1e-12)
    moved = T[:5].copy()
    moved[:, 0, 3] += 1e-3
    close = np.abs(error.at(pairs(moved)) - F[:5]).max()
    assert 0 < close < 0.05 * np.abs(F).max()
    far = T[:5].copy()
    far[:, 0, 3] += 5.0
    assert np.abs(error.at(pairs(far))).max() < 1e-4 * np.abs(F).max()
    with pytest.raises(InputError, match="bound"):
        SharedError.robot_accuracy("0.5mm,0.05deg").at(pairs(T))


def test_many_poses_have_no_more_columns():
    T = near(1500, 0.3)
    assert SharedError.robot_accuracy("0.5mm,0.05deg").bound(pairs(T)).at(pairs(T)).shape == (
        1500,
        6,
        6 * MOST_FEATURES,
    )


def test_one_row_and_one_source_of_type_B():
    poses = uq.simulate(20, noise=NOISE, seed=SEED)
    result = quietly(poses, noise=NOISE, shared=[SharedError.robot_accuracy("0.5mm,0.05deg")])
    row = next(row for row in shared_table(result).rows if row[0].startswith("robot accuracy"))
    assert row[1] == "0.5 mm, 0.05 deg (declared)" and row[2] == "not estimated"
    assert included_words(result).endswith("share: robot accuracy 0.5 mm, 0.05 deg.")
    assert dict(zip(result.budget.sources, result.budget.types, strict=True))["robot accuracy"] == "B"
    assert result.provenance.options["shared"] == ["robot accuracy: 0.5 mm, 0.05 deg"]
    assert (result.std > quietly(poses, noise=NOISE).std).all()
    text = " ".join(result.summary(verbose=True).split())
    assert "robot errors beyond those declared" in text and "wrong robot kinematics" not in text


def test_a_plan_does_not_take_it():
    poses = uq.simulate(8, noise=NOISE, seed=SEED)
    with pytest.raises(InputError, match="robot accuracy"):
        uq.plan(poses, k=3, noise=NOISE, shared=[SharedError.robot_accuracy("0.5mm,0.05deg")])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("0.5mm",), "0.5mm,0.05deg"),
        ((0.5,), "0.5mm,0.05deg"),
        (("0.5mm", "-1deg"), ">= 0"),
        (("0.5mm", "much"), "much"),
        (("0.5", "0.05deg"), "unit"),
        (("1mm,1deg,1deg",), "0.5mm,0.05deg"),
    ],
)
def test_bad_statements(given, message):
    with pytest.raises(InputError, match=message):
        SharedError.robot_accuracy(*given)


def test_the_reach_is_above_0():
    with pytest.raises(InputError, match="reach"):
        SharedError.robot_accuracy("0.5mm,0.05deg", reach="0m")
    assert SharedError.robot_accuracy("exact").is_exact


# -------------------------------------------------------------------------------------------- a robot that is wrong


def forward(q, arm):
    T = np.tile(np.eye(4), (len(q), 1, 1))
    for k, (theta, d, a, alpha) in enumerate(arm):
        A = np.tile(np.eye(4), (len(q), 1, 1))
        R = Rotation.from_rotvec((q[:, k] + theta)[:, None] * [0, 0, 1]) * Rotation.from_rotvec([alpha, 0, 0])
        A[:, :3, :3] = R.as_matrix()
        A[:, :3, 3] = np.stack([a * np.cos(q[:, k] + theta), a * np.sin(q[:, k] + theta), np.full(len(q), d)], axis=1)
        T = T @ A
    return T


def twists(truth, told):
    """(theta, tau) of the poses told against the true ones."""
    turn = Rotation.from_matrix(told[:, :3, :3] @ truth[:, :3, :3].mT).as_rotvec()
    return np.concatenate([turn, told[:, :3, 3] - truth[:, :3, 3]], axis=1)


def frames(T):
    """(n, 6, 12): what moves of the base frame and of the tool frame do to the poses."""
    J = np.zeros((len(T), 6, 12))
    J[:, :3, :3] = J[:, 3:, 3:6] = np.eye(3)
    J[:, 3:, :3] = -np.cross(np.eye(3), T[:, None, :3, 3]).mT
    J[:, :3, 6:9] = J[:, 3:, 9:] = T[:, :3, :3]
    return J


def session(rng, n=20):
    """Poses of one region of an arm with wrong joints and links, X in its aligned frames, and its accuracy."""
    wrong = ARM + rng.normal(size=ARM.shape) * 0.6 * np.array([1e-3, 3e-4, 3e-4, 6e-4])
    everywhere = rng.uniform(LOW, HIGH, (400, 6))
    told = forward(everywhere, ARM)
    error, J, weight = twists(forward(everywhere, wrong), told), frames(told), np.repeat([0.3, 1.0], 3)
    aligned = np.linalg.lstsq((J * weight[:, None]).reshape(-1, 12), (error * weight).ravel(), rcond=None)[0]
    error = error - J @ aligned
    accuracy = [float(np.sqrt((error[:, of] ** 2).sum(axis=1).mean())) for of in (slice(3, 6), slice(3))]
    q = rng.uniform(LOW + 0.35 * (HIGH - LOW), HIGH - 0.35 * (HIGH - LOW)) + rng.uniform(-0.35, 0.35, (n, 6))
    told = forward(q, ARM)
    error = twists(forward(q, wrong), told) - frames(told) @ aligned
    truth = told.copy()
    truth[:, :3, :3] = Rotation.from_rotvec(-error[:, :3]).as_matrix() @ told[:, :3, :3]
    truth[:, :3, 3] -= error[:, 3:]
    X, W = np.eye(4), np.eye(4)
    X[:3, :3], X[:3, 3] = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix(), [0.03, -0.05, 0.06]
    W[:3, 3] = (truth[:, :3, 3] + 0.4 * truth[:, :3, 2]).mean(axis=0)
    camera = inverse(X) @ inverse(truth) @ W
    e = rng.normal(size=(n, 6)) * 1e-4
    camera[:, :3, :3] = Rotation.from_rotvec(e[:, :3]).as_matrix() @ camera[:, :3, :3]
    camera[:, :3, 3] += e[:, 3:]
    return uq.PosePairs(told, camera), X, accuracy


def test_it_covers_an_arm_whose_kinematics_are_wrong():
    """X from local poses lies outside its 95 % ellipsoid more often than not; with the accuracy declared inside."""
    inside, error = {"today": [], "declared": []}, {"today": [], "declared": []}
    for seed in range(100, 124):
        poses, X, accuracy = session(np.random.default_rng(seed))
        for name, shared in (("today", []), ("declared", [SharedError.robot_accuracy(*accuracy)])):
            result = quietly(poses, shared=shared, correlation="none")
            e = twists(X[None], result.X[None])[0]
            inside[name].append(e @ np.linalg.solve(result.covariance, e) < result.quantile(0.95))
            error[name].append(np.linalg.norm(e[3:]))
    assert np.mean(inside["today"]) < 0.6
    assert np.mean(inside["declared"]) > 0.85
    np.testing.assert_array_equal(error["declared"], error["today"])  # it gains no accuracy


# ------------------------------------------------------------------------------------------ nothing is declared of it


def assumed(result):
    return [error for error in result.shared if error.error == "robot accuracy"]


def without_truth(poses):
    return uq.PosePairs(poses.robot, poses.camera, poses.setup)


def test_a_robot_of_which_nothing_is_declared_has_an_accuracy_that_is_assumed():
    """X stays. Only where the noise of the robot is estimated, and no arm, accuracy or list of errors is given."""
    poses = without_truth(uq.simulate(20, noise=NOISE, seed=SEED))
    result = quietly(poses)
    found = assumed(result)
    assert found and all(error.default for error in found)
    assert "robot accuracy" in " ".join(result.accuracy.included)
    assert any(part.name == "robot accuracy" for part in result.accuracy.parts)
    declared = list(default_errors(False))
    plain = quietly(poses, shared=declared)
    assert assumed(plain) == [] and result.accuracy.translation > plain.accuracy.translation
    np.testing.assert_allclose(result.X, plain.X, atol=1e-12)
    assert assumed(quietly(uq.simulate(20, noise=NOISE, seed=SEED))) == []  # simulated: the robot is as it was said
    assert assumed(quietly(poses, noise=NOISE)) == []
    assert assumed(quietly(poses, method="tsai")) == []
    robot = ("0.02deg", "0.05mm")
    assert assumed(quietly(poses, prior=uq.NoisePrior(robot=robot, factor=1))) == []
    one = [SharedError.robot_accuracy("0.5mm,0.05deg")]
    assert not any(error.default for error in assumed(quietly(poses, shared=one)))


@pytest.mark.parametrize("size", [0.0, 2.0])
def test_the_variance_of_a_smooth_error_is_unbiased_and_its_error_true(size):
    """Draws of the field itself at so many times its deviation, beside noise that is stated too large by half."""
    true = uq.simulate(25, seed=SEED).truth
    base = uq.PosePairs(true.robot, true.camera)
    field = SharedError.robot_accuracy(*TYPICAL).bound(base)
    F = field.at(base) * field.sd
    rng = np.random.default_rng(SEED)
    small = uq.PoseNoise.isotropic(robot=("0.02deg", "0.1mm"), camera=("0.05deg", "0.2mm"))
    stated = uq.PoseNoise(2.25 * small.robot, 2.25 * small.camera)
    draws, errors = [], []
    for _ in range(60):
        e = size * F @ rng.standard_normal(F.shape[-1])
        camera = perturb(true.camera, rng.standard_normal((25, 6)) @ np.linalg.cholesky(small.camera).T)
        robot = perturb(true.robot, e + rng.standard_normal((25, 6)) @ np.linalg.cholesky(small.robot).T)
        poses = uq.PosePairs(robot, camera)
        fit = uq.efficient(poses, stated)
        s2, sd = smooth_variance(fit, field, poses)
        draws.append(s2)
        errors.append(sd)
    spread = np.std(draws, ddof=1)
    assert abs(np.mean(draws) - size**2) < 4 * spread / np.sqrt(60)
    assert 0.6 < np.median(errors) / spread < 1.6


def test_residuals_that_exclude_a_smooth_error_leave_little_of_it():
    """A precise camera on an exact robot; and poses whose noise hides everything."""
    exact = uq.PoseNoise.isotropic(robot=("0.001deg", "0.002mm"), camera=("0.002deg", "0.005mm"))
    noisy = uq.PoseNoise.isotropic(robot=("0.5deg", "5mm"), camera=("1deg", "10mm"))
    stated = {}
    for name, noise in (("exact", exact), ("noisy", noisy)):
        result = quietly(without_truth(uq.simulate(25, noise=noise, seed=SEED)))
        stated[name] = assumed(result)[0].stated
    assert stated["exact"] == "0.1 mm, 0.014 deg"  # the best that is assumed
    move = float(stated["noisy"].split(" mm")[0])
    assert 0.4 < move < 3.0  # at least what is typical, and not the noise


def test_an_arm_with_errors_of_its_own_is_inside_what_is_stated():
    """The same arms as with a declared accuracy, of which nothing is said."""
    inside = []
    for seed in range(100, 124):
        poses, X, _ = session(np.random.default_rng(seed))
        result = quietly(poses, shared=[assumed_accuracy()], correlation="none")
        e = twists(X[None], result.X[None])[0]
        inside.append(e @ np.linalg.solve(result.covariance, e) < result.quantile(0.95))
    assert np.mean(inside) > 0.85
