"""Poses written as matrices, in the forms of `matrix_forms`: read to 1e-9, or refused by name."""

import numpy as np
import pytest
from matrix_forms import FORMS, FRANKA, rig_of

from uq_handeye.io import read_poses

ROBOT, CAMERA = rig_of()
ANOTHER = {"16, times", "16 by columns, times", "12, times", "columns, times", "columns, blanks"}


@pytest.fixture(scope="module")
def camera(tmp_path_factory):
    path = tmp_path_factory.mktemp("camera") / "camera.npy"
    np.save(path, CAMERA)
    return path


def check(poses, atol=1e-9):
    np.testing.assert_allclose(poses.robot, ROBOT, rtol=0, atol=atol)
    np.testing.assert_allclose(poses.camera, CAMERA, rtol=0, atol=atol)


@pytest.mark.parametrize("form", FORMS)
def test_matrices_in_text(tmp_path, camera, form):
    path = tmp_path / "robot.txt"
    path.write_text(FORMS[form](ROBOT), encoding="utf-8")
    poses = read_poses(path, camera)
    check(poses)
    assert poses.sources[0].format == "matrix"
    assert (poses.timestamps is not None) == (form in ANOTHER)
    check(read_poses(path, camera, format=("matrix", None)))


@pytest.mark.parametrize("form", FRANKA)
def test_franka(tmp_path, camera, form):
    path = tmp_path / "robot.csv"
    path.write_text(FRANKA[form](ROBOT), encoding="utf-8")
    poses = read_poses(path, camera)
    check(poses)
    assert poses.sources[0].format == "franka"
