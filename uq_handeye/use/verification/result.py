"""Result of touches against a calibration: test, bias, table of the points, power, where to touch next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...core.geometry.se3 import Array
from ...core.presentation.document import COLUMNS, document_of, to_text
from ...core.presentation.notebook import html_of
from ...core.runtime.read_only import ReadOnlyArrays
from ...findings import Finding
from .power import LEVEL, POWER, quantile_of_components


@dataclass(frozen=True, eq=False)
class PointTable(ReadOnlyArrays):
    """The touches, one by one: touch minus the point as the calibration has it, base frame, m."""

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

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and text."""
        return {
            "names": list(self.names),
            "difference": self.difference.tolist(),
            "std": finite(self.std),
            "p_value": finite(self.p_value),
            "flagged": self.flagged.tolist(),
        }


@dataclass(frozen=True)
class Needed:
    """The number of touches that would show a bias of a size."""

    size: float  # m
    touches: int | None  # None: no number would
    limit: float  # m, the smallest bias that any number of such touches would show

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers."""
        return {"size": self.size, "touches": self.touches, "limit": self.limit if np.isfinite(self.limit) else None}


@dataclass(frozen=True, eq=False)
class NextTouch(ReadOnlyArrays):
    """A further touch and what it would bring."""

    seen: Array  # (3,) in the camera frame, m
    base: Array  # (3,) in the base, m
    view: int  # number of the touch whose robot pose it is seen from
    detectable: float  # m, the smallest bias that would show with it

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and lists."""
        return {
            "seen": self.seen.tolist(),
            "base": self.base.tolist(),
            "view": self.view,
            "detectable": self.detectable,
        }


@dataclass(frozen=True, eq=False)
class Verification(ReadOnlyArrays):
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

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, lists and text; lengths in m."""
        return {
            "contradicted": self.contradicted,
            "p_value": self.p_value,
            "bias_p_value": self.bias_p_value,
            "scatter_p_value": self.scatter_p_value,
            "level": LEVEL,
            "power": POWER,
            "chi2": self.chi2,
            "dof": self.dof,
            "noise_dof": self.noise_dof,
            "n_touches": self.m,
            "rms": self.rms,
            "frame": "base",
            "bias": finite(self.bias),
            "covariance": finite(self.covariance),
            "std": finite(self.std),
            "interval_95": finite(self.interval),
            "worst_direction": self.worst.tolist(),
            "detectable": finite(np.array(self.detectable)),
            "limit": finite(np.array(self.limit)),
            "needed": [one.to_dict() for one in self.needed],
            "next": [one.to_dict() for one in self.next],
            "tool": None if self.tool is None else finite(self.tool),
            "tool_std": None if self.tool_std is None else finite(self.tool_std),
            "points": self.points.to_dict(),
            "findings": [one.to_dict() for one in self.findings],
            "warnings": list(self.warnings),
        }


def finite(values: Array) -> Any:
    """Lists with None for what is not finite."""
    found = np.asarray(values).astype(object)
    if found.ndim == 0:
        return float(values) if np.isfinite(values) else None
    found[~np.isfinite(np.asarray(values, dtype=float))] = None
    return found.tolist()
