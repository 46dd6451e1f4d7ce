"""The tool brought to a point that the camera saw: statistics over drawn arms, errors of the base, refusals."""

import numpy as np
import pytest
from fixtures.arms import SIX_AXES, measured
from fixtures.rigs import quietly
from scipy.stats import chi2
from support import SEED

import uq_handeye as uq

ARM = uq.Kinematics.from_urdf(SIX_AXES, base="base_link", tip="tool0")
ERRORS = uq.KinematicErrors(
    "declared",
    offset_sd=1e-3,
    tilt_sd=5e-4,
    length_sd=2e-4,
    transmission_sd=1e-4,
    sag_sd=3e-4,
    joint_sd=1e-4,
    flange="physical",  # that of the tool, which stands in the machined flange
)
CAMERA = (4e-4, 1e-4)
NOISE = uq.PoseNoise(camera=np.diag(np.repeat(CAMERA, 3)) ** 2)
SD = np.array([ERRORS.standard_deviations[part.group] for part in ARM.errors])
IN_VIEW = np.array([0.05, -0.02, 0.4])


def calibrated(rng, setup, n=20):
    e = SD * rng.normal(size=len(SD))
    poses, X, _ = measured(ARM, rng, n, e=e, setup=setup, near=0.5, joint_sd=ERRORS.joint_sd, camera=CAMERA)
    result = quietly(poses, noise=NOISE, kinematics=ARM, kinematic_errors=ERRORS, robust=False, correlation="none")
    return result, e, X


def point_of(e, X, setup, q):
    """Return the point in view in the base."""
    p = X[:3, :3] @ IN_VIEW + X[:3, 3]
    G = ARM.poses(q, e)
    return p if setup == "eye-to-hand" else (G[..., :3, :3] @ p) + G[..., :3, 3]


def tip_at(e, q, tool):
    G = ARM.poses(q, e)
    return (G[..., :3, :3] @ tool[..., None])[..., 0] + G[..., :3, 3]


@pytest.mark.statistical
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_misses_are_as_large_as_predicted(setup):
    rng = np.random.default_rng(SEED)
    sd = ERRORS.joint_sd
    d2, misses = [], []
    for _ in range(70):
        result, e, X = calibrated(rng, setup)
        q, there = (rng.uniform(-1.2, 1.2, (3, 6)) for _ in range(2))
        goal, G = point_of(0 * e, X, setup, q), ARM.poses(there)
        tool = (np.swapaxes(G[:, :3, :3], 1, 2) @ (goal - G[:, :3, 3])[..., None])[..., 0]
        seen_at = {} if setup == "eye-to-hand" else {"joints": q}
        found = result.predict(IN_VIEW, **seen_at, reached_at=there, tool=tool)
        at = [joints + sd * rng.normal(size=joints.shape) for joints in (q, there)]
        off = tip_at(e, at[1], tool) - point_of(e, X, setup, at[0]) - found.points
        d2.append((off[:, None] @ np.linalg.solve(found.covariance, off[..., None]))[:, 0, 0])
        misses.append(np.linalg.norm(off, axis=-1))
    d2 = np.array(d2)
    assert 2.4 < d2.mean() < 3.6, d2.mean()
    inside = (d2 < chi2.ppf(0.95, 3)).mean()
    assert 0.91 < inside < 0.99, inside
    assert 1e-4 < np.sqrt(np.mean(np.square(misses))) < 5e-3


def test_what_moves_point_and_tool_alike_cancels():
    rng = np.random.default_rng(SEED)
    result, _, _ = calibrated(rng, "eye-in-hand")
    q = rng.uniform(-1, 1, (4, 6))
    alone = result.predict(IN_VIEW, q)
    X = result.X
    on_the_point = X[:3, :3] @ IN_VIEW + X[:3, 3]  # the tip where the point is: the arm has not moved
    miss = result.predict(IN_VIEW, q, reached_at=q, tool=on_the_point)
    np.testing.assert_allclose(miss.points, 0.0, atol=1e-12)
    G = result.kinematics.poses(q)
    by_X = G[:, :3, :3] @ result.uncertainty_at(IN_VIEW).covariance @ np.swapaxes(G[:, :3, :3], 1, 2)
    lever = miss.covariance - by_X  # noise of the joints, of both poses
    assert (np.linalg.eigvalsh(lever) > -1e-15).all() and miss.frame == "base"
    assert (miss.radius_95 < alone.radius_95).all()


def test_the_tool_is_at_the_flange_where_nothing_is_said():
    rng = np.random.default_rng(SEED)
    result, _, _ = calibrated(rng, "eye-to-hand", 12)
    there = np.zeros((2, 6))
    found = result.predict(IN_VIEW, reached_at=there)
    same = result.predict(IN_VIEW, joints=np.ones(6), reached_at=there, tool=[0, 0, 0])
    np.testing.assert_array_equal(found.covariance, same.covariance)  # the camera stands still
    of_tip = result.kinematics.poses(there)[:, :3, 3]
    np.testing.assert_allclose(found.points, of_tip - result.predict(IN_VIEW, np.zeros(6)).points, atol=1e-15)
    assert result.predict(np.zeros((5, 1, 3)), reached_at=there).covariance.shape == (5, 2, 3, 3)


@pytest.mark.slow
def test_refusals():
    result, _, _ = calibrated(np.random.default_rng(SEED), "eye-in-hand", 12)
    for options in (
        {"joints": np.zeros(6), "tool": np.zeros(3)},
        {"joints": np.zeros(6), "reached_at": np.zeros(5)},
        {"joints": np.zeros(6), "reached_at": np.zeros(6), "tool": np.zeros(2)},
        {"joints": np.zeros((2, 6)), "reached_at": np.zeros((3, 6))},
        {"joints": np.zeros(6), "reached_at": np.zeros(6), "tool": [np.nan, 0, 0]},
        {"reached_at": np.zeros(6)},
    ):
        with pytest.raises(uq.InputError):
            result.predict(IN_VIEW, **options)
