"""X by `efficient` or `ml`, with its covariance at the Cramer-Rao bound, and what the result states about the fit."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..core.geometry.se3 import Array, difference
from ..core.levels import DOUBTFUL, UNUSUAL
from ..core.limits import MIN_POSES_FOR_ROBUST
from ..core.read_only import read_only
from ..core.rounding import CHAIN_ROUNDING, SOLUTION_ROUNDING
from ..errors import DegenerateMotionError, InputError, NotConvergedError
from ..findings import Finding
from ..fit.diagnostics.lengths import check_place
from ..fit.diagnostics.pose_table import pose_table
from ..fit.diagnostics.resampled import resampled
from ..fit.diagnostics.residuals import check_fit, check_motions, misread
from ..fit.diagnostics.rotations import require_signal
from ..fit.graph.constraint import Constraint, Unknowns
from ..fit.graph.estimation import FoundSizes, JointModel
from ..fit.graph.gauss_helmert import (
    FITS,
    Fit,
    corrected,
    offset_sensitivity,
    open_at,
)
from ..fit.graph.goodness_of_fit import goodness_of_fit
from ..fit.graph.mode import ROUGH_GAIN
from ..fit.graph.noise_report import noise_estimate_of
from ..fit.graph.own_residuals import walks
from ..fit.graph.points import OpenSizes, with_open_sizes
from ..fit.graph.posterior import Posterior
from ..fit.graph.request import of_motions
from ..fit.graph.robust import RobustFit, fit_robustly
from ..fit.graph.shared_estimates import (
    estimates_of,
    motion_in_session,
    of_moves,
    posterior_of_fit,
    without_shared_errors,
)
from ..fit.graph.starts import leaves_open, start_open
from ..fit.graph.weighing import TAIL_SLACK, fitted_again, settle, weigh, weigh_from_two_starts
from ..methods.published_fit import Published, fit_published
from ..model.errors.camera_noise import CameraNoise
from ..model.errors.key import ErrorKey, Kind
from ..model.errors.keys import (
    BY_VIEW,
    CAMERA_SCALE,
    CLOCK_OFFSET,
    FOCAL_LENGTH,
    JOINT_NOISE,
    LENS,
    MOTION,
    OUTLINE,
    PRINCIPAL_POINT,
    ROBOT_ACCURACY,
    SIZES_OPEN,
    TARGET_SCALE,
    VIEW,
    WALKS,
)
from ..model.errors.models import Noise, PoseNoise, is_of_each, with_prior
from ..model.errors.square_roots import Covariance
from ..model.kinematics.kinematic_errors import ACCURATE
from ..model.poses.motions import Motions, relative_motions
from ..model.poses.pose_pairs import PosePairs
from ..model.poses.residuals import residuals, summarise
from ..model.poses.timing import TimeOffset
from ..model.shared_errors.assumed import assumed_drift
from ..model.shared_errors.in_noise import shared_columns, with_shared, without_shared
from ..model.shared_errors.shared_error import WRONG_SIZE
from ..model.shared_errors.walk import assumed_walk
from .analysis import Analysis, FittedKinematics
from .by_published import bare_result, estimate_unweighted, reference_for, reference_of
from .camera_of_result import given_by_robot, is_negligible, moved_intrinsics
from .closed_forms import closed_forms
from .contradictions import against_corners, against_data_sheet, against_prior, shared_findings
from .findings import GIVEN, MAX_REJECTED_SHARE, said_open, wrong_poses
from .job import Job
from .moves import moves
from .parts import FourDPA
from .prediction.workspace import local_findings
from .result import Calibration

# The errors of an arm are linearised again where their second order moves its poses by more than this, in standard
# deviations of X.
MAX_SECOND_ORDER_SD = 0.05
# Another branch of the inverse kinematics is taken where the logarithm of its evidence is larger by this.
MIN_LOG_EVIDENCE_GAIN = 1.0
# A random walk of the camera poses is taken where the logarithm of its evidence is larger by this.
MIN_LOG_EVIDENCE_OF_WALK = 5.0
# An arm counts as a calibrated one where the logarithm of the evidence is larger by this, odds of 20 to 1.
MIN_ACCURATE_GAIN = 3.0
# Findings after which the place of the camera needs no further word.
PLACED = frozenset(
    f"input_checks.{name}"
    for name in [
        "long_bracket",
        "setup_by_lengths",
        "setup_not_said",
        "target_unseen",
        "steadier_reading",
        "poses_unexplained",
        "wrong_scale",
        "misread_axes",
    ]
)
# Errors whose columns at other poses follow from the poses that they were bound to.
OF_POSES = frozenset({ROBOT_ACCURACY, VIEW, LENS, OUTLINE, FOCAL_LENGTH, PRINCIPAL_POINT})


def by_likelihood(job: Job) -> tuple[Calibration, list[Finding]]:
    """Estimate X by `efficient` or `ml`, and by 4DPA for comparison."""
    noise, constraint, known = job.noise, job.constraint, job.pose_prior
    fourdpa: Published | None = None
    with suppress(DegenerateMotionError):
        fourdpa = fit_published(job.motions, noise, "4dpa", None, job.everything)
    opens = True
    if fourdpa is None:
        at = start_open(constraint, noise, known)
    elif opens := leaves_open(constraint, noise, at := constraint.complete(fourdpa.X)):
        with suppress(DegenerateMotionError):
            at, fourdpa = start_open(constraint, noise, known), None
    start = fourdpa or Published(job.motions, "4dpa", None, at.X, at.W, 0, job.everything)
    angle, distance = residuals(job.motions.A, job.motions.B, at.X)
    if not opens and known is None and (noise is None or noise.prior is None):
        require_signal(job.motions, noise, angle)  # half turns whose signs are lost in the noise
    source = None if noise is not None else replace(joint_model_of(job, constraint), nothing_open=not opens)
    sides = (job.motions.A, job.motions.B) if job.poses is None else (job.poses.robot, job.poses.camera)
    longest = max(float(np.abs(T[:, :3, 3]).max()) for T in sides) or 1.0
    exact = noise is None and max(angle.max(), distance.max() / longest) < CHAIN_ROUNDING
    if source is not None and not exact:
        job, source = _in_its_branch(job, source, at)
    robust: RobustFit | None = None
    found: FoundSizes | None = None
    if job.robust and not exact:
        if source is None:
            robust = fit_robustly(constraint, noise, at, job.method, seed=job.request.seed)
        else:
            robust, found = weigh_from_two_starts(source, at, job.method, job.request.seed, *_slack(job))
            if (other := _as_accurate_arm(job, found)) is not None:
                job, source = other
                at = robust.fit.unknowns
                robust, found = weigh_from_two_starts(source, at, job.method, job.request.seed, *_slack(job))
        noise = robust.noise
    elif source is not None:
        found = source.find(at)
        if (other := _as_accurate_arm(job, found)) is not None:
            job, source = other
            found = source.find(at)
        noise = None if found.noise is None else with_prior(found.noise, known)
    if noise is None:  # the data fit exactly: there are no weights, and all estimates agree
        assert found is not None
        estimate = noise_estimate_of(found)
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
    if source is not None:
        assert found is not None
        found, noise, fit, robust = settle(source, noise, fit, robust, found, job.method, _at_corrected)
        walking = _walking(job, source, found, fit, robust)
        if walking is not None:
            found, noise, fit, robust = walking
        job = replace(job, shared=found.errors)
    elif job.columns:
        noise = _columns_at_corrected(job, noise, fit)
        fit = fitted_again(constraint, noise, fit, job.method)
    robust = None if robust is None else replace(robust, fit=fit, noise=noise)
    del source  # its columns are those at the measured poses: of many poses their memory is needed
    return _assembled(job, noise, fit, fourdpa, found, robust)


def _walking(
    job: Job, source: JointModel, found: FoundSizes, fit: Fit, robust: RobustFit | None
) -> tuple[FoundSizes, Noise, Fit, RobustFit | None] | None:
    """Return the fit with a random walk of the camera poses, where neighbouring residuals ask for one; else None."""
    poses, request = job.poses, job.request
    asked = request.correlation == "auto" and request.covariance == "model" and job.given is None
    if not asked or poses is None or poses.truth is not None or found.exact.any() or not walks(fit, poses):
        return None
    scale = any(error.key == CAMERA_SCALE for error in job.shared)
    walked = replace(source, errors=(*job.shared, *assumed_walk(poses, scale)), most_used=100)  # poses
    try:
        again, sizes = weigh(walked, fit.unknowns, job.method, request.seed, _slack(job)[0])
        assert sizes is not None and again.noise is not None
        answer = settle(walked, again.noise, again.fit, again, sizes, job.method, _at_corrected)
    except (InputError, NotConvergedError):
        return None
    # Both by the same rows: those that both keep, as many as the walk is found by.
    rows = np.zeros(poses.n)
    rows[np.intersect1d(found.kept, answer[0].kept)] = 1.0
    with suppress(InputError, NotConvergedError):
        without = replace(source, most_used=walked.most_used).find(fit.unknowns, rows).mode.log_evidence
        gain = walked.find(answer[2].unknowns, rows).mode.log_evidence - without
        return answer if gain > MIN_LOG_EVIDENCE_OF_WALK else None
    return None


def _in_its_branch(job: Job, source: JointModel, at: Unknowns) -> tuple[Job, JointModel]:
    """Return the request and its model in the branch of the inverse kinematics that the rows make most probable.

    Where an elbow or a wrist is the other way round, the errors of the arm have other effects. Rows are those that
    robust weights keep with the first branch.
    """
    if job.arm is None or not job.terms_of_arm or not (others := job.arm.other_branches()):
        return job, source
    rows = None
    if job.robust:
        with suppress(InputError, NotConvergedError):
            robust = weigh(source, at, job.method, job.request.seed, _slack(job)[0])[0]
            rows, at = (robust.weights > 0).astype(float), robust.fit.unknowns
    best, most = (job, source), -np.inf
    for arm in (job.arm, *others):
        asked = replace(job, arm=arm, terms_of_arm=arm.terms)
        model = source if arm is job.arm else joint_model_of(asked, job.constraint)
        with suppress(NotConvergedError):
            evidence = model.find(at, rows, gain=ROUGH_GAIN).mode.log_evidence
            if evidence > most + (0.0 if arm is job.arm else MIN_LOG_EVIDENCE_GAIN):
                best, most = (asked, model), evidence
    return best


def _as_accurate_arm(job: Job, found: FoundSizes | None) -> tuple[Job, JointModel] | None:
    """Return the request and its model for an arm that is calibrated, where its class is left to the data and they make
    that much more probable than the usual one, with the rows that count and near the unknowns of ``found``.
    """
    arm = job.arm
    if arm is None or not job.terms_of_arm or not arm.errors.class_is_open or found is None or found.exact.any():
        return None
    arm = arm._replace(errors=replace(arm.errors, robot_class=ACCURATE))
    asked = replace(job, arm=arm, terms_of_arm=arm.terms)
    model, rows = joint_model_of(asked, job.constraint), np.zeros(job.constraint.n)
    rows[found.kept] = 1.0
    with suppress(NotConvergedError):
        if model.find(found.at, rows, gain=ROUGH_GAIN).mode.log_evidence > found.mode.log_evidence + MIN_ACCURATE_GAIN:
            return asked, model
    return None


def _slack(job: Job) -> tuple[float, float]:
    """Factors of the limits of robust weights, and that of all rows alike."""
    accuracy = any(error.key == ROBOT_ACCURACY for error in job.shared)
    return TAIL_SLACK if job.arm is not None else 1.0, TAIL_SLACK if job.arm is not None or accuracy else 1.0


def joint_model_of(job: Job, constraint: Constraint) -> JointModel:
    """Return the components of a request whose noise is to be estimated."""
    poses, robot = job.poses, job.robot_noise
    camera: Covariance | CameraNoise | None = job.camera_noise
    if job.given is not None:  # a side that it leaves out is exact
        camera, robot = (np.zeros((6, 6)) if S is None else S for S in (job.given.camera, job.given.robot))
    errors = job.shared
    if (
        poses is not None
        and job.request.correlation == "auto"
        and job.request.covariance == "model"
        and job.given is None
    ):
        errors = (*errors, *assumed_drift(poses))
    return JointModel.beside(
        constraint,
        poses,
        job.request.prior,
        camera,
        robot,
        errors,
        pose_prior=job.pose_prior,
        arm=job.terms_of_arm,
        sizes=job.request.sizes,
        more=job.request.components,
    )


def _at_corrected(source: JointModel, noise: Noise, fit: Fit) -> JointModel:
    """Return the model with its columns at the poses as the fit corrects them (`_columns_at_corrected`)."""
    if source.poses is None or not isinstance(noise, PoseNoise):
        return source
    by_view = next((part.block for part in source.components if part.key == BY_VIEW), None)
    return replace(source, poses=_corrected_poses(source.poses, noise, fit), by_view=by_view)


def _corrected_poses(poses: PosePairs, noise: PoseNoise, fit: Fit) -> PosePairs:
    """The poses as the fit corrects them, without what belongs to those measured."""
    robot, camera = corrected(fit, noise, poses.robot, poses.camera)
    return PosePairs(robot, camera, poses.setup, poses.timestamps)


def poses_about_errors(job: Job, result: Calibration) -> PosePairs | None:
    """The poses that replace the measured ones when the errors of the arm are linearised at their estimate.

    None where that makes no difference.
    """
    if job.arm is None or result.kinematics is None or result.covariance is None or job.poses is None:
        return None
    arm = job.arm._replace(joints=result.kinematics.joints)
    again = arm.linear_about(result.kinematics.e)
    if is_negligible(difference(again, job.poses.robot), result.covariance, MAX_SECOND_ORDER_SD):
        return None
    return replace(job.poses, robot=again)


def motions_without_shared_errors(motions: Motions, noise: Noise, fit: Fit) -> Motions:
    """Return motions corrected by the estimated errors that all poses share; those without poses are unchanged."""
    poses = motions.poses
    if poses is None or motions.pairs is None or poses.n != len(fit.residual):
        return motions
    found = without_shared_errors(fit, noise, poses.robot, poses.camera)
    return motions if found is None else relative_motions(PosePairs(*found, poses.setup), motions.pairs)


def _joint_noise(job: Job, found: Mapping[Kind, float] | None) -> dict[ErrorKey, Array]:
    """Covariances (n, 6, 6) that joint noise gives the robot poses; nothing where there is none."""
    if job.arm is None:
        return {}
    sd = float(job.arm.errors.joint_sd or 0.0) if found is None else found.get(Kind.JOINT_NOISE, 0.0)
    terms = job.arm.terms if sd > 0 else ()
    return {term.key: sd**2 * term.covariance for term in terms if term.key == JOINT_NOISE}


def _fitted(job: Job, posterior: Posterior, found: Mapping[Kind, float] | None) -> FittedKinematics | None:
    """Return the results of the fit about the arm."""
    if job.arm is None:
        return None
    given = job.arm.errors
    declared = given.standard_deviations | {Kind.JOINT_NOISE: float(given.joint_sd or 0.0)}
    sd = {kind.value: size for kind, size in (declared if found is None else found).items()}
    left = job.arm.against.rms
    return FittedKinematics.of(job.arm.kinematics, job.arm.joints, given.how, given.flange, sd, left, posterior)


def _columns_at_corrected(job: Job, noise: Noise, fit: Fit) -> PoseNoise:
    """The noise with the columns of shared errors taken at the poses as the fit corrects them.

    Columns at measured poses hold their noise, which the residuals hold too: where X and W absorb all else of a column,
    the residuals would seem to ask for the error.
    """
    assert isinstance(noise, PoseNoise) and job.poses is not None
    poses = _corrected_poses(job.poses, noise, fit)
    return with_shared(without_shared(noise, job.shared), shared_columns(job.shared, poses))


def _assembled(
    job: Job,
    noise: Noise,
    fit: Fit,
    start: Published | None,
    found: FoundSizes | None,
    robust: RobustFit | None,
) -> tuple[Calibration, list[Finding]]:
    estimate = None if found is None else noise_estimate_of(found)
    deviations = None if found is None or job.arm is None else found.of_arm
    data, motions, poses = job.data, job.motions, job.poses
    reference = reference_for(fit, estimate)
    covariance, covariance_W = fit.covariance_X, fit.covariance_W
    if fit.open is not None and job.request.covariance != "model":
        raise InputError(
            f"The motions leave a part of X open, for which only covariance='model' is available, got "
            f"{job.request.covariance!r}."
        )
    if job.request.covariance != "model":
        resample = resampled(data, job.method, job.request.covariance, fit=fit, seed=job.request.seed)
        covariance, covariance_W, reference = resample.covariance_X, resample.covariance_W, reference_of(resample)
    beside: dict[ErrorKey, Array] = {}
    if found is not None and job.request.covariance == "model":
        beside[SIZES_OPEN] = found.spread
        if (motion := motion_in_session(fit, noise)) is not None:
            beside[MOTION] = motion
    without = covariance + sum((of_moves(move[:6]) for move in beside.values()), np.zeros((6, 6)))
    time_offset, by_offset = _time_offset(poses, fit, without)
    if by_offset is not None:
        beside[CLOCK_OFFSET] = by_offset
    for move in beside.values():
        covariance = covariance + of_moves(move[:6])
        covariance_W = None if covariance_W is None else covariance_W + of_moves(move[6:])
    table = pose_table(fit, robust)
    # Beside a camera covariance from corners the noise counts as known: most of it, or the test errs on the safe side.
    dof = None if estimate is not None and estimate.camera_known else reference_for(fit, estimate).dof
    within = _joint_noise(job, deviations)
    seed = int(job.request.seed)
    analysis = Analysis(data, noise, fit, job.method, estimate, dof, seed, read_only(beside), read_only(within))
    seen = motions_without_shared_errors(motions, noise, fit)
    angle, distance = residuals(seen.A, seen.B, fit.X)
    del seen
    judged = goodness_of_fit(fit)
    if estimate is not None and not estimate.tested:
        judged = replace(judged, p_value=None)
    joint = posterior_of_fit(fit, noise, job.shared, beside)
    posterior: Posterior | OpenSizes | None = None
    if fit.W is not None and fit.open is None:
        posterior = joint
        if poses is not None and (found is not None or not OF_POSES.isdisjoint(key.error for key in joint.keys)):
            posterior = replace(joint, bound=(poses.robot, poses.camera), times=poses.timestamps)
        if found is not None:
            more = [of_moves(move) for key, move in beside.items() if key != SIZES_OPEN]
            of_rest = sum(more, np.zeros_like(fit.covariance))
            posterior = with_open_sizes(posterior, fit.covariance, of_rest, found, noise)
    shared = estimates_of(joint, job.shared, fit)
    at = None if found is None else found.source.poses
    if isinstance(posterior, OpenSizes):
        analysis = replace(analysis, joint=posterior, prior_sd={error.key: error.size for error in shared})
    result = replace(
        bare_result(job, fit.X, fit.W, summarise(angle, distance), noise),
        covariance=covariance,
        covariance_W=covariance_W,
        iterations=fit.iterations if job.method == "ml" else 0,
        covariance_kind=job.request.covariance,
        reference=reference,
        noise_estimate=estimate,
        bound=fit.covariance_X,
        fourdpa=None if start is None else FourDPA(start.X, start.covariances(noise)[0]),
        fit=judged,
        table=table,
        time_offset=time_offset,
        shared_at_sizes=shared,
        analysis=analysis,
        opened=fit.opened,
        joint_posterior=posterior,
        corrected=None if at is None else np.stack([at.robot[:, :3], at.camera[:, :3]]),
        kinematics=None if posterior is None else _fitted(job, joint, deviations),
    )
    wrong_size = _wrong_size(found, result)
    said = said_open(fit.opened, result.setup) + against_prior(fit)
    findings = table.findings if robust else wrong_poses(job, noise, table)
    if estimate is not None:
        of_noise = "diagnostics.noise_too_small"
        findings = [
            Finding(of_noise, one.severity, {"scale": one.values["scale"], "estimated": True})
            if one.code == of_noise
            else one
            for one in findings
        ]
    findings += _of_fit(job, noise, fit, result, wrong_size, (angle, distance))
    if poses is not None and isinstance(noise, PoseNoise):
        findings += moves(poses, noise, fit, shared)
    halves = (analysis.split_half.finding, analysis.split_in_time.finding)
    findings += [found for found in (*analysis.diagnostics.findings, *halves) if found.severity != "note"]
    findings += shared_findings(job, result, joint, wrong_size)
    seen_by = None if poses is None else poses.camera_calibration
    findings += moved_intrinsics(seen_by, noise, joint)
    if seen_by is not None and not any(one.code == GIVEN for one in seen_by.findings):
        findings += given_by_robot(seen_by, fit)
    if result.kinematics is not None:
        findings += local_findings(result)
    if estimate is not None:
        findings += against_data_sheet(result) + against_corners(estimate, judged)
        if len(data) < MIN_POSES_FOR_ROBUST:
            values = {"item": table.item, "count": len(data), "needed": MIN_POSES_FOR_ROBUST}
            findings.append(Finding("calibration.few_for_outliers", "caution", values))
    return result, said + findings


def _of_fit(
    job: Job, noise: Noise, fit: Fit, result: Calibration, wrong_size: float | None, off: tuple[Array, Array]
) -> list[Finding]:
    """Return what the residuals say of the files and of X; ``off``: rotations and distances of the motions."""
    poses, table, estimate = job.poses, result.table, result.noise_estimate
    assert table is not None
    if poses is None or of_motions(noise):
        return check_motions(job.motions, None if estimate else noise, fit.covariance_X, *off, fit.X)
    assert isinstance(noise, PoseNoise)
    if any(error.key in WALKS.values() for error in job.shared):  # a walk is no other reading of the files
        corrected_by = without_shared_errors(fit, noise, poses.robot, poses.camera)
        if corrected_by is not None:
            poses = PosePairs(*corrected_by, poses.setup, poses.timestamps)
    kept = table.weight > 0
    rest, rest_noise = (poses, noise) if kept.all() else (poses.rows(kept), noise.rows(kept))
    # estimated noise explains any residuals, and shows only how those of the poses differ
    known, own = (rest_noise, None) if estimate is None else (None, rest_noise)
    if own is not None and not (is_of_each(own.robot) or is_of_each(own.camera)):
        own = None
    size = next((1.0 / (1.0 + of.estimate) for of in result.shared_at_sizes if of.key == TARGET_SCALE), 1.0)
    sure = wrong_size is None or wrong_size > 1 - DOUBTFUL.probability
    any_scale = any(error.key == CAMERA_SCALE for error in job.shared)
    looked = check_fit(rest, fit.X, known, fit.covariance_X, own, size, sure, judged=True, any_scale=any_scale)
    if (~kept).mean() > MAX_REJECTED_SHARE and not any(one.severity == "failure" for one in looked):
        looked += misread(poses, fit.X, minority=2 * kept.sum() < len(kept))
    if job.pose_prior is None and fit.open is None and not any(one.code in PLACED for one in looked):
        looked += check_place(poses, fit.X, fit.covariance_X)
    return looked + closed_forms(job, result, table)


def _wrong_size(found: FoundSizes | None, result: Calibration) -> float | None:
    """Return the probability that the target has another size, sizes of errors integrated over; None: not computed."""
    scale = next((error for error in result.shared_at_sizes if error.key == TARGET_SCALE), None)
    if found is None or scale is None:
        return None
    likely = scale.beyond(WRONG_SIZE)
    return likely if likely < UNUSUAL.probability else found.probability_of(TARGET_SCALE, WRONG_SIZE)


def _time_offset(poses: PosePairs | None, fit: Fit, covariance: Array) -> tuple[TimeOffset | None, Array | None]:
    """Return the effect of the offset of interpolated poses on X, and one standard deviation of it as a move (12,) of
    X and W.
    """
    timing = None if poses is None else poses.timing
    if timing is None or fit.W is None:
        return None, None
    g = offset_sensitivity(fit, timing)
    move = timing.std * g
    added = float(move[:6] @ np.linalg.pinv(covariance, rcond=SOLUTION_ROUNDING, hermitian=True) @ move[:6])
    sensitivity = tuple(float(value) for value in g[:6])
    return TimeOffset(timing.offset, timing.std, timing.side, sensitivity, added / (1.0 + added)), move
