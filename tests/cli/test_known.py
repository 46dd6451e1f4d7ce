"""Priors of X and W on the command line, and robots that leave a part of X open."""

import json

import numpy as np
import pytest
from fixtures.few_axes import rig
from support import SEED

from uq_handeye.read import write_pose_file


@pytest.fixture
def files(tmp_path):
    data = rig("scara", 15, np.random.default_rng([SEED, 33]))
    names = [str(tmp_path / name) for name in ("robot.csv", "camera.csv")]
    for name, poses in zip(names, (data.robot, data.camera), strict=True):
        write_pose_file(name, poses)
    return [*names, "--robot-noise", "0.02deg,0.05mm", "--camera-noise", "0.1deg,0.5mm"], data.truth


def run(arguments, capsys, command="calibrate"):
    from uq_handeye.cli.app import main

    with pytest.raises(SystemExit) as ended:
        main([command, *arguments])
    return ended.value.code, capsys.readouterr()


@pytest.mark.slow
def test_what_is_open_is_said_and_a_known_length_closes_it(files, capsys, tmp_path):
    arguments, truth = files
    code, printed = run(arguments, capsys)
    assert code == 6 and "Not determined: the camera along the gripper's z axis" in " ".join(printed.out.split())
    height = truth.W[2, 3]
    code, printed = run([*arguments, "--known", f"target z = {1e3 * height:.6f}mm +- 1mm", "--json"], capsys)
    result = json.loads(printed.out)
    assert "open" not in result and result["noise"]["prior"]["W"]["information"][5][5] == pytest.approx(1e6)
    (tmp_path / "x.json").write_text(printed.out)
    code, printed = run([*arguments, "--prior-x", str(tmp_path / "x.json"), "--json"], capsys)
    assert json.loads(printed.out)["std"][5] < result["std"][5]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "options"),
    [
        ("validate", ["--trials", "50"]),
        ("validate", ["--trials", "50", "--method", "4dpa"]),
        ("validate", ["--trials", "50", "--covariance", "each"]),
        ("cross-check", ["--trials", "100"]),
        ("posterior", []),
    ],
)
def test_what_tests_a_covariance_asks_for_a_prior_where_a_part_is_open(command, options, files, capsys):
    code, printed = run([*files[0], *options], capsys, command)
    assert code == 2 and printed.out == ""
    errors = [line for line in printed.err.splitlines() if "error:" in line]
    assert len(errors) == 1 and "leave a part of X open" in errors[0] and "--known, --prior-x" in errors[0]


@pytest.mark.slow
def test_a_known_length_lets_the_covariance_be_tested(files, capsys):
    arguments, truth = files
    known = ["--known", f"target z = {1e3 * truth.W[2, 3]:.6f}mm +- 1mm", "--trials", "300", "--json"]
    code, printed = run([*arguments, *known], capsys, "validate")
    assert code in (0, None)
    tested = json.loads(printed.out)
    assert tested["consistent"] is True


def test_statements_that_are_none_are_one_line(files, capsys):
    arguments, _ = files
    code, printed = run([*arguments, "--known", "target z = 120 +- 1mm"], capsys)
    assert code == 2 and "unit" in printed.err
