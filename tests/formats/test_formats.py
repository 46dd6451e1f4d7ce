"""Every format in: the sample of its tool, what its own library writes, and what is found out by itself."""

import hashlib
import json
import logging
import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from support import SEED, exact_poses

from uq_handeye.errors import InputError, InputWarning
from uq_handeye.formats.controllers.forms import CONTROLLERS
from uq_handeye.read import FORMATS, read_poses, read_stream, write_pose_file

cv2 = pytest.importorskip("cv2")
SAMPLES = Path(__file__).parent / "samples"
TIMES = 1700000000.25 + 0.5 * np.arange(6)


@pytest.fixture(scope="module")
def truth():
    return read_poses(SAMPLES / "robot.csv", SAMPLES / "camera.csv")


def assert_same(poses, other, atol=1e-14):
    np.testing.assert_allclose(poses.robot, other.robot, rtol=0, atol=atol)
    np.testing.assert_allclose(poses.camera, other.camera, rtol=0, atol=atol)


# ------------------------------------------------------------------------------------------------ samples of the tools


@pytest.mark.slow
@pytest.mark.parametrize(
    ("files", "format", "times", "atol"),
    [
        (["robot.csv", "camera.csv"], "csv", True, 0),
        (["robot.tum", "camera.tum"], "tum", True, 1e-8),
        (["poses.npz"], "npz", True, 1e-14),
        (["robot.npy", "camera.npy"], "npy", False, 1e-14),
        (["easy_handeye.yaml"], "easy_handeye", False, 1e-14),
        (["easy_handeye2.samples"], "easy_handeye2", False, 1e-14),
        (["moveit.yaml"], "moveit", False, 1e-14),
        (["opencv.yml"], "opencv", False, 1e-14),
        (["opencv.xml"], "opencv", False, 1e-14),
        (["opencv.json"], "opencv", False, 1e-14),
        (["poses.json"], "json", True, 1e-14),
        (["robot.tf_echo.txt", "camera.tf_echo.txt"], "tf-echo", True, 1e-14),
        (["robot.topic.txt", "camera.topic.txt"], "ros-topic", True, 1e-14),
        (["poses.mat"], "mat", True, 1e-14),
        (["robot.matrix.txt", "camera.npy"], ("matrix", "npy"), False, 1e-14),
        (["robot.kitti.txt", "camera.npy"], ("matrix", "npy"), False, 1e-11),
        (["robot.franka.csv", "camera.npy"], ("franka", "npy"), True, 1e-14),
    ],
)
def test_samples(truth, files, format, times, atol):
    paths = [SAMPLES / name for name in files]
    poses = read_poses(*paths, setup="eye-in-hand")
    assert_same(poses, truth, atol)
    assert poses.setup == "eye-in-hand"
    if times:
        np.testing.assert_array_equal(poses.timestamps, TIMES)
    else:
        assert poses.timestamps is None
    assert [source.format for source in poses.sources] == (
        [format] * len(files) if isinstance(format, str) else [*format]
    )
    for source, path in zip(poses.sources, paths, strict=True):
        assert source.name == path.name
        assert source.size == path.stat().st_size
        assert source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert_same(read_poses(*paths, setup="eye-in-hand", format=format), truth, atol)


@pytest.mark.parametrize("name", [*CONTROLLERS, "table"])
def test_samples_of_controllers(truth, name):
    (path,) = SAMPLES.glob(f"robot.{name}.*")
    poses = read_poses(path, SAMPLES / "camera.csv", format=(None if name == "table" else name, None))
    np.testing.assert_allclose(poses.robot, truth.robot, rtol=0, atol=2e-9)


@pytest.mark.parametrize("name", ["easy_handeye_eob.yaml", "easy_handeye2_eob.samples"])
def test_easy_handeye_on_base_holds_inverse_robot_poses(name):
    truth = read_poses(SAMPLES / "robot_eob.csv", SAMPLES / "camera_eob.csv", setup="eye-to-hand")
    poses = read_poses(SAMPLES / name, setup="eye-to-hand")
    assert_same(poses, truth)
    assert any("gripper_T_base" in note for note in poses.sources[0].notes)


