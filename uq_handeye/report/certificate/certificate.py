"""The certificate of a stored calibration or rig, as a page for people and as data for programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any, overload

from ...calibration.result import Calibration
from ...calibration.statement.tolerance import Tolerance
from ...core.files.about import as_about
from ...errors import InputError
from ...rig.result import RigCalibration
from .contents import Contents, decide
from .of_rig import RigCertificate, certificate_of_rig
from .page import certificate_html


class Certificate(Contents):
    """The statement of a calibration for the file: see `make_certificate`.

    Attributes
    ----------
    result : Calibration
        What it is of, with its title block.
    decision : Decision or None
        Verdict on a tolerance, with its guard band, where one was asked for.
    issued : str
        Date and time, UTC.
    """

    def to_html(self) -> str:
        """Return the page as one self-contained HTML text."""
        return certificate_html(self)


@overload
def make_certificate(result: RigCalibration, **options: Any) -> RigCertificate: ...
@overload
def make_certificate(result: Calibration, **options: Any) -> Certificate: ...
def make_certificate(  # type: ignore[misc]
    result: Any,
    *,
    tolerance: Any = None,
    at: Any = None,
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
    if isinstance(result, RigCalibration):
        return certificate_of_rig(
            result, None if tolerance is None else Tolerance.read(tolerance, at), about or {}, now
        )
    if not isinstance(result, Calibration):
        raise InputError(f"Expected `result` to be a Calibration, got {type(result).__name__}.")
    of = replace(result, about=as_about({**result.about, **(about or {})}))
    decision = None if tolerance is None else decide(of, of.verdict(tolerance, at))
    return Certificate(of, decision, now)
