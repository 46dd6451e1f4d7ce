"""Sentences of the findings of `calibrate` other than those of the checks that it calls. Values are in rad and m."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..core.presentation.numbers import concise, digits, multiple, probability, signed, times_of_noise
from ..findings import CAMERA, MOTION, NOISE, OUTLIERS, RESIDUALS, SHARED, Values, sentence
from ..fit.diagnostics.sentences import along
from ..model.poses.pose_numbers import ranges
from .estimated import open_words

# Open directions of a robot that only translates turn X by less than this (rad per m).
MAX_TURN_OF_A_GANTRY = 0.05


def _of_two(v: Values) -> float:
    return float(max(v["rotation"], v["translation"], key=lambda x: abs(math.log(x)) if x > 0 else 0.0))


def _open_in_short(v: Values) -> str:
    k = len(v["directions"])
    return f"{k} direction{'s' if k > 1 else ''} of X and W not determined"


def _size_in_short(v: Values) -> str:
    share = 100 * abs(1 / (1 + v["estimate"]) - 1)
    what = f"target {v.get('target', '')}".rstrip()
    return f"{what} {digits(share, 2)} % {'larger' if v['estimate'] < 0 else 'smaller'} than given"


@sentence(
    "calibration.data_sheet_contradicted",
    check=NOISE,
    phrase=lambda v: times_of_noise(_of_two(v)),
    effect=lambda v: max(_of_two(v), 1.05),
    rejects=True,
    remedy="leave the noise out, it is then estimated; or correct it",
)
def _(rotation: float, translation: float, p_value: float) -> str:
    return (
        f"The residuals contradict the noise of the data sheet (chi-square test, p = {p_value:.1g}): those in rotation "
        f"are {_times(rotation)}, those in translation {_times(translation)} than it explains. The standard deviations "
        "of X are wrong by up to this factor. Correct `prior` (--robot-prior, --camera-prior), or leave it out."
    )


def _times(ratio: float) -> str:
    return f"{multiple(ratio)} times larger" if ratio > 1 else f"{multiple(1 / ratio)} times smaller"


@sentence(
    "calibration.shared_contradicted",
    check=SHARED,
    phrase="{name} contradicts what was assumed of it",
    effect=lambda v: abs(v["estimate"]) / v["assumed"],
    rejects=True,
    remedy="correct the {name}, or declare it wider",
)
def _(name: str, unit: str, estimate: float, sd: float, assumed: float, p_value: float) -> str:
    return (
        f"The residuals contradict the assumed {name}: they indicate {signed(concise(estimate, sd, unit))}, but the "
        f"assumed standard deviation is {f'{digits(assumed, 2)} {unit}'.rstrip()} ({probability(p_value)}). Correct "
        "the value, or declare a larger standard deviation."
    )


@sentence(
    "calibration.group_contradicted",
    check=SHARED,
    phrase="{name} contradict what was assumed",
    effect=lambda v: float(v["times"]),
    rejects=True,
    remedy="correct what is declared of the {name}",
)
def _(name: str, count: int, times: float, p_value: float) -> str:
    how = f"about {multiple(times)} times as large as" if times >= 0.2 else "less than a fifth of what was"
    declare = "larger" if times > 1 else "smaller"
    numbers = "it is" if count == 1 else f"its {count} numbers are"
    return (
        f"The residuals contradict the assumed {name}: {numbers} {how} assumed "
        f"({probability(p_value)}). Declare a {declare} standard deviation."
    )


@sentence(
    "calibration.target_size",
    check=SHARED,
    phrase=_size_in_short,
    effect=1.15,
    remedy="measure the target and give its true size",
)
def _(estimate: float, sd: float, square: float | None, probability: float = 1.0, target: str = "") -> str:
    sure = f" (probability {digits(100 * min(probability, 0.9999), 4)} %)"
    # Used / true - 1 = e, so that the true size is that used, over 1 + e.
    true, deviation = 1 / (1 + estimate), sd / (1 + estimate) ** 2
    if square is not None:
        found = concise(1e3 * square * true, 1e3 * square * deviation, "mm")
        return f"The squares measure {found}, not {digits(1e3 * square, 4)}{sure}. Measure them, and give their size."
    way = "smaller" if true < 1 else "larger"
    size = abs(true - 1)
    found = concise(100 * size, 100 * deviation, "%")
    printed = " A printer that scales to fit the page does that; a wrong focal length looks like it." * (size > 0.015)
    what = f"The target {target}".rstrip()
    return f"{what} is {found} {way} than assumed{sure}.{printed} Measure it, and give its size."


@sentence(
    "calibration.closed_form_fits",
    check=RESIDUALS,
    phrase="X by {method} fits better",
    effect=lambda v: math.sqrt(v["d2"] / 6),
    remedy="compare the methods: uq-handeye compare",
)
def _(method: str, rotation: float, translation: float, d2: float, count: int) -> str:
    others = f" ({count} closed forms fit better)" if count > 1 else ""
    return (
        f"X by method {method!r} fits the poses better than this X{others}: its residuals are {digits(rotation, 2)} "
        f"times as large in rotation and {digits(translation, 2)} times in translation, and it lies outside the stated "
        f"uncertainty (d^2 = {digits(d2, 3)}). Compare the methods before X is used."
    )


def _directions(directions: Sequence[Values]) -> str:
    """``the rotation of X about the camera's y and x axes``."""
    ways: dict[str, list[str]] = {}  # axes by what X does
    for of in directions:
        turns = of["what"] == "rotation"
        ways.setdefault("the rotation of X about" if turns else "the translation of X along", []).append(
            along(of["axis"], "camera")
        )
    found = []
    for way, axes in ways.items():
        named = all(axis.startswith("camera ") for axis in axes)
        letters = " and ".join(axis[-1] for axis in axes)
        named_axes = f"the camera's {letters} {'axis' if len(axes) == 1 else 'axes'}"
        found.append(f"{way} {named_axes if named else ' and '.join(axes)}")
    return " and ".join(found)


