"""Camera noise by geometry: derivatives, the that of corners, consistency, pixel noise, input that does not fit."""

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from scipy import stats
from support import assert_same_covariance

import uq_handeye as uq
from studies.camera_covariance import PIXEL, ROBOT, board, error, poses_of, recorded
from uq_handeye.core.geometry.se3 import inverse, perturb
from uq_handeye.errors import InputError
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.model.camera.intrinsics_file import KnownIntrinsics
from uq_handeye.model.shared_errors.assumed import default_errors
from uq_handeye.model.shared_errors.camera_noise import _derivatives, lens_of

K = np.array([[1100.0, 0, 640], [0, 1090, 470], [0, 0, 1]])
POINTS = board()


def calibrate(*args, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return uq.calibrate(*args, **options)


def finished(rng, n=15, model="brown", **options):
    """Finished poses, made from corners that are thrown away, the rounded camera matrix and the true X."""
    corners, robot, X = recorded(rng, n, model=model, **options)
    with_corners = poses_of(corners, robot, model)
    seen = with_corners.camera_calibration
    rounded = [round(seen.intrinsics[name], -1) for name in ("fx", "fy", "cx", "cy")]
    return uq.PosePairs(with_corners.robot, with_corners.camera), rounded, X, seen


@pytest.fixture(scope="module")
def views():
    return finished(np.random.default_rng(5))


def squared(X, covariance, truth):
    off = error(X, truth)
    return float(off @ np.linalg.solve(covariance, off))


def test_the_derivatives_are_those_of_symbols_and_of_differences(views):
    poses, _, _, _ = views
    C = poses.camera[:2]
    A, B = _derivatives(lens_of(K, None), C, POINTS)

    fx, fy, cx, cy = lens = sp.symbols("fx fy cx cy")
    theta, tau = sp.Matrix(sp.symbols("a:3")), sp.Matrix(sp.symbols("b:3"))
    turned, t = sp.Matrix(sp.symbols("p:3")), sp.Matrix(sp.symbols("t:3"))
    x, y, z = turned + theta.cross(turned) + tau + t
    pixel = sp.Matrix([fx * x / z + cx, fy * y / z + cy])
    at_zero = dict.fromkeys([*theta, *tau], 0)
    by = [sp.lambdify([*lens, *turned, *t], pixel.jacobian(of).subs(at_zero)) for of in (lens, [*theta, *tau])]
    for i, T in enumerate(C):
        for j in (0, 20, 53):
            values = [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *(T[:3, :3] @ POINTS[j]), *T[:3, 3]]
            np.testing.assert_allclose(A[i, 2 * j : 2 * j + 2], by[0](*values), rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(B[i, 2 * j : 2 * j + 2], by[1](*values), rtol=1e-12, atol=1e-9)

    def pixels(T):
        seen = (POINTS @ T[:3, :3].T + T[:3, 3]) @ K.T
        return (seen[:, :2] / seen[:, 2:]).ravel()

    for k, h in enumerate(1e-6 * np.eye(6)):
        found = (pixels(perturb(C[0], h)) - pixels(perturb(C[0], -h))) / 2e-6
        np.testing.assert_allclose(B[0, :, k], found, rtol=1e-6, atol=1e-3)


def test_it_is_the_covariance_of_the_corners_without_the_corners(rng):
    """The reference is a bundle adjustment with all pictures alike: only camera matrix, board and poses are known
    here.
    """
    poses, rounded, _, seen = finished(rng, 12)
    k = [seen.intrinsics[name] for name in ("fx", "fy", "cx", "cy")]
    found = uq.camera_noise(poses, POINTS, k, pixel_sd=seen.pixel_noise).covariance()
    own = seen.bundle.own * seen.bundle.weights[:, None, None]
    for one, other in zip(found.own, own, strict=True):
        assert_same_covariance(one, other, 0.1)
    variances = [np.diagonal(S.shared @ S.shared.mT, axis1=1, axis2=2) for S in (found, seen.covariance)]
    assert np.median(variances[0] / variances[1]) == pytest.approx(1, abs=0.25)
    # What X gets of it, and with a focal length that is rounded
    for matrix in (k, rounded):
        found = uq.camera_noise(poses, POINTS, matrix, pixel_sd=seen.pixel_noise).covariance()
        with_views, with_corners = (efficient(poses, uq.PoseNoise(ROBOT, S)) for S in (found, seen.covariance))
        ratio = np.sqrt(np.diag(with_views.covariance_X) / np.diag(with_corners.covariance_X))
        np.testing.assert_allclose(ratio, 1, atol=0.12)


def test_the_intrinsics_as_a_prior(views):
    """Exact ones share nothing; a prior adds G Sigma G^T, whatever the pixel noise; f moves all along z."""
    poses, rounded, _, _ = views
    exact = uq.camera_noise(poses, POINTS, rounded, "exact")
    assert exact.joint.shared.shape[-1] == 0 and not exact.scales.any()
    prior = np.diag([4.0, 4, 1, 1])
    noise = uq.camera_noise(poses, POINTS, rounded, prior)
    assert noise.joint.shared.shape[-1] == 4 and not noise.scales.any()
    one, three = noise.covariance(0.1), noise.covariance(0.3)
    np.testing.assert_array_equal(one.shared, three.shared)
    np.testing.assert_allclose(9 * one.own, three.own, rtol=1e-12)
    estimated = uq.camera_noise(poses, POINTS, rounded)
    assert estimated.scales.all() and len(estimated.scales) == 8
    np.testing.assert_allclose(3 * estimated.covariance(0.1).shared, estimated.covariance(0.3).shared, rtol=1e-12)

    f = rounded[0]
    along = uq.camera_noise(poses, POINTS, (f, f, *rounded[2:]), [[(0.01 * f) ** 2]]).covariance(0.1).shared
    assert along.shape == (poses.n, 6, 1)
    middle = poses.camera[:, 2, 3] + poses.camera[:, 2, :3] @ POINTS.mean(axis=0)
    np.testing.assert_allclose(np.abs(along[:, 5, 0]), 0.01 * middle, rtol=0.35)

    known = KnownIntrinsics(
        dict(zip(("fx", "fy", "cx", "cy"), zip(rounded, (2, 2, 1, 1), strict=True), strict=True)), None, None
    )
    np.testing.assert_allclose(uq.camera_noise(poses, POINTS, known).joint.shared, noise.joint.shared)


def test_of_a_calibrated_camera_it_takes_model_and_covariance(views):
    poses, _, _, seen = views
    noise = uq.camera_noise(poses, POINTS, seen)
    assert len(noise.scales) == len(seen.estimated) and not noise.scales.any()
    other = seen.covariance  # of the same pictures: not the same, as corners pull poses and intrinsics together
    assert noise.joint.shared.shape == other.shared.shape


def test_robot_noise_beside_an_unknown_pixel_noise_is_that_of_all_noise(views):
    poses, matrix, _, _ = views
    noise = uq.camera_noise(poses, POINTS, matrix)
    beside, both = uq.estimate_robot_noise(poses, noise), uq.estimate_noise(poses, camera=noise)
    for found, other in zip(beside.components, both.components, strict=True):
        assert found.key == other.key
        assert found.size == pytest.approx(other.size, rel=1e-2)  # the sizes end where a step gains nothing


@pytest.mark.statistical
def test_errors_are_consistent_and_with_exact_intrinsics_they_are_not():
    """X of finished poses, robot and pixel noise estimated: d^2 of 24 rigs; exact intrinsics are rejected."""
    sets = 24
    p, d2 = [], []
    for seed in range(sets):
        poses, rounded, X, _ = finished(np.random.default_rng([17, seed]))
        result = calibrate(poses, noise=uq.camera_noise(poses, POINTS, rounded), shared=list(default_errors(True)))
        p.append(result.reference.p_value(squared(result.X, result.covariance, X)))
        found = efficient(
            poses, uq.PoseNoise(ROBOT, uq.camera_noise(poses, POINTS, rounded, "exact", pixel_sd=PIXEL).covariance())
        )
        d2.append(squared(found.X, found.covariance_X, X))
    assert stats.kstest(p, "uniform").pvalue > 1e-3, sorted(p)
    assert np.median(d2) > 3 * stats.chi2.median(6)


@pytest.mark.slow
def test_pixel_noise_and_robot_noise_are_found_beside_each_other(rng):
    robot = np.diag([3e-4] * 3 + [2e-4] * 3) ** 2
    poses, rounded, _, _ = finished(rng, 30, robot=robot, pixel=0.15)
    noise = uq.camera_noise(poses, POINTS, rounded)
    found = uq.estimate_noise(poses, camera=noise)
    pixels = found["pixel noise"]
    assert pixels.status == "estimated" and pixels.unit == "px" and pixels.low < 0.15 < pixels.high
    assert found["robot rotation"].low < 3e-4 < found["robot rotation"].high
    assert found["robot translation"].low < 2e-4 < found["robot translation"].high
    assert found["camera rotation"].status == "by geometry" and "geometry of the views" in found.statement[0]
    assert (
        len(found.variances) == len(found.keys)
        and uq.NoiseEstimate.from_dict(found.to_dict()).to_dict() == found.to_dict()
    )
    assert str(pixels).startswith("pixel noise: 0.1")

    given = calibrate(poses, noise=uq.PoseNoise(robot=robot, camera=noise)).noise_estimate
    assert {"pixel noise", "camera rotation", "camera translation"} <= {part.name for part in given.components}
    assert given["pixel noise"].low < 0.15 < given["pixel noise"].high
    known = calibrate(poses, noise=uq.camera_noise(poses, POINTS, rounded, pixel_sd="0.15px")).noise_estimate
    assert known["pixel noise"].status == "given" and known["robot rotation"].status == "estimated"
    both = uq.PoseNoise(robot=robot, camera=uq.camera_noise(poses, POINTS, rounded, pixel_sd=0.15))
    assert isinstance(both.camera, uq.JointCovariance) and calibrate(poses, noise=both).noise_estimate is None
    prior = calibrate(poses, noise=noise, prior=uq.NoisePrior(robot=(0, 0), factor=1))
    assert not np.any(prior.noise.robot)


def test_a_robot_whose_noise_hides_the_pixels_leaves_them_open(rng):
    poses, rounded, _, _ = finished(rng, 12, robot=np.diag([0.03] * 3 + [0.03] * 3) ** 2)
    pixels = uq.estimate_noise(poses, camera=uq.camera_noise(poses, POINTS, rounded))["pixel noise"]
    assert pixels.status == "not told apart" and pixels.high > 5 * pixels.low
    assert "not identifiable" in str(pixels)


@pytest.mark.slow
def test_wrong_poses_are_found_all_the_same(rng):
    poses, rounded, X, _ = finished(rng, 20)
    camera = poses.camera.copy()
    camera[[3, 11]] = perturb(camera[[3, 11]], np.array([[0.02, 0, 0, 0.004, 0, 0], [0, 0.01, 0, 0, 0, 0.02]]))
    wrong = uq.PosePairs(poses.robot, camera)
    result = calibrate(wrong, noise=uq.camera_noise(wrong, POINTS, rounded))
    assert [row for row, flag in enumerate(result.table.flag) if flag != "kept"] == [3, 11]
    assert result.reference.p_value(squared(result.X, result.covariance, X)) > 1e-3


def test_published_methods_take_it_too(views):
    poses, rounded, _, _ = views
    result = calibrate(poses, noise=uq.camera_noise(poses, POINTS, rounded), method="park")
    assert result.noise_estimate["pixel noise"].status == "estimated" and np.isfinite(result.std).all()


@pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")
def test_rendered_pictures_with_known_truth():
    """Finished poses alone, f rounded: X within 0.15 mm of the truth, where isotropic noise is off by 2 mm."""
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / "synthetic_camera_2"
    poses = uq.read_poses(folder / "robot.csv", folder / "camera.csv")
    noise = uq.camera_noise(poses, uq.Board(9, 6, 0.2).points, (1080, 1080, 960, 540))
    result = calibrate(poses, noise=noise)
    off = error(result.X, np.diag([1.0, -1, -1, 1]))
    assert np.linalg.norm(off[3:]) < 0.15e-3
    assert off @ np.linalg.solve(result.covariance, off) < 16.8


CAMERA = (1100, 1100, 640, 480)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"camera_matrix": (1.1, 1.1, 0.6, 0.5)}, "in pixels"),
        ({"camera_matrix": (1100, 1100, 64, 48)}, "does not fit: in 15 of 15 poses"),
        ({"camera_matrix": np.eye(3)[:2]}, r"\(3, 3\) or \(fx"),
        ({"camera_matrix": K.T}, "fx 0 cx"),
        ({"camera_matrix": "K.yaml"}, "numbers in pixels"),
        ({"points": 1e3 * POINTS}, "millimetres"),
        ({"points": POINTS[:9]}, "not on one line"),
        ({"points": POINTS[:, :2]}, r"\(m, 3\)"),
        ({"points": POINTS[:, [0, 2, 1]] - [0, 0, 0.3]}, "is behind|edge-on|does not fit"),
        ({"intrinsics": "known"}, "estimated, pinhole, exact or a covariance"),
        ({"intrinsics": np.zeros((4, 4))}, "positive definite"),
        ({"intrinsics": np.diag([1.0, 1, -1, 1])}, "positive definite"),
        ({"intrinsics": np.triu(np.ones((4, 4)))}, "symmetric"),
        ({"intrinsics": np.eye(3)}, r"\(4, 4\) of fx"),
        ({"intrinsics": np.full((4, 4), np.nan)}, "finite"),
        ({"pixel_sd": 0}, "pixel_sd"),
        ({"pixel_sd": "0.2mm"}, "pixel_sd"),
        ({"poses": np.eye(4)}, "poses"),
    ],
)
def test_input_that_does_not_fit_is_refused_in_one_line(views, change, words):
    poses = views[0]
    with pytest.raises(InputError, match=words) as caught:
        uq.camera_noise(**{"poses": poses, "points": POINTS, "camera_matrix": CAMERA} | change)
    assert "\n" not in str(caught.value)


