"""Wrong units, setup, inverse files and moved targets in a session: remedies as buttons, without options."""

import html
import re

import numpy as np
import pytest

import uq_handeye as uq
from studies.one_model.moves import stepped
from uq_handeye.findings import Finding
from uq_handeye.use.live_session.folder import Folder
from uq_handeye.use.live_session.markup import summary
from uq_handeye.use.live_session.remedies import remedies_of
from uq_handeye.use.live_session.session import Session

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


def drawn(setup="eye-in-hand"):
    return uq.simulate(n_poses=12, noise=NOISE, seed=5, setup=setup)


def in_mm(T):
    T = T.copy()
    T[:, :3, 3] *= 1e3
    return T


def case(name):
    """Files as they were written, and the button that mends them."""
    poses, fixed = drawn(), drawn("eye-to-hand")
    return {
        "units": (poses.robot, in_mm(poses.camera), "The camera file is in mm"),
        "both units": (in_mm(poses.robot), in_mm(poses.camera), "Both files are in mm"),
        "inverse camera": (poses.robot, np.linalg.inv(poses.camera), "The camera file holds target_T_camera"),
        "inverse robot": (np.linalg.inv(poses.robot), poses.camera, "The robot file holds gripper_T_base"),
        "setup": (fixed.robot, fixed.camera, "The camera is fixed in the cell"),
    }[name]


def session_of(folder, robot, camera):
    folder.mkdir(exist_ok=True)
    for side, T in (("robot", robot), ("camera", camera)):
        uq.write_pose_file(folder / f"{side}.csv", T)
    session = Session(Folder(folder))
    session.update()
    return session


def words(session):
    return html.unescape(re.sub(r"<style.*?</style>|<[^>]+>", " ", summary(session), flags=re.DOTALL))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize("name", ["units", "both units", "inverse camera", "inverse robot", "setup"])
def test_a_button_reads_the_files_as_they_are(tmp_path, name):
    robot, camera, label = case(name)
    session = session_of(tmp_path / "s", robot, camera)
    assert "--" not in words(session)
    remedy = next(one for one in session.answer.remedies if one.label == label)
    answer = session.remedy(remedy)
    assert answer.result.usable and not answer.remedies
    truth = drawn("eye-to-hand" if name == "setup" else "eye-in-hand").truth.X
    assert np.linalg.norm(answer.result.X[:3, 3] - truth[:3, 3]) < 5e-3
    again = Session(Folder(tmp_path / "s"))  # the choice is on disk
    assert again.update().result.X.tolist() == answer.result.X.tolist()
    before = again.read_as_before()
    assert before.remedies and (before.result is None or not before.result.usable or name == "both units")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_a_target_that_moved_is_left_out_from_there_on(tmp_path):
    poses = stepped([0, 4], "target", 10e-3, 0.0, n=24, since=14)
    session = session_of(tmp_path / "s", poses.robot, poses.camera)
    assert "the target moved from pose 14 on" in words(session) and "--" not in words(session)
    first, second = session.answer.remedies
    assert (first.label, second.label) == ("Leave out the poses from 14 on", "Leave out the poses before 14")
    assert session.remedy(first).left_out == tuple(range(14, 24)) and session.answer.result.usable
    assert session.undo().left_out == ()


@pytest.mark.slow
def test_what_is_shown_while_it_computes(tmp_path, monkeypatch):
    poses = drawn()
    session = session_of(tmp_path / "s", poses.robot, poses.camera)
    shown, headline = [], session.answer.result.headline
    session.listeners.append(lambda one: shown.append(words(one)))
    session.drop_last()
    assert "Computing" in shown[0] and headline not in shown[0]
    assert "Computing" not in shown[-1] and session.answer.result.headline in shown[-1]
    (tmp_path / "s" / "camera.csv").write_text("no poses")
    session.update()
    assert not session.computing and "Waiting" in shown[-1]


def test_remedies_of_readings():
    values = {"readings": [{"kind": "quaternion", "file": "robot", "order": "wxyz"}, {"kind": "mirrored"}]}
    (one,) = remedies_of([Finding("input_checks.poses_unexplained", "failure", values)], range(3))
    assert one.how == {"rotation": ("wxyz", None)}
    both = {"kind": "inverse camera", "setup": None, "scale": {"kind": "scale", "file": "camera", "unit": "mm",
            "factor": 1e-3}}  # fmt: skip
    (one,) = remedies_of([Finding("input_checks.poses_unexplained", "failure", {"readings": [both]})], range(3))
    assert one.label == "The camera file holds target_T_camera, in mm"
    assert one.how == {"camera_frame": "target_T_camera", "units": (None, "mm")}
