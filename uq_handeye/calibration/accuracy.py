r"""The accuracy of X: total standard uncertainty in the worst direction, for X and at the distance of the target.

The headline states it in one sentence, or that X cannot be used and why.

Model: ``xi = (theta, tau)`` of X has the covariance S of the calibration (noise, shared errors, correlation). The
standard uncertainty of a part in its worst direction is the root of the largest eigenvalue of its block of S; that of a
point p straight ahead of the camera is ``sqrt(max eig J S J^T)``, ``J = [-[R p]x, I]`` (`diagnostics.task_space`). What
is stated for 95 % is the length that 95 % of the errors are within, in all directions together, by the points of
`calibration.error_of_X`: the rule of the verdict on a tolerance, too.

*From the poses.* Errors a of robot, camera and target that are assumed, and that the data do not determine, add the
uncertainty of their priors. With P the joint covariance of xi and a, the contribution of the poses alone is the
covariance of xi for known a, ``P_xx - P_xa P_aa^-1 P_ax``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from ..core.files.records import Record
from ..core.geometry.pose_numbers import principal_axes
from ..core.geometry.se3 import Array
from ..core.presentation.numbers import digits
from ..core.presentation.units import MM_PER_M
from ..core.rounding import SOLUTION_ROUNDING
from ..findings import step_after
from ..fit.diagnostics.budget import Budget, Source
from ..fit.diagnostics.sentences import DECLARE
from ..model.errors.key import ErrorKey, Kind, Owner
from ..model.errors.keys import (
    FOCAL_LENGTH,
    LENS,
    OUTLINE,
    PRINCIPAL_POINT,
    ROBOT_ACCURACY,
    TARGET_SCALE,
    VIEW,
)
from .checks import Checked, included, lower_limit_of, not_included
from .contribution import Contribution
from .error_of_X import radius_95
from .estimated import Estimated, distance_of
from .stored_result import NOT_USABLE
from .tolerance import Tolerance, ToleranceLike, Verdict, probability_of, verdict_of

# A number is known by its prior where the data leave more than this share of the prior variance.
MAX_PRIOR_SHARE = 0.5
# What default priors add is stated where X is this many times as uncertain with them.
MIN_PRIOR_GAIN = 1.25
# A tolerance that X is said to meet is larger by this share than the length that it is rounded from.
SIZE_MARGIN = 1e-3
# With fewer poses, more of them are the first advice where noise limits X.
MIN_POSES_TO_TAKE = 25
# Kinds of a budget that are noise of each pose, of one side.
_NOISE = (Kind.ROTATION, Kind.TRANSLATION, Kind.COUPLING, Kind.BOTH, Kind.EACH_POSE)
NOISE_OF_POSES = ErrorKey(Owner.ALL, Kind.POSES)


@dataclass(frozen=True)
class FromPoses(Record):
    """Standard uncertainties in the worst direction from the poses alone; see the module.

    ``assumed``: the errors whose priors contribute most to the difference from the total, the largest first.
    """

    translation: float  # m
    rotation: float  # rad
    assumed: tuple[ErrorKey, ...]


@dataclass(frozen=True)
class Accuracy(Record):
    """Standard uncertainties (1 sigma) of X in the worst direction, in m and rad.

    ``_95``: the length or angle that 95 % of the errors are within, in all directions together.

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
    parts: tuple[Contribution, ...]
    included: tuple[str, ...]
    not_included: tuple[str, ...]
    lower_limit: bool  # the errors that are not included are known to matter
    from_poses: FromPoses | None = None  # where priors of errors that are assumed add to it

    _if_any: ClassVar[str] = "from_poses"


def accuracy_of(result: Statement) -> Accuracy | None:
    """Return the accuracy of X; None where the covariance is not determined."""
    if result.covariance is None:
        return None
    S = result.covariance
    distance, known = distance_of(result.analysis)
    point, point_95 = point_ahead(result, distance)
    budget = budget_of_model(result)
    xi = result.error_points
    touched = sum(one.values["count"] for one in result.findings if one.code == "evidence.touches_used")
    move, turn = _worst(S[3:, 3:]), _worst(S[:3, :3])
    stated = [
        (key, f"{text} (assumed)" if default and not text.endswith("assumed)") else text)
        for key, text, default in included(result)
    ]
    words = [text for _, text in stated]
    if touched:
        words.insert(0, f"{touched} touched {'point' if touched == 1 else 'points'}")
    return Accuracy(
        translation=_steady(move),
        rotation=_steady(turn),
        point=_steady(point),
        translation_95=_steady(radius_95(xi[:, 3:])),
        rotation_95=_steady(radius_95(xi[:, :3])),
        point_95=_steady(point_95),
        distance=distance,
        distance_known=known,
        parts=() if budget is None else parts_of(budget, stated),
        included=(str(NOISE_OF_POSES), *words),
        not_included=tuple(not_included(result)),
        lower_limit=lower_limit_of(result),
        from_poses=None if touched else _from_poses(result),
    )


