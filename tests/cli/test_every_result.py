"""Every command on the result of one camera, of several cameras, of several targets and of several arms."""

import json
from typing import get_args

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.calibration.report.facts import Group
from uq_handeye.cli.app import main
from uq_handeye.core.geometry.rotations import Rotation
from uq_handeye.trials.simulation.several_cameras import simulate_rig
from uq_handeye.use.live_session.browser_page import BrowserPage

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")]
KINDS = {
    "one": ({"left": "arm"}, {"board": "world"}, ("arm",)),
    "cameras": ({"left": "arm", "right": "arm"}, {"board": "world"}, ("arm",)),
    "targets": ({"left": "arm"}, {"board": "world", "plate": "world"}, ("arm",)),
    "arms": ({"left": "arm", "right": "second"}, {"board": "world"}, ("arm", "second")),
}
COMMANDS = {
    "predict camera": "predict OLD --robot ROBOT --camera",
    "predict point": "predict OLD --robot ROBOT --point 0mm,0mm,300mm",
    "predict length": "predict OLD --length 100mm --at 0.5m --pixel-noise 0.2px --focal-length 1000px",
    "report": "report OLD FOLDER/report.html --no-compare",
    "certificate": "certificate OLD FOLDER/certificate.json",
    "export": "export OLD FOLDER/x.urdf",
    "check": "check OLD FOLDER/new.toml",
    "update": "update OLD FOLDER/new.toml",
    "plan": "plan OLD -k 1 --sample 40 --tolerance 5mm --floor -1m",
    "diff": "diff OLD NEW",
    "compare": "compare OLD --methods park,shah",
    "validate": "validate OLD --trials 100 --workers 1",
    "cross-check": "cross-check OLD --trials 100 --no-posterior --workers 1",
    "posterior": "posterior OLD --samples 300 --walkers 32",
    "verify": "verify OLD FOLDER/touches.csv --camera left",
    "view": "view OLD --no-browser --port 0",
    "live": "live FOLDER/session --no-browser --port 0",
}
# Commands that answer for each camera.
EACH = (
    "predict camera", "predict point", "predict length", "diff", "compare", "validate", "cross-check", "posterior",
)  # fmt: skip
# Commands that do nothing with a result that is not usable.
STOP = {
    name: command.replace(" OLD", " MOVED")
    for name, command in COMMANDS.items()
    if name in ("predict camera", "predict point", "check", "plan", "diff", "validate", "export")
}


def write_rig(path, rig, noise):
    """Write a rig as a rig file with its pose files."""
    lines = []
    for kind, things in (("cameras", rig.cameras), ("targets", rig.targets)):
        lines += [f'[{kind}.{name}]\non = "{place}"' for name, place in things.items()]
    files = {name: (arm.names, arm.poses) for name, arm in rig.arms.items()}
    lines += [f'[arms.{name}]\nposes = "{path.stem}_{name}.csv"' for name in files]
    for view in rig.views:
        name = f"{view.camera}_{view.target}"
        files[name] = (view.at, view.poses)
        lines.append(f'[[views]]\ncamera = "{view.camera}"\ntarget = "{view.target}"\nfile = "{path.stem}_{name}.csv"')
    for name, (moments, T) in files.items():
        rows = np.column_stack([np.array(moments, float), T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_quat()])
        np.savetxt(path.with_name(f"{path.stem}_{name}.csv"), rows, delimiter=",", comments="", fmt="%.15g",
                   header="timestamp,x,y,z,qx,qy,qz,qw")  # fmt: skip
    path.write_text("\n".join(lines) + "\n")


