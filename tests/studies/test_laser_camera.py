"""The study of a laser scanner and a camera: its rig, its drift, its covariances and its verdicts."""

import numpy as np
import pytest
from fixtures.study_tables import quick_tables
from scipy.stats import chi2

import uq_handeye as uq
from studies import laser_camera
from studies.common.scores import errors, nees, true_means
from studies.laser_camera import estimates as made
from studies.laser_camera import findings
from studies.laser_camera import rig as rig
from uq_handeye.core.geometry.se3 import inverse, perturb

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def tables():
    return quick_tables("laser_camera")


@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")  # interpolation counts where noise does not
def test_streams_are_those_of_one_rig():
    """Without noise G X C = W at the true offset, W the pose of one start in the other."""
    rng = np.random.default_rng(1)
    exact = rig.Sensors(scanner=(1e-9, 1e-9), camera=(1e-9, 1e-9))
    recorded = rig.recording(rng, exact)
    assert np.diff(recorded.scanner.timestamps).mean() == pytest.approx(1.0)
    assert np.diff(recorded.camera.timestamps).mean() == pytest.approx(1 / 200)
    sync = uq.synchronise(recorded.scanner, recorded.camera, offset=recorded.offset)
    assert sync.poses.n == rig.SCANS and sync.side == "camera"
    closed = sync.poses.robot @ rig.X @ sync.poses.camera
    assert np.abs(closed - closed[0]).max() < 1e-4  # what interpolation at 200 Hz misses
    start = recorded.path(np.array([recorded.scanner.timestamps[0], recorded.start]))
    np.testing.assert_allclose(closed[0], rig.X @ inverse(start[0]) @ start[1], atol=1e-4)


def test_white_noise_is_as_said():
    rng = np.random.default_rng(2)
    walk, sensors = rig.walk(1), rig.Sensors()
    V, G = rig.walked(walk, sensors, rng, 300)
    for found, exact, (turn, shift) in (
        (G, walk.G, sensors.scanner),
        (inverse(V), inverse(walk.V), sensors.camera),
    ):
        e = errors(found.reshape(-1, 4, 4), np.broadcast_to(exact, found.shape).reshape(-1, 4, 4))
        np.testing.assert_allclose(e.std(axis=0), np.repeat((turn, shift), 3), rtol=0.03)


def test_drift_has_the_covariance_that_is_told():
    rng = np.random.default_rng(3)
    drift, trials = (2e-3, 5e-3), 2000
    path, fine = rig.waved(rng, 20.0), np.arange(0.0, 20.05, 0.1)
    exact = inverse(path(fine[:1])) @ path(fine)
    at = np.array([10, 50, 51, 200])
    drifted = rig.drifted(exact, fine, drift, rng, trials)[:, at]
    e = np.concatenate([errors(inverse(drifted[:, k]), inverse(exact[i])) for k, i in enumerate(at)], axis=1)
    S = rig.drift_covariance(path, 0.0, fine[at], drift)
    assert S.shape == (24, 24)
    low, high = true_means(trials, 24)
    assert low < nees(e, S).mean() < high
    assert not low < nees(e, 0.8 * S).mean() < high
    wrong = S * np.kron(np.eye(4), np.ones((6, 6)))  # as if it were white
    L = np.linalg.cholesky(wrong)
    assert np.linalg.eigvalsh(np.linalg.solve(L, np.linalg.solve(L, e.T @ e / trials).T)).max() > 2
    np.testing.assert_array_equal(rig.drifted(exact, fine, (0.0, 0.0), rng, 1)[0][at, :3, :3], exact[at, :3, :3])


@pytest.mark.parametrize("experiment", rig.LOOPS)
def test_a_walk_ends_where_it_began_and_is_fused_exactly(experiment):
    walk = rig.walk(experiment)
    np.testing.assert_allclose(walk.V[-1, :3, 3], 0, atol=1e-9)
    np.testing.assert_allclose(rig.fused(walk.V, walk.G, rig.X), walk.G[:, :3, 3], atol=1e-10)
    np.testing.assert_allclose(walk.G @ rig.X, rig.X @ walk.V, atol=1e-12)
    assert np.linalg.norm(rig.fused(walk.V, walk.G, rig.NOMINAL)[-1] - walk.G[-1, :3, 3]) > 0.3


def test_slopes_of_the_place_at_the_end():
    walk = rig.walk(2)
    J = made.end_slopes(walk)[-1]
    xi, late = np.array([2e-4, -1e-4, 3e-4, 1e-3, -2e-3, 1e-3]), 2e-3
    # an offset that is too large by `late` has the camera read too early
    moved = rig.fused(walk.late(np.array(-late)), walk.G, perturb(rig.X, xi))[-1] - walk.G[-1, :3, 3]
    np.testing.assert_allclose(moved, J @ np.r_[xi, late], rtol=0.02, atol=1e-5)


