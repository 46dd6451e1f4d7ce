"""Exports, read back by other programs: OpenCV, PyYAML, ElementTree with SciPy, NumPy, GTSAM."""

import dataclasses
import re
import runpy
import shlex
import sys
import types
import warnings
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import yaml
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from support import SEED, assert_same_covariance, holds_for, rotation_vectors, rotations

import uq_handeye as uq
from uq_handeye.core.geometry.conventions import from_convention
from uq_handeye.formats import export
from uq_handeye.formats.controllers.written import SINGLE, WRITTEN, written_poses
from uq_handeye.formats.snippets import fixed_axis_angles, texts

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
FRAMES = {"eye-in-hand": ("gripper", "camera"), "eye-to-hand": ("base", "camera")}


@pytest.fixture(scope="module", params=["eye-in-hand", "eye-to-hand"])
def result(request):
    return uq.calibrate(uq.simulate(15, noise=NOISE, setup=request.param, seed=SEED), noise=NOISE)


@pytest.fixture(scope="module")
def unknown(result):
    """Without a covariance."""
    return dataclasses.replace(result, covariance=None, covariance_W=None, analysis=None)


def both(result):
    """(T, covariance, parent, child) of X and of its inverse."""
    parent, child = FRAMES[result.setup]
    return [
        (result.X, result.covariance, parent, child),
        (result.inverse, result.covariance_inverse, child, parent),
    ]


def matrix(position, quaternion):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat([quaternion[a] for a in "xyzw"]).as_matrix()
    T[:3, 3] = [position[a] for a in "xyz"]
    return T


def from_origin(element):
    """Read the origin as a URDF reader does: roll, pitch, yaw about fixed axes."""
    T = np.eye(4)
    roll, pitch, yaw = map(float, element.get("rpy").split())
    turns = [Rotation.from_euler(axis, angle).as_matrix() for axis, angle in (("z", yaw), ("y", pitch), ("x", roll))]
    T[:3, :3] = turns[0] @ turns[1] @ turns[2]
    T[:3, 3] = list(map(float, element.get("xyz").split()))
    return T


def snippets(result, start):
    found = [s for s in texts(result) if s.title.startswith(start)]
    assert len(found) == 2
    return list(zip(found, both(result), strict=True))


def run(snippet):
    names = {}
    exec(snippet.text, names)
    return names


# ------------------------------------------------------------------------------------------------------------- snippets


def test_numpy(result):
    for snippet, (T, covariance, parent, child) in snippets(result, "NumPy"):
        names = run(snippet)
        np.testing.assert_allclose(names[f"{parent}_T_{child}"], T, rtol=0, atol=1e-11)
        assert_same_covariance(names["covariance"], covariance, 1e-6)
        assert f"in the parent frame {parent}" in snippet.convention
        assert "rad and m" in snippet.convention
        assert snippet.language == "python"


def test_opencv(result):
    for snippet, (T, covariance, parent, child) in snippets(result, "OpenCV"):
        names = run(snippet)
        name = f"{child}2{parent}".replace("camera", "cam")
        np.testing.assert_allclose(names[f"R_{name}"], T[:3, :3], rtol=0, atol=1e-11)
        np.testing.assert_allclose(names[f"t_{name}"], T[:3, 3:], rtol=0, atol=1e-11)
        assert_same_covariance(from_convention(names[f"covariance_{name}"], T, "opencv"), covariance, 1e-6)
        assert "rvec" in snippet.convention


def test_gtsam(result):
    for snippet, (T, covariance, _, child) in snippets(result, "GTSAM"):
        assert "right perturbation" in snippet.convention
        assert f"in the frame {child}" in snippet.convention
        gtsam = pytest.importorskip("gtsam")
        names = run(snippet)
        pose = next(value for value in names.values() if isinstance(value, gtsam.Pose3))
        np.testing.assert_allclose(pose.matrix(), T, rtol=0, atol=1e-11)
        assert_same_covariance(from_convention(names["noise"].covariance(), T, "gtsam"), covariance, 1e-6)


