"""Two pose files become pairs only if their rows belong together."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from support import SEED

import uq_handeye as uq
from uq_handeye.errors import InputError, InputWarning
from uq_handeye.read import read_poses, read_stream, write_pose_file
from uq_handeye.read.poses import require_robot

needs_data = pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")


@pytest.fixture
def pair(tmp_path):
    def make(robot_times, camera_times):
        files = tmp_path / "robot.csv", tmp_path / "camera.csv"
        for file, times in zip(files, (robot_times, camera_times), strict=True):
            write_pose_file(file, np.tile(np.eye(4), (len(times), 1, 1)), times)
        return files

    return make


def message(files, **options):
    with pytest.raises(InputError) as caught:
        read_poses(*files, **options)
    text = str(caught.value)
    assert "\n" not in text
    assert "robot.csv" in text
    assert "camera.csv" in text
    return text


@pytest.mark.parametrize("start", [0.0, 1.0, 1487321563.68, 1487321563680000067.0])
def test_equal_timestamps(pair, start):
    times = start + np.arange(3) * max(1.0, np.spacing(start))
    poses = read_poses(*pair(times, times), setup="eye-to-hand")
    assert poses.setup == "eye-to-hand"
    assert poses.n == 3
    np.testing.assert_array_equal(poses.timestamps, times)


def test_printed_times_may_be_rounded(pair):
    times = 1487321563.714296341 + np.arange(3) / 30
    poses = read_poses(*pair(times, np.round(times, 6)))
    np.testing.assert_array_equal(poses.timestamps, times)


def test_counts_differ(pair):
    text = message(pair([0, 1, 2], [0, 1]))
    assert "robot.csv has 3 poses" in text
    assert "camera.csv has 2" in text


@pytest.mark.parametrize(
    ("camera", "parts"),
    [
        ([0.0, 1.6, 2.002], ["same moments", "0.6 s, in pose 1 (1.0 and 1.6)", "--pair time", "--pair async"]),
        ([0, 1, 3], ["1 s, in pose 2", "--pair rows"]),  # one numbering lost a row
        ([1, 2, 3], ["1 s, in pose 0"]),
    ],
)
def test_rows_are_not_synchronous(pair, camera, parts):
    text = message(pair([0, 1, 2], camera))
    for part in parts:
        assert part in text


@pytest.mark.parametrize("jitter", [0.0, 0.1])
def test_clocks_without_a_common_time(pair, jitter):
    uptime = 5129.9 + 0.7 * np.arange(5)
    unix = 1.7e9 + 0.7 * np.arange(5) + jitter * np.array([0, 1, -1, 1, 0])
    poses = read_poses(*pair(uptime, unix))
    assert any("the clocks differ by -1.69999e+09 s" in note for note in poses.sources[0].notes)
    assert "same moments" in message(pair(uptime, unix + np.array([0, 0, 0, 0.7, 0.7])))  # a row was lost


def test_swapped_files_are_asked_about(pair):
    robot, camera = pair([0, 1, 2], [0, 1, 2])
    with pytest.warns(InputWarning, match="are they swapped"):
        read_poses(camera, robot, setup="eye-to-hand")


def test_rows_belong_together_where_it_is_said(pair):
    files = pair([0, 1, 2], [1, 2, 4])
    assert "--pair rows" in message(files)
    with pytest.warns(InputWarning, match="paired by their order although .* 2 s, in pose 2"):
        np.testing.assert_array_equal(read_poses(*files, pair="rows").timestamps, [0, 1, 2])


def test_small_differences_are_said(pair):
    with pytest.warns(InputWarning, match=r"0.013 s, in pose 1 \(1.0 and 1.013\)"):
        assert read_poses(*pair([0, 1, 2], [0.0, 1.013, 2.002])).n == 3


def test_order_of_timestamps_is_said(pair):
    files = pair([0, 2, 1], [0, 2, 1])
    with pytest.warns(InputWarning) as caught:
        assert read_poses(*files).n == 3
    texts = [str(warning.message) for warning in caught]
    assert len(texts) == 2  # one for each file
    assert "robot.csv: the timestamps go back in 1 of 3 rows, first in line 4" in texts[0]
    assert "camera.csv" in texts[1]


def test_other_arguments(pair):
    files = pair([0], [0])
    with pytest.raises(InputError, match="`setup`"):
        read_poses(*files, setup="eye-on-stalk")
    with pytest.raises(InputError, match="`units`"):
        read_poses(*files, units="parsec")
    with pytest.raises(InputError, match="Expected the path"):
        read_poses(files[0], 3)


@needs_data
@pytest.mark.parametrize(
    ("name", "n"),
    [
        ("kuka_1", 30),
        ("synthetic_camera_2", 19),
        ("nguyen_pham", 500),
        ("ethz_robot_arm_sync", 1687),
        ("wu_2019_as_published", 224),
    ],
)
def test_real_files(name, n):
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / name
    assert read_poses(folder / "robot.csv", folder / "camera.csv").n == n


@needs_data
def test_real_asynchronous_files():
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / "ethz_robot_arm_async"
    text = message((folder / "robot.csv", folder / "camera.csv"))
    assert "2817" in text
    assert "1703" in text


def test_a_stream_says_that_it_does_not_carry_the_setup(tmp_path, caplog):
    T = np.broadcast_to(np.eye(4), (3, 4, 4)).tolist()
    text = json.dumps({"setup": "eye-to-hand", "timestamps": [0, 1, 2], "robot": T, "camera": T})
    (tmp_path / "both.json").write_text(text)
    with caplog.at_level("INFO", logger="uq_handeye"):
        stream = read_stream(tmp_path / "both.json", "robot")
    assert any("eye-to-hand" in note and "--setup" in note for note in stream.source.notes)
    assert "it says eye-to-hand" in caplog.text


@pytest.mark.parametrize("timed", [True, False])
def test_the_row_without_a_partner_is_named(tmp_path, timed):
    poses = uq.simulate(14, seed=SEED)
    times = 2.0 * np.arange(14) + 0.3 if timed else np.arange(14.0)
    kept = np.delete(np.arange(14), 9)
    for name, T, t in (("robot", poses.robot[kept], times[kept] + 0.002), ("camera", poses.camera, times)):
        write_pose_file(tmp_path / f"{name}.csv", T, t if timed else np.arange(len(T)))
    with pytest.raises(uq.InputError, match=r"Of the camera, row 9 \(line 11.*\) has no partner"):
        uq.read_poses(tmp_path / "robot.csv", tmp_path / "camera.csv")


def test_robot_poses_are_tested_before_pictures_are_searched(tmp_path):
    poses = uq.simulate(6, seed=SEED)
    write_pose_file(tmp_path / "robot.csv", poses.robot)
    write_pose_file(tmp_path / "still.csv", np.repeat(poses.robot[:1], 6, axis=0))
    require_robot(tmp_path / "robot.csv", 6, {})
    with pytest.raises(InputError, match="has 6 poses, and there are 7 pictures"):
        require_robot(tmp_path / "robot.csv", 7, {})
    with pytest.raises(InputError, match="all 6 poses are the same"):
        require_robot(tmp_path / "still.csv", 6, {})
    with pytest.raises(InputError, match="units"):
        require_robot(tmp_path / "robot.csv", 6, {"units": ("m", "mm", "m")})
