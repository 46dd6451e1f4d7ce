"""The backend of easy_handeye2, with stand-ins for its messages and its server."""

import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.errors import InputError
from uq_handeye.ros.easy_handeye2 import EasyHandeyeBackend, poses_of_samples

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


class Node:
    """Logger of a node of ROS 2."""

    def __init__(self):
        self.said = []

    def get_logger(self):
        say = lambda mark: lambda text: self.said.append(mark + text)  # noqa: E731
        return SimpleNamespace(info=say(""), warning=say("! "), error=say("!! "))


def transform(T):
    (x, y, z), q = T[:3, 3].tolist(), Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
    return SimpleNamespace(
        translation=SimpleNamespace(x=x, y=y, z=z), rotation=SimpleNamespace(**dict(zip("xyzw", q, strict=True)))
    )


def samples_of(poses, old=False):
    """Return samples as the samplers keep them: base_T_gripper on the hand, gripper_T_base in the cell."""
    robot = poses.robot if poses.setup == "eye-in-hand" else inverse(poses.robot)
    pairs = [(transform(G), transform(C)) for G, C in zip(robot, poses.camera, strict=True)]
    if old:
        return [{"robot": SimpleNamespace(transform=G), "optical": SimpleNamespace(transform=C)} for G, C in pairs]
    return SimpleNamespace(samples=[SimpleNamespace(robot=G, tracking=C) for G, C in pairs])


def matrix(message):
    T = np.eye(4)
    r, t = message.rotation, message.translation
    T[:3, :3], T[:3, 3] = Rotation.from_quat([r.x, r.y, r.z, r.w]).as_matrix(), [t.x, t.y, t.z]
    return T


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_samples_give_x_with_its_covariance(setup, tmp_path):
    poses = uq.simulate(15, noise=NOISE, seed=2, setup=setup)
    kind = {"eye-in-hand": "eye_in_hand", "eye-to-hand": "eye_on_base"}[setup]
    parameters = SimpleNamespace(name="my cell/../x", calibration_type=kind)
    backend, node = EasyHandeyeBackend(tmp_path), Node()
    found = backend.compute_calibration(node, parameters, samples_of(poses), algorithm="Efficient")
    expected = uq.calibrate(uq.PosePairs(poses.robot, poses.camera, setup=setup))
    np.testing.assert_allclose(matrix(found.transform), expected.X, atol=1e-9)
    assert found.parameters is parameters
    np.testing.assert_allclose(backend.last_result.covariance, expected.covariance, rtol=1e-6)
    assert backend.last_result.headline in node.said
    files = sorted(path.name for path in tmp_path.iterdir())
    assert files == ["my_cell_.._x_uq.json", "my_cell_.._x_uq.yaml"]
    kept = uq.Calibration.from_json(tmp_path / files[0])
    np.testing.assert_allclose(kept.covariance, expected.covariance, rtol=1e-6)


@pytest.mark.slow
def test_what_is_not_usable_is_an_error_and_no_calibration(tmp_path):
    poses = uq.simulate(12, noise=NOISE, seed=2)
    camera = poses.camera.copy()
    camera[:, :3, 3] *= 1000.0
    backend, node = EasyHandeyeBackend(), Node()
    wrong = samples_of(uq.PosePairs(poses.robot, camera))
    assert backend.compute_calibration(node, SimpleNamespace(), wrong, algorithm="Park") is None
    assert node.said[0].startswith("!! NOT USABLE") and not backend.last_result.usable
    assert backend.last_poses.n == 12
    (tmp_path / "file").touch()
    backend, node = EasyHandeyeBackend(tmp_path / "file" / "in"), Node()
    parameters = SimpleNamespace(calibration_type="eye_on_hand")
    assert backend.compute_calibration(node, parameters, samples_of(poses), algorithm="Park") is not None
    assert node.said[-1].startswith("! The result was not written to ")


