"""The program ``uq-handeye``: it parses the command line, calls the command, and ends with its exit status.

The statuses are in `exit_status.py`.
"""

import _thread
import errno
import shlex
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from types import FrameType

import typer

from ..errors import InputError, NotConvergedError
from .exit_status import ExitStatus
from .help import Command, Program, with_help_all
from .messages import fail, fail_internally, messages
from .options import Maker, with_messages

# Typer carries its own copy of Click or uses the installed one, depending on its version.
ClickException: type[Exception] = typer.BadParameter.__mro__[2]


# Commands by group of the help. Each has a module of its name in `commands`, but for the short forms of others.
COMMANDS: dict[str, tuple[str, ...]] = {
    "Calibrate": ("calibrate", "live", "demo", "camera", "scene", "points", "sync", "bag"),
    "Use the result": ("view", "report", "export", "predict", "check", "update", "diff", "verify", "certificate"),
    "Improve and compare": ("plan", "compare"),
    "Check the covariance": ("validate", "cross-check", "posterior"),
    "Simulate and generate code": ("simulate", "codegen"),
}
SHORT_FORMS = {"certificate": "report"}


@with_help_all
@with_messages
def _start(context: typer.Context, version: bool = False) -> None:
    """Program.

    Options:
      --version: Print the version and exit.
    """
    if version:
        from .._version import __version__

        print(f"uq-handeye {__version__}")
    elif context.invoked_subcommand is None:
        print(context.get_help())


@cache
def program(only: str | None = None) -> typer.Typer:
    """Return the program with all its commands, or with one, so that a run does not load the options of the others."""
    made = typer.Typer(
        cls=Program,
        help="""Estimate the pose X of a camera on a robot or in its cell, with uncertainty.

        Start with uq-handeye demo. Examples and options: uq-handeye COMMAND --help.
        """,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    made.callback(invoke_without_command=True)(_start)
    for group, names in COMMANDS.items():
        for name in names:
            if only in (None, name):
                module = SHORT_FORMS.get(name, name).replace("-", "_")
                place = import_module(f".commands.{module}", __package__)
                command: Maker = getattr(place, f"{name.replace('-', '_')}_command")
                made.command(name, cls=Command, rich_help_panel=group)(with_help_all(with_messages(command)))
    return made


def __getattr__(name: str) -> typer.Typer:
    """``app``: the whole program, for shells that complete it and for documentation."""
    if name == "app":
        return program()
    raise AttributeError(name)


def main(arguments: list[str] | None = None) -> None:
    """Run the command; every expected failure is one line on stderr and exit status 2."""
    if sys.flags.optimize > 1:
        print(
            "uq-handeye: error: PYTHONOPTIMIZE=2 (-OO) takes away the texts of the options. Use 1, or none.",
            file=sys.stderr,
        )
        raise SystemExit(ExitStatus.BAD_INPUT)
    given = sys.argv[1:] if arguments is None else arguments
    command = shlex.join(["uq-handeye", *given]).encode(errors="backslashreplace").decode()  # names may be no UTF-8
    with messages(command, no_color="--no-color" in given), _interrupts() as interrupted:
        status = _status_of(given, interrupted)
        # returned by a command that has printed what it had, or by Typer, which catches the exception
        if status == ExitStatus.INTERRUPTED:
            with suppress(ValueError):  # not in the main thread
                signal.signal(signal.SIGINT, signal.SIG_IGN)  # once more would end this line too
            print("uq-handeye: interrupted", file=sys.stderr)
    raise SystemExit(status)


@contextmanager
def _interrupts() -> Iterator[list[int]]:
    """Count every Ctrl-C, because not every one arrives as a KeyboardInterrupt.

    Libraries in C turn it into their own error, and in a finaliser Python prints and drops it; then it is sent again.
    """
    count: list[int] = []
    before, hook = signal.getsignal(signal.SIGINT), sys.unraisablehook

    def handle(number: int, frame: FrameType | None) -> None:
        count.append(number)
        signal.default_int_handler(number, frame)

    def dropped(error: "sys.UnraisableHookArgs") -> None:
        if issubclass(error.exc_type, KeyboardInterrupt):
            threading.Timer(0.01, _thread.interrupt_main).start()
        else:
            hook(error)

    if before is not signal.default_int_handler or threading.current_thread() is not threading.main_thread():
        yield count  # somebody else's to handle
        return
    signal.signal(signal.SIGINT, handle)
    sys.unraisablehook = dropped
    try:
        yield count
    finally:
        sys.unraisablehook = hook
        if signal.getsignal(signal.SIGINT) is handle:
            signal.signal(signal.SIGINT, before)


def _status_of(arguments: list[str], interrupted: list[int]) -> int:
    try:
        named = arguments[0] if arguments and any(arguments[0] in group for group in COMMANDS.values()) else None
        status = program(named)(arguments, prog_name="uq-handeye", standalone_mode=False)
        if sys.stdout is not None:  # it may be closed
            sys.stdout.flush()
    except (Exception, KeyboardInterrupt) as error:
        return _failed(error, bool(interrupted))
    return status if isinstance(status, int) else 0


def _failed(error: BaseException, interrupted: bool) -> int:
    """Print the one line of an error and return its exit status."""
    match error:
        case ClickException():
            context = getattr(error, "ctx", None)
            path = "uq-handeye" if context is None else context.command_path
            said = error.format_message()  # type: ignore[attr-defined]
            # Shells expand a pattern that is not in quotes.
            quotes = ". Quote a pattern of files: 'poses/*.txt'" if said.startswith("Got unexpected extra") else ""
            return fail(f"{said}{quotes} (see {path} --help)")
        case typer.Abort() | KeyboardInterrupt():
            return ExitStatus.INTERRUPTED
        case _ if interrupted:
            return ExitStatus.INTERRUPTED
        case InputError() | NotConvergedError():
            return fail(str(error))
        case OSError(errno=errno.ENAMETOOLONG):
            return fail("A name is too long for the file system. Give a shorter one.")
        case OSError(filename=None):  # files have their own messages, so this is the standard output
            sys.stdout = None  # or Python would try, and fail, to flush it once more
            return fail(f"Cannot write the output: {error.strerror or error}.")
    return fail_internally(error)
