"""The accuracy of the cameras of a rig, the tolerance that they meet, what limits it, and the checks.

The sentences and the names of the checks are those of one camera (`accuracy`, `checks`), as are the rules: a tolerance
is the length that 95 % of the errors of a point straight ahead of the camera are within (`error_of_X`), here of the
least accurate camera. The checks of a rig are made of its own tests: residuals by chi-square, copies of each pose
before and after every moment (`fit.diagnostics.paths`), and the dual bound (`fit.diagnostics.optimality`).
"""

from __future__ import annotations

from functools import cached_property, partial
from typing import Literal

import numpy as np

from ..core.levels import CONTRADICTED, IMPOSSIBLE, UNUSUAL
from ..core.limits import MIN_POSES_FOR_ROBUST
from ..core.presentation.numbers import digits, probability, times_of_noise
from ..core.presentation.units import MM_PER_M
from ..findings import (
    CHECKS,
    HALVES,
    INPUT,
    MINIMUM,
    MOTION,
    NEIGHBOURS,
    NOISE,
    OUTLIERS,
    RESIDUALS,
    SHARED,
    Finding,
    step_after,
)
from ..fit.graph.robust import is_weak_minority
from ..model.errors.key import ErrorKey
from .accuracy import MAX_PRIOR_SHARE, SIZE_MARGIN, amounts, from_poses_of, limit_words, rounded_up
from .checks import CAUTION_OF_TEN_TESTS, Check, checks_of, in_order
from .error_of_X import PointAhead, point_ahead_of
from .report.facts import Facts, facts_of_rig
from .rig_poses import RigPoses
from .stored_result import NOT_USABLE

# The residuals contradict the model, whatever the size of the noise, where chi-square over its degrees of freedom
# exceeds this.
MAX_CHI_SQUARE_RATIO = 10.0
# Noise that was given is refuted from residuals on that are larger by this factor, where that is no chance.
MIN_REFUTED_RATIO = 1.3
# Next step where the motions leave directions open.
ANOTHER_AXIS = "add poses that rotate about another axis: uq-handeye plan chooses them"
# Of a result it is doubted where a larger share of the views is rejected.
MAX_REJECTED_VIEWS = 0.1


