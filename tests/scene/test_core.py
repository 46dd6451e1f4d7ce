"""Normal equations of a scene and the covariance of its camera poses, against independent computations."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.scene_tracks import TRUE_LENS, X_TRUE, simulated

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import difference, inverse, perturb
from uq_handeye.model.errors.joint_covariance import JointCovariance
from uq_handeye.scene.adjust import adjust, joint_covariance, reduce, weights_of
from uq_handeye.scene.lens import Lens
from uq_handeye.scene.poses import as_poses, similarity, without_lens


@pytest.fixture(scope="module")
def small():
    return simulated(3, n=6, m=60, per_picture=40).truth


@pytest.fixture(scope="module")
def adjusted():
    sim = simulated(1, n=12, m=500, per_picture=110)
    return sim, *adjust(sim.start)


def dense(scene, s):
    """Return S and g by finite differences of all weighted residuals and a dense elimination of the points."""
    w = weights_of(scene.residuals(), s)
    n, m = scene.tracks.n, scene.tracks.m
    free = np.flatnonzero(scene.lens.free)
    size = 6 * n + len(free)

    def rows(x):
        values = scene.lens.values.copy()
        values[free] += x[6 * n : size]
        moved = replace(
            scene,
            poses=perturb(scene.poses, x[: 6 * n].reshape(n, 6)),
            points=scene.points + x[size:].reshape(m, 3),
            lens=scene.lens.at(values),
        )
        return np.concatenate([(np.sqrt(w) / s)[:, None] * moved.residuals()], 0).ravel(), moved.lens.prior_rows()[0]

    steps = np.full(size + 3 * m, 1e-6)
    steps[6 * n : 6 * n + 4] = 1e-3
    columns = []
    for k, h in enumerate(steps):
        x = np.zeros(len(steps))
        x[k] = h
        (up, p), (down, q) = rows(x), rows(-x)
        columns.append(np.concatenate([up - down, p - q]) / (2 * h))
    J, r = np.array(columns).T, np.concatenate(rows(np.zeros(len(steps))))
    H, g = J.T @ J, J.T @ r
    gain = H[:size, size:] @ np.linalg.inv(H[size:, size:])
    return H[:size, :size] - gain @ H[size:, :size], g[:size] - gain @ g[size:]


@pytest.mark.slow
def test_reduced_normal_equations_by_finite_differences(small):
    S, g = dense(small, 0.3)
    found = reduce(small, 0.3)
    unit = 1.0 / np.sqrt(np.diag(S))
    assert np.abs((found.S - S) * np.outer(unit, unit)).max() < 1e-5
    assert np.abs((found.g - g) * unit).max() < 1e-4 * np.abs(g * unit).max() + 1e-6


def test_a_similarity_of_the_scene_changes_nothing(small):
    found = reduce(small, 0.3)
    Lambda, _ = without_lens(found)
    unit = 1.0 / np.sqrt(np.diag(Lambda))
    Q = similarity(small.poses) / unit[:, None]
    assert np.abs(Lambda * np.outer(unit, unit) @ Q / np.linalg.norm(Q, axis=0)).max() < 1e-6
    turned = small.moved(X_TRUE).scaled(3.0)
    assert np.allclose(turned.residuals(), small.residuals(), atol=1e-9)


@pytest.mark.slow
def test_poses_have_the_covariance_of_the_pictures_but_for_the_similarity(adjusted):
    _, scene, s = adjusted
    at = reduce(scene, s)
    poses, covariance = as_poses(at, scene.poses)
    assert 6 < covariance.shared.shape[-1] < 60
    # in relative motions, without the similarity: the information is that of the pictures
    Lambda, _ = without_lens(at)
    S = np.asarray(covariance)
    h = np.sqrt(np.diag(S))
    Q = np.linalg.qr(similarity(poses) / h[:, None])[0]
    values, vectors = np.linalg.eigh(Lambda * np.outer(h, h))
    found = vectors[:, 7:].T @ (S / np.outer(h, h)) @ vectors[:, 7:]
    ratio = np.sqrt(np.diag(found) * values[7:])
    assert np.all(ratio > 0.7) and 0.9 < np.median(ratio) < 1.5
    assert Q.shape[1] == 7


def test_the_poses_are_the_minimum_wherever_they_are_linearised(adjusted):
    _, scene, s = adjusted
    rng = np.random.default_rng(0)
    at, sd = reduce(scene, s), joint_covariance(reduce(scene, s), gauge=similarity(scene.poses))
    near = np.sqrt(np.diag(sd))[: 6 * at.n].reshape(-1, 6) * rng.normal(size=(at.n, 6))
    weights = weights_of(scene.residuals(), s)
    first, _ = as_poses(reduce(scene, s, weights), scene.poses)
    moved = replace(scene, poses=perturb(scene.poses, near))
    other = reduce(moved, s, weights)
    moved = replace(moved, points=moved.points + other.points_after(np.zeros(len(other.g))))
    second, _ = as_poses(reduce(moved, s, weights), moved.poses)
    # the same relative motions to far below their noise
    relative = [C[1:] @ inverse(C[:1]) for C in (first, second)]
    unit = [np.linalg.norm(C[1:, :3, 3] - C[:-1, :3, 3], axis=-1).mean() for C in (inverse(first), inverse(second))]
    relative[1][:, :3, 3] *= unit[0] / unit[1]
    off = difference(*relative)
    assert np.abs(off[:, :3]).max() < 0.2 * np.sqrt(np.diag(sd))[:3].max()


def test_covariance_is_that_of_colmap():
    pycolmap = pytest.importorskip("pycolmap")
    sim = simulated(5, n=8, m=150, per_picture=80)
    lens = Lens(TRUE_LENS, sim.truth.lens.free, TRUE_LENS, np.full(12, np.inf), False)
    scene = replace(sim.truth, lens=lens)
    at = reduce(scene, 1.0, np.ones(len(scene.tracks)))
    fixed = np.arange(6)
    kept = np.setdiff1d(np.arange(len(at.S)), fixed)
    gauge = similarity(scene.poses)
    gauge[fixed] = 0.0
    scale = np.zeros((len(at.S), 1))
    scale[: 6 * at.n, 0] = (similarity(scene.poses) @ _holding_first(scene.poses))[:, 0]
    S = at.S[np.ix_(kept, kept)]
    unit = 1.0 / np.sqrt(np.diag(S))
    q = scale[kept] / unit[:, None]
    q /= np.linalg.norm(q)
    covariance = (np.linalg.inv(S * np.outer(unit, unit) + q @ q.T) - q @ q.T) * np.outer(unit, unit)
    theirs = _of_colmap(pycolmap, scene)
    ours = covariance[-8:, -8:]
    assert np.allclose(np.sqrt(np.diag(theirs[0])) / np.sqrt(np.diag(ours)), 1.0, atol=1e-3)
    for k in range(1, at.n):  # tangents of quaternions are half angles
        rotation = covariance[6 * (k - 1) : 6 * (k - 1) + 3, 6 * (k - 1) : 6 * (k - 1) + 3]
        assert np.allclose(np.sqrt(np.diag(rotation)) / np.sqrt(np.diag(theirs[1][k])), 2.0, rtol=2e-3)


def _holding_first(poses):
    """Return the similarity (7, 1) that changes the size of the scene about the first camera."""
    eye = inverse(poses)[0, :3, 3]
    return np.concatenate([np.zeros(3), -eye, [1.0]])[:, None]


def _of_colmap(pycolmap, scene):
    """Return COLMAP's covariance of the lens and of the rotations of each picture, the first of which is held."""
    t, values = scene.tracks, scene.lens.values[:8]
    rec = pycolmap.Reconstruction()
    camera = pycolmap.Camera(model="OPENCV", width=t.image_size[0], height=t.image_size[1], params=values, camera_id=1)
    rec.add_camera_with_trivial_rig(camera)
    order = [np.flatnonzero(t.picture == k) for k in range(t.n)]
    place = np.zeros(len(t), dtype=int)
    for k, rows in enumerate(order):
        place[rows] = np.arange(len(rows))
        image = pycolmap.Image(name=t.names[k], keypoints=t.pixels[rows], camera_id=1, image_id=k + 1)
        rec.add_image_with_trivial_frame(image, pycolmap.Rigid3d(scene.poses[k, :3]))
    for j in range(t.m):
        track = pycolmap.Track()
        for row in np.flatnonzero(t.point == j):
            track.add_element(int(t.picture[row]) + 1, int(place[row]))
        rec.add_point3D(scene.points[j], track)
    config = pycolmap.BundleAdjustmentConfig()
    for k in range(t.n):
        config.add_image(k + 1)
    config.set_constant_rig_from_world_pose(1)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = True
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, rec)
    found = pycolmap.estimate_ba_covariance(pycolmap.BACovarianceOptions(), rec, adjuster)
    of_lens = np.asarray(found.get_other_params_cov(rec.camera(1).params))
    return of_lens, {k: np.asarray(found.get_cam_cov_from_world(k + 1))[:3, :3] for k in range(1, t.n)}


