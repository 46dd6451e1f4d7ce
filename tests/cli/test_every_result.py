"""Every command on the result of one camera, of several cameras, of several targets and of several arms."""

import json

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.cli.app import main
from uq_handeye.core.geometry.rotations import Rotation
from uq_handeye.trials.simulation.several_cameras import simulate_rig

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
        found[kind] = folder
    return found


def said_by(command, folder, capsys):
    words = {"OLD": f"{folder}/old.json", "NEW": f"{folder}/new.json", "ROBOT": f"{folder}/new_arm.csv"}
    arguments = [words.get(part, part).replace("FOLDER", str(folder)) for part in command.split()]
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    said = capsys.readouterr()
    return ended.value.code, said.out, said.err


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", KINDS)
def test_every_command_takes_every_result(kind, command, folders, capsys):
    status, out, err = said_by(COMMANDS[command], folders[kind], capsys)
    assert status == 0, out + err
    each = ("predict camera", "predict point", "predict length", "diff", "compare", "validate")
    cameras = list(KINDS[kind][0])
    assert [name for name in cameras if f"{name}:\n" in out] == (
        cameras if command in each and len(cameras) > 1 else []
    )


def test_the_json_of_a_command_for_each_camera_is_one_object(folders, capsys):
    status, out, _ = said_by("predict OLD --robot ROBOT --camera --json -o FOLDER/out", folders["cameras"], capsys)
    assert status == 0 and list(json.loads(out)["cameras"]) == ["left", "right"]
    assert (folders["cameras"] / "out" / "right" / "predictions.csv").is_file()
    status, _, err = said_by("predict OLD --robot ROBOT --camera --target board", folders["cameras"], capsys)
    assert status == 2 and "--target board is of one camera" in err


def test_touches_are_of_one_camera(folders, capsys):
    status, _, err = said_by("verify OLD touches.csv", folders["cameras"], capsys)
    assert status == 2 and "Choose one: --camera left" in err
