"""Pairing by time: the nearest, one to one, what is left out is named; and refusals that say what to do."""

import logging

import numpy as np
import pytest
from support import SEED, random_transforms

from uq_handeye.errors import InputError
from uq_handeye.read import read_poses, write_pose_file

START = 1700000000.0


@pytest.fixture
def pair(tmp_path):
    def make(robot_times, camera_times):
        files = []
        for seed, (name, times) in enumerate((("robot", robot_times), ("camera", camera_times))):
            times = np.asarray(times, dtype=float)
            poses = random_transforms(np.random.default_rng(SEED + seed), (len(times),))
            poses[:, 0, 3] = times - times.min()  # tells the row
            files.append(tmp_path / f"{name}.csv")
            write_pose_file(files[-1], poses, times)
        return files

    return make


def rows(T):
    return T[:, 0, 3]


def message(files, **options):
    with pytest.raises(InputError) as caught:
        read_poses(*files, pair="time", **options)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_nearest_one_to_one_and_the_rest_is_named(pair, caplog):
    robot = START + np.array([0.0, 1.0, 2.0, 2.008, 3.0, 9.0])
    camera = START + np.array([3.01, 2.007, 0.995, 5.0, 0.004])  # in no order
    with caplog.at_level(logging.INFO, "uq_handeye"):
        poses = read_poses(*pair(robot, camera), pair="time")
    np.testing.assert_allclose(poses.timestamps - START, [0, 1, 2.008, 3], atol=1e-6)
    np.testing.assert_allclose(rows(poses.robot), [0, 1, 2.008, 3], atol=1e-6)
    np.testing.assert_allclose(rows(poses.camera), [0, 0.991, 2.003, 3.006], atol=1e-6)
    notes = poses.sources[0].notes
    assert notes[-3:] == (
        "4 pairs by time: |robot - camera| is 0.0045 s (median), 0.01 s (largest)",
        "2 of 6 robot poses left out, without a partner within 0.02 s: line 4, 7",
        "1 of 5 camera poses left out, without a partner within 0.02 s: line 5",
    )
    assert all(note in caplog.text for note in notes[-3:])


def test_the_tolerance_is_kept(pair):
    robot = np.arange(6.0)
    files = pair(robot, robot + np.array([0, 0.01, 0.019, 0.03, 0.04, 0.05]))
    assert read_poses(*files, pair="time").n == 3
    assert read_poses(*files, pair="time", tolerance=0.035).n == 4
    assert read_poses(*files, pair="time", tolerance=1).n == 6


@pytest.mark.parametrize("seed", range(5))
def test_against_all_pairs(pair, seed):
    rng = np.random.default_rng(SEED + seed)
    robot, camera = rng.uniform(0, 10, 40), rng.uniform(0, 10, 60)
    files = pair(robot, camera)
    poses = read_poses(*files, pair="time", tolerance=0.05)
    distance = np.abs(robot[:, None] - camera)
    expected = {
        (i, int(distance[i].argmin()))
        for i in range(40)
        if distance[:, distance[i].argmin()].argmin() == i and distance[i].min() <= 0.05
    }
    found = {
        (int(np.abs(robot - robot.min() - a).argmin()), int(np.abs(camera - camera.min() - b).argmin()))
        for a, b in zip(rows(poses.robot), rows(poses.camera), strict=True)
    }
    assert found == expected
    assert np.all(np.diff(poses.timestamps) > 0)


def test_no_common_time(pair):
    text = message(pair(np.arange(5.0), START + np.arange(5.0)))
    assert "leaves 0 of 5 robot and 5 camera poses, and at least 3 are needed" in text
    assert "nothing in common" in text
    assert "robot.csv (0 to 4 s)" in text
    assert "--pair async" in text
    assert "--pair rows" in text


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_other_units_of_time(pair, factor, unit):
    times = START + np.arange(5.0)
    text = message(pair(times, times * factor))
    assert f"camera.csv seems to count {unit}; timestamps are in seconds" in text
    assert "robot.csv seems to count" in message(pair(times * factor, times))


def test_beyond_the_tolerance(pair):
    text = message(pair(np.arange(5.0), np.arange(5.0) + 0.3))
    assert "the closest two are 0.3 s apart, and the tolerance is 0.02 s" in text
    assert "--time-tolerance" in text
    assert "--pair async" in text


def test_too_few(pair):
    assert "leaves 1 of 1 robot and 1 camera poses" in message(pair([0.0], [0.0]))
    text = message(pair([0.0, 1, 2, 3], [0.0, 1.0, 2.5]))
    assert "leaves 2 of 4" in text
    assert "no others are within 0.02 s" in text


def test_no_timestamps(tmp_path):
    for name in ("r", "c"):
        np.save(tmp_path / f"{name}.npy", np.tile(np.eye(4), (3, 1, 1)))
    text = message((tmp_path / "r.npy", tmp_path / "c.npy"))
    assert "r.npy has no timestamps" in text
    assert "--pair rows" in text


def test_different_numbers_of_rows_name_the_ways(pair):
    with pytest.raises(InputError, match=r"has 3 poses.*has 2.*--pair time.*--pair async"):
        read_poses(*pair([0, 1, 2], [0, 1]))
