"""Diagnostics in words: sentences for people, each with whether it deserves a warning."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..residual_patterns import RARE, RARE_PATTERN
from ..scale_errors import FOCAL, ROBOT, SCALE, SCORE, TARGET
from ..se3 import Array

if TYPE_CHECKING:
    from ..diagnostics import Diagnostics, Influence, Spectrum

_MM, _DEG = 1e3, 180.0 / np.pi
# An axis within 25 degrees of a direction gives it its name.
_NEAR = float(np.cos(np.radians(25.0)))


def findings(d: Diagnostics) -> list[tuple[bool, str]]:
    """Everything that `Diagnostics` says."""
    found = spectrum_words(d.spectrum) + influence_words(d.influence, d.n, d.item)
    axis, most = d.diversity.axes[0], float(d.diversity.share[0])
    if most > 0.9:
        where = along(axis, d.frame)
        found.append(
            (False, f"{100 * most:.0f} % of the turning of the robot is about one axis, {where}: add motions that turn "
             "about other axes.")
        )  # fmt: skip
    return found + residual_words(d) + systematic_words(d)


def shared_errors(d: Diagnostics) -> list[str]:
    """What noise that was estimated from one camera's poses cannot contain; nothing where it would hardly matter."""
    focal = d.probes[0]
    if not d.independent_camera or focal.reason or focal.shift_sd < 1:
        return []
    move = np.linalg.norm(focal.shift[3:]) * _MM
    return [
        "The standard deviations are a lower limit. Noise that is estimated from the poses does not contain what all "
        "of them share: the error of the camera's intrinsics, of the robot's kinematics. 0.1 % of focal length would "
        f"move X by {move:.2g} mm, {focal.shift_sd:.2g} of its standard deviations. The joint covariance of the camera "
        "poses would cover it."
    ]


def along(axis: Array, frame: str) -> str:
    k = int(np.abs(axis).argmax())
    if abs(axis[k]) > _NEAR:
        return f"{frame} {'xyz'[k]}"
    return f"({', '.join(f'{x:.2f}' for x in axis)}) of the {frame} frame"


def spectrum_words(s: Spectrum) -> list[tuple[bool, str]]:
    found = []
    for name, sd, axes, unit in (
        ("translation", s.sd_translation_mm, s.axes_translation, "mm"),
        ("rotation", s.sd_rotation_deg, s.axes_rotation, "deg"),
    ):
        ratio, where = sd[0] / max(sd[-1], 1e-300), along(axes[0], s.frame)
        way = "along" if name == "translation" else "about"
        found.append(
            (False, f"X's {name} {way} {where} is {ratio:.2g} times less certain than {way} its best "
             f"direction ({sd[0]:.2g} against {sd[-1]:.2g} {unit}).")
        )  # fmt: skip
    found.append(
        (False, f"Over all six directions of X, with rotations times {s.length_m:.3g} m "
         f"({s.length_of}), standard deviations run from {s.sd_joint_mm[-1]:.2g} to {s.sd_joint_mm[0]:.2g} mm: "
         f"condition {s.condition:.2g}.")
    )  # fmt: skip
    return found


def influence_words(s: Influence, n: int, item: str) -> list[tuple[bool, str]]:
    found: list[tuple[bool, str]] = [
        (False, f"The information about X is spread like that of {s.effective_number:.1f} equal {item}s of {n}; "
         f"{item} {int(s.share.argmax())} brings {100 * s.share.max():.2g} % of it.")
    ]  # fmt: skip
    needed = np.flatnonzero(np.isinf(s.shift_sd))
    if needed.size:
        found.append((True, f"Without {_list(needed, item)} the data do not determine X."))
    strong = np.flatnonzero(np.isfinite(s.shift_sd) & (s.shift_sd > 1))
    strong = strong[np.argsort(-s.shift_sd[strong])][:3]
    for k in strong:
        turn, move = np.linalg.norm(s.shift[k, :3]) * _DEG, np.linalg.norm(s.shift[k, 3:]) * _MM
        wrong = bool(s.p_value[k] < RARE / n)
        verdict = f"more than its noise explains (p = {s.p_value[k]:.1g})" if wrong else "as its noise and weight allow"
        found.append(
            (wrong, f"Without {item} {k} X moves by {s.shift_sd[k]:.1f} of its standard deviations ({turn:.2g} deg, "
             f"{move:.2g} mm), {verdict}.")
        )  # fmt: skip
    return found


def _list(rows: NDArray[np.intp], item: str) -> str:
    shown = ", ".join(str(k) for k in rows[:5])
    return f"any of the {item}s {shown}{', ...' if len(rows) > 5 else ''}" if len(rows) > 1 else f"{item} {shown}"


