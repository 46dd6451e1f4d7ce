"""Poses side by side: arrays, lists and SciPy's RigidTransform; anything else is named in one line."""

import numpy as np
import pandas as pd
import pytest
from fixtures.rigs import NOISE, quietly
from scipy.spatial.transform import RigidTransform, Rotation

import uq_handeye as uq

POSES = uq.simulate(12, noise=NOISE, seed=3)
G, C = POSES.robot, POSES.camera


@pytest.mark.slow
@pytest.mark.parametrize(
    "form",
    [
        np.asarray,
        list,
        np.ndarray.tolist,
        lambda T: T.astype(object),
        RigidTransform.from_matrix,
        lambda T: [RigidTransform.from_matrix(one) for one in T],
    ],
)
@pytest.mark.parametrize("setup", [None, "eye-to-hand"])
def test_every_form_is_the_same(form, setup):
    poses = POSES if setup is None else uq.simulate(12, noise=NOISE, setup=setup, seed=3)
    found = uq.calibrate(form(poses.robot), form(poses.camera), setup=setup, noise=NOISE)
    np.testing.assert_allclose(found.X, quietly(poses, noise=NOISE).X, atol=1e-12)
    assert found.setup == (setup or "eye-in-hand")


def test_compare_takes_them():
    rows = uq.compare(G, C, noise=NOISE, methods=["park"], timed=False).rows
    assert [row.agrees for row in rows] == [True, True]


@pytest.mark.parametrize(
    ("robot", "camera", "words"),
    [
        (G[:5], C, "same number of poses"),
        (G[:, :3], C[:, :3], r"`robot` to have shape"),
        (G.reshape(-1, 16), C, r"`robot` to have shape"),
        ("robot.csv", "camera.csv", r"read_poses\(robot, camera\)"),
        (G, 5, "`camera` to be poses"),
        (POSES, C, "PosePairs hold them"),
        (G, NOISE, "`camera` to be poses"),
        (Rotation.from_matrix(G[:, :3, :3]), C, "`robot` to have shape"),
        ((G[:, :3, :3], G[:, :3, 3]), C, "`robot`"),
        ({"a": 1}, C, "`robot`"),
        (pd.DataFrame(G.reshape(-1, 16)), C, "`robot` to have shape"),
        (np.where(np.arange(12)[:, None, None] == 3, np.nan, G), C, r"`robot\[3\]`|robot"),
        (G, None, "`data` to be PosePairs or Motions"),
    ],
)
def test_what_is_no_poses_is_named(robot, camera, words):
    with pytest.raises(uq.InputError, match=words) as caught:
        uq.calibrate(robot, camera)
    assert "\n" not in str(caught.value)
