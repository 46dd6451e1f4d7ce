"""Corners, calibrated cameras and intrinsics in files: what is written is read, and what is no such file is refused."""

import json
import logging
import shutil
from dataclasses import fields, replace

import numpy as np
import pytest
from fixtures.pictures import CAMERA, SIZE, camera_to_board, seen_corners, simulated_rig

import uq_handeye as uq
from uq_handeye.errors import InputError, InputWarning
from uq_handeye.model.camera.adjustment.criterion import Candidate
from uq_handeye.model.camera.calibration_files import camera_files
from uq_handeye.model.camera.corners_file import corners_text
from uq_handeye.model.camera.report.figures import camera_pictures
from uq_handeye.model.camera.result import FURTHER
from uq_handeye.read import write_files, write_pose_file

cv2 = pytest.importorskip("cv2")
BOARD = uq.Board(8, 5, 0.02)
LENSES = {
    "pinhole": {},
    "brown": {"distortion": [-0.2, 0.05, 0.001, -0.001, 0.0]},
    "fisheye": {"distortion": [0.02, -0.01, 0.0, 0.0], "fisheye": True},
}


def calibrated(rng, model="pinhole", **options):
    """A camera of the model, with one wrong corner and two pictures without a board."""
    poses, corners = simulated_rig(BOARD, rng, **LENSES[model])
    pixels = corners.pixels.copy()
    pixels[77] += 9.0
    keep = ~np.isin(corners.row, (3, 9))
    names = [f"img {row}, left.png" for row in np.unique(corners.row[keep])]
    corners = uq.Corners(corners.row[keep], corners.points[keep], pixels[keep], names, SIZE, ["img 3", "img 9"])
    return poses, uq.calibrate_camera(corners, model=model, **options)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize("model", ["pinhole", "brown", "fisheye"])
def test_a_camera_is_read_as_it_was_written(rng, tmp_path, model):
    _, cam = calibrated(rng, model)
    inf = float("inf")
    cam = replace(cam, candidates=(Candidate("pinhole", (), -7.5, 0.1), Candidate("brown", ("k1", "k2"), inf, inf)))
    write_files(tmp_path / "camera", camera_files(cam))
    read = uq.read_camera(tmp_path / "camera")
    unknowns = cam.bundle.unknowns, read.bundle.unknowns
    for here, there in ((cam.bundle, read.bundle), unknowns, (cam.bundle.shape, read.bundle.shape)):
        for field in fields(there):
            one, other = getattr(here, field.name), getattr(there, field.name)
            same = np.array_equal(one, other) if isinstance(one, np.ndarray) else one == other
            assert same or field.name in ("unknowns", "shape"), field.name
    for name in ("own", "shared"):
        np.testing.assert_array_equal(getattr(read.covariance, name), getattr(cam.covariance, name))
    for name in ("row", "points", "pixels", "names", "missing", "image_size"):
        np.testing.assert_array_equal(getattr(read.corners, name), getattr(cam.corners, name))
    for name in ("intrinsics", "std", "estimated", "outliers", "pixel_noise", "candidates", "findings", "image_size"):
        assert getattr(read, name) == getattr(cam, name), name
    assert len(read.outliers) == 1 and read.corners.missing == ("img 3", "img 9")
    assert read.pattern.p_value == cam.pattern.p_value and read.pattern.share == cam.pattern.share
    assert camera_files(read) == camera_files(cam)
    # of some of the pictures, too
    some = read.select(np.array([0, 2, 5, 6]))
    write_files(tmp_path / "some", camera_files(some))
    np.testing.assert_array_equal(uq.read_camera(tmp_path / "some").bundle.own, some.bundle.own)


