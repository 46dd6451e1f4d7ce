"""The command ``uq-handeye``: parses, calls, prints.

Exit status: 0 success; 2 bad usage or bad input, with one line on stderr; 1 an internal error, or a run that lost its
workers; 130 Ctrl-C, with one line on stderr.
"""

import shlex
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from .cli_calibrate import calibrate_command, demo_command
from .cli_compare import compare_command
from .cli_cross_check import cross_check_command
from .cli_files import export_command, report_command
from .cli_messages import coloured, fail, fail_internally, messages
from .cli_options import with_messages
from .cli_plan import plan_command
from .cli_posterior import posterior_command
from .cli_simulate import simulate_command
from .cli_sync import sync_command
from .cli_validate import INTERRUPTED, validate_command
from .errors import InputError, NotConvergedError

# Typer carries its own copy of Click or uses the installed one, depending on its version.
ClickException: type[Exception] = typer.BadParameter.__mro__[2]


def _colour_help() -> None:
    """Rich, which Typer prints help with, by the rule of all other output."""
    from typer import rich_utils  # slow to import

    colours = coloured(sys.stdout)
    rich_utils.COLOR_SYSTEM = "auto" if colours else None
    rich_utils.FORCE_TERMINAL = True if colours else None


class _Command(TyperCommand):
    def format_help(self, *arguments: Any) -> None:
        _colour_help()
        super().format_help(*arguments)


class _Group(TyperGroup):
    def format_help(self, *arguments: Any) -> None:
        _colour_help()
        super().format_help(*arguments)


app = typer.Typer(
    cls=_Group,
    help="Hand-eye calibration AX = XB with its uncertainty.\n\nExample: uq-handeye demo",
    epilog="Every command has --help with an example.",
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


@with_messages
def _start(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", metavar="", help="Print the version.")] = False,
) -> None:
    if version:
        from . import __version__

        print(f"uq-handeye {__version__}")
    elif context.invoked_subcommand is None:
        print(context.get_help())


app.callback(invoke_without_command=True)(_start)

_COMMANDS: dict[str, dict[str, Callable[..., Any]]] = {
    "Calibrate": {
        "demo": demo_command,
        "calibrate": calibrate_command,
        "compare": compare_command,
        "plan": plan_command,
    },
    "Is the covariance true?": {
        "validate": validate_command,
        "posterior": posterior_command,
        "cross-check": cross_check_command,
    },
    "Files": {
        "sync": sync_command,
        "report": report_command,
        "export": export_command,
        "simulate": simulate_command,
    },
}
for panel, commands in _COMMANDS.items():
    for name, command in commands.items():
        app.command(name, cls=_Command, rich_help_panel=panel)(with_messages(command))


def main(arguments: list[str] | None = None) -> None:
    """Run the command; every expected failure is one line on stderr and exit status 2."""
    given = sys.argv[1:] if arguments is None else arguments
    with messages(shlex.join(["uq-handeye", *given]), no_color="--no-color" in given):
        status = _status_of(given)
        if status == INTERRUPTED:  # of a command that has printed what it had, or of Typer, which catches the exception
            with suppress(ValueError):  # not in the main thread
                signal.signal(signal.SIGINT, signal.SIG_IGN)  # once more would end this line too
            print("uq-handeye: interrupted", file=sys.stderr)
    raise SystemExit(status)


def _status_of(arguments: list[str]) -> int:
    try:
        status = app(arguments, prog_name="uq-handeye", standalone_mode=False)
        sys.stdout.flush()
    except ClickException as error:
        context = getattr(error, "ctx", None)
        path = "uq-handeye" if context is None else context.command_path
        return fail(f"{error.format_message()} (see {path} --help)")  # type: ignore[attr-defined]
    except (InputError, NotConvergedError) as error:
        return fail(str(error))
    except (typer.Abort, KeyboardInterrupt):
        return INTERRUPTED
    except OSError as error:
        if error.filename is not None:
            return fail_internally(error)
        # files have their own messages, so this is the standard output
        sys.stdout = None  # or Python would try, and fail, to flush it once more
        return fail(f"Cannot write the output: {error.strerror or error}.")
    except Exception as error:
        return fail_internally(error)
    return status if isinstance(status, int) else 0
