"""The NumPy functions of the registry against independent NumPy: products, differences, batches, precision."""

import inspect

import numpy as np
import pytest

from uq_handeye.symbolic import functions as cf
from uq_handeye.symbolic.matrices import FORMS

D = 50.0  # small enough that the terms in 1/d count in the comparisons
EPS = np.finfo(np.float64).eps
PAIRS = [(j, k) for j in range(1, 5) for k in range(1, 5)]


@pytest.fixture
def rng():
    return np.random.default_rng(20190508)


def quaternion_product(x, y):
    """Hamilton product, scalar first, by its scalar and vector parts."""
    scalar = x[..., :1] * y[..., :1] - np.sum(x[..., 1:] * y[..., 1:], axis=-1, keepdims=True)
    vector = x[..., :1] * y[..., 1:] + y[..., :1] * x[..., 1:] + np.cross(x[..., 1:], y[..., 1:])
    return np.concatenate([scalar, vector], axis=-1)


def unit(x):
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def exp_so3(theta):
    """Rotation matrices of rotation vectors, through unit quaternions."""
    angle = np.linalg.norm(theta, axis=-1, keepdims=True)
    axis = theta / np.where(angle == 0, 1, angle)
    q = np.concatenate([np.cos(angle / 2), np.sin(angle / 2) * axis], axis=-1)
    images = [quaternion_product(quaternion_product(q, e), q * [1, -1, -1, -1]) for e in np.eye(4)[1:]]
    return np.stack([image[..., 1:] for image in images], axis=-1)


def poses(rng, *batch):
    T = np.zeros((*batch, 4, 4))
    T[..., :3, :3] = exp_so3(rng.uniform(-1.5, 1.5, (*batch, 3)))
    T[..., :3, 3] = rng.normal(size=(*batch, 3))
    T[..., 3, 3] = 1
    return T


def vec(X):
    return X.swapaxes(-1, -2).reshape(*X.shape[:-2], -1)


def unvec(x):
    return x.reshape(*x.shape[:-1], 4, 4).swapaxes(-1, -2)


def assert_close(found, wanted, rtol=64 * EPS):
    """Relative to the largest entry of the wanted array."""
    assert found.shape == wanted.shape
    np.testing.assert_allclose(found, wanted, rtol=0, atol=rtol * np.abs(wanted).max())


def arguments(rng, form, batch=(), dtype=np.float64):
    values = []
    for argument in form.arguments:
        if argument.name == "T":
            values.append(poses(rng, *batch).astype(dtype))
        elif argument.name == "d":
            values.append(np.full(batch, D, dtype))
        else:
            values.append(rng.normal(size=(*batch, *argument.shape)).astype(dtype))
    return values


# Every function ---------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_every_form_is_a_function():
    assert sorted(FORMS) == dir(cf)
    for name, form in FORMS.items():
        assert list(inspect.signature(getattr(cf, name)).parameters) == [a.name for a in form.arguments]
        assert form.equation in getattr(cf, name).__doc__


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(FORMS))
def test_batches_and_precision(rng, name):
    form, function = FORMS[name], getattr(cf, name)
    values = arguments(rng, form, (2, 3))
    batch = function(*values)
    assert batch.shape == (2, 3, *form.shape)
    assert batch.dtype == np.float64
    for at in np.ndindex(2, 3):  # one at a time gives the same
        np.testing.assert_array_equal(function(*(value[at] for value in values)), batch[at])
    mixed = function(values[0], *(value[0, 0] for value in values[1:]))  # batch axes broadcast
    assert mixed.shape == batch.shape
    np.testing.assert_array_equal(mixed[0, 0], batch[0, 0])

    assert function(*(value[:0] for value in values)).shape == (0, 3, *form.shape)
    single = function(*(value.astype(np.float32) for value in values))
    assert single.dtype == np.float32
    assert_close(single.astype(np.float64), batch, 64 * np.finfo(np.float32).eps)
    assert function(*(np.zeros(a.shape, int) if a.name != "d" else 1 for a in form.arguments)).dtype == float


def test_a_python_number_has_no_precision(rng):
    T = poses(rng, 3).astype(np.float32)
    assert cf.F2(T, 1e4).dtype == np.float32
    assert cf.F2(T, 10000).dtype == np.float32
    assert cf.F2(T, np.float64(1e4)).dtype == np.float64
    assert cf.F2(T, np.array([1e3, 1e4, 1e5])).shape == (3, 4, 4)


