"""Poses from points: closed forms, the covariance against actual errors, outliers, refusals."""

import warnings

import numpy as np
import pytest
from fixtures.point_sets import pose_errors, rig
from scipy import stats
from support import CONFIDENCE, SEED

from uq_handeye import InputError, InputWarning
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.model.points.closed_form import kabsch, placed
from uq_handeye.model.points.estimate import poses_from_points
from uq_handeye.model.points.least_squares import Matches, by_direction, fit, sight_lines
from uq_handeye.model.points.measured import PointSet, Target

LATERAL, AXIAL = 1e-4, 5e-4


def mean_is_one(d2, k):
    """Check that the mean of n values that are chi-square distributed with k degrees of freedom is k."""
    return abs(np.mean(d2) / k - 1.0) < stats.norm.isf((1 - CONFIDENCE) / 2) * np.sqrt(2 / (k * len(d2)))


def nees(found, T):
    e = pose_errors(T, found.poses)
    return np.einsum("na,nab,nb->n", e, np.linalg.inv(found.covariance.blocks), e)


def test_kabsch_is_exact_and_proper():
    rng = np.random.default_rng(SEED)
    y, p, T = rig(rng, 20, 4, 0.0, 0.0)
    pose, point = np.repeat(np.arange(20), 4), np.tile(np.arange(4), 20)
    found = kabsch(y.reshape(-1, 3), p[point], pose, 20, rng.uniform(0.5, 2.0, 80))
    np.testing.assert_allclose(found, T, atol=1e-12)


def test_derivatives_are_numerical_derivatives():
    rng = np.random.default_rng(SEED + 1)
    y, p, T = rig(rng, 2, 4, 1e-3, 1e-3)
    pose, p = np.repeat(np.arange(2), 4), np.tile(p, (2, 1))
    J = Matches(y.reshape(-1, 3), p, pose, 2).derivatives(T)
    h = 1e-6
    for k in range(6):
        xi = h * np.eye(6)[k]
        moved = (placed(perturb(T, xi), p, pose) - placed(perturb(T, -xi), p, pose)) / (2 * h)
        np.testing.assert_allclose(J[:, :, k], moved, atol=1e-8)


def test_the_fit_is_the_dense_least_squares_of_each_pose():
    """Covariance and stationarity against one dense least squares problem a pose, and REML against the hat matrix."""
    rng = np.random.default_rng(SEED + 2)
    y, p, T = rig(rng, 3, 6, LATERAL, AXIAL)
    points = Matches(y.reshape(-1, 3), np.tile(p, (3, 1)), np.repeat(np.arange(3), 6), 3)
    found = fit(points, T, np.array([LATERAL, AXIAL]) ** 2, estimate=True)
    at = placed(found.T, points.p, points.pose)
    half = np.linalg.cholesky(by_direction(sight_lines(at), *(1.0 / found.phi)))
    white = (half.mT @ found.J).reshape(3, 18, 6)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(white.mT @ white), rtol=1e-6)
    r = (half.mT @ found.r[..., None]).reshape(3, 18, 1)
    assert np.abs(np.linalg.lstsq(white.reshape(3, 18, 6)[0], r[0])[0]).max() < 1e-8
    hat = white @ found.covariance @ white.mT
    assert np.trace(hat, axis1=1, axis2=2).sum() == pytest.approx(18)
    assert found.dof.sum() == pytest.approx(3 * 18 - 18)
    np.testing.assert_allclose(found.squares / found.dof, found.phi, rtol=1e-4)


@pytest.mark.statistical
@pytest.mark.parametrize("axial", [LATERAL, AXIAL])
@pytest.mark.parametrize("noise", ["given", None])
def test_covariance_of_poses_of_a_known_target(axial, noise):
    rng = np.random.default_rng(SEED + 3)
    y, p, T = rig(rng, 700, 5, LATERAL, axial)
    found = poses_from_points(y, p, (LATERAL, axial) if noise == "given" else None)
    assert not found.findings and mean_is_one(nees(found, T), 6)
    for sd, true, dof in zip(found.sd, (LATERAL, axial), found.dof, strict=True):
        assert abs(sd / true - 1) < 4.0 / np.sqrt(2 * dof)


