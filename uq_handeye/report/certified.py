"""The certified part of a result: reasons against it, the sheets of the page, and the data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import singledispatch
from typing import NamedTuple

import numpy as np

from ..calibration.contribution import Contribution
from ..calibration.result import Calibration
from ..calibration.stored_result import NOT_USABLE, not_a_result
from ..core.files.json_values import JsonObject
from ..core.files.records import plain
from ..core.geometry.conventions import CONVENTION
from ..core.presentation.document import Section
from .budget import LEVEL, Stated, budget_rows, components_of, worst_of
from .certificate_sheets import sheets_of
from .decision import Decision
from .statements import (
    conditions_of,
    coverage_of,
    hashes_of,
    lengths_of,
    measurand_of,
    method_of,
    noise_source,
    robot_words,
    traceability,
)

UNITS = {"m": "\\metre", "rad": "\\radian"}


class Certified(NamedTuple):
    """The contents of a certificate."""

    refusals: tuple[str, ...]  # reasons why nothing is certified
    subjects: Sequence[str]  # frame of X, or names of the cameras
    facts: Sequence[str]  # a line below the title
    sheets: Callable[[], Sequence[Sequence[Section]]]
    data: Callable[[], JsonObject]


@singledispatch
def certified_of(result: object, decisions: Mapping[str, Decision]) -> Certified:
    """Return what is certified of a result."""
    raise not_a_result(result)


@certified_of.register
def _of_camera(result: Calibration, decisions: Mapping[str, Decision]) -> Certified:
    refusals = tuple(f"{NOT_USABLE}: {reason}" for reason in result.reasons)
    if not refusals and result.covariance is None:
        refusals = ("the uncertainty of X is not known: no noise was given, and none could be estimated",)
    decision = next(iter(decisions.values()), None)
    facts = [result.setup or "motions without poses", f"method {result.method}"]
    return Certified(
        refusals, [result.frame], facts, lambda: sheets_of(result, decision, refusals),
        lambda: _data(result, not refusals),
    )  # fmt: skip


def _data(result: Calibration, certified: bool) -> JsonObject:
    return {
        "measurand": {
            "name": result.frame,
            "setup": result.setup,
            "convention": CONVENTION,
            "description": measurand_of(result),
        },
        "result": _result(result) if certified else None,
        "budget": _budget(result) if certified else None,
        "conditions": [{"name": name, "text": text} for name, text in conditions_of(result)],
        "method": {"name": result.method, "description": method_of(result) if certified else ""},
        "checks": [check.to_dict() for check in result.checks],
        "cautions": [str(finding) for finding in result.cautions],
        "traceability": {
            "noise": noise_source(result),
            "lengths": lengths_of(result),
            **traceability(hashes_of(result), result.provenance),
        },
        "iso_9283": robot_words(result),
    }


def _result(result: Calibration) -> JsonObject:
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


def _quantity(one: Stated) -> JsonObject:
    """Return a number as a D-SI quantity; an infinite uncertainty, which is not determined, is left out."""
    found: JsonObject = {"label": one.name, "unit": UNITS[one.unit]}
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


def _budget(result: Calibration) -> JsonObject:
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


def _source(row: Contribution) -> JsonObject:
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