def test_ros_static_transforms(result):
    for snippet, (T, _, parent, child) in snippets(result, "ROS 2 static transform"):
        words = shlex.split(snippet.text)
        assert words[:4] == ["ros2", "run", "tf2_ros", "static_transform_publisher"]
        options = dict(zip(words[4::2], words[5::2], strict=True))
        assert (options.pop("--frame-id"), options.pop("--child-frame-id")) == (parent, child)
        values = {key: float(value) for key, value in options.items()}
        again = matrix({a: values[f"--{a}"] for a in "xyz"}, {a: values[f"--q{a}"] for a in "xyzw"})
        np.testing.assert_allclose(again, T, rtol=0, atol=1e-9)
    for snippet, (T, _, parent, child) in snippets(result, "ROS 1 static transform"):
        words = snippet.text.split()
        assert words[-2:] == [parent, child]
        numbers = list(map(float, words[3:-2]))
        again = matrix(dict(zip("xyz", numbers[:3], strict=True)), dict(zip("xyzw", numbers[3:], strict=True)))
        np.testing.assert_allclose(again, T, rtol=0, atol=1e-9)


def test_ros_pose_with_covariance(result):
    for snippet, (T, covariance, parent, child) in snippets(result, "ROS PoseWithCovariance"):
        message = yaml.safe_load(snippet.text)
        np.testing.assert_allclose(matrix(*message["pose"].values()), T, rtol=0, atol=1e-9)
        assert all(isinstance(value, float) for value in message["covariance"])
        again = from_convention(np.reshape(message["covariance"], (6, 6)), T, "ros")
        assert_same_covariance(again, covariance, 1e-6)
        assert f"of {child} in {parent}" in snippet.convention
        assert "translation first" in snippet.convention


def test_urdf_joint(result):
    for snippet, (T, _, parent, child) in snippets(result, "URDF"):
        joint = ElementTree.fromstring(snippet.text)
        assert joint.get("type") == "fixed"
        assert (joint.find("parent").get("link"), joint.find("child").get("link")) == (parent, child)
        np.testing.assert_allclose(from_origin(joint.find("origin")), T, rtol=0, atol=1e-9)


def test_snippets_say_that_the_covariance_is_not_determined(unknown):
    for snippet in texts(unknown):
        assert snippet.convention
        if "static transform" not in snippet.title and "URDF" not in snippet.title:
            assert "not determined" in snippet.convention
            assert "covariance" not in snippet.text
        if snippet.title.startswith("ROS Pose:"):
            assert set(yaml.safe_load(snippet.text)) == {"position", "orientation"}


def test_motions_without_poses():
    A, B = (uq.relative_motions(uq.simulate(10, noise=NOISE, seed=1), "all").A for _ in range(2))
    motions = uq.Motions(A, B)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        found = texts(uq.calibrate(motions, noise=uq.PairNoise.isotropic(A=("0.1deg", "1mm"))))
    assert found[0].title == "NumPy: frame_of_A_T_frame_of_B"
    for snippet in found:
        if snippet.language == "python" and "gtsam" not in snippet.text:
            run(snippet)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2, *(np.pi / 2 - np.logspace(-12, -1, 12))])
def test_fixed_axis_angles_near_gimbal_lock(pitch):
    for roll, yaw in ((0.0, 0.0), (0.3, -2.0), (-3.0, 3.1), (np.pi, np.pi / 2)):
        R = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
        origin = ElementTree.Element("origin", xyz="0 0 0", rpy=" ".join(f"{a:.17g}" for a in fixed_axis_angles(R)))
        np.testing.assert_allclose(from_origin(origin)[:3, :3], R, rtol=0, atol=1e-14)


