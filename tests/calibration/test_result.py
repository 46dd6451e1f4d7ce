"""Content of a calibration: files and back, points, budget, text."""

import dataclasses
import json

import numpy as np
import pytest
from fixtures.rigs import NOISE, PAIR_NOISE, SETUPS, motions_alone, quietly, with_wrong
from support import (
    SEED,
    assert_same_covariance,
    jacobian,
    moved,
    random_covariance,
)

import uq_handeye as uq
from uq_handeye.calibration.parts import PARTS

# ------------------------------------------------------------------------------------------------------------- JSON


def cases():
    poses = uq.simulate(20, noise=NOISE, seed=SEED)
    _, alone = motions_alone()
    return {
        "efficient": (poses, {"noise": NOISE}),
        "ml": (poses, {"noise": NOISE, "method": "ml"}),
        "robust": (with_wrong(poses, 4), {"noise": NOISE, "robust": True}),
        "estimated": (poses, {}),
        "estimated, wrong ones": (with_wrong(poses, 4), {}),
        "prior": (poses, {"prior": uq.NoisePrior(robot=(None, "0.05mm"))}),
        "eye-to-hand": (uq.simulate(20, noise=NOISE, setup="eye-to-hand", seed=SEED), {"noise": NOISE}),
        "motions": (alone, {"noise": PAIR_NOISE}),
        "motions, estimated": (alone, {}),
        "sandwich": (poses, {"covariance": "sandwich"}),
        "4dpa": (poses, {"noise": NOISE, "method": "4dpa"}),
        "park, estimated": (poses, {"method": "park"}),
        "shah": (poses, {"noise": NOISE, "method": "shah"}),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", cases())
def test_json_round_trip_and_summary(name):
    data, options = cases()[name]
    result = quietly(data, **options)
    text = result.to_json()
    again = uq.Calibration.from_dict(json.loads(text))
    assert again.to_json() == text
    assert again.summary(verbose=True) == result.summary(verbose=True)
    for field in ("X", "covariance", "W", "covariance_W", "bound", "efficiency"):
        value, read = getattr(result, field), getattr(again, field)
        assert (value is None) == (read is None)
        if value is not None:
            np.testing.assert_array_equal(read, value)
    assert again.reference == result.reference and again.fit == result.fit and again.warnings == result.warnings
    if result.analysis is not None:
        assert again.split_half.sentence == result.split_half.sentence
        assert again.diagnostics.sentences() == result.diagnostics.sentences()
        np.testing.assert_allclose(again.budget.shares, result.budget.shares)
        assert again.budget.sources == result.budget.sources
    assert max(map(len, result.summary(verbose=True).splitlines())) <= 120
    assert "nan" not in result.summary(verbose=True).lower().split() and "None" not in result.summary(verbose=True)


def test_attributes_of_the_parts_are_those_of_the_result(estimated):
    for part, kind in PARTS.items():
        held = getattr(estimated, part)
        assert isinstance(held, kind)
        for one in dataclasses.fields(kind):
            assert getattr(estimated, one.name) is getattr(held, one.name)
    assert len(dataclasses.fields(estimated)) == 6 + len(PARTS)
    other = dataclasses.replace(estimated, about={"robot": "left"}, bound=None, X=np.eye(4))
    assert (other.about, other.origin.about, other.bound) == ({"robot": "left"}, {"robot": "left"}, None)
    assert other.quality.table is estimated.table and estimated.about == {} and estimated.bound is not None
    with pytest.raises(TypeError, match=r"Calibration\(\) got an unexpected keyword argument 'colour'"):
        dataclasses.replace(estimated, colour=1)


@pytest.mark.slow
def test_saved_and_loaded(estimated, tmp_path):
    again = uq.load(estimated.save(tmp_path / "result.json"))
    np.testing.assert_array_equal(again.X[:3], np.column_stack([again.R, again.t]))
    np.testing.assert_array_equal(again.X, estimated.X)


@pytest.mark.slow
def test_damaged_parts_are_refused(estimated):
    data = json.loads(estimated.to_json())
    changes = [
        (key, value) for key in ("fit", "poses", "analysis", "noise_estimate", "4dpa") for value in ("abc", [], 3)
    ]
    changes += [
        ("reference", {"kind": "F", "dof": None}),
        ("reference", {"kind": "F", "dof": -3}),
        ("reference", "F"),
        ("bound", [[1.0]]),
        ("W", None),
        ("covariance_kind", 3),
        ("fit", {**data["fit"], "more": 1}),
        ("4dpa", {"X": np.eye(3).tolist(), "covariance": None}),
        ("poses", data["poses"] | {"weight": [1.0]}),
        ("poses", data["poses"] | {"distance2": [None] * 20}),
        ("noise_estimate", data["noise_estimate"] | {"components": [{"name": "x"}]}),
        *[
            ("analysis", data["analysis"] | {part: value})
            for part in ("diagnostics", "covariances", "split_half", "split_in_time", "budget", "reasons")
            for value in ("abc", 3)
        ],
        ("analysis", data["analysis"] | {"covariances": {"model": [[1.0]]}}),
        ("analysis", data["analysis"] | {"budget": {"sources": ["a"]}}),
    ]
    changes += [("usable", value) for value in (False, [], "yes", 1, None)]
    changes += [("answered", value) for value in ("in part", "no", True, None)]
    changes += [
        ("convention", "x"),
        ("convention", None),
        ("units", "mm"),
        ("units", data["units"] | {"rotation": "deg"}),
    ]
    for key, value in changes:
        with pytest.raises(uq.InputError):
            uq.Calibration.from_dict(data | {key: value})
    for key in data["analysis"]:
        with pytest.raises(uq.InputError, match="damaged"):
            uq.Calibration.from_dict(data | {"analysis": {k: v for k, v in data["analysis"].items() if k != key}})


# ------------------------------------------------------------------------------------------------------- task space


@pytest.mark.slow
def test_noise_of_many_numbers_is_stored_once(estimated):
    """A joint covariance has a row of hundreds of numbers for each pose; it was half of the file."""
    data = json.loads(estimated.to_json())
    assert estimated.noise_estimate.is_joint and data["noise_estimate"]["noise"] == "as noise"
    again = uq.Calibration.from_dict(data)
    assert again.noise_estimate.noise is again.noise and again.to_json() == estimated.to_json()
    other = {**data, "noise_estimate": data["noise_estimate"] | {"noise": "x"}}
    for noise, words in (({**data, "noise": None}, "noise is missing"), (other, "a dictionary")):
        with pytest.raises(uq.InputError, match=words):
            uq.Calibration.from_dict(noise)


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("way", ["X", "robot", "target"])
def test_uncertainty_of_points(way, setup, rng):
    """Against a numerical derivative of the chain of poses, and a Monte Carlo of it."""
    poses = uq.simulate(20, noise=NOISE, setup=setup, seed=SEED)
    result = quietly(poses, noise=NOISE)
    T = poses.robot[3] if way == "robot" else poses.camera[3]
    S_T, S_p, p = random_covariance(rng), random_covariance(rng, 3), np.array([0.1, -0.05, 0.6])
    options = {"points_covariance": S_p}
    if way == "robot":
        options |= {"robot": T, "robot_covariance": S_T}
    elif way == "target":
        options |= {"camera": T, "camera_covariance": S_T}
    found = result.uncertainty_at(p, **options)

    def carried(x):
        """Carry errors (m, 15): of X or W, of the pose, of the point."""
        points = (p + x[:, 12:])[..., None]
        pose = moved(np.tile(T, (len(x), 1, 1)), x[:, 6:12])
        if way == "target":
            chain = moved(np.tile(result.W, (len(x), 1, 1)), x[:, :6]) @ np.linalg.inv(pose)
        else:
            chain = moved(np.tile(result.X, (len(x), 1, 1)), x[:, :6])
        if way == "robot":
            chain = (pose if setup == "eye-in-hand" else np.linalg.inv(pose)) @ chain
        return (chain[:, :3, :3] @ points)[..., 0] + chain[:, :3, 3]

    S = np.zeros((15, 15))
    S[:6, :6] = result.covariance_W if way == "target" else result.covariance
    if way != "X":
        S[6:12, 6:12] = S_T
    S[12:, 12:] = S_p
    J = jacobian(carried, 15)
    assert_same_covariance(found.covariance, J @ S @ J.T, 1e-6)
    np.testing.assert_allclose(found.points, carried(np.zeros((1, 15)))[0], atol=1e-14)
    near, far = ("gripper", "base") if setup == "eye-in-hand" else ("base", "gripper")
    assert found.frame == (near if way == "X" else far)
    values, vectors = np.linalg.eigh(S)
    errors = carried((rng.normal(size=(20_000, 15)) * np.sqrt(np.clip(values, 0, None))) @ vectors.T) - found.points
    # eigenvalues of a covariance from 20,000 samples scatter by 1 %
    assert_same_covariance(np.cov(errors.T), found.covariance, 0.06)
    inside = (np.linalg.norm(errors, axis=1) < found.radius_95).mean()
    assert abs(inside - 0.95) < 4 * np.sqrt(0.95 * 0.05 / 20_000) + 0.02 * (found.tails - 1)
    np.testing.assert_allclose(found.std, np.sqrt(np.diag(found.covariance)))


@pytest.mark.slow
def test_uncertainty_that_is_not_determined(poses, given):
    p = [0, 0, 0.5]
    with pytest.raises(uq.InputError, match=r"either `robot`.*or `camera`"):
        given.uncertainty_at(p, robot=np.eye(4), camera=np.eye(4))
    with pytest.raises(uq.InputError, match="`points`"):
        given.uncertainty_at([0, 0])
    with pytest.raises(uq.InputError, match="robot"):
        given.uncertainty_at(p, robot=np.eye(3))
    with pytest.raises(uq.InputError, match="needs W"):
        quietly(poses, noise=NOISE, kind="pairs").uncertainty_at(p, camera=poses.camera[0])
    _, alone = motions_alone()
    motions = quietly(alone, noise=PAIR_NOISE)
    assert motions.uncertainty_at(p).covariance.shape == (3, 3)
    assert motions.uncertainty_at(p).frame == "parent frame of X"
    for name in ("robot", "camera"):
        with pytest.raises(uq.InputError, match=f"Expected no `{name}`: .*came without poses"):
            motions.uncertainty_at(p, **{name: poses.camera[0]})
        with pytest.raises(uq.InputError, match=f"the pose `{name}` beside `{name}_covariance`"):
            given.uncertainty_at(p, **{f"{name}_covariance": np.eye(6)})
    exact = uq.calibrate(uq.PosePairs(poses.truth.robot, poses.truth.camera))
    for options in ({}, {"robot": poses.robot[0]}, {"camera": poses.camera[0]}):
        with pytest.raises(uq.InputError):
            exact.uncertainty_at(p, **options)


def test_budget_does_not_split_what_is_not_known(given, estimated):
    assert set(given.budget.sources) == {f"{a} {b}" for a in ("robot", "camera") for b in ("rotation", "translation")}
    open_ = {c.name for c in estimated.noise_estimate.components if c.status == "not told apart"}
    both = {"robot translation", "camera translation"}
    merged = "robot translation + camera translation" in estimated.budget.sources
    assert open_ and merged == (both <= open_) and merged != bool(both & set(estimated.budget.sources))
    for result in (given, estimated):
        assert_same_covariance(result.budget.covariance[:6, :6], result.covariance, 1e-4)
        for shares in result.budget.group_shares.values():
            assert shares.sum() == pytest.approx(1.0)


# ------------------------------------------------------------------------------------------------------------- text


@pytest.mark.slow
def test_the_summary_has_every_section(given, estimated, poses):
    everywhere = (
        "gripper_T_camera from 20 poses, eye-in-hand, efficient",
        "translation (mm)",
        "gripper_T_camera is known ",
        "sigma_0: 1 before the fit (prior), ",
        "  rotation vector (deg)",
        "The robot rotates about three axes, with shares ",
        "Residuals of AX = XB over the pairs",
        "camera_T_gripper (inverse of X)",
        "base_T_target (the target, from all poses)",
        "Fit: chi-square",
        "4DPA only, on the same data:",
        "times the Cramer-Rao bound",
        "Standard deviations of X by every covariance",
        "  model (the noise) *  ",
        "bootstrap",
        "Uncertainty budget of X (JCGM 100)",
        "95 % of the errors are within",
        "Diagnostics:",
        "95 % of all errors lie within d^2",
        "Errors that all poses share: standard deviation assumed",
    )
    for result in (given, estimated):
        for part in everywhere:
            assert part in result.summary(verbose=True), part
        assert "Not included: " in " ".join(result.summary(verbose=True).split())
    assert "Noise as given" in given.summary(
        verbose=True
    ) and "robot           0.0200            0.0500" in given.summary(verbose=True)
    assert "chi-square with 6 degrees of freedom" in given.summary(verbose=True)
    assert "Noise, estimated from the residuals" in estimated.summary(verbose=True) and "t with " in estimated.summary(
        verbose=True
    )
    assert "to first order, of the noise given" in given.summary(verbose=True)
    assert "to first order, of the noise estimated" in estimated.summary(verbose=True)
    spoiled = quietly(with_wrong(poses, 4)).summary(verbose=True)
    assert "CAUTION: " in spoiled and "stand out (numbered from 0" in spoiled and "CAUTION: 1 of 20 poses" in spoiled
    assert "No pose stands out" in quietly(uq.simulate(8, noise=NOISE, seed=1), noise=NOISE).summary(verbose=True)


@pytest.mark.slow
def test_the_summary_answers_first_and_says_each_thing_once(poses):
    result = quietly(with_wrong(poses, 4))
    lines = result.summary(verbose=True).splitlines()
    assert lines[1].startswith("gripper_T_camera is known ")
    first = [k for k, line in enumerate(lines) if line.startswith("CAUTION: ")]
    matrix = next(k for k, line in enumerate(lines) if line.startswith("   "))
    assert len(first) == len(result.warnings) and max(first) < matrix
    assert lines.index("camera_T_gripper (inverse of X)") > lines.index("Diagnostics:")
    flat = " ".join(" ".join(lines).split())
    for text in result.warnings:
        assert flat.count(f"CAUTION: {text}") == 1


def test_the_summary_of_joint_noise():
    n = 12
    noise = uq.PoseNoise(NOISE.robot, np.kron(np.eye(n) + 0.5, NOISE.camera))
    flat = " ".join(quietly(uq.simulate(n, noise=noise, seed=1), noise=noise).summary(verbose=True).split())
    assert flat.count("The noise is joint over the poses") == 1
    assert "sandwich, bootstrap not determined: " in flat
    assert "camera (rotation and translation) " in flat and "camera rotation " not in flat


def test_a_folder_stands_for_the_result_in_it(tmp_path):
    found = uq.calibrate(uq.simulate(8, noise=NOISE, seed=3), noise=NOISE)
    found.to_json(tmp_path / "result.json")
    assert uq.load(tmp_path).to_dict() == uq.load(tmp_path / "result.json").to_dict()
    with pytest.raises(uq.InputError, match="it is a folder, expected a file"):
        uq.load(tmp_path.parent)
