"""A page: its blocks rendered by the template, as one HTML file, or as PDF.

A PDF is printed by WeasyPrint where it is installed, else by a Chromium browser: the same HTML with its print style.
WeasyPrint also writes the page numbers of the contents.
"""

from __future__ import annotations

import base64
import hashlib
import logging
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from importlib import resources
from pathlib import Path
from types import ModuleType
from typing import Any

from markupsafe import Markup

from ..._version import __version__
from ...errors import InputError, MissingExtraError
from ..files.atomic import require_writable_file, write_atomically
from ..limits import MAX_WAIT_S
from .document import Drawing, Section
from .figure_parts import Picture, inline_svg
from .html import PAGE, section_html

# Later rules go before earlier ones. By the kind of page.
STYLES = {"report": ("report.css", "figures.css"), "certificate": ("report.css", "certificate.css")}

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
# Nothing from the network, no first-run pages, no state that stays. Without its sandbox it also runs in a container and
# as root; what it opens is the report alone, whose policy forbids every request and every script but its own.
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
)
PAPERS = ("a4", "letter")


@dataclass(frozen=True)
class Page:
    """One page; the section with the anchor ``answer`` comes first.

    Parameters
    ----------
    heading, subject : str
        The title.
    facts : list of str
        A line below it.
    sections : sequence of Section
        What the contents list; those that are ``folded`` are closed, and printed where they are open.
    sheets : sequence of sequences of Section
        Printed pages before the contents, each with its sections.
    fields : sequence of (name, text)
        Title block. A field without text is room to write on paper, and not shown on the screen.
    foot : str
        Last line of the last sheet.
    signed : int
        Sheet, from 1, that ends with room for name, date and signature; 0: none.
    full : bool
        Open all that is folded.
    kind : str
        "report" or "certificate", which is denser in print.
    """

    heading: str
    subject: str
    facts: Sequence[str]
    sections: Sequence[Section]
    sheets: Sequence[Sequence[Section]] = ()
    fields: Sequence[tuple[str, str]] = ()
    foot: str = ""
    signed: int = 1
    full: bool = False
    kind: str = "report"

    def html(self) -> str:
        """Return the page as HTML text."""
        from jinja2 import Environment, StrictUndefined

        files = resources.files(__package__)
        environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
        look = replace(PAGE, tag="Caution" if self.sheets else "Warning")
        template = environment.from_string((files / "template.html.j2").read_text(encoding="utf-8"))
        scripts = [_SCRIPT.strip()]
        every = [section for page in (*self.sheets, self.sections) for section in page]
        if any(getattr(block, "scene", "") for section in every for block in section.blocks):
            scripts.append((files / "turn.js").read_text(encoding="utf-8").strip())
        return template.render(
            {field.name: getattr(self, field.name) for field in fields(self)},
            content=lambda section: section_html(section, look, lead=not self.sheets and section.anchor == "answer"),
            style=Markup("".join((files / name).read_text(encoding="utf-8") for name in STYLES[self.kind])),
            scripts=[Markup(script) for script in scripts],
            script_hashes=[base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts],
            version=__version__,
        )


def drawing(stem: str, picture: Picture, small: bool = False) -> Drawing:
    """The picture as a block of a page."""
    svg = Markup(inline_svg(picture.figure, stem))
    return Drawing(stem, svg, picture.alt, picture.caption, Markup(picture.scene), small)


