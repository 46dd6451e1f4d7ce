r"""The accuracy of X: total standard uncertainty in the worst direction, for X and at the distance of the target.

Model: ``xi = (theta, tau)`` of X has the covariance S of the calibration (noise, shared errors, correlation). The
standard uncertainty of a part in its worst direction is the root of the largest eigenvalue of its block of S; that of a
point p straight ahead of the camera is ``sqrt(max eig J S J^T)``, ``J = [-[R p]x, I]`` (`diagnostics.task_space`). The
coverage factor for 95 % is Student's t with the effective degrees of freedom in that direction (JCGM 100, G.4).

*From the poses.* Errors a of robot, camera and target that are assumed, and whose numbers the data do not determine,
add what their priors say. With P the joint covariance of xi and a, what the poses alone give is the covariance of xi
for known a, ``P_xx - P_xa P_aa^-1 P_ax``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from scipy.special import ndtri, stdtrit

from ...core.files.records import Record
from ...core.formatting.numbers import digits
from ...core.geometry.principal_axes import principal_axes
from ...core.geometry.se3 import Array
from ...fit.diagnostics.budget import EACH, SHARED, Budget, Expanded
from ...model.noise.joint_covariance import group_of
from ...model.shared_errors.shared_error import PRINCIPAL_POINT
from ..estimate.estimated import Estimated, distance_of
from .checks import lower_limit_of
from .included import PLAIN, included, not_included

_KINDS = ("rotation", "translation", "coupling")
# A number of an error is told by its prior where the data leave more than this share of its variance; what priors add
# is said where X is so many times as uncertain with it; and errors that add less than this share of the most are not
# named.
BY_PRIOR, DIFFERENT, NAMED = 0.5, 1.25, 0.5
# Longest list of names of parts that are shown as one.
LONGEST_NAMES = 48


class Part(NamedTuple):
    """The standard uncertainty that one kind of error gives X, in the directions in which X is least certain."""

    name: str
    translation: float  # m
    rotation: float  # rad


@dataclass(frozen=True)
class FromPoses(Record):
    """Standard uncertainties in the worst direction that the poses alone give; see the module.

    ``assumed``: the errors whose priors add most of what the total has more, the first one most.
    """

    translation: float  # m
    rotation: float  # rad
    assumed: tuple[str, ...]


@dataclass(frozen=True)
class Accuracy(Record):
    """Standard uncertainties (1 sigma) of X in the worst direction, in m and rad; ``_95``: expanded, for 95 %.

    ``point`` is that of a point straight ahead of the camera, ``distance`` (m) away: the distance of the target where
    it is known. Directions that the poses leave open are not part of the numbers.
    """

    translation: float
    rotation: float
    point: float
    translation_95: float
    rotation_95: float
    point_95: float
    distance: float
    distance_known: bool
    parts: tuple[Part, ...]
    included: tuple[str, ...]
    not_included: tuple[str, ...]
    lower_limit: bool  # the errors that are not included are known to matter
    from_poses: FromPoses | None = None  # where priors of errors that are assumed add to it

    _if_any: ClassVar[str] = "from_poses"


def accuracy_of(result: Estimated) -> Accuracy | None:
    """Return the accuracy of X; None where the covariance is not determined."""
    if result.covariance is None:
        return None
    S = result.covariance
    distance, known = distance_of(result.analysis)
    ahead = result.uncertainty_at([0.0, 0.0, distance]).covariance
    point = float("inf") if not np.isfinite(ahead).all() else _worst(ahead)
    sizes = {"X rotation": _worst(S[:3, :3]), "X translation": _worst(S[3:, 3:]), "point": point}
    budget = None
    touched = sum(one.values["count"] for one in result.findings if one.code == "evidence.touches_used")
    if result.has_budget and result.covariance_kind in ("model", "sigma-points"):
        budget = result.budget
    factors = _factors(budget, result, distance)
    words = [
        f"{text} (assumed)" if default and not text.endswith("assumed)") else text for text, default in included(result)
    ]
    if touched:
        words.insert(0, f"{touched} touched {'point' if touched == 1 else 'points'}")
    return Accuracy(
        translation=_steady(sizes["X translation"]),
        rotation=_steady(sizes["X rotation"]),
        point=_steady(point),
        translation_95=_steady(factors["X translation"] * sizes["X translation"]),
        rotation_95=_steady(factors["X rotation"] * sizes["X rotation"]),
        point_95=_steady(factors["point"] * point),
        distance=distance,
        distance_known=known,
        parts=() if budget is None else parts_of(budget),
        included=("noise of the poses", *words),
        not_included=tuple(not_included(result)),
        lower_limit=lower_limit_of(result),
        from_poses=None if touched else _from_poses(result),
    )


def _from_poses(result: Estimated) -> FromPoses | None:
    """Return what the poses alone give; None where priors add little."""
    posterior, S = result.posterior, result.covariance
    if posterior is None or S is None or result.covariance_kind != "model":
        return None
    place = {name: len(posterior.covariance) - len(posterior.names) + k for k, name in enumerate(posterior.names)}
    of: dict[str, list[int]] = {}
    for error in result.shared:
        if error.default and error.name in place and error.sd**2 > BY_PRIOR * error.prior_sd**2:
            of.setdefault(error.error, []).append(place[error.name])

    def known(index: list[int]) -> Array:
        P = posterior.covariance
        across = P[:6, index]
        C = P[:6, :6] - across @ np.linalg.solve(P[np.ix_(index, index)], across.T)
        return np.array([_worst(C[3:, 3:]), _worst(C[:3, :3])])

    if not of:
        return None
    total, alone = np.array([_worst(S[3:, 3:]), _worst(S[:3, :3])]), known([k for index in of.values() for k in index])
    if not (total > DIFFERENT * alone).any():
        return None
    gains = {name: float((1.0 - known(index) / total).max()) for name, index in of.items()}
    named = [name for name in sorted(gains, key=lambda name: -gains[name]) if gains[name] > NAMED * max(gains.values())]
    return FromPoses(_steady(float(alone[0])), _steady(float(alone[1])), tuple(named))


def parts_of(budget: Budget) -> tuple[Part, ...]:
    """Return the sources of a budget as few parts, largest first: noise, shared errors by name, correlated errors."""
    together = any(" + " in source for source in budget.sources)  # robot and camera are not identifiable
    along = budget.in_worst_direction()
    squares: dict[str, Array] = {}
    for source, move, turn in zip(budget.sources, along["X translation"], along["X rotation"], strict=True):
        name = part_name(source, together)
        squares[name] = squares.get(name, np.zeros(2)) + np.array([move, turn])
    squares = {name: np.maximum(square, 0.0) for name, square in squares.items()}
    scale = np.maximum(np.sum(list(squares.values()), axis=0), 1e-300)
    order = sorted(squares, key=lambda name: -float((squares[name] / scale).max()))
    return tuple(Part(name, *map(_steady, np.sqrt(squares[name]).tolist())) for name in order)


def combined_parts(parts: Sequence[Part], most: int) -> list[Part]:
    """Return at most so many parts, the smallest as one with their names, or their number where these are long."""
    if len(parts) <= most:
        return list(parts)
    rest = parts[most - 1 :]
    size = np.sqrt(np.sum([[part.translation**2, part.rotation**2] for part in rest], axis=0)).tolist()
    names = ", ".join(part.name for part in rest)
    if len(names) > LONGEST_NAMES:
        names = f"{len(rest)} others" if most > 1 else "all errors"
    return [*parts[: most - 1], Part(names, *size)]


def part_name(source: str, together: bool) -> str:
    """Return the part that a source of the budget belongs to."""
    side, _, rest = source.partition(" ")
    if " + " in source or (side in ("robot", "camera", "A", "B") and rest.startswith((*_KINDS, EACH, "("))):
        if rest == SHARED:
            return f"errors shared by all {side} poses"
        return "noise of the poses" if together else f"noise of the {side} {'poses' if len(side) > 1 else 'motions'}"
    name = group_of(source)
    return PRINCIPAL_POINT if name.startswith(PRINCIPAL_POINT) else PLAIN.get(name, name)


def _factors(budget: Budget | None, result: Estimated, distance: float) -> dict[str, float]:
    """Return coverage factors for 95 % in the worst direction."""
    if budget is None:
        dof = result.reference.dof
        k = float(ndtri(0.975)) if dof is None else float(stdtrit(dof, 0.975))
        return dict.fromkeys(("X rotation", "X translation", "point"), k)
    found: dict[str, Expanded] = budget.expanded(worst=True)
    found |= budget.budget_at(np.array([0.0, 0.0, distance])).expanded(worst=True)
    return {name: of.k for name, of in found.items()}


def _steady(number: float) -> float:
    """Return the number without the last digits, which differ when it is computed again from a file."""
    return float(f"{number:.8g}")


def _worst(S: Array) -> float:
    """Return the standard deviation along the axis of the largest variance."""
    return float(principal_axes(S)[0][0])


def amounts(translation: float, rotation: float) -> str:
    """Return both sizes (m, rad) in mm and deg, with two digits."""
    return f"{digits(1e3 * translation, 2)} mm and {digits(float(np.degrees(rotation)), 2)} deg"
