"""calibrate() and its result: numbers that belong together, lossless JSON, honest failures."""

import inspect
import json
import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import difference, jacobian, moved

import uq_handeye as uq
from uq_handeye.methods.scaled import octonion

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


@pytest.fixture(scope="module")
def result():
    return uq.calibrate(uq.simulate(20, noise=NOISE, seed=1), noise=NOISE)


def test_is_solve_and_propagate():
    poses = uq.simulate(20, noise=NOISE, seed=1)
    for pairs in ("all", "consecutive", [[0, 5], [3, 7], [2, 9]]):
        result = uq.calibrate(poses, noise=NOISE, method="4dpa", pairs=pairs)
        motions = uq.relative_motions(poses, pairs)
        np.testing.assert_allclose(result.X, uq.solve(motions.A, motions.B), atol=1e-14)
        np.testing.assert_allclose(result.covariance, uq.propagate(motions, NOISE), rtol=1e-10)
        assert (result.n_poses, result.n_pairs) == (20, motions.N)
    assert result.kind == "poses"
    assert uq.calibrate(poses, noise=NOISE, kind="pairs").kind == "pairs"


def test_motions_without_poses():
    motions = uq.relative_motions(uq.simulate(20, seed=1))
    noise = uq.PairNoise.isotropic(B=("1mrad", "1mm"))
    result = uq.calibrate(uq.Motions(motions.A, motions.B), noise=noise)
    assert (result.n_poses, result.n_pairs, result.frame) == (None, 19, "X")
    assert (result.kind, result.method) == ("pairs", "efficient")
    published = uq.calibrate(uq.Motions(motions.A, motions.B), noise=noise, method="4dpa")
    assert (published.n_poses, published.n_pairs, published.frame, published.kind) == (None, 19, "X", "pairs")


def test_exact_data_say_nothing_about_the_noise():
    result = uq.calibrate(uq.simulate(10, seed=1))
    assert result.method == "efficient"
    assert result.covariance is result.std is result.correlation is result.covariance_inverse is None
    assert result.covariance_sigma is result.weakest_rotation is None
    assert "accuracy of gripper_T_camera is not known" in result.summary(verbose=True)
    with pytest.raises(uq.InputError, match="not determined"):
        result.covariance_in("ros")
    for value in ("diagnostics", "covariances", "split_half", "budget"):
        with pytest.raises(uq.InputError, match="where there is noise"):
            getattr(result, value)
    with pytest.raises(uq.InputError, match="not determined"):
        result.uncertainty_at([0, 0, 1])


def test_derived_quantities(result):
    D = np.diag(result.std)
    np.testing.assert_allclose(D @ result.correlation @ D, result.covariance, rtol=1e-12)
    np.testing.assert_allclose(result.inverse @ result.X, np.eye(4), atol=1e-14)
    np.testing.assert_allclose(Rotation.from_quat(result.quaternion).as_matrix(), result.X[:3, :3], atol=1e-14)
    axis, deviation = result.weakest_translation
    assert deviation**2 == pytest.approx(axis @ result.covariance[3:, 3:] @ axis)
    assert deviation >= result.std[3:].max()
    # the covariance of the inverse, by a numerical derivative
    J = jacobian(lambda xi: difference(np.linalg.inv(moved(result.X, xi)), np.tile(result.inverse, (len(xi), 1, 1))), 6)
    np.testing.assert_allclose(result.covariance_inverse, J @ result.covariance @ J.T, rtol=1e-7, atol=1e-14)


@pytest.mark.parametrize(("scale", "method"), [(None, "4dpa"), (None, "efficient"), (1e3, "4dpa"), (1e5, "4dpa")])
def test_octonion(scale, method):
    poses = uq.simulate(20, noise=NOISE, seed=1)
    result = uq.calibrate(poses, noise=NOISE, scale=scale, method=method)
    d = result.sigma_scale
    assert d == (scale or 1e4)
    assert np.linalg.norm(result.sigma) == pytest.approx(1)
    assert np.linalg.norm(result.sigma[:4]) == pytest.approx(np.sqrt(0.5))

    def sigma(xi):
        return octonion(moved(result.X, xi), d)

    same_on_the_octonions(result.covariance_sigma, jacobian(sigma, 6), result)


