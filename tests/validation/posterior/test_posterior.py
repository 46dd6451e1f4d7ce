"""`sample_posterior` against the bound on problems drawn here, its refusals, and what results give away."""

import json
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest
from fixtures.likelihood_problems import KINDS, problem
from scipy import stats
from support import (
    EQUATION_70,
    difference,
    draw,
    exact_motions,
    is_consistent,
    moved,
    whitened_eigenvalues,
    writable,
)

import uq_handeye as uq
from uq_handeye.errors import DegenerateMotionError, InputError, NotConvergedError
from uq_handeye.fit.graph.gauss_helmert import bound
from uq_handeye.trials.validation.corner_plot import _thresholds
from uq_handeye.trials.validation.posterior.density import ScalePrior
from uq_handeye.trials.validation.posterior.result import shortest
from uq_handeye.trials.validation.posterior.sample import sample_posterior

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("1mrad", "1mm"))
POSES = uq.simulate(10, noise=NOISE, seed=8)


@pytest.fixture(scope="module")
def posterior():
    return sample_posterior(POSES, NOISE, samples=4000)


@pytest.mark.slow
def test_nothing_of_it_can_be_written_to(posterior):
    assert writable(posterior) == []


def agree(covariance, reference, effective):
    """Return whether the whitened eigenvalues are those of a Wishart matrix of so many samples, to 99.9 % or so."""
    edge = np.sqrt(6 / effective) + 3.5 / np.sqrt(effective)  # of the largest singular value of Gaussian matrices
    return bool((np.abs(np.sqrt(whitened_eigenvalues(covariance, reference)) - 1) < edge).all())


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_covariance_is_that_of_the_bound(kind, rng):
    given = problem(kind, rng, n=10, sd=3e-4)
    found = sample_posterior(given.data, given.noise, samples=4000)
    assert agree(found.covariance, found.bound, found.diagnostics.ess_bulk.min())
    assert np.abs(found.mean / found.std).max() < 4 / np.sqrt(found.diagnostics.ess_bulk.min()) + 0.01
    wrong = np.diag([1.1] * 3 + [1.0] * 3)
    assert not agree(wrong @ found.covariance @ wrong, found.bound, 4000)
    assert found.frame == {"motions": None, "eye-in-hand": "gripper_T_camera", "eye-to-hand": "base_T_camera"}[kind]


@pytest.mark.slow
def test_equation_70_at_exact_data(rng):
    """The bar of the paper's experiment: 10,000 effective samples, deviations within 3 % of the bound at the truth."""
    X, A, B = exact_motions(rng, 60)
    noise = uq.PairNoise(*EQUATION_70)
    measured = uq.Motions(*(moved(T, draw(rng, S, (60,))) for T, S in zip((A, B), EQUATION_70, strict=True)))
    found = sample_posterior(measured, noise)
    for values in (found.diagnostics.ess_bulk, found.diagnostics.ess_tail):
        assert values.min() >= 10_000
    ratio = found.std / np.sqrt(np.diag(bound(uq.Motions(A, B), noise, X)))
    assert np.abs(ratio - 1).max() < 0.03


@pytest.mark.statistical
def test_the_truth_lies_where_the_posterior_says(rng):
    noise = uq.PoseNoise.isotropic(robot=("0.5mrad", "0.2mm"), camera=("2mrad", "1mm"))
    errors, covariances = [], []
    for seed in range(16):
        poses = uq.simulate(6, noise=noise, seed=rng)
        found = sample_posterior(poses, noise, samples=400, walkers=32, seed=seed)
        errors.append(difference(poses.truth.X, found.X) - found.mean)
        covariances.append(found.covariance)
    assert is_consistent(np.array(errors), np.array(covariances))
    assert not is_consistent(np.array(errors), 0.25 * np.array(covariances))


@pytest.mark.slow
def test_seeds():
    options = {"samples": 300, "walkers": 32}
    one, same, other = (sample_posterior(POSES, NOISE, seed=seed, **options) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.samples, same.samples)
    n = min(len(one.samples), len(other.samples))
    assert np.mean(one.samples[:n] == other.samples[:n]) < 0.01


@pytest.mark.slow
def test_highest_density(posterior):
    for level in (0.5, 0.9):
        region = posterior.hpd(level)
        assert region.gaussian
        assert abs(region.content - level) < 5 * region.content_error
        z = stats.norm.ppf(0.5 + level / 2)
        expected = posterior.mean[:, None] + posterior.std[:, None] * [-z, z]
        np.testing.assert_allclose(region.intervals, expected, atol=0.25 * posterior.std.max())
        half = 0.5 * np.diff(region.intervals)[:, 0] / posterior.std
        np.testing.assert_allclose(half, z, rtol=0.08)
    for level in (0, 1, -0.1, True, "0.5", None):
        with pytest.raises(InputError, match="level"):
            posterior.hpd(level)


