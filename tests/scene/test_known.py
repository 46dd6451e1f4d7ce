"""Later pictures in a known scene: their poses and covariance in its frame; tracks are simulated."""

import numpy as np
import pytest
from fixtures.scene_tracks import simulated

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import difference, perturb
from uq_handeye.scene.adjust import adjust, reduce
from uq_handeye.scene.known import KnownScene, adjusted_with, packed, points_in_frame, unpacked
from uq_handeye.scene.poses import as_poses, similarity


def parts(seed, old=12, new=4):
    """Simulated tracks, the scene of the first pictures as known, and the tracks of points that it has."""
    sim = simulated(seed, n=old + new, m=500, per_picture=110)
    first = sim.truth.of_pictures(np.arange(old))
    scene, noise = adjust(first)
    poses, _ = as_poses(reduce(scene, noise), scene.poses)
    _, points = sim.truth.tracks.of_pictures(np.arange(old))
    t = sim.truth.tracks
    tracks, _ = t.where(np.isin(t.point, points))
    described = scene.tracks.first
    descriptors = np.random.default_rng(seed).integers(0, 90, (len(described), 128)).astype(np.uint8)
    return sim, KnownScene(scene, poses, described, descriptors, False), tracks


@pytest.mark.slow
def test_a_known_scene_is_read_as_it_was_written():
    _, known, _ = parts(0, 6, 2)
    again = unpacked(packed(known))
    assert np.allclose(again.scene.tracks.pixels, known.scene.tracks.pixels, atol=1e-4)
    for name in ("point", "picture"):
        assert np.array_equal(getattr(again.scene.tracks, name), getattr(known.scene.tracks, name))
    assert np.array_equal(again.scene.points, known.scene.points) and np.array_equal(again.poses, known.poses)
    assert np.array_equal(again.descriptors, known.descriptors) and not again.weak
    assert again.scene.lens.names == known.scene.lens.names
    assert packed(None) == ""
    for text in ("AAAA", "no base64", packed(known)[:2000]):
        with pytest.raises(uq.InputError, match="scene of the result cannot be read"):
            unpacked(text)
    other = known._replace(described=known.described + len(known.scene.tracks))
    with pytest.raises(uq.InputError, match="do not belong together"):
        unpacked(packed(other))


@pytest.mark.statistical
def test_later_pictures_are_as_certain_as_stated():
    """d^2 of the new poses against the truth, moved so that its old poses are where the known ones are."""
    ratio = []
    for seed in range(12):
        sim, known, tracks = parts(seed)
        n, m = len(known.poses), 4
        start = perturb(sim.truth.poses[n:], np.full((m, 6), 1e-3))
        poses, covariance = adjusted_with(known, tracks, start)
        true = sim.truth.poses
        at = reduce(known.scene, 0.3)
        Q = similarity(true[:n])
        B = (at.own @ Q.reshape(n, 6, 7)).reshape(-1, 7)
        for _ in range(2):
            a = np.linalg.solve(B.T @ Q, B.T @ difference(known.poses, true[:n]).ravel())
            true = perturb(true, (similarity(true) @ a).reshape(-1, 6))
        off = difference(poses, true[n:]).ravel()
        ratio.append(off @ np.linalg.solve(np.asarray(covariance), off) / (6 * m))
    assert 0.75 < np.mean(ratio) < 1.35, ratio


@pytest.mark.slow
def test_points_are_drawn_in_the_frame_of_the_result():
    _, known, _ = parts(1, 6, 2)
    points = points_in_frame(known, 200)
    assert 150 < len(points) <= 200
    distance = np.linalg.norm(points[:, None] - known.scene.points, axis=-1).min(axis=1)
    assert distance.max() < 0.01 * np.ptp(points, axis=0).max()
    frame = perturb(np.eye(4), np.array([0.3, -0.2, 0.1, 1.0, 2.0, 3.0]))
    elsewhere = known._replace(scene=known.scene.moved(frame).scaled(1.7))
    np.testing.assert_allclose(points_in_frame(elsewhere, 200), points, atol=1e-9)