@pytest.mark.parametrize("name", ["easy_handeye.yaml", "easy_handeye2.samples"])
def test_easy_handeye_that_does_not_say_the_setup(name):
    with pytest.warns(InputWarning, match=r"taken as eye-in-hand.*--setup eye-to-hand"):
        assert read_poses(SAMPLES / name).setup == "eye-in-hand"


@pytest.mark.slow
def test_every_format_has_a_sample():
    found = set()
    for path in SAMPLES.iterdir():
        if path.suffix != ".md":
            found |= {read_stream_format(path)}
    assert found == set(FORMATS)


def read_stream_format(path):
    from uq_handeye.formats.detect import read_contents

    name = path.name.split(".")[1]  # the columns of some makers bear the names of others
    return read_contents(path, name if name in CONTROLLERS else None)[1].format


# -------------------------------------------------------------------------------------- what the tools' libraries write


@pytest.fixture(scope="module")
def rig():
    _, robot, camera = exact_poses(np.random.default_rng(SEED), 5)
    return robot, camera


def message(T):
    q = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
    return {
        "translation": dict(zip("xyz", T[:3, 3].tolist(), strict=True)),
        "rotation": dict(zip("xyzw", q, strict=True)),
    }


def check(poses, rig, atol=1e-12):
    np.testing.assert_allclose(poses.robot, rig[0], rtol=0, atol=atol)
    np.testing.assert_allclose(poses.camera, rig[1], rtol=0, atol=atol)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("parameters", "setup", "note"),
    [
        ({"calibration_type": "eye_in_hand", "robot_base_frame": "panda_link0"}, "eye-in-hand", "panda_link0"),
        ({"calibration_type": "eye_on_base"}, "eye-to-hand", "calibration_type: eye_on_base"),
        ({"eye_on_hand": True}, "eye-in-hand", "eye_on_hand: True"),
        ({"eye_on_hand": False}, "eye-to-hand", "eye_on_hand: False"),
    ],
)
def test_parameters_of_easy_handeye(tmp_path, rig, parameters, setup, note, caplog):
    robot, camera = rig
    enters = robot if setup == "eye-in-hand" else np.linalg.inv(robot)
    forms = {
        "two.yaml": {
            "parameters": parameters,
            "samples": [{"robot": message(G), "tracking": message(C)} for G, C in zip(enters, camera, strict=True)],
        },
        "one.yaml": {
            "parameters": parameters,
            "hand_world_samples": {"transforms": [message(G) for G in enters]},
            "camera_marker_samples": {"transforms": [{"transform": message(C)} for C in camera]},
        },
    }
    for name, tree in forms.items():
        (tmp_path / name).write_text(yaml.safe_dump(tree) + "---\n")
        with caplog.at_level(logging.INFO, "uq_handeye"):
            poses = read_poses(tmp_path / name)
        check(poses, rig)
        assert poses.setup == setup
        assert any(note in text for text in poses.sources[0].notes)
        assert note in caplog.text
        assert "read as easy_handeye" in caplog.text
        other = "eye-to-hand" if setup == "eye-in-hand" else "eye-in-hand"
        with pytest.raises(InputError, match=rf"{name} says {setup}, and `setup` \(--setup\) says {other}"):
            read_poses(tmp_path / name, setup=other)


def sequence(storage, name, matrices):
    storage.startWriteStruct(name, cv2.FileNode_SEQ)
    for matrix in matrices:
        storage.write("", np.ascontiguousarray(matrix))
    storage.endWriteStruct()


