"""Commands ``live`` and ``view``: a calibration in the browser, growing with each pose or stored."""

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
from .files import ResultFile

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
    bag: Path | None = None,
    ros: bool = False,
    frames: str | None = None,
) -> int:
    r"""Calibrate in the browser, pose by pose.

    Examples:
      # An empty session: add files in the page
      uq-handeye live
      # A folder in which robot.csv and camera.csv grow
      uq-handeye live session/ --tolerance 1mm,0.1deg
      # Poses from a pipe, one JSON line each
      uq-handeye live session/ --stdin

    Poses are on disk before the page shows them. Start the command again with
    the same folder to go on. Ctrl-C ends the page, not the session.

    Options (Page):
      * --stdin: Poses from standard input in place of files. One JSON line each: {"robot": POSE, "camera": POSE}.
      --bag BAG: Poses of a ROS bag, played back. Give the frames by --frames.
      --ros: Poses of a running ROS 2 system by tf, with a button to take one. Give the frames by --frames.
      --frames ROBOT,CAMERA: Frames of --bag and --ros, parent:child each, e.g. base:tool0,camera:tag0. Topics of poses
        for --bag, too.
    """
    from ...live_session.page import Page
    from ...live_session.session import Session

    if files.offset is not None:
        raise InputError("--offset is for unsynchronised streams. Pose k of the robot belongs to pose k of the camera.")
    if given.one_side is not None:
        if prior is not None:
            raise InputError("The noise and a prior of it are both given. Give one of them.")
        prior = given.one_side
    folder = folder_of(files.folder, files, pictures)
    question = question_of(given, pictures, {"prior": prior}, wanted.tolerance)
    sources = _sources(files, stdin, bag, ros, frames)
    if sources:  # their poses are kept in a form of our own
        folder = replace(folder, how={"setup": files.setup})
    session = Session(folder, question, _deliver(files.folder / "result"))
    if bag is not None and session.update().n:
        raise InputError(f"{files.folder} holds {session.answer.n} poses already. Play --bag into an empty folder.")
    shown = Page(session, sources, page.host, page.port)
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


def _sources(files: SessionFiles, stdin: bool, bag: Path | None, ros: bool, frames: str | None) -> "tuple[Source, ...]":
    """Return where poses come from; none: the files of the folder."""
    if stdin + (bag is not None) + ros > 1:
        raise InputError("--stdin, --bag and --ros: give one of them.")
    if (bag is not None or ros) != (frames is not None):
        raise InputError("--bag and --ros need --frames ROBOT,CAMERA, e.g. base:tool0,camera:tag0, and only these.")
    if stdin:
        from ...live_session.sources.lines import Lines

        return (Lines(sys.stdin, files.reading),)
    if frames is None:
        return ()
    robot, comma, camera = frames.partition(",")
    if not comma:
        raise InputError(f"Expected --frames as ROBOT,CAMERA, e.g. base:tool0,camera:tag0, got {frames!r}.")
    if ros:
        from ...live_session.sources.ros import tf_source

        return (tf_source(robot, camera),)
    from ...live_session.sources.bag import Playback
    from ...rosbag.streams import read_bag

    assert bag is not None
    how = {} if files.setup is None else {"setup": files.setup}
    return (Playback(*read_bag(bag, robot=robot, camera=camera), interval=1.0, how=how, name=bag.name),)


@made_of(page=PageOptions)
def view_command(result: ResultFile, page: "PageOptions") -> int:
    """Show a stored calibration in the browser.

    Examples:
      uq-handeye view result/result.json

    Ctrl-C ends the page.
    """
    from ...calibration.result import Calibration
    from ...live_session.view import ViewPage

    shown = ViewPage(Calibration.from_json(result), page.host, page.port)
    try:
        emit(f"Page: {shown.url}\nCtrl-C ends it.\n")
        if not page.no_browser and sys.stdout.isatty():
            shown.open()
        shown.wait()
    except KeyboardInterrupt:
        pass
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
