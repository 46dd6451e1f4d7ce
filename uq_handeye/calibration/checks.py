"""Checks of a calibration, one line each, and the verdict whether X can be used.

Cautions come in the order of their effect on X. A last part lists the errors that the covariance of X includes and
those that it does not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar, Literal, get_args

import numpy as np
from scipy.special import erfc

from ..core.files.records import Record
from ..core.levels import IMPOSSIBLE, UNUSUAL
from ..core.limits import MIN_POSES_FOR_ROBUST
from ..core.presentation.numbers import digits, probability, times_of_noise
from ..findings import (
    CHECKS,
    HALVES,
    INPUT,
    MOTION,
    NEIGHBOURS,
    NOISE,
    OUTLIERS,
    RESIDUALS,
    SHARED,
    Finding,
    without_consequences,
)
from ..fit.graph.open_directions import MAX_ROTATION_SD_RAD
from ..fit.graph.shared_groups import grouped
from ..model.errors.error_estimate import ErrorEstimate
from ..model.errors.key import ErrorKey
from ..model.errors.key_text import plain_text
from ..model.errors.keys import CLOCK_OFFSET, FOCAL_LENGTH, INTRINSICS, ROBOT_ACCURACY, TARGET_SCALE
from ..model.errors.models import Noise, is_joint
from ..model.kinematics.kinematic_errors import DECLARED_AS
from .analysis import joint_sides
from .estimated import Estimated, distance_of

# X is not determined beyond this standard deviation of its translation, in distances of the target.
MAX_TRANSLATION_SD = 0.5
# Of few poses, the others prove nothing where a larger share is rejected: they may agree on a wrong X by chance.
MAX_REJECTED_OF_FEW = 0.35
# Poses from which on they are not few.
MIN_MANY_POSES = 20
# Ten tests are made of a result: together they raise a caution in 5 % of data sets (Bonferroni).
CAUTION_OF_TEN_TESTS = UNUSUAL.probability / 10
# Checks whose tests refute a result: what was assumed, given or declared, and X of two halves.
REFUTING = (NOISE, HALVES, SHARED)
# Methods whose results hold the residuals of the poses, unless they were updated by the joint posterior only.
_WITH_RESIDUALS = ("efficient", "ml")

Status = Literal["ok", "caution", "failed", "not run"]
STATUSES: tuple[Status, ...] = get_args(Status)
_PARTS = (slice(0, 3), slice(3, 6))  # rotation, translation


@dataclass(frozen=True)
class Check(Record):
    """One check: its name, its status, a short phrase, and the findings behind it."""

    _in_file: ClassVar[str] = "name status text"

    name: str
    status: Status
    text: str
    findings: tuple[Finding, ...] = ()


def in_order(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return the findings that are more than a note, those of the largest effect and the decisive ones first."""
    found = [finding for finding in findings if finding.severity != "note"]
    order = sorted(range(len(found)), key=lambda k: (-found[k].effect, found[k].record.rank, k))
    return tuple(found[k] for k in order)


