"""Sentences of the findings of the diagnostics.

Values are in rad, m and standard deviations of X; those of directions in mm and deg, as their names say.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from ...core.levels import UNUSUAL
from ...core.presentation.numbers import concise, digits, multiple, probability, signed, times_of_noise
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M
from ...findings import HALVES, MOTION, NEIGHBOURS, NOISE, OUTLIERS, RESIDUALS, SHARED, sentence
from ...model.errors.keys import (
    CLOCK_OFFSET,
    FOCAL_LENGTH,
    PRINCIPAL_POINT,
    ROBOT_ACCURACY,
    ROBOT_SCALE,
    TARGET_SCALE,
)

# The values of a finding, by name.
Values: TypeAlias = Mapping[str, Any]
# A direction has the name of an axis within 25 degrees of it.
NEAR_AXIS_COS = math.cos(math.radians(25.0))
# Below this ratio of the largest to the smallest standard deviation no direction is worth a name.
EVEN_RATIO = 1.5
# Share of the rotation about one axis from which on rotations about others are recommended.
ONE_AXIS_SHARE = 0.9


# ------------------------------------------------------------------------------------------- what X is known to


def _flagged_in_short(v: Values) -> str:
    what = {"rejected": "rejected", "downweighted": "down-weighted", "outlier": "kept, but do not fit"}[v["flag"]]
    rows = ", ".join(str(one["row"]) for one in v["worst"][:5])
    more = ", ..." if v["count"] > min(len(v["worst"]), 5) else ""
    return f"{v['count']} of {v['n']} {v['item']}s {what}: {rows}{more}"


def _flagged_effect(v: Values) -> float:
    return 1.1 if v["flag"] != "outlier" else math.sqrt(v["worst"][0]["distance2"] / 6.0)


def _correlated_in_short(v: Values) -> str:
    growth = v["growth"]
    if growth is None or growth < 1.05:
        return f"correlated ({probability(v['p_value'])}), hardly any effect on X"
    return f"correlated; X is about {digits(growth, 2)} times less certain"


def _shape_in_short(v: Values) -> str:
    says = []
    if v["excess_kurtosis"] is not None:
        says.append(f"{'heavier' if v['excess_kurtosis'] > 0 else 'lighter'} tails")
    if v["skewness"] is not None:
        says.append("skewed")
    return f"not Gaussian ({probability(v['p_value'])}): {', '.join(says)}"


# How data are split into two, for people.
SPLITS = {"contiguous": "first and second half", "interleaved": "even and odd rows"}


def _halves_in_short(v: Values) -> str:
    state = "agree" if v["agree"] else "differ"
    return f"{SPLITS.get(v['split'], v['split'])} {state} ({probability(v['p_value'])})"


@sentence("diagnostics.direction")
def _(what: str, largest: float, smallest: float, axis: Sequence[float], frame: str) -> str:
    return f"X's {direction_words(what, largest, smallest, axis, frame)}."


def direction_words(what: str, largest: float, smallest: float, axis: Sequence[float], frame: str) -> str:
    """The least certain direction of "translation" (mm) or "rotation" (deg), from its standard deviations."""
    way, unit = ("along", "mm") if what == "translation" else ("about", "deg")
    least, most = digits(smallest, 2), digits(largest, 2)
    if largest < EVEN_RATIO * smallest:
        sizes = f"about {most}" if least == most else f"{least} to {most}"
        return f"{what} is about equally certain in all directions ({sizes} {unit})"
    ratio = f"{digits(largest / smallest, 2)} times" if smallest > 0 else "infinitely"
    return (
        f"{what} is least certain {way} {along(axis, frame)}: {most} {unit}, {ratio} that {way} its best direction "
        f"({least} {unit})"
    )


# What rotations are multiplied by in the joint spectrum.
LENGTHS = {
    "target": "rms distance from camera to target",
    "motions": "rms length of the camera motions",
    "nothing": "arbitrary, as the camera does not move",
}


@sentence("diagnostics.joint_spectrum")
def _(length_m: float, length_of: str, largest: float, smallest: float) -> str:
    condition = digits(largest / smallest, 2) if smallest > 0 else "infinite"
    return (
        f"Over all six directions of X, with rotations times {length_m:.3g} m ({LENGTHS[length_of]}), standard "
        f"deviations range from {digits(smallest, 2)} to {digits(largest, 2)} mm (condition number {condition})."
    )


@sentence("diagnostics.turning")
def _(share: Sequence[float], axis: Sequence[float], frame: str) -> str:
    shares = ", ".join(f"{round(x, 2):.2g}" for x in share)
    text = f"The robot rotates about three axes, with shares {shares} of the rotation"
    if share[0] > ONE_AXIS_SHARE:
        text += f", nearly all of it about {along(axis, frame)}. Add motions that rotate about other axes"
    return f"{text}."


def along(axis: Sequence[float], frame: str) -> str:
    """The name of an axis of a frame, or its components: ``gripper z``."""
    k, name = max(range(3), key=lambda k: abs(axis[k])), frame if "frame" in frame else f"{frame} frame"
    if abs(axis[k]) > NEAR_AXIS_COS:
        return f"{'xyz'[k]} of the {name}" if name == frame else f"{frame} {'xyz'[k]}"
    return f"({', '.join(f'{x:.2f}' for x in axis)}) of the {name}"


# --------------------------------------------------------------------------------------------------- influence


sentence(
    "diagnostics.information",
    "The information about X is that of {effective:.1f} equally informative {item}s of {n}; {item} {row} contributes "
    "{share:pct~2} % of it.",
)


@sentence(
    "diagnostics.needed_rows",
    check=MOTION,
    phrase="without {item} {rows[0]} the data do not determine X",
    effect=2,
    remedy="add poses that rotate about another axis: uq-handeye plan chooses them",
    rows=("rows",),
)
def _(item: str, rows: Sequence[int]) -> str:
    shown = ", ".join(str(k) for k in rows[:5])
    which = f"any one of the {item}s {shown}{', ...' if len(rows) > 5 else ''}" if len(rows) > 1 else f"{item} {shown}"
    return f"Without {which} the data do not determine X."


_MOVES = (
    "Without {item} {row} X would move by {shift_sd:~2} standard deviations ({rotation:deg~2} deg, "
    "{translation:mm~2} mm), "
)
sentence(
    "diagnostics.wrong_row",
    _MOVES + "more than its noise explains ({p_value:p}).",
    check=RESIDUALS,
    phrase="without {item} {row} X moves by {shift_sd:~2} standard deviations",
    effect=lambda v: float(v["shift_sd"]),
)
sentence("diagnostics.strong_row", _MOVES + "as its noise and weight allow.")


# ----------------------------------------------------------------------------------------- tests of the residuals


@sentence(
    "diagnostics.not_tested",
    phrase=lambda v: {
        "too few": "too few poses",
        "exact": "the residuals are zero",
        "unknowns": "too few poses for the unknowns",
        "coefficients": "too few poses",
        "estimated": "estimated from the same residuals",
    }.get(v["why"], "the noise is joint over the poses"),
)
def _(test: str, item: str, why: str, rows: int, needed: int) -> str:
    reason = {
        "too few": f"{rows} rows are too few, {needed} are needed",
        "exact": "the residuals are zero next to the noise",
        "unknowns": f"{rows} rows are too few for the unknowns of the fit, which include those of the arm and others",
        "coefficients": f"{rows} rows are too few for its coefficients",
        "estimated": "the correlation in the noise was estimated from these same residuals",
        # of files written before these tests knew joint covariances
        "no order": "rows of a joint covariance have no order once they are whitened",
        "no rows": "rows of a joint covariance belong to no single pose once they are whitened",
    }[why]
    what = {
        "autocorrelation": "the autocorrelation of the residuals",
        "normality": "the normality of the residuals",
        "pattern": f"a linear pattern of the residuals over the {item}s",
    }[test]
    return f"The test of {what} was not run, because {reason}."


@sentence(
    "diagnostics.correlated",
    check=NEIGHBOURS,
    phrase=_correlated_in_short,
    effect=lambda v: max(float(v["growth"] or 1.0), 1.0),
    rejects=True,
    remedy=lambda v: "add timestamps to the poses: drift is then estimated" if v.get("untimed") else "",
)
def _(item: str, n: int, lag_1: float, p_value: float, growth: float, untimed: bool = False) -> str:
    start = f"Neighbouring residuals are correlated (lag 1: {lag_1:.2f}, {probability(p_value)})"
    if growth < 1.05:
        return f"{start}. This hardly changes the standard deviations of X."
    drift = "Add timestamps to the poses, so that a drift is estimated with the noise, or thin" if untimed else "Thin"
    return (
        f"{start}. The standard deviations of X are about {growth:.2g} times too small: {n} {item}s count as "
        f"{n / growth**2:.0f} independent ones. {drift} the {item}s."
    )


sentence(
    "diagnostics.uncorrelated",
    "Neighbouring residuals show no significant correlation (lag 1: {lag_1:.2f} +- {standard_error:.2f}).",
    check=NEIGHBOURS,
    phrase="residuals of neighbouring poses uncorrelated",
)


@sentence(
    "diagnostics.not_gaussian",
    check=RESIDUALS,
    phrase=_shape_in_short,
    effect=1.1,
)
def _(p_value: float, excess_kurtosis: float | None, skewness: float | None) -> str:
    says = []
    if excess_kurtosis is not None:
        kind = "heavier" if excess_kurtosis > 0 else "lighter"
        says.append(f"{kind} tails than Gaussian (excess kurtosis {excess_kurtosis:.2g})")
    if skewness is not None:
        says.append(f"skewed (skewness up to {skewness:.2g})")
    return (
        f"The residuals are not Gaussian ({probability(p_value)}): {', '.join(says)}. Outliers, or noise that differs "
        "from pose to pose, can be the cause."
    )


sentence("diagnostics.gaussian", "The residuals are consistent with a Gaussian distribution (p = {p_value:.2g}).")


@sentence(
    "diagnostics.pattern",
    check=RESIDUALS,
    phrase="follow the {item}s ({r_squared:pct~2} % explained)",
    effect=lambda v: 1.0 / math.sqrt(max(1.0 - v["r_squared"], 0.01)),
    rejects=True,
    remedy="look at the residuals by pose in the report: --report report.html",
)
def _(item: str, r_squared: float, chance: float, p_value: float, correlated: bool) -> str:
    by_chance = f"{100 * chance:.0f}" if chance >= 0.01 else "below 1"
    also = " Correlated errors of neighbouring rows can be the cause, too." if correlated else ""
    return (
        f"The residuals follow the {item}s: a linear function of the camera's translation and rotation explains "
        f"{100 * r_squared:.0f} % of them ({by_chance} % by chance, {probability(p_value)}). Noise does not do this. "
        f"Check the intrinsics, the robot's kinematics and the target.{also}"
    )


sentence("diagnostics.no_pattern", "The residuals show no linear pattern over the {item}s.")


# -------------------------------------------------------------------------------------- errors that all rows share

# Options that declare an error, and a value that takes a measurement: better than what is assumed.
DECLARE = {
    FOCAL_LENGTH: ("--shared 'focal length={}'", "0.03%"),
    PRINCIPAL_POINT: ("--shared 'principal point={}'", "0.0003"),
    TARGET_SCALE: ("--shared 'target scale={}'", "0.01%"),
    ROBOT_SCALE: ("--shared 'robot scale={}'", "0.005%"),
    ROBOT_ACCURACY: ("--robot-accuracy {}", "0.2mm,0.02deg"),
    CLOCK_OFFSET: ("--shared 'clock offset={}'", "0.1ms"),
}


_OPTIONS = {str(key): option for key, option in DECLARE.items()}


def _declare(values: Values) -> str:
    name, found = values["errors"][0]["name"], abs(float(values["errors"][0]["estimate"]))
    sd = f"{digits(100 * found, 1)}%"
    option = _OPTIONS[name][0].format(sd) if name in _OPTIONS else f"--shared '{name}={sd}'"
    return f"measure the {name}, or declare an uncertainty that holds what was found: {option}"


@sentence(
    "diagnostics.undeclared",
    check=SHARED,
    phrase="the residuals indicate a {errors[0][name]} error of {errors[0][estimate]:pct~2} %",
    effect=2,
    rejects=True,
    remedy=_declare,
)
def _(errors: Sequence[Values]) -> str:
    asked = [f"{error['name']} {relative(error['estimate'], error['sd'])}" for error in errors]
    one = len(asked) == 1
    return (
        f"The residuals indicate {'a shared error that was' if one else 'shared errors that were'} not declared: "
        f"{' or '.join(asked)}. Measure {'it' if one else 'them'}, or declare {'it' if one else 'them'} "
        "(shared=[...], --shared)."
    )


def relative(estimate: float, sd: float) -> str:
    """A relative error with its standard deviation, in percent: ``-4.3(2) %``."""
    return signed(concise(100 * estimate, 100 * sd, "%"))


# --------------------------------------------------------------------------------------------------- split halves


@sentence("diagnostics.halves_too_small", phrase="too few poses")
def _(split: str, item: str, rows: int, needed: int) -> str:
    return f"{_not_run(split)} a half has {rows} {item}s, {needed} are needed."


@sentence("diagnostics.halves_without_freedom", phrase="too few degrees of freedom")
def _(split: str, dof: float) -> str:
    return f"{_not_run(split)} the noise was estimated with {dof:.2g} degrees of freedom only."


@sentence("diagnostics.half_fails", phrase="a half does not determine X")
def _(split: str, error: str) -> str:
    return f"{_not_run(split)} the fit of one half fails. {error}"


def _not_run(split: str) -> str:
    return f"The split-half test ({SPLITS.get(split, split)}) was not run, because"


@sentence(
    "diagnostics.halves",
    check=HALVES,
    phrase=_halves_in_short,
    effect=lambda v: math.sqrt(v["d2"] / 6.0),
    rejects=True,
    remedy="look at the residuals by pose in the report: --report report.html",
)
def _(
    split: str, sizes: Sequence[int], rotation: float, translation: float, d2: float, p_value: float, agree: bool
) -> str:
    verdict, advice = "agree" if agree else "do not agree", ""
    if not agree:
        advice = " The covariance is too small, or the halves have different systematic errors."
    elif p_value < UNUSUAL.probability:  # of several tests one is below 5 % by chance
        advice = " That is unusual, and no contradiction."
    return (
        f"The two halves of the data ({SPLITS.get(split, split)}: {sizes[0]} and {sizes[1]}) {verdict} within their "
        f"covariances: X differs by {DEG_PER_RAD * rotation:.2g} deg and {MM_PER_M * translation:.2g} mm "
        f"(d^2 = {d2:.1f}, expected 6; p = {p_value:.2g}).{advice}"
    )


@sentence("diagnostics.many_halves")
def _(split: str, passed: int, tests: int) -> str:
    return f"{passed} of {tests} split-half tests ({SPLITS.get(split, split)}) passed."


# ---------------------------------------------------------------------------------------------------- pose table


@sentence(
    "diagnostics.flagged",
    explained=True,
    check=OUTLIERS,
    phrase=_flagged_in_short,
    effect=_flagged_effect,
    remedy="look at the flagged poses in the report: --report report.html",
)
def _(item: str, flag: str, n: int, count: int, limit: float, worst: Sequence[Values]) -> str:
    one = count == 1
    what = {
        "rejected": f"{'was' if one else 'were'} rejected as {'an outlier' if one else 'outliers'}",
        "downweighted": f"{'was' if one else 'were'} down-weighted as {'an outlier' if one else 'outliers'}",
        "outlier": f"{'is an outlier and biases' if one else 'are outliers and bias'} X (robust=True, --robust leaves "
        f"{'it' if one else 'them'} out)",
    }[flag]
    named = ", ".join(
        f"{item} {row['row']} ({digits(DEG_PER_RAD * row['rotation'], 2)} degrees, "
        f"{digits(MM_PER_M * row['translation'])} mm, d^2 = {digits(row['distance2'])})"
        for row in worst
    )
    more = f" and {count - len(worst)} more" if count > len(worst) else ""
    return (
        f"{count} of {n} {item}s {what}: {named}{more}, counted from 0. A good {item} stays below d^2 = {limit:.3g} in "
        "999 of 1000 cases. Look for a wrong detection or a row that belongs to another moment."
    )


@sentence(
    "diagnostics.noise_too_small",
    check=NOISE,
    phrase=lambda v: times_of_noise(v["scale"]),
    effect=lambda v: float(v["scale"]),
    rejects=True,
    remedy=lambda v: (
        "look at the residuals by pose in the report: --report report.html"
        if v.get("estimated")
        else "leave the noise out, it is then estimated; or correct it"
    ),
)
def _(scale: float, estimated: bool = False, p_value: float | None = None) -> str:
    what = "The noise estimated does not explain the poses" if estimated else "The noise given is too small"
    return (
        f"{what}: most residuals are {multiple(scale)} times as large as it explains. Outliers "
        f"were judged by {multiple(scale)} times the noise. The standard deviations of X are too small by about this "
        "factor."
    )
