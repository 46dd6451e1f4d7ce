"""SO(3) and SE(3): each Jacobian against its definition, each check at the door against what it must refuse."""

import mpmath
import numpy as np
import pytest
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation
from support import (
    cross_matrix,
    difference,
    holds_for,
    jacobian,
    moved,
    random_transforms,
    rotation_vectors,
    rotations,
    transforms,
)

from uq_handeye.core.geometry import checks, se3
from uq_handeye.errors import InputError

EPS = np.finfo(float).eps
# Through every branch: a log grid, both sides of the switch at 0.5, near pi, pi, and past it.
ANGLES = np.unique(
    np.concatenate(
        [
            np.logspace(-12, 0, 37),
            np.nextafter(0.5, [0, 1]),
            [0.0, 0.5, 0.499, 0.501, np.pi, 4.0, 6.0],
            np.pi - np.logspace(-8, -1, 8),
        ]
    )
)
AXES = np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1], [0.6, -0.48, 0.64]])


def mp_exp_integral(theta, order):
    """sum_k [theta]x^k / (k + order)! in 60 digits: exp for order 0, the left Jacobian for order 1."""
    with mpmath.workdps(60):
        S = mpmath.matrix(cross_matrix([mpmath.mpf(float(x)) for x in theta]).tolist())
        term, total = mpmath.eye(3) / mpmath.factorial(order), mpmath.zeros(3)
        for k in range(1, 70):
            total += term
            term = term * S / (k + order)
        return np.array(total.tolist(), dtype=float)


def test_skew_and_vee(rng):
    v, y = rng.normal(size=(2, 5, 7, 3))
    np.testing.assert_allclose((se3.skew(v) @ y[..., None])[..., 0], np.cross(v, y), rtol=0, atol=8 * EPS)
    np.testing.assert_array_equal(se3.skew(v), -np.swapaxes(se3.skew(v), -1, -2))
    np.testing.assert_array_equal(se3.vee(se3.skew(v)), 2 * v)
    M = rng.normal(size=(5, 3, 3))
    for k in range(5):  # twice the axial vector: the skew part of M is [vee(M)/2]x
        np.testing.assert_allclose(cross_matrix(se3.vee(M)[k]), M[k] - M[k].T, rtol=0, atol=4 * EPS)
    assert se3.skew([1, 2, 3]).dtype == float


@pytest.mark.slow
@pytest.mark.parametrize("angle", ANGLES)
def test_left_jacobian_against_the_power_series(angle):
    for theta in angle * AXES:
        J = se3.left_jacobian(theta)
        np.testing.assert_allclose(J, mp_exp_integral(theta, 1), rtol=0, atol=4 * EPS)
        # the part beyond I, relative to its own size: a wrong 1/2 or 1/6 must show at 1e-12 too
        S = cross_matrix(theta)
        if 0 < angle < 1e-3:
            np.testing.assert_allclose(J - np.eye(3) - S / 2, 0, atol=angle**2 / 6 + 4 * EPS * angle + EPS)


@pytest.mark.parametrize("angle", ANGLES[ANGLES > 0])
def test_left_jacobian_against_scipy(angle):
    """``exp(theta + d) = exp(J(theta) d) exp(theta)``."""
    theta = angle * AXES[3]

    def turned(d):
        return (Rotation.from_rotvec(theta + d) * Rotation.from_rotvec(theta).inv()).as_rotvec()

    np.testing.assert_allclose(se3.left_jacobian(theta), jacobian(turned, 3), rtol=0, atol=1e-11)


@pytest.mark.slow
@holds_for(seed=st.integers(0, 2**32 - 1), exponent=st.floats(-12, 0.8))
def test_left_jacobian_properties(seed, exponent):
    """``J(-theta) = J(theta)^T``, ``J theta = theta``, ``exp(theta) = I + [theta]x J = J(theta) J(-theta)^-1``."""
    theta = 10**exponent * rotation_vectors(np.random.default_rng(seed), (3,), 1, 1)
    J = se3.left_jacobian(theta)
    size = 8 * EPS * (1 + 10**exponent) ** 2
    np.testing.assert_allclose(se3.left_jacobian(-theta), np.swapaxes(J, -1, -2), rtol=0, atol=size)
    np.testing.assert_allclose((J @ theta[..., None])[..., 0], theta, rtol=0, atol=size * 10**exponent)
    np.testing.assert_allclose(np.eye(3) + se3.skew(theta) @ J, rotations(theta), rtol=0, atol=4 * size)


