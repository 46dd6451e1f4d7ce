"""Result of `calibrate_camera`: a calibrated camera with its summary, figures and folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ...core.files.atomic import write_files
from ...core.files.open import StrPath, as_path
from ...core.presentation.document import to_text
from ...core.presentation.html import to_html
from .calibrated import Calibrated
from .calibration_files import camera_files
from .report.text import camera_document

# What a report may come with: `report.figures`.
FURTHER = {
    "report.html",
    *(
        f"{stem}.{kind}"
        for stem in ("pattern", "residuals", "pictures", "certainty", "boards", "board", "board_residuals")
        for kind in ("png", "svg")
    ),
}


@dataclass(frozen=True, eq=False)
class CameraCalibration(Calibrated):
    """A calibrated camera, the poses it saw the board at, and how well all of that is known; see `calibrate_camera`."""

    def summary(self, details: bool = False) -> str:
        """Model, intrinsics with their standard deviations, pixel noise, corners that were left out, warnings:
        as text; ``details``: with all corners that were left out and all models that were compared.
        """
        return to_text(camera_document(self, details))

    def _repr_html_(self) -> str:
        """For notebooks."""
        return to_html("Camera calibration", camera_document(self))

    def figure(self, path: StrPath, name: str = "pattern") -> Path:
        """Write a figure as ``.png`` or ``.svg``; its name is that of one of the files of `write`."""
        from ...core.presentation.figure_parts import save_figure
        from .report.figures import named_figure

        return save_figure(path, lambda: named_figure(self, name))

    def write(self, folder: StrPath) -> Path:
        """Everything as files in a folder, all or none, which `read_camera` and `read_poses` take."""
        from .report.page import report_files

        files = {**camera_files(self), **report_files(self)}
        write_files(folder, files)
        path = as_path(folder)
        for name in FURTHER - set(files):  # those of an earlier run are not of this camera
            (path / name).unlink(missing_ok=True)
        return path
