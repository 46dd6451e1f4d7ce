"""Options that several commands share, their types, and how output is printed.

Nothing heavy is imported here, so that help and completion load quickly: the names that options complete are repeated,
and a test holds them against the registries.
"""

import difflib
import inspect
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from ...errors import InputError
from ..messages import Messages, styled, terminal_width
from .declared import ESTIMATION, OUTPUT, choices, common_in, parameters_of, without_options

if TYPE_CHECKING:
    from ...core.presentation.document import Document

# Names of likelihood.ESTIMATORS, METHODS, ROBOT_WORLD_METHODS, SETUPS, request.COVARIANCES, FORMATS and CONTROLLERS.
AT_THE_BOUND = ("efficient", "ml")
PUBLISHED = (
    *("tsai", "shiu", "chou", "park", "horaud", "daniilidis", "andreff", "lu"),
    *("gwak", "heller", "condurache", "zhang", "zhao", "nguyen", "4dpa"),
)
ROBOT_WORLD = ("li", "shah")
# Bundle adjustment on corners (request.BUNDLE), of `calibrate` only.
BUNDLE = "bundle"
EVERY_METHOD = (*AT_THE_BOUND, *PUBLISHED, *ROBOT_WORLD)
SETUP_NAMES = ("eye-in-hand", "eye-to-hand")
COVARIANCE_NAMES = ("model", "sigma-points", "sandwich", "hac", "jackknife", "bootstrap")
CONTROLLER_NAMES = (
    *("ur", "kuka", "fanuc", "abb", "staubli", "yaskawa", "kawasaki", "mitsubishi", "denso", "epson", "doosan"),
    *("comau", "techman", "dobot", "jaka", "xarm", "rpy"),
)
FORMAT_NAMES = (
    *("csv", "tum", "npz", "npy", "mat", "easy_handeye", "easy_handeye2", "moveit", "opencv", "json"),
    *("tf-echo", "ros-topic", "franka", "zivid", "halcon", "matrix"),
    *CONTROLLER_NAMES,
    "table",
)
ROBOT_FRAMES = ("base_T_gripper", "gripper_T_base")
CAMERA_FRAMES = ("camera_T_target", "target_T_camera")
PAIRINGS = ("rows", "time", "async")
UNITS = ("m", "mm", "cm", "um", "in")


# ------------------------------------------------------------------------------------------- groups of options


def made_of(**makers: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Replace parameters of a command by the options that they are made of.

    ``@made_of(noise=noise_of)`` gives ``command(noise, seed)`` the options of ``noise_of`` and ``seed``: the values of
    the former go to ``noise_of``, and what it returns to the command. A maker is a function or a class; an option that
    two of them have is one. The parameters made are annotated in quotes, so that Typer does not see them.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        parts = {
            parameter.name: parameters_of(makers[parameter.name]) if parameter.name in makers else [parameter]
            for parameter in parameters_of(command)
        }

        def run(**given: Any) -> Any:
            made = {name: maker(**{p.name: given[p.name] for p in parts[name]}) for name, maker in makers.items()}
            return command(**made, **{name: given[name] for name in parts if name not in makers})

        by_name = {parameter.name: parameter for part in parts.values() for parameter in part}
        return with_parameters(run, command, list(by_name.values()))

    return decorate


def with_messages(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of `Messages` to a command; they are applied before anything else."""
    parameters = inspect.signature(Messages).parameters

    def run(**given: Any) -> Any:
        Messages(**{name: given.pop(name) for name in parameters}).apply()
        return command(**given)

    return with_parameters(run, command, [*parameters_of(command), *parameters.values()])


def with_parameters(
    run: Callable[..., Any], command: Callable[..., Any], parameters: list[inspect.Parameter]
) -> Callable[..., Any]:
    """Return ``run`` with the name and help of ``command``, and the parameters where Typer looks for them."""
    parameters = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in parameters]
    run = wraps(command)(run)
    run.__doc__ = without_options(command.__doc__)
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    return run


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


class Options:
    """Options of one topic: base of frozen dataclasses with a field for each, None where it was not given."""

    # Options that are not called as their fields are.
    _called: ClassVar[dict[str, str]] = {}

    @property
    def given(self) -> list[str]:
        """Names of the options that were given."""
        return [
            self._called.get(name, f"--{name.replace('_', '-')}")
            for name, value in vars(self).items()
            if value is not None
        ]


def option(
    *names: str,
    help: str,
    panel: str | None = None,
    of: Sequence[str] = (),
    metavar: str | None = None,
    common: bool = False,
) -> Any:
    """Return a Typer option that takes text or a number.

    The shell completes the names ``of``; the short help shows the ``common`` ones, by the first sentence of ``help``
    and the sentence that starts with "Default:".
    """
    completed = choices(of) if of else None
    group = common_in(panel) if common else panel
    return typer.Option(*names, help=help, metavar=metavar, rich_help_panel=group, autocompletion=completed)


def flag(*names: str, help: str, panel: str | None = None, common: bool = False) -> Any:
    """Return a Typer option without a value; the short help shows the ``common`` ones."""
    return typer.Option(*names, help=help, metavar="", rich_help_panel=common_in(panel) if common else panel)


# ------------------------------------------------------------------------------------------------------ output


def named_folder(directory: Path | None) -> Path | None:
    """Return a folder that can be written; raise `InputError` before the work otherwise, also for an empty name."""
    if directory is None:
        return None
    if str(directory) == ".":
        raise InputError("Expected -o to name a folder, got an empty name or '.'. Write, for example, -o result.")
    from ...core.files.atomic import require_writable_folder

    require_writable_folder(directory)
    return directory


def folder_option(help: str) -> Any:
    """Return the option ``-o DIR``, which the short help shows."""
    return typer.Option(
        "-o",
        "--output",
        metavar="DIR",
        callback=named_folder,
        help=help,
        rich_help_panel=common_in(OUTPUT),
        show_default=False,
    )


def require_writable(path: Path | None, option: str, suffixes: Sequence[str] = ()) -> None:
    """Raise `InputError`, before the work, unless a file of that name can be written."""
    if path is None:
        return
    if suffixes and path.suffix.lower() not in suffixes:
        raise InputError(f"Expected {option} to be named {' or '.join(suffixes)}, got {str(path)!r}.")
    from ...core.files.atomic import require_writable_file

    require_writable_file(path)


PairsOption = Annotated[
    str,
    option(
        "--pairs",
        of=("all", "consecutive", "disjoint"),
        metavar="NAME",
        panel=ESTIMATION,
        help="Pairs of poses that form a motion: all, consecutive or disjoint.",
    ),
]
JsonOption = Annotated[bool, flag("--json", panel=OUTPUT, common=True, help="Print the result as one JSON object.")]
WorkersOption = Annotated[
    int | None, option("--workers", metavar="N", help="Number of processes. Default: one per core.")
]


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def emit_document(document: "Document") -> None:
    """Print a document, wrapped to the terminal and with its colours."""
    from ...core.presentation.document import to_text

    emit(to_text(document, terminal_width(), styled))


def emit(output: str) -> None:
    """Print text; a reader that closes the pipe early (`| head`) is no failure."""
    if sys.stdout is None:  # closed by the caller
        raise InputError("Cannot write the output: the standard output is closed.")
    try:
        sys.stdout.write(output)
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