def test_lens_prior_and_known_intrinsics():
    lens = Lens.of((1000, 800), {"fx": 900.0, "cx": (505.0, 2.0)})
    assert not lens.free[0] and lens.free[2] and lens.f == 7 and not lens.square
    rows, J = lens.at(lens.values + np.eye(12)[2]).prior_rows()
    assert rows.max() == 0.5 and J.shape == (6, 7)
    with pytest.raises(uq.InputError, match="brown"):
        Lens.of((1000, 800), {"k9": 0.0})


@pytest.mark.slow
def test_X_of_simulated_tracks_is_as_good_as_it_says():
    squares = []
    for seed in range(4):
        sim = simulated(seed)
        scene, s = adjust(sim.start)
        poses, covariance = as_poses(reduce(scene, s), scene.poses)
        eyes = [np.linalg.norm(np.diff(inverse(C)[:, :3, 3], axis=0), axis=1) for C in (sim.truth.poses, poses)]
        unit = np.median(eyes[0] / eyes[1])
        poses, D = poses.copy(), np.repeat([1.0, unit], 3)
        poses[:, :3, 3] *= unit
        covariance = JointCovariance(D[:, None] * covariance.own * D, D[:, None] * covariance.shared)
        pairs = uq.PosePairs(sim.robot, poses, camera_covariance=covariance)
        found = uq.calibrate(pairs, shared=[uq.SharedError.target_scale("5%")])
        off = difference(X_TRUE, found.X)
        squares.append(off @ np.linalg.solve(found.covariance, off))
        assert np.linalg.norm(off[3:]) < 0.5e-3
    assert 1.0 < np.mean(squares) < 10.0
