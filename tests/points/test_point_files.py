"""Tables of points as people write them, folders of poses from points, the figure."""

import dataclasses
import re
import warnings

import numpy as np
import pytest
from fixtures.pages import DOCS
from fixtures.point_sets import rig
from support import SEED

import uq_handeye as uq
from uq_handeye import InputError, InputWarning
from uq_handeye.model.points.result import POINTS, SUMMARY

XYZ = np.array([[0.031, -0.028, 0.618], [0.129, -0.030, 0.625], [0.031, -0.128, 0.618], [0.129, -0.131, 0.625]])
ROWS, NAMES = [0, 0, 1, 1], ["A", "B", "A", "B"]


def table(line, header):
    lines = [line.format(pose, name, *xyz) for pose, name, xyz in zip(ROWS, NAMES, XYZ, strict=True)]
    return "\n".join(([header] if header else []) + lines) + "\n"


def wide(header, mark, more=""):
    rows = [mark.join([str(k), *map(str, XYZ[2 * k : 2 * k + 2].ravel())]) + more for k in range(2)]
    return "\n".join([header, *rows]) + "\n"


@pytest.mark.parametrize(
    "text",
    [
        table("{},{},{},{},{}", "pose,point,x,y,z"),
        table("{},{},{},{},{}", "\ufeffPose_ID,ID,X,Y,Z").replace("\n", "\r\n"),
        table("{1};{0};{2};{3};{4}", "marker;view;x [m];y [m];z [m]").replace(".", ","),
        table('"{}"\t"{}"\t{}\t{}\t{}', "# from the scanner\nframe\tlabel\tposition.x\tposition.y\tposition.z"),
        table("{} {} {}  {} {}", "shot feature x y z"),
        table("{0},{1},{2},{3},{4},0.9", "row,name,x,y,z,confidence"),
        table("scan{0}.ply,{1},{2},{3},{4}", "image,point,x,y,z"),
        table("17{0}.25,{1},{2},{3},{4}", "timestamp,point,x,y,z"),
        table("{0}.0,{1},{2},{3},{4}", "pose number,point,x,y,z").replace("pose number", "pose_number"),
        table("{},{},{},{},{}", "pose,point,x,y,z") + "0,C,,,\n1,C,nan,nan,nan\n",
        table("{},{},{},{},{}", ""),
        wide("frame,A_x,A_y,A_z,B_x,B_y,B_z,C_x,C_y,C_z", ",", ",,,"),
        wide("Frame;A x [m];A y [m];A z [m];B x [m];B y [m];B z [m]", ";").replace(".", ","),
        table("{0},{1},{2},{3},{4},0,0,1", "pose,point,position.x,position.y,position.z,normal.x,normal.y,normal.z"),
    ],
)
def test_tables_that_people_write(text, tmp_path):
    path = tmp_path / "points.csv"
    path.write_text(text, encoding="utf-8")
    found = uq.read_points(path)
    assert found.row.tolist() == ROWS and found.point.tolist() == NAMES
    np.testing.assert_array_equal(found.xyz, XYZ)