def same_on_the_octonions(covariance_sigma, J, result):
    """``covariance_sigma = J Sigma_X J^T`` for J = d sigma / d xi (8x6), judged in whitened coordinates of X."""
    back = np.linalg.pinv(J, rcond=1e-15) @ covariance_sigma @ np.linalg.pinv(J, rcond=1e-15).T
    L = np.linalg.cholesky(result.covariance)
    np.testing.assert_allclose(np.linalg.solve(L, np.linalg.solve(L, back).T), np.eye(6), atol=1e-3)
    normals = np.zeros((8, 2))
    normals[:4, 0], normals[4:, 1] = result.sigma[:4], result.sigma[4:]  # the lengths of q_L and q_R are exact
    assert np.abs(covariance_sigma @ normals).max() < 1e-7 * np.abs(covariance_sigma).max()


def test_octonion_is_that_of_the_paper_route():
    motions = uq.relative_motions(uq.simulate(30, noise=NOISE, seed=1))
    noise = uq.PairNoise.isotropic(A=("0.2deg", "1mm"), B=("0.1deg", "0.5mm"))
    result = uq.calibrate(uq.Motions(motions.A, motions.B), noise=noise, scale=1e4)
    sigma, covariance = uq.octonion_covariance(motions.A, motions.B, noise, scale=1e4)
    np.testing.assert_allclose(result.sigma, sigma, atol=1e-8)
    J = jacobian(lambda xi: octonion(moved(result.X, xi), 1e4), 6)
    same_on_the_octonions(covariance, J, result)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [None, NOISE, uq.PoseNoise(camera=np.eye(120) * 1e-6)])
@pytest.mark.parametrize("scale", [None, 1e4])
def test_json_round_trip_without_loss(noise, scale, tmp_path):
    poses = uq.simulate(20, noise=NOISE, seed=1)
    result = uq.calibrate(poses, noise=noise, scale=scale, pairs="consecutive")
    text = result.to_json(tmp_path / "result.json")
    assert (tmp_path / "result.json").read_text() == text
    again = uq.Calibration.from_json(tmp_path / "result.json")
    assert again.to_json() == text
    np.testing.assert_array_equal(again.X, result.X)
    if noise is not None:
        np.testing.assert_array_equal(again.covariance, result.covariance)
        np.testing.assert_array_equal(again.noise.camera, noise.camera)
    data = json.loads(text)
    assert {"X", "covariance", "method", "convention", "units"} <= set(data)


def test_the_signature_names_every_argument():
    names = inspect.signature(uq.calibrate).parameters
    assert {"data", "camera", "exclude", "noise", "method", "kinematic_errors", "components"} <= set(names)
    with pytest.raises(TypeError, match="unexpected keyword argument 'nose'"):
        uq.calibrate(uq.simulate(5, seed=1), nose=NOISE)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ("[1, 2]", "Expected a result file of format 'uq-handeye calibration 8', got .*1, 2"),
        ('{"format": "uq-handeye calibration 3"}', "calibration 3.*uq-handeye calibrate ROBOT CAMERA -o DIR"),
        ("{", "is not JSON"),
        ("", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
    ],
)
def test_damaged_json(damage, message, tmp_path):
    file = tmp_path / "result.json"
    file.write_text(damage)
    with pytest.raises(uq.InputError, match=message):
        uq.Calibration.from_json(file)


@pytest.mark.parametrize(("text", "message"), [("{}", "got JSON text"), ("x" * 5000, "Cannot read xxx")])
def test_text_in_place_of_a_path_is_one_short_line(text, message):
    with pytest.raises(uq.InputError, match=message) as error:
        uq.Calibration.from_json(text)
    assert len(str(error.value)) < 350