@sentence("calibration.shared_confounded")
def _(name: str, unit: str, assumed: float, directions: Sequence[Values]) -> str:
    size = f"{digits(assumed, 2)} {unit}".rstrip()
    return (
        f"The {name} cannot be separated from {_directions(directions)}. Its assumed standard deviation, {size}, "
        "enters X in full."
    )


@sentence(
    "calibration.shared_opens",
    check=SHARED,
    phrase="{name} as declared leaves X open",
    effect=1.5,
)
def _(name: str, unit: str, assumed: float, directions: Sequence[Values]) -> str:
    turns = directions[0]["what"] == "rotation"
    most = max(of["size"] for of in directions if of["what"] == directions[0]["what"])
    open_by = f"{digits(math.degrees(most), 2)} deg" if turns else f"{digits(1e3 * most, 2)} mm"
    size = f"{digits(assumed, 2)} {unit}".rstrip()
    return (
        f"The {name} can hardly be separated from {_directions(directions)}. With its declared standard deviation, "
        f"{size}, this leaves X uncertain by {open_by}. Declare a smaller value if it is known."
    )


@sentence(
    "calibration.unweighted",
    check=NOISE,
    phrase="a part of the data is exact: X by 4dpa, unweighted",
    effect=2,
)
def _() -> str:
    return (
        "The noise makes part of the data exact, so they cannot be weighted by its inverse. X is that of method "
        "'4dpa', which neither weights the data nor looks for outliers. For the estimate of least variance give the "
        "poses of one side standard deviations above 0 in rotation and translation."
    )


@sentence(
    "calibration.robust_failed",
    check=OUTLIERS,
    phrase="no robust weights found; outliers bias X",
    effect=3,
)
def _(error: str) -> str:
    return f"Outlier rejection failed: all poses count in full, and an outlier would bias X. {error}"


@sentence(
    "calibration.robust_skipped",
    check=OUTLIERS,
    phrase="rejection skipped: X not determined without",
    effect=3,
    remedy="add poses that rotate about another axis: uq-handeye plan chooses them",
)
def _() -> str:
    return (
        "Outlier rejection was skipped: without the suspect poses X is not determined. An outlier would bias X. Add "
        "poses that rotate about other axes."
    )


@sentence(
    "calibration.few_for_outliers",
    check=OUTLIERS,
    phrase="too few poses to be sure of outliers",
    effect=1.3,
    remedy="take more poses: uq-handeye plan chooses them",
)
def _(item: str, count: int, needed: int) -> str:
    return f"With {count} {item}s an outlier cannot be identified. Take at least {needed}."


@sentence(
    "calibration.near_half_turn",
    check=MOTION,
    phrase="X rotates by about 180 deg",
    effect=1.2,
)
def _(angle: float) -> str:
    return (
        f"The rotation angle of X is {math.degrees(angle):.1f} degrees. Tsai's method solves for a Rodrigues vector, "
        "which grows without bound at 180 degrees, as do its errors. Use another method."
    )


@sentence(
    "calibration.no_covariance",
    check=NOISE,
    phrase="covariance not determined",
    effect=10,
)
def _(covariance: str) -> str:
    return f"There is no covariance {covariance!r}, because there is no noise to compute it from."


@sentence(
    "calibration.noise_not_estimated",
    check=NOISE,
    phrase="noise not estimated, accuracy unknown",
    effect=10,
)
def _(error: str) -> str:
    return error


@sentence(
    "calibration.prior_contradicted",
    check=SHARED,
    phrase=lambda v: f"the prior of {v['of']} contradicts the data ({probability(v['p_value'])})",
    effect=lambda v: math.sqrt(v["chi2"] / v["dof"]),
    rejects=True,
)
def _(of: str, chi2: float, dof: int, p_value: float) -> str:
    return (
        f"The prior of {of} contradicts the data: chi-square {chi2:.3g} with {dof} degrees of freedom, "
        f"p = {p_value:.1g}. Check the value, its unit and frame, and its standard deviation."
    )


