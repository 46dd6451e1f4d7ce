"""Command ``view``: a stored result in the browser."""

from pathlib import Path

from ..touches import TouchesToUse
from .live import PageOptions, _stay


def view_command(result: Path, page: PageOptions, touched: TouchesToUse) -> int:
    """Show a stored calibration in the browser.

    Examples:
      uq-handeye view result/result.json
      # A rig with several cameras
      uq-handeye view result.json

    Ctrl-C ends the page.
    """
    from ...calibration.load import load
    from ...use.live_session.view import view_page

    shown = load(result)
    touches = touched.read(shown.kinematics)
    return _stay(view_page(shown, page.host, page.port, touches), page)
