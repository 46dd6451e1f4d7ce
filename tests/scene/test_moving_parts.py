"""Parts that do not stand still with the scene: a gripper in every picture, and an object that was moved half way."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fixtures.scene_tracks import SIZE, simulated

from uq_handeye.core.geometry.rotations import matrices
from uq_handeye.model.camera.models import CORNER_PX
from uq_handeye.scene.colmap import Matched, write_mask
from uq_handeye.scene.estimate import Placed
from uq_handeye.scene.moved import moved_object
from uq_handeye.scene.tracks import Tracks


def matched(keypoints, raw, n):
    """Return what was found in pictures whose features and matches are given."""
    names = tuple(f"img{k:02d}.png" for k in range(n))
    seen = Matched(Path(), Path(), names, SIZE, np.array([len(at) for at in keypoints]), np.arange(n), False, (1,))
    seen.__dict__.update(keypoints=keypoints, raw=raw, verified={})
    return seen


def with_gripper(n=10):
    """Return features of a scene that moves, and of a gripper below right that stands still, matched by number."""
    rng = np.random.default_rng(0)
    still = rng.uniform([900, 600], [1279, 959], (400, 2))
    keypoints = [np.concatenate([still + rng.normal(0, 0.3, still.shape), rng.uniform([0, 0], [1279, 590], (200, 2))])]
    keypoints += [
        np.concatenate([still + rng.normal(0, 0.3, still.shape), rng.uniform([0, 0], [1279, 590], (200, 2))])
        for _ in range(n - 1)
    ]
    all_of_them = np.tile(np.arange(600)[:, None], 2)
    return matched(keypoints, {(i, j): all_of_them for i in range(n) for j in range(i + 1, n)}, n)


def test_the_gripper_is_the_region_that_stands_still():
    seen = with_gripper()
    assert 0.6 < seen.stationary_share() <= 1.0
    region = seen.still_region()
    assert region.shape == SIZE[::-1]
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    assert region[(rows > 625) & (columns > 925)].mean() > 0.97
    assert not region[(rows < 560) | (columns < 860)].any()


def test_features_that_stand_still_between_two_pictures_only_are_no_gripper():
    seen = with_gripper()
    moved = [at + 40.0 * k for k, at in enumerate(seen.keypoints)]
    moved[1] = moved[0] + 0.2
    assert matched(moved, seen.raw, 10).still_region() is None


def test_a_mask_is_black_in_the_region_and_where_the_given_one_is(tmp_path):
    Image = pytest.importorskip("PIL.Image")
    region = np.zeros((40, 60), bool)
    region[30:] = True
    Image.fromarray(np.where(np.arange(30) < 5, 0, 255).astype(np.uint8)[None].repeat(20, 0)).save(tmp_path / "m.png")
    written = np.asarray(Image.open(write_mask(region, tmp_path / "m.png", tmp_path / "out.png")))
    assert written.shape == region.shape
    assert not written[30:].any() and not written[:, :10].any() and (written[:30, 10:] == 255).all()


def with_moved_object(moved=90, turn=0.2, shift=0.05, always=False):
    """Return a scene with its matches, of which points were moved half way; ``always``: both are seen all the time."""
    truth = simulated(3, n=12, m=500, per_picture=150).truth
    t = truth.tracks
    near = np.argsort(np.linalg.norm(truth.points[:, :2] - [0.5, 0.05], axis=1))[:moved]
    late = np.isin(t.point, near) & ((t.picture >= 6) if not always else np.random.default_rng(2).random(len(t)) < 0.5)
    point = np.where(late, t.m + t.point, t.point)
    R = matrices(np.array([0.0, 0.0, turn]))
    centre = truth.points[near].mean(axis=0)
    there = (truth.points - centre) @ R.T + centre + [shift, 0.0, 0.0]
    kept, number = np.unique(point, return_inverse=True)
    tracks = Tracks.of(t.picture, number, t.pixels, t.names, t.image_size)
    scene = replace(truth, tracks=tracks, points=np.concatenate([truth.points, there])[kept])
    before = tracks.pixels + scene.residuals()
    scene = replace(
        scene, tracks=replace(tracks, pixels=before + np.random.default_rng(1).normal(0, 0.3, before.shape))
    )
    tracks = scene.tracks
    keypoints = [tracks.pixels[one] + CORNER_PX for one in tracks.of_each_picture]
    original = [kept[tracks.point[one]] % t.m for one in tracks.of_each_picture]
    raw = {}
    for i in range(12):
        for j in range(i + 1, 12):
            _, a, b = np.intersect1d(original[i], original[j], return_indices=True)
            raw[i, j] = np.stack([a, b], axis=1)
    placed = Placed(np.arange(12), scene, 0.3, np.zeros((tracks.m, 3), np.uint8))
    return placed, matched(keypoints, raw, 12)


@pytest.mark.slow
def test_an_object_that_moved_is_told_with_its_pictures():
    placed, seen = with_moved_object()
    found = moved_object(placed, seen, in_metres=True)
    assert found.severity == "caution"
    assert found.values["before"][0] == "img00.png" and found.values["after"][0] == "img06.png"
    assert not set(found.values["before"]) & set(found.values["after"])
    assert 0.03 < found.values["length"] < 0.08
    assert "by 0.0" not in str(found) and "mm" in str(found)
    assert "mm" not in str(moved_object(placed, seen, in_metres=False))


@pytest.mark.slow
def test_what_stands_still_or_repeats_did_not_move():
    placed, seen = with_moved_object(turn=0.0, shift=0.0)
    assert moved_object(placed, seen, in_metres=True) is None
    placed, seen = with_moved_object(always=True)
    assert moved_object(placed, seen, in_metres=True) is None
