"""Diagnostics in words: sentences for people, each with whether it deserves a warning."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..formatting.numbers import digits, probability
from ..geometry.se3 import Array
from .residual_patterns import RARE, RARE_PATTERN
from .scale_errors import FOCAL, ROBOT, SCALE, SCORE, TARGET

if TYPE_CHECKING:
    from .diagnose import Diagnostics, Influence, Spectrum

_MM, _DEG = 1e3, 180.0 / np.pi
# An axis within 25 degrees of a direction gives it its name.
_NEAR = float(np.cos(np.radians(25.0)))
# Below this ratio of the largest to the smallest deviation no direction is worth a name.
_EVEN = 1.5
# Poses that move X by more, in standard deviations, are named.
_STRONG = 1.5
SYSTEMATIC = (
    "Systematic errors (wrong camera intrinsics, wrong robot kinematics, a wrong target) are not covered by the "
    "covariance."
)


def findings(d: Diagnostics) -> list[tuple[bool, str]]:
    """Everything that `Diagnostics` says."""
    axis, share = d.diversity.axes[0], d.diversity.share
    text = f"The robot turns about three axes: shares {', '.join(f'{x:.2g}' for x in share.round(2))} of the turning"
    if share[0] > 0.9:
        text += f", nearly all of it about {along(axis, d.frame)}: add motions that turn about other axes"
    turning = [(False, f"{text}.")]
    return (
        spectrum_words(d.spectrum)
        + influence_words(d.influence, d.n, d.item)
        + turning
        + residual_words(d)
        + systematic_words(d)
    )


def shared_errors(d: Diagnostics) -> list[str]:
    """What noise that was estimated from one camera's poses cannot contain; nothing where it would hardly matter."""
    focal = d.probes[0]
    if not d.independent_camera or focal.reason or focal.shift_sd < 1:
        return []
    move = np.linalg.norm(focal.shift[3:]) * _MM
    return [
        "The standard deviations are a lower limit. Noise that is estimated from the poses does not contain what all "
        "of them share: the error of the camera's intrinsics, of the robot's kinematics. 0.1 % of focal length would "
        f"move X by {digits(move, 2)} mm, {digits(focal.shift_sd, 2)} of its standard deviations. The joint covariance "
        "of the camera poses would cover it."
    ]


def along(axis: Array, frame: str) -> str:
    k, name = int(np.abs(axis).argmax()), frame if "frame" in frame else f"{frame} frame"
    if abs(axis[k]) > _NEAR:
        return f"{'xyz'[k]} of the {name}" if name == frame else f"{frame} {'xyz'[k]}"
    return f"({', '.join(f'{x:.2f}' for x in axis)}) of the {name}"


def spectrum_words(s: Spectrum) -> list[tuple[bool, str]]:
    directions = (
        direction_words("translation", s.sd_translation_mm, s.axes_translation[0], s.frame),
        direction_words("rotation", s.sd_rotation_deg, s.axes_rotation[0], s.frame),
    )
    return [*((False, f"X's {text}.") for text in directions), (False, joint_words(s))]


def direction_words(name: str, sd: Array, axis: Array, frame: str) -> str:
    """The least certain direction of "translation" (mm) or "rotation" (deg), from deviations (3,), largest first."""
    way, unit = ("along", "mm") if name == "translation" else ("about", "deg")
    least, most = digits(sd[-1], 2), digits(sd[0], 2)
    if sd[0] < _EVEN * sd[-1]:
        sizes = f"about {most}" if least == most else f"{least} to {most}"
        return f"{name} is about equally certain in all directions ({sizes} {unit})"
    ratio = f"{digits(sd[0] / sd[-1], 2)} times" if sd[-1] > 0 else "infinitely"
    return (
        f"{name} {way} {along(axis, frame)} is {ratio} less certain than {way} its best direction ({most} against "
        f"{least} {unit})"
    )


def joint_words(s: Spectrum) -> str:
    """Rotation and translation at one scale."""
    return (
        f"Over all six directions of X, with rotations times {s.length_m:.3g} m ({s.length_of}), standard deviations "
        f"run from {digits(s.sd_joint_mm[-1], 2)} to {digits(s.sd_joint_mm[0], 2)} mm: condition "
        f"{digits(s.condition, 2)}."
    )


def influence_words(s: Influence, n: int, item: str) -> list[tuple[bool, str]]:
    found: list[tuple[bool, str]] = [
        (False, f"The information about X is spread like that of {s.effective_number:.1f} equal {item}s of {n}; "
         f"{item} {int(s.share.argmax())} brings {digits(100 * s.share.max(), 2)} % of it.")
    ]  # fmt: skip
    needed = np.flatnonzero(np.isinf(s.shift_sd))
    if needed.size:
        found.append((True, f"Without {_list(needed, item)} the data do not determine X."))
    strong = np.flatnonzero(np.isfinite(s.shift_sd) & (s.shift_sd > _STRONG))
    strong = strong[np.argsort(-s.shift_sd[strong])][:3]
    for k in strong:
        turn, move = np.linalg.norm(s.shift[k, :3]) * _DEG, np.linalg.norm(s.shift[k, 3:]) * _MM
        wrong = bool(s.p_value[k] < RARE / n)
        verdict = (
            f"more than its noise explains ({probability(s.p_value[k])})" if wrong else "as its noise and weight allow"
        )
        found.append(
            (wrong, f"Without {item} {k} X moves by {digits(s.shift_sd[k], 2)} of its standard deviations "
             f"({digits(turn, 2)} deg, {digits(move, 2)} mm), {verdict}.")
        )  # fmt: skip
    return found


def _list(rows: NDArray[np.intp], item: str) -> str:
    shown = ", ".join(str(k) for k in rows[:5])
    return f"any one of the {item}s {shown}{', ...' if len(rows) > 5 else ''}" if len(rows) > 1 else f"{item} {shown}"


