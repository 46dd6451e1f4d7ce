"""Figures of a calibration: which there are, and the way to them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


class Plotted:
    """Figures of a `Calibration` by name."""

    @property
    def figures(self) -> tuple[str, ...]:
        """The names that `plot` takes for this result."""
        return figure_names(self)

    def plot(self: Any, name: str | None = None) -> Figure:
        """Return a figure as a Matplotlib Figure, which notebooks show.

        Parameters
        ----------
        name : str or None
            One of `figures`: "ellipses", "rig", "residuals", "budget", "shared", "task_space", "workspace" or "methods"
            (which compares the methods first). None: the first of them.

        Raises
        ------
        InputError
            A name that is not among `figures`.
        """
        from ...report.figures import figure_of

        return figure_of(self, name)


def figure_names(result: Any) -> tuple[str, ...]:
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
