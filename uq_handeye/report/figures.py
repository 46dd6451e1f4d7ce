"""All figures of a calibration, each with its caption and alternative text.

A figure that cannot be drawn (no covariance, no poses, no noise) is left out; `report.page` says why. This module
imports Matplotlib; import it where it is used.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from ..calibration.checks import shared_groups
from ..calibration.estimated import distance_of
from ..calibration.report.arm import prediction_words, workspace_caption
from ..calibration.report.budget import budget_shares, shown_budget
from ..calibration.report.figure_names import FIGURES, figure_names
from ..calibration.report.figures import budget_figure, shared_figure, task_space_figure
from ..calibration.report.points_ahead import ahead
from ..calibration.report.residual_figure import residual_figure
from ..calibration.report.rig_figure import MAX_FRAMES, rig, rig_figure, rig_scene
from ..calibration.report.workspace_figure import workspace_figure
from ..core.presentation.ellipses import covariance_ellipses, held, small_ellipses
from ..core.presentation.figure_parts import NamedFigure, Picture
from ..core.presentation.numbers import digits
from ..errors import InputError
from ..methods.target_pose import mean_target
from ..model.errors.models import PoseNoise
from ..model.poses.pose_pairs import PosePairs
from .comparison.compare import compare_result
from .comparison.figure import comparison_picture

if TYPE_CHECKING:
    from ..calibration.result import Calibration
    from ..core.geometry.se3 import Array
    from ..fit.diagnostics.pose_table import PoseTable
    from ..trials.validation.cross_check.result import CrossCheck
    from .comparison.result import Comparison


# Rows of a cross-check that are laid over the ellipses: key and name in the legend.
OVERLAY = (
    ("{method}-sampled", "Monte Carlo, {method}"),
    ("posterior", "posterior"),
    ("bound", "Cramer-Rao bound"),
    ("4dpa-poses", "4DPA, first order"),
    ("4dpa-pairs", "4DPA, first order, pairs independent"),
)


def figures(
    result: Calibration, cross_check: CrossCheck | None = None, comparison: Comparison | None = None
) -> dict[str, Figure]:
    """The figures of a calibration by the stem of their file names; those that cannot be drawn are left out.

    Parameters
    ----------
    result : Calibration
    cross_check : CrossCheck or None
        Of the same problem: its covariances are laid over the ellipses.
    comparison : Comparison or None
        Of the same data: its methods get a figure.

    Raises
    ------
    InputError
        A cross-check of another X or another number of poses.
    """
    return {stem: picture.figure for stem, picture in pictures(result, cross_check, comparison).items()}


def pictures(
    result: Calibration,
    cross_check: CrossCheck | None = None,
    comparison: Comparison | None = None,
    only: Collection[str] | None = None,
) -> dict[str, Picture]:
    """`figures` with alt text and caption; ``only``: draw no others."""
    makers: dict[str, Callable[[], Picture | None]] = {
        "ellipses": lambda: _ellipses(result, cross_check),
        "rig": lambda: _rig(result),
        "residuals": lambda: _residuals(result),
        "budget": lambda: _budget(result),
        "shared": lambda: _shared(result),
        "task_space": lambda: _task_space(result),
        "workspace": lambda: _workspace(result),
        "methods": lambda: None if comparison is None else comparison_picture(comparison),
    }
    found = {stem: make() for stem, make in makers.items() if only is None or stem in only}
    there = {stem: picture for stem, picture in found.items() if picture is not None}
    for stem, picture in there.items():
        if isinstance(picture.figure, NamedFigure):
            picture.figure.named(stem, FIGURES[stem], picture.alt)
    return there


def small_pictures(result: Calibration) -> dict[str, Picture]:
    """Pictures in half the width of a page: residuals by pose, and the ellipses within translation and rotation."""
    found: dict[str, Picture] = {}
    table = result.table
    if table is not None and len(table):
        words = f"{_medians(table, 2)}; {_flagged(table)}"
        alt = f"Residual of each {table.item} in mm and in deg: {words}."
        found["residuals-small"] = Picture(
            residual_figure(table, small=True), alt, f"Residual of each {table.item}: {words}."
        )
    if result.covariance is not None:
        sizes = np.sqrt(np.diag(result.covariance)) * np.repeat([180 / np.pi, 1e3], 3)
        said = (
            f"{kind} {', '.join(f'{axis} {digits(sd, 2)}' for axis, sd in zip('xyz', part, strict=True))} {unit}"
            for kind, part, unit in (("translation", sizes[3:], "mm"), ("rotation", sizes[:3], "deg"))
            if part.any()
        )
        caption = (
            "The error of X in pairs of components: translation above, rotation below. The ellipses are 1, 2 and 3 "
            f"sigma and hold {held(0)} of the errors."
        )
        if result.opened is not None:
            caption += " Directions that the poses leave open are not drawn."
        alt = f"Ellipses of the error of X, 1, 2 and 3 sigma, along each axis. Standard deviations: {'; '.join(said)}."
        found["ellipses-small"] = Picture(small_ellipses(result.covariance), alt, caption)
    return found


def _medians(table: PoseTable, places: int) -> str:
    """Return the median residuals of the poses that count in words."""
    turn, move = (float(np.median(part[table.counted])) for part in (table.rotation, table.translation))
    return f"median {digits(1e3 * move, places)} mm, {digits(np.degrees(turn), places)} deg"


def _flagged(table: PoseTable) -> str:
    """Return how many poses are flagged and excluded in words."""
    count, total = len(table.flagged), f"{len(table.counted):,}"
    excluded = f"; {len(table.excluded):,} excluded, as open circles" if table.excluded else ""
    return (f"{count} of {total} flagged" if count else f"none of the {total} flagged") + excluded


def poses_of(result: Calibration) -> PosePairs | None:
    """Return the poses that a result was made of; None for motions only, and where its file holds no poses."""
    return None if result.data is None else result.data.poses


def require_same_problem(result: Calibration, check: CrossCheck) -> None:
    """Raise `InputError` unless the cross-check can be that of the result."""
    if check.frame != result.frame:
        raise InputError(f"Expected `cross_check` to be of {result.frame}, as the result, got one of {check.frame}.")
    count = result.n_poses if isinstance(check.noise, PoseNoise) else result.n_pairs
    if count is not None and check.n != count:
        raise InputError(f"Expected `cross_check` to be of the same data, {count} rows, got one of {check.n}.")


def _ellipses(result: Calibration, check: CrossCheck | None) -> Picture | None:
    if result.covariance is None:
        return None
    others: dict[str, Array] = {}
    samples = None
    if check is not None:
        require_same_problem(result, check)
        known = {row.key: row.covariance for row in check.rows if row.covariance is not None}
        for key, name in OVERLAY:
            key = key.format(method=result.method)
            same = key == "bound" and result.bound is not None  # then it is the covariance of the result
            doubled = key == "4dpa-pairs" and "4dpa-poses" in known
            if key in known and not same and not doubled:
                others[name.format(method=result.method)] = known[key]
        if result.method in check.runs:
            samples = check.runs[result.method].errors
    figure = covariance_ellipses(
        result.X, result.covariance, others=others, samples=samples, label=f"this result ({result.method})"
    )
    overlay = f", with those of {', '.join(others)} over it" if others else ""
    alt = (
        f"Fifteen panels with the 1, 2 and 3 sigma ellipses of {result.frame}{overlay}: three of the rotation, three "
        f"of the translation, nine of rotation against translation. {' '.join(result.facts.directions)}"
    )
    caption = (
        f"Errors of X in pairs of its six components. The ellipses hold {held(0)} of the errors. A narrow, tilted "
        "ellipse means that the two errors are correlated (coefficient above each panel). A long ellipse marks the "
        "least certain direction."
    )
    if others:
        caption += " Where lines of different style coincide, independent computations agree."
    return Picture(figure, alt, caption)


def _rig(result: Calibration) -> Picture | None:
    poses = poses_of(result)
    if poses is None:
        return None
    table = result.table
    weight = np.ones(poses.n) if table is None or table.item != "pose" else table.weight.copy()
    if len(result.excluded) < poses.n == len(weight):
        weight[list(result.excluded) if isinstance(result.data, PosePairs) else []] = 0.0
    W = mean_target(poses, result.X) if result.W is None else result.W
    scene = rig(poses, result.X, W, result.covariance, weight, excluded=result.excluded)
    one = "cameras and one target" if poses.setup == "eye-in-hand" else "targets and one camera"
    alt = f"The rig in the base frame, from the side and from above: {poses.n:,} gripper poses with their {one}."
    caption = (
        "All poses in the base frame, in metres. Pyramids are cameras, open in the viewing direction; rectangles are "
        "targets; grey lines connect each gripper to what it carries. "
        "If the cameras do not look at the target, a frame or a unit is wrong."
    )
    if poses.n > MAX_FRAMES:
        caption += f" {MAX_FRAMES} of the {poses.n:,} poses are drawn in full, the others as dots."
    if scene.half_axes.any():
        caption += f" The ellipsoid holds 95 % of the errors of X's translation; it is drawn {scene.enlarged}."
        alt += f" An ellipsoid about one camera holds 95 % of the errors of X's translation, {scene.enlarged}."
    return Picture(rig_figure(scene), alt, caption, rig_scene(scene, table, alt))


def _residuals(result: Calibration) -> Picture | None:
    table = result.table
    if table is None or not len(table):
        return None
    alt = (
        f"Residuals of {len(table):,} {table.item}s in three panels, translation, rotation and squared distance: "
        f"{_medians(table, 3)}; {_flagged(table)}."
    )
    caption = (
        f"Residual of each {table.item} from the prediction of X and all other {table.item}s. d² is the squared "
        f"distance in standard deviations: 6 on average, above {table.limit:.3g} for one good {table.item} in 1,000. A "
        "curve, step or trend is not noise: it points to drift, kinematics or intrinsics."
    )
    if table.excluded:
        caption += f" Open circles are {table.item}s that were excluded: the fit does not use them."
    return Picture(residual_figure(table), alt, caption)


def _budget(result: Calibration) -> Picture | None:
    budget, shares = shown_budget(result), budget_shares(result)
    if budget is None:
        return None
    kinds = dict(zip(budget.sources, budget.types, strict=True))
    shares = {f"{name} ({kinds[name]})": share for name, share in shares.items()}
    parts = "; ".join(f"{name} {100 * a:.0f} % and {100 * b:.0f} %" for name, (a, b) in shares.items())
    alt = f"Bars of the share that each noise source has in the variance of X's rotation and translation: {parts}."
    caption = (
        "Where the uncertainty of X comes from. The longest bar is what to improve first: halving that noise "
        "removes three quarters of its share. (A) is evaluated from the data, (B) is declared or assumed."
    )
    return Picture(budget_figure(shares), alt, caption)


def _shared(result: Calibration) -> Picture | None:
    if not result.shared:
        return None
    groups = shared_groups(result)
    alt = f"Errors that all poses share, assumed and found: {', '.join(group.name for group in groups)}."
    caption = (
        "Each error before the fit (grey, one standard deviation to each side) and after it (blue). Where blue is as "
        "wide as grey, the data say nothing about the error."
    )
    if any(group.count > 1 for group in groups):
        caption += " The estimates of an error with several numbers are dots."
    return Picture(shared_figure(groups), alt, caption)


def _task_space(result: Calibration) -> Picture | None:
    if result.covariance is None or result.opened is not None:
        return None
    typical, known = distance_of(result.analysis)
    at = ahead(result, np.array([typical]))
    alt = (
        f"Standard deviation of a point against its distance from the camera, and a map of the plane in front of the "
        f"camera. At {typical:.2g} m it is {digits(1e3 * at.worst[0])} mm in the worst direction."
    )
    caption = (
        f"Uncertainty of a point that the camera sees, transformed by X to the {result.facts.parent}. Only the error "
        "of X is included; the camera's own error of the point comes in addition. Left: points on the optical axis. "
        "Right: the plane y = 0, up to 30 degrees from the axis."
    )
    if known:
        caption += f" The target was {typical:.2g} m away (RMS); beyond that, the numbers are extrapolated."
    return Picture(task_space_figure(result), alt, caption)


def _workspace(result: Calibration) -> Picture | None:
    found = result.over_workspace
    if found is None:
        return None
    alt = (
        "A section of the workspace with the 95 % radius of the miss in cells and the calibrated poses on it, and the "
        f"same against the distance from the nearest calibrated pose. {prediction_words(result)}"
    )
    return Picture(workspace_figure(found), alt, workspace_caption(result))


def figure_of(result: Calibration, name: str | None = None) -> Figure:
    """Return the figure of that name, without a name the first there is.

    Raises `InputError` for a name that the result has no figure of.
    """
    names = figure_names(result)
    if name is None and names:
        name = names[0]
    if name in names:
        comparison = compare_result(result).comparison if name == "methods" else None
        picture = pictures(result, None, comparison, only=(name,)).get(name)
        if picture is not None:
            return picture.figure
    known = f"; {name!r} needs data or a covariance that this result does not have" if name in FIGURES else ""
    raise InputError(f"Expected `name` to be one of {', '.join(names) or 'no figures'}, got {name!r}{known}.")
