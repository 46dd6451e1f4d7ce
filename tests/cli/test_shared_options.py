"""Shared errors on the command line and in the noise file: what is taken, what is refused."""

import json

import numpy as np
import pytest
from fixtures.commands import MODEL, NOISE, run
from fixtures.streams import motion, streams

import uq_handeye as uq
from uq_handeye.read import write_pose_file

BOTH = ("robot.csv", "camera.csv")
VIEWS = ("--board", "9x6", "--square", "20mm", "--camera-matrix", "1000,1000,640,480")
OF_VIEWS = {"lens distortion (5)": "0.00015 to 0.009", "target outline (12)": 0.3, "view (36)": 1.5e-4}
DEFAULTS = {"focal length": 1e-3, "principal point x": 1e-3, "principal point y": 1e-3, "target scale": 3e-4} | OF_VIEWS
ASSUMED = {"robot accuracy": "0.6 mm"}  # where the noise of the robot is estimated, too
ALL = DEFAULTS | ASSUMED


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("session")
    poses = uq.simulate(12, noise=MODEL, seed=4)
    write_pose_file(folder / "robot.csv", poses.robot, poses.timestamps)
    write_pose_file(folder / "camera.csv", poses.camera, poses.timestamps)
    np.savez(folder / "bend.npz", F=np.ones((12, 6, 1)))
    np.save(folder / "two.npy", np.ones((12, 6, 2)))
    np.savetxt(folder / "bend.csv", np.arange(12 * 12.0).reshape(12, 12), delimiter=",", header="theta, tau")
    (folder / "shared.toml").write_text('[shared]\nfocal_length = "0.5%"\nprincipal_point = "none"\n')
    return folder


def sds(folder, *options):
    """Standard deviations that a calibration records, by name."""
    found = run("calibrate", *BOTH, "--json", *options, cwd=folder)
    assert found.returncode in (None, 0), found.stderr
    lines = json.loads(found.stdout)["provenance"]["options"]["shared"]
    return {name: sd if " " in sd or sd == "exact" else float(sd) for name, sd in (line.split(": ") for line in lines)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ([], ALL),
        (["--shared", "defaults"], ALL),
        (["--shared", "none"], {}),
        (["--shared", "focal length=0.3%"], ALL | {"focal length": 3e-3}),
        (["--shared", "focal length=none"], ALL | {"focal length": 0.0}),
        (
            ["--shared", "principal point=0.002", "--shared", "robot scale=0.01%"],
            ALL | {"principal point x": 2e-3, "principal point y": 2e-3, "robot scale": 1e-4},
        ),
        (["--target-scale-sd", "exact"], ALL | {"target scale": 0.0}),
        (["--shared", "none", "--shared", "focal length=0.1%"], {"focal length": 1e-3}),
        (["--noise", "shared.toml"], ALL | {"focal length": 5e-3, "principal point x": 0, "principal point y": 0}),
        (["--noise", "shared.toml", "--shared", "focal length=0.2%", "--shared", "none"],
         {"focal length": 2e-3, "principal point x": 0, "principal point y": 0}),
        (["--robot-accuracy", "0.5mm,0.05deg"], DEFAULTS | {"robot accuracy": "0.5 mm, 0.05 deg"}),
        (["--robot-accuracy", "0.05deg, 0.5mm"], DEFAULTS | {"robot accuracy": "0.5 mm, 0.05 deg"}),
        (["--robot-accuracy", "exact"], DEFAULTS | {"robot accuracy": "exact"}),
        (["--robot-class", "cobot"], DEFAULTS | {"robot accuracy": "2 mm"}),
        ([*NOISE, "--robot-class", "calibrated"], {"robot accuracy": "0.15 mm"}),
        (NOISE, {}),
        ([*NOISE, "--shared", "focal length=0.3%"], {"focal length": 3e-3}),
        ([*NOISE, "--noise", "shared.toml"], {"focal length": 5e-3, "principal point x": 0, "principal point y": 0}),
        ([*NOISE[:2], "--shared", "focal length=0.3%"], DEFAULTS | {"focal length": 3e-3}),
        (
            [*VIEWS, "--shared", "principal point=2px"],
            {"target scale": 3e-4, "principal point x": 2e-3, "principal point y": 2e-3} | ASSUMED,
        ),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list | tuple) else "",
)  # fmt: skip
def test_which_apply(folder, options, expected):
    assert sds(folder, *options) == expected


