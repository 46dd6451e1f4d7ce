"""Messages of the command in addition to its result: notes, warnings and errors on stderr, colours, the log file.

Everything goes through the logger ``uq_handeye``: DEBUG is each step and its duration (-v), INFO a note, WARNING input
that looks wrong, ERROR the one line that ends the run. Stdout is for results.
"""

import logging
import os
import shutil
import sys
import time
import traceback
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, TextIO

import typer

from ..core.files.one_line import printable
from ..core.presentation.document import COLUMNS, WIDTH
from ..errors import InputError, InputWarning
from .exit_status import ExitStatus

LOG = logging.getLogger("uq_handeye")

_WORDS = {logging.INFO: "note: ", logging.WARNING: "warning: ", logging.ERROR: "error: "}
_COLOURS = {logging.WARNING: "yellow", logging.ERROR: "red"}
# Colour of a status on stdout.
_STATUS_COLOURS = {"ok": "green", "caution": "yellow", "failed": "red", "not run": "bright_black"}


@dataclass
class _Run:
    """Settings of the messages of a run."""

    command: str = "uq-handeye"  # the command line as typed
    given: tuple[str, ...] = ()  # names of its options and arguments
    quiet: bool = False
    verbose: bool = False
    no_color: bool = False
    said: set[str] = field(default_factory=set)  # warnings: several steps of a command may give the same
    held: list[tuple[str, type[Warning]]] | None = None  # warnings that may be part of the result
    shown: list[str] = field(default_factory=list)  # ... and those that are


_run = _Run()


class Messages(NamedTuple):
    """Options of the messages, before or after the name of a command.

    Options (Messages):
      * -q, --quiet: Print the answer only. No notes, warnings or progress.
      * -v, --verbose: Print all details. Also each step with its duration.
      --log-file FILE: File that all messages are appended to, with times.
      --no-color: Print without colours.
    """

    quiet: bool = False
    verbose: bool = False
    log_file: Path | None = None
    no_color: bool = False

    def apply(self) -> None:
        """Apply the options to this run."""
        _run.quiet |= self.quiet
        _run.verbose |= self.verbose
        _run.no_color |= self.no_color
        if _run.quiet and _run.verbose:
            raise InputError("Give either --quiet or --verbose, not both.")
        if self.log_file is not None:
            _open_log(self.log_file)


def command_line() -> str:
    """Return the command line as typed."""
    return _run.command


def given_options() -> tuple[str, ...]:
    """Return the names of the options and arguments that were typed: ``--seed``, ``CAMERA``."""
    return _run.given


def note_options(given: tuple[str, ...]) -> None:
    """Keep the names of the options and arguments that were typed."""
    _run.given = given


def quiet() -> bool:
    """Return whether --quiet was given."""
    return _run.quiet


def verbose() -> bool:
    """Return whether --verbose was given."""
    return _run.verbose


def progress_wanted() -> bool:
    """Return whether long work may show a bar, which it does on a terminal only."""
    return not _run.quiet


def coloured(stream: TextIO | None) -> bool:
    """Return whether colours go to a stream: a terminal that shows them, unless --no-color or NO_COLOR; FORCE_COLOR."""
    if _run.no_color or os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR", "0") not in ("", "0"):
        return True
    return stream is not None and stream.isatty() and os.environ.get("TERM") != "dumb"


def terminal_width() -> int:
    """Return the columns that text on stdout is wrapped to: those of the terminal, else $COLUMNS, else 80."""
    if sys.stdout is not None and sys.stdout.isatty():
        columns = shutil.get_terminal_size((COLUMNS, 24)).columns
    else:
        given = os.environ.get("COLUMNS", "")
        columns = int(given) if given.isdecimal() else COLUMNS
    return min(max(columns, 40), WIDTH)


def styled(text: str, role: str) -> str:
    """Style text by its role (`presentation.document.Style`) for stdout: the answer bold, statuses coloured."""
    if role not in (*_STATUS_COLOURS, "answer") or not coloured(sys.stdout):
        return text
    return typer.style(text, fg=_STATUS_COLOURS.get(role), bold=True if role == "answer" else None)


@contextmanager
def withheld() -> Iterator[list[str]]:
    """Hold back warnings of input until the end, and then give those that are not in the list yielded.

    The list is for the sentences that the result itself shows. After an error it is empty, and all are given.
    """
    shown: list[str] = []
    before, _run.held = _run.held, []
    try:
        yield shown
    finally:
        held, _run.held = _run.held, before
        for text, category in held:
            if text in shown:
                LOG.warning("%s", text, extra={"shown": True})
                _run.shown.append(text)
            else:
                _warn(text, category)


