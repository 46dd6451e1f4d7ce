"""The study of d: its route keeps its precision and is the toolkit's, rigs have the length, verdicts can fail."""

import re

import numpy as np
import pytest
from fixtures.study_tables import quick_tables

import uq_handeye as uq
from studies import scaling_factor as study
from studies.common.study import read_table
from studies.scaling_factor import curves
from studies.scaling_factor import single_precision as route
from studies.scaling_factor.findings import findings, flat
from uq_handeye.symbolic import functions

pytestmark = pytest.mark.slow

DEVIATIONS = np.array([1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 2e-3])


@pytest.fixture(scope="module")
def rigs():
    return study.rigs(6, np.random.default_rng(1))


@pytest.fixture(scope="module")
def tables():
    table = quick_tables("scaling_factor")["accuracy"]
    return {"accuracy": read_table(table.to_csv(index=False, float_format="%.6g"))}


def noise():
    S = np.diag(DEVIATIONS**2)
    return uq.PairNoise(S, S)


def relative(S, reference):
    whitener = np.linalg.inv(np.linalg.cholesky(reference))
    return np.abs(np.linalg.eigvalsh(whitener @ S @ whitener.mT) - 1).max()


@pytest.mark.parametrize("d", [30.0, 1e3, 1e5])
def test_in_double_precision_it_is_the_route_of_the_toolkit(rigs, d):
    _, A, B = rigs
    octonion = route.problem_2(A, B, d)
    np.testing.assert_allclose(route.remapped(octonion, d), uq.solve(A, B, scale=d), atol=1e-14 * d)
    linear, expected = route.linear(A, B, octonion, d, DEVIATIONS), uq.propagate(A, B, noise(), scale=d)
    assert relative(linear.covariance(), expected) < 1e-13 * d
    assert relative(linear.printed(), expected) < 1e-13 * d**2


def test_in_double_precision_its_limit_is_that_of_the_toolkit(rigs):
    X, A, B = rigs
    found = route.limit(A, B)
    np.testing.assert_allclose(found, X, atol=1e-13)
    np.testing.assert_allclose(found, uq.solve(A, B), atol=1e-13)
    assert relative(route.limit_covariance(A, B, found, DEVIATIONS), uq.propagate(A, B, noise())) < 1e-11


def test_nothing_in_between_is_in_double_precision(rigs, monkeypatch):
    """Every generated function and every decomposition takes and gives float32."""
    seen = set()

    def watched(name, function):
        def call(*arguments, **keywords):
            result = function(*arguments, **keywords)
            parts = [*arguments, *(result if isinstance(result, tuple) else (result,))]
            seen.add(name)
            assert {part.dtype for part in parts if hasattr(part, "dtype")} == {np.dtype(np.float32)}, name
            return result

        return call

    names = ("F2", "F11", "F22", "sigma_to_R", "dF11q_db", "dF22q_db", "dF2_dxi", "P_1", "P_4")
    names += ("u", "w", "du_dxi", "dw_dxi")
    for name in names:
        monkeypatch.setattr(functions, name, watched(name, getattr(functions, name)))
    for name in ("eigh", "svd", "solve", "det"):
        monkeypatch.setattr(np.linalg, name, watched(name, getattr(np.linalg, name)))
    _, A, B = (T.astype(np.float32) for T in rigs)
    octonion = route.problem_2(A, B, 1e3)
    X, limit = route.remapped(octonion, 1e3), route.limit(A, B)
    linear = route.linear(A, B, octonion, 1e3, DEVIATIONS.astype(np.float32))
    outcomes = (
        X,
        limit,
        linear.covariance(),
        linear.printed(),
        route.limit_covariance(A, B, limit, DEVIATIONS.astype(np.float32)),
    )
    assert {outcome.dtype for outcome in outcomes} == {np.dtype(np.float32)}
    assert seen >= {*names, "eigh", "svd", "solve", "det"}


