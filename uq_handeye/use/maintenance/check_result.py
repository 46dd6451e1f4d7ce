"""ChangeCheck: whether a calibration still holds, and if not, what has changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...core.files.atomic import json_text
from ...core.files.records import Record
from ...core.geometry.se3 import Array
from ...core.presentation.document import COLUMNS, document_of, to_text
from ...findings import Finding
from .causes import Causes
from .power import Detectable

UNCHANGED, CHANGED, CANNOT_TELL = "unchanged", "changed", "cannot tell"


@dataclass(frozen=True, eq=False)
class ChangeCheck(Record):
    """The answer of `check`. ``str(check)`` is its text.

    Attributes
    ----------
    status : "unchanged", "changed" or "cannot tell"
    p_value : float
        Probability of poses that contradict the calibration at least as much, if nothing has changed.
    d2, dof : float and int
        Squared distance of the new poses from the calibration, of ``dof`` numbers.
    noise_dof : float or None
        Degrees of freedom of the noise, where the calibration estimated it; None: given.
    detectable : Detectable
        Smallest change that these poses would have shown with 95 % probability.
    causes : Causes
        Each cause by itself, with its estimate, and which of them can be separated.
    shift : (6,)
        How X moved (W, where `shift_of` is "W"): (theta, tau) of the new pose relative to the old one, rad and m, left
        rotation and additive translation in its parent frame.
    covariance : (6, 6)
        Of `shift`, with the uncertainty of the calibration.
    shift_of : "X" or "W"
    distances : (m,)
        Squared distance of each pose from what the others and the calibration predict; 6 on average.
    findings : tuple of Finding
    level : float
        Probability of a false alarm.
    n_poses, n_calibrated : int
        New poses, and those of the calibration (None: not stored).
    tolerance : str or None
        Change that matters, as given.
    focal_length_px : float or None
        In which an image centre is printed.
    """

    _in_file: ClassVar[str] = (
        "format status changed p_value d2 dof noise_dof level setup n_poses n_calibrated tolerance detectable cause "
        "candidates causes=causes.all shift_of shift covariance distances findings sentences"
    )
    format: ClassVar[str] = "uq-handeye check 1"

    status: str
    p_value: float
    d2: float
    dof: int
    noise_dof: float | None
    level: float
    detectable: Detectable
    causes: Causes
    shift: Array
    covariance: Array
    shift_of: str
    distances: Array
    findings: tuple[Finding, ...]
    setup: str
    n_poses: int
    n_calibrated: int | None
    tolerance: str | None = None
    focal_length_px: float | None = None

    @property
    def changed(self) -> bool:
        """True if something has changed."""
        return self.status == CHANGED

    @property
    def cause(self) -> str | None:
        """Name of the cause, where it can be separated: "X", "target", "focal length" or "target size"; else None.

        "X" and "target" each stand for two things that no pose can separate: see `causes`. The image centre is the
        same as a camera that rotated, and only among `candidates`.
        """
        named = self.causes.named
        return named.name if self.changed and named is not None else None

    @property
    def candidates(self) -> tuple[str, ...]:
        """Names of the causes that cannot be separated from the most probable one, with it; empty if unchanged."""
        if not self.changed or not self.causes.explained:
            return ()
        return tuple(cause.name for cause in self.causes.candidates)

    @property
    def std(self) -> Array:
        """(6,) standard deviations of `shift`, rad and m."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def sentences(self) -> list[str]:
        """The findings in words."""
        return [str(finding) for finding in self.findings]

    def summary(self, width: int = COLUMNS) -> str:
        """Text of about ten lines."""
        return to_text(document_of(self), width)

    def __str__(self) -> str:
        return self.summary()

    def to_json(self) -> str:
        """JSON text of `to_dict`."""
        return json_text(self.to_dict())