@pytest.mark.slow
def test_a_prior_is_stored_and_restored(rng, tmp_path):
    known = {"fx": (750.0, 2.0), "fy": (746.0, 2.0), "cx": 320.0}
    _, cam = calibrated(rng, intrinsics=known)
    write_files(tmp_path, camera_files(cam))
    read = uq.read_camera(tmp_path).bundle.prior
    np.testing.assert_array_equal(read.mean, cam.bundle.prior.mean)
    np.testing.assert_array_equal(read.covariance, cam.bundle.prior.covariance)
    assert camera_files(uq.read_camera(tmp_path)) == camera_files(cam)
    for prior in ({"mean": [1.0]}, 7, {"mean": [0.0] * 4, "covariance": [[-1.0] * 4] * 4}):
        broken(tmp_path, "intrinsics.json", of_json(prior=prior))
        with pytest.raises(InputError, match=r"intrinsics\.json, prior"):
            uq.read_camera(tmp_path)


@pytest.mark.slow
def test_figures_of_an_earlier_run_are_taken_away(rng, tmp_path, without_rendering):
    _, cam = calibrated(rng)
    exact = calibrated(rng, intrinsics={"fx": 750.0, "fy": 746.0, "cx": 320.0, "cy": 240.0}, exact=True)[1]
    (tmp_path / "mine.png").write_bytes(b"mine")
    cam.write(tmp_path)
    assert (tmp_path / "certainty.png").exists()
    exact.write(tmp_path)  # of exact intrinsics there is no map of how certain they are
    assert not (tmp_path / "certainty.png").exists() and not (tmp_path / "certainty.svg").exists()
    assert (tmp_path / "mine.png").exists() and (tmp_path / "report.html").exists()
    assert {f"{name}.{kind}" for name in camera_pictures(cam) for kind in ("png", "svg")} <= FURTHER


@pytest.mark.slow
def test_intrinsics_of_another_run_are_refused(rng, tmp_path):
    _, cam = calibrated(rng)
    write_files(tmp_path, camera_files(cam))
    other = calibrated(rng)[1]  # other noise: nearly the same numbers, and everything else fits
    write_files(tmp_path, {"intrinsics.json": camera_files(other)["intrinsics.json"]})
    with pytest.raises(InputError, match=r"intrinsics\.json and camera_covariance\.npz are not of the same run"):
        uq.read_camera(tmp_path)


@pytest.mark.slow
def test_intrinsics_that_are_all_exact(rng, tmp_path):
    known = {"fx": 750.0, "fy": 746.0, "cx": 320.0, "cy": 240.0}
    _, cam = calibrated(rng, intrinsics=known, exact=True)
    write_files(tmp_path, camera_files(cam))
    read = uq.read_camera(tmp_path)
    assert read.intrinsics == known and set(read.std.values()) == {0.0} and read.covariance.shared.shape[-1] == 0


@pytest.mark.slow
def test_everything_is_written_or_nothing(rng, tmp_path, without_rendering):
    _, cam = calibrated(rng)
    (tmp_path / "full" / "corners.csv").mkdir(parents=True)
    with pytest.raises(InputError, match="it is a folder, expected a file"):
        cam.write(tmp_path / "full")
    assert [path.name for path in (tmp_path / "full").iterdir()] == ["corners.csv"]
    folder = cam.write(tmp_path / "new" / "camera")
    names = {path.name for path in folder.iterdir()}
    assert names >= {"camera.csv", "camera_covariance.npz", "intrinsics.json", "intrinsics.yaml", "corners.csv"}
    assert "report.html" in names and any(name.endswith(".png") for name in names)
    with np.load(folder / "camera_covariance.npz", allow_pickle=False) as archive:
        S = uq.JointCovariance(archive["own"], archive["shared"])
        assert "additive" in str(archive["convention"])
        np.testing.assert_array_equal(archive["rows"], cam.rows)
    np.testing.assert_array_equal(np.asarray(S), np.asarray(cam.covariance))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize("model", ["pinhole", "brown", "fisheye"])
