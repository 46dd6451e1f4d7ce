"""The result of a rig calibration: all its poses with their joint covariance, and the operations on them.

`RigCalibration` adds to the poses its text and file, the report, exports, and the check, prediction and plan with new
views.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

from numpy.typing import ArrayLike

from ..core.files.json_files import json_text
from ..core.files.open import StrPath
from ..core.geometry.conventions import convention_of
from ..core.geometry.se3 import Array
from ..core.presentation.document import COLUMNS, document_of, to_text
from ..core.presentation.html import html_of
from ..errors import InputError
from ..formats.export import Several, write_several
from ..formats.snippets import OPEN_SD_M, Transform, with_open
from ..model.poses.estimated_pose import EstimatedPose
from ..model.rig.description import WORLD
from .of_camera import of_camera
from .prediction.points_of_cameras import RigPoints, predict_points
from .report import rig_sections as rig_sections  # registers the text of a rig
from .result import Calibration
from .rig_result_file import from_dict, to_dict
from .rig_statement import RigStatement
from .stored_result import OF_RIG, StoredResult
from .tolerance import Tolerance, ToleranceLike, Verdict, probability_within, verdict_of_pose


@dataclass(frozen=True, eq=False)
class RigCalibration(RigStatement, StoredResult):
    """All poses of a rig with their joint covariance, and operations on them; attributes as `RigPoses`."""

    @property
    def identity(self) -> tuple[str, tuple[Array | None, ...]]:
        """All poses with their covariance, of a rig."""
        return OF_RIG, (self.poses, self.covariance)

    def summary(self, verbose: bool = False) -> str:
        """Return the answer, the poses with the sizes of their errors, and the checks; ``verbose``: all sections."""
        return to_text(document_of(self, verbose=verbose), COLUMNS)

    text = summary

    def _repr_html_(self) -> str:
        """The result in a notebook: answer and poses, and the numbers behind them."""
        return html_of(self)

    def of_camera(self, camera: str | None = None, target: str | None = None) -> Calibration:
        """Return one camera with one target as the result of one camera, by its marginal posterior (`of_camera`).

        ``camera`` None: the first; ``target`` None: the one that the camera sees most often.
        """
        return of_camera(self, self.camera_names[0] if camera is None else camera, target)

    def verdicts(self, tolerance: ToleranceLike | None, at: str | float | None = None) -> dict[str, Verdict]:
        """Return whether the pose of each camera meets a tolerance, by its name; none without one."""
        if tolerance is None:
            return {}
        wanted = Tolerance.read(tolerance, at)
        reasons = [f"X is not usable: {reason}" for reason in self.reasons[:1]] or self.doubts[:1]
        return {name: verdict_of_pose(one, self.reference, wanted, reasons) for name, one in self.cameras.items()}

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers and texts: poses by name, relative poses, and all that `from_dict` reads; see `files`."""
        return to_dict(self, tuple(part.name for part in fields(self)))

    def conformity(self, camera: str, tolerance: Tolerance) -> float:
        """Return the probability that the pose of a camera lies within a tolerance."""
        one = self.cameras[camera]
        return probability_within(one.covariance, self.reference, tolerance, one.pose[:3, :3])

    def export(self, path: StrPath, format: str | None = None, *, covariance_convention: str = "toolkit") -> Path:
        """Write all poses and relative poses for another program; see `uq_handeye.formats.export`.

        ``format``: json, ros, launch, urdf, opencv, toml or npz; None: by the suffix. Their covariances have the
        convention of the toolkit: that of another one is for a single pose (`Calibration.export`).
        """
        if convention_of(covariance_convention).name != "toolkit":
            raise InputError(
                "Expected no `covariance_convention` (--covariance-convention) for several poses in one file. Choose "
                f"one: --camera {self.camera_names[0]}."
            )
        return write_several(several_of(self), path, format)

    def report(self, path: StrPath, **options: Any) -> Path:
        """Write the report, .html or .pdf; options as those of `Calibration.report`."""
        from ..report.page import write_report

        return write_report(self, Path(path), **options)

    # ------------------------------------------------------------------------------------------- in use

    def predict(
        self, camera: str, points: ArrayLike, robot: Mapping[str, ArrayLike] | None = None, into: str = WORLD
    ) -> RigPoints:
        """Predict the position of points that a camera sees; see `uq_handeye.use.planning.next_views`."""
        return predict_points(self, camera, points, robot, into)

    @classmethod
    def from_dict(cls, data: Any) -> Self:
        """Read the values that `to_dict` writes; raises `InputError` on any others."""
        return from_dict(cls, data)

    def __repr__(self) -> str:
        return f"RigCalibration({', '.join(self.names)}; chi-square {self.chi_square:.0f} of {self.dof:.0f})"


def several_of(result: RigCalibration) -> Several:
    """Return the poses of cameras, targets and bases, and the relative poses, of a `RigCalibration`."""
    comments = []
    if opened := [one.frame for one in result.every if len(one.open)]:
        comments = [
            f"Open, not determined by the motions in all directions: {', '.join(opened)}.",
            f"Along open directions the covariance has a standard deviation of {OPEN_SD_M:g} m (angles: times "
            f"{result.lever:.3g} m), which stands for infinity.",
        ]
    first = next(iter(result.rig.arms))
    if len(result.rig.arms) > 1:
        comments.append(f"The world is the base of the arm {first}.")
    return Several(
        [_transform(one) for one in result.singles], [_transform(one) for one in result.pairs], comments,
        result.to_json(),
    )  # fmt: skip


def several_of_split(split: Sequence[EstimatedPose]) -> Several:
    """Return poses of the fit in which what moved is two."""
    comments = ["The fit with what moved as two: before the move, and from the robot pose after @ on."]
    return Several([_transform(one) for one in split], [], comments, json_text([one.to_dict() for one in split]))


def _transform(one: EstimatedPose) -> Transform:
    parent, _, child = (re.sub(r"[^A-Za-z0-9_]", "_", part) for part in one.frame.partition("_T_"))
    return Transform(one.pose + 0.0, with_open(one.covariance, one.open), parent, child)