def test_easy_handeye_of_ros_1_calls_without_a_node():
    poses = uq.simulate(10, noise=NOISE, seed=2)
    backend = EasyHandeyeBackend(noise=NOISE)
    found = backend.compute_calibration(SimpleNamespace(eye_on_hand=True), samples_of(poses, old=True), "Park")
    np.testing.assert_allclose(matrix(found.transform), uq.solve(*motions(poses), method="park"), atol=1e-6)
    assert backend.last_result.method == "park" and backend.last_result.covariance.shape == (6, 6)


def motions(poses):
    found = uq.relative_motions(poses, pairs="all")
    return found.A, found.B


@pytest.mark.slow
def test_every_algorithm_has_a_method():
    poses, backend = uq.simulate(8, noise=NOISE, seed=4), EasyHandeyeBackend(noise=NOISE)
    for name in backend.AVAILABLE_ALGORITHMS:
        assert "/" not in name  # the server splits BACKEND/ALGORITHM there
        assert backend.compute_calibration(None, SimpleNamespace(), samples_of(poses), algorithm=name) is not None
        np.testing.assert_allclose(backend.last_result.X, poses.truth.X, atol=0.02)


@pytest.mark.parametrize(
    ("samples", "parameters", "algorithm", "words"),
    [
        (2, {}, None, "at least 3 samples, got 2"),
        (6, {"calibration_type": "eye_in_space"}, None, "eye_in_hand or eye_on_base, got 'eye_in_space'"),
        (6, {}, "Best", "one of Efficient, Maximum-likelihood"),
        ("nan", {}, None, "sample 1, robot: expected finite numbers"),
        ("part", {}, None, "sample 1, robot: expected translation.x, got none"),
        ("side", {}, None, "Expected samples with tracking or optical"),
    ],
)
def test_samples_that_give_nothing_are_logged(samples, parameters, algorithm, words):
    given = samples_of(
        uq.simulate(6 if isinstance(samples, str) else samples, seed=1) if samples != 2 else uq.simulate(3)
    )
    if samples == 2:
        given.samples.pop()
    elif samples == "nan":
        given.samples[1].robot.translation.x = float("nan")
    elif samples == "part":
        given.samples[1].robot.translation = None
    elif samples == "side":
        del given.samples[1].tracking
    backend, node = EasyHandeyeBackend(), Node()
    assert backend.compute_calibration(node, SimpleNamespace(**parameters), given, algorithm=algorithm) is None
    assert backend.last_result is None and len(node.said) == 1 and words in node.said[0]


def test_the_messages_of_easy_handeye2_are_used_where_they_are(monkeypatch):
    made = lambda name: type(name, (SimpleNamespace,), {})  # noqa: E731
    geometry, own = ModuleType("geometry_msgs.msg"), ModuleType("easy_handeye2.handeye_calibration")
    for name in ("Transform", "Vector3", "Quaternion"):
        setattr(geometry, name, made(name))
    own.HandeyeCalibration = made("HandeyeCalibration")
    for name, module in (
        ("geometry_msgs", ModuleType("geometry_msgs")), ("geometry_msgs.msg", geometry),
        ("easy_handeye2", ModuleType("easy_handeye2")), ("easy_handeye2.handeye_calibration", own),
    ):  # fmt: skip
        monkeypatch.setitem(sys.modules, name, module)
    found = EasyHandeyeBackend().compute_calibration(None, SimpleNamespace(), samples_of(uq.simulate(6, seed=1)))
    assert isinstance(found, own.HandeyeCalibration) and isinstance(found.transform, geometry.Transform)

    class Earlier(SimpleNamespace):
        def __init__(self, calibration_parameters, transformation):
            super().__init__(calibration_parameters=calibration_parameters, transformation=transformation)

    own.HandeyeCalibration = Earlier
    found = EasyHandeyeBackend().compute_calibration(None, SimpleNamespace(), samples_of(uq.simulate(6, seed=1)))
    assert isinstance(found.transformation, geometry.Transform)


def test_poses_of_samples_and_wrong_calls():
    poses = uq.simulate(6, seed=1)
    np.testing.assert_allclose(poses_of_samples(SimpleNamespace(), samples_of(poses)).robot, poses.robot, atol=1e-12)
    with pytest.raises(InputError, match=r"Expected \(node, parameters, samples\)"):
        EasyHandeyeBackend().compute_calibration(1)
