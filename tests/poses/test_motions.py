"""Motions: the equation A X = X B that defines them, and which poses make a pair."""

import numpy as np
import pytest
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform
from support import exact_poses, holds_for, random_transforms

from uq_handeye.core.geometry.frames import SETUPS
from uq_handeye.errors import InputError
from uq_handeye.model.poses.motions import Motions, pair_indices, relative_motions
from uq_handeye.model.poses.pose_pairs import PosePairs

KINDS = {
    "consecutive": [[0, 1], [1, 2], [2, 3], [3, 4]],
    "disjoint": [[0, 1], [2, 3]],
    "all": [[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [1, 3], [1, 4], [2, 3], [2, 4], [3, 4]],
}
CUSTOM = [[4, 0], [1, 3], [1, 3], [3, 1]]


@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("pairs", [*KINDS, CUSTOM], ids=str)
def test_AX_equals_XB(rng, setup, pairs):
    X, robot, camera = exact_poses(rng, 5, setup)
    motions = relative_motions(PosePairs(robot, camera, setup), pairs)
    np.testing.assert_allclose(motions.A @ X, X @ motions.B, rtol=0, atol=1e-12)
    assert np.abs(motions.A - motions.B).max() > 0.1
    assert motions.A.shape == motions.B.shape == (len(motions), 4, 4)
    assert motions.N == len(motions) == len(motions.pairs)
    assert motions.poses.setup == setup


@pytest.mark.parametrize("setup", SETUPS)
def test_definition(rng, setup):
    """``A_ij = inv(G_j) G_i``, ``B_ij = C_j inv(C_i)``, with G inverted for eye-to-hand."""
    robot, camera = random_transforms(rng, (5,)), random_transforms(rng, (5,))
    motions = relative_motions(PosePairs(robot, camera, setup), CUSTOM)
    G = robot if setup == "eye-in-hand" else np.linalg.inv(robot)
    for k, (i, j) in enumerate(CUSTOM):
        np.testing.assert_allclose(motions.A[k], np.linalg.solve(G[j], G[i]), rtol=0, atol=1e-13)
        np.testing.assert_allclose(motions.B[k], camera[j] @ np.linalg.inv(camera[i]), rtol=0, atol=1e-13)


@pytest.mark.parametrize("setup", SETUPS)
def test_eye_to_hand_is_eye_in_hand_with_inverted_robot(rng, setup):
    robot, camera = random_transforms(rng, (5,)), random_transforms(rng, (5,))
    other = next(s for s in SETUPS if s != setup)
    one = relative_motions(PosePairs(robot, camera, setup))
    two = relative_motions(PosePairs(np.linalg.inv(robot), camera, other))
    np.testing.assert_allclose(one.A, two.A, rtol=0, atol=1e-13)


def test_batches(rng):
    robot, camera = random_transforms(rng, (2, 3, 5)), random_transforms(rng, (2, 3, 5))
    batch = relative_motions(PosePairs(robot, camera), "all")
    assert batch.A.shape == (2, 3, 10, 4, 4)
    assert batch.N == 10
    for k in np.ndindex(2, 3):
        one = relative_motions(PosePairs(robot[k], camera[k]), "all")
        np.testing.assert_allclose(batch.A[k], one.A, rtol=0, atol=1e-14)
        np.testing.assert_allclose(batch.B[k], one.B, rtol=0, atol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_pair_kinds(kind):
    index = pair_indices(5, kind)
    assert index.tolist() == KINDS[kind]
    assert index.dtype == np.intp


@pytest.mark.slow
@holds_for(n=st.integers(0, 40))
def test_pair_counts(n):
    every = {tuple(p) for p in pair_indices(n, "all").tolist()}
    assert every == {(i, j) for i in range(n) for j in range(i + 1, n)}
    chain = pair_indices(n, "consecutive").tolist()
    assert chain == [[i, i + 1] for i in range(n - 1)]
    apart = pair_indices(n, "disjoint")
    assert len(apart) == n // 2
    assert len(set(apart.ravel().tolist())) == apart.size  # no pose twice


def test_custom_pairs_are_kept_as_given():
    for given in (CUSTOM, np.array(CUSTOM, dtype=np.int32), np.array(CUSTOM, dtype=np.uint8)):
        assert pair_indices(5, given).tolist() == CUSTOM
    assert pair_indices(5, np.empty((0, 2), int)).shape == (0, 2)


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ("every", r"'consecutive', 'disjoint', 'all' or an \(N, 2\) integer array, got 'every'"),
        ([0, 1], r"\(N, 2\) integer array, got shape \(2,\) of int"),
        ([[0, 1, 2]], r"got shape \(1, 3\)"),
        ([[0.0, 1.0]], r"got shape \(1, 2\) of float64"),
        ([[True, False]], r"got shape \(1, 2\) of bool"),
        ([], r"got shape \(0,\)"),
        (None, r"integer array"),
        ([[0, 1], [2, 5]], "pose numbers 0 to 4, got 5"),
        ([[0, 1], [-1, 2]], "pose numbers 0 to 4, got -1"),
        ([[0, 1], [3, 3]], r"two different poses in each pair, got \[3, 3\] in `pairs`\[1\]"),
    ],
)
def test_bad_pairs(pairs, message):
    with pytest.raises(InputError, match=message):
        pair_indices(5, pairs)


def test_relative_motions_wants_poses(rng):
    with pytest.raises(InputError, match="`poses` to be PosePairs, got ndarray"):
        relative_motions(random_transforms(rng, (5,)))


def test_motions_without_poses(rng):
    A, B = random_transforms(rng, (5,)), random_transforms(rng, (5,))
    motions = Motions(RigidTransform.from_matrix(A), B)
    np.testing.assert_allclose(motions.A, A, rtol=0, atol=1e-14)
    assert motions.poses is None
    assert motions.pairs is None
    assert repr(motions) == "Motions(5 pairs)"
    assert repr(relative_motions(PosePairs(A, B))) == "Motions(4 pairs of 5 poses)"


def test_motions_are_checked(rng):
    A, B = random_transforms(rng, (5,)), random_transforms(rng, (5,))
    with pytest.raises(InputError, match=r"same number of motions, got shapes \(5, 4, 4\) and \(4, 4, 4\)"):
        Motions(A, B[:4])
    with pytest.raises(InputError, match="`pairs` and `poses` together"):
        Motions(A, B, np.array([[0, 1]] * 5))
    B[2, :3, :3] *= 1.1
    with pytest.raises(InputError, match=r"`B`\[2\] to hold a rotation"):
        Motions(A, B)


def test_motions_with_poses_are_checked(rng):
    """The public constructor takes `poses` too: what it cannot use it must refuse."""
    A, B = random_transforms(rng, (4,)), random_transforms(rng, (4,))
    poses = PosePairs(random_transforms(rng, (5,)), random_transforms(rng, (5,)))
    pairs = pair_indices(5)
    with pytest.raises(InputError):
        Motions(A, B, poses=poses)
    with pytest.raises(InputError):
        Motions(A, B[:3], pairs, poses)