def test_opencv_reads_the_intrinsics_and_sees_the_same_pixels(rng, tmp_path, model):
    _, cam = calibrated(rng, model)
    write_files(tmp_path, camera_files(cam))
    storage = cv2.FileStorage(str(tmp_path / "intrinsics.yaml"), cv2.FILE_STORAGE_READ)
    K, d = (storage.getNode(name).mat() for name in ("camera_matrix", "distortion_coefficients"))
    assert (storage.getNode("image_width").real(), storage.getNode("image_height").real()) == SIZE
    assert (
        storage.getNode("camera_model").string() == model and "k1" in storage.getNode("comment").string()
    ) or not d.any()
    project = cv2.fisheye.projectPoints if model == "fisheye" else cv2.projectPoints
    T = cam.poses[0]
    seen = project(BOARD.points[:, None], cv2.Rodrigues(T[:3, :3])[0], T[:3, 3].copy(), K, d)[0].reshape(-1, 2)
    first = cam.corners.row == 0
    np.testing.assert_allclose(seen, (cam.corners.pixels - cam.bundle.residuals)[first], atol=1e-6)
    known = uq.read_intrinsics(tmp_path / "intrinsics.yaml")
    assert known.model == model and known.image_size == SIZE
    assert {name: known.values[name] for name in known.values} == {name: cam.intrinsics[name] for name in known.values}


# ----------------------------------------------------------------------------------------------- folders that lie


def broken(folder, name, change):
    path = folder / name
    path.write_bytes(change(path.read_bytes()))


def of_json(**values):
    return lambda data: json.dumps({**json.loads(data), **values}).encode()


def of_archive(**values):
    def change(data):
        import io

        arrays = dict(np.load(io.BytesIO(data), allow_pickle=False))
        buffer = io.BytesIO()
        np.savez(buffer, **{key: value for key, value in (arrays | values).items() if value is not None})
        return buffer.getvalue()

    return change


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("camera") / "camera"
    write_files(path, camera_files(calibrated(np.random.default_rng(5))[1]))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("intrinsics.json", lambda data: b"{", r"intrinsics\.json.*not (JSON|YAML)"),
        ("intrinsics.json", lambda data: b"[1, 2]", "expected the format 'uq-handeye camera 1', got a list of 2"),
        ("intrinsics.json", of_json(format="uq-handeye calibration 3"), "got 'uq-handeye calibration 3'"),
        ("intrinsics.json", of_json(model="brown"), "k1"),
        ("intrinsics.json", of_json(model=["brown"]), "model: expected one of pinhole, brown"),
        ("intrinsics.json", of_json(parameters={"fx": "a"}), "expected a number"),
        ("intrinsics.json", of_json(covariance=[[1.0]]), "expected a list of 4 numbers"),
        ("intrinsics.json", of_json(covariance=(-np.eye(4)).tolist()), "not of the same run"),
        ("intrinsics.json", of_json(estimated=None), "not what uq-handeye camera writes|exact|positive|expected"),
        ("intrinsics.json", of_json(pixel_noise=None), "expected a number, got nothing"),
        ("camera_covariance.npz", lambda data: data[:200], "archive is damaged"),
        (
            "camera_covariance.npz",
            of_archive(own=None),
            r"own of camera_covariance\.npz to be numbers of shape \(13",
        ),
        ("camera_covariance.npz", of_archive(own=np.full((13, 6, 6), np.nan)), "own of .* to be finite numbers"),
        ("camera_covariance.npz", of_archive(own=-np.tile(np.eye(6), (13, 1, 1))), "own: expected covariances"),
        ("camera_covariance.npz", of_archive(poses=np.zeros((13, 4, 4))), "poses"),
        ("camera_covariance.npz", of_archive(rows=np.arange(13)), "not of the same run"),
        ("corners.csv", lambda data: data[: len(data) // 2] + b"\n", r"line \d+.*expected|expected finite numbers"),
        ("corners.csv", lambda data: data.replace(b",0.02,", b",0.025,"), "not of the same run"),
        ("camera.csv", lambda data: data.replace(b"\n0.0,", b"\n0.5,"), "not of the same run"),
        ("camera.csv", lambda data: data[:300], "field|number|line"),
    ],
)
def test_files_that_do_not_belong_together_are_one_line(folder, tmp_path, name, change, message):
    shutil.copytree(folder, tmp_path / "camera")
    broken(tmp_path / "camera", name, change)
    with pytest.raises(InputError, match=message) as error:
        uq.read_camera(tmp_path / "camera")
    assert "\n" not in str(error.value) and len(str(error.value)) < 600


