"""Test of a prior of poses against the data."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc

from ...core.geometry.se3 import Array
from ...core.levels import RARE
from ...findings import Finding

# An estimate is compared with its prior where the data take away at least this share of the prior variance.
MIN_SHARE_FROM_DATA = 1e-3


def prior_findings(information: Array, pull: Array, covariance: Array, name: str) -> list[Finding]:
    """Return a finding by the normal equations of a prior (p, p), (p,) and the covariance (p, p) after the fit.

    The estimate minus the prior's mean has the covariance ``Lambda^-1 - C`` along what data and prior both determine;
    its square is chi-square with as many degrees of freedom.
    """
    chi2, dof = 0.0, 0
    scale = np.sqrt(np.diag(information))
    told = scale > 0
    unit = information[np.ix_(told, told)] / np.outer(scale[told], scale[told])
    values, vectors = np.linalg.eigh(unit)
    half = scale[told, None] * vectors * np.sqrt(values)  # Lambda = half half^T
    of_mean = (vectors.T @ (pull[told] / scale[told])) / np.sqrt(values)  # half^T xi
    mu, V = np.linalg.eigh(np.eye(len(values)) - half.T @ covariance[np.ix_(told, told)] @ half)
    both = mu > MIN_SHARE_FROM_DATA
    chi2, dof = float(((V.T @ of_mean)[both] ** 2 / mu[both]).sum()), int(both.sum())
    if dof == 0:
        return []
    p_value = float(chdtrc(dof, chi2))
    values_of = {"of": name, "chi2": chi2, "dof": dof, "p_value": p_value}
    if p_value < RARE.probability:
        return [Finding("calibration.prior_contradicted", "caution", values_of)]
    return [Finding("calibration.prior_agrees", "note", values_of)]
