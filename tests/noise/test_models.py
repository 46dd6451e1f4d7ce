"""Noise models: what is a covariance and what is not, and factors of it."""

import numpy as np
import pytest
from hypothesis import strategies as st
from support import assert_same_covariance, holds_for, random_covariance

from uq_handeye.core.geometry.checks import checked_covariance
from uq_handeye.errors import InputError
from uq_handeye.model.errors.camera_noise import CameraNoise
from uq_handeye.model.errors.cholesky import factor
from uq_handeye.model.errors.joint_covariance import JointCovariance
from uq_handeye.model.errors.keys import FOCAL_LENGTH
from uq_handeye.model.errors.models import PairNoise, PoseNoise, is_joint, require_count

PER_ITEM = [(6, 6), (1, 6, 6), (7, 6, 6)]
JOINT = [(12, 12), (42, 42)]


def covariance(rng, shape):
    return random_covariance(rng, shape[-1], shape[:-2])


@pytest.mark.parametrize("shape", PER_ITEM + JOINT)
def test_accepts(rng, shape):
    S = covariance(rng, shape)
    checked = checked_covariance(S, "camera", joint=True)
    np.testing.assert_allclose(checked, S, rtol=1e-15)
    np.testing.assert_array_equal(checked, checked.mT)
    with pytest.raises(ValueError, match="read-only"):
        checked[0] = 0
    S[...] = 0  # a copy
    assert np.abs(checked).max() > 0


@pytest.mark.parametrize("shape", JOINT)
def test_pairs_have_no_joint_covariance(rng, shape):
    with pytest.raises(InputError, match=r"`A` to have shape \(6, 6\) or \(N, 6, 6\), got"):
        checked_covariance(covariance(rng, shape), "A", joint=False)


@pytest.mark.parametrize(
    "shape",
    [(), (6,), (3, 3), (5, 5), (7, 7), (6, 12), (12, 6), (2, 2, 6, 6), (2, 12, 12), (0, 0), (0, 6, 6)],
)
def test_refuses_shapes(shape):
    with pytest.raises(InputError, match=r"\(6, 6\), \(n, 6, 6\) or \(6n, 6n\), got"):
        checked_covariance(np.zeros(shape), "camera", joint=True)


@pytest.mark.parametrize("value", ["1mm", [[1, 2], [3]], object(), [["a"] * 6] * 6])
def test_refuses_what_is_no_array(value):
    with pytest.raises(InputError, match="`camera` to be an array of numbers"):
        checked_covariance(value, "camera", joint=True)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("shape", PER_ITEM + JOINT)
def test_refuses_what_is_not_finite(rng, shape, bad):
    S = covariance(rng, shape)
    S[..., -1, -2] = bad
    with pytest.raises(InputError, match="`camera` to be finite"):
        checked_covariance(S, "camera", joint=True)


@pytest.mark.parametrize("shape", PER_ITEM + JOINT)
def test_refuses_negative_variances(rng, shape):
    S = covariance(rng, shape)
    S[..., 0, 0] = -1e-20
    with pytest.raises(InputError, match="variances of `camera` to be >= 0, got -1e-20"):
        checked_covariance(S, "camera", joint=True)


@pytest.mark.parametrize("shape", PER_ITEM + JOINT)
@pytest.mark.parametrize(("asymmetry", "accepted"), [(1e-7, True), (1e-5, False), (0.1, False)])
def test_symmetry_is_relative(rng, shape, asymmetry, accepted):
    """Judged against the standard deviations: rad and mm side by side differ by many orders of magnitude."""
    units = np.resize([1e-8, 1e-8, 1e-8, 1e3, 1e3, 1e3], shape[-1])
    S = covariance(rng, shape)
    d = np.sqrt(np.diagonal(S, axis1=-2, axis2=-1))
    S[..., 0, 1] += asymmetry * d[..., 0] * d[..., 1]  # both are small
    S *= units[:, None] * units
    if accepted:
        checked = checked_covariance(S, "camera", joint=True)
        np.testing.assert_array_equal(checked, checked.mT)
    else:
        with pytest.raises(InputError, match="`camera` to be symmetric"):
            checked_covariance(S, "camera", joint=True)


@pytest.mark.parametrize("shape", PER_ITEM + JOINT)
@pytest.mark.parametrize(("smallest", "accepted"), [(0.0, True), (-1e-10, True), (-1e-6, False), (-0.5, False)])
def test_semidefiniteness_is_relative(rng, shape, smallest, accepted):
    """A correlation matrix with the given smallest eigenvalue, in mixed units."""
    size = shape[-1]
    v = np.zeros(size)
    v[[0, 1]] = np.sqrt(0.5), -np.sqrt(0.5)
    C = np.eye(size) - np.outer(v, v) + smallest * np.outer(v, v)
    d = np.sqrt(np.diag(C))
    C = C / d / d[:, None]
    units = np.resize([1e-8, 1e-8, 1e-8, 1e3, 1e3, 1e3], size)
    S = np.broadcast_to(C * units[:, None] * units, shape)
    if accepted:
        checked_covariance(S, "camera", joint=True)
    else:
        with pytest.raises(InputError, match="`camera` to be positive semidefinite"):
            checked_covariance(S, "camera", joint=True)


def test_one_bad_covariance_among_many(rng):
    S = covariance(rng, (7, 6, 6))
    S[4, 0, 1] = S[4, 1, 0] = 2 * np.sqrt(S[4, 0, 0] * S[4, 1, 1])
    with pytest.raises(InputError, match="positive semidefinite"):
        checked_covariance(S, "camera", joint=True)


