"""Limits of first order: against independent trials, sigma points beyond them, the words, and the figure."""

import inspect
import json
import multiprocessing
import subprocess

import numpy as np
import pytest
from scipy import stats
from support import SEED, exact_motions, nees

import uq_handeye as uq
from uq_handeye.errors import InputError
from uq_handeye.findings import Finding
from uq_handeye.trials.simulation.experiment import experiment
from uq_handeye.trials.simulation.run import run
from uq_handeye.trials.validation.figures_of_trials import sweep_figure
from uq_handeye.trials.validation.sweep import run as sweep_module
from uq_handeye.trials.validation.sweep.level import KINDS, Level, Limit, MethodSweep, Verdict, coverage_limits, judged
from uq_handeye.trials.validation.sweep.run import CLOSE, sweep, verdict

FAILS = Finding("sweep.no_estimate", "failure", {"failures": 2, "trials": 9})


def star(sd, N=30):
    """Motions of nearly one common translation, and noise on both sides, mostly of rotation."""
    rng = np.random.default_rng([70, 30])  # where first order ends depends on the geometry
    X, _, B = exact_motions(rng, N)
    B[:, :3, 3] = [0.3, 0.0, 0.4] + 0.01 * rng.normal(size=(N, 3))
    S = np.diag(np.repeat([sd, 1e-4], 3) ** 2)
    return uq.Motions(X @ B @ np.linalg.inv(X), B), uq.PairNoise(S, S)


@pytest.fixture(scope="module")
def found():
    motions, noise = star(0.03)
    return sweep(motions, noise=noise, methods=["4dpa"], factors=[0.1, 1, 10, 1000], trials=2000, seed=SEED)


def mean_nees(motions, noise, factor, seed):
    """Return the mean NEES of fresh trials in the first-order covariance."""
    scaled = uq.PairNoise(factor * noise.A, factor * noise.B)
    problem = experiment(motions, scaled, "4dpa")
    errors = run(problem, np.random.default_rng([SEED, seed]), 4000).errors
    return [nees(errors[:, part], problem.predicted()[part, part]).mean() for part in (slice(6), slice(3), slice(3, 6))]


def test_first_order_holds_below_its_limit_and_fails_beyond(found):
    motions, noise = star(0.03)
    limit = found["4dpa"].limit("first order")
    assert 1 < limit.holds < limit.fails < 1000
    assert limit.fails / limit.holds <= CLOSE * (1 + 1e-9)
    inside = mean_nees(motions, noise, limit.holds / 4, 1)
    outside = mean_nees(motions, noise, 2 * limit.fails, 2)
    assert np.abs(np.array(inside) / [6, 3, 3] - 1).max() < 0.21
    assert np.abs(np.array(outside) / [6, 3, 3] - 1).max() > 0.21


def test_sigma_points_reach_farther(found):
    first, second = (found["4dpa"].limit(kind) for kind in KINDS)
    assert second.holds > 3 * first.fails
    at = found["4dpa"].at(first.fails)
    assert not at.first_order.holds and at.sigma_points.holds
    assert abs(at.sigma_points.mean_nees[0] - 6) < 0.4 < at.first_order.mean_nees[0] - 6
    least, largest = at.sigma_points.worst
    assert 0.9 < least < largest < 1.1 < at.first_order.worst[1]


def test_heavy_tails_are_said():
    """Errors of which few make up the spread, held against their own mean square: no covariance serves."""
    rng = np.random.default_rng([SEED, 40])
    errors, ok = heavy_errors(rng), np.ones(4000, dtype=bool)
    first = judged("first order", errors, ok, 0.1 * np.eye(6), 0.1)
    second = judged("sigma points", errors, ok, errors.T @ errors / 4000, 0.1)
    level = Level(1.0, first, second)
    assert level.heavy and not second.holds
    assert abs(second.mean_nees[0] - 6) < 1e-9 and second.failure.code == "sweep.coverage"
    text = verdict(MethodSweep("m", (level,)))
    assert text.startswith("m: first order is not valid at your noise. The ") and "errors are 3." in text
    assert "Sigma points are not valid at your noise. The 95 % ellipsoid holds" in text
    assert "The errors have heavy tails" in text and "use another method" in text
    gaussian = rng.normal(size=(4000, 6))
    fine = judged("sigma points", gaussian, ok, gaussian.T @ gaussian / 4000, 0.1)
    assert fine.holds and not Level(1.0, fine, fine).heavy


