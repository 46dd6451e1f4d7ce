"""Declaration of the options of all commands by docstrings, and the options that several commands share.

A parameter of a function, or a field of a dataclass, has its type and default where Python has them; the value and the
help text of its option are in the docstring:

    Arguments:
      files = PICTURES: Pictures, or one table of corners.

    Options (Pose files):
      * --pair HOW <PAIRINGS>: Pairing: rows, time or async. More text,
        which may go on below.
      --exclude POSES: Poses to exclude.
      as_json = --json: Print the result as one JSON object.

The heading names the group of the help, if there is one. ``*`` marks options that the short help shows. Behind the
names comes the value of the option, nothing for a flag; then, in ``<>``, the names that the shell completes (a constant
of the module or of this one, or words with ``|`` between them) or the function of these that checks the value.
``{PAIRINGS}`` in the text lists a constant. The parameter of an option is the one of its name, or the one in front of
``=``. What several commands take is declared once, in `Common`, and found there by the name of the parameter.

A parameter whose type is a dataclass with options, or ``Annotated[T, maker]``, is made of further options: those of the
fields, or of the parameters of ``maker``, which may be made of others in turn.

Nothing heavy is imported here, so that help and completion load quickly: the names that options complete are repeated,
and a test holds them against the registries.
"""

import difflib
import inspect
import math
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer
from typer.models import ArgumentInfo, OptionInfo

from ..core.files.about import ABOUT
from ..core.files.lines import floats
from ..core.files.one_line import printable
from ..errors import InputError
from .messages import Messages, quiet, styled, terminal_width

if TYPE_CHECKING:
    from ..core.presentation.document import Document

# A command, or what makes a group of options.
Maker = Callable[..., Any]
# An argument or option as Typer takes it.
Declared = ArgumentInfo | OptionInfo

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
COVARIANCE_NAMES = ("model", "sandwich", "bootstrap")
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
# Names of core.geometry.conventions.CONVENTIONS.
CONVENTION_NAMES = (
    *("toolkit", "ros", "napa", "se3-right", "gtsam", "small-gicp", "manif", "sophus", "jaxlie", "g2o", "se3-left"),
    *("open3d", "pytransform3d", "pypose", "symforce", "calibsense", "opencv", "pycolmap", "factorama", "mrpt"),
    "paper",
)
ROBOT_FRAMES = ("base_T_gripper", "gripper_T_base")
CAMERA_FRAMES = ("camera_T_target", "target_T_camera")
PAIRINGS = ("rows", "time", "async")
PAPERS = ("a4", "letter")
TITLES = tuple(ABOUT)
UNITS = ("m", "mm", "cm", "um", "in")
JOINT_UNITS = ("rad", "deg")
# Those of kinematics.kinematic_errors and of shared_errors.sizes.
ROBOT_CLASSES = ("industrial", "cobot", "hobby")
ACCURACY_CLASSES = ("calibrated", "industrial", "cobot")
EVERY_CLASS = tuple(dict.fromkeys((*ACCURACY_CLASSES, *ROBOT_CLASSES)))

# Groups of options in the help, in their order; a command's own groups take the place of OPTIONS.
ARGUMENTS, OPTIONS, MESSAGES = "Arguments", "Options", "Messages"
_BEFORE = (
    *(ARGUMENTS, "Pictures of a board", "Pose files", "Camera poses from other programs", "Robot joints"),
    *("Camera model", "Noise", "Shared errors", "Prior knowledge", "Estimation"),
)
_AFTER = ("Output", MESSAGES)
# Groups that the short help shows under the heading of another one, to save lines.
SHOWN_UNDER = {
    "Camera poses from other programs": "Pictures of a board",
    "Robot joints": "Pose files",
    "Shared errors": "Noise",
    MESSAGES: "Output",
}


# ------------------------------------------------------------------------------------------- groups of options


def maker_of(parameter: inspect.Parameter) -> Maker | None:
    """Return the maker of a parameter from further options: a group of them, or that of ``Annotated[T, maker]``."""
    annotation = parameter.annotation
    if hasattr(annotation, "__dataclass_fields__"):
        return annotation  # type: ignore[no-any-return]
    return next((one for one in getattr(annotation, "__metadata__", ()) if callable(one)), None)


