"""Poses in new pictures by a camera that is known."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.pictures import simulated_rig

import uq_handeye as uq
from uq_handeye.model.camera.corners import without_pictures
from uq_handeye.model.camera.description import Board
from uq_handeye.model.camera.known_camera import poses_by_known_camera


def test_poses_of_the_same_pictures_are_the_same(rng):
    _, corners = simulated_rig(Board(9, 6, 0.02), rng, n=8, distortion=(-0.2, 0.0, 0.0, 0.0))
    camera = uq.calibrate_camera(corners, model="brown", coefficients=["k1"], shape="flat")
    some = without_pictures(corners, np.arange(8) != 3)
    again = poses_by_known_camera(camera, some)
    assert again.poses.shape == (1, 4, 4)
    assert np.allclose(again.poses[0], camera.poses[3], atol=1e-4)
    assert np.allclose(again.bundle.own[0], camera.bundle.own[3], rtol=0.2, atol=1e-12)
    assert np.array_equal(again.bundle.parameters, camera.bundle.parameters)
    with pytest.raises(uq.InputError, match="640 x 480"):
        poses_by_known_camera(camera, replace(some, image_size=(800, 600)))
