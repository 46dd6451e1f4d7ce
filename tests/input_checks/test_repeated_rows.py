"""Poses that were given more than once are found and named wherever they stand."""

from dataclasses import replace

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.fit.diagnostics.columns import check_poses
from uq_handeye.fit.diagnostics.repeated_rows import SAME_NUMBER, repeated_rows

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
POSES = replace(uq.simulate(12, noise=NOISE, seed=2), timestamps=None)


def said(poses):
    return [str(finding) for finding in check_poses(poses) if finding.code == "input_checks.repeated_rows"]


@pytest.mark.parametrize(
    ("rows", "groups", "words"),
    [
        ([*range(12)], (), None),
        (
            [*range(12), 3],
            ((3, 12),),
            "1 of 13 poses is an earlier one again, of robot and camera (row 12 is row 3): no",
        ),
        ([*range(12), *range(12)], tuple((k, k + 12) for k in range(12)), "(rows 12 to 23 are rows 0 to 11)"),
        ([0, 0, 0, 1, 2, 1], ((0, 1, 2), (3, 5)), "(row 1 is row 0; row 2 is row 0; row 5 is row 3)"),
    ],
)
def test_found_and_named(rows, groups, words):
    poses = POSES[rows]
    assert repeated_rows(poses) == groups
    assert len(said(poses)) == (words is not None) and (words is None or words in said(poses)[0])


def test_rounding_and_what_is_measured_again(rng):
    robot, camera = (np.concatenate([T, T]) for T in (POSES.robot, POSES.camera))
    rounded = camera.copy()
    rounded[12:, :3] += rng.uniform(-0.9, 0.9, (12, 3, 4)) * SAME_NUMBER
    assert repeated_rows(uq.PosePairs(robot, rounded)) == tuple((k, k + 12) for k in range(12))
    again = perturb(camera, 1e-4 * rng.standard_normal((24, 6)))
    assert repeated_rows(uq.PosePairs(robot, again)) == () and said(uq.PosePairs(robot, again)) == []
    stale = uq.PosePairs(POSES.robot, POSES.camera[[0, 0, *range(2, 12)]])
    assert said(stale) == ["1 of 12 camera poses repeat the row before exactly: they add no information."]


def test_poses_that_share_some_numbers_are_not_compared_one_by_one(monkeypatch):
    """A robot that stood in few places, and cameras that did: no pose is near another in all of its numbers."""
    seen = uq.simulate(2_000, noise=NOISE, seed=3)
    monkeypatch.setattr("scipy.spatial.KDTree", None)
    assert repeated_rows(uq.PosePairs(seen.robot[np.arange(2_000) % 7], seen.camera)) == ()
    assert repeated_rows(uq.PosePairs(seen.robot, seen.camera[np.arange(2_000) % 7])) == ()


def test_many(rng):
    many = POSES[rng.integers(12, size=20_000)]
    assert sum(map(len, repeated_rows(many))) == 20_000
