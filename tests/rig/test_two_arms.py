"""Two arms with joints in one rig: a camera on each that sees one board in the world."""

import numpy as np
import pytest
from fixtures.rigs_on_arms import ARM, CENTRE, GEOMETRY

import uq_handeye as uq
from uq_handeye.core.geometry.rotations import Rotation
from uq_handeye.core.geometry.se3 import inverse, perturb

NOISE = {
    "first": ("1e-5rad", "0.01mm"),
    "second": ("1e-5rad", "0.01mm"),
    "left": ("0.3mrad", "0.1mm"),
    "right": ("0.3mrad", "0.1mm"),
}
POINT = np.array([[0.1, 0.05, 0.6]])


def pose(turn, position):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(np.array(turn)).as_matrix(), position
    return T


def drawn(seed, n):
    """A rig of arms whose kinematic errors are drawn, and the point that ``right`` sees at joints, as ``left`` does."""
    rng = np.random.default_rng(seed)
    e = [np.array([rng.normal() * GEOMETRY.get(one.group, 0.0) for one in ARM.errors]) for _ in range(2)]
    left, right = pose([0.1, 0.2, 0.3], [0.02, 0.03, 0.08]), pose([-0.2, 0.1, 1.0], [-0.02, 0.05, 0.1])
    base = pose([0.02, -0.05, 3.0], [1.1, 0.1, 0.02])
    board = ARM.poses(CENTRE, e[0]) @ left @ pose([0, 0, 0], [0, 0, 0.6])
    q = [CENTRE + rng.uniform(-0.5, 0.5, (n, 6)) for _ in range(2)]
    exact = inverse(ARM.poses(q[0], e[0]) @ left) @ board, inverse(base @ ARM.poses(q[1], e[1]) @ right) @ board
    C = [perturb(T, rng.normal(size=(n, 6)) * np.repeat([3e-4, 1e-4], 3)) for T in exact]

    def part(rows):
        arms = {name: uq.ArmPoses.by_kinematics(ARM, joints=of[rows], names=range(n)[rows])
                for name, of in zip(("first", "second"), q, strict=True)}  # fmt: skip
        views = [uq.View(name, "board", T[rows], range(n)[rows]) for name, T in zip(("left", "right"), C, strict=True)]
        return uq.Rig(arms, {"left": "first", "right": "second"}, {"board": "world"}, views)

    def seen(joints):
        to_world = base @ ARM.poses(joints[1], e[1]) @ right @ np.append(POINT[0], 1.0)
        return (inverse(ARM.poses(joints[0], e[0]) @ left) @ to_world[..., None])[:, :3, 0]

    return part, seen, [CENTRE + rng.uniform(-0.5, 0.5, (6, 6)) for _ in range(2)]


@pytest.mark.slow
def test_a_point_is_carried_from_one_arm_to_the_other_as_accurately_as_stated():
    squares = []
    for seed in range(3):
        part, seen, q = drawn(seed, 40)
        result = uq.calibrate(part(slice(None)), noise=NOISE)
        assert result.usable and {key.name for key in result.posterior.keys} == {"first", "second"}
        found = result.predict("right", POINT, {"first": ARM.poses(q[0]), "second": ARM.poses(q[1])}, into="left")
        d = found.points[:, 0] - seen(q)
        squares.append(np.mean([x @ np.linalg.solve(S[0], x) / 3 for x, S in zip(d, found.covariance, strict=True)]))
    assert 0.2 < np.mean(squares) < 3.0  # of 54 numbers, of which those of one rig share its errors


@pytest.mark.slow
def test_the_result_is_stored_checked_updated_and_planned(tmp_path):
    part, _, _ = drawn(0, 40)
    result = uq.calibrate(part(slice(0, 30)))
    result.save(tmp_path / "result.json")
    again = uq.load(tmp_path / "result.json")
    assert again.to_dict() == result.to_dict()
    assert not uq.check(again, part(slice(30, 40))).changed
    updated = uq.update(again, part(slice(30, 40)))
    assert updated.rig.arms["second"].joints.shape == (40, 6)
    whole = uq.calibrate(part(slice(None)))
    sd = np.sqrt(np.diag(whole.covariance)).reshape(-1, 6)
    for one, other, of in zip(updated.poses, whole.poses, sd, strict=True):
        assert (np.abs(one[:3, 3] - other[:3, 3]) < 0.05 * of[3:]).all()
    assert set(uq.plan(again, k=2, sample=20).robots) == {"first", "second"}
