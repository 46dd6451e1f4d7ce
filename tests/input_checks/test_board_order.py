"""Poses of other programs of a grid without marks, whose points they took in another order in some views."""

import re
import warnings

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.fit.diagnostics.board_order import KINDS, RECTANGLE, SQUARE, reordered_views

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.1mm"), camera=("0.1deg", "0.5mm"))
MIDDLE = np.array([0.075, 0.05, 0.0])


def read_otherwise(seed, group, share, n=20):
    """Pairs in which a share of the views is of the grid turned about its middle, and the elements (n,)."""
    rng = np.random.default_rng(seed)
    pairs = uq.simulate(n_poses=n, noise=NOISE, seed=seed)
    element = np.where(rng.permutation(n) < share * n, rng.integers(1, len(group), n), 0)
    D = np.tile(np.eye(4), (n, 1, 1))
    D[:, :3, :3] = group[element]
    D[:, :3, 3] = MIDDLE - D[:, :3, :3] @ MIDDLE
    return uq.PosePairs(pairs.robot, pairs.camera @ D), element


def named(finding):
    return {kind: list(rows) for kind, rows in finding.values.items() if kind != "rejected"}


@pytest.mark.parametrize("share", [0.1, 0.4])
@pytest.mark.parametrize("group", [RECTANGLE, SQUARE], ids=["rectangle", "square"])
def test_views_are_named_by_how_their_target_is_turned(group, share):
    for seed in range(4):
        pairs, element = read_otherwise(seed, group, share)
        expected = {kind: [k for k in range(pairs.n) if KINDS[element[k]] == kind] for kind in set(KINDS[1:])}
        assert named(reordered_views(pairs)) == expected


def test_the_calibration_says_so_in_place_of_outliers_and_rows(rng):
    pairs, _ = read_otherwise(3, RECTANGLE, 0.3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = uq.calibrate(pairs)
    (finding,) = (one for one in result.findings if one.code == "input_checks.board_order")
    assert re.match(r"The board is turned by half a turn in view.*; mirrored in view", str(finding))
    assert finding.severity == "caution" and result.usable and finding.values["rejected"]
    pairs, _ = read_otherwise(3, RECTANGLE, 0.8)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            findings = uq.calibrate(pairs).findings
        except (uq.InputError, uq.NotConvergedError) as error:
            findings = error.findings
    assert [one.severity for one in findings if one.code == "input_checks.board_order"] == ["failure"]


def test_right_rows_exchanged_rows_and_random_poses_are_not_named(rng):
    for seed in range(20):
        pairs, _ = read_otherwise(seed, RECTANGLE, 0.0)
        assert reordered_views(pairs) is None
        assert reordered_views(uq.PosePairs(np.roll(pairs.robot, 1, axis=0), pairs.camera)) is None
        camera = pairs.camera.copy()
        camera[rng.permutation(20)[:8]] = uq.simulate(n_poses=8, seed=seed + 100).camera
        assert reordered_views(uq.PosePairs(pairs.robot, camera)) is None
