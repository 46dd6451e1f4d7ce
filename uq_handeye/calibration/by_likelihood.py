"""X by `efficient` or `ml`, with its covariance, at the Cramer-Rao bound."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ..diagnostics.pose_table import pose_table
from ..empirical_covariance.resampled import resampled
from ..errors import DegenerateMotionError, InputError
from ..findings import Finding
from ..geometry.se3 import Array, logarithm
from ..input_checks.checks import check_fit, check_motions, require_signal
from ..kinematics.kinematic_errors import DECLARED_AS, JOINT_NOISE, KinematicColumns
from ..likelihood.carried_errors import carried_estimates, carried_moves
from ..likelihood.constraint import Constraint, Unknowns
from ..likelihood.gauss_helmert import (
    CLOSED_FORM_STEPS,
    FITS,
    MOST_STEPS,
    SINGULAR,
    Fit,
    corrected,
    offset_sensitivity,
    open_at,
)
from ..likelihood.gauss_helmert import fit as refit
from ..likelihood.goodness_of_fit import goodness_of_fit
from ..likelihood.open_start import start_open
from ..likelihood.robust import RobustFit, fit_robustly
from ..likelihood.shared_estimates import JointFit, JointPosterior, Resolved, SharedEstimate, of_moves, resolve_doubts
from ..likelihood.starts import leaves_open
from ..noise.estimate import NoiseEstimate, NoisePrior
from ..noise.models import Noise, PairNoise, PoseNoise, is_of_each, with_prior
from ..noise_estimation.beside_kinematics import BesideKinematics, FoundKinematics
from ..noise_estimation.estimate import FoundNoise, NoiseSource, choose_source
from ..noise_estimation.serial_correlation import account_for_correlation, correlation_finding
from ..poses.motions import Motions
from ..poses.pose_pairs import PosePairs
from ..poses.residuals import residuals, summarise
from ..poses.timing import TimeOffset
from ..prediction.fitted_kinematics import FittedKinematics
from ..prediction.local_joints import local_findings
from ..propagation.published_fit import Published, fit_published
from ..runtime.read_only import read_only
from ..shared_errors.shared_error import CLOCK_OFFSET, SharedError, shared_columns, with_shared, without_shared
from .analysis import Analysis
from .by_published import bare_result, by_sigma_points, estimate_unweighted, reference_for, reference_of
from .findings import against_corners, against_data_sheet, against_prior, said_open, shared_findings, wrong_poses
from .request import FEWEST_FOR_ROBUST, OF_NOISE, Job
from .result import Calibration
from .result_file import FourDPA
from .robot_accuracy import scaled_by_residuals

# Data whose residuals (rad, and relative to the longest translation) are smaller come from a simulation without noise.
EXACT = 1e-10
# Errors of the arm are derived anew where their second order moves its poses by more than this, in deviations of X.
SECOND_ORDER = 0.05
# What no model of an arm explains differs from pose to pose and has tails: beside its errors a pose is wrong from this
# many times the usual d^2 on. Poses left out for their tails make the noise of the others too small for new ones.
TAILS = 3.0


def by_likelihood(job: Job) -> tuple[Calibration, list[Finding]]:
    """`efficient` or `ml`, with 4DPA beside it."""
    noise, constraint, known = job.noise, job.constraint, job.pose_prior
    fourdpa: Published | None = None
    with suppress(DegenerateMotionError):
        fourdpa = fit_published(job.motions, noise, "4dpa", None, job.everything)
    if fourdpa is None:
        at = start_open(constraint, noise, known)
    elif leaves_open(constraint, noise, at := constraint.complete(fourdpa.X)):
        with suppress(DegenerateMotionError):
            at, fourdpa = start_open(constraint, noise, known), None
    elif known is None and (noise is None or noise.prior is None):  # half turns whose signs are lost in the noise
        require_signal(job.motions, noise, residuals(job.motions.A, job.motions.B, fourdpa.X)[0])
    start = fourdpa or Published(job.motions, "4dpa", None, at.X, at.W, 0, job.everything)
    angle, distance = residuals(job.motions.A, job.motions.B, at.X)
    beside: dict[str, Any] = {"columns": job.columns, "pose_prior": known}
    source: NoiseSource | None = None
    if noise is None:
        source = (
            choose_source(job.data, constraint, job.prior, job.camera_noise, job.robot_noise, **beside)
            if job.columns_of_arm is None
            else _beside_kinematics(job, constraint, job.columns_of_arm)
        )
    exact = noise is None and max(angle.max(), distance.max() / _longest(job.motions)) < EXACT
    robust: RobustFit | None = None
    found: FoundNoise | None = None
    if job.robust and not exact:

        def estimate_variances(constraint: Constraint, at: Unknowns, weights: Array) -> Noise | None:
            nonlocal found
            assert source is not None
            found = source.find(at, weights)
            return None if found.noise is None else with_prior(found.noise, known)

        slack = 1.0 if job.columns_of_arm is None else TAILS
        robust = fit_robustly(constraint, noise, at, job.method, estimate_variances, job.seed, known, slack)
        noise = robust.noise
    elif source is not None:
        found = source.find(at)
        noise = None if found.noise is None else with_prior(found.noise, known)
    estimate = None if found is None else found.describe()
    if noise is None:  # the data fit exactly: there are no weights, and all estimates agree
        assert estimate is not None
        if robust is not None:  # once wrong ones are left out
            kept = replace(start, X=robust.fit.X, W=robust.fit.W)
            result, findings = estimate_unweighted(job, kept, estimate)
            table = pose_table(robust.fit, robust)
            result, findings = replace(result, table=table), [*table.findings, *findings]
        else:
            result, findings = estimate_unweighted(job, start, estimate)
        opened = open_at(constraint, at, known)
        return replace(result, opened=opened), said_open(opened, result.setup) + findings
    fit = FITS[job.method](constraint, noise, at) if robust is None else robust.fit
    if isinstance(found, FoundKinematics):
        job = replace(job, shared=(*job.shared, *found.errors))
    if job.columns:
        noise = _columns_at_corrected(job, noise, fit)
        fit = _fitted_again(job, noise, fit)
        estimate = None if estimate is None else replace(estimate, noise=noise)
    deviations = dict(found.deviations) if isinstance(found, FoundKinematics) else None
    correlated = _correlated(job, noise, fit, estimate)
    if correlated is not None:
        assert isinstance(correlated.noise, PoseNoise) and estimate is not None
        if deviations is not None and JOINT_NOISE in deviations:  # a part of the noise is in common now
            k = estimate.names.index(JOINT_NOISE)
            deviations[JOINT_NOISE] *= float(np.sqrt(correlated.variances[k] / max(estimate.variances[k], 1e-300)))
        independent, noise = fit, correlated.noise
        fit = _fitted_again(job, noise, fit)
        finding = _correlation_finding(job, correlated, independent, fit)
        estimate = replace(correlated, findings=(*correlated.findings, finding))
    resolved: Resolved | None = None
    if any(error.doubt is not None for error in job.shared):
        resolved = resolve_doubts(fit, noise, job.shared)
        job, noise = replace(job, shared=resolved.errors), resolved.noise
        fit = _fitted_again(job, noise, fit)
        estimate = None if estimate is None else replace(estimate, noise=noise)
    robust = None if robust is None else replace(robust, fit=fit, noise=noise)
    return _assembled(job, noise, fit, fourdpa, estimate, robust, resolved, deviations)


def poses_about_errors(job: Job, result: Calibration) -> PosePairs | None:
    """The poses that stand for those measured once the errors of the arm are derived at their estimate.

    None where that makes no difference.
    """
    if job.arm is None or result.kinematics is None or result.covariance is None or job.poses is None:
        return None
    again, before = job.arm.linear_about(result.kinematics.e), job.poses.robot
    turn, shift = logarithm(again[:, :3, :3] @ before[:, :3, :3].mT), again[:, :3, 3] - before[:, :3, 3]
    moved = [float(np.sqrt(np.mean(np.sum(part**2, axis=-1)))) for part in (turn, shift)]
    known = [float(np.sqrt(np.trace(result.covariance[k : k + 3, k : k + 3]))) for k in (0, 3)]
    if all(move <= SECOND_ORDER * sd for move, sd in zip(moved, known, strict=True)):
        return None
    return replace(job.poses, robot=again)


def _joint_noise(job: Job, found: Mapping[str, float] | None) -> dict[str, Array]:
    """Covariances (n, 6, 6) that joint noise gives the robot poses, by its name; nothing where there is none."""
    columns = None if job.arm is None else job.arm.columns
    if columns is None:
        return {}
    sd = float(columns.given.joint_sd or 0.0) if found is None else found.get(JOINT_NOISE, 0.0)
    return {JOINT_NOISE: sd**2 * columns.J @ columns.J.mT} if sd > 0 else {}


def _fitted(job: Job, posterior: JointPosterior | None, found: Mapping[str, float] | None) -> FittedKinematics | None:
    """Return the results of the fit about the arm."""
    if job.arm is None or posterior is None:
        return None
    given = job.arm.errors
    sd = dict(given.standard_deviations | {JOINT_NOISE: float(given.joint_sd or 0.0)} if found is None else found)
    sd = {name: sd.get(name, 0.0) for name in (*DECLARED_AS, JOINT_NOISE)}
    left = job.arm.against.rms
    return FittedKinematics.of(job.arm.kinematics, job.arm.joints, given.how, given.flange, sd, left, posterior)


def _beside_kinematics(job: Job, constraint: Constraint, columns: KinematicColumns) -> BesideKinematics:
    """Standard deviations of the arm's errors and of the noise that is not known."""
    camera: Any = job.camera_noise
    robot = job.robot_noise
    if job.given is not None:  # a side that it leaves out is exact
        camera, robot = (np.zeros((6, 6)) if S is None else S for S in (job.given.camera, job.given.robot))
    elif camera is None and job.poses is not None:
        camera = job.poses.known_camera
    prior = NoisePrior() if job.prior is None else job.prior
    return BesideKinematics(constraint, columns, camera, robot, prior, job.columns, job.pose_prior)