def test_json_with_changed_parts(result):
    data = result.to_dict()
    for key, value in (
        ("X", [[1, 2]]),
        ("covariance", [[1.0]]),
        ("covariance", (-np.eye(6)).tolist()),
        ("setup", "eye"),
        ("residuals", {}),
        ("noise", {"type": "PoseNoise"}),
        ("X", np.tile(np.eye(4), (2, 1, 1)).tolist()),
        ("n_poses", "abc"),
        ("findings", "abc"),
        ("findings", ["abc"]),
        ("findings", [{"code": "input_checks.same_file", "severity": "bad", "values": {}}]),
        ("scale", "1e4"),
        ("reference", {"kind": "normal", "dof": None}),
        ("noise_estimate", {"noise": None}),
        ("4dpa", {"X": [[1.0]], "covariance": None}),
        ("poses", {"item": "pose"}),
        ("analysis", {}),
        ("fit", {"chi2": 1}),
    ):
        with pytest.raises(uq.InputError):
            uq.Calibration.from_dict(data | {key: value})
    del data["method"]
    with pytest.raises(uq.InputError, match="damaged: 'method' is missing"):
        uq.Calibration.from_dict(data)
    with pytest.raises(uq.InputError, match="Expected the path of a file, got NoneType"):
        uq.Calibration.from_json(None)


def leaves(data, path=()):
    """Paths to every part of plain data; of lists the last."""
    items = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for name, part in items:
        if not isinstance(name, int) or name == len(data) - 1:
            yield (*path, name)
            yield from leaves(part, (*path, name))


def replaced(data, path, value):
    found = data.copy()
    found[path[0]] = value if len(path) == 1 else replaced(data[path[0]], path[1:], value)
    return found


