"""Boards that are not flat: the fields, their derivatives, which shape is chosen, and what X is worth with it."""

import os
import warnings
from pathlib import Path

import numpy as np
import pytest

import uq_handeye as uq
from studies import board_shape as study
from studies.camera_covariance import SIZE, board, recorded
from tests.support import jacobian
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.errors import InputError
from uq_handeye.model.camera.adjustment.bundle import MAX_PIXELS, Sight
from uq_handeye.model.camera.adjustment.criterion import criterion
from uq_handeye.model.camera.adjustment.setting import Setting
from uq_handeye.model.camera.board_shape import SHAPES, BoardShape, flat_shape, polynomial_shape, possible_shapes
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.models import MODELS


def quietly(*arguments, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return calibrate_camera(*arguments, **options)


@pytest.mark.parametrize("turned", [False, True])
def test_fields_have_no_rigid_motion_and_no_scale_and_are_nested(rng, turned):
    points = board(7, 5)
    if turned:
        points = points @ uq.simulate(n_poses=3, seed=1).robot[0, :3, :3].T + [0.3, -0.2, 0.1]
    full = polynomial_shape("bow4+plane2", np.repeat(points, 3, axis=0))
    assert (full.q, len(full.points)) == (20, 35)
    B = full.fields.reshape(-1, full.q)
    np.testing.assert_allclose(B.T @ B, 35 * np.eye(20), atol=1e-9)
    middle = full.points - full.points.mean(axis=0)
    spins = [np.cross(axis, middle) for axis in np.eye(3)]
    rigid = np.array([*(np.broadcast_to(axis, middle.shape) for axis in np.eye(3)), *spins, middle]).reshape(7, -1)
    assert np.abs(rigid @ B).max() < 1e-9
    columns = dict(zip(full.names, np.moveaxis(full.fields, -1, 0), strict=True))
    for name in SHAPES:
        shape = polynomial_shape(name, points)
        for text, field in zip(shape.names, np.moveaxis(shape.fields, -1, 0), strict=True):
            np.testing.assert_allclose(field, columns[text], atol=1e-9)
    # what the fields are made of: a paraboloid and an aspect are in their span, a sphere of degree 6 is not
    x, y = points[:, 0] - points[:, 0].mean(), points[:, 1] - points[:, 1].mean()
    bow = polynomial_shape("bow2", board(7, 5))
    at = bow.rows(board(7, 5))
    plane = np.column_stack([np.ones(35), board(7, 5)[:, :2], bow.fields[at, 2]])
    x, y = board(7, 5)[:, :2].T
    for height, inside in ((3 * x * x - x * y + 2 * y * y, True), (x**3, False)):
        left = height - plane @ np.linalg.lstsq(plane, height, rcond=None)[0]
        assert (np.abs(left).max() < 1e-12) == inside


def test_what_a_board_cannot_tell_is_refused():
    with pytest.raises(InputError, match="Expected `shape` to be auto or one of flat, bow2"):
        polynomial_shape("bow5", board())
    with pytest.raises(InputError, match="6 points of the board do not determine a shape 'bow2'"):
        polynomial_shape("bow2", board(3, 2))
    assert next(shape.name for shape in possible_shapes(board(3, 2))) == "flat"
    solid = board() + 0.01 * np.arange(54)[:, None] ** 2
    with pytest.raises(InputError, match="lie in no plane"):
        polynomial_shape("plane1", solid)
    assert [shape.name for shape in possible_shapes(solid)] == ["flat"]
    with pytest.raises(InputError, match="none of the 54 points"):
        flat_shape(board()).rows(board(square=0.031))


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_derivatives_of_what_is_seen(rng, model):
    corners, _, _ = recorded(rng, 3)
    shape = polynomial_shape("bow3+plane2", corners.points)
    offset = 1e-3 * rng.normal(size=shape.points.shape)
    shape = BoardShape("measured", shape.names, shape.points, offset, shape.fields, np.ones(shape.q))
    sight = Sight.of(MODELS[model], shape, corners, rng.uniform(0.5, 1, corners.m))
    k = len(MODELS[model].names)
    parameters = np.concatenate(
        [[1100, 1090, 640, 480], 0.01 * rng.normal(size=k - 4), 1e-3 * rng.normal(size=shape.q)]
    )
    poses = quietly(corners, SIZE, "pinhole", shape="flat").poses
    r, A, B = sight.rows(parameters, poses)
    off = sight.predicted(parameters, poses) - corners.by_picture(corners.pixels)
    np.testing.assert_allclose(r, (sight.weights[..., None] * off).mT.reshape(r.shape), atol=1e-9)
    free = np.arange(k + shape.q) % 3 == 0
    for part, same in zip(
        sight.pictures(slice(1, 3)).rows(parameters, poses[1:], free), (r, A[..., free], B), strict=True
    ):
        np.testing.assert_allclose(part, same[1:], rtol=1e-12, atol=1e-9)
    scale = np.concatenate([np.full(4, 1e2), np.full(k - 4, 1e-2), np.full(shape.q, 1e-3)])
    slope = jacobian(
        lambda d: np.array([sight.rows(parameters + scale * one, poses)[0].ravel() for one in d]), k + shape.q
    )
    np.testing.assert_allclose(scale * A.reshape(r.size, -1), slope, atol=1e-5 * np.abs(slope).max())
    slope = jacobian(lambda d: np.array([sight.rows(parameters, perturb(poses, one))[0].ravel() for one in d]), 6)
    np.testing.assert_allclose(B.reshape(r.size, 6), slope, rtol=1e-4, atol=1e-4 * np.abs(slope).max())


def test_what_moves_no_point_and_what_is_behind_the_camera_pull_nothing(rng):
    corners, _, _ = recorded(rng, 3)
    still = polynomial_shape("bow2", corners.points)
    still = BoardShape("measured", still.names, still.points, still.offset, 0 * still.fields, np.ones(3))
    sight = Sight.of(MODELS["pinhole"], still, corners, np.ones(corners.m))
    parameters, poses = (
        np.array([1100, 1090, 640, 480, 0, 0, 0.0]),
        quietly(corners, SIZE, "pinhole", shape="flat").poses,
    )
    poses = poses.copy()
    poses[1, 2, 3] -= 10.0
    r, A, B = sight.rows(parameters, poses)
    assert not A[..., 4:].any() and not A[1].any() and not B[1].any()
    assert (r[1] == MAX_PIXELS).all() and A[0, :, :4].any() and B[0].any()


@pytest.mark.slow
def test_every_candidate_is_fitted_to_its_minimum(rng):
    points, bent = study.bent_board(rng, "wide")
    corners, _, _ = recorded(rng, 12, model="brown", points=points, bent=bent, pixel=0.1)
    found = quietly(corners, SIZE)
    assert found.bundle.shape.name == "bow2+plane1"
    for one in found.candidates:
        if one.model == "brown" and len(one.coefficients) in (2, 4, 5):
            setting = Setting.of(MODELS["brown"], one.coefficients, {}, polynomial_shape(one.shape, corners.points))
            fit = setting.fit(corners, setting.after(found.bundle), found.bundle.used)
            true = criterion(float(np.sum(fit.residuals**2)), 2 * corners.m, corners.n, int(fit.free.sum()))
            assert found.bundle.used.all() and fit.converged
            assert one.bic == pytest.approx(true, abs=0.5 + 0.02 * (true - min(one.bic for one in found.candidates)))


@pytest.mark.slow
@pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")
def test_a_real_board_bows():
    """The focal length of kuka_1 is 2058.5(3) pixels with a flat board; another session of the rig says 2060.4(9)."""
    corners = uq.read_corners(Path(os.environ["UQ_HANDEYE_DATA"]) / "kuka_1" / "corners.csv")
    found = quietly(corners, (1928, 1208), "brown")
    assert found.bundle.shape.name.startswith("bow") and found.corners.n == 30
    assert found.intrinsics["fx"] == pytest.approx(2062.0, abs=1.0) and found.std["fx"] < 0.5
    flat = quietly(corners, (1928, 1208), "brown", shape="flat")
    assert flat.intrinsics["fx"] == pytest.approx(2058.4, abs=0.5)
