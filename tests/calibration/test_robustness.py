"""Robustness of calibrate() to wrong detections, shifted rows, copies, garbage and options that do not fit."""

import contextlib
import json
import re
import warnings

import numpy as np
import pytest
from fixtures.rigs import NOISE, SETUPS, quietly, with_wrong
from scipy import stats
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline
from support import (
    SEED,
    difference,
    draw,
    mean_interval,
    moved,
    nees,
    random_transforms,
    transforms,
)

import uq_handeye as uq
from uq_handeye.fit.graph.gauss_helmert import bound, efficient

# ------------------------------------------------------------------------------------------------------- robustness


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"noise": NOISE, "robust": True}, {"method": "ml"}])
@pytest.mark.parametrize("setup", SETUPS)
def test_a_wrong_detection_is_found_and_named(options, setup):
    clean = uq.simulate(20, noise=NOISE, setup=setup, seed=SEED)
    data, rest = with_wrong(clean, 4), np.delete(np.arange(20), 4)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = uq.calibrate(data, **options)
    assert [str(warning.message) for warning in caught] == list(result.warnings)
    assert result.warnings[0].startswith("1 of 20 poses was rejected as an outlier: pose 4 (")
    assert result.table.rejected == [4] and result.table.weight[4] == 0 and result.table.flag[4] == "rejected"
    assert any("pose 4 (" in text for text in result.warnings)
    others = uq.PosePairs(clean.robot[rest], clean.camera[rest], setup)  # as recorded: nothing known of the arm
    reference = quietly(others, **{**options, "robust": False})
    shift = difference(result.X, reference.X)
    # 0: the good poses count in full; but for one in 1000 that is weighted down
    assert shift @ np.linalg.solve(reference.covariance, shift) < 0.5
    assert np.sqrt(nees(difference(result.X, clean.truth.X)[None], result.covariance))[0] < 6
    data_out = json.loads(result.to_json())
    assert data_out["poses"]["flag"][4] == "rejected" and any("pose 4 (" in text for text in data_out["warnings"])
    assert re.search(r"^  4 .* rejected$", result.summary(verbose=True), re.MULTILINE)
    assert result.to_dict()["n_poses"] == 20


def test_a_plain_fit_names_a_gross_error_and_keeps_it(poses):
    data = with_wrong(poses, 4)
    result = quietly(data, noise=NOISE, robust=False)
    np.testing.assert_allclose(result.X, efficient(data, NOISE).X, atol=1e-9)
    assert (result.table.weight == 1).all() and "outlier" in result.table.flag
    (text,) = [text for text in result.warnings if "robust=True" in text]
    assert text.startswith("1 of 20 poses is an outlier and biases X") and "pose 4 (" in text
    data = with_wrong(poses, 4, metres=0.2)
    spoilt, robust = (
        nees(difference(quietly(data, noise=NOISE, robust=r).X, poses.truth.X)[None], bound(poses, NOISE))[0]
        for r in (False, True)
    )
    assert robust < stats.chi2.ppf(0.9999, 6) < spoilt / 5


@pytest.mark.slow
def test_clean_data_are_silent_and_whole():
    """Nobody is rejected without a word: table, warnings and JSON tell the same."""
    silent = 0
    for seed in range(10):
        result = quietly(uq.simulate(20, noise=NOISE, seed=np.random.default_rng([SEED, seed])))
        flagged = result.table.flagged
        assert [k for k, w in enumerate(result.table.weight) if w < 1] == flagged
        for k in flagged:  # one that chance may have made is a note
            assert any(f"pose {k} (" in str(finding) for finding in result.findings)
        assert json.loads(result.to_json())["warnings"] == list(result.warnings)
        silent += not result.warnings
    # 20 poses at one in 1000, and a few tests at one in 1000
    assert silent >= stats.binom.ppf(0.0005, 10, 0.95)