# Shows the buttons, which do nothing without it: copies (the old way where a browser has no clipboard for files), opens
# the section that a link leads to, and opens all sections for print.
_SCRIPT = """
var folded = document.querySelectorAll("section.folded > details");
function openTarget() {
  var target = location.hash.length > 1 && document.getElementById(location.hash.slice(1));
  var details = target && target.querySelector(":scope > details");
  if (details) { details.open = true; target.scrollIntoView(); }
}
window.addEventListener("hashchange", openTarget);
openTarget();
document.querySelectorAll("button.print").forEach(function (button) {
  button.hidden = false;
  button.addEventListener("click", function () {
    var closed = Array.from(folded).filter(function (details) { return !details.open; });
    closed.forEach(function (details) { details.open = true; });
    document.documentElement.classList.add("full");
    window.addEventListener("afterprint", function () {
      document.documentElement.classList.remove("full");
      closed.forEach(function (details) { details.open = false; });
    }, { once: true });
    window.print();
  });
});
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


def page_path(path: str | Path, paper: str, suffixes: Sequence[str] = (".html", ".pdf")) -> Path:
    """Return the path of a page that can be written; raises `InputError` for another suffix or paper."""
    found = Path(path)
    if found.suffix.lower() not in suffixes:
        listed = (" or " if len(suffixes) == 2 else ", ").join(suffixes)
        raise InputError(f"Expected `path` to end in {listed}, got {found.name!r}.")
    if paper not in PAPERS:
        raise InputError(f"Expected `paper` to be {' or '.join(PAPERS)}, got {paper!r}.")
    require_writable_file(found)
    return found


def write_page(path: Path, html: str, paper: str) -> Path:
    """Write a page as its suffix says, whole or not at all."""
    write_atomically(path, html if path.suffix.lower() == ".html" else to_pdf(html, paper))
    return path


def to_pdf(html: str, paper: str = PAPERS[0]) -> bytes:
    """Print a self-contained HTML text on paper of one of `PAPERS`.

    Raises
    ------
    MissingExtraError
        Neither WeasyPrint nor a browser is installed.
    InputError
        The browser did not print.
    """
    html = html.replace("</style>", f"@page {{ size: {paper}; }}\n</style>", 1)
    if (printer := find_weasyprint()) is not None:
        return _by_weasyprint(html, printer)
    if (browser := find_browser()) is not None:
        return _by_browser(html, browser)
    raise MissingExtraError(
        "A report as PDF needs WeasyPrint (in the clone: pip install '.[pdf]') or an installed Chromium or "
        "Chrome; or write a .html file and print it from any browser."
    )


def find_browser() -> str | None:
    """The path of a Chromium browser, if there is one."""
    return next((path for name in BROWSERS if (path := shutil.which(name)) is not None), None)


def find_weasyprint() -> ModuleType | None:
    """The package, or None where it or the libraries that it needs (Pango) are not installed."""
    try:
        import weasyprint  # type: ignore[import-untyped]
    except (ImportError, OSError):
        return None
    found: ModuleType = weasyprint
    return found


def _by_weasyprint(html: str, weasyprint: ModuleType) -> bytes:
    with _silent("weasyprint", "fontTools"):  # it warns of style that is for screens alone
        return bytes(weasyprint.HTML(string=html, base_url=None, url_fetcher=_refuse).write_pdf())


@contextmanager
def _silent(*names: str) -> Iterator[None]:
    """Loggers that say nothing below an error, as long as it lasts."""
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _refuse(url: str, *_: Any, **__: Any) -> Any:
    raise ValueError(f"the report loads nothing, got {url[:80]!r}")


def _by_browser(html: str, browser: str) -> bytes:
    with tempfile.TemporaryDirectory(prefix="uq-handeye-", ignore_cleanup_errors=True) as folder:
        page, pdf = Path(folder, "report.html"), Path(folder, "report.pdf")
        page.write_text(html, encoding="utf-8")
        command = [
            browser, *FLAGS, f"--user-data-dir={folder}/profile", "--no-pdf-header-footer", f"--print-to-pdf={pdf}",
            page.as_uri(),
        ]  # fmt: skip
        try:
            subprocess.run(command, capture_output=True, timeout=MAX_WAIT_S, check=True)
            return pdf.read_bytes()
        except (OSError, subprocess.SubprocessError) as error:
            reason = getattr(error, "strerror", None) or type(error).__name__
            raise InputError(
                f"{Path(browser).name} did not print the report ({reason}): write a .html file and print it, or "
                "install WeasyPrint (in the clone of uq-handeye: pip install '.[pdf]')."
            ) from error