def test_wide_tables_by_numbers_and_their_faults(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("x1,y1,z1,x2,y2,z2\n1,2,3,4,5,6\n# pause\n\n7,8,9,1,2,3\n")
    found = uq.read_points(path)
    assert found.row.tolist() == ROWS and found.point.tolist() == ["1", "2", "1", "2"]
    np.testing.assert_array_equal(found.xyz.ravel(), [1, 2, 3, 4, 5, 6, 7, 8, 9, 1, 2, 3])
    for rows, words in (
        ("1,2,3,4,5\n", "line 2: expected 6 fields separated by commas, got 5"),
        ("1,2,3,4,5,b\n", "line 2, column z2: expec"),
    ):
        path.write_text("x1,y1,z1,x2,y2,z2\n" + rows)
        with pytest.raises(InputError, match=words):
            uq.read_points(path)


def test_names_that_differ_in_capital_letters_only():
    target = {"A": (0, 0, 0), "B": (0.1, 0, 0), "C": (0, 0.1, 0), "D": (0.1, 0.1, 0.05)}
    xyz = np.tile(np.add(list(target.values()), (0, 0, 1.0)), (3, 1))
    xyz += 1e-4 * np.random.default_rng(1).normal(size=xyz.shape)
    points = uq.PointSet(np.repeat([0, 1, 2], 4), np.array(list("abcd") * 3), xyz)
    found = uq.poses_from_points(points, target, 1e-4)
    np.testing.assert_allclose(found.poses[:, :3, 3], [[0, 0, 1]] * 3, atol=2e-3)


@pytest.mark.parametrize("page", ["formats.md", "how-to/points.md"])
def test_examples_of_the_documentation(page, tmp_path):
    text = re.search(r"^```csv\n(pose,point.*?)^```", (DOCS / page).read_text(), re.DOTALL | re.MULTILINE)[1]
    (tmp_path / "points.csv").write_text(text)
    assert uq.read_points(tmp_path / "points.csv").point.tolist() == ["A", "B"]


def test_units_and_tables_without_names(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("\n".join(f"{row},{','.join(map(str, 1e3 * xyz))}" for row, xyz in zip(ROWS, XYZ, strict=True)))
    with pytest.raises(InputError, match="expected the header pose,point,x,y,z"):
        uq.read_points(path)
    path.write_text("pose,x_mm,y_mm,z_mm\n" + path.read_text())
    found = uq.read_points(path)
    assert found.point.tolist() == ["0", "1", "0", "1"]
    np.testing.assert_allclose(found.xyz, XYZ, rtol=1e-15)
    path.write_text(path.read_text().replace("_mm", ""))
    np.testing.assert_allclose(uq.read_points(path, "mm").xyz, XYZ, rtol=1e-15)
    with pytest.warns(InputWarning, match="--units mm"):
        uq.read_points(path)
    path.write_text("0,7,0.1,0.2,0.8\n1,7,0.1,0.1,0.9\n")
    assert uq.read_points(path).point.tolist() == ["7", "7"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the file is empty"),
        ("pose,point,x,y,z\n", "no rows after the header"),
        ("pose,point,x,y\n0,A,1,2\n", "missing: z"),
        ("point,x,y,z\nA,1,2,3\n", "missing: pose"),
        ("pose,point,x,y,z\n0,A,1,2\n", "line 2: expected 5 fields separated by commas, got 4"),
        ("pose,point,x,y,z\n0,A,1,far,3\n", "line 2, column y: expected a number, got 'far'"),
        ("pose,point,x,y,z\n0,A,1,inf,3\n", "line 2: expected finite coordinates"),
        ("pose,point,x,y,z\n0,A,1,2,3\n0,A,1,2,3\n", "point A twice in pose 0"),
        ("pose,point,x,y,z\n-1,A,1,2,3\n", "numbers of poses from 0, got -1"),
        ("pose,point,x_mm,y,z\n0,A,1,2,3\n", "one unit for x, y and z"),
        ("pose,x,y,z\n0,1,2,3\n0,1,2,4\n1,1,2,3\n", "expected a column point"),
        ("pose,point,x,y,z\n0,,1,2,3\n", "expected a name or a number"),
        ("pose,point,x,y,z\n0,A,,,\n", "expected points with coordinates, got none"),
        ("\0\1\2", "NUL bytes"),
    ],
)
def test_refusals_name_file_and_place(text, words, tmp_path):
    path = tmp_path / "points.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as error:
        uq.read_points(path)
    assert str(error.value).startswith(f"{path.name}") or str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_target(tmp_path):
    path = tmp_path / "target.csv"
    path.write_text("id;x [mm];y [mm];z [mm]\nA;0;0;0\nB;100;0,5;0\n")
    found = uq.read_target(path)
    assert found.names.tolist() == ["A", "B"] and found.xyz[1].tolist() == [0.1, 0.0005, 0.0]
    path.write_text("x,y,z\n0,0,0\n1,0,0\n")
    assert uq.read_target(path).names.tolist() == ["0", "1"]
    path.write_text("7,0,0,0\n9,1,0,0\n")
    assert uq.read_target(path).names.tolist() == ["7", "9"]


@pytest.fixture(scope="module")
def seen():
    y, p, _ = rig(np.random.default_rng(SEED), 10, 6, 1e-4, 5e-4)
    y[3, 2] += [0.0, 0.02, 0.0]
    y[5, 1:] = np.nan
    y[:, 4][1:3] = np.nan
    names = np.array(["a b", 'x"y', "#1", "7", "c,d", "e"])
    pose, point = np.nonzero(~np.isnan(y).any(axis=-1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        points = uq.PointSet(pose, names[point], y[pose, point])
        return uq.poses_from_points(points, uq.Target(names, p))


def test_folders_are_read_bit_by_bit(seen, tmp_path, without_rendering):
    found = seen
    found.write(tmp_path / "seen")
    again = uq.read_point_poses(tmp_path / "seen")
    for field in dataclasses.fields(found):
        one, other = getattr(found, field.name), getattr(again, field.name)
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other)
        elif isinstance(one, uq.JointCovariance | uq.PointSet | uq.Target):
            for part in dataclasses.fields(one):
                np.testing.assert_array_equal(getattr(one, part.name), getattr(other, part.name))
        else:
            assert one == other
    assert again.summary() == found.summary() and "Pose 5 was left out" in again.summary()
    part = found.select(np.arange(3))
    assert part.n == 3 and part.covariance.n == 3 and set(part.points.row) == {0, 1, 2}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "change", "words"),
    [
        (POINTS, lambda text: text.replace("0,7,-0.", "0,7,-1.").replace("0,7,0.", "0,7,1."), "not of the same run"),
        (POINTS, lambda text: text.replace(",1\n", ",2\n", 1), "expected 1 or 0"),
        ("target.csv", lambda text: text.replace("0.0", "0.1", 1), "not of the same run"),
        ("camera.csv", lambda text: text.replace("0.0,", "0.5,", 1), "not of the same run"),
        (SUMMARY, lambda text: text.replace("points 2", "points 1"), "expected the format"),
        (SUMMARY, lambda text: text.replace('"lateral":', '"side":'), "not what uq-handeye points writes"),
        (SUMMARY, None, "lacks points.json"),
    ],
)
def test_folders_that_were_changed_are_refused(file, change, words, seen, tmp_path, without_rendering):
    folder = seen.write(tmp_path / "seen")
    path = folder / file
    if change is None:
        path.unlink()
    else:
        text = path.read_text()
        assert change(text) != text
        path.write_text(change(text))
    with pytest.raises(InputError, match=words):
        uq.read_point_poses(folder)


