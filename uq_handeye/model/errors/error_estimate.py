"""`ErrorEstimate`, what is known after the fit of an error or of one number of it.

An error has a ``size``, its standard deviation for each unit of its columns, with a 95 % interval where the data had to
find it. Of noise that is drawn at each pose that is all. A number that all poses share has an estimate as well: of the
error of the value that was used, ``used / true - 1`` for lengths, else ``used - true``. Errors of an arm are ``true -
model``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import numpy as np
from scipy.special import erfc

from ...core.files.records import Record
from ...core.geometry.se3 import Array
from ...core.presentation.units import small_unit
from ...errors import InputError
from .key import ErrorKey
from .sizes import RobotAccuracy

# Units of noise, and the factor to those that people read.
SHOWN = {"rad": (180 / np.pi, "deg"), "m": (1e3, "mm"), "px": (1.0, "px"), "": (1.0, "")}
# A size with one of these was not estimated, and has no interval.
GIVEN = ("fixed", "exact", "given", "from corners", "from points", "from the scene", "by geometry")
# Status of an error that is no part of the model, and of one that the covariance of the poses holds without a name.
NOT_DECLARED, IN_NOISE = "not declared", "in the noise"


@dataclass(frozen=True, eq=False)
class ErrorEstimate(Record):
    """An error, or one number of it, after the fit; see the module. What is not known of it has its default.

    ``status`` of a noise: "estimated"; "zero" (the estimate is 0, on the edge of what is possible); "prior" (estimated
    with its data sheet); "population" (of the errors of an arm: at least that of arms of its kind); "fixed" (given);
    "not told apart" (between ``low`` and ``high``, the data say no more); "exact" (the residuals are rounding errors;
    ``high`` is then not determined: None); "from corners", "from points", "from the scene",
    "by geometry" (of the camera poses, from their own covariance: root of the mean variance); "given" (the pixel noise
    of it). "not declared" and "in the noise" (of an error that the model does not have by itself): ``size`` is the one
    that ``effect`` and ``share`` are stated for, which may be above 1.
    """

    _in_file: ClassVar[str] = (
        "name key side unit size low high status count resolved share estimate sd alone alone_sd effect default "
        "focal_length_px stated accuracy"
    )
    _if_any: ClassVar[str] = (
        "low status count resolved share estimate sd alone alone_sd effect default focal_length_px stated accuracy"
    )

    key: ErrorKey
    side: str  # whose poses it moves: "robot" or "camera"; empty: of a sum of both
    unit: str  # "rad", "m", "px", "s"; "" where relative, or mixed
    size: float  # standard deviation: found, or assumed where that was known
    low: float = 0.0  # 95 % interval of the size
    high: float | None = None  # None: not determined
    status: str = ""
    count: int = 0  # numbers of the error that poses share; 0: drawn at each pose
    resolved: float = 0.0  # share of the prior variances that the data took away, at the sizes found: 0 to 1
    share: float = 0.0  # of the variance of X, in the direction where it matters most
    estimate: float = 0.0
    sd: float = 0.0  # after the fit
    alone: float | None = None  # what the residuals say without the prior; None: nothing
    alone_sd: float | None = None
    # (6,) of X (rad, m) for an error of one ``size``, once the fit has done its best
    effect: Annotated[Array, "e"] = field(default_factory=lambda: np.zeros(0))
    default: bool = False  # assumed, not declared
    focal_length_px: float | None = None  # of a principal point, where it is known
    stated: str = ""  # the prior in words, where the number is in units of it
    accuracy: RobotAccuracy | None = None  # of a robot: the prior in numbers
    numbers: tuple[ErrorEstimate, ...] = ()  # of an error of several numbers that are taken together

    @property
    def name(self) -> str:
        """The error in words."""
        return str(self.key)

    @property
    def is_given(self) -> bool:
        """True if its size has no interval: it was not estimated."""
        return self.status in GIVEN

    @property
    def known(self) -> bool:
        """True if its size was known beforehand."""
        return self.low == self.high

    @property
    def parts(self) -> tuple[ErrorEstimate, ...]:
        """Its numbers; itself where it is one."""
        return self.numbers or (self,)

    @property
    def shown_status(self) -> str:
        """Status as people read it."""
        return "not identifiable" if self.status == "not told apart" else self.status

    @property
    def shown(self) -> tuple[float, str]:
        """Factor and unit in which people read its numbers."""
        return small_unit(self.unit) if self.focal_length_px is None else (self.focal_length_px, "px")

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the numbers as people read them, in order."""
        return tuple(dict.fromkeys(part.shown[1] for part in self.parts))

    def of_unit(self, unit: str) -> tuple[Array, Array, Array]:
        """Return sizes, estimates and standard deviations after the fit of the numbers of a unit."""
        parts = [part for part in self.parts if part.shown[1] == unit]
        rows = [[part.shown[0] * x for x in (part.size, part.estimate, part.sd)] for part in parts]
        size, estimate, sd = np.array(rows).T
        return size, estimate, sd

    def beyond(self, size: float) -> float:
        """Return the probability that the error is larger than a size, whatever its sign."""
        return share_beyond(size, self.estimate, self.sd)

    @property
    def p_value(self) -> float | None:
        """p-value of the prior: the probability of an estimate at least as far from 0; None where the data say
        nothing.
        """
        if self.alone is None or self.alone_sd is None:
            return None
        spread = float(np.hypot(self.alone_sd, self.size))
        return float(erfc(abs(self.alone) / spread / np.sqrt(2.0)))

    def __str__(self) -> str:
        scale, unit = SHOWN.get(self.unit, (1.0, self.unit))
        if self.is_given:
            return f"{self.name}: {self.size * scale:.3g} {unit} ({self.shown_status})"
        high = "?" if self.high is None else f"{self.high * scale:.3g}"
        return f"{self.name}: {self.size * scale:.3g} {unit} ({self.low * scale:.3g} to {high}; {self.shown_status})"

    def _possible(self) -> ErrorEstimate:
        known = (self.alone is None) == (self.alone_sd is None) and (self.alone_sd is None or self.alone_sd > 0)
        focal = self.focal_length_px is None or self.focal_length_px > 0
        in_model = self.status not in (NOT_DECLARED, IN_NOISE)
        shares = 0 <= self.resolved <= 1 and self.share >= 0 and (self.share <= 1 or not in_model)
        size = self.size > 0 or not self.effect.size
        if not (known and focal and shares and size and self.size >= 0 and self.sd >= 0 and self.effect.size in (0, 6)):
            raise InputError(f"Expected numbers of the error {self.name!r} that can be.")
        return self


def resolved_share(sd: float, size: float) -> float:
    """Return the share of a prior variance that the data took away, of the standard deviation that is left."""
    return float(np.clip(1.0 - (sd / size) ** 2, 0.0, 1.0)) if size > 0 else 0.0


def share_beyond(size: float, mean: float, sd: float) -> float:
    """Return the probability that a Gaussian number is larger than a size, whatever its sign."""
    spread = max(sd, 1e-300) * np.sqrt(2.0)
    return float(0.5 * (erfc((size - mean) / spread) + erfc((size + mean) / spread)))
