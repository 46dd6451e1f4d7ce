"""``uq-handeye plan`` with joints and a URDF: joints out, inside the limits, as a file that is read again."""

import json

import numpy as np
import pytest
from fixtures.arm_sessions import chain, looking, measured
from fixtures.arms import SIX_AXES
from fixtures.commands import run

from uq_handeye.model.kinematics.joints_file import read_joints
from uq_handeye.read import write_pose_file

CHAIN = ("--joints", "joints.csv", "--urdf", "arm.urdf", "--tip", "tool0")
GIVEN = (*CHAIN, "--kinematics", "declared", "--size", "joint noise=0.1mrad", "--shared", "none", "--sample", 60)
NOISES = ("--robot-noise", "exact", "--camera-noise", "0.3mrad,0.2mm")
ARM = chain()


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    rng = np.random.default_rng(5)
    q = looking(ARM, rng, 10, 0.3)
    write_pose_file(folder / "camera.csv", measured(ARM, np.zeros(len(ARM.errors)), q, rng).camera)
    (folder / "arm.urdf").write_text(SIX_AXES)
    for name, values in (("joints", q), ("task", 0.5 * q)):
        rows = [",".join(ARM.names), *(",".join(map(repr, row)) for row in values.tolist())]
        (folder / f"{name}.csv").write_text("\n".join([*rows, ""]))
    return folder


def command(cell, *options):
    return run("plan", "camera.csv", *GIVEN, *options, cwd=cell)


@pytest.mark.slow
def test_a_plan_of_joints(cell):
    found = command(cell, *NOISES, "-k", 3, "--task", "task.csv", "-o", "plan", "--json")
    data = json.loads(found.stdout)
    assert (data["criterion"], data["joint_names"], len(data["task"])) == ("prediction", list(ARM.names), 10)
    q = read_joints(cell / "plan" / "next.csv", ARM).q
    np.testing.assert_allclose(q, [step["joints"] for step in data["steps"]], atol=1e-8)
    assert ((q >= ARM.limits[:, 0]) & (q <= ARM.limits[:, 1])).all()
    np.testing.assert_allclose(ARM.poses(q), [step["robot"] for step in data["steps"]], atol=5e-3)  # but for its errors


@pytest.mark.slow
@pytest.mark.parametrize("noise", [(), NOISES[2:]])
def test_noise_that_is_not_given_is_estimated(cell, noise):
    found = command(cell, *noise, "-k", 1)
    assert "axis_6" in found.stdout and "estimated from the poses so far" in found.stdout


@pytest.mark.slow
def test_candidates_are_joints(cell):
    data = json.loads(
        command(cell, *NOISES, "-k", 2, "--candidates", "task.csv", "--criterion", "trace", "--json").stdout
    )
    task = read_joints(cell / "task.csv", ARM).q
    np.testing.assert_allclose(
        [step["joints"] for step in data["steps"]], task[[s["candidate"] for s in data["steps"]]]
    )


def test_a_task_without_joints_is_refused(cell):
    found = run("plan", "camera.csv", "camera.csv", "--task", "task.csv", cwd=cell)
    assert found.returncode == 2 and "--task and --criterion prediction need --joints and --urdf" in found.stderr
