"""Every method in one table: who agrees, who differs, who fails, and nothing is lost."""

import dataclasses
import json
import math
import re
import warnings

import numpy as np
import pytest
from fixtures.comparisons import compare
from scipy import stats
from support import difference, exact_motions, moved, noisy_motions, random_covariance, whitened_eigenvalues

import uq_handeye as uq
from uq_handeye.errors import DegenerateMotionError, InputError, InputWarning, MissingExtraError, NotConvergedError
from uq_handeye.methods.method import Estimate
from uq_handeye.model.poses.motions import spread_pairs
from uq_handeye.report.comparison import compare as module
from uq_handeye.report.comparison.compare import CHI2_95, Row, against, squared_distance
from uq_handeye.report.comparison.result import Comparison

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
FEW = ("tsai", "park", "gwak", "4dpa")


@pytest.fixture(scope="module")
def poses():
    return uq.simulate(12, noise=NOISE, seed=5)


@pytest.fixture(scope="module")
def everything(poses):
    return compare(poses, noise=NOISE)


def replaced(monkeypatch, name, calibration=None, **changes):
    """METHODS[name] with other fields; or calibrate() with another outcome for it."""
    if changes:
        monkeypatch.setitem(uq.METHODS, name, dataclasses.replace(uq.METHODS[name], **changes))
    if calibration is not None:
        original = module.calibrate

        def calibrate(data, *, method=None, **options):
            return calibration() if method == name else original(data, method=method, **options)

        monkeypatch.setattr(module, "calibrate", calibrate)


class Failing:
    """A solver that raises."""

    def __init__(self, error):
        self.error = error

    def estimate(self, A, B, noise):
        raise self.error


def raises(error):
    def act():
        raise error

    return act


def no_constant(name):
    raise AssertionError(f"{name} in JSON")


@pytest.mark.slow
def test_all_methods_have_a_row_as_calibrate_gives_it(poses, everything):
    assert [row.method for row in everything.rows] == list(uq.METHODS)
    assert (everything.reference, everything.frame, everything.n_poses) == ("4dpa", "gripper_T_camera", 12)
    assert (everything.n_pairs, everything.n_pairs_available) == (66, 66)
    motions = uq.relative_motions(poses, "all")
    for row in everything.rows:
        if row.failure is not None:  # an optional extra may be missing
            continue
        method = uq.METHODS[row.method]
        assert (row.year, row.structure, row.form) == (method.year, method.structure, method.form)
        result = uq.calibrate(motions, noise=NOISE, method=row.method)
        np.testing.assert_allclose(row.X, result.X, atol=1e-9)
        np.testing.assert_allclose(whitened_eigenvalues(row.covariance, result.covariance), 1, rtol=1e-5)
        np.testing.assert_allclose(row.residuals, result.residuals, rtol=1e-5)
        assert row.iterations == result.iterations
        assert row.converged is True
        assert row.seconds > 0
    direct = uq.calibrate(poses, noise=NOISE, method="4dpa")  # all pairs in O(n): the same numbers by another way
    np.testing.assert_allclose(everything["4dpa"].X, direct.X, atol=1e-12)
    eigenvalues = whitened_eigenvalues(everything["4dpa"].covariance, direct.covariance)
    np.testing.assert_allclose(eigenvalues, 1, rtol=1e-6)


@pytest.mark.slow
def test_differences_are_those_of_the_convention(everything):
    reference = everything["4dpa"]
    assert (reference.d2, reference.agrees, reference.difference_rotation) == (0, True, 0)
    for row in everything.rows:
        if row.failure is not None:
            continue
        np.testing.assert_allclose(moved(reference.X, row.xi), row.X, atol=1e-14)
        np.testing.assert_allclose(row.xi, difference(row.X, reference.X), atol=1e-14)
        cosine = (np.trace(row.X[:3, :3] @ reference.X[:3, :3].T) - 1) / 2
        assert math.cos(row.difference_rotation) == pytest.approx(cosine, abs=1e-12)
        distance = np.linalg.norm(row.X[:3, 3] - reference.X[:3, 3])
        assert row.difference_translation == pytest.approx(distance, rel=1e-12)
        assert row.d2 == pytest.approx(row.xi @ np.linalg.solve(row.covariance, row.xi), rel=1e-6)
        assert row.agrees == (row.d2 <= stats.chi2.ppf(0.95, 6))


