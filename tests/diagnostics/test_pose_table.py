"""The table of poses: its columns, its flags, what it says in words, and what it refuses to read."""

import dataclasses

import numpy as np
import pytest
from scipy import stats
from support import SEED, moved, random_transforms

import uq_handeye as uq
from uq_handeye.fit.diagnostics.pose_table import PoseTable, pose_table
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.fit.graph.robust import FULL, pose_distances, robust_fit

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


def with_wrong_ones(n, wrong, metres=0.05, seed=SEED):
    """Poses, ``wrong`` of which have a camera that is off by so many metres."""
    poses = uq.simulate(n, noise=NOISE, seed=seed)
    camera = poses.camera.copy()
    camera[wrong, 0, 3] += metres
    return uq.PosePairs(poses.robot, camera)


def by_hand(**changes):
    """Four poses, one of each kind."""
    columns = {
        "rotation": np.radians([0.1, 2.0, 0.2, 0.3]),
        "translation": np.array([1e-3, 0.02, 2e-3, 3e-3]),
        "distance2": np.array([5.0, 900.0, 30.0, 6.0]),
        "leverage": np.array([0.4, 0.0, 0.2, 0.4]),
        "weight": np.array([1.0, 0.0, 0.5, 1.0]),
    }
    return PoseTable("pose", *columns.values(), ("kept", "rejected", "downweighted", "kept"), **changes)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_columns_of_a_plain_fit(setup):
    poses = uq.simulate(20, noise=NOISE, setup=setup, seed=SEED)
    fitted = efficient(poses, NOISE)
    table = pose_table(fitted, None)
    distances, leverage = pose_distances(fitted)
    assert (table.item, len(table), table.limit, table.scale) == ("pose", 20, FULL, 1.0)
    np.testing.assert_array_equal(table.distance2, distances)
    np.testing.assert_array_equal(table.leverage, leverage)
    assert table.leverage.sum() == pytest.approx(1.0)
    np.testing.assert_array_equal(table.weight, np.ones(20))
    np.testing.assert_allclose(table.rotation, np.sqrt((fitted.residual[:, :3] ** 2).sum(axis=1)))
    np.testing.assert_allclose(table.translation, np.sqrt((fitted.residual[:, 3:] ** 2).sum(axis=1)))
    assert table.flagged == [k for k in range(20) if distances[k] > FULL]
    assert table.rejected == []


@pytest.mark.statistical
def test_limit_of_all_is_exceeded_once_in_1000_data_sets():
    for n in (1, 20, 400):
        table = dataclasses.replace(by_hand(), flag=("kept",) * n)
        assert stats.chi2.sf(table.limit_of_all, 6) * n == pytest.approx(1e-3)


def test_a_plain_fit_names_outliers_that_are_no_chance():
    table = pose_table(efficient(with_wrong_ones(30, [4, 9]), NOISE), None)
    assert {4, 9} <= set(table.flagged)
    assert {table.flag[k] for k in table.flagged} == {"outlier"}
    assert table.rejected == []
    (text,) = map(str, table.findings)
    assert "pose 4 (" in text and "pose 9 (" in text and "counted from 0" in text
    assert "are outliers and bias X" in text and "robust=True" in text
    # one pose beyond the 99.9 % quantile but within that of the largest of all is marked, and not spoken of
    rare = dataclasses.replace(by_hand(), flag=("kept", "kept", "outlier", "kept"), weight=np.ones(4))
    quiet = dataclasses.replace(rare, distance2=np.array([5.0, 6.0, FULL + 1, 6.0]))
    assert quiet.flagged == [2] and quiet.limit_of_all > FULL + 1 and quiet.findings == []
    loud = dataclasses.replace(rare, distance2=np.array([5.0, 6.0, quiet.limit_of_all + 1, 6.0]))
    assert len(loud.findings) == 1


def test_a_robust_fit_says_what_became_of_each_pose():
    wrong = [3, 17]
    data = with_wrong_ones(30, wrong)
    found = robust_fit(data, NOISE)
    table = pose_table(found.fit, found)
    assert table.rejected == wrong
    assert table.flag == found.flags
    np.testing.assert_array_equal(table.weight, found.weights)
    (text,) = [text for text in map(str, table.findings) if "were rejected" in text]
    assert text.startswith("2 of 30 poses were rejected as outliers: ")
    for k in wrong:
        turn, shift = np.degrees(table.rotation[k]), 1e3 * table.translation[k]
        assert f"pose {k} ({turn:.2g} degrees, {shift:.3g} mm, d^2 = {table.distance2[k]:.0f})" in text
        assert shift == pytest.approx(50, rel=0.1)  # the residual of a rejected pose is what is wrong with it
    assert "stays below d^2 = 22.5" in text


