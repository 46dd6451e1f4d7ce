"""`calibrate ROBOT CAMERA` and `calibrate ROBOT --camera left=CAMERA` are one answer, and so is all that follows."""

import json
import re

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.cli.app import main

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")]
NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
# Parts of a file that say how it was made, and what the camera is called.
AS_GIVEN = ("provenance", "checksum", "sha256", "names")


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        main([str(part) for part in arguments])
    return ended.value.code


def renamed(text):
    """Return a text with the camera as it is called by default."""
    text = re.sub(r"\bthe camera left\b", "the camera", re.sub(r"\bThe camera left\b", "The camera", text))
    return " ".join(re.sub(r"(?<=_T_)left|\bleft(?=@| or| and)|(?<=or )left", "camera", text).split())


def require_same(one, other, path=""):
    """Require equal plain values, numbers to 1e-9."""
    if isinstance(one, dict):
        assert one.keys() - set(AS_GIVEN) == other.keys() - set(AS_GIVEN), path
        for key in one.keys() - set(AS_GIVEN):
            require_same(one[key], other[key], f"{path}.{key}")
    elif isinstance(one, list):
        assert len(one) == len(other), path
        for k, pair in enumerate(zip(one, other, strict=True)):
            require_same(*pair, f"{path}[{k}]")
    elif isinstance(one, float):
        assert other == pytest.approx(one, rel=1e-9, abs=1e-12), path
    elif isinstance(one, str):
        assert renamed(one) == renamed("camera" if other == "left" else other), path
    else:
        assert one == other, path


def moved_from_12_on(camera):
    camera[12:20, 0, 3] += 3e-3
    return camera


def in_mm(camera):
    camera[:, :3, 3] *= 1000.0
    return camera


@pytest.mark.parametrize(
    ("setup", "change", "status"),
    [("eye-in-hand", np.asarray, 0), ("eye-to-hand", moved_from_12_on, 3), ("eye-in-hand", in_mm, 3)],
    ids=["clean", "moved", "mm"],
)
def test_one_camera_by_its_name_is_the_same_answer(setup, change, status, tmp_path, capsys):
    poses = uq.simulate(30, noise=NOISE, seed=5, setup=setup)
    camera = change(poses.camera.copy())
    for name, rows in (("", slice(20)), ("new_", slice(20, 30))):
        uq.write_pose_file(tmp_path / f"{name}robot.csv", poses.robot[rows])
        uq.write_pose_file(tmp_path / f"{name}camera.csv", camera[rows])
    robot, file = tmp_path / "robot.csv", tmp_path / "camera.csv"
    ways = (("1", [file]), ("2", ["--camera", f"left={file}"]))
    screens, files = [], []
    for folder, way in ways:
        report = tmp_path / f"{folder}.html"
        written = ("-o", tmp_path / folder, "--report", report, "--no-compare")
        assert run("calibrate", robot, *way, "--setup", setup, *written) == status
        said = capsys.readouterr()
        screens.append(renamed(said.out.replace(f"{tmp_path / folder}", "FOLDER").replace(report.name, "report.html")))
        stored = tmp_path / folder / "result.json"
        files.append(json.loads(stored.read_text()) if stored.exists() else {})
    assert screens[0] == screens[1]
    require_same(*files)
    if not files[0]:
        return
    new = [tmp_path / "new_robot.csv", tmp_path / "new_camera.csv"]
    for command in (
        ("check", *new), ("update", *new), ("plan", "-k", 1, "--sample", 30), ("predict", "--robot", new[0], "--camera")
    ):  # fmt: skip
        found = []
        for folder, _ in ways:
            name, *others = command
            code = run(name, tmp_path / folder / "result.json", *others, "--json")
            said = capsys.readouterr()
            values = json.loads(said.out) if said.out else {}
            values["views"] = list(values.get("views", {}).values())  # p-values by the names of camera and target
            found.append((code, values))
        assert found[0][0] == found[1][0], command
        require_same(found[0][1], found[1][1], name)
