"""Test of a stored calibration by an independent data set of the same cell.

The test is the chi-square of the residuals of the new poses (`evidence.new_poses`). Where the camera poses come from
corners, the corners of the board predicted from the robot pose, X and W are compared with those of the board as seen.
The covariance predicts the RMS distance ``sqrt(mean trace(J S J^T))``, J the derivative of a corner by the pose of the
board, S the covariance of a new measured pose. Distortion of the lens is left out of this comparison.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...calibration.estimated import Estimated
from ...calibration.evidence.new_poses import evidence_of_poses
from ...calibration.prediction.predict import predict_camera
from ...core.files.records import Record
from ...core.levels import UNUSUAL
from ...core.presentation.document import COLUMNS, Answer, Document, Paragraph, document_of
from ...core.presentation.numbers import digits, probability
from ...core.presentation.shown import Shown
from ...findings import Finding
from ...fit.diagnostics.task_space import by_pose
from ...model.camera.intrinsics_file import camera_matrix
from ...model.poses.pose_pairs import PosePairs
from ..maintenance.misread import misread


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
        return self.p_value < UNUSUAL.probability


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
    if p < UNUSUAL.probability and result.W is not None:
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
