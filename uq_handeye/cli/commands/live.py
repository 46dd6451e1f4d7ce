"""Command ``live``: a calibration that grows in the browser."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from ...errors import InputError
from ..arm import arm_alone
from ..delivery import Outputs, tolerance_of
from ..noise import Given, noise_of
from ..pictures import Pictures, pictures_of
from ..pose_files import StreamFiles
from ..printing import emit
from ..touches import TouchesToUse
from ..watching import folder_of, question_of

if TYPE_CHECKING:
    from ...calibration.tolerance import Tolerance
    from ...use.live_session.browser_page import BrowserPage
    from ...use.live_session.question import Answer
    from ...use.live_session.sources import Side, Source
    from ..arm import Arm
    from ..pictures import Pictures
    from ..views import Views


@dataclass(frozen=True)
class SessionFiles(StreamFiles):
    """Folder of a session, and how its files are read.

    Arguments:
      robot = DIR: Folder of the session, made if missing. Poses that are there are used; files robot* and camera* of
        another program may grow in it. Default: session.
    """

    robot: Path | None = None
    camera: Path | None = field(default=None, init=False)

    @property
    def folder(self) -> Path:
        """Folder of the session."""
        return self.robot or Path("session")


class PageOptions(NamedTuple):
    """Options of the address of the page.

    Options (Page):
      --host ADDRESS: Address to listen on. Default: 127.0.0.1, this machine alone. 0.0.0.0 lets
        other machines in, too. The address printed holds a token.
      --port N: Port, or the next one that is free. Default: 8011.
      --no-browser: Print the address without opening it.
    """

    host: str = "127.0.0.1"
    port: int = 8011
    no_browser: bool = False


class SourceOptions(NamedTuple):
    """Options of sources of poses other than the files of the folder.

    Options (Sources):
      * --stdin: Poses from standard input in place of files. One JSON line each: {"robot": POSE, "camera": POSE}.
      --bag BAG: Poses of a ROS bag, played back. Give the frames by --frames.
      --ros: Poses of a running ROS 2 system, with a button to take one. Give frames or topics by --frames.
      --rtde HOST: Robot poses of a Universal Robots arm by RTDE, taken when a camera pose comes by --stdin, or by the
        button of --ros. It is then CAMERA alone that --frames names.
      --frames ROBOT,CAMERA: Frames of --bag and --ros, parent:child each, e.g. base:tool0,camera:tag0, or topics of
        poses, e.g. /tcp_pose.
    """

    stdin: bool = False
    bag: Path | None = None
    ros: bool = False
    rtde: str | None = None
    frames: str | None = None


def live_command(
    files: SessionFiles,
    arm: Annotated["Arm | None", arm_alone],
    pictures: Annotated["Pictures | Views | None", pictures_of],
    given: Annotated["Given", noise_of],
    tolerance: Annotated["Tolerance | None", tolerance_of],
    page: PageOptions,
    come: SourceOptions,
    touched: TouchesToUse,
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
    """
    from ...use.live_session.page import Page
    from ...use.live_session.session import Session

    if files.offset is not None:
        raise InputError("--offset is for unsynchronised streams. Pose k of the robot belongs to pose k of the camera.")
    folder = folder_of(files.folder, files, pictures)
    options: dict[str, Any] = {}
    if arm is not None:
        folder = replace(folder, how={**folder.how, **arm.of_files})
        options |= arm.of_calibrate
    question = question_of(given, pictures, options, tolerance)
    touches = touched.read(None)
    sources = _sources(files, come)
    if sources:  # their poses are kept in a form of our own
        folder = replace(folder, how={"setup": files.setup})
    session = Session(folder, question, _deliver(files.folder / "result"))
    if come.bag is not None and session.update().n:
        raise InputError(f"{files.folder} holds {session.answer.n} poses already. Play --bag into an empty folder.")
    shown = Page(session, sources, page.host, page.port, touches=touches)
    return _stay(
        shown, page, f"Session in {files.folder}. ",
        lambda: f"Ended with {session.answer.n} poses in {files.folder}.\n",
    )  # fmt: skip


def _sources(files: SessionFiles, given: SourceOptions) -> "tuple[Source, ...]":
    """Return where poses come from; none: the files of the folder."""
    stdin, bag, ros, rtde, frames = given.stdin, given.bag, given.ros, given.rtde, given.frames
    if stdin + (bag is not None) + ros > 1:
        raise InputError("--stdin, --bag and --ros: give one of them.")
    if rtde is not None and not (stdin or ros):
        raise InputError("--rtde gives the robot poses. Add --stdin or --ros --frames CAMERA for the camera poses.")
    if (bag is not None or ros) != (frames is not None):
        raise InputError("--bag and --ros need --frames ROBOT,CAMERA, e.g. base:tool0,camera:tag0, and only these.")
    if stdin:
        from ...use.live_session.json_lines import Lines

        return (Lines(sys.stdin, files.reading, robot=_arm(rtde)),)
    if frames is None:
        return ()
    robot, comma, camera = frames.partition(",")
    if not comma and rtde is not None:
        robot, comma, camera = "", ",", frames
    if not comma or (rtde is not None and robot):
        wanted = "ROBOT,CAMERA, e.g. base:tool0,camera:tag0" if rtde is None else "CAMERA, e.g. camera:tag0"
        raise InputError(f"Expected --frames as {wanted}, got {frames!r}.")
    if ros:
        from ...use.live_session.ros2 import Node
        from ...use.live_session.sources import Taken

        node = Node()
        return (Taken("ROS" if rtde is None else "RTDE, ROS", _arm(rtde) or node.side(robot), node.side(camera)),)
    from ...read.rosbag.streams import read_bag
    from ...use.live_session.playback import Playback

    assert bag is not None
    how = {} if files.setup is None else {"setup": files.setup}
    return (Playback(*read_bag(bag, robot=robot, camera=camera), interval=1.0, how=how, name=bag.name),)


def _arm(host: str | None) -> "Side | None":
    from ...use.live_session.universal_robots import Ur

    return None if host is None else Ur(host)


def _stay(shown: "BrowserPage", page: PageOptions, said: str = "", ended: Callable[[], str] = str) -> int:
    """Print the address, open it, and stay until Ctrl-C."""
    try:
        emit(f"{said}Page: {shown.url}\nCtrl-C ends it.\n")
        if not page.no_browser and sys.stdout.isatty():
            shown.open()
        shown.wait()
    except KeyboardInterrupt:
        emit(ended())
    finally:
        shown.close()
    return 0


def _deliver(folder: Path) -> "Callable[[Answer], Path]":
    """Return what writes result, exports and report of an answer as ``calibrate -o`` does."""

    def deliver(answer: "Answer") -> Path:
        assert answer.result is not None
        Outputs(folder / "report.html", no_compare=True, output=folder).write(answer.result, answer.verdicts)
        return folder

    return deliver
