"""Command ``live``: a calibration in the browser, growing with each pose."""

import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ...errors import InputError
from ..options.common import emit, made_of
from ..options.noise import Given, given_of, prior_of
from ..outcome import Wanted, wanted_of
from ..stream_files import StreamFiles
from ..views import pictures_of
from ..watching import folder_of, question_of
from .calibrate import Files

if TYPE_CHECKING:
    from ...live_session.question import Answer
    from ...live_session.sources.source import Source
    from ...noise.estimate import NoisePrior
    from ..pictures import Pictures
    from ..views import Views


@dataclass(frozen=True)
class SessionFiles(StreamFiles):
    """Folder of a session, and how its files are read."""

    robot: Annotated[
        Path | None,
        typer.Argument(
            metavar="DIR",
            help="Folder of the session, made if missing. Poses that are there are used; files robot* and camera* of "
            "another program may grow in it. Default: session.",
            show_default=False,
        ),
    ] = None
    camera: Path | None = field(default=None, init=False)

    @property
    def folder(self) -> Path:
        """Folder of the session."""
        return self.robot or Path("session")


@dataclass(frozen=True)
class PageOptions:
    """Options of the address of the page.

    Options (Page):
      --host ADDRESS: Address to listen on. Default: 127.0.0.1, this machine alone. Another one, e.g. 0.0.0.0, asks for
        the token in the address printed.
      --port N: Port, or the next one that is free. Default: 8011.
      --no-browser: Print the address without opening it.
    """

    host: str = "127.0.0.1"
    port: int = 8011
    no_browser: bool = False


@made_of(
    files=SessionFiles,
    pictures=pictures_of,
    given=given_of,
    prior=prior_of,
    wanted=wanted_of,
    page=PageOptions,
)
def live_command(
    files: "SessionFiles",
    pictures: "Pictures | Views | None",
    given: "Given",
    prior: "NoisePrior | None",
    wanted: "Wanted",
    page: "PageOptions",
    stdin: bool = False,
) -> int:
    r"""Calibrate in the browser while poses arrive: the answer after each, and where the next pose should be.

    Examples:
      # An empty session: add files in the page
      uq-handeye live
      # A folder in which robot.csv and camera.csv grow
      uq-handeye live session/ --tolerance 1mm,0.1deg
      # Poses from any program that prints a JSON line for each
      robot-program | uq-handeye live session/ --stdin

    Poses are on disk before the page shows them. Start the command again with
    the same folder to go on. Ctrl-C ends the page, not the session.

    Options (Page):
      * --stdin: Poses from standard input in place of files. One JSON line each: {"robot": POSE, "camera": POSE}.
    """
    from ...live_session.page import Page
    from ...live_session.session import Session
    from ...live_session.sources.lines import Lines

    if files.offset is not None:
        raise InputError("--offset is for unsynchronised streams. Pose k of the robot belongs to pose k of the camera.")
    if given.one_side is not None:
        if prior is not None:
            raise InputError("The noise and a prior of it are both given. Give one of them.")
        prior = given.one_side
    folder = folder_of(files.folder, files, pictures)
    question = question_of(given, pictures, {"prior": prior}, wanted.tolerance)
    sources: tuple[Source, ...] = (Lines(sys.stdin, files.reading),) if stdin else ()
    if stdin:
        own: dict[str, Any] = {"setup": files.setup}
        folder = replace(folder, how=own)
    shown = Page(Session(folder, question, _deliver(files.folder / "result")), sources, page.host, page.port)
    try:
        emit(f"Session in {files.folder}. Page: {shown.url}\nCtrl-C ends it.\n")
        if not page.no_browser and sys.stdout.isatty():
            shown.open()
        shown.wait()
    except KeyboardInterrupt:
        emit(f"Ended with {shown.session.answer.n} poses in {files.folder}.\n")
    finally:
        shown.close()
    return 0


def _deliver(folder: Path) -> Any:
    """Return what writes result, exports and report of an answer as ``calibrate -o`` does."""

    def deliver(answer: "Answer") -> Path:
        assert answer.result is not None
        Files(folder, folder / "report.html", comparison=False).write(answer.result, answer.verdict)
        return folder

    return deliver