@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")  # the offsets given are wrong
def test_estimates_move_with_the_offset_as_they_say():
    rng = np.random.default_rng(4)
    recorded = rig.recording(rng, rig.Sensors())
    noise = rig.Sensors().white
    step = 2e-3
    found = []
    for offset in (recorded.offset + step, recorded.offset, recorded.offset - step):
        sync = uq.synchronise(recorded.scanner, recorded.camera, noise=noise, offset=offset)
        found.append(dict(made.estimates(recorded, sync, rig.Sensors())))
    later, at, sooner = found
    assert set(at) == {made.PAPER, made.LIMIT, made.EFFICIENT}
    for name, estimate in at.items():  # the rates that it comes from are noisy
        slope = errors(later[name].X, sooner[name].X) / (2 * step)
        assert estimate.slope @ slope > 0.9 * np.linalg.norm(estimate.slope) * np.linalg.norm(slope)
    sync = uq.synchronise(recorded.scanner, recorded.camera, noise=noise, offset=recorded.offset)
    moved = [perturb(sync.poses.camera, sign * 1e-4 * sync.poses.timing.rate) for sign in (1, -1)]
    ends = [uq.efficient(uq.PosePairs(sync.poses.robot, camera), sync.noise).X for camera in moved]
    np.testing.assert_allclose(at[made.EFFICIENT].slope, errors(*ends) / 2e-4, atol=0.01)
    S = at[made.PAPER].joint(1e-3)
    np.testing.assert_allclose(S[:6, :6] - np.outer(S[:6, 6], S[:6, 6]) / S[6, 6], at[made.PAPER].exact, atol=1e-12)


def test_the_last_method_is_told_the_drift():
    path, times = made.drift_path()
    drift = rig.Sensors().drifting().drift
    noise = made.with_drift(rig.Sensors().white, path, 0.0, times, drift)
    own = rig.drift_covariance(path, 0.0, times, drift)
    np.testing.assert_allclose(
        noise.camera - own, np.kron(np.eye(len(times)), rig.Sensors().white.camera), atol=1e-12 * own.max()
    )
    with pytest.raises(AssertionError):  # it is not diagonal
        np.testing.assert_allclose(own, own * np.kron(np.eye(len(times)), np.ones((6, 6))))


def test_drift_makes_a_covariance_of_white_noise_too_small(tables):
    table = tables["drift"].set_index(["drift", "method", "noise assumed"])["NEES"]
    _, high = true_means(20, 6)
    assert table[0.0, "efficient", "white, shared poses"] < high
    assert table[1.0, "efficient", "white, shared poses"] > high
    assert table[1.0, "efficient", "white and drift, shared poses"] < high
    assert table[1.0, "4dpa, all motions", "white, pairs independent"] > 100


def test_calibration_lessens_the_error(tables):
    table = tables["trajectory"]
    assert (table["after, RMS (m)"] < table["before, RMS (m)"]).all()
    assert (table["sd by calibration (m)"] < table["sd (m)"]).all()


def test_verdicts_can_fail(tables):
    text = findings(tables)
    assert "falls on 9 of 9 axes" in text and "is not found" in text and "is mostly the odometry" in text
    other = {name: table.copy() for name, table in tables.items()}
    other["trajectory"]["after, RMS (m)"] = 2 * other["trajectory"]["before, RMS (m)"]
    other["trajectory"]["sd by calibration (m)"] = other["trajectory"]["sd (m)"]
    other["scale"].loc[0, "farthest from the limit (m)"] = 0.5
    for name, column in (("drift", "NEES"), ("calibration", "NEES"), ("ends", "NEES"), ("ends", "NEES by calibration")):
        other[name][column] = 1000.0
    other["calibration"]["offset z^2"] = 50.0
    opposite = findings(other)
    assert "falls on 0 of 9 axes" in opposite and "is found" in opposite and "is not always mostly" in opposite
    assert "Consistent at every drift: none" in opposite and ", consistent" not in opposite
    assert "(consistent)" not in opposite and "| consistent |" not in opposite
    other["drift"]["NEES"] = other["ends"]["NEES"] = other["calibration"]["NEES"] = 0.01
    assert "too large" in findings(other)


@pytest.mark.parametrize(("trials", "freedom"), [(20, 6), (300, 3)])
def test_a_verdict_is_that_of_chi_square(trials, freedom):
    low, high = (chi2.ppf(p, trials * freedom) / trials for p in (5e-4, 1 - 5e-4))
    assert laser_camera.verdict(high * 1.001, trials, freedom) == "too small"
    assert laser_camera.verdict(low * 0.999, trials, freedom) == "too large"
    assert laser_camera.verdict(freedom, trials, freedom) == "consistent"
