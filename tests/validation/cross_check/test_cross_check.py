"""The cross-check: every row against an independent reference, and what it says of healthy and of bad problems."""

import json
import os
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from support import (
    EQUATION_70,
    SEED,
    assert_same_covariance,
    draw,
    exact_motions,
    moved,
)

import uq_handeye as uq
from uq_handeye.core.presentation.document import WIDTH
from uq_handeye.findings import Finding
from uq_handeye.trials.validation.cross_check import rows as cross_check_rows
from uq_handeye.trials.validation.cross_check.run import cross_check
from uq_handeye.trials.validation.cross_check.text import _figures, _sentence
from uq_handeye.trials.validation.posterior import sample as posterior
from uq_handeye.trials.validation.sentences import INTERRUPTED

NOISE_70 = uq.PairNoise(*EQUATION_70)
ON_POSES = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


def motions(seed=SEED, N=60):
    """True X and motions, and measured ones with the noise (70)."""
    rng = np.random.default_rng(seed)
    X, A, B = exact_motions(rng, N)
    return X, A, B, uq.Motions(*(moved(M, draw(rng, S, (N,))) for M, S in zip((A, B), EQUATION_70, strict=True)))


@pytest.fixture(scope="module")
def paper():
    """The paper's experiment (70), with few trials and the posterior."""
    return cross_check(motions()[3], noise=NOISE_70, trials=800, seed=SEED)


@pytest.fixture(scope="module")
def poses():
    return cross_check(
        uq.simulate(12, noise=ON_POSES, seed=SEED), noise=ON_POSES, trials=800, seed=SEED, posterior=False
    )


@pytest.mark.slow
def test_a_healthy_problem_shows_no_broken_relation(paper, poses):
    assert paper.broken == poses.broken == ()
    assert [r.holds for r in paper.relations if r.law] == [True] * 8
    assert paper.to_text().startswith("All 8 relations hold: the covariances are those that theory predicts for this")
    assert [row.key for row in paper.rows] == [
        "4dpa-pairs",
        "4dpa-literal",
        "nguyen-own",
        "nguyen-first-order",
        "efficient",
        "ml",
        "bound",
        "4dpa-sampled",
        "nguyen-sampled",
        "efficient-sampled",
        "ml-sampled",
        "posterior",
    ]
    assert [row.key for row in poses.rows] == [
        *("4dpa-pairs", "4dpa-poses"),
        *(row.key for row in paper.rows[1:-1]),
    ]
    # pairs share poses: what Nguyen and Pham's own covariances promise is no matter of the bound
    assert poses.relation("nguyen-not-below-bound").holds is None
    assert poses.relation("shared-poses").holds is True
    assert "posterior" not in [row.key for row in poses.rows] and poses.posterior is None


@pytest.mark.slow
def test_formulas_at_the_truth(poses):
    simulated = uq.simulate(12, noise=ON_POSES, seed=SEED)
    truth = simulated.truth
    exact = uq.relative_motions(uq.PosePairs(truth.robot, truth.camera), "all")
    for kind in ("pairs", "poses"):
        reference = uq.propagate(exact, ON_POSES, X=truth.X, kind=kind)
        assert_same_covariance(poses.row(f"4dpa-{kind}").covariance, reference, 1e-9)
    reference = uq.propagate(exact, ON_POSES, X=truth.X, method="nguyen")
    assert_same_covariance(poses.row("nguyen-first-order").covariance, reference, 1e-6)
    assert_same_covariance(poses.row("bound").covariance, uq.bound(simulated, ON_POSES), 1e-9)
    assert_same_covariance(poses.row("efficient").covariance, uq.efficient(simulated, ON_POSES).covariance_X, 1e-9)
    assert_same_covariance(poses.row("ml").covariance, uq.maximum_likelihood(simulated, ON_POSES).covariance_X, 1e-9)


@pytest.mark.slow
def test_formulas_of_motions():
    """(45) and Nguyen and Pham's own, where the truth is known to us."""
    X, A, B, _ = motions()
    check = cross_check(uq.Motions(A, B), noise=NOISE_70, trials=100, posterior=False)
    literal = uq.propagate(A, B, NOISE_70, X=X, kind="literal")
    assert np.allclose(check.row("4dpa-literal").covariance, literal, rtol=1e-4, atol=1e-4 * np.abs(literal).max())
    own = uq.nguyen(A, B, NOISE_70)
    covariance = check.row("nguyen-own").covariance
    assert np.allclose(covariance[:3, :3], own.Sigma_R, rtol=1e-6) and np.allclose(
        covariance[3:, 3:], own.Sigma_t, rtol=1e-6
    )
    assert not covariance[:3, 3:].any()
    assert "no cross-covariance" in check.row("nguyen-own").note