def failures_in_words(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Return the failures among findings as short phrases, the decisive one first; also those of an `InputError`."""
    return tuple(dict.fromkeys(one.phrase for one in in_order(findings) if one.severity == "failure"))


def _is_refuted(finding: Finding) -> bool:
    """Return whether a test refutes an assumption, or that two halves have one X, beyond any chance."""
    p = finding.values.get("p_value")
    if p is None and finding.code == "diagnostics.undeclared":  # each is tested by its estimate
        p = min(float(erfc(abs(one["estimate"] / one["sd"]) / np.sqrt(2.0))) for one in finding.values["errors"])
    return finding.rejects and finding.record.check in REFUTING and p is not None and p < IMPOSSIBLE.probability


def lower_limit_of(result: Checked) -> bool:
    """Return whether the accuracy is a lower limit: tests show errors that it does not include, or none is included.

    Noise that is estimated from the residuals cannot show what all poses share: without any shared error declared or
    assumed it is a lower limit by itself.
    """
    if any(finding.rejects for finding in result.cautions):
        return True
    return result.noise_estimate is not None and not included(result)


def _all_findings(result: Estimated) -> Iterable[Finding]:
    """Return the findings of the result, and those of its diagnostics and halves that are not among them.

    Those that other findings explain are left out.
    """
    found = list(result.findings)
    if result.analysis is not None:
        halves = (result.analysis.split_half.finding, result.analysis.split_in_time.finding)
        found += [one for one in (*result.analysis.diagnostics.findings, *halves) if one not in found]
    return without_consequences(found)


def checks_of(
    cautions: Sequence[Finding], names: Iterable[str], without_findings: Callable[[str], Check]
) -> tuple[Check, ...]:
    """Return the checks of these names, and those of further findings, by their findings.

    ``without_findings`` makes the check of a name where nothing was found.
    """
    found: dict[str, list[Finding]] = {name: [] for name in names}
    misread = any(finding.explains for finding in cautions)  # then the fit does not test the rest
    for finding in cautions:
        found.setdefault(finding.record.check, []).append(finding)
    checks = []
    for name, findings in found.items():
        if findings:
            more = f" (+{len(findings) - 1} more)" if len(findings) > 1 else ""
            failed = any(one.rejects for one in findings)
            checks.append(Check(name, "failed" if failed else "caution", findings[0].phrase + more, tuple(findings)))
        else:
            checks.append(Check(name, "not run", "after the input") if misread else without_findings(name))
    return tuple(checks)


def _without_findings(result: Estimated, name: str) -> Check:
    """Return the check where nothing was found: passed, or not run and why."""
    if name == INPUT:
        if _are_few(result):
            return Check(name, "not run", f"{result.n_poses} poses fit under several readings of the files")
        return Check(name, "ok", "rows, units and frames fit together")
    if name == OUTLIERS:
        if result.table is None:
            return Check(name, "not run", _without_residuals(result))
        excluded = f"; {len(result.excluded)} excluded" if result.excluded else ""
        return Check(name, "ok", f"none of {len(result.table.counted)} {result.table.item}s{excluded}")
    if name == NOISE:
        return _of_noise(result)
    if result.analysis is None:
        why = f"not made for method {result.method}"
        if result.covariance is None or result.method in _WITH_RESIDUALS:
            why = _without_residuals(result)
        return Check(name, "not run", why)
    if name in (NEIGHBOURS, RESIDUALS):
        return _of_residuals(name, result)
    if name == HALVES:
        return _of_halves(result)
    if name == MOTION:
        spectrum, turning = result.analysis.diagnostics.spectrum, result.analysis.diagnostics.diversity.share
        shares = " / ".join(f"{100 * share:.0f}" for share in turning)
        condition = f", condition {digits(spectrum.condition, 2)}" if np.isfinite(spectrum.condition) else ""
        return Check(name, "ok", f"about three axes ({shares} %){condition}")
    assert name == SHARED
    if not included(result):
        return Check(name, "not run", "none declared or assumed")
    if result.noise_estimate is not None and _are_few(result):
        return Check(name, "not run", "too few poses")  # the noise takes what these errors would leave
    return Check(name, "ok", "the residuals agree with what is assumed")


def _are_few(result: Estimated) -> bool:
    """Return whether there are so few poses that they fit whatever is assumed."""
    return result.n_poses is not None and result.n_poses < MIN_POSES_FOR_ROBUST


def _of_noise(result: Estimated) -> Check:
    fit, estimate = result.fit, result.noise_estimate
    if fit is not None and fit.p_value is not None:
        if fit.p_value < CAUTION_OF_TEN_TESTS:
            return Check(NOISE, "caution", f"{times_of_noise(fit.sigma0)} ({probability(fit.p_value, 2)})")
        return Check(NOISE, "ok", f"the residuals agree with it ({probability(fit.p_value, 2)})")
    if result.covariance is None:
        return Check(NOISE, "not run", "no noise, given or estimated")
    if estimate is not None:
        return Check(NOISE, "not run", "estimated from the same residuals")
    return Check(NOISE, "not run", _without_residuals(result))


def _without_residuals(result: Estimated) -> str:
    """Return why there are no residuals of poses to look at."""
    if result.covariance is None:
        return "no noise, given or estimated"
    if result.method in _WITH_RESIDUALS:
        return "the result holds no residuals of poses"
    return f"needs the methods efficient or ml, not {result.method}"


def _of_residuals(name: str, result: Estimated) -> Check:
    assert result.analysis is not None
    found = result.analysis.diagnostics
    for noted in result.findings:
        if noted.record.check == name:
            return Check(name, "ok", noted.phrase, (noted,))
    tests = (found.autocorrelation,) if name == NEIGHBOURS else (found.normality, found.regression)
    reasons = [test.reason for test in tests if test.reason is not None]
    if len(reasons) == len(tests):
        return Check(name, "not run", reasons[0].phrase, tuple(reasons))
    words = "uncorrelated" if name == NEIGHBOURS else "Gaussian, without a pattern over the poses"
    if reasons:  # one of two
        words = "Gaussian" if found.normality.reason is None else "no pattern over the poses"
    return Check(name, "ok", words, tuple(reasons))


def _of_halves(result: Estimated) -> Check:
    assert result.analysis is not None
    halves = (result.analysis.split_half, result.analysis.split_in_time)
    run = [half for half in halves if half.possible]
    if not run:
        return Check(HALVES, "not run", halves[0].finding.phrase, (halves[0].finding,))
    least = min(float(np.min(half.p_value)) for half in run if half.p_value is not None)
    words = "agrees" if least >= UNUSUAL.probability else "differs no more than by chance"
    return Check(HALVES, "ok", f"X of two halves {words} ({probability(least, 2)})", tuple(h.finding for h in run))


def shared_groups(result: Estimated) -> list[ErrorEstimate]:
    """Return the shared errors of a result, those of many numbers as one."""
    carried = any(error.key.error == ROBOT_ACCURACY for error in result.shared)  # no part of the bound
    return grouped(result.shared, result.covariance if carried or result.bound is None else result.bound)


def included(result: Estimated) -> list[tuple[ErrorKey | None, str, bool]]:
    """Return the shared errors that the covariance of X includes: key, size in words, whether the size is assumed.

    It is not where the data found the size, or where it was declared. The key is None of several errors together.
    """
    found = {part.key for part in result.components if not part.known}
    parts: list[tuple[ErrorKey | None, str, bool]] = []
    if of_camera(result):
        parts.append((None, "errors of the intrinsics", False))
    elif result.noise is not None and _unnamed(result.noise):
        parts.append((None, "the joint covariance of the noise", False))
    groups: dict[ErrorKey, list[ErrorEstimate]] = {}  # by error: such as both coordinates of the principal point
    for group in shared_groups(result):
        groups.setdefault(group.key.error, []).append(group)
    of_arm = [key for key in groups if key.kind in DECLARED_AS]
    if of_arm:
        parts.append((None, f"errors of the arm ({', '.join(map(str, of_arm))})", False))
    for key, of_error in groups.items():
        if key in of_arm:
            continue
        sizes = list(dict.fromkeys(map(sizes_of, of_error)))
        parts.append((key, f"{plain_text(key)} {' and '.join(sizes)}", of_error[0].default and key not in found))
    columns = dict.fromkeys(key.source for key in column_keys(result))
    parts += [(key, str(key), False) for key in columns if not groups]
    if result.time_offset is not None and result.time_offset.std > 0:
        parts.append((CLOCK_OFFSET, f"{CLOCK_OFFSET} {digits(1e3 * result.time_offset.std, 2)} ms", False))
    return parts


def not_included(result: Estimated) -> list[str]:
    """Return the systematic errors that the covariance of X does not include."""
    keys = column_keys(result)
    known = of_camera(result) or FOCAL_LENGTH in keys
    camera = "camera model" if known else "camera intrinsics"
    if from_points(result):
        camera = "depth errors that points share"
    scene = getattr(getattr(result, "data", None), "scene", None) is not None
    if scene:
        return ["camera model", "scale and kinematics of the robot"]
    target = "target shape" if TARGET_SCALE in keys or of_camera(result) else "target size"
    robot = "robot kinematics"
    if any(error.key.error == ROBOT_ACCURACY for error in result.shared):
        assumed = all(error.default for error in result.shared if error.key.error == ROBOT_ACCURACY)
        robot = f"robot errors beyond those {'assumed' if assumed else 'declared'}"
    if any(key.kind in DECLARED_AS for key in keys):
        robot = "arm errors outside its model"
    return [camera, robot, target]


def sizes_of(group: ErrorEstimate) -> str:
    """Return the standard deviations assumed of the numbers of a group: one, or from the smallest to the largest."""
    if group.parts[0].stated:
        return group.parts[0].stated
    found = []
    for unit in group.units:
        prior = group.of_unit(unit)[0]
        ends = list(dict.fromkeys(digits(end, 2) for end in (prior.min(), prior.max())))
        found.append(f"{' to '.join(ends)} {unit}".rstrip())
    return ", ".join(found)


def column_keys(result: Estimated) -> tuple[ErrorKey, ...]:
    """Return the shared errors that the noise holds, without those of the intrinsics."""
    sides = joint_sides(result.noise).values()
    return tuple(key for S in sides for key in S.keys if key is not None and key != INTRINSICS)


def of_camera(result: Estimated) -> bool:
    """Return whether the noise of the camera poses holds the errors of the intrinsics."""
    S = joint_sides(result.noise).get("camera")
    return S is not None and bool({INTRINSICS, None} & set(S.keys))


def from_points(result: Estimated) -> bool:
    """Return whether the camera poses come from points in 3-D."""
    return getattr(getattr(result, "data", None), "camera_covariance", None) is not None


def _unnamed(noise: Noise) -> bool:
    """Return whether a side has a joint covariance that was given as such."""
    by_columns = joint_sides(noise)
    joint = [name for name, S in noise.sides.items() if S is not None and is_joint(S)]
    return any(name not in by_columns or None in by_columns[name].keys for name in joint)


class Checked(Estimated):
    """Checks of a result and their findings, in the order of their effect on X; a part of `Calibration`."""

    @cached_property
    def cautions(self) -> tuple[Finding, ...]:
        """The findings that are more than a note, those of the diagnostics too, in the order of their effect on X."""
        return in_order(_all_findings(self))

    @cached_property
    def checks(self) -> tuple[Check, ...]:
        """The checks of data and fit, one line each: ok, caution, failed or not run."""
        return checks_of(self.cautions, CHECKS, partial(_without_findings, self))

    @property
    def refuting(self) -> tuple[Finding, ...]:
        """Findings that make X unusable, the decisive one first: failures, then assumptions that a test refutes."""
        failures = [one for one in in_order(self.cautions) if one.severity == "failure"]
        return (*failures, *(one for one in self.cautions if one.severity != "failure" and _is_refuted(one)))

    @cached_property
    def contradictions(self) -> tuple[str, ...]:
        """Reasons why X cannot be used, without the one that more poses mend: that these do not determine X."""
        found = list(dict.fromkeys(one.phrase for one in self.refuting))
        if self.table is not None and len(self.table.counted) < MIN_MANY_POSES:
            rejected, n = len(self.table.rejected), len(self.table.counted)
            if rejected > MAX_REJECTED_OF_FEW * n:  # of few poses as many as are left may agree on a wrong X by chance
                found.append(f"{rejected} of {n} {self.table.item}s contradict X")
        return tuple(found)

    @cached_property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why X cannot be used, the decisive one first; empty where it can."""
        found = list(self.contradictions)
        if self.covariance is not None:
            turn, move = (float(np.sqrt(np.linalg.eigvalsh(self.covariance[part, part])[-1])) for part in _PARTS)
            if turn > MAX_ROTATION_SD_RAD or move > MAX_TRANSLATION_SD * distance_of(self.analysis)[0]:
                size = f"{digits(1e3 * move, 2)} mm and {digits(float(np.degrees(turn)), 2)} deg"
                found.append(f"the poses do not determine X (1 sigma: {size})")
        return tuple(found)
