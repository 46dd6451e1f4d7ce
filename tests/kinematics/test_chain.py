"""Poses, derivatives and covariances of chains, against a slow product of factors and against differences."""

import json

import numpy as np
import pytest
from fixtures.arms import SIX_AXES, motion, pose_and_twists, random_chain, to_axis, twist_between
from hypothesis import given, settings
from hypothesis import strategies as st

import uq_handeye as uq
from uq_handeye.errors import InputError
from uq_handeye.model.kinematics.chain import Joint, Kinematics

STEP = 1e-5


def postures(rng, chain, *shape):
    limits = np.clip(chain.limits, -3.0, 3.0)
    return rng.uniform(limits[:, 0], limits[:, 1], size=(*shape, chain.n_joints))


def algebraic_columns(chain, q):
    """F at e = 0 of one posture, from the product rule."""
    _, found = pose_and_twists(chain, q)
    g = chain.gravity(q)
    columns = []
    for error in chain.errors:
        k = chain.names.index(error.joint)
        value = q[k]
        joint = found["joint", error.joint, 0]
        if error.group == "joint offsets":
            columns.append(found["turn", error.joint, 2])
        elif error.group in ("joint tilts", "link lengths"):
            part = "turn" if error.group == "joint tilts" else "shift"
            columns.append(found[part, error.joint, "xyz".index(error.name[-1])])
        elif error.group == "transmission":
            wave = error.name.removeprefix(f"transmission: {error.joint} ")
            functions = {"sin q": np.sin, "cos q": np.cos, "sin 2q": lambda v: np.sin(2 * v)}
            columns.append(joint * functions.get(wave, lambda v: np.cos(2 * v))(value))
        else:
            columns.append(joint * g[k])
    return np.array(columns).T


def differences(function, x, step=STEP):
    """Central differences, corrected once, of poses by the last axis of x: (6, len(x))."""
    found = []
    for k in range(len(x)):
        d = np.zeros(len(x))
        d[k] = step
        near = twist_between(function(x - d), function(x + d)) / (2 * step)
        wide = twist_between(function(x - 2 * d), function(x + 2 * d)) / (4 * step)
        found.append((4 * near - wide) / 3)
    return np.array(found).T


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.text("RP", min_size=1, max_size=7), st.integers(0, 2**31))
def test_random_chains_agree_with_the_product_of_their_factors(kinds, seed):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, kinds)
    q = postures(rng, chain)
    T, found = pose_and_twists(chain, q)
    np.testing.assert_allclose(chain.poses(q), T, atol=1e-13)
    joints = np.array([found["joint", name, 0] for name in chain.names]).T
    np.testing.assert_allclose(chain.jacobian(q), joints, atol=1e-12)
    np.testing.assert_allclose(chain.columns(q), algebraic_columns(chain, q), atol=1e-12)


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(st.text("RP", min_size=1, max_size=5), st.integers(0, 2**31), st.sampled_from([0.0, 1e-3, 0.3]))
def test_derivatives_are_those_of_the_exact_poses(kinds, seed, size):
    rng = np.random.default_rng(seed)
    chain = random_chain(rng, kinds)
    q, e = postures(rng, chain), size * rng.normal(size=len(chain.errors))
    F = differences(lambda x: chain.poses(q, x), e)
    np.testing.assert_allclose(chain.columns(q, e), F, atol=3e-9, rtol=1e-8)
    J = differences(lambda x: chain.poses(x, e), q)
    np.testing.assert_allclose(chain.jacobian(q, e), J, atol=3e-9, rtol=1e-8)


@pytest.mark.parametrize("size", [1e-1, 1e-2, 1e-3, 1e-4])
def test_columns_are_right_to_second_order(rng, size):
    chain = random_chain(rng, "RRRPRR")
    q, e = postures(rng, chain, 20), size * rng.normal(size=len(chain.errors))
    error = twist_between(chain.poses(q), chain.poses(q, e)) - chain.columns(q) @ e
    assert np.abs(error).max() < 100 * size**2