def test_clean_data_are_silent():
    silent = 0
    for trial in range(20):
        found = robust_fit(uq.simulate(20, noise=NOISE, seed=np.random.default_rng([SEED, 9, trial])), NOISE)
        table = pose_table(found.fit, found)
        silent += table.findings == []
        assert bool(table.flagged) == bool(table.findings)
    # a pose is flagged once in 1000: 20 poses in 2 % of the sets
    assert silent >= stats.binom.ppf(0.0005, 20, 0.98)


def test_motions_are_called_motions():
    rng = np.random.default_rng(SEED)
    X, B = random_transforms(rng), random_transforms(rng, (40,), largest=2.0)
    sd = np.repeat([1e-3, 5e-4], 3)
    A = X @ B @ np.linalg.inv(X)
    B = moved(B, sd * rng.normal(size=(40, 6)))
    B[[3, 17, 30]] = random_transforms(rng, (3,))
    found = robust_fit(uq.Motions(A, B), uq.PairNoise(B=np.diag(sd**2)))
    table = pose_table(found.fit, found)
    assert table.item == "motion" and table.rejected == [3, 17, 30]
    assert str(table.findings[0]).startswith("3 of 40 motions were rejected") and "motion 17 (" in str(
        table.findings[0]
    )
    assert table.to_dataframe().columns[0] == "motion"


def test_noise_that_is_too_small_is_said():
    data = with_wrong_ones(40, [1, 2, 3, 4])
    found = robust_fit(data, uq.PoseNoise(NOISE.robot / 100, NOISE.camera / 100))
    table = pose_table(found.fit, found)
    assert 7 < table.scale < 13 and set(table.rejected) >= {1, 2, 3, 4}
    assert "The noise given is too small" in str(table.findings[-1]) and f"{table.scale:.2g} times" in str(
        table.findings[-1]
    )
    honest = robust_fit(data, NOISE)
    assert not any("too small" in text for text in map(str, pose_table(honest.fit, honest).findings))


def test_statements_name_the_worst_and_count_the_rest():
    n = 15
    table = PoseTable(
        "pose",
        np.zeros(n),
        np.zeros(n),
        100.0 + np.arange(n),
        np.full(n, 1 / n),
        np.zeros(n),
        ("rejected",) * n,
    )
    (text,) = map(str, table.findings)
    assert text.index("pose 14 (") < text.index("pose 10 (") and "and 10 more, counted" in text
    assert "pose 9 (" not in text
    rejected, downweighted = map(str, by_hand().findings)
    assert "pose 1 (2 degrees, 20 mm, d^2 = 900)" in rejected
    assert "down-weighted as an outlier: pose 2 (0.2 degrees, 2 mm, d^2 = 30)" in downweighted
    assert by_hand().flagged == [1, 2] and by_hand().rejected == [1]


def test_dataframe_has_units_in_its_names():
    frame = by_hand().to_dataframe()
    names = ["pose", "rotation_deg", "translation_mm", "distance2", "leverage", "weight", "flag"]
    assert frame.columns.tolist() == names
    np.testing.assert_allclose(frame["rotation_deg"], [0.1, 2.0, 0.2, 0.3])
    np.testing.assert_allclose(frame["translation_mm"], [1, 20, 2, 3])
    assert frame["flag"].tolist() == list(by_hand().flag) and frame["pose"].tolist() == [0, 1, 2, 3]


def test_round_trip():
    table = by_hand(limit=25.0, scale=1.5)
    again = PoseTable.from_dict(table.to_dict())
    assert again.to_dict() == table.to_dict()
    assert (again.item, again.limit, again.scale, again.flag) == ("pose", 25.0, 1.5, table.flag)
    np.testing.assert_array_equal(again.distance2, table.distance2)


@pytest.mark.parametrize(
    "change",
    [
        {"weight": [1.0, 1.0]},
        {"distance2": [1.0, 2.0, 3.0, float("nan")]},
        {"flag": ["kept"]},
        {"flag": ["kept"] * 3 + ["downweighted (0.40)"]},
        {"rotation": [[0.0] * 4]},
    ],
)
def test_damaged_tables_are_refused(change):
    with pytest.raises(uq.InputError, match=r"Expected (poses|the flags of poses)"):
        PoseTable.from_dict(by_hand().to_dict() | change)


def test_missing_columns_are_refused():
    data = by_hand().to_dict()
    del data["leverage"]
    result = uq.calibrate(uq.simulate(10, noise=NOISE, seed=SEED), noise=NOISE).to_dict()
    with pytest.raises(uq.InputError, match="damaged: Expected poses to have 'leverage', which is missing"):
        uq.Calibration.from_dict(result | {"poses": data})
