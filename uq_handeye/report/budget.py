"""Stated uncertainties and the uncertainty budget in the terms of the GUM (JCGM 100), all from the result.

Nothing is estimated here. The standard uncertainties are those of `Calibration.covariance`, effects and degrees of
freedom those of `Calibration.budget`, the statements in the worst direction those of `Calibration.accuracy`. A
component is ``y = a xi`` with a row a of the derivative of the six numbers by xi = (theta, tau); its expanded
uncertainty is ``U = k u``, ``k = t_p(nu_eff)`` (JCGM 100, G.4). Each source of the budget has its input: what it
is, its distribution, its standard uncertainty.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri, stdtrit

from ..calibration.accuracy import budget_of_model
from ..calibration.checks import shared_groups, sizes_of
from ..calibration.contribution import Contribution, Input
from ..calibration.report.budget import WITHIN_95, freedom, shorten_budget, shown_budget
from ..calibration.report.facts import noise_per_axis
from ..calibration.result import Calibration
from ..core.geometry.pose_numbers import rotation_vector
from ..core.geometry.se3 import Array, left_jacobian
from ..core.levels import INTERVAL
from ..core.presentation.document import Cell, Table
from ..core.presentation.numbers import digits, fixed
from ..core.presentation.units import DEG_PER_RAD, MM_PER_M
from ..core.rounding import TINY
from ..fit.diagnostics.budget import PRIORS, Budget, Expanded, Source
from ..model.errors.error_estimate import SHOWN, ErrorEstimate
from ..model.errors.key import ErrorKey, Kind, Owner
from ..model.errors.keys import CLOCK_OFFSET, INTRINSICS, JOINT_NOISE, ROBOT_ACCURACY
from ..model.errors.noise_estimate import SIDES, NoiseEstimate

# Coverage probability of every expanded uncertainty.
LEVEL = INTERVAL.probability
# Length (mm) and angle (deg) of a table, from m and rad.
_FACTORS = {"m": (MM_PER_M, "mm"), "rad": (DEG_PER_RAD, "deg")}


KINDS = (Kind.ROTATION, Kind.TRANSLATION)
# Noise of one side that is drawn at each pose, and columns of a covariance that was given.
_OF_SIDE = (*KINDS, Kind.COUPLING, Kind.BOTH, Kind.EACH_POSE, Kind.SHARED)
_OF_BOTH = (Kind.BOTH, Kind.EACH_POSE)
NORMAL = "normal"
_ESTIMATED = "residuals (REML)"
_ORIGIN = {
    "prior": "data sheet, residuals",
    "population": "arms of the kind, residuals",
    "fixed": "declared",
    "given": "declared",
    "from corners": "corners of the target",
    "from points": "points of the target",
    "from the scene": "features of the scene",
    "by geometry": "residuals, views",
}


class Stated(NamedTuple):
    """A number with its uncertainty, in m or rad."""

    name: str
    unit: str  # "m" or "rad"
    value: float | None  # None: a statement on the error only
    u: float  # infinite: not determined
    dof: float
    k: float
    U: float


def budget_of(result: Calibration) -> Budget | None:
    """Return the budget whose sum is the covariance of the result; None where there is none."""
    return shown_budget(result) if result.covariance_kind == "model" else None


def budget_rows(result: Calibration, most: int | None = None) -> tuple[Contribution, ...]:
    """Return one row per source; beyond ``most`` the smallest are one row.

    Where the covariance is not divided by source, as with a published method, the row is the whole of it.
    """
    budget = budget_of(result)
    if budget is None:
        return _undivided(result)
    budget = shorten_budget(budget, most)
    along = budget.in_worst_direction()
    move, turn = (np.sqrt(np.maximum(along[name], 0.0)) for name in ("X translation", "X rotation"))
    shares = [np.square(sizes) / max(float(np.square(sizes).sum()), TINY) for sizes in (move, turn)]
    return tuple(
        Contribution(
            source,
            float(move[k]),
            float(turn[k]),
            type=budget.types[k],
            input=Input() if source[0].kind == Kind.OTHERS else input_of(source, result),
            dof=float(budget.dof[k]),
            share_translation=float(shares[0][k]),
            share_rotation=float(shares[1][k]),
        )
        for k, source in enumerate(budget.keys)
    )


def _undivided(result: Calibration) -> tuple[Contribution, ...]:
    """Return the covariance as one row, which no budget divides by source."""
    accuracy, dof = result.accuracy, result.reference.dof
    if accuracy is None:
        return ()
    of_residuals = result.covariance_kind != "model"
    kind = "A" if of_residuals or result.noise_estimate is not None else "B"
    found = Input("covariance", NORMAL, result.facts.source)
    free = float("inf") if dof is None else float(dof)
    source = (ErrorKey(Owner.ALL, Kind.COVARIANCE),)
    return (Contribution(source, accuracy.translation, accuracy.rotation, "", kind, found, free, 1.0, 1.0),)


def components_of(result: Calibration) -> tuple[Stated, ...]:
    """Return translation (m) and rotation vector (rad) of X, six numbers, with their uncertainties."""
    if result.covariance is None:
        return ()
    to_si = {"mm": (1 / MM_PER_M, "m"), "deg": (1 / DEG_PER_RAD, "rad")}
    rows = _rows(result)
    budget = budget_of_model(result)  # sources that are shown as one have degrees of freedom of their own
    if budget is None:
        expanded = [_by_reference(result)] * 6
    else:
        padded = np.pad(rows, ((0, 0), (0, len(budget.covariance) - 6)))
        expanded = [(found.dof, found.k) for found in budget.expanded_along(padded, LEVEL)]
    found = []
    for one, (dof, k) in zip(result.facts.X, expanded, strict=True):
        factor, unit = to_si[one.unit]
        assert one.sd is not None  # where there is a covariance
        u = factor * one.sd
        found.append(Stated(one.name, unit, factor * one.value, u, dof, k, k * u))
    return tuple(found)


def _rows(result: Calibration) -> Array:
    """Return the derivatives (6, 6) of translation and rotation vector by (theta, tau)."""
    rows = np.zeros((6, 6))
    rows[:3, 3:] = np.eye(3)
    rows[3:, :3] = np.linalg.inv(left_jacobian(rotation_vector(result.X, None)))
    return rows


def correlation_of(result: Calibration) -> Array:
    """Return the correlation (6, 6) of translation and rotation vector; NaN for a number that is not determined."""
    assert result.covariance is not None  # of a certified result
    rows = _rows(result)
    S = rows @ result.covariance @ rows.T
    sd = np.sqrt(np.diag(S))
    found = S / np.maximum(np.outer(sd, sd), TINY)
    known = np.isfinite([one.u for one in components_of(result)])
    return np.where(np.outer(known, known), found, np.nan)


def worst_of(result: Calibration) -> tuple[Stated, ...]:
    """Return translation and rotation of X, and a point ahead of the camera: u in the direction of the largest
    variance, U the length or angle that 95 % of the errors are within, k their ratio.
    """
    accuracy = result.accuracy
    if accuracy is None:
        return ()
    budget = budget_of_model(result)  # sources that are shown as one have degrees of freedom of their own
    dof = dict.fromkeys(("X translation", "X rotation", "point"), _by_reference(result)[0])
    if budget is not None:
        found: dict[str, Expanded] = budget.expanded(LEVEL, worst=True)
        found |= budget.budget_at(np.array([0.0, 0.0, accuracy.distance])).expanded(LEVEL, worst=True)
        dof = {name: of.dof for name, of in found.items()}
    return tuple(
        Stated(name, unit, None, u, dof[of], U / u if u > 0 else float("nan"), U)
        for name, of, unit, u, U in (
            ("translation", "X translation", "m", accuracy.translation, accuracy.translation_95),
            ("rotation", "X rotation", "rad", accuracy.rotation, accuracy.rotation_95),
            ("point", "point", "m", accuracy.point, accuracy.point_95),
        )
    )


def _by_reference(result: Calibration) -> tuple[float, float]:
    """Return degrees of freedom and coverage factor of a single number of the whole covariance."""
    dof = result.reference.dof
    return (float("inf"), float(ndtri(0.5 + LEVEL / 2))) if dof is None else (dof, float(stdtrit(dof, 0.5 + LEVEL / 2)))


def input_of(source: Source, result: Calibration) -> Input:
    """Return the input behind a source of the budget."""
    estimate = result.noise_estimate
    if estimate is not None and (found := _estimated(source, estimate)) is not None:
        return found
    key = source[0]
    if key.kind in _OF_SIDE and all(one.owner in SIDES for one in source):
        return _of_noise(source, result)
    if key == CLOCK_OFFSET and result.time_offset is not None:
        return Input(f"{digits(1e3 * result.time_offset.std, 2)} ms", NORMAL, "the two streams")
    for group in shared_groups(result):
        if key in (group.key, group.key.error):
            return _shared(group.key.error, sizes_of(group), group.default)
    if key == JOINT_NOISE and result.kinematics is not None:
        return Input(_sizes([(result.kinematics.joint_noise, "rad")]), NORMAL, "declared")
    if key.kind in (Kind.POSES, Kind.POSES_AND_TOUCHES):
        return Input("covariance", NORMAL, "declared" if estimate is None else _ESTIMATED)
    if key.error == INTRINSICS:
        return Input("covariance", NORMAL, "camera calibration")
    if key in PRIORS.values():
        return Input("covariance", NORMAL, "declared")
    return Input("covariance", NORMAL, "as given with the noise")


def _shared(error: ErrorKey, size: str, default: bool) -> Input:
    origin = "assumed" if default else "declared"
    if error == ROBOT_ACCURACY:
        return Input(f"{size} (RMS)", "normal, smooth over the pose", origin)
    return Input(size, NORMAL, origin)


def _estimated(source: Source, estimate: NoiseEstimate) -> Input | None:
    """Return the input of noise components that belong to these errors; None where none does."""
    parts = [part for part in estimate.components if any(_belongs(part, key) for key in source)]
    if len(source) > 1:  # what cannot be separated is known as a sum
        sums = (Owner.ROBOT_AND_CAMERA, Owner.A_AND_B)
        of_both = [part for part in estimate.components if part.key.owner in sums and part.key.kind == source[0].kind]
        parts = of_both or parts
    if not parts:
        return None
    parts = parts[:2]
    return Input(_sizes((part.size, part.unit) for part in parts), NORMAL, _ORIGIN.get(parts[0].status, _ESTIMATED))


def _belongs(part: ErrorEstimate, key: ErrorKey) -> bool:
    """Return whether a component is that of an error of a source: the same, or one of its two kinds."""
    of_both = key.kind in _OF_BOTH and part.key.owner == key.owner and part.key.kind in KINDS
    of_pixels = part.unit == "px" and (key.error == INTRINSICS or (key.kind in _OF_SIDE and key.owner == Owner.CAMERA))
    return part.key == key or of_both or of_pixels


def _of_noise(source: Source, result: Calibration) -> Input:
    """Return the noise of one side as given: standard deviations per axis, on average over axes and poses."""
    squares = np.zeros(2)
    for owner in dict.fromkeys(key.owner for key in source):
        S = getattr(result.noise, owner, None)
        if S is not None:
            squares += np.square(noise_per_axis(S))
    sizes = [(float(size), unit) for size, unit in zip(np.sqrt(squares), ("rad", "m"), strict=True)]
    kind, of_camera, data = source[0].kind, source[0].owner == Owner.CAMERA, result.data
    corners = getattr(data, "camera_calibration", None) is not None and of_camera
    of_file = getattr(data, "camera_read_as", None) is not None and of_camera
    points = getattr(data, "camera_covariance", None) is not None and of_camera and not of_file
    if kind == Kind.SHARED:
        return Input("covariance", NORMAL, "camera calibration" if corners else "as given with the noise")
    shown = [sizes[KINDS.index(kind)]] if kind in KINDS else sizes
    scene = getattr(data, "scene", None) is not None and of_camera
    sources = (
        (corners, "corners of the target"),
        (scene, "features of the scene"),
        (points, "points of the target"),
        (of_file, "file of the poses"),
    )
    return Input(_sizes(shown), NORMAL, next((name for known, name in sources if known), "declared"))


def _sizes(sizes: Iterable[tuple[float, str]]) -> str:
    return ", ".join(f"{digits(SHOWN[unit][0] * size, 2)} {SHOWN[unit][1]}" for size, unit in sizes)


def sizes_of_stated(one: Stated) -> list[str]:
    """Return u, degrees of freedom, k, U and unit as a row of a table."""
    factor, unit = _FACTORS[one.unit]
    if not np.isfinite(one.u):
        return ["not determined", "", "", "", unit]
    return [fixed(factor * one.u, 2), freedom(one.dof), f"{one.k:.2f}", fixed(factor * one.U, 2), unit]


def lower(title: str, result: Calibration) -> str:
    """Return the title, marked where the stated uncertainty is a lower limit."""
    return f"{title} (lower limit)" if result.accuracy is not None and result.accuracy.lower_limit else title


def gum_table(result: Calibration, most: int | None = None) -> Table:
    """Return the budget as a table: each source with its input, its effect on X and its share of the variance.

    Beyond ``most`` the smallest sources are one row.
    """
    found = sorted(budget_rows(result, most), key=lambda row: row.key.kind == Kind.OTHERS)
    rows: list[list[Cell]] = [_source(row) for row in found]
    move, turn, _ = worst_of(result)
    rows.append([])
    factors = [_FACTORS["m"][0], _FACTORS["rad"][0]]
    for title, cells in (
        (lower("combined, u_c", result), [fixed(f * one.u, 3) for f, one in zip(factors, (move, turn), strict=True)]),
        ("effective degrees of freedom", [freedom(one.dof) for one in (move, turn)]),
        (lower(WITHIN_95, result), [fixed(f * one.U, 3) for f, one in zip(factors, (move, turn), strict=True)]),
    ):
        rows.append([title, "", "", "", "", *cells, "", ""])
    head = ["source", "type", "input: u", "distribution, origin", "nu", "u (mm)", "u (deg)", "% of mm", "% of deg"]
    caption = (
        "JCGM 100. Effect of each source on translation (mm) and rotation (deg) of X, in the direction in which each "
        "is least certain, and share of the variance; the effect divided by u of the input is its sensitivity "
        "coefficient. The sources are independent: squares add. nu: degrees of freedom. Type A: evaluated from the "
        "data, B: declared."
    )
    return Table(caption, head, rows, frozenset({1, 2, 3}))


def _source(row: Contribution) -> list[Cell]:
    words = ", ".join(text for text in (row.input.distribution, row.input.origin) if text)
    sizes = [
        fixed(factor * size, 2) if factor * size >= 1e-6 else "0"
        for (factor, _), size in zip(_FACTORS.values(), (row.translation, row.rotation), strict=True)
    ]
    shares = [f"{100 * share:.1f}" for share in (row.share_translation, row.share_rotation)]
    return [row.name, row.type, row.input.uncertainty, words, freedom(row.dof), *sizes, *shares]