def test_they_are_in_the_covariance(folder):
    poses = uq.read_poses(folder / "robot.csv", folder / "camera.csv")
    found = json.loads(run("calibrate", *BOTH, *NOISE, "--shared", "focal length=1%", "--json", cwd=folder).stdout)
    expected = uq.calibrate(poses, noise=MODEL, shared=[uq.SharedError.focal_length("1%")])
    np.testing.assert_allclose(found["covariance"], expected.covariance, rtol=1e-10)
    assert np.trace(expected.covariance) > 1.1 * np.trace(uq.calibrate(poses, noise=MODEL).covariance)


@pytest.mark.slow
@pytest.mark.parametrize("given", [NOISE, NOISE[:2], ()], ids=["noise", "one side", "none"])
@pytest.mark.parametrize(
    ("command", "more", "key"),
    [
        ("validate", ("--trials", "200", "--workers", "1"), "predicted"),
        ("compare", ("--methods", "efficient,park"), "rows"),
        ("plan", ("-k", "1", "--sample", "20"), "before"),
    ],
)
def test_they_reach_the_other_commands(folder, command, more, key, given):
    """Counted once, also where the noise of one side is estimated first."""

    def deviations(*options):
        found = run(command, *BOTH, *given, *more, *options, "--json", cwd=folder)
        assert found.returncode in (None, 0), found.stderr
        return found.stdout

    assert deviations("--shared", "none") != deviations("--shared", "none", "--shared", "focal length=3%")
    once = json.loads(
        run("calibrate", *BOTH, *given, "--shared", "none", "--shared", "focal length=3%", "--json", cwd=folder).stdout
    )
    found = json.loads(deviations("--shared", "none", "--shared", "focal length=3%"))
    if command == "plan":
        np.testing.assert_allclose(found["before"]["std"], np.sqrt(np.diag(once["covariance"])), rtol=1e-3)
    if command == "compare":
        row = next(row for row in found["methods"] if row["method"] == "efficient")
        # the noise of one side is estimated first, and then counts with its sizes as they were found
        expected = once["bound" if given == NOISE[:2] else "covariance"]
        np.testing.assert_allclose(row["covariance"], expected, rtol=1e-3, atol=1e-11)


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        (["--shared", "focal length=0.1"], ["--shared 'focal length=0.1'", "unit", "%", "'0.1'"]),
        (["--shared", "focal length=-1%"], ["--shared 'focal length=-1%'", ">= 0", "-1%"]),
        (["--shared", "focal length=nan%"], ["--shared", "nan%"]),
        (["--target-scale-sd", "1mm"], ["--target-scale-sd", "mm"]),
        (["--shared", "robot scale=much"], ["--shared", "'much'"]),
        (["--shared", "principal point=1px"], ["--shared", "focal length in pixels"]),
        (["--shared", "clock offset=1"], ["--shared", "unit", "ms"]),
        (["--robot-accuracy", "0.5mm,0.05deg,1"], ["--robot-accuracy", "0.5mm,0.05deg", "'0.5mm,0.05deg,1'"]),
        (["--robot-accuracy", "0.5,0.05deg"], ["--robot-accuracy", "unit", "mm"]),
        (["--robot-accuracy", "-1mm,0.05deg"], ["--robot-accuracy", ">= 0"]),
        (["--shared", "some"], ["--shared", "defaults, none", "'some'"]),
        (["--shared", "focal=1%"], ["--shared", "focal length, principal point", "'focal'"]),
        (["--shared", "focal length=1%", "--shared", "focal length=2%"], ["--shared", "focal length once"]),
        (["--shared", "target scale=1%", "--target-scale-sd", "2%"], ["--target-scale-sd both declare"]),
        (["--size", "robot accuracy"], ["--size", "NAME=SIZE", "'robot accuracy'"]),
        (["--size", "robot acuracy=0.3mm"], ["--size", "'robot acuracy'", "Near it: robot accuracy"]),
        (["--size", "robot accuracy=0.3"], ["--size", "robot accuracy", "unit"]),
        (["--size", "view=1%", "--size", "view=2%"], ["--size", "two of one name"]),
        (["--size", "robot accuracy=0.3mm,x"], ["--size", "factor", "'x'"]),
        (["--size", "robot accuracy=0.3mm,0.5"], ["--size", "factor", "0.5"]),
        (["--size", "robot accuracy=0mm"], ["'robot accuracy'", "above 0"]),
        (["--size", "pixel noise=0.2px"], ["'pixel noise'"]),  # of no error of these poses
        ([*NOISE, "--size", "robot accuracy=0.3mm"], ["nothing is estimated"]),
        (["--pair", "async", "--offset", "0,0.001", "--shared", "clock offset=1ms"], ["twice", "--shared"]),
    ],
    ids=lambda value: " ".join(value),
)
def test_bad_options(folder, options, parts):
    found = run("calibrate", *BOTH, *options, cwd=folder)
    assert (found.returncode, found.stdout, found.stderr.count("\n")) == (2, "", 1)
    for part in parts:
        assert part in found.stderr


