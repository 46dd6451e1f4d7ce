"""The poses in a result file: exact, checked, and enough for all that a result in memory can do."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from fixtures.rigs import NOISE, PAIR_NOISE, motions_alone, quietly, with_wrong
from support import SEED

import uq_handeye as uq
from studies.camera_covariance import ROBOT, poses_of, recorded
from uq_handeye.core.files.packed import unpacked
from uq_handeye.core.files.source import Source
from uq_handeye.core.presentation.figure_parts import canvas
from uq_handeye.errors import InputError
from uq_handeye.model.camera.calibration_files import camera_to_dict
from uq_handeye.model.camera.stored_calibration import camera_from_dict
from uq_handeye.model.poses.timing import Timing
from uq_handeye.report.comparison.compare import compare_result
from uq_handeye.report.page import report_html
from uq_handeye.use.planning.plan import plan


def with_everything():
    """Poses with timestamps, joints, an offset between clocks, sources, and one outlier."""
    poses = with_wrong(uq.simulate(14, noise=NOISE, setup="eye-to-hand", seed=SEED), 4)
    rng = np.random.default_rng(1)
    return replace(
        poses,
        truth=None,
        timestamps=np.cumsum(rng.uniform(0.1, 1.0, 14)),
        joints=rng.normal(size=(14, 6)),
        timing=Timing(0.01, 1e-3, rng.normal(size=(14, 6)), "robot"),
        sources=(Source("robot.csv", "csv", 120, 64 * "a", ("poses in mm",)),),
    )


@pytest.fixture(scope="module")
def from_corners():
    corners, robot, _ = recorded(np.random.default_rng(11), 12)
    return quietly(poses_of(corners, robot))


def stored(result):
    return uq.Calibration.from_dict(json.loads(result.to_json()))


def same(one, other):
    """Return whether all parts of two data sets are equal, bit by bit."""
    if isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, other)
    elif hasattr(one, "__dataclass_fields__") and not isinstance(one, Source):
        assert type(one) is type(other)
        for name in one.__dataclass_fields__:
            if name not in ("window", "candidates", "findings", "pattern", "board_pattern", "image_size"):
                same(getattr(one, name), getattr(other, name))
    else:
        assert one == other


@pytest.mark.slow
def test_a_board_of_estimated_shape_is_stored(from_corners):
    """Its coefficients have no standard deviation beforehand, which JSON cannot say as a number."""
    seen = from_corners.data.camera_calibration
    cam = uq.calibrate_camera(seen.corners, seen.image_size, model="pinhole", shape="bow2")
    assert np.isinf(cam.bundle.shape.sd).all()
    text = json.dumps(camera_to_dict(cam), allow_nan=False)
    same(cam.bundle.shape, camera_from_dict(json.loads(text), cam.poses).bundle.shape)


@pytest.mark.slow
def test_poses_are_stored_exactly(from_corners):
    poses = with_everything()
    motions = uq.relative_motions(uq.simulate(8, noise=NOISE, seed=2), "disjoint")
    motions = replace(motions, poses=replace(motions.poses, truth=None))
    for result in (
        quietly(poses, noise=NOISE),
        quietly(poses),
        quietly(poses, noise=NOISE, method="park"),
        quietly(motions, noise=PAIR_NOISE),
        quietly(motions_alone()[1]),
        from_corners,
    ):
        again = stored(result)
        same(result.data, again.data)
        assert again.to_json() == result.to_json()
    assert from_corners.data.camera_calibration.findings == stored(from_corners).data.camera_calibration.findings


def test_the_hash_is_that_of_the_poses_given():
    result = quietly(with_everything(), noise=NOISE)
    data = result.to_dict()
    assert data["data"]["sha256"] == data["provenance"]["data_sha256"]


@pytest.mark.slow
@pytest.mark.parametrize("case", ["outlier", "corners"])
def test_the_report_of_a_file_is_that_of_the_result(case, from_corners, monkeypatch):
    """Byte by byte, with figures and two methods beside it; ellipses, which need no poses, take longest."""
    two = {name: uq.METHODS[name] for name in ("park", "tsai")}
    monkeypatch.setattr("uq_handeye.report.comparison.compare.METHODS", two)
    monkeypatch.setattr("uq_handeye.report.figures.covariance_ellipses", lambda *_, **__: canvas(1.0))
    result = {
        "outlier": lambda: quietly(with_everything(), prior=uq.NoisePrior(robot=(None, "0.05mm"))),
        "corners": lambda: from_corners,
    }[case]()
    again = stored(result)
    one, other = (report_html(of, comparison=compare_result(of), date="some day") for of in (result, again))
    assert one == other and "<td>tsai" in one.replace('<th scope="row">', "<td>")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_what_needs_poses_works_from_a_file(from_corners):
    result = quietly(with_everything())
    again = stored(result)
    for one, other in zip(result.used, again.used, strict=True):
        np.testing.assert_array_equal(one.robot, other.robot)
    one, other = (uq.monte_carlo(of, method="efficient", trials=20, seed=0) for of in (result, again))
    np.testing.assert_array_equal(one.errors, other.errors)
    one, other = (uq.cross_check(of, trials=100, posterior=False, seed=0) for of in (result, again))
    np.testing.assert_array_equal(one.rows[0].covariance, other.rows[0].covariance)
    data, noise = stored(quietly(uq.simulate(8, noise=NOISE, seed=3), noise=NOISE)).used
    assert len(plan(data, k=1, noise=noise, sample=20).robot) == 1
    known = replace(from_corners.data, truth=None)
    ahead = [of.predict_camera(robot=known.robot[:3]) for of in (from_corners, stored(from_corners))]
    np.testing.assert_array_equal(ahead[0].poses, ahead[1].poses)
    np.testing.assert_allclose(ahead[0].covariance, ahead[1].covariance, rtol=1e-9)
    one, other = (quietly(of.data, noise=uq.PoseNoise(robot=ROBOT)) for of in (from_corners, stored(from_corners)))
    np.testing.assert_allclose(one.X, other.X, rtol=0, atol=1e-12)


def test_a_file_without_poses_is_read_and_says_so():
    data = quietly(uq.simulate(8, noise=NOISE, seed=1), noise=NOISE).to_dict()
    del data["data"]
    result = uq.Calibration.from_dict(data)
    assert result.data is None and "data" not in result.to_dict()
    with pytest.raises(InputError, match="no poses: its file holds none"):
        uq.monte_carlo(result)
    assert "holds no poses" in compare_result(result).reason


def changed(part, *path, to):
    """``part`` with one entry replaced, or removed where ``to`` is KeyError."""
    copy = json.loads(json.dumps(part))
    at = copy
    for name in path[:-1]:
        at = at[name]
    if to is KeyError:
        del at[path[-1]]
    else:
        at[path[-1]] = to
    return copy


DAMAGE = {
    "a number changed": (("robot", 3, 0, 3), 0.5),
    "hash changed": (("sha256",), 64 * "0"),
    "no hash": (("sha256",), KeyError),
    "no camera": (("camera",), KeyError),
    "one pose less": (("camera",), [np.eye(4).tolist()]),
    "no poses": (("robot",), []),
    "text": (("robot",), "many"),
    "ragged": (("robot", 2), [[1.0]]),
    "times": (("timestamps",), [1.0]),
    "times twice": (("timestamps",), 14 * [1.0]),
    "joints": (("joints",), [[0.0]]),
    "joints of none": (("joints",), []),
    "timing": (("timing", "rate"), [[0.0]]),
    "timing of no side": (("timing", "side"), "tool"),
    "std": (("timing", "std"), -1.0),
}


@pytest.fixture(scope="module")
def whole():
    return unpacked(json.loads(quietly(with_everything(), noise=NOISE).to_json()))


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_poses_are_refused(whole, damage):
    path, to = DAMAGE[damage]
    with pytest.raises(InputError, match="damaged"):
        uq.Calibration.from_dict(whole | {"data": changed(whole["data"], *path, to=to)})


@pytest.mark.slow
def test_poses_of_another_result_are_refused(whole, from_corners):
    for other in (quietly(uq.simulate(9, noise=NOISE, seed=1), noise=NOISE), quietly(motions_alone()[1]), from_corners):
        with pytest.raises(InputError, match="damaged"):
            uq.Calibration.from_dict(whole | {"data": other.to_dict()["data"]})
    left = [np.diag([1.0, 1, -1, 1]).tolist()] * 14
    with pytest.raises(InputError, match="damaged"):
        uq.Calibration.from_dict(whole | {"data": whole["data"] | {"robot": left}})
    for part in ("data", [], 3, "x"), ("data", {"A": [], "B": []}):
        for value in part[1:]:
            with pytest.raises(InputError, match="damaged"):
                uq.Calibration.from_dict(whole | {"data": value})


CAMERA_DAMAGE = {
    "pixels": (("seen", "pixels"), [[0.0, 0.0]]),
    "a far corner": (("seen", "pixels", 0), [1e6, 1e6]),
    "no such point": (("seen", "point", 0), 100_000),
    "half a point": (("seen", "point", 0), 0.5),
    "left out": (("seen", "left_out"), [-1]),
    "names": (("seen", "names"), []),
    "weights": (("arrays", "weights", 0), -1.0),
    "covariance": (("arrays", "covariance", 0, 1), 1.0),
    "parameters": (("arrays", "parameters", 0), 1.0),
    "model": (("model",), "telescope"),
    "no arrays": (("arrays",), KeyError),
    "format": (("format",), "other"),
}


@pytest.mark.slow
@pytest.mark.parametrize("damage", CAMERA_DAMAGE)
def test_a_damaged_camera_calibration_is_refused(from_corners, damage):
    data = from_corners.to_dict()
    path, to = CAMERA_DAMAGE[damage]
    if damage == "names":
        to = ["one"]
    camera = changed(data["data"]["camera_calibration"], *path, to=to)
    with pytest.raises(InputError, match=r"damaged: data\.camera_calibration is damaged"):
        uq.Calibration.from_dict(data | {"data": data["data"] | {"camera_calibration": camera}})


@pytest.mark.slow
def test_lists_of_numbers_take_one_line():
    """File of 30 poses: smaller than one number to a line made it without the poses."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        result = uq.calibrate(uq.simulate(30, noise=NOISE, seed=1))
    text = result.to_json()
    plain = result.to_dict()
    written = json.loads(text)
    del written["checksum"]
    assert unpacked(written) == json.loads(json.dumps(plain))
    del plain["data"]
    assert len(text) < len(json.dumps(plain, indent=2))