def test_agreement_on_either_side_of_the_ellipsoid(rng):
    assert pytest.approx(stats.chi2.ppf(0.95, 6), rel=1e-12) == CHI2_95
    X, covariance = np.eye(4), random_covariance(rng)
    base = Row("4dpa", 2019, "", "", X=X, covariance=covariance, converged=True)
    direction = np.linalg.cholesky(covariance) @ [0.6, 0, 0, 0, 0.8, 0]
    for radius, agrees in ((0.99, True), (1.01, False)):
        shifted = moved(X, radius * math.sqrt(CHI2_95) * direction)
        row = against(dataclasses.replace(base, method="park", X=shifted), base)
        assert row.agrees is agrees
        assert row.d2 == pytest.approx(radius**2 * CHI2_95, rel=1e-9)
    # the method's own covariance counts, not that of the reference
    assert against(dataclasses.replace(base, method="park", X=shifted, covariance=4 * covariance), base).agrees
    without = against(dataclasses.replace(base, method="park", X=shifted, covariance=None), base)
    assert without.xi is not None and (without.d2, without.agrees) == (None, None)


def test_squared_distance_of_singular_covariances():
    xi = np.array([1e-3, 0, 0, 1e-3, 0, 0])
    assert squared_distance(xi, np.diag([1e-6, 0, 0, 1e-6, 0, 0])) == pytest.approx(2)
    assert squared_distance(xi, np.diag([0, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6])) == math.inf
    along = np.outer(xi, xi) + np.diag([0, 1.0, 1, 0, 1, 1])
    assert squared_distance(xi, along) == pytest.approx(1)
    assert squared_distance(xi * [1, 0, 0, -1, 0, 0], along) == math.inf
    assert squared_distance(np.zeros(6), np.zeros((6, 6))) == 0


def test_a_shifted_method_differs(poses, monkeypatch):
    good = uq.calibrate(poses, noise=NOISE, method="park")
    off = moved(good.X, np.array([0, 0, 0, 0.01, 0, 0]))
    replaced(monkeypatch, "park", lambda: dataclasses.replace(good, X=off))
    result = compare(poses, noise=NOISE, methods=FEW)
    assert result["tsai"].agrees and not result["park"].agrees
    assert "1 differs: park" in result.verdict
    assert "DIFFERS" in result.to_text(verbose=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("error", "text"),
    [
        (DegenerateMotionError("Axes are\nparallel.", np.eye(6)), "Axes are parallel."),
        (InputError("No."), "No."),
        (np.linalg.LinAlgError("Singular matrix"), "LinAlgError: Singular matrix"),
        (ArithmeticError(), "ArithmeticError: ArithmeticError"),
    ],
)
def test_a_failing_method_says_why_in_its_row(poses, monkeypatch, error, text):
    replaced(monkeypatch, "park", solver=Failing(error))
    result = compare(poses, noise=NOISE, methods=FEW)
    row = result["park"]
    assert (row.failure, row.X, row.xi, row.d2, row.agrees, row.seconds) == (text, None, None, None, None, None)
    assert result["tsai"].agrees
    assert f"park failed: {text}" in " ".join(result.to_text(verbose=True).split())
    assert "1 failed: park" in result.verdict
    assert text in result.to_csv()
    assert json.loads(result.to_json())["methods"][1]["failure"] == text


def test_a_method_without_its_extra_is_not_run(poses, monkeypatch):
    replaced(monkeypatch, "park", solver=Failing(MissingExtraError("pip install 'uq-handeye[sdp]'.")))
    result = compare(poses, noise=NOISE, methods=FEW)
    assert (result["park"].status, result["park"].X) == ("not run", None)
    assert "park not run: pip install 'uq-handeye[sdp]'." in " ".join(result.to_text(verbose=True).split())
    assert "1 not run: park" in result.verdict and "failed" not in result.verdict
    assert json.loads(result.to_json())["methods"][1]["status"] == "not run"


@pytest.mark.parametrize("error", [IndexError("out"), TypeError("none"), AssertionError()])
def test_a_fault_of_the_program_is_no_row(poses, monkeypatch, error):
    replaced(monkeypatch, "park", solver=Failing(error))
    with pytest.raises(type(error)):
        compare(poses, noise=NOISE, methods=FEW)


