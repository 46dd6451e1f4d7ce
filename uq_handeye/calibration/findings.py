"""Findings of `calibrate`: data sheets contradicted, outliers, shifted rows, a rotation that is left open."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.special import chdtr, chdtrc

from ..core.geometry.se3 import Array, difference
from ..core.numbers.levels import CONTRADICTED, DOUBTFUL, RARE, UNUSUAL
from ..core.numbers.limits import MIN_POSES_FOR_ROBUST
from ..core.numbers.rounding import TINY
from ..errors import DegenerateMotionError, InputError, NotConvergedError
from ..findings import GROSS_EXCESS, Finding, Severity, without_consequences
from ..fit.diagnostics.pose_table import PoseTable, pose_table
from ..fit.input_checks.alphabetical_rows import alphabetical_rows
from ..fit.input_checks.columns import check_poses
from ..fit.input_checks.pose_ambiguity import CODE as POSE_AMBIGUITY
from ..fit.input_checks.pose_ambiguity import flipped_rows
from ..fit.input_checks.residuals import check_fit
from ..fit.input_checks.rotations import check_rotations
from ..fit.input_checks.shifted_rows import find_shift, shifted_run
from ..fit.likelihood.constraint import Unknowns
from ..fit.likelihood.gauss_helmert import Fit
from ..fit.likelihood.goodness_of_fit import GoodnessOfFit
from ..fit.likelihood.open_directions import OpenDirections
from ..fit.likelihood.robust import robust_fit
from ..fit.likelihood.shared_estimates import SharedEstimate, group_test
from ..methods.estimators.registry import solve
from ..methods.propagation.published_fit import fit_published
from ..model.camera.description import spacing_of
from ..model.noise.estimate import NoiseEstimate
from ..model.noise.joint_covariance import group_of
from ..model.noise.models import Noise, PoseNoise
from ..model.poses.motions import Motions, relative_motions, spread_pairs
from ..model.poses.pose_pairs import PosePairs
from ..model.poses.residuals import median, pose_residuals, rotation_angles
from ..model.posterior.posterior import Posterior
from ..model.shared_errors.shared_error import TARGET_SCALE, WRONG_SIZE
from .job import Job, job_of
from .request import Request
from .result import Calibration
from .statement.checks import MAX_ROTATION_SD_RAD

# Noise of the corners (pixels) that the input checks presume for finished poses whose noise is to be estimated.
PRESUMED_CORNER_NOISE_PX = 1.0
# An estimate is compared with its prior where the data take away at least this share of the prior variance.
MIN_SHARE_FROM_DATA = 1e-3
# Closed forms that are compared with X on the poses that were kept.
CLOSED_FORMS = ("4dpa", "tsai", "park", "horaud", "daniilidis")
# A closed form fits better than X where its median residuals are below this share of those of X.
CLEARLY_BETTER = 0.9
# The closed forms are compared only where 4DPA of all poses reaches this share already.
SLIGHTLY_BETTER = 0.97
# The data do not resolve an error whose standard deviation stays above this share of the declared one.
UNRESOLVED_SD = 0.95
# An error is confounded with X where it makes a larger share of the variance along one direction.
DOMINANT_SHARE = 0.8
# X is hardly determined where a confounded error moves it by more (rad, or relative to the distance of the target).
MAX_CONFOUNDED_SIZE = 0.02


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


# RMS rotation residual of the pairs (rad) from which on a shifted pairing of the rows is looked for.
SUSPICIOUS = np.radians(1.0)


def against_data_sheet(result: Calibration) -> list[Finding]:
    """Return a finding if the residuals contradict the noise that was given."""
    estimate, fit = result.noise_estimate, result.fit
    if (
        estimate is None
        or fit is None
        or fit.p_value is None
        or not estimate.has_prior
        or fit.p_value > RARE.probability
    ):
        return []
    rotation, translation = fit.rotation_sigma0, fit.translation_sigma0
    severity: Severity = "failure" if max(rotation, translation) > GROSS_EXCESS else "caution"
    values = {"rotation": rotation, "translation": translation, "p_value": fit.p_value}
    return [Finding("calibration.data_sheet_contradicted", severity, values)]


def against_corners(estimate: NoiseEstimate, judged: GoodnessOfFit) -> list[Finding]:
    """Return findings if the residuals contradict the covariance of camera poses from corners.

    Noise that is estimated makes up for residuals that are larger; of those that are smaller than the camera's
    covariance alone allows the lower tail of chi-square tells.
    """
    found = [one for one in estimate.findings if one.severity != "note"]
    p = float(chdtr(judged.dof, judged.chi2))
    if estimate.camera_known and p < RARE.probability:
        values = {"factor": judged.chi2 / judged.dof, "p_value": p, "dof": judged.dof}
        found.append(Finding("noise_estimation.camera_factor", "caution", values))
    return found


def shared_findings(job: Job, result: Calibration, joint: Posterior, wrong_size: float | None = None) -> list[Finding]:
    """Shared errors that contradict what was assumed of them, that show a wrong size, that X cannot be told from.

    The numbers of one error (`group_of`) are tested together: of many single ones some are far out by chance.
    ``wrong_size``: the probability that the target has another size; None: by its Gaussian.
    """
    found = []
    by_name: dict[str, list[SharedEstimate]] = {}
    for error in result.shared_at_sizes:
        by_name.setdefault(group_of(error.name), []).append(error)
    for name, errors in by_name.items():
        declared = len(errors) > 1 and not errors[0].default  # sizes that are assumed were found by these data
        test = group_test(joint, job.shared, name) if declared else None
        # An arm of right accuracy is within a factor of 2 of the population that stands for it.
        within = (0.5, 2.0) if errors[0].accuracy is not None else (0.0, 1.0)
        if test is not None and (test.times > within[1] or test.times < within[0]):
            severity: Severity = "caution" if test.times > 1 else "note"
            of_group = {"name": name, "count": len(errors), "times": test.times, "p_value": test.p_value}
            if test.p_value < (CONTRADICTED.probability if severity == "caution" else DOUBTFUL.probability):
                found.append(Finding("calibration.group_contradicted", severity, of_group))
    single = [errors[0] for errors in by_name.values() if len(errors) == 1]
    for error in single:
        alone, sd = error.alone, error.alone_sd
        told = alone is not None and sd is not None and MIN_SHARE_FROM_DATA * sd**2 < error.prior_sd**2
        if told and (error.p_value or 0) < CONTRADICTED.probability:
            factor, unit = error.shown
            numbers = {"estimate": alone, "sd": sd, "assumed": error.prior_sd}
            shown = {name: factor * number for name, number in numbers.items() if number is not None}
            values = {"name": error.name, "unit": unit, "p_value": error.p_value} | shown
            found.append(Finding("calibration.shared_contradicted", "caution", values))
        probability = error.beyond(WRONG_SIZE) if wrong_size is None else wrong_size
        if error.name == TARGET_SCALE and probability > 0.5:
            size = {"estimate": error.estimate, "sd": error.sd, "square": _square_of(job), "probability": probability}
            found.append(Finding("calibration.target_size", "caution", size))
    groups: dict[str, list[SharedEstimate]] = {}
    for error in single:
        if error.share > DOMINANT_SHARE:
            groups.setdefault(error.error, []).append(error)
    return found + [finding for name, errors in groups.items() for finding in _confounded(result, name, errors)]


def _confounded(result: Calibration, name: str, errors: Sequence[SharedEstimate]) -> list[Finding]:
    """Report along which directions most of an error goes into X; a caution where X is hardly determined then."""
    assert result.covariance is not None and result.analysis is not None
    S, R = result.covariance, result.X[:3, :3]
    distance, directions, hardly = result.analysis.diagnostics.spectrum.length_m, [], False
    for error in errors:
        parts = {"rotation": error.effect[:3], "translation": error.effect[3:]}
        blocks = {"rotation": S[:3, :3], "translation": S[3:, 3:]}
        # Along what is open X does not move, and has no variance there.
        shares = {part: float(e @ np.linalg.pinv(blocks[part], 1e-12, hermitian=True) @ e) for part, e in parts.items()}
        kind = max(parts, key=lambda part: shares[part])
        size = float(np.linalg.norm(parts[kind]))
        directions.append({"what": kind, "axis": R.T @ parts[kind] / size, "size": size})
        hardly |= size > (MAX_CONFOUNDED_SIZE if kind == "rotation" else MAX_CONFOUNDED_SIZE * distance)
    factor, unit = errors[0].shown
    values = {"name": name, "unit": unit, "assumed": factor * errors[0].prior_sd, "directions": directions}
    if hardly and not errors[0].default:
        return [Finding("calibration.shared_opens", "caution", values)]
    untold = all(error.sd > UNRESOLVED_SD * error.prior_sd for error in errors)
    return [Finding("calibration.shared_confounded", "note", values)] if untold else []


def closed_forms(job: Job, result: Calibration, table: PoseTable) -> list[Finding]:
    """Return a finding if a closed form fits the poses that count better than X, which it contradicts.

    Better: without any of the errors that were estimated with X, the medians of its rotation and of its translation
    residuals are both below `CLEARLY_BETTER` times those that X leaves with them. The others are computed where 4DPA of
    all poses, which is known already, fits at least a little better (`SLIGHTLY_BETTER`).
    """
    kept = table.weight > 0
    if job.poses is None or result.covariance is None or result.opened is not None or kept.sum() < MIN_POSES_FOR_ROBUST:
        return []
    poses = job.poses if kept.all() else job.poses.rows(kept)
    G, C = poses.effective_robot, poses.camera
    own = np.maximum([median(table.rotation[kept]), median(table.translation[kept])], TINY)
    known = result.fourdpa.X if kept.all() and result.fourdpa is not None else None
    if (
        known is not None
        and (np.array([median(part) for part in pose_residuals(G, C, known)]) > SLIGHTLY_BETTER * own).any()
    ):
        return []
    motions = relative_motions(poses, spread_pairs(poses.n, 500))
    found: list[tuple[float, str, Array, float]] = []
    for name in CLOSED_FORMS:
        with suppress(InputError, NotConvergedError):
            X = solve(motions.A, motions.B, method=name)
            ratio = np.array([median(part) for part in pose_residuals(G, C, X)]) / own
            xi = difference(X, result.X)
            d2 = float(xi @ np.linalg.solve(result.covariance, xi))
            if (ratio < CLEARLY_BETTER).all() and d2 > UNUSUAL.chi_square(6):
                found.append((float(ratio.max()), name, ratio, d2))
    if not found:
        return []
    _, name, ratio, d2 = min(found, key=lambda one: one[0])
    values = {
        "method": name,
        "rotation": float(ratio[0]),
        "translation": float(ratio[1]),
        "d2": d2,
        "count": len(found),
    }
    return [Finding("calibration.closed_form_fits", "caution", values)]


def _square_of(job: Job) -> float | None:
    """The side of the squares (m) of the board that was seen; None where that is not known."""
    seen = None if job.poses is None else job.poses.camera_calibration
    if seen is not None:
        return spacing_of(seen.corners.points)
    return None if job.camera_noise is None else job.camera_noise.square


def wrong_poses(job: Job, noise: Noise, table: PoseTable) -> list[Finding]:
    """Find the poses that a plain fit should leave out, by robust estimation, as outliers affect all residuals."""
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
    found = [] if job.poses is None else [*job.poses.findings, *check_poses(job.poses)]
    seen = None if job.poses is None else job.poses.camera_calibration
    found += [] if seen is None else [finding for finding in seen.findings if finding.code == POSE_AMBIGUITY]
    return found + (check_rotations(job.motions, _known_noise(job), job.method) if job.motions.N >= 2 else [])


def why_failed(findings: Sequence[Finding]) -> list[Finding]:
    """Return the failures among findings; those that explain the others alone, where there are some."""
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
            found = check_fit(job.poses, X, None, np.zeros((6, 6)), own)
    return found + shifted(job, None)


def shifted(job: Job, result: Calibration | None) -> list[Finding]:
    """Return a finding if rows of one file are missing or in another order, where the fit gives reason to ask."""
    if job.poses is None or job.poses.n < MIN_POSES_FOR_ROBUST:
        return []
    if result is not None:
        bad = 0 if result.table is None else len(result.table.flagged)
        if bad < max(2, 0.05 * job.poses.n) and result.residuals.rotation_rms < SUSPICIOUS:
            return []
    if (sorted_by_name := alphabetical_rows(job.poses)) is not None:
        return [sorted_by_name]
    if (shift := find_shift(job.poses)) is not None:
        return [shift.finding]
    if result is None or result.table is None or result.W is None or result.table.item == "motion":
        return []
    run = shifted_run(job.poses, Unknowns(result.X, result.W), result.table.weight == 0)
    return [] if run is None else [run]


def flipped_poses(job: Job, result: Calibration) -> list[Finding]:
    """Return a finding if outliers among finished camera poses fit with the target flipped."""
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


def said_open(opened: OpenDirections | None, setup: str | None) -> list[Finding]:
    """Return what the data leave open of X and W."""
    if opened is None:
        return []
    return [Finding("calibration.open", "caution", {"directions": opened.single().tolist(), "setup": setup})]


def against_prior(fit: Fit) -> list[Finding]:
    """Return a finding if the prior of X and W contradicts the data.

    The estimate less the prior's mean has the covariance ``Lambda^-1 - C`` along what data and prior both determine;
    its square is chi-square with as many degrees of freedom.
    """
    if fit.prior is None:
        return []
    chi2, dof = 0.0, 0
    information, pull, _ = fit.prior.normal_equations(fit.X, fit.W)
    scale = np.sqrt(np.diag(information))
    told = scale > 0
    unit = information[np.ix_(told, told)] / np.outer(scale[told], scale[told])
    values, vectors = np.linalg.eigh(unit)
    half = scale[told, None] * vectors * np.sqrt(values)  # Lambda = half half^T
    of_mean = (vectors.T @ (pull[told] / scale[told])) / np.sqrt(values)  # half^T xi
    mu, V = np.linalg.eigh(np.eye(len(values)) - half.T @ fit.covariance[np.ix_(told, told)] @ half)
    both = mu > MIN_SHARE_FROM_DATA
    chi2, dof = float(((V.T @ of_mean)[both] ** 2 / mu[both]).sum()), int(both.sum())
    if dof == 0:
        return []
    p_value = float(chdtrc(dof, chi2))
    name = " and ".join(part[0] for part in fit.prior.parts())
    values_of = {"of": name, "chi2": chi2, "dof": dof, "p_value": p_value}
    if p_value < RARE.probability:
        return [Finding("calibration.prior_contradicted", "caution", values_of)]
    return [Finding("calibration.prior_agrees", "note", values_of)]
