"""The convention in which covariances of camera poses fit: named where it is another one, and not by chance."""

import re

import numpy as np
import pytest
from support import draw, moved

import uq_handeye as uq
from uq_handeye.core.geometry.conventions import CovarianceReading, same_class
from uq_handeye.fit.diagnostics.covariance_convention import (
    CODE,
    convention_finding,
    is_isotropic,
    readings,
)
from uq_handeye.fit.graph.constraint import Unknowns
from uq_handeye.model.errors.joint_covariance import JointCovariance

K = np.array([[900.0, 0, 640], [0, 900, 360], [0, 0, 1]])
CORNERS = np.stack([*(0.02 * np.indices((9, 6)).reshape(2, -1) - [[0.08], [0.05]]), np.zeros(54)], axis=-1)
ROBOT = np.diag([np.radians(0.01) ** 2] * 3 + [3e-5**2] * 3)
N = 15


def rig(seed, pixel_sd=0.2, count=N):
    """Poses with the covariance of 54 corners."""
    exact = uq.simulate(count, seed=seed)
    S = pixel_sd**2 * uq.camera_noise(exact.camera, CORNERS, K, "exact", pixel_sd=1.0).joint.own
    rng = np.random.default_rng(seed)
    robot = moved(exact.robot, draw(rng, ROBOT, (count,)))
    return uq.PosePairs(robot, moved(exact.camera, draw(rng, S, (count,))), truth=exact.truth), S


def as_it_comes(poses, S, words):
    """The numbers of a convention, taken for a covariance of the toolkit."""
    numbers = CovarianceReading.parse(words).write(S, poses.camera)
    return 0.5 * (numbers + numbers.mT)


def found(poses, camera, robot=ROBOT, given=None):
    at = Unknowns(poses.truth.X, poses.truth.W)
    return convention_finding(poses, at, robot, camera, given or CovarianceReading())


def names_of(finding):
    return (
        [] if finding is None else re.findall(r"[\w-]+(?: of the inverse poses)?", " ".join(finding.values["classes"]))
    )


def test_no_reading_is_tried_twice(rng):
    T = moved(np.eye(4), rng.normal(size=6))
    L = rng.normal(size=(6, 6))
    made = [np.linalg.inv(J) @ L @ L.T @ np.linalg.inv(J).T for J in (one.jacobian(T) for one in readings())]
    assert len(made) > 15
    for k, S in enumerate(made):
        assert all(np.abs(S / np.trace(S) - other / np.trace(other)).max() > 1e-4 for other in made[:k]), readings()[k]


@pytest.mark.parametrize(
    "words",
    [pytest.param("gtsam", marks=pytest.mark.slow), "ros", pytest.param("toolkit,inverse", marks=pytest.mark.slow)],
)
def test_the_convention_is_named_before_an_outlier(words):
    poses, S = rig(7)
    wrong = as_it_comes(poses, S, words)
    with pytest.warns(uq.InputWarning, match=f"--covariance-convention {words}"):
        result = uq.calibrate(poses, noise=uq.PoseNoise(ROBOT, wrong))
    (finding,) = [one for one in result.findings if one.severity != "note"]
    assert finding.code == CODE
    assert finding.values["next"] == words
    right = uq.from_convention(wrong, poses.camera, words.split(",")[0], of="inverse" if "," in words else "pose")
    assert uq.calibrate(poses, noise=uq.PoseNoise(ROBOT, right)).findings == ()


def test_the_sentence():
    poses, S = rig(7)
    text = str(found(poses, as_it_comes(poses, S, "gtsam")))
    assert text.startswith("The covariances fit as gtsam (small-gicp), not as given: log likelihood +")
    assert "Next: --covariance-convention gtsam" in text


def test_what_was_stated_is_read_again():
    poses, S = rig(7)
    wrong = CovarianceReading("manif", pixel_sd=0.5)
    numbers = CovarianceReading("ros", pixel_sd=0.5).write(S, poses.camera)
    camera = wrong.read(numbers, poses.camera)
    finding = found(poses, camera, given=wrong)
    assert "not as manif,pixel_sd=0.5:" in str(finding)
    assert finding.values["next"] == "ros,pixel_sd=0.5"


def test_nothing_is_said_of_isotropic_blocks():
    poses, S = rig(7)
    isotropic = np.diag([1e-6] * 3 + [1e-8] * 3)
    assert is_isotropic(isotropic)
    assert is_isotropic(np.tile(isotropic, (3, 1, 1)))
    assert not is_isotropic(S)
    assert not is_isotropic(np.diag([1e-6, 1e-6, 2e-6, 1e-8, 1e-8, 1e-8]))
    finding = found(poses, np.tile(np.diag([2e-6] * 3 + [1e-6] * 3), (N, 1, 1)))
    assert finding is None or {"gtsam", "symforce"}.isdisjoint(names_of(finding))


