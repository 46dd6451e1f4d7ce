"""The certificate of a calibration: the preset of the report that is signed and filed, as a page and as data.

The page selects the sections that a certificate states, and shows no X where nothing is certified. The data have stable
keys, SI units, and quantities with the names of D-SI (PTB's format of SI data).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any, ClassVar, overload

import numpy as np

from ..calibration.accuracy import NOT_USABLE
from ..calibration.contribution import Contribution
from ..calibration.result import Calibration
from ..calibration.rig_result import RigCalibration
from ..calibration.tolerance import Tolerance, ToleranceLike, Verdict
from ..core.files.about import as_about
from ..core.files.json_values import JsonObject
from ..core.files.records import plain
from ..core.geometry.conventions import CONVENTION
from ..errors import InputError
from .budget import LEVEL, Stated, budget_rows, components_of, worst_of
from .certificate_form import Form
from .certificate_sheets import sheets_of
from .decision import Decision, decide, verdicts_of_rig
from .rig_certificate import RigCertificate
from .statements import (
    STANDING,
    VALIDITY,
    conditions_of,
    coverage_of,
    fields_of,
    hashes_of,
    lengths_of,
    measurand_of,
    method_of,
    noise_source,
    robot_words,
)

UNITS = {"m": "\\metre", "rad": "\\radian"}


@dataclass(frozen=True, eq=False)
class Certificate(Form):
    """The certificate of a calibration; see `make_certificate`.

    Attributes
    ----------
    result : Calibration
        The result that is certified, with its title block.
    decision : Decision or None
        Verdict on a tolerance, with its guard band, where one was given.
    issued : str
        Date and time, UTC.
    """

    _format: ClassVar[str] = "uq-handeye certificate 1"

    result: Calibration
    decision: Decision | None
    issued: str

    def to_html(self) -> str:
        """Return the page as one self-contained HTML text."""
        result = self.result
        facts = [result.setup or "motions without poses", f"method {result.method}"]
        sheets = sheets_of(result, self.decision, self.refusals)
        return self.page("Hand-eye calibration", result.frame, facts, sheets, fields_of(result))

    @property
    def refusals(self) -> tuple[str, ...]:
        """Reasons why nothing is certified: X is not usable, or has no uncertainty; empty where it is."""
        reasons = [f"{NOT_USABLE}: {reason}" for reason in self.result.reasons]
        if not reasons and self.result.covariance is None:
            reasons = ["the uncertainty of X is not known: no noise was given, and none could be estimated"]
        return tuple(reasons)

    def _contents(self) -> JsonObject:
        result = self.result
        return {
            "certified": self.certified,
            "refusals": list(self.refusals),
            "about": result.about,
            "measurand": {
                "name": result.frame,
                "setup": result.setup,
                "convention": CONVENTION,
                "description": measurand_of(result),
            },
            "headline": result.headline,
            "result": _result(result) if self.certified else None,
            "budget": _budget(result) if self.certified else None,
            "decision": None if self.decision is None else self.decision.to_dict(),
            "conditions": [{"name": name, "text": text} for name, text in conditions_of(result)],
            "method": {"name": result.method, "description": method_of(result) if self.certified else ""},
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


@overload
def make_certificate(result: RigCalibration, **options: Any) -> RigCertificate: ...
@overload
def make_certificate(result: Calibration, **options: Any) -> Certificate: ...
def make_certificate(  # type: ignore[misc]
    result: Any,
    *,
    tolerance: ToleranceLike | None = None,
    at: str | float | None = None,
    verdict: Verdict | None = None,
    about: Mapping[str, str] | None = None,
    issued: str | None = None,
) -> Certificate | RigCertificate:
    """Return the certificate of a calibration: measurand, result, uncertainty budget, conditions, traceability.

    The numbers are those of `Calibration.accuracy` and `Calibration.budget`; only the margin to a tolerance is
    computed. A result that is not usable or has no uncertainty gives a certificate that says so and states no X.

    Parameters
    ----------
    result : Calibration or RigCalibration
        New, or read from a file. Of a rig all poses are stated, and the decision is on each camera.
    tolerance, at
        As for `Calibration.verdict`: the decision on a tolerance (JCGM 106).
    verdict : Verdict or None
        Of one camera, in place of a tolerance.
    about : mapping or None
        Title block (`files.about.ABOUT`), added to that of the result: also ``number``, ``organisation``,
        ``environment`` (temperature, load) and ``reference`` (certificate of the target).
    issued : str or None
        Date that is written; None is now (UTC).

    Raises
    ------
    InputError
        A result that is no `Calibration`, a tolerance that cannot be read, ``at`` without a tolerance, another name in
        the title block.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    >>> result = uq.calibrate(uq.simulate(n_poses=20, noise=noise, seed=1), noise=noise)
    >>> found = uq.make_certificate(result, tolerance="2mm,0.5deg")
    >>> found.certified, found.decision.verdict.word
    (True, 'PASS')
    """
    if tolerance is None and at is not None:
        raise InputError("Expected a `tolerance` beside `at`, which is the distance that it applies to; got none.")
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC") if issued is None else issued
    match result:
        case RigCalibration():
            wanted = None if tolerance is None else Tolerance.read(tolerance, at)
            return RigCertificate(result, verdicts_of_rig(result, wanted), as_about(about or {}), now)
        case Calibration():
            of = replace(result, about=as_about({**result.about, **(about or {})}))
            if tolerance is not None:
                verdict = of.verdict(tolerance, at)
            return Certificate(of, None if verdict is None else decide(of, verdict), now)
    raise InputError(f"Expected `result` to be a Calibration, got {type(result).__name__}.")


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