def test_wrong_arguments_are_named():
    with pytest.raises(ValueError, match=r"Expected `Z` to have shape \(\.\.\., 4, 4\), got \(4, 3\)"):
        cf.F11(np.eye(4), np.ones((4, 3)))
    with pytest.raises(ValueError, match=r"Expected batch axes that broadcast, got `E` \(2,\), `Z` \(3,\)"):
        cf.F11(np.ones((2, 4, 4)), np.ones((3, 4, 4)))
    with pytest.raises(TypeError, match="Expected `q` to hold real numbers, got complex128"):
        cf.R_L(np.ones(4) * 1j)


# Problem by problem -----------------------------------------------------------------------------------------


def test_quaternion_matrices(rng):
    q, x = rng.normal(size=(2, 7, 4))
    assert_close((cf.R_L(q) @ x[..., None])[..., 0], quaternion_product(q, x))
    assert_close((cf.R_R(q) @ x[..., None])[..., 0], quaternion_product(x, q))


def test_octonion(rng):
    q_L, q_R = unit(rng.normal(size=(2, 7, 4)))
    sigma = np.concatenate([q_L, q_R], axis=-1) / np.sqrt(2)
    R = cf.sigma_to_R(sigma)
    assert_close(R, cf.R_L(q_L) @ cf.R_R(q_R))
    for i in range(4):
        P, Q = getattr(cf, f"P_{i + 1}")(sigma), getattr(cf, f"Q_{i + 1}")(sigma)
        assert_close((P @ sigma[..., None])[..., 0], R[..., :, i])  # (20)
        assert_close((Q @ sigma[..., None])[..., 0], R[..., i, :])  # (28)


@pytest.mark.parametrize("mirror", [False, True])
def test_problem_1_and_its_SVD(rng, mirror):
    """The largest eigenvector of W gives V diag(1, 1, 1, det UV) U^T, with U S V^T = H and H as in (15).

    The paper's (14), U diag(..) V^T, is the transpose: it belongs to H^T = sum (v - mean v)(u - mean u)^T.
    """
    points = rng.normal(size=(50, 4)) * [1, 2, 3, 4]
    truth = cf.R_L(unit(rng.normal(size=4))) @ cf.R_R(unit(rng.normal(size=4)))
    if mirror:
        truth = truth @ np.diag([1, 1, 1, -1.0])  # no rotation fits: the branch det(UV) = -1
    images = points @ truth.T + rng.normal(size=4) + 0.1 * rng.normal(size=points.shape)
    u, v = points - points.mean(axis=0), images - images.mean(axis=0)
    H = u.T @ v  # (15)
    R = cf.sigma_to_R(np.linalg.eigh(cf.W(H))[1][:, -1])
    U, _, Vt = np.linalg.svd(H)
    D4 = np.diag([1, 1, 1, np.linalg.det(U @ Vt.T)])
    assert_close(R, Vt.T @ D4 @ U.T, 1e-12)
    cost = np.sum((u @ R.T - v) ** 2)
    printed = U @ D4 @ Vt  # (14) as printed
    assert np.sum((u @ printed.T - v) ** 2) > 2 * cost
    for other in cf.R_L(unit(np.eye(4)[0] + 0.05 * rng.normal(size=(50, 4)))):  # nothing near is better
        assert np.sum((u @ (other @ R).T - v) ** 2) > cost


def test_J_and_their_sums(rng):
    E, Z = rng.normal(size=(2, 7, 4, 4))
    q_L, q_R = rng.normal(size=(2, 7, 4))
    R = cf.R_L(q_L) @ cf.R_R(q_R)
    residual = E @ R - R @ Z
    F11, F22 = np.zeros((2, 7, 4, 4))
    for j, k in PAIRS:
        J = getattr(cf, f"J_{j}{k}")(E, Z)
        np.testing.assert_allclose(
            np.einsum("ni,nij,nj->n", q_L, J, q_R), residual[:, k - 1, j - 1], rtol=0, atol=1e-13
        )
        F11 += J @ J.swapaxes(-1, -2)
        F22 += J.swapaxes(-1, -2) @ J
    assert_close(cf.F11(E, Z), F11)  # (35)
    assert_close(cf.F22(E, Z), F22)