def _columns_at_corrected(job: Job, noise: Noise, fit: Fit) -> PoseNoise:
    """The noise with the columns of shared errors taken at the poses as the fit corrects them.

    Columns at measured poses hold their noise, which the residuals hold too: where X and W absorb all else of a column,
    the residuals would seem to ask for the error.
    """
    assert isinstance(noise, PoseNoise) and job.poses is not None
    robot, camera = corrected(fit, noise, job.poses.robot, job.poses.camera)
    poses = PosePairs(robot, camera, job.poses.setup, job.poses.timestamps)
    return with_shared(without_shared(noise, job.shared), shared_columns(job.shared, poses))


def _fitted_again(job: Job, noise: Noise, found: Fit) -> Fit:
    """The fit with other noise, from the unknowns and with the weights that were found."""
    steps = CLOSED_FORM_STEPS if job.method == "efficient" else MOST_STEPS
    return refit(job.constraint, noise, found.unknowns, steps, found.weights)


def _correlated(job: Job, noise: Noise, fit: Fit, estimate: NoiseEstimate | None) -> NoiseEstimate | None:
    """The noise estimate with what neighbouring poses have in common; None where there is nothing, or none wanted."""
    wanted = job.correlation == "auto" and job.covariance in OF_NOISE
    if estimate is None or job.poses is None or not isinstance(noise, PoseNoise) or not wanted:
        return None
    return account_for_correlation(fit, job.poses, noise, estimate)


