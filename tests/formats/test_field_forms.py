"""Forms in which people keep both sides, or one, of a calibration: read by themselves, with a note that says how."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import SEED

import uq_handeye as uq
from uq_handeye.errors import InputError
from uq_handeye.formats.opencv_storage import matrix_lines
from uq_handeye.read import read_poses, write_pose_file

N = 14
POSES = uq.simulate(n_poses=N, seed=SEED)
X = POSES.truth.X


def numbers(T, form, length=1.0, rotation_first=False):
    """Rows (n, 6 or 7) of poses."""
    rotation = Rotation.from_matrix(T[:, :3, :3])
    if form == "rotvec":
        angles = rotation.as_rotvec()
    elif form == "xyzw":
        angles = rotation.as_quat()
    else:
        angles = rotation.as_euler(form, degrees=True)
    parts = [length * T[:, :3, 3], angles]
    return np.hstack(parts[::-1] if rotation_first else parts)


def lines(rows, mark=", "):
    return "".join(mark.join(map(repr, row)) + "\n" for row in np.asarray(rows).tolist())


def assert_right(poses, atol=1e-9):
    np.testing.assert_allclose(poses.robot, POSES.robot, rtol=0, atol=atol)
    np.testing.assert_allclose(poses.camera, POSES.camera, rtol=0, atol=atol)


def notes(poses):
    return " | ".join(note for source in poses.sources for note in source.notes)


# ---------------------------------------------------------------------------------------- rotation before translation


@pytest.mark.slow
@pytest.mark.parametrize(("form", "length"), [("rotvec", 1.0), ("rotvec", 1e3), ("xyz", 1e3), ("ZYX", 1.0)])
def test_rotation_before_translation(tmp_path, form, length):
    (tmp_path / "robot.txt").write_text(lines(numbers(POSES.robot, form, length, True)))
    write_pose_file(tmp_path / "camera.csv", POSES.camera)
    poses = read_poses(tmp_path / "robot.txt", tmp_path / "camera.csv")
    assert_right(poses)
    assert "rotation before translation), with which robot and camera agree" in notes(poses)


@pytest.mark.slow
@pytest.mark.parametrize("first", [False, True])
def test_a_given_form_leaves_the_order_open(tmp_path, first):
    for name, T in (("robot.txt", POSES.robot), ("camera.txt", POSES.camera)):
        (tmp_path / name).write_text(lines(numbers(T, "rotvec", 1.0, first)))
    assert_right(read_poses(tmp_path / "robot.txt", tmp_path / "camera.txt", rotation="rotvec-rad"))


def test_hundreds_are_never_radians(tmp_path):
    """Also where the form is asked for: the last three numbers are then the translation."""
    (tmp_path / "robot.txt").write_text(lines(numbers(POSES.robot, "rotvec", 1e3, True)))
    write_pose_file(tmp_path / "camera.csv", POSES.camera)
    options = {"rotation": ("rotvec-rad", None), "units": ("mm", None)}
    assert_right(read_poses(tmp_path / "robot.txt", tmp_path / "camera.csv", **options))


@pytest.mark.slow
@pytest.mark.parametrize("mark", ["\n", "\r\n", ",\n"])
def test_one_number_a_line_in_a_file_per_pose(tmp_path, mark):
    (tmp_path / "robot").mkdir()
    for k, row in enumerate(numbers(POSES.robot, "xyz", 1e3, True)):
        (tmp_path / "robot" / f"pos{k}.txt").write_text(mark.join(f"{value:.10f}" for value in row) + mark)
    write_pose_file(tmp_path / "camera.csv", POSES.camera)
    poses = read_poses(tmp_path / "robot", tmp_path / "camera.csv")
    assert_right(poses, atol=1e-8)


@pytest.mark.slow
def test_folders_with_a_file_of_each_side(tmp_path):
    for k in range(N):
        folder = tmp_path / "session" / f"pose_{k}"
        folder.mkdir(parents=True)
        np.savetxt(folder / "robot.txt", POSES.robot[k])
        np.savetxt(folder / "camera.txt", POSES.camera[k])
    with pytest.raises(InputError, match=r"'.*session/\*/robot.txt' '.*session/\*/camera.txt'"):
        read_poses(tmp_path / "session")
    patterns = tmp_path / "session" / "*" / "robot.txt", tmp_path / "session" / "*" / "camera.txt"
    assert_right(read_poses(*patterns))


# --------------------------------------------------------------------------------------------- both sides in one table


@pytest.mark.slow
@pytest.mark.parametrize("first", [False, True])
@pytest.mark.parametrize("counted", [False, True])
def test_both_poses_in_each_row(tmp_path, first, counted):
    rows = np.hstack([numbers(POSES.robot, "rotvec", 1.0, first), numbers(POSES.camera, "rotvec", 1.0, first)])
    rows = np.column_stack([np.arange(N), rows]) if counted else rows
    (tmp_path / "both.txt").write_text(lines(rows, " "))
    poses = read_poses(tmp_path / "both.txt")
    assert_right(poses)
    assert "two poses of 6 numbers in each row: the robot's first" in notes(poses)


def test_two_quaternions_in_each_row(tmp_path):
    rows = np.hstack([numbers(POSES.robot, "xyzw"), numbers(POSES.camera, "xyzw")])
    (tmp_path / "both.txt").write_text(lines(rows))
    assert_right(read_poses(tmp_path / "both.txt"))


@pytest.mark.slow
@pytest.mark.parametrize("words", [("hand", "eye"), ("Robot", "Camera"), ("gripper", "target")])
def test_rows_that_name_their_side(tmp_path, words):
    sides = [numbers(T, "xyz") for T in (POSES.robot, POSES.camera)]
    rows = zip(*(lines(one).splitlines(True) for one in sides), strict=True)
    text = "".join(f"{word},{line}" for pair in rows for word, line in zip(words, pair, strict=True))
    (tmp_path / "both.csv").write_text(text)
    poses = read_poses(tmp_path / "both.csv")
    assert_right(poses)
    assert f"robot poses from the rows {words[0].lower()}" in notes(poses)
    (tmp_path / "both.csv").write_text(text.replace(words[1], "other"))
    with pytest.raises(InputError):
        read_poses(tmp_path / "both.csv")


# -------------------------------------------------------------------------------------------------- tables with quotes


def quoted(style):
    """A table of odometry as rosbag_to_csv or pandas writes it: covariances in quotes, with commas between."""
    T = POSES.robot
    times = 1_700_000_000.25 + 2.0 * np.arange(N)
    values = np.hstack([T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat()])
    names = [f"pose.pose.position.{a}" for a in "xyz"] + [f"pose.pose.orientation.{a}" for a in "xyzw"]
    cells = "(" + ", ".join(["0.0"] * 36) + ")" if style == "rosbag_to_csv" else str([0.0] * 36)
    if style == "rosbag_to_csv":
        header = ["time", ".header.seq", ".header.frame_id", *(f".{name}" for name in names), ".pose.covariance"]
        rows = [[f"{t * 1e9:.0f}", str(k), "/odom", *map(repr, row), f'"{cells}"']
                for k, (t, row) in enumerate(zip(times, values.tolist(), strict=True))]  # fmt: skip
        return ", ".join(header) + "\n" + "".join(", ".join(row) + "\n" for row in rows)
    header = ["timestamp", *names, "pose.covariance"]
    rows = [[repr(t), *map(repr, row), f'"{cells}"'] for t, row in zip(times.tolist(), values.tolist(), strict=True)]
    return ",".join(header) + "\n" + "".join(",".join(row) + "\n" for row in rows)


@pytest.mark.parametrize("style", ["rosbag_to_csv", "pandas"])
def test_quoted_fields(tmp_path, style):
    (tmp_path / "odometry.csv").write_text(quoted(style))
    write_pose_file(tmp_path / "camera.csv", POSES.camera, 1_700_000_000.25 + 2.0 * np.arange(N))
    poses = read_poses(tmp_path / "odometry.csv", tmp_path / "camera.csv", pair="time")
    assert_right(poses)
    assert poses.timestamps[0] == pytest.approx(1_700_000_000.25, abs=1e-6)
    assert ("timestamps in ns, as their size shows" in notes(poses)) == (style == "rosbag_to_csv")
    (tmp_path / "odometry.csv").write_text(quoted(style).replace(')"', ")").replace(']"', "]"))
    with pytest.raises(InputError, match="line 2: the quotation marks do not match"):
        read_poses(tmp_path / "odometry.csv", tmp_path / "camera.csv")


# ---------------------------------------------------------------------------------------------------- arrays and trees


def test_one_pose_beside_the_poses(tmp_path):
    rows = numbers(POSES.robot, "rotvec")
    np.savez(tmp_path / "robot.npz", poses_of_robot_read=rows, waiting=rows[0])
    write_pose_file(tmp_path / "camera.csv", POSES.camera)
    poses = read_poses(tmp_path / "robot.npz", tmp_path / "camera.csv")
    assert_right(poses)
    assert "not used: the arrays 'waiting'" in notes(poses)
    np.savez(tmp_path / "robot.npz", first=rows, second=rows)
    with pytest.raises(InputError, match="expected the arrays robot and camera"):
        read_poses(tmp_path / "robot.npz", tmp_path / "camera.csv")


def test_a_list_of_poses_in_yaml_is_no_message_of_ros(tmp_path):
    import yaml

    for name, side in (("robot.yaml", POSES.robot), ("marker.yaml", POSES.camera)):
        poses = [{"rotation": T[:3, :3].tolist(), "translation": T[:3, 3].tolist()} for T in side]
        (tmp_path / name).write_text(yaml.safe_dump({"poses": poses}))
    poses = read_poses(tmp_path / "robot.yaml", tmp_path / "marker.yaml")
    assert_right(poses)
    assert "read as json, by its content" in notes(poses)


def test_two_lists_of_matrices_by_their_order(tmp_path):
    """TransformPairs.yml of camodocal: T1_k of the robot, T2_k of the camera."""
    sides = {"T1": POSES.robot, "T2": POSES.camera}
    text = f"%YAML:1.0\nframeCount: {N}\n"
    for k in range(N):
        text += "".join("\n".join(matrix_lines(f"{name}_{k}", T[k])) + "\n" for name, T in sides.items())
    (tmp_path / "TransformPairs.yml").write_text(text)
    poses = read_poses(tmp_path / "TransformPairs.yml")
    assert_right(poses)
    assert "robot poses from T1 | camera poses from T2" in notes(poses)
    (tmp_path / "TransformPairs.yml").write_text(text.replace("T2_", "K_"))
    with pytest.raises(InputError, match="expected R_gripper2base"):
        read_poses(tmp_path / "TransformPairs.yml")


@pytest.mark.slow
@pytest.mark.parametrize("by_rows", [False, True])
@pytest.mark.parametrize("given", ["captured", "captured/pose_*/*.json"])
def test_a_folder_per_pose_with_both_sides_in_its_json(tmp_path, monkeypatch, by_rows, given):
    monkeypatch.chdir(tmp_path)
    vectors = Rotation.from_matrix(POSES.camera[:, :3, :3]).as_rotvec()
    for k in range(N):
        folder = tmp_path / "captured" / f"pose_{k}"
        folder.mkdir(parents=True)
        G, C = POSES.robot[k], POSES.camera[k]
        content = {
            "joint_pose": [0.1] * 7,
            "O_T_EE": (G if by_rows else G.T).ravel().tolist(),
            "camera_intrinsics": np.diag([600.0, 600.0, 1.0]).tolist(),
            "T_cam_target_rvec": vectors[k][:, None].tolist(),
            "T_cam_target_tvec": C[:3, 3][:, None].tolist(),
        }
        (folder / "data.json").write_text(json.dumps(content, indent=1))
        (folder / "picture.png").write_bytes(b"\x89PNG")
    poses = read_poses(given)
    assert_right(poses)
    assert "camera poses from T_cam_target" in notes(poses)
    assert f"{N} files, pose_0/data.json to pose_{N - 1}/data.json" in notes(poses)
    (tmp_path / "captured" / "pose_3" / "data.json").rename(tmp_path / "captured" / "pose_3" / "other.json")
    with pytest.raises(InputError):
        read_poses("captured")


# --------------------------------------------------------------------------------------------------- what a file says


def declared(tmp_path, text, name="robot.yaml"):
    (tmp_path / name).write_text(text)
    write_pose_file(tmp_path / "camera.csv", POSES.camera)
    return read_poses(tmp_path / name, tmp_path / "camera.csv")


def test_numbered_rows_with_units(tmp_path):
    rows = numbers(POSES.robot, "rotvec", 1e3).tolist()
    head = f"num_of_poses: {N}\nrot_type: rotation vector\ndistance_unit: mm\nangle_unit: radian\n"
    text = "%YAML:1.0\n---\n" + head + "".join(f"pose{k + 1}: {row}\n" for k, row in enumerate(rows))
    poses = declared(tmp_path, text)
    assert_right(poses)
    assert "lengths in mm, as the file says | rotations are rotvec-rad, as the file says" in notes(poses)


@pytest.mark.parametrize(
    ("said", "form", "length"),
    [
        ({"units": {"translation": "mm", "rotation": "deg"}, "euler_order": "ZYX"}, "ZYX", 1e3),
        ({"units": "cm", "angle_unit": "degrees", "convention": "rpy"}, "xyz", 100.0),
        ({"unit": "metres", "rotation_type": "Rodrigues"}, "rotvec", 1.0),
    ],
)
def test_declarations_beside_rows(tmp_path, said, form, length):
    poses = declared(tmp_path, json.dumps({**said, "poses": numbers(POSES.robot, form, length).tolist()}), "robot.json")
    assert_right(poses)
    assert f"rotations are {form}" in notes(poses) and "as the file says" in notes(poses)
    assert ("robot and camera agree" in notes(poses)) == (form == "rotvec")  # in rad or deg: the file does not say


@pytest.mark.parametrize("convention", ["base2gripper", "gripper_T_base", "T_ee_base"])
def test_declared_frames_are_believed(tmp_path, convention):
    inverted = np.linalg.inv(POSES.robot)
    poses = declared(tmp_path, json.dumps({"convention": convention, "poses": inverted.tolist()}), "robot.json")
    assert_right(poses)
    assert "poses are gripper_T_base, as the file says" in notes(poses)


def test_declarations_in_comments(tmp_path):
    inverted = np.linalg.inv(POSES.robot)
    text = "# units: mm\n# convention = base2gripper\nx,y,z,qx,qy,qz,qw\n" + lines(numbers(inverted, "xyzw", 1e3), ",")
    poses = declared(tmp_path, text, "robot.csv")
    assert_right(poses)
    with pytest.raises(InputError, match="declares lengths in mm, and its columns name cm"):
        declared(tmp_path, text.replace("x,y,z", "x [cm],y [cm],z [cm]"), "robot.csv")
    remarks = "# note: taken on monday\n# units: parsecs\n# frame: 12\nx,y,z,qx,qy,qz,qw\n"
    assert_right(declared(tmp_path, remarks + lines(numbers(POSES.robot, "xyzw"), ","), "robot.csv"))


# ------------------------------------------------------------------------------------------ files of other programs


def kinhec(side, T, seen=None):
    """A stream as kinhec 1.1.0 exports it (``io.Sequence.to_csv``): joints, ground truth, and what was measured."""
    rng = np.random.default_rng(SEED)
    parts = ("px", "py", "pz", "qw", "qx", "qy", "qz")
    measured = np.hstack([T[:, :3, 3], np.roll(Rotation.from_matrix(T[:, :3, :3]).as_quat(), 1, axis=1)])
    truth = measured + 0.01 * rng.normal(size=measured.shape)
    times = 0.05 * np.arange(N)
    if side == "robot":
        names = ["t", *(f"q{k}_{of}" for of in ("meas", "gt") for k in range(1, 7))]
        names += [f"base_ee_{of}_{part}" for of in ("gt", "meas") for part in parts]
        return ",".join(names) + "\n" + lines(np.column_stack([times, np.zeros((N, 12)), truth, measured]), ",")
    names = ["t", "t_gt", *(f"{of}_{part}" for of in ("base_ee_gt", "cam_target_gt") for part in parts)]
    names += [*(f"cam_target_meas_{part}" for part in parts), "visible", "outlier", "n_points", "reproj_rmse_px"]
    text = ",".join(names) + "\n"
    for k in range(N):
        row = map(repr, [*times[[k, k]].tolist(), *truth[k].tolist(), *truth[k].tolist()])
        pose = map(repr, measured[k].tolist()) if seen is None or seen[k] else [""] * 7
        text += ",".join([*row, *pose, str(seen is None or bool(seen[k])), "False", "54", ""]) + "\n"
    return text


def test_kinhec_by_what_was_measured(tmp_path):
    (tmp_path / "a_robot.csv").write_text(kinhec("robot", POSES.robot))
    (tmp_path / "a_camera.csv").write_text(kinhec("camera", POSES.camera))
    assert len((tmp_path / "a_robot.csv").read_text().split("\n")[0].split(",")) == 27
    assert_right(read_poses(tmp_path / "a_robot.csv", tmp_path / "a_camera.csv"))
    seen = np.arange(N) % 5 != 2
    (tmp_path / "a_camera.csv").write_text(kinhec("camera", POSES.camera, seen))
    poses = read_poses(tmp_path / "a_robot.csv", tmp_path / "a_camera.csv", pair="time")
    np.testing.assert_allclose(poses.robot, POSES.robot[seen], rtol=0, atol=1e-9)
    np.testing.assert_allclose(poses.camera, POSES.camera[seen], rtol=0, atol=1e-9)
    assert f"rows in which nothing was seen left out: {(~seen).sum()}" in notes(poses)


@pytest.mark.parametrize("below", [False, True])
def test_frames_of_compas(tmp_path, below):
    """Frames as compas 2.15 writes them by ``json_dump``: two axes, of which the second need not be perpendicular."""
    for name, side in (("robot.json", POSES.robot), ("camera.json", POSES.camera)):
        axes = [dict(zip(("xaxis", "yaxis", "point"), T[:3, [0, 1, 3]].T.tolist(), strict=True)) for T in side]
        frames = [{"dtype": "compas.geometry/Frame", "data": one, "guid": f"a{k}"} for k, one in enumerate(axes)]
        for frame in frames:
            data = frame["data"]
            data["yaxis"] = (2.0 * np.array(data["yaxis"]) + 0.5 * np.array(data["xaxis"])).tolist()
        (tmp_path / name).write_text(json.dumps({"frames": frames} if below else frames))
    assert_right(read_poses(tmp_path / "robot.json", tmp_path / "camera.json"))
    frames[3]["data"]["yaxis"] = frames[3]["data"]["xaxis"]
    (tmp_path / "camera.json").write_text(json.dumps(frames))
    with pytest.raises(InputError):
        read_poses(tmp_path / "robot.json", tmp_path / "camera.json")


def test_the_marker_of_figaroh(tmp_path):
    """x1 ... phiz1 are metres and roll, pitch, yaw about the fixed axes, rad (``pin.rpy`` in figaroh 1.0.2)."""
    rows = numbers(POSES.robot, "xyz")
    rows[:, 3:] = np.radians(rows[:, 3:])
    text = "x1,y1,z1,phix1,phiy1,phiz1,joint_1,joint_2\n" + lines(np.hstack([rows, np.zeros((N, 2))]), ",")
    poses = declared(tmp_path, text, "data.csv")
    assert_right(poses)
    assert "not used: the columns 'joint_1, joint_2'" in notes(poses)


def test_columns_of_other_things_are_no_two_poses(tmp_path):
    rows = np.hstack([numbers(POSES.robot, "xyzw"), numbers(POSES.camera, "xyzw")])
    names = ",".join(f"sensor{k}" for k in range(14))
    (tmp_path / "log.csv").write_text(f"{names}\n{lines(rows, ',')}")
    with pytest.raises(InputError):
        read_poses(tmp_path / "log.csv")


# ------------------------------------------------------------------------------------------- both sides in one JSON


def both_in_json():
    """Ways in which people keep both sides of a session in one file."""
    T, six, q = (
        [of(side) for side in (POSES.robot, POSES.camera)]
        for of in (np.ndarray.tolist, lambda T: numbers(T, "rotvec").tolist(), lambda T: numbers(T, "xyzw").tolist())
    )
    yield (
        "six numbers and a board's rvec, tvec",
        [{"tcp_pose": a, "rvec": b[3:], "tvec": b[:3], "image": "1.png"} for a, b in zip(*six, strict=True)],
    )
    yield (
        "rvec and tvec by name",
        [{"robot_pose": a, "marker_rvec": b[3:], "marker_tvec": b[:3]} for a, b in zip(*six, strict=True)],
    )
    yield (
        "positions and orientations",
        [
            {"ee_position": a[:3], "ee_orientation": a[3:], "marker_position": b[:3], "marker_orientation": b[3:]}
            for a, b in zip(*q, strict=True)
        ],
    )
    yield "below another name", {"data": [{"robot": a, "target": b} for a, b in zip(*T, strict=True)], "date": "today"}
    yield "hand and eye", {"hand": T[0], "eye": T[1]}
    yield "hand_poses and eye_poses", {"hand_poses": six[0], "eye_poses": six[1]}
    millimetres = numbers(POSES.robot, "xyzw", 1e3).tolist()
    yield (
        "units of each side",
        {"robot": {"units": "mm", "poses": millimetres}, "camera": {"units": "m", "poses": q[1]}},
    )


@pytest.mark.slow
@pytest.mark.parametrize(("way", "content"), list(both_in_json()))
def test_both_sides_in_one_json(tmp_path, way, content):
    (tmp_path / "session.json").write_text(json.dumps(content))
    assert_right(read_poses(tmp_path / "session.json"))


def test_two_arrays_by_their_order(tmp_path):
    np.savez(tmp_path / "session.npz", T2=POSES.camera, T1=POSES.robot)
    assert_right(read_poses(tmp_path / "session.npz"))
    np.savez(tmp_path / "session.npz", A=POSES.robot, B=POSES.camera)  # of motions as often as of poses
    with pytest.raises(InputError, match="expected the arrays robot and camera"):
        read_poses(tmp_path / "session.npz")


@pytest.mark.slow
@pytest.mark.parametrize(
    "content",
    [
        '{"compas": ' + '{"a": ' * 400 + "1" + "}" * 401,
        '[{"robot_pose": [1, 2], "marker_rvec": ' + "[" * 300 + "1" + "]" * 300 + ', "marker_tvec": [1, 2, 3]}]',
        '{"units": {"translation": ["mm"], "rotation": {"a": "deg"}}, "poses": [[1, 2, 3, 4, 5]]}',
        '{"convention": "' + "base2gripper" * 1000 + '", "poses": [1]}',
        '[{"dtype": "compas.geometry/Frame", "data": {"point": [1, 2], "xaxis": [1e400, 0, 0], "yaxis": "a"}}]',
        '{"T1": [1, 2], "T2": {"rows": 4, "cols": 4, "dt": "d", "data": [1]}}',
        '{"robot": {"units": "mm", "poses": []}, "camera": {"units": 3}}',
        "hand," + ",".join(["1e999"] * 6) + "\neye,1,2,3,4,5,6\n",
        "# units: " + "m" * 100_000 + "\nx,y,z,qx,qy,qz,qw\n",
        "1 2 3 4 5 6 7 8 9 10 11 nan\n" * 5,
    ],
)
@pytest.mark.parametrize("name", ["robot.json", "robot.txt"])
def test_hostile_contents_are_refused_in_one_line(tmp_path, content, name):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError) as caught:
        declared_only(tmp_path / name)
    assert str(caught.value).isprintable() and len(str(caught.value)) < 1500


def declared_only(path):
    write_pose_file(path.parent / "camera.csv", POSES.camera)
    return read_poses(path, path.parent / "camera.csv")


@pytest.mark.slow
@pytest.mark.parametrize("key", ["poses", "samples", "data"])
def test_both_sides_in_lists_of_yaml(tmp_path, key):
    """Numbers in brackets are no table where the file is a tree."""
    sides = (numbers(T, "rotvec").tolist() for T in (POSES.robot, POSES.camera))
    text = f"{key}:\n" + "".join(f"- robot: {a}\n  target: {b}\n" for a, b in zip(*sides, strict=True))
    (tmp_path / "session.yaml").write_text(text)
    assert_right(read_poses(tmp_path / "session.yaml"))


@pytest.mark.slow
@pytest.mark.parametrize("names", [("T1_", "T2_"), ("robot_", "camera_"), ("base_T_ee_", "cam_T_board_")])
@pytest.mark.parametrize("suffix", ["json", "yaml"])
def test_numbered_matrices_of_both_sides(tmp_path, names, suffix):
    sides = zip(names, (POSES.robot, POSES.camera), strict=True)
    tree = {f"{name}{k}": T[k].tolist() for name, T in sides for k in range(N)}
    text = json.dumps(tree) if suffix == "json" else "".join(f"{key}: {value}\n" for key, value in tree.items())
    (tmp_path / f"session.{suffix}").write_text(text)
    assert_right(read_poses(tmp_path / f"session.{suffix}"))


def of_robot_in_yaml():
    """Lists of poses in YAML, in brackets and below each other."""
    T, q = POSES.robot, numbers(POSES.robot, "xyzw").tolist()
    R, t, column = T[:, :3, :3].tolist(), T[:, :3, 3].tolist(), T[:, :3, 3:].tolist()
    for key in ("poses", "robot_poses", "transforms"):
        yield f"{key}:\n" + "".join(f"- rotation: {a}\n  translation: {b}\n" for a, b in zip(R, t, strict=True))
    yield "poses:\n" + "".join(f"- rotation: {a}\n  translation: {b}\n" for a, b in zip(R, column, strict=True))
    names = ("position", "xyz"), ("orientation", "xyzw")
    yield "poses:\n" + "".join(
        "- " + "  ".join(
            f"{part}:\n" + "".join(f"    {axis}: {row[3 * of + k]!r}\n" for k, axis in enumerate(axes))
            for of, (part, axes) in enumerate(names)
        ) for row in q
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("text", list(of_robot_in_yaml()))
def test_lists_of_poses_in_yaml(tmp_path, text):
    assert_right(declared(tmp_path, text))


def test_matrices_beside_joints_in_arrays(tmp_path):
    np.savez(tmp_path / "robot.npz", ee=POSES.robot.reshape(N, 16), q=np.zeros((N, 6)), home=np.eye(4))
    write_pose_file(tmp_path / "camera.csv", POSES.camera)
    poses = read_poses(tmp_path / "robot.npz", tmp_path / "camera.csv")
    assert_right(poses)
    assert "poses from 'ee'" in notes(poses)


# ------------------------------------------------------------------------------------- decimal commas behind names


FORMS_WITH_COMMAS = {
    "lines": lambda names, row: "\n".join(f"{name} = {value}" for name, value in zip(names, row, strict=True)),
    "one line": lambda names, row: " ".join(f"{name}={value}" for name, value in zip(names, row, strict=True)),
    "with commas": lambda names, row: ", ".join(f"{name} {value}" for name, value in zip(names, row, strict=True)),
    "in braces": lambda names, row: (
        "{" + ", ".join(f"{name} {value}" for name, value in zip(names, row, strict=True)) + "}"
    ),
    "lists": lambda names, row: f"Position: {'; '.join(row[:3])}\nEuler: {' '.join(row[3:])}",
}


@pytest.mark.parametrize("form", FORMS_WITH_COMMAS)
def test_decimal_commas_behind_names_are_not_cut_off(tmp_path, form):
    """X = 526,963 is no 526."""
    rows = [[f"{value:.6f}".replace(".", ",") for value in row] for row in numbers(POSES.robot, "ZYX", 1e3).tolist()]
    text = "\n\n".join(FORMS_WITH_COMMAS[form]("XYZABC", row) for row in rows)
    (tmp_path / "robot.txt").write_text(text)
    write_pose_file(tmp_path / "camera.csv", POSES.camera)
    assert_right(read_poses(tmp_path / "robot.txt", tmp_path / "camera.csv"), atol=1e-6)


def test_poses_as_the_april_tag_library_has_them(tmp_path):
    """pose_R and pose_t, a column, of each detection."""
    found = [{"tag_id": 3, "pose_R": C[:3, :3].tolist(), "pose_t": C[:3, 3:].tolist()} for C in POSES.camera]
    (tmp_path / "tags.json").write_text(json.dumps(found))
    write_pose_file(tmp_path / "robot.csv", POSES.robot)
    assert_right(read_poses(tmp_path / "robot.csv", tmp_path / "tags.json"))


def test_the_folder_without_its_file_is_named(tmp_path):
    for k in range(4):
        (tmp_path / f"poses/pose_{k}").mkdir(parents=True)
        if k != 2:
            np.savetxt(tmp_path / f"poses/pose_{k}/pose.txt", POSES.robot[k])
    write_pose_file(tmp_path / "camera.csv", POSES.camera[:4])
    with pytest.raises(InputError, match=r"3 of 4 folders hold pose.txt; pose_2 does not"):
        read_poses(tmp_path / "poses", tmp_path / "camera.csv")