def test_the_length_of_a_rig_is_that_of_its_translations(rigs):
    for length in (0.001, 10.0):
        T = np.concatenate([study.scaled(T, length) for T in rigs[1:]], axis=1)
        np.testing.assert_allclose(np.sqrt((T[..., :3, 3] ** 2).sum(axis=-1).mean(axis=1)), length)
        X, A, B = (study.scaled(T, length) for T in rigs)
        np.testing.assert_allclose(A @ X[:, None], X[:, None] @ B, atol=1e-14 * max(1, length))


def test_truncation_and_rounding_have_their_slopes_and_balance_where_derived(tables):
    table = curves.with_ratios(tables["accuracy"])
    for precision, dtype in curves.PRECISIONS.items():
        for quantity, expected in curves.SLOPES.items():
            c = curves.curve(table, precision, quantity)
            found = np.where(np.isnan(c.slopes), expected, c.slopes)  # too few d to fit, in single precision as printed
            np.testing.assert_allclose(found, expected, atol=0.3, err_msg=f"{precision} {quantity}")
            assert c.limit < c.least
        c = curves.curve(table, precision, "translation")
        assert 0.2 < c.balanced * float(np.finfo(dtype).eps) ** (1 / 3) < 5
        assert abs(np.log10(c.best / c.balanced)) <= 0.5


def test_a_fit_finds_the_factors_of_a_made_up_curve(tables):
    table = tables["accuracy"].copy()
    ratio = table.d_m / table.length_m
    table["translation_from_limit_m"] = table.length_m * (3.0 / ratio**2 + 5e-12 * ratio)
    table.loc[table.d_m.isna(), "translation_from_limit_m"] = 0.0
    c = curves.curve(curves.with_ratios(table), "double", "translation")
    np.testing.assert_allclose(c.factors, (3.0, 5e-12), rtol=0.1)
    np.testing.assert_allclose(c.slopes, (-2, 1), atol=0.05)


def test_the_findings_of_the_quick_run(tables):
    text = findings(tables)
    assert "The guarantee does not hold: 0 of 32" in text
    assert re.search(r"\b(\d+) of \1 fitted slopes", text)
    assert "do not; take the limit" in text
    assert "Only d / length matters" in text


def test_the_findings_say_the_opposite_of_tables_that_say_it(tables):
    table = tables["accuracy"].copy()
    table["within_claim"] = table.rigs
    table.loc[table.d_m.isna(), ["translation_error_median_m", "covariance_from_limit"]] = 1.0
    table.loc[table.d_m.notna(), "covariance_from_limit"] = table.length_m / table.d_m
    table.loc[table.length_m == 10, "translation_from_limit_m"] *= 3
    text = findings({"accuracy": table})
    assert "Not only d / length matters" in text
    assert "The guarantee holds: 32 of 32" in text
    assert not re.search(r"\b(\d+) of \1 fitted slopes", text)
    assert "the limit is not the best" in text and "take the limit" not in text


def test_table_v_is_said_to_fall_only_where_it_does(tables):
    table = tables["accuracy"].copy()
    assert "does so for 1 of 4 lengths" in findings(tables)
    table["translation_from_limit_m"] = table.length_m / table.d_m
    table.loc[table.d_m.isna(), "translation_from_limit_m"] = 1e-9
    text = findings({"accuracy": table})
    assert "does so for 4 of 4 lengths" in text and "rises again" not in text
    assert "fall by a factor of 10;" in text


def test_the_range_of_d_that_is_as_good_as_the_limit(tables):
    rows = curves.chosen(tables["accuracy"], precision="double", noise="none", length_m=1.0).copy()
    rows["x"] = np.where(rows.d_m.between(50, 2e4), 1.005, 1.5)
    assert flat(rows, "x", 1.0) == "1e2 to 1e4"
    assert flat(rows, "x", 9.0) == "nowhere"