def _correlation_finding(job: Job, estimate: NoiseEstimate, independent: Fit, fit: Fit) -> Finding:
    assert estimate.correlation is not None and job.poses is not None
    known = np.linalg.pinv(independent.covariance_X, rcond=SINGULAR, hermitian=True)  # but along what is open
    ratio = np.trace(known @ fit.covariance_X) / np.trace(known @ independent.covariance_X)
    return correlation_finding(estimate.correlation, job.poses.setup, float(np.sqrt(ratio)))


def _longest(motions: Motions) -> float:
    """The longest translation, or 1 if there is none."""
    data = (motions.A, motions.B) if motions.poses is None else (motions.poses.robot, motions.poses.camera)
    return max(float(np.abs(T[:, :3, 3]).max()) for T in data) or 1.0


def _assembled(
    job: Job,
    noise: Noise,
    fit: Fit,
    start: Published | None,
    estimate: NoiseEstimate | None,
    robust: RobustFit | None,
    resolved: Resolved | None,
    deviations: Mapping[str, float] | None,
) -> tuple[Calibration, list[Finding]]:
    data, motions, poses = job.data, job.motions, job.poses
    reference = reference_for(fit, estimate)
    covariance, covariance_W = fit.covariance_X, fit.covariance_W
    if fit.open is not None and job.covariance != "model":
        raise InputError(
            f"The motions leave a part of X open, for which only covariance='model' is available, got "
            f"{job.covariance!r}."
        )
    if job.covariance == "sigma-points":
        covariance, covariance_W = by_sigma_points(job, noise, robust), None
    elif job.covariance != "model":
        found = resampled(data, job.method, job.covariance, fit=fit, seed=job.seed)
        covariance, covariance_W, reference = found.covariance_X, found.covariance_W, reference_of(found)
    joint = JointFit.of(fit, noise, job.shared)
    beside = {} if resolved is None else joint.moves(resolved.left_open)
    time_offset, move = _time_offset(poses, fit, covariance)
    if move is not None:
        beside[CLOCK_OFFSET] = move
    errors = _carried_errors(job, fit, poses)
    carried = {} if poses is None else {error.name: carried_moves(fit, error, poses) for error in errors}
    beside |= carried
    for move in beside.values():
        covariance = covariance + of_moves(move[:6])
        covariance_W = None if covariance_W is None else covariance_W + of_moves(move[6:])
    table = pose_table(fit, robust)
    # Beside a camera covariance from corners the noise counts as known: most of it, or the test errs on the safe side.
    # A drift does not count in halves: the test is of the noise that both were made of.
    alone = None if estimate is None else replace(estimate, correlation=None)
    dof = None if estimate is not None and estimate.camera_known else reference_for(fit, alone).dof
    within = _joint_noise(job, deviations)
    analysis = Analysis(data, noise, fit, job.method, estimate, dof, job.seed, read_only(beside), read_only(within))
    angle, distance = residuals(motions.A, motions.B, fit.X)
    judged = goodness_of_fit(fit)
    if estimate is not None and not estimate.tested:
        judged = replace(judged, p_value=None)
    posterior = None
    if fit.W is not None and fit.open is None:
        posterior = JointFit.with_intrinsics(fit, noise, job.shared).posterior(beside)
    result = replace(
        bare_result(job, fit.X, fit.W, summarise(angle, distance), noise),
        covariance=covariance,
        covariance_W=covariance_W,
        iterations=fit.iterations if job.method == "ml" else 0,
        covariance_kind=job.covariance,
        reference=reference,
        noise_estimate=estimate,
        bound=fit.covariance_X,
        fourdpa=None if start is None else FourDPA(start.X, start.covariances(noise)[0]),
        fit=judged,
        table=table,
        time_offset=time_offset,
        shared=(*joint.estimates(resolved), *_carried_estimates(errors, carried, covariance)),
        analysis=analysis,
        opened=fit.opened,
        joint_posterior=posterior,
        kinematics=_fitted(job, posterior, deviations),
    )
    said = said_open(fit.opened, result.setup) + against_prior(fit)
    findings = table.findings if robust else wrong_poses(job, noise, table)
    if poses is None or isinstance(noise, PairNoise):
        findings += check_motions(motions, None if estimate else noise, fit.covariance_X, angle, distance, fit.X)
    else:
        assert isinstance(noise, PoseNoise)
        kept = table.weight > 0
        whole = bool(kept.all())
        rest, rest_noise = (poses, noise) if whole else (poses.rows(kept), noise.rows(kept))
        # noise that was estimated explains any residuals, and says only how those of the poses differ
        known, own = (rest_noise, None) if estimate is None else (None, rest_noise)
        if own is not None and not (is_of_each(own.robot) or is_of_each(own.camera)):
            own = None
        findings += check_fit(rest, fit.X, known, fit.covariance_X, own)
    halves = (analysis.split_half.finding, analysis.split_in_time.finding)
    findings += [found for found in (*analysis.diagnostics.findings, *halves) if found.severity != "note"]
    findings += shared_findings(job, result, joint)
    findings += local_findings(result)
    if estimate is not None:
        findings += against_data_sheet(result) + against_corners(estimate)
        if len(data) < FEWEST_FOR_ROBUST:
            values = {"item": table.item, "count": len(data), "needed": FEWEST_FOR_ROBUST}
            findings.append(Finding("calibration.few_for_outliers", "caution", values))
    return result, said + findings


