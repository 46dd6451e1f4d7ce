"""The study of a declared accuracy: frames are aligned, and the verdict follows the table."""

import numpy as np
import pandas as pd
import pytest

from studies.common.scores import errors
from studies.kinematics.aligned import aligned
from studies.kinematics.arms import Rig, arm, workspace_joints
from studies.robot_accuracy import WAYS, findings
from studies.robot_accuracy.rigs import PLACES, session
from uq_handeye.core.geometry.se3 import inverse, perturb

pytestmark = pytest.mark.slow


def table(inside):
    rows = [
        {"where": where, "setup": "eye-in-hand", "arm": "ur5_like", "accuracy_mm": 1.0, "accuracy_deg": 0.1, "way": way,
         "refused": False, "inside": float(k < inside[way]), "d2": 6.0, "mm": mm, "stated": 1.0, "deg": 0.1,
         "cpu_s": 0.5}
        for where in PLACES for k in range(20) for way, mm in zip(WAYS, (1.0, 1.0, 2.0), strict=True)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def test_findings_follow_the_table():
    text = findings({"sets": table(dict(zip(WAYS, (19, 18, 2), strict=True)))})
    assert "in 38 of 40 sets with the accuracy declared" in text and "in 36 of 40 with nothing said" in text
    assert "in 4 of 40 with the robot taken as exact" in text
    assert "off by 0.50 (declared) and 0.50 (nothing said)" in text


def test_an_arm_that_differs_by_frames_alone_is_exact(rng):
    """Errors that base and tool take up leave no accuracy to declare."""

    class Moved(Rig):
        def true_robot(self, q):
            return A @ self.kinematics.poses(q) @ B

    kinematics = arm("irb120_like")
    A, B = (perturb(np.eye(4), 0.01 * rng.standard_normal(6)) for _ in range(2))
    none = np.zeros(len(kinematics.errors))
    rig = Moved(kinematics, none, "eye-in-hand", np.eye(4), np.eye(4), 0.0, np.zeros(6))
    found_A, found_B, accuracy = aligned(rig, workspace_joints(kinematics, 50, rng))
    assert max(accuracy) < 1e-6
    np.testing.assert_allclose(found_A, A, atol=1e-6)
    np.testing.assert_allclose(found_B, B, atol=1e-6)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_X_is_that_of_the_aligned_frames(rng, setup):
    """Over wide poses the robot's chain with X of the session closes to the arm's accuracy."""
    of = session("ur5_like", setup, "wide", 40, rng)
    robot, camera = of.poses.robot, of.poses.camera
    W = (robot if setup == "eye-in-hand" else inverse(robot)) @ of.X @ camera
    middle = np.median(errors(W, W[0]), axis=0)
    assert np.median(np.linalg.norm(errors(W, perturb(W[0], middle))[:, 3:], axis=1)) < 6e-3
