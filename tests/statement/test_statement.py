"""The headline, the parts of the accuracy, and the checks."""

import json

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye import findings as all_findings
from uq_handeye.calibration.checks import failures_in_words
from uq_handeye.findings import CHECKS

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
POSES = uq.simulate(n_poses=30, noise=NOISE, seed=1)
pytestmark = pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")


@pytest.fixture(scope="module")
def given():
    return uq.calibrate(POSES, noise=NOISE)


@pytest.fixture(scope="module")
def estimated():
    return uq.calibrate(POSES)


def test_the_accuracy_is_the_worst_direction_of_the_total_covariance(estimated):
    found, S = estimated.accuracy, estimated.covariance
    assert found.translation == pytest.approx(np.sqrt(np.linalg.eigvalsh(S[3:, 3:])[-1]))
    assert found.rotation == pytest.approx(np.sqrt(np.linalg.eigvalsh(S[:3, :3])[-1]))
    ahead = estimated.uncertainty_at([0, 0, found.distance]).covariance
    assert found.point == pytest.approx(np.sqrt(np.linalg.eigvalsh(ahead)[-1]))
    assert found.distance == pytest.approx(np.sqrt(np.mean(np.sum(POSES.camera[:, :3, 3] ** 2, axis=-1))), rel=0.02)
    assert 1.9 < found.translation_95 / found.translation < 3.2 and 1.9 < found.rotation_95 / found.rotation < 3.2


def test_the_parts_add_up(estimated, given):
    for result in (estimated, given):
        found = result.accuracy
        total = np.sqrt(sum(np.square([part.translation, part.rotation]) for part in found.parts))
        np.testing.assert_allclose(total, [found.translation, found.rotation], rtol=6e-8)
    names = {part.name for part in estimated.accuracy.parts}
    noise = {name for name in names if name.startswith("noise of the")}
    assert noise and names - noise == {"focal length", "principal point", "target scale", "sizes of the errors"}
    assert {part.name for part in given.accuracy.parts} == {"noise of the camera poses", "noise of the robot poses"}


def test_the_headline(given, estimated):
    assert given.headline.startswith("gripper_T_camera is known to 0.34 mm and 0.048 deg (1 sigma, worst direction)")
    assert any(text.startswith("focal length") for text in estimated.accuracy.included)
    assert not any("assumed" in text for text in (*estimated.accuracy.included, *given.accuracy.included))


def test_every_check_is_there_in_its_order(given, estimated):
    for result in (
        given,
        estimated,
        uq.calibrate(POSES, noise=NOISE, method="tsai"),
        uq.calibrate(POSES.rows(range(4))),
    ):
        assert tuple(check.name for check in result.checks) == CHECKS
        for check in result.checks:
            assert check.status in ("ok", "caution", "failed", "not run")
            assert 3 < len(check.text) <= 62 and not check.text.endswith(".")
    assert {check.name: check.status for check in given.checks}["noise level"] == "ok"
    assert {check.name: check.status for check in estimated.checks}["noise level"] == "not run"


def test_outliers_and_a_wrong_size_show_in_their_checks():
    camera = POSES.camera.copy()
    camera[7, :3, 3] += [0.02, 0, 0]
    found = uq.calibrate(uq.PosePairs(POSES.robot, camera, setup="eye-in-hand"), noise=NOISE)
    check = {check.name: check for check in found.checks}["outliers"]
    assert check.status == "caution" and check.text == "1 of 30 poses rejected: 7"
    assert str(check.findings[0]) in found.warnings


def test_cautions_come_in_the_order_of_their_effect():
    small = uq.PoseNoise.isotropic(robot=("0.01deg", "0.02mm"), camera=("0.04deg", "0.2mm"))
    found = uq.calibrate(POSES, noise=small).cautions
    assert len(found) > 2 and (np.diff([one.effect for one in found]) <= 0).all()
    assert any(one.rejects for one in found)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ("inverse camera", "the camera file seems inverse, or the setup eye-to-hand"),
        ("mm", "the camera file seems to be in mm"),
        ("noise", "times larger than this noise"),
    ],
)
def test_what_cannot_be_used_says_why(wrong, reason):
    robot, camera, noise = POSES.robot, POSES.camera.copy(), None
    if wrong == "mm":
        camera[:, :3, 3] *= 1e3
    elif wrong == "noise":
        noise = uq.PoseNoise.isotropic(robot=("0.001deg", "0.002mm"), camera=("0.004deg", "0.02mm"))
    else:
        camera = np.linalg.inv(camera)
    poses = uq.PosePairs(robot, camera, setup="eye-in-hand")
    if noise is None:  # with estimated noise X is of no use or there is none: the reason comes either way
        try:
            reasons = uq.calibrate(poses).reasons
        except uq.NotConvergedError as error:
            reasons = failures_in_words(error.findings)
        assert reason in reasons[0]
        noise = NOISE
    found = uq.calibrate(poses, noise=noise)
    assert not found.usable and reason in found.reasons[0] and found.headline == f"NOT USABLE: {found.reasons[0]}."


def test_an_uncertainty_beyond_the_rig_is_not_usable():
    noise = uq.PoseNoise.isotropic(robot=("3deg", "300mm"), camera=("3deg", "300mm"))
    found = uq.calibrate(uq.simulate(n_poses=6, noise=noise, seed=3), noise=noise, shared=[])
    assert not found.usable and "do not determine X" in " ".join(found.reasons)


def test_the_json_says_it_too(given):
    data = json.loads(given.to_json())
    assert data["headline"] == given.headline and data["usable"] is True
    assert data["accuracy"]["translation"] == given.accuracy.translation
    assert [check["name"] for check in data["checks"]] == list(CHECKS)


def test_every_caution_of_the_program_has_a_phrase():
    """Codes that can be more than a note in a calibration; the others are of streams and chains."""
    import uq_handeye.calibration.calibrate  # noqa: F401  registers the sentences

    elsewhere = ("synchronisation.", "posterior.", "monte_carlo.", "stored.", "tests.", "verification.")
    elsewhere += ("maintenance.",)
    notes = {
        *("diagnostics.direction", "diagnostics.joint_spectrum", "diagnostics.turning", "diagnostics.information"),
        *("diagnostics.strong_row", "diagnostics.not_tested", "diagnostics.gaussian", "diagnostics.no_pattern"),
        *("diagnostics.halves_too_small", "diagnostics.halves_without_freedom"),
        *("diagnostics.half_fails", "diagnostics.many_halves", "calibration.prior_agrees", "calibration.excluded"),
        *("calibration.shared_confounded", "kinematics.against_controller", "camera.bent_edges"),
        *("camera.corrected_by_robot", "camera.given_moved", "calibration.camera_scale", "calibration.scene_scale"),
        *("input_checks.pose_ambiguity",),
    }
    known = set(all_findings._RECORDS)
    phrased = {code for code, record in all_findings._RECORDS.items() if record.phrase}
    missing = {code for code in known - phrased - notes if not code.startswith((*elsewhere, "noise_estimation."))}
    assert missing == set()


def test_values_of_another_version_give_the_code():
    assert all_findings.Finding("diagnostics.pattern", "caution", {}).phrase == "pattern"
    assert all_findings.Finding("future.some_thing", "caution", {"a": 1}).phrase == "some thing"
    assert all_findings.Finding("diagnostics.pattern", "caution", {}).effect == 1.0
