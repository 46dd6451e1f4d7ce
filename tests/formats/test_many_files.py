"""One file per pose: folders and patterns as they are met, with what lies beside the files."""

import json

import numpy as np
import pytest
from fixtures.matrix_texts import blocks, rig_of
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from uq_handeye.cli.app import app
from uq_handeye.errors import InputError
from uq_handeye.read import read_poses

ROBOT, CAMERA = rig_of(12)


def write(folder, poses, name="pose_{k}.txt", first=0, numbers=None):
    folder.mkdir(parents=True, exist_ok=True)
    for k, T in zip(range(first, first + len(poses)) if numbers is None else numbers, poses, strict=True):
        (folder / name.format(k=k)).write_text(blocks([T]))
    return folder


def check(poses):
    np.testing.assert_allclose(poses.robot, ROBOT, atol=1e-12)
    np.testing.assert_allclose(poses.camera, CAMERA, atol=1e-12)


@pytest.fixture
def camera(tmp_path):
    np.save(tmp_path / "camera.npy", CAMERA)
    return tmp_path / "camera.npy"


@pytest.mark.slow
def test_names_are_ordered_by_their_numbers(tmp_path, camera):
    for name in ("pose_{k}.txt", "{k}", "p{k}_take2.dat", "2024-01-01 pose ({k}).TXT"):
        folder = write(tmp_path / f"robot {name[:2]}", ROBOT, name, first=1)
        poses = read_poses(folder, camera)
        check(poses)
        assert any("12 files" in note for note in poses.sources[0].notes)


def test_what_lies_beside_poses(tmp_path, camera):
    folder = write(tmp_path / "robot", ROBOT, "pos{k}.yaml")
    for name in ("img1.png", "img1.zdf", "cloud.PLY", ".DS_Store", ".pos3.yaml", "README.md", "notes.txt", "Thumbs.db"):
        (folder / name).write_bytes(b"\0\1")
    (folder / "old").mkdir()
    poses = read_poses(folder, camera)
    check(poses)
    assert any("hold no poses are left out" in note and ".zdf" in note for note in poses.sources[0].notes)
    (folder / "extra.csv").write_text("")
    with pytest.raises(InputError, match=r"got 12 \.yaml, 1 \.csv.*'.*robot/\*\.yaml'"):
        read_poses(folder, camera)
    check(read_poses(folder / "*.yaml", camera))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["with blanks", "with [1] brackets", "it's", "äöü"])
def test_patterns_in_folders_of_any_name(tmp_path, name):
    write(tmp_path / name, ROBOT, "robot_{k}.txt")
    write(tmp_path / name, CAMERA, "camera_{k}.txt", first=1)
    check(read_poses(tmp_path / name / "robot_*.txt", tmp_path / name / "camera_*.txt"))
    check(read_poses(f"'{tmp_path}/{name}/robot_*'", tmp_path / name / "camera_?*.txt"))
    check(read_poses(tmp_path / name / "robot_[0-9]*.txt", tmp_path / "**" / "camera_*.txt"))


