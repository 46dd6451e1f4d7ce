r"""Points that the camera saw and the robot touched, or independent poses, against a stored calibration.

*Poses* (`evidence.new_poses`): chi-square of their residuals. Where the camera poses come from corners, the corners of
the board as predicted from the robot pose, X and W are compared with those of the board as seen. The covariance
predicts the RMS distance ``sqrt(mean trace(J S J^T))``, J the derivative of a corner by the pose of the board, S the
covariance of a new pose measured. Without distortion of the lens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from ...calibration.estimate.estimated import Estimated
from ...calibration.evidence.new_poses import evidence_of_poses
from ...calibration.evidence.touches import Touches, TouchEvidence, evidence_of_touches
from ...calibration.prediction.predict import predict_camera
from ...core.files.records import Record
from ...core.formatting.numbers import digits, probability
from ...core.formatting.units import parse_deviations, parse_length
from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array, inverse
from ...core.presentation.document import COLUMNS, Answer, Document, Paragraph, document_of
from ...core.presentation.shown import Shown
from ...errors import InputError, keywords_of, require_known
from ...findings import Finding
from ...fit.diagnostics.task_space import by_pose
from ...model.camera.intrinsics_file import camera_matrix
from ...model.poses.pose_pairs import PosePairs
from ..maintenance.causes import misread
from ..maintenance.update import require_other_touches
from .power import Bias, bias_of, limit, next_touches, touches_needed
from .result import LEVEL, Needed, PointTable, Verification
from .touches_file import require_metres

# Size of a bias (m) whose number of touches is stated where none is asked for.
SHOWN = 0.5e-3
# An inverted robot pose explains touches if it divides their RMS difference by so much.
_EXPLAINS = 10.0


@dataclass(frozen=True, eq=False)
class VerifyRequest:
    """The arguments of `verify` beside the calibration and the points; see there."""

    robot: Any = None
    joints: Any = None
    touched_robot: Any = None
    touched_joints: Any = None
    tool: Any = None
    touch_sd: Any = None
    point_sd: Any = None
    tool_sd: float | str = 0.0
    board: Any = None
    board_covariance: Any = None
    same_camera: bool = True
    robot_noise: Any = None
    names: Sequence[str] = ()
    show: float | str = SHOWN
    candidates: Any = None

    @property
    def size(self) -> float:
        """`show` in m."""
        if not (size := parse_length(self.show, "show (--show)")) > 0:
            raise InputError(f"Expected `show` (--show) to be above 0, got {self.show!r}.")
        return size

    def touches(self, seen: Any, touched: Any) -> Touches:
        """Return the points with what belongs to them."""
        parts = {part.name: getattr(self, part.name) for part in fields(Touches) if hasattr(self, part.name)}
        given = None if touched is None else as_numbers(touched, "touched")
        if given is not None and given.ndim >= 2 and given.shape[-2:] == (4, 4):
            parts["touched_robot"], given = given, None
        points = np.atleast_2d(as_numbers(seen, "seen"))
        if self.touch_sd is None:
            raise InputError("Expected `touch_sd`, the standard deviation of a touch per axis, such as '0.2mm'.")
        parts |= {
            "seen": points, "touched": given, "seen_covariance": covariances_of(self.point_sd, len(points)),
            "touch_sd": _length(self.touch_sd, "touch_sd"), "tool_sd": tool_deviation(self.tool_sd),
            "robot_noise": robot_covariance(self.robot_noise), "names": tuple(map(str, self.names)),
        }  # fmt: skip
        return Touches(**parts)


def verify(result: Estimated, seen: Any, touched: Any = None, **asked: Any) -> Verification:
    """Test a calibration by points that its camera saw and a tool touched.

    Model: `evidence.touches`. The difference of touch and point has the covariance of X, the shared errors, the robot,
    the tool, seeing and touching. Answers whether the differences fit it, how large a bias (an offset of all touches)
    is, and which bias these touches would have shown.

    Parameters
    ----------
    result : Calibration
        With the joint covariance of X and W (poses, method efficient or ml).
    seen : (m, 3), or Touches
        Points in the camera frame, m. With `board`: points of the board.
    touched : (m, 3), (m, 4, 4) or None
        Points touched, in the base, m; or the robot poses ``base_T_gripper`` at the touch, as `touched_robot`.
    robot, joints : (m, 4, 4), (m, L) or None
        Robot pose or joints (rad) at which each point was seen, for a camera on the robot.
    touched_robot, touched_joints : (m, 4, 4), (m, L) or None
        Robot pose or joints at the touch. Beside `touched`, the poses tell the orientation of the tool.
    tool : (3,) or None
        Tip of the tool in the flange frame, m; None: its origin.
    touch_sd : float, str or (m,)
        Standard deviation of a touch per axis, m or ``"0.2mm"``.
    point_sd : float, str, (m,), (m, 3) or (m, 3, 3)
        Noise of the points in the camera frame: standard deviations, or covariances. None: the noise of a camera pose
        in the calibration.
    tool_sd : float or str
        Standard deviation of the tool's offset per axis, m, ``"0.3mm"``; 0 is exact, ``"unknown"`` unknown.
    board, board_covariance : (m, 4, 4), (m, 6, 6) or None
        Poses ``camera_T_target`` of a board and their covariance. `seen` are then points of the board.
    same_camera : bool
        False for points of another sensor in the frame of the camera, such as depth: the errors of the calibration's
        focal length and image centre are not theirs.
    robot_noise : (rotation, translation), (6, 6) or None
        Noise of one robot pose: standard deviations such as ``("0.02deg", "0.05mm")``, or its covariance. None: that of
        the calibration, which holds a part of the camera's noise where it was estimated.
    names : sequence of str
    show : float or str
        Bias whose number of touches is computed, m or ``"0.5mm"``.
    candidates : (c, 3) or None
        Points in the camera frame (or of the board) that could be touched next. None: the region of the points so far.

    Returns
    -------
    Verification

    Raises
    ------
    InputError
        A calibration without joint covariance, shapes that do not fit, missing robot poses, millimetres for metres.

    Examples
    --------
    >>> import numpy as np
    >>> import uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> result = uq.calibrate(uq.simulate(setup="eye-to-hand", noise=noise, seed=1), noise=noise)
    >>> seen = np.array([[0.1, 0, 0.7], [-0.1, 0, 0.8], [0, 0.1, 0.7], [0, -0.1, 0.9]])
    >>> touched = seen @ result.X[:3, :3].T + result.X[:3, 3] + [0.0, 0.0, 0.01]
    >>> uq.verify(result, seen, touched, touch_sd="0.2mm", point_sd="0.3mm").contradicted
    True
    """
    require_known("verify", asked, VerifyRequest)
    request = VerifyRequest(**asked)
    touches = seen if isinstance(seen, Touches) else request.touches(seen, touched)
    require_metres(result, touches)
    evidence = evidence_of_touches(result, touches)
    require_other_touches(result, touches, evidence)
    size, known = request.size, touches.tool_known
    bias = bias_of(evidence, known)
    level, (p_bias, p_scatter), (worst, direction) = bias.level, bias.p_values, bias.worst
    at_least = limit(evidence, known, level)
    tool = None if known else evidence.explained_by(evidence.by_tool)
    part = np.abs(bias.hidden.T @ bias.hidden) > 1e-6
    hidden = np.diag(part)
    covariance = np.where(part, 0.0, bias.covariance)
    covariance[np.diag_indices(3)] = np.where(hidden, np.inf, np.diag(bias.covariance))
    table = point_table(evidence, touches)
    return Verification(
        bias=np.where(hidden, np.nan, bias.estimate),
        covariance=covariance,
        p_value=bias.p_value,
        bias_p_value=p_bias,
        scatter_p_value=p_scatter,
        chi2=bias.d2 + bias.rest,
        dof=bias.dof + bias.dof_rest,
        noise_dof=bias.reference.noise_dof if bias.dof and np.isfinite(bias.reference.noise_dof) else None,
        points=table,
        detectable=bias.detectable(level),
        limit=at_least,
        worst=direction,
        tool=None if tool is None else -tool.estimate,
        tool_std=None if tool is None else np.sqrt(np.diag(tool.covariance)),
        needed=(Needed(size, touches_needed(evidence, known, size, level), at_least),),
        next=next_touches(result, touches, evidence, level, request.candidates) if np.isfinite(worst) else (),
        findings=tuple(_findings(result, touches, evidence, bias, table)),
        tool_sd=float(touches.tool_sd),
    )


verify.__signature__ = keywords_of(verify, VerifyRequest)  # type: ignore[attr-defined]


def point_table(evidence: TouchEvidence, touches: Touches) -> PointTable:
    """Return the touches one by one, each by itself."""
    S = evidence.own + evidence.by_unit @ evidence.by_unit.mT
    if touches.tool_known:
        p = np.array([evidence.rows(np.array([k])).test.p_value for k in range(touches.m)])
    else:
        S[:, np.arange(3), np.arange(3)] = np.inf
        p = np.full(touches.m, np.nan)
    return PointTable(touches.names, evidence.r, S, p)


def covariances_of(sd: Any, m: int) -> Array | None:
    """Covariances (3, 3) or (m, 3, 3) of points by one standard deviation, one of each, of each axis, or themselves."""
    if sd is None:
        return None
    values = np.asarray(_length(sd, "point_sd"))
    if values.ndim >= 2 and values.shape[-2:] == (3, 3) and values.shape != (m, 3):
        return values
    if values.shape not in ((), (m,), (m, 3)) or not (np.isfinite(values) & (values >= 0)).all():
        raise InputError(
            f"Expected `point_sd` to be standard deviations >= 0, one, {(m,)} or {(m, 3)}, or covariances "
            f"{(m, 3, 3)}, got shape {values.shape}."
        )
    values = values[..., None] if values.ndim < 2 else values
    return np.broadcast_to(values, (m, 3))[..., None] ** 2 * np.eye(3)


def robot_covariance(noise: Any) -> Array | None:
    """Covariance (6, 6) of one robot pose by the standard deviations of rotation and translation, or itself."""
    if noise is None:
        return None
    if np.ndim(noise) == 1 and len(noise) == 2:
        return np.diag(np.repeat(parse_deviations(tuple(noise), "robot_noise (--robot-noise)"), 3) ** 2)
    return np.asarray(as_numbers(noise, "robot_noise"))


# Words for the standard deviation of the tool's offset (m).
_OF_TOOL = {"unknown": float("inf"), "?": float("inf"), "inf": float("inf"), "exact": 0.0, "0": 0.0}


def tool_deviation(sd: float | str) -> float:
    """Standard deviation of the tool's offset (m); infinite where it is unknown."""
    known = _OF_TOOL.get(str(sd).strip().lower())
    value = parse_length(sd, "tool_sd (--tool-sd)") if known is None else known
    if not value >= 0:
        raise InputError(f"Expected `tool_sd` (--tool-sd) to be a length >= 0, 'exact' or 'unknown', got {sd!r}.")
    return value


