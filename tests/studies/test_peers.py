"""The study of peers: every program is given what it should get, and the verdicts follow the tables."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
from fixtures.pages import DOCS, ROOT

import uq_handeye as uq
from studies import peers
from studies.peers import programs
from studies.peers.findings import OURS, REFERENCE

pytestmark = pytest.mark.slow

NOISE = peers.NOISES["isotropic"]
PROGRAMS = {program.label: program for program in programs.installed() if program.name != "SymForce"}


@pytest.mark.parametrize("label", PROGRAMS)
def test_every_program_finds_the_true_X_of_exact_poses(label):
    poses = uq.simulate(12, seed=3)
    X, S = PROGRAMS[label].prepare(poses, NOISE)()
    np.testing.assert_allclose(X, poses.truth.X, atol=1e-5)
    assert (S is not None) == PROGRAMS[label].told


def test_symforce_minimises_what_ml_minimises():
    pytest.importorskip("symforce")
    program = next(program for program in programs.installed() if program.name == "SymForce")
    noise = peers.NOISES["weak in depth and tilt"]
    poses = uq.simulate(6, noise=noise, seed=3)
    X, S = program.prepare(poses, noise)()
    ours = uq.maximum_likelihood(poses, noise)
    np.testing.assert_allclose(X, ours.X, atol=1e-4 * np.sqrt(ours.covariance_X.max()))
    np.testing.assert_allclose(S, ours.covariance_X, rtol=1e-2, atol=1e-3 * np.abs(ours.covariance_X).max())


def test_covariances_are_in_the_convention_of_the_toolkit():
    pytest.importorskip("gtsam")
    poses = uq.simulate(12, noise=NOISE, seed=4)
    (X, S), (_, ours) = (PROGRAMS[label].prepare(poses, NOISE)() for label in ("GTSAM, latent poses", REFERENCE))
    np.testing.assert_allclose(np.linalg.eigvals(np.linalg.solve(ours, S)).real, 1.0, atol=0.01)
    assert X.shape == (4, 4)


def test_the_noise_is_weak_in_depth_and_tilt_of_the_camera():
    noise = peers.NOISES["weak in depth and tilt"]
    rotation, translation = 1e3 * np.sqrt(np.diag(noise.camera)).reshape(2, 3)
    np.testing.assert_allclose(rotation, [3, 3, 0.5])
    np.testing.assert_allclose(translation, [0.3, 0.3, 3])  # z of the camera is the line of sight
    exact, *noisy = peers._draws(1, noise, 300)
    shift = np.array([poses.camera[:, :3, 3] - exact.camera[:, :3, 3] for poses in noisy])
    np.testing.assert_allclose(1e3 * shift.std(axis=(0, 1)), translation, rtol=0.05)


def test_a_program_that_fails_is_counted_and_one_that_is_not_installed_left_out(monkeypatch):
    def prepare(poses, noise):
        def run():
            if poses.camera[0, 0, 3] > exact.camera[0, 0, 3]:
                raise ValueError("no answer")
            X = exact.truth.X.copy()
            X[0, 3] += poses.camera[2, 0, 3] - exact.camera[2, 0, 3]
            return np.full((4, 4), np.nan) if poses.camera[1, 0, 3] > exact.camera[1, 0, 3] else X, None

        return run

    draws = peers._draws(0, NOISE, 40)
    exact = draws[0]
    program = programs.Program("other", "1", "odd", prepare)
    found, ours = (list(peers._found(one, draws, NOISE, 40, lambda n: None)) for one in (program, PROGRAMS[REFERENCE]))
    row = peers._quality(program, found, ours, exact, np.ones(6))
    assert row["failed"] + row["trials"] == 40 and 20 < row["failed"] < 40 and "NEES" not in row
    absent = dataclasses.replace(programs.PEERS[0], module="no_such_module")
    monkeypatch.setattr(programs, "PEERS", (absent, programs.PEERS[-1]))
    assert absent.version == "not installed"
    assert [program.label for program in programs.installed()] == [OURS, REFERENCE]


def test_the_excess_is_that_over_the_same_draws():
    draws = peers._draws(1, peers.NOISES["weak in depth and tilt"], 40)
    noise = peers.NOISES["weak in depth and tilt"]
    sd = np.sqrt(np.diag(uq.bound(draws[0], noise=noise)))
    ours = list(peers._found(PROGRAMS[REFERENCE], draws, noise, 40, lambda n: None))
    one = peers._quality(PROGRAMS[OURS], list(peers._found(PROGRAMS[OURS], draws, noise, 40, lambda n: None)), ours,
                         draws[0], sd)  # fmt: skip
    assert abs(one["excess"]) < 0.01 and 0.8 < one["error over bound"] < 1.25
    far = [(X.copy(), S) for X, S in ours]
    for X, _ in far:
        X[:3, 3] += 3 * sd[3:]
    other = peers._quality(PROGRAMS[OURS], far, ours, draws[0], sd)
    assert other["excess"] == pytest.approx(0.5 * 9, abs=6 * other["excess standard error"])


def test_runs_are_timed_in_turn():
    calls = []

    def run(name, work):
        def call():
            calls.append(name)
            sum(range(work))
            return np.eye(4), None

        return call

    (short, long), rounds = peers.interleaved([run("a", 10_000), run("b", 300_000)], 0.0, 5)
    assert rounds == 5 and calls == ["a", "b"] * 6 and 3 * short < long


@pytest.fixture(scope="module")
def tables():
    quality = [
        {"noise": "isotropic", "program": program, "version": "1", "method": method, "told the noise": told,
         "poses": 30, "trials": 1000, "failed": 0, "error over bound": error, "standard error": 0.01,
         "excess": error**2 - 1, "excess standard error": 0.02, "NEES": nees}
        for program, method, told, error, nees in (
            ("OpenCV", "Tsai", False, 1.4, np.nan),
            ("GTSAM", "latent poses", True, 1.0, 6.05),
            ("uq-handeye", "efficient", True, 1.0, 6.04),
            ("uq-handeye", "ml", True, 1.0, 6.04),
        )
    ]  # fmt: skip
    ratios = {("OpenCV", "Tsai"): 3.0, ("GTSAM", "latent poses"): 2.0, ("uq-handeye", "efficient"): 1.0,
              ("uq-handeye", "ml"): 2.0}  # fmt: skip
    times = [
        {"program": program, "method": method, "poses": n, "rounds": 5, "ms": ratio, "times efficient": ratio}
        for n in (10, 30)
        for (program, method), ratio in ratios.items()
    ]
    equal = [
        {"noise": "isotropic", "program": "GTSAM", "method": "latent poses", "trials": 20, "largest distance": 0.01,
         "largest covariance difference": 0.001}
    ]  # fmt: skip
    described = [{"name": "OpenCV", "package": "opencv-python-headless", "version": "1", "gives": "X"}]
    rows = {"quality": quality, "times": times, "equal": equal, "peers": described}
    return {name: pd.DataFrame(table) for name, table in rows.items()}


def test_verdicts_follow_the_tables(tables):
    text = peers.findings(tables)
    assert (
        "on the same draws (that these draws show): GTSAM, latent poses; uq-handeye, `efficient`; uq-handeye, `ml`."
        in text
    )
    assert "it is true (NEES, 99.9 %) for 3 of them." in text
    assert "The answer of GTSAM, latent poses is `ml`'s" in text
    assert "10 poses: faster than `efficient` by more than 10 %: none; slower: 2 of 2" in text
    assert "GTSAM takes 2 at 10, 2 at 30 poses" in text
    quality, times, equal = (tables[name].copy() for name in ("quality", "times", "equal"))
    quality.loc[1, ["error over bound", "excess", "NEES"]] = 2.5, 5.25, 9.0
    times.loc[times.program == "GTSAM", "times efficient"] = 0.5
    equal["largest distance"] = 0.4
    text = peers.findings(tables | {"quality": quality, "times": times, "equal": equal})
    assert "on the same draws (that these draws show): uq-handeye, `efficient`; uq-handeye, `ml`." in text
    assert "to 2.50 (GTSAM, latent poses)" in text and "`ml` has 1.00 ± 0.01 times the bound's error and is at" in text
    quality.loc[3, "error over bound"] = 1.2
    assert "and is not at the bound" in peers.findings(tables | {"quality": quality})
    assert "for 2 of them, not for GTSAM, latent poses." in text
    assert "The answer of GTSAM, latent poses is not `ml`'s" in text
    assert "10 poses: faster than `efficient` by more than 10 %: GTSAM, latent poses; slower: 1 of 2" in text


def test_without_any_peer_there_is_no_gap(tables):
    own = {name: table[table.program == "uq-handeye"] for name, table in tables.items() if "program" in table}
    text = peers.findings(tables | own)
    assert "\n\n\n" not in text and "GTSAM" not in text and "2 of 2 give a covariance" in text


def test_the_figure_is_drawn(tables):
    assert set(peers.figures(tables)) == {"peers"}


def test_the_table_of_the_readme_is_a_part_of_that_of_the_study():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("| program |"))
    shown = lines[start : lines.index("", start)]
    measured = (DOCS / "studies" / "peers" / "findings.md").read_text(encoding="utf-8").split("\n\n")[1].splitlines()
    assert len(shown) > 4 and shown == [row for row in measured if row in shown]
