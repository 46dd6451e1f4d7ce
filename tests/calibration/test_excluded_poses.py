"""Poses that are excluded by request: the fit is that of the others, the data and the table keep all."""

import json
import warnings

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.errors import InputError
from uq_handeye.findings import Finding, renumbered
from uq_handeye.model.poses.pose_numbers import numbers_of, ranges, select_poses
from uq_handeye.report.comparison.compare import compare_result
from uq_handeye.report.figures import pictures, small_pictures

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
EXCLUDED = [5, 12, 13, 14]
KEPT = np.setdiff1d(np.arange(24), EXCLUDED)


def spoiled():
    """Return 24 poses: 5 and 18 are wrong by centimetres."""
    poses = uq.simulate(n_poses=24, noise=NOISE, seed=3)
    camera = poses.camera.copy()
    camera[[5, 18], :3, 3] += [[0.03, 0, 0], [0, 0.05, 0]]
    return uq.PosePairs(poses.robot, camera, timestamps=np.arange(24.0))


@pytest.fixture(scope="module")
def poses():
    return spoiled()


@pytest.fixture(scope="module")
def result(poses):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return uq.calibrate(poses, noise=NOISE, exclude=EXCLUDED)


@pytest.fixture(scope="module")
def of_rest(poses):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return uq.calibrate(poses.rows(KEPT), noise=NOISE)


def test_the_fit_is_that_of_the_others(result, of_rest):
    for name in ("X", "W", "covariance", "covariance_W", "bound"):
        assert np.array_equal(getattr(result, name), getattr(of_rest, name))
    assert (result.n_poses, result.n_pairs, result.fit) == (20, of_rest.n_pairs, of_rest.fit)
    assert result.residuals == of_rest.residuals
    assert np.array_equal(result.budget.covariances, of_rest.budget.covariances)
    assert "20 poses, 4 excluded" in repr(result)


def test_excluded_poses_stay_in_data_and_table(result, poses):
    table = result.table
    assert result.data.n == len(table) == 24 and np.array_equal(result.data.camera, poses.camera)
    assert table.excluded == EXCLUDED == list(result.excluded)
    assert [table.flag[k] for k in (5, 12, 18, 20)] == ["excluded", "excluded", "rejected", "kept"]
    assert (table.rejected, table.flagged) == ([18], [18])
    assert table.counts == "24 poses: 19 kept, 1 rejected, 4 excluded"
    assert table.distance2[5] > 1000 and (table.distance2[EXCLUDED[1:]] < table.limit).all()
    r = poses.robot[5] @ result.X @ poses.camera[5]
    assert table.translation[5] == pytest.approx(np.linalg.norm(r[:3, 3] - result.W[:3, 3]), rel=1e-9)
    assert (table.weight[EXCLUDED] == 0).all() and (table.leverage[EXCLUDED] == 0).all()
    assert table.leverage.sum() == pytest.approx(1.0, abs=1e-6)


def test_numbers_are_those_of_the_data(result, of_rest):
    assert "pose 18 (" in result.warnings[0] and "of 20 poses" in result.warnings[0]
    assert "pose 14 (" in of_rest.warnings[0]
    shown, alone = (found.analysis.diagnostics.findings for found in (result, of_rest))
    row = next(one.values["row"] for one in alone if one.code == "diagnostics.information")
    assert next(one.values["row"] for one in shown if one.code == "diagnostics.information") == KEPT[row]
    said = str(next(one for one in result.findings if one.code == "calibration.excluded"))
    assert "poses 5, 12-14 of 24" in said and "poses 12-14 fit the others" in said


def test_excluded_poses_are_no_outliers(poses):
    result = uq.calibrate(poses, noise=NOISE, exclude=[5, 18])
    assert result.warnings == () and result.usable
    assert next(check for check in result.checks if check.name == "outliers").text == ("none of 22 poses; 2 excluded")


@pytest.mark.slow
def test_distances_of_good_excluded_poses_are_chi_square():
    rng, found = np.random.default_rng(5), []
    for _ in range(12):
        poses = uq.simulate(n_poses=20, noise=NOISE, seed=rng)
        found += uq.calibrate(poses, noise=NOISE, robust=False, exclude="0-7").table.distance2[:8].tolist()
    assert np.mean(found) == pytest.approx(6.0, abs=4 * np.sqrt(12 / len(found)) + 0.3)  # one X for 8 poses


@pytest.mark.slow
def test_questions_about_x_use_the_others(result, of_rest):
    for mine, other in zip(result.used, of_rest.used, strict=True):
        assert repr(mine) == repr(other)
    assert np.array_equal(result.used[0].camera, of_rest.used[0].camera)
    assert uq.monte_carlo(result, trials=50, seed=1).covariance == pytest.approx(
        uq.monte_carlo(of_rest, trials=50, seed=1).covariance
    )
    assert compare_result(result).comparison.n_poses == 19


def test_the_result_file_keeps_them(result, tmp_path):
    text = result.to_json(tmp_path / "result.json")
    again = uq.Calibration.from_json(tmp_path / "result.json")
    assert again.to_json() == text and again.excluded == tuple(EXCLUDED)
    assert json.loads(text)["provenance"]["options"]["exclude"] == "5, 12-14"
    assert np.array_equal(again.used[0].robot, result.used[0].robot)
    assert "fit the others" in again.summary(verbose=True)
    for damage in ({"excluded": [5, 12]}, {"excluded": [5, 12, 13, 99]}, {"excluded": ["5"]}, {"excluded": []}):
        with pytest.raises(InputError, match="damaged"):
            uq.Calibration.from_dict(json.loads(text) | damage)