@pytest.mark.slow
def test_a_covariance_that_is_refused_leaves_x(poses, monkeypatch):
    original = module.calibrate

    def calibrate(data, *, method=None, noise=None, **options):
        if method == "park" and noise is not None:
            raise InputError("66 pairs are too many.")
        return original(data, method=method, noise=noise, **options)

    monkeypatch.setattr(module, "calibrate", calibrate)
    with pytest.warns(InputWarning, match="park: No covariance, hence no verdict: 66 pairs are too many"):
        result = compare(poses, noise=NOISE, methods=FEW)
    row = result["park"]
    assert (row.failure, row.covariance, row.agrees, row.converged) == (None, None, None, True)
    alone = uq.calibrate(poses, method="park")
    np.testing.assert_allclose(row.X, alone.X, atol=1e-12)
    assert (row.residuals, row.iterations) == (alone.residuals, alone.iterations)
    assert result.verdict == "2 of 2 methods agree with 4dpa at 95 %; 1 without covariance: park."


@pytest.mark.slow
def test_an_iteration_without_end_keeps_what_it_reached(poses, monkeypatch):
    X = uq.calibrate(poses, method="gwak").X
    partial = Estimate(X, np.array(False), np.array(100))
    replaced(monkeypatch, "gwak", raises(NotConvergedError("It did not converge.", partial)))
    result = compare(poses, noise=NOISE, methods=FEW)
    row = result["gwak"]
    np.testing.assert_array_equal(row.X, X)
    assert (row.converged, row.iterations, row.covariance, row.agrees) == (False, 100, None, None)
    assert row.failure == "It did not converge."
    assert row.difference_translation > 0
    assert row.residuals.pairs == 66
    assert "UNCONVERGED" in result.to_text(verbose=True)
    assert "\ngwak *  " in result.to_text(verbose=True) and "* not converged" in result.to_text(verbose=True)
    assert "It did not converge." in result.to_text(verbose=True)
    assert "1 did not converge: gwak" in result.verdict
    table = result.to_dataframe().set_index("method")
    assert not table.loc["gwak", "converged"]
    replaced(monkeypatch, "gwak", raises(NotConvergedError("It did not converge.")))
    assert compare(poses, noise=NOISE, methods=FEW)["gwak"].X is None


@pytest.mark.slow
@pytest.mark.parametrize("name", ["X", "covariance"])
def test_numbers_that_are_not_finite_are_a_failure(poses, monkeypatch, name):
    good = uq.calibrate(poses, noise=NOISE, method="park")
    bad = np.full_like(getattr(good, name), np.nan)
    replaced(monkeypatch, "park", lambda: dataclasses.replace(good, **{name: bad}))
    result = compare(poses, noise=NOISE, methods=FEW)
    assert "not finite" in result["park"].failure
    assert "nan" not in result.to_text(verbose=True).lower()


def test_reference_that_fails(poses, monkeypatch):
    replaced(monkeypatch, "4dpa", raises(DegenerateMotionError("No.", np.eye(6))))
    result = compare(poses, noise=NOISE, methods=FEW)
    assert (result.reference, result.requested_reference) == ("tsai", "4dpa")
    assert "4dpa gave no result: the reference is tsai" in result.to_text(verbose=True)
    assert result["tsai"].d2 == 0


def test_every_method_fails():
    X, A, _ = exact_motions(np.random.default_rng(0), 5)
    A[:, :3, :3] = np.eye(3)
    with pytest.warns(InputWarning) as caught:
        result = compare(uq.Motions(A, np.linalg.inv(X) @ A @ X))
    said = " ".join(str(one.message) for one in caught)
    assert "The robot does not rotate" in said and "the translation of X stays open" in said
    assert result.reference is None
    assert len(result.rows) == len(uq.METHODS)
    assert all(row.failure for row in result.rows)
    assert result.verdict == f"None of the {len(uq.METHODS)} methods gave a result."
    text = result.to_text(verbose=True)
    assert all(f"\n{name} " in text for name in uq.METHODS)
    assert "failed: like tsai" in text
    assert len(result.to_dataframe()) == len(uq.METHODS)
    json.loads(result.to_json(), parse_constant=no_constant)


