"""Paths of rigs: chi-square distributed where nothing moved; a moved board and a knocked camera are named."""

import os

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom, chi2, kstest

import uq_handeye as uq
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.trials.simulation.several_cameras import simulate_rig, with_noise

SEED = int(os.environ.get("UQ_HANDEYE_SEED", "0"))
SIZE = ("0.5mrad", "0.3mm")
DRAWS = 200
HAND = ({"left": "arm", "right": "arm"}, {"board": "world", "tag": "world"})
CELL = ({"a": "world", "b": "world", "c": "world"}, {"board": "arm"})
SINGLE = ({"left": "arm"}, {"board": "world"})


def moved(rig, name, since, angle, shift):
    """The rig in which one camera or target stands elsewhere from a robot pose on."""
    D = np.eye(4)
    D[:3, :3], D[:3, 3] = Rotation.from_rotvec([0, angle, 0]).as_matrix(), [shift, 0, 0]
    views = []
    for view in rig.views:
        C, after = np.array(view.poses), np.array(view.at) >= since
        if view.camera == name:
            C[after] = np.linalg.inv(D) @ C[after]
        if view.target == name:
            C[after] = C[after] @ D
        views.append(uq.View(view.camera, view.target, C, view.at))
    return uq.Rig(rig.arms, rig.cameras, rig.targets, tuple(views))


@pytest.fixture(scope="module")
def still():
    exact, _ = simulate_rig(*HAND, n_poses=40, seed=5)
    noise = dict.fromkeys((*exact.arms, *exact.cameras), SIZE)
    return [calibrate_rig(with_noise(exact, noise, [SEED, k]), noise) for k in range(DRAWS)]


@pytest.mark.statistical
def test_paths_are_chi_square_distributed_where_nothing_moved(still):
    by_pair = {}
    for found in still:
        for path in found.paths:
            if path.by is not None:
                by_pair.setdefault(path.words, []).append(path)
    assert set(by_pair) == {"left, by tag", "right, by tag", "board, by right", "tag, by right"}
    for paths in by_pair.values():
        assert {path.dof for path in paths} == {6}
        assert kstest([path.p for path in paths], "uniform").pvalue > 1e-4
        e = np.array([path.change @ np.linalg.solve(path.covariance, path.change) for path in paths])
        np.testing.assert_allclose(e, [path.chi_square for path in paths], rtol=1e-6)


@pytest.mark.statistical
def test_false_alarms_are_rare(still):
    in_time = np.array([[path.p for path in found.paths if path.by is None] for found in still])
    for level in (0.01, 0.05, 0.2):
        assert (in_time < level).sum(axis=0).max() <= binom.ppf(1 - 1e-4, DRAWS, level)
    assert sum(bool(found.findings) for found in still) <= binom.ppf(1 - 1e-4, DRAWS, 5e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("cameras", "targets"), [HAND, CELL, SINGLE])
@pytest.mark.parametrize("since", [20, 30])
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_what_moved_is_named_with_the_moment(cameras, targets, since):
    """3 mrad and 3 mm, ten times the noise: no draw without the right name."""
    exact, _ = simulate_rig(cameras, targets, n_poses=40, seed=5)
    noise = dict.fromkeys((*exact.arms, *exact.cameras), SIZE)
    said = []
    for name in (next(iter(cameras)), "board"):
        for k in range(DRAWS // 20):
            rig = moved(with_noise(exact, noise, [SEED, k]), name, since, 3e-3, 3e-3)
            (finding,) = (one for one in uq.calibrate(rig, noise=noise).findings if one.code.startswith("rig."))
            said.append((finding.values["name"], str(finding.values.get("since"))) == (name, str(since)))
            if said[-1]:
                assert finding.values["shift"] == pytest.approx(3e-3, rel=0.3)
                assert f"{name} moved from robot pose {since} on, by " in str(finding)
    assert np.mean(said) > (0.8 if len(cameras) == 1 else 0.95)  # one camera, one board: the two are nearly alike


@pytest.mark.slow
@pytest.mark.parametrize("since", [20, 30])
def test_a_move_of_a_hundred_times_the_noise_is_named_not_rejected(since):
    exact, _ = simulate_rig(*CELL, n_poses=40, seed=5)
    noise = dict.fromkeys((*exact.arms, *exact.cameras), SIZE)
    for name in ("a", "board"):
        rig = moved(with_noise(exact, noise, [SEED, 3]), name, since, 0.03, 0.03)
        try:
            said = str(calibrate_rig(rig, noise).findings[0])
        except uq.InputError as error:
            said = str(error)
        assert f"{name} moved from robot pose {since} on, by " in said


def test_single_outliers_are_no_move():
    exact, _ = simulate_rig(*HAND, n_poses=40, seed=5)
    noise = dict.fromkeys((*exact.arms, *exact.cameras), SIZE)
    rig = with_noise(exact, noise, [SEED, 1])
    view = rig.views[0]
    C = np.array(view.poses)
    C[[3, 17, 35], :3, 3] += 0.02
    views = (uq.View(view.camera, view.target, C, view.at), *rig.views[1:])
    found = calibrate_rig(uq.Rig(rig.arms, rig.cameras, rig.targets, views), noise)
    assert len(found.rejected) == 3 and found.findings == ()


@pytest.mark.slow
def test_a_move_is_found_with_noise_estimated():
    exact, _ = simulate_rig(*CELL, n_poses=40, seed=5)
    noise = dict.fromkeys((*exact.arms, *exact.cameras), SIZE)
    names = []
    for k in range(5):
        found = calibrate_rig(moved(with_noise(exact, noise, [SEED, k]), "b", 25, 3e-3, 3e-3), shared=False)
        names += [finding.values["name"] for finding in found.findings]
    assert names == ["b"] * 5


@pytest.mark.slow
def test_paths_in_text_and_in_the_file():
    exact, _ = simulate_rig(*HAND, n_poses=40, seed=5)
    noise = dict.fromkeys((*exact.arms, *exact.cameras), SIZE)
    found = calibrate_rig(moved(with_noise(exact, noise, [SEED, 1]), "board", 25, 3e-3, 3e-3), noise)
    assert "The target board moved from robot pose 25 on, by " in found.text()
    stored = found.to_dict()
    of = {(path["name"], path.get("by") or path["since"]): path for path in stored["paths"]}
    assert of["board", 25]["chi_square"] > chi2.ppf(1 - 1e-9, 6)
    assert stored["findings"][0]["code"] == "rig.moved"


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize("before", [3, 4])
def test_a_camera_is_said_to_have_moved_after_its_first_few_views(before):
    """They are rejected, and are too few to be a run among other outliers."""
    noise = dict.fromkeys(("arm", "left", "right"), SIZE)
    rig, _ = simulate_rig({"left": "world", "right": "world"}, {"board": "arm"}, n_poses=13, seed=before, noise=noise)
    left, right = rig.views
    poses = right.poses.copy()
    poses[before:, :3, 3] += 0.02 * np.array([0.6, -0.8, 0.0])
    after = uq.Rig(rig.arms, rig.cameras, rig.targets, [left, uq.View("right", "board", poses, right.at)])
    result = uq.calibrate(after, noise=noise)
    assert [(one.code, one.values["name"], one.values["since"]) for one in result.findings] == [
        ("rig.moved", "right", str(before))
    ]
