"""The study of Table I: problems and noise, what is measured of each method, verdicts that follow their tables."""

import numpy as np
import pytest
from fixtures.pages import DOCS
from fixtures.study_tables import quick_tables
from support import SEED

import uq_handeye as uq
from studies import table_1
from studies.common.paper_tables import classes
from studies.common.scores import errors, nees, true_means
from studies.table_1.findings import ACCURACY, SPEED, class_of, findings, summary
from uq_handeye.trials.simulation.experiment import Experiment
from uq_handeye.trials.simulation.run import run

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def tables():
    return quick_tables("table_1")


def changed(tables, name, edit):
    table = tables[name].copy()
    edit(table)
    return {**tables, name: table}


def test_the_problems_without_noise():
    X, A, B = table_1.exact_problems(50, 5)
    np.testing.assert_allclose(A @ X[:, None], X[:, None] @ B, atol=1e-12)
    angle = np.degrees(np.linalg.norm(errors(B, np.broadcast_to(np.eye(4), B.shape))[..., :3], axis=-1))
    assert 1 <= angle.min() < 30 and 150 < angle.max() <= 179


@pytest.mark.parametrize("label", table_1.CASES)
def test_cases_are_exact_and_drawn_with_their_noise(label):
    case = table_1.CASES[label](np.random.default_rng([SEED, 1]))
    motions = case.data if isinstance(case.data, uq.Motions) else uq.relative_motions(case.data, "all")
    np.testing.assert_allclose(motions.A @ case.X, case.X @ motions.B, atol=1e-12)
    on_poses = isinstance(case.data, uq.PosePairs)
    exact = (case.data.robot, case.data.camera) if on_poses else (case.data.A, case.data.B)
    noise = (case.noise.robot, case.noise.camera) if on_poses else (case.noise.A, case.noise.B)
    drawn = [np.concatenate(side) for side in zip(*table_1.drawn(case, 150), strict=True)]
    for T, true, S in zip(drawn, exact, noise, strict=True):
        assert len(T) == 150
        squares = nees(errors(T, np.broadcast_to(true, T.shape)).reshape(-1, 6), S)
        low, high = true_means(len(squares))
        assert low < squares.mean() < high


def test_every_method_is_measured(tables):
    assert len(table_1.METHODS) == 19
    for name in ("about", "exact", "times"):
        assert tuple(tables[name]["method"]) == table_1.METHODS
    assert tables["exact"]["largest_error_rad_m"].max() < 1e-11
    count = tables["accuracy"].groupby("method")["case"].nunique()
    assert count.drop(["li", "shah"]).eq(5).all() and count[["li", "shah"]].eq(3).all()
    assert (tables["times"]["one_over_fastest"].min(), tables["times"]["batch_over_fastest"].min()) == (1, 1)


def test_the_printed_table():
    printed = classes().set_index("method")
    assert set(printed.index) == set(uq.METHODS) - {"4dpa"}
    assert tuple(printed.loc["gwak", ["speed", "accuracy", "uncertainty"]]) == ("Very Low", "High", "No")
    assert list(printed.index[printed["uncertainty"] == "Yes"]) == ["nguyen"]


def test_the_bound_is_reached_by_efficient_and_missed_by_others(tables):
    """RMS over bound: 40 draws of 3 to 6 numbers have a relative error of about a tenth."""
    table = summary(tables)
    assert 0.85 < table.loc["efficient", "ratio"] < 1.15
    hard = tables["accuracy"].set_index(["method", "case"])["translation_over_bound"]
    assert hard["4dpa", "motions, 1 mrad 0.1 mm"] > 4 > 1.5 > hard["efficient", "motions, 1 mrad 0.1 mm"]
    assert hard["nguyen", "motions, 1 mrad 0.1 mm"] < 1.6


def test_the_class_of_accuracy_is_of_the_further_geometries(tables):
    def of(table, geometry, factor):
        chosen = (table["method"] == "tsai") & (table["geometry"] == geometry)
        table.loc[chosen, ["rotation_over_bound", "translation_over_bound"]] = factor

    before = summary(tables)
    assert summary(changed(tables, "geometries", lambda table: of(table, 0, 9.0))).equals(before)
    after = changed(tables, "geometries", lambda table: (of(table, 1, 4.0), of(table, 2, 1.0)))
    row = summary(after).loc["tsai"]
    assert (row["ratio"], row["least"], row["largest"]) == pytest.approx((2, 1, 4))
    assert row["accuracy"] == "Low" and before.loc["tsai", "accuracy"] == "Medium"
    assert "`tsai`" in findings(after).partition("among single geometries")[2].partition("that of the draws")[0]


def test_the_sentence_on_separated_methods_is_counted_over_the_further_geometries(tables):
    def of(factor):
        def edit(table):
            kind = table["method"].map(tables["about"].set_index("method")["structure"])
            chosen = (kind == "separated") & (table["geometry"] > 0)
            table.loc[chosen, "translation_over_bound"] = factor

        return findings(changed(tables, "geometries", edit)).partition("In the 2 further geometries")[2]

    assert "in 2, without `nguyen` in 2." in of(99.0)
    assert "in 0, without `nguyen` in 0." in of(1.0)