@sentence("calibration.prior_agrees")
def _(of: str, chi2: float, dof: int, p_value: float) -> str:
    test = f"chi-square {chi2:.3g} with {dof} degrees of freedom, p = {p_value:.2g}"
    return f"The prior of {of} agrees with the data: {test}."


def _open_remedy(v: Mapping[str, Any]) -> str:
    """Return what determines the open directions; several translations are open where the robot does not rotate."""
    if len(v["directions"]) < 2 or np.abs(np.asarray(v["directions"])[:, :3]).max() > MAX_TURN_OF_A_GANTRY:
        return "add poses that rotate about another axis: uq-handeye plan chooses them"
    return "measure the target or the camera and give it (--known 'target z = 50mm +- 1mm'), or rotate the robot"


@sentence(
    "calibration.intrinsics_moved",
    check=CAMERA,
    phrase=lambda v: "robot poses move the intrinsics: " + ", ".join(_moved_most(v["numbers_moved"])),
    remedy="go on with the corrected intrinsics, intrinsics.yaml of -o, to which X belongs",
)
def _(numbers_moved: Sequence[Mapping[str, Any]], sigma: float) -> str:
    each = "; ".join(
        f"{one['name']} {digits(one['before'], 5)} to {concise(one['after'], one['std'])} "
        f"({digits(abs(one['sigma']), 2)} sigma)"
        for one in numbers_moved
    )
    return (
        f"Robot and pictures together move the intrinsics of the pictures ({digits(sigma, 2)} sigma): {each}. "
        "X belongs to the corrected intrinsics, which -o writes with the camera poses by them. Points placed with the "
        "earlier ones are off by the difference."
    )


def _moved_most(numbers: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the largest shifts in words, at most two."""
    most = sorted(numbers, key=lambda one: -abs(one["sigma"]))[:2]
    return [f"{one['name']} by {digits(one['after'] - one['before'], 2)}" for one in most]


def _rotation_only(v: Mapping[str, Any]) -> str:
    rows = v["left_out"]
    left = "" if not rows else f"; {len(rows)} of {v['n']} poses left out: {ranges(rows)}"
    return f"no positions were given: the translation of X is open{left}"


@sentence(
    "calibration.rotation_only",
    check=MOTION,
    phrase=_rotation_only,
    effect=5,
    remedy="give positions of robot and camera if the translation is wanted",
)
def _(n: int, noise: float, left_out: Sequence[int]) -> str:
    text = (
        f"No positions were given. The rotation of X comes from {n - len(left_out)} rotations with errors of "
        f"{digits(math.degrees(noise), 2)} deg per axis of a pair, and the translation of X is open."
    )
    return text if not left_out else f"{text} Left out, as they do not fit the others: {ranges(left_out)}."


@sentence(
    "calibration.open",
    check=MOTION,
    phrase=_open_in_short,
    effect=5,
    remedy=_open_remedy,
)
def _(directions: Sequence[Sequence[float]], setup: str | None) -> str:
    return (
        f"The motions leave open: {'; '.join(open_words(one, setup) for one in directions)}. X is one of many that "
        "fit, and the standard deviations cover the rest only. Give a prior (--known, --prior-x), or rotate the robot "
        "about another axis."
    )


@sentence("calibration.camera_scale")
def _(factor: float, std: float) -> str:
    return (
        f"The camera poses have a scale of their own: 1 m is {concise(1.0 / factor, std / factor**2)} of their units. "
        f"Multiply their lengths by {digits(factor, 4)} to have them in m."
    )


@sentence("calibration.scene_scale")
def _(factor: float, std: float) -> str:
    if abs(factor - 1.0) < max(5.0 * std, 0.01):  # lengths are those of the robot already
        return f"The unit of the scene is the robot's metre, to {digits(100 * std / factor, 1)} %."
    return f"1 unit of the scene is {concise(1e3 * factor, 1e3 * std, 'mm')}, by the robot."


@sentence("calibration.excluded")
def _(excluded: Sequence[int], fit: Sequence[int] | None, limit: float | None, n: int) -> str:
    one = len(excluded) == 1
    which = f"pose{'' if one else 's'} {ranges(excluded)} of {n}, counted from 0"
    text = f"Excluded by request: {which}. X does not use {'it' if one else 'them'}."
    if fit is None or limit is None:
        return text
    below = f"the others (d^2 below {limit:.3g})"
    if not fit:
        return f"{text} {'It does not fit' if one else 'None of them fits'} {below}."
    if len(fit) == len(excluded):
        return f"{text} {'It fits' if one else 'All of them fit'} {below}; including {_it(fit)} would add information."
    some = f"pose {fit[0]} fits" if len(fit) == 1 else f"poses {ranges(fit)} fit"
    return f"{text} Of these, {some} {below}; including {_it(fit)} would add information."


def _it(rows: Sequence[int]) -> str:
    return "it" if len(rows) == 1 else "them"
