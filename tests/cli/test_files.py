"""``report``, ``export``, ``sync``, ``-o`` and ``--report``: the files, and what they hold."""

import json
import re
import warnings
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from fixtures.commands import MODEL, NOISE, run, write_session

import uq_handeye as uq
from uq_handeye.cli.delivery import FIGURES
from uq_handeye.core.files.packed import unpacked
from uq_handeye.read import write_pose_file
from uq_handeye.report.figures import figures
from uq_handeye.report.files import EXPORTS


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Pose files, and a result.json of calibrate."""
    folder = tmp_path_factory.mktemp("session")
    write_session(folder)
    done = run("calibrate", "robot.csv", "camera.csv", *NOISE, "--json", cwd=folder)
    (folder / "result.json").write_text(done.stdout)
    return folder


@pytest.fixture
def asked(monkeypatch):
    """Record what a report is asked for, instead of the report, which takes seconds."""
    found = []

    def report(self, path, *, comparison=True, cross_check=None, **_):
        found.append((self, path, comparison, cross_check))
        return path

    monkeypatch.setattr(uq.Calibration, "report", report)
    return found


# ------------------------------------------------------------------------------------------------------ report


@pytest.mark.slow
def test_report_of_calibrate(session, tmp_path):
    """One real report: the command line as typed, the numbers of the result, no comparison where none is wanted."""
    done = run(
        "calibrate", "robot.csv", "camera.csv", *NOISE, "--report", tmp_path / "r.html", "--no-compare", cwd=session
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("gripper_T_camera from robot.csv, camera.csv: 12 poses, eye-in-hand, efficient\n")
    assert f"Wrote {tmp_path}/r.html." in done.stdout.replace("\n  ", " ").replace("\n", "")
    html = unescape((tmp_path / "r.html").read_text(encoding="utf-8"))
    typed = f"uq-handeye calibrate robot.csv camera.csv {' '.join(NOISE)} --report {tmp_path}/r.html --no-compare"
    assert typed in html and "gripper_T_camera" in html


@pytest.mark.slow
def test_what_goes_into_the_report(session, tmp_path, asked):
    files = ("robot.csv", "camera.csv", *NOISE, "--report", tmp_path / "r.html")
    run("calibrate", *files, cwd=session)
    run("calibrate", *files, "--no-compare", cwd=session)
    run("demo", "--report", tmp_path / "demo.html")
    for (result, path, comparison, check), name, wanted in zip(
        asked, ("r.html", "r.html", "demo.html"), (True, False, True), strict=True
    ):
        assert (path, comparison is not False, check) == (tmp_path / name, wanted, None)
        if wanted:  # compared before, and handed over
            assert comparison.comparison.reference == "efficient (this result)"
        assert result.provenance.command.startswith("uq-handeye ")


@pytest.mark.slow
def test_the_title_block_goes_into_the_result_and_the_report(session, tmp_path, asked):
    (tmp_path / "cell.toml").write_text('cell = "B7"\noperator = "J. Doe"\n', encoding="utf-8")
    about = ("--about", tmp_path / "cell.toml", "--about", "operator=M. Roe")
    done = run("calibrate", "robot.csv", "camera.csv", *NOISE, *about, "--report", tmp_path / "r.pdf", cwd=session)
    assert done.returncode == 0 and asked[0][0].about == {"cell": "B7", "operator": "M. Roe"}
    assert asked[0][2] is True  # two pages show no comparison, and none was made
    for wrong in ("colour=red", "cell.tml", ""):
        done = run("report", "result.json", tmp_path / "r.pdf", "--about", wrong, cwd=session)
        assert done.returncode == 2 and done.stderr.count("\n") == 1


@pytest.mark.slow
def test_the_comparison_of_the_report_is_a_figure_of_the_folder(session, tmp_path, asked):
    files = ("robot.csv", "camera.csv", *NOISE, "-o", tmp_path / "out", "--figures")
    for more in (("--report", tmp_path / "r.html"), ()):
        assert run("calibrate", *files, *more, cwd=session).returncode == 0
        names = {file.name for file in (tmp_path / "out").iterdir()}
        assert {"methods.png", "methods.svg"} & names == ({"methods.png", "methods.svg"} if more else set())
    ((_, _, found, _),) = asked
    assert found.comparison.reference == "efficient (this result)"


@pytest.mark.slow
def test_cross_check_in_the_report(session, tmp_path, asked, monkeypatch):
    from uq_handeye.trials.validation.cross_check import run as module

    ordinary = module.cross_check
    few = {"trials": 200, "posterior": False, "workers": 1}
    monkeypatch.setattr(module, "cross_check", lambda *args, **options: ordinary(*args, **(options | few)))
    files = ("robot.csv", "camera.csv", *NOISE, "--seed", 4, "--report", tmp_path / "r.html")
    assert run("calibrate", *files, "--with-cross-check", cwd=session).returncode == 0
    assert run("cross-check", *files, cwd=session).returncode == 0
    for result, _, _, check in asked:
        assert (check.trials, check.seed, result.n_poses) == (200, 4, 12)
        assert result.provenance.command.endswith(("r.html", "--with-cross-check"))


@pytest.mark.slow
def test_report_of_a_stored_result(session, tmp_path, asked):
    done = run("report", "result.json", tmp_path / "again.html", cwd=session)
    said = "".join(done.stdout.split())  # long paths are broken where the line ends
    assert done.returncode == 0 and f"Wrote{tmp_path}/again.html" in said
    ((result, path, comparison, check),) = asked
    assert done.stdout.startswith(result.headline[:60]) and done.stdout.count("\n") <= 5
    assert run("report", "result.json", cwd=session).stdout.startswith(result.summary()[:-1])
    assert (path, comparison, check) == (tmp_path / "again.html", True, None)
    assert result.to_json() == (session / "result.json").read_text()
    run("report", "result.json", tmp_path / "again.html", "--no-compare", cwd=session)
    assert asked[1][2] is False


@pytest.mark.slow
def test_report_of_a_stored_result_is_that_of_calibrate(session, tmp_path):
    """But for date and command line, which are those of calibrate in both."""
    files = ("robot.csv", "camera.csv", *NOISE, "--report", tmp_path / "r.html", "--no-compare")
    (tmp_path / "result.json").write_text(run("calibrate", *files, "--json", cwd=session).stdout)
    done = run("report", tmp_path / "result.json", tmp_path / "again.html", "--no-compare", cwd=session)
    assert done.returncode == 0
    one, other = (
        re.sub(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC", "date", (tmp_path / name).read_text(encoding="utf-8"))
        for name in ("r.html", "again.html")
    )
    assert one == other


# ------------------------------------------------------------------------------------------------ export and -o


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("x.json", ()),
        ("x.urdf", ()),
        ("x.npz", ()),
        ("x.yaml", ("--format", "opencv")),
        ("x.yaml", ("--format", "ROS")),
    ],
)
def test_export_writes_what_the_function_writes(session, tmp_path, name, options):
    done = run("export", "result.json", tmp_path / name, *options, cwd=session)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"Wrote {tmp_path / name}\n", "")
    result = uq.Calibration.from_json(session / "result.json")
    format = options[1].lower() if options else None
    expected = result.export(tmp_path / f"expected{name[1:]}", format).read_bytes()
    if name != "x.npz":  # a zip file, which holds times
        assert (tmp_path / name).read_bytes() == expected
    else:
        with np.load(tmp_path / name) as file:
            np.testing.assert_array_equal(file[next(key for key in file if file[key].shape == (4, 4))].shape, (4, 4))


def test_a_result_that_is_not_usable_is_not_exported(tmp_path):
    poses = uq.simulate(15, noise=MODEL, seed=3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        result = uq.calibrate(replace(poses, camera=poses.camera[::-1]), noise=MODEL, shared=[])
    assert not result.usable
    result.to_json(tmp_path / "result.json")
    done = run("export", "result.json", "x.urdf", cwd=tmp_path)
    assert done.returncode == 3 and done.stdout == ""
    assert done.stderr.startswith("uq-handeye: error: result.json is NOT USABLE, so nothing was exported: ")
    assert len(done.stderr.splitlines()) == 1 and not (tmp_path / "x.urdf").exists()


@pytest.mark.slow
def test_known_figures_and_exports(session):
    """Files that an earlier run may have left in -o DIR are known by name."""
    result = uq.calibrate(uq.read_poses(session / "robot.csv", session / "camera.csv"), noise=MODEL)
    assert set(figures(result)) <= set(FIGURES)
    assert set(EXPORTS) == {"ros", "urdf", "opencv", "npz"}


# -------------------------------------------------------------------------------------------------------- sync


@pytest.fixture(scope="module")
def streams(tmp_path_factory):
    """A robot at 50 Hz and a camera at 20 Hz whose clock is 0.03 s behind, both moving smoothly."""
    from support import rotations, transforms

    def robot(t):
        phase = t[:, None] * np.array([0.9, 0.7, 0.5]) * 2
        R = rotations(0.8 * np.sin(phase + np.array([0.0, 1.0, 2.0])))
        return transforms(R, 0.3 * np.cos(phase * 0.8 + np.array([0.5, 0.0, 1.5])))

    folder = tmp_path_factory.mktemp("streams")
    rng = np.random.default_rng(7)
    X = transforms(rotations(np.array([0.1, -0.2, 1.5])), np.array([0.03, -0.07, 0.05]))
    W = transforms(rotations(np.array([0.3, 0.2, -0.4])), np.array([0.6, 0.1, 0.2]))
    of_robot, of_camera = np.arange(0.0, 20.0, 0.02), np.arange(0.5, 19.5, 0.05)
    G = robot(of_robot)
    C = np.linalg.inv(X) @ np.linalg.inv(robot(of_camera)) @ W
    C[:, :3, :3] = rotations(1e-3 * rng.normal(size=(len(C), 3))) @ C[:, :3, :3]
    C[:, :3, 3] += 5e-4 * rng.normal(size=(len(C), 3))
    write_pose_file(folder / "robot.csv", G, timestamps=of_robot)
    write_pose_file(folder / "camera.csv", C, timestamps=of_camera - 0.03)
    return folder


@pytest.mark.slow
def test_sync_finds_the_offset_and_writes_pairs(streams, tmp_path):
    done = run("sync", "robot.csv", "camera.csv", "-o", tmp_path / "paired", cwd=streams)
    assert done.returncode == 0 and "offset" in done.stdout
    names = sorted(file.name for file in (tmp_path / "paired").iterdir())
    assert names == ["camera.csv", "robot.csv", "sync.json", "sync.png", "sync.svg"]
    data = json.loads((tmp_path / "paired" / "sync.json").read_text())
    assert abs(data["offset"] - 0.03) < 4 * data["offset_std"] < 0.01
    poses = uq.read_poses(tmp_path / "paired" / "robot.csv", tmp_path / "paired" / "camera.csv")
    assert poses.n == data["n_poses"]
    assert json.loads(run("sync", "robot.csv", "camera.csv", "--json", cwd=streams).stdout) == data


@pytest.mark.slow
def test_calibrate_pairs_streams(streams):
    command = ("calibrate", "robot.csv", "camera.csv", "--pair", "async", "--json", "--no-robust")
    estimated, given = run(*command, cwd=streams), run(*command, "--offset", "0.03", cwd=streams)
    assert estimated.returncode == given.returncode == 0
    assert re.search(r"uq-handeye: note: The clocks differ by (30|29)\.\d+\(\d+\) ms", estimated.stderr)
    assert "uq-handeye: note: The clocks differ by 30 ms, as given" in given.stderr
    X, exact = (json.loads(done.stdout) for done in (estimated, given))
    assert abs(np.array(X["X"])[:3, 3] - [0.03, -0.07, 0.05]).max() < 2e-3
    assert max(X["std"][3:]) > max(exact["std"][3:])  # the uncertainty of the offset is in that of X


@pytest.mark.slow
def test_interpolated_poses_are_less_noisy_than_the_samples(streams):
    noise = ("--robot-noise", "1mrad,0.5mm", "--camera-noise", "1mrad,1mm")
    done = run("calibrate", "robot.csv", "camera.csv", "--pair", "async", "--json", "--no-robust", *noise, cwd=streams)
    of_pairs = unpacked(json.loads(done.stdout))["noise"]
    robot, camera = (np.array(of_pairs[side])[..., 0, 0] for side in ("robot", "camera"))
    assert 0.4e-6 < robot.mean() < 0.9e-6 and robot.max() < 1.001e-6
    np.testing.assert_allclose(camera, 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (("--offset", "a"), ["--offset"]),
        (("--max-gap", "-1"), ["max_gap"]),
        (("--setup", "eye"), ["setup", "eye-in-hand"]),
        (("--pair", "rows"), ["--pair"]),
        (("-o", "robot.csv"), ["expected a folder"]),
    ],
    ids=str,
)
def test_bad_usage_of_sync(streams, options, parts):
    done = run("sync", "robot.csv", "camera.csv", *options, cwd=streams)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    for part in parts:
        assert part in done.stderr
