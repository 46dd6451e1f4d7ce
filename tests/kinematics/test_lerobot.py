"""Joints as LeRobot writes them: shares of the calibrated ranges, degrees, data sets; against LeRobot's own numbers."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation
from support import CONFIDENCE, SEED, difference

import uq_handeye as uq
from uq_handeye.errors import InputError
from uq_handeye.model.kinematics.by_poses import joints_by_poses
from uq_handeye.model.kinematics.chain import Kinematics
from uq_handeye.model.kinematics.joints_file import read_joints
from uq_handeye.read import read_poses, write_pose_file

STORED = json.loads(Path(__file__).with_name("poses_of_lerobot.json").read_text(encoding="utf-8"))
SHARES, DEGREES, POSES = (np.array(STORED[name]) for name in ("shares", "degrees", "poses"))
MOTORS = [f"{name}.pos" for name in STORED["calibration"]]
ARM = Kinematics.from_name("SO-101")
Q = np.radians(DEGREES[:, :5])


@pytest.fixture
def written(tmp_path):
    """Write rows of all motors and the calibration; return their paths."""

    def write(rows, names=MOTORS, calibration=STORED["calibration"]):
        np.savetxt(tmp_path / "joints.csv", rows, delimiter=",", header=",".join(names), comments="", fmt="%.5f")
        (tmp_path / "so101.json").write_text(json.dumps(calibration))
        return tmp_path / "joints.csv", str(tmp_path / "so101.json")

    return write


@pytest.mark.parametrize("prefix", ["", "main_", "left_"])
def test_shares_by_the_calibration_are_the_degrees_that_lerobot_writes(written, prefix):
    path, calibration = written(SHARES, [prefix + name for name in MOTORS])
    found = read_joints(path, ARM, calibration)
    np.testing.assert_allclose(found.q, Q, atol=2e-6)
    assert "joints from -100 to 100 of the ranges of the motors" in found.notes
    np.testing.assert_allclose(read_joints(written(DEGREES)[0], ARM, "deg").q, Q, atol=1e-6)
    by_number, _ = written(SHARES, [f"q_{k}" for k in range(6)])
    with pytest.warns(uq.InputWarning, match="6 columns, and the arm has 5 joints"):
        np.testing.assert_allclose(read_joints(by_number, ARM, calibration).q, Q, atol=2e-6)


def test_shares_of_one_motor():
    """``FeetechMotorsBus._normalize`` of LeRobot 0.4.4 at tick 2600 of 800 to 3300: 44, and 48.35165 deg."""
    from uq_handeye.model.kinematics.lerobot import MotorRange

    assert np.degrees(MotorRange(1, 800, 3300, False).angle(np.array(44.0))) == pytest.approx(48.35164835)
    assert np.degrees(MotorRange(1, 800, 3300, True).angle(np.array(-44.0))) == pytest.approx(48.35164835)


def test_poses_are_those_of_its_kinematics():
    """Whole ticks are 0.088 deg; more is another arm or another zero."""
    apart = ARM.poses(Q)[:, :3] - POSES
    assert np.abs(apart[..., 3]).max() < 5e-4 and np.abs(apart[..., :3]).max() < np.radians(0.15)


def broken(**changes):
    calibration = {name: dict(of) for name, of in STORED["calibration"].items()}
    for name, value in changes.items():
        calibration["elbow_flex"][name] = value
    return calibration


@pytest.mark.parametrize(
    ("rows", "calibration", "words"),
    [
        (DEGREES * 2, None, "got 1.* Are the values degrees"),
        (SHARES, {"calib_mode": ["DEGREE"]}, "before 0.3, whose joint values are degrees"),
        (SHARES, [1, 2], "expected a calibration of LeRobot"),
        (SHARES, broken(range_max="3000"), "motor 'elbow_flex': expected whole numbers"),
        (SHARES, broken(range_max=100), "range_min < range_max"),
        (SHARES, {"gripper": STORED["calibration"]["gripper"]}, "no motor of the column"),
    ],
)
def test_what_is_refused(written, rows, calibration, words):
    path, ranges = written(rows, calibration=STORED["calibration"] if calibration is None else calibration)
    with pytest.raises(InputError, match=words) as error:
        read_joints(path, ARM, ranges)
    assert "\n" not in str(error.value)
    with pytest.raises(InputError, match="without another unit"):
        read_joints(path, ARM, f"{written(SHARES)[1]},deg")
    with pytest.raises(InputError, match="no such file"):
        read_joints(path, ARM, "none.json")


def test_values_without_a_unit_are_no_radians(written):
    path, _ = written(SHARES)
    with pytest.raises(InputError, match=r"or its shares from -100 to 100\? Give --joint-units deg, or"):
        read_joints(path, ARM)


X, W = np.eye(4), np.eye(4)
X[:3, :3], X[:3, 3] = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix(), [0.0, 0.05, -0.06]
W[:3, :3], W[:3, 3] = Rotation.from_rotvec([0.1, 2.8, 0.3]).as_matrix(), [0.3, 0.0, 0.0]


def camera(folder, noise=(2e-3, 3e-4)):
    rng = np.random.default_rng([SEED, 5])
    G = np.tile(np.eye(4), (len(POSES), 1, 1))
    G[:, :3] = POSES
    seen = np.linalg.inv(G @ X) @ W
    seen[:, :3, :3] @= Rotation.from_rotvec(noise[0] * rng.normal(size=(len(G), 3))).as_matrix()
    seen[:, :3, 3] += noise[1] * rng.normal(size=(len(G), 3))
    write_pose_file(folder / "camera.csv", seen, np.arange(20.0))
    return folder / "camera.csv"


def test_shares_taken_for_degrees_are_named(written, tmp_path):
    path, calibration = written(SHARES)
    poses = read_poses(None, camera(tmp_path), joints=path, kinematics=ARM, joint_units="deg")
    (finding,) = (one for one in poses.findings if one.code != "poses.units")
    assert finding.values["meant"] == "percent" and "--joint-units my_arm.json" in str(finding)
    assert finding.phrase == "the joints seem to be from -100 to 100 of their ranges"
    assert finding.remedy.startswith("give the calibration file of the arm (--joint-units my_arm.json)")
    poses = read_poses(None, camera(tmp_path), joints=path, kinematics=ARM, joint_units=calibration)
    assert all(one.code == "poses.units" for one in poses.findings)


def test_five_axes_do_not_follow_from_poses():
    G = np.tile(np.eye(4), (len(POSES), 1, 1))
    G[:, :3] = POSES
    with pytest.raises(InputError, match=r"has 5 axes, .* Give its joints"):
        joints_by_poses(ARM, G)


def test_the_calibration_of_a_rig_is_in_the_folder_of_its_file(written, tmp_path):
    written(np.column_stack([np.arange(20.0), SHARES]), ["timestamp", *MOTORS])
    camera(tmp_path)
    (tmp_path / "rig.toml").write_text(
        '[arms.arm]\njoints = "joints.csv"\nrobot_model = "so101"\njoint_units = "so101.json"\n'
        '[cameras.wrist]\non = "arm"\n[targets.board]\non = "world"\n'
        '[[views]]\ncamera = "wrist"\ntarget = "board"\nfile = "camera.csv"\n'
    )
    rig, _ = uq.read_rig(tmp_path / "rig.toml")
    np.testing.assert_allclose(rig.arms["arm"].joints, Q, atol=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("values", ["shares", "degrees"])
def test_x_of_a_rig_of_lerobot(written, tmp_path, values):
    path, calibration = written(SHARES if values == "shares" else DEGREES)
    units = calibration if values == "shares" else "deg"
    poses = read_poses(None, camera(tmp_path), joints=path, kinematics=ARM, joint_units=units)
    noise = uq.PoseNoise.isotropic(None, (2e-3, 3e-4))
    errors = uq.KinematicErrors("exact", joint_sd="0.026deg")  # of whole ticks
    result = uq.calibrate(poses, noise=noise, shared=[], kinematics=ARM, kinematic_errors=errors)
    off = difference(X, result.X)
    assert off @ np.linalg.solve(result.covariance, off) < stats.chi2.ppf(CONFIDENCE, 6)


@pytest.fixture
def data_set(tmp_path, monkeypatch):
    """A data set of LeRobot: its names in meta/info.json, rows in data/chunk-000/file-000.parquet."""

    def make(names=MOTORS, file=False, **columns):
        n = len(DEGREES)
        rows = {
            "action": [np.zeros(6, np.float32) for _ in range(n)],
            "observation.state": list(DEGREES.astype(np.float32)),
            "timestamp": np.arange(n, dtype=np.float32) / 30,
            "frame_index": np.arange(n),
            "episode_index": np.zeros(n, int),
            "index": np.arange(n),
            "task_index": np.zeros(n, int),
        }
        frame = pd.DataFrame(rows | columns)
        path = tmp_path / "data" / "chunk-000" / "file-000.parquet"
        path.parent.mkdir(parents=True)
        if names is not None:
            (tmp_path / "meta").mkdir()
            features = {name: {"dtype": "float32", "names": names} for name in ("action", "observation.state")}
            (tmp_path / "meta" / "info.json").write_text(json.dumps({"features": features}))
        if file:
            frame.to_parquet(path)
        else:
            path.write_bytes(b"PAR1 of another reader")
            monkeypatch.setattr(pd, "read_parquet", lambda file: frame)
        return path

    return make


@pytest.mark.parametrize("names", [MOTORS, {"motors": [f"main_{name[:-4]}" for name in MOTORS]}])
def test_a_data_set(data_set, names):
    found = read_joints(data_set(names), ARM, "deg")
    np.testing.assert_allclose(found.q, Q, atol=1e-6)
    np.testing.assert_allclose(found.timestamps, np.arange(len(Q)) / 30, atol=1e-7)


def test_a_data_set_without_names_and_with_several_episodes(data_set):
    with pytest.warns(uq.InputWarning, match=r"'observation.state\[0\]' to 'observation.state\[5\]' are 6 columns"):
        found = read_joints(data_set(None, episode_index=np.arange(len(Q)) // 10), ARM, "deg")
    np.testing.assert_allclose(found.q, Q, atol=1e-6)
    assert found.timestamps is None and "2 episodes, whose timestamps start at 0" in found.notes[0]


def test_plain_columns_and_what_is_no_data_set(data_set, tmp_path, monkeypatch):
    frame = pd.DataFrame({name: DEGREES[:, k] for k, name in enumerate(MOTORS)} | {"picture": ["a"] * len(Q)})
    path = data_set()
    monkeypatch.setattr(pd, "read_parquet", lambda file: frame)
    np.testing.assert_allclose(read_joints(path, ARM, "deg").q, Q, atol=1e-6)
    for table, words in ((frame[["picture"]], "got none"), (frame[:0], "no rows")):
        monkeypatch.setattr(pd, "read_parquet", lambda file, table=table: table)
        with pytest.raises(InputError, match=words):
            read_joints(path, ARM, "deg")

    def missing(file):
        raise ImportError("Unable to find a usable engine")

    monkeypatch.setattr(pd, "read_parquet", missing)
    with pytest.raises(uq.MissingExtraError, match=r"needs pyarrow: pip install '\.\[parquet\]'"):
        read_joints(path, ARM, "deg")


def test_a_data_set_that_pyarrow_writes(data_set, tmp_path):
    pytest.importorskip("pyarrow")
    np.testing.assert_allclose(read_joints(data_set(file=True), ARM, "deg").q, Q, atol=1e-6)
    (tmp_path / "cut.parquet").write_bytes(b"PAR1cut off")
    with pytest.raises(InputError, match="not a parquet file that can be read"):
        read_joints(tmp_path / "cut.parquet", ARM, "deg")
