"""Shared errors of a rig that contradict what is assumed: the size of a target, and an error that was declared."""

from dataclasses import replace

import pytest

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.fit.graph.fit import Task
from uq_handeye.fit.graph.request import Request
from uq_handeye.fit.graph.sizes import components_of
from uq_handeye.model.errors.columns import some_rows
from uq_handeye.trials.simulation.several_cameras import simulate_rig, with_noise

NOISE = dict.fromkeys(("arm", "left", "right"), ("0.5mrad", "0.3mm"))
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")]


def rig_of(scale):
    """Two cameras and two boards; the lengths of the views of board b are ``scale`` times as large."""
    rig, _ = simulate_rig({"left": "arm", "right": "arm"}, {"a": "world", "b": "world"}, n_poses=30, seed=3)
    rig, views = with_noise(rig, NOISE, 3), []
    for view in rig.views:
        poses = view.poses.copy()
        poses[:, :3, 3] *= scale if view.target == "b" else 1.0
        views.append(replace(view, poses=poses))
    return replace(rig, views=tuple(views))


def test_a_target_of_another_size_is_named_with_its_size():
    found = [one for one in uq.calibrate(rig_of(1.015)).findings if one.code == "calibration.target_size"]
    assert [one.values["target"] for one in found] == ["b"]
    # used / true - 1: the lengths are those of a target that is 1.5 % larger than the true one
    assert abs(found[0].values["estimate"] - 0.015) < 3 * found[0].values["sd"] < 0.01
    assert "The target b is" in str(found[0]) and "smaller than assumed" in str(found[0])


def test_nothing_is_said_of_targets_of_the_size_that_is_given():
    result = uq.calibrate(rig_of(1.0))
    assert result.findings == ()
    assert next(one for one in result.checks if one.name == "shared errors").status == "ok"


def test_a_declared_error_that_the_views_contradict_is_named():
    declared, rig = [uq.SharedError.focal_length("0.05%").of("left")], rig_of(1.0)
    right = uq.calibrate(rig, noise=NOISE, shared=declared)
    assert right.status == "ok"
    task = Task.of(rig, Request(shared=tuple(declared)), True)
    (part,) = (one for one in components_of(rig, task.graph, True, request=task.request) if one.key == declared[0].key)
    xi = 8.0 * part.size.median * some_rows(part.columns, slice(None))[..., 0]  # the focal length is 0.4 % off
    views = [replace(view, poses=perturb(view.poses, xi[task.graph.view == k])) for k, view in enumerate(rig.views)]
    wrong = uq.calibrate(replace(rig, views=tuple(views)), noise=NOISE, shared=declared)
    found = next(one for one in wrong.findings if one.code == "calibration.group_contradicted")
    assert found.values["name"] == "left focal length" and 4 < found.values["times"] < 16
    assert "it is about" in str(found) and found.values["p_value"] < 1e-3
    assert next(one for one in wrong.checks if one.name == "shared errors").status == "failed"
