"""Check whether a calibration still holds, by one or more new poses.

The residuals of the new poses against the stored result, with its joint covariance, are tested as a whole, for a move
of each unknown pose before them, and for one among them (`judged`). Whatever the answer, the result states which change
these poses would have shown. Where the result no longer holds, it names the cause, as far as the poses separate the
causes (`causes`), and its size.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterable, Mapping, Sequence
from functools import singledispatch
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...calibration.estimated import Estimated
from ...calibration.evidence.new_poses import PoseEvidence, evidence_of_poses
from ...calibration.evidence.same_things import ROBOT, THINGS, others_by_pictures
from ...calibration.prediction.predict import poses_so_far
from ...calibration.rig_poses import RigPoses
from ...calibration.stored_result import not_a_result
from ...calibration.tolerance import Tolerance
from ...core.geometry.se3 import Array, difference
from ...core.levels import DOUBTFUL, UNUSUAL
from ...core.limits import VISIBLE_CHANGE
from ...core.presentation.numbers import digits
from ...core.rounding import CHAIN_ROUNDING
from ...errors import InputError
from ...findings import Finding
from ...fit.graph.rows import PredictiveReference
from ...model.errors.joint_covariance import Index
from ...model.errors.models import PoseNoise
from ...model.poses.pose_pairs import PosePairs
from ...model.rig.description import Rig, require_left_out
from . import check_text as check_text  # registers the text of a result
from .causes import (
    CAMERA_MOVED,
    FOCAL_LENGTH,
    ONE_POSE,
    TARGET_MOVED,
    TARGET_SIZE,
    candidates_of_poses,
    columns_of_causes,
    distances,
)
from .check_result import CANNOT_TELL, CHANGED, MOVED_SINCE, UNCHANGED, ChangeCheck, Move
from .compared_views import compared_views, p_of_pair
from .joined_poses import common_poses
from .judged import Compared, Judged, judged
from .misread import misread, scale_finding

# Poses of joints that are farther from those of the files (rad, share of the reach) are of another arm.
ANOTHER_ARM_SHARE = 0.05


def check(
    result: Estimated | RigPoses,
    poses: PosePairs | Rig,
    *,
    noise: PoseNoise | None = None,
    joints: ArrayLike | None = None,
    tolerance: Any = None,
    level: float = UNUSUAL.probability,
    same: Iterable[str] | str = THINGS,
) -> ChangeCheck:
    """Check whether a calibration still holds, by new poses of the same rig.

    Parameters
    ----------
    result : Calibration or RigCalibration
        With the joint covariance of X and W: of poses, by ``efficient`` or ``ml``. Of several cameras,
        targets and arms ``poses`` is a Rig, and ``same`` are names in it
        (`uq_handeye.use.maintenance.compared_views`).
    poses : PosePairs or Rig
        One or more new poses, of the same robot, camera and target. Three or more can separate a change from one
        wrong pose, and X from the target.
    noise : PoseNoise or None
        Of the new poses. None: that of the calibration.
    joints : (m, L) or None
        Joint values, for a calibration with kinematics; None: ``poses.joints``.
    tolerance : text, numbers or None
        Change of X that matters, such as ``"1mm,0.1deg"``: poses that would miss it cannot tell. None: 1 % of the
        distance of the target, and 0.01 rad.
    level : float
        Probability of a false alarm.
    same : names out of "robot", "camera" and "target"
        Which of them are those of the calibration, so that their errors are the same. Default: all. The errors of
        others are drawn again; X and W are those of the calibration all the same.

    Returns
    -------
    ChangeCheck
        ``status`` ("unchanged", "changed" or "cannot tell"), ``p_value``, ``cause``, ``shift`` with its ``covariance``,
        and ``moves``: of each pose also the smallest move that would have shown with 95 % probability.

    Raises
    ------
    InputError
        A calibration without joint covariance, of another setup, or with a part of X open; poses that the calibration
        used itself, or without the joints that it needs; noise or level that cannot be used.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> result = uq.calibrate(uq.simulate(n_poses=20, noise=noise, seed=1), noise=noise)
    >>> uq.check(result, uq.simulate(n_poses=5, noise=noise, seed=2)).status
    'unchanged'
    """
    accepted = None if tolerance is None else Tolerance.read(tolerance)
    new = compared_with(result, result.new_measurements(poses), Asked(noise, joints, same))
    found = judged(new.compared, level)
    limits = _limits(accepted, new.seen)
    if found.contradicted:
        status, findings = new.of_change(found)
    else:
        coarse = _coarse([one for one in found.moves if one.name in new.cameras], limits, accepted is not None)
        status, findings = (UNCHANGED, []) if coarse is None else (CANNOT_TELL, [coarse])
        if found.p_value > 1 - DOUBTFUL.probability and new.assumed_accuracy:
            findings.append(Finding("maintenance.overstated", "note"))
    return ChangeCheck(
        status, found.p_value, new.compared.rows.d2, new.compared.dof, _noise_dof(new.compared.reference(None)), level,
        found.moves, found.causes, new.distances, tuple(findings), new.n, new.n_before,
        new.of_pairs(found.p_value), new.unseen, limits, new.setup, None if accepted is None else str(accepted),
        new.focal_length_px,
    )  # fmt: skip


class Asked(NamedTuple):
    """Arguments of `check` on the new measurements."""

    noise: PoseNoise | None
    joints: ArrayLike | None
    same: Iterable[str] | str


class NewMeasurements(NamedTuple):
    """New measurements compared with a result, and what the answer says of them."""

    compared: Compared
    seen: Sequence[Array]  # (n, 4, 4) camera poses of each view
    cameras: Collection[str]  # names of the moves that are of cameras
    of_change: Callable[[Judged], tuple[str, list[Finding]]]  # status and findings where they contradict the result
    of_pairs: Callable[[float], dict[str, float]]  # p-value of each camera and target, by that of all
    distances: Array  # (n,) squared, of each pose or view
    n: int
    n_before: int | None  # of the calibration
    unseen: tuple[str, ...] = ()
    assumed_accuracy: bool = False  # whether an accuracy of the robot is assumed
    setup: str | None = None
    focal_length_px: float | None = None


@singledispatch
def compared_with(result: object, poses: object, asked: Asked) -> NewMeasurements:
    """Compare new measurements with a result: poses of one camera, or views of several."""
    raise not_a_result(result)


@compared_with.register
def _of_poses(result: Estimated, poses: PosePairs, asked: Asked) -> NewMeasurements:
    evidence = evidence_of_poses(result, poses, *asked)
    _require_new(result, poses)
    columns, so_far = columns_of_causes(evidence, poses.setup), poses_so_far(result)
    axes = {CAMERA_MOVED: result.X[:3, :3], TARGET_MOVED: np.eye(3) if result.W is None else result.W[:3, :3]}
    pair = f"{result.names.camera}, {result.names.target}"
    return NewMeasurements(
        _compared_poses(evidence, poses, columns, axes), [poses.camera], {CAMERA_MOVED},
        lambda found: _of_change(result, poses, evidence, found, asked), lambda p: {pair: p}, distances(evidence),
        poses.n, None if so_far is None else so_far.n, (),
        any(one.accuracy is not None and one.default for one in result.shared), poses.setup,
        next((one.focal_length_px for one in result.shared if one.focal_length_px), None),
    )  # fmt: skip


@compared_with.register
def _of_views(result: RigPoses, rig: Rig, asked: Asked) -> NewMeasurements:
    require_left_out("of a rig", noise=asked.noise, joints=asked.joints)
    compared, evidence, moments = compared_views(result, rig, None if asked.same is THINGS else asked.same)
    pairs = dict.fromkeys((view.camera, view.target) for view in rig.views)

    def of_change(found: Judged) -> tuple[str, list[Finding]]:
        return _named_change(found, evidence.graph.E, None if found.later is None else moments[found.later[1].begin])

    return NewMeasurements(
        compared, [view.poses for view in rig.views], result.rig.cameras, of_change,
        lambda _: {f"{camera}, {target}": p_of_pair(evidence, rig, camera, target) for camera, target in pairs},
        np.bincount(evidence.edges, compared.rows.r[:, 0] ** 2, evidence.graph.E).astype(float),
        evidence.graph.E, result.rig.n_views,
        tuple(name for name in (*result.rig.cameras, *result.rig.targets) if name not in compared.moved),
    )  # fmt: skip


def _noise_dof(reference: PredictiveReference) -> float | None:
    return None if reference.noise_given else reference.noise_dof


def _compared_poses(
    evidence: PoseEvidence, poses: PosePairs, columns: Mapping[str, Array], axes: Mapping[str, Array]
) -> Compared:
    """Return new poses of one camera compared with its calibration."""

    def reference(of: Array | None) -> PredictiveReference:
        if of is None:
            return evidence.test.reference
        U, s, _ = np.linalg.svd(evidence.whitened(of), full_matrices=False)
        return evidence.reference_along(U[:, s > s.max(initial=0.0) * CHAIN_ROUNDING])

    moment = np.arange(poses.n)
    if poses.timestamps is not None:
        moment[np.argsort(poses.timestamps, kind="stable")] = np.arange(poses.n)
    moved = {name: columns[name] for name in (CAMERA_MOVED, TARGET_MOVED)}
    causes = lambda: candidates_of_poses(evidence, columns, axes)  # noqa: E731
    return Compared(evidence, evidence.dof, reference, moved, causes, moment)


def _of_change(
    result: Estimated,
    poses: PosePairs,
    evidence: PoseEvidence,
    found: Judged,
    asked: Asked,
) -> tuple[str, list[Finding]]:
    """Status and findings of poses that contradict the calibration."""
    noise, joints, same = asked
    assert result.W is not None
    if others := _others(result, poses, joints):
        listed = "; another ".join(f"{thing} ({words})" for thing, words in others.items())
        return CANNOT_TELL, [Finding("maintenance.another_rig", "caution", {"things": listed})]

    def d2_of(again: PosePairs, rows: Index | None = None) -> float:
        of, q = (noise, joints) if rows is None else (
            None if noise is None else noise.rows(rows), None if joints is None else np.asarray(joints)[rows]
        )  # fmt: skip
        return evidence_of_poses(result, again, of, q, same).d2

    first = found.causes.named
    lens = any(one.name == FOCAL_LENGTH and one.explains for one in found.causes.all)
    # where the focal length explains the poses, a smaller factor on translations than 1.2 is no other reading
    other = (
        misread(result.X, result.W, poses, evidence, d2_of, least_factor=0.2)
        if lens
        else misread(result.X, result.W, poses, evidence, d2_of)
    )
    if other is None and first is not None and first.name == TARGET_SIZE:
        other = scale_finding("camera", float(1.0 + first.estimate[0]))
    if other is not None:
        return CANNOT_TELL, [other]
    step = None
    if found.later is not None:  # a place in the order of time
        order = np.arange(poses.n) if poses.timestamps is None else np.argsort(poses.timestamps, kind="stable")
        step = int(order[found.later[1].begin])
    return _named_change(found, poses.n, step, by_row=True)


def _named_change(found: Judged, n: int, since: Hashable, by_row: bool = False) -> tuple[str, list[Finding]]:
    """Status and findings of n poses or views that contradict a calibration, by the causes that explain them.

    ``since``: the pose from which on something moved, where it did among them, by its row or by its name.
    """
    first = found.causes.named
    if first is not None and first.name == ONE_POSE:
        which = {"of": first.of} if first.row is None else {"row": first.row}
        return CANNOT_TELL, [Finding("maintenance.one_pose_wrong", "caution", {"n": n, **which})]
    if found.later is not None:
        name, step = found.later
        turn, shift = (float(np.linalg.norm(part)) for part in (step.change[:3], step.change[3:]))
        values = {"name": name, "since": since, "rotation": turn, "translation": shift, "p_value": step.p}
        values |= {"n": n if by_row else None}
        return CHANGED, [Finding(MOVED_SINCE, "caution", values)]
    if not found.causes.explained:
        return CHANGED, [Finding("maintenance.unexplained", "caution", {"p_value": found.causes.all[0].p_left})]
    return CHANGED, [Finding("maintenance.few_poses", "note", {"n": n})] if n < 3 else []


def _others(result: Estimated, poses: PosePairs, joints: ArrayLike | None) -> dict[str, str]:
    """Return which of robot, camera and target are plainly others by what the files hold, in words."""
    found, fitted = others_by_pictures(poses_so_far(result), poses), result.kinematics
    q = poses.joints if joints is None else joints
    if fitted is not None and q is not None:
        off = difference(fitted.chain.poses(fitted.checked(q)), poses.robot)
        turn, shift = (float(np.median(np.linalg.norm(part, axis=-1))) for part in (off[:, :3], off[:, 3:]))
        if turn > ANOTHER_ARM_SHARE or shift > ANOTHER_ARM_SHARE * fitted.chain.reach:
            found[ROBOT] = (
                f"the joints are those of poses {digits(1e3 * shift, 2)} mm and {digits(np.degrees(turn), 2)} deg away "
                f"for {fitted.chain.name}, the arm of the result"
            )
    return found


def _require_new(result: Estimated, poses: PosePairs) -> None:
    """Raise `InputError` where a pose was used by the calibration: its errors are those of X, and show no change."""
    used = poses_so_far(result)
    if used is not None and (twice := common_poses(used, poses)):
        first = twice[0][0]
        raise InputError(
            f"{len(twice)} of the {poses.n} poses were used by the calibration itself (the first: pose {first}): they "
            "cannot show a change. Check new poses."
        )


def _limits(accepted: Tolerance | None, seen: Sequence[Array]) -> tuple[float | None, float | None]:
    """Return the change of a camera that must show: as accepted, or a share of the distance of the targets."""
    if accepted is not None:
        return accepted.translation, accepted.rotation
    distance = float(np.median(np.concatenate([np.linalg.norm(T[:, :3, 3], axis=-1) for T in seen])))
    return VISIBLE_CHANGE * distance, VISIBLE_CHANGE


def _coarse(moves: Sequence[Move], limits: tuple[float | None, float | None], given: bool) -> Finding | None:
    """Return what these poses would have missed of the cameras, if that matters."""
    for one in moves:
        found = one.least_shift, one.least_angle
        if all(limit is None or value <= limit for value, limit in zip(found, limits, strict=True)):
            continue
        move, turn = (value if np.isfinite(value) else None for value in found)
        values = {"name": one.name, "translation": move, "rotation": turn, "translation_limit": limits[0],
                  "rotation_limit": limits[1]}  # fmt: skip
        return Finding("maintenance.coarse", "caution", values | {"given": given})
    return None
