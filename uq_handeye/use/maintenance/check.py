"""Check whether a calibration still holds, by one or more new poses.

The residuals of the new poses against the stored result, with its joint covariance, are tested as a whole
(`reference`). Whatever the answer, the result states which change these poses would have shown (`power`). Where the
result no longer holds, it names the cause, as far as the poses separate the causes (`causes`), and its size.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from ...calibration.estimate.estimated import Estimated
from ...calibration.evidence.new_poses import PoseEvidence, evidence_of_poses
from ...calibration.evidence.same_things import ROBOT, THINGS, others_by_pictures
from ...calibration.prediction.predict import poses_so_far
from ...calibration.rig_result import RigCalibration
from ...calibration.statement.tolerance import Tolerance
from ...core.formatting.numbers import digits
from ...core.geometry.se3 import difference
from ...core.numbers.levels import DOUBTFUL, UNUSUAL
from ...core.numbers.limits import VISIBLE_CHANGE
from ...errors import InputError
from ...findings import Finding
from ...model.noise.joint_covariance import Index
from ...model.noise.models import PoseNoise
from ...model.poses.pose_pairs import PosePairs
from ...model.rig.description import Rig, require_left_out
from ...model.rig.single import poses_like
from . import check_text as check_text  # registers the text of a result
from .causes import (
    CAMERA_MOVED,
    FOCAL_LENGTH,
    ONE_POSE,
    TARGET_MOVED,
    TARGET_SIZE,
    Causes,
    columns_of_causes,
    compare_causes,
    distances,
    later_move,
)
from .check_result import CANNOT_TELL, CHANGED, UNCHANGED, ChangeCheck, Detectable, detectable_changes
from .check_views import RigCheck, check_rig
from .joined_poses import common_poses
from .misread import misread, scale_finding

# Poses of joints that are farther from those of the files (rad, share of the reach) are of another arm.
ANOTHER_ARM_SHARE = 0.05


@overload
def check(result: RigCalibration, poses: Rig, **options: Any) -> RigCheck: ...
@overload
def check(result: Estimated, poses: PosePairs, **options: Any) -> ChangeCheck: ...
def check(  # type: ignore[misc]
    result: Any,
    poses: Any,
    *,
    noise: PoseNoise | None = None,
    joints: ArrayLike | None = None,
    tolerance: Any = None,
    level: float = UNUSUAL.probability,
    same: Iterable[str] | str = THINGS,
) -> ChangeCheck | RigCheck:
    """Check whether a calibration still holds, by new poses of the same rig.

    Parameters
    ----------
    result : Calibration or RigCalibration
        With the joint covariance of X and W: of poses, by ``efficient`` or ``ml``. Of several cameras,
        targets and arms: ``poses`` is a Rig, and ``same`` are names in it (`uq_handeye.use.maintenance.check_views`).
    poses : PosePairs
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
        and ``detectable``: the smallest change that these poses would have shown with 95 % probability.

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
    if not 0 < level < 0.5:
        raise InputError(f"Expected `level` to lie between 0 and 0.5, got {level!r}.")
    accepted = None if tolerance is None else Tolerance.read(tolerance)
    if isinstance(result, RigCalibration):
        require_left_out("of a rig", noise=noise, joints=joints)
        limits = None if accepted is None else (accepted.translation, accepted.rotation)
        return check_rig(result, poses, level=level, tolerance=limits, same=None if same is THINGS else same)
    if isinstance(poses, Rig):
        poses = poses_like(poses, result.names)
    evidence = evidence_of_poses(result, poses, noise, joints, same)
    _require_new(result, poses)
    reference = evidence.test.reference
    columns = columns_of_causes(evidence, poses.setup)
    detectable = detectable_changes(
        evidence.information(columns[CAMERA_MOVED]), evidence.information(columns[TARGET_MOVED]), reference, level
    )
    axes = {CAMERA_MOVED: result.X[:3, :3], TARGET_MOVED: np.eye(3) if result.W is None else result.W[:3, :3]}
    causes = compare_causes(evidence, columns, reference, axes)
    p_value = reference.p_value(evidence.d2)
    if p_value < level:
        status, findings = _of_change(result, poses, evidence, causes, (noise, joints, same))
    else:
        coarse = _coarse(detectable, accepted, evidence)
        status, findings = (UNCHANGED, []) if coarse is None else (CANNOT_TELL, [coarse])
        if p_value > 1 - DOUBTFUL.probability and any(
            one.accuracy is not None and one.default for one in result.shared
        ):
            findings.append(Finding("maintenance.overstated", "note"))
    named, so_far = causes.named, poses_so_far(result)
    moved = causes[TARGET_MOVED if named is not None and named.name == TARGET_MOVED else CAMERA_MOVED]
    return ChangeCheck(
        status=status,
        p_value=p_value,
        d2=evidence.d2,
        dof=evidence.dof,
        noise_dof=None if reference.noise_given else reference.noise_dof,
        level=level,
        detectable=detectable,
        causes=causes,
        shift=moved.estimate,
        covariance=moved.covariance,
        shift_of="W" if moved.name == TARGET_MOVED else "X",
        distances=distances(evidence),
        findings=tuple(findings),
        setup=poses.setup,
        n_poses=poses.n,
        n_calibrated=None if so_far is None else so_far.n,
        tolerance=None if accepted is None else str(accepted),
        focal_length_px=next((one.focal_length_px for one in result.shared if one.focal_length_px), None),
    )


def _of_change(
    result: Estimated,
    poses: PosePairs,
    evidence: PoseEvidence,
    causes: Causes,
    asked: tuple[PoseNoise | None, ArrayLike | None, Iterable[str] | str],
) -> tuple[str, list[Finding]]:
    """Status and findings of poses that contradict the calibration; ``asked``: noise, joints and what is the same."""
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

    first = causes.named
    lens = any(one.name == FOCAL_LENGTH and one.explains for one in causes.all)
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
    if first is not None and first.name == ONE_POSE:
        return CANNOT_TELL, [Finding("maintenance.one_pose_wrong", "caution", {"row": first.row, "n": poses.n})]
    if (since := later_move(evidence, columns_of_causes(evidence, poses.setup))) is not None:
        name, row = since
        values = {"name": name, "setup": poses.setup, "row": row, "n": poses.n}
        return CHANGED, [Finding("maintenance.moved_since", "caution", values)]
    if not causes.explained:
        return CHANGED, [Finding("maintenance.unexplained", "caution", {"p_value": causes.all[0].p_left})]
    return CHANGED, [Finding("maintenance.few_poses", "note", {"n": poses.n})] if poses.n < 3 else []


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


def _coarse(detectable: Detectable, accepted: Tolerance | None, evidence: PoseEvidence) -> Finding | None:
    """Return what these poses would have missed, if that matters."""
    if accepted is None:
        distance = float(np.median(np.linalg.norm(evidence.camera[:, :3, 3], axis=-1)))
        limits: tuple[float | None, float | None] = VISIBLE_CHANGE * distance, VISIBLE_CHANGE
    else:
        limits = accepted.translation, accepted.rotation
    found = detectable.X_translation, detectable.X_rotation
    if all(limit is None or value <= limit for value, limit in zip(found, limits, strict=True)):
        return None
    move, turn = (value if np.isfinite(value) else None for value in found)
    values = {"translation": move, "rotation": turn, "translation_limit": limits[0], "rotation_limit": limits[1]}
    return Finding("maintenance.coarse", "caution", values | {"given": accepted is not None})
