"""The form that certificates of one camera and of a rig share: identifier, page, data, and the sheet of a refusal.

The identifier is a hash of the contents without the date, so that the same result and title block give the same one.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from .._version import __version__
from ..core.files.json_files import json_text
from ..core.files.json_values import JsonObject
from ..core.presentation.document import Block, Paragraph, Section
from ..core.presentation.page import PAPERS, Page, page_path, write_page
from .statements import STANDING

NOT_CERTIFIED = "NOT CERTIFIED"
SUFFIXES = (".html", ".pdf", ".json")


class Form:
    """A certificate: its contents, which give its identifier, written as a page or as data."""

    _format: ClassVar[str]
    issued: str  # date and time, UTC

    @property
    def refusals(self) -> tuple[str, ...]:
        """Reasons why nothing is certified; empty where it is."""
        raise NotImplementedError

    @property
    def certified(self) -> bool:
        """True if the result is certified; else the page and the data give the reasons."""
        return not self.refusals

    @property
    def identifier(self) -> str:
        """Identifier of the contents, without the date: the same result and title block give the same."""
        return f"UQ-{hashlib.sha256(json.dumps(self._contents(), sort_keys=True).encode()).hexdigest()[:16].upper()}"

    def page(
        self,
        of: str,
        subject: str,
        facts: Sequence[str],
        sheets: Sequence[Sequence[Section]],
        fields: Sequence[tuple[str, str]],
    ) -> str:
        """Return the page of its sheets; nothing in it looks like a result where none is certified."""
        name = f"{of} certificate" if self.certified else f"{NOT_CERTIFIED}: {of[0].lower()}{of[1:]}"
        foot = f"{self.identifier}, issued {self.issued} by uq-handeye {__version__}. {STANDING}"
        signed = len(sheets) if self.certified else 0
        numbered = [*facts, f"No. {self.identifier}", f"issued {self.issued}"]
        return Page(name, subject, numbered, [], sheets, fields, foot, signed, kind="certificate").html()

    def _contents(self) -> JsonObject:
        raise NotImplementedError

    def to_dict(self) -> JsonObject:
        """Return the certificate as plain numbers and text, in m and rad; see the reference page for the keys."""
        head = {"format": self._format, "identifier": self.identifier, "issued": self.issued}
        return head | {"issued_by": f"uq-handeye {__version__}", **self._contents()}

    def to_html(self) -> str:
        """Return the page as one self-contained HTML text."""
        raise NotImplementedError

    def to_json(self, path: str | Path | None = None) -> str:
        """Return JSON text, also written to ``path`` (whole or not at all)."""
        return json_text(self.to_dict(), path)

    def write(self, path: str | Path, *, paper: str = PAPERS[0]) -> Path:
        """Write the certificate in the form of the suffix: .html, .pdf or .json.

        Parameters
        ----------
        path : str or Path
        paper : str
            Of the PDF: "a4" or "letter".

        Raises
        ------
        InputError
            A path with another suffix or that cannot be written.
        MissingExtraError
            A PDF where neither WeasyPrint (extra ``pdf``) nor a Chromium browser is installed.
        """
        target = page_path(path, paper, SUFFIXES)
        if target.suffix.lower() != ".json":
            return write_page(target, self.to_html(), paper)
        self.to_json(target)
        return target


def refused(*why: Block) -> Section:
    """Return the section that says that nothing is certified, and why."""
    last = Paragraph("This page states no result. It must not be used as evidence of a calibration.")
    return Section("answer", NOT_CERTIFIED, [*why, last], wide=True)
