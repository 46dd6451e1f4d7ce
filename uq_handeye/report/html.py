"""The report of a calibration: one self-contained HTML file, or the same as PDF.

Nothing is loaded from anywhere: style and figures are in the file, and a content security policy forbids the rest. All
text is escaped by the template. The same result gives the same file, except for the date.
"""

from __future__ import annotations

import base64
import hashlib
import warnings
from dataclasses import replace
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from .. import __version__
from ..comparison import Comparison, compare
from ..comparison_row import Row, against
from ..errors import InputError, NotConvergedError
from ..io.atomic import write_atomically
from ..motions import spread_pairs
from ..poses import PosePairs
from ..result import CONVENTION
from .blocks import Drawing, Section
from .figure_parts import Picture, inline_svg
from .figures import pictures, require_same_problem
from .methods_figure import methods_figure
from .pdf import to_pdf
from .sections_data import (
    budget_section,
    covariances_section,
    methods_section,
    noise_section,
    observability_section,
    pretty,
    residuals_section,
    rig_section,
)
from .sections_repeat import repeat_section
from .sections_result import (
    answer_section,
    ellipses_section,
    forms_section,
    scope_section,
    task_space_section,
    warnings_section,
)

if TYPE_CHECKING:
    from ..result import Calibration
    from ..validation.cross_check import CrossCheck

# Methods are compared on all pairs of the poses, or on about so many of them.
COMPARED_PAIRS = 4000
SUFFIXES = (".html", ".pdf")


