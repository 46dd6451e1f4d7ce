"""calibrate with joints: the chain in the frames of the controller, also once its errors are derived again."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.arms import SIX_AXES, motion
from fixtures.rigs_on_arms import ARM, rig
from support import difference

import uq_handeye as uq
from uq_handeye.calibration.report.arm import arm_sentences
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.errors import InputError
from uq_handeye.model.kinematics.known_arms import about_flange

# Wide motions about a camera that does not follow its target.
pytestmark = [
    pytest.mark.filterwarnings("ignore:The target is ahead"),
    pytest.mark.filterwarnings("ignore:The camera sees its target"),
]
LARGE = {"joint offsets": 2e-2, "joint tilts": 1e-2, "link lengths": 2e-3}
NOISE = uq.PoseNoise.isotropic(None, (3e-4, 1e-4))
FRAMES = (motion((0.0, 0.0, 2.0), (0.4, -0.1, 0.8)), motion((0.0, 0.0, 0.8), (0.0, 0.01, 0.15)))


def calibrated(poses, sd=LARGE, **options):
    of = dict(zip(("offset_sd", "tilt_sd", "length_sd"), sd.values(), strict=True))
    errors = uq.KinematicErrors("declared", **of, joint_sd=1e-4)
    return uq.calibrate(poses, noise=NOISE, shared=[], kinematics=ARM, kinematic_errors=errors, **options)


def said(result):
    return [finding.code for finding in result.findings if finding.code.startswith("kinematics.")]


@pytest.mark.slow
def test_large_errors_do_not_move_the_chain(rng):
    """Errors of 20 mrad are derived again at their estimate; the poses compared stay those that were measured."""
    poses = rig(rng, sd=LARGE, n=15, spread=0.6).poses
    result = calibrated(poses, robust=False)
    np.testing.assert_array_equal(result.kinematics.chain.poses(poses.joints), poses.robot)
    assert np.abs(result.kinematics.e).max() > 5e-3 and said(result) == []


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_frames_of_the_controller_are_in_X_and_W(rng, setup):
    """Base frame B and tool E of the controller, G = B FK(q) E: X and W are in them, by as much as without."""
    base, tool = FRAMES
    poses = rig(rng, setup, n=15, spread=0.6).poses
    same = calibrated(poses, {"joint offsets": 5e-4, "joint tilts": 5e-4, "link lengths": 3e-4}, robust=False)
    moved = replace(poses, robot=base @ poses.robot @ tool)
    result = calibrated(moved, {"joint offsets": 5e-4, "joint tilts": 5e-4, "link lengths": 3e-4}, robust=False)
    X, W = (np.linalg.inv(tool), base) if setup == "eye-in-hand" else (base, np.linalg.inv(tool))
    # Another base changes nothing (below). X and W are those of the frames that fit the tip of the tool best over the
    # workspace, and a tool of 150 mm has its tip elsewhere: by less than half a deviation, and no prediction changes.
    for found, of, S in (
        (result.X, X @ same.X, result.covariance),
        (result.W, W @ same.W, result.posterior.covariance_of("W")),
    ):
        off = difference(found, of)
        assert off @ np.linalg.solve(S, off) < 0.5**2
    np.testing.assert_allclose(np.sort(result.std[:3]), np.sort(same.std[:3]), rtol=0.3)
    np.testing.assert_allclose(result.kinematics.e, same.kinematics.e, rtol=0, atol=1e-6)
    assert said(result) == ["kinematics.against_controller"]
    text = " ".join(result.summary(verbose=True).split())
    assert "after a tool frame of 150 mm, 45.8 deg and a base frame of 900 mm, 115 deg" in text
    first = " ".join(result.summary().split())
    own, other = ("150 mm, 45.8 deg", "base is 900 mm, 115 deg")
    if setup == "eye-to-hand":
        own, other = ("900 mm, 115 deg", "tool is 150 mm, 45.8 deg")
    frame = "gripper" if setup == "eye-in-hand" else "base"
    assert f"X is in the reported {frame} frame, {own} from that of the model. The reported {other} from" in first
    q = poses.joints[:2] + 0.1
    ahead = result.predict_camera(joints=q)
    np.testing.assert_allclose(ahead.poses, same.predict_camera(joints=q).poses, rtol=0, atol=2e-6)


def test_the_first_screen_says_which_flange_x_belongs_to(rng):
    """Also on 26 lines of 80 columns; without an arm there is nothing to say."""
    poses = rig(rng, n=10, spread=0.6, sd={}, joint_noise=0.0).poses
    options = {"noise": NOISE, "shared": [], "robust": False}
    exact = {"kinematics": ARM, "kinematic_errors": uq.KinematicErrors("exact")}
    frames = {
        "X is in the reported gripper frame.": uq.calibrate(poses, **options, **exact),
        "X is in the reported gripper frame, 150 mm, 45.8 deg from that of the model.": uq.calibrate(
            replace(poses, robot=poses.robot @ FRAMES[1]), **options, **exact
        ),
    }
    for words, result in frames.items():
        text = result.summary()
        assert words in " ".join(text.split()) and text.count("\n") <= 26
    assert "gripper frame" not in uq.calibrate(poses, **options).summary()


@pytest.mark.slow
def test_the_first_screen_says_that_x_belongs_to_the_machined_flange(rng):
    poses = rig(rng, n=10, spread=0.6, sd={}, joint_noise=0.0).poses
    errors = uq.KinematicErrors("declared", 1e-4, 1e-4, 1e-4, joint_sd=1e-4, flange="physical")
    result = uq.calibrate(poses, noise=NOISE, shared=[], robust=False, kinematics=ARM, kinematic_errors=errors)
    assert "X is in the machined gripper frame." in " ".join(result.summary().split())


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_where_the_controller_has_its_base_changes_nothing(rng, setup):
    """A base on the floor and turned: the workspace over which X is stated is that of the arm."""
    base = FRAMES[0]
    poses = rig(rng, setup, n=15, spread=0.6).poses
    sd = {"joint offsets": 5e-4, "joint tilts": 5e-4, "link lengths": 3e-4}
    same = calibrated(poses, sd, robust=False)
    result = calibrated(replace(poses, robot=base @ poses.robot), sd, robust=False)
    X, W = (np.eye(4), base) if setup == "eye-in-hand" else (base, np.eye(4))
    np.testing.assert_allclose(result.X, X @ same.X, rtol=0, atol=1e-9)
    np.testing.assert_allclose(result.W, W @ same.W, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_another_arm_is_refused_with_what_would_explain_it(rng):
    poses = rig(rng, n=15).poses
    with pytest.raises(InputError, match=r"more than any tolerance of an arm.*read the joints as degrees"):
        uq.calibrate(replace(poses, joints=np.degrees(poses.joints)), kinematics=ARM)
    other = uq.Kinematics.from_urdf(SIX_AXES.replace("0 0 0.27", "0 0 0.67"))
    with pytest.raises(InputError, match="The URDF is of another arm"):
        uq.calibrate(poses, kinematics=other)


@pytest.mark.parametrize(
    ("name", "words"),
    [("hc10", "turned by half a turn"), ("vs060", "half a turn"), ("rs007n", "a guess"), ("ur5e", "")],
)
def test_what_is_open_about_the_flange_of_an_arm(name, words):
    """Name the chain by its name, which stays when its frames are those of the controller."""
    about = about_flange(uq.Kinematics.from_name(name).name)
    assert words in about and bool(about) is bool(words)
    assert about_flange("six_axes") == ""


@pytest.mark.slow
def test_what_is_open_about_the_flange_of_an_arm_is_in_its_section(rng):
    arm = uq.Kinematics.from_name("vs060")
    q = rng.uniform(-0.4, 0.4, (10, 6)) + 0.7
    X, W = motion((0.1, 0.2, 0.3), (0.05, 0.0, 0.1)), motion((0.0, 3.0, 0.0), (0.5, 0.0, 0.2))
    poses = uq.PosePairs(arm.poses(q), np.linalg.inv(arm.poses(q) @ X) @ W, "eye-in-hand", joints=q)
    poses = replace(poses, camera=perturb(poses.camera, rng.normal(size=(10, 6)) * np.repeat([3e-4, 1e-4], 3)))
    options = {"kinematics": arm, "kinematic_errors": uq.KinematicErrors("exact")}
    result = uq.calibrate(poses, noise=NOISE, shared=[], robust=False, **options)
    assert "Another public description of this arm has the flange turned" in " ".join(arm_sentences(result))
