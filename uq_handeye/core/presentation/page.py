"""A page: its blocks rendered by the template."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from importlib import resources

from markupsafe import Markup

from ..._version import __version__
from .document import Drawing, Section
from .figure_parts import Picture, inline_svg
from .html import PAGE, section_html

# Later rules go before earlier ones. By the kind of page.
STYLES = {"report": ("report.css", "figures.css"), "certificate": ("report.css", "certificate.css")}


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
        if any(isinstance(block, Drawing) and block.scene for section in every for block in section.blocks):
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