def write_forms(storage, T, names, form):
    R, t = T[:, :3, :3], T[:, :3, 3]
    if form == "sequences":
        sequence(storage, names[0], R)
        sequence(storage, names[1], t[:, :, None])
    elif form == "rows":
        sequence(storage, names[0], R)
        sequence(storage, names[1], t[:, None, :])
    elif form == "vectors":
        sequence(storage, names[0], Rotation.from_matrix(R).as_rotvec()[:, :, None])
        storage.write(names[1], np.ascontiguousarray(t))
    elif form == "stacked":
        storage.write(names[0], np.ascontiguousarray(R.reshape(-1, 3)))
        storage.write(names[1], np.ascontiguousarray(t.reshape(-1, 1)))
    elif form == "flattened":
        storage.write(names[0], np.ascontiguousarray(R.reshape(-1, 9)))
        storage.write(names[1], np.ascontiguousarray(t))
    elif form == "4x4":
        sequence(storage, names[2], T)
    elif form == "4n x 4":
        storage.write(names[2], np.ascontiguousarray(T.reshape(-1, 4)))
    else:
        storage.write(names[2], np.ascontiguousarray(T))


OPENCV_FORMS = ["sequences", "rows", "vectors", "stacked", "flattened", "4x4", "4n x 4", "n x 4 x 4"]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
@pytest.mark.parametrize("form", OPENCV_FORMS)
def test_opencv(tmp_path, rig, form, suffix):
    path = tmp_path / f"poses.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("note", 'text with a "quote"')
    storage.write("count", 5)
    write_forms(storage, rig[0], ("R_gripper2base", "t_gripper2base", "T_gripper2base"), form)
    write_forms(storage, rig[1], ("R_target2cam", "t_target2cam", "T_target2cam"), form)
    storage.release()
    check(read_poses(path), rig)


def test_opencv_names_that_say_the_inverse(tmp_path, rig):
    path = tmp_path / "poses.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    write_forms(storage, np.linalg.inv(rig[0]), ("R_base2gripper", "t_base2gripper"), "sequences")
    write_forms(storage, rig[1], ("R_target2cam", "T_target2cam"), "sequences")  # T: a translation beside R
    storage.release()
    poses = read_poses(path)
    check(poses, rig)
    assert "robot poses from R_base2gripper" in poses.sources[0].notes
    check(read_poses(path, robot_frame="gripper_T_base"), rig)  # which it is


def test_npz_names(tmp_path, rig):
    robot, camera = rig
    times = np.arange(5) * 0.1
    np.savez_compressed(tmp_path / "a.npz", base_T_gripper=robot, target_T_camera=np.linalg.inv(camera), times=times)
    poses = read_poses(tmp_path / "a.npz")
    check(poses, rig)
    np.testing.assert_array_equal(poses.timestamps, times)
    np.savez(tmp_path / "b.npz", robot=robot.astype(np.float32), robot_timestamps=times)
    np.savez(tmp_path / "c.npz", anything=camera, t=times, setup="eye-to-hand")
    poses = read_poses(tmp_path / "b.npz", tmp_path / "c.npz")
    check(poses, rig, 1e-6)
    assert poses.setup == "eye-to-hand"
    assert "eye-to-hand, as the file says" in poses.sources[1].notes
    assert "poses from 'anything'" in poses.sources[1].notes


def test_json_forms(tmp_path, rig):
    def poses_of(T, key):
        shift = 0 if key == "quaternion_xyzw" else 1
        q = np.roll(Rotation.from_matrix(T[:, :3, :3]).as_quat(), shift, axis=1)
        return [{"timestamp": 0.5 * k, "translation": T[k, :3, 3].tolist(), key: q[k].tolist()} for k in range(len(T))]

    robot, camera = rig
    (tmp_path / "r.json").write_text(json.dumps(poses_of(robot, "quaternion_wxyz")))
    (tmp_path / "c.json").write_text(json.dumps([T.ravel().tolist() for T in camera]))
    poses = read_poses(tmp_path / "r.json", tmp_path / "c.json")
    check(poses, rig)
    np.testing.assert_array_equal(poses.timestamps, 0.5 * np.arange(5))
    both = {"robot": poses_of(robot, "quaternion_xyzw"), "target_T_camera": np.linalg.inv(camera).tolist()}
    (tmp_path / "both.json").write_text(json.dumps(both))
    check(read_poses(tmp_path / "both.json"), rig)
    check(read_poses(tmp_path / "both.json", tmp_path / "both.json"), rig)


# ----------------------------------------------------------------------------------------- orders, frames, units


