"""OpenCV 4's five methods and two robot-world methods on the same poses, all pairs, 200 noise draws."""

import numpy as np
import pytest
from support import difference, draw, exact_poses, missing, moved

import uq_handeye as uq
from uq_handeye.model.poses.pose_pairs import Truth

cv2 = pytest.importorskip("cv2")
if not hasattr(cv2, "calibrateHandEye"):
    missing("opencv4", "OpenCV 5.0 has no calibrateHandEye; `pip install -e '.[bench]'` installs OpenCV 4")
pytestmark = pytest.mark.opencv4

TRIALS = 200
FLAGS = {
    name: getattr(cv2, f"CALIB_HAND_EYE_{name.upper()}") for name in ("tsai", "park", "horaud", "andreff", "daniilidis")
}
ROBOT_WORLD = {name: getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name.upper()}") for name in ("shah", "li")}


def pose(R, t):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, np.ravel(t)
    return T


def wide(rng, setup, n=12):
    """Poses anywhere, pairs up to half a turn."""
    X, robot, camera = exact_poses(rng, n, setup)
    covariance = 1e-6 * np.eye(6)
    W = (robot[0] if setup == "eye-in-hand" else np.linalg.inv(robot[0])) @ X @ camera[0]
    noisy = (moved(T, draw(rng, covariance, (TRIALS, n))) for T in (robot, camera))
    return uq.PosePairs(*noisy, setup, truth=Truth(X, W, robot, camera))


def rig(rng, setup):
    noise = uq.PoseNoise.isotropic(robot=("0.3mrad", "0.2mm"), camera=("2mrad", "1mm"))
    return uq.simulate(15, noise=noise, setup=setup, trials=TRIALS, seed=rng)


@pytest.fixture(
    params=[(rig, "eye-in-hand"), (rig, "eye-to-hand"), (wide, "eye-in-hand")],
    ids=lambda case: f"{case[0].__name__}-{case[1]}",
)
def poses(request, rng):
    make, setup = request.param
    return make(rng, setup)


def rms(errors):
    return np.sqrt(np.mean(np.sum(errors.reshape(len(errors), 2, 3) ** 2, axis=2), axis=0))


@pytest.mark.parametrize("name", FLAGS)
def test_hand_eye(name, poses):
    """Equal to rounding where the algorithm is the same; Tsai's in OpenCV drops pairs of small and of large angles."""
    motions = uq.relative_motions(poses, "all")
    ours = uq.solve(motions.A, motions.B, method=name)
    theirs = np.stack(
        [
            pose(*cv2.calibrateHandEye(G[:, :3, :3], G[:, :3, 3], C[:, :3, :3], C[:, :3, 3], method=FLAGS[name]))
            for G, C in zip(poses.effective_robot, poses.camera, strict=True)
        ]
    )
    ratio = rms(difference(ours, poses.truth.X)) / rms(difference(theirs, poses.truth.X))
    assert (ratio < 1.05).all(), ratio
    if name != "tsai":
        assert np.median(np.abs(difference(ours, theirs)).max(axis=1)) < 1e-11


def test_tsai_equals_where_no_pair_is_dropped(rng):
    noise = uq.PoseNoise.isotropic(camera=("2mrad", "1mm"))
    for seed in range(200):
        poses = uq.simulate(4, noise=noise, seed=seed)
        motions = uq.relative_motions(poses, "all")
        angles = np.degrees(np.arccos(np.clip((np.trace(motions.A[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1, 1)))
        if angles.min() > 20 and angles.max() < 120:
            break
    G, C = poses.robot, poses.camera
    theirs = cv2.calibrateHandEye(G[:, :3, :3], G[:, :3, 3], C[:, :3, :3], C[:, :3, 3], method=FLAGS["tsai"])
    np.testing.assert_allclose(uq.solve(motions.A, motions.B, method="tsai"), pose(*theirs), atol=1e-12)


@pytest.mark.parametrize("name", ROBOT_WORLD)
def test_robot_world(name, poses):
    ours = uq.ROBOT_WORLD_METHODS[name](poses)
    theirs = []
    for G, C in zip(poses.effective_robot, poses.camera, strict=True):
        B = np.linalg.inv(G)
        found = cv2.calibrateRobotWorldHandEye(
            C[:, :3, :3],
            C[:, :3, 3:],
            B[:, :3, :3],
            B[:, :3, 3:],
            method=ROBOT_WORLD[name],  # OpenCV 5.1: columns
        )
        theirs.append((np.linalg.inv(pose(*found[2:])), np.linalg.inv(pose(*found[:2]))))
    for k, truth in enumerate((poses.truth.X, poses.truth.W)):
        reference = np.stack([pair[k] for pair in theirs])
        ratio = rms(difference(ours[k], truth)) / rms(difference(reference, truth))
        assert (ratio < 1.05).all(), ratio
        assert np.abs(difference(ours[k], reference)).max() < 1e-9
