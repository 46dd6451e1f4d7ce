r"""Joint values of the poses of one data set, all in one branch of the inverse kinematics.

*Branch.* An arm of the table has its usual one. Of another arm of six or seven revolute joints, the pose in the middle
of all is solved from `N_STARTS` postures spread over the limits. Its different solutions are the branches, tried in the
order of

    0.2 (RMS distance of the joints from the middle of their limits, over half the range)
        - 2 (mean height of the joint frames + mean distance in front) / reach

elbow up and in front first, until one reaches the poses. The flip of a spherical wrist is not prescribed, as it only
changes signs of the errors of the arm.

*Postures.* Each pose starts from the middle posture; where that does not arrive, or beyond a singularity, from the
nearest of stored postures of the branch (`WorkPostures`): those that the middle posture reaches along a straight line
of joint values without a change of the sign of the Jacobian's determinant (with the elbow's roll held, for seven axes).
The elbow of seven axes has the roll of the middle posture at the start and moves only by the least change of the
joints; in the end it is moved to where the joints are nearest to the middle of their limits (`elbow.relaxed`), as
nothing else is known of it. Poses that were not reached start from the nearest pose that was. `newton.postures_at` does
the rest.

Chains of other joints start from the middle posture, and then from the nearest pose that was reached.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ...core.geometry.se3 import Array
from .chain import POSTURES_PER_BLOCK, Kinematics
from .elbow import MAX_JOINT_CHANGE_RAD, relaxed
from .forward import Frames, fixed_transforms, spread_postures
from .known_arms import arm_names, known_arm
from .newton import Postures, postures_at
from .stack import LEVER_SHARE, N_AXES, ROLL, ArmStack, spread
from .work_postures import WorkPostures, descend

# Number of postures, spread over the joint limits, from which the first pose is solved.
N_STARTS = 96
# Largest difference of a joint between postures of one pose that count as the same.
SAME_POSTURE_RAD = 0.3
# Share of the poses that a branch must reach for the search to end with it.
MIN_BRANCH_SHARE = 0.9


def postures_by_branch(kinematics: Kinematics, poses: Array, n_branches: int = 3) -> Postures:
    """Return joint values (n, L) whose tip is at ``poses`` (n, 4, 4) base_T_tip, in one branch, and which reached it.

    Joint values are inside the limits; angles are within half a turn of their circular mean where the limits allow it.
    A pose that is not reached has a posture near it. ``n_branches``: the most that are tried.
    """
    poses = np.asarray(poses, dtype=float)
    arm = _standing(kinematics)
    if arm is None:
        return _from_the_nearest(kinematics, poses)
    scaled = arm.standard(poses)
    best: Postures | None = None
    for middle, work in _branches(arm, scaled[_middle(scaled)], n_branches):
        found = _in_branch(kinematics, arm, poses, scaled, middle, work)
        if best is None or found.reached.sum() > best.reached.sum():
            best = found
        if best.reached.mean() >= MIN_BRANCH_SHARE:
            break
    assert best is not None
    return best


def all_branches(kinematics: Kinematics, poses: Array, n_branches: int = 16) -> list[Array]:
    """Return joint values (n, L) of the poses (n, 4, 4) in each branch found that reaches all of them.

    Each solution of the pose in the middle is followed to the others in two ways: from neighbour to neighbour, and as
    `postures_by_branch` does.
    """
    arm, poses = _standing(kinematics), np.asarray(poses, dtype=float)
    found: list[Array] = []
    if arm is None:
        return found
    scaled = arm.standard(poses)
    for middle, work in _branches(arm, scaled[_middle(scaled)], n_branches):
        ways = [_in_branch(kinematics, arm, poses, scaled, middle, work)]
        if middle is not None:
            ways.append(_followed(kinematics, poses, scaled, arm.own(middle[None])[0]))
        for q in (_unwound(kinematics, way.q) for way in ways if way.reached.all()):
            if all(np.abs(_wrapped(q - other)).max() > SAME_POSTURE_RAD for other in found):
                found.append(q)
    return found


def _in_branch(
    kinematics: Kinematics, arm: _Arm, poses: Array, scaled: Array, middle: Array | None, work: WorkPostures
) -> Postures:
    """Postures from the middle one, from the stored ones of its branch, and from the nearest poses reached."""
    step = POSTURES_PER_BLOCK
    parts = [scaled[k : k + step] for k in range(0, len(poses), step)]
    q = np.concatenate([_along_the_branch(arm.stack, middle, work, part) for part in parts])
    found = postures_at(kinematics, poses, _unwound(kinematics, arm.own(q)))
    if not found.reached.all() and found.reached.any():
        found = _repaired(kinematics, poses, scaled, found)
    return relaxed(kinematics, poses, found) if kinematics.n_joints == N_AXES else found


def _followed(kinematics: Kinematics, poses: Array, scaled: Array, middle: Array) -> Postures:
    """Postures from that of the pose in the middle, each from that of its nearest neighbour reached before.

    Joints change by less than `MAX_JOINT_CHANGE_RAD` as long as any pose is reached that way.
    """
    flat = _flat(scaled)
    q, reached = np.tile(middle, (len(poses), 1)), np.zeros(len(poses), dtype=bool)
    first = _middle(scaled)
    q[first] = postures_at(kinematics, poses[[first]], middle[None]).q[0]
    reached[first] = True
    for _ in range(24):
        left = np.flatnonzero(~reached)
        if not len(left):
            break
        away = ((flat[left, None] - flat[reached]) ** 2).sum(axis=-1)
        soon = away.min(axis=1) <= np.median(away.min(axis=1))
        start = q[reached][away.argmin(axis=1)[soon]]
        again = postures_at(kinematics, poses[left[soon]], start)
        good = again.reached & (np.abs(again.q - start).max(axis=1) < MAX_JOINT_CHANGE_RAD)
        if not good.any():
            return _repaired(kinematics, poses, scaled, Postures(q, reached))
        q[left[soon][good]] = again.q[good]
        reached[left[soon][good]] = True
    return Postures(q, reached)


def _flat(scaled: Array) -> Array:
    """(n, 12) coordinates of poses (n, 3, 4) whose differences count alike."""
    return np.concatenate([scaled[..., :3].reshape(len(scaled), 9), scaled[..., 3] / LEVER_SHARE], axis=1)


# Arms of six or seven revolute joints


class _Arm(NamedTuple):
    """A chain with joint 1 about the base's z, joint 7 about the tip's, and reach 1, and its usual branch."""

    stack: ArmStack
    base: Array  # (4, 4) base_T of the frame of joint 1
    tip: Array  # (4, 4) tip_T of a frame on the axis of the last joint
    work: WorkPostures | None
    up: Array  # (3,) in the frame of joint 1

    def standard(self, poses: Array) -> Array:
        """(n, 3, 4) poses of that tip in that base, lengths over the reach."""
        out = (np.linalg.inv(self.base) @ poses @ self.tip)[:, :3]
        out[..., 3] /= self.stack.reach[0]
        return np.asarray(out)

    def own(self, q: Array) -> Array:
        """(n, L) joint values from (n, 7)."""
        return q if self.stack.moves[0, ROLL] else np.delete(q, ROLL, axis=1)


@functools.lru_cache(maxsize=32)
def _standing(kinematics: Kinematics) -> _Arm | None:
    """The arm in that form; None for chains of other joints."""
    L = kinematics.n_joints
    if L not in (N_AXES - 1, N_AXES) or not kinematics.revolute.all():
        return None
    fixed = fixed_transforms(kinematics.joints, kinematics.end)
    base, end = fixed[0].copy(), fixed[L].copy()
    on_axis = np.eye(4)
    on_axis[2, 3] = end[2, 3]
    fixed[0], fixed[L] = np.eye(4), on_axis
    limits, moves = _range(kinematics), np.ones(L, dtype=bool)
    if L < N_AXES:
        fixed = np.insert(fixed, ROLL, np.eye(4), axis=0)
        limits, moves = np.insert(limits, ROLL, 0.0, axis=0), np.insert(moves, ROLL, False)
    reach = max(kinematics.reach, 1e-3)
    fixed[:, :3, 3] /= reach
    usual = _usual_ranges(kinematics)
    stack = ArmStack(
        fixed[None, :, :3],
        moves[None],
        limits[None],
        (limits if usual is None else np.insert(usual, ROLL, 0.0, axis=0) if L < N_AXES else usual)[None],
        np.array([reach]),
        np.full((1, N_AXES), np.inf),
    )
    work = None if usual is None else WorkPostures.of(stack)
    return _Arm(stack, base, np.linalg.inv(end) @ on_axis, work, base[:3, :3].T @ kinematics.up)


def _usual_ranges(kinematics: Kinematics) -> Array | None:
    """(L, 2) usual ranges of the joints, of an arm of the table on any base, with any tip."""
    between = fixed_transforms(kinematics.joints, kinematics.end)[1:-1]
    for name in arm_names():
        arm = known_arm(name)
        if len(arm.usual) == kinematics.n_joints and np.allclose(
            fixed_transforms(arm.parts.joints, arm.parts.end)[1:-1], between, atol=1e-6
        ):
            return arm.usual
    return None


def _branches(arm: _Arm, pose: Array, most: int, steps: int = 24) -> Iterator[tuple[Array | None, WorkPostures]]:
    """The usual branch, then those of one pose (3, 4), up to ``most``: its posture (7,) and stored ones."""
    if arm.work is not None:
        yield None, arm.work
    stack = arm.stack
    start = spread(stack.limits[0], N_STARTS)[None]
    low, high = stack.limits.transpose(2, 0, 1)[..., None]
    q, frames, reached = descend(stack, start, np.repeat(pose[None], N_STARTS, axis=0), low, high, steps)
    up, origin = arm.up, frames.p[0]  # (7, 3, n)
    ahead = pose[:, 3] - (pose[:, 3] @ up) * up
    ahead = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    placed = np.einsum("kin,i->n", origin - origin[:1], up + ahead) / N_AXES
    half = np.maximum((high - low)[0] / 2, 1e-9)
    off = np.sqrt((((q[0] - (high + low)[0] / 2) / half) ** 2).mean(axis=0))
    order = np.argsort(0.2 * off - 2.0 * placed, kind="stable")
    found: list[Array] = []
    for k in order[reached[0, order]] if reached.any() else order[:1]:
        one = q[0, :, k]
        if all(np.abs(_wrapped(one - other)).max() > SAME_POSTURE_RAD for other in found):
            found.append(one)
            yield one, WorkPostures.at(stack, _same_branch(stack, one))
        if len(found) == most:
            return


def _same_branch(stack: ArmStack, middle: Array) -> Array:
    """(1, 7, S) postures that a straight line joins to ``middle`` (7,) without a singularity, joints 1 and 7 at 0."""
    limits = stack.limits[0].copy()
    limits[[0, ROLL, N_AXES - 1]] = np.array([0.0, middle[ROLL], 0.0])[:, None]
    centre = middle.copy()
    centre[[0, N_AXES - 1]] = 0.0
    q = spread(limits, 800)
    along = np.linspace(0.0, 1.0, 6)
    line = centre[:, None, None] + along * (q - centre[:, None])[..., None]  # (7, S, 6)
    side = _side(stack, stack.frames(line.reshape(1, N_AXES, -1))).reshape(q.shape[1], -1)
    same = (side == side[:, :1]).all(axis=1)
    return np.concatenate([centre[:, None], q[:, same]], axis=1)[None]


def _side(stack: ArmStack, frames: Frames) -> Array:
    """(n,) sign of the determinant of the Jacobian, the elbow's roll held."""
    J = np.delete(stack.twists(frames)[0], ROLL, axis=0)  # (6, 6, n)
    return np.asarray(np.sign(np.linalg.det(np.moveaxis(J, -1, 0))))


