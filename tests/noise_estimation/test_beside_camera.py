"""The robot's noise beside a known joint covariance of the camera poses: numbers, zeros, intervals, tests of both."""

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import approx_fprime
from support import SEED, random_covariance

import uq_handeye as uq
from studies.camera_covariance import ROBOT, poses_of, recorded
from uq_handeye.errors import InputError
from uq_handeye.likelihood.constraint import OnPoses, residual_covariance
from uq_handeye.likelihood.gauss_helmert import efficient
from uq_handeye.likelihood.goodness_of_fit import effective_dof
from uq_handeye.likelihood.starts import start_of
from uq_handeye.noise.camera_noise import CameraNoise
from uq_handeye.noise.estimate import CameraFactor, NoiseEstimate, NoisePrior
from uq_handeye.noise.joint_covariance import JointCovariance
from uq_handeye.noise.square_roots import cholesky_of, log_determinant
from uq_handeye.noise_estimation.beside_camera import estimate_robot_noise
from uq_handeye.noise_estimation.components_beside_camera import ComponentRows
from uq_handeye.noise_estimation.estimate import estimate_noise
from uq_handeye.noise_estimation.findings import against_camera
from uq_handeye.simulation.rig import disturbed


def joint(rng, n, own=1e-4, shared=2e-3, q=4):
    return JointCovariance(random_covariance(rng, shape=(n,), sd=own), shared * rng.normal(size=(n, 6, q)))


def poses_with(rng, n, robot, camera, setup="eye-in-hand", actual=None):
    exact = uq.simulate(n, setup=setup, seed=int(rng.integers(1 << 30)))
    moved = exact.robot if robot is None else disturbed(exact.robot, robot, (), rng)
    return uq.PosePairs(moved, disturbed(exact.camera, camera if actual is None else actual, (), rng), setup)


def isotropic(rotation, translation):
    return np.diag([rotation] * 3 + [translation] * 3) ** 2


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_the_likelihood_is_that_of_the_whole_array(rng, setup):
    n = 7
    camera = joint(rng, n)
    poses = poses_with(rng, n, ROBOT, camera, setup)
    constraint = OnPoses(poses.robot, poses.camera, setup == "eye-to-hand")
    linear = constraint.linearise(start_of(poses, constraint, None), poses.robot, poses.camera)
    v = np.array([3e-8, 5e-9])
    found = ComponentRows.of(linear, camera).at(v)

    noise = uq.PoseNoise(np.diag(np.repeat(v, 3)), np.asarray(camera))
    S = residual_covariance(linear.sides, noise)
    J, r = linear.J.reshape(6 * n, 12), linear.r.ravel()
    inverse = np.linalg.inv(S)
    P = inverse - inverse @ J @ np.linalg.inv(J.T @ inverse @ J) @ J.T @ inverse
    deviance = np.linalg.slogdet(S)[1] + np.linalg.slogdet(J.T @ inverse @ J)[1] + r @ P @ r
    assert found.deviance == pytest.approx(deviance, rel=1e-9)
    assert found.squares == pytest.approx(r @ P @ r, rel=1e-8)
    V = []
    for part in (slice(3), slice(3, 6)):
        U = np.zeros((6 * n, 3 * n))
        for k in range(n):
            U[6 * k : 6 * k + 6, 3 * k : 3 * k + 3] = linear.sides[0][k][:, part]
        V.append(U @ U.T)
    np.testing.assert_allclose(found.trace, [np.trace(P @ A) for A in V], rtol=1e-7)
    np.testing.assert_allclose(found.quadratic, [r @ P @ A @ P @ r for A in V], rtol=1e-7)
    information = [[0.5 * np.trace(P @ A @ P @ B) for B in V] for A in V]
    for rows in (ComponentRows.of(linear, camera), ComponentRows.of(linear, np.asarray(camera))):
        np.testing.assert_allclose(rows.information(v, found), information, rtol=1e-4)
    by_difference = approx_fprime(np.log(v), lambda x: ComponentRows.of(linear, camera).at(np.exp(x)).deviance, 1e-6)
    np.testing.assert_allclose(v * (found.trace - found.quadratic), by_difference, rtol=1e-3)


def test_log_determinants(rng):
    S = joint(rng, 6)
    expected = np.linalg.slogdet(np.asarray(S))[1]
    assert float(log_determinant(cholesky_of(S))) == pytest.approx(expected, rel=1e-12)
    assert float(log_determinant(cholesky_of(np.asarray(S)))) == pytest.approx(expected, rel=1e-12)
    blocks = np.linalg.slogdet(S.blocks)[1].sum()
    assert float(log_determinant(cholesky_of(S.blocks))) == pytest.approx(blocks, rel=1e-12)


