"""The text of the panel as HTML, made by the macros of `panel.html.j2`, and the numbers in it."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from markupsafe import Markup

from ...calibration.report.first_screen import checks_block
from ...core.geometry.se3 import Array
from ...core.limits import MIN_POSES
from ...core.presentation.html import macros
from ...core.presentation.numbers import digits
from .question import words
from .remedies import is_remedied
from .session import Session

# Rows of the table of poses that the page shows.
MAX_ROWS_SHOWN = 1000


@cache
def _macros() -> Any:
    style = resources.files(__package__ or "").joinpath("panel.css").read_text(encoding="utf-8")
    return macros(
        __package__, "panel.html.j2", checks_block=checks_block,
        digits=digits, FEWEST=MIN_POSES, style=Markup(f"<style>\n{style}</style>"), log10=np.log10, degrees=np.degrees,
        isfinite=np.isfinite, is_remedied=is_remedied,
    )  # fmt: skip


def panel(macro: str, *given: Any) -> str:
    """Return what a macro of `panel.html.j2` makes of its arguments: covered, result, rig, poses, preformatted, ..."""
    return str(getattr(_macros(), macro)(*given))


def summary(session: Session) -> str:
    """Return the answer: headline, verdict, what is included, checks, what the last pose brought, the curve."""
    folder = session.folder
    begin = f"No poses yet in {folder.path.name or folder.path}. {words(session.answer, folder.of_scene)}"
    return panel("summary", session, begin, _steps(session))


def of_point(point: Array, covariance: Array | None, text: str) -> str:
    """Return where a point is (m, base frame) and how well it is known (3, 3)."""
    sd, worst = None, float("inf")
    if covariance is not None:
        sd = 1e3 * np.sqrt(np.diag(covariance))
        if np.isfinite(covariance).all():
            worst = 1e3 * float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    return panel("point", 1e3 * point, sd, worst, text)


def _steps(session: Session) -> list[str]:
    """Return what the last pose brought, and what comes next."""
    answer, new = session.answer, session.answer.n - 1
    lines = [f"{answer.n - len(answer.left_out)} poses."]
    brought = session.brought()
    if brought is not None and np.isfinite(brought).all():
        before, after = (digits(1e3 * size, 2) for size in brought)
        lines[0] += f" The last one: from {before} to {after} mm at the target."
    found = None if answer.result is None else answer.result.table
    if found is not None and new < len(found) and found.flag[new] not in ("kept", "excluded"):
        lines.append(f"The last pose, {new}, contradicts the others: {found.status(new)}. Look at it, or leave it out.")
    return list(filter(None, [*lines, *answer.lines[1:], words(answer)]))
