"""Configuration of the documentation.

    python -m sphinx -W --keep-going -b html docs build/docs

Neither the build nor the pages need the network: formulas become MathML (`_ext/mathml.py`), theme and fonts come from
the installed packages, and there is no intersphinx.
"""

import re
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

from docutils import nodes

import uq_handeye

project = "uq-handeye"
author = "The uq-handeye developers"
copyright = author
release = version = uq_handeye.__version__

extensions = [
    "commands",
    "fields",
    "mathml",
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["_ext", "figures/*.py", "studies/*/*.md"]  # the last are included by the pages of the studies
myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
smartquotes = False  # "--units" stays as it is typed
default_role = "code"  # docstrings write names in single backticks

autodoc_typehints = "none"  # the docstrings say types and shapes in words
autodoc_member_order = "bysource"
# Words of a parameter's type that are names of attributes too; sample files in languages that Pygments does not know.
suppress_warnings = ["ref.python", "misc.highlighting_failure"]
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
toc_object_entries_show_parents = "hide"
copybutton_exclude = ".linenos, .gp, .go"
copybutton_selector = "div.command pre, div.highlight-python pre, div.highlight-bash pre, div.highlight-py pre"

html_theme = "pydata_sphinx_theme"
html_title = "uq-handeye"
html_static_path = ["_static"]
html_css_files = ["style.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_search_summary = False  # they are fetched, which a browser refuses for files on disk
html_show_sourcelink = False
html_context = {"default_mode": "auto"}
html_sidebars = {"index": []}
html_theme_options = {
    "show_nav_level": 2,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}


COLON = "\ue000"  # of no alphabet


def readable(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings as reStructuredText.

    They write |t| and log_scale_..., characters that would be read as markup; and prose after a list of parameters,
    which napoleon would read as more parameters: it becomes a section of notes. In the first line of a property
    it would take what stands before a colon for a type: `colons` puts the colon back afterwards.
    """
    if what in ("property", "attribute", "data") and lines:
        lines[0] = lines[0].replace(":", COLON)
    found: list[str] = []
    in_list = False
    for k, line in enumerate(lines):
        parts = re.split(r"(`+[^`]*`+)", line)
        parts[::2] = [re.sub(r"\||(?<=\w)_(?!\w)", lambda match: "\\" + match.group(), part) for part in parts[::2]]
        following = lines[k + 1] if k + 1 < len(lines) else ""
        starts = bool(line) and not line.startswith(" ") and k > 0 and not lines[k - 1]
        if following and set(following) == {"-"}:
            in_list = line in ("Parameters", "Attributes", "Raises", "Returns", "Warns")
        elif in_list and starts and " : " not in line and not following.startswith(" "):
            found += ["Notes", "-----"]
            in_list = False
        found.append("".join(parts))
    lines[:] = found


def colons(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """The colons that `readable` hid from napoleon."""
    lines[:] = [line.replace(COLON, ":") for line in lines]


def mark_commands(app: Any, document: nodes.document) -> None:
    """Blocks of commands look other than what they print, and only they can be copied."""
    for block in document.findall(nodes.literal_block):
        if block.get("language") == "text" and block.astext().startswith("uq-handeye "):
            block["classes"].append("command")


def setup(app: Any) -> None:
    app.connect("doctree-read", mark_commands)
    app.connect("autodoc-process-docstring", readable, priority=100)  # before napoleon
    app.connect("autodoc-process-docstring", colons, priority=900)  # after it
