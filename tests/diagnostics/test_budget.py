"""Types of the sources, combined and expanded uncertainty: against the covariance, Satterthwaite's rule, and draws."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fixtures.rigs import NOISE, quietly
from scipy import stats
from support import SEED

import uq_handeye as uq
from uq_handeye.core.presentation.numbers import fixed
from uq_handeye.fit.diagnostics.budget import Budget
from uq_handeye.model.errors.key import ErrorKey, Kind, Owner
from uq_handeye.model.errors.keys import PRINCIPAL_POINT


@pytest.fixture(scope="module")
def poses():
    return uq.simulate(25, noise=NOISE, seed=SEED)


@pytest.fixture(scope="module")
def by_default(poses):
    return quietly(poses)


def made(variances, relative, types=None):
    """A budget of X whose sources have these variances in every component."""
    parts = np.stack([v * np.eye(6) for v in variances])
    types = ("A",) * len(parts) if types is None else types
    return Budget(
        tuple((ErrorKey(Owner.ROBOT, Kind.OWN, name=name),) for name in "abc"[: len(parts)]),
        parts,
        np.eye(4),
        types,
        np.array(relative),
    )


@pytest.mark.slow
def test_what_is_declared_is_of_type_B_and_what_is_estimated_of_type_A(poses, by_default):
    of = dict(zip(by_default.budget.sources, by_default.budget.types, strict=True))
    shared = {"focal length", "principal point x", "principal point y", "target scale"}
    assert shared <= {name for name, kind in of.items() if kind == "B"}
    noise = {f"{side} {kind}" for side in ("robot", "camera") for kind in ("rotation", "translation")}
    assert {of[name] for name in noise & of.keys()} == {"A"}
    given = quietly(poses, noise=NOISE).budget
    assert set(given.types) == {"B"} and np.isinf(given.dof).all()
    fixed = uq.NoisePrior(robot=("0.02deg", "0.05mm"), factor=1)
    partly = quietly(poses, prior=fixed, shared=[]).budget
    of = dict(zip(partly.sources, partly.types, strict=True))
    assert (of["robot rotation"], of["robot translation"], of["camera rotation"]) == ("B", "B", "A")


def test_combined_is_the_covariance_of_the_result(by_default):
    S, budget = by_default.covariance, by_default.budget
    for name, part in (("X rotation", slice(0, 3)), ("X translation", slice(3, 6))):
        assert budget.combined[name] == pytest.approx(np.sqrt(np.trace(S[part, part]) / 3), rel=1e-9)
        of_sources = np.trace(budget.covariances[:, part, part], axis1=1, axis2=2) / 3  # that of a coupling may be < 0
        assert of_sources.sum() == pytest.approx(budget.combined[name] ** 2, rel=1e-9)
        assert budget.expanded()[name].u == pytest.approx(budget.combined[name], rel=1e-12)
    worst = budget.expanded(worst=True)
    assert worst["X translation"].u == pytest.approx(by_default.weakest_translation[1], rel=1e-9)
    assert worst["X rotation"].u == pytest.approx(by_default.weakest_rotation[1], rel=1e-9)


def test_independent_estimates_follow_welch_and_satterthwaite():
    budget = made([1.0, 4.0, 2.0], np.diag([2 / 10, 2 / 5, 0.0]), ("A", "A", "B"))
    np.testing.assert_allclose(budget.dof, [10, 5, np.inf])
    found = budget.expanded(0.9)["X translation"]
    assert found.dof == pytest.approx(7.0**2 / (1 / 10 + 16 / 5))  # JCGM 100, (G.2b)
    assert found.k == pytest.approx(stats.t.ppf(0.95, found.dof))
    assert pytest.approx(found.k * np.sqrt(7.0)) == found.U
    declared = made([1.0, 4.0], np.zeros((2, 2)), ("B", "B")).expanded()["X rotation"]
    assert np.isinf(declared.dof) and declared.k == pytest.approx(1.959964, rel=1e-6)


@pytest.mark.slow
def test_expanded_uncertainty_holds_as_often_as_it_says():
    """One measured source of 6 degrees of freedom beside a declared one, 10,000 draws."""
    rng = np.random.default_rng(SEED)
    inside = []
    for _ in range(10_000):
        estimated = rng.chisquare(6) / 6
        found = made([estimated, 1.0], np.diag([2 / 6, 0.0]), ("A", "B")).expanded()["X rotation"]
        inside.append(abs(rng.normal() * np.sqrt(2.0)) < found.U)
    assert abs(np.mean(inside) - 0.95) < 0.01


def test_merged_sources_keep_the_whole(by_default):
    budget = by_default.budget
    merged = budget.merged(["principal point x", "principal point y"], ["camera rotation", "focal length"])
    kinds = dict(zip(merged.sources, merged.types, strict=True))
    assert kinds["principal point x + principal point y"] == "B" and kinds["camera rotation + focal length"] == "A, B"
    assert merged.combined == pytest.approx(budget.combined)
    more = budget.plus(PRINCIPAL_POINT.number("x"), np.eye(12) * 1e-8)
    assert more.types == budget.types and more.combined["X rotation"] > budget.combined["X rotation"]
    np.testing.assert_allclose(more.dof, budget.dof)
    assert budget.budget_at([0, 0, 0.5]).types == budget.types
    point = budget.budget_at([0, 0, 0.5]).expanded(worst=True)["point"]
    assert point.U > point.u > 0


def test_what_holds_95_percent_is_that_of_the_mixture_over_sizes(by_default):
    """Its covariance holds what is open of the sizes; a second time, as degrees of freedom, it would count twice."""
    points = by_default.posterior.points
    assert np.isinf(by_default.budget.dof).all()
    text = " ".join(by_default.summary(verbose=True).split())
    shown = fixed(1e3 * by_default.accuracy.translation_95, 2)
    assert f"95 % of the errors are within {shown} " in text
    # Against random draws of the mixture over the sizes itself.
    rng, A = np.random.default_rng(SEED), by_default.posterior.A[3:6]
    weights = np.maximum(points.weights, 0.0)
    counts = rng.multinomial(100_000, weights / weights.sum())
    each = zip(points.means, points.covariances, counts, strict=True)
    drawn = np.concatenate([rng.multivariate_normal(m @ A.T, A @ S @ A.T, k) for m, S, k in each])
    lengths = np.linalg.norm(drawn, axis=1)
    assert by_default.accuracy.translation_95 == pytest.approx(np.quantile(lengths, 0.95), rel=0.01)


def test_coupled_errors_are_one_source(poses):
    rng = np.random.default_rng(SEED)
    A = rng.normal(size=(6, 6)) * np.array([1e-3] * 3 + [5e-4] * 3)[:, None]
    noise = uq.PoseNoise(robot=NOISE.robot, camera=A @ A.T + 1e-8 * np.eye(6))
    summary = quietly(poses, noise=noise).summary(verbose=True)
    assert "camera (rotation and translation)" in summary and "robot rotation" in summary
    assert (
        "all degrees of freedom are infinite" in " ".join(summary.split())
        and "95 % of the errors are within" in summary
    )


def test_what_is_no_budget_is_refused(by_default):
    with pytest.raises(uq.InputError, match="types A or B"):
        replace(by_default.budget, types=("C",) * len(by_default.budget.sources))
    with pytest.raises(uq.InputError, match="level"):
        by_default.budget.expanded(1.0)


@pytest.mark.slow
def test_a_budget_survives_a_file_and_a_damaged_one_is_refused(by_default):
    data = json.loads(by_default.to_json())
    again = uq.Calibration.from_dict(data).budget
    assert again.types == by_default.budget.types and again.expanded() == by_default.budget.expanded()
    stored = data["analysis"]["budget"]
    assert stored["combined"] == by_default.budget.combined
    assert stored["dof"].count(None) == np.isinf(by_default.budget.dof).sum() >= 2
    count = len(stored["sources"])
    for damage in (
        {"types": ["A"]}, {"types": "A" * count}, {"types": ["C"] * count}, {"relative": [[0.0]]},
        {"relative": (-np.eye(count)).tolist()}, {"combined": {"X rotation": 1.0}}, {"dof": [3.0] * count},
    ):  # fmt: skip
        with pytest.raises(uq.InputError, match="damaged") as error:
            uq.Calibration.from_dict(data | {"analysis": data["analysis"] | {"budget": stored | damage}})
        assert "\n" not in str(error.value)