def test_inverse(rng):
    T = random_transforms(rng, (3, 5), length=10)
    np.testing.assert_allclose(se3.inverse(T), np.linalg.inv(T), rtol=0, atol=1e-13)
    np.testing.assert_allclose(T @ se3.inverse(T), np.broadcast_to(np.eye(4), T.shape), rtol=0, atol=1e-13)
    np.testing.assert_array_equal(se3.inverse(T)[..., 3, :], np.broadcast_to([0, 0, 0, 1], (3, 5, 4)))


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 1e-3, 0.5, 1.0, 3.0, np.pi - 1e-8, np.pi])
@pytest.mark.parametrize("t", [[0, 0, 0], [1, 2, -3], [1e3, 0, 5e2]])
def test_inverse_jacobian(angle, t):
    T = transforms(rotations(angle * AXES[3]), np.array(t, dtype=float))
    numeric = jacobian(lambda xi: difference(se3.inverse(moved(T, xi)), se3.inverse(T)), 6)
    scale = 1 + np.linalg.norm(t)
    np.testing.assert_allclose(se3.inverse_jacobian(T), numeric, rtol=0, atol=1e-11 * scale)


def test_inverse_jacobian_of_the_inverse_is_its_inverse(rng):
    T = random_transforms(rng, (4, 3))
    product = se3.inverse_jacobian(se3.inverse(T)) @ se3.inverse_jacobian(T)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(6), product.shape), rtol=0, atol=1e-13)


def test_perturb_is_the_convention(rng):
    T, xi = random_transforms(rng, (3, 5)), rng.normal(size=(3, 5, 6))
    np.testing.assert_allclose(se3.perturb(T, xi), moved(T, xi), rtol=0, atol=1e-14)
    spread = se3.perturb(T[0], xi)  # broadcast over trials, and the argument stays as it was
    np.testing.assert_allclose(spread, moved(np.broadcast_to(T[0], T.shape), xi), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(se3.perturb(T, np.zeros(6)), T)


def test_block(rng):
    a, b, c, d = rng.normal(size=(4, 5, 3, 3))
    np.testing.assert_array_equal(se3.block(a, b, c, d), np.block([[a, b], [c, d]]))
    np.testing.assert_array_equal(
        se3.block(a, 0.0, np.eye(3), d)[2], np.block([[a[2], np.zeros((3, 3))], [np.eye(3), d[2]]])
    )


def test_entry_rows(rng):
    one, other = rng.normal(size=(3, 4, 4)), rng.normal(size=(2, 4, 4))
    rows = checks.entry_rows(one, other)
    np.testing.assert_array_equal(np.moveaxis(rows, 2, 0), np.concatenate([one, other]))


# ------------------------------------------------------------------------------------------ as_transforms


def test_accepts_arrays_lists_and_rigid_transforms(rng):
    T = random_transforms(rng, (2, 3))
    for value in (T, T.tolist(), RigidTransform.from_matrix(T)):
        accepted = checks.as_transforms(value, "A")
        assert accepted.dtype == np.float64
        np.testing.assert_allclose(accepted, T, rtol=0, atol=1e-14)
    assert checks.as_transforms(T.astype(np.float32), "A").dtype == np.float64
    assert checks.as_transforms(np.eye(4, dtype=int), "X", stack=False).dtype == np.float64
    np.testing.assert_array_equal(checks.as_transforms(T[0, 0], "X", stack=False), T[0, 0])
    np.testing.assert_array_equal(checks.as_transforms(T, "X", stack=False), T)
    assert checks.as_transforms(np.empty((0, 4, 4)), "A").shape == (0, 4, 4)


def test_accepts_four_decimals_as_they_are(rng):
    """Accepted matrices, as printed by robot controllers, are used without repair."""
    printed = random_transforms(rng, (500,), 0, np.pi).round(4)
    worst = np.abs(np.swapaxes(printed[:, :3, :3], 1, 2) @ printed[:, :3, :3] - np.eye(3)).max()
    assert worst > 5e-5  # far beyond rounding
    before = printed.copy()
    np.testing.assert_array_equal(checks.as_transforms(printed, "A"), before)


def test_refuses_three_decimals(rng):
    with pytest.raises(InputError, match=r"`A`\[\d+\] to hold a rotation, got a matrix that is not orthogonal"):
        checks.as_transforms(random_transforms(rng, (500,), 0, np.pi).round(3), "A")


def test_long_translations():
    """Up to 1e75, whose squares and their sums stay finite; no warnings on the way."""
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, 0, 3] = [1e74, -1e74, 0.5e75]
    np.testing.assert_array_equal(checks.as_transforms(T, "A"), T)
    for length in (1e77, 1e160, 1.7e308):
        T[1, 0, 3] = length
        with pytest.raises(InputError, match=r"translation of `A`\[1\]"):
            checks.as_transforms(T, "A")


