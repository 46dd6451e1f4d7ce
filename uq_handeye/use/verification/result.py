"""Result of a verification by touches, and its text: test, bias, table of the points, power, and touches to add."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.special import ndtri, stdtrit

from ...core.files.records import Record
from ...core.geometry.se3 import Array
from ...core.levels import POWER, UNUSUAL
from ...core.limits import MAX_PRINTED_ROWS
from ...core.presentation.document import COLUMNS, Answer, Document, Paragraph, Points, Table, document_of
from ...core.presentation.numbers import digits, plus_minus, probability
from ...core.presentation.shown import Shown
from ...findings import Finding


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
        """(m,) True for points that differ from what the calibration says, tested at 5 % for all of them."""
        return np.asarray(np.nan_to_num(self.p_value, nan=1.0) < UNUSUAL.probability / len(self.names))


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
class Verification(Record, Shown):
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
        Smallest bias, in the worst direction, that these touches would have shown with 95 % probability, m.
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

    columns = COLUMNS
    _in_file: ClassVar[str] = (
        "contradicted p_value bias_p_value scatter_p_value level power chi2 dof noise_dof n_touches=m rms frame bias "
        "covariance std interval_95=interval worst_direction=worst detectable limit needed next tool tool_std points "
        "findings warnings"
    )
    level: ClassVar[float] = UNUSUAL.probability
    power: ClassVar[float] = POWER.probability
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
        return self.p_value is not None and self.p_value < UNUSUAL.probability

    @property
    def std(self) -> Array:
        """(3,) standard deviations of the bias."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def interval(self) -> Array:
        """(3, 2) the 95 % interval of each component of the bias, m."""
        tail = 0.5 * (1.0 + 0.95)
        half = float(ndtri(tail) if self.noise_dof is None else stdtrit(self.noise_dof, tail)) * self.std
        return np.stack([self.bias - half, self.bias + half], axis=-1)

    @property
    def rms(self) -> float:
        """RMS length of the differences, m."""
        return float(np.sqrt(np.mean(self.points.distance**2)))

    @property
    def same_vector(self) -> str:
        """State that all touches miss by the same vector, which a new calibration mends; empty where they do not."""
        if self.m < 2 or not self.contradicted or self.bias_p_value is None or np.isnan(self.bias).any():
            return ""
        scatters = self.scatter_p_value is not None and self.scatter_p_value < UNUSUAL.probability
        if scatters or self.bias_p_value >= UNUSUAL.probability:
            return ""
        clear = (self.interval > 0).all(axis=1) | (self.interval < 0).all(axis=1)
        shown = np.asarray(clear | (not clear.any())).tolist()
        parts = zip("xyz", (1e3 * self.bias).tolist(), shown, strict=True)
        listed = ", ".join(f"{axis} {b:+.{1 if abs(b) >= 1 else 2}f} mm" for axis, b, is_it in parts if is_it)
        return (
            f"All touches miss by the same vector: {listed} (touch minus point, base frame). The camera moved, or the "
            "tool is not as given. Measure the tool, and calibrate again."
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences of the findings that are more than a note."""
        return tuple(str(one) for one in self.findings if one.severity != "note")


@document_of.register(Verification)
def verification_document(found: Verification) -> Document:
    """The answer, the bias, its power, the points, what to do next."""
    status = "failed" if found.contradicted else "caution" if found.p_value is None or found.warnings else "ok"
    lines = [Paragraph(text, hang="  ") for text in (_bias(found), _scatter(found), _power(found), _needed(found))]
    tool = _tool(found)
    more = [Paragraph(text, hang="  ") for text in (tool, _next(found)) if text]
    findings = [] if not found.findings else [Points.of_findings(found.findings)]
    same = [Paragraph(found.same_vector, hang="  ")] if found.same_vector else []
    return [[Answer(headline(found), status), *same], [*lines, *more], _table(found), findings]


def headline(found: Verification) -> str:
    """State whether the touches contradict the calibration."""
    n = f"{found.m} {'touch' if found.m == 1 else 'touches'}"
    if found.p_value is None:
        return f"CANNOT TELL: {n} with a tool of unknown offset test nothing."
    p = probability(found.p_value, 2)
    if not found.contradicted:
        verb = "agrees" if found.m == 1 else "agree"
        return f"AGREES: {n} {verb} with the calibration ({p})."
    parts = {"a bias": found.bias_p_value, "the scatter of the points": found.scatter_p_value}
    why = min((p for p in parts.items() if p[1] is not None), key=lambda part: part[1] or 0.0)[0]
    verb = "contradicts" if found.m == 1 else "contradict"
    return f"CONTRADICTED by {why}: {n} {verb} the calibration ({p})."


def _bias(found: Verification) -> str:
    if found.bias_p_value is None:
        return "Bias: not known, the tool's offset hides it."
    half = found.interval[:, 1] - found.bias
    words = [
        f"{axis} hidden" if np.isnan(b) else f"{axis} {plus_minus(1e3 * b, 1e3 * h)}"
        for axis, b, h in zip("xyz", found.bias, half, strict=True)
    ]
    return (
        f"Bias (touch minus point, base frame, 95 %): {', '.join(words)} mm; {probability(found.bias_p_value, 2)}. It "
        "includes the uncertainty of X."
    )


def _scatter(found: Verification) -> str:
    text = f"Differences: {digits(1e3 * found.rms, 2)} mm RMS"
    if found.scatter_p_value is None:
        return f"{text}."
    law = "chi-square" if found.noise_dof is None else "a mixture over the sizes of the errors"
    return (
        f"{text}; d^2 {digits(found.chi2)} of {found.dof} numbers ({law}); scatter about the bias: "
        f"{probability(found.scatter_p_value, 2)}."
    )


def _power(found: Verification) -> str:
    if not np.isfinite(found.detectable):
        return "Power: no bias would have shown in every direction."
    direction = ", ".join(f"{x + 0.0:.2f}" for x in found.worst)
    return (
        f"Power: a bias of {_mm(found.detectable)} mm would have shown with {100 * POWER.probability:.0f} % "
        f"probability, in the worst direction ({direction}); tests at {100 * UNUSUAL.probability:.0f} %."
    )


def _needed(found: Verification) -> str:
    parts = []
    for one in found.needed:
        size = digits(1e3 * one.size, 3)
        if one.touches is not None:
            many = "1 such touch" if one.touches == 1 else f"{one.touches} such touches in all"
            parts.append(f"A bias of {size} mm would show with {many}.")
            continue
        why = ""
        if np.isfinite(one.limit):
            why = f": the uncertainty that they share (X, robot, tool) hides up to {_mm(one.limit)} mm"
        parts.append(f"No number of such touches would show a bias of {size} mm{why}.")
    return " ".join(parts)


def _tool(found: Verification) -> str:
    if found.tool is None or found.tool_std is None or not found.dof:
        return ""
    listed = ", ".join(
        f"{axis} {plus_minus(1e3 * v, 1e3 * s)}" for axis, v, s in zip("xyz", found.tool, found.tool_std, strict=True)
    )
    return f"Tool offset, found minus given (flange frame, standard deviations, if there is no bias): {listed} mm."


def _next(found: Verification) -> str:
    if not found.next:
        return ""
    first = found.next[0]
    seen, base = (", ".join(f"{1e3 * x + 0.0:.0f}" for x in point) for point in (first.seen, first.base))
    return (
        f"Touch next: the point ({seen}) mm of the camera, at ({base}) mm in the base, seen from the pose of point "
        f"{found.points.names[first.view]}. With {len(found.next)} chosen touches {_mm(found.next[-1].detectable)} mm "
        "would show."
    )


def _table(found: Verification) -> Table:
    points, rows = found.points, []
    order = np.sort(np.argsort(np.nan_to_num(points.p_value, nan=1.0), kind="stable")[:MAX_PRINTED_ROWS])
    for k in order.tolist():
        sd, p = np.sqrt(np.trace(points.covariance[k]) / 3.0), points.p_value[k]
        rows.append(
            [
                points.names[k], *(f"{1e3 * x:.3f}" for x in (*points.difference[k], points.distance[k])),
                f"{1e3 * sd:.3f}" if np.isfinite(sd) else "",
                probability(p, 2).removeprefix("p = ").removeprefix("p ") if np.isfinite(p) else "",
                "differs" if points.flagged[k] else "",
            ]
        )  # fmt: skip
    more = f" ({found.m - len(rows)} more points: --json, -o)" if found.m > len(rows) else ""
    head = ["point", "x", "y", "z", "distance", "sd", "p", ""]
    units = ["", "mm", "mm", "mm", "mm", "mm", "", ""]
    marked = frozenset(np.flatnonzero(points.flagged[order]).tolist())
    caption = f"Touch minus point, base frame{more}"
    return Table(caption, head, rows, units=units, marked=marked, text_columns=frozenset({7}))


def _mm(metres: float) -> str:
    return digits(1e3 * metres, 2)
