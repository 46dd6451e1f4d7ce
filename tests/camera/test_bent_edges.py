"""Corners between bent edges: against the minimum of the functional, and against OpenCV on pictures."""

import json
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import erf
from support import SEED

import uq_handeye as uq
from studies.common.pictures import Camera, picture
from uq_handeye.model.camera.adjustment import bent_edges
from uq_handeye.model.camera.chessboard import chessboard_finder
from uq_handeye.model.camera.corners import Corners
from uq_handeye.model.camera.models import MODELS

BOARD = uq.Board(9, 6, "20mm")
SIZE = (640, 480)
BENDING = Camera("fisheye", np.array([300.0, 301, 322, 236, -0.02, 0.005, -0.002, 0]), SIZE)
STRAIGHT = Camera("pinhole", np.array([600.0, 598, 322, 236]), SIZE)


def functional_minimum(a, directions, curvature, sigma):
    """The p of least ``sum w (g . (q - p))^2`` by its own iteration, on a picture given as a function."""
    step = 0.5
    p = np.zeros(2)
    for _ in range(12):
        q = p + np.stack(np.meshgrid(*(np.arange(-a - 0.5 + step / 2, a + 0.5, step),) * 2), axis=-1)
        value, slope = [], []
        for angle, k in zip(directions, curvature, strict=True):
            t, n = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
            # blurred as heat spreads: a bent edge moves inwards
            beside = (q @ n - 0.5 * k * ((q @ t) ** 2 + sigma**2)) / (np.sqrt(2) * sigma)
            value.append(erf(beside))
            slope.append(np.exp(-(beside**2))[..., None] * (n - k * (q @ t)[..., None] * t))
        g = value[1][..., None] * slope[0] + value[0][..., None] * slope[1]
        w = np.exp(-np.sum((q - p) ** 2, axis=-1) / a**2)
        M = np.einsum("ij,ijk,ijl->kl", w, g, g)
        p = np.linalg.solve(M, np.einsum("ij,ijk,ijl,ijl->k", w, g, g, q))
    return p


@pytest.mark.parametrize(("a", "angles"), [(10, (5, 95)), (12, (20, 100)), (30, (-35, 40)), (20, (0, 110))])
def test_the_closed_form_is_the_minimum_of_the_functional(a, angles):
    angles, curvature = np.radians(angles), np.array([4e-4, -7e-4])
    tangent = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    d = bent_edges.shift(np.array([float(a)]), tangent[None], curvature[None])[0]
    p = functional_minimum(a, angles, curvature, float(bent_edges.blur(np.array(float(a)))))
    assert np.linalg.norm(p) > 0.004
    np.testing.assert_allclose(d, p, atol=0.03 * np.linalg.norm(p))


@cache
def found(camera, blur):
    """Corners of a few pictures without noise, as detected, with the true poses and pixels."""
    pytest.importorskip("cv2")
    rng = np.random.default_rng(SEED)
    find = chessboard_finder(BOARD)
    parts, poses = [], []
    for tilt, roll, z in ((0, 3, 0.11), (25, -20, 0.13), (-30, 48, 0.15)):
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("yz", [tilt, roll], degrees=True).as_matrix()
        T[:3, 3] = [0.004, -0.003, z * camera.parameters[0] / 300] - T[:3, :3] @ BOARD.points.mean(axis=0)
        parts.append(find(picture(camera, BOARD, T, rng, noise=0.0, blur=blur)))
        poses.append(T)
    poses = np.array(poses)
    corners = Corners(
        np.repeat(range(3), 54),
        BOARD.points[np.concatenate([part[0] for part in parts])],
        np.concatenate([part[1] for part in parts]),
        window=np.concatenate([part[2] for part in parts]),
    )
    return corners, poses, camera.seen(BOARD.points, poses).reshape(-1, 2)


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.slow
@pytest.mark.parametrize("blur", [0.3, 0.8])
def test_opencv_finds_corners_beside_bent_edges_by_that_much(blur):
    corners, poses, truth = found(BENDING, blur)
    camera = SimpleNamespace(model=MODELS["fisheye"], intrinsics=BENDING.parameters, poses=poses)
    d, off = bent_edges.bias(camera, corners), corners.pixels - truth
    assert np.abs(d).max() > 0.05
    assert np.sum(d * off) / np.sum(d * d) == pytest.approx(1.0, abs=0.06)
    assert rms(off - d) < 0.5 * rms(off)


@pytest.mark.slow
def test_straight_edges_move_no_corner():
    corners, poses, _ = found(STRAIGHT, 0.0)
    camera = SimpleNamespace(model=MODELS["pinhole"], intrinsics=STRAIGHT.parameters, poses=poses)
    assert np.abs(bent_edges.bias(camera, corners)).max() < 1e-8


@pytest.mark.slow
def test_without_windows_nothing_is_moved():
    corners, poses, _ = found(BENDING, 0.3)
    camera = SimpleNamespace(model=MODELS["fisheye"], intrinsics=BENDING.parameters, poses=poses)
    table = Corners(corners.row, corners.points, corners.pixels)
    assert not bent_edges.bias(camera, table).any()
    some = np.where(np.arange(corners.m) % 2, corners.window, 0)
    d = bent_edges.bias(camera, Corners(corners.row, corners.points, corners.pixels, window=some))
    np.testing.assert_array_equal(d.any(axis=1), some > 0)
    np.testing.assert_array_equal(d[some > 0], bent_edges.bias(camera, corners)[some > 0])


@pytest.mark.slow
def test_a_camera_is_calibrated_on_corners_that_are_moved_back_once(tmp_path, without_rendering):
    corners, poses, _ = found(BENDING, 0.3)
    lens = dict(zip(("k1", "k2", "k3", "k4"), BENDING.parameters[4:].tolist(), strict=True))
    how = {"model": "fisheye", "shape": "flat", "coefficients": (), "intrinsics": lens, "exact": True}
    with pytest.warns(uq.InputWarning, match="The given intrinsics do not fit the pictures"):
        before = uq.calibrate_camera(replace(corners, window=None), SIZE, **how)
    after = uq.calibrate_camera(corners, SIZE, **how)
    off = [rms(camera.poses[:, :3, 3] - poses[:, :3, 3]) for camera in (before, after)]
    assert off[1] < 0.3 * off[0]
    assert before.corners.pixels.tolist() == corners.pixels.tolist()

    moved = np.linalg.norm(after.corners.pixels - corners.pixels, axis=1)
    agrees, finding = after.findings
    assert agrees.code == "camera.given_agree"
    assert (finding.code, finding.severity) == ("camera.bent_edges", "note") and after.warnings == ()
    assert finding.values == {"largest": pytest.approx(moved.max()), "rms": pytest.approx(rms(moved))}
    assert f"moved by up to {moved.max():.3f} pixels" in " ".join(after.summary().split())

    folder = after.write(tmp_path / "camera")
    stored = json.loads((folder / "intrinsics.json").read_text(encoding="utf-8"))
    assert finding.to_dict() in stored["findings"]
    assert uq.read_camera(folder).findings == after.findings
    again = uq.calibrate_camera(uq.read_corners(folder / "corners.csv"), SIZE, **how)
    assert [one.code for one in again.findings] == ["camera.given_agree"]
    np.testing.assert_allclose(again.poses, after.poses, atol=1e-8)