def spoiled(kind):
    T = transforms(rotations(np.array([0.3, -0.5, 0.9])), np.array([1.0, 2.0, 3.0]))
    R = T[:3, :3]
    match kind:
        case "NaN":
            T[1, 2] = np.nan
        case "NaN in the translation":
            T[0, 3] = np.nan
        case "infinite translation":
            T[2, 3] = np.inf
        case "minus infinite translation":
            T[2, 3] = -np.inf
        case "infinite rotation":
            T[0, 0] = np.inf
        case "NaN in the last row":
            T[3, 3] = np.nan
        case "left-handed":
            T[:3, 0] *= -1
        case "slightly scaled":
            R *= 1.001
        case "scaled":
            R *= 2
        case "millimetres":
            T *= 1000
        case "sheared":
            T[:3, 0] += 0.01 * T[:3, 1]
        case "stretched at constant volume":
            R[:] = R @ np.diag([1.01, 1 / 1.01, 1])
        case "zero rotation":
            R[:] = 0
        case "rank 1":
            R[:] = np.ones((3, 3)) / np.sqrt(3)
        case "transposed":
            T = T.T.copy()
        case "last row [0, 0, 0, 0]":
            T[3, 3] = 0
        case "last row [0, 0, 0.001, 1]":
            T[3, 2] = 1e-3
        case "last row [0, 0, 0, -1]":
            T[3, 3] = -1
    return T


FINITE = "to be finite, got NaN or infinity"
ORTHOGONAL = "to hold a rotation, got a matrix that is not orthogonal"
LAST_ROW = "last row of .* to be \\[0, 0, 0, 1\\]"
SPOILED = {
    "NaN": FINITE,
    "NaN in the translation": FINITE,
    "infinite translation": FINITE,
    "minus infinite translation": FINITE,
    "infinite rotation": FINITE,
    "NaN in the last row": FINITE,
    "left-handed": "left-handed matrix \\(determinant -1.000\\)",
    "slightly scaled": ORTHOGONAL,
    "scaled": ORTHOGONAL,
    "millimetres": LAST_ROW,
    "sheared": ORTHOGONAL,
    "stretched at constant volume": ORTHOGONAL,
    "zero rotation": ORTHOGONAL,
    "rank 1": ORTHOGONAL,
    "transposed": LAST_ROW,
    "last row [0, 0, 0, 0]": LAST_ROW,
    "last row [0, 0, 0.001, 1]": LAST_ROW,
    "last row [0, 0, 0, -1]": LAST_ROW,
}


@pytest.mark.parametrize(("kind", "message"), SPOILED.items())
def test_refuses_and_says_which(rng, kind, message):
    good = random_transforms(rng, (2, 3))
    bad = good.copy()
    bad[1, 2] = spoiled(kind)
    with np.errstate(invalid="ignore"), pytest.raises(InputError, match=message) as caught:
        checks.as_transforms(bad, "robot")
    assert "`robot`[1, 2]" in str(caught.value)
    with np.errstate(invalid="ignore"), pytest.raises(InputError, match=message) as caught:
        checks.as_transforms(spoiled(kind), "X", stack=False)
    assert "`X`" in str(caught.value)
    assert "`X`[" not in str(caught.value)


@pytest.mark.parametrize("kind", SPOILED)
def test_refusals_raise_no_warning(kind):
    """Checked input must lead to one error, not to NumPy warnings on the way."""
    with pytest.raises(InputError):
        checks.as_transforms(spoiled(kind)[None], "A")


