"""Declaration of the options of all commands by docstrings, and the options that several commands share.

A parameter of a function, or a field of a record (dataclass or NamedTuple), has its type and default where Python has
them; the value and the help text of its option are in the docstring:

    Arguments:
      files = PICTURES: Pictures, or one table of corners.

    Options (Pose files):
      * --pair HOW <PAIRINGS>: Pairing: rows, time or async. More text,
        which may go on below.
      --exclude POSES: Poses to exclude.
      as_json = --json: Print the result as one JSON object.

The heading names the group of the help, if there is one. ``*`` marks options that the short help shows. Behind the
names comes the value of the option, nothing for a flag; then, in ``<>``, the names that the shell completes (a constant
of the module or of `names`, or words with ``|`` between them) or the function of `values` that checks the value.
``{PAIRINGS}`` in the text lists a constant. The parameter of an option is the one of its name, or the one in front of
``=``. What several commands take is declared once, in `Common`, and found there by the name of the parameter.

A parameter whose type is a record with options, or ``Annotated[T, maker]``, is made of further options: those of the
fields, or of the parameters of ``maker``, which may be made of others in turn. Nothing heavy is imported here, so that
help and completion load quickly.
"""

import inspect
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from functools import cache, wraps
from typing import Annotated, Any, ClassVar

import typer
from typer.models import ArgumentInfo, OptionInfo

from . import names, values
from .messages import Messages

# A command, or what makes a group of options.
Maker = Callable[..., Any]
# An argument or option as Typer takes it.
Declared = ArgumentInfo | OptionInfo

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


def maker_of(parameter: inspect.Parameter) -> Maker | None:
    """Return the maker of a parameter from further options: a group of them, or that of ``Annotated[T, maker]``."""
    annotation = parameter.annotation
    if isinstance(annotation, type) and (is_dataclass(annotation) or hasattr(annotation, "_fields")):
        return annotation
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
    known = {**vars(values), **vars(names), **vars(sys.modules[maker.__module__])}
    declared = {key: made for doc in docs for key, made in _declared(doc or "", known)}
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


def names_of_options(*makers: Maker) -> set[str]:
    """Return the names of the options that commands or groups declare, as ``--seed``."""
    found = set()
    for maker in makers:
        for parameter in parameters_of(maker):
            for made in getattr(parameter.annotation, "__metadata__", ()):
                flags = [getattr(made, "default", None), *(getattr(made, "param_decls", None) or ())]
                found |= {name for flag in flags if isinstance(flag, str) for name in flag.split("/")}
    return found


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
      RESULT: Result: result.json of calibrate -o, or its folder.

    Options (Robot joints):
      --joint-units UNIT <JOINT_UNITS>: Unit of the joint values: rad, deg, deg,mm with prismatic joints,
        deg,pendant where joint 3 of a FANUC arm is that of its pendant, or the calibration file of LeRobot (.json) for
        values from -100 to 100. Default: as the header says.
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
    return dict(_declared(Common.__doc__ or "", vars(names)))
