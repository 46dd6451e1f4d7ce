r"""A calibration that has taken in further measurements: the update of its joint posterior by evidence.

With the errors ``s = (xi_X, xi_W, e - estimate)`` and their mean and covariance given the measurements
(`Posterior.absorb`), X and W become ``perturb(X, -mean)``, e becomes ``estimate + mean``, and the joint posterior has
the covariance of s. To first order this is the fit of all measurements together. What was found about the poses
(residuals of the pose table, diagnostics, budget) stays that of the poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from scipy.special import chdtrc

from ...core.geometry.se3 import perturb
from ...errors import InputError
from ...findings import Finding
from ...model.poses.to_dict import sha256_of
from ...model.posterior.rows import NewRows
from ..estimate.estimated import Estimated
from ..estimate.fitted_kinematics import FittedKinematics
from ..prediction.predict import posterior_of
from .touches import Touches, TouchEvidence, evidence_of_touches, with_tool

# p-value below which touches contradict the poses.
CONTRADICTS = 0.05


C = TypeVar("C", bound=Estimated)


def absorbed_into(result: C, evidence: NewRows, finding: Finding, options: Mapping[str, Any]) -> C:
    """Return a calibration with the evidence taken in.

    Parameters
    ----------
    result : Calibration
        With the covariance of the noise model.
    evidence : NewRows
        Against this calibration.
    finding : Finding
        What was taken in, and how far it fitted.
    options : mapping
        Entries for the options of the provenance.

    Raises
    ------
    InputError
        A calibration without joint covariance, or with a covariance of X from its residuals.
    """
    before = posterior_of(result)
    if result.covariance_kind != "model":
        raise InputError(
            f"Expected a calibration with the covariance of its noise model, got covariance={result.covariance_kind!r}."
        )
    assert result.W is not None
    posterior, move = before.absorb(evidence)
    sd = np.sqrt(np.maximum(np.diag(posterior.covariance)[12:], 0.0))
    place = {name: k for k, name in enumerate(before.names)}
    shared = tuple(
        replace(error, estimate=float(posterior.estimate[k]), sd=float(sd[k]))
        if (k := place.get(error.name)) is not None
        else error
        for error in result.shared
    )
    fitted = result.kinematics
    if fitted is not None:
        fitted = FittedKinematics.of(
            fitted.chain, fitted.joints, fitted.how, fitted.flange, fitted.sd, fitted.beside_controller, posterior
        )
    origin = result.provenance
    parts: dict[str, Any] = {
        "X": perturb(result.X, -move[:6]),
        "W": perturb(result.W, -move[6:12]),
        "covariance": posterior.covariance[:6, :6],
        "covariance_W": posterior.covariance[6:12, 6:12],
        "joint_posterior": posterior,
        "shared": shared,
        "kinematics": fitted,
        "findings": (*result.findings, finding),
        "provenance": None if origin is None else replace(origin, options=origin.options | dict(options)),
    }
    return replace(result, **parts)


def touches_taken(result: Estimated) -> list[dict[str, Any]]:
    """Return the sets of touches that a calibration has taken in, of its provenance."""
    return [] if result.provenance is None else list(result.provenance.options.get("touches", []))


def require_other_touches(result: Estimated, touches: Touches, evidence: TouchEvidence) -> None:
    """Raise `InputError` for touches that are part of the calibration: they cannot verify it."""
    if _key_of(touches, evidence) in (one["sha256"] for one in touches_taken(result)):
        raise InputError("These touches are part of the calibration and cannot test it. Verify with others.")


def _key_of(touches: Touches, evidence: TouchEvidence) -> str:
    return sha256_of(touches.seen, touches.touched if touches.touched is not None else evidence.r + evidence.at)


def include_touches(result: C, touches: Touches) -> C:
    """Return a calibration with points that were seen and touched taken in.

    X, W, their covariance, the joint posterior and the shared errors are those of poses and touches together
    (`evidence.absorb`). The findings say how far the touches fitted. An unknown tool is an unknown of three numbers.

    Parameters
    ----------
    result : Calibration
        Of poses, method efficient or ml, with the covariance of the noise model.
    touches : Touches
        Not those of a verification: a test needs touches that the calibration has not seen.

    Raises
    ------
    InputError
        As `verify`; a calibration that has taken in these touches already.
    """
    evidence = evidence_of_touches(result, touches)
    key, used = _key_of(touches, evidence), touches_taken(result)
    if key in (one["sha256"] for one in used):
        raise InputError("The calibration has taken in these touches already: a touch counts once.")
    known = touches.tool_known
    d2, dof = evidence.d2, evidence.dof
    if not known:
        tool = evidence.explained_by(evidence.by_tool)
        d2, dof = d2 - tool.gain, dof - int(np.linalg.matrix_rank(tool.covariance))
        evidence = with_tool(evidence)
    p = float(chdtrc(dof, d2)) if dof > 0 else 1.0
    rms = float(np.sqrt(np.mean(np.sum(np.square(evidence.r), axis=-1))))
    values = {"count": touches.m, "d2": d2, "dof": dof, "p_value": p, "rms": rms}
    finding = Finding("evidence.touches_used", "caution" if p < CONTRADICTS else "note", values)
    return absorbed_into(result, evidence, finding, {"touches": [*used, {"sha256": key, "count": touches.m}]})
