"""Intrinsics of a depth camera: errors that all poses share, tested by the points."""

import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.errors import InputWarning
from uq_handeye.model.points.result import read_point_poses

K = {"fx": 600.0, "fy": 600.0, "cx": 320.0, "cy": 240.0}
CORNERS = 0.15 * np.array([[x, y, z] for x in (0, 1, 2) for y in (0, 1, 2) for z in (0, 1)])


def measured(rng, shift=(0.0, 0.0), n=15, noise=2e-4):
    """Points by a camera matrix whose centre is off by ``shift`` pixels, and the true poses."""
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(rng.normal(scale=0.4, size=(n, 3))).as_matrix()
    poses[:, :3, 3] = rng.uniform([-0.3, -0.3, 0.9], [0.1, 0.1, 1.3], (n, 3))
    p = CORNERS @ poses[:, :3, :3].mT + poses[:, None, :3, 3]
    p[..., :2] -= p[..., 2:] * np.array(shift) / K["fx"]
    return p + noise * rng.normal(size=p.shape), poses


def found(points, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        return uq.poses_from_points(points, CORNERS, **options)


def mean_square(seen, truth):
    """Squared distance of all poses together from the truth, over its degrees of freedom."""
    xi = np.concatenate(
        [
            Rotation.from_matrix(seen.poses[:, :3, :3] @ truth[:, :3, :3].mT).as_rotvec(),
            seen.poses[:, :3, 3] - truth[:, :3, 3],
        ],
        axis=1,
    ).ravel()
    F = seen.covariance.shared.reshape(len(xi), -1)
    S = F @ F.T
    for i, block in enumerate(seen.covariance.own):
        S[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] += block
    return float(xi @ np.linalg.solve(S, xi)) / len(xi)


@pytest.mark.statistical
def test_the_joint_covariance_holds_for_a_wrong_centre(rng):
    shifts = rng.normal(scale=0.6, size=(30, 2))  # 0.001 focal lengths
    with_them, without = [], []
    for shift in shifts:
        points, truth = measured(rng, shift)
        with_them.append(mean_square(found(points, intrinsics=K), truth))
        without.append(mean_square(found(points), truth))
    # What no pose explains of a wrong centre is taken as noise of the points.
    assert 0.75 < np.mean(with_them) < 1.1 and np.mean(without) > 1.5


def test_a_wrong_centre_is_named(rng, tmp_path, without_rendering):
    points, _ = measured(rng, (8.0, 0.0))
    seen = found(points, intrinsics=K)
    (finding,) = seen.findings
    assert finding.code == "camera.given_contradicted" and finding.values["data"] == "points"
    assert [one["name"] for one in finding.values["contradicted"]] == ["cx"]
    again = read_point_poses(seen.write(tmp_path / "seen"))
    np.testing.assert_array_equal(again.covariance.shared, seen.covariance.shared)
    assert again.findings == seen.findings and again.covariance.keys == seen.covariance.keys


def test_right_and_exact_numbers(rng):
    points, _ = measured(rng)
    seen = found(points, intrinsics=K)
    assert [one.code for one in seen.findings] == ["camera.given_agree"] and seen.covariance.shared.shape[-1] == 4
    exact = found(points, intrinsics=K, exact=True)
    assert exact.covariance.shared.shape[-1] == 0
    with pytest.raises(uq.InputError, match="got none of cx, cy"):
        found(points, intrinsics={"fx": 600.0, "fy": 600.0})