def _from_poses(result: Estimated) -> FromPoses | None:
    """Return what the poses alone give; None where priors add little."""
    posterior = result.posterior
    if posterior is None or result.covariance is None or result.covariance_kind != "model":
        return None
    place = {key: posterior.p + k for key, k in posterior.place.items()}
    of: dict[ErrorKey, list[int]] = {}
    for error in result.shared:
        if error.default and error.key in place and error.resolved < 1.0 - MAX_PRIOR_SHARE:
            of.setdefault(error.key.error, []).append(place[error.key])
    return from_poses_of(posterior.covariance, slice(0, 6), of)


def from_poses_of(P: Array, pose: slice, of: Mapping[ErrorKey, Sequence[int]]) -> FromPoses | None:
    """Return what the poses alone give of a pose; None where priors add little.

    ``P``: joint covariance (N, N) of poses and errors. ``pose``: the six numbers of the pose. ``of``: by the errors
    that are assumed, the places of their numbers.
    """

    def known(index: Sequence[int]) -> Array:
        across = P[pose, index]
        C = P[pose, pose] - across @ np.linalg.solve(P[np.ix_(index, index)], across.T)
        return np.array([_worst(C[3:, 3:]), _worst(C[:3, :3])])

    if not of:
        return None
    total, alone = known([]), known([k for index in of.values() for k in index])
    if not (total > MIN_PRIOR_GAIN * alone).any():
        return None
    gains = {key: float((1.0 - known(index) / total).max()) for key, index in of.items()}
    named = [key for key in sorted(gains, key=lambda key: -gains[key]) if gains[key] > 0.5 * max(gains.values())]
    return FromPoses(_steady(float(alone[0])), _steady(float(alone[1])), tuple(named))


def parts_of(budget: Budget, stated: Sequence[tuple[ErrorKey | None, str]] = ()) -> tuple[Contribution, ...]:
    """Return the sources of a budget as few parts, largest first: noise, shared errors, correlated errors.

    ``stated``: errors that are included, with their size in words.
    """
    along = budget.in_worst_direction()
    squares: dict[ErrorKey, Array] = {}
    for key, move, turn in zip(part_keys(budget.keys), along["X translation"], along["X rotation"], strict=True):
        squares[key] = squares.get(key, np.zeros(2)) + np.array([move, turn])
    squares = {key: np.maximum(square, 0.0) for key, square in squares.items()}
    scale = np.maximum(np.sum(list(squares.values()), axis=0), 1e-300)
    order = sorted(squares, key=lambda key: -float((squares[key] / scale).max()))
    words = dict(stated)
    sizes = {key: [_steady(size) for size in np.sqrt(square).tolist()] for key, square in squares.items()}
    return tuple(Contribution((key,), sizes[key][0], sizes[key][1], words.get(key, "")) for key in order)


def combined_parts(parts: Sequence[Contribution], most: int, sized: bool = False) -> list[tuple[str, float, float]]:
    """Return name, translation (m) and rotation (rad) of at most ``most`` parts; ``sized``: with those of errors.

    The smallest parts are combined in one, with their names or their number.
    """
    kept, rest = (parts, parts[:0]) if len(parts) <= most else (parts[: most - 1], parts[most - 1 :])
    rows = [((part.stated if sized else "") or part.name, part.translation, part.rotation) for part in kept]
    if rest:
        move, turn = np.sqrt(np.sum([[part.translation**2, part.rotation**2] for part in rest], axis=0)).tolist()
        names = ", ".join(part.name for part in rest)
        if len(names) > 48:
            names = "all other errors" if most > 1 else "all errors"
        rows.append((names, move, turn))
    return rows


def part_keys(sources: Sequence[Source]) -> list[ErrorKey]:
    """Return for each source of a budget the part that it belongs to."""
    together = any(len(source) > 1 for source in sources)  # robot and camera are not identifiable
    found = []
    for source in sources:
        key = source[0]
        if len(source) > 1 or key.kind in _NOISE:
            key = NOISE_OF_POSES if together else ErrorKey(key.owner, Kind.POSES)
        found.append(key.error)
    return found


