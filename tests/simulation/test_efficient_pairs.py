"""The fast engine of `efficient` against `likelihood.efficient` on the same disturbed motions, and its statistics."""

import tracemalloc

import numpy as np
import pytest
from support import (
    EQUATION_70,
    assert_same_covariance,
    covers,
    difference,
    draw,
    exact_motions,
    is_consistent,
    logarithms,
    moved,
    random_covariance,
    random_transforms,
    rotations,
    transforms,
)

import uq_handeye as uq
from uq_handeye.core.geometry.component_rows import composed, logarithm, matrix, quaternion, turned
from uq_handeye.fit.likelihood.gauss_helmert import bound, efficient
from uq_handeye.trials.simulation import efficient_pairs
from uq_handeye.trials.simulation.efficient_pairs import efficient_on_drawn, efficient_on_motions


def measured(rng, A, B, noise, trials):
    """Motions (trials, N, 4, 4) with the noise in them."""
    shape = (trials, len(A))
    return [
        np.broadcast_to(T, (*shape, 4, 4)) if S is None else moved(T, draw(rng, S, shape))
        for T, S in ((A, noise.A), (B, noise.B))
    ]


def assert_as_efficient(X, A, B, noise, tolerance=1e-9):
    """Errors to that many standard deviations, covariances relatively, trial by trial."""
    errors, covariances, ok = efficient_on_motions(A, B, X, noise)
    found = efficient(uq.Motions(A, B), noise)
    assert ok.all()
    deviations = np.sqrt(np.diagonal(found.covariance, axis1=-2, axis2=-1))
    assert np.abs((errors - difference(found.X, X)) / deviations).max() < tolerance
    for covariance, reference in zip(covariances, found.covariance, strict=True):
        assert_same_covariance(covariance, reference, tolerance, symmetry=max(1e-9, tolerance))


def noise_of(rng, kinds, N, sd=1e-3, **kwargs):
    """Not nearly singular: beside an exact side the residuals have the noise of one side alone."""
    floor = (0.1 * sd) ** 2 * np.eye(6)
    return uq.PairNoise(
        *(
            None
            if kind == "exact"
            else floor + random_covariance(rng, 6, (N,) if kind == "per pair" else (), sd=sd, **kwargs)
            for kind in kinds
        )
    )


@pytest.mark.parametrize("N", [2, 3, 17, 60, 200])
@pytest.mark.parametrize(
    "kinds",
    [
        ("common", "common"),
        ("per pair", "common"),
        ("common", "per pair"),
        ("per pair", "per pair"),
        ("exact", "common"),
        ("per pair", "exact"),
    ],
    ids="-".join,
)
def test_same_as_efficient_on_the_same_motions(kinds, N, rng):
    """More trials than a block and more pairs than a part holds, where N is large."""
    X, A, B = exact_motions(rng, N)
    noise = noise_of(rng, kinds, N)
    assert_as_efficient(
        X, *measured(rng, A, B, noise, 300 if N == 17 else 40), noise, 1e-7 if "exact" in kinds else 1e-9
    )


@pytest.mark.parametrize("sd", [1e-7, 0.02, 0.1, 0.3])
def test_same_at_small_and_large_noise(sd, rng):
    """Each branch of the series of sine and cosine, up to 0.3 rad and 0.3 m."""
    X, A, B = exact_motions(rng, 40)
    noise = noise_of(rng, ("common", "per pair"), 40, sd=sd, spread=1.5)
    # the rounding of the numbers themselves is 1e-16 of 1 m
    assert_as_efficient(X, *measured(rng, A, B, noise, 50), noise, 1e-9 + 1e-14 / sd)


def test_same_where_rotation_noise_times_lever_dominates(rng):
    """10 mrad and 0.1 mm, where the two steps differ most."""
    X, A, B = exact_motions(rng, 60)
    noise = uq.PairNoise.isotropic(A=("10mrad", "0.1mm"), B=("10mrad", "0.1mm"))
    assert_as_efficient(X, *measured(rng, A, B, noise, 50), noise)