def some(rig, rows):
    arms = {name: uq.ArmPoses(arm.poses[rows], arm.names[rows]) for name, arm in rig.arms.items()}
    views = [uq.View(v.camera, v.target, v.poses[rows], v.at[rows]) for v in rig.views]
    return uq.Rig(arms, rig.cameras, rig.targets, views)


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Return for each kind a folder with two results and the rig file of the second one."""
    found = {}
    for kind, (cameras, targets, arms) in KINDS.items():
        folder, noise = tmp_path_factory.mktemp(kind), dict.fromkeys((*arms, *cameras), ("0.5mrad", "0.3mm"))
        rig, _ = simulate_rig(cameras, targets, arms=arms, n_poses=32, noise=noise, seed=4)
        for name, rows in (("old", slice(0, 20)), ("new", slice(20, 32))):
            uq.calibrate(some(rig, rows), noise=noise).save(folder / f"{name}.json")
            write_rig(folder / f"{name}.toml", some(rig, rows), noise)
        uq.calibrate(moved(some(rig, slice(0, 20))), noise=noise).save(folder / "moved.json")
        write_touches(folder / "touches.csv", uq.load(folder / "old.json").of_camera("left"), rig)
        (folder / "session").mkdir()
        for side in ("arm", "left_board"):
            name = "robot.csv" if side == "arm" else "camera.csv"
            (folder / "session" / name).write_text((folder / f"new_{side}.csv").read_text())
        found[kind] = folder
    return found


def moved(rig):
    """Return a rig whose camera left slipped by 20 mm after half of the poses."""
    late = np.arange(20)[:, None] >= 10
    views = [
        uq.View(v.camera, v.target, v.poses, v.at)
        if v.camera != "left"
        else uq.View(v.camera, v.target, shifted(v.poses, 0.02 * late), v.at)
        for v in rig.views
    ]
    return uq.Rig(rig.arms, rig.cameras, rig.targets, views)


def shifted(T, by):
    T = np.array(T)
    T[:, :1, 3] += by
    return T


def write_touches(path, result, rig):
    """Write points that the camera left saw and the tool touched, without error."""
    G = rig.arms["arm"].poses[:8]
    seen = np.random.default_rng(1).uniform((-0.1, -0.1, 0.3), (0.1, 0.1, 0.5), (8, 3))
    touched = np.einsum("kij,kj->ki", G @ result.X, np.append(seen, np.ones((8, 1)), axis=1))[:, :3]
    at = np.append(G[:, :3, 3], Rotation.from_matrix(G[:, :3, :3]).as_quat(), axis=1)
    head = [f"{side}_{axis}" for side in ("seen", "touched") for axis in "xyz"] + ["touched_sd"]
    head += [f"seen_at_{part}" for part in ("x", "y", "z", "qx", "qy", "qz", "qw")]
    rows = np.column_stack([seen, touched, np.full(8, 5e-4), at])
    np.savetxt(path, rows, delimiter=",", comments="", fmt="%.15g", header=",".join(head))


def said_by(command, folder, capsys):
    words = {name.upper(): f"{folder}/{name}.json" for name in ("old", "new", "moved")}
    words["ROBOT"] = f"{folder}/new_arm.csv"
    arguments = [words.get(part, part).replace("FOLDER", str(folder)) for part in command.split()]
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


@pytest.fixture
def ended_at_once(monkeypatch):
    """End a page as Ctrl-C does; a session first compares its poses with a stored result. Return what it said."""
    said = []

    def wait(page):
        if hasattr(page, "_compare"):
            folder = page.session.folder.path.parent
            page._compare("old.json", (folder / "old.json").read_bytes())
            said.append(page._said.content)
        raise KeyboardInterrupt

    monkeypatch.setattr(BrowserPage, "wait", wait)
    return said


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", KINDS)
def test_every_command_takes_every_result(kind, command, folders, capsys, ended_at_once):
    status, out, err = said_by(COMMANDS[command], folders[kind], capsys)
    assert status == 0, out + err
    cameras = list(KINDS[kind][0])
    several = len(cameras) > 1
    assert [name for name in cameras if f"{name}:\n" in out] == (cameras if command in EACH and several else [])
    if command == "live":
        (text,) = ended_at_once
        assert text.count("UNCHANGED") >= 1 and ("right:" in text) == several


@pytest.mark.parametrize("command", STOP)
@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_done_with_a_result_that_is_not_usable(kind, command, folders, capsys):
    status, out, err = said_by(STOP[command], folders[kind], capsys)
    assert status == 3 and out == "", out + err
    (line,) = err.splitlines()
    assert "NOT USABLE" in line and "Calibrate again." in line


@pytest.mark.parametrize("kind", KINDS)
def test_the_answer_of_every_result_has_the_same_parts(kind, folders):
    folder = folders[kind]
    result = uq.load(folder / "old.json")
    data = result.to_dict()
    assert {"headline", "usable", "answered", "facts", "cameras" if kind != "one" else "X"} <= set(data)
    first = list(dict.fromkeys(one["group"] for one in data["facts"]))
    assert first == [group for group in get_args(Group) if group in first] and first[0] == "accuracy"
    assert all({"group", "of", "name", "value", "uncertainty", "unit"} <= set(one) for one in data["facts"])
    for frame in [one.frame for one in (*result.cameras.values(), *result.targets.values())]:
        numbers = result.facts.select("pose", frame)
        assert len(numbers) == 6 and all(one.sd > 0 for one in numbers)
    certificate = uq.make_certificate(result, tolerance="5mm,1deg", issued="today").to_dict()
    assert certificate["certified"] and certificate["format"] == "uq-handeye certificate 1"
    assert {"measurand", "conditions", "method", "traceability", "validity", "headline"} <= set(certificate)


def test_the_json_of_a_command_for_each_camera_is_one_object(folders, capsys):
    status, out, _ = said_by("predict OLD --robot ROBOT --camera --json -o FOLDER/out", folders["cameras"], capsys)
    assert status == 0 and list(json.loads(out)["cameras"]) == ["left", "right"]
    assert (folders["cameras"] / "out" / "right" / "predictions.csv").is_file()
    status, _, err = said_by("predict OLD --robot ROBOT --camera --target board", folders["cameras"], capsys)
    assert status == 2 and "--target board is of one camera" in err


def test_touches_are_of_one_camera(folders, capsys):
    status, _, err = said_by("verify OLD touches.csv", folders["cameras"], capsys)
    assert status == 2 and "Choose one: --camera left" in err