def test_figure(seen, tmp_path):
    from uq_handeye.model.points.figure import residual_figure

    figure = residual_figure(seen)
    assert "1 left out" in figure.alt and len(figure.axes) == 2
    drawn = sum(len(line.get_xdata()) for line in figure.axes[1].lines if line.get_marker() == ".")
    assert drawn == int(seen.used.sum())
    with pytest.raises(InputError, match=r"\.png or \.svg"):
        seen.figure(tmp_path / "residuals.pdf")
    across, along, _ = seen.split_residuals
    both = np.isfinite(along)
    np.testing.assert_allclose(
        np.sum(across[both] ** 2, axis=1) + along[both] ** 2, np.sum(seen.residuals[both] ** 2, axis=1)
    )


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        (0, "inf", None),  # poses with names are numbered
        (0, "9" * 400, None),
        (1, "\x1b[31m", "all of which print"),
        (1, "\u202ex", "all of which print"),
        (1, "p" * 300, "at most 200 characters"),
        (2, "1e300", "below 10000 m"),
    ],
)
def test_hostile_fields(tmp_path, column, value, words):
    rng = np.random.default_rng(0)
    rows = [[str(k), f"p{j}", *map(str, rng.normal((0, 0, 2)))] for k in range(3) for j in range(5)]
    rows[7][column] = value
    path = tmp_path / "points.csv"
    path.write_text("pose,point,x,y,z\n" + "".join(",".join(row) + "\n" for row in rows), encoding="utf-8")
    if words is None:
        assert len(uq.read_points(path).rows) == 4
    else:
        with pytest.raises(uq.InputError, match=words):
            uq.read_points(path)