class RigStatement(RigPoses):
    """Accuracy of the poses of a rig, their checks, and whether they can be used; a part of `RigCalibration`."""

    @property
    def answered(self) -> Literal["whole", "in part", "no"]:
        """``whole``: all directions are determined. ``in part``: `open` are not. ``no``: see `reasons`."""
        if self.reasons:
            return "no"
        return "in part" if len(self.open) else "whole"

    @property
    def usable(self) -> bool:
        """True if the poses can be used, and are determined in all directions."""
        return self.answered == "whole"

    @property
    def headline(self) -> str:
        """Accuracy of the cameras in one sentence; or ``NOT USABLE:`` and the decisive reason."""
        if self.reasons:
            return f"{NOT_USABLE}: {self.reasons[0]}."
        if len(self.open):
            names = ", ".join(one.name for one in self.singles if len(one.open))
            count = "1 direction" if len(self.open) == 1 else f"{len(self.open)} directions"
            return f"Not determined: {count}, of {names}. The robot poses turn about too few axes."
        turns, shifts = zip(*(one.sizes for one in self.cameras.values()), strict=True)
        known = f"{amounts(max(shifts), max(turns))} (1 sigma, worst direction)"
        if len(self.cameras) == 1:
            (one,) = self.cameras.values()
            return f"{one.frame} is known to {known}."
        count = "Both" if len(self.cameras) == 2 else f"All {len(self.cameras)}"
        return f"{count} cameras are known to {known} or better."

    @property
    def status(self) -> str:
        """Status of the headline: "failed" where the poses are not usable, "caution" where something is found, "ok"."""
        if self.reasons:
            return "failed"
        return "caution" if any(check.status in ("caution", "failed") for check in self.checks) else "ok"

    @property
    def suits(self) -> str | None:
        """A sentence with the tolerance of a point that all cameras meet; None where they are not usable."""
        ahead = self.points_ahead
        if not self.usable or not ahead or not all(np.isfinite(one.within_95) for one in ahead.values()):
            return None
        far = list(dict.fromkeys(digits(at(one.distance for one in ahead.values()), 3) for at in (min, max)))
        where = f"The target{'' if len(self.targets) == 1 else 's'} {' to '.join(far)} m ahead"
        if self.doubts:
            return f"{where}: no tolerance is shown to be met: {self.doubts[0]}."
        size = rounded_up(max(one.within_95 for one in ahead.values()) * MM_PER_M * (1.0 + SIZE_MARGIN))
        whose = "" if len(ahead) == 1 else "both cameras are " if len(ahead) == 2 else f"all {len(ahead)} cameras are "
        return f"{where}: {whose}good for a tolerance of {size} mm (95 %)."

    @property
    def limit(self) -> str | None:
        """A sentence on what limits the accuracy of the least accurate camera, where that is a prior; or None."""
        posterior = self.posterior
        if posterior is None or self.reasons or len(self.open):
            return None
        estimated = {ErrorKey.from_dict(part["key"]) for part in self.components}
        assumed: dict[ErrorKey, list[int]] = {}
        for k, key in enumerate(posterior.keys, start=posterior.p):
            if key.error in estimated and posterior.covariance[k, k] > MAX_PRIOR_SHARE:  # of 1, its prior
                assumed.setdefault(key.error.of(""), []).append(k)
        worst = max(self.cameras, key=lambda name: self.cameras[name].sizes[1])
        k = 6 * self.names.index(worst)
        own = from_poses_of(posterior.covariance, slice(k, k + 6), assumed)
        return None if own is None else limit_words(own)

    @cached_property
    def points_ahead(self) -> dict[str, PointAhead]:
        """The error of a point straight ahead of each camera that is determined, at the RMS distance of its targets."""
        found = {}
        for name, one in self.cameras.items():
            depths = [np.linalg.norm(view.poses[:, :3, 3], axis=-1) for view in self.rig.views if view.camera == name]
            if depths and not len(one.open):
                distance = float(np.sqrt(np.mean(np.concatenate(depths) ** 2)))
                found[name] = point_ahead_of(one.pose, one.covariance, self.reference, distance)
        return found

    @property
    def cautions(self) -> tuple[Finding, ...]:
        """The findings that are more than a note, in the order of their effect on the poses."""
        return in_order(self.findings)

    @cached_property
    def checks(self) -> tuple[Check, ...]:
        """The checks of views and fit, one line each, in the order of those of one camera."""
        checks = checks_of(self.cautions, (*CHECKS, MINIMUM), partial(_without_findings, self))
        return tuple(_rejected(self, one) if one.name == OUTLIERS and self.rejected_words else one for one in checks)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Checks that failed, in words: the errors may be larger than stated, of poses that can be used as well."""
        return tuple(f"check failed: {one.name} ({one.text})" for one in self.checks if one.status == "failed")

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons why the poses cannot be used; empty where they can."""
        return self.contradictions

    @property
    def contradictions(self) -> tuple[str, ...]:
        """Reasons why the poses cannot be used, none of which more views mend."""
        found = [finding.phrase for finding in self.cautions if finding.severity == "failure"]
        if not found and self.noise_refuted:  # what moved makes them larger, too
            ratio = float(np.sqrt(self.chi_square / self.dof))
            found.append(f"{times_of_noise(ratio)} (chi-square {self.chi_square:.0f} of {self.dof:.0f})")
        for (camera, target), (kept, count) in self._kept.items():
            if is_weak_minority(kept, count):
                found.append(f"{count - kept} of {count} views of {target} by {camera} contradict the others")
        if len(self.rejected) > 0.5 * len(self.weights):
            found.append(f"{len(self.rejected)} of {len(self.weights)} views contradict the others")
        return tuple(found)

    @property
    def noise_refuted(self) -> bool:
        """True if the residuals are larger than the noise explains, by more than chance."""
        ratio = self.chi_square / self.dof if self.dof > 0 else 0.0
        refuted = not self.components and ratio > MIN_REFUTED_RATIO**2 and self.p_value < IMPOSSIBLE.probability
        return refuted or ratio > MAX_CHI_SQUARE_RATIO

    @property
    def advice(self) -> str | None:
        """The next step about the findings, None where there is nothing to do."""
        step = step_after(self.cautions)
        if step is None and len(self.open):
            step = ANOTHER_AXIS
        elif step is None and self.noise_refuted:
            step = "leave the noise out, it is then estimated; look at the files, and what each camera and target is on"
        return None if step is None else step.rstrip(".")

    @property
    def remedy(self) -> str | None:
        """Remedy of what was found, None where nothing has one."""
        return self.advice

    @property
    def is_stated(self) -> bool:
        """True if the accuracy is known: of several poses always."""
        return True

    @property
    def open_words(self) -> tuple[str, ...]:
        """Names of the poses that are not determined in all directions."""
        return tuple(one.name for one in self.every if len(one.open))

    @cached_property
    def facts(self) -> Facts:
        """Facts that the views of the result select from: text, page, notebook, certificate, panel, JSON."""
        residuals = self.chi_square, self.dof, self.p_value
        return facts_of_rig(
            list(self.cameras.values()),
            self.points_ahead,
            {one.frame: one for one in self.every} | {one.name: one for one in self.split},
            self.reference,
            residuals,
            self.noise,
            self.components,
        )