def _along_the_branch(
    stack: ArmStack, middle: Array | None, work: WorkPostures, poses: Array, steps: int = 12
) -> Array:
    """(n, 7) postures of poses (n, 3, 4) from the middle posture; from the stored ones where that leaves the branch."""
    if middle is None:
        return np.asarray(work.find(poses, steps)[0][0].T)
    start = np.repeat(middle[None, :, None], len(poses), axis=2)
    q, frames, reached = descend(stack, start, poses, work.low, work.high, steps)
    side = _side(stack, stack.frames(middle[None, :, None]))
    out, left = np.array(q[0].T), ~reached[0] | (_side(stack, frames) != side)
    if left.any():
        again, frames, found = work.find(poses[left], steps)
        better = found[0] & (_side(stack, frames) == side) | ~reached[0, left]
        out[np.flatnonzero(left)[better]] = again[0].T[better]
    return out


def _repaired(kinematics: Kinematics, poses: Array, scaled: Array, found: Postures) -> Postures:
    """``found`` with the postures of poses that were not reached tried from that of the nearest one that was."""
    q, reached = found.q.copy(), found.reached.copy()
    flat = _flat(scaled)
    for _ in range(3):
        left = np.flatnonzero(~reached)
        nearest = ((flat[left, None] - flat[reached]) ** 2).sum(axis=-1).argmin(axis=1)
        again = postures_at(kinematics, poses[left], q[reached][nearest])
        q[left[again.reached]] = again.q[again.reached]
        reached[left] = again.reached
        if reached.all() or not again.reached.any():
            break
    return Postures(q, reached)


