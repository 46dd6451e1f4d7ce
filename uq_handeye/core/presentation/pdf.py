"""The report as PDF: by WeasyPrint where it is installed, else by a Chromium browser.

Both print the same HTML with its print style. WeasyPrint also writes the page numbers of the contents.
"""

from __future__ import annotations

import logging
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ...errors import InputError, MissingExtraError
from ..files.atomic import require_writable_file, write_atomically

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
# Nothing from the network, no first-run pages, no state that stays. Without its sandbox it also runs in a container and
# as root; what it opens is the report alone, whose policy forbids every request and every script but its own.
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
)
PAPERS = ("a4", "letter")
# Seconds that a browser may take.
PATIENCE = 120


def page_path(path: str | Path, paper: str, suffixes: Sequence[str] = (".html", ".pdf")) -> Path:
    """Return the path of a page that can be written; raises `InputError` for another suffix or paper."""
    found = Path(path)
    if found.suffix.lower() not in suffixes:
        listed = (" or " if len(suffixes) == 2 else ", ").join(suffixes)
        raise InputError(f"Expected `path` to end in {listed}, got {found.name!r}.")
    if paper not in PAPERS:
        raise InputError(f"Expected `paper` to be {' or '.join(PAPERS)}, got {paper!r}.")
    require_writable_file(found)
    return found


def write_page(path: Path, html: str, paper: str) -> Path:
    """Write a page as its suffix says, whole or not at all."""
    write_atomically(path, html if path.suffix.lower() == ".html" else to_pdf(html, paper))
    return path


def to_pdf(html: str, paper: str = PAPERS[0]) -> bytes:
    """Print a self-contained HTML text on paper of one of `PAPERS`.

    Raises
    ------
    MissingExtraError
        Neither WeasyPrint nor a browser is installed.
    InputError
        The browser did not print.
    """
    html = html.replace("</style>", f"@page {{ size: {paper}; }}\n</style>", 1)
    if (printer := found_weasyprint()) is not None:
        return _by_weasyprint(html, printer)
    if (browser := found_browser()) is not None:
        return _by_browser(html, browser)
    raise MissingExtraError(
        "A report as PDF needs WeasyPrint (in the clone: pip install '.[pdf]') or an installed Chromium or "
        "Chrome; or write a .html file and print it from any browser."
    )


def found_browser() -> str | None:
    """The path of a Chromium browser, if there is one."""
    return next((path for name in BROWSERS if (path := shutil.which(name)) is not None), None)


def found_weasyprint() -> Any:
    """The package, or None where it or the libraries that it needs (Pango) are not installed."""
    try:
        import weasyprint  # type: ignore[import-untyped]
    except (ImportError, OSError):
        return None
    return weasyprint


def _by_weasyprint(html: str, weasyprint: Any) -> bytes:
    with _silent("weasyprint", "fontTools"):  # it warns of style that is for screens alone
        return bytes(weasyprint.HTML(string=html, base_url=None, url_fetcher=_refuse).write_pdf())


@contextmanager
def _silent(*names: str) -> Iterator[None]:
    """Loggers that say nothing below an error, as long as it lasts."""
    loggers = [logging.getLogger(name) for name in names]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _refuse(url: str, *_: Any, **__: Any) -> Any:
    raise ValueError(f"the report loads nothing, got {url[:80]!r}")


def _by_browser(html: str, browser: str) -> bytes:
    with tempfile.TemporaryDirectory(prefix="uq-handeye-", ignore_cleanup_errors=True) as folder:
        page, pdf = Path(folder, "report.html"), Path(folder, "report.pdf")
        page.write_text(html, encoding="utf-8")
        command = [
            browser, *FLAGS, f"--user-data-dir={folder}/profile", "--no-pdf-header-footer", f"--print-to-pdf={pdf}",
            page.as_uri(),
        ]  # fmt: skip
        try:
            subprocess.run(command, capture_output=True, timeout=PATIENCE, check=True)
            return pdf.read_bytes()
        except (OSError, subprocess.SubprocessError) as error:
            reason = getattr(error, "strerror", None) or type(error).__name__
            raise InputError(
                f"{Path(browser).name} did not print the report ({reason}): write a .html file and print it, or "
                "install WeasyPrint (in the clone of uq-handeye: pip install '.[pdf]')."
            ) from error