def write_report(
    result: Calibration,
    path: str | Path,
    *,
    comparison: Comparison | bool = True,
    cross_check: CrossCheck | None = None,
) -> Path:
    """Write the report of ``result``; the arguments are those of `Calibration.report`.

    Returns
    -------
    Path
        Of the file, which is written whole or not at all.

    Raises
    ------
    InputError
        A path that ends neither in .html nor in .pdf or cannot be written; a comparison or cross-check of another
        problem.
    MissingExtraError
        A PDF where neither WeasyPrint nor a Chromium browser is installed.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"Expected `path` to end in {' or '.join(SUFFIXES)}, got {path.name!r}.")
    text = report_html(result, comparison=comparison, cross_check=cross_check)
    write_atomically(path, text if suffix == ".html" else to_pdf(text))
    return path


def report_html(
    result: Calibration,
    *,
    comparison: Comparison | bool = True,
    cross_check: CrossCheck | None = None,
    date: str | None = None,
) -> str:
    """The report as HTML text; ``date`` is written into it, None is now (UTC). Raises as `write_report`."""
    if not isinstance(comparison, bool | Comparison):
        raise InputError(f"Expected `comparison` to be True, False or a Comparison, got {type(comparison).__name__}.")
    if cross_check is not None:
        require_same_problem(result, cross_check)
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC") if date is None else date
    drawings = {stem: _drawing(stem, picture) for stem, picture in pictures(result, cross_check).items()}
    sections = [
        answer_section(result),
        warnings_section(result),
        ellipses_section(result, drawings, cross_check),
        rig_section(result, drawings),
        residuals_section(result, drawings),
        budget_section(result, drawings),
        task_space_section(result, drawings),
        _methods(result, comparison),
        observability_section(result),
        noise_section(result),
        covariances_section(result),
        forms_section(result),
        repeat_section(result, date, __version__),
        scope_section(result, CONVENTION),
    ]
    return _rendered(result, sections, date)


def _rendered(result: Calibration, sections: list[Section], date: str) -> str:
    from jinja2 import Environment, StrictUndefined

    files = resources.files(__package__)
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["pretty"] = pretty
    template = environment.from_string((files / "template.html.j2").read_text(encoding="utf-8"))
    script = _SCRIPT.strip()
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    data = f"{result.n_poses:,} poses" if result.n_poses is not None else f"{result.n_pairs:,} motions"
    return template.render(
        frame=result.frame,
        facts=[result.setup or "motions without poses", data, f"method {result.method}", date],
        sections=sections,
        style=Markup((files / "report.css").read_text(encoding="utf-8")),
        script=Markup(script),
        script_hash=digest,
        version=__version__,
    )


def _drawing(stem: str, picture: Picture) -> Drawing:
    return Drawing(stem, Markup(inline_svg(picture.figure, stem)), picture.alt, picture.caption)


class _Compared(NamedTuple):
    comparison: Comparison | None
    reason: str  # why there is none
    note: str  # on the data that were compared


def _methods(result: Calibration, comparison: Comparison | bool) -> Section:
    """The section on the other methods, with X of the result as the reference where they are compared here."""
    if isinstance(comparison, Comparison):
        if comparison.frame != result.frame:
            raise InputError(
                f"Expected `comparison` to be of {result.frame}, as the result, got one of {comparison.frame}."
            )
        found = _Compared(comparison, "", "")
    elif comparison:
        found = _compared(result)
    else:
        found = _Compared(None, "Not compared: report(path, comparison=True) puts all published methods here.", "")
    drawing = None
    rows = () if found.comparison is None else found.comparison.rows
    base = None if found.comparison is None else found.comparison.base
    others = [row for row in rows if row is not base]
    if base is not None and any(row.xi is not None and row.failure is None for row in others):
        figure = methods_figure([base, *others])
        alt = f"Differences of {len(others)} methods from {base.method} in the six components of X, with 1 and 2 sigma."
        caption = (
            f"Differences from {base.method}, one row per method; thick and thin bars are 1 and 2 standard deviations "
            "of the method itself, the grey band is 1 standard deviation of the reference. Orange diamonds: the method "
            "differs from it beyond its own 95 % ellipsoid. Triangles at the rim: farther away, with the value. Bars "
            "that do not reach zero in several panels deserve a look."
        )
        drawing = _drawing("methods", Picture(figure, alt, caption))
    return methods_section(found.comparison, found.reason, found.note, drawing)


def _compared(result: Calibration) -> _Compared:
    """All published methods on the data of the result, without the poses that it rejected."""
    data, noise, note = result.data, result.noise, ""
    if data is None:
        return _Compared(
            None,
            "Not compared: this result was read from a file, which holds no poses. "
            "report(path, comparison=compare(poses, noise=noise)) shows the methods.",
            "",
        )
    if result.table is not None and result.table.rejected:
        kept = np.flatnonzero(result.table.weight > 0)
        data, noise = data.rows(kept), None if noise is None else noise.rows(kept)
        count = len(result.table.rejected)
        note = f" Without the {f'{count} {result.table.item}s' if count > 1 else result.table.item} rejected here."
    pairs: NDArray[np.intp] | str = "all"
    if isinstance(data, PosePairs):
        pairs = spread_pairs(data.n, COMPARED_PAIRS)
    elif data.N > COMPARED_PAIRS:
        some = np.linspace(0, data.N - 1, COMPARED_PAIRS).astype(np.intp)
        note += f" They are spread evenly over the {data.N:,} motions."
        data, noise = data.rows(some), None if noise is None else noise.rows(some)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # those that matter are in the table
            found = compare(data, noise=noise, pairs=pairs)
    except (InputError, NotConvergedError) as error:
        return _Compared(None, f"Not compared: {error}", "")
    available = data.n * (data.n - 1) // 2 if isinstance(data, PosePairs) else found.n_pairs
    base = Row(
        f"{result.method} (this result)",
        0,
        "",
        "",
        X=result.X,
        covariance=result.covariance,
        residuals=result.residuals,
    )
    rows = [against(row, base) for row in (base, *found.rows)]
    found = replace(found, rows=tuple(rows), reference=base.method, n_pairs_available=available)
    return _Compared(found, "", note)


# Shows the buttons, which do nothing without it, and copies; the old way where a browser has no clipboard for files.
_SCRIPT = """
document.querySelectorAll("button.copy").forEach(function (button) {
  button.hidden = false;
  button.addEventListener("click", function () {
    var text = button.parentElement.parentElement.querySelector("pre").textContent;
    function said(word) {
      button.textContent = word;
      setTimeout(function () { button.textContent = "Copy"; }, 1500);
    }
    function oldWay() {
      var area = document.createElement("textarea");
      area.value = text;
      area.setAttribute("readonly", "");
      area.className = "offscreen";
      document.body.appendChild(area);
      area.select();
      var done = false;
      try { done = document.execCommand("copy"); } catch (error) { done = false; }
      document.body.removeChild(area);
      said(done ? "Copied" : "Select and copy by hand");
    }
    if (navigator.clipboard && navigator.clipboard.writeText) {
      navigator.clipboard.writeText(text).then(function () { said("Copied"); }, oldWay);
    } else { oldWay(); }
  });
});
"""
