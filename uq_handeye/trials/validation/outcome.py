"""Results of validations: their text, figure and file, and checks of the noise that they draw against their data.

A validation draws the noise that is given or estimated and tests whether a covariance follows from it. It cannot test
whether that noise is the noise of these data; their residuals can. A calibration has tested them (its ``checks``). For
poses or motions only, the residuals of maximum likelihood are compared with the noise (`goodness_of_fit`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import singledispatch
from importlib import import_module
from math import log
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeVar

import numpy as np

from ..._version import __version__
from ...core.files.atomic import write_atomically
from ...core.files.json_values import JsonObject
from ...core.files.open import StrPath, as_path
from ...core.geometry.conventions import CONVENTION
from ...core.geometry.frames import SETUPS
from ...core.levels import CONTRADICTED
from ...core.presentation.document import COLUMNS, WIDTH, Block, Checks, Document, Paragraph, document_of, to_text
from ...core.presentation.html import to_html
from ...core.presentation.numbers import digits, probability
from ...core.presentation.shown import Shown
from ...core.rounding import THIRD_DIGITS
from ...errors import InputError, NotConvergedError
from ...findings import GROSS_EXCESS
from ...fit.graph.gauss_helmert import maximum_likelihood
from ...fit.graph.goodness_of_fit import GoodnessOfFit, goodness_of_fit
from ...model.errors.models import Noise
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs

if TYPE_CHECKING:
    from matplotlib.figure import Figure


T = TypeVar("T")

# Residuals up to this ratio to the noise, either way, are no reason to doubt it.
HARMLESS_RATIO = 1.1


class NoiseCheck(NamedTuple):
    """One check of data and noise: name, status ("ok", "caution", "failed", "not run"), short phrase."""

    name: str
    status: str
    text: str


class NoiseOfData(NamedTuple):
    """Checks of the data of a validation, and of the noise against them."""

    checks: tuple[NoiseCheck, ...]
    by: str  # "calibrate", or "residuals" where there is no calibration
    stated: tuple[float, float] | None = None  # m, rad: sd in the worst direction by a calibration with open sizes

    @property
    def part(self) -> str:
        """Return which part of what calibrate states a validation speaks of, as a sentence; empty where it is all."""
        return part_of("noise of known sizes", self.stated)

    @property
    def doubtful(self) -> tuple[NoiseCheck, ...]:
        """Checks that contradict the noise, failed ones first."""
        return tuple(check for status in ("failed", "caution") for check in self.checks if check.status == status)

    def __str__(self) -> str:
        """Return one sentence: what contradicts the noise on these data, or that nothing does."""
        doubtful = self.doubtful
        if doubtful:
            listed = "; ".join(f"{check.text} ({check.name}: {check.status})" for check in doubtful[:2])
            more = f"; and {len(doubtful) - 2} more" if len(doubtful) > 2 else ""
            return f"{self.warns} {listed}{more}."
        if any(check.status == "ok" for check in self.checks):
            whose = "calibrate found nothing against it" if self.by == "calibrate" else "the residuals agree with it"
            return f"On these data {whose}."
        return f"On these data it was not checked: {self.checks[0].text}."

    @property
    def warns(self) -> str:
        """Words before the checks that warn."""
        return f"On these data {'calibrate warns' if self.by == 'calibrate' else 'the residuals contradict it'}:"

    def to_dict(self) -> JsonObject:
        """Return plain values for JSON."""
        found: JsonObject = {"by": self.by, "sentence": str(self), "checks": [check._asdict() for check in self.checks]}
        return found if self.stated is None else found | {"stated": list(self.stated)}


def part_of(what: str, stated: tuple[float, float] | None) -> str:
    """Return the sentence that a validation is about ``what`` only, with the accuracy by calibrate; or none."""
    if stated is None:
        return ""
    move, turn = digits(1e3 * stated[0], 2), digits(float(np.degrees(stated[1])), 2)
    return (
        f" It speaks of {what}; calibrate, which does not know them, states {move} mm and {turn} deg in all (1 sigma, "
        "worst direction)."
    )


def noise_of_data(data: object, used: PosePairs | Motions, noise: Noise | None, estimated: bool) -> NoiseOfData:
    """Return a sentence on the agreement of the data with the noise.

    Parameters
    ----------
    data : PosePairs, Motions or Calibration
        As the validation was given it; a calibration brings its own checks.
    used : PosePairs or Motions
        The data themselves.
    noise : PoseNoise, PairNoise or None
        The noise that is drawn; None is not checked.
    estimated : bool
        Whether it was estimated from the same data.
    """
    found: Iterable[Any] | None = getattr(data, "checks", None)  # of a calibration, which stands above this package
    if found is not None:
        checks = tuple(NoiseCheck(check.name, check.status, check.text) for check in found)
        return NoiseOfData(checks, "calibrate", stated_of(data) if estimated else None)
    return NoiseOfData((_level(used, None if estimated else noise),), "residuals")


def stated_of(result: Any) -> tuple[float, float] | None:
    """Return the accuracy of X (m, rad) by a calibration that estimated sizes, where it exceeds that of known sizes;
    None also for data without one.
    """
    S, known = getattr(result, "covariance", None), getattr(result, "bound", None)
    if S is None or known is None or np.allclose(S, known, rtol=1e-6):
        return None
    turn, move = (float(np.sqrt(np.linalg.eigvalsh(S[part, part])[-1])) for part in (slice(0, 3), slice(3, 6)))
    return move, turn


def _level(data: PosePairs | Motions, noise: Noise | None) -> NoiseCheck:
    """Return whether the residuals have the size that the noise explains."""
    fit: GoodnessOfFit | None = None
    if noise is None:
        return NoiseCheck("noise level", "not run", "the noise was estimated from the same residuals")
    with suppress(InputError, NotConvergedError, np.linalg.LinAlgError):
        fit = goodness_of_fit(maximum_likelihood(data, noise))
    if fit is None:
        return NoiseCheck("noise level", "not run", "these data have no residuals to compare it with")
    if fit.sigma0 < THIRD_DIGITS:
        return NoiseCheck("noise level", "not run", "the data are exact, simulated without noise")
    p = 1.0 if fit.p_value is None else fit.p_value
    if p > CONTRADICTED.probability or abs(log(fit.sigma0)) < log(HARMLESS_RATIO):
        return NoiseCheck("noise level", "ok", f"the residuals agree with it ({probability(p, 2)})")
    larger = fit.sigma0 > 1
    ratio = digits(fit.sigma0 if larger else 1 / fit.sigma0, 2)
    text = f"residuals {ratio} times {'larger' if larger else 'smaller'} than this noise"
    return NoiseCheck("noise level", "failed" if fit.sigma0 > GROSS_EXCESS else "caution", text)


def limit(who: str, found: NoiseOfData | None) -> str:
    """Return the limits of a validation, and the test of the noise by the data, in one paragraph."""
    text = f"{who} cannot tell whether the noise is right."
    return text if found is None else f"{text}{found.part} {found}"


def limit_blocks(who: str, found: NoiseOfData | None, verbose: bool) -> list[Block]:
    """Return the same with one line for each check that warns; ``verbose``: for each check."""
    if found is None or not (verbose or found.doubtful):
        return [Paragraph(limit(who, found))]
    shown = found.checks if verbose else found.doubtful
    said = found.warns if found.doubtful else str(found)
    return [
        Paragraph(f"{who} cannot tell whether the noise is right.{found.part} {said}"),
        Checks([(check.status, check.name, check.text) for check in shown]),
    ]


def one_of(known: Mapping[str, T], name: str, what: str) -> T:
    """Return the value of a name; raises the `InputError` that lists the names there are."""
    if name not in known:
        raise InputError(f"Expected {what} {', '.join(known)}, got {name!r}.")
    return known[name]


def place_of(data: PosePairs | Motions) -> dict[str, Any]:
    """Return what X is called, the setup (None for motions), and around what noise is drawn."""
    poses = data.poses
    return {
        "frame": "X" if poses is None else SETUPS[poses.setup],
        "setup": None if poses is None else poses.setup,
        "origin": "fit to the data" if poses is None or poses.truth is None else "truth of the simulation",
    }


@singledispatch
def figure_of(result: Outcome) -> Figure:
    """Return the figure of a result. Each topic registers the function that draws its own result."""
    raise TypeError(f"Expected a result with a figure, got {type(result).__name__}.")


class Outcome(Shown):
    """A result with a document (`document_of`), a figure and a file."""

    kind: ClassVar[str]  # in files

    def head(self, **units: str) -> JsonObject:
        """Return the beginning of the file: its format, the version that wrote it, convention and units."""
        units = {"rotation": "rad", "translation": "m", **units}
        form = f"uq-handeye {self.kind} 1"
        return {"format": form, "version": __version__, "convention": CONVENTION, "units": units}

    def document(self, verbose: bool = False) -> Document:
        """Return the verdict with its limits and the first table; ``verbose``: everything that is known."""
        with np.errstate(over="ignore"):  # the ratio to a direction without any error is infinite
            return document_of(self, verbose=verbose)

    def _repr_html_(self) -> str:
        """Return the verdict, with everything else folded, for notebooks."""
        return to_html(self.title, self.document(True), seen=self.unfolded)

    def summary(self, verbose: bool = False) -> str:
        """Return the verdict and the first table as text of 80 columns; ``verbose``: everything that is known."""
        return to_text(self.document(verbose), WIDTH if verbose else COLUMNS)

    def __str__(self) -> str:
        return self.summary()

    def drawn(self) -> Figure:
        """Return the figure as Matplotlib has it, which is slow to import."""
        for name in ("figure_of_monte_carlo", "figure_of_cross_check", "corner_plot"):
            import_module(f"{__package__}.{name}")
        return figure_of(self)

    def figure(self, path: StrPath) -> Path:
        """Write the figure, ``.png`` or ``.svg`` by its name, whole or not at all; returns the path.

        Raises `InputError` for another kind of file, or one that cannot be written.
        """
        path = as_path(path)
        kind = path.suffix.lower().removeprefix(".")
        if kind not in ("png", "svg"):
            raise InputError(f"Expected a figure to be named .png or .svg, got {str(path)!r}.")
        from ...core.presentation.ellipses import render

        with np.errstate(over="ignore"):
            image = render(self.drawn(), kind)
        write_atomically(path, image)
        return path
