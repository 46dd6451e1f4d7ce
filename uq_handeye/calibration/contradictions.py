"""Findings about declared errors: those that the data contradict, and those that they cannot separate from X.

Declared are the noise of data sheets or corners, the errors that all poses share, and priors.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtr

from ..core.levels import CONTRADICTED, DOUBTFUL, RARE
from ..core.rounding import EPS
from ..findings import GROSS_EXCESS, Finding, Severity
from ..fit.diagnostics.prior_check import MIN_SHARE_FROM_DATA, prior_findings
from ..fit.diagnostics.residuals import MAX_TARGET_RATIO
from ..fit.graph.declared import Errors, declared_of
from ..fit.graph.gauss_helmert import Fit
from ..fit.graph.goodness_of_fit import GoodnessOfFit
from ..fit.graph.graph import Graph
from ..fit.graph.noise import RigNoise
from ..fit.graph.posterior import Posterior
from ..fit.graph.shared_estimates import GroupTest, group_test
from ..model.camera.description import spacing_of
from ..model.errors.error_estimate import ErrorEstimate, share_beyond
from ..model.errors.key import ErrorKey, Kind
from ..model.errors.keys import ROBOT_ACCURACY, TARGET_SCALE
from ..model.errors.noise_estimate import NoiseEstimate
from ..model.shared_errors.shared_error import WRONG_SIZE
from .job import Job
from .result import Calibration

# The data do not resolve an error whose standard deviation stays above this share of the declared one.
UNRESOLVED_SD = 0.95
# An error is confounded with X where it makes a larger share of the variance along one direction.
DOMINANT_SHARE = 0.8
# X is hardly determined where a confounded error moves it by more (rad, or relative to the distance of the target).
MAX_CONFOUNDED_SIZE = 0.02


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

    Estimated noise compensates for residuals that are larger; the lower tail of chi-square tests for residuals that are
    smaller than the camera's covariance alone allows.
    """
    found = [one for one in estimate.findings if one.severity != "note"]
    p = float(chdtr(judged.dof, judged.chi2))
    if estimate.camera_known and p < RARE.probability:
        values = {"factor": judged.chi2 / judged.dof, "p_value": p, "dof": judged.dof}
        found.append(Finding("noise_estimation.camera_factor", "caution", values))
    return found


def shared_findings(job: Job, result: Calibration, joint: Posterior, wrong_size: float | None = None) -> list[Finding]:
    """Findings of shared errors that contradict their prior, that show a wrong size, or that cannot be separated from
    X.

    The numbers of one error are tested together: of many single ones some are far out by chance.
    ``wrong_size``: the probability that the target has another size; None: by its Gaussian.
    """
    found: list[Finding] = []
    sd = {key: float(s) for one in job.shared for key, s in zip(one.keys, one.sd, strict=True)}
    by_key: dict[ErrorKey, list[ErrorEstimate]] = {}
    for error in result.shared_at_sizes:
        by_key.setdefault(error.key.source, []).append(error)
    for key, errors in by_key.items():
        declared = len(errors) > 1 and not errors[0].default  # sizes that are assumed were found by these data
        if declared:
            found += _of_group(group_test(joint, sd, key), key, len(errors), errors[0].accuracy is not None)
    single = [errors[0] for errors in by_key.values() if len(errors) == 1]
    for error in single:
        alone, alone_sd = error.alone, error.alone_sd
        told = alone is not None and alone_sd is not None and MIN_SHARE_FROM_DATA * alone_sd**2 < error.size**2
        if told and (error.p_value or 0) < CONTRADICTED.probability:
            factor, unit = error.shown
            numbers = {"estimate": alone, "sd": alone_sd, "assumed": error.size}
            shown = {name: factor * number for name, number in numbers.items() if number is not None}
            values = {"name": error.name, "unit": unit, "p_value": error.p_value} | shown
            found.append(Finding("calibration.shared_contradicted", "caution", values))
        probability = error.beyond(WRONG_SIZE) if wrong_size is None else wrong_size
        if error.key == TARGET_SCALE and probability > 0.5:
            size = {"estimate": error.estimate, "sd": error.sd, "square": _square_of(job), "probability": probability}
            found.append(Finding("calibration.target_size", "caution", size))
    groups: dict[ErrorKey, list[ErrorEstimate]] = {}
    for error in single:
        if error.share > DOMINANT_SHARE:
            groups.setdefault(error.key.error, []).append(error)
    return found + [finding for key, errors in groups.items() for finding in _confounded(result, str(key), errors)]