def test_estimates_and_their_intervals_over_many_sets(rng):
    n, sets, true = 25, 40, np.array([2e-4, 3e-4])
    camera = joint(rng, n)
    inside, values = np.zeros(2), []
    for _ in range(sets):
        estimate = estimate_robot_noise(poses_with(rng, n, isotropic(*true), camera), camera)
        robot = [estimate["robot rotation"], estimate["robot translation"]]
        assert all(part.status == "estimated" and part.low < part.value < part.high for part in robot)
        inside += [part.low <= value <= part.high for part, value in zip(robot, true, strict=True)]
        values.append((estimate.variances - true**2) / np.sqrt(np.diag(estimate.covariance)))
    low, high = stats.binom.ppf([0.0005, 0.9995], sets, 0.95)
    assert ((low <= inside) & (inside <= high)).all(), inside
    # unbiased, and as uncertain as said, to Monte Carlo error (99.9 %)
    assert (np.abs(np.mean(values, axis=0)) < 3.3 / np.sqrt(sets)).all()
    assert (np.abs(np.std(values, axis=0) - 1) < 3.3 / np.sqrt(2 * sets) + 0.1).all()


def test_an_exact_robot_is_said_to_be_one(rng):
    n = 20
    camera = joint(rng, n)
    zeros = 0
    for _ in range(6):
        estimate = estimate_robot_noise(poses_with(rng, n, None, camera), camera)
        for name in ("robot rotation", "robot translation"):
            part = estimate[name]
            assert part.low == 0 and part.high is not None and part.high < 3e-4
            zeros += part.status == "zero"
            assert (part.status == "zero") == (part.value == 0)
        if not estimate.variances.any():
            assert estimate.noise.robot is None
            assert "show no robot noise" in " ".join(estimate.statement)
    assert zeros >= 2  # half of them, in the mean
    np.testing.assert_allclose(estimate.noise.camera.own, camera.own, rtol=1e-12)


def test_a_translation_only_robot(rng):
    n = 30
    camera = joint(rng, n, own=3e-5)
    estimate = estimate_robot_noise(poses_with(rng, n, isotropic(0, 1e-3), camera), camera)
    assert estimate["robot rotation"].low == 0
    part = estimate["robot translation"]
    assert part.low < 1e-3 < part.high


@pytest.mark.parametrize("n", [4, 150])
def test_few_and_many_poses(rng, n):
    """Noise far below, like and far above the camera's: intervals hold the estimate, whatever the number of poses."""
    for sd in ((1e-7, 1e-4), (1e-3, 0), (1e-2, 1e-2)):
        camera = joint(rng, n, own=1e-3)
        estimate = estimate_robot_noise(poses_with(rng, n, isotropic(*sd), camera), camera)
        for name in ("robot rotation", "robot translation"):
            part = estimate[name]
            assert part.low <= part.value and (part.high is None or part.value <= part.high)


def test_the_camera_covariance_is_tested(rng):
    """The p-value of consistent covariances is uniform; twice too small or too large ones are found."""
    n, sets, robot = 20, 30, isotropic(1e-4, 1e-4)
    camera = joint(rng, n, own=1e-3)
    p = [estimate_robot_noise(poses_with(rng, n, robot, camera), camera).camera_factor.p_value for _ in range(sets)]
    assert min(p) > 1e-4 and stats.kstest(p, "uniform").pvalue > 1e-3
    for factor in (4.0, 0.25):
        wrong = estimate_robot_noise(poses_with(rng, n, robot, camera, actual=factor * camera), camera).camera_factor
        if factor < 1:
            assert wrong.p_value < 1e-4 and 0.15 < wrong.value < 0.45
            assert against_camera(wrong).severity == "caution" and "are too large" in str(against_camera(wrong))
        else:  # a robot's noise could explain a part of it
            assert wrong.value > 1
    large = CameraFactor(4.0, 100.0, 1e-20)
    words = str(against_camera(large))
    assert "a scale of 2 " in words and "contradict the camera's covariance" in words
    assert against_camera(None).severity == "note" and "dominates" in str(against_camera(None))


def test_noise_of_the_robot_hides_the_camera(rng):
    camera = joint(rng, 15, own=1e-6, shared=1e-6)
    estimate = estimate_robot_noise(poses_with(rng, 15, isotropic(1e-3, 1e-3), camera), camera)
    assert estimate.camera_factor is None and not estimate.tested
    assert "dominates" in estimate.statement[-1]