@pytest.mark.slow
def test_a_covariance_of_the_wrong_shape_is_rejected():
    """Isotropic noise assumed of a camera whose axial noise is five times the lateral one."""
    rng = np.random.default_rng(SEED + 3)
    y, p, T = rig(rng, 300, 5, LATERAL, AXIAL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        found = poses_from_points(y, p, LATERAL)
    assert not mean_is_one(nees(found, T[found.rows]), 6)
    assert [one.code for one in found.findings if one.code == "points.noise_differs"]


def test_few_residuals_do_not_give_the_noise():
    y, p, _ = rig(np.random.default_rng(SEED + 10), 1, 4, LATERAL, AXIAL)
    assert not poses_from_points(y, p, noise=(LATERAL, AXIAL)).findings
    with pytest.raises(InputError, match="degrees of freedom for the noise"):
        poses_from_points(y, p)


def test_wrong_points_are_named():
    rng = np.random.default_rng(SEED + 6)
    y, p, _ = rig(rng, 15, 6, LATERAL, AXIAL)
    y[3, 2] += [0.0, 0.02, 0.0]
    y[7, [0, 4]] = y[7, [4, 0]]
    with pytest.warns(InputWarning, match="rejected as outliers"):
        found = poses_from_points(y, p)
    assert {(pose, point) for pose, point, _ in found.outliers} == {(3, "2"), (7, "0"), (7, "4")}
    np.testing.assert_allclose(found.sd, [LATERAL, AXIAL], rtol=0.25)
    assert "pose 3, point 2" in str(next(one for one in found.findings if one.code == "points.left_out"))


def test_poses_that_cannot_be_had_are_left_out_by_number():
    rng = np.random.default_rng(SEED + 7)
    y, p, _ = rig(rng, 10, 5, LATERAL, AXIAL)
    y[4, 2:] = np.nan
    y[6, :] = y[6, 0] + np.linspace(0, 0.2, 5)[:, None] * [1.0, 0.0, 0.0]
    with pytest.warns(InputWarning, match="left out"):
        found = poses_from_points(y, p)
    assert found.rows.tolist() == [0, 1, 2, 3, 5, 7, 8, 9]
    assert dict(found.refused) == {4: "few points", 6: "in line"}
    assert "Pose 4 was left out: fewer than three" in " ".join(found.warnings)


def test_a_wrong_target_is_named():
    rng = np.random.default_rng(SEED + 8)
    y, p, _ = rig(rng, 30, 6, LATERAL, AXIAL)
    with pytest.warns(InputWarning, match="larger than those of"):
        poses_from_points(1.003 * y, p)
    off = p.copy()
    off[2] += [0.0, 0.0, 4e-4]
    with pytest.warns(InputWarning, match=r"in all poses alike: 2 \(|than those of the target"):
        poses_from_points(y, off)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda y, p: (1e3 * y, p), "--units mm"),
        (lambda y, p: (y, 1e3 * p), "--target-units mm"),
        (lambda y, p: (y, p * [1, 1, -1]), "mirror image"),
        (lambda y, p: (y[:, :1], p[:1]), "One point per pose gives no pose"),
        (lambda y, p: (y[:, :2], p[:2]), "at most 2 points per pose"),
        (lambda y, p: (y, {"a": p[0], "b": p[1], "c": p[2]}), "same name in both"),
        (lambda y, p: (y, p[[1, 2, 3, 4, 0]]), "do not fit the target"),
        (lambda y, p: (y[..., :2], p), "Expected `points`"),
        (lambda y, p: (y, np.outer(np.arange(5.0), [0.05, 0.0, 0.0])), "in a line"),
        (lambda y, p: (y, np.outer(np.arange(5.0), [0.05, 0.0, 0.0]) + 2e-4 * np.eye(5, 3)), "in a line"),
    ],
)
def test_refusals_say_what_to_do(change, words):
    y, p, _ = rig(np.random.default_rng(SEED + 9), 8, 5, LATERAL, AXIAL)
    with pytest.raises(InputError, match=words):
        poses_from_points(*change(y, p))


@pytest.mark.parametrize("noise", ["2", "1mm,2mm,3mm", "soft", "isotropic", (0.0, 1e-3), True])
def test_noise_that_makes_no_sense(noise):
    y, p, _ = rig(np.random.default_rng(SEED + 9), 8, 5, LATERAL, AXIAL)
    with pytest.raises(InputError, match="--noise"):
        poses_from_points(y, p, noise)


def test_points_are_checked():
    with pytest.raises(InputError, match="point a twice in pose 1"):
        PointSet(np.array([1, 1]), np.array(["a", "a"]), np.zeros((2, 3)))
    with pytest.raises(InputError, match="got 0 twice"):
        Target(np.array(["0", "0"]), np.zeros((2, 3)))
