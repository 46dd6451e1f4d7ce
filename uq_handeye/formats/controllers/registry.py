"""Registry of the controller formats: how each is recognised by its first lines, and read as program or table."""

from __future__ import annotations

import re
from functools import lru_cache

from ...core.files.lines import floats
from ...core.files.trees import is_json
from ...core.limits import HEAD_BYTES
from ..columns import seconds_of
from ..contents import COLUMNS, Contents
from ..csv_poses import is_csv_header
from ..number_table import number_of
from ..tum_poses import names_order
from .abb import has_lists
from .forms import CONTROLLERS
from .labelled import is_labelled, read_labelled
from .programs import PROGRAMS, read_program
from .tables import read_pose_table, table_kind

# The comment above what `export` and `plan` write.
_WRITTEN = re.compile(r"# .{0,100}, as (.{1,40}?) writes (?:it|them)\b")
# What a text of another format begins with.
_OTHERS = ("%YAML", "---", '<?xml version="1.0"?>\n<opencv')


@lru_cache(maxsize=4)
def kind_of(head: str) -> str | None:
    """Return the format of a text by its beginning, or None."""
    for name, program in PROGRAMS.items():
        if program.recognises(head):
            return name
    first = head.lstrip().partition("\n")[0].rstrip()
    if first.startswith("{") and (not first.endswith("}") or is_json(head)):  # JSON
        return None
    if has_lists(head):
        return "table"
    if "<RIst" in head:  # what the robot sensor interface of KUKA sends
        return "kuka"
    if head.lstrip().startswith(("<", *_OTHERS)):
        return "table" if is_labelled(head) else None
    for line in head.split("\n", 40)[:40]:
        content = line.strip()
        if not content:
            continue
        if is_csv_header(content.lstrip("# \t")):
            if _below(content, head):
                break
            return None
        if content.startswith("#"):
            continue
        words = content.split()
        if len(words) == len(COLUMNS) and (floats(words) is not None or names_order(words)):
            return None  # TUM
        break
    return _own(head) or table_kind(head) or ("table" if is_labelled(head) else None)


def _own(head: str) -> str | None:
    """Return the maker that the first line of an export names."""
    said = _WRITTEN.match(head)
    return None if said is None else next((form.name for form in CONTROLLERS.values() if form.maker == said[1]), None)


def _below(names: str, head: str) -> bool:
    """Return whether the rows below the names are no CSV: dates, of which a table makes seconds; other separators."""
    lines = [line for line in head.split("\n", 60)[:60] if line.strip() and not line.startswith("#")]
    if names.startswith("#") and "," in names and lines and not re.search("[,;\t]", lines[0]):
        return True
    fields = re.split(r"[,;\t]", lines[1] if len(lines) > 1 else "")
    return any(number_of(field) is None and seconds_of(field) is not None for field in fields)


def read_controller(format: str, text: str, name: str) -> Contents:
    """Return the poses of a text in the format of a maker: a program of theirs, or a table of numbers."""
    if format in PROGRAMS and (PROGRAMS[format].recognises(text) or PROGRAMS[format].loose(text)):
        return read_program(format, text, name)
    if format == "table" and has_lists(text):
        return read_program("abb", text, name, sure=False)
    if table_kind(text[:HEAD_BYTES]) is None and is_labelled(text[:HEAD_BYTES]):
        return read_labelled(text, name)
    return read_pose_table(text, name, CONTROLLERS.get(format))
