"""The title block of a report: cell, robot, camera, serial numbers, target, operator, date of the data and a note.

The result file keeps these texts under ``about``; a TOML file or ``KEY=VALUE`` on the command line gives them.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Mapping
from pathlib import Path

from ...errors import InputError
from .open import as_path, shown

# Keys and what the report calls them, in its order.
ABOUT = {
    "cell": "Cell",
    "robot": "Robot",
    "robot_serial": "Robot serial number",
    "camera": "Camera",
    "camera_serial": "Camera serial number",
    "target": "Target",
    "operator": "Operator",
    "date": "Date of the data",
    "environment": "Temperature, load",
    "reference": "Reference standard",
    "organisation": "Organisation",
    "number": "Certificate number",
    "note": "Note",
}
# Keys that only the certificate shows.
OF_CERTIFICATE = ("environment", "reference", "organisation", "number")
# Longest value of the title block, and longest note.
MAX_VALUE_CHARACTERS, MAX_NOTE_CHARACTERS = 80, 300


def as_about(values: Mapping[str, str | int | datetime.date | datetime.time], where: str = "about") -> dict[str, str]:
    """Return the texts of a title block in the order of the report, without those that are empty.

    Parameters
    ----------
    values : mapping
        Text, whole numbers or dates by the names in `ABOUT`.
    where : str
        What messages call it.

    Raises
    ------
    InputError
        Another name, another type, control characters, or more characters than fit.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"Expected {where} to be a mapping of names to text, got {type(values).__name__}.")
    for name in values:
        if name not in ABOUT:
            raise InputError(f"Unknown name {str(name)[:40]!r} in {where}: use {', '.join(ABOUT)}.")
    found = {name: _text(values[name], name, where) for name in ABOUT if name in values}
    return {name: text for name, text in found.items() if text}


def read_about(texts: Iterable[str]) -> dict[str, str]:
    """Return the title block of ``KEY=VALUE`` texts and paths of TOML files; later ones replace earlier ones."""
    found: dict[str, str] = {}
    for text in texts:
        name, separator, value = text.partition("=")
        if separator and not Path(text).is_file():
            found = found | {name.strip(): ""} | as_about({name.strip(): value}, "--about")
        else:
            from .trees import parse_toml  # NumPy is slow to import

            path = as_path(text)
            found |= as_about(parse_toml(path), shown(path))
    return as_about(found)


def _text(value: str | int | datetime.date | datetime.time, name: str, where: str) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | datetime.date | datetime.time):
        raise InputError(f"Expected {name} in {where} to be text, got {type(value).__name__}.")
    text = " ".join(str(value).split())
    most = MAX_NOTE_CHARACTERS if name == "note" else MAX_VALUE_CHARACTERS
    if len(text) > most:
        raise InputError(f"Expected {name} in {where} to have at most {most} characters, got {len(text)}.")
    if not text.isprintable():
        raise InputError(f"Expected {name} in {where} to be printable text, got {text[:40]!a}.")
    return text
