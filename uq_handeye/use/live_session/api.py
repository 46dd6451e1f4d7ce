"""The Python functions that open the page: `live` follows a session, `view` shows a stored result."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from numpy.typing import ArrayLike

from ...calibration.result import Calibration
from ...calibration.tolerance import Tolerance
from ...core.files.open import StrPath, as_path
from ...core.geometry.frames import SETUPS
from ...errors import require_one_of
from .folder import Folder
from .page import Page
from .question import Answer, Question
from .server import HOST, PORT
from .session import Session
from .sources import Source


class Live:
    """A session with its page; ends with `close`, or as a context."""

    def __init__(self, session: Session, page: Page) -> None:
        self.session, self._page = session, page

    @property
    def url(self) -> str:
        """Address of the page."""
        return self._page.url

    @property
    def result(self) -> Calibration | None:
        """Calibration of the poses so far; None where they do not determine X."""
        return self.session.answer.result

    def add(self, robot: ArrayLike, camera: ArrayLike, time: float | None = None) -> Answer:
        """Keep a pair of poses, base_T_gripper and camera_T_target (4, 4) in m, and return the answer with it."""
        return self.session.add(robot, camera, time)

    def leave_out(self, *poses: int) -> Answer:
        """Leave poses out, by their numbers from 0."""
        return self.session.leave_out(*poses)

    def take_back(self, *poses: int) -> Answer:
        """Take poses back that were left out."""
        return self.session.take_back(*poses)

    def finish(self) -> Path:
        """Write result.json and report.html, and return their folder."""
        return self.session.finish()

    def close(self) -> None:
        """End the page; the poses stay in the folder."""
        self._page.close()

    def __enter__(self) -> Live:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def live(
    folder: StrPath = "session",
    *,
    setup: str | None = None,
    tolerance: Any = None,
    sources: Sequence[Source] = (),
    host: str = HOST,
    port: int = PORT,
    open_browser: bool = False,
    **options: Any,
) -> Live:
    """Open a live page: the answer after each pose, in the browser.

    Parameters
    ----------
    folder : path
        Folder of the session, made if missing; poses that are there are used.
    setup : "eye-in-hand", "eye-to-hand" or None
        None: eye-in-hand, unless a file says otherwise.
    tolerance : Tolerance, text such as "1mm,0.1deg", or None
        Asked for after each pose.
    sources : sequence of Source
        Where poses come from beside `Live.add` (`live_session.sources`).
    host, port : str, int
        Address of the page. `Live.url` holds a token, without which the page does not open.
    open_browser : bool
        Open the page in the browser of this machine.
    **options
        Further arguments of `calibrate`: ``noise``, ``shared``, ``prior``, ``sizes``, ...

    Raises
    ------
    MissingExtraError
        viser is not installed (extra ``live``).
    InputError
        A folder, tolerance or address that cannot be used.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> with uq.live("session") as session:  # doctest: +SKIP
    ...     session.add(base_T_gripper, camera_T_target)
    """
    noise, shared = options.pop("noise", None), options.pop("shared", None)
    asked = Question(options, lambda _: (noise, shared), None if tolerance is None else Tolerance.read(tolerance))
    if setup is not None:
        require_one_of("setup", setup, SETUPS, "--setup")
    session = Session(Folder(as_path(folder), {} if setup is None else {"setup": setup}), asked)
    page = Page(session, tuple(sources), host, port)
    if open_browser:
        page.open()
    return Live(session, page)