def test_a_folder_that_is_none_or_lacks_a_file(folder, tmp_path):
    with pytest.raises(InputError, match="expected the folder of uq-handeye camera -o"):
        uq.read_camera(tmp_path / "nowhere")
    shutil.copytree(folder, tmp_path / "camera")
    (tmp_path / "camera" / "corners.csv").unlink()
    with pytest.raises(InputError, match=r"lacks corners\.csv"):
        uq.read_camera(tmp_path / "camera")
    with pytest.raises(InputError, match=r"lacks corners\.csv"):
        uq.read_poses(tmp_path / "robot.csv", tmp_path / "camera")


# -------------------------------------------------------------------------------------------------------- corners


def test_corners_of_any_order_of_columns_with_names_and_units(rng, tmp_path, caplog):
    row, points, pixels = seen_corners(
        BOARD.points, camera_to_board(uq.simulate(3, seed=1).camera, BOARD), rng, rows=[2, 0, 7]
    )
    lines = [
        f'{u!r};{v!r};{r};"picture {r}; left.png";{1000 * x!r};{1000 * y!r};{1000 * z!r};0.5'
        for r, (x, y, z), (u, v) in zip(row, points.tolist(), pixels.tolist(), strict=True)
    ]
    file = tmp_path / "corners.csv"
    file.write_text("\n".join(["# detected", "u;v;row;name;X;Y;Z;score", *lines]))
    with caplog.at_level(logging.INFO, "uq_handeye"):
        found = uq.read_corners(file, units="mm")
    assert "not used: the columns 'score'" in caplog.text
    order = np.argsort(row, kind="stable")
    np.testing.assert_allclose(found.points, points[order], atol=1e-12)
    np.testing.assert_array_equal(found.pixels, pixels[order])
    file.write_text("\n".join(["u;v;row;name;X [mm];Y [mm];Z [mm];score", *lines]))
    np.testing.assert_array_equal(uq.read_corners(file).points, found.points)
    with pytest.raises(InputError, match="names its points in mm, and `units` is cm"):
        uq.read_corners(file, units="cm")
    file.write_text("\n".join(["u;v;row;name;X [mm];Y [mm];Z;score", *lines]))
    with pytest.raises(InputError, match="expected one unit for x, y and z"):
        uq.read_corners(file)
    assert found.names == tuple(f"picture {r}; left.png" for r in (0, 2, 7))
    file.write_text(corners_text(found, np.ones(found.m, dtype=bool)))
    again = uq.read_corners(file)
    np.testing.assert_array_equal(again.points, found.points)
    assert again.names == found.names


HEADER = "row,x,y,z,u,v\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty"),
        (HEADER, "no rows after the header"),
        ("0,0,0,0,1,1\n", r"line 1: expected the header row,x,y,z,u,v.*header line is missing"),
        ("row,x,y,u,v\n", r"missing: z"),
        ("row,x,y,z,u,v,u\n", "twice: u"),
        (HEADER + "0,0,0,0,1\n", r"line 2: expected 6 fields separated by commas, got 5"),
        (HEADER + "0,0,0,0,1,a\n", "line 2, column v: expected a number, got 'a'"),
        (HEADER + "0,0,0,0,1,nan\n", "line 2, column v: expected a finite number"),
        (HEADER + "nan,0,0,0,1,1\n", "line 2, column row: expected a finite number"),
        (HEADER + "0.5,0,0,0,1,1\n", "numbers of pictures"),
        (HEADER + "0,0,0,0,1,1\n", "at least 4 corners in every picture, got 1 in row 0"),
        (
            HEADER.replace("\n", ",name\n") + "0,0,0,0,1,1,a\n0,0,1,0,1,1,b\n",
            "line 3: row 0 is of 'b', in .*line 2 of 'a'",
        ),
        (HEADER.replace("\n", ",name\n") + '0,0,0,0,1,1,"a\n', "quotation marks"),
        (HEADER.replace("\n", ",used\n") + "0,0,0,0,1,1,2\n" * 4, "column used: expected 1 or 0"),
        ("x" * 20000, "lines of at most 10000 characters"),
        ("\0\0\0\0", "NUL"),
    ],
)
def test_tables_that_are_no_corners(tmp_path, text, message):
    file = tmp_path / "corners.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        uq.read_corners(file)
    assert "corners.csv" in str(error.value) and "\n" not in str(error.value)


