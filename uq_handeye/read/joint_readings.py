"""Choice of the reading of joint values by the other poses, those of the controller beside them or of the camera.

Joint 3 of a FANUC arm is read in both ways, as the joint and as the pendant shows it, and the way is taken by which the
poses agree, with a finding that says so. Where joints without poses of the controller disagree with the camera, the
other readings of `model.kinematics.joint_readings` are tried, and one that fits is named; what confirms it is an option
or a change of the columns. Joints beside poses of the controller are judged by `calibrate`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import PurePath
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array, inverse
from ..core.limits import MIN_POSES_TO_DECIDE
from ..core.rounding import CHAIN_ROUNDING
from ..findings import Finding
from ..fit.diagnostics.consistency import LARGE_ROTATION_RAD, MAX_MISFIT_SHARE, consistency
from ..fit.diagnostics.covariance_convention import MAX_POSES
from ..model.kinematics.against_controller import MAX_MEDIANS, compare_with_controller
from ..model.kinematics.chain import Kinematics
from ..model.kinematics.forward import LEVER_M
from ..model.kinematics.joint_readings import (
    COUPLED,
    PERCENT,
    JointReading,
    JointSeries,
    is_fanuc,
    likely_readings,
    other_arms,
    single_readings,
    uncoupled,
)
from ..model.poses.pose_pairs import PosePairs
from ..model.poses.residuals import rotation_angles
from .joints import Joints
from .readings import DECISIVE_RATIO

# Rows are left out whose rotations against the others differ from the camera's by more than `MAX_MEDIANS` medians and
# this angle, unless fewer than this share would stay.
MIN_APART_RAD, MIN_SHARE_OF_ROWS = np.radians(0.5), 0.7
# Shares of ranges that are only the limits of the arm fit roughly: they are named if they fit better by this factor.
PERCENT_RATIO = 4.0


class _Misfit(NamedTuple):
    rotation: float  # RMS, rad
    translation: float  # RMS, m
    fits: bool

    @property
    def cost(self) -> float:
        """Both in m, by `LEVER_M`."""
        return float(np.hypot(self.translation, LEVER_M * self.rotation))


def read_by_the_poses(poses: PosePairs, arm: Joints, series: Array | None, by_controller: bool) -> PosePairs:
    """Return pairs with joints with these in the reading by which they agree with the other poses, and findings on it.

    Parameters
    ----------
    poses : with the joints as they were read
    arm : their file
    series : (n, K) values of a longer series of columns at the poses
    by_controller : the robot poses are those of a file of the controller, not of the joints
    """
    assert poses.joints is not None
    if poses.n < MIN_POSES_TO_DECIDE:
        return poses
    chain, rows = arm.kinematics, np.unique(np.linspace(0, poses.n - 1, min(poses.n, MAX_POSES)).astype(int))
    few = PosePairs(poses.robot[rows], poses.camera[rows], poses.setup, joints=poses.joints[rows])

    def misfit(q: Array) -> _Misfit:
        return _against_controller(chain, q, few) if by_controller else _against_camera(chain.poses(q), few)

    found: list[Finding] = []
    now = misfit(poses.joints[rows])
    if is_fanuc(chain) and not arm.pendant:
        other = misfit(uncoupled(poses.joints[rows]))
        if coupled := _decides(other, now):
            poses = _with(poses, chain, uncoupled(poses.joints), by_controller)
        if coupled or _decides(now, other):
            now, other = (other, now) if coupled else (now, other)
            values = {"name": PurePath(arm.name).name, "joint": chain.names[2], "coupled": coupled}
            values |= {"rotation": now.rotation, "other": other.rotation}
            found.append(Finding("kinematics.joint_3", "note", values))
    if not by_controller and not now.fits:
        longer = None if series is None or arm.series is None else JointSeries(arm.series.names, series[rows])
        if (meant := _meant(chain, few, longer, arm.pendant, now)) is not None:
            values = {"name": PurePath(arm.name).name, "meant": meant[0], "joints": list(meant[1])}
            values |= {"rotation": now.rotation, "translation": now.translation}
            found.append(Finding("kinematics.another_reading", "failure", values))
    return replace(poses, findings=(*poses.findings, *found)) if found else poses


def _with(poses: PosePairs, chain: Kinematics, q: Array, by_controller: bool) -> PosePairs:
    robot = poses.robot if by_controller else chain.poses(q)
    return replace(poses, joints=q, robot=robot)


def _decides(one: _Misfit, other: _Misfit) -> bool:
    """Return whether one reading fits, and far better than the other."""
    least = max(one.rotation, CHAIN_ROUNDING), max(one.translation, CHAIN_ROUNDING)
    better = other.rotation > DECISIVE_RATIO * least[0] or other.translation > DECISIVE_RATIO * least[1]
    return one.fits and better


def _against_controller(chain: Kinematics, q: Array, poses: PosePairs) -> _Misfit:
    against = compare_with_controller(chain, q, poses.robot, explain=False)
    return _Misfit(*against.rms, against.same_arm)


def _against_camera(robot: Array, poses: PosePairs) -> _Misfit:
    """Return how far the target moves in the base, in the setup in which it moves less; wrong rows are left out."""
    rows = _agreeing_rows(robot, poses.camera)
    robot, camera = robot[rows], poses.camera[rows]
    travel = float(np.linalg.norm(np.std(robot[:, :3, 3], axis=0)))
    both = (robot, inverse(robot)) if poses.setup == "eye-in-hand" else (inverse(robot), robot)
    best = _Misfit(np.pi, travel, False)
    for G in both:
        fit = consistency(G, camera)
        if fit is not None and fit[0] < best.rotation:
            best = _Misfit(*fit[:2], fit[0] <= LARGE_ROTATION_RAD and fit[1] <= MAX_MISFIT_SHARE * travel)
    return best


def _agreeing_rows(robot: Array, camera: Array) -> NDArray[np.bool_]:
    """Return the rows that rotate against most others as the camera sees it; all, where too few do."""
    between = [rotation_angles(T[:, None, :3, :3].mT @ T[None, :, :3, :3]) for T in (robot, camera)]
    apart = np.median(np.abs(between[0] - between[1]), axis=1)
    rows = apart <= max(MAX_MEDIANS * float(np.median(apart)), MIN_APART_RAD)
    return rows if rows.mean() >= MIN_SHARE_OF_ROWS else np.ones(len(rows), dtype=bool)


def _meant(
    kinematics: Kinematics, few: PosePairs, series: JointSeries | None, pendant: bool, now: _Misfit
) -> tuple[str, tuple[str, ...]] | None:
    """Return the name of the reading by which robot and camera agree, and what it is about; None if there is none."""
    q = few.joints
    assert q is not None

    def first(readings: Iterator[JointReading]) -> tuple[str, tuple[str, ...]] | None:
        decided = is_fanuc(kinematics) or pendant
        open_ones = (one for one in readings if one.name != COUPLED or not decided)
        for reading in _by_angles(open_ones, kinematics, few):
            other = _against_camera(kinematics.poses(reading.q), few)
            roughly = reading.name == PERCENT and other.rotation * PERCENT_RATIO < now.rotation
            if roughly or _decides(other, now):
                return reading.name, reading.joints
        return None

    if found := first(likely_readings(kinematics, q, series)):
        return found
    seen = _angles(few.camera)
    arms = [
        (_against_camera(T, few), names)
        for names, arm in other_arms(kinematics)
        if _rotate_alike(T := arm.poses(q), seen, 2.0 * LARGE_ROTATION_RAD)
    ]
    best, names = min(arms, key=lambda one: one[0].cost, default=(now, ()))
    return ("arm", names) if _decides(best, now) else first(single_readings(kinematics, q))


def _by_angles(readings: Iterator[JointReading], chain: Kinematics, poses: PosePairs) -> Iterator[JointReading]:
    """Yield readings by which robot and camera rotate by the same angles from each pose to the next, whatever X is."""
    seen = _angles(poses.camera)
    for reading in readings:
        most = 2.0 * LARGE_ROTATION_RAD * (PERCENT_RATIO if reading.name == PERCENT else 1.0)
        if _rotate_alike(chain.poses(reading.q), seen, most):
            yield reading


def _rotate_alike(T: Array, seen: Array, most: float) -> bool:
    """Return whether poses rotate from each to the next by the angles seen, but for ``most`` (rad) of most of them."""
    return bool(np.median(np.abs(_angles(T) - seen)) < most)


def _angles(T: Array) -> Array:
    return rotation_angles(T[:-1, :3, :3].mT @ T[1:, :3, :3])