def test_errors_stand_where_the_model_puts_them(rng):
    """O_1 E_1 M_1(q') O_2 E_2 M_2(q') O_tip by hand, z of E_k along the axis."""
    chain = random_chain(rng, "RP")
    q = postures(rng, chain)
    e = dict(zip([error.name for error in chain.errors], 0.2 * rng.normal(size=len(chain.errors)), strict=True))
    g = chain.gravity(q)
    T = np.eye(4)
    for k, joint in enumerate(chain.joints):
        tilt = [e[f"joint tilts: {joint.name} {axis}"] for axis in "xy"]
        shift = [e[f"link lengths: {joint.name} {axis}"] for axis in "xyz"]
        moved = q[k] + g[k] * e[f"sag: {joint.name}"]
        if k == 0:
            waves = {
                "sin q": np.sin(q[0]),
                "cos q": np.cos(q[0]),
                "sin 2q": np.sin(2 * q[0]),
                "cos 2q": np.cos(2 * q[0]),
            }
            moved += sum(value * e[f"transmission: j0 {name}"] for name, value in waves.items())
        E = motion((*tilt, e["joint offsets: j0" if k == 0 else "joint tilts: j1 z"]), shift)
        A = to_axis(joint)
        M = motion(joint.axis * moved) if k == 0 else motion(shift=joint.axis * moved)
        T = T @ joint.origin @ A @ E @ A.T @ M
    np.testing.assert_allclose(chain.poses(q, np.array(list(e.values()))), T @ chain.end, atol=1e-13)


def test_frames_have_the_axes_as_z(rng):
    chain = Kinematics.from_urdf(SIX_AXES, tip="tool0")
    geometric = [error.group not in ("transmission", "sag") for error in chain.errors]
    q, e = postures(rng, chain, 4), 0.1 * rng.normal(size=len(chain.errors)) * geometric
    for errors in (None, e):
        P, T = chain.frames(q, errors), chain.poses(q, errors)
        z, lever = P[..., :3, 2], T[:, None, :3, 3] - P[..., :3, 3]
        twists = np.concatenate([z, np.cross(z, lever)], axis=-1)
        np.testing.assert_allclose(np.swapaxes(chain.jacobian(q, errors), -1, -2), twists, atol=1e-13)
    np.testing.assert_allclose(chain.frames(q)[:, 0, :3, 3], np.tile([0, 0, 0.29], (4, 1)), atol=1e-15)


def test_leading_axes_and_blocks(rng, monkeypatch):
    chain = random_chain(rng, "RRP")
    q, e = postures(rng, chain, 2, 5), 0.01 * rng.normal(size=(3, 1, 1, len(chain.errors)))
    assert chain.poses(q).shape == (2, 5, 4, 4)
    whole = {name: getattr(chain, name)(q, e) for name in ("poses", "frames", "jacobian", "columns")}
    assert whole["columns"].shape == (3, 2, 5, 6, len(chain.errors))
    monkeypatch.setattr("uq_handeye.model.kinematics.chain.POSTURES_PER_BLOCK", 4)
    for name, values in whole.items():
        function = getattr(chain, name)
        np.testing.assert_allclose(function(q, e), values, atol=1e-15)
        np.testing.assert_allclose(values[1, 0, 2], function(q[0, 2], e[1, 0, 0]), atol=1e-14)
    assert chain.poses(np.empty((0, 3))).shape == (0, 4, 4)
    np.testing.assert_allclose(chain.gravity(q)[1, 3], chain.gravity(q[1, 3]), atol=1e-15)


@pytest.mark.parametrize(("kinds", "told"), [("R" * 6, 18), ("R" * 7, 22), ("RR", 2)])
def test_what_no_data_can_tell(rng, kinds, told):
    """Only 4L - 6 of 6L geometric errors are identifiable beside X and W; the gauge columns are exactly X or W."""
    chain = random_chain(rng, kinds)
    q = postures(rng, chain, 60)
    F, T = chain.columns(q), chain.poses(q)
    geometric = np.array([error.group in ("joint offsets", "joint tilts", "link lengths") for error in chain.errors])
    gauge = np.array([error.gauge for error in chain.errors])
    assert gauge.sum() == 8 and not gauge[~geometric].any()
    left, right = np.zeros((60, 6, 6)), np.zeros((60, 6, 6))
    for k in range(6):  # T' = exp(xi) T and T exp(xi), to first order
        twist = np.eye(6)[k]
        left[:, :3, k] = twist[:3]
        left[:, 3:, k] = twist[3:] + np.cross(twist[:3], T[:, :3, 3])
        right[:, :3, k], right[:, 3:, k] = T[:, :3, :3] @ twist[:3], T[:, :3, :3] @ twist[3:]

    def rank(*parts):
        whole = np.concatenate(parts, axis=-1).reshape(360, -1)
        return np.linalg.matrix_rank(whole / np.linalg.norm(whole, axis=0), tol=1e-8)

    assert rank(left, right) == 12
    assert rank(left, right, F[..., geometric]) - 12 == told
    assert rank(left, right, F[..., gauge]) == 12
    assert rank(left, right, F[..., geometric & ~gauge]) - 12 == told