def budget_of_model(result: Estimated) -> Budget | None:
    """Return the budget whose sum is the covariance of X; None where there is none."""
    return result.budget if result.has_budget and result.covariance_kind == "model" else None


def point_ahead(result: Estimated, distance: float) -> tuple[float, float]:
    """Return the standard uncertainty of a point straight ahead of the camera in the worst direction, and the length
    that 95 % of its errors are within, m; infinite where it is not determined.
    """
    found = result.uncertainty_at(np.array([0.0, 0.0, distance]))
    S = found.covariance
    return _worst(S) if np.isfinite(S).all() else float("inf"), float(found.radius_95)


def _steady(number: float) -> float:
    """Return the number without the last digits, which differ when it is computed again from a file."""
    return float(f"{number:.8g}")


def _worst(S: Array) -> float:
    """Return the standard deviation along the axis of the largest variance."""
    return float(principal_axes(S)[0][0])


def amounts(translation: float, rotation: float) -> str:
    """Return both sizes (m, rad) in mm and deg, with two digits."""
    return f"{digits(1e3 * translation, 2)} mm and {digits(float(np.degrees(rotation)), 2)} deg"


def suits_of(result: Statement) -> str | None:
    """Return a sentence with the tolerance of a point that X meets; None where X is not usable or that is not known.

    It is the length that 95 % of the errors of a point at the distance of the target are within, rounded up to two
    digits: the verdict on this tolerance there is PASS.
    """
    accuracy = result.accuracy
    if not result.usable or accuracy is None or not np.isfinite(accuracy.point_95) or accuracy.point <= 0:
        return None
    size = rounded_up(accuracy.point_95 * MM_PER_M * (1.0 + SIZE_MARGIN))
    far = f"{'The target' if accuracy.distance_known else 'A point'} {digits(accuracy.distance, 3)} m ahead"
    verdict = result.verdict((float(size) / MM_PER_M, None), at=accuracy.distance)
    if verdict.passed:
        return f"{far}: good for a tolerance of {size} mm (95 %)."
    return f"{far}: no tolerance is shown to be met: {'; '.join(verdict.reasons)}."


def rounded_up(number: float, places: int = 2) -> str:
    """Return a number above 0 with so many digits, the last one rounded up."""
    step = 10.0 ** (np.floor(np.log10(number)) - places + 1)
    return digits(float(np.ceil(number / step * (1 - SOLUTION_ROUNDING)) * step), places)


# Owner of each error whose size is assumed, and the option that declares it.
_ASSUMED = {
    ROBOT_ACCURACY: ("an arm of unknown accuracy", "Give joints (--joints, --urdf), --robot-model or --robot-accuracy"),
    FOCAL_LENGTH: ("the focal length", "Give pictures, or --shared 'focal length=SD'"),
    PRINCIPAL_POINT: ("the principal point", "Give pictures, or --shared 'principal point=SD'"),
    TARGET_SCALE: ("the size of the target", "Measure it, and give --target-scale-sd"),
    VIEW: ("an unknown camera", "Give pictures or corners"),
    LENS: ("an unknown camera", "Give pictures or corners"),
    OUTLINE: ("an unknown target", "Give pictures or corners"),
}


def limit_of(result: Statement) -> str | None:
    """Return a sentence on what limits the accuracy: priors of errors that are assumed, with advice, or the largest
    part; None where X is not usable or that is not known.
    """
    accuracy = result.accuracy
    if accuracy is None or result.reasons:
        return None
    if accuracy.from_poses is not None:
        return limit_words(accuracy.from_poses)
    if not accuracy.parts:
        return None
    largest = accuracy.parts[0]
    return f"Most of it is {largest.name}: {amounts(largest.translation, largest.rotation)}."


def limit_words(own: FromPoses) -> str:
    """Return a sentence on what the poses alone give, and on the prior that adds most to it, with advice."""
    of, give = _ASSUMED.get(own.assumed[0], (f"the {own.assumed[0]}", "Declare it"))
    known = amounts(own.translation, own.rotation)
    return f"These poses alone give {known}; the rest is assumed of {of}. {give}."


