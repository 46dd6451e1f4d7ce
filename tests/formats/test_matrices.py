"""Poses written as matrices, in the forms of `fixtures.matrix_texts`: read to 1e-9, or refused by name."""

import numpy as np
import pytest
from fixtures.commands import run
from fixtures.matrix_texts import FORMS, FRANKA, R33, blocks, columns16, lines, names, rig_of, rows16, table, timed

from uq_handeye.errors import InputError
from uq_handeye.formats.matrices.text import is_matrix_text
from uq_handeye.read import read_poses

ROBOT, CAMERA = rig_of()
ANOTHER = {"16, times", "16 by columns, times", "12, times", "columns, times", "columns, blanks", "16, times last"}


@pytest.fixture(scope="module")
def camera(tmp_path_factory):
    path = tmp_path_factory.mktemp("camera") / "camera.npy"
    np.save(path, CAMERA)
    return path


def check(poses, atol=1e-9):
    np.testing.assert_allclose(poses.robot, ROBOT, rtol=0, atol=atol)
    np.testing.assert_allclose(poses.camera, CAMERA, rtol=0, atol=atol)


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_matrices_in_text(tmp_path, camera, form):
    path = tmp_path / "robot.txt"
    path.write_text(FORMS[form](ROBOT), encoding="utf-8")
    poses = read_poses(path, camera)
    check(poses)
    assert poses.sources[0].format == "matrix"
    assert (poses.timestamps is not None) == (form in ANOTHER)
    check(read_poses(path, camera, format=("matrix", None)))


@pytest.mark.slow
@pytest.mark.parametrize("form", FRANKA)
def test_franka(tmp_path, camera, form):
    path = tmp_path / "robot.csv"
    path.write_text(FRANKA[form](ROBOT), encoding="utf-8")
    poses = read_poses(path, camera)
    check(poses)
    assert poses.sources[0].format == "franka"


@pytest.mark.parametrize(("mark", "times"), [(",", False), (" ", False), (";", True)])
def test_numbers_of_franka_without_names(tmp_path, camera, mark, times):
    path = tmp_path / "robot.csv"
    numbers = timed(columns16(ROBOT)) if times else columns16(ROBOT)
    path.write_text("".join(mark.join(map(repr, map(float, row))) + "\n" for row in numbers), encoding="utf-8")
    poses = read_poses(path, camera, format=("franka", None))
    check(poses)
    assert poses.sources[0].format == "franka" and (poses.timestamps is not None) == times
    path.write_text("1,2,3\n4,5,6\n")
    with pytest.raises(InputError, match=r"expected the 16 numbers of O_T_EE in each line, got none \(docs/formats"):
        read_poses(path, camera, format=("franka", None))


HURT = blocks(ROBOT)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            lines(rows16(ROBOT))[:-40],
            r"line 30: expected 16 numbers as in the other lines, got 1\d\. Is the file cut off",
        ),
        (HURT[:-60], r"line 119: expected 4 numbers as in the other lines, got \d\. Is the file cut off"),
        (
            "\n".join(HURT.split("\n")[:-3]),
            r"got 118 lines; the last one has 2, line 117 and after\. Is the file cut off",
        ),
        (HURT.replace("1.0\n", "nan\n", 1), r"line 1: expected the matrix to be finite, got NaN"),
        (
            HURT.replace("0.0 0.0 0.0 1.0", "0.0 0.0 -- 1.0", 1),
            r"line 4: expected 4 numbers as in the other lines, got 2",
        ),
        (HURT.replace("0.0 0.0 0.0 1.0", "0.0 0.0 x 1.0", 1), r"line 4: expected numbers of a matrix, got 'x'"),
        (
            lines(rows16(ROBOT @ np.diag([1, -1, 1, 1]))),
            r"line 1: .*left-handed.*an axis is mirrored.*docs/formats\.md",
        ),
        (blocks(np.round(ROBOT, 3)), r"not orthogonal.*have 3 decimals, and need 6 or more"),
        ("T =\n\n   1.0e+03 *\n\n" + HURT, r"line 3: the numbers are printed with a common factor.*format long g"),
        (lines([range(2, 18)] * 5), r"line 1: expected a matrix 4x4 whose last row.*0, 0, 0, 1.*14, 15, 16, 17"),
        (lines([range(2, 14)] * 5), r"line 1: expected 12 numbers of a matrix 3x4.*no rotation"),
        (
            table([*R33, "tx", "ty", "tz"], [[*range(9), 7, 1, 2]]).replace("7.0,1.0,2.0", "x,1,2"),
            r"line 2, column tx: expected a number, got 'x'",
        ),
        (table(names("m{i}{j}"), [[1.0] * 15]), r"line 2: expected 16 fields as the names say, got 15"),
        (FRANKA["states"](ROBOT)[:100], r"line 1: expected the 16 numbers of O_T_EE, got"),
    ],
)
def test_texts_that_are_wrong(tmp_path, camera, text, message):
    path = tmp_path / "robot.txt"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        read_poses(path, camera)
    assert "\n" not in str(error.value)


@pytest.mark.slow
@pytest.mark.parametrize("format", ["matrix", "franka"])
def test_long_and_wild_texts_end_soon(tmp_path, camera, format):
    rng = np.random.default_rng(3)
    wild = [
        "1 " * 100_000,
        "[" * 100_000,
        "x" * 200_000,
        "O_T_EE: [" + "1," * 50_000,
        "f 0\n" * 20_000,
        "T = " * 50_000,
    ]
    wild += ["".join(map(chr, rng.integers(32, 126, 2000))) for _ in range(5)]
    for text in wild:
        (tmp_path / "wild.txt").write_text(text)
        with pytest.raises(InputError):
            read_poses(tmp_path / "wild.txt", camera, format=(format, None))


def test_what_belongs_to_other_readers(tmp_path):
    """Six, seven and eight numbers in a line, joint angles, robtargets and lists of YAML are not matrices."""
    rng = np.random.default_rng(5)
    for count in (1, 2, 5, 6, 7, 8, 9, 10, 11):
        assert not is_matrix_text(lines(rng.normal(size=(16, count))))
    robtarget = "[[600,0,700],[1,0,0,0],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]]\n"
    assert not is_matrix_text(robtarget * 3)
    assert not is_matrix_text("- effector_wrt_world: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n")


@pytest.mark.slow
def test_by_the_command_line(tmp_path, camera):
    """Millimetres without a unit are named with the option, and a transposed rotation too."""
    millimetres = ROBOT.copy()
    millimetres[:, :3, 3] *= 1000
    turned = ROBOT.copy()
    turned[:, :3, :3] = np.swapaxes(ROBOT[:, :3, :3], 1, 2)
    for poses, option in ((ROBOT, None), (millimetres, "--units robot=mm"), (turned, "--rotation robot=transposed")):
        (tmp_path / "robot.txt").write_text(lines(rows16(poses)))
        given = ["calibrate", tmp_path / "robot.txt", camera]
        outcome = run(*given)
        said = " ".join((outcome.stdout + outcome.stderr).split())
        assert (outcome.returncode in (None, 0)) == (option is None), said
        if option is not None:
            assert option in said
            assert run(*given, *option.split()).returncode in (None, 0)