def made(maker: Maker, given: Mapping[str, Any]) -> Any:
    """Call a command, or make a group of options, with the values of all its options; see `parameters_of`."""
    own = inspect.signature(maker).parameters.values()
    return maker(**{p.name: made(of, given) if (of := maker_of(p)) else given[p.name] for p in own})


def with_messages(command: Maker) -> Maker:
    """Add the options of `Messages` to a command; they are applied before anything else."""
    parameters = {parameter.name: parameter for parameter in parameters_of(Messages)}

    def run(**given: Any) -> Any:
        Messages(**{name: given.pop(name) for name in parameters}).apply()
        return made(command, given)

    return with_parameters(run, command, [*parameters_of(command), *parameters.values()])


def with_parameters(run: Maker, command: Maker, parameters: list[inspect.Parameter]) -> Maker:
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


class Group(str):
    """Name of a group of options; ``common`` if the short help shows the option that bears it."""

    common = False


def position(group: str) -> int:
    """Return the place of a group in the order of the help."""
    if group in _AFTER:
        return len(_BEFORE) + 1 + _AFTER.index(group)
    return _BEFORE.index(group) if group in _BEFORE else len(_BEFORE)


_HEADING = re.compile(r"\n\n(?=(?:Arguments|Options(?: \(.+\))?):\n)")
_GROUP = re.compile(r"(?:Arguments|Options(?: \((.+)\))?):\n")
_ENTRY = re.compile(
    r"(\* )?(?:(\w+) = )?(-[\w/-]+(?:, -[\w-]+)*|[A-Z][\w.]*)(?: ([^\s<:][^<:]*?))?(?: <([^>]+)>)?: (.+)"
)


def parameters_of(maker: Maker) -> list[inspect.Parameter]:
    """Return the parameters of a command or a group, each with its option where a docstring declares it.

    A parameter that is made of others (`maker_of`) is replaced by these; an option that two of them have occurs once.
    """
    docs = [base.__doc__ for base in reversed(maker.__mro__)] if isinstance(maker, type) else [maker.__doc__]
    names = {**globals(), **vars(sys.modules[maker.__module__])}
    declared = {key: made for doc in docs for key, made in _declared(doc or "", names)}
    found = list(inspect.signature(maker).parameters.values())
    fields = getattr(maker, "__dataclass_fields__", {})  # with those that a group derived from another does not take
    if unknown := declared.keys() - {parameter.name for parameter in found} - fields.keys():
        raise TypeError(f"{maker.__name__} has no parameter {', '.join(sorted(unknown))}, which its docstring declares")
    parameters: dict[str, inspect.Parameter] = {}
    for p in found:
        if (of := maker_of(p)) is not None:
            parameters |= {part.name: part for part in parameters_of(of)}
            continue
        option = None if hasattr(p.annotation, "__metadata__") else declared.get(p.name) or _common().get(p.name)
        parameters[p.name] = p.replace(annotation=Annotated[p.annotation, option]) if option else p
    return list(parameters.values())


def without_options(doc: str | None) -> str:
    """Return a docstring without the options that it declares."""
    return _HEADING.split(inspect.cleandoc(doc or ""))[0]