def test_zero_variances(rng):
    """Exactly known coordinates are fine; what is exactly known correlates with nothing."""
    np.testing.assert_array_equal(checked_covariance(np.zeros((6, 6)), "A", joint=False), np.zeros((6, 6)))
    S = np.diag([0, 1e-6, 1e-6, 0, 1e-6, 1e-6])
    np.testing.assert_array_equal(checked_covariance(S, "A", joint=False), S)
    for entry in (1e-3, 1e-9, 1e-15):  # against a variance of 1e-6: none is rounding of a correlation
        S[0, 1] = S[1, 0] = entry
        with pytest.raises(InputError, match="`A`"):
            checked_covariance(S, "A", joint=False)


def test_singular_covariances_are_accepted(rng):
    L = rng.normal(size=(7, 6, 2)) * np.array([1e-3] * 3 + [1.0] * 3)[:, None]
    checked_covariance(L @ L.mT, "A", joint=False)
    J = np.tile(np.eye(6), (5, 1)) * 1e-3  # all poses share one error
    checked_covariance(J @ J.T, "camera", joint=True)


@pytest.mark.parametrize(("kind", "sides"), [(PairNoise, ("A", "B")), (PoseNoise, ("robot", "camera"))])
def test_noise_objects(rng, kind, sides):
    S = covariance(rng, (6, 6))
    for side, other in (sides, sides[::-1]):
        noise = kind(**{side: S})
        np.testing.assert_allclose(getattr(noise, side), S, rtol=1e-15)
        assert getattr(noise, other) is None
        bad = S.copy()
        bad[0, 1] += 1
        with pytest.raises(InputError, match=f"`{side}` to be symmetric"):
            kind(**{side: bad})
    with pytest.raises(InputError, match=f"at least one of `{sides[0]}` and `{sides[1]}`"):
        kind()


@pytest.mark.parametrize(("kind", "sides"), [(PairNoise, ("A", "B")), (PoseNoise, ("robot", "camera"))])
def test_isotropic(kind, sides):
    noise = kind.isotropic(("0.5deg", "2mm"), (1e-3, 0.25))
    np.testing.assert_allclose(np.sqrt(np.diag(getattr(noise, sides[0]))), [np.pi / 360] * 3 + [2e-3] * 3, rtol=1e-14)
    np.testing.assert_allclose(np.sqrt(np.diag(getattr(noise, sides[1]))), [1e-3] * 3 + [0.25] * 3, rtol=1e-14)
    assert np.count_nonzero(getattr(noise, sides[0])) == 6
    assert getattr(kind.isotropic(("1mrad", "0m")), sides[1]) is None
    with pytest.raises(InputError, match=f"standard deviations of {sides[1]} to be >= 0, got '-1mm'"):
        kind.isotropic(**{sides[1]: ("1mrad", "-1mm")})
    with pytest.raises(InputError, match="at least one"):
        kind.isotropic()


def test_joint_and_counts(rng):
    assert not is_joint(np.zeros((6, 6)))
    assert not is_joint(np.zeros((12, 6, 6)))
    assert is_joint(np.zeros((12, 12)))
    for fits in (None, np.zeros((6, 6)), np.zeros((4, 6, 6)), np.zeros((24, 24))):
        require_count(fits, 4, "camera", "poses")
    for S, found in ((np.zeros((3, 6, 6)), 3), (np.zeros((30, 30)), 5), (np.zeros((1, 6, 6)), 1)):
        with pytest.raises(InputError, match=f"`camera` to cover 4 poses, got {found}"):
            require_count(S, 4, "camera", "poses")


@pytest.mark.slow
@holds_for(seed=st.integers(0, 2**32 - 1), size=st.sampled_from([6, 12, 30]), rank=st.integers(0, 30))
def test_factor(seed, size, rank):
    """``L L^T`` is the covariance, of full rank or not, on its own and among others."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, size, min(rank, size))) * 10.0 ** rng.uniform(-3, 0, (size, 1))
    S = root @ root.mT
    S[0] = random_covariance(rng, size)  # a regular one among singular ones
    L = factor(S)
    for k in range(3):
        scale = np.sqrt(np.trace(S[k]) + 1e-300)
        np.testing.assert_allclose(L[k] @ L[k].T / scale**2, S[k] / scale**2, rtol=0, atol=1e-13)
        one = factor(S[k])
        np.testing.assert_allclose(one @ one.T / scale**2, S[k] / scale**2, rtol=0, atol=1e-13)
    assert_same_covariance(0.5 * (L[0] @ L[0].T + (L[0] @ L[0].T).T), S[0], 1e-6)


def test_noise_of_a_camera_of_unknown_pixels_is_a_table_and_no_robot():
    own, shared = np.tile(1e-6 * np.eye(6), (4, 1, 1)), np.full((4, 6, 1), 1e-3)
    noise = CameraNoise(JointCovariance(own, shared, (FOCAL_LENGTH,)), np.ones(1, dtype=bool))
    text = PoseNoise(camera=noise)._repr_html_()
    assert "per pixel of corner noise" in text and "the poses share 1 errors (focal length)" in text
    with pytest.raises(InputError, match="only `camera` may be a CameraNoise"):
        PoseNoise(robot=noise)
    known = PoseNoise(camera=CameraNoise(noise.joint, noise.scales, pixel_sd=0.5)).camera
    np.testing.assert_allclose(known, 0.25 * np.asarray(noise.joint))
