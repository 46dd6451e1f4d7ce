"""Files of touches: names, units, boards, joints, and what is refused."""

import numpy as np
import pytest
from fixtures.arms import SIX_AXES
from scipy.spatial.transform import Rotation
from support import random_transforms

import uq_handeye as uq
from uq_handeye.model.kinematics.chain import Kinematics

HEAD = "point,seen_x,seen_y,seen_z,touched_x,touched_y,touched_z"
ROW = "A,0.1,0.2,0.5,0.4,0.1,0.05"
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")


def read(tmp_path, *lines, **options):
    (tmp_path / "touches.csv").write_text("\n".join(lines) + "\n")
    return uq.read_touches(tmp_path / "touches.csv", **({"touch_sd": 2e-4} | options))


def test_plain(tmp_path):
    found = read(tmp_path, "# measured by hand", HEAD, "", ROW, ROW.replace("A", "B"), point_sd=3e-4)
    assert found.names == ("A", "B")
    np.testing.assert_allclose(found.seen[0], [0.1, 0.2, 0.5])
    np.testing.assert_allclose(found.touched[1], [0.4, 0.1, 0.05])
    np.testing.assert_allclose(found.seen_covariance[0], 9e-8 * np.eye(3))
    assert (found.touch_sd == 2e-4).all()


def test_units_of_columns_and_of_the_caller(tmp_path):
    head = "seen_x [mm];seen_y_mm;seen_z (mm);base_x;base_y;base_z;touched_sd_mm;seen_sd"
    found = read(tmp_path, head, "100;200;500;40;10;5;0.3;0.02", units="cm", touch_sd=None)
    np.testing.assert_allclose(found.seen, [[0.1, 0.2, 0.5]])
    np.testing.assert_allclose(found.touched, [[0.4, 0.1, 0.05]])
    np.testing.assert_allclose(found.touch_sd, 3e-4)
    np.testing.assert_allclose(found.seen_covariance[0], 4e-8 * np.eye(3))


def test_robot_poses_and_joints(tmp_path, rng):
    arm = Kinematics.from_urdf(SIX_AXES)
    T = random_transforms(rng)
    values = [*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat()]
    q = rng.uniform(-1, 1, 6)
    head = ["seen_x,seen_y,seen_z", *(f"seen_at_{name}" for name in POSE)]
    head += [f"touched_at_{name} [deg]" for name in arm.names]
    row = ["0.1,0.2,0.5", *map(repr, map(float, values)), *map(repr, map(float, np.degrees(q)))]
    found = read(tmp_path, ",".join(head), ",".join(row), arm=arm, tool=np.array([0, 0, 0.1]))
    np.testing.assert_allclose(found.robot[0], T, atol=1e-12)
    np.testing.assert_allclose(found.touched_joints[0], q)
    assert found.touched is None and found.tool[2] == 0.1


def test_points_of_a_board(tmp_path, rng):
    board = random_transforms(rng, (2,))
    head = HEAD.replace("seen_", "board_") + ",board_pose"
    found = read(tmp_path, head, f"{ROW},1", f"{ROW},0", board=board)
    np.testing.assert_allclose(found.board, board[[1, 0]])
    with pytest.raises(uq.InputError, match="line 2, column board_pose: expected a row 0 to 1"):
        read(tmp_path, head, f"{ROW},2", board=board)
    with pytest.raises(uq.InputError, match="--board-poses"):
        read(tmp_path, head, f"{ROW},0")


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([HEAD], "no rows"),
        ([], "the file is empty"),
        (["x,y,z", "1,2,3"], "line 1: expected a header with seen_x"),
        ([HEAD, ROW.replace("0.5", "half")], "line 2, column seen_z: expected a number, got 'half'"),
        ([HEAD, ROW, ROW.replace("0.5", "nan")], "line 3, column seen_z: expected a number"),
        ([HEAD, ROW + ",1"], "line 2: expected 7 fields separated by commas, got 8"),
        ([HEAD.replace("seen_z", "z"), ROW], "expected the columns seen_z beside seen_x"),
        ([HEAD.replace("touched", "other"), ROW], "where the points were touched"),
        ([HEAD.replace("seen_y", "seen_x"), ROW], "two columns seen_x"),
        ([HEAD + ",touched_sd", ROW + ",-1"], "line 2, column touched_sd: expected >= 0"),
        ([HEAD.replace("seen_x", "seen_x [deg]"), ROW], "unknown unit 'deg' of a length"),
        ([HEAD + "".join(f",seen_at_{n}" for n in POSE), ROW + ",0,0,0,0,0,0,2"], "line 2, columns seen_at_qx"),
    ],
)
def test_what_is_refused(tmp_path, lines, message):
    with pytest.raises(uq.InputError, match=r"touches\.csv") as error:
        read(tmp_path, *lines)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_noise_of_a_touch_is_needed(tmp_path):
    with pytest.raises(uq.InputError, match=r"--tcp-sd 0\.2mm, or a column touched_sd"):
        read(tmp_path, HEAD, ROW, touch_sd=None)
