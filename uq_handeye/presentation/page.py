"""A page: its blocks rendered by the template."""

from __future__ import annotations

import base64
import hashlib
import re
from importlib import resources

from markupsafe import Markup

from .._version import __version__
from .document import Drawing, Section
from .figure_parts import Picture, inline_svg

# Later rules go before earlier ones.
STYLES = ("report.css", "figures.css")


def pretty(text: str) -> str:
    """Signs of print for those of a terminal: d², ±, a true minus before a number."""
    text = text.replace("`", "").replace("d^2", "d²").replace("deg^2", "deg²").replace("mm^2", "mm²").replace("+-", "±")
    return re.sub(r"(?<![\w.)\]-])-(?=\d)", "\N{MINUS SIGN}", text)


def rendered(heading: str, subject: str, facts: list[str], sections: list[Section]) -> str:
    """One page as HTML text; the section with the anchor ``answer`` comes first."""
    from jinja2 import Environment, StrictUndefined

    files = resources.files(__package__)
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["pretty"] = pretty
    template = environment.from_string((files / "template.html.j2").read_text(encoding="utf-8"))
    scripts = [_SCRIPT.strip()]
    if any(isinstance(block, Drawing) and block.scene for section in sections for block in section.blocks):
        scripts.append((files / "turn.js").read_text(encoding="utf-8").strip())
    return template.render(
        heading=heading,
        subject=subject,
        facts=facts,
        sections=sections,
        style=Markup("".join((files / name).read_text(encoding="utf-8") for name in STYLES)),
        scripts=[Markup(script) for script in scripts],
        script_hashes=[base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in scripts],
        version=__version__,
    )


def drawing(stem: str, picture: Picture) -> Drawing:
    """The picture as a block of a page."""
    return Drawing(stem, Markup(inline_svg(picture.figure, stem)), picture.alt, picture.caption, Markup(picture.scene))


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
