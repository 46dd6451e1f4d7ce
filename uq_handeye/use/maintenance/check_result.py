r"""Result of `check`: whether a calibration still holds, and if not, what has changed.

*The smallest change that would have shown*: power of the chi-square test of the posterior (`graph.rows`). A change
a of columns C, ``E r = C a``, has the noncentrality ``a^T I a``, ``I = C^T Sigma^-1 C``. With lambda the noncentrality
that is detected with probability 95 %, the smallest shift (or rotation by itself) that shows in every direction is
``sqrt(lambda / min eigenvalue of I)`` of its block of I.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from ...core.files.records import Record
from ...core.geometry.se3 import Array
from ...core.presentation.document import COLUMNS
from ...core.presentation.shown import Shown
from ...findings import Finding
from .causes import TARGET_MOVED, Cause, Causes

UNCHANGED, CHANGED, CANNOT_TELL = "unchanged", "changed", "cannot tell"
# Finding of a camera, target or base that moved among the new poses.
MOVED_SINCE = "maintenance.moved_since"


@dataclass(frozen=True, eq=False)
class Move(Record):
    """One unknown pose as the only one that moved before the new poses: its estimate, test and power.

    ``p``: probability of its chi-square if nothing moved; ``left``: of the rest with this move. ``least_angle`` (rad)
    and ``least_shift`` (m): that show in every direction with 95 % probability; infinite: none does. ``estimate``:
    (theta, tau) of the new pose relative to the old one, rad and m.
    """

    name: str
    chi_square: float
    p: float
    left: float
    least_angle: Annotated[float, ">= 0"]
    least_shift: Annotated[float, ">= 0"]
    estimate: Annotated[Array, 6]
    covariance: Annotated[Array, 6, 6]

    @property
    def angle(self) -> float:
        """Angle of the move, rad."""
        return float(np.linalg.norm(self.estimate[:3]))

    @property
    def shift(self) -> float:
        """Length of the move, m."""
        return float(np.linalg.norm(self.estimate[3:]))

    @property
    def std(self) -> Array:
        """(6,) standard deviations of the estimate, rad and m."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


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
    level : float
        Probability of a false alarm.
    moves : tuple of Move
        Each unknown pose that the new poses depend on as the one that moved, with the smallest move of it that shows:
        of one camera "X" and "target", of a rig cameras, targets and bases by name; that which explains most first.
    causes : Causes
        Each cause by itself, with its estimate, and which of them can be separated.
    distances : (n_poses,)
        Squared distance of each pose from what the others and the calibration predict; 6 on average. Of a rig of each
        view, from what the calibration predicts.
    findings : tuple of Finding
    n_poses, n_calibrated : int
        New poses (of a rig views), and those of the calibration (None: not stored).
    views : dict
        p-value of the new views of each pair of camera and target, by "camera, target".
    unseen : tuple of str
        Cameras and targets without a new view, which are not checked.
    limits : (translation (m), rotation (rad))
        Change of a camera that must show.
    setup : str or None
        Of one camera; None of a rig.
    tolerance : str or None
        Change that matters, as given.
    focal_length_px : float or None
        In which an image centre is printed.
    """

    columns = COLUMNS
    _in_file: ClassVar[str] = (
        "format status changed p_value d2 dof noise_dof level setup n_poses n_calibrated tolerance limits cause "
        "candidates causes moves shift_of shift covariance distances views unseen focal_length_px findings sentences"
    )
    format: ClassVar[str] = "uq-handeye check 2"

    status: str
    p_value: float
    d2: float
    dof: int
    noise_dof: float | None
    level: float
    moves: tuple[Move, ...]
    causes: Causes
    distances: Annotated[Array, "n_poses"]
    findings: tuple[Finding, ...]
    n_poses: int
    n_calibrated: int | None
    views: dict[str, float]
    unseen: tuple[str, ...] = ()
    limits: tuple[float | None, float | None] = (None, None)
    setup: str | None = None
    tolerance: str | None = None
    focal_length_px: float | None = None

    @property
    def changed(self) -> bool:
        """True if something has changed."""
        return self.status == CHANGED

    @property
    def moved_since(self) -> Finding | None:
        """The finding of what moved among the new poses, and from which one on; None: nothing did."""
        return next((finding for finding in self.findings if finding.code == MOVED_SINCE), None)

    @property
    def cause(self) -> str | None:
        """Name of the cause, where it can be separated; else None.

        Of one camera "X", "target", "focal length" or "target size". "X" and "target" each stand for two things that no
        pose can separate: see `causes`. The image centre is the same as a camera that rotated, and only among
        `candidates`. Of a rig the name of what moved, or the cause with that of its camera or target.
        """
        named = self.causes.named
        return named.label if self.changed and named is not None else None

    @property
    def candidates(self) -> tuple[str, ...]:
        """Names of the causes that cannot be separated from the most probable one, with it; empty if unchanged."""
        return tuple(cause.label for cause in self.likely)

    @property
    def likely(self) -> tuple[Cause, ...]:
        """The causes of `candidates`."""
        return self.causes.candidates if self.changed and self.causes.explained else ()

    def move(self, name: str) -> Move:
        """Return the move of one unknown pose; of one camera "X" or "target"."""
        return next(one for one in self.moves if one.name == name)

    @property
    def main(self) -> Move:
        """The move of the cause, or of X; of a rig the one that explains most."""
        for name in (self.cause, "X"):
            for one in self.moves:
                if one.name == name:
                    return one
        return self.moves[0]

    @property
    def shift_of(self) -> str:
        """Name of the pose of `shift`: "X" or "W"; of a rig that of what moved."""
        return "W" if self.main.name == TARGET_MOVED else self.main.name

    @property
    def shift(self) -> Array:
        """(6,) move of X, or of the cause (`shift_of`): (theta, tau), rad and m.

        Of the new pose relative to the old one, left rotation and additive translation in its parent frame.
        """
        return self.main.estimate

    @property
    def covariance(self) -> Array:
        """(6, 6) of `shift`, with the uncertainty of the calibration."""
        return self.main.covariance

    @property
    def std(self) -> Array:
        """(6,) standard deviations of `shift`, rad and m."""
        return self.main.std

    @property
    def sentences(self) -> list[str]:
        """The findings in words."""
        return [str(finding) for finding in self.findings]

    __str__ = Shown.summary