def _length(value: Any, name: str) -> Array:
    return as_numbers(value if np.ndim(value) else parse_length(value, name), name)


def _findings(
    result: Estimated, touches: Touches, evidence: TouchEvidence, bias: Bias, points: PointTable
) -> list[Finding]:
    found = []
    rms = float(np.sqrt(np.mean(np.sum(evidence.r**2, axis=-1))))
    if result.setup == "eye-in-hand" and touches.robot is not None:
        other = replace(touches, robot=inverse(touches.robot))
        other_rms = float(np.sqrt(np.mean(np.sum(evidence_of_touches(result, other).r ** 2, axis=-1))))
        if other_rms * _EXPLAINS < rms:
            found.append(Finding("verification.inverted_robot", "caution", {"rms": rms, "other": other_rms}))
    if touches.seen_covariance is None and touches.board is None:
        sd = float(np.sqrt(np.einsum("mii->", evidence.own - touches.touch_noise) / (3.0 * touches.m)))
        found.append(Finding("verification.point_noise_assumed", "note", {"sd": sd}))
    if len(bias.hidden):
        posed = touches.touched_robot is not None or touches.touched_joints is not None
        values = {"hidden": len(bias.hidden), "posed": posed}
        found.append(Finding("verification.tool_hides_bias", "caution", values))
    if bias.dof_rest <= 0:
        found.append(Finding("verification.no_scatter", "note", {"count": touches.m, "tested": bias.dof > 0}))
    index = np.flatnonzero(points.flagged)
    if index.size and index.size < touches.m:
        names = [points.names[k] for k in index]
        found.append(Finding("verification.points_differ", "caution", {"names": names, "count": touches.m}))
    return found


