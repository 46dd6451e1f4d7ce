"""Names and titles of the figures that a calibration can have."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..estimated import Estimated

if TYPE_CHECKING:
    pass

# Names and titles of all figures.
FIGURES = {
    "ellipses": "Ellipses of the errors of X",
    "rig": "The rig in the base frame",
    "residuals": "Residuals of each pose",
    "budget": "Uncertainty budget of X",
    "shared": "Errors that all poses share",
    "task_space": "Uncertainty of a point in front of the camera",
    "workspace": "Accuracy over the workspace",
    "methods": "Published methods on the same data",
}


def figure_names(result: Estimated) -> tuple[str, ...]:
    """Return the names of the figures that a result can have, in the order of `FIGURES`."""
    determined = result.covariance is not None
    poses = None if result.data is None else result.data.poses
    there = {
        "ellipses": determined,
        "rig": poses is not None,
        "residuals": result.table is not None and len(result.table) > 0,
        "budget": result.analysis is not None,
        "shared": len(result.shared) > 0,
        "task_space": determined and result.opened is None,
        "workspace": result.kinematics is not None,
        "methods": result.data is not None,
    }
    return tuple(name for name in FIGURES if there[name])
