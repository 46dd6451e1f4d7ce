"""Matrices in arrays and in JSON and YAML of any names; files that hold no poses, refused with what to do."""

import io
import json
import pickle
import zipfile

import numpy as np
import pytest
import yaml
from fixtures.matrix_texts import rig_of
from scipy.spatial.transform import Rotation

from uq_handeye.errors import InputError
from uq_handeye.read import read_poses

ROBOT, CAMERA = rig_of()
TURNED = np.swapaxes(ROBOT, 1, 2)
QUATERNIONS, T = Rotation.from_matrix(ROBOT[:, :3, :3]).as_quat(), ROBOT[:, :3, 3]

ARRAYS = {
    "columns": TURNED,
    "n x 16": ROBOT.reshape(-1, 16),
    "n x 16, columns": TURNED.reshape(-1, 16),
    "n x 12": ROBOT[:, :3].reshape(-1, 12),
    "n x 13": np.c_[np.arange(30), ROBOT[:, :3].reshape(-1, 12)],
    "4 x 4 x n": np.moveaxis(ROBOT, 0, -1),
    "3 x 4 x n": np.moveaxis(ROBOT[:, :3], 0, -1),
    "9 + 3": np.c_[ROBOT[:, :3, :3].reshape(-1, 9), T],
    "9 + 3, columns": np.c_[TURNED[:, :3, :3].reshape(-1, 9), T],
    "n x 7": np.c_[T, QUATERNIONS],
    "n x 7, scalar first": np.c_[T, np.roll(QUATERNIONS, 1, axis=1)],
    "quaternion first": np.c_[QUATERNIONS, T],
    "n x 8": np.c_[0.5 * np.arange(30), T, QUATERNIONS],
}
MATRICES = ROBOT.tolist()
TREES = {
    "4x4": MATRICES,
    "16, columns": TURNED.reshape(-1, 16).tolist(),
    "3x4": ROBOT[:, :3].tolist(),
    "a name": {"units": "m", "T_base_tool": MATRICES},
    "a list of maps": [{"id": k, "T": M} for k, M in enumerate(MATRICES)],
    "numbered": {f"pose_{k}": M for k, M in enumerate(MATRICES)},
    "frames": {"angle": 0.5, "frames": [{"file": f"{k}.png", "transform_matrix": M} for k, M in enumerate(MATRICES)]},
    "elements": [{"elements": row} for row in TURNED.reshape(-1, 16).tolist()],
    "poses": {"poses": [{"name": "a", "matrix": M} for M in MATRICES]},
    "robot": {"robot": TURNED.reshape(-1, 16).tolist()},
}


@pytest.fixture(scope="module")
def camera(tmp_path_factory):
    path = tmp_path_factory.mktemp("camera") / "camera.npy"
    np.save(path, CAMERA)
    return path


@pytest.mark.parametrize("form", ARRAYS)
def test_arrays(tmp_path, camera, form):
    np.save(tmp_path / "robot.npy", ARRAYS[form])
    np.savez(tmp_path / "robot.npz", arm=ARRAYS[form])
    for name in ("robot.npy", "robot.npz"):
        np.testing.assert_allclose(read_poses(tmp_path / name, camera).robot, ROBOT, rtol=0, atol=1e-9)