def test_poses_that_do_not_fit_are_refused(views, rng):
    poses, rounded, _, _ = views
    with pytest.raises(InputError, match="behind the camera"):
        uq.camera_noise(inverse(poses.camera) @ np.diag([1.0, -1, -1, 1]), POINTS, rounded)
    edge = poses.camera.copy()
    edge[4] = np.eye(4)
    edge[4, :3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    edge[4, 2, 3] = 0.7
    with pytest.raises(InputError, match="edge-on"):
        uq.camera_noise(edge, POINTS, rounded)
    millimetres = poses.camera.copy()
    millimetres[:, :3, 3] *= 1e3
    with pytest.raises(InputError, match="millimetres"):
        uq.camera_noise(millimetres, POINTS, rounded)
    noise = uq.camera_noise(poses, POINTS, rounded)
    with pytest.raises(InputError, match="got that of 15 poses"):
        uq.calibrate(poses.rows(np.arange(10)), noise=noise)
    with pytest.raises(InputError, match=r"pixel noise .* is not known"):
        uq.bound(poses, noise=uq.PoseNoise(camera=noise), X=np.eye(4))
    with pytest.raises(InputError, match="for the robot only"):
        uq.estimate_noise(poses, uq.NoisePrior(camera=(1e-3, None)), camera=noise)
    with pytest.raises(InputError, match="do not determine the intrinsics"):
        uq.camera_noise(np.tile(poses.camera[:1], (3, 1, 1)), POINTS, rounded)


def test_a_board_of_another_size_is_said(views):
    """A wrong unit of the squares shows as a pixel noise that no detector has."""
    poses, rounded, _, _ = views
    for factor, seen in ((0.05, True), (1.0, False)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)
            noise = uq.camera_noise(poses, factor * POINTS + (1 - factor) * POINTS.mean(axis=0), rounded)
        found = uq.estimate_noise(poses, camera=noise)
        assert any(finding.code == "noise_estimation.unusual_pixels" for finding in found.findings) is seen


def test_a_pinhole_has_four_unknowns(views):
    poses, rounded, _, _ = views
    whole, four = (uq.camera_noise(poses, POINTS, rounded, given) for given in ("estimated", "pinhole"))
    assert len(four.scales) == 4 and four.scales.all()
    smaller = whole.joint.shared @ whole.joint.shared.mT - four.joint.shared @ four.joint.shared.mT
    assert np.linalg.eigvalsh(smaller).min() > -1e-9 * np.abs(smaller).max()


def test_the_corners_of_a_tag():
    points = uq.tag_points("40mm")
    np.testing.assert_allclose(np.linalg.norm(np.diff(points, axis=0), axis=1), 0.04)
    np.testing.assert_allclose(points.mean(axis=0), 0, atol=1e-12)
    with pytest.raises(InputError, match="side"):
        uq.tag_points(-1)


def test_the_share_of_the_intrinsics_is_in_the_budget(views):
    poses, rounded, _, _ = views
    result = calibrate(poses, noise=uq.camera_noise(poses, POINTS, rounded))
    budget = result.analysis.budget
    assert {"intrinsics", "camera (each pose)"} <= set(budget.sources)
    # what is declared beside it, here the size of the board, is no part of what the views say of the camera
    wide = calibrate(poses, noise=uq.camera_noise(poses, POINTS, rounded), shared=[uq.SharedError.target_scale("5%")])
    assert wide.noise_estimate["camera translation"].size < 1.5 * result.noise_estimate["camera translation"].size


def test_of_a_single_tag_the_intrinsics_are_those_of_another_calibration(views):
    poses, rounded, _, _ = views
    tag = uq.tag_points(0.1) + POINTS.mean(axis=0)
    noise = uq.camera_noise(poses, tag, rounded)
    assert not noise.scales.any() and noise.joint.shared.shape[-1] == 3
    f = np.mean(rounded[:2])
    alone = uq.camera_noise(poses, tag, rounded, [[(1e-3 * f) ** 2]])
    np.testing.assert_allclose(noise.joint.shared[..., 0], alone.joint.shared[..., 0], rtol=1e-6)
    assert uq.camera_noise(poses, tag, rounded, "pinhole").scales.all()


def test_squares_of_another_size_are_measured(views):
    """The same pictures read with squares that are 2 % too large: the robot tells."""
    poses, rounded, _, _ = views
    side = float(np.min(np.linalg.norm(POINTS[1:] - POINTS[0], axis=1)))
    camera = poses.camera.copy()
    camera[:, :3, 3] *= 1.02
    larger = uq.PosePairs(poses.robot, camera)
    noise = uq.camera_noise(larger, 1.02 * POINTS, rounded)
    assert noise.square == pytest.approx(1.02 * side) and noise.rows(np.arange(5)).square == noise.square
    assert uq.camera_noise(poses, POINTS + POINTS**2, rounded).square is None
    result = calibrate(larger, noise=noise)
    said = [text for text in result.warnings if text.startswith("The squares measure ")]
    assert len(said) == 1 and f"mm, not {1e3 * 1.02 * side:.4g} (probability" in said[0]
    found = next(finding for finding in result.findings if finding.code == "calibration.target_size").values
    true, sd = 1.02 * side / (1 + found["estimate"]), 1.02 * side * found["sd"]
    assert abs(true - side) < 4 * sd < 0.02 * side