@pytest.mark.slow
def test_reference_and_methods(poses):
    result = compare(poses, methods=["park", "tsai", "park"], reference="chou")
    assert [row.method for row in result.rows] == ["chou", "park", "tsai"]
    assert result.reference == "chou"
    assert [row.method for row in compare(poses, methods="park").rows] == ["4dpa", "park"]
    assert compare(poses, methods=["4dpa"], noise=NOISE).verdict == "4dpa alone, with nothing to compare."
    assert compare(poses, methods=["park"], noise=NOISE).verdict == "park agrees with 4dpa at 95 %."


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"data": "poses"}, "`data`.*got str"),
        ({"data": uq.simulate(2, seed=0)}, "at least 3 poses"),
        ({"methods": ["magic"]}, "`methods`.*4dpa.*'magic'"),
        ({"methods": [None]}, "`methods`.*None"),
        ({"reference": "magic"}, "`reference`.*'magic'"),
        ({"pairs": "some"}, "`pairs`.*'some'"),
        ({"noise": 0.1}, "`noise`.*float"),
        ({"noise": uq.PairNoise(np.eye(6)[None].repeat(3, 0), np.eye(6))}, "3"),
        ({"data": uq.Motions(np.eye(4)[None], np.eye(4)[None]), "noise": NOISE}, "PairNoise"),
        ({"data": uq.Motions(np.zeros((2, 5, 4, 4)) + np.eye(4), np.zeros((2, 5, 4, 4)) + np.eye(4))}, "batch"),
    ],
)
def test_refuses_what_no_method_could_use(poses, arguments, match):
    with pytest.raises(InputError, match=match):
        compare(**({"data": poses} | arguments))


@pytest.mark.slow
def test_without_noise(poses):
    result = compare(poses, methods=FEW)
    assert result.noise_estimated and not compare(poses, noise=NOISE, methods=FEW).noise_estimated
    estimated = uq.calibrate(poses).noise
    np.testing.assert_array_equal(result.noise.robot, estimated.robot)
    np.testing.assert_array_equal(result.noise.camera, estimated.camera)
    given = compare(poses, noise=estimated, methods=FEW)
    for row, other in zip(result.rows, given.rows, strict=True):
        np.testing.assert_array_equal(row.X, other.X)
        np.testing.assert_array_equal(row.covariance, other.covariance)
        assert (row.d2, row.agrees) == (other.d2, other.agrees)
    assert "noise estimated from them" in result.to_text(
        verbose=True
    ) and "noise estimated from them" not in given.to_text(verbose=True)
    assert json.loads(result.to_json())["noise_estimated"] is True


def test_exact_data_show_no_noise():
    result = compare(uq.simulate(12, seed=5), methods=FEW)
    assert (result.noise, result.noise_estimated) == (None, False)
    row = result["park"]
    assert (row.covariance, row.std, row.d2, row.agrees) == (None, None, None, None)
    assert row.difference_translation >= 0
    assert "cannot be said without noise" in result.verdict
    assert "+-" not in result.to_text(verbose=True)


@pytest.mark.slow
def test_the_noise_is_estimated_once(poses, monkeypatch):
    seen = []
    original = module.calibrate
    monkeypatch.setattr(
        module,
        "calibrate",
        lambda data, *, noise, **options: seen.append(noise) or original(data, noise=noise, **options),
    )
    result = compare(poses, methods=FEW)
    assert seen[0] is None and len(seen) == 1 + len(FEW)
    assert all(noise is result.noise for noise in seen[1:])


def test_motions_with_noise_of_pairs(rng):
    X, A, B = noisy_motions(rng, 30, sd=1e-4)
    noise = uq.PairNoise(1e-8 * np.eye(6), 1e-8 * np.eye(6))
    result = compare(uq.Motions(A, B), noise=noise, methods=FEW)
    assert (result.frame, result.setup, result.n_poses) == ("X", None, None)
    for row in result.rows:
        assert row.agrees
        np.testing.assert_allclose(row.X, X, atol=1e-3)


