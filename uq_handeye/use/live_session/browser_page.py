"""Base class of the pages in a browser: panel, buttons, opening, waiting and closing."""

from __future__ import annotations

import threading
import webbrowser
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from ...errors import InputError, MissingExtraError, NotConvergedError
from .server import HOST, PORT, Server

if TYPE_CHECKING:
    import viser


class BrowserPage:
    """A page with a panel at its right edge (on a phone: below)."""

    def __init__(self, host: str = HOST, port: int = PORT) -> None:
        self._server = Server(host, port)
        self._stop, self._drawing = threading.Event(), threading.Lock()
        self._gui = self._server.viser.gui
        self._gui.set_panel_label("uq-handeye")
        self._gui.main_panel.dock_right()
        self._theme(False)

    def _theme(self, dark: bool) -> None:
        self._gui.configure_theme(show_logo=False, show_share_button=False, control_width="large", dark_mode=dark)

    @property
    def url(self) -> str:
        """Address of the page, with its token."""
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
        """End the page."""
        self._stop.set()
        self._server.close()

    def _button(self, label: str, work: Callable[[], None], icon: str) -> None:
        from viser import IconName

        self._gui.add_button(label, color="teal", icon=IconName(icon)).on_click(lambda _: self._tried(work))

    def _upload(self, label: str, work: Callable[[str, bytes], None], icon: str) -> None:
        """Add a button that takes a file: its name, and its content."""
        from viser import IconName

        button = self._gui.add_upload_button(label, icon=IconName(icon))
        button.on_upload(lambda event: self._tried(lambda: work(event.target.value.name, event.target.value.content)))

    def _tried(self, work: Callable[[], None]) -> None:
        """Do what a click starts; an error is shown on the page."""
        try:
            work()
        except (InputError, NotConvergedError, MissingExtraError) as error:
            self._say(str(error))

    def _say(self, problem: str) -> None:
        """Show a problem in one line."""
        raise NotImplementedError

    @staticmethod
    def _set(element: viser.GuiHtmlHandle, content: str) -> None:
        """Change the text of an element, which is sent to each browser, where it differs."""
        if element.content != content:
            element.content = content
