"""The certificate of a result: the preset of the report that is signed and filed, as a page and as data.

The page selects the sections that a certificate states, and shows no pose where nothing is certified. The data have
stable keys, SI units, and quantities with the names of D-SI (PTB's format of SI data). The identifier is a hash of the
contents without the date, so that the same result and title block give the same one.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property, partial
from pathlib import Path

from .._version import __version__
from ..calibration.load import Result
from ..calibration.stored_result import StoredResult
from ..calibration.tolerance import ToleranceLike, Verdicts
from ..core.files.about import as_about
from ..core.files.json_files import json_text
from ..core.files.json_values import JsonObject
from ..core.presentation.page import PAPERS, Page, page_path, write_page
from ..errors import InputError, require_type
from . import rig_certificate as rig_certificate  # registers what is certified of a rig
from .certificate_sheets import NOT_CERTIFIED
from .certified import Certified, certified_of
from .decision import Decision, decide, verdicts_by_name
from .statements import STANDING, VALIDITY, fields_of

FORMAT = "uq-handeye certificate 1"
SUFFIXES = (".html", ".pdf", ".json")


@dataclass(frozen=True, eq=False)
class Certificate:
    """The certificate of a result; see `make_certificate`.

    Attributes
    ----------
    result : Calibration or RigCalibration
        The result that is certified, with its title block.
    decisions : mapping of names of cameras to Decision
        Verdicts on a tolerance, with their guard bands, where one was given.
    issued : str
        Date and time, UTC.
    """

    result: Result
    decisions: Mapping[str, Decision]
    issued: str

    @property
    def decision(self) -> Decision | None:
        """The decision on the only camera; None without a tolerance, and for several cameras."""
        return next(iter(self.decisions.values())) if len(self.decisions) == 1 else None

    @property
    def refusals(self) -> tuple[str, ...]:
        """Reasons why nothing is certified; empty where it is."""
        return self._content.refusals

    @property
    def certified(self) -> bool:
        """True if the result is certified; else the page and the data give the reasons."""
        return not self.refusals

    @property
    def identifier(self) -> str:
        """Identifier of the contents, without the date: the same result and title block give the same."""
        return f"UQ-{hashlib.sha256(json.dumps(self._data(), sort_keys=True).encode()).hexdigest()[:16].upper()}"

    @cached_property
    def _content(self) -> Certified:
        return certified_of(self.result, self.decisions)

    def to_html(self) -> str:
        """Return the page as one self-contained HTML text, which looks like no result where none is certified."""
        of, sheets = "Hand-eye calibration", self._content.sheets()
        name = f"{of} certificate" if self.certified else f"{NOT_CERTIFIED}: {of[0].lower()}{of[1:]}"
        foot = f"{self.identifier}, issued {self.issued} by uq-handeye {__version__}. {STANDING}"
        facts = [*self._content.facts, f"No. {self.identifier}", f"issued {self.issued}"]
        signed = len(sheets) if self.certified else 0
        subject, fields = ", ".join(self._content.subjects), fields_of(self.result.about)
        return Page(name, subject, facts, [], sheets, fields, foot, signed, kind="certificate").html()

    def to_dict(self) -> JsonObject:
        """Return the certificate as plain numbers and text, in m and rad; see the reference page for the keys."""
        head = {"format": FORMAT, "identifier": self.identifier, "issued": self.issued}
        return head | {"issued_by": f"uq-handeye {__version__}", **self._data()}

    def _data(self) -> JsonObject:
        result, decisions = self.result, {name: one.to_dict() for name, one in self.decisions.items()}
        several = len(result.camera_names) > 1
        return {
            "certified": self.certified,
            "refusals": list(self.refusals),
            "about": result.about,
            "headline": result.headline,
            "decision": decisions if several else next(iter(decisions.values()), None),
            "validity": VALIDITY,
            "standing": STANDING,
            **self._content.data(),
        }

    def to_json(self, path: str | Path | None = None) -> str:
        """Return JSON text, also written to ``path`` (whole or not at all)."""
        return json_text(self.to_dict(), path)

    def write(self, path: str | Path, *, paper: str = PAPERS[0]) -> Path:
        """Write the certificate in the form of the suffix: .html, .pdf or .json.

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


def make_certificate(
    result: Result,
    *,
    tolerance: ToleranceLike | None = None,
    at: str | float | None = None,
    verdict: Verdicts | None = None,
    about: Mapping[str, str] | None = None,
    issued: str | None = None,
) -> Certificate:
    """Return the certificate of a calibration: measurand, result, uncertainty budget, conditions, traceability.

    The numbers are those of `Calibration.accuracy` and `Calibration.budget`; only the margin to a tolerance is
    computed. A result that is not usable or has no uncertainty gives a certificate that says so and states no X.

    Parameters
    ----------
    result : Calibration or RigCalibration
        New, or read from a file. Of a rig all poses are stated, and the decision is on each camera.
    tolerance, at
        As for `Calibration.verdict`: the decision on a tolerance (JCGM 106).
    verdict : Verdict, mapping of names of cameras to Verdict, or None
        In place of a tolerance.
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
    require_type("result", result, StoredResult, "a Calibration")
    now = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC") if issued is None else issued
    of = replace(result, about=as_about({**result.about, **(about or {})}))
    verdicts = verdicts_by_name(of, verdict) if tolerance is None else of.verdicts(tolerance, at)
    return Certificate(of, {name: decide(one, partial(of.conformity, name)) for name, one in verdicts.items()}, now)