@pytest.mark.slow
def test_sizes_by_name(folder):
    """A size takes the place of that of the table: exact, or the median within a factor."""

    def sized(*texts):
        options = [part for text in texts for part in ("--size", text)]
        found = json.loads(run("calibrate", *BOTH, *options, "--json", cwd=folder).stdout)
        of_model = {part["name"]: part for part in found["noise_estimate"]["of_model"]}
        return found["provenance"]["options"].get("sizes"), of_model

    given, found = sized("robot accuracy=0.3mm,2", "target scale = 0.01%")
    assert given == {"robot accuracy": [3e-4, 2.0], "target scale": [pytest.approx(1e-4), 1.0]}
    known = found["target scale"]
    assert known["low"] == known["high"] and known["size"] == pytest.approx(1e-4)
    robot = found["robot accuracy"]
    assert robot["low"] < robot["high"] and 3e-5 < robot["size"] < 3e-3
    more = sized("robot accuracy=3mm,1.2")[1]["robot accuracy"]["size"]
    assert more > 2 * robot["size"] and sized()[0] is None


def test_offset_needs_times(folder):
    untimed = folder / "untimed.npz"
    poses = uq.read_poses(folder / "robot.csv", folder / "camera.csv")
    np.savez(untimed, robot=poses.robot, camera=poses.camera)
    found = run("calibrate", untimed, *NOISE, "--shared", "clock offset=1ms")
    assert found.returncode == 2 and "timestamps" in found.stderr
    assert run("calibrate", untimed, *NOISE, "--shared", "clock offset=none").returncode in (None, 0)


@pytest.mark.slow
@pytest.mark.parametrize(("sd", "expected"), [("20ms", 0.02), ("exact", 0.0)])
def test_offset_of_streams_takes_the_place_of_the_one_estimated(tmp_path, rng, sd, expected):
    *_, robot, camera = streams(rng, motion(rng, 6.0), 0.02, 6.0)
    for name, stream in (("robot.csv", robot), ("camera.csv", camera)):
        write_pose_file(tmp_path / name, stream.poses, stream.timestamps)
    found = run("calibrate", *BOTH, "--pair", "async", *NOISE, "--shared", f"clock offset={sd}", "--json", cwd=tmp_path)
    result = json.loads(found.stdout)
    assert result["time_offset"]["std"] == expected and result["shared"] == []


def test_noise_on_motions_has_no_shared_errors(folder):
    (folder / "motions.toml").write_text(
        '[A]\nrotation = "0.1deg"\ntranslation = "1mm"\n[shared]\nrobot_scale = "1%"\n'
    )
    found = run("validate", *BOTH, "--noise", "motions.toml", cwd=folder)
    assert found.returncode == 2 and "noise of motions" in found.stderr


def test_simulate_draws_none(folder):
    found = run("simulate", "-o", folder / "sim", "--noise", folder / "shared.toml")
    assert found.returncode == 2 and "Remove [shared] from" in found.stderr


# ------------------------------------------------------------------------------------------------------ the file