def test_fixed_axis_angles_of_any_rotation():
    vectors = rotation_vectors(np.random.default_rng(SEED), (500,), 0.0, np.pi)
    for R in rotations(vectors):
        again = Rotation.from_euler("xyz", fixed_axis_angles(R)).as_matrix()
        np.testing.assert_allclose(again, R, rtol=0, atol=1e-14)


# ---------------------------------------------------------------------------------------------------------------- files


def test_json(result, tmp_path):
    again = uq.Calibration.from_json(result.export(tmp_path / "x.json"))
    np.testing.assert_array_equal(again.X, result.X)
    np.testing.assert_array_equal(again.covariance, result.covariance)


def test_ros_file(result, unknown, tmp_path):
    text = export.write_export(result, tmp_path / "x.yaml").read_text()
    data = yaml.safe_load(text)
    for key, (T, _, parent, child) in zip(
        ("transform_stamped", "inverse_transform_stamped"), both(result), strict=True
    ):
        message = data[key]
        assert message["header"] == {"frame_id": parent}
        assert message["child_frame_id"] == child
        again = matrix(message["transform"]["translation"], message["transform"]["rotation"])
        np.testing.assert_allclose(again, T, rtol=0, atol=1e-14)
    message = data["pose_with_covariance_stamped"]
    assert message["header"] == {"frame_id": FRAMES[result.setup][0]}
    np.testing.assert_allclose(matrix(*message["pose"]["pose"].values()), result.X, rtol=0, atol=1e-14)
    covariance = message["pose"]["covariance"]
    assert len(covariance) == 36
    assert all(isinstance(value, float) for value in covariance)
    assert_same_covariance(from_convention(np.reshape(covariance, (6, 6)), result.X, "ros"), result.covariance, 1e-9)
    assert "translation first" in text
    text = export.write_export(unknown, tmp_path / "y.yml").read_text()
    assert set(yaml.safe_load(text)) == {"transform_stamped", "inverse_transform_stamped"}
    assert "not determined" in text


def test_urdf_file(result, tmp_path):
    robot = ElementTree.parse(export.write_export(result, tmp_path / "x.urdf")).getroot()
    parent, child = FRAMES[result.setup]
    assert robot.tag == "robot"
    assert [link.get("name") for link in robot.findall("link")] == [parent, child]
    np.testing.assert_allclose(from_origin(robot.find("joint/origin")), result.X, rtol=0, atol=1e-14)


def test_opencv_file(result, unknown, tmp_path):
    cv2 = pytest.importorskip("cv2")
    storage = cv2.FileStorage(str(export.write_export(result, tmp_path / "x.yaml", "opencv")), cv2.FILE_STORAGE_READ)
    for T, covariance, parent, child in both(result):
        name = f"{child}2{parent}".replace("camera", "cam")
        np.testing.assert_array_equal(storage.getNode(f"{parent}_T_{child}").mat(), T)
        np.testing.assert_array_equal(storage.getNode(f"R_{name}").mat(), T[:3, :3])
        np.testing.assert_array_equal(storage.getNode(f"t_{name}").mat(), T[:3, 3:])
        np.testing.assert_array_equal(storage.getNode(f"covariance_{parent}_T_{child}").mat(), covariance)
    assert storage.getNode("units").string() == "m"
    assert "left rotation, additive translation" in storage.getNode("convention").string()
    storage = cv2.FileStorage(str(export.write_export(unknown, tmp_path / "y.yml", "opencv")), cv2.FILE_STORAGE_READ)
    assert not [key for key in storage.root().keys() if "covariance" in key]  # noqa: SIM118
    assert "not determined" in storage.getNode("convention").string()


def test_npz_file(result, unknown, tmp_path):
    with np.load(export.write_export(result, tmp_path / "x.npz"), allow_pickle=False) as data:
        for name in ("X", "covariance", "covariance_inverse", "W", "covariance_W"):
            np.testing.assert_array_equal(data[name], getattr(result, name))
        np.testing.assert_array_equal(data["X_inverse"], result.inverse)
        assert str(data["frame"]) == result.frame
        assert "rotation first" in str(data["convention"])
    with np.load(export.write_export(unknown, tmp_path / "y.npz"), allow_pickle=False) as data:
        assert "covariance" not in data
        assert "not determined" in str(data["convention"])


