"""A target that no camera sees, and files that are inverse or exchanged: X fits as well, and a caution says so."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.rigs import quietly
from scipy.spatial.transform import Rotation
from support import SEED

import uq_handeye as uq
from uq_handeye.core.geometry.frames import CAMERA_CONVENTIONS
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.fit.diagnostics.camera_views import check_views
from uq_handeye.methods.all_pairs import solve_all_pairs
from uq_handeye.read.poses import in_convention

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
SETUPS = ("eye-in-hand", "eye-to-hand")


def _rig(setup, seed=SEED):
    """Poses of a camera that looks at its target from all sides, 0.6 m away."""
    rng = np.random.default_rng(seed)
    poses = uq.simulate(18, setup=setup, noise=NOISE, seed=int(rng.integers(1000)))
    return poses if setup == "eye-in-hand" else replace(poses, truth=None)


def _said(poses):
    return check_views(poses, solve_all_pairs(poses))


@pytest.mark.parametrize("setup", SETUPS)
def test_good_rigs_have_no_word(setup):
    for seed in range(20):
        assert _said(_rig(setup, seed)) == []


@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("name", ["opengl", "ros", "wpilib"])
def test_another_convention_is_named_and_its_option_mends_it(setup, name):
    good = _rig(setup)
    poses = replace(good, camera=inverse(CAMERA_CONVENTIONS[name]) @ good.camera)
    (found,) = _said(poses)
    assert found.code == "input_checks.target_unseen" and found.severity == "caution"
    first = found.values["views"][0]
    assert first["kind"] == "convention" and np.array_equal(CAMERA_CONVENTIONS[first["name"]], CAMERA_CONVENTIONS[name])
    assert f"--camera-convention {first['name']}" in str(found)
    mended = in_convention(poses, first["name"])
    assert np.allclose(mended.camera, good.camera) and _said(mended) == []
    assert _said(in_convention(poses, "optical")) == []  # confirmed: a tracker


@pytest.mark.parametrize("setup", SETUPS)
def test_inverse_and_exchanged_files_are_named(setup):
    for seed in range(2):
        good = _rig(setup, seed)
        for kind, robot, camera in (
            ("both inverse", inverse(good.robot), inverse(good.camera)),
            ("exchanged inverse", inverse(good.camera), inverse(good.robot)),
        ):
            result = quietly(uq.PosePairs(robot, camera, setup))
            found = [one for one in result.findings if one.severity in ("caution", "failure")]
            assert any(
                one.code == "input_checks.long_bracket"
                or kind in [reading["kind"] for reading in one.values.get("views", ())]
                for one in found
            ), (kind, seed)


def _write(path, T):
    rows = [[k, *pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()] for k, pose in enumerate(T)]
    np.savetxt(path, rows, delimiter=",", header="timestamp,x,y,z,qx,qy,qz,qw", comments="")


def test_files_are_read_in_the_convention(tmp_path):
    good = _rig("eye-in-hand")
    robot, camera = tmp_path / "robot.csv", tmp_path / "camera.csv"
    _write(robot, good.robot)
    _write(camera, inverse(CAMERA_CONVENTIONS["opengl"]) @ good.camera)
    assert np.allclose(uq.read_poses(robot, camera, camera_convention="opengl").camera, good.camera)
    with pytest.raises(uq.InputError, match="camera_convention"):
        uq.read_poses(robot, camera, camera_convention="unity")


@pytest.mark.slow
def test_a_camera_in_the_frame_of_its_gripper_or_far_from_it_is_doubted():
    good = _rig("eye-in-hand")
    offset = np.eye(4)
    offset[:3, 3] = 0.3, 0.6, 0.1
    X = solve_all_pairs(good)
    for robot, code in ((good.robot @ X, "input_checks.identity"), (good.robot @ offset, "input_checks.far_camera")):
        poses = uq.PosePairs(robot, good.camera)
        assert code in [one.code for one in quietly(poses).findings]
        place = inverse(X) @ X if code.endswith("identity") else inverse(offset) @ X
        prior = (place, np.diag([1.0, 1, 1, 1e-4, 1e-4, 1e-4]))
        assert code not in [one.code for one in quietly(poses, prior_X=prior).findings]
