"""Help of a command: summary, examples and the common options; all options with --help-all.

The texts are those of the program: the docstring of a command and the ``help`` of its options. The pages of the
documentation are made from the same functions.
"""

import inspect
import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple, get_args

import typer
from typer.core import TyperCommand, TyperGroup

from .messages import coloured, note_options, terminal_width
from .options import ARGUMENTS, MESSAGES, OPTIONS, SHOWN_UNDER, Maker, position, with_parameters

EXAMPLES = "Examples:"
AnyCommand = TyperCommand | TyperGroup

_SENTENCE_END = re.compile(r"(?<!e\.g)\. ")


class Description(NamedTuple):
    """Docstring of a command in its parts."""

    summary: str
    examples: str  # lines of a shell, comments included
    paragraphs: tuple[str, ...]


class Row(NamedTuple):
    """An argument or option: its names with what it takes, its text, and where it is shown."""

    names: str
    text: str
    group: str
    common: bool

    @property
    def short(self) -> str:
        """First sentence of the text, and its default."""
        sentences = _SENTENCE_END.split(self.text)
        kept = [k for k, text in enumerate(sentences) if k == 0 or text.startswith("Default:")]
        shown = ". ".join(sentences[k] for k in kept)
        return shown if shown.endswith(".") else shown + "."


def describe(command: AnyCommand) -> Description:
    """Return summary, examples and further paragraphs of a command."""
    summary, *parts = inspect.cleandoc(command.help or "").split("\n\n")
    examples = "\n\n".join(textwrap.dedent(part.partition("\n")[2]) for part in parts if part.startswith(EXAMPLES))
    rest = tuple(" ".join(part.split()) for part in parts if not part.startswith(EXAMPLES))
    return Description(" ".join(summary.split()), examples, rest)


def rows(command: AnyCommand) -> list[Row]:
    """Return every argument and option that is not hidden, in the order of their groups."""
    found = [_row(value) for value in command.params if not getattr(value, "hidden", False)]
    return sorted(found, key=lambda row: position(row.group))


def _row(value: Any) -> Row:  # a parameter of the copy of Click that Typer carries or uses
    group = getattr(value, "rich_help_panel", None)
    text = " ".join((getattr(value, "help", None) or "").split())
    if value.param_type_name == "argument":
        shown = value.metavar or ""
        many = "..." if value.nargs != 1 and "..." not in shown else ""
        return Row(shown + many, text, ARGUMENTS, common=True)
    # Typer keeps the type of a value in other places from version to version; its name says enough
    takes = "" if getattr(value, "is_flag", False) or value.metavar == "" else value.metavar or value.name.upper()
    names = sorted(value.opts, key=len)
    shown = "/".join([", ".join(names), *value.secondary_opts])
    default = value.default
    if isinstance(default, str | int | float) and not isinstance(default, bool) and "Default:" not in text:
        text += f" Default: {default}."
    return Row(f"{shown} {takes}".strip(), text, str(group or OPTIONS), getattr(group, "common", False))


# ------------------------------------------------------------------------------------------------------------ text


def help_text(context: typer.Context, every: bool) -> str:
    """Return the help of the command of ``context``, with ``every`` option or the common ones."""
    page = _Page()
    command = context.command
    if isinstance(command, TyperGroup):
        _write_program(page, command, context.command_path, every)
    elif isinstance(command, TyperCommand):
        _write_command(page, command, context, every)
    return "\n".join(page.lines) + "\n"


class _Page:
    """Lines of a help page."""

    def __init__(self) -> None:
        self.width = min(terminal_width(), 100)
        self.colours = coloured(sys.stdout)
        self.lines: list[str] = []

    def bold(self, text: str) -> str:
        return f"\x1b[1m{text}\x1b[0m" if self.colours else text

    def dim(self, text: str) -> str:
        return f"\x1b[2m{text}\x1b[0m" if self.colours else text

    def paragraph(self, text: str, indent: str = "") -> None:
        self.lines += textwrap.wrap(
            text, self.width, initial_indent=indent, subsequent_indent=indent, break_long_words=False,
            break_on_hyphens=False,
        )  # fmt: skip

    def table(self, entries: list[tuple[str, str]], at: int | None = None) -> None:
        """Names on the left, texts on the right, from column ``at``."""
        at = at or _column(name for name, _ in entries)
        for name, text in entries:
            lines = textwrap.wrap(text, max(self.width - at, 16), break_long_words=False, break_on_hyphens=False)
            first = lines.pop(0) if len(name) + 4 <= at and lines else ""
            gap = " " * (at - len(name) - 2) if first else ""
            self.lines.append(f"  {self.bold(name)}{gap}{first}")
            self.lines += [" " * at + line for line in lines]


def _column(names: Iterable[str]) -> int:
    return min(max(map(len, names)), 28) + 4  # columns of the longest name, and a gap