@pytest.mark.slow
def test_text_and_figures_show_them(result):
    assert "20 of 24 poses" in result.summary()
    assert "4 of 24 poses are excluded" in result.summary(verbose=True)
    drawn = pictures(result, only=("residuals", "rig"))
    labels = {stem: [text.get_text() for text in drawn[stem].figure.legends[0].get_texts()] for stem in drawn}
    assert "excluded (4)" in labels["residuals"] and "rejected, excluded" in labels["rig"]
    assert "1 of 20 flagged; 4 excluded, as open circles" in small_pictures(result)["residuals-small"].caption


@pytest.mark.slow
def test_noise_estimated_and_published_methods(poses):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        for method in (None, "park"):
            whole = uq.calibrate(poses, method=method, exclude="5,12-14")
            rest = uq.calibrate(poses.rows(KEPT), method=method)
            assert np.array_equal(whole.X, rest.X) and np.array_equal(whole.covariance, rest.covariance)
            assert whole.excluded == tuple(EXCLUDED) and whole.data.n == 24
            assert whole.to_json() == uq.Calibration.from_dict(json.loads(whole.to_json())).to_json()
            assert len(whole.used[0]) == len(rest.used[0])


def test_rows_of_noise_pairs_and_columns(poses):
    """Noise and options by pose or by pair are those of the poses that are left."""
    S = np.broadcast_to(NOISE.camera, (24, 6, 6)) * np.linspace(1, 2, 24)[:, None, None]
    F = np.random.default_rng(0).normal(size=(24, 6, 1))
    pairs = np.stack([np.arange(23), np.arange(1, 24)], axis=-1)
    noise = uq.PoseNoise(NOISE.robot, S)
    error = uq.SharedError.columns("bend", F, 1e-4, "robot")
    whole = uq.calibrate(poses, noise=noise, shared=[error], pairs=pairs, only=[*range(5), *range(6, 12), 20, 22, 23])
    kept = np.array([*range(5), *range(6, 12), 20, 22, 23])
    left = pairs[np.isin(pairs, kept).all(axis=1)]
    rest = uq.calibrate(
        poses.rows(kept),
        noise=noise.rows(kept),
        shared=[uq.SharedError.columns("bend", F[kept], 1e-4, "robot")],
        pairs=np.searchsorted(kept, left),
    )
    assert np.array_equal(whole.covariance, rest.covariance) and whole.n_pairs == rest.n_pairs == len(left)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"exclude": [24]}, "between 0 and 23, counted from 0, got 24"),
        ({"exclude": [-1]}, "between 0 and 23, counted from 0, got -1"),
        ({"exclude": [1], "only": [2, 3, 4]}, "both given"),
        ({"exclude": "16-14"}, "count upwards, got 16-14. Write 14-16"),
        ({"only": [1, 2]}, "leaves 2 of 24 poses"),
        ({"exclude": "0-23"}, "leaves 0 of 24 poses"),
        ({"exclude": "3,,4"}, "such as 12,14-16, got '3,,4'"),
        ({"exclude": [1.5]}, "to be pose numbers"),
        ({"exclude": [True] * 24}, "to be pose numbers"),
        ({"exclude": {"a": 1}}, "to be pose numbers"),
    ],
)
def test_requests_that_cannot_be_met(poses, given, message):
    with pytest.raises(InputError, match=message):
        uq.calibrate(poses, noise=NOISE, **given)


def test_motions_and_noise_by_pair_are_refused(poses):
    with pytest.raises(InputError, match="they count its poses"):
        uq.calibrate(uq.relative_motions(poses), exclude=[1])
    S = np.broadcast_to(np.eye(6), (276, 6, 6))
    with pytest.raises(InputError, match="one covariance for all motions"):
        uq.calibrate(poses, noise=uq.PairNoise(A=S, B=S), exclude=[1])


def test_nothing_excluded_changes_nothing(poses):
    assert select_poses(24, exclude=[]) is None and select_poses(24, only="0-23") is None
    assert numbers_of("12, 14-16,3", "x") == [12, 14, 15, 16, 3]
    assert ranges([1, 2, 3, 7, 9, 10]) == "1-3, 7, 9-10"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        assert uq.calibrate(poses, noise=NOISE, exclude=[]).excluded == ()


def test_findings_are_renumbered():
    numbers = [0, 2, 3, 7]
    old = Finding("kinematics.rows_apart", "caution", {"rows": [1, 3], "farthest": 3, "rotation": 1})
    assert renumbered(old, numbers).values == {"rows": [2, 7], "farthest": 7, "rotation": 1}
    shift = Finding("input_checks.shifted_rows", "failure", {"stretches": [[0, 2, 0], [2, 4, 1]]})
    assert renumbered(shift, numbers).values == {"stretches": [[0, 3, 0], [3, 8, 1]]}
    motion = Finding("diagnostics.needed_rows", "caution", {"item": "motion", "rows": [1]})
    assert renumbered(motion, numbers) == motion