def _of_group(test: GroupTest | None, key: ErrorKey, count: int, of_arm: bool) -> list[Finding]:
    """Return a finding where the numbers of an error are together larger, or smaller, than assumed."""
    # An arm of right accuracy is within a factor of 2 of the population that represents it.
    least, most = (0.5, 2.0) if of_arm else (0.0, 1.0)
    if test is None or least <= test.times <= most:
        return []
    severity: Severity = "caution" if test.times > 1 else "note"
    if test.p_value >= (CONTRADICTED.probability if severity == "caution" else DOUBTFUL.probability):
        return []
    values = {"name": str(key), "count": count, "times": test.times, "p_value": test.p_value}
    return [Finding("calibration.group_contradicted", severity, values)]


def findings_of_views(graph: Graph, posterior: Posterior, noise: RigNoise, declared: Errors) -> list[Finding]:
    """Return the same of the errors that the views of a rig share: sizes of targets, and what was declared of errors.

    The errors of ``posterior`` have the prior variance 1. The relative error of the size of a target is that of the
    lengths of its views, ``a = g z`` with ``g_k`` the mean of ``K_k . t / |t|^2`` over them, of columns K of scale.
    """
    found: list[Finding] = []
    numbers: dict[ErrorKey, list[int]] = {}
    for k, key in enumerate(posterior.keys):
        numbers.setdefault(key.error, []).append(k)
    for error, of in numbers.items():
        if declared_of(declared, error) is not None:
            test = group_test(posterior, dict.fromkeys((posterior.keys[k] for k in of), 1.0), error)
            found += _of_group(test, error, len(of), error.of("") == ROBOT_ACCURACY)
    of_robot = noise.of_robot.tolist()
    scales = [k for k, key in enumerate(posterior.keys) if key.kind == Kind.SCALE and not of_robot[k]]
    of_camera = (np.cumsum(~noise.of_robot) - 1)[scales]  # their places among the errors of the camera side
    K, t = noise.by_camera[:, 3:, of_camera], graph.C[:, :3, 3]
    g = np.einsum("eik,ei->ek", K, t) / np.maximum(np.einsum("ei,ei->e", t, t), EPS)[:, None]
    S = posterior.covariance[np.ix_(*2 * [posterior.p + np.array(scales, dtype=np.intp)])]
    for w in np.unique(graph.W) if scales else ():
        mean = g[w == graph.W].mean(axis=0)
        estimate, sd = float(mean @ posterior.estimate[scales]), float(np.sqrt(mean @ S @ mean))
        probability = share_beyond(WRONG_SIZE, estimate, sd)
        if probability > 0.5:
            target = {"target": graph.names[w]} if len(np.unique(graph.W)) > 1 else {}
            values = {"estimate": estimate, "sd": sd, "square": None, "probability": probability, **target}
            misread = not 1 / MAX_TARGET_RATIO < 1 + estimate < MAX_TARGET_RATIO
            found.append(Finding("calibration.target_size", "failure" if misread else "caution", values))
    return found


def _confounded(result: Calibration, name: str, errors: Sequence[ErrorEstimate]) -> list[Finding]:
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
    values = {"name": name, "unit": unit, "assumed": factor * errors[0].size, "directions": directions}
    if hardly and not errors[0].default:
        return [Finding("calibration.shared_opens", "caution", values)]
    untold = all(error.sd > UNRESOLVED_SD * error.size for error in errors)
    return [Finding("calibration.shared_confounded", "note", values)] if untold else []


def _square_of(job: Job) -> float | None:
    """The side of the squares (m) of the board that was seen; None where that is not known."""
    seen = None if job.poses is None else job.poses.camera_calibration
    if seen is not None:
        return spacing_of(seen.corners.points)
    return None if job.camera_noise is None else job.camera_noise.square


def against_prior(fit: Fit) -> list[Finding]:
    """Return a finding if the prior of X and W contradicts the data."""
    if fit.prior is None:
        return []
    information, pull, _ = fit.prior.normal_equations(fit.X, fit.W)
    return prior_findings(information, pull, fit.covariance, " and ".join(part[0] for part in fit.prior.parts()))