def heavy_errors(rng):
    """(4000, 6) with unit mean square, of two sizes."""
    return rng.normal(size=(4000, 6)) * np.sqrt(rng.choice([0.25, 4], size=(4000, 1), p=[0.8, 0.2]))


def test_the_user_is_told_whether_the_noise_is_inside(found):
    text = " ".join(found.summary(verbose=True).split())
    limit = found["4dpa"].limit("first order")
    assert f"4dpa: first order is valid up to {np.sqrt(limit.holds):.2g} times your standard deviations (" in text
    assert limit.holds > 4 and "; your own noise is well inside." in text  # twice the deviations and more
    assert "Beyond, it fails." in text and "Sigma points are valid" in text
    motions, noise = star(0.5)
    outside = sweep(motions, noise=noise, methods=["4dpa"], factors=[0.001], trials=400, seed=SEED)
    text = " ".join(outside.summary(verbose=True).split())
    assert "4dpa: first order is not valid at your noise." in text
    own = outside["4dpa"].own
    assert own.sigma_points.holds and not own.first_order.holds
    assert "Use covariance='sigma-points', which is valid at all levels tried, up to your noise." in text
    assert "Sigma points are not valid" not in text


def test_the_margin_of_the_noise_is_said():
    """Well inside from twice the deviations on, near the end below; without an end only inside."""
    rng = np.random.default_rng([SEED, 41])
    errors, ok = rng.normal(size=(4000, 6)), np.ones(4000, dtype=bool)
    good, bad = (judged("first order", errors, ok, covariance, 0.1) for covariance in (np.eye(6), np.eye(6) / 9))
    sigma = judged("sigma points", errors, ok, np.eye(6), 0.1)
    assert good.holds and not bad.holds and sigma.holds
    for factors, said in (
        ((1.0, 3.0, 3.1), "your own noise is inside, but near the end."),
        ((1.0, 5.0, 5.2), "your own noise is well inside."),
        ((1.0, 3.0), "your own noise is inside."),
    ):
        levels = [Level(f, bad if f > 3 and f != 5 else good, sigma) for f in factors]
        assert f"; {said}" in verdict(MethodSweep("m", tuple(levels)))


def test_a_wrong_covariance_would_be_noticed(found):
    """Deviations that are 15 % off at factor 1 fail by the same rule."""
    from uq_handeye.trials.validation.monte_carlo.chunks import Work, chunk_size

    motions, noise = star(0.03)
    problem = experiment(motions, noise, "4dpa")
    covariance = problem.predicted()
    chunks = Work(problem, SEED, 2000, chunk_size(problem), covariance)
    parts = [chunks.compute(k) for k in range(chunks.count)]
    errors, ok = (np.concatenate([getattr(part, name) for part in parts]) for name in ("errors", "ok"))
    assert judged("first order", errors, ok, covariance, 0.1).holds
    for factor in (1 / 1.15, 1.15):
        wrong = judged("first order", errors, ok, factor**2 * covariance, 0.1)
        assert wrong.failure.code == "sweep.size" and wrong.failure.values["ratio"] == pytest.approx(
            1 / factor, rel=0.1
        )
        assert f"{wrong.failure.values['ratio']:.2g} times as large as predicted" in wrong.reason
    few = judged("first order", errors, np.arange(2000) % 50 > 0, covariance, 0.1)
    assert few.failure == Finding("sweep.no_estimate", "failure", {"failures": 40, "trials": 2000})