def test_predictions_over_the_bound(tables):
    """None is below the bound; `efficient` reaches it; draws of the same geometry agree (40 draws)."""
    table = tables["geometries"]
    assert set(table["geometry"]) == {0, 1, 2}
    over = table.set_index("method")[["rotation_over_bound", "translation_over_bound"]]
    assert over.to_numpy().min() > 1 - 1e-6
    np.testing.assert_allclose(over.loc["efficient"], 1, rtol=1e-9)
    drawn = tables["accuracy"].set_index(["case", "method"])
    same = table[table["geometry"] == 0].set_index(["case", "method"])
    columns = ["rotation_over_bound", "translation_over_bound"]
    share = (drawn[columns] / same.loc[drawn.index, columns])[drawn["trials"] == 40]
    assert share.to_numpy().min() > 0.6 and share.to_numpy().max() < 1.5


def test_classes_follow_their_rules():
    assert [class_of(x, SPEED) for x in (1, 4.99, 5, 15, 50)] == ["High", "High", "Medium", "Low", "Very Low"]
    assert [class_of(x, ACCURACY) for x in (1.2, 1.25, 1.99, 2)] == ["High", "Medium", "Medium", "Low"]


def test_verdicts_follow_the_tables(tables):
    def in_the_middle(table):
        table["nees"] = 6.0

    def one_outside(table):
        in_the_middle(table)
        table.loc[(table["method"] == "tsai") & (table["case"] == "motions, (70)"), "nees"] = 99.0

    def worst_separated(table):
        table.loc[
            table["method"].isin(["tsai", "shiu", "chou", "park", "horaud", "nguyen"]), "translation_over_bound"
        ] = 9

    true = findings(changed(tables, "accuracy", in_the_middle))
    assert "in 91 of 91 cells" in true and "Outside" not in true
    false = findings(changed(tables, "accuracy", one_outside))
    assert "in 90 of 91 cells" in false and 'Outside: `tsai` in "motions, (70)" (99.00)' in false
    assert "the sentence does not hold here" in true
    assert "the sentence holds here" in findings(changed(tables, "accuracy", worst_separated))
    assert "7 have the" in true and "`tsai` (High) takes 4.6 times as long as `zhang` (Medium)" in true

    def as_classed(table):
        order = {"High": 1.0, "Medium": 2.0, "Low": 3.0, "Very Low": 4.0}
        known = classes().set_index("method")["speed"]
        table["seconds"] = [order.get(known.get(name, "High"), 1.0) for name in table["method"]]

    assert "0 have the" in findings(changed(tables, "paper_times", as_classed))

    def equal(table):
        table["one_over_fastest"] = 1.0

    def ranked(table):
        order = {"High": 1.0, "Medium": 2.0, "Low": 3.0, "Very Low": 4.0}
        known = classes().set_index("method")["speed"]
        table["one_over_fastest"] = [order[known.get(name, "High")] for name in table["method"]]

    def reversed_rank(table):
        ranked(table)
        table["one_over_fastest"] = 5 - table["one_over_fastest"]

    words = classes()["speed"].value_counts()
    pairs = (14**2 - (words**2).sum()) // 2
    assert f"same order here: speed, {pairs} of {pairs}; accuracy" in findings(changed(tables, "times", ranked))
    assert f"same order here: speed, 0 of {pairs}; " in findings(changed(tables, "times", reversed_rank))

    def unknown(table):
        table.loc[table["method"] == "tsai", "nees"] = np.nan

    assert "| No | yes |\n| `shiu`" in true and "| No | no |\n| `shiu`" in findings(
        changed(tables, "accuracy", unknown)
    )

    differ = 14 - (classes()["speed"] == "High").sum()
    assert f"differ in speed for {differ} of 14 methods" in findings(changed(tables, "times", equal))


def test_the_page_on_methods_finds_its_table(tables):
    page = (DOCS / "explanation" / "methods.md").read_text(encoding="utf-8")
    text = findings(tables)
    for marker in ("## All methods, measured", "## Classes"):
        assert f'"{marker}"' in page and text.count(f"{marker}\n") == 1
    between = text.partition("## All methods, measured")[2].partition("## Classes")[0]
    assert all(f"\n| `{name}` |" in between for name in table_1.METHODS)


def test_where_first_order_ends():
    """`andreff` is outside its interval in one case, by a second-order bias: at a fifth of the noise it is inside."""
    label = "rig, weak depth"
    case = table_1.case_of(label, 0)
    means = []
    for factor in (1.0, 0.2):
        noise = uq.PoseNoise(factor**2 * case.noise.robot, factor**2 * case.noise.camera)
        problem = Experiment(case.data, case.X, case.data.truth.W, noise, "andreff")
        xi = run(problem, np.random.default_rng([SEED, 2]), 3000).errors
        means.append(nees(xi, problem.predicted()).mean())
    low, high = true_means(3000)
    assert low < means[1] < high and means[1] + 0.1 < means[0], means