def test_same_near_half_a_turn(rng):
    """Motions within 0.1 rad of 180 degrees, some beyond it once they are disturbed."""
    X, A, B = exact_motions(rng, 30, smallest=np.pi - 0.1, largest=np.pi)
    noise = noise_of(rng, ("common", "common"), 30)
    assert_as_efficient(X, *measured(rng, A, B, noise, 50), noise, 1e-8)


def test_far_from_the_truth_it_is_given(rng):
    """The X that errors are counted from does not enter the estimate."""
    X, A, B = exact_motions(rng, 12)
    noise = noise_of(rng, ("common", "per pair"), 12)
    motions = measured(rng, A, B, noise, 10)
    elsewhere = random_transforms(rng)
    here, there = (efficient_on_motions(*motions, at, noise) for at in (X, elsewhere))
    sd = np.sqrt(here[1].diagonal(axis1=1, axis2=2))
    assert np.abs((difference(moved(X, here[0]), moved(elsewhere, there[0]))) / sd).max() < 1e-9
    np.testing.assert_allclose(here[1], there[1], rtol=0, atol=1e-9 * sd.max() ** 2)


# ------------------------------------------------------------------------------------------------ statistics


@pytest.mark.parametrize("kinds", [("common", "common"), ("per pair", "per pair"), ("exact", "common")], ids="-".join)
def test_covariance_of_drawn_trials_is_true(kinds, rng):
    """NEES and coverage by each trial's own covariance; sampling covariance at the bound; 10 % more is rejected."""
    N, trials = 20, 6000
    X, A, B = exact_motions(rng, N)
    noise = noise_of(rng, kinds, N)
    errors, covariances, ok = efficient_on_drawn(A, B, X, noise, rng, trials)
    assert ok.all() and is_consistent(errors, covariances) and all(covers(errors, covariances))
    assert not is_consistent(errors, 1.1 * covariances) and not is_consistent(errors, covariances / 1.1)
    at_truth = bound(uq.Motions(A, B), noise, X)
    # relative deviation of the extreme eigenvalues of a Wishart matrix: 2 sqrt(6 / trials), and then some
    assert_same_covariance(errors.T @ errors / trials, at_truth, 4 * np.sqrt(6 / trials))


def test_the_draws_have_the_noise_asked_for(rng):
    """Errors of the disturbed motions themselves, from 20,000 draws of 3 pairs: mean and covariance of each side."""
    X, A, B = exact_motions(rng, 3)
    noise = noise_of(rng, ("per pair", "common"), 3, sd=0.1, spread=1.5)
    m = 20_000
    for T, turn, L, S in zip((A, B), (None, X[:3, :3]), noise.factors, (noise.A, noise.B), strict=True):
        q, t = efficient_pairs.Side.of(T, turn, L).drawn(slice(0, 3), m, rng, np.empty((7, 3, m)))
        frame = np.eye(3) if turn is None else turn
        found = np.stack([matrix(q[:, [k]]) for k in range(3)]).transpose(3, 0, 1, 2)
        theta = logarithms(frame.T @ found @ frame @ T[:, :3, :3].mT)
        tau = t.transpose(2, 1, 0) @ frame - T[:, :3, 3]
        for k in range(3):
            xi = np.concatenate([theta, tau], axis=-1)[:, k]
            reference = S if S.ndim == 2 else S[k]
            assert_same_covariance(xi.T @ xi / m, reference, 4 * np.sqrt(6 / m))


def test_equation_70(rng):
    """The noise of the paper, 60 pairs."""
    X, A, B = exact_motions(rng, 60)
    errors, covariances, ok = efficient_on_drawn(A, B, X, uq.PairNoise(*EQUATION_70), rng, 1500)
    assert ok.all() and is_consistent(errors, covariances)


# ---------------------------------------------------------------------------- reproducible, bounded, honest