@pytest.mark.parametrize("name", ["F11", "F22"])
def test_derivatives_by_the_data(rng, name):
    """Central differences are exact up to rounding: F is quadratic in b."""
    E, Z = rng.normal(size=(2, 7, 4, 4))
    q = rng.normal(size=4)
    b = np.concatenate([vec(E), vec(Z)], axis=-1)[:, None, :]

    def F(b):
        return vec(getattr(cf, name)(unvec(b[..., :16]), unvec(b[..., 16:])))

    step = np.eye(32)
    differences = ((F(b + step) - F(b - step)) / 2).swapaxes(-1, -2)
    D_F = getattr(cf, f"d{name}_db")(E, Z)
    assert_close(D_F, differences)
    assert_close(getattr(cf, f"d{name}q_db")(E, Z, q), np.kron(q, np.eye(4)) @ D_F)


@pytest.mark.parametrize("name", ["F1", "F2", "u", "w"])
def test_derivatives_by_the_pose(rng, name):
    """Against central differences on exp([theta]x) R, t + tau; error of order step^2."""
    T = poses(rng, 7)
    extra = (D,) if name.startswith("F") else ()
    step = 1e-5
    columns = []
    for axis in range(6):
        sides = []
        for signed in (step, -step):
            xi = signed * np.eye(6)[axis]
            moved = T.copy()
            moved[:, :3, :3] = exp_so3(xi[:3]) @ T[:, :3, :3]
            moved[:, :3, 3] += xi[3:]
            value = getattr(cf, name)(moved, *extra)
            sides.append(vec(value) if name.startswith("F") else value)
        columns.append((sides[0] - sides[1]) / (2 * step))
    assert_close(getattr(cf, f"d{name}_dxi")(T, *extra), np.stack(columns, axis=-1), 1e-9)


def test_maps_and_their_limit(rng):
    T = poses(rng, 7)
    R, t = T[:, :3, :3], T[:, :3, 3]
    Rt_t = np.einsum("nji,nj->ni", R, t)
    for function, sign in ((cf.F1, 1), (cf.F2, -1)):
        image = function(T, D)
        assert_close(image[:, :3, :3], R)
        assert_close(image[:, :3, 3], t / D)
        assert_close(image[:, 3, :3], sign * Rt_t / D)
        np.testing.assert_array_equal(image[:, 3, 3], 1)
    skew = R - R.swapaxes(-1, -2)
    assert_close(cf.u(T), np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1) / 2)
    assert_close(cf.w(T), (t + Rt_t) / 2)
    E = cf.F2(T, D)
    e = np.eye(4)
    assert_close(cf.a_left(E), np.einsum("kij,nij->nk", cf.R_L(e), E) / 4)
    assert_close(cf.c_right(E), np.einsum("kij,nij->nk", cf.R_R(e), E) / 4)
    # |vector part| of a and c: |u - w/d| / 2 and |u + w/d| / 2
    for read, sign in ((cf.a_left, -1), (cf.c_right, 1)):
        wanted = np.linalg.norm(cf.u(T) + sign * cf.w(T) / D, axis=-1) / 2
        assert_close(np.linalg.norm(read(E)[:, 1:], axis=-1), wanted)


def test_problem_2_tends_to_the_limit(rng):
    """T2 on noisy data: the solution at finite d approaches the closed form like 1/d^2."""
    X = poses(rng)
    B = poses(rng, 12)
    A = X @ B @ np.linalg.inv(X)
    A[:, :3, :3] = exp_so3(0.02 * rng.normal(size=(12, 3))) @ A[:, :3, :3]
    A[:, :3, 3] += 0.02 * rng.normal(size=(12, 3))

    u, w, v, z = cf.u(A), cf.w(A), cf.u(B), cf.w(B)
    U, _, Vt = np.linalg.svd(u.T @ v)
    R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    y = v @ R.T
    G = u.T @ y
    M = np.trace(G) * np.eye(3) - (G + G.T) / 2
    t = -np.linalg.solve(M, np.sum(np.cross(w, y) + np.cross(u, z @ R.T), axis=0))

    errors = []
    for d in (1e2, 1e3):
        E, Z = cf.F2(A, d), cf.F2(B, d)
        q_L = np.linalg.eigh(cf.F11(E, Z).sum(axis=0))[1][:, 0]
        q_R = np.linalg.eigh(cf.F22(E, Z).sum(axis=0))[1][:, 0]
        X4 = cf.R_L(q_L) @ cf.R_R(q_R)
        X4 *= np.sign(X4[3, 3])
        errors.append(max(np.abs(X4[:3, :3] - R).max(), np.abs(d * X4[:3, 3] - t).max()))
    assert errors[1] < 1e-5
    assert 90 < errors[0] / errors[1] < 110  # 1/d^2
