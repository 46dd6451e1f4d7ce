"""Interpolation: (37)-(38) on SO(4) in closed form against the SVD, the geodesic, truth, and what is refused."""

import numpy as np
import pytest
from fixtures.streams import motion
from support import SEED, difference, jacobian, moved, random_transforms, rotations, transforms

from uq_handeye import InputError, orthonormalise, so4_from_se3
from uq_handeye.core.geometry.se3 import left_jacobian
from uq_handeye.read.synchronisation.interpolation import (
    AFTER,
    BEFORE,
    FINE,
    GAP,
    KINDS,
    MAX_STEP_RAD,
    TURN,
    at_times,
    error_of_interpolation,
    interpolate,
    misses,
    noise_floor,
)

ANGLES = (0.0, 1e-12, 1e-9, 1e-6, 1e-4, 1e-2, 0.1, 0.3, 1.0, 2.0, 3.0, MAX_STEP_RAD - 1e-6)


def steps(rng, angle, n=200):
    """Poses, poses that lie ``angle`` and about as many metres away, and weights."""
    first = random_transforms(rng, (n,))
    axis = rng.normal(size=(n, 3))
    axis *= angle / np.linalg.norm(axis, axis=1, keepdims=True)
    return first, first @ transforms(rotations(axis), angle * rng.normal(size=(n, 3))), rng.uniform(size=n)


@pytest.mark.parametrize("angle", ANGLES)
def test_so4_in_closed_form_is_problem_1_in_the_limit(angle):
    """The SVD of (37) at finite d, d growing, goes to it by 1/d^2."""
    first, second, w = steps(np.random.default_rng(SEED), angle)
    limit = interpolate(first, second, w)
    apart = [np.abs(interpolate(first, second, w, scale=d) - limit).max() for d in (1e2, 1e3, 1e4)]
    assert apart[2] < 1e-4
    assert apart[1] < 0.02 * apart[0]
    assert apart[2] < 0.02 * apart[1]


def test_finite_d_maximises_37():
    rng = np.random.default_rng(SEED)
    first, second, w = steps(rng, 0.4, 30)
    E_0, E_1 = so4_from_se3(first, 10.0), so4_from_se3(second, 10.0)
    H = w[:, None, None] * E_0 + (1 - w)[:, None, None] * E_1
    best = orthonormalise(H)
    value = np.einsum("nij,nij->n", best, H)
    for _ in range(20):
        other = orthonormalise(best + 0.05 * rng.normal(size=best.shape))
        assert (np.einsum("nij,nij->n", other, H) < value).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("angle", ANGLES)
def test_ends_and_frames(kind, angle):
    """The ends are the samples; inverses and transforms before and behind make no difference."""
    rng = np.random.default_rng(SEED)
    first, second, w = steps(rng, angle)
    middle = interpolate(first, second, w, kind)
    assert np.abs(interpolate(first, second, np.ones(len(w)), kind) - first).max() < 1e-13
    assert np.abs(interpolate(first, second, np.zeros(len(w)), kind) - second).max() < 1e-12
    assert np.abs(interpolate(second, first, 1 - w, kind) - middle).max() < 1e-12
    inverse = interpolate(np.linalg.inv(first), np.linalg.inv(second), w, kind)
    assert np.abs(np.linalg.inv(inverse) - middle).max() < 1e-12
    before, behind = random_transforms(rng), random_transforms(rng)
    turned = interpolate(before @ first @ behind, before @ second @ behind, w, kind)
    assert np.abs(turned - before @ middle @ behind).max() < 1e-11


def test_both_kinds_agree_to_third_order():
    apart = []
    for angle in (0.4, 0.2, 0.1):
        first, second, w = steps(np.random.default_rng(SEED + 1), angle, 500)
        d = difference(interpolate(first, second, w), interpolate(first, second, w, "geodesic"))
        apart.append([np.linalg.norm(part, axis=1).max() for part in (d[:, :3], d[:, 3:])])
    for shrink in (np.divide(apart[0], apart[1]), np.divide(apart[1], apart[2])):
        assert (np.abs(shrink - 8.0) < 0.5).all(), shrink
    assert apart[2][0] < 0.0165 * 0.1**3


@pytest.mark.parametrize("kind", KINDS)
def test_truth_is_missed_by_second_order(kind):
    pose = motion(np.random.default_rng(SEED), 4.0)
    missed = []
    for step in (0.04, 0.02, 0.01):
        times = np.arange(0.0, 4.0, step)
        at = np.arange(0.1, 3.8, 0.0137)
        found = at_times(times, pose(times), at, kind)
        assert found.fine.all()
        d = difference(found.poses, pose(at))
        missed.append([np.sqrt(np.mean(part**2)) for part in (d[:, :3], d[:, 3:])])
    for shrink in (np.divide(missed[0], missed[1]), np.divide(missed[1], missed[2])):
        assert ((shrink > 3.6) & (shrink < 4.4)).all(), shrink


def test_geodesic_is_exact_on_a_screw():
    rng = np.random.default_rng(SEED)
    start, turn, rate = random_transforms(rng), rng.normal(size=3), rng.normal(size=3)

    def screw(t):
        v = np.asarray(t)[:, None]
        return start @ transforms(rotations(v * turn), (left_jacobian(v * turn) @ (v * rate)[..., None])[..., 0])

    times = np.arange(0, 3, 0.5)
    at = rng.uniform(0, 2.4, 50)
    assert np.abs(at_times(times, screw(times), at, "geodesic").poses - screw(at)).max() < 1e-12