@pytest.mark.parametrize("N", [2, 60, 700])
def test_the_same_generator_gives_the_same_bits(N, rng):
    X, A, B = exact_motions(rng, N)
    noise = noise_of(rng, ("common", "per pair"), N)
    one, other = (efficient_on_drawn(A, B, X, noise, np.random.default_rng(5), 400) for _ in range(2))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)
    # whole blocks do not depend on how many follow
    size = next(efficient_pairs._blocks(10_000, N))[0].stop
    if size <= 400:
        first, *_ = efficient_on_drawn(A, B, X, noise, np.random.default_rng(5), size)
        np.testing.assert_array_equal(first, one[0][:size])


def test_trials_of_nothing(rng):
    """Draws that do not determine X are not ok, among others that do; no NaN, no warning."""
    X, A, B = exact_motions(rng, 8)
    noise = noise_of(rng, ("common", "common"), 8)
    first, second = (np.array(T) for T in measured(rng, A, B, noise, 9))
    first[2], second[2] = np.eye(4), np.eye(4)  # no motion at all
    axis = rotations(np.linspace(0.3, 2.0, 8)[:, None] * [0.6, 0.0, 0.8])
    first[5] = transforms(axis, first[5, :, :3, 3])
    second[5] = np.linalg.inv(X) @ first[5] @ X  # one axis
    errors, covariances, ok = efficient_on_motions(first, second, X, noise)
    assert ok.tolist() == [k not in (2, 5) for k in range(9)]
    assert (errors[~ok] == 0).all() and (covariances[~ok] == np.eye(6)).all()
    assert np.isfinite(errors).all() and np.isfinite(covariances).all()
    alone = efficient_on_motions(first[ok], second[ok], X, noise)
    np.testing.assert_allclose(errors[ok], alone[0], rtol=1e-9, atol=1e-15)


def test_what_no_draw_can_mend_is_an_error(rng):
    """Motions about one axis without rotation noise; noise that leaves residuals exact; counts that do not fit."""
    X, A, B = exact_motions(rng, 6)
    one_axis = transforms(rotations(np.linspace(0.3, 2.0, 6)[:, None] * [0.6, 0.0, 0.8]), rng.normal(size=(6, 3)))
    shift = np.diag([1e-30] * 3 + [1e-6] * 3)
    with pytest.raises(uq.DegenerateMotionError, match="parallel"):
        efficient_on_drawn(one_axis, np.linalg.inv(X) @ one_axis @ X, X, uq.PairNoise(B=shift), rng, 20)
    with pytest.raises(uq.InputError, match="exact"):
        efficient_on_drawn(A, B, X, uq.PairNoise(A=np.diag([0.0] * 3 + [1e-6] * 3)), rng, 20)
    with pytest.raises(uq.InputError, match="cover 6 motions, got 5"):
        efficient_on_drawn(A, B, X, uq.PairNoise(A=random_covariance(rng, 6, (5,))), rng, 20)


def test_memory_is_bounded(rng):
    """Beside the answers, 43 numbers per trial: 10,000 trials of 60 pairs in 40 MB."""
    X, A, B = exact_motions(rng, 60)
    noise = noise_of(rng, ("common", "common"), 60)
    tracemalloc.start()
    efficient_on_drawn(A, B, X, noise, rng, 3000)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40e6


# --------------------------------------------------------------------------------------- rotations by rows


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-4, 0.0109, 0.011, 0.1, 0.28, 0.29, 1.0, 2.0, 3.1])
def test_quaternions_against_scipy(angle, rng):
    """Each side of each switch of the series, to rounding."""
    axes = rng.normal(size=(2, 3, 50))
    one, other = angle * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    p, q = quaternion(one), quaternion(other)
    np.testing.assert_allclose(matrix(p).transpose(2, 0, 1), rotations(one.T), atol=2e-15)
    both = rotations(one.T) @ rotations(other.T)
    np.testing.assert_allclose(matrix(composed(p, q)).transpose(2, 0, 1), both, atol=2e-15)
    np.testing.assert_allclose(matrix(turned(q, one[:, None])).transpose(2, 0, 1), both, atol=2e-15)
    for sign in (1.0, -1.0):
        back = np.empty((3, 1, 50))
        logarithm(sign * p, back)
        np.testing.assert_allclose(back[:, 0], one, atol=1e-14, rtol=1e-13)
