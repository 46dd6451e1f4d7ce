"""Files of a result beside its own, for other programs: exports, tables, intrinsics and figures, by their names."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from functools import singledispatch
from typing import TYPE_CHECKING

from ..calibration.camera_of_result import corrected_camera
from ..calibration.result import Calibration
from ..calibration.rig_result import RigCalibration, several_of, several_of_split
from ..calibration.stored_result import not_a_result
from ..calibration.tolerance import NO_VERDICTS, Verdict
from ..core.presentation.document import document_of, to_text
from ..fit.diagnostics.pose_table import PoseTable
from ..formats.export import exported, several_exported
from ..model.camera.calibration_files import camera_files
from ..model.poses.scene_facts import SceneFacts
from ..scene.lens import NAMES
from ..scene.result import INTRINSICS, intrinsics_yaml
from ..trials.validation.cross_check.result import CrossCheck
from .comparison.result import Comparison
from .page import report_html
from .rig_page import rig_sketch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Files of the poses for other programs, by the format of `export`.
EXPORTS = {"ros": "x_ros.yaml", "urdf": "x.urdf", "opencv": "x_opencv.yaml", "npz": "x.npz"}
POSES, SPLIT, DRAWING = "poses.csv", "split.toml", "rig.svg"
# All names, for those that an earlier run may have left.
FILES = (POSES, SPLIT, *EXPORTS.values())


@singledispatch
def files_of(result: object, verdicts: Mapping[str, Verdict] = NO_VERDICTS) -> dict[str, str | bytes]:
    """Return the files of a result beside its own, by their names."""
    raise not_a_result(result)


@files_of.register
def _of_camera(result: Calibration, verdicts: Mapping[str, Verdict] = NO_VERDICTS) -> dict[str, str | bytes]:
    files: dict[str, str | bytes] = {name: exported(result, format) for format, name in EXPORTS.items()}
    if (seen := corrected_camera(result)) is not None:  # the intrinsics, with the poses and corners that belong to them
        files |= camera_files(seen)
    scene = _scene(result)
    if scene is not None and len(scene.image_size) == 2 and scene.lens:
        width, height = scene.image_size
        files[INTRINSICS] = intrinsics_yaml(dict(zip(NAMES, scene.lens, strict=True)), (width, height))
    if result.table is not None:
        files[POSES] = _poses_csv(result.table)
    if result.split:
        files[SPLIT] = several_exported(several_of_split(result.split), "toml")
    return files


@files_of.register
def _of_rig(result: RigCalibration, verdicts: Mapping[str, Verdict] = NO_VERDICTS) -> dict[str, str | bytes]:
    of = several_of(result)
    files: dict[str, str | bytes] = {name: several_exported(of, format) for format, name in EXPORTS.items()}
    if result.split:
        files[SPLIT] = several_exported(several_of_split(result.split), "toml")
    files["rig.txt"] = to_text(document_of(result, verdicts=verdicts))
    files["report.html"] = report_html(result, verdict=verdicts)
    return files


@singledispatch
def figures_of(
    result: object, cross_check: CrossCheck | None = None, comparison: Comparison | None = None
) -> Mapping[str, str | Figure]:
    """Return the figures of a result, by the stems of their files or by their names."""
    raise not_a_result(result)


@figures_of.register(Calibration)
def _figures_of_camera(
    result: Calibration, cross_check: CrossCheck | None = None, comparison: Comparison | None = None
) -> Mapping[str, Figure]:
    from .figures import figures  # Matplotlib is slow to import

    return figures(result, cross_check, comparison)


@figures_of.register
def _drawing_of_rig(
    result: RigCalibration, cross_check: CrossCheck | None = None, comparison: Comparison | None = None
) -> Mapping[str, str]:
    return {DRAWING: str(rig_sketch(result).svg)}


@singledispatch
def words_of_intrinsics(result: object) -> str:
    """Return which intrinsics X belongs to, as the end of a sentence; empty where it came without pictures."""
    return ""


@words_of_intrinsics.register
def _intrinsics_of_camera(result: Calibration) -> str:
    if (seen := corrected_camera(result)) is not None:
        of = "corrected intrinsics" if seen.estimated else "intrinsics as given"
        return f"; X belongs to the {of}, {INTRINSICS}"
    return "" if _scene(result) is None else f"; X belongs to the intrinsics of the scene, {INTRINSICS}"


def _scene(result: Calibration) -> SceneFacts | None:
    found: SceneFacts | None = getattr(result.data, "scene", None)
    return found


def _poses_csv(table: PoseTable) -> str:
    """Format the table of the poses as pandas writes its `to_dataframe`, without loading pandas."""
    columns: dict[str, Iterable[float | str | None]] = {
        table.item: range(len(table)),
        "rotation_deg": [math.degrees(angle) for angle in table.rotation.tolist()],
        "translation_mm": [1e3 * length for length in table.translation.tolist()],
        "distance2": table.distance2.tolist(),
        "leverage": table.leverage.tolist(),
        "weight": table.weight.tolist(),
        "flag": table.flag,
    }
    rows = zip(*columns.values(), strict=True)
    lines = (",".join("" if value != value else str(value) for value in row) for row in rows)  # NaN is no value
    return "\n".join([",".join(columns), *lines, ""])
