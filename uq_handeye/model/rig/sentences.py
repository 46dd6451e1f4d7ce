"""Sentences about rigs. Values in rad and m."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ...core.levels import IMPOSSIBLE
from ...core.presentation.numbers import concise, digits, probability, times_of_noise
from ...findings import GROSS_EXCESS, INPUT, RESIDUALS, Finding, Values, sentence
from ..poses.pose_numbers import ranges
from .description import later_name

# Poses with the views of their copy: name, and by which partner or since which robot pose.
Paths = Sequence[Mapping[str, Any]]


def _by(angle: float, shift: float) -> str:
    return f"{math.degrees(angle):.3g} deg, {1e3 * shift:.3g} mm"


def path_words(name: str, by: str | None, since: str | int | None) -> str:
    """Name a pose and the views of its copy."""
    return f"{name}, by {by}" if by is not None else f"{name}, from robot pose {since} on"


def _moved_by(values: Values) -> str:
    """``3.0(5) mm, 0.50(7) deg``; without the part that is not resolved."""
    parts = (("shift", 1e3, "mm"), ("angle", 180 / math.pi, "deg"))
    resolved = [(name, of, unit) for name, of, unit in parts if values[f"{name}_sd"] is not None]
    if not resolved:
        return _by(values["angle"], values["shift"])
    return ", ".join(concise(of * values[name], of * values[f"{name}_sd"], unit) for name, of, unit in resolved)


def _after_move(values: Values) -> str:
    name = values["name"]
    if values["kind"] == "camera":
        names = f"{name} or {later_name(name, values['since'])}"
        return f"take X before or after the move: uq-handeye export RESULT FILE --camera {names}"
    names = " or ".join(values.get("cameras", ())) or "NAME"
    return f"take X of the fit with two targets: uq-handeye export RESULT FILE --camera {names}"


def _or(others: Paths) -> str:
    words = [path_words(**one) for one in others]
    return f" As likely: {'; '.join(words)}." if words else ""


def _named(values: Mapping[str, Any]) -> str:
    """Name the pose by what it is, and by its name where that says more."""
    kind, name = values["kind"], values["name"]
    return kind if kind == name else f"{kind} {name}"


@sentence(
    "rig.moved",
    check=RESIDUALS,
    phrase=lambda values: f"the {_named(values)} moved from pose {values['since']} on, by {_moved_by(values)}",
    remedy=_after_move,
    explains=True,
    rows=("since",),
)
def _(
    kind: str, name: str, since: str | int, angle: float, shift: float, chi_square: float, p: float, others: Paths,
    angle_sd: float | None = None, shift_sd: float | None = None, cameras: Sequence[str] = (),
) -> str:  # fmt: skip
    what = _named({"kind": kind, "name": name})
    moved = _moved_by({"angle": angle, "angle_sd": angle_sd, "shift": shift, "shift_sd": shift_sd})
    return (
        f"The {what} moved from robot pose {since} on, by {moved} (chi-square {chi_square:.0f} of 6, "
        f"{probability(p)}).{_or(others)} It is two in the fit before and after: {name} and {later_name(name, since)}."
    )


@sentence(
    "rig.drifts",
    check=RESIDUALS,
    phrase=lambda values: f"the {_named(values)} drifts by {_moved_by(values)} from the first pose to the last",
    remedy="fasten it and let it warm up, or give the times of the poses: a drift is then estimated",
    explains=True,
)
def _(
    kind: str, name: str, angle: float, shift: float, chi_square: float, p: float,
    angle_sd: float | None = None, shift_sd: float | None = None,
) -> str:  # fmt: skip
    what = _named({"kind": kind, "name": name})
    moved = _moved_by({"angle": angle, "angle_sd": angle_sd, "shift": shift, "shift_sd": shift_sd})
    return (
        f"The {what} drifts by {moved} from the first pose to the last (chi-square {chi_square:.0f} of 6, "
        f"{probability(p)}): a steady change explains the residuals better than one step."
    )


@sentence(
    "rig.paths_disagree",
    check=RESIDUALS,
    phrase="two ways to the {kind} {name} disagree",
    remedy="Look at the size of the target {by}, the intrinsics, and whether both stood still between their views.",
)
def _(
    kind: str, name: str, by: str, angle: float, shift: float, chi_square: float, p: float, others: Paths,
    angle_sd: float | None = None, shift_sd: float | None = None,
) -> str:  # fmt: skip
    differ = _moved_by({"angle": angle, "angle_sd": angle_sd, "shift": shift, "shift_sd": shift_sd})
    return (
        f"The pose of the {kind} {name} with {by} and that from its other views differ by {differ} "
        f"(chi-square {chi_square:.0f} of 6, {probability(p)}).{_or(others)} Look at the size of the target, the "
        "intrinsics, and whether both stood still between their views."
    )


@sentence(
    "rig.path_rings",
    check=RESIDUALS,
    phrase="two ways to one pose disagree, and no move explains it",
    remedy="Look at the intrinsics, the sizes of the targets, the accuracy of the arm and the noise given.",
)
def _(path: str, angle: float, shift: float, chi_square: float, p: float) -> str:
    return (
        f"Two ways to one pose disagree ({path}): by {_by(angle, shift)} (chi-square {chi_square:.0f}, "
        f"{probability(p)}), and no move of one pose explains it. Look at the intrinsics, the sizes of the targets, "
        "the accuracy of the arm and the noise given."
    )


def _of_size(values: Values) -> str:
    """``left: the target is 0.984(1) times as large as given``; without the camera where all of them show it."""
    by = "" if values["camera"] is None else f"{values['camera']}: "
    what = _named({"kind": "target", "name": values["target"]})
    return f"{by}the {what} is {concise(values['size'], values['sd'])} times as large as given"


def _of_lengths(values: Values) -> str:
    """Return what else shows as another size: of one camera, or of all of them."""
    if values["camera"] is None:
        return "or declare what the arm or the focal length may be off by (--robot-accuracy, --shared)"
    return f"and look at the size and the focal length that the program of {values['camera']} was given"


@sentence(
    "rig.wrong_size",
    check=INPUT,
    phrase=_of_size,
    effect=lambda values: float(values["times"]),
    rejects=True,
    explains=lambda values: values["times"] > GROSS_EXCESS and values["p"] < IMPOSSIBLE.probability,
    explained=True,
    remedy=lambda values: f"measure the {_named({'kind': 'target', 'name': values['target']})}, {_of_lengths(values)}",
)
def _(target: str, camera: str | None, size: float, sd: float, times: float, p: float) -> str:
    values = {"target": target, "camera": None, "size": size, "sd": sd}
    whose = "its cameras" if camera is None else camera
    remedy = _of_lengths(values | {"camera": camera})
    return (
        f"By the lengths of {whose} and of the robot, {_of_size(values)} ({probability(p)}). X of {whose} is then off "
        f"by up to {digits(times, 2)} standard deviations. Measure it, {remedy}."
    )


def _of_file(values: Values) -> Finding:
    return Finding.from_dict(values["finding"])


def _named_phrase(camera: str, phrase: str) -> str:
    return phrase if camera in phrase.split() else f"{camera}: {phrase}"


@sentence(
    "rig.of_camera",
    check=INPUT,
    phrase=lambda values: _named_phrase(values["camera"], _of_file(values).phrase),
    remedy=lambda values: _of_file(values).remedy,
    effect=lambda values: _of_file(values).effect,
    explains=lambda values: (of := _of_file(values)).explains and of.severity == "failure",
    rank=0,
)
def _(camera: str, target: str, finding: Mapping[str, Any]) -> str:
    return f"Camera {camera} with {target}: {Finding.from_dict(finding)}"


@sentence(
    "rig.same_views",
    check=INPUT,
    phrase="{one} and {two} hold the same poses",
    explains=True,
    rank=0,
    remedy="give the file of each {what}: --camera NAME=FILE, or `file` of its view in the rig file",
)
def _(what: str, one: str, two: str, count: int, sources: Sequence[str]) -> str:
    files = f" ({', '.join(dict.fromkeys(sources))})" if sources else ""
    return (
        f"The {what}s {one} and {two} hold the same poses, {count} of them{files}: one file was given for both. Give "
        f"the file of each {what} (--camera NAME=FILE, or `file` of its view in the rig file)."
    )


def _at_poses(rows: Sequence[Any]) -> str:
    at = ranges(sorted(rows)) if {type(row) for row in rows} == {int} else ", ".join(map(str, rows))
    return f"at robot pose{'' if len(rows) == 1 else 's'} {at}"


@sentence(
    "rig.exchanged_views",
    check=INPUT,
    phrase=lambda values: f"{values['one']} and {values['two']} are exchanged {_at_poses(values['rows'])}",
    explains=lambda values: not values["left_out"],
    rank=0,
    remedy="exchange these rows in the files of {one} and {two}",
)
def _(what: str, one: str, two: str, rows: Sequence[Any], count: int, left_out: bool) -> str:
    end = "They are left out." if left_out else "Exchange these rows in their files, or the others."
    return (
        f"The views of the {what}s {one} and {two} are exchanged {_at_poses(rows)} ({len(rows)} of {count}): each fits "
        f"as that of the other {what}. {end}"
    )


def _noise_of(larger: Paths) -> str:
    return "; ".join(
        f"{one['name']} {_by(one['rotation'], one['translation'])}"
        + ("" if one["times"] is None else f" ({digits(one['times'], 2)} times the noise given)")
        for one in larger
    )


def _against(ratio: float | None) -> str:
    return "views contradict this noise" if ratio is None else times_of_noise(ratio)


@sentence(
    "rig.noise_too_small",
    check=RESIDUALS,
    phrase=lambda values: f"{_against(values['ratio'])}; they show {_noise_of(values['larger'][:1])}",
    remedy="leave the noise out, it is then estimated; look at the clock, the file and the target of what is noisy",
)
def _(ratio: float | None, larger: Paths) -> str:
    return (
        f"{_against(ratio).capitalize()}. By the views it is, per axis: {_noise_of(larger)}. Leave the noise "
        "out, it is then estimated; look at the clock, the file and the target of a camera that is noisier than the "
        "others."
    )


@sentence(
    "rig.noisy_robot",
    check=RESIDUALS,
    phrase=lambda values: f"the noise of {values['name']} is {_by(values['rotation'], values['translation'])}",
    remedy="look at the file of the robot: many of its poses are wrong, or of other moments",
)
def _(name: str, rotation: float, translation: float) -> str:
    return (
        f"The robot poses of {name} scatter by {_by(rotation, translation)} per axis: many of them are wrong. "
        "Look at the file, and at which view each pose belongs to."
    )


@sentence(
    "rig.noisy_camera",
    check=RESIDUALS,
    phrase=lambda values: f"the noise of {values['name']} is {_by(values['rotation'], values['translation'])}",
    remedy="look at the file of that camera: most of its poses are wrong, or of other moments",
)
def _(name: str, rotation: float, translation: float, ratio: float | None) -> str:
    others = "" if ratio is None else f", {ratio:.3g} times that of the quietest camera"
    return (
        f"The poses by {name} scatter by {_by(rotation, translation)} per axis{others}, as those of a camera of which "
        "many are wrong. Look at its file, at which robot pose each belongs to, and at its target."
    )
