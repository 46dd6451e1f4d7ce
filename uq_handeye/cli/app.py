"""Program ``uq-handeye``: parse, call, print.

`exit_status.py` has the exit statuses.
"""

import _thread
import shlex
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

import typer

from ..errors import InputError, NotConvergedError
from .commands.calibrate import calibrate_command, demo_command
from .commands.camera import bag_command, camera_command, points_command, sync_command
from .commands.check import check_command, diff_command, update_command, verify_command
from .commands.live import live_command, view_command
from .commands.plan import compare_command, plan_command
from .commands.predict import certificate_command, export_command, predict_command, report_command
from .commands.simulate import codegen_command, simulate_command
from .commands.validate import cross_check_command, posterior_command, validate_command
from .exit_status import ExitStatus
from .help import Command, Program, with_help_all
from .messages import fail, fail_internally, messages
from .options import Maker, with_messages

# Typer carries its own copy of Click or uses the installed one, depending on its version.
ClickException: type[Exception] = typer.BadParameter.__mro__[2]


app = typer.Typer(
    cls=Program,
    help="""Estimate the pose X of a camera on a robot or in its cell (AX = XB), and its uncertainty.

    Start with uq-handeye demo. Examples and options: uq-handeye COMMAND --help.
    """,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


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


app.callback(invoke_without_command=True)(_start)

_COMMANDS: dict[str, dict[str, Maker]] = {
    "Calibrate": {
        "calibrate": calibrate_command,
        "live": live_command,
        "demo": demo_command,
        "camera": camera_command,
        "points": points_command,
        "sync": sync_command,
        "bag": bag_command,
    },
    "Use the result": {
        "view": view_command,
        "report": report_command,
        "export": export_command,
        "predict": predict_command,
        "check": check_command,
        "update": update_command,
        "diff": diff_command,
        "verify": verify_command,
        "certificate": certificate_command,
    },
    "Improve and compare": {"plan": plan_command, "compare": compare_command},
    "Check the covariance": {
        "validate": validate_command,
        "cross-check": cross_check_command,
        "posterior": posterior_command,
    },
    "Simulate and generate code": {"simulate": simulate_command, "codegen": codegen_command},
}
for group, commands in _COMMANDS.items():
    for name, command in commands.items():
        app.command(name, cls=Command, rich_help_panel=group)(with_help_all(with_messages(command)))


def main(arguments: list[str] | None = None) -> None:
    """Run the command; every expected failure is one line on stderr and exit status 2."""
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
        status = app(arguments, prog_name="uq-handeye", standalone_mode=False)
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
        case OSError(filename=None):  # files have their own messages, so this is the standard output
            sys.stdout = None  # or Python would try, and fail, to flush it once more
            return fail(f"Cannot write the output: {error.strerror or error}.")
    return fail_internally(error)