@pytest.mark.slow
def test_many_poses_share_spread_pairs(monkeypatch):
    poses = uq.simulate(210, noise=NOISE, seed=1)
    result = compare(poses, methods=("park", "4dpa"), noise=NOISE)
    assert result.n_pairs_available == 210 * 209 // 2
    assert 0.8 * 20_000 < result.n_pairs < 1.1 * 20_000
    motions = uq.relative_motions(poses, spread_pairs(210, 20_000))
    for row in result.rows:
        np.testing.assert_allclose(row.X, uq.solve(motions.A, motions.B, method=row.method), atol=1e-12)
        assert row.residuals.pairs == result.n_pairs
    assert "Of 21,945 pairs all methods used the same" in result.to_text(verbose=True)
    assert compare(poses, methods=["4dpa"], pairs="consecutive").n_pairs_available == 209


@pytest.mark.slow
def test_most_differ_points_to_the_central_method(poses, monkeypatch):
    good = uq.calibrate(poses, noise=NOISE, method="4dpa")
    off = moved(good.X, np.array([0, 0, 0, 0.01, 0, 0]))
    replaced(monkeypatch, "4dpa", lambda: dataclasses.replace(good, X=off))
    result = compare(poses, noise=NOISE, methods=(*FEW, "horaud"))
    assert result.verdict.startswith("0 of 4 methods agree")
    assert result.most_central[1] == 3
    assert f"agree with {result.most_central[0]}" in " ".join(result.to_text(verbose=True).split())


@pytest.mark.slow
def test_warnings_come_once(poses):
    with pytest.warns(InputWarning) as caught:
        result = compare(dataclasses.replace(poses, camera=poses.camera[::-1]), methods=("park", "chou"))
    texts = [str(warning.message) for warning in caught]
    assert len(texts) == len(set(texts)) == len(result.warnings) + len(result.own_warnings)
    assert any("No shift of the rows" in text for text in result.warnings)
    assert "CAUTION" in result.to_text(verbose=True)
    for text in texts:
        assert " ".join(text.split()) in " ".join(result.to_text(verbose=True).split())


def test_warnings_of_one_method_stay_with_it(poses, monkeypatch):
    good = uq.calibrate(poses, noise=NOISE, method="park")

    def act():
        warnings.warn("X is 3.5 m long.", InputWarning, stacklevel=2)
        return good

    replaced(monkeypatch, "park", act)
    with pytest.warns(InputWarning, match=r"^park: X is 3\.5 m long"):
        result = compare(poses, noise=NOISE, methods=FEW)
    assert (result.warnings, result["park"].warnings, result["tsai"].warnings) == ((), ("X is 3.5 m long.",), ())
    assert "park !" in result.to_text(verbose=True)


def undetermined(name, poses):
    """The error of calibrate() for a method whose first-order covariance means nothing."""
    good = uq.calibrate(poses, noise=NOISE, method=name)
    partial = dataclasses.replace(good, covariance=1e6 * good.covariance)
    return DegenerateMotionError("With this noise the motions do not determine X.", np.eye(6)[:1], partial)


@pytest.mark.slow
def test_an_undetermined_method_keeps_its_x(poses, monkeypatch):
    error = undetermined("park", poses)
    replaced(monkeypatch, "park", raises(error))
    result = compare(poses, noise=NOISE, methods=FEW)
    row = result["park"]
    np.testing.assert_array_equal(row.X, error.partial.X)
    np.testing.assert_array_equal(row.covariance, error.partial.covariance)
    assert (row.status, row.d2, row.agrees, row.residuals) == ("undetermined", None, None, error.partial.residuals)
    assert row.difference_translation > 0 and row.seconds > 0
    assert result.verdict == "2 of 2 methods agree with 4dpa at 95 %; 1 undetermined: park."
    text = result.to_text(verbose=True)
    assert "UNDETERMINED" in text and "\npark ?  " in text
    assert re.search(r"^ +With this noise the motions do not determine X\.$", text, re.MULTILINE)
    assert compare(poses, noise=NOISE, methods=("park", "tsai", "gwak", "4dpa")).most_central[0] != "park"
    assert json.loads(result.to_json())["methods"][1]["status"] == "undetermined"
    # it is no reference, and alone it is no result
    other = compare(poses, noise=NOISE, methods=FEW, reference="park")
    assert other.reference == "tsai" and "park gave no result to rely on: the reference is tsai" in other.to_text(
        verbose=True
    )
    alone = compare(poses, noise=NOISE, methods=["park"], reference="park")
    assert alone.reference is None
    assert alone.verdict == "park gave no result to rely on."
    assert "UNDETERMINED" in alone.to_text(verbose=True) and "\npark ?  " in alone.to_text(verbose=True)


