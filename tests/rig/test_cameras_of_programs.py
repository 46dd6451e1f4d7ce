"""Camera poses of a rig by caliscope, aniposelib, multical and vision-calibration, compared with a rig."""

import json
import os

import numpy as np
import pytest
from fixtures.commands import run

import uq_handeye as uq
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.core.geometry.rotations import Rotation
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.read.camera_poses import read_camera_poses
from uq_handeye.trials.simulation.several_cameras import simulate_rig
from uq_handeye.use.verification.verify_cameras import verify_cameras

SEED = int(os.environ.get("UQ_HANDEYE_SEED", "0"))
SQUARE = 0.025


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """A rig of two cameras in a file, the result, and the true poses of the cameras in the first."""
    noise = dict.fromkeys(("arm", "left", "right"), ("0.5mrad", "0.3mm"))
    places = {"left": "arm", "right": "arm"}
    described, truth = simulate_rig(places, {"board": "world"}, n_poses=20, noise=noise, seed=SEED)
    result = calibrate_rig(described, noise)
    path = tmp_path_factory.mktemp("cameras") / "result.json"
    result.save(path)
    return path, result, {name: inverse(truth[name]) @ truth["left"] for name in places}


def toml(poses, names):
    parts = []
    for k, (key, T) in enumerate(zip(names, poses.values(), strict=True)):
        r, t = Rotation.from_matrix(T[:3, :3]).as_rotvec().tolist(), T[:3, 3].tolist()
        parts.append(f"[cam_{k}]\nname = '{key}'\nmatrix = [[1, 0, 0]]\nrotation = {r}\ntranslation = {t}\n")
    return "\n".join(parts) + "\n[metadata]\nerror = 0.1\n"


def multical(poses):
    """Lengths in squares."""
    first, *others = poses
    names = {first: first} | {other: f"{other}_to_{first}" for other in others}
    return json.dumps({
        "cameras": {},
        "camera_poses": {
            names[key]: {"R": T[:3, :3].tolist(), "T": (T[:3, 3] / SQUARE).tolist()} for key, T in poses.items()
        },
    })  # fmt: skip


def vision(poses):
    at = ((Rotation.from_matrix(T[:3, :3]).as_quat().tolist(), T[:3, 3].tolist()) for T in poses.values())
    return json.dumps({"cam_se3_rig": [{"rotation": q, "translation": t} for q, t in at]})


def files(folder, poses):
    for name, text in (
        ("aniposelib.toml", toml(poses, poses)), ("caliscope.toml", toml(poses, "01").replace("[cam", "[cameras.cam")),
        ("multical.json", multical(poses)), ("vision.json", vision(poses)),
    ):  # fmt: skip
        (folder / name).write_text(text)
        yield folder / name, SQUARE if name == "multical.json" else 1.0


def test_each_file_is_read_and_agrees_with_the_rig(rig, tmp_path):
    _, result, poses = rig
    for path, unit in files(tmp_path, poses):
        found = verify_cameras(result, read_camera_poses(path), unit)
        (pair,) = found.pairs
        assert not found.contradicted and pair.translation < 1e-3, path.name
        assert found.scale == pytest.approx(1.0, abs=0.02)
    moved = {name: T.copy() for name, T in poses.items()}
    moved["right"][0, 3] += 0.005
    for path, unit in files(tmp_path, moved):
        found = verify_cameras(result, read_camera_poses(path), unit)
        assert found.contradicted and found.pairs[0].translation == pytest.approx(0.005, rel=0.3), path.name


@pytest.mark.slow
def test_the_command(rig, tmp_path):
    path, _, poses = rig
    (tmp_path / "multical.json").write_text(multical(poses))
    done = run("verify", str(path), "--camera-poses", "multical.json", "--units", "25mm", cwd=tmp_path)
    assert done.returncode == 0 and "AGREES: 1 relative pose of cameras by multical" in done.stdout, done.stderr
    done = run("verify", str(path), "--camera-poses", "multical.json", cwd=tmp_path)
    assert done.returncode == 4 and "times those of the file" in done.stdout


def test_other_files_and_names_are_refused(rig, tmp_path):
    (tmp_path / "none.json").write_text('{"fx": 1.0}')
    with pytest.raises(uq.InputError, match="holds no camera poses"):
        read_camera_poses(tmp_path / "none.json")
    _, result, poses = rig
    (tmp_path / "three.toml").write_text(toml(poses | {"x": np.eye(4)}, "abc"))
    with pytest.raises(uq.InputError, match="the rig has left, right, the file of caliscope, aniposelib a, b, c"):
        verify_cameras(result, read_camera_poses(tmp_path / "three.toml"))
