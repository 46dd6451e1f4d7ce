"""Findings of `calibrate` about input and fit: suspicious files, outliers, shifted rows, an undetermined rotation."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.conventions import CovarianceReading
from ..core.geometry.se3 import inverse, logarithm
from ..core.limits import MIN_POSES_FOR_ROBUST
from ..errors import DegenerateMotionError, InputError, NotConvergedError
from ..findings import Finding, without_consequences
from ..fit.diagnostics.alphabetical_rows import alphabetical_rows
from ..fit.diagnostics.board_order import reordered_views
from ..fit.diagnostics.columns import check_poses
from ..fit.diagnostics.covariance_convention import convention_finding, is_isotropic
from ..fit.diagnostics.pose_ambiguity import CODE as POSE_AMBIGUITY
from ..fit.diagnostics.pose_ambiguity import flipped_rows
from ..fit.diagnostics.pose_table import PoseTable, pose_table
from ..fit.diagnostics.residuals import check_fit
from ..fit.diagnostics.rotations import check_rotations
from ..fit.diagnostics.shifted_rows import exchanged_rows, find_shift, shifted_run
from ..fit.graph.constraint import Unknowns
from ..fit.graph.open_directions import MAX_ROTATION_SD_RAD, OpenDirections
from ..fit.graph.request import Request, of_motions
from ..fit.graph.robust import robust_fit
from ..methods.published_fit import fit_published
from ..model.errors.keys import CAMERA_SCALE
from ..model.errors.models import Noise, PoseNoise
from ..model.poses.motions import Motions
from ..model.poses.pose_pairs import PosePairs
from ..model.poses.residuals import rotation_angles
from .job import Job, job_of
from .result import Calibration

# Where a larger share of the poses is rejected, the program tests whether another reading of the files explains all
# of them.
MAX_REJECTED_SHARE = 0.15
# Noise of the corners (pixels) that the input checks presume for finished poses whose noise is to be estimated.
PRESUMED_CORNER_NOISE_PX = 1.0


def require_determined(result: Calibration, motions: Motions) -> None:
    """Raise `DegenerateMotionError` with the result where its rotation is left open."""
    if (weakest := result.weakest_rotation) is None or weakest[1] <= MAX_ROTATION_SD_RAD:
        return
    axis, deviation = weakest
    directions = np.zeros((1, 6))
    directions[0, :3] = axis
    raise DegenerateMotionError(
        f"With this noise the motions do not determine X by method {result.method!r}: its rotation about "
        f"({', '.join(f'{x:.3f}' for x in axis)}) in the frame of `A` has a first-order standard deviation of "
        f"{np.degrees(deviation):.0f} degrees. {_advice(result.method, motions)}",
        directions,
        partial=result,
    )


def _advice(method: str, motions: Motions) -> str:
    smallest = float(np.degrees(rotation_angles(motions.A[..., :3, :3]).min()))
    if method == "shiu" and smallest < 1.0:
        return (
            f"This method counts all motions alike, and one of them rotates by {smallest:.2g} degrees only, which "
            "leaves its axis to the noise: leave small rotations out, or use another method."
        )
    return "Add motions that rotate about other axes."


# Angle by which a picture that is turned by 180 or by 90 degrees may be off that.
MAX_OFF_TURN_RAD = np.radians(3.0)
# Finding of a camera whose given intrinsics its pictures contradict.
GIVEN = "camera.given_contradicted"
# RMS rotation residual of the pairs (rad) from which on a shifted pairing of the rows is looked for.
SUSPICIOUS = np.radians(1.0)


def wrong_poses(job: Job, noise: Noise, table: PoseTable) -> list[Finding]:
    """Return the poses that a fit without robust weights should leave out, as outliers affect all residuals."""
    if not (table.distance2 > table.limit_of_all).any():
        return []
    with suppress(InputError, NotConvergedError):
        found = robust_fit(job.data, noise, method="efficient", seed=job.request.seed)
        table = pose_table(found.fit, found)
        table = replace(table, flag=tuple("kept" if flag == "kept" else "outlier" for flag in table.flag))
    return table.findings


def check_input(data: PosePairs | Motions, noise: Noise | None = None) -> list[Finding]:
    """Return suspicious properties of the input, by the checks that `calibrate` makes before it estimates noise and
    covariance.

    Raises `InputError` for what `calibrate` cannot use.
    """
    job = job_of(Request(noise), data)
    return without_consequences(look_at(job) + reasons(job))


def look_at(job: Job) -> list[Finding]:
    """Findings of the files as read, of the poses and of the rotations of their motions, before there is an X."""
    return of_files(job) + of_rotations(job)


def of_files(job: Job) -> list[Finding]:
    """Findings of the files as read and of the columns of the poses."""
    found = [] if job.poses is None else [*job.poses.findings, *check_poses(job.poses)]
    seen = None if job.poses is None else job.poses.camera_calibration
    return found + (
        [] if seen is None else [finding for finding in seen.findings if finding.code in (POSE_AMBIGUITY, GIVEN)]
    )


def of_rotations(job: Job, table: PoseTable | None = None) -> list[Finding]:
    """Findings of the rotations of the motions: of all of them, or of those whose rows count by a ``table``."""
    motions = job.motions
    if table is not None and not (counts := table.weight > 0).all():
        of_rows = table.item == "motion" or motions.pairs is None
        kept = np.flatnonzero(counts if of_rows else counts[np.asarray(motions.pairs)].all(axis=1))
        if len(kept) and (not of_rows or len(counts) == motions.N):
            pairs = None if motions.pairs is None else motions.pairs[kept]
            motions = replace(motions, A=motions.A[kept], B=motions.B[kept], pairs=pairs)
    return check_rotations(motions, _known_noise(job), job.method) if motions.N >= 2 else []


def why_failed(findings: Sequence[Finding]) -> list[Finding]:
    """Return the failures among findings; only those that explain the others, where there are any."""
    failures = [finding for finding in findings if finding.severity == "failure"]
    return [finding for finding in failures if finding.explains] or failures


def _known_noise(job: Job) -> Noise | None:
    """Return the noise given, else that of the corners: rotations of small targets are uncertain by degrees."""
    seen = None if job.poses is None else job.poses.camera_calibration
    if job.noise is not None or job.arm is not None:
        return job.noise
    if seen is not None:
        return PoseNoise(camera=seen.covariance)
    if job.camera_noise is not None:
        return PoseNoise(camera=job.camera_noise.covariance(job.camera_noise.pixel_sd or PRESUMED_CORNER_NOISE_PX))
    return None


def reasons(job: Job) -> list[Finding]:
    """Return possible causes where the data gave no result."""
    found: list[Finding] = []
    with suppress(InputError, NotConvergedError):
        X = fit_published(job.motions, None, "4dpa", None, job.everything).X
        if job.poses is not None:
            known = _known_noise(job)
            own = known if isinstance(known, PoseNoise) else None
            any_scale = any(error.key == CAMERA_SCALE for error in job.shared)
            found = check_fit(job.poses, X, None, np.zeros((6, 6)), own, any_scale=any_scale)
    return found + other_convention(job, None) + shifted(job, None)


def shifted(job: Job, result: Calibration | None) -> list[Finding]:
    """Return a finding if rows of one file are missing or in another order, where the fit gives reason to test it."""
    if job.poses is None or job.poses.n < MIN_POSES_FOR_ROBUST:
        return []
    if result is not None:
        bad = 0 if result.table is None else len(result.table.flagged)
        if bad < max(2, 0.05 * job.poses.n) and result.residuals.rotation_rms < SUSPICIOUS:
            return []
    if result is None or result.table is None or result.W is None or result.table.item == "motion":
        return misplaced_rows(job.poses)
    return misplaced_rows(job.poses, Unknowns(result.X, result.W), result.table.weight == 0)


def misplaced_rows(
    poses: PosePairs, at: Unknowns | None = None, rejected: NDArray[np.bool_] | None = None
) -> list[Finding]:
    """Return a finding if views are of a target that is turned or mirrored, if rows are in another order, or shifted:
    all, or a run of those that a fit rejected.
    """
    if (reordered := reordered_views(poses, rejected)) is not None:
        return [reordered]
    if (sorted_by_name := alphabetical_rows(poses)) is not None:
        return [sorted_by_name]
    if (shift := find_shift(poses)) is not None:
        return [shift.finding]
    if at is None or rejected is None:
        return []
    if (exchanged := exchanged_rows(poses, at, rejected)) is not None:
        return [exchanged]
    run = shifted_run(poses, at, rejected)
    return [] if run is None else [run]


def other_convention(job: Job, result: Calibration | None) -> list[Finding]:
    """Return a finding if the covariances of the camera poses fit in the convention of another library."""
    poses, noise = job.poses, job.request.noise
    if poses is None or of_motions(noise) or poses.camera_calibration is not None:
        return []
    robot, camera, given = None, None, CovarianceReading()
    match noise:
        case PoseNoise():
            robot = np.zeros((6, 6)) if noise.robot is None else noise.robot
            camera, given = noise.camera, noise.read_as.get("camera", given)
        case None if poses.camera_covariance is not None and poses.camera_covariance.shared.shape[-1] == 0:
            camera, given = poses.camera_covariance.own, poses.camera_read_as or given
    sides = [S for S in (robot, camera) if S is not None]
    if camera is None or not all(isinstance(S, np.ndarray) and S.shape[-2:] == (6, 6) for S in sides):
        return []
    if is_isotropic(camera):  # numbers of a person, not of a library
        return []
    if result is None or result.W is None:
        with suppress(InputError, NotConvergedError):
            X = fit_published(job.motions, None, "4dpa", None, job.everything).X
            found = convention_finding(poses, job.constraint.complete(X), robot, camera, given)
            return [] if found is None else [found]
        return []
    found = convention_finding(poses, Unknowns(result.X, result.W), robot, camera, given)
    return [] if found is None else [found]


def flipped_poses(job: Job, result: Calibration) -> list[Finding]:
    """Return a finding if outliers among camera poses without corners fit with the target flipped."""
    table, poses = result.table, job.poses
    if (
        poses is None
        or table is None
        or table.item != "pose"
        or result.W is None
        or poses.camera_calibration is not None
    ):
        return []
    views = None if job.camera_noise is None else job.camera_noise.views
    rows = flipped_rows(poses, Unknowns(result.X, result.W), table.weight > 0.9, table.flagged, views)
    return [Finding("input_checks.flipped_poses", "caution", {"rows": rows})] if rows else []


def turned_pictures(job: Job, result: Calibration) -> list[Finding]:
    """Return findings if outliers fit once their pictures are turned about the optical axis, by 180 or 90 degrees."""
    table, poses = result.table, job.poses
    if poses is None or table is None or table.item != "pose" or result.W is None or poses.camera_calibration is None:
        return []
    flagged = np.asarray(table.flagged, dtype=int)
    expected = inverse(poses.effective_robot[flagged] @ result.X) @ result.W
    turn = logarithm(expected[:, :3, :3] @ poses.camera[flagged, :3, :3].mT)
    found = []
    for angle in (np.pi, 0.5 * np.pi):
        about_axis = np.sign(turn[:, 2:]) * angle * np.array([0.0, 0.0, 1.0])
        rows = flagged[np.linalg.norm(turn - about_axis, axis=1) < MAX_OFF_TURN_RAD]
        if len(rows):
            values = {"rows": rows.tolist(), "angle": float(angle)}
            found.append(Finding("input_checks.turned_pictures", "caution", values))
    return found


def said_open(opened: OpenDirections | None, setup: str | None) -> list[Finding]:
    """Return the findings about the directions of X and W that the data leave open."""
    if opened is None:
        return []
    return [Finding("calibration.open", "caution", {"directions": opened.single().tolist(), "setup": setup})]