@contextmanager
def messages(command: str, no_color: bool) -> Iterator[None]:
    """Set up the logger and Python's warnings for a run of the command."""
    global _run
    before, _run = (_run, LOG.level, LOG.propagate, list(LOG.handlers)), _Run(command, no_color=no_color)
    LOG.setLevel(logging.DEBUG)
    LOG.propagate = False
    LOG.addHandler(_ToStderr())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", InputWarning)
            warnings.showwarning = _show_warning
            yield
    finally:
        for handler in [handler for handler in LOG.handlers if handler not in before[3]]:
            LOG.removeHandler(handler)
            handler.close()
        _run, LOG.propagate = before[0], before[2]
        LOG.setLevel(before[1])


@contextmanager
def timed(what: str) -> Iterator[None]:
    """Report a step with -v, and then its duration."""
    start = time.perf_counter()
    LOG.debug("%s ...", what)
    yield
    LOG.debug("%s: done in %.2f s", what, time.perf_counter() - start)


def fail(message: str) -> int:
    """Print the one line of an error and return the exit status of bad input."""
    for text in _run.shown:  # held back for a text that does not come
        LOG.warning("%s", text)
    LOG.error(" ".join(message.split()))
    return ExitStatus.BAD_INPUT


def fail_internally(error: BaseException) -> int:
    """Print an internal error and how to report it; return its exit status."""
    LOG.debug("".join(traceback.format_exception(error)).rstrip())
    logs = any(isinstance(handler, _ToFile) for handler in LOG.handlers)
    where = "the log file has" if logs else "run it again with --log-file uq-handeye.log, which keeps"
    LOG.error(
        "internal error: %s: %s. This is a fault of the program; please report it (%s the details).",
        type(error).__name__,
        " ".join(str(error).split()) or "no message",
        where,
    )
    return ExitStatus.INTERNAL_ERROR


class _ToStderr(logging.Handler):
    """``uq-handeye: warning: ...``, each text once."""

    def __init__(self) -> None:
        super().__init__()
        self.said: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        least = logging.ERROR if _run.quiet else logging.DEBUG if _run.verbose else logging.INFO
        text = f"uq-handeye: {getattr(record, 'label', _WORDS.get(record.levelno, ''))}{record.getMessage()}"
        if (
            record.levelno < least
            or getattr(record, "shown", False)
            or (text in self.said and record.levelno > logging.DEBUG)
        ):
            return
        self.said.add(text)
        text = printable(text)
        colour = _COLOURS.get(record.levelno)
        if colour is not None and coloured(sys.stderr):
            text = typer.style(text, fg=colour)
        if sys.stderr is not None:  # it may be closed
            print(text, file=sys.stderr)


class _ToFile(logging.FileHandler):
    """Handler of the log file, which gives up, with one warning, if the file cannot be written."""

    def handleError(self, record: logging.LogRecord) -> None:
        error = sys.exception()
        LOG.removeHandler(self)
        stream, self.stream = self.stream, None  # or the handler would close it again, and fail again
        with suppress(OSError):
            if stream is not None:
                stream.close()
        LOG.warning("Cannot write the log file %s any more: %s.", self.baseFilename, error)


def _open_log(path: Path) -> None:
    from .._version import __version__

    try:
        if path.is_fifo():
            os.close(os.open(path, os.O_WRONLY | os.O_NONBLOCK))  # refused where no process reads it, not waited for
        handler = _ToFile(path, "a", encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"Cannot write --log-file {path}: {(error.strerror or str(error)).lower()}; name a file in a folder that "
            "exists."
        ) from error
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
    LOG.addHandler(handler)
    LOG.debug("uq-handeye %s: %s (in %s)", __version__, command_line(), Path.cwd())


def _show_warning(
    message: Warning | str, category: type[Warning], *_: str | int | TextIO | None, **__: str | int | TextIO | None
) -> None:
    if _run.held is not None and issubclass(category, InputWarning):
        _run.held.append((str(message), category))
    else:
        _warn(str(message), category)


def _warn(text: str, category: type[Warning]) -> None:
    if text in _run.said:
        return
    _run.said.add(text)
    expected = issubclass(category, InputWarning)
    LOG.warning("%s", text, extra={} if expected else {"label": f"{category.__name__}: "})
