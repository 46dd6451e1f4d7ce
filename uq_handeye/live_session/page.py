"""The page of a session: the panel with its buttons, the scene, and what a click does."""

from __future__ import annotations

import threading
import warnings
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..calibration.result import Calibration
from ..errors import InputError, InputWarning, NotConvergedError
from ..maintenance.check import check
from .markup import preformatted, summary, table
from .scene import Scene
from .server import HOST, PORT, Server
from .session import Session
from .sources.source import Source, feed
from .uploads import keep_result, keep_upload


class Page:
    """One session in the browser: every browser that looks at it sees the same.

    Parameters
    ----------
    session : Session
    sources : list of Source
        Poses that come by themselves are added as they come; for the others there is a button.
    host, port, token
        As of `Server`.
    """

    def __init__(
        self, session: Session, sources: tuple[Source, ...] = (), host: str = HOST, port: int = PORT,
        token: str | None = None,
    ) -> None:  # fmt: skip
        self.session, self._sources = session, sources
        self._stop = threading.Event()
        self.selected: int | None = None
        self._drawing = threading.Lock()
        self._server = Server(host, port, token)
        self._gui = self._server.viser.gui
        self._scene = Scene(self._server.viser, self.select)
        self._build()
        session.update()
        session.listeners.append(self._show)
        self._show(session)
        workers: list[tuple[Callable[..., None], tuple[Any, ...]]] = [(session.run, (self._stop,))]
        workers += [(feed, (session, source, self._stop)) for source in sources if not source.on_demand]
        self._workers = [threading.Thread(target=work, args=with_, daemon=True) for work, with_ in workers]
        for worker in self._workers:
            worker.start()

    @property
    def url(self) -> str:
        """Address of the page."""
        return self._server.url

    def open(self) -> None:
        """Open the page in the browser of this machine, where there is one."""
        with suppress(webbrowser.Error):
            webbrowser.open(self.url)

    def wait(self) -> None:
        """Stay until Ctrl-C."""
        while not self._stop.wait(0.5):
            pass

    def close(self) -> None:
        """End the page; the session stays on disk."""
        self._stop.set()
        if self._show in self.session.listeners:
            self.session.listeners.remove(self._show)
        for source in self._sources:
            source.close()
        self._workers[0].join(10.0)
        self._server.close()

    def select(self, pose: int | None) -> None:
        """Light up a pose."""
        self.selected = pose if pose is not None and 0 <= pose < self.session.answer.n else None
        self._show(self.session)

    # ------------------------------------------------------------------------------------------------------ panel

    def _build(self) -> None:
        gui = self._gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        gui.set_panel_label("uq-handeye")
        self._summary = gui.add_html("")
        for source in self._sources:
            if source.on_demand:
                self._button(f"Take pose ({source.name})", partial(self._take, source), color="teal")
        for label, side in (("Add robot poses", "robot"), ("Add camera poses", "camera")):
            button = gui.add_upload_button(label)
            button.on_upload(partial(self._uploaded, side))
        compare = gui.add_upload_button("Compare with a result", color="gray")
        compare.on_upload(lambda event: self._tried(lambda: self._compare(event.target.value)))
        self._compared = gui.add_html("")
        with gui.add_folder("Poses"):
            self._table = gui.add_html("")
            self._number: Any = gui.add_number("Pose", -1, min=-1, step=1, hint="Number of the pose; -1: none.")
            self._number.on_update(lambda _: self.select(int(self._number.value)))
            self._button("Leave out", lambda: self.session.leave_out(self._chosen()))
            self._button("Take back", lambda: self.session.take_back(self._chosen()))
            self._button("Leave out the last", self.session.drop_last)
            self._button("Undo", self.session.undo)
        finish = gui.add_button("Finish and report", color="blue")
        finish.on_click(lambda event: self._tried(lambda: self._finish(event.client)))
        with gui.add_folder("View", expand_by_default=False):
            self._enlarged = gui.add_number("Ellipsoid x", 0, min=0, step=10, hint="0: by its size")
            self._enlarged.on_update(lambda _: self._enlarge())
            dark = gui.add_checkbox("Dark", False)
            dark.on_update(lambda _: gui.configure_theme(
                show_logo=False, show_share_button=False, control_width="large", dark_mode=dark.value))  # fmt: skip
            self._factor = gui.add_html("")

    def _button(self, label: str, work: Callable[[], Any], **look: Any) -> None:
        self._gui.add_button(label, **look).on_click(lambda _: self._tried(work))

    def _tried(self, work: Callable[[], Any]) -> None:
        """Do what a click asks for; what cannot be done is said on the page."""
        try:
            work()
        except (InputError, NotConvergedError) as error:
            self.session.note(str(error))

    def _chosen(self) -> int:
        if self.selected is None:
            raise InputError("No pose is selected. Click a row of the table or a pose in the scene.")
        return self.selected

    def _take(self, source: Source) -> None:
        pair = source.take()
        if pair is not None:
            self.session.add(*pair)

    def _uploaded(self, side: str, event: Any) -> None:
        file = event.target.value

        def work() -> None:
            keep_upload(self.session.folder.path, side, file.name, file.content)
            self.session.update()

        self._tried(work)

    def _compare(self, file: Any) -> None:
        """Hold the poses of the session against a stored result, and say whether it still holds."""
        poses = self.session.answer.poses
        if poses is None:
            raise InputError("There are no poses yet to compare with a result.")
        kept = [k for k in range(poses.n) if k not in self.session.choice.left_out]
        stored = Calibration.from_json(keep_result(self.session.folder.path / "compared", file.name, file.content))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)
            found = check(stored, poses.rows(np.array(kept, dtype=np.intp)))
        self._compared.content = preformatted(found.summary())

    def _finish(self, client: Any) -> None:
        folder: Path = self.session.finish()
        report = folder / "report.html"
        client.send_file_download("report.html", report.read_bytes())
        client.add_notification("Finished", f"Result and report are in {folder}.", color="teal")

    def _enlarge(self) -> None:
        self._scene.enlarged = int(self._enlarged.value) or None
        self._show(self.session)

    # ------------------------------------------------------------------------------------------------------- show

    def _show(self, session: Session) -> None:
        """Bring the page up to the answer."""
        with self._drawing, self._server.viser.atomic():
            if self.selected is not None and self.selected >= session.answer.n:
                self.selected = None
            number = -1 if self.selected is None else self.selected
            if self._number.value != number:
                self._number.value = number
            _set(self._summary, summary(session))
            _set(self._table, table(session, self.selected, self._number._impl.uuid))
            in_hand = session.folder.how.get("setup") in (None, "eye-in-hand")
            factor = self._scene.show(session.answer, self.selected, in_hand)
            text = f"<div class='uq dim'><p>Ellipsoid of X: 1 sigma, drawn {factor} times as large.</p></div>"
            _set(self._factor, text)


def _set(element: Any, content: str) -> None:
    if element.content != content:
        element.content = content