@pytest.mark.slow
@pytest.mark.stored
@pytest.mark.parametrize(
    ("options", "bad"),
    [*(({}, bad) for bad in (None, "x", -1, [], {}, 1e400, 10**400, True)), ({"method": "park"}, None)],
    ids=lambda value: str(value)[:6],
)
def test_no_damage_passes_that_shows_up_later(options, bad):
    """Each part of a file replaced: refused when it is read, or a result that can be printed and written again."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        data = json.loads(uq.calibrate(uq.simulate(8, noise=NOISE, seed=1), **options).to_json())
    refused = 0
    for_programs = ("headline", "usable", "answered", "accuracy", "checks")  # written, not read
    paths = [path for path in leaves(data) if path[0] not in for_programs]
    for path in paths:
        try:
            found = uq.Calibration.from_dict(replaced(data, path, bad))
        except uq.InputError:
            refused += 1
            continue
        assert "X" not in path or bad == -1, path
        assert found.summary(verbose=True) and found.to_json()
    assert refused > 0.3 * len(paths)
    if isinstance(bad, float | str | list | dict):
        assert refused > 0.7 * len(paths)


def test_numbers_that_are_none(result, tmp_path):
    text = result.to_json()
    for constant in ("NaN", "Infinity", "-Infinity", "1e999"):
        file = tmp_path / "result.json"
        file.write_text(text.replace('"n_pairs": 190', f'"n_pairs": {constant}'))
        with pytest.raises(uq.InputError, match=r"is not JSON|is not finite"):
            uq.Calibration.from_json(file)
    data = result.to_dict()
    assert uq.Calibration.from_dict(data | {"comment": "more is no damage"}).to_json() == text
    with pytest.raises(uq.InputError, match=r"calibration\.std.* does not fit the rest"):
        uq.Calibration.from_dict(data | {"std": [2 * x for x in data["std"]]})
    with pytest.raises(uq.InputError, match="covariance_kind is 'magic'"):
        uq.Calibration.from_dict(data | {"covariance_kind": "magic"})


@pytest.mark.slow
def test_a_file_of_many_poses_is_small():
    many = uq.simulate(1687, noise=NOISE, seed=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        assert len(uq.calibrate(many, noise=NOISE).to_json()) < 2e6  # the poses are 0.95 MB of it


def test_summary_states_units_and_numbers(result):
    text = result.summary(verbose=True, threshold=0.3)
    for part in ("gripper_T_camera", "(mm)", "(deg)", "quaternion", "known to ", "equally certain", "camera_T_gripper"):
        assert part in text
    assert f"{1e3 * result.X[0, 3]:.4f} +- " in text
    said = " ".join(text.split())
    assert (
        "Not included: camera intrinsics, robot kinematics, target size." in said
        and "Errors that all poses share are not included." in said
    )
    assert "rotation y with translation x" in text
    assert "rotation y with translation x" not in result.summary(verbose=True, threshold=0.99)


def test_too_few_poses():
    with pytest.raises(uq.InputError, match="at least 3 poses, which make 2 motions, got 2"):
        uq.calibrate(uq.simulate(2, seed=0))
    with pytest.raises(uq.InputError, match=r"PosePairs or Motions.*got ndarray"):
        uq.calibrate(np.eye(4))
    with pytest.raises(uq.InputError, match="one data set"):
        uq.calibrate(uq.simulate(5, noise=NOISE, trials=2, seed=0))


def planar(n, noise, seed=0):
    """A 4-axis robot: translations in space, rotations about z only."""
    rng = np.random.default_rng(seed)
    truth = uq.simulate(3, seed=0).truth
    robot = np.zeros((n, 4, 4))
    robot[:, :3, :3] = Rotation.from_rotvec(rng.uniform(-2, 2, (n, 1)) * [0, 0, 1]).as_matrix()
    robot[:, :3, 3] = rng.uniform(-0.5, 0.5, (n, 3))
    robot[:, 3, 3] = 1
    camera = np.linalg.inv(robot @ truth.X) @ truth.W
    if noise is not None:
        camera = moved(camera, rng.normal(size=(n, 6)) * np.sqrt(np.diag(noise.camera)))
    return uq.PosePairs(robot, camera)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_parallel_axes_are_answered_and_named(seed):
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("1mrad", "1mm"))
    with pytest.warns(uq.InputWarning, match="gripper's z axis together with the target along the base's z axis"):
        found = uq.calibrate(planar(20, None if seed is None else noise, seed or 0), noise=noise)
    assert "nearly parallel" not in found.summary(verbose=True)  # it is said once, and better
    (row,) = [
        line for line in found.summary(verbose=True).splitlines() if line.strip().startswith("model (the noise) *")
    ]
    assert row.split()[-1] == "open" and row.split().count("open") == 1
    np.testing.assert_allclose(np.abs(found.open_directions), [[0, 0, 0, 0, 0, 0.5**0.5] * 2], atol=1e-6)
    assert np.isinf(found.std).tolist() == [False] * 5 + [True] and found.reference.components == 5
    again = uq.Calibration.from_dict(json.loads(found.to_json()))
    np.testing.assert_array_equal(again.open_directions, found.open_directions)
    assert "Infinity" not in found.to_json() and "NaN" not in found.to_json()
    at = found.uncertainty_at([0.0, 0.0, 0.5])
    assert np.isfinite(at.std[:2]).all() and np.isinf(at.std[2]) and np.isinf(at.radius_95)


def test_published_methods_refuse_parallel_axes():
    with (
        pytest.raises(uq.DegenerateMotionError, match=r"parallel to \(0.000, 0.000, 1.000\)"),
        pytest.warns(uq.InputWarning, match="nearly parallel"),
    ):
        uq.calibrate(planar(20, None), method="4dpa")


@pytest.mark.slow
def test_a_prior_closes_parallel_axes_and_one_that_contradicts_the_data_is_named():
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("1mrad", "1mm"))
    data = planar(20, noise, 3)
    X = uq.simulate(3, seed=0).truth.X
    height = X[2, 3]
    with pytest.warns(uq.InputWarning, match="nearly parallel"):
        found = uq.calibrate(data, noise=noise, **uq.parse_known_values(f"camera z = {height:.9f}m +- 1mm"))
    assert len(found.open_directions) == 0 and abs(found.std[5] - 1e-3) < 2e-5
    assert "prior of X" in found.budget.sources
    again = uq.Calibration.from_dict(json.loads(found.to_json()))
    assert again.noise.prior.rank == 1
    away = X[0, 3] + 0.05
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = uq.calibrate(
            data,
            noise=noise,
            **uq.parse_known_values(f"camera x = {away:.9f}m +- 1mm", f"camera z = {height:.9f}m +- 1mm"),
        )
    assert any(finding.code == "calibration.prior_contradicted" for finding in found.findings)
    with pytest.raises(uq.InputError, match="takes no prior"):
        uq.calibrate(data, noise=noise, method="park", **uq.parse_known_values("camera x = 1m +- 1mm"))