# ----------------------------------------------------------------------------------------------------- intrinsics


def known(tmp_path, text, name="intrinsics.json", model=None):
    (tmp_path / name).write_text(text)
    return uq.read_intrinsics(tmp_path / name, model)


def test_what_the_maker_says_with_deviations(rng, tmp_path):
    found = known(
        tmp_path, '{"fx": [751.0, 2.0], "fy": [745, 2], "cx": 320.0, "k1": [0.0, 0.01], "image_size": [640, 480]}'
    )
    assert found.values == {"fx": (751.0, 2.0), "fy": (745.0, 2.0), "cx": 320.0, "k1": (0.0, 0.01)}
    assert (found.model, found.image_size) == (None, (640, 480))
    _, cam = calibrated(rng)
    write_files(tmp_path / "camera", camera_files(cam))
    own = uq.read_intrinsics(tmp_path / "camera" / "intrinsics.json")
    assert own.values == {name: (cam.intrinsics[name], cam.std[name]) for name in ("fx", "fy", "cx", "cy")}
    assert (own.model, own.image_size) == ("pinhole", SIZE)


ROS = """image_width: 640
image_height: 480
camera_name: left
camera_matrix:
  rows: 3
  cols: 3
  data: [750.0, 0.0, 320.0, 0.0, 746.0, 240.0, 0.0, 0.0, 1.0]
distortion_model: {model}
distortion_coefficients:
  rows: 1
  cols: {n}
  data: {data}
"""