def test_patterns_of_the_home_folder(tmp_path, camera, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    write(tmp_path / "robot", ROBOT)
    check(read_poses("~/robot/*.txt", camera))


def test_a_folder_of_both_sides_shows_the_patterns(tmp_path, camera):
    write(tmp_path / "cell", ROBOT, "robot_{k}.txt")
    write(tmp_path / "cell", CAMERA, "cam_{k}.txt")
    for path in (tmp_path / "cell", tmp_path / "cell" / "*.txt"):
        with pytest.raises(InputError, match=r"robot_\*\.txt \(12\)") as error:
            read_poses(path, camera)
        assert f"'{tmp_path}/cell/robot_*.txt'" in str(error.value)
        assert f"'{tmp_path}/cell/robot_*.txt' '{tmp_path}/cell/cam_*.txt'" in str(error.value)


@pytest.mark.slow
def test_numbers_of_files_that_do_not_match(tmp_path):
    for lost, message in (
        ((3, 7), r"robot lacks 3; .*camera lacks 7"),
        ((3, None), r"robot has 11 poses and .*camera has 12.*Of the camera, row 3 \(pose_3\.txt\) has no partner\. "),
    ):
        folders = []
        for side, poses, out in (("robot", ROBOT, lost[0]), ("camera", CAMERA, lost[1])):
            kept = [k for k in range(12) if k != out]
            folders.append(write(tmp_path / str(lost) / side, poses[kept], numbers=kept))
        with pytest.raises(InputError, match=message):
            read_poses(*folders)


def numbered(path, poses, numbers, column, form="{}"):
    """Write a table of quaternions with a column that numbers the poses."""
    rows = [",".join([form.format(k), *map(repr, seven)]) for k, seven in zip(numbers, sevens(poses), strict=True)]
    path.write_text("\n".join([f"{column},x,y,z,qx,qy,qz,qw", *rows]))
    return path


def sevens(poses):
    return np.hstack([poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat()]).tolist()


def test_numbers_in_columns_of_tables(tmp_path):
    """Numbers of rows count as those of files: lost ones are named; from 0 and from 1, or of other things, nothing."""
    robot, camera = tmp_path / "robot.csv", tmp_path / "camera.csv"
    lost = {3: [k for k in range(12) if k != 3], 7: [k for k in range(12) if k != 7]}
    numbered(robot, ROBOT[lost[3]], lost[3], "Nr")
    numbered(camera, CAMERA[lost[7]], lost[7], "image", "img_{:03}.png")
    with pytest.raises(InputError, match=r"robot\.csv lacks 3; .*camera\.csv lacks 7.*--pair rows"):
        read_poses(robot, camera)
    assert read_poses(robot, camera, pair="rows").n == 11
    numbered(robot, ROBOT, range(12), "Nr")
    by_name = sorted(range(12), key=str)
    numbered(camera, CAMERA[by_name], by_name, "image", "img_{}.png")
    with pytest.raises(InputError, match="in different orders"):
        read_poses(robot, camera)
    numbered(robot, ROBOT, range(1, 13), "Punkt")
    for numbers in (range(12), range(0, 120, 10), [5] * 12):
        np.testing.assert_allclose(
            read_poses(robot, numbered(camera, CAMERA, numbers, "frame")).robot, ROBOT, atol=1e-9
        )


def test_lines_of_a_program_beside_numbered_files(tmp_path):
    poses = np.hstack([ROBOT[:, :3, 3], Rotation.from_matrix(ROBOT[:, :3, :3]).as_rotvec()]).tolist()
    lines = [f"  movel(p[{', '.join(map(repr, six))}])" for six in poses]
    (tmp_path / "robot.script").write_text("def p():\n" + "\n  sleep(1)\n".join(lines))
    camera = write(tmp_path / "camera", CAMERA, "cam_{k}.txt")
    np.testing.assert_allclose(read_poses(tmp_path / "robot.script", camera).robot, ROBOT, atol=1e-9)


def test_files_that_are_wrong(tmp_path, camera):
    folder = write(tmp_path / "robot", ROBOT)
    with pytest.raises(InputError, match=r"No file matches .*robot/\*\.csv\. Check the folder and the ending"):
        read_poses(folder / "*.csv", camera)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"No files in the folder .*empty"):
        read_poses(tmp_path / "empty", camera)
    (folder / "pose_5.txt").write_text(blocks(ROBOT[:2]))
    with pytest.raises(InputError, match=r"got 2 in .*pose_5\.txt"):
        read_poses(folder, camera)
    (folder / "pose_5.txt").write_text("timestamp,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n")
    with pytest.raises(InputError, match=r"pose_5\.txt \(csv\) is not like .*pose_0\.txt \(matrix\)"):
        read_poses(folder, camera)
    (folder / "pose_5.txt").write_text("")
    with pytest.raises(InputError, match=r"pose_5\.txt: the file is empty"):
        read_poses(folder, camera)


def test_json_of_one_pose(tmp_path, camera):
    (tmp_path / "robot").mkdir()
    for k, T in enumerate(ROBOT):
        (tmp_path / "robot" / f"{k}.json").write_text(json.dumps({"pose": T.tolist(), "id": k}))
    check(read_poses(tmp_path / "robot", camera))


@pytest.mark.slow
def test_the_command_line_expands_patterns(tmp_path, camera):
    write(tmp_path / "my robot [2]", ROBOT)
    arguments = ["calibrate", str(tmp_path / "my robot [2]" / "*.txt"), str(camera), "--json"]
    outcome = CliRunner().invoke(app, arguments)
    assert outcome.exit_code in (0, 3), outcome.output
    assert '"X"' in outcome.output