@pytest.mark.parametrize("angle", [MAX_STEP_RAD + 1e-3, np.pi])
def test_half_a_turn_is_refused(angle):
    first, second, w = steps(np.random.default_rng(SEED), angle, 3)
    for kind in KINDS:
        with pytest.raises(InputError, match="below 177 degrees"):
            interpolate(first, second, w, kind)


def test_what_is_no_weight_or_kind_is_refused():
    first, second, w = steps(np.random.default_rng(SEED), 0.1, 3)
    for bad in (w + 1, w - 1, np.full(3, np.nan)):
        with pytest.raises(InputError, match="not extrapolated"):
            interpolate(first, second, bad)
    with pytest.raises(InputError, match="so4, geodesic"):
        interpolate(first, second, w, "slerp")
    with pytest.raises(InputError, match="no `scale`"):
        interpolate(first, second, w, "geodesic", scale=1e4)


def test_nothing_is_extrapolated_and_no_gap_is_bridged():
    rng = np.random.default_rng(SEED)
    pose = motion(rng, 3.0)
    times = np.array([0.0, 0.1, 0.2, 1.2, 1.3, 1.4])
    poses = pose(times)
    poses[5, :3, :3] = poses[4, :3, :3] @ rotations([np.pi, 0, 0])
    at = np.array([-1e-9, 0.0, 0.15, 0.2, 0.2001, 1.1999, 1.2, 1.25, 1.35, 1.4, 1.4 + 1e-9])
    found = at_times(times, poses, at, max_gap=0.3)
    assert found.problem.tolist() == [BEFORE, FINE, FINE, FINE, GAP, GAP, FINE, FINE, TURN, FINE, AFTER]
    assert np.isnan(found.poses[~found.fine]).all()
    assert np.isfinite(found.poses[found.fine]).all() and np.isfinite(found.rate[found.fine]).all()
    assert np.array_equal(found.poses[[1, 3, 6, 9]], poses[[0, 2, 3, 5]])  # samples as they are


def test_one_interval_only():
    times = np.array([0.0, 0.1])
    poses = motion(np.random.default_rng(SEED), 1.0)(times)
    found = at_times(times, poses, np.array([0.05]))
    assert np.abs(found.rate * 0.1 - difference(poses[1:], poses[0])).max() < 1e-12


def test_rate_is_the_derivative_of_the_pose():
    """Derivative in the toolkit's convention: T(t + d) = (exp([omega d]x) R, t + d tdot)."""
    pose = motion(np.random.default_rng(SEED), 4.0)
    times = np.arange(0, 4, 0.002)
    at = np.array([1.001, 2.223])  # the middle of an interval
    rate = at_times(times, pose(times), at).rate
    for k, t in enumerate(at):
        truth = jacobian(lambda d, t=t: difference(pose(t + d[:, 0]), pose(np.array([t]))[0]), 1, 1e-4)[:, 0]
        assert np.abs(rate[k] - truth).max() < 1e-3 * np.abs(truth).max()
        assert np.abs(moved(pose(np.array([t])), 1e-3 * rate[k][None]) - pose(np.array([t + 1e-3]))).max() < 1e-4


def test_the_noise_of_a_rate_is_not_that_of_its_pose():
    pose = motion(np.random.default_rng(SEED), 2.0)
    times = np.arange(0, 2, 0.1)
    poses = pose(times)
    before = at_times(times, poses, np.array([1.05])).rate
    poses[10:12] = moved(poses[10:12], np.full((2, 6), 0.01))
    assert np.array_equal(at_times(times, poses, np.array([1.05])).rate, before)


def test_misses_say_how_large_the_error_is():
    rng = np.random.default_rng(SEED)
    pose = motion(rng, 20.0)
    times = np.arange(0, 20, 0.02)
    exact = pose(times)
    at = times[:-1] + 0.01  # the middles, where it is largest
    d = difference(at_times(times, exact, at).poses, pose(at))
    truth = [np.sqrt(np.mean((part**2).sum(axis=1))) for part in (d[:, :3], d[:, 3:])]
    found = error_of_interpolation(exact, misses(times, exact))
    assert np.abs(np.divide(found, truth) - 1).max() < 0.1
    noisy = moved(exact, rng.normal(size=(len(times), 6)) * np.repeat([2e-4, 1e-4], 3))
    found = error_of_interpolation(noisy, misses(times, noisy))
    assert np.abs(np.divide(found, truth) - 1).max() < 0.3
    assert not misses(times[:2], exact[:2]).any()
    assert not misses(times, exact, max_gap=0.01).any()


def test_noise_floor_tells_noise_from_motion():
    rng = np.random.default_rng(SEED)
    times = np.arange(0, 20, 0.01)
    noisy = moved(motion(rng, 20.0)(times), rng.normal(size=(len(times), 6)) * np.repeat([2e-4, 1e-4], 3))
    assert np.abs(np.divide(noise_floor(noisy), [2e-4, 1e-4]) - 1).max() < 0.1
    assert noise_floor(noisy[:5]) == (0.0, 0.0)
