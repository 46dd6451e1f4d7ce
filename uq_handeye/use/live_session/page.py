"""The page of a session: the panel with its buttons, the scene, and the action of each click."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...calibration.evidence.touches import Touches
from ...calibration.load import load
from ...calibration.result import Calibration
from ...errors import InputError, InputWarning
from ...model.camera.description import KINDS
from ...model.poses.pose_pairs import PosePairs
from ..maintenance.check import check
from .browser_page import BrowserPage
from .folder import board_text
from .markup import MAX_ROWS_SHOWN, panel, summary
from .nodes import Picture
from .question import ONE_AT_A_TIME, Answer
from .remedies import Remedy
from .scene import Extras, Scene, scene_of, touched
from .server import HOST, PORT
from .session import Session
from .sources import Source, feed
from .uploads import keep_bag, keep_other, keep_picture, keep_upload, thumbnail

if TYPE_CHECKING:
    import viser


# Remedies that the page offers.
MAX_REMEDIES = 4


class Page(BrowserPage):
    """One session in the browser: every browser that looks at it sees the same.

    Parameters
    ----------
    session : Session
    sources : list of Source
        Poses that come by themselves are added as they come; for the others there is a button.
    host, port
        As of `Server`.
    touches : Touches, path or None
        Points that were seen and touched, shown with each answer.
    """

    def __init__(
        self, session: Session, sources: tuple[Source, ...] = (), host: str = HOST, port: int = PORT,
        touches: Touches | Path | None = None,
    ) -> None:  # fmt: skip
        super().__init__(host, port)
        self.session, self._sources, self._touches = session, sources, touches
        self.selected: int | None = None
        self._scene = Scene(self._server.viser, self.select)
        self._build()
        session.update()
        session.listeners.append(self._show)
        self._show(session)
        self._workers: list[threading.Thread] = []
        self._work(lambda: session.run(self._stop))
        for source in sources:
            if not source.on_demand:
                self._work(partial(feed, session, source, self._stop))

    def _work(self, work: Callable[[], None]) -> None:
        self._workers.append(threading.Thread(target=work, daemon=True))
        self._workers[-1].start()

    def close(self) -> None:
        """End the page; the session stays on disk."""
        self._stop.set()
        if self._show in self.session.listeners:
            self.session.listeners.remove(self._show)
        for source in self._sources:
            source.close()
        self._workers[0].join(10.0)
        with self._drawing:  # which another worker may still do
            super().close()

    def select(self, pose: int | None) -> None:
        """Light up a pose."""
        self.selected = pose if pose is not None and 0 <= pose < self.session.answer.n else None
        self._show(self.session)

    # ------------------------------------------------------------------------------------------------------ panel

    def _build(self) -> None:
        import viser

        gui = self._gui
        self._summary = gui.add_html("")
        self._remedy_folder = gui.add_folder("Remedy", visible=False)
        self._offered: tuple[str, ...] = ()
        self._remedy_buttons: list[viser.GuiButtonHandle] = []
        for source in self._sources:
            if source.on_demand:
                self._button(f"Take pose ({source.name})", partial(self._take, source), icon="camera")
        for side in ("robot", "camera"):
            self._upload(f"Add {side} poses", partial(self._add, keep_upload, side), icon="upload")
        with gui.add_folder("Poses"):
            self._table = gui.add_html("")
            self._number: Any = gui.add_number("Pose", -1, min=-1, step=1, hint="Number of the pose; -1: none.")
            self._number.on_update(lambda _: self.select(int(self._number.value)))
            self._steps("Selected", {"Leave out": lambda: self.session.leave_out(self._chosen()),
                                     "Take back": lambda: self.session.take_back(self._chosen())})  # fmt: skip
            self._steps("Last", {"Drop last": self.session.drop_last, "Undo": self.session.undo})
        finish = gui.add_button("Finish and report", color="teal", icon=viser.IconName("file-check"))
        finish.on_click(lambda event: self._tried(lambda: self._finish(event.client)))
        with gui.add_folder("Checks, and what is included"):
            self._covered = gui.add_html("")
        with gui.add_folder("More: pictures, a bag, touches, a stored result", expand_by_default=False):
            self._kind = gui.add_dropdown("Board", KINDS, hint="Kind of board in the pictures.")
            self._board = gui.add_text("Numbers", "9x6", hint="Columns x rows: inner corners of a chessboard, "
                                            "squares of a ChArUco board, tags of a grid.")  # fmt: skip
            self._square = gui.add_text("Side", "20mm", hint="Side of a square or tag, as measured.")
            self._second = gui.add_text("Marker or gap", "15mm", hint="Side of the markers of a ChArUco board; "
                                             "gap between the tags of a grid.", visible=False)  # fmt: skip
            self._words = gui.add_text("Dictionary", "", hint="Such as 5X5_100 or tag25h9; empty: the usual one.",
                                            visible=False)  # fmt: skip
            self._kind.on_update(lambda _: self._of_kind())
            self._upload("Add a picture of the board", self._add_picture, icon="photo")
            self._frames = gui.add_text("Frames", "base:tool0,camera:tag0", hint="Robot and camera, parent:child.")
            self._upload("Play a bag of ROS (or its folder as .zip)", self._play, icon="player-play")
            self._upload("Add touched points", self._add_touches, icon="hand-finger")
            self._upload("Compare with a result", self._compare, icon="git-compare")
            self._said = gui.add_html("")
        with gui.add_folder("View", expand_by_default=False):
            self._enlarged = gui.add_number("Ellipsoid x", 0, min=0, step=10, hint="0: by its size")
            self._enlarged.on_update(lambda _: self._enlarge())
            dark = gui.add_checkbox("Dark", False)
            dark.on_update(lambda _: self._theme(dark.value))

    def _steps(self, label: str, steps: dict[str, Callable[[], Answer]]) -> None:
        """Add small buttons in one row."""
        group = self._gui.add_button_group(label, tuple(steps))

        def work() -> None:
            steps[group.value]()

        group.on_click(lambda _: self._tried(work))

    def _say(self, problem: str) -> None:
        self.session.note(problem)

    def _chosen(self) -> int:
        if self.selected is None:
            raise InputError("No pose is selected. Click a row of the table or a pose in the scene.")
        return self.selected

    def _take(self, source: Source) -> None:
        pair = source.take()
        if pair is not None:
            self.session.add(*pair)

    def _add(self, keep: Callable[..., Path], side: str, name: str, content: bytes) -> None:
        keep(self.session.folder.path, side, name, content)
        self.session.update()

    def _add_picture(self, name: str, content: bytes) -> None:
        """Keep a picture; with robot poses as files and no camera poses it is one of the board."""
        keep_picture(self.session.folder.path, name, content)
        if self.session.folder.seen is None and not self.session.folder.holds_camera:
            given = (self._kind, self._board, self._square, self._second, self._words)
            self.session.look_for(board_text(*(one.value for one in given)))
        self.session.update()

    def _of_kind(self) -> None:
        """Ask for what this kind of board has."""
        kind = self._kind.value
        self._board.visible = kind != "apriltag"
        self._second.visible = kind not in ("chessboard", "apriltag")
        self._words.visible = kind != "chessboard"

    def _play(self, name: str, content: bytes) -> None:
        """Add the poses of a bag, one after the other."""
        from ...read.rosbag.streams import read_bag
        from .playback import Playback

        self.session.require_own()
        robot, _, camera = self._frames.value.partition(",")
        path = keep_bag(self.session.folder.path, name, content)
        source = Playback(*read_bag(path, robot=robot.strip(), camera=camera.strip()), interval=0.0, name=path.name)
        self._work(lambda: feed(self.session, source, self._stop))

    def _add_touches(self, name: str, content: bytes) -> None:
        self._touches = keep_other(self.session.folder.path, "touches", ".csv", "a table of touches", name, content)
        self._show(self.session)

    def _compare(self, name: str, content: bytes) -> None:
        """Hold the poses of the session against a stored result, and say whether it still holds."""
        poses = self.session.answer.poses
        if poses is None:
            raise InputError("There are no poses yet to compare with a result.")
        path = keep_other(
            self.session.folder.path, "compared", ".json", "the result.json of a calibration", name, content
        )
        kept = [k for k in range(poses.n) if k not in self.session.choice.left_out]
        with ONE_AT_A_TIME, warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)
            stored, new = load(path), poses.rows(np.array(kept, dtype=np.intp))
            cameras = stored.camera_names
            heads = {name: f"{name}:\n" if len(cameras) > 1 else "" for name in cameras}
            found = (f"{head}{check(stored.of_camera(name), new).summary()}" for name, head in heads.items())
            text = "\n".join(found)
        self._said.content = panel("preformatted", text)

    def _finish(self, client: viser.ClientHandle | None) -> None:
        """Write result and report, and download the report in the browser that asks for it."""
        folder = self.session.finish()
        if client is not None:
            client.send_file_download("report.html", (folder / "report.html").read_bytes(), save_immediately=True)
            client.add_notification("Finished", f"Result and report are in {folder}.", color="teal")

    def _enlarge(self) -> None:
        self._scene.enlarged = int(self._enlarged.value) or None
        self._show(self.session)

    # ------------------------------------------------------------------------------------------------------- show

    def _show(self, session: Session) -> None:
        """Bring the page up to the answer."""
        with self._drawing, self._server.viser.atomic():
            if self._stop.is_set():
                return
            answer = session.answer
            if self.selected is not None and self.selected >= answer.n:
                self.selected = None
            number = -1 if self.selected is None else self.selected
            if self._number.value != number:
                self._number.value = number
            self._set(self._summary, summary(session))
            if session.computing:  # the rest follows with the answer
                self._offer(())
                return
            self._offer(answer.remedies)
            self._set(self._table, panel("poses", answer, self.selected, self._number._impl.uuid, MAX_ROWS_SHOWN))
            self._set(self._covered, panel("covered", answer.result))
            in_hand = session.folder.how.get("setup") in (None, "eye-in-hand")
            self._scene.show(answer, self.selected, in_hand, self._extras(answer.poses, answer.result))

    def _offer(self, remedies: tuple[Remedy, ...]) -> None:
        """Show a button for each remedy, and one that takes the chosen readings of the files back."""
        work: dict[str, Callable[[], Answer]] = {
            one.label: partial(self.session.remedy, one) for one in remedies[:MAX_REMEDIES]
        }
        if self.session.choice.how and not self.session.computing:
            work["Read the files as before"] = self.session.read_as_before
        if tuple(work) == self._offered:
            return
        self._offered = tuple(work)
        for button in self._remedy_buttons:
            button.remove()
        with self._remedy_folder:
            self._remedy_buttons = [self._gui.add_button(label, color="orange") for label in work]
        for button, action in zip(self._remedy_buttons, work.values(), strict=True):
            button.on_click(partial(self._mend, action))
        self._remedy_folder.visible = bool(work)

    def _mend(self, action: Callable[[], Answer], _: Any) -> None:
        def work() -> None:
            action()

        self._tried(work)

    def _extras(self, poses: PosePairs | None, result: Calibration | None) -> Extras:
        """Return pictures, touched points and the scene; what cannot be used is said where it was added."""
        things = scene_of(poses)
        if things is None and self.session.folder.of_scene:
            things = np.zeros((0, 3))
        if poses is None or result is None:
            return Extras(scene=things)
        pictures: list[Picture] = [
            (str(path), partial(_pixels, path)) for path in self.session.folder.pictures_of(poses)
        ]
        points = None
        if self._touches is not None:
            try:
                points = touched(result, self._touches)
                self._set(self._said, panel("preformatted", points.words))
            except InputError as error:
                self._set(self._said, panel("preformatted", str(error)))
        return Extras(pictures, points, things)


def _pixels(path: Path) -> NDArray[np.uint8] | None:
    """Return a picture as it is drawn on its camera; None where it cannot be read."""
    try:
        return thumbnail(path)
    except InputError:
        return None