def test_a_data_sheet_for_the_robot(rng):
    n = 20
    camera = joint(rng, n)
    poses = poses_with(rng, n, isotropic(2e-4, 3e-4), camera)
    fixed = estimate_robot_noise(poses, camera, NoisePrior(robot=(2e-4, None), factor=1))
    assert fixed["robot rotation"].status == "fixed" and fixed["robot rotation"].value == 2e-4
    assert fixed["robot translation"].status == "estimated" and fixed.covariance[0, 0] == 0 < fixed.covariance[1, 1]
    free = estimate_robot_noise(poses, camera)
    tight = estimate_robot_noise(poses, camera, NoisePrior(robot=(1e-3, 3e-4), factor=1.05))
    assert tight["robot rotation"].status == "prior"
    assert free["robot rotation"].value < tight["robot rotation"].value < 1.05e-3
    assert tight.covariance[0, 0] / tight.variances[0] ** 2 < free.covariance[0, 0] / free.variances[0] ** 2
    with pytest.raises(InputError, match="for the robot only"):
        estimate_robot_noise(poses, camera, NoisePrior(camera=(1e-3, None)))


def test_estimate_noise_takes_the_covariance_of_the_corners(rng):
    corners, robot, _ = recorded(rng)
    poses = poses_of(corners, robot)
    whole = poses.camera_calibration.covariance
    found = estimate_noise(poses)
    assert found.from_corners
    np.testing.assert_array_equal(found.noise.camera.shared, whole.shared)
    np.testing.assert_array_equal(found.variances, estimate_robot_noise(poses, whole).variances)
    again = NoiseEstimate.from_dict(found.to_dict())
    assert again.to_dict() == found.to_dict() and again.camera_factor == found.camera_factor
    np.testing.assert_array_equal(again.noise.camera.shared, whole.shared)

    weights = np.ones(poses.n)
    weights[[2, 5]] = 0
    fewer = estimate_noise(poses, weights=weights)
    kept = np.flatnonzero(weights)
    np.testing.assert_allclose(
        fewer.variances, estimate_robot_noise(poses.rows(kept), whole.rows(kept)).variances, rtol=1e-3
    )
    assert fewer.noise.camera.n == poses.n
    with pytest.raises(InputError, match="`weights` of 0 or 1"):
        estimate_noise(poses, weights=np.full(poses.n, 0.5))


@pytest.mark.parametrize("by_views", [False, True])
def test_degrees_of_freedom_of_a_joint_noise(rng, by_views):
    """The uncertainty of the covariance follows from its differences; nu follows the robot's share."""
    n = 15
    camera = joint(rng, n)
    poses = poses_with(rng, n, isotropic(2e-4, 3e-4), camera)
    constraint = OnPoses(poses.robot, poses.camera, False)
    at = start_of(poses, constraint, None)
    linear = constraint.linearise(at, poses.robot, poses.camera)
    open_ = CameraNoise(camera, np.arange(4) < 2) if by_views else camera
    rows = ComponentRows.of(linear, open_)
    v = np.array([4e-8, 9e-8, 1.3][: 3 if by_views else 2])
    V = random_covariance(rng, shape=(), sd=1.0)[: len(v), : len(v)] * v * v[:, None]

    def covariance(v):
        noise = uq.PoseNoise(np.diag(np.repeat(v[:2], 3)), open_.covariance(np.sqrt(v[2])) if by_views else camera)
        S = np.linalg.inv(residual_covariance(linear.sides, noise.dense()))
        J = linear.J.reshape(6 * n, 12)
        return np.linalg.inv(J.T @ S @ J)[:6, :6]

    relative = [
        np.linalg.solve(covariance(v), covariance(v + h) - covariance(v - h)) / (2 * h.max()) for h in np.diag(1e-4 * v)
    ]
    expected = np.einsum("kl,kij,lji->", V, relative, relative)
    assert rows.spread_of_X(v, V) == pytest.approx(expected, rel=1e-4)

    estimate = estimate_robot_noise(poses, camera)
    few = effective_dof(efficient(poses, estimate.noise), estimate)
    assert 20 < few < 5000
    known = estimate_robot_noise(poses, camera, NoisePrior(robot=(2e-4, 3e-4), factor=1))
    assert np.isinf(effective_dof(efficient(poses, known.noise), known))


def test_what_makes_no_sense_is_refused(rng):
    camera = joint(rng, 10)
    with pytest.raises(InputError, match="cover 12 poses, got 10"):
        estimate_robot_noise(uq.simulate(12, seed=SEED), camera)
    motions = uq.relative_motions(uq.simulate(10, seed=SEED))
    with pytest.raises(InputError, match="PoseNoise needs poses"):
        estimate_robot_noise(uq.Motions(motions.A, motions.B), camera)
