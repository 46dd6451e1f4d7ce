"""Bundle adjustment on the corners of the board, started from `efficient`, with the agreement of both."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..findings import Finding
from ..fit.likelihood.rig_bundle import Agreement, adjust_rig
from ..model.error_terms.keys import CAMERA_EXCESS, PICTURE_SHIFT
from ..model.noise.models import PoseNoise
from ..model.poses.residuals import residuals, summarise
from .by_likelihood import by_likelihood
from .estimate.analysis import Analysis
from .job import Job
from .request import BUNDLE
from .result import Calibration

# A bundle adjustment that differs from `efficient` by more standard deviations, or by a larger ratio of variances,
# is a caution.
MAX_BUNDLE_DIFFERENCE = 1.5


def by_bundle(job: Job) -> tuple[Calibration, list[Finding]]:
    """Estimate X by bundle adjustment with independent poses, from the noise, the outliers and the X of `efficient`."""
    result, findings = by_likelihood(replace(job, method="efficient", request=replace(job.request, correlation="none")))
    analysis, poses = result.analysis, job.poses
    assert isinstance(analysis, Analysis) and isinstance(analysis.noise, PoseNoise) and poses is not None
    assert result.covariance is not None
    fit, robot = analysis.fit, analysis.noise.robot
    components = () if result.noise_estimate is None else result.noise_estimate.components
    calibration = poses.camera_calibration
    corners = 0.0 if calibration is None else float(np.median(np.bincount(calibration.corners.picture)))
    # A shift of a picture that the data resolve is noise of its corners that moves their mean by as much.
    times = {CAMERA_EXCESS: 1.0, PICTURE_SHIFT: corners}
    told = [part for part in components if part.key == CAMERA_EXCESS or part.status == "estimated"]
    excess = float(np.sqrt(sum(times.get(part.key, 0.0) * part.size**2 for part in told)))
    found = adjust_rig(poses, robot, fit.unknowns, fit.weights, excess)
    agreement = Agreement.of(found.X, found.covariance_X, fit.X, fit.covariance_X)
    of_offset = result.covariance - fit.covariance_X
    angle, distance = residuals(job.motions.A, job.motions.B, found.X)
    result = replace(
        result,
        X=found.X,
        W=found.W,
        covariance=found.covariance_X + of_offset,
        covariance_W=found.covariance_W,
        method=BUNDLE,
        iterations=found.iterations,
        residuals=summarise(angle, distance),
        agreement=agreement,
    )
    low, high = agreement.eigenvalues[0], agreement.eigenvalues[-1]
    if max(agreement.distance, high, 1 / low if low > 0 else np.inf) >= MAX_BUNDLE_DIFFERENCE:
        values = {
            "distance": agreement.distance,
            "largest": np.abs(agreement.by_component).max(),
            "variance_low": agreement.eigenvalues[0],
            "variance_high": agreement.eigenvalues[-1],
        }
        findings.append(Finding("calibration.bundle_differs", "caution", values))
    return result, findings