def test_content_of_what_is_no_gaussian(posterior, rng):
    heavy = rng.standard_t(2.5, size=posterior.chain.shape)
    assert not replace(posterior, chain=heavy).hpd(0.5).gaussian


def test_shortest_intervals(rng):
    samples = rng.exponential(size=(20_000, 1))
    low, high = shortest(samples, 0.9)[0]
    assert low < 0.01
    assert abs(high - np.log(10)) < 0.1  # the shortest of an exponential begins at 0
    assert np.mean((samples >= low) & (samples <= high)) >= 0.9


@pytest.mark.slow
def test_nothing_is_reported_before_it_has_converged(tmp_path):
    with pytest.raises(NotConvergedError, match=r"has not converged: .*Raise max_steps") as caught:
        sample_posterior(POSES, NOISE, max_steps=30)
    partial = caught.value.partial
    assert not partial.converged
    for name in ("samples", "mean", "covariance", "std", "scale_samples"):
        with pytest.raises(NotConvergedError) as again:
            getattr(partial, name)
        assert again.value.partial is partial
    with pytest.raises(NotConvergedError):
        partial.hpd(0.9)
    with pytest.raises(NotConvergedError):
        partial.figure(tmp_path / "corner.png")
    assert not list(tmp_path.iterdir())
    assert "NOT CONVERGED" in partial.summary()
    values = json.loads(partial.to_json())
    assert values["converged"] is False
    assert not {"mean", "covariance", "samples", "intervals_95"} & set(values)
    data = partial.to_arviz()
    assert data["posterior"].attrs["converged"] == 0
    assert len(partial.chain) > 0


@pytest.mark.slow
def test_to_arviz(posterior):
    data = posterior.to_arviz()
    assert data["posterior"].attrs["converged"] == 1
    steps, walkers, _ = posterior.chain.shape
    for k, name in enumerate(posterior.names):
        np.testing.assert_array_equal(data["posterior"][name].values, posterior.chain[..., k].T)
    assert data["sample_stats"]["lp"].shape == (walkers, steps)


@pytest.mark.slow
def test_it_needs_no_extra(tmp_path):
    """A new interpreter that cannot import ArviZ, xarray or pandas samples and keeps the chain."""
    done = subprocess.run([sys.executable, "-c", NO_EXTRA, str(tmp_path / "chain.h5")], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "ArviZ is not installed; to_arviz() needs it: pip install arviz.\n")


NO_EXTRA = """
import sys
for name in ("arviz", "arviz_base", "xarray", "pandas"):
    sys.modules[name] = None
import uq_handeye as uq
noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
result = uq.sample_posterior(uq.simulate(10, noise=noise, seed=1), noise, samples=400, walkers=32, file=sys.argv[1])
try:
    result.to_arviz()
except uq.MissingExtraError as error:
    print(error)
"""


def test_json_and_text(posterior):
    values = json.loads(posterior.to_json())
    np.testing.assert_array_equal(values["covariance"], posterior.covariance)
    np.testing.assert_array_equal(values["X"], posterior.X)
    assert values["diagnostics"]["names"] == list(posterior.names)
    assert values["diagnostics"]["converged"] is True
    assert abs(values["content"]["0.95"] - 0.95) < 0.02
    text = posterior.summary()
    assert max(map(len, text.splitlines())) <= 120
    row = next(line.split() for line in text.splitlines() if line.split()[:1] == ["tau_z"])
    assert row[1] == "mm"
    assert abs(float(row[3]) - 1e3 * posterior.std[5]) < 1e-2 * 1e3 * posterior.std[5]
    assert "as those of a Gaussian do" in text


@pytest.mark.slow
def test_figure(posterior, tmp_path):
    style = dict(matplotlib.rcParams)
    figure = posterior.figure(tmp_path / "corner.png")
    assert (tmp_path / "corner.png").read_bytes().startswith(b"\x89PNG")
    posterior.figure(tmp_path / "corner.svg")
    assert b"<svg" in (tmp_path / "corner.svg").read_bytes()
    with pytest.raises(InputError, match="png or svg"):
        posterior.figure(tmp_path / "corner.pdf")
    panels = [axis for axis in figure.axes if axis.axison]
    assert len(panels) == 21
    assert dict(matplotlib.rcParams) == style
    # the 1 sigma ellipse of the first panel is that of the bound, in mrad
    line = figure.axes[6].lines[0].get_xydata()
    inverse = np.linalg.inv(1e6 * posterior.bound[:2, :2])
    np.testing.assert_allclose(np.einsum("ki,ij,kj->k", line, inverse, line), 1.0, rtol=1e-6)