def test_quaternion_order(tmp_path, rig):
    for name, T in zip(("robot", "camera"), rig, strict=True):
        write_pose_file(tmp_path / f"{name}.csv", T)
        rows = (tmp_path / f"{name}.csv").read_text().splitlines()[1:]
        rows = [row.split(",") for row in rows]
        wrong = [",".join(row[:4] + row[7:] + row[4:7]) for row in rows]
        (tmp_path / f"{name}_wrong.csv").write_text("\n".join(["timestamp,x,y,z,qx,qy,qz,qw", *wrong]))
        (tmp_path / f"{name}_named.csv").write_text("\n".join(["time,tx,ty,tz,QW,QX,QY,QZ", *wrong]))
        (tmp_path / f"{name}.tum").write_text("\n".join(row.replace(",", "  ") for row in wrong))
    files = tmp_path / "robot_wrong.csv", tmp_path / "camera_wrong.csv"
    check(read_poses(*files, quaternion="wxyz"), rig)
    check(read_poses(files[0], tmp_path / "camera.csv", quaternion=("wxyz", None)), rig)
    check(read_poses(tmp_path / "robot.tum", tmp_path / "camera.tum", quaternion="wxyz"), rig)
    named = tmp_path / "robot_named.csv", tmp_path / "camera_named.csv"
    poses = read_poses(*named)
    check(poses, rig)
    check(read_poses(*named, quaternion="wxyz"), rig)
    notes = " | ".join(poses.sources[0].notes)
    assert "columns time, tx, ty, tz, QW, QX, QY, QZ read as timestamp, x, y, z, qw, qx, qy, qz" in notes
    assert "scalar first, as the columns are named" in notes
    with pytest.raises(InputError, match=r"`quaternion` \(--quaternion\) to be xyzw or wxyz, got 'zyxw'"):
        read_poses(*files, quaternion="zyxw")


def test_tum_with_a_line_of_names(tmp_path, rig):
    for name, T in zip(("robot", "camera"), rig, strict=True):
        write_pose_file(tmp_path / f"{name}.csv", T)
        rows = [row.split(",") for row in (tmp_path / f"{name}.csv").read_text().splitlines()[1:]]
        wrong = [" ".join(row[:4] + row[7:] + row[4:7]) for row in rows]
        (tmp_path / f"{name}.txt").write_text("\n".join(["timestamp tx ty tz qw qx qy qz", *wrong]))
    poses = read_poses(tmp_path / "robot.txt", tmp_path / "camera.txt")
    check(poses, rig)
    assert poses.sources[0].format == "tum"
    assert any("scalar first" in note for note in poses.sources[0].notes)


def test_tum_with_names_in_a_comment(tmp_path, rig):
    q = [Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True) for T in rig[0]]
    rows = [[k, *T[:3, 3], *one] for k, (T, one) in enumerate(zip(rig[0], q, strict=True))]
    path = tmp_path / "robot.txt"
    path.write_text(
        "# timestamp tx ty tz qw qx qy qz\n" + "\n".join(" ".join(map(repr, map(float, row))) for row in rows)
    )
    np.testing.assert_allclose(read_stream(path, "robot").poses, rig[0], atol=1e-12)


@pytest.mark.parametrize("column", [False, True])
def test_npz_with_the_names_of_opencv(tmp_path, rig, column):
    T, C = rig[0], rig[1]
    shape = (-1, 3, 1) if column else (-1, 3)
    rvecs = Rotation.from_matrix(C[:, :3, :3]).as_rotvec().reshape(shape)
    robot = {"R_gripper2base": T[:, :3, :3], "t_gripper2base": T[:, :3, 3].reshape(shape)}
    np.savez(tmp_path / "both.npz", **robot, rvecs=rvecs, tvecs=C[:, :3, 3].reshape(shape))
    check(read_poses(tmp_path / "both.npz"), rig, 1e-12)
    np.savez(tmp_path / "robot.npz", R=T[:, :3, :3], t=T[:, :3, 3].reshape(shape))
    np.savez(tmp_path / "camera.npz", rvecs=rvecs, tvecs=C[:, :3, 3].reshape(shape))
    check(read_poses(tmp_path / "robot.npz", tmp_path / "camera.npz"), rig, 1e-12)