@dataclass(frozen=True)
class Reprojection:
    """Distance of corners and predicted corners in the picture, px."""

    rms: float
    expected: float
    corners: int


@dataclass(frozen=True)
class PoseVerification(Record, Shown):
    """Independent poses against a calibration."""

    columns = COLUMNS
    _in_file: ClassVar[str] = "contradicted p_value d2 dof noise_dof n_poses rms expected reprojection=pixels findings"

    n_poses: int
    d2: float
    dof: int
    p_value: float
    noise_dof: float | None
    rms: tuple[float, float]  # of the residuals, rad and m
    expected: tuple[float, float]  # of them, if nothing has changed
    pixels: Reprojection | None
    findings: tuple[Finding, ...] = ()  # how the files may be misread

    @property
    def contradicted(self) -> bool:
        """True if the poses contradict the calibration at the level of 5 %."""
        return self.p_value < LEVEL


def verify_poses(result: Estimated, poses: PosePairs) -> PoseVerification:
    """Test a calibration by an independent data set of the same cell.

    Raises
    ------
    InputError
        A calibration without joint covariance, poses of another setup.
    """
    evidence = evidence_of_poses(result, poses)
    reference = evidence.test.reference
    noise_dof = None if reference.noise_given else reference.noise_dof
    p = reference.p_value(evidence.d2)
    squares = np.stack([evidence.r**2, np.diag(evidence.covariance).reshape(evidence.r.shape)])
    rms, expected = np.sqrt(squares.reshape(2, -1, 2, 3).sum(axis=-1).mean(axis=1)).tolist()  # of both, rad and m
    other = None
    if p < LEVEL and result.W is not None:
        other = misread(
            result.X, result.W, poses, evidence, lambda of, _=None: evidence_of_poses(result, of).d2, least_factor=0
        )
    return PoseVerification(
        poses.n, evidence.d2, evidence.dof, p, noise_dof, (rms[0], rms[1]), (expected[0], expected[1]),
        _reprojected(result, poses), () if other is None else (other,),
    )  # fmt: skip