def test_the_table(folder):
    (folder / "all.toml").write_text(
        '[robot]\nrotation = "0.02deg"\ntranslation = "0.05mm"\n'
        '[shared]\nfocal_length = "0.1%"\nprincipal_point = "1px"\ntarget_scale = "exact"\nrobot_scale = 1e-4\n'
        'clock_offset = "1ms"\nrobot_accuracy = "0.5mm,0.05deg"\n'
        '[[shared.columns]]\nname = "bend"\nfile = "bend.npz"\nsd = 5e-5\nside = "robot"\nunit = "K"\n'
        '[[shared.columns]]\nname = "two"\nfile = "two.npy"\nsd = [1e-5, 2e-5]\nside = "camera"\n'
        '[[shared.columns]]\nname = "table"\nfile = "bend.csv"\nsd = 1e-7\nside = "robot"\n'
    )
    errors = uq.read_shared_errors(folder / "all.toml", focal_length_px=500.0)
    assert [(error.name, *error.sd.tolist()) for error in errors] == [
        ("focal length", 1e-3),
        ("principal point", 2e-3, 2e-3),
        ("target scale", 0.0),
        ("robot scale", 1e-4),
        ("clock offset", 1e-3),
        ("robot accuracy", 1.0),
        ("bend", 5e-5),
        ("two", 1e-5, 2e-5),
        ("table", 1e-7, 1e-7),
    ]
    assert errors[6].unit == "K" and errors[7].side == "camera"
    poses = uq.simulate(12, noise=MODEL, seed=4)
    assert errors[6].at(poses).shape == (12, 6, 1) and errors[7].at(poses).shape == (12, 6, 2)
    np.testing.assert_array_equal(errors[8].at(poses)[1], np.arange(12, 24.0).reshape(2, 6).T)
    assert isinstance(uq.read_noise_file(folder / "all.toml"), uq.PoseNoise)
    assert uq.read_noise_file(folder / "shared.toml") is None
    result = uq.calibrate(poses, noise=MODEL, shared=errors)
    assert "two: 2" in [entry.name for entry in result.shared]


def columns(**changes):
    entry = {"name": '"a"', "file": '"bend.npz"', "sd": "1", "side": '"robot"'} | changes
    return "[[shared.columns]]\n" + "".join(f"{key} = {value}\n" for key, value in entry.items() if value)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("shared = 3\n", ["[shared]", "must be a table", "'3'"]),
        ('[shared]\nfocus = "1%"\n', ["[shared]", "unknown key 'focus'", "focal_length"]),
        ('[shared]\nfocal_length = "0.1"\n', ["[shared]", "focal length", "unit"]),
        ("[shared]\nfocal_length = nan\n", ["[shared]", "focal length", "finite"]),
        ('[shared]\ntarget_scale = "-1%"\n', ["[shared]", "target scale", ">= 0"]),
        ("[shared]\nrobot_scale = true\n", ["[shared]", "robot scale", "True"]),
        ("[shared]\nrobot_scale = [1]\n", ["[shared]", "robot scale", "[1]"]),
        ('[shared]\nprincipal_point = "1px"\n', ["[shared]", "principal point", "focal length in pixels"]),
        ('[shared]\nrobot_accuracy = "0.5"\n', ["[shared]", "robot accuracy", "unit", "'0.5'"]),
        ("[shared]\ncolumns = 3\n", ["[shared]", "[[shared.columns]]"]),
        (columns(nme='"b"'), ["[shared]", "unknown key 'nme'"]),
        (columns(sd=""), ["[shared]", "sd", "missing"]),
        (columns(file="3"), ["[shared]", "file", "'3'"]),
        (columns(file='"no.npy"'), ["[shared]", "no.npy", "no such file"]),
        (columns(file='"robot.csv"'), ["[shared]", "robot.csv", "rows of 6 k numbers"]),
        (columns(file='"shared.toml"'), ["[shared]", "shared.toml", "rows of 6 k numbers"]),
        (columns(sd="-1"), ["[shared]", ">= 0"]),
        (columns(side='"left"'), ["[shared]", "robot or camera", "'left'"]),
        (columns(name='"focal length"'), ["[shared]", "another `name`"]),
    ],
)
def test_bad_tables(folder, text, parts):
    (folder / "bad.toml").write_text(text)
    with pytest.raises(uq.InputError) as caught:
        uq.read_shared_errors(folder / "bad.toml")
    assert "\n" not in str(caught.value) and "bad.toml" in str(caught.value)
    for part in parts:
        assert part in str(caught.value)