def _rejected(result: RigStatement, check: Check) -> Check:
    views, poses = len(result.rejected), len(result.rejected_poses)
    counts = [f"{views} of {len(result.weights)} views"] if views else []
    counts += [f"{poses} of {len(result.pose_names)} robot poses"] if poses else []
    text = f"{' and '.join(counts)} rejected: {'; '.join(result.rejected_words)}"
    doubted = views > MAX_REJECTED_VIEWS * len(result.weights)
    return Check(check.name, "failed" if doubted else "caution", text, check.findings)


def _without_findings(result: RigStatement, name: str) -> Check:
    """Return the check where nothing was found: passed, or not run and why."""
    if len(result.pose_names) < MIN_POSES_FOR_ROBUST and name in (INPUT, OUTLIERS, RESIDUALS, HALVES, SHARED):
        fit = f"{len(result.pose_names)} poses fit under several readings of the files"
        return Check(name, "not run", fit if name == INPUT else "too few poses")
    if name == INPUT:
        return Check(name, "ok", "rows, units and frames fit together")
    if name == OUTLIERS:
        return Check(name, "ok", f"none of {len(result.weights)} views")
    if name == NOISE:
        if result.components:
            return Check(name, "not run", "estimated from the same residuals")
        p = result.p_value
        if p >= CAUTION_OF_TEN_TESTS:
            return Check(name, "ok", f"the residuals agree with it ({probability(p, 2)})")
        text = f"{times_of_noise(float(np.sqrt(result.chi_square / result.dof)))} ({probability(p, 2)})"
        return Check(name, "failed" if p < CONTRADICTED.probability else "caution", text)
    if name == NEIGHBOURS:
        return Check(name, "not run", "not made for several cameras")
    if name == RESIDUALS:
        return Check(name, "ok", f"chi-square {result.chi_square:.0f} of {result.dof:.0f}")
    if name == HALVES:
        if not result.paths:
            return Check(name, "not run", "no two ways lead to one pose")
        least = min(result.paths, key=lambda path: path.p)
        agree = "agree" if least.p >= UNUSUAL.probability else "differ no more than by chance"
        text = f"{len(result.paths)} pairs of ways to one pose {agree}, least {least.words} ({probability(least.p)})"
        return Check(name, "ok", text)
    if name == MOTION:
        if names := [one.name for one in result.singles if len(one.open)]:
            return Check(name, "caution", f"directions of {', '.join(names)} are not determined")
        return Check(name, "ok", f"all directions of {len(result.singles)} poses are determined")
    if name == MINIMUM:
        return Check(name, "ok" if result.optimality.proven else "not run", result.optimality.words)
    if result.posterior is None or not result.posterior.keys:
        return Check(name, "not run", "none declared or assumed")
    return Check(name, "ok", "the residuals agree with what is assumed")