def _middle(poses: Array) -> int:
    """Return the number of the pose (n, 3, 4), lengths over the reach, that is nearest to the mean."""
    flat = _flat(poses)
    return int(np.argmin(((flat - flat.mean(axis=0)) ** 2).sum(axis=1)))


# Chains of other joints


def _from_the_nearest(kinematics: Kinematics, poses: Array) -> Postures:
    """Postures from that of the middle pose, then from those of the nearest poses that were reached."""
    scaled = poses[:, :3].copy()
    scaled[..., 3] /= max(kinematics.reach, 1e-3)
    start = spread_postures(_range(kinematics), kinematics.revolute, N_STARTS)
    first = postures_at(kinematics, np.repeat(poses[_middle(scaled)][None], N_STARTS, axis=0), start)
    away = ((first.q - start.mean(axis=0)) ** 2).sum(axis=1) + np.where(first.reached, 0.0, 1e9)
    found = postures_at(kinematics, poses, np.repeat(first.q[np.argmin(away)][None], len(poses), axis=0))
    return _repaired(kinematics, poses, scaled, found) if found.reached.any() and not found.reached.all() else found


def _unwound(kinematics: Kinematics, q: Array) -> Array:
    """``q`` with angles within half a turn of their circular mean, or where the limits are by a turn more or less."""
    low, high = kinematics.limits.T
    mean = np.angle(np.exp(1j * q).mean(axis=0))
    out = mean + _wrapped(q - mean)
    for turn in (2 * np.pi, -2 * np.pi):
        outside, fits = (out < low) | (out > high), (out + turn >= low) & (out + turn <= high)
        out = np.where(outside & fits, out + turn, out)
    return np.asarray(out)


def _range(kinematics: Kinematics) -> Array:
    """(L, 2) limits, those of angles at most a turn apart, those of lengths finite."""
    low, high = kinematics.limits.T
    half = np.where(kinematics.revolute, np.pi, 1.0)
    both = np.isfinite(low) & np.isfinite(high)
    middle = np.where(np.isfinite(low), low + half, np.where(np.isfinite(high), high - half, 0.0))
    middle[both] = (low[both] + high[both]) / 2
    narrow = both & ((high - low < 2 * half) | ~kinematics.revolute)
    half[narrow] = (high[narrow] - low[narrow]) / 2
    return np.stack([middle - half, middle + half], axis=1)


def _wrapped(angle: Array) -> Array:
    """Angles within half a turn."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