def test_arrays_without_the_last_row_or_flat(tmp_path, rig):
    np.save(tmp_path / "robot.npy", rig[0][:, :3])
    np.save(tmp_path / "camera.npy", rig[1].reshape(-1, 16))
    check(read_poses(tmp_path / "robot.npy", tmp_path / "camera.npy"), rig)


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_opencv_with_names_of_either_side(tmp_path, rig, suffix):
    for name, poses in (("robot", rig[0]), ("camera", rig[1])):
        storage = cv2.FileStorage(str(tmp_path / f"{name}.{suffix}"), cv2.FILE_STORAGE_WRITE)
        storage.write("rvecs", Rotation.from_matrix(poses[:, :3, :3]).as_rotvec())
        storage.write("tvecs", np.ascontiguousarray(poses[:, :3, 3]))
        storage.release()
        storage = cv2.FileStorage(str(tmp_path / f"{name}_T.{suffix}"), cv2.FILE_STORAGE_WRITE)
        storage.startWriteStruct("poses", cv2.FileNode_SEQ)
        for T in poses:
            storage.write("", T)
        storage.endWriteStruct()
        storage.release()
    for tail in ("", "_T"):
        poses = read_poses(tmp_path / f"robot{tail}.{suffix}", tmp_path / f"camera{tail}.{suffix}")
        check(poses, rig, 1e-12)


def renamed(transform):
    return {"position": transform["translation"], "orientation": transform["rotation"]}


def test_json_of_other_programs(tmp_path, rig):
    pairs = list(zip(rig[0], rig[1], strict=True))
    forms = {
        "poses": ({"poses": T.tolist()} for T in (rig[0], rig[1])),
        "message": ([message(T) for T in side] for side in (rig[0], rig[1])),
        "pose": ([{"header": {}, "pose": renamed(message(T))} for T in side] for side in (rig[0], rig[1])),
        "rigid": (
            [{"translation": T[:3, 3].tolist(), "rotation": T[:3, :3].tolist()} for T in side]
            for side in (rig[0], rig[1])
        ),
        "samples": [{"samples": [{"robot_pose": A.tolist(), "camera_pose": C.tolist()} for A, C in pairs]}],
        "pairs": [[{"robot": message(A), "camera": message(C)} for A, C in pairs]],
    }
    for form, trees in forms.items():
        paths = []
        for k, tree in enumerate(trees):
            paths.append(tmp_path / f"{form}{k}.json")
            paths[-1].write_text(json.dumps(tree))
        check(read_poses(*paths), rig, 1e-12)


def test_samples_within_the_server_of_easy_handeye(tmp_path, rig):
    samples = [
        {"robot": {"transform": message(A)}, "optical": {"transform": message(C)}}
        for A, C in zip(rig[0], rig[1], strict=True)
    ]
    (tmp_path / "samples.yaml").write_text(yaml.safe_dump(samples))
    check(read_poses(tmp_path / "samples.yaml", setup="eye-in-hand"), rig, 1e-12)


def test_frames_and_units(tmp_path, rig):
    robot, camera = (np.linalg.inv(T) for T in rig)
    camera[:, :3, 3] *= 1000
    np.save(tmp_path / "r.npy", robot)
    np.save(tmp_path / "c.npy", camera)
    files = tmp_path / "r.npy", tmp_path / "c.npy"
    options = {"robot_frame": "gripper_T_base", "camera_frame": "target_T_camera", "units": ("m", "mm")}
    check(read_poses(*files, **options), rig)
    with pytest.raises(InputError, match=r"`robot_frame` \(--robot-frame\) to be base_T_gripper or gripper_T_base"):
        read_poses(*files, robot_frame="target_T_camera")
    with pytest.raises(InputError, match="`units`"):
        read_poses(*files, units=("m", "parsec"))
    with pytest.raises(InputError, match=r"`units` to be one value or a pair \(robot, camera\), got 3"):
        read_poses(*files, units=("m", "mm", "m"))
    with pytest.raises(InputError, match=r"r\.npy holds rotation matrices.*--quaternion robot="):
        read_poses(*files, quaternion="xyzw")