@pytest.mark.slow
def test_numbers_of_a_row(paper):
    row, errors = paper.row("4dpa-pairs"), paper.runs["4dpa"].errors
    P = row.covariance
    assert np.allclose(row.std**2, np.diag(P))
    assert np.isclose(row.trace_rotation, np.trace(P[:3, :3])) and np.isclose(
        row.trace_translation, np.trace(P[3:, 3:])
    )
    assert np.isclose(row.log_determinant, np.log(np.linalg.eigvalsh(P)).sum())
    nees = np.einsum("ti,ti->t", errors, np.linalg.solve(P, errors.T).T)
    assert np.isclose(row.nees, nees.mean())
    assert np.allclose(row.nees_interval, stats.chi2.ppf([0.005, 0.995], 6 * len(errors)) / len(errors))
    assert row.consistent is True
    assert np.allclose(paper.row("4dpa-sampled").covariance, np.cov(errors.T))
    assert paper.row("4dpa-sampled").nees is None and paper.row("4dpa-sampled").trials == 800
    # the bound is judged by the trials of ml, and so is the posterior, which adds the error of its own samples
    assert paper.row("bound").method == paper.row("posterior").method == "ml"
    widths = [np.ptp(paper.row(key).nees_interval) for key in ("bound", "posterior")]
    assert widths[0] < widths[1] < 2 * widths[0]
    # taken as independent, the covariance of pairs that share poses must be seen to be wrong
    assert replace(row, nees=6.9).consistent is False


@pytest.mark.slow
def test_literal_covariance_is_singular(paper):
    row = paper.row("4dpa-literal")
    assert row.singular and row.log_determinant is None and row.nees is None
    assert "Singular" in row.note
    assert not paper.row("bound").singular
    # by at least sqrt(N) too small, where all pairs have the same noise
    sampled = paper.row("4dpa-sampled").std
    assert (sampled / row.std > np.sqrt(60) * 0.85).all()


@pytest.mark.slow
def test_large_noise_is_named_in_the_text():
    rng = np.random.default_rng(3)
    _, A, B = exact_motions(rng, 60)
    S = np.diag(np.repeat([0.4, 0.1], 3) ** 2)
    check = cross_check(uq.Motions(A, B), noise=uq.PairNoise(S, S), trials=500, posterior=False)
    assert "4dpa-first-order" in check.broken
    text = check.to_text(verbose=True)
    assert text.startswith("BROKEN: ")
    assert "NOT SO" in text and "[BROKEN]" in text
    assert check.row("4dpa-pairs").consistent is False and "!" in text
    failures = check.row("nguyen-sampled").failures
    assert failures > 0 and f"{failures} of 500 trials gave no estimate" in " ".join(text.split())