def test_covariances_in_the_convention_of_a_library(result, tmp_path):
    path = result.export(tmp_path / "x.npz", covariance_convention="manif")
    with np.load(path, allow_pickle=False) as data:
        assert_same_covariance(from_convention(data["covariance"], result.X, "manif"), result.covariance, 1e-9)
        assert_same_covariance(
            from_convention(data["covariance_inverse"], result.inverse, "manif"), result.covariance_inverse, 1e-9
        )
        assert "manif: translation first" in str(data["convention"])
    path = result.export(tmp_path / "x.yaml", "opencv", covariance_convention="gtsam")
    assert "gtsam: rotation first" in path.read_text(encoding="utf-8")
    with pytest.raises(uq.InputError, match="opencv and npz take one"):
        result.export(tmp_path / "x.json", covariance_convention="gtsam")


@pytest.mark.slow
@holds_for(examples=50, scale=st.floats(1e-12, 1e3))
def test_any_size_of_covariance_is_read_back(scale):
    from uq_handeye.formats.opencv_storage import yaml_number

    assert yaml.safe_load(yaml_number(scale)) == scale
    assert isinstance(yaml.safe_load(yaml_number(-0.0)), float)


def about(axis, degrees):
    """Rotation by SciPy about one axis, in degrees."""
    return Rotation.from_euler(axis, degrees, degrees=True).as_matrix()


def numbers_of(line):
    return [float(x) for x in re.findall(r"(?<![\w.])-?\d+\.?\d*(?:e[+-]?\d+)?", line)]


DECODED = {
    "ur": lambda v: (v[:3], Rotation.from_rotvec(v[3:]).as_matrix()),
    "kuka": lambda v: (v[:3] / 1e3, about("z", v[3]) @ about("y", v[4]) @ about("x", v[5])),
    "fanuc": lambda v: (v[:3] / 1e3, about("z", v[5]) @ about("y", v[4]) @ about("x", v[3])),
    "abb": lambda v: (v[:3] / 1e3, Rotation.from_quat(np.roll(v[3:], -1)).as_matrix()),
    "staubli": lambda v: (v[:3] / 1e3, about("x", v[3]) @ about("y", v[4]) @ about("z", v[5])),
    "yaskawa": lambda v: (v[:3] / 1e3, about("z", v[5]) @ about("y", v[4]) @ about("x", v[3])),
    "kawasaki": lambda v: (v[:3] / 1e3, about("z", v[3]) @ about("y", v[4]) @ about("z", v[5])),
    "rpy": lambda v: (
        v[:3],
        about("z", np.degrees(v[5])) @ about("y", np.degrees(v[4])) @ about("x", np.degrees(v[3])),
    ),
}


@pytest.mark.parametrize("format", DECODED)
def test_pose_as_a_controller_writes_it(result, tmp_path, format):
    """The last line holds the numbers; the rotation is put together from rotations about single axes."""
    lines = export.write_export(result, tmp_path / "x.txt", format).read_text().splitlines()
    assert result.frame in lines[0] and "1 sigma" in lines[1] and "mm" in lines[1]
    values = np.array(numbers_of(lines[-1].partition("=")[2] or lines[-1]))
    t, R = DECODED[format](values)
    np.testing.assert_allclose(t, result.X[:3, 3], atol=1e-12)
    np.testing.assert_allclose(R, result.X[:3, :3], atol=1e-12)