def test_no_timestamps_in_csv(tmp_path, rig):
    for name, T in zip(("robot", "camera"), rig, strict=True):
        write_pose_file(tmp_path / f"{name}.csv", T)
        rows = (tmp_path / f"{name}.csv").read_text().splitlines()
        (tmp_path / f"{name}.csv").write_text("\n".join(row.partition(",")[2] for row in rows))
    poses = read_poses(tmp_path / "robot.csv", tmp_path / "camera.csv")
    check(poses, rig)
    assert poses.timestamps is None
    assert any("no timestamp column" in note for note in poses.sources[0].notes)


def test_detected_by_content_and_said(tmp_path, caplog):
    (tmp_path / "robot.txt").write_bytes((SAMPLES / "robot.tum").read_bytes())
    (tmp_path / "camera.dat").write_bytes((SAMPLES / "camera.csv").read_bytes())
    with caplog.at_level(logging.INFO, "uq_handeye"):
        poses = read_poses(tmp_path / "robot.txt", tmp_path / "camera.dat")
    assert [source.notes for source in poses.sources] == [
        ("read as tum, by its content",),
        ("read as csv, by its content",),
    ]
    assert "robot.txt: read as tum, by its content" in caplog.text
    assert all(record.levelno == logging.INFO for record in caplog.records)
    # what the suffix says already is not said again
    assert read_poses(SAMPLES / "robot.csv", SAMPLES / "camera.csv").sources[0].notes == ()


def test_streams(truth):
    for name, kwargs in (("robot.csv", {}), ("robot.tum", {"frame": "base_T_gripper"}), ("poses.npz", {})):
        stream = read_stream(SAMPLES / name, "robot", **kwargs)
        np.testing.assert_allclose(stream.poses, truth.robot, atol=1e-8)
        np.testing.assert_array_equal(stream.timestamps, TIMES)
        assert stream.source.name == name
    inverse = read_stream(SAMPLES / "camera.csv", "camera", frame="target_T_camera").poses
    np.testing.assert_allclose(inverse, np.linalg.inv(truth.camera), atol=1e-12)
    with pytest.raises(InputError, match=r"moveit\.yaml has no timestamps \(moveit\).*--pair rows"):
        read_stream(SAMPLES / "moveit.yaml", "robot")
    with pytest.raises(InputError, match="`side` to be robot or camera, got 'gripper'"):
        read_stream(SAMPLES / "robot.csv", "gripper")
    with pytest.raises(InputError, match=r"`camera_frame` \(--camera-frame\)"):
        read_stream(SAMPLES / "camera.csv", "camera", frame="base_T_gripper")


def test_one_side_only(tmp_path, rig):
    with pytest.raises(InputError, match=r"robot\.csv holds poses of one side only \(csv\); give the file"):
        read_poses(SAMPLES / "robot.csv")
    np.savez(tmp_path / "r.npz", robot=rig[0])
    with pytest.raises(InputError, match=r"r\.npz holds robot poses only.*swapped"):
        read_poses(SAMPLES / "robot.csv", tmp_path / "r.npz")


def test_arguments():
    files = SAMPLES / "robot.csv", SAMPLES / "camera.csv"
    for name, options in (
        (r"`format` \(--format\) to be one of csv, tum", {"format": "xlsx"}),
        (r"`pair` \(--pair\) to be rows or time, got 'async'.*synchronise", {"pair": "async"}),
        (r"`setup` \(--setup\) to be one of eye-in-hand", {"setup": "eye"}),
        (r"`tolerance` \(--time-tolerance\)", {"pair": "time", "tolerance": -1}),
        (r"`tolerance` \(--time-tolerance\)", {"pair": "time", "tolerance": "2"}),
    ):
        with pytest.raises(InputError, match=name):
            read_poses(*files, **options)


def test_nothing_is_warned_of(truth):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in ("moveit.yaml", "opencv.yml", "poses.npz", "poses.json"):
            assert_same(read_poses(SAMPLES / name), truth)