@pytest.mark.parametrize(
    ("said", "data", "model", "coefficients"),
    [
        ("plumb_bob", [0.1, 0.2, 0.3, 0.4, 0.5], "brown", {"k1": 0.1, "k2": 0.2, "p1": 0.3, "p2": 0.4, "k3": 0.5}),
        ("equidistant", [0.1, 0.2, 0.3, 0.4], "fisheye", {"k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4}),
        (
            "rational_polynomial",
            [0.1] * 8 + [0.0] * 4,
            "brown",
            dict.fromkeys(("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), 0.1),
        ),
    ],
)
def test_intrinsics_of_ros(tmp_path, said, data, model, coefficients):
    found = known(tmp_path, ROS.format(model=said, n=len(data), data=data), "camera.yaml")
    assert found.model == model and found.image_size == (640, 480)
    assert found.values == {"fx": 750.0, "fy": 746.0, "cx": 320.0, "cy": 240.0} | coefficients


def test_intrinsics_of_opencv_without_a_model(tmp_path):
    file = str(tmp_path / "calibration.xml")
    storage = cv2.FileStorage(file, cv2.FILE_STORAGE_WRITE)
    storage.write("camera_matrix", CAMERA)
    storage.write("distortion_coefficients", np.zeros((5, 1)))
    storage.release()
    found = uq.read_intrinsics(file)
    assert found.model == "pinhole" and set(found.values) == {"fx", "fy", "cx", "cy"}
    assert uq.read_intrinsics(file, "brown").values["k3"] == 0.0
    with pytest.raises(InputError, match="4 coefficients of a fisheye, got 5"):
        uq.read_intrinsics(file, "fisheye")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("3", "expected intrinsics such as"),
        ("{}", "none of them"),
        ('{"fx": "a"}', "fx: expected a number"),
        ('{"fx": [1, 2, 3]}', "a value, or a value and its standard deviation, got a list of 3"),
        ('{"fx": [1, -2]}', "standard deviation of at least 0"),
        ('{"fx": 1e999}', "finite"),
        ('{"focal": 1}', "unknown: 'focal'"),
        ('{"fx": 1, "model": "zoom"}', "camera model 'zoom' is not one"),
        ('{"fx": 1, "image_size": 3}', "image_size: expected width and height"),
        ('{"camera_matrix": [[1, 5, 0], [0, 1, 0], [0, 0, 1]]}', "expected .fx 0 cx"),
        ('{"camera_matrix": [1, 2]}', "expected .fx 0 cx"),
        ('{"K": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "D": [0,0,0,0,0,0,0,0,0,0,0,0,0,0,1]}', "others than 0 beyond"),
        ("[" * 5000, "not|nested|deep"),
    ],
)
def test_intrinsics_that_are_none(tmp_path, text, message):
    with pytest.raises(InputError, match=message) as error:
        known(tmp_path, text)
    assert "\n" not in str(error.value)


# ---------------------------------------------------------------------------------------------- poses from a folder


def test_poses_of_a_folder_are_those_of_its_rows(rng, tmp_path, caplog):
    poses, cam = calibrated(rng)
    write_files(tmp_path / "camera", camera_files(cam))
    write_pose_file(tmp_path / "robot.csv", poses.robot)
    with caplog.at_level(logging.INFO, "uq_handeye"):
        read = uq.read_poses(tmp_path / "robot.csv", tmp_path / "camera")
    assert "rows without a picture of the board are left out: 3, 9" in caplog.text
    np.testing.assert_allclose(read.robot, poses.robot[cam.rows], atol=1e-12)
    np.testing.assert_array_equal(read.camera, cam.poses)
    np.testing.assert_array_equal(np.asarray(read.camera_calibration.covariance), np.asarray(cam.covariance))
    np.testing.assert_array_equal(read.timestamps, cam.rows)
    assert [source.name for source in read.sources] == ["robot.csv", "camera/corners.csv"]
    same = uq.read_poses(tmp_path / "robot.csv", cam)
    np.testing.assert_array_equal(same.robot, read.robot)


@pytest.mark.slow
def test_numbers_of_pictures_and_robot_poses_that_differ(rng, tmp_path):
    poses, cam = calibrated(rng)  # 13 of 15 pictures
    write_files(tmp_path / "camera", camera_files(cam))
    for n in (13, 14):
        write_pose_file(tmp_path / "robot.csv", poses.robot[:n])
        with pytest.raises(InputError, match=rf"robot\.csv has {n} poses and .*camera 15 pictures, 2 of them without"):
            uq.read_poses(tmp_path / "robot.csv", tmp_path / "camera")
    some = cam.select(np.arange(5, 13))  # how many pictures there were is not known
    write_files(tmp_path / "some", camera_files(some))
    with pytest.raises(InputError, match=r"8 pictures, the last of row 14: picture k, counted from 0"):
        uq.read_poses(tmp_path / "robot.csv", tmp_path / "some")
    write_pose_file(tmp_path / "robot.csv", poses.robot)
    for options in ({"pair": "time"}, {"camera_frame": "target_T_camera"}):
        with pytest.raises(InputError, match="calibrated camera goes with its rows"):
            uq.read_poses(tmp_path / "robot.csv", tmp_path / "camera", **options)


def test_a_board_as_large_as_a_house_is_in_millimetres(rng, tmp_path):
    _, corners = simulated_rig(BOARD, rng, n=4)
    large = replace(corners, points=1e3 * corners.points)
    (tmp_path / "corners.csv").write_text(corners_text(large, np.ones(large.m, dtype=bool)))
    with pytest.warns(InputWarning, match=r"corners\.csv: their points span 161 m.*--units mm"):
        uq.read_corners(tmp_path / "corners.csv")
    np.testing.assert_allclose(uq.read_corners(tmp_path / "corners.csv", "mm").points, corners.points)


@pytest.mark.slow
def test_that_size_is_known_or_asked_for(rng):
    _, cam = calibrated(rng)
    bare = uq.Corners(cam.corners.row, cam.corners.points, cam.corners.pixels)
    with pytest.raises(InputError, match="image_size"):
        uq.calibrate_camera(bare, model="pinhole")
    assert uq.calibrate_camera(bare, SIZE, "pinhole").intrinsics == cam.intrinsics
    with pytest.warns(InputWarning):
        uq.calibrate_camera(bare, SIZE, "brown")