@pytest.mark.slow
def test_failures_are_worded_for_a_table(poses, monkeypatch):
    partial = Estimate(uq.calibrate(poses, method="gwak").X, np.array(False), np.array(100))
    replaced(monkeypatch, "gwak", raises(NotConvergedError("It did not converge\nwithin 1e2 iterations.", partial)))
    replaced(monkeypatch, "park", raises(DegenerateMotionError("Parallel.", np.eye(6))))
    result = compare(poses, methods=FEW)
    assert result["gwak"].failure == "It did not converge within 1e2 iterations."
    assert result["park"].failure == "Parallel."
    replaced(monkeypatch, "tsai", solver=Failing(InputError("No.")))
    assert compare(poses, methods=["tsai"], reference="tsai").verdict == "tsai gave no result."


def test_no_advice_of_a_minority(poses, monkeypatch):
    """Three methods that all disagree with each other: none of them is recommended."""
    good = uq.calibrate(poses, noise=NOISE, method="4dpa")
    for k, name in enumerate(FEW):
        shifted = dataclasses.replace(good, X=moved(good.X, np.array([0, 0, 0, 0.01 * (k // 2), 0, 0])), method=name)
        replaced(monkeypatch, name, lambda shifted=shifted: shifted)
    result = compare(poses, noise=NOISE, methods=(*FEW[:3], "4dpa"), reference="gwak")
    assert result.most_central[1] == 1
    assert "--reference" not in result.to_text(verbose=True)


def test_progress_is_silent_without_a_terminal(poses, capfd):
    compare(poses, methods=FEW, progress=True)
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_lookup(everything):
    assert everything["park"].method == "park"
    assert repr(everything) == f"Comparison({len(uq.METHODS)} methods, reference 4dpa, 66 pairs)"
    assert repr(everything["4dpa"]) == "Row(4dpa 2019, agrees=True, 0 deg and 0 mm from the reference)"
    assert repr(Row("park", 1994, "", "", failure="No.")) == "Row(park 1994, failed)"
    assert "park" in everything and "magic" not in everything
    with pytest.raises(InputError, match=r"^Expected the name of a method compared, one of tsai, shiu"):
        everything["magic"]
    assert isinstance(everything, Comparison)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("noise", [None, NOISE], ids=["estimated", "given"])
@pytest.mark.parametrize("wrong", [False, True], ids=["good", "outlier"])
def test_the_reference_is_the_answer_of_calibrate(poses, noise, wrong):
    camera = poses.camera.copy()
    if wrong:
        camera[4] = moved(camera[4], np.array([0.3, 0, 0, 0.1, 0, 0]))
    poses = uq.PosePairs(poses.robot, camera)
    answer = uq.calibrate(poses, noise=noise)
    result = uq.compare(poses, noise=noise, methods=["park", "ml"])
    assert [row.method for row in result.rows] == ["efficient", "park", "ml"]
    assert result.reference == result.requested_reference == "efficient"
    np.testing.assert_array_equal(result["efficient"].X, answer.X)
    np.testing.assert_array_equal(result["efficient"].covariance, answer.covariance)
    # the others get the poses that count in it, and its noise
    weight = answer.table.weight
    assert result.n_poses == (weight > 0).sum() and result.n_pairs == result.n_pairs_available
    assert result.n_pairs == result.n_poses * (result.n_poses - 1) // 2
    used, noise = answer.used
    np.testing.assert_allclose(result["park"].X, uq.calibrate(used, noise=noise, method="park").X, atol=1e-9)
    if not wrong or (weight == 0).any():  # a gross error that counts is beyond first order
        assert (np.abs(result["ml"].xi) < 0.03 * answer.std).all()
        assert result["park"].agrees


@pytest.mark.slow
def test_all_methods_stand_beside_the_answer(poses):
    result = uq.compare(poses, noise=NOISE)
    assert [row.method for row in result.rows] == ["efficient", *uq.METHODS]
    assert "methods agree with efficient at 95 %" in result.verdict
    assert (result["efficient"].year, result["efficient"].to_dict()["year"]) == (None, None)
