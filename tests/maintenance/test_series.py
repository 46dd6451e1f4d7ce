"""A log of checks: whole lines of one calibration, and a figure of the series."""

import numpy as np
import pytest
from fixtures.check_series import new_poses, plain_check, rig

import uq_handeye as uq
from uq_handeye.use.maintenance.log import COLUMNS, log_check, read_checks

SETUP = "eye-in-hand"


@pytest.fixture(scope="module")
def calibrated():
    return rig(SETUP)


@pytest.fixture
def log(calibrated, tmp_path):
    """A log of four checks, with the random numbers for more."""
    result, truth = calibrated
    rng = np.random.default_rng(5)
    path = tmp_path / "checks.csv"
    for k in range(4):
        poses = new_poses(truth, SETUP, 2, rng)
        log_check(path, result, poses, plain_check(result, poses), time=f"2026-03-0{k + 1}T08:00:00+00:00")
    return path, rng


def test_a_log_is_read_as_it_was_written(calibrated, tmp_path, rng):
    result, truth = calibrated
    path = tmp_path / "checks.csv"
    poses = new_poses(truth, SETUP, 3, rng)
    check = plain_check(result, poses, candidates=("X", "target"), status="changed")
    log_check(path, result, poses, check, time="2026-03-02T08:00")
    other = new_poses(truth, SETUP, 1, rng)
    log_check(path, result, other, plain_check(result, other))
    series = read_checks(path, result)
    first, second = series.checks
    assert (first.time, first.cause, first.answer) == ("2026-03-02T08:00", "X or target", "changed")
    assert (first.d2, first.dof, first.n_poses) == (pytest.approx(check.d2), 18, 3) and second.n_poses == 1
    np.testing.assert_allclose(first.shift, check.moves[0].estimate, rtol=1e-9)
    np.testing.assert_allclose(first.shift_std, check.moves[0].std, rtol=1e-9)
    assert second.time.endswith("+00:00")
    lines = path.read_text().splitlines()
    assert lines[0].startswith("time,poses,d2,dof,p_value,answer,cause,X_x_mm") and len(lines) == 3


def test_damaged_lines_are_skipped_and_named(calibrated, log):
    result, truth = calibrated
    path, rng = log
    lines = path.read_text().splitlines()
    lines[2] = lines[2][: len(lines[2]) // 2]  # cut
    lines[3] = lines[3].replace(",unchanged,", ",,", 1)
    path.write_text("\n".join([*lines, "\0\0\0", ""]))
    series = read_checks(path, result)
    assert len(series) == 2
    assert [number for number, _ in series.damaged] == [3, 4, 6]
    assert "Line 3 of the log was skipped" in series.sentences[0]
    poses = new_poses(truth, SETUP, 2, rng)
    longer = log_check(path, result, poses, plain_check(result, poses))
    assert len(longer) == 3 and len(read_checks(path).damaged) == 3  # nothing is lost
    path.write_text(path.read_text().rstrip("\n"))  # the last line without its end
    assert len(read_checks(path)) == 3


def test_refusals(calibrated, log, tmp_path):
    result, truth = calibrated
    path, rng = log
    poses = new_poses(truth, SETUP, 2, rng)
    check = plain_check(result, poses)
    log_check(path, result, poses, check)
    before = path.read_bytes()
    other, _ = rig(SETUP, 8)
    assert other.digest != result.digest
    with pytest.raises(uq.InputError, match="log of another calibration"):
        log_check(path, other, poses, check)
    with pytest.raises(uq.InputError, match="log of another calibration"):
        read_checks(path, other)
    with pytest.raises(uq.InputError, match="logged as check 5"):
        log_check(path, result, poses, check)
    with pytest.raises(uq.InputError, match="Expected a time such as"):
        log_check(path, result, poses, check, time="yesterday")
    table = tmp_path / "robot.csv"
    table.write_text("timestamp,x,y,z\n1,2,3,4\n")
    with pytest.raises(uq.InputError, match="expected a log of checks"):
        log_check(table, result, poses, check)
    assert path.read_bytes() == before and len(table.read_text()) == 24
    with pytest.raises(uq.InputError, match="no such file"):
        read_checks(tmp_path / "none.csv")


def test_wrong_poses_are_named_as_the_cause(calibrated, log):
    result, truth = calibrated
    path, rng = log
    poses = new_poses(truth, SETUP, 3, rng, shift=0.1)
    found = uq.findings.Finding("maintenance.one_pose_wrong", "caution", {"row": 1, "n": 3})
    series = log_check(path, result, poses, plain_check(result, poses, findings=(found,), status="cannot tell"))
    assert len(series) == 5 and series.checks[-1].cause == "one pose wrong"


@pytest.mark.slow
def test_the_figure_shows_every_check(calibrated, log):
    from uq_handeye.use.maintenance.series_figure import series_figure

    result, _ = calibrated
    path, _ = log
    moved, turned = series_figure(read_checks(path, result)).axes
    assert len(moved.lines[1].get_xdata()) == 4
    assert "translation" in moved.get_ylabel() and "rotation" in turned.get_ylabel()


def test_the_columns_are_described():
    assert len(COLUMNS) == len(set(COLUMNS)) == 7 + 12 + 1


@pytest.mark.slow
def test_check_log_adds_a_line_and_draws_the_series(calibrated, tmp_path, capsys):
    from uq_handeye.cli.app import main
    from uq_handeye.read import write_pose_file

    result, truth = calibrated
    rng = np.random.default_rng(9)
    path, stored, out = tmp_path / "checks.csv", tmp_path / "result.json", tmp_path / "out"
    stored.write_text(result.to_json(), encoding="utf-8")

    def check(shift, *more):
        poses = new_poses(truth, SETUP, 3, rng, shift)
        files = [tmp_path / "robot.csv", tmp_path / "camera.csv"]
        for file, T in zip(files, (poses.robot, poses.camera), strict=True):
            write_pose_file(file, T)
        with pytest.raises(SystemExit) as ended:
            main(["check", str(stored), *map(str, files), "--log", str(path), *more])
        return ended.value.code, capsys.readouterr()

    status, said = check(0.0)
    assert status == 0 and "Check 1 of the log" in said.out
    status, said = check(np.array([0, 0, 0, 0.05, 0, 0]), "--json", "-o", str(out))
    assert status == 4 and '"status": "changed"' in said.out
    assert {file.name for file in out.iterdir()} == {"check.json", "check.txt", "series.png", "series.svg"}
    assert [check.answer for check in read_checks(path, result).checks] == ["unchanged", "changed"]