def residual_words(d: Diagnostics) -> list[tuple[bool, str]]:
    a, m, g = d.autocorrelation, d.normality, d.regression
    found = []
    correlated = not a.reason and a.p_value < RARE
    if a.reason:
        found.append((False, f"Autocorrelation of the residuals was not tested: {a.reason}."))
    elif correlated:
        start = f"Neighbouring residuals are correlated (lag 1: {a.correlation[0]:.2f}, {probability(a.p_value)})"
        if a.growth < 1.05:
            found.append((True, f"{start}; that hardly changes the standard deviations of X."))
        else:
            found.append(
                (True, f"{start}: for X {d.n} {d.item}s count as {d.n / a.growth**2:.0f} independent ones, and its "
                 f"standard deviations are about {a.growth:.2g} times too small. covariance='hac' shows a part of it; "
                 f"thin the {d.item}s for the rest.")
            )  # fmt: skip
    else:
        lag_1 = f"lag 1: {a.correlation[0]:.2f} +- {a.standard_error[0]:.2f}"
        found.append((False, f"Neighbouring residuals show no significant correlation ({lag_1})."))
    if m.reason:
        found.append((False, f"Normality of the residuals was not tested: {m.reason}."))
    elif m.p_value < RARE:
        says = []
        if m.p_kurtosis < max(m.p_skewness, RARE):
            says.append("heavier" if m.excess_kurtosis > 0 else "lighter")
            says[-1] += f" tails than Gaussian (excess kurtosis {m.excess_kurtosis:.2g})"
        if m.p_skewness < max(m.p_kurtosis, RARE):
            says.append(f"skewed (skewness up to {np.abs(m.skewness).max():.2g})")
        found.append((True, f"The residuals are not Gaussian ({probability(m.p_value)}): {', '.join(says)}. Outliers "
                            "or noise that differs from pose to pose can be the cause."))  # fmt: skip
    else:
        found.append((False, f"The residuals do not differ significantly from Gaussian ones (p = {m.p_value:.2g})."))
    if g.reason:
        found.append((False, f"The residuals were not regressed on the {d.item}s: {g.reason}."))
    elif g.p_value < RARE_PATTERN:
        by_chance = f"{100 * g.chance:.0f}" if g.chance >= 0.01 else "below 1"
        cause = " or by the correlation of neighbours" if correlated else ""
        found.append((True, f"The residuals follow the {d.item}s: a linear function of the camera's translation and "
                            f"rotation explains {100 * g.r_squared:.0f} % of them ({by_chance} % by chance, "
                            f"{probability(g.p_value)}). Noise does not do that: intrinsics, robot kinematics or the "
                            f"target are wrong{', or it is made' + cause[3:] if cause else ''}."))  # fmt: skip
    else:
        found.append((False, f"The residuals show no linear pattern over the {d.item}s."))
    return found


def independent_words(d: Diagnostics) -> str:
    """What the camera noise leaves out where it is taken as independent."""
    return (
        f"The camera noise is taken as independent from {d.item} to {d.item}, but all poses of one camera share the "
        "error of its intrinsics: a focal length error moves all of them along the optical axis. It averages out "
        "nowhere and hides from the residuals, so the covariance is too optimistic, typically by factors of several. "
        "Use the joint covariance of the camera poses."
    )


def systematic_words(d: Diagnostics) -> list[tuple[bool, str]]:
    found, focal = [(False, SYSTEMATIC)], d.probes[0]
    if d.independent_camera:
        found.append((False, independent_words(d)))
    for probe in d.probes:
        if probe.name == FOCAL and d.focal_covered:
            found.append((False, "What an error of the focal length does to X is in its covariance."))
            continue
        if probe.reason:
            found.append((False, f"The effect of the {probe.name} is not known: {probe.reason}."))
            continue
        move = np.linalg.norm(probe.shift[3:]) * _MM
        turn = np.linalg.norm(probe.shift[:3]) * _DEG
        text = (
            f"An error of 0.1 % in the {probe.name} moves X by {digits(move, 2)} mm and {digits(turn, 2)} deg, "
            f"{digits(probe.shift_sd, 2)} of its standard deviations"
        )
        if probe.shift_sd > 1e-6:
            text += f"; an error of {digits(100 * SCALE / probe.shift_sd, 2)} % moves it by one"
        found.append((False, text + "."))
    if d.independent_camera and focal.visible:
        span = focal.sd / SCALE
        found.append(
            (False, f"The residuals tell the focal length only to +- {digits(100 * focal.sd, 2)} %. Over "
             f"that range X moves by {digits(span * float(np.linalg.norm(focal.shift[3:])) * _MM, 2)} mm, "
             f"{digits(span * focal.shift_sd, 2)} of its standard deviations, which do not include it.")
        )  # fmt: skip
    for probe in d.probes:
        if probe.visible and abs(probe.z) > SCORE:
            # Lengths that came out too long by s: focal length, target or robot steps are really shorter by s.
            way = "shorter" if probe.estimate > 0 else "longer"
            what = {FOCAL: "a focal length", TARGET: "a target", ROBOT: "robot motions"}[probe.name]
            found.append((True, f"The residuals ask for {what} {digits(100 * abs(probe.estimate), 2)} % {way} "
                                f"(+- {digits(100 * probe.sd, 2)} %, z = {probe.z:.1f})."))  # fmt: skip
    if all(abs(probe.z) > SCORE for probe in d.probes if probe.name in (TARGET, ROBOT)):
        found.append((False, "Target size and robot scale act on the residuals alike: which of the two is wrong "
                             "the data cannot tell."))  # fmt: skip
    return found