def residual_words(d: Diagnostics) -> list[tuple[bool, str]]:
    a, m, g = d.autocorrelation, d.normality, d.regression
    found = []
    correlated = not a.reason and a.p_value < RARE
    if a.reason:
        found.append((False, f"Autocorrelation of the residuals was not tested: {a.reason}."))
    elif correlated:
        found.append(
            (True, f"Neighbouring residuals are correlated (lag 1: {a.correlation[0]:.2f}, p = {a.p_value:.1g}): {d.n} "
             f"{d.item}s count as {a.effective_number:.0f} independent ones, and the standard deviations of X are "
             f"about {max(a.growth, 1.0):.2g} times too small. The covariance 'hac' makes up for a part of that; for "
             f"all of it, leave out {d.item}s in between.")
        )  # fmt: skip
    else:
        found.append((False, f"Neighbouring residuals show no correlation (lag 1: {a.correlation[0]:.2f} +- "
                             f"{a.standard_error[0]:.2f})."))  # fmt: skip
    if m.reason:
        found.append((False, f"Normality of the residuals was not tested: {m.reason}."))
    elif m.p_value < RARE:
        says = []
        if m.p_kurtosis < max(m.p_skewness, RARE):
            says.append("heavier" if m.excess_kurtosis > 0 else "lighter")
            says[-1] += f" tails than Gaussian (excess kurtosis {m.excess_kurtosis:.2g})"
        if m.p_skewness < max(m.p_kurtosis, RARE):
            says.append(f"skewed (skewness up to {np.abs(m.skewness).max():.2g})")
        found.append((True, f"The residuals are not Gaussian (p = {m.p_value:.1g}): {', '.join(says)}. Outliers or "
                            "noise that differs from pose to pose can be the cause."))  # fmt: skip
    else:
        found.append((False, f"The residuals look Gaussian (p = {m.p_value:.2f})."))
    if g.reason:
        found.append((False, f"The residuals were not regressed on the {d.item}s: {g.reason}."))
    elif g.p_value < RARE_PATTERN:
        cause = " or by the correlation of neighbours" if correlated else ""
        found.append((True, f"The residuals follow the {d.item}s: a linear function of the camera's translation and "
                            f"rotation explains {100 * g.r_squared:.0f} % of them ({100 * g.chance:.0f} % by chance, "
                            f"p = {g.p_value:.1g}). Noise does not do that: intrinsics, robot kinematics or the "
                            f"target are wrong{', or it is made' + cause[3:] if cause else ''}."))  # fmt: skip
    else:
        found.append((False, f"The residuals show no linear pattern over the {d.item}s."))
    return found


def systematic_words(d: Diagnostics) -> list[tuple[bool, str]]:
    found = [(False, "Systematic errors (wrong camera intrinsics, wrong robot kinematics, a wrong target) are not "
                     "covered by the covariance.")]  # fmt: skip
    focal = d.probes[0]
    if d.independent_camera:
        found.append(
            (False, f"The camera noise is taken as independent from {d.item} to "
             f"{d.item}, but all poses of one camera share the error of its intrinsics: a focal length error moves "
             "all of them along the optical axis. It averages out nowhere and hides from the residuals, so the "
             "covariance is too optimistic, typically by factors of several. Use the joint covariance of the "
             "camera poses.")
        )  # fmt: skip
    for probe in d.probes:
        if probe.reason:
            found.append((False, f"The effect of the {probe.name} is not known: {probe.reason}."))
            continue
        move = np.linalg.norm(probe.shift[3:]) * _MM
        turn = np.linalg.norm(probe.shift[:3]) * _DEG
        text = (
            f"An error of 0.1 % in the {probe.name} moves X by {move:.2g} mm and {turn:.2g} deg, "
            f"{probe.shift_sd:.2g} of its standard deviations"
        )
        if probe.shift_sd > 1e-6:
            text += f"; an error of {100 * SCALE / probe.shift_sd:.2g} % moves it by one"
        found.append((False, text + "."))
    if d.independent_camera and focal.visible:
        span = focal.sd / SCALE
        found.append(
            (False, f"The residuals tell the focal length only to +- {100 * focal.sd:.2g} %. Over "
             f"that range X moves by {span * np.linalg.norm(focal.shift[3:]) * _MM:.2g} mm, "
             f"{span * focal.shift_sd:.2g} of its standard deviations, which do not include it.")
        )  # fmt: skip
    for probe in d.probes:
        if probe.visible and abs(probe.z) > SCORE:
            # Lengths that came out too long by s: focal length, target or robot steps are really shorter by s.
            way = "shorter" if probe.estimate > 0 else "longer"
            what = {FOCAL: "a focal length", TARGET: "a target", ROBOT: "robot motions"}[probe.name]
            found.append((True, f"The residuals ask for {what} {100 * abs(probe.estimate):.2g} % {way} "
                                f"(+- {100 * probe.sd:.1g} %, z = {probe.z:.1f})."))  # fmt: skip
    if all(abs(probe.z) > SCORE for probe in d.probes if probe.name in (TARGET, ROBOT)):
        found.append((False, "Target size and robot scale act on the residuals alike: which of the two is wrong "
                             "the data cannot tell."))  # fmt: skip
    return found