def test_gauge_of_a_prismatic_last_joint(rng):
    chain = random_chain(rng, "RRP")
    last = [error.name for error in chain.errors if error.gauge and error.joint == "j2"]
    assert last == ["joint tilts: j2 z", "link lengths: j2 x", "link lengths: j2 y", "link lengths: j2 z"]
    q = postures(rng, chain, 5)
    F = chain.columns(q)[..., [error.name in last for error in chain.errors]]
    R = chain.poses(q)[:, :3, :3]
    local = np.concatenate([np.swapaxes(R, 1, 2) @ F[:, :3], np.swapaxes(R, 1, 2) @ F[:, 3:]], axis=1)
    np.testing.assert_allclose(
        local, np.broadcast_to(local[:1], local.shape), atol=1e-12
    )  # the same in the tip's frame


def test_names_and_order_of_the_errors():
    chain = Kinematics.from_urdf(SIX_AXES, tip="tool0")
    names = [error.name for error in chain.errors]
    assert len(names) == 66 == len(set(names))
    assert names[0] == "joint offsets: axis_1" and names[6:8] == ["joint tilts: axis_1 x", "joint tilts: axis_1 y"]
    assert names[18] == "link lengths: axis_1 x" and names[36:38] == [
        "transmission: axis_1 sin q",
        "transmission: axis_1 cos q",
    ]
    assert names[-1] == "sag: axis_6"
    assert {(error.group, error.unit) for error in chain.errors} == {
        ("joint offsets", "rad"), ("joint tilts", "rad"), ("link lengths", "m"), ("transmission", "rad"),
        ("sag", "rad"),
    }  # fmt: skip
    gauge = [error.name for error in chain.errors if error.gauge]
    assert gauge == [
        "joint offsets: axis_1", "joint offsets: axis_6", "joint tilts: axis_1 x", "joint tilts: axis_1 y",
        "link lengths: axis_1 x", "link lengths: axis_1 y", "link lengths: axis_1 z", "link lengths: axis_6 z",
    ]  # fmt: skip


def test_gravity_is_the_slope_of_the_potential(rng):
    chain = random_chain(rng, "RPRR")
    q = postures(rng, chain)

    def potential(values):
        return chain.frames(values)[..., 2, 3].sum(axis=-1) + chain.poses(values)[..., 2, 3]

    raw = np.array([-(potential(q + d) - potential(q - d)) / 2e-6 for d in 1e-6 * np.eye(4)])
    g = chain.gravity(q)
    ratio = raw / g
    assert (ratio > 0).all()
    spread = chain.gravity(postures(rng, chain, 5000))
    assert (np.abs(spread).max(axis=0) < 1.1).all() and (np.abs(spread).max(axis=0) > 0.9).all()
    again = Kinematics.from_dict(json.loads(json.dumps(chain.to_dict())))
    np.testing.assert_array_equal(again.gravity(q), g)


def test_gravity_does_not_load_an_upright_axis(rng):
    upright = Kinematics.from_urdf(SIX_AXES, tip="tool0")
    on_the_wall = Kinematics.from_urdf(SIX_AXES, tip="tool0", up=(1, 0, 0))
    q = postures(rng, upright, 10)
    assert not upright.gravity(q)[:, 0].any() and not upright.gravity(q)[:, 5].any()
    assert on_the_wall.gravity(q)[:, 0].all()
    assert np.abs(upright.gravity(q)[:, 1]).max() > 0.1


def test_reach():
    chain = Kinematics.from_urdf(SIX_AXES, tip="tool0")
    assert 0.6 < chain.reach < 0.02 + 0.27 + 0.07 + 0.302 + 0.072


def test_covariance_is_that_of_drawn_errors(rng):
    chain = random_chain(rng, "RRPR")
    q = postures(rng, chain, 3)
    options = {
        "offset_sd": 2e-3, "tilt_sd": 1e-3, "length_sd": 5e-4, "transmission_sd": 3e-4, "sag_sd": 4e-4,
        "joint_sd": 1e-4,
    }  # fmt: skip
    S = chain.covariance(q, flange="physical", **options)
    assert S.n == 3 and S.keys == tuple(error.key for error in chain.errors)
    units = {"joint offsets": 2e-3, "joint tilts": 1e-3, "link lengths": 5e-4, "transmission": 3e-4, "sag": 4e-4}
    e = rng.normal(size=(4000, 1, len(S.keys))) * [units[error.group] for error in chain.errors]
    noisy = q + 1e-4 * rng.normal(size=(4000, 3, 4))
    errors = twist_between(chain.poses(q, e), chain.poses(noisy)).reshape(4000, 18)  # measured minus true
    white = np.linalg.solve(np.linalg.cholesky(np.asarray(S) + 1e-14 * np.eye(18)), errors.T)
    scatter = white @ white.T / 4000
    assert np.abs(scatter - np.eye(18)).max() < 0.15
    np.testing.assert_allclose(S.shared[1, :, 3], -chain.columns(q)[1, :, 3] * 1e-3)