def test_matrices_of_other_programs(result, unknown, tmp_path):
    def text(format):
        return export.write_export(result, tmp_path / "x.txt", format).read_text()

    np.testing.assert_array_equal(np.loadtxt(tmp_path / "x.txt") if text("matrix") else None, result.X.ravel())
    row = np.array(text("franka").splitlines()[-1].split(","), dtype=float)
    np.testing.assert_array_equal(row.reshape(4, 4).T, result.X)
    zivid = yaml.safe_load(text("zivid"))
    in_mm = np.array(zivid["FloatMatrix"]["Data"])
    np.testing.assert_allclose(in_mm[:3, 3], 1e3 * result.X[:3, 3])
    np.testing.assert_array_equal(in_mm[:, :3], result.X[:, :3])
    halcon = {line[0]: line[2:].split() for line in text("halcon").splitlines() if line[:2] in ("f ", "r ", "t ")}
    angles = np.array(halcon["r"], dtype=float)
    R = about("x", angles[0]) @ about("y", angles[1]) @ about("z", angles[2])
    assert halcon["f"] == ["0"]
    np.testing.assert_allclose(R, result.X[:3, :3], atol=1e-12)
    np.testing.assert_array_equal(np.array(halcon["t"], dtype=float), result.X[:3, 3])
    assert "not determined" in export.write_export(unknown, tmp_path / "x.dat", "kuka").read_text()
    for format in SINGLE:
        with pytest.raises(uq.InputError, match="holds one pose, not 2"):
            written_poses(np.stack([result.X] * 2), format, ["a", "b"])


def test_which_format(result, tmp_path):
    assert set(export.FORMATS) == {"json", "ros", "launch", "urdf", "opencv", "npz", *WRITTEN}
    for name, format in (("a.JSON", None), ("a.YAML", None), ("a", "ros"), ("a.txt", "opencv"), ("a.urdf", "urdf")):
        assert result.export(tmp_path / name, format).stat().st_size
    for name, format, parts in (
        ("a.xml", None, [".json, .yaml", "--format"]),
        ("a", None, ["--format"]),
        ("a.json", "ros", ["ros", ".yaml or .yml", "a.json"]),
        ("a.yaml", "npz", ["npz", ".npz"]),
        ("a.yaml", "kdl", ["json, ros, launch, urdf, opencv, npz", "'kdl'"]),
        ("none/a.yaml", None, ["no folder"]),
    ):
        with pytest.raises(uq.InputError) as caught:
            result.export(tmp_path / name, format)
        assert "\n" not in str(caught.value)
        for part in parts:
            assert part in str(caught.value)
    assert {path.suffix for path in tmp_path.iterdir()} <= {
        "",
        ".JSON",
        ".YAML",
        ".txt",
        ".urdf",
    }  # none by halves


def test_launch_file(result, tmp_path, monkeypatch):
    """The launch file, run with stand-ins for ROS, publishes X under the names that the program of ROS takes."""
    path = result.export(tmp_path / "x.launch.py")
    nodes = []
    launch = types.SimpleNamespace(LaunchDescription=list)
    monkeypatch.setitem(sys.modules, "launch", launch)
    monkeypatch.setitem(sys.modules, "launch_ros", types.SimpleNamespace())
    actions = types.SimpleNamespace(Node=lambda **node: nodes.append(node))
    monkeypatch.setitem(sys.modules, "launch_ros.actions", actions)
    runpy.run_path(str(path))["generate_launch_description"]()
    (node,) = nodes
    assert (node["package"], node["executable"]) == ("tf2_ros", "static_transform_publisher")
    given = dict(zip(node["arguments"][::2], node["arguments"][1::2], strict=True))
    position, quaternion = ({a: float(given[f"--{q}{a}"]) for a in axes} for q, axes in (("", "xyz"), ("q", "xyzw")))
    parent, child = FRAMES[result.setup]
    assert (given["--frame-id"], given["--child-frame-id"]) == (parent, child)
    np.testing.assert_allclose(matrix(position, quaternion), result.X, atol=1e-14)
    assert "translation first" in path.read_text().splitlines()[0]
    assert "translation first" in result.export(tmp_path / "x.yaml").read_text().splitlines()[0]