def test_coverage_limits_are_those_of_wrong_deviations():
    for size in (3, 6):
        few, many = coverage_limits(size, 0.1)
        edge = stats.chi2.ppf(0.95, size)
        assert few == pytest.approx(stats.chi2.cdf(edge / 1.21, size))
        assert many == pytest.approx(stats.chi2.cdf(edge * 1.21, size))


def test_limits_of_all_shapes():
    def levels(*holds):
        made = (Verdict("", None, None, None if ok else FAILS) for ok in holds)
        return MethodSweep("m", tuple(Level(10.0**k, one, one) for k, one in enumerate(made)))

    assert levels(True, True).limit("first order") == Limit(10.0, None)
    assert levels(False, True).limit("first order") == Limit(None, 1.0)
    # one that holds again beyond a failure is no reason to trust it
    assert levels(True, False, True).limit("sigma points") == Limit(1.0, 10.0)


def test_factor_one_is_the_monte_carlo_of_the_same_seed(found):
    from uq_handeye.trials.validation.monte_carlo.run import monte_carlo

    motions, noise = star(0.03)
    same = monte_carlo(motions, noise=noise, method="4dpa", trials=2000, seed=SEED)
    np.testing.assert_allclose(found["4dpa"].own.first_order.mean_nees[0], same.mean_nees, rtol=1e-9)


def test_the_same_seed_gives_the_same_digits_in_this_process_alone(found, monkeypatch):
    def never(*args, **kwargs):
        raise AssertionError("a process was started")

    monkeypatch.setattr(multiprocessing.Process, "start", never)
    monkeypatch.setattr(subprocess, "Popen", never)
    motions, noise = star(0.03)
    options = {"factors": np.array([0.1, 1, 10, 1000]), "trials": np.int64(2000), "seed": np.int32(SEED)}
    other = sweep(motions, noise=noise, methods="4dpa", tolerance=np.float64(0.1), **options)
    assert other.to_json() == found.to_json()
    assert "workers" not in inspect.signature(sweep).parameters


def test_ctrl_c_leaves_as_it_is(monkeypatch):
    def pressed(task):
        raise KeyboardInterrupt

    monkeypatch.setattr(sweep_module, "drawn", pressed)
    motions, noise = star(0.03)
    with pytest.raises(KeyboardInterrupt):
        sweep(motions, noise=noise, methods=["4dpa"], trials=100)


def test_factors_are_named_by_what_they_are_of(found):
    """Covariances times f are deviations times its root: both stand in the table and in the sentence."""
    text = found.summary(verbose=True)
    row = next(line.split() for line in text.splitlines() if line.split()[:1] == ["10"])
    head = next(line for line in text.splitlines() if "cov x" in line)
    assert head.split()[:4] == ["cov", "x", "sd", "x"] and row[:2] == ["10", "3.16"]
    assert max(map(len, text.splitlines())) <= 120
    holds = found["4dpa"].limit("first order").holds
    words = " ".join(text.split())
    assert f"{np.sqrt(holds):.2g} times your standard deviations ({holds:.3g} times your covariances)" in words
    assert "all levels share their draws" in words


def test_a_limit_among_heavy_tails_is_no_sharp_number():
    rng = np.random.default_rng([SEED, 41])
    errors, ok = heavy_errors(rng), np.ones(4000, dtype=bool)
    fails = judged("sigma points", errors, ok, errors.T @ errors / 4000, 0.1)
    gaussian = rng.normal(size=(4000, 6))
    fine = judged("sigma points", gaussian, ok, gaussian.T @ gaussian / 4000, 0.1)
    first = Verdict("first order", None, None, FAILS)
    levels = (Level(1.0, fine, fine), Level(29.37**2, first, fine), Level(31.2**2, first, fails))
    found = MethodSweep("m", levels)
    assert found.limit("sigma points") == Limit(29.37**2, 31.2**2, heavy=True)
    assert found.limit("first order") == Limit(1.0, 29.37**2, heavy=False)
    text = verdict(found)
    assert "Sigma points are valid up to about 29 times your standard deviations (860 times your covariances)" in text
    assert "from about 31 times on errors have heavy tails, where it is chance whether a level passes" in text
    assert "29.3" not in text and "29.4" not in text
    assert verdict(MethodSweep("m", levels[:2])).count("about") == 0


