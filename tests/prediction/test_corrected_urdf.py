"""A URDF corrected by what a calibration found of the arm, read again."""

import json

import numpy as np
import pytest
from fixtures.arm_sessions import Session, calibrated, chain, drawn_errors, measured
from fixtures.arms import SIX_AXES
from fixtures.commands import run

from uq_handeye import InputError
from uq_handeye.calibration.prediction.corrected_urdf import corrected_urdf
from uq_handeye.model.kinematics.chain import Kinematics
from uq_handeye.model.kinematics.descriptions.urdf import Placed, with_origins
from uq_handeye.model.kinematics.errors import LENGTHS, OFFSETS, TILTS
from uq_handeye.model.kinematics.forward import spread_postures

ARM = chain()
Q = spread_postures(ARM.limits, np.ones(6, dtype=bool), 80)


@pytest.fixture(scope="module")
def result():
    """Return the result for poses all over the workspace, which tell much of the arm."""
    rng = np.random.default_rng(4)
    e, q = drawn_errors(ARM, rng), spread_postures(ARM.limits, np.ones(6, dtype=bool), 60)
    return calibrated(Session(ARM, e, measured(ARM, e, q, rng), q))


@pytest.mark.slow
def test_the_corrected_urdf_has_the_poses_of_the_errors_exported(result):
    found = corrected_urdf(result.kinematics, SIX_AXES)
    assert 3 <= len(found.exported) < len(result.kinematics.kept)
    again = Kinematics.from_urdf(found.text, tip="tool0")
    np.testing.assert_allclose(again.poses(Q), ARM.poses(Q, found.e), atol=1e-12)
    assert not np.allclose(again.poses(Q), ARM.poses(Q), atol=1e-4)


@pytest.mark.slow
def test_only_what_the_data_know_is_exported(result):
    found = corrected_urdf(result.kinematics, SIX_AXES)
    exported = {row.name for row in found.exported}
    for row in result.kinematics.table():
        geometric = row.key.kind in (OFFSETS, TILTS, LENGTHS)
        assert (row.name in exported) == (geometric and row.sd < 0.5 * row.size)
    names = [error.name for error in ARM.errors]
    assert {names[k] for k in np.flatnonzero(found.e)} == exported
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)), [row.sd for row in found.exported])
    assert {row.key.kind for row in found.functions} == {"transmission", "sag"}
    functions = np.where([error.group in ("transmission", "sag") for error in ARM.errors], result.kinematics.e, 0.0)
    move = ARM.poses(Q, functions)[:, :3, 3] - ARM.poses(Q)[:, :3, 3]
    assert found.by_functions == pytest.approx(np.sqrt(np.mean(np.sum(move**2, axis=-1))), rel=0.2)
    assert f"{1e3 * found.by_functions:.2f} mm" in found.text.split("-->")[0]


@pytest.mark.slow
def test_all_of_the_geometry_can_be_written(result):
    found = corrected_urdf(result.kinematics, SIX_AXES, 1.0)
    again = Kinematics.from_urdf(found.text, tip="tool0")
    np.testing.assert_allclose(again.poses(Q), ARM.poses(Q, found.e), atol=1e-12)
    assert found.by_left < 1e-5


def test_the_rest_of_the_text_stays(result):
    found = corrected_urdf(result.kinematics, SIX_AXES)
    lines = found.text.splitlines()
    assert lines[0] == SIX_AXES.splitlines()[0]  # the declaration
    changed = set(SIX_AXES.splitlines()) - set(lines)
    joint = {error.key: error.joint for error in result.kinematics.chain.errors}
    exported = {joint[row.key] for row in found.exported}
    assert changed and all("<origin" in line or any(name in line for name in exported) for line in changed)


def test_origins_in_every_form_are_replaced():
    place = Placed(np.array([1.0, 2.0, 3.0]), np.zeros(3))
    text = """<robot name="r>"><link name="a"/><link name="b"/><link name="c"/><!-- <origin/> -->
    <joint name="one" type="revolute"><parent link="a"/><child link="b"/><origin xyz='0 0 1'></origin></joint>
    <joint
      name="two" type="revolute"><parent link="b"/><child link="c"/></joint></robot>"""
    found = with_origins(text, {"one": place, "two": place}, "a -- b")
    arm = Kinematics.from_urdf(found)
    for joint in arm.joints:
        np.testing.assert_allclose(joint.origin[:3, 3], [1, 2, 3])
    assert found.count("<origin xyz") == 2 and "<!-- a - - b -->" in found and "<!-- <origin/> -->" in found


def test_another_arm_and_no_arm_are_refused(result):
    with pytest.raises(InputError, match="differ by up to"):
        corrected_urdf(result.kinematics, SIX_AXES.replace("0 0 0.27", "0 0 0.28"))
    with pytest.raises(InputError, match="of the joints axis_1"):
        corrected_urdf(result.kinematics, SIX_AXES.replace("axis_2", "shoulder"))
    with pytest.raises(InputError, match="with joints and kinematics"):
        corrected_urdf(None, SIX_AXES)
    with pytest.raises(InputError, match="narrower"):
        corrected_urdf(result.kinematics, SIX_AXES, 0.0)
    with pytest.raises(InputError, match="document type"):
        with_origins("<!DOCTYPE robot><robot/>", {})


@pytest.mark.slow
def test_on_the_command_line(result, tmp_path):
    (tmp_path / "arm.urdf").write_text(SIX_AXES)
    result.to_json(tmp_path / "result.json")
    found = run("export", "result.json", "corrected.urdf", "--corrects", "arm.urdf", cwd=tmp_path)
    assert found.returncode in (0, None), found.stderr
    assert "Corrected: " in found.stdout and "no place in a URDF" in found.stdout
    expected = corrected_urdf(result.kinematics, SIX_AXES)
    assert (tmp_path / "corrected.urdf").read_text() == expected.text
    data = json.loads((tmp_path / "corrected.corrections.json").read_text())
    np.testing.assert_allclose(data["covariance"], expected.covariance)
    refused = run("export", "result.json", "corrected.txt", "--corrects", "arm.urdf", cwd=tmp_path)
    assert refused.returncode == 2 and "to end in .urdf" in refused.stderr
