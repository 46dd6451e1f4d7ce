r"""Result of `check`: whether a calibration still holds, and if not, what has changed.

*The smallest change that would have shown*: power of the chi-square test of the posterior (`posterior.rows`). A change
a of columns C, ``E r = C a``, has the noncentrality ``a^T I a``, ``I = C^T Sigma^-1 C``. With lambda the noncentrality
that is detected with probability 95 %, the smallest shift (or rotation by itself) that shows in every direction is
``sqrt(lambda / min eigenvalue of I)`` of its block of I.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...core.files.records import Record
from ...core.geometry.se3 import Array
from ...core.numbers.levels import POWER
from ...core.presentation.document import COLUMNS
from ...core.presentation.shown import Shown
from ...findings import Finding
from ...model.posterior.rows import PredictiveReference, smallest_change
from .causes import Causes

UNCHANGED, CHANGED, CANNOT_TELL = "unchanged", "changed", "cannot tell"


@dataclass(frozen=True, eq=False)
class ChangeCheck(Record, Shown):
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

    columns = COLUMNS
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

    __str__ = Shown.summary


@dataclass(frozen=True)
class Detectable(Record):
    """Smallest shifts (m) and rotations (rad) of X and of W that show in every direction with probability ``power``.

    Rotations are about the origin of the pose. Infinite: not at all.
    """

    X_translation: float
    X_rotation: float
    W_translation: float
    W_rotation: float
    power: float
    level: float


def detectable_changes(of_X: Array, of_W: Array, reference: PredictiveReference, level: float) -> Detectable:
    """Build it from the information (6, 6) of changes of X and of W."""
    noncentrality = reference.noncentrality(POWER.probability, level)
    return Detectable(
        *smallest_change(of_X, noncentrality),
        *smallest_change(of_W, noncentrality),
        power=POWER.probability,
        level=level,
    )