def _reprojected(result: Estimated, poses: PosePairs) -> Reprojection | None:
    """Return how far the corners of the board are from the prediction; None for poses without corners."""
    seen = poses.camera_calibration
    if seen is None or result.W is None:
        return None
    joints = None if result.kinematics is None else poses.joints
    predicted = predict_camera(result, joints, poses.robot)
    K = camera_matrix(seen)
    points, _ = seen.corners.on_board
    squares, expected = 0.0, 0.0
    for pose, S, measured in zip(predicted.poses, predicted.covariance, poses.camera, strict=True):
        arm = points @ pose[:3, :3].T
        there, here = arm + pose[:3, 3], points @ measured[:3, :3].T + measured[:3, 3]
        x, y, z = there.T
        squares += float(np.sum(((there[:, :2] / z[:, None] - here[:, :2] / here[:, 2:]) @ K[:2, :2].T) ** 2))
        by_point = np.zeros((len(points), 2, 3))
        by_point[:, 0, 0] = by_point[:, 1, 1] = 1.0 / z
        by_point[:, 0, 2], by_point[:, 1, 2] = -x / z**2, -y / z**2
        J = K[:2, :2] @ by_point @ by_pose(arm)  # (u, 2, 6)
        expected += float(np.einsum("nij,jk,nik->", J, S, J))
    count = len(points) * poses.n
    return Reprojection(float(np.sqrt(squares / count)), float(np.sqrt(expected / count)), count)


@document_of.register(PoseVerification)
def pose_verification_document(found: PoseVerification) -> Document:
    """The answer, the residuals, the picture."""
    one, p = found.n_poses == 1, probability(found.p_value, 2)
    n = f"{found.n_poses} independent {'pose' if one else 'poses'}"
    word, verb = ("CONTRADICTED", "contradict") if found.contradicted else ("AGREES", "agree")
    verb += ("s" if one else "") + ("" if found.contradicted else " with")
    law = "chi-square" if found.noise_dof is None else "a mixture over the sizes of the errors"
    (turn, shift), (turn_0, shift_0) = found.rms, found.expected
    lines = [
        f"d^2 {digits(found.d2)} of {found.dof} numbers ({law}).",
        f"Residuals: {digits(np.degrees(turn), 2)} deg and {digits(1e3 * shift, 2)} mm RMS; the covariance predicts "
        f"{digits(np.degrees(turn_0), 2)} deg and {digits(1e3 * shift_0, 2)} mm.",
    ]
    if (seen := found.pixels) is not None:
        lines.append(
            f"Re-projection of {seen.corners} corners: {digits(seen.rms, 2)} px RMS; the covariance predicts "
            f"{digits(seen.expected, 2)} px."
        )
    answer = Answer(f"{word}: {n} {verb} the calibration ({p}).", "failed" if found.contradicted else "ok")
    findings = [Paragraph(str(finding), hang="  ") for finding in found.findings]
    return [[answer, *findings], [Paragraph(line, hang="  ") for line in lines]]
