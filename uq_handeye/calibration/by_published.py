"""X by a published method, with its covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..core.geometry.se3 import Array
from ..errors import InputError, NotConvergedError
from ..findings import Finding
from ..fit.diagnostics.resampled import Resampled, resampled
from ..fit.diagnostics.residuals import check_fit, check_motions
from ..fit.diagnostics.rotations import require_signal
from ..fit.graph.gauss_helmert import Fit, efficient
from ..fit.graph.goodness_of_fit import components_of, effective_dof
from ..fit.graph.noise_of_data import estimate_noise
from ..fit.graph.reference import Reference
from ..methods.published_fit import Published, fit_published
from ..methods.registry import ROBOT_WORLD_METHODS
from ..model.errors.models import Noise, PoseNoise
from ..model.errors.noise_estimate import NoiseEstimate
from ..model.poses.residuals import Residuals, residuals, rotation_angles, summarise
from ..model.poses.timing import left_out_of
from .job import Job
from .parts import Errors, Origin, Quality, Solution
from .result import Calibration

# Beyond this angle of X (rad) the errors of Tsai's Rodrigues vector grow by a factor of ten and more.
NEAR_HALF_TURN_OF_X = np.radians(170.0)


def by_published(job: Job) -> tuple[Calibration, list[Finding]]:
    """Estimate X by a method of METHODS or ROBOT_WORLD_METHODS."""
    motions, poses = job.motions, job.poses
    found = fit_published(motions, job.noise, job.method, job.request.scale, job.everything)
    angle, distance = residuals(motions.A, motions.B, found.X)
    require_signal(motions, job.noise, angle)
    noise, estimate, reference = job.noise, None, Reference()
    if noise is None:
        try:
            estimate = estimate_noise(
                job.data, job.request.prior, start=found.X, camera=job.camera_noise, robot=job.robot_noise,
                shared=job.shared,
            )  # fmt: skip
        except (InputError, NotConvergedError) as error:  # X does without
            unknown = Finding("calibration.noise_not_estimated", "caution", {"error": str(error)})
            return estimate_unweighted(job, found, None, [unknown])
        if estimate.noise is None:
            return estimate_unweighted(job, found, estimate)
        at_bound = efficient(job.data, estimate.noise, found.X)
        noise = estimate.noise
        reference = reference_for(at_bound, estimate)
    covariance, covariance_W, doubts = found.covariances(noise, job.request.kind)
    if job.request.covariance != "model":
        every_pair = job.everything is not None or job.method in ROBOT_WORLD_METHODS
        data = poses if poses is not None and every_pair else motions
        resample = resampled(data, job.method, job.request.covariance, X=found.X, noise=noise, seed=job.request.seed)
        covariance, covariance_W, reference = resample.covariance_X, resample.covariance_W, reference_of(resample)
    if poses is None:
        findings = check_motions(motions, None if estimate else noise, covariance, angle, distance, found.X)
    else:
        given = noise if isinstance(noise, PoseNoise) and estimate is None else None
        findings = check_fit(poses, found.X, given, None if given is None else covariance)
    if job.request.covariance == "model":
        findings += doubts
    angle_of_X = float(rotation_angles(found.X[:3, :3]))
    if job.method == "tsai" and angle_of_X > NEAR_HALF_TURN_OF_X:
        findings.append(Finding("calibration.near_half_turn", "caution", {"angle": angle_of_X}))
    if poses is not None:
        findings += left_out_of(f"method {job.method!r}", poses.timing)
    result = replace(
        bare_result(job, found.X, found.W, summarise(angle, distance), noise),
        covariance=covariance,
        covariance_W=covariance_W,
        iterations=found.iterations,
        covariance_kind=job.request.covariance,
        reference=reference,
        noise_estimate=estimate,
    )
    return result, findings


def estimate_unweighted(
    job: Job, found: Published, estimate: NoiseEstimate | None, findings: Sequence[Finding] = ()
) -> tuple[Calibration, list[Finding]]:
    """X without covariance, where the noise cannot be estimated: the data fit exactly, or not at all."""
    angle, distance = residuals(job.motions.A, job.motions.B, found.X)
    result = bare_result(job, found.X, found.W, summarise(angle, distance), None)
    more = [] if job.poses is None else check_fit(job.poses, found.X, None, None)
    if job.request.covariance != "model":
        more.append(Finding("calibration.no_covariance", "caution", {"covariance": job.request.covariance}))
    return replace(result, noise_estimate=estimate, kind=None), [*findings, *more]


def bare_result(job: Job, X: Array, W: Array | None, of_pairs: Residuals, noise: Noise | None) -> Calibration:
    """X with all results that do not depend on the covariance."""
    poses, data, kind = job.poses, job.data, job.request.kind
    kind = kind or ("pairs" if data is job.motions else "poses")
    n_pairs = job.everything.n_pairs if job.everything else job.motions.N
    setup, n_poses = (None, None) if poses is None else (poses.setup, poses.n)
    return Calibration(
        X,
        W=W,
        origin=Origin(setup=setup, n_poses=n_poses, n_pairs=n_pairs, data=data),
        solution=Solution(method=job.method, scale=job.request.scale, kind=kind),
        errors=Errors(noise=noise),
        quality=Quality(residuals=of_pairs),
    )


def reference_for(fit: Fit, estimate: NoiseEstimate | None) -> Reference:
    """The reference distribution for the covariance of the noise: chi-square if a prior fixes the noise completely."""
    dof = float("inf") if estimate is None else effective_dof(fit, estimate)
    known = components_of(fit)
    return Reference("t", dof, known) if np.isfinite(dof) else Reference(components=known)


def reference_of(resample: Resampled) -> Reference:
    """The reference distribution for a covariance from residuals."""
    return Reference("Hotelling", resample.freedom)