def choices(names: Sequence[str]) -> Callable[[str], list[str]]:
    """Return the completion of one of ``names``, also as the last of a list with commas."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [f"{before}{comma}{name}" for name in names if name.startswith(last)]

    return complete


def _declared(doc: str, names: Mapping[str, Any]) -> Iterator[tuple[str, Declared]]:
    """Yield the name of the parameter and the option of each entry."""
    for section in _HEADING.split(inspect.cleandoc(doc))[1:]:
        heading = _GROUP.match(section)
        assert heading is not None
        for entry in re.split(r"\n  (?=\S)", "\n" + section[heading.end() :].rstrip())[1:]:
            match = _ENTRY.fullmatch(" ".join(entry.split()))
            if match is None:
                raise TypeError(f"expected an option such as '--exclude POSES: Poses to exclude.', got {entry!r}")
            star, key, flags, takes, of, text = match.groups()
            help = re.sub(r"\{(\w+)\}", lambda name: _listed(names[name[1]]), text)
            if not flags.startswith("-"):
                yield key or flags.lower(), typer.Argument(metavar=flags, help=help)
                continue
            group = Group(heading[1] or OPTIONS)
            group.common = bool(star)
            known = () if of is None else names.get(of) or of.split("|")
            made = typer.Option(
                *flags.split(", "),
                help=help,
                metavar=takes or "",
                rich_help_panel=group if star or heading[1] else None,
                callback=known if callable(known) else None,
                autocompletion=choices(known) if known and not callable(known) else None,
            )
            yield key or max(flags.split(", "), key=len).split("/")[0].lstrip("-").replace("-", "_"), made


def _listed(names: Iterable[str]) -> str:
    return names if isinstance(names, str) else ", ".join(names)


class Common:
    """Options and arguments that several commands take, by the names of their parameters.

    Arguments:
      RESULT: Result file: result.json of calibrate -o.

    Options (Robot joints):
      --joint-units UNIT <JOINT_UNITS>: Unit of the joint values: rad, deg, or e.g. deg,mm with prismatic joints.
        Default: as the header says.
      --robot-class NAME <EVERY_CLASS>: Class of the arm. With its kinematics ({ROBOT_CLASSES}) it sets the standard
        deviations not given. Default: industrial. Without ({ACCURACY_CLASSES}) it sets the accuracy that is assumed of
        the robot: 0.15, 0.6 or 2 mm, within a factor of 2.

    Options (Shared errors):
      --size NAME=SIZE[,FACTOR]: Size of an error before the data, e.g. 'robot accuracy=0.3mm,2': a standard deviation,
        and the factor within which it is known (1 sigma; without it: exact). Of an arm with kinematics, without a
        factor: joint noise, joint offsets, joint tilts, link lengths, transmission, sag, e.g. 'joint offsets=0.02deg'.
        Repeatable. Default: by a table.

    Options (Estimation):
      --pairs NAME <all|consecutive|disjoint>: Pairs of poses that form a motion: all, consecutive or disjoint.

    Options:
      --workers N: Number of processes. Default: one per core.

    Options (Output):
      * --about KEY=VALUE: Title block, or a TOML file. Keys: {TITLES}. Repeatable.
      --paper NAME <PAPERS>: Paper of a PDF report: a4 or letter.
      * --report FILE: Report, one .html or .pdf file.
      --no-compare: Report without the comparison of methods.
      * as_json = --json: Print the result as one JSON object.
      --figures: Figures in the folder of -o, as PNG and SVG, that of the methods with --report. Takes some seconds.
    """


@cache
def _common() -> dict[str, Declared]:
    return dict(_declared(Common.__doc__ or "", globals()))


# ------------------------------------------------------------------------------------------------------ output


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
def said_of(option: str) -> Iterator[None]:
    """Put the name of an option before the message of an `InputError`."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{option}: {error}") from None


def metres(text: str, option: str) -> float:
    """Return a length in metres, of a number with or without a unit."""
    from ..core.formatting.units import parse_length

    found = floats([text])
    return parse_length(text, option) if found is None else found[0]


def coordinates(text: str, name: str) -> list[float]:
    """Return the three lengths (m) of an option such as ``0mm,0mm,300mm``."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 3:
        raise InputError(f"Expected {name} to be X,Y,Z such as 0mm,0mm,300mm, got {text!r}.")
    values = [metres(part, name) for part in parts]
    if not (far := max(map(abs, values))) <= 10.0 or not all(map(math.isfinite, values)):
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


def shown(document: "Document") -> "Document":
    """Return a document; with --quiet its first block, which is its answer."""
    from ..core.presentation.document import groups_of

    return [list(next(iter(groups_of(document)))[:1])] if quiet() else document


def emit_document(document: "Document") -> None:
    """Print a document, wrapped to the terminal and with its colours."""
    from ..core.presentation.document import to_text

    emit(to_text(document, terminal_width(), styled))


def emit(output: str) -> None:
    """Print text; a reader that closes the pipe early (`| head`) is no failure."""
    if sys.stdout is None:  # closed by the caller
        raise InputError("Cannot write the output: the standard output is closed.")
    try:
        sys.stdout.write(printable(output))
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
