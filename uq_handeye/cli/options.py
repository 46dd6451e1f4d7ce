"""Options that several commands share: groups of them, their types, how they are read, and how output is printed.

Nothing heavy is imported here, so that help and completion are quick: names that the options complete are written down
once more, and a test holds them against the registries.
"""

import difflib
import inspect
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import InputError
from .messages import Messages, styled, terminal_width

if TYPE_CHECKING:
    from ..presentation.document import Document

# The names of likelihood.ESTIMATORS, METHODS, ROBOT_WORLD_METHODS, SETUPS, request.COVARIANCES and io.FORMATS.
AT_THE_BOUND = ("efficient", "ml")
PUBLISHED = (
    *("tsai", "shiu", "chou", "park", "horaud", "daniilidis", "andreff", "lu"),
    *("gwak", "heller", "condurache", "zhang", "zhao", "nguyen", "4dpa"),
)
ROBOT_WORLD = ("li", "shah")
# Of `calibrate` alone: the bundle adjustment on corners, request.BUNDLE.
BUNDLE = "bundle"
EVERY_METHOD = (*AT_THE_BOUND, *PUBLISHED, *ROBOT_WORLD)
SETUP_NAMES = ("eye-in-hand", "eye-to-hand")
COVARIANCE_NAMES = ("model", "sigma-points", "sandwich", "hac", "jackknife", "bootstrap")
FORMAT_NAMES = ("csv", "tum", "npz", "npy", "easy_handeye", "easy_handeye2", "moveit", "opencv", "json")
ROBOT_FRAMES = ("base_T_gripper", "gripper_T_base")
CAMERA_FRAMES = ("camera_T_target", "target_T_camera")
PAIRINGS = ("rows", "time", "async")
UNITS = ("m", "mm", "cm", "um", "in")

OUTPUT = "Output"


# ------------------------------------------------------------------------------------------- groups of options


def made_of(**makers: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Parameters of a command as the options that they are made of.

    ``@made_of(noise=noise_of)`` gives ``command(noise, seed)`` the options of ``noise_of`` and ``seed``: the values of
    the former go to ``noise_of``, and what it returns to the command. A class does as well as a function. Parameters
    that are made are annotated in quotes: Typer is not to see them.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        parts = {
            name: list(inspect.signature(makers[name]).parameters.values()) if name in makers else [parameter]
            for name, parameter in inspect.signature(command).parameters.items()
        }

        def run(**given: Any) -> Any:
            made = {name: maker(**{p.name: given.pop(p.name) for p in parts[name]}) for name, maker in makers.items()}
            return command(**made, **given)

        return _with_parameters(run, command, [parameter for part in parts.values() for parameter in part])

    return decorate


def with_messages(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options of `Messages` after those of a command; they hold before anything else is done."""
    parameters = inspect.signature(Messages).parameters

    def run(**given: Any) -> Any:
        Messages(**{name: given.pop(name) for name in parameters}).apply()
        return command(**given)

    return _with_parameters(run, command, [*inspect.signature(command).parameters.values(), *parameters.values()])


def _with_parameters(
    run: Callable[..., Any], command: Callable[..., Any], parameters: list[inspect.Parameter]
) -> Callable[..., Any]:
    """``run`` with the name and help of ``command``, and these parameters where Typer looks for them."""
    parameters = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters]
    run = wraps(command)(run)
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    return run


def choices(names: Sequence[str]) -> Callable[[str], list[str]]:
    """What a shell completes: one of ``names``, also as the last of a list with commas."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [f"{before}{comma}{name}" for name in names if name.startswith(last)]

    return complete


def one_of(value: str, option: str, names: Sequence[str]) -> str:
    """``value`` in small letters if it is one of ``names``; else an `InputError` that says which is nearest."""
    if value.lower() in names:
        return value.lower()
    raise InputError(f"Expected {option} to be one of {', '.join(names)}, got {value!r}.{did_you_mean(value, names)}")


def did_you_mean(value: str, names: Iterable[str]) -> str:
    """`` Did you mean park?``, or nothing if no name is near."""
    near = difflib.get_close_matches(value.lower(), names, n=1)
    return f" Did you mean {near[0]}?" if near else ""


def methods_of(text: str, option: str, known: Sequence[str], most: int | None = None) -> list[str]:
    """The methods of a list with commas, each once, in small letters or capitals."""
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


def option(*names: str, help: str, panel: str | None = None, of: Sequence[str] = (), metavar: str | None = None) -> Any:
    """A Typer option that takes text or a number; the shell completes the names ``of``."""
    completed = choices(of) if of else None
    return typer.Option(*names, help=help, metavar=metavar, rich_help_panel=panel, autocompletion=completed)


def flag(*names: str, help: str, panel: str | None = None) -> Any:
    """A Typer option without a value."""
    return typer.Option(*names, help=help, metavar="", rich_help_panel=panel)


# ------------------------------------------------------------------------------------------------------ output


def named_folder(directory: Path | None) -> Path | None:
    """An empty name would mean the current folder, and some cannot be written: said before the work, not after."""
    if directory is None:
        return None
    if str(directory) == ".":
        raise InputError("Expected -o to name a folder, got an empty name or '.'; write for example -o result.")
    from ..files.atomic import require_writable_folder

    require_writable_folder(directory)
    return directory


def folder_option(help: str) -> Any:
    """``-o DIR``."""
    return typer.Option(
        "-o", "--output", metavar="DIR", callback=named_folder, help=help, rich_help_panel=OUTPUT, show_default=False
    )


def require_writable(path: Path | None, option: str, suffixes: Sequence[str] = ()) -> None:
    """Raise `InputError`, before the work and not after, unless a file of that name can be written."""
    if path is None:
        return
    if suffixes and path.suffix.lower() not in suffixes:
        raise InputError(f"Expected {option} to be named {' or '.join(suffixes)}, got {str(path)!r}.")
    from ..files.atomic import require_writable_file

    require_writable_file(path)


PairsOption = Annotated[
    str,
    option(
        "--pairs",
        of=("all", "consecutive", "disjoint"),
        metavar="NAME",
        help="Which poses make a motion: all, consecutive or disjoint.",
    ),
]
JsonOption = Annotated[bool, flag("--json", panel=OUTPUT, help="Print one JSON object.")]
WorkersOption = Annotated[int | None, option("--workers", help="Processes. Left out: one per core.")]


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def emit_document(document: "Document") -> None:
    """Print a document, wrapped to the terminal and with its colours."""
    from ..presentation.document import to_text

    emit(to_text(document, terminal_width(), styled))


def emit(output: str) -> None:
    """Print; a reader that closes the pipe early (`| head`) has seen enough, which is no failure."""
    if sys.stdout is None:  # closed by the caller
        raise InputError("Cannot write the output: the standard output is closed.")
    try:
        sys.stdout.write(output)
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