def test_outliers_are_no_other_convention():
    poses, S = rig(7)
    camera = poses.camera.copy()
    camera[3] = moved(camera[3], np.array([0.02, -0.03, 0.01, 0.01, -0.02, 0.015]))
    poses = uq.PosePairs(poses.robot, camera, truth=poses.truth)
    assert found(poses, S) is None
    assert "gtsam" in names_of(found(poses, as_it_comes(poses, S, "gtsam")))


@pytest.mark.parametrize("factor", [0.5, 4.0])
def test_numbers_of_another_size_are_no_other_convention(factor):
    poses, S = rig(7)
    assert found(poses, factor * S) is None


@pytest.mark.slow
def test_many_poses_take_no_longer():
    """Let some of 400 poses decide: one covariance of the robot for each is that of these poses."""
    poses, S = rig(3, count=400)
    robot = np.tile(ROBOT, (400, 1, 1))
    assert "ros" in names_of(found(poses, as_it_comes(poses, S, "ros"), robot))
    assert found(poses, S, robot) is None


def test_noise_that_leaves_residuals_exact():
    poses, S = rig(7)
    S = S.copy()
    S[:, 5], S[:, :, 5] = 0.0, 0.0
    assert found(poses, S, np.zeros((6, 6))) is None


@pytest.mark.slow
def test_robot_noise_that_is_estimated():
    poses, S = rig(7)
    S = as_it_comes(poses, S, "ros")
    poses = uq.PosePairs(poses.robot, poses.camera, camera_covariance=JointCovariance(S, np.zeros((N, 6, 0))))
    with pytest.warns(uq.InputWarning, match=r"fit as ros \(napa\)"):
        uq.calibrate(poses)


OF_THE_TABLE = [
    "gtsam",
    "symforce",
    "pycolmap",
    "opencv",
    "manif",
    "ros",
    "factorama",
    "g2o",
    "open3d",
    "pypose",
    "mrpt",
]


@pytest.mark.statistical
@pytest.mark.parametrize("robot", [ROBOT, None], ids=["robot known", "robot estimated"])
@pytest.mark.parametrize("words", [*OF_THE_TABLE, "toolkit,inverse", "symforce,inverse"])
def test_the_right_class_is_named(words, robot):
    """Judge the count of 200 sets: fewer than 183 have a probability of 1 % if the rate is 95 %."""
    of = CovarianceReading.parse(words)
    name = same_class(of.convention)[0] + (" of the inverse poses" if of.inverse else "")
    named = 0
    count = 200 if robot is not None else 60
    for seed in range(count):
        poses, S = rig(seed + 1000)
        names = names_of(found(poses, as_it_comes(poses, S, words), robot))
        named += any(
            name == one or one in same_class(of.convention) for one in names if of.inverse == ("of the" in one)
        )
    assert named >= {200: 183, 60: 53}[count]


@pytest.mark.statistical
@pytest.mark.parametrize(("robot", "pixel_sd", "count"), [(ROBOT, 0.2, 300), (ROBOT, 0.05, 300), (None, 0.2, 100)])
def test_no_convention_is_named_by_chance(robot, pixel_sd, count):
    """Judge the count of 300 sets: more than 8 have a probability of 0.4 % if the rate is 1 %."""
    wrong = sum(found(*rig(seed + 3000, pixel_sd), robot) is not None for seed in range(count))
    assert wrong <= {300: 8, 100: 4}[count]


@pytest.mark.statistical
@pytest.mark.parametrize("words", ["gtsam", "ros", "pycolmap", "g2o", "open3d", "toolkit,inverse"])
def test_X_has_its_covariance_with_the_convention_given(words):
    """Mean d^2 of X of 200 sets, 6: its standard error is 0.24."""
    of, squares = CovarianceReading.parse(words), []
    for seed in range(200):
        poses, S = rig(seed + 5000)
        numbers = of.write(S, poses.camera)
        noise = uq.PoseNoise(ROBOT, uq.from_convention(
            numbers, poses.camera, of.convention, of="inverse" if of.inverse else "pose"))  # fmt: skip
        fit = uq.efficient(poses, noise)
        R = fit.X[:3, :3] @ poses.truth.X[:3, :3].T
        xi = (
            np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], *2 * (fit.X - poses.truth.X)[:3, 3]]) / 2
        )
        squares.append(xi @ np.linalg.solve(fit.covariance_X, xi))
    assert 5.4 < np.mean(squares) < 6.8