def _about_largest(result: Checked, accuracy: Accuracy) -> str | None:
    """Return what to do about the largest part of the accuracy."""
    if not accuracy.parts:
        return None
    part, count = accuracy.parts[0], result.n_poses or result.n_pairs
    if part.key.kind in (Kind.POSES, Kind.POSES_AND_TOUCHES) and count < MIN_POSES_TO_TAKE:
        return "take more poses to reduce the noise: uq-handeye plan chooses them"
    if part.key in DECLARE and any(error.key.error == part.key and error.default for error in result.shared):
        option, sd = DECLARE[part.key]
        return f"measure the {part.name}, which limits X, and declare how well: such as {option.format(sd)}"
    return None


class Statement(Checked):
    """Accuracy of X, its checks, whether X can be used and whether it meets a tolerance; a part of `Calibration`."""

    @cached_property
    def accuracy(self) -> Accuracy | None:
        """The total standard uncertainty of X in the worst direction, with its parts; None: not determined."""
        return accuracy_of(self)

    @property
    def answered(self) -> Literal["whole", "in part", "no"]:
        """``whole``: X explains the poses and is determined by them. ``in part``: directions of it are open
        (`open_directions`), and the others are known. ``no``: X cannot be used (`reasons`).
        """
        if self.reasons:
            return "no"
        return "whole" if self.opened is None or not self.opened.of_X.size else "in part"

    @property
    def usable(self) -> bool:
        """True if X explains the poses and is determined by them; otherwise see `reasons` and `open_directions`."""
        return self.answered == "whole"

    @cached_property
    def headline(self) -> str:
        """Accuracy of X in one sentence; or ``NOT USABLE:`` and the decisive reason."""
        if self.reasons:
            return f"{NOT_USABLE}: {self.reasons[0]}."
        accuracy = self.accuracy
        if accuracy is None:
            return f"The accuracy of {self.frame} is not known: no noise was given, and none could be estimated."
        if self.translation_open:
            known = (
                f"the rotation is known to {digits(np.degrees(accuracy.rotation), 2)} deg (1 sigma, worst direction)"
            )
            return f"{self.frame}: {known}. Not determined: {'; '.join(self.open_words)}."
        if self.opened is not None and self.opened.of_X.size:
            known = f"{amounts(accuracy.translation, accuracy.rotation)} (1 sigma, worst direction that is known)"
            return f"{self.frame} is known to {known}. Not determined: {'; '.join(self.open_words)}."
        known = f"{amounts(accuracy.translation, accuracy.rotation)} (1 sigma, worst direction)"
        if accuracy.lower_limit:
            known = f"no better than {known}"
        return f"{self.frame} is known to {known}."

    @property
    def remedy(self) -> str | None:
        """Remedy of the cautions, first of those that explain others; None where nothing has one."""
        first = [finding for finding in self.cautions if finding.record.first]
        return step_after([*first, *self.cautions])

    @property
    def advice(self) -> str | None:
        """The next step about the data or the noise, None where there is nothing to do."""
        if (found := self.remedy) is not None:
            return found
        if (accuracy := self.accuracy) is None:
            return "give the noise: --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm"
        return _about_largest(self, accuracy)

    @property
    def is_stated(self) -> bool:
        """True if the accuracy is known."""
        return self.accuracy is not None

    @property
    def status(self) -> str:
        """Status of the headline: "failed" where X is not usable, "caution" where a check is not ok, or "ok"."""
        if self.reasons:
            return "failed"
        if self.accuracy is None or self.accuracy.lower_limit or self.cautions:
            return "caution"
        return "ok"

    def verdicts(self, tolerance: ToleranceLike | None, at: str | float | None = None) -> dict[str, Verdict]:
        """Return whether X meets a tolerance, by the name of the camera, as of a rig of several; none without one."""
        return {} if tolerance is None else {self.names.camera: self.verdict(tolerance, at)}

    def conformity(self, camera: str, tolerance: Tolerance) -> float:
        """Return the probability that X lies within a tolerance; ``camera``: its name, as of a rig of several."""
        return probability_of(self, tolerance)

    def verdict(self, tolerance: ToleranceLike, at: str | float | None = None) -> Verdict:
        """Return whether X meets a tolerance: PASS, FAIL or NOT SHOWN, with the probability (`calibration.tolerance`).

        Parameters
        ----------
        tolerance : str, (m, rad) or Tolerance
            Such as ``"1mm,0.1deg"``, ``"1mm"`` or ``"0.1deg"``: the largest errors that are accepted.
        at : str, float or None
            Distance (m, or text with its unit) of a point ahead of the camera, whose error the length is then of; None:
            the length is of the translation of X.

        Raises
        ------
        InputError
            A tolerance that cannot be read.
        """
        return verdict_of(self, tolerance, at)
