"""A closed form that fits better than X, which it contradicts, is a finding."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.rigs import NOISE, quietly

import uq_handeye as uq
from uq_handeye.calibration.closed_forms import closed_forms
from uq_handeye.calibration.job import job_of
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.fit.graph.request import Request


@pytest.mark.slow
def test_an_x_that_is_off_is_contradicted_and_a_right_one_is_not():
    poses = uq.simulate(30, noise=NOISE, seed=4)
    poses = uq.PosePairs(poses.robot, poses.camera)
    result, job = quietly(poses), job_of(Request(), poses)
    assert closed_forms(job, result, result.table) == []
    off = replace(result, X=perturb(result.X, np.array([0.02, 0.0, 0.0, 0.0, 0.02, 0.0])))
    worse = replace(result.table, rotation=3.0 * result.table.rotation, translation=3.0 * result.table.translation)
    assert closed_forms(job, off, result.table) == []  # it does not fit better
    (found,) = closed_forms(job, off, worse)
    assert found.code == "calibration.closed_form_fits" and found.severity == "caution"
    assert found.values["rotation"] < 0.9 and found.values["translation"] < 0.9 and found.values["d2"] > 12.6
    assert closed_forms(job, result, worse) == []  # nor does one contradict X where both say the same


@pytest.mark.slow
def test_units_are_told_from_targets_of_another_size():
    """Far from 1 a factor is that of a unit, 8 % beside it too; near 1 a target has it."""
    poses = uq.simulate(25, noise=NOISE, seed=3)
    for factor, unit in ((920.0, "mm"), (1.0 / 0.0254 * 1.08, "in"), (1.02, None)):
        camera = poses.camera.copy()
        camera[:, :3, 3] *= factor
        try:
            result = quietly(uq.PosePairs(poses.robot, camera))
            usable, text = result.usable, " ".join(map(str, result.findings))
        except (uq.InputError, uq.NotConvergedError) as error:
            usable, text = False, " ".join(map(str, error.findings))
        assert usable == (unit is None)
        assert unit is None or f"--units camera={unit}" in text
