"""The certificate of a stored calibration, as a page for people and as data for programs; the decision on a tolerance.

The data have stable keys, SI units, and quantities with the names of D-SI (PTB's format of SI data). The decision has a
guard band, in the terms of JCGM 106.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..._version import __version__
from ...calibration.result import Calibration
from ...calibration.statement.accuracy import NOT_USABLE
from ...calibration.statement.tolerance import MET, Tolerance, Verdict, percent, probability_of
from ...core.files.atomic import json_text
from ...core.files.records import plain
from ...core.formatting.numbers import digits
from ...core.geometry.conventions import CONVENTION
from ...core.presentation.document import Block, Paragraph, Section
from ...core.presentation.page import PAPERS, Page, page_path, write_page
from .budget import LEVEL, BudgetRow, Stated, budget_rows, components_of, worst_of
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
    robot_words,
)

UNITS = {"m": "\\metre", "rad": "\\radian"}
RULE = (
    f"Decision rule (JCGM 106): PASS if the probability of conformity is at least {percent(MET)}, FAIL if it is at "
    f"most {percent(1 - MET)}, else NOT SHOWN. Never PASS where a check failed or the uncertainty is a lower limit."
)
_STEPS = 40


@dataclass(frozen=True)
class Decision:
    """A verdict with its guard band: the part of the tolerance that the uncertainty takes.

    X is used as estimated, so that the estimate of its error is 0: it is accepted where the tolerance is at least the
    guard band, at which the probability of conformity is 95 %. Length and angle are in the proportion of the tolerance.
    """

    verdict: Verdict
    guard_band: Tolerance | None  # None: the probability is not known

    @property
    def margin(self) -> float | None:
        """Share of the tolerance beyond the guard band; below 0 where the guard band is larger."""
        if self.guard_band is None:
            return None
        wanted = self.verdict.tolerance
        if wanted.translation is not None and self.guard_band.translation is not None:
            return 1.0 - self.guard_band.translation / wanted.translation
        assert wanted.rotation is not None and self.guard_band.rotation is not None
        return 1.0 - self.guard_band.rotation / wanted.rotation

    @property
    def sentence(self) -> str:
        """Guard band, and how it compares with the tolerance."""
        if self.guard_band is None or self.margin is None:
            return ""
        share = 1.0 - self.margin
        compared = f"{digits(share, 2)} times" if share > 1 else f"{digits(100 * share, 2)} % of"
        return f"Guard band: the probability reaches {percent(MET)} at {self.guard_band}, {compared} the tolerance."

    def to_dict(self) -> dict[str, Any]:
        """Return plain numbers and text, in m and rad."""
        band = None
        if self.guard_band is not None:
            band = {"translation": self.guard_band.translation, "rotation": self.guard_band.rotation}
        return self.verdict.to_dict() | {"rule": RULE, "guard_band": band, "margin": self.margin}


def decide(result: Calibration, verdict: Verdict) -> Decision:
    """Return the verdict with its guard band."""
    if verdict.probability is None or result.covariance is None:
        return Decision(verdict, None)
    wanted = verdict.tolerance

    def scaled(factor: float) -> Tolerance:
        move, turn = wanted.translation, wanted.rotation
        return Tolerance(None if move is None else factor * move, None if turn is None else factor * turn, wanted.at)

    low, high = -9.0, 9.0  # powers of 10
    for _ in range(_STEPS):
        middle = 0.5 * (low + high)
        if probability_of(result, scaled(float(10.0**middle))) >= MET:
            high = middle
        else:
            low = middle
    return Decision(verdict, scaled(float(np.power(10.0, high))))


NOT_CERTIFIED = "NOT CERTIFIED"
SUFFIXES = (".html", ".pdf", ".json")


class Written:
    """A certificate: its contents, which give its identifier, written as a page or as data."""

    _format: ClassVar[str]
    issued: str  # date and time, UTC

    @property
    def refusals(self) -> tuple[str, ...]:
        """Reasons why nothing is certified; empty where it is."""
        raise NotImplementedError

    @property
    def certified(self) -> bool:
        """True if the result is stated; else the page and the data say why not."""
        return not self.refusals

    @property
    def identifier(self) -> str:
        """Identifier of the contents, without the date: the same result and title block give the same."""
        return f"UQ-{hashlib.sha256(json.dumps(self._contents(), sort_keys=True).encode()).hexdigest()[:16].upper()}"

    def page(self, of: str, subject: str, facts: Sequence[str], sheets: Sequence[Any], fields: Any) -> str:
        """Return the page of its sheets; nothing in it looks like a result where none is certified."""
        name = f"{of} certificate" if self.certified else f"{NOT_CERTIFIED}: {of[0].lower()}{of[1:]}"
        foot = f"{self.identifier}, issued {self.issued} by uq-handeye {__version__}. {STANDING}"
        signed = len(sheets) if self.certified else 0
        numbered = [*facts, f"No. {self.identifier}", f"issued {self.issued}"]
        return Page(name, subject, numbered, [], sheets, fields, foot, signed, kind="certificate").html()

    def refused(self, *why: Block) -> Section:
        """Return the section that says that nothing is certified, and why."""
        last = Paragraph("This page states no result. It must not be used as evidence of a calibration.")
        return Section("answer", NOT_CERTIFIED, [*why, last], wide=True)

    def _contents(self) -> dict[str, Any]:
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Return the certificate as plain numbers and text, in m and rad; see the reference page for the keys."""
        head = {"format": self._format, "identifier": self.identifier, "issued": self.issued}
        return head | {"issued_by": f"uq-handeye {__version__}", **self._contents()}

    def to_html(self) -> str:
        """Return the page as one self-contained HTML text."""
        raise NotImplementedError

    def to_json(self, path: str | Path | None = None) -> str:
        """Return JSON text, also written to ``path`` (whole or not at all)."""
        return json_text(self.to_dict(), path)

    def write(self, path: str | Path, *, paper: str = PAPERS[0]) -> Path:
        """Write the certificate; the suffix says which form: .html, .pdf or .json.

        Parameters
        ----------
        path : str or Path
        paper : str
            Of the PDF: "a4" or "letter".

        Raises
        ------
        InputError
            A path with another suffix or that cannot be written.
        MissingExtraError
            A PDF where neither WeasyPrint (extra ``pdf``) nor a Chromium browser is installed.
        """
        target = page_path(path, paper, SUFFIXES)
        if target.suffix.lower() != ".json":
            return write_page(target, self.to_html(), paper)
        self.to_json(target)
        return target


@dataclass(frozen=True, eq=False)
class Contents(Written):
    """A result with its title block, the decision on a tolerance, and the date of the certificate."""

    _format: ClassVar[str] = "uq-handeye certificate 1"

    result: Calibration
    decision: Decision | None
    issued: str

    @property
    def refusals(self) -> tuple[str, ...]:
        """Reasons why nothing is certified: X is not usable, or has no uncertainty; empty where it is."""
        reasons = [f"{NOT_USABLE}: {reason}" for reason in self.result.reasons]
        if not reasons and self.result.covariance is None:
            reasons = ["the uncertainty of X is not known: no noise was given, and none could be estimated"]
        return tuple(reasons)

    def _contents(self) -> dict[str, Any]:
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
