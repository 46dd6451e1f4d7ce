"""The answer after each pose of a session: the accuracy of X, the best next pose, and whether more poses still help.

The result is that of `calibrate` on the poses so far; nothing is carried over from the previous answer, so that the
last one is bit-equal to a calibration of the same files.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...calibration.calibrate import calibrate
from ...calibration.result import Calibration
from ...calibration.tolerance import Tolerance, Verdict
from ...core.limits import MIN_POSES
from ...core.threads import one_thread
from ...errors import InputError, InputWarning, NotConvergedError
from ...findings import Finding
from ...model.errors.models import Noise
from ...model.poses.pose_pairs import PosePairs
from ...model.shared_errors.shared_error import SharedError
from ..planning.after_each import NextPose, next_pose, words_after, words_without
from .remedies import Remedy, remedies_of
from .starting_views import VIEWS

NoiseAndShared = tuple[Noise | None, list[SharedError] | None]
# Warnings are switched off for a whole process: one answer at a time, or they would come back in another thread's.
ONE_AT_A_TIME = threading.RLock()
# Poses ahead, and the relative gain below which they hardly help.
POSES_AHEAD, SMALL_GAIN = 5, 0.10


def words(answer: Answer, of_scene: bool = False) -> str:
    """Return what to do next in one sentence; nothing where the answer says it already."""
    if answer.n == 0:
        seen = "board in the middle, at about twice its diagonal"
        if of_scene:
            seen = "scene in the middle, so that it fills the picture"
        return (
            f"Start with ten poses like those in the picture: the {seen}, tilted by up to "
            f"{max(view[0] for view in VIEWS)} deg to each side, and turned about the line of sight."
        )
    if answer.passed:
        return "The tolerance is shown to be met: you can finish."
    if enough(answer):
        return f"Enough poses: {POSES_AHEAD} more would gain less than {100 * SMALL_GAIN:.0f} %."
    return ""


def enough(answer: Answer) -> bool:
    """Return whether `POSES_AHEAD` more poses would gain less than `SMALL_GAIN`.

    None of them gains more than the next one, g, so together at most ``1 - (1 - g)^5``; a lower bound of a
    gain says nothing.
    """
    ahead = answer.ahead
    if ahead is None or ahead.least or not np.isfinite(gain := ahead.gain):
        return False
    return 1.0 - (1.0 - max(gain, 0.0)) ** POSES_AHEAD < SMALL_GAIN


def _estimated(poses: PosePairs) -> NoiseAndShared:
    """Return noise and shared errors where nothing is given."""
    return None, None


@dataclass(frozen=True)
class Question:
    """Request to `calibrate` that is repeated after each pose, and the tolerance.

    ``noise_and_shared`` returns the noise and the shared errors that go with the poses, as `calibrate` takes them.
    """

    options: Mapping[str, Any] = field(default_factory=dict)
    noise_and_shared: Callable[[PosePairs], NoiseAndShared] = _estimated
    tolerance: Tolerance | None = None

    def calibrate(self, poses: PosePairs, left_out: tuple[int, ...] = ()) -> tuple[Calibration, NoiseAndShared]:
        """Return the calibration, and the noise and the shared errors that it was given."""
        with ONE_AT_A_TIME, warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)  # the result holds them as findings
            noise, shared = self.noise_and_shared(poses)
            result = calibrate(poses, noise=noise, shared=shared, exclude=list(left_out) or None, **self.options)
        return result, (noise, shared)

    def ask(self, n: int, poses: PosePairs | None, left_out: tuple[int, ...] = (), plan: bool = True) -> Answer:
        """Return the answer for ``n`` complete poses; ``poses=None``: too few of them can be read."""
        with ONE_AT_A_TIME, one_thread():
            return self._ask(n, poses, left_out, plan)

    def _ask(self, n: int, poses: PosePairs | None, left_out: tuple[int, ...], plan: bool) -> Answer:
        if poses is None or poses.n - len(left_out) < MIN_POSES:
            return Answer(n, tuple(words_without(n - len(left_out), InputError(""))), left_out, poses)
        try:
            result, (noise, shared) = self.calibrate(poses, left_out)
        except (InputError, NotConvergedError) as error:
            lines = tuple(words_without(n - len(left_out), error))
            return Answer(n, lines, left_out, poses, findings=tuple(error.findings))
        verdict = None if self.tolerance is None else result.verdict(self.tolerance)
        ahead = None
        if plan and not (verdict is not None and verdict.passed):
            kept = np.setdiff1d(np.arange(poses.n), left_out)
            ahead = next_pose(result, noise if noise is None or not left_out else noise.rows(kept), shared)
        lines = tuple(words_after(result, verdict, ahead))
        return Answer(n, lines, left_out, poses, result, verdict, ahead, result.findings)


@dataclass(frozen=True, eq=False)
class Answer:
    """The calibration after ``n`` poses; without a ``result`` the ``lines`` give the reason."""

    n: int
    lines: tuple[str, ...]
    left_out: tuple[int, ...] = ()
    poses: PosePairs | None = None
    result: Calibration | None = None
    verdict: Verdict | None = None
    ahead: NextPose | None = None
    findings: tuple[Finding, ...] = ()  # about the poses, also where there is no X

    @property
    def remedies(self) -> tuple[Remedy, ...]:
        """Remedies for the findings."""
        return remedies_of(self.findings, [k for k in range(self.n) if k not in self.left_out])

    @property
    def verdicts(self) -> dict[str, Verdict]:
        """The verdict by the name of the camera; none without a tolerance."""
        return {} if self.result is None or self.verdict is None else {self.result.names.camera: self.verdict}

    @property
    def size(self) -> float | None:
        """Standard uncertainty (m) of a point at the distance of the target; None where X is not usable."""
        result = self.result
        if result is None or result.opened is not None or not result.usable or result.accuracy is None:
            return None
        return result.accuracy.point if np.isfinite(result.accuracy.point) else None

    @property
    def passed(self) -> bool:
        """True if the tolerance is shown to be met."""
        return self.verdict is not None and self.verdict.passed
