"""Checks of the values of options: names with a suggestion, lengths, coordinates, and files to be written."""

import difflib
import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import typer

from ..core.files.lines import floats
from ..core.limits import MAX_PLAIN_LENGTH_M
from ..errors import InputError


def one_of(value: str, option: str, names: Sequence[str]) -> str:
    """Return ``value`` in lower case if it is one of ``names``; else raise an `InputError` that names the nearest."""
    if value.lower() in names:
        return value.lower()
    raise InputError(f"Expected {option} to be one of {', '.join(names)}, got {value!r}.{did_you_mean(value, names)}")


def did_you_mean(value: str, names: Iterable[str]) -> str:
    """Return `` Did you mean park?``, or nothing if no name is near."""
    near = difflib.get_close_matches(value.lower(), names, n=1)
    return f" Did you mean {near[0]}?" if near else ""


def methods_of(text: str, option: str, known: Sequence[str], most: int | None = None) -> list[str]:
    """Return the methods of a list with commas, each once, in lower case."""
    parts = [part.strip() for part in text.split(",") if part.strip()]
    names = list(dict.fromkeys(part.lower() for part in parts))
    wrong = next((part for part in parts if part.lower() not in known), None)
    if wrong is not None or not names or (most and len(names) > most):
        what = "one method" if most == 1 else "methods"
        got = text if wrong is None else wrong
        raise InputError(
            f"Expected {option} to name {what} among {', '.join(known)}, got {got!r}.{did_you_mean(got, known)}"
        )
    return names


def named_folder(directory: Path | None) -> Path | None:
    """Return a folder that can be written; raise `InputError` before the work otherwise, also for an empty name."""
    if directory is None:
        return None
    if str(directory) == ".":
        raise InputError("Expected -o to name a folder, got an empty name or '.'. Write, for example, -o result.")
    from ..core.files.atomic import require_writable_folder

    require_writable_folder(directory)
    return directory


@contextmanager
def naming_option(option: str) -> Iterator[None]:
    """Put the name of an option before the message of an `InputError`."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{option}: {error}") from None


def metres(text: str, option: str) -> float:
    """Return a length in metres, of a number with or without a unit."""
    from ..core.presentation.units import parse_length

    found = floats([text])
    return parse_length(text, option) if found is None else found[0]


def coordinates(text: str, name: str) -> list[float]:
    """Return the three lengths (m) of an option such as ``0mm,0mm,300mm``."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 3:
        raise InputError(f"Expected {name} to be X,Y,Z such as 0mm,0mm,300mm, got {text!r}.")
    values = [metres(part, name) for part in parts]
    if not (far := max(map(abs, values))) <= MAX_PLAIN_LENGTH_M or not all(map(math.isfinite, values)):
        raise InputError(f"{name} {text}: {far:g} m is too far. Write the unit, e.g. 0mm,0mm,300mm.")
    return values


def fraction(value: float) -> float:
    """Return a number from 0 to 1."""
    if not 0.0 <= value <= 1.0:
        raise typer.BadParameter(f"{value:g} is not in the range 0<=x<=1.")
    return value


def require_writable(path: Path | None, option: str, suffixes: Sequence[str] = ()) -> None:
    """Raise `InputError`, before the work, unless a file of that name can be written."""
    if path is None:
        return
    if suffixes and path.suffix.lower() not in suffixes:
        raise InputError(f"Expected {option} to be named {' or '.join(suffixes)}, got {str(path)!r}.")
    from ..core.files.atomic import require_writable_file

    require_writable_file(path)


def by_names(text: str | None, names: Sequence[str], option: str) -> dict[str, str]:
    """Return the values of an option by the names of cameras, targets or arms.

    ``VALUE`` is for all of them (the name ""), ``NAME:VALUE`` for one; several with semicolons between.

    >>> by_names("left:0.1%;0.2%", ["left", "right"], "--target-scale-sd")
    {'left': '0.1%', '': '0.2%'}
    """
    found: dict[str, str] = {}
    for part in [] if text is None else text.split(";"):
        name, colon, value = part.partition(":")
        name, value = (name.strip(), value.strip()) if colon and name.strip() in names else ("", part.strip())
        if colon and not name and part.partition(":")[0].strip().isidentifier():
            raise InputError(
                f"{option} {text}: names {part.partition(':')[0].strip()!r}, which is none of {', '.join(names)}."
            )
        if name in found or not value:
            raise InputError(f"Expected {option} to be VALUE or NAME:VALUE, one for each name, got {text!r}.")
        found[name] = value
    return found