def smooth(n, rng, every=12, still=0):
    """A smooth path with noise, ``every`` poses from one view to the next; ``still`` poses at rest at its start."""
    key = uq.simulate(n // every + 4, seed=rng)
    knots = np.arange(len(key))
    frames = np.clip((np.arange(n) - still) / every, 0, None)
    R = RotationSpline(knots, Rotation.from_matrix(key.robot[:, :3, :3]))(frames).as_matrix()
    robot = transforms(R, CubicSpline(knots, key.robot[:, :3, 3])(frames))
    camera = np.linalg.inv(robot @ key.truth.X) @ key.truth.W
    return uq.PosePairs(moved(robot, draw(rng, NOISE.robot, (n,))), moved(camera, draw(rng, NOISE.camera, (n,))))


@pytest.mark.slow
@pytest.mark.parametrize("noise", [None, NOISE])
@pytest.mark.parametrize("still", [0, 15])
def test_a_shifted_pairing_is_said(noise, still):
    poses = smooth(90, np.random.default_rng(SEED), still=still)
    shifted = uq.PosePairs(poses.robot, np.roll(poses.camera, 1, axis=0))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result = uq.calibrate(shifted, noise=noise)
        except (uq.InputError, uq.NotConvergedError):
            result = None
    texts = [str(warning.message) for warning in caught]
    assert any("robot row i belongs to camera row i + 1" in text for text in texts), texts
    if result is not None:
        assert list(result.warnings) == texts
    assert not any("belongs to camera row" in text for text in quietly(poses, noise=noise).warnings)


@pytest.mark.slow
def test_static_views_rolled_by_one_are_said(poses):
    shifted = uq.PosePairs(poses.robot, np.roll(poses.camera, 1, axis=0))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with contextlib.suppress(uq.InputError, uq.NotConvergedError):
            assert not uq.calibrate(shifted).usable
    texts = [str(warning.message) for warning in caught]
    assert any("robot row i belongs to camera row i + 1" in text for text in texts), texts


# ---------------------------------------------------------------------------------------------------------- garbage


def garbage():
    poses = uq.simulate(20, noise=NOISE, seed=SEED)
    rng = np.random.default_rng(SEED)
    robot, camera = poses.robot, poses.camera

    def scaled(T, factor):
        T = T.copy()
        T[:, :3, 3] *= factor
        return T

    turned = Rotation.from_matrix(camera[:, :3, :3]).as_quat()
    reordered = camera.copy()
    reordered[:, :3, :3] = Rotation.from_quat(np.roll(turned, 1, axis=1)).as_matrix()
    still = np.tile(robot[:1], (20, 1, 1))
    return {
        "camera times 10": (robot, scaled(camera, 10)),
        "camera over 10": (robot, scaled(camera, 0.1)),
        "robot in mm": (scaled(robot, 1000), camera),
        "camera in mm": (robot, scaled(camera, 1000)),
        "inverse camera": (robot, np.linalg.inv(camera)),
        "inverse robot": (np.linalg.inv(robot), camera),
        "quaternion order": (robot, reordered),
        "no relation": (robot, random_transforms(rng, (20,))),
        "all random": (random_transforms(rng, (20,)), random_transforms(rng, (20,))),
        "permuted": (robot, camera[rng.permutation(20)]),
        "same file": (robot, robot),
        "robot at rest": (still, camera),
        "both at rest": (still, np.tile(camera[:1], (20, 1, 1))),
    }


@pytest.mark.slow
@pytest.mark.parametrize("noise", [None, NOISE])
@pytest.mark.parametrize("name", garbage())
def test_garbage_is_an_error_or_a_warning(name, noise):
    data = uq.PosePairs(*garbage()[name])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result = uq.calibrate(data, noise=noise)
        except (uq.InputError, uq.NotConvergedError) as error:
            result, refusal = None, str(error)
    if result is None:
        assert len(refusal) > 40 and "nan" not in refusal.lower().split()
        return
    assert {warning.category for warning in caught} == {uq.InputWarning}
    assert result.warnings
    for value in (result.X, result.covariance, result.W, result.covariance_W, result.bound):
        assert value is None or np.isfinite(value).all()
    result.to_json()  # which refuses NaN


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("camera times 10", r"multiplied by 0\.(0999|1)"),
        ("camera over 10", r"multiplied by (9\.99|10)"),
        ("robot in mm", "--units robot=mm"),
        ("camera in mm", "--units camera=mm"),
        ("inverse camera", "camera file holds inverse poses"),
        ("inverse robot", "the setup is eye-to-hand, or the robot file holds inverse poses"),
        ("quaternion order", "scalar of the quaternion first"),
        ("same file", "same file was given twice"),
    ],
)
@pytest.mark.parametrize("noise", [None, NOISE])
def test_garbage_comes_with_a_hint(name, hint, noise):
    """Also where it ends in an error: what looks wrong is warned of first."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            uq.calibrate(uq.PosePairs(*garbage()[name]), noise=noise)
        except (uq.InputError, uq.NotConvergedError) as error:
            caught_error = str(error)
        else:
            caught_error = ""
    said = " ".join([*(str(warning.message) for warning in caught), caught_error])
    if name == "quaternion order" and noise is None:
        # noise that is estimated puts all of it down to the rotations: translations alone give X, and it is right
        assert "X does not explain the poses: the target seems to move by" in said
    else:
        assert re.search(hint, said), said


# ----------------------------------------------------------------------------------------- requests, copies, drift


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"robust": "yes"}, "`robust` to be True, False or None, got 'yes'"),
        ({"robust": 1}, "`robust`"),
        ({"seed": -1}, "`seed` to be an integer of at least 0, got -1"),
        ({"seed": "a"}, "`seed`.*'a'"),
        ({"seed": True}, "`seed`"),
        ({"seed": 1.0}, "`seed`"),
        ({"noise": None, "prior": (1, 2)}, "`prior` to be a NoisePrior or None, got tuple"),
        ({"noise": "1mm"}, "`noise` to be PoseNoise, PairNoise or None, got str"),
        ({"method": "efficient", "noise": uq.PoseNoise.isotropic(camera=("1mrad", "0mm"))}, "residuals exact"),
        ({"robust": True, "noise": uq.PoseNoise.isotropic(camera=("1mrad", "0mm"))}, "residuals exact"),
    ],
)
def test_refuses_options_of_a_wrong_type(poses, options, message):
    with pytest.raises(uq.InputError, match=message):
        quietly(poses, **({"noise": NOISE} | options))


def test_numpy_numbers_are_numbers(poses):
    assert quietly(poses, noise=NOISE, robust=np.bool_(True), seed=np.int64(3)).table is not None


@pytest.mark.slow
@pytest.mark.parametrize("rows", [[*range(22), *range(18)], [*range(20)] * 2])
@pytest.mark.parametrize("noise", [None, NOISE])
def test_copied_rows_are_an_answer_and_accuse_nobody(rows, noise):
    poses = uq.simulate(22, noise=NOISE, seed=SEED)
    found = quietly(uq.PosePairs(poses.robot[rows], poses.camera[rows]), noise=noise, robust=True)
    assert len(found.table.flagged) <= 2 and not found.table.rejected
    xi = difference(found.X, poses.truth.X)
    assert xi @ np.linalg.solve(found.covariance, xi) / 2 < found.quantile(0.999)  # a copy counts as a pose


@pytest.mark.slow
def test_plain_where_most_poses_do_not_determine_x(poses, monkeypatch):
    """The robust fit cannot; the plain one can, and says that wrong poses were not looked for."""

    def refuse(*_, **__):
        raise uq.DegenerateMotionError("the poses that agree are still", np.eye(6))

    for module in ("calibration.by_likelihood", "fit.graph.weighing"):
        monkeypatch.setattr(f"uq_handeye.{module}.fit_robustly", refuse)
    with pytest.warns(uq.InputWarning) as said:
        found = uq.calibrate(poses)
    assert any("Outlier rejection was skipped" in str(warning.message) for warning in said)
    assert found.provenance.options["robust"] is False
    plain = quietly(poses, robust=False)
    np.testing.assert_array_equal(found.X, plain.X)
    assert any(text.startswith("Outlier rejection was skipped") for text in found.warnings)
    with pytest.raises(uq.DegenerateMotionError, match="are still"):
        quietly(poses, robust=True)
    with pytest.raises(uq.DegenerateMotionError, match="are still"):  # a wrong pose shows in the plain fit
        quietly(with_wrong(uq.simulate(30, noise=NOISE, seed=SEED), 3, 2.0))


def test_halves_that_contradict_each_other_are_found_and_their_cause_is_named():
    noise = uq.PoseNoise.isotropic(robot=("0.05mrad", "0.05mm"), camera=("0.2mrad", "0.2mm"))
    clean = uq.simulate(40, noise=noise, seed=[SEED, 9])
    X, camera = clean.truth.X, clean.camera.copy()
    camera[20:] = np.linalg.inv(moved(X, np.array([0, 0, 0, 0, 0, 2e-3]))) @ X @ camera[20:]  # slips in its bracket
    found = quietly(uq.PosePairs(clean.robot, camera), noise=noise)
    assert found.split_in_time.p_value < 1e-3 and found.split_in_time.finding.severity == "caution"
    assert "The camera moved from robot pose 20 on, by " in found.warnings[0] and not found.usable
    assert found.split_in_time is found.analysis.split_in_time
    whole = quietly(clean, noise=noise)
    assert whole.split_half.possible and not any("two halves" in text for text in whole.warnings)


def test_a_data_sheet_that_is_wrong_in_one_part_says_which():
    poses = uq.simulate(40, noise=uq.PoseNoise.isotropic(camera=("1mrad", "0.1mm")), seed=SEED)
    found = quietly(poses, prior=uq.NoisePrior(robot=(0, 0), camera=("1mrad", "1mm"), factor=1))
    said = [text for text in found.warnings if "of the data sheet" in text]
    assert len(said) == 1 and re.search(r"those in translation \d+(\.\d+)? times smaller than", said[0])
    assert found.fit.translation_sigma0 < 0.5


# ------------------------------------------------------------------------------------- robust by default, noise given


@pytest.mark.slow
def test_outliers_are_down_weighted_with_noise_given():
    """One wrong pose of 15: X is as good as without it, and the result says what was done."""
    d2 = []
    for seed in range(20):
        poses = uq.simulate(15, noise=NOISE, seed=np.random.default_rng([SEED, 15, seed]))
        found = quietly(with_wrong(poses, 4, 0.02), noise=NOISE)
        assert found.table.rejected == [4] and found.provenance.options["robust"] is True
        assert any("was rejected as an outlier: pose 4 (" in text for text in found.warnings)
        d2.append(nees(difference(found.X, poses.truth.X)[None], found.covariance)[0])
    low, high = mean_interval(20)
    assert low < np.mean(d2) < high
    plain = quietly(with_wrong(poses, 4, 0.02), noise=NOISE, robust=False)
    assert nees(difference(plain.X, poses.truth.X)[None], plain.covariance)[0] > 100
    assert plain.provenance.options["robust"] is False


@pytest.mark.slow
def test_clean_data_with_noise_given_stay_consistent():
    """X is the plain one if no pose is flagged; over many sets its covariance is that of its errors."""
    d2, flagged = [], 0
    for seed in range(60):
        poses = uq.simulate(12, noise=NOISE, setup=SETUPS[seed % 2], seed=np.random.default_rng([SEED, 12, seed]))
        found = quietly(poses, noise=NOISE)
        if found.table.flagged:
            flagged += 1
        else:
            plain = quietly(poses, noise=NOISE, robust=False)
            np.testing.assert_array_equal(found.X, plain.X)
            np.testing.assert_array_equal(found.covariance, plain.covariance)
        d2.append(nees(difference(found.X, poses.truth.X)[None], found.covariance)[0])
    low, high = mean_interval(60)
    assert low < np.mean(d2) < high
    assert flagged <= stats.binom.ppf(0.9995, 60, 1 - 0.999**12)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [4.0, 10.0])
def test_noise_given_too_small_is_said_and_rejects_nobody(factor):
    poses = uq.simulate(30, noise=NOISE, seed=SEED)
    small = uq.PoseNoise(NOISE.robot / factor**2, NOISE.camera / factor**2)
    found, plain = (quietly(poses, noise=small, robust=robust) for robust in (None, False))
    assert not found.table.rejected and len(found.table.flagged) <= 1
    assert 0.7 * factor < found.table.scale < 1.4 * factor
    assert any("The noise given is too small" in text for text in found.warnings)
    assert any("than the noise given explains" in text or "the noise given explains" in text for text in plain.warnings)
    assert found.fit.p_value < 1e-6
    shift = difference(found.X, plain.X)
    assert shift @ np.linalg.solve(plain.covariance, shift) < 0.1 * factor**2


def test_four_poses_count_in_full():
    poses = uq.simulate(4, noise=NOISE, seed=SEED)
    found = quietly(poses, noise=NOISE)
    assert found.provenance.options["robust"] is False and (found.table.weight == 1).all()


def test_what_was_recorded_can_be_repeated(poses, monkeypatch):
    """After the fall back to the plain fit too."""

    def refuse(*_, **__):
        raise uq.NotConvergedError("weights take turns", None)

    for module in ("calibration.by_likelihood", "fit.graph.weighing"):
        monkeypatch.setattr(f"uq_handeye.{module}.fit_robustly", refuse)
    found = quietly(poses, noise=NOISE)
    assert found.provenance.options["robust"] is False
    assert found.warnings[0].startswith("Outlier rejection failed") and "weights take turns" in found.warnings[0]
    np.testing.assert_array_equal(found.X, quietly(poses, noise=NOISE, robust=False).X)
    for options in ({"noise": NOISE, "robust": True}, {}):
        with pytest.raises(uq.NotConvergedError, match="take turns"):
            quietly(poses, **options)


@pytest.mark.slow
@pytest.mark.parametrize("n", [5, 6, 7])
@pytest.mark.parametrize("gross", [False, True])
def test_few_poses_are_not_refused_and_their_outlier_is_named(n, gross):
    """The noise of the others is too uncertain to judge one of so few rows by it."""
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    found = 0
    for seed in range(12):
        poses = uq.simulate(n, noise=noise, seed=[SEED, n, seed])
        camera = poses.camera.copy()
        camera[seed % n, :3, 3] += 0.02 * gross
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)
            result = uq.calibrate(uq.PosePairs(poses.robot, camera))
        found += (result.table.weight < 1).nonzero()[0].tolist() == [seed % n]
    assert found >= 10 if gross else found <= 1


@pytest.mark.slow
@pytest.mark.parametrize(("n", "wrong"), [(8, 3), (10, 4), (12, 4), (20, 6)])
def test_several_outliers_do_not_hide_in_the_noise_that_they_make(n, wrong):
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    right = 0
    for seed in range(6):
        poses = uq.simulate(n, noise=noise, setup="eye-to-hand", seed=[SEED, n, seed])
        away = np.random.default_rng([SEED, seed]).normal(size=(wrong, 3))
        camera = poses.camera.copy()
        camera[:wrong, :3, 3] += 0.02 * away / np.linalg.norm(away, axis=1, keepdims=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)
            weight = uq.calibrate(uq.PosePairs(poses.robot, camera, "eye-to-hand")).table.weight
        right += (weight[:wrong] == 0).all() and (weight[wrong:] > 0).sum() >= n - wrong - 1
    assert right >= 5