def _write_command(page: _Page, command: TyperCommand, context: typer.Context, every: bool) -> None:
    about = describe(command)
    pieces = [piece.replace("{", "").replace("}", "") for piece in command.collect_usage_pieces(context)]
    pieces.remove("[OPTIONS]")
    page.lines.append(f"{page.bold('Usage:')} {' '.join([context.command_path, *pieces, '[OPTIONS]'])}")
    page.lines.append("")
    page.paragraph(about.summary)
    page.lines += ["", page.bold(EXAMPLES)]
    for line in about.examples.splitlines():
        page.lines.append(f"  {page.dim(line) if line.startswith('#') else line}".rstrip())
    if every:
        for text in about.paragraphs:
            page.lines.append("")
            page.paragraph(text)
    listed = [row for row in rows(command) if every or row.common]
    at = None if every else _column(row.names for row in listed)
    page.lines += [] if every else [""]
    for group, shown in _groups(listed, every):
        page.lines += ["", page.bold(f"{group}:")] if every else [page.bold(f"{group}:")]
        page.table([(row.names, row.text if every else row.short) for row in shown], at)
    if not every:
        page.lines.append(f"All options: {context.command_path} --help-all")


def _groups(found: list[Row], every: bool) -> Iterator[tuple[str, list[Row]]]:
    groups: dict[str, list[Row]] = {}
    for row in found:
        groups.setdefault(row.group if every else SHOWN_UNDER.get(row.group, row.group), []).append(row)
    yield from groups.items()


def _write_program(page: _Page, program: TyperGroup, path: str, every: bool) -> None:
    about = describe(program)
    page.lines.append(f"{page.bold('Usage:')} {path} COMMAND [OPTIONS]")
    page.paragraph(about.summary)
    groups: dict[str, list[tuple[str, str]]] = {}
    for name, command in program.commands.items():
        if isinstance(command, TyperCommand):
            groups.setdefault(str(command.rich_help_panel), []).append((name, describe(command).summary))
    for group, entries in groups.items():
        page.lines.append(page.bold(f"{group}:"))
        page.table(entries)
    if every:
        page.lines += ["", page.bold("Options:")]
        page.table([(row.names, row.text) for row in rows(program)])
    else:
        page.paragraph(" ".join(about.paragraphs))


# ------------------------------------------------------------------------------------------------------ in the app


class _WithHelp:
    """Help of this module in place of Typer's."""

    def format_help(self, context: Any, formatter: Any) -> None:
        context.color = coloured(sys.stdout)  # otherwise escapes are removed when the text is printed
        formatter.write(help_text(context, every=False))

    def get_params(self, ctx: Any) -> Any:
        """Return the parameters; those that hold one value take it by `_taken`."""
        callback: Any = getattr(self, "callback", None)
        annotations = getattr(callback, "__annotations__", {})
        found = super().get_params(ctx)  # type: ignore[misc]
        for parameter in found:
            if parameter.nargs == 1 and not isinstance(parameter.process_value, partial):
                kinds: dict[Any, Callable[[str], str | Path]] = {
                    str: str,
                    str | None: str,
                    Path: Path,
                    Path | None: Path,
                }
                kind = kinds.get(next(iter(get_args(annotations.get(parameter.name))), None))
                parameter.process_value = partial(_taken, parameter, parameter.process_value, kind)
        return found


def _taken(
    parameter: Any,
    process: Callable[[Any, Any], Any],
    kind: Callable[[str], str | Path] | None,
    context: Any,
    value: Any,
) -> Any:
    """Return the value of a parameter by its own ``process``, unless that has nothing to do.

    Typer builds a validator of Pydantic for each parameter; what is absent, a default, text or a path needs none.
    """
    if kind is not None and isinstance(value, str):
        value = kind(value)
    elif value is None and not parameter.required:
        value = () if parameter.multiple else None
    elif value is not parameter.default:
        return process(context, value)
    return value if parameter.callback is None else parameter.callback(context, parameter, value)


class Command(_WithHelp, TyperCommand):
    """Command of the program; it keeps which of its options were typed."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        typed = [
            parameter
            for parameter in self.params
            if (source := ctx.get_parameter_source(parameter.name)) is not None and source.name == "COMMANDLINE"
        ]
        note_options(
            tuple(max(p.opts, key=len) if p.opts[0].startswith("-") else (p.metavar or p.name).upper() for p in typed)
        )
        return super().invoke(ctx)


class Program(_WithHelp, TyperGroup):
    """Program with its commands."""


def _show_all(context: typer.Context, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        typer.echo(help_text(context, every=True), color=coloured(sys.stdout), nl=False)
        raise typer.Exit()


HelpAll = Annotated[
    bool,
    typer.Option(
        "--help-all",
        metavar="",
        is_eager=True,
        callback=_show_all,
        help="List every option and exit.",
        rich_help_panel=MESSAGES,
    ),
]


def with_help_all(command: Maker) -> Maker:
    """Add the option ``--help-all`` to a command."""

    def run(help_all: bool = False, **given: Any) -> Any:
        return command(**given)

    option = inspect.Parameter("help_all", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=HelpAll)
    return with_parameters(run, command, [*inspect.signature(command).parameters.values(), option])
