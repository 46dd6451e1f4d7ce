"""Result of touches against a calibration: test, bias, table of the points, power, where to touch next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...core.files.records import Record
from ...core.geometry.se3 import Array
from ...core.presentation.document import COLUMNS, document_of, to_text
from ...core.presentation.notebook import html_of
from ...findings import Finding
from .power import LEVEL, POWER, quantile_of_components


@dataclass(frozen=True, eq=False)
class PointTable(Record):
    """The touches, one by one: touch minus the point as the calibration has it, base frame, m."""

    _in_file: ClassVar[str] = "names difference std p_value flagged"

    names: tuple[str, ...]  # (m)
    difference: Array  # (m, 3)
    covariance: Array  # (m, 3, 3) if nothing has changed; infinite on the diagonal where the tool is not known
    p_value: Array  # (m,) of the difference by itself; nan where the tool is not known

    @property
    def distance(self) -> Array:
        """(m,) lengths of the differences."""
        return np.asarray(np.linalg.norm(self.difference, axis=-1))

    @property
    def std(self) -> Array:
        """(m, 3) standard deviations along the axes of the base."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))

    @property
    def flagged(self) -> Array:
        """(m,) True for points that differ from what the calibration says, tested at `LEVEL` for all of them."""
        return np.asarray(np.nan_to_num(self.p_value, nan=1.0) < LEVEL / len(self.names))


@dataclass(frozen=True)
class Needed(Record):
    """The number of touches that would show a bias of a size."""

    size: float  # m
    touches: int | None  # None: no number would
    limit: float  # m, the smallest bias that any number of such touches would show


@dataclass(frozen=True, eq=False)
class NextTouch(Record):
    """A further touch and what it would bring."""

    seen: Array  # (3,) in the camera frame, m
    base: Array  # (3,) in the base, m
    view: int  # number of the touch whose robot pose it is seen from
    detectable: float  # m, the smallest bias that would show with it


@dataclass(frozen=True, eq=False)
class Verification(Record):
    """Points that the camera saw and the robot touched against a calibration.

    Model: `evidence.touches`. The differences of all touches have the covariance Sigma, of X, the robot, the shared
    errors, the tool, touching and seeing. A bias is an offset that all touches share, estimated with Sigma; the
    scatter is what it leaves of ``d^2``. Both are tested; they are independent, and ``p_value`` is that of the smaller
    one of the two.

    Attributes
    ----------
    bias : (3,)
        Touch minus the point as the calibration has it, base frame, m; generalised least squares. Components that an
        unknown tool hides are nan.
    covariance : (3, 3)
        Of the bias, with the calibration's own uncertainty; infinite on the diagonal where the tool hides it.
    p_value : float or None
        Of all touches together, ``1 - (1 - min(bias, scatter))^2``; None: nothing can be tested.
    bias_p_value, scatter_p_value : float or None
    chi2, dof : float, int
        ``d^2`` of all differences, and its degrees of freedom.
    noise_dof : float or None
        Degrees of freedom of the variance of the bias where the calibration estimated noise; None: it was given.
    points : PointTable
    detectable : float
        Smallest bias, in the worst direction, that these touches would have shown with `POWER` probability, m.
    limit : float
        The same for any number of such touches, m.
    worst : (3,)
        The direction in which a bias is known least, base frame.
    tool : (3,) or None
        An unknown tool's offset, estimated minus given, flange frame, m, if there is no bias.
    tool_std : (3,) or None
        Its standard deviations, m.
    tool_sd : float
        What was assumed of the tool's offset per axis, m; infinite: unknown.
    needed : tuple of Needed
    next : tuple of NextTouch
    findings : tuple of Finding
    """

    _in_file: ClassVar[str] = (
        "contradicted p_value bias_p_value scatter_p_value level power chi2 dof noise_dof n_touches=m rms frame bias "
        "covariance std interval_95=interval worst_direction=worst detectable limit needed next tool tool_std points "
        "findings warnings"
    )
    level: ClassVar[float] = LEVEL
    power: ClassVar[float] = POWER
    frame: ClassVar[str] = "base"

    bias: Array
    covariance: Array
    p_value: float | None
    bias_p_value: float | None
    scatter_p_value: float | None
    chi2: float
    dof: int
    noise_dof: float | None
    points: PointTable
    detectable: float
    limit: float
    worst: Array
    tool: Array | None
    tool_std: Array | None
    needed: tuple[Needed, ...]
    next: tuple[NextTouch, ...]
    findings: tuple[Finding, ...]
    tool_sd: float

    @property
    def m(self) -> int:
        """Number of touches."""
        return len(self.points.names)

    @property
    def contradicted(self) -> bool:
        """True if the touches contradict the calibration at the level of 5 %."""
        return self.p_value is not None and self.p_value < LEVEL

    @property
    def std(self) -> Array:
        """(3,) standard deviations of the bias."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def interval(self) -> Array:
        """(3, 2) the 95 % interval of each component of the bias, m."""
        half = quantile_of_components(0.95, self.noise_dof) * self.std
        return np.stack([self.bias - half, self.bias + half], axis=-1)

    @property
    def rms(self) -> float:
        """RMS length of the differences, m."""
        return float(np.sqrt(np.mean(self.points.distance**2)))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences of the findings that are more than a note."""
        return tuple(str(one) for one in self.findings if one.severity != "note")

    def summary(self) -> str:
        """The answer as text."""
        return to_text(document_of(self), COLUMNS)

    def _repr_html_(self) -> str:
        return html_of(self)