def _carried_errors(job: Job, fit: Fit, poses: PosePairs | None) -> list[SharedError]:
    """Return the errors that are carried to X and not fitted; an assumed one as large as the residuals leave it."""
    if poses is None:
        return []
    found = [error for error in job.carried if not error.is_exact]
    return [scaled_by_residuals(fit, error, poses) if error.default else error for error in found]


def _carried_estimates(
    errors: Sequence[SharedError], moves: Mapping[str, Array], covariance: Array
) -> list[SharedEstimate]:
    """Return the estimates of the errors that are carried to X and not fitted."""
    return [part for error in errors for part in carried_estimates(error, moves[error.name], covariance)]


def _time_offset(poses: PosePairs | None, fit: Fit, covariance: Array) -> tuple[TimeOffset | None, Array | None]:
    """Return the effect of the offset of interpolated poses on X, and one standard deviation of it as a move (12,) of
    X and W.
    """
    timing = None if poses is None else poses.timing
    if timing is None or fit.W is None:
        return None, None
    g = offset_sensitivity(fit, timing)
    move = timing.std * g
    added = float(move[:6] @ np.linalg.pinv(covariance, rcond=SINGULAR, hermitian=True) @ move[:6])
    sensitivity = tuple(float(value) for value in g[:6])
    return TimeOffset(timing.offset, timing.std, timing.side, sensitivity, added / (1.0 + added)), move
