"""The result of a rig with new views: the calibration of all views together, with the arguments of the first one."""

from __future__ import annotations

import numpy as np

from ...errors import InputError
from ..calibrate import calibrate_rig
from ..description import Rig
from ..result import RigCalibration
from .check import check_rig
from .evidence import joined, like

LEVEL = 1e-3


def update_rig(result: RigCalibration, rig: Rig, *, although_changed: bool = False) -> RigCalibration:
    """Calibrate the old and the new views together.

    Parameters
    ----------
    result : RigCalibration
    rig : Rig
        New robot poses and views. Poses that the result has too must be the same; their names must else be new.
    although_changed : bool
        Update even if the new views contradict the result.

    Raises
    ------
    InputError
        New views that contradict the result, that it has already, or of things that the rig does not have.
    """
    new = like(result, rig)
    have = {(view.camera, view.target, moment) for view in result.rig.views for moment in view.at or ()}
    for view in new.views:
        if again := [moment for moment in view.at or () if (view.camera, view.target, moment) in have]:
            raise InputError(
                f"{view.words} has the view of {view.target} by {view.camera} at robot pose {again[0]!s}, which the "
                "calibration has already. Remove it, or rename the pose."
            )
    if not although_changed:
        found = check_rig(result, rig, level=LEVEL)
        if found.changed:
            raise InputError(
                f"The new views contradict the calibration. {found.sentence} To update, give --although-changed."
            )
    if result.provenance is None:
        raise InputError("Expected a result that says how it was calibrated. Calibrate again.")
    request = dict(result.provenance["request"])
    noise = request.pop("noise")
    if noise is not None:
        noise = {name: np.array(of) if isinstance(of, list) and isinstance(of[0], list) else of
                 for name, of in noise.items()}  # fmt: skip
    return calibrate_rig(joined(result.rig, new), noise, **request)