@pytest.mark.parametrize("size", [1e80, 1e155, 1e308])
@pytest.mark.parametrize("entry", [(0, 0), (3, 3), (0, 3)])
@pytest.mark.parametrize("stack", [False, True])
def test_huge_numbers_are_refused_like_others(stack, entry, size):
    T = np.eye(4)
    T[entry] = size
    with pytest.raises(InputError, match="`A`"):
        checks.as_transforms(T[None] if stack else T, "A", stack=stack)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.eye(4), r"`A` to have shape \(\.\.\., N, 4, 4\), got \(4, 4\)"),
        (np.ones((5, 3, 4)), r"got \(5, 3, 4\)"),
        (np.ones((5, 4, 3)), r"got \(5, 4, 3\)"),
        (np.ones(16), r"got \(16,\)"),
        (3.0, r"got \(\)"),
        ([], r"got \(0,\)"),
        ([np.eye(4), np.eye(3)], "`A` to be an array of numbers.*, got list"),
        ([[1, 2], [3]], "`A` to be an array of numbers.*, got list"),
        ("poses.csv", "`A` to be an array of numbers.*, got str"),
        ([["a"] * 4] * 4, "`A` to be an array of numbers.*, got list"),
        (None, r"`A`"),
        (object(), "`A` to be an array of numbers.*, got object"),
    ],
)
def test_refuses_wrong_shapes_and_types(value, message):
    with pytest.raises(InputError, match=message):
        checks.as_transforms(value, "A")


@pytest.mark.slow
@pytest.mark.parametrize("extra", [-1, 0, 1])
@pytest.mark.parametrize("kind", ["NaN in the translation", "sheared", "last row [0, 0, 0.001, 1]"])
def test_chunk_boundaries(extra, kind):
    """The bad matrix in the last place, the only one of its chunk for extra = 1; and in the first place."""
    n = checks.CHUNK + extra
    T = np.tile(np.eye(4), (n, 1, 1))
    np.testing.assert_array_equal(checks.as_transforms(T, "A"), T)
    for bad in (0, n - 1):
        T[bad] = spoiled(kind)
        with pytest.raises(InputError, match=rf"`A`\[{bad}\]"):
            checks.as_transforms(T, "A")
        T[bad] = np.eye(4)
    batch = np.tile(np.eye(4), (3, n, 1, 1))
    batch[2, n - 1] = spoiled(kind)
    with pytest.raises(InputError, match=rf"`A`\[2, {n - 1}\]"):
        checks.as_transforms(batch, "A")


def test_errors_cannot_hide_in_a_crowd(rng):
    """The quick look sums over a chunk: deviations of opposite sign must not cancel."""
    T = random_transforms(rng, (checks.CHUNK,))
    T[5, :3, :3] *= 1.001
    T[7, :3, :3] /= 1.001
    with pytest.raises(InputError, match=r"`A`\[5\]"):
        checks.as_transforms(T, "A")


# --------------------------------------------------------------------------------------- surely_transforms


def stretched(seed, exponent, constant_volume):
    """Q (I + E) with E symmetric of size 10^exponent; at constant volume the determinant stays exactly 1."""
    rng = np.random.default_rng(seed)
    E = rng.normal(size=(3, 3))
    E = E + E.T
    stretch = np.eye(3) + 10**exponent * E / np.linalg.norm(E)
    if constant_volume:
        stretch /= np.cbrt(np.linalg.det(stretch))
    return random_transforms(rng)[:3, :3] @ stretch


@pytest.mark.slow
@holds_for(
    examples=400,
    seed=st.integers(0, 2**32 - 1),
    exponent=st.floats(-7, 0.5),
    constant_volume=st.booleans(),
)
def test_what_surely_passes_is_a_rotation(seed, exponent, constant_volume):
    """Sufficient: |R|^2 = 3 and det R = 1 to 1e-9 leave no stretch above the tolerance, at any volume."""
    R = stretched(seed, exponent, constant_volume)
    passed = checks.surely_transforms(checks.entry_rows(transforms(R, np.ones(3))[None]))
    deviation = np.abs(R.T @ R - np.eye(3)).max()
    assert not passed or deviation < checks.ORTHOGONALITY_TOLERANCE
    # and what the docstring says about its reach: |E|^2 is of the order of 1e-9 at most
    assert not passed or deviation < 1e-4


def test_surely_is_neither_empty_nor_blind():
    def judged(exponent, constant_volume):
        return [
            checks.surely_transforms(checks.entry_rows(transforms(stretched(k, exponent, constant_volume), 0)[None]))
            for k in range(50)
        ]

    assert all(judged(-10, False))
    assert all(judged(-5.5, True))  # second order in E
    assert not any(judged(-4, True))
    assert not any(judged(0, True))
    assert not any(judged(-2, False))


def test_surely_refuses_what_is_no_rotation():
    for kind in SPOILED:
        if "translation" not in kind:
            with np.errstate(invalid="ignore"):
                assert not checks.surely_transforms(checks.entry_rows(spoiled(kind)[None])), kind