def test_contours_hold_what_they_say(rng):
    z = np.linspace(-5, 5, 400)
    density = np.exp(-0.5 * (z[:, None] ** 2 + z**2))
    for level, threshold in zip((3, 2, 1), _thresholds(density), strict=True):
        assert abs(threshold / np.exp(-0.5 * level**2) - 1) < 0.05


@pytest.mark.slow
def test_scales_find_a_wrong_noise(rng):
    """Deviations of the camera told three times too small, of the robot right."""
    told = uq.PairNoise.isotropic(("1mrad", "1mm"), ("1mrad", "1mm"))
    _, A, B = exact_motions(rng, 80)
    data = uq.Motions(moved(A, draw(rng, told.A, (80,))), moved(B, draw(rng, 9 * told.B, (80,))))
    found = sample_posterior(data, told, scales=True, samples=1000, walkers=48)
    assert list(found.scale_samples) == ["A", "B"]
    total = found.scale_samples["A"] ** 2 + found.scale_samples["B"] ** 2
    low, high = np.quantile(total, [0.0005, 0.9995])
    assert low < 10 < high
    assert high < 15
    held = sample_posterior(data, told, samples=1000, walkers=48)
    assert found.std.min() > 1.7 * held.std.min()
    fixed = sample_posterior(data, told, scales=ScalePrior(robot=None), samples=1000, walkers=48)
    low, high = np.quantile(fixed.scale_samples["B"], [0.0005, 0.9995])
    assert low < 3 < high


@pytest.mark.slow
def test_student_t_bears_wrong_poses():
    poses = uq.simulate(20, noise=NOISE, seed=4)
    camera = np.array(poses.camera)
    camera[3] = moved(camera[3], np.array([0.02, -0.03, 0.02, 0.03, -0.02, 0.03]))
    data = uq.PosePairs(poses.robot, camera)
    distances = {}
    for nu in (None, 3.0):
        found = sample_posterior(data, NOISE, student_t=nu, samples=1000, walkers=48)
        e = difference(poses.truth.X, found.X) - found.mean
        distances[nu] = float(e @ np.linalg.solve(found.covariance, e))
    assert distances[3.0] < stats.chi2.ppf(0.999, 6)
    assert distances[None] > 2 * stats.chi2.ppf(0.999, 6)
    assert found.names[6:] == tuple(f"W_{axis}" for axis in found.names[:6])


@pytest.mark.slow
def test_noise_that_is_estimated():
    found = sample_posterior(POSES, samples=300, walkers=48)
    assert found.noise_estimated
    assert found.scales == ScalePrior()
    assert set(found.scale_samples) == {"robot", "camera"}
    assert "noise estimated from the data" in found.summary()
    fixed = sample_posterior(POSES, samples=300, walkers=48, scales=False)
    assert fixed.scale_samples == {}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"noise": 3}, "`noise`"),
        ({"seed": -1}, "`seed`"),
        ({"seed": 1.5}, "`seed`"),
        ({"samples": 10}, "`samples`"),
        ({"samples": True}, "`samples`"),
        ({"walkers": 10}, "`walkers`"),
        ({"walkers": 16, "student_t": 5, "scales": True}, "`walkers`"),
        ({"max_steps": 0}, "`max_steps`"),
        ({"student_t": 0.5}, "`student_t`"),
        ({"student_t": "5"}, "`student_t`"),
        ({"student_t": np.nan}, "`student_t`"),
        ({"scales": 2.0}, "`scales`"),
        ({"noise": uq.PairNoise.isotropic(("1mrad", "1mm"))}, "Motions"),
    ],
)
def test_wrong_arguments(arguments, words):
    with pytest.raises(InputError, match=words):
        sample_posterior(POSES, arguments.pop("noise", NOISE), **arguments)


def test_data_that_do_not_do(rng):
    with pytest.raises(InputError, match="PosePairs or Motions"):
        sample_posterior(SimpleNamespace(), NOISE)
    with pytest.raises(InputError, match="one data set"):
        sample_posterior(uq.simulate(5, noise=NOISE, trials=2), NOISE)
    with pytest.raises(InputError, match="exact up to rounding"):
        sample_posterior(uq.simulate(6, seed=1))
    turn = moved(np.broadcast_to(np.eye(4), (6, 4, 4)), np.outer(rng.normal(size=6), [0, 0, 1, 0, 0, 0]))
    with pytest.raises(DegenerateMotionError):
        sample_posterior(uq.Motions(turn, turn), uq.PairNoise.isotropic(("1mrad", "1mm"), ("1mrad", "1mm")))