def test_repr_is_short(found):
    assert repr(found).startswith("Sweep(2,000 trials per level") and len(repr(found)) < 200
    assert repr(found["4dpa"]).startswith("MethodSweep(4dpa, ") and len(repr(found["4dpa"])) < 200


def test_the_figure_explains_the_marks_that_there_are(found):
    footer = sweep_figure(found).texts[-1].get_text()
    assert "White" in footer and "Dotted" in footer and "share their draws" in footer
    motions, noise = star(0.03)
    inside = sweep(motions, noise=noise, methods=["4dpa"], factors=[1], trials=500, seed=SEED)
    footer = sweep_figure(inside).texts[-1].get_text()
    assert "White" not in footer and "Dotted" not in footer and "~" not in footer


def test_poses_and_several_methods():
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    poses = uq.simulate(n_poses=12, noise=noise, seed=SEED)
    seen = uq.PosePairs(poses.robot, poses.camera)
    found = sweep(seen, noise=None, methods=["4dpa", "shah"], factors=[4], trials=1000, seed=SEED)
    assert found.noise_estimated and found.around == "fit to the data"
    assert all(one.own.first_order.holds for one in found.methods)
    assert "first order is valid at all levels tried, up to 2 times your standard deviations (4 " in " ".join(
        found.summary(verbose=True).split()
    )


def test_points_without_an_estimate_fail_in_words():
    motions, noise = star(0.5)
    found = sweep(motions, noise=noise, methods=["nguyen"], factors=[], trials=100, seed=SEED)
    own = found["nguyen"].own
    assert own.first_order.failure.code == "sweep.no_estimate" and own.failed > 0.01
    assert own.sigma_points.covariance is None and own.sigma_points.failure.code == "sweep.no_sigma_points"
    assert "Sigma points are not valid at your noise" in " ".join(found.summary(verbose=True).split())
    json.loads(found.to_json())


def test_everything_can_be_written(found, tmp_path):
    data = json.loads(found.to_json(tmp_path / "sweep.json"))
    assert data["methods"][0]["limits"]["first order"]["holds"] == found["4dpa"].limit("first order").holds
    assert (tmp_path / "sweep.json").read_text() == found.to_json()
    frame = found.to_dataframe()
    assert len(frame) == 2 * len(found["4dpa"].levels)
    assert frame[frame.kind == "first order"].holds.tolist() == [
        level.first_order.holds for level in found["4dpa"].levels
    ]
    for kind, start in (("png", b"\x89PNG"), ("svg", b"<?xml")):
        path = found.figure(tmp_path / f"sweep.{kind}")
        assert path.read_bytes().startswith(start)
        assert found.figure(tmp_path / f"again.{kind}").read_bytes() == path.read_bytes()
    with pytest.raises(InputError, match=r"\.png or \.svg"):
        found.figure(tmp_path / "sweep.pdf")


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"factors": [0]}, "`factors`"),
        ({"factors": ["much"]}, "`factors`"),
        ({"trials": 10}, "`trials`"),
        ({"tolerance": 1.5}, "`tolerance`"),
        ({"tolerance": True}, "`tolerance` to be a number between 0 and 1"),
        ({"methods": None}, "`methods`"),
        ({"methods": 5}, "`methods`"),
        ({"methods": ["4dpa", 5]}, "`methods`"),
        ({"methods": []}, "`methods`"),
        ({"methods": ["none"]}, "`method`"),
    ],
)
def test_wrong_arguments_are_named(arguments, name):
    motions, noise = star(0.01)
    with pytest.raises(InputError, match=name):
        sweep(motions, noise=noise, **arguments)