def test_covariance_leaves_out_the_gauge_and_what_is_exact(rng):
    chain = Kinematics.from_urdf(SIX_AXES, tip="tool0")
    q = postures(rng, chain, 4)
    S = chain.covariance(q, "0.01deg", "0.1deg", "0.2mm")
    kept = [error for error in chain.errors if error.key in S.keys]
    assert len(kept) == len(S.keys) == 28 and not any(error.gauge for error in kept)
    np.testing.assert_allclose(S.own, np.deg2rad(0.01) ** 2 * chain.jacobian(q) @ np.swapaxes(chain.jacobian(q), 1, 2))
    assert chain.covariance(q).keys == () and not chain.covariance(q).own.any()
    assert chain.covariance(q, np.full(6, 1e-4)).own.any()
    for options in (
        {"joint_sd": [1.0, 2.0]},
        {"angle_sd": -1.0},
        {"flange": "real"},
        {"length_sd": "1deg"},
        {"joint_sd": np.full(6, np.nan)},
    ):
        with pytest.raises(InputError):
            chain.covariance(q, **options)
    with pytest.raises(InputError, match="shape"):
        chain.covariance(q[0])


def test_plain_numbers_and_back(rng):
    chain = Kinematics.from_urdf(SIX_AXES, tip="tool0")
    data = json.loads(json.dumps(chain.to_dict(), allow_nan=False))
    again = Kinematics.from_dict(data)
    assert again.to_dict() == chain.to_dict() and again.names == chain.names
    q = postures(rng, chain, 3)
    np.testing.assert_array_equal(again.poses(q), chain.poses(q))
    np.testing.assert_array_equal(again.limits, chain.limits)
    assert again.limits[5, 1] == np.inf


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.pop("end"),
        lambda d: d.update(joints={}),
        lambda d: d.update(joints=[]),
        lambda d: d.update(joints=d["joints"] * 2),
        lambda d: d.update(joints=[0]),
        lambda d: d.update(name=3),
        lambda d: d.update(tip="a\nb"),
        lambda d: d.update(up=[0, 0, 0]),
        lambda d: d.update(end=[[1, 2], [3, 4]]),
        lambda d: d["joints"][0].update(kind="floating"),
        lambda d: d["joints"][0].update(axis=[0, 0, 0]),
        lambda d: d["joints"][0].update(axis=[0, 0, None]),
        lambda d: d["joints"][0].update(lower=4.0),
        lambda d: d["joints"][0].update(lower="x"),
        lambda d: d["joints"][0].update(lower=-(10**400)),
        lambda d: d["joints"][0].update(origin=(2 * np.eye(4)).tolist()),
        lambda d: d["joints"][0]["origin"][0].__setitem__(3, 1e9),
        lambda d: d["joints"][0].pop("axis"),
    ],
)
def test_damaged_numbers_are_refused(change):
    data = json.loads(json.dumps(Kinematics.from_urdf(SIX_AXES, tip="tool0").to_dict()))
    change(data)
    with pytest.raises(InputError):
        Kinematics.from_dict(data)


def test_bad_arguments(rng):
    chain = random_chain(rng, "RR")
    with pytest.raises(InputError, match=r"shape \(..., 2\)"):
        chain.poses(np.zeros((4, 3)))
    with pytest.raises(InputError, match="finite"):
        chain.poses([np.nan, 0.0])
    with pytest.raises(InputError, match="`e`"):
        chain.poses([0.0, 0.0], np.zeros(3))
    with pytest.raises(InputError, match="broadcast"):
        chain.poses(np.zeros((4, 2)), np.zeros((3, len(chain.errors))))
    with pytest.raises(InputError, match="lower limit"):
        Joint("j", "revolute", np.eye(4), [0, 0, 1], 1.0, np.nan)
    assert not chain.joints[0].origin.flags.writeable and not chain.end.flags.writeable
    assert uq.Kinematics is Kinematics
