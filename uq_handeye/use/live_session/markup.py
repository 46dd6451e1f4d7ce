"""The text of the panel as HTML: headline, what is included, checks, the curve, the table of poses.

Only numbers and escaped text: whatever a file holds is shown as the characters that it is made of.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup, escape

from ...calibration.report.first_screen import STATUS_OF, checks_block, status_of
from ...calibration.result import Calibration
from ...core.formatting.numbers import digits
from ...core.geometry.se3 import Array
from ...fit.diagnostics.pose_table import PoseTable
from ...rig.result import RigCalibration
from .question import FEWEST, Answer, words
from .session import Session

# Rows of the table that are sent: the first of so many.
MOST_ROWS = 1000

STYLE = Markup("""<style>
.uq{padding:0 .75em;font-size:.82em;line-height:1.4;overflow-wrap:anywhere}
.uq .uq{padding:0;font-size:1em}.uq p{margin:.35em 0}.uq .big{font-size:1.15em;font-weight:600}
.uq .dim{color:var(--mantine-color-dimmed)}
.uq .ok{color:#0a7d4f}.uq .caution{color:#a15c00}.uq .failed{color:#c4002f}
[data-mantine-color-scheme=dark] .uq .ok{color:#4fd1a1}[data-mantine-color-scheme=dark] .uq .caution{color:#f2b84b}
[data-mantine-color-scheme=dark] .uq .failed{color:#ff7a90}
.uq .verdict{border:1px solid currentColor;border-radius:4px;padding:.25em .5em;font-weight:600}
.uq p.check{margin:.15em 0;padding-left:1.2em;text-indent:-1.2em}
@media (max-width:36em){.mantine-Paper-root:has(#uq-answer),.mantine-Paper-root:has(#uq-answer) [style*="20em"]{
width:100%!important}}
.uq .rows{max-height:15em;overflow-y:auto;border:1px solid var(--mantine-color-default-border);border-radius:4px}
.uq table{border-collapse:collapse;width:100%;font-variant-numeric:tabular-nums}
.uq th{position:sticky;top:0;background:var(--mantine-color-body);font-weight:600}
.uq td,.uq th{padding:.1em .4em;text-align:right;white-space:nowrap}.uq td:last-child,.uq th:last-child{text-align:left}
.uq tr[onclick]{cursor:pointer}.uq tr[onclick]:hover{background:var(--mantine-color-default-hover)}
.uq tr.chosen{background:var(--mantine-primary-color-light)}.uq tr.out{text-decoration:line-through;opacity:.65}
.uq svg{width:100%;height:auto;display:block}.uq svg text{fill:var(--mantine-color-dimmed);font-size:11px}
</style>""")
_MARKS = {"ok": "✓", "caution": "!", "failed": "✗", "not run": "·"}


def summary(session: Session) -> str:
    """Return the answer: headline, verdict, what is included, checks, what the last pose brought, the curve."""
    answer = session.answer
    parts = [STYLE, Markup('<div class="uq" id="uq-answer" data-poses="{}">').format(answer.n)]
    result = answer.result
    if session.problem:
        parts.append(_line(f"Waiting: {session.problem}", "failed"))
    parts += [_line(note, "failed") for note in session.notes]
    if result is None:
        parts += [
            _line(line, "big" if k == 0 else "")
            for k, line in enumerate(answer.lines if answer.n else (_begin(session),))
        ]
    else:
        parts.append(_line(result.headline, f"big {status_of(result)}"))
        if answer.verdict is not None:
            text = str(answer.verdict) if result.usable else f"{answer.verdict.word}: X is not usable."
            parts.append(_line(text, f"verdict {STATUS_OF[answer.verdict.word]}"))
        parts += [_line(str(one), "failed") for one in result.cautions[:1] if one.severity == "failure"]
        parts += [_line(line) for line in _steps(session)]
        parts += [_item(*row) for row in checks_block(result).rows if row[0] in ("caution", "failed")]
        parts.append(curve(session.curve))
    return str(Markup("").join([*parts, Markup("</div>")]))


def of_result(result: Calibration) -> str:
    """Return the headline of a stored result."""
    head = _line(result.headline, f"big {status_of(result)}")
    return str(Markup('{}<div class="uq" id="uq-answer">{}</div>').format(STYLE, head))


def of_rig(result: RigCalibration) -> str:
    """Return the poses of a rig with the root mean square lengths of their errors."""
    row = Markup("<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>")
    rows = []
    for one in (*result.cameras.values(), *result.targets.values(), *list(result.arms.values())[1:], *result.pairs):
        turn, shift = one.sizes
        sizes = [digits(x, 2) if np.isfinite(x) else "open" for x in (1e3 * shift, float(np.degrees(turn)))]
        rows.append(row.format(one.frame, *sizes, one.count or ""))
    head = Markup("<tr><th>pose</th><th>mm</th><th>deg</th><th>views</th></tr>")
    lines = [
        _line(repr(result.rig).removeprefix("Rig(").removesuffix(")"), "big"),
        Markup("<table>{}{}</table>").format(head, Markup("").join(rows)),
    ]
    lines += [_line(text, "caution") for text in result.warnings]
    return str(Markup("").join([STYLE, Markup('<div class="uq" id="uq-answer">'), *lines, Markup("</div>")]))


def of_point(point: Array, covariance: Array | None, text: str) -> str:
    """Return where a point is (m, base frame) and how well it is known (3, 3)."""
    parts = [_line("Point in the base: " + ", ".join(f"{1e3 * x:.1f}" for x in point.tolist()) + " mm", "big")]
    if covariance is not None:
        if np.isfinite(covariance).all():
            each = ", ".join(f"{1e3 * sd:.2f}" for sd in np.sqrt(np.diag(covariance)).tolist())
            worst = digits(1e3 * float(np.sqrt(np.linalg.eigvalsh(covariance)[-1])), 2)
            parts.append(_line(f"1 sigma x, y, z: {each} mm; worst direction {worst} mm."))
        else:
            parts.append(_line("Not determined by these poses.", "failed"))
    return str(Markup('<div class="uq" id="uq-point">{}{}</div>').format(Markup("").join(parts), _line(text, "dim")))


def covered(result: Calibration | None) -> str:
    """Return the checks, and what the accuracy includes and what not."""
    if result is None:
        return ""
    parts = [_item(*row) for row in checks_block(result).rows]
    if result.accuracy is not None and result.usable:
        parts.append(_line(f"Includes {', '.join(result.accuracy.included)}.", "dim"))
        if result.accuracy.not_included:
            parts.append(_line(f"Not included: {', '.join(result.accuracy.not_included)}.", "dim"))
    return str(Markup('<div class="uq">{}</div>').format(Markup("").join(parts)))


def _item(status: str, name: str, text: str) -> Markup:
    """Return one check, with its mark and colour."""
    kind = status.replace(" ", "-")
    return Markup('<p class="check {}"><b>{} {}</b> {}</p>').format(kind, _MARKS[status], name, text)


def _begin(session: Session) -> str:
    return f"No poses yet in {session.folder.path.name or session.folder.path}. {words(session.answer)}"


def _steps(session: Session) -> list[str]:
    """Return what the last pose brought, and what comes next."""
    answer, lines = session.answer, []
    kept = answer.n - len(answer.left_out)
    brought = session.brought()
    if brought is not None and np.isfinite(brought).all():
        before, after = (digits(1e3 * size, 2) for size in brought)
        lines.append(f"{kept} poses. The last one: from {before} to {after} mm at the target.")
    else:
        lines.append(f"{kept} poses.")
    new = answer.n - 1
    found = None if answer.result is None else answer.result.table
    if found is not None and new < len(found) and found.flag[new] not in ("kept", "excluded"):
        lines.append(f"The last pose, {new}, contradicts the others: {found.status(new)}. Look at it, or leave it out.")
    return list(filter(None, [*lines, *answer.lines[1:], words(answer)]))


def preformatted(text: str) -> str:
    """Return text of several lines as it is."""
    return str(Markup('<div class="uq"><pre style="white-space:pre-wrap;margin:0">{}</pre></div>').format(text))


def table(session: Session, selected: int | None, target: str) -> str:
    """Return the poses as a table; a click on a row writes its number into the field of the id ``target``."""
    answer = session.answer
    found = None if answer.result is None else answer.result.table
    rows = []
    for k in range(min(answer.n, MOST_ROWS)):
        out = k in answer.left_out
        size = ("", "") if found is None else _residual(found, k)
        state = "left out" if out else "" if found is None or found.flag[k] == "kept" else found.status(k)
        kind = " ".join(filter(None, ["chosen" if k == selected else "", "out" if out else "",
                                      "failed" if state and not out else ""]))  # fmt: skip
        row = '<tr class="{}" data-pose="{}" onclick="{}"><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>'
        rows.append(Markup(row).format(kind, k, _click(target, k), k, *size, state))
    head = "<tr><th>pose</th><th>mm</th><th>deg</th><th>residual</th></tr>"
    more = _line(f"The first {MOST_ROWS} of {answer.n} poses.", "dim") if answer.n > MOST_ROWS else ""
    body = Markup('<div class="rows" id="uq-poses"><table>{}{}</table></div>').format(
        Markup(head), Markup("").join(rows)
    )
    return str(Markup('<div class="uq">{}{}{}</div>').format(body, more, _reason(answer, selected)))


def _residual(found: PoseTable, k: int) -> tuple[str, str]:
    return f"{1e3 * found.translation[k]:.2f}", f"{np.degrees(found.rotation[k]):.3f}"


def _reason(answer: Answer, selected: int | None) -> Markup:
    """Return what is known of the selected pose."""
    found = None if answer.result is None else answer.result.table
    if selected is None or found is None or selected >= len(found):
        return Markup("")
    move, turn = _residual(found, selected)
    text = (
        f"Pose {selected}: {move} mm and {turn} deg from where the others predict it; d² = "
        f"{digits(float(found.distance2[selected]), 2)}, a good pose stays below {digits(found.limit, 3)}."
    )
    return _line(text, "" if found.flag[selected] in ("kept", "excluded") else "failed")


def _click(target: str, k: int) -> str:
    """Return the handler of a row: it types the number of the pose into a field of the page."""
    identity = "".join(part for part in target if part.isalnum() or part in "-_")
    return (
        f"var e=document.getElementById('{identity}');"
        "Object.getOwnPropertyDescriptor(HTMLInputElement.prototype,'value').set"
        f".call(e,'{int(k)}');e.dispatchEvent(new Event('input',{{bubbles:true}}))"
    )


def curve(points: Sequence[tuple[int, float]]) -> Markup:
    """Return the accuracy over the number of poses as a small figure (log scale, mm); nothing for fewer than two."""
    if len(points) < 2:
        return Markup("")
    n, size = np.array(points).T
    size = 1e3 * size
    low, high = np.log10(size.min()) - 0.05, np.log10(size.max()) + 0.05
    first, last = min(float(n[0]), FEWEST), float(n[-1])
    x = 44 + 246 * (n - first) / max(last - first, 1.0)
    y = 88 - 76 * (np.log10(size) - low) / (high - low)
    line = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    texts = [(40, 18, "end", f"{digits(float(size.max()), 2)}"), (40, 88, "end", f"{digits(float(size.min()), 2)}"),
             (44, 108, "start", f"{first:.0f}"), (290, 108, "end", f"{last:.0f}"),
             (167, 108, "middle", "poses; mm (1 sigma) at the target")]  # fmt: skip
    words = Markup("").join(Markup('<text x="{}" y="{}" text-anchor="{}">{}</text>').format(*text) for text in texts)
    return Markup(
        '<svg viewBox="0 0 300 114" role="img">'
        '<path d="M44 10V92H292" fill="none" stroke="currentColor" opacity=".35"/>'
        '<polyline points="{}" fill="none" stroke="#0072b2" stroke-width="2"/>'
        '<circle cx="{:.1f}" cy="{:.1f}" r="3.5" fill="#0072b2"/>{}</svg>'
    ).format(line, x[-1], y[-1], words)


def _line(text: str, kind: str = "") -> Markup:
    return Markup('<p class="{}">{}</p>').format(kind, escape(text))
