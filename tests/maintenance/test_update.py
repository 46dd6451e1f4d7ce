"""Updates equal the fit of all poses, whatever the order, and refuse what is not of the same question."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from fixtures.rigs import NOISE, PAIR_NOISE, motions_alone, quietly
from fixtures.rigs_on_arms import ARM, rig

import uq_handeye as uq
from studies.camera_covariance import ROBOT, poses_of, recorded
from uq_handeye.core.geometry.se3 import logarithm
from uq_handeye.model.camera.corners import without_pictures

GIVEN = {"noise": NOISE}
SHARED = {
    "shared": [
        uq.SharedError.robot_accuracy("0.5mm,0.05deg", reach="1.2m"),
        uq.SharedError.principal_point("1px", focal_length_px=900),
        uq.SharedError.target_scale("0.1%"),
    ]
}
KNOWN = {
    "prior": uq.NoisePrior(robot=("0.02deg", None)),
    "prior_X": (np.eye(4), np.diag([np.inf] * 3 + [0.1**2] * 3)),
}
ALL = 26


def stored(result):
    return uq.Calibration.from_dict(json.loads(result.to_json()))


def updated(result, *parts, **options):
    """Return the result after one update for each part."""
    for poses in parts:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", uq.InputWarning)
            result = uq.update(result, poses, **options)
    return result


def apart(one, other):
    """Distance of two X in standard deviations, and of their covariances, whitened."""
    L = np.linalg.inv(np.linalg.cholesky(other.covariance))
    return max(float(np.linalg.norm(L @ _off(one, other))), float(np.abs(L @ one.covariance @ L.T - np.eye(6)).max()))


def parts_of(poses, *sizes):
    ends = np.cumsum([0, *sizes])
    return [poses.rows(np.arange(*ends[k : k + 2])) for k in range(len(sizes))]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("setup", "options", "close"),
    [
        ("eye-in-hand", GIVEN, 1e-6),
        ("eye-to-hand", GIVEN | SHARED | {"method": "ml"}, 1e-6),
        ("eye-to-hand", {}, 0.35),  # times that run backwards are dropped, and with them the drift: 0.08 to 0.28
        ("eye-in-hand", SHARED | KNOWN, 0.2),  # the same
    ],
    ids=["noise", "shared", "estimated", "known"],
)
def test_an_update_is_the_fit_of_all_poses_in_any_order(setup, options, close):
    simulated = uq.simulate(ALL, noise=NOISE, setup=setup, seed=5)
    poses = replace(simulated, truth=None)
    first, second, third = parts_of(poses, 18, 7, 1)
    whole, start = quietly(poses, **options), quietly(first, **options)
    anyway = {"although_changed": True}  # one check in twenty is a false alarm
    forward, backward = updated(start, second, third, **anyway), updated(start, third, second, **anyway)
    assert forward.n_poses == ALL and apart(forward, whole) < 1e-9
    assert apart(backward, whole) < close
    assert [one.name for one in forward.shared] == [one.name for one in whole.shared]
    assert [part["poses"] for part in forward.provenance.options["together"]] == [18, 7, 1]
    assert apart(start, whole) > 0.1  # the new poses said something


@pytest.mark.slow
def test_poses_with_their_truth_are_asked_the_same_from_a_file():
    """No accuracy of the robot is assumed of simulated poses, whose truth a file does not hold."""
    poses = uq.simulate(ALL, noise=NOISE, seed=5)
    first, second = parts_of(poses, 20, 6)
    assert apart(updated(stored(quietly(first)), second), quietly(poses)) < 1e-9


def test_noise_of_new_poses_counts_beside_that_of_the_old():
    poses = uq.simulate(ALL, noise=NOISE, seed=6)
    first, second = parts_of(poses, 20, 6)
    worse = uq.PoseNoise(NOISE.robot, 9 * NOISE.camera)
    camera = np.concatenate([np.tile(NOISE.camera, (20, 1, 1)), np.tile(9 * NOISE.camera, (6, 1, 1))])
    both = uq.PoseNoise(NOISE.robot, camera)
    found = updated(quietly(first, noise=NOISE), second, noise=worse)
    assert apart(found, quietly(poses, noise=both)) < 1e-9
    with pytest.raises(uq.InputError, match="differs from pose to pose"):
        uq.update(found, uq.simulate(4, noise=NOISE, seed=7))


def test_excluded_poses_stay_excluded():
    poses = replace(uq.simulate(ALL, noise=NOISE, seed=6), truth=None)
    first, second = parts_of(poses, 20, 6)
    out = {"exclude": [2, 7]}
    each = uq.PoseNoise(NOISE.robot, np.linspace(1, 3, ALL)[:, None, None] * NOISE.camera)
    start = quietly(first, noise=each.rows(np.arange(20)), **out)
    found = updated(start, second, noise=each.rows(np.arange(20, ALL)))
    assert found.excluded == (2, 7) and found.n_poses == ALL - 2
    assert apart(found, quietly(poses, noise=each, **out)) < 1e-9


def test_poses_that_contradict_the_result_are_refused():
    poses = uq.simulate(ALL, noise=NOISE, seed=10)
    first, second = parts_of(poses, 20, 6)
    moved = second.camera.copy()
    moved[:, :3, 3] += [0.0, 0.0, 0.01]
    moved = uq.PosePairs(second.robot, moved)
    result = quietly(first, noise=NOISE)
    with pytest.raises(uq.InputError, match=r"something has changed.*--although-changed"):
        uq.update(result, moved)
    assert updated(result, moved, although_changed=True).n_poses == ALL


@pytest.mark.slow
def test_camera_noise_by_views_is_that_of_all_views():
    poses = replace(uq.simulate(ALL, noise=NOISE, seed=8), truth=None)
    first, second = parts_of(poses, 25, 1)
    asked = lambda of: uq.camera_noise(of, uq.Board(9, 6, "20mm").points, (900, 900, 640, 480))  # noqa: E731
    whole = quietly(poses, noise=asked(poses))
    assert apart(updated(quietly(first, noise=asked(first)), second), whole) < 1e-9


@pytest.mark.slow
def test_an_arm_is_asked_again_by_its_joints():
    large = {"joint offsets": 0.02, "joint tilts": 0.02, "link lengths": 5e-3}
    poses = rig(np.random.default_rng(0), n=16, sd=large).poses
    first, second = parts_of(poses, 12, 4)
    declared = uq.KinematicErrors("declared", offset_sd=0.02, tilt_sd=0.02, length_sd=5e-3, joint_sd=1e-4)
    options = {
        "kinematics": ARM,
        "kinematic_errors": declared,
        "noise": uq.PoseNoise.isotropic(camera=(3e-4, 1e-4)),
    }
    start = quietly(first, **options)
    assert start.provenance.request["arm"]["at"] is not None  # the poses of the result stand for those measured
    assert apart(updated(start, second), quietly(poses, **options)) < 1e-6
    with pytest.raises(uq.InputError, match="expected joints of the new poses"):
        uq.update(start, replace(second, joints=None))


@pytest.mark.slow
def test_the_camera_is_adjusted_with_all_pictures():
    corners, robot, _ = recorded(np.random.default_rng(11), 12)

    def part(rows):
        kept = without_pictures(corners, ~np.isin(np.arange(12), rows))
        return poses_of(replace(kept, row=kept.picture), robot[rows])

    options = {"noise": uq.PoseNoise(robot=ROBOT)}
    whole = quietly(poses_of(corners, robot), **options)
    first, second = part(np.arange(8)), part(np.arange(8, 12))
    assert apart(updated(quietly(first, **options), second), whole) < 1e-6
    assert apart(updated(quietly(second, **options), first), whole) < 1e-6
    for wrong, words in ((first, "already"), (replace(second, camera_calibration=None), "without corners")):
        with pytest.raises(uq.InputError, match=words):
            uq.update(quietly(first, **options), wrong)


@pytest.mark.slow
def test_what_is_not_of_the_same_question_is_refused():
    poses = uq.simulate(ALL, noise=NOISE, seed=9)
    first, second = parts_of(poses, 20, 6)
    result = quietly(first, noise=NOISE)
    twice, other = updated(result, second), replace(second, setup="eye-to-hand", truth=None)
    far = uq.PosePairs(*(_in_mm(T) for T in (second.robot, second.camera)))
    joint = uq.PoseNoise(NOISE.robot, np.kron(np.eye(20), NOISE.camera))
    columns = [uq.SharedError.columns("sag", np.ones((20, 6)), 1e-4, "robot")]
    for of, new, words in (
        (result, first, "made with these poses already"),
        (twice, second, "made with these poses already"),
        (result, poses.rows(np.arange(18, 26)), "2 of 8 new poses are in the result already"),
        (result, other, "new poses are eye-to-hand"),
        (result, far, "expected both in metres"),
        (quietly(first, noise=joint), second, "camera poses is joint over the poses"),
        (quietly(first, noise=NOISE, shared=columns), second, "'sag' has columns of its own"),
        (quietly(first, noise=NOISE, pairs=[[0, 1], [1, 2], [2, 3]]), second, "pairs that were listed"),
        (quietly(motions_alone()[1], noise=PAIR_NOISE), second, "motions that came without poses"),
    ):
        with pytest.raises(uq.InputError, match=words) as error:
            uq.update(of, new)
        assert "\n" not in str(error.value)
    with pytest.raises(uq.InputError, match="leave out that of the new poses"):
        uq.update(quietly(first), second, noise=NOISE)


def _in_mm(T):
    T = T.copy()
    T[:, :3, 3] *= 1e3
    return T


def without_poses(result):
    """A result as an older version wrote it; with open sizes its posterior is not bound to poses."""
    origin, of = replace(result.provenance, request=None), result.posterior
    of = of if of.points is None else replace(of, bound=None)
    parts = {"data": None, "table": None, "analysis": None, "fit": None, "provenance": origin, "joint_posterior": of}
    return replace(result, **parts)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "close"),
    [
        (GIVEN, 0.01),
        (GIVEN | {"shared": SHARED["shared"][2:]}, 0.01),
        (GIVEN | {"shared": SHARED["shared"][1:]}, 0.05),
        ({"shared": []}, 0.05),
    ],
    ids=["noise", "scale", "principal point", "estimated"],
)
def test_a_result_without_poses_is_updated_by_its_posterior(options, close):
    """To first order: old poses are not linearised again. Sizes that were estimated are estimated again.

    X absorbs a shift of the image centre but for what the noise of its column leaves, and the columns of old poses are
    not taken again at the poses as all correct them: 0.01 to 0.04 deviations for four seeds, at any size of the noise.
    """
    poses = uq.simulate(ALL, noise=NOISE, seed=5)
    first, second, third = parts_of(poses, 18, 7, 1)
    whole, start = quietly(poses, robust=False, **options), without_poses(quietly(first, robust=False, **options))
    anyway = {"although_changed": True}  # one check in twenty is a false alarm
    forward, backward = updated(start, second, third, **anyway), updated(start, third, second, **anyway)
    off = [np.linalg.norm(np.linalg.solve(np.linalg.cholesky(whole.covariance), _off(one, whole)))
           for one in (forward, backward)]  # fmt: skip
    assert max(off) < close < 0.5 * np.linalg.norm(_off(start, whole) / whole.std)
    assert apart(forward, backward) < 0.01 and forward.n_poses == ALL
    again = stored(forward)
    why = {check.name: check.text for check in again.checks}
    assert {why[name] for name in ("outliers", "residuals", "two halves")} == {"the result holds no residuals of poses"}
    assert again.findings[-1].code == "maintenance.by_posterior" and "updated the joint" in str(again.findings[-1])
    with pytest.raises(uq.InputError, match="made with these poses already"):
        uq.update(again, second)
    with pytest.raises(uq.InputError, match=r"in common.*uq-handeye update"):
        uq.difference(start, forward)


@pytest.mark.slow
@pytest.mark.parametrize("times", [None, np.arange(ALL) * 2.0], ids=["no times", "times"])
@pytest.mark.parametrize("lacks", ["poses", "poses and request"])
def test_a_file_without_poses_is_updated_as_one_with_them(times, lacks, tmp_path):
    """Its posterior keeps the poses that open sizes and errors of poses are bound to."""
    poses = uq.simulate(ALL, noise=NOISE, seed=5)
    poses = uq.PosePairs(poses.robot, poses.camera, poses.setup, times)
    first, second = parts_of(poses, 18, 8)
    bare = replace(quietly(first), data=None, table=None, analysis=None, fit=None)
    if lacks == "poses and request":
        bare = replace(bare, provenance=replace(bare.provenance, request=None))
    bare.save(tmp_path / "bare.json")
    whole, found = quietly(poses), updated(uq.load(tmp_path / "bare.json"), second, although_changed=True)
    assert apart(found, whole) < 1e-9 and found.n_poses == ALL
    np.testing.assert_allclose(found.covariance, whole.covariance, rtol=1e-6, atol=1e-18)
    with pytest.raises(uq.InputError, match="18 poses in common"):
        uq.difference(uq.load(tmp_path / "bare.json"), found)


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_open_sizes_are_found_again_beside_touches(setup):
    """The rows that the posterior is made of tell them, also from a file; columns of old poses are not taken again."""
    off = []
    for seed in range(4):
        poses = uq.simulate(24, setup=setup, noise=NOISE, seed=seed)
        poses = uq.PosePairs(poses.robot, poses.camera, poses.setup)
        whole, start = quietly(poses), quietly(poses.rows(range(16)))
        touched = {"touches": [{"sha256": "of touches", "count": 5}]}
        start = replace(start, provenance=replace(start.provenance, options=start.provenance.options | touched))
        found = updated(stored(start), poses.rows(range(16, 24)), although_changed=True)
        assert found.findings[-1].code == "maintenance.by_posterior"
        off.append(np.abs(_off(found, whole) / whole.std).max())
        np.testing.assert_allclose(found.std, whole.std, rtol=0.12)
        again = stored(found).posterior
        np.testing.assert_allclose(again.covariance, found.posterior.covariance, rtol=1e-9, atol=1e-15)
    assert max(off) < 0.1 and np.median(off) < 0.05


def test_another_target_is_not_one_fit():
    """Its size is drawn again, so that new poses of it tell less of the focal length than those of the same target."""
    poses = uq.simulate(ALL, noise=NOISE, seed=5)
    first, second = parts_of(poses, 20, 6)
    start = quietly(first, noise=NOISE, shared=[uq.SharedError.target_scale("1%")])
    other, one = (updated(start, second, same=same, although_changed=True)
                  for same in (("robot", "camera"), ("robot", "camera", "target")))  # fmt: skip
    assert other.findings[-1].code == "maintenance.by_posterior" and other.n_poses == one.n_poses == ALL
    assert one.data is not None and other.data is None
    scale = [of.posterior.covariance[12, 12] for of in (start, other, one)]
    assert scale[2] < scale[1] <= scale[0] * (1 + 1e-9)


@pytest.mark.slow
def test_touches_that_were_taken_in_are_taken_in_again():
    """A file holds them: the update is the fit of all poses with the touches."""
    poses = uq.simulate(ALL, noise=NOISE, seed=5)
    poses = uq.PosePairs(poses.robot, poses.camera, poses.setup)
    first, second = parts_of(poses, 20, 6)
    rng = np.random.default_rng(3)
    seen, at = rng.uniform([-0.1, -0.1, 0.4], [0.1, 0.1, 0.6], (5, 3)), first.robot[:5]
    in_base = np.einsum("nij,nj->ni", at[:, :3] @ quietly(poses).X, np.c_[seen, np.ones(5)])
    touches = uq.Touches(
        seen, in_base + 2e-4 * rng.standard_normal((5, 3)), robot=at, touch_sd=2e-4, seen_covariance=1e-8 * np.eye(3),
        tool_sd=np.inf,
    )  # fmt: skip
    start, whole = (uq.include_touches(quietly(of), touches) for of in (first, poses))
    found = updated(stored(start), second, although_changed=True)
    assert apart(found, whole) < 1e-9 and found.data is not None and found.n_poses == ALL
    assert [one["count"] for one in stored(found).provenance.options["touches"]] == [5]
    with pytest.raises(uq.InputError, match="a touch counts once"):
        uq.include_touches(stored(found), touches)
    bare = {name: value for name, value in start.provenance.request.items() if name != "touches"}
    older = replace(start, provenance=replace(start.provenance, request=bare))
    found = updated(older, second, although_changed=True)
    assert found.findings[-1].code == "maintenance.by_posterior" and found.data is None
    assert found.provenance.options["touches"] == older.provenance.options["touches"]


def test_with_less_noise_the_posterior_update_is_the_fit():
    """Second order falls with the noise: 1e-6 standard deviations at a thousandth of it."""
    small = uq.PoseNoise(1e-6 * NOISE.robot, 1e-6 * NOISE.camera)
    poses = uq.simulate(ALL, noise=small, seed=5)
    first, second = parts_of(poses, 20, 6)
    start = without_poses(quietly(first, noise=small, robust=False, method="ml"))
    assert apart(updated(start, second), quietly(poses, noise=small, robust=False, method="ml")) < 1e-4


def _off(one, other):
    return np.r_[logarithm(one.X[:3, :3] @ other.X[:3, :3].T), one.X[:3, 3] - other.X[:3, 3]]