@pytest.mark.slow
def test_heavy_tails_are_no_excuse_for_a_covariance_that_is_wrong():
    """Rare large errors: what chance explains would then be anything, so that inside of it nothing holds."""
    noise = uq.PoseNoise.isotropic(camera=(0.4, "1mm"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        check = cross_check(uq.simulate(15, noise=noise, seed=1), noise=noise, trials=1000, posterior=False)
    assert check.row("4dpa-poses").nees > 9 and check.row("4dpa-poses").consistent is False
    assert {"4dpa-first-order", "efficient-bound", "shared-poses"} <= set(check.broken)
    assert check.relation("ml-bound").holds is True
    relation = check.relation("4dpa-first-order")
    assert "heavy tails, which no covariance describes" in relation.text and "chance explains" not in relation.text
    assert "rare large ones" in relation.advice and "no covariance in its place would do" in relation.advice


def test_what_cannot_be_worked_out_says_why():
    """Exact translations: there is no bound, no efficient estimate, no posterior."""
    _, A, B, _ = motions()
    noise = uq.PairNoise(A=np.diag([1e-6] * 3 + [0.0] * 3))
    check = cross_check(uq.Motions(A, B), noise=noise, trials=100)
    for key in ("efficient", "ml", "bound", "efficient-sampled", "ml-sampled", "posterior"):
        row = check.row(key)
        assert row.covariance is None and "exact" in row.note and row.std is None and row.consistent is None
    assert check.relation("ml-bound").holds is None and "Cramer-Rao bound: none" in check.relation("ml-bound").text
    assert check.relation("4dpa-first-order").holds is True
    text = check.to_text(verbose=True)
    assert "none, see below" in text and "Not judged" in text
    json.loads(check.to_json())


@pytest.mark.slow
def test_a_posterior_that_did_not_converge(monkeypatch, poses):
    def refuse(*args, **kwargs):
        raise uq.NotConvergedError("The posterior has not converged: no.")

    monkeypatch.setattr(posterior, "sample_posterior", refuse)
    check = cross_check(uq.simulate(12, noise=ON_POSES, seed=SEED), noise=ON_POSES, trials=100)
    row = check.row("posterior")
    assert row.covariance is None and row.note == "The posterior has not converged: no."
    assert check.relation("posterior-bound").holds is None and check.broken == ()


@pytest.mark.slow
def test_very_many_pairs(monkeypatch):
    monkeypatch.setattr(cross_check_rows, "MAX_PAIRS_OF_NGUYEN", 60)
    monkeypatch.setattr(cross_check_rows, "MAX_POSES_OF_TRIALS", 2000)
    data = uq.simulate(12, noise=ON_POSES, seed=SEED)  # 66 pairs
    check = cross_check(data, noise=ON_POSES, trials=300, posterior=False)
    assert "66 pairs are too many" in check.row("nguyen-sampled").note
    assert "66 pairs are too many" in check.relation("nguyen-first-order").text
    assert check.row("nguyen-own").covariance is not None
    assert check.row("ml-sampled").trials == 166 and "166 trials in place of 300" in check.row("ml-sampled").note
    assert check.row("4dpa-pairs").covariance is not None and check.relation("4dpa-first-order").holds
    assert "166 trials in place of 300" in check.to_text(verbose=True)
    monkeypatch.setattr(cross_check_rows, "MAX_PAIRS", 65)
    check = cross_check(data, noise=ON_POSES, trials=100, posterior=False)
    for key in ("4dpa-pairs", "4dpa-literal", "nguyen-own", "nguyen-first-order"):
        assert "66 pairs are too many" in check.row(key).note
    assert check.relation("shared-poses").holds is None and check.broken == ()


def test_interrupted(monkeypatch):
    real = cross_check_rows.monte_carlo

    def once(*args, **kwargs):
        return replace(real(*args, **kwargs), ended=Finding(INTERRUPTED, "caution"))

    monkeypatch.setattr(cross_check_rows, "monte_carlo", once)
    check = cross_check(uq.simulate(12, noise=ON_POSES, seed=SEED), noise=ON_POSES, trials=100)
    assert "interrupted" in check.row("4dpa-sampled").note and list(check.runs) == ["4dpa"]
    assert check.row("ml-sampled").covariance is None and "Not run" in check.row("ml-sampled").note
    assert "Not run" in check.row("posterior").note and check.posterior is None


@pytest.mark.slow
def test_a_run_that_was_cut_short_says_so_first(monkeypatch):
    real = cross_check_rows.monte_carlo

    def until_efficient(*args, method, **kwargs):
        if method == "efficient":
            raise KeyboardInterrupt
        return real(*args, method=method, **kwargs)

    data = uq.simulate(12, noise=ON_POSES, seed=SEED)
    whole = cross_check(data, noise=ON_POSES, trials=100, posterior=False)
    assert whole.complete and whole.reason == "" and "NOT COMPLETE" not in whole.to_text(verbose=True)
    assert "; 100 trials, seed 0" in whole.to_text(verbose=True)
    monkeypatch.setattr(cross_check_rows, "monte_carlo", until_efficient)
    check = cross_check(data, noise=ON_POSES, trials=100)
    assert not check.complete and check.reason == "interrupted" and list(check.runs) == ["4dpa", "nguyen"]
    first = "NOT COMPLETE (interrupted). Trials, of 100 asked: 4dpa 100, nguyen 100, efficient 0, ml 0. No posterior."
    assert check.to_text(verbose=True).startswith(first)
    assert "; trials: 4dpa 100, nguyen 100, seed 0" in " ".join(check.to_text(verbose=True).split())
    assert "not complete: interrupted" in repr(check) and json.loads(check.to_json())["complete"] is False
    monkeypatch.setattr(cross_check_rows, "monte_carlo", lambda *args, **kwargs: until_efficient(method="efficient"))
    with pytest.raises(KeyboardInterrupt):  # there is nothing to show
        cross_check(data, noise=ON_POSES, trials=100)


@pytest.mark.slow
def test_ctrl_c_in_the_posterior_keeps_the_trials(monkeypatch):
    def pressed(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(posterior, "sample_posterior", pressed)
    check = cross_check(uq.simulate(12, noise=ON_POSES, seed=SEED), noise=ON_POSES, trials=100)
    assert not check.complete and len(check.runs) == 4 and check.posterior is None
    assert check.to_text(verbose=True).startswith(
        "NOT COMPLETE (interrupted). Trials, of 100 asked: 4dpa 100, nguyen 100,"
    )


def test_words_and_units_of_the_text(poses):
    text = poses.to_text(verbose=True)
    assert "rotation (deg)" in text and "deg^2" in text and "mrad" not in text
    line = next(line for line in text.splitlines() if line.startswith("Cramer-Rao bound"))
    std = poses.row("bound").std
    shown = [float(cell) for cell in line.removeprefix("Cramer-Rao bound").split()[:6]]
    assert np.allclose(shown, [*np.degrees(std[:3]), *1e3 * std[3:]], rtol=6e-3)
    # names of methods stay as they are, at the start of a sentence too
    assert _sentence("ml, Monte Carlo: none") == "ml, Monte Carlo: none."
    assert _sentence("efficient, at the data: none.") == "efficient, at the data: none."
    assert _sentence("standard deviations") == "Standard deviations."
    assert all(len(_figures(value)) <= 7 for value in 10.0 ** np.arange(-30, 30) * 9.996)


@pytest.mark.slow
def test_noise_on_pairs_of_poses_and_estimated_noise():
    data = uq.simulate(10, noise=ON_POSES, seed=SEED)
    check = cross_check(data, noise=uq.PairNoise.isotropic(B=("1mrad", "1mm")), trials=100, posterior=False)
    assert (check.n, check.pairs, check.origin) == (45, 45, "truth of the simulation")
    assert "4dpa-poses" not in [row.key for row in check.rows] and check.broken == ()
    measured = uq.PosePairs(data.robot, data.camera)
    check = cross_check(measured, trials=100, posterior=False)
    assert check.noise_estimated and check.origin == "fit to the data" and check.frame == "gripper_T_camera"
    assert "estimated from the data" in check.to_text(verbose=True)


@pytest.mark.slow
@pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")
def test_a_real_data_set():
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / "kuka_1"
    check = cross_check(uq.read_poses(folder / "robot.csv", folder / "camera.csv"), trials=300, posterior=False)
    assert check.broken == () and check.relation("shared-poses").holds
    assert check.row("4dpa-pairs").nees > 50 and check.row("4dpa-poses").consistent


@pytest.mark.slow
def test_the_same_seed_gives_the_same_numbers(poses):
    data = uq.simulate(12, noise=ON_POSES, seed=SEED)
    again = cross_check(data, noise=ON_POSES, trials=800, seed=SEED, posterior=False)
    for one, other in zip(poses.rows, again.rows, strict=True):
        assert np.array_equal(one.covariance, other.covariance) and one.nees == other.nees


@pytest.mark.slow
def test_output(paper, tmp_path):
    plain = json.loads(paper.to_json(tmp_path / "check.json"))
    assert plain == json.loads((tmp_path / "check.json").read_text())
    assert np.allclose(plain["rows"][0]["covariance"], paper.rows[0].covariance)
    assert plain["broken"] == [] and plain["units"]["rotation"] == "rad" and plain["frame"] == "X"
    assert {r["name"] for r in plain["relations"]} == {r.name for r in paper.relations}
    table = paper.to_dataframe()
    assert list(table.index) == [row.key for row in paper.rows]
    assert np.allclose(table.loc["bound", "std_translation_z"], paper.row("bound").std[5])
    assert table.loc["4dpa-sampled", "trials"] == 800 and table.loc["bound", "nees_low"] < 6
    text = paper.summary(verbose=True)
    assert text == paper.to_text(verbose=True)
    assert [line for line in text.splitlines() if len(line) > WIDTH] == []
    assert all(relation.statement in " ".join(text.split()) for relation in paper.relations)
    assert "12 rows" in repr(paper) and "no relation broken" in repr(paper)


def test_wrong_input(poses):
    data = uq.simulate(8, noise=ON_POSES, seed=SEED)
    for name, value in (("trials", 99), ("trials", True), ("trials", 1e4), ("seed", -1), ("workers", 0)):
        with pytest.raises(uq.InputError, match=f"`{name}`"):
            cross_check(data, noise=ON_POSES, posterior=False, **{name: value})
    with pytest.raises(uq.InputError, match="`data`"):
        cross_check(np.eye(4), noise=ON_POSES)
    with pytest.raises(uq.InputError, match="no noise to draw"):
        cross_check(uq.simulate(8, seed=SEED))
    with pytest.raises(uq.InputError, match="key of a row"):
        poses.row("4DPA")
    with pytest.raises(uq.InputError, match="name of a relation"):
        poses.relation("T8")
    rng = np.random.default_rng(SEED)
    _, A, _ = exact_motions(rng, 5)
    turned = np.broadcast_to(np.eye(4), A.shape).copy()
    turned[:, :3, 3] = rng.normal(size=(5, 3))
    with pytest.raises(uq.DegenerateMotionError):
        cross_check(uq.Motions(turned, turned), noise=uq.PairNoise.isotropic(A=("1mrad", "1mm")), posterior=False)
