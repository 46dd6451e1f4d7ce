"""Options of a command or of a group of them, declared in its docstring.

A parameter of a function, or a field of a dataclass, has its type and default where Python has them; what its option
takes and says stands in the docstring:

    Options (Pose files):
      * --pair HOW <PAIRINGS>: Pairing: rows, time or async. More text,
        which may go on below.
      --exclude POSES: Poses to exclude.
      as_json = --json: Print the result as one JSON object.

The heading names the group of the help, if there is one. ``*`` marks options that the short help shows. Behind the
names stands what the option takes, nothing for a flag; then, in ``<>``, the names that the shell completes: a constant
of the module or of `options.common`, or words with ``|`` between them. ``{PAIRINGS}`` in the text lists a constant.
The parameter of an option is the one of its name, or the one in front of ``=``.

Groups of options in the help: their names, their order, and the options of each that the short help shows.
"""

import inspect
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Annotated, Any

import typer

ARGUMENTS = "Arguments"
PICTURES = "Pictures of a board"
POSE_FILES = "Pose files"
VIEWS = "Camera poses from other programs"
JOINTS = "Robot joints"
CAMERA_MODEL = "Camera model"
NOISE = "Noise"
SHARED = "Shared errors"
PRIOR = "Prior knowledge"
ESTIMATION = "Estimation"
OPTIONS = "Options"  # of options that name no group
OUTPUT = "Output"
MESSAGES = "Messages"

# Order in the help; a command's own groups stand where OPTIONS does.
_BEFORE = (ARGUMENTS, PICTURES, POSE_FILES, VIEWS, JOINTS, CAMERA_MODEL, NOISE, SHARED, PRIOR, ESTIMATION)
_AFTER = (OUTPUT, MESSAGES)

# Groups that the short help shows under the heading of another one, to save lines.
SHOWN_UNDER = {VIEWS: PICTURES, JOINTS: POSE_FILES, SHARED: NOISE, MESSAGES: OUTPUT}


class Group(str):
    """Name of a group of options; ``common`` if the short help shows the option that bears it."""

    common = False


def common_in(group: str | None) -> Group:
    """Return ``group`` as that of an option that the short help shows."""
    marked = Group(group or OPTIONS)
    marked.common = True
    return marked


def position(group: str) -> int:
    """Return the place of a group in the order of the help."""
    if group in _AFTER:
        return len(_BEFORE) + 1 + _AFTER.index(group)
    return _BEFORE.index(group) if group in _BEFORE else len(_BEFORE)


_HEADING = re.compile(r"\n\n(?=Options(?: \(.+\))?:\n)")
_GROUP = re.compile(r"Options(?: \((.+)\))?:\n")
_ENTRY = re.compile(r"(\* )?(?:(\w+) = )?(-[\w/-]+(?:, -[\w-]+)*)(?: ([^\s<][^\s]*))?(?: <([^>]+)>)?: (.+)")


def parameters_of(maker: Callable[..., Any]) -> list[inspect.Parameter]:
    """Return the parameters of a function or class, each with its option where the docstring declares it."""
    docs = [base.__doc__ for base in reversed(maker.__mro__)] if isinstance(maker, type) else [maker.__doc__]
    names = {**vars(sys.modules[f"{__package__}.common"]), **vars(sys.modules[maker.__module__])}
    declared = {key: made for doc in docs for key, made in _declared(doc or "", names)}
    found = list(inspect.signature(maker).parameters.values())
    if unknown := declared.keys() - {parameter.name for parameter in found}:
        raise TypeError(f"{maker.__name__} has no parameter {', '.join(sorted(unknown))}, which its docstring declares")
    return [p.replace(annotation=Annotated[p.annotation, declared[p.name]]) if p.name in declared else p for p in found]


def without_options(doc: str | None) -> str:
    """Return a docstring without the options that it declares."""
    return _HEADING.split(inspect.cleandoc(doc or ""))[0]


def choices(names: Sequence[str]) -> Callable[[str], list[str]]:
    """Return the completion of one of ``names``, also as the last of a list with commas."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [f"{before}{comma}{name}" for name in names if name.startswith(last)]

    return complete


def _declared(doc: str, names: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the name of the parameter and the option of each entry."""
    for section in _HEADING.split(inspect.cleandoc(doc))[1:]:
        heading = _GROUP.match(section)
        assert heading is not None
        for entry in re.split(r"\n  (?=\S)", "\n" + section[heading.end() :].rstrip())[1:]:
            match = _ENTRY.fullmatch(" ".join(entry.split()))
            if match is None:
                raise TypeError(f"expected an option such as '--exclude POSES: Poses to exclude.', got {entry!r}")
            star, key, flags, takes, completed, text = match.groups()
            flags = flags.split(", ")
            made = typer.Option(
                *flags,
                help=re.sub(r"\{(\w+)\}", lambda name: ", ".join(names[name[1]]), text),
                metavar=takes or "",
                rich_help_panel=common_in(heading[1]) if star else heading[1],
                autocompletion=None if completed is None else choices(names.get(completed) or completed.split("|")),
            )
            yield key or max(flags, key=len).split("/")[0].lstrip("-").replace("-", "_"), made
