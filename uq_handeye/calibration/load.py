"""A result file as the result that it is of: of one camera, or of several cameras, targets and arms."""

from __future__ import annotations

from pathlib import Path
from typing import TypeAlias

from ..core.files.json_files import parsed
from ..core.files.tree_values import is_map
from .result import Calibration
from .rig_result import RigCalibration
from .stored_result import OF_CAMERA, OF_RIG

Result: TypeAlias = Calibration | RigCalibration

# The result of each word that a file says it is of.
RESULTS: dict[str, type[Calibration] | type[RigCalibration]] = {OF_CAMERA: Calibration, OF_RIG: RigCalibration}


def load(path: str | Path) -> Result:
    """Read a result file, as `Calibration.save`, `RigCalibration.save` and ``uq-handeye calibrate -o`` write it."""
    data = parsed(path)
    of = str(data.get("of")) if is_map(data) else OF_CAMERA
    return RESULTS.get(of, Calibration).from_json(path, data)
