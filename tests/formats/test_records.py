"""Poses in JSON under names of people's own, robot and camera told apart by the motions where names say too little."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import SEED

import uq_handeye as uq
from uq_handeye.read import write_pose_file

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


@pytest.fixture(scope="module")
def poses():
    return uq.simulate(10, noise=NOISE, seed=SEED)


def entries(poses, make):
    return [
        make(R, T[:3, 3].tolist())
        for R, T in zip(Rotation.from_matrix(poses.robot[:, :3, :3]), poses.robot, strict=True)
    ]


def mm(t):
    return [1e3 * x for x in t]


FORMS = {
    "R t": lambda R, t: {"R": R.as_matrix().tolist(), "t": t},
    "columns": lambda R, t: {"id": 3, "R": R.as_matrix().tolist(), "tvec": [[x] for x in t]},
    "rvec": lambda R, t: {"rvec": R.as_rotvec().tolist(), "tvec": t},
    "flat": lambda R, t: dict(zip(("x", "y", "z", "rx", "ry", "rz"), [*t, *R.as_rotvec().tolist()], strict=True)),
    "kuka": lambda R, t: dict(zip("XYZABC", [*mm(t), *R.as_euler("ZYX", degrees=True).tolist()], strict=True)),
    "rpy": lambda R, t: {"position": t, "rpy": R.as_euler("xyz").tolist()},
    "quaternion": lambda R, t: {"position": t, "orientation": R.as_quat().tolist()},
    "scalar first": lambda R, t: {"pos": t, "quat": R.as_quat(scalar_first=True).tolist()},
    "pose": lambda R, t: {"name": "p", "pose": [*t, *R.as_rotvec().tolist()]},
}


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("below", [None, "poses", "robot"])
def test_maps_of_one_pose(poses, tmp_path, form, below):
    write_pose_file(tmp_path / "camera.csv", poses.camera)
    values = entries(poses, FORMS[form])
    (tmp_path / "robot.json").write_text(json.dumps(values if below is None else {below: values}))
    read = uq.read_poses(tmp_path / "robot.json", tmp_path / "camera.csv")
    np.testing.assert_allclose(read.robot, poses.robot, atol=1e-9)


def test_what_is_no_pose_is_refused(poses, tmp_path):
    write_pose_file(tmp_path / "camera.csv", poses.camera)
    for values in ([{"a": 1.0}] * 10, [{"position": [1, 2], "rpy": [0, 0, 0]}] * 10, [{"x": 1, "y": 2, "z": 3}] * 10):
        (tmp_path / "robot.json").write_text(json.dumps(values))
        with pytest.raises(uq.InputError) as caught:
            uq.read_poses(tmp_path / "robot.json", tmp_path / "camera.csv")
        assert "\n" not in str(caught.value) and "format" in str(caught.value)


def test_joint_values_are_named(poses, tmp_path):
    write_pose_file(tmp_path / "camera.csv", poses.camera)
    numbers = np.random.default_rng(SEED).normal(size=(10, 6))
    np.savetxt(tmp_path / "joints.csv", numbers, delimiter=",", header="j1,j2,j3,j4,j5,j6", comments="")
    with pytest.raises(uq.InputError, match=r"joint values .*--joints with --urdf"):
        uq.read_poses(tmp_path / "joints.csv", tmp_path / "camera.csv")


@pytest.mark.parametrize("names", [("rvec", "tvec"), ("rotations", "translations"), ("Rs", "ts")])
def test_other_names_of_arrays(poses, tmp_path, names):
    write_pose_file(tmp_path / "camera.csv", poses.camera)
    rotation = Rotation.from_matrix(poses.robot[:, :3, :3])
    values = rotation.as_rotvec() if names[0] == "rvec" else rotation.as_matrix()
    np.savez(tmp_path / "robot.npz", **dict(zip(names, (values, poses.robot[:, :3, 3]), strict=True)))
    read = uq.read_poses(tmp_path / "robot.npz", tmp_path / "camera.csv")
    np.testing.assert_allclose(read.robot, poses.robot, atol=1e-9)


def test_a_result_is_no_table_of_poses(poses, tmp_path):
    write_pose_file(tmp_path / "camera.csv", poses.camera)
    uq.calibrate(poses, noise=NOISE).to_json(tmp_path / "result.json")
    with pytest.raises(uq.InputError, match="is a result of uq-handeye"):
        uq.read_poses(tmp_path / "result.json", tmp_path / "camera.csv")


def quaternion_list(R, t):
    return {"translation": t, "rotation": R.as_quat().tolist()}


def visp(R, t):
    return {"rows": 6, "cols": 1, "data": [[x] for x in [*t, *R.as_rotvec().tolist()]]}


FILES = {
    "poses.jsonl": lambda each: "\n".join(map(json.dumps, each)),
    "commas.json": lambda each: ",\n".join(json.dumps(one, indent=1) for one in each),
    "several.yaml": lambda each: "---\n" + "\n---\n".join(map(json.dumps, each)) + "\n---\n",
    "numbered.yaml": lambda each: json.dumps({f"pose_{k}": one for k, one in enumerate(each)}),
    "pictures.json": lambda each: json.dumps({"robot": {f"img{k}.png": one for k, one in enumerate(each)}}),
}


@pytest.mark.parametrize("file", FILES)
def test_one_document_or_entry_per_pose(poses, tmp_path, file):
    write_pose_file(tmp_path / "camera.csv", poses.camera)
    (tmp_path / file).write_text(FILES[file](entries(poses, quaternion_list)))
    read = uq.read_poses(tmp_path / file, tmp_path / "camera.csv")
    np.testing.assert_allclose(read.robot, poses.robot, atol=1e-9)


def test_pose_vectors_of_visp(poses, tmp_path):
    write_pose_file(tmp_path / "camera.csv", poses.camera)
    for k, one in enumerate(entries(poses, visp)):
        (tmp_path / f"pose_rPe_{k + 1}.yaml").write_text(json.dumps(one))
    read = uq.read_poses(tmp_path / "pose_rPe_*.yaml", tmp_path / "camera.csv")
    np.testing.assert_allclose(read.robot, poses.robot, atol=1e-9)
