r"""Report after each pose of a session: the accuracy so far, the next pose, and whether more poses help.

Model: the mean squared error of points at the distance of the target, ``c(S) = tr(S_tau) + 2/3 length^2 tr(S_theta)``
(criterion ``trace`` of `planning.plan`), in which S is the whole covariance of X. A planned pose lowers it by as much
as the plan says; the gain is that of the root, ``1 - sqrt(c_after / c)``.

More poses average the noise. Errors that all poses share remain, as far as the data do not resolve them: their part of
S, without the noise, is a limit that more poses do not pass.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from ...calibration.accuracy import amounts, part_keys
from ...calibration.checks import failures_in_words
from ...calibration.result import Calibration
from ...calibration.tolerance import MET, Verdict, percent, probability_within
from ...core.geometry.se3 import Array, logarithm
from ...errors import DegenerateMotionError, InputError, NotConvergedError
from ...fit.graph.reference import Reference
from ...model.errors.key import Kind
from ...model.errors.models import Noise, PoseNoise
from ...model.poses.pose_pairs import PosePairs
from ...model.shared_errors.shared_error import OF_ANY_POSES, SharedError
from .by_posterior import Known, PlanRequest
from .plan import plan, plan_from

# From this share of the variance of X on the errors that all poses share are what limits it.
LIMITING_VARIANCE_SHARE = 0.8
# Parts of the accuracy that more poses average.
AVERAGED = (Kind.POSES, Kind.POSES_AND_TOUCHES)
# From this number of poses on the accuracy that is assumed by the residuals has converged.
MIN_POSES_SETTLED = 10


@dataclass(frozen=True, eq=False)
class NextPose:
    """The robot pose to take next."""

    robot: Array  # (4, 4) base_T_gripper
    gain: float  # by which it lowers the standard deviation of a point at the distance of the target, relative
    least: bool = False  # noise estimated from few poses: what a further one says of it comes to the gain

    def __str__(self) -> str:
        x, y, z = 1e3 * self.robot[:3, 3]
        a, b, c = np.degrees(logarithm(self.robot[:3, :3]))
        gain = f"{100 * self.gain:.0f} %" if self.gain >= 0.005 else "less than 1 %"
        gain += " or more" if self.least else ""
        return (
            f"the next pose would gain {gain}; take base_T_gripper x {x:.0f} y {y:.0f} z {z:.0f} mm, rotation vector "
            f"x {a:.0f} y {b:.0f} z {c:.0f} deg"
        )


def next_pose(result: Calibration, noise: Noise | None, shared: list[SharedError] | None) -> NextPose | None:
    """Return the pose that would gain most, of 100 robot poses drawn around the target; None where none can be planned.

    Beside an arm whose joints are known the pose is within its reach and joint limits. ``noise`` and ``shared`` are
    those that `calibrate` was given.
    """
    data = result.counted
    if result.covariance is None or not isinstance(data, PosePairs):
        return None
    given = noise if isinstance(noise, PoseNoise) else None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # they are those of the calibration
            told = all(error.key in OF_ANY_POSES for error in shared or ())  # also what it does to new poses
            if told and result.posterior is not None and result.opened is None:
                known = Known(result, data, result.noise_estimate is not None)
                found = plan_from(known, PlanRequest(k=1, criterion="trace", sample=100).of(data))
            else:
                errors = None if shared is None else [error for error in shared if error.key in OF_ANY_POSES]
                found = plan(data, k=1, noise=given, shared=errors, sample=100)
    except (InputError, NotConvergedError):
        return None
    if result.opened is not None or found.length is None:
        return NextPose(found.robot[0], float("nan"))
    size = max(_mean_square(result.covariance, found.length), float(found.criterion_before))
    saved = float(found.criterion_before - found.criterion_values[0])
    least = result.noise_estimate is not None and (result.n_poses or 0) < MIN_POSES_SETTLED
    return NextPose(found.robot[0], 1.0 - float(np.sqrt(max(size - saved, 0.0) / size)), least)


def words_after(result: Calibration, verdict: Verdict | None, ahead: NextPose | None) -> list[str]:
    """Return one or two lines: the accuracy so far and the verdict; the next pose, or what limits X."""
    n = result.n_poses
    if result.opened is not None:
        first = f"{n} poses: not determined yet: {'; '.join(result.open_words)}."
        turn = "take a pose that rotates about another axis" if ahead is None else str(ahead).partition("; ")[2]
        return [first, _sentence(turn)]
    if result.reasons or result.accuracy is None:
        why = result.reasons[0] if result.reasons else "the covariance of X is not determined"
        return [f"{n} poses: X is not usable yet: {why}."]
    accuracy = result.accuracy
    first = f"{n} poses: {amounts(accuracy.translation, accuracy.rotation)}"
    if verdict is not None and verdict.passed:
        return [f"{first}.", str(verdict)]
    if verdict is not None and verdict.probability is not None:
        first += f"; within {verdict.tolerance} with {percent(verdict.probability)}, {percent(MET)} are needed"
    if verdict is not None and verdict.reasons:
        first += f"; {verdict.reasons[0]}"
    limit = limit_of(result, verdict)
    if limit is not None:
        return [f"{first}.", limit]
    return [f"{first}.", *([] if ahead is None else [_sentence(str(ahead))])]


def words_without(n: int, error: InputError | NotConvergedError) -> list[str]:
    """Return the line of a session of which there is no X yet."""
    if n < 3:
        return [f"{n} pose{'' if n == 1 else 's'}: at least 3 are needed, rotated about different axes."]
    if isinstance(error, DegenerateMotionError):
        return [f"{n} poses: X is not determined yet. Take poses that rotate by 30 deg and more, about different axes."]
    if reasons := failures_in_words(error.findings):
        return [f"{n} poses: no X: {reasons[0]}."]
    return [f"{n} poses: no X yet. {' '.join(str(error).split())}"]


def limit_of(result: Calibration, verdict: Verdict | None) -> str | None:
    """Return the sentence that more poses will not help, with what limits X; None where they do.

    With a tolerance: where X would not meet it without any noise of the poses. Otherwise where errors that all poses
    share make up most of the variance. Errors that are assumed by the residuals are too large at first: with these
    nothing is said of the limit of fewer than `MIN_POSES_SETTLED` poses.
    """
    if not result.has_budget or result.accuracy is None or result.covariance_kind != "model":
        return None
    budget = result.budget
    keys = part_keys(budget.keys)
    stays = np.array([key.kind not in AVERAGED for key in keys])
    if not stays.any():
        return None
    floor = budget.covariances[stays, :6, :6].sum(axis=0)
    total = budget.covariances[:, :6, :6].sum(axis=0)
    length = result.accuracy.distance
    sizes = {key: 0.0 for key, kept in zip(keys, stays, strict=True) if kept}
    for key, S in zip(keys, budget.covariances[:, :6, :6], strict=True):
        if key in sizes:
            sizes[key] += _mean_square(S, length)
    largest = max(sizes, key=lambda key: sizes[key])
    part = next(part for part in result.accuracy.parts if part.key == largest)
    what = part.stated or part.name
    assumed = any(error.key.error == largest and error.default for error in result.shared)
    if assumed and (result.n_poses or 0) < MIN_POSES_SETTLED:
        return None
    share = _mean_square(floor, length) / _mean_square(total, length)
    makes = f"what limits X is the {what}; errors that all poses share make {100 * share:.0f} % of its variance"
    if verdict is not None:
        floor = 0.5 * (floor + floor.T)
        if probability_within(floor, Reference(), verdict.tolerance, result.X[:3, :3]) < MET:
            return f"More poses will not reach {verdict.tolerance}: {makes}."
        return None
    return f"More poses will hardly help: {makes}." if share >= LIMITING_VARIANCE_SHARE else None


def _mean_square(S: Array, length: float) -> float:
    """c(S) of the module, m^2."""
    return float(np.trace(S[3:, 3:]) + 2.0 / 3.0 * length**2 * np.trace(S[:3, :3]))


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."
