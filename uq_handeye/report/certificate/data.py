"""The certificate as data: stable keys, SI units, quantities with the names of D-SI (PTB's format of SI data)."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..._version import __version__
from ...calibration.result import Calibration
from ...core.files.records import plain
from ...core.geometry.conventions import CONVENTION
from .budget import LEVEL, BudgetRow, Stated, budget_rows, components_of, worst_of
from .decision import Contents
from .iso_9283 import robot_words
from .statements import (
    STANDING,
    VALIDITY,
    conditions_of,
    coverage_of,
    hashes_of,
    lengths_of,
    measurand_of,
    method_of,
    noise_source,
)

FORMAT = "uq-handeye certificate 1"
UNITS = {"m": "\\metre", "rad": "\\radian"}


def certificate_data(of: Contents) -> dict[str, Any]:
    """Return everything that the certificate states; see the reference page of the command for the keys."""
    return {
        "format": FORMAT,
        "identifier": identifier_of(of),
        "issued": of.issued,
        "issued_by": f"uq-handeye {__version__}",
        **_contents(of),
    }


def identifier_of(of: Contents) -> str:
    """Return an identifier of the contents, without the date."""
    text = json.dumps(_contents(of), sort_keys=True)
    return f"UQ-{hashlib.sha256(text.encode()).hexdigest()[:16].upper()}"


def _contents(of: Contents) -> dict[str, Any]:
    result = of.result
    return {
        "certified": of.certified,
        "refusals": list(of.refusals),
        "about": result.about,
        "measurand": {
            "name": result.frame,
            "setup": result.setup,
            "convention": CONVENTION,
            "description": measurand_of(result),
        },
        "headline": result.headline,
        "result": _result(result) if of.certified else None,
        "budget": _budget(result) if of.certified else None,
        "decision": None if of.decision is None else of.decision.to_dict(),
        "conditions": [{"name": name, "text": text} for name, text in conditions_of(result)],
        "method": {"name": result.method, "description": method_of(result) if of.certified else ""},
        "checks": [check.to_dict() for check in result.checks],
        "cautions": [str(finding) for finding in result.cautions],
        "traceability": {
            "noise": noise_source(result),
            "lengths": lengths_of(result),
            "sha256": [{"name": name, "sha256": digest} for name, digest in hashes_of(result)],
            "versions": {} if result.provenance is None else dict(result.provenance.versions),
            "command": None if result.provenance is None else result.provenance.command,
        },
        "iso_9283": robot_words(result),
        "validity": VALIDITY,
        "standing": STANDING,
    }


def _result(result: Calibration) -> dict[str, Any]:
    accuracy, S = result.accuracy, result.covariance
    assert accuracy is not None and S is not None  # of a certified result
    limit = result.quantile(LEVEL)
    return {
        "matrix": result.X.tolist(),
        "quaternion_xyzw": result.quaternion.tolist(),
        "components": [_quantity(one) for one in components_of(result)],
        "worst_direction": {one.name: _quantity(one) for one in worst_of(result)},
        "point_distance": {"value": accuracy.distance, "unit": UNITS["m"], "known": accuracy.distance_known},
        "covariance": {
            "matrix": S.tolist(),
            "units": [UNITS["rad"]] * 3 + [UNITS["m"]] * 3,
            "open": [] if result.open_of_X is None else result.open_of_X.tolist(),
        },
        "coverage_region": {
            "coverageProbability": LEVEL,
            "limit": limit if np.isfinite(limit) else None,
            "distribution": str(result.reference),
            "text": coverage_of(result),
        },
        "lower_limit": accuracy.lower_limit,
        "not_determined": list(result.open_words),
        "included": list(accuracy.included),
        "not_included": list(accuracy.not_included),
    }


def _quantity(one: Stated) -> dict[str, Any]:
    """Return a number as a D-SI quantity; an infinite uncertainty, which is not determined, is left out."""
    found: dict[str, Any] = {"label": one.name, "unit": UNITS[one.unit]}
    if one.value is not None:
        found["value"] = one.value
    if not np.isfinite(one.u):
        return found | {"measurementUncertaintyUnivariate": None}
    return found | {
        "measurementUncertaintyUnivariate": {
            "standardMU": {"valueStandardMU": one.u},
            "expandedMU": {
                "valueExpandedMU": plain(one.U),
                "coverageFactor": plain(one.k),
                "coverageProbability": LEVEL,
                "distribution": "normal" if not np.isfinite(one.dof) else "t",
            },
            "effectiveDegreesOfFreedom": plain(one.dof),
        }
    }


def _budget(result: Calibration) -> dict[str, Any]:
    rows = budget_rows(result)
    return {
        "direction": "that of the largest variance, of translation and of rotation",
        "sources": [_source(row) for row in rows],
        "combined": {
            "translation": {"value": _root([row.translation for row in rows]), "unit": UNITS["m"]},
            "rotation": {"value": _root([row.rotation for row in rows]), "unit": UNITS["rad"]},
        },
    }


def _root(sizes: Sequence[float]) -> float:
    return float(np.sqrt(np.square(sizes).sum()))


def _source(row: BudgetRow) -> dict[str, Any]:
    return {
        "name": row.name,
        "type": row.type,
        "input": {
            "standard_uncertainty": row.input.uncertainty,
            "distribution": row.input.distribution,
            "origin": row.input.origin,
        },
        "degreesOfFreedom": plain(row.dof),
        "translation": {"value": row.translation, "unit": UNITS["m"], "share": row.share_translation},
        "rotation": {"value": row.rotation, "unit": UNITS["rad"], "share": row.share_rotation},
    }