def test_arrays_of_franka(tmp_path, camera):
    others = {"F_T_EE": np.tile(np.eye(4).reshape(16), (30, 1)), "q": np.zeros((30, 7))}
    np.savez(tmp_path / "robot.npz", O_T_EE=TURNED.reshape(-1, 16), **others)
    for format in (None, ("franka", None)):
        np.testing.assert_allclose(read_poses(tmp_path / "robot.npz", camera, format=format).robot, ROBOT, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("form", TREES)
def test_trees(tmp_path, camera, form):
    for suffix, text in (
        ("json", json.dumps(TREES[form])),
        ("yaml", yaml.dump(TREES[form], Dumper=yaml.CSafeDumper, default_flow_style=None)),
    ):
        path = tmp_path / f"robot.{suffix}"
        path.write_text(text)
        np.testing.assert_allclose(read_poses(path, camera).robot, ROBOT, rtol=0, atol=1e-9)


def test_a_few_poses_do_not_decide(tmp_path):
    for side, poses in (("robot", ARRAYS["9 + 3"]), ("camera", CAMERA)):
        np.save(tmp_path / f"{side}.npy", poses[:3])
    files = tmp_path / "robot.npy", tmp_path / "camera.npy"
    with pytest.raises(InputError, match=r"may be matrix \(matrix\), matrix \(transposed\).*--rotation robot=matrix"):
        read_poses(*files)
    np.testing.assert_allclose(read_poses(*files, rotation=("matrix", None)).robot, ROBOT[:3], atol=1e-12)


def _zip(*names):
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name in names:
            archive.writestr(name, "text")
    return data.getvalue()


def _objects():
    data = io.BytesIO()
    np.save(data, np.array([{"T": 1}, None], dtype=object), allow_pickle=True)
    return data.getvalue()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("robot.pkl", pickle.dumps(MATRICES), r"never loaded.*import pickle, numpy as np; np.save\('robot.npy'"),
        ("robot.dat", pickle.dumps(MATRICES), r"is a pickle of Python.*pickle.load\(open\('robot.dat', 'rb'\)\)"),
        ("robot.joblib", b"x\x9c\x00", r"import joblib.*joblib.load\('robot.joblib'\)"),
        ("robot.npy", _objects(), r"Python objects.*np.save\('robot_poses.npy'.*allow_pickle=True"),
        ("robot.mat", b"MATLAB 7.3 MAT-file, Platform", r"version 7.3.*'-v7'.*writematrix"),
        ("frame.zdf", b"\x89HDF\r\n\x1a\n", "a frame of Zivid, and a point cloud"),
        ("poses.h5", b"\x89HDF\r\n\x1a\n", "HDF5.*numpy.save"),
        ("img.png", b"\x89PNG\r\n\x1a\n\0\0", "picture.*--images.*--board"),
        ("img.jpg", b"\xff\xd8\xff\xe0", "picture"),
        ("poses.pdf", b"%PDF-1.7\n", "PDF"),
        ("poses.xlsx", _zip("[Content_Types].xml", "xl/workbook.xml"), "spreadsheet.*CSV"),
        ("poses.zip", _zip("robot.csv"), "ZIP archive: unpack"),
        ("cell.bag", b"#ROSBAG V2.0\n", "--bag"),
        ("cell.mcap", b"\x89MCAP0\r\n", "--bag"),
        ("scan.ply", b"ply\nformat ascii 1.0\n", "point cloud"),
    ],
)
def test_files_that_hold_no_poses(tmp_path, camera, name, content, message):
    (tmp_path / name).write_bytes(content)
    for format in (None, ("csv", None)) if name != "robot.npy" else (None,):
        with pytest.raises(InputError, match=message) as error:
            read_poses(tmp_path / name, camera, format=format)
        assert "\n" not in str(error.value)


def test_mat_files(tmp_path, camera, monkeypatch):
    savemat = pytest.importorskip("scipy.io").savemat
    cells = np.empty((1, 30), dtype=object)
    for k, M in enumerate(ROBOT):
        cells[0, k] = M
    for values in (np.moveaxis(ROBOT, 0, -1), np.moveaxis(TURNED, 0, -1), ROBOT.reshape(-1, 16), cells):
        for packed in (False, True):
            savemat(tmp_path / "robot.mat", {"T": values, "comment": "of the cell"}, do_compression=packed)
            np.testing.assert_allclose(read_poses(tmp_path / "robot.mat", camera).robot, ROBOT, atol=1e-12)
    data = (tmp_path / "robot.mat").read_bytes()
    for wrong, message in (
        (data[:-20], "cut off"),
        (data[:140] + b"\1" * (len(data) - 140), "damaged|cut off|expected"),
    ):
        (tmp_path / "wrong.mat").write_bytes(wrong)
        with pytest.raises(InputError, match=message):
            read_poses(tmp_path / "wrong.mat", camera)
    monkeypatch.setattr("uq_handeye.formats.matlab_poses.MAX_TABLE_BYTES", 100_000)
    savemat(tmp_path / "bomb.mat", {"T": np.zeros((4, 4, 2000))}, do_compression=True)
    with pytest.raises(InputError, match=r"at most 0\.1 MB unpacked"):
        read_poses(tmp_path / "bomb.mat", camera)
