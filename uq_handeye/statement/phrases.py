"""Each finding in a short phrase, the check that it belongs to, and how far it may put X off.

A phrase has at most about 55 characters and no full stop; ``str(finding)`` is the whole sentence. The effect is by how
many of its stated standard deviations X may be off, or how many times too small these may be, as far as the finding
says: 1 where the covariance contains it, infinite where X cannot be used. It only orders findings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from ..findings import Finding
from ..formatting.numbers import digits, probability

# The checks, in the order in which they are shown.
INPUT, OUTLIERS, NOISE, NEIGHBOURS = "input", "outliers", "noise level", "neighbours"
RESIDUALS, HALVES, MOTION, SHARED, CAMERA = "residuals", "two halves", "motion", "shared errors", "camera"
CHECKS = (INPUT, OUTLIERS, NOISE, NEIGHBOURS, RESIDUALS, HALVES, MOTION, SHARED)

Words = Callable[[Mapping[str, Any]], str]
Effect = Callable[[Mapping[str, Any]], float]


class Phrase(NamedTuple):
    """Short text of a code."""

    check: str
    words: Words
    effect: Effect = lambda v: 1.0
    rejects: bool = False  # a test says that the covariance of X is too small


def _text(text: str) -> Words:
    return lambda v: text


def _constant(value: float) -> Effect:
    return lambda v: value


def _reading(v: Mapping[str, Any]) -> str:
    """One of `misread_files.other_readings`, in short."""
    kind, file = v["kind"], v.get("file")
    if kind == "scale":
        if file and v.get("unit"):
            return f"the {file} {'poses seem' if v.get('bag') else 'file seems'} to be in {v['unit']}"
        if v.get("bag"):
            return f"the tag seems to be {digits(float(v['factor']), 2)} times as large as given"
        if v.get("target"):
            return f"the target seems to be {digits(float(v['factor']), 3)} times as large as given"
        return "robot and camera seem to be in different units"
    if kind == "inverse robot" and v.get("likely") == "setup":
        return f"the setup seems to be {v['setup']}, or the camera file inverse"
    if kind == "inverse robot":
        return f"the robot file seems inverse, or the setup {v['setup']}"
    if kind == "inverse camera":
        setup = v.get("setup")
        return (
            "the camera file seems to hold inverse poses"
            if setup is None
            else (f"the camera file seems inverse, or the setup {setup}")
        )
    if kind == "mirrored":
        return "the camera's or the robot's frame seems to be left-handed"
    who = "both files seem" if file is None else f"the {file} file seems"
    if kind == "transposed":
        return f"{who} to have transposed rotations"
    return f"{who} to have the quaternion's scalar {'first' if v['order'] == 'wxyz' else 'last'}"


def _far(v: Mapping[str, Any]) -> str:
    if rows := v.get("rows"):
        return f"{v['file']} row{'' if len(rows) == 1 else 's'} {', '.join(map(str, rows))} in {v['unit']}?"
    return f"{v['file']} translations look like {v['unit']}"


def _repeated(v: Mapping[str, Any]) -> str:
    count, again = v["count"], bool(v.get("runs"))
    rows = f"{count} {v.get('file', '')} row{'' if count == 1 else 's'}"
    return f"{rows} given again, counted once" if again else f"{rows} like the row before"


def _readings(v: Mapping[str, Any]) -> str:
    readings: Sequence[Mapping[str, Any]] = v["readings"]
    if readings:
        return _reading(readings[0])
    return f"X does not explain the poses ({_both(v['rotation'], v['translation'])} RMS)"


def _both(rotation: float, translation: float) -> str:
    return f"{digits(math.degrees(rotation), 2)} deg, {digits(1e3 * translation, 2)} mm"


def _flagged(v: Mapping[str, Any]) -> str:
    what = {"rejected": "rejected", "downweighted": "down-weighted", "outlier": "kept, but do not fit"}[v["flag"]]
    rows = ", ".join(str(one["row"]) for one in v["worst"][:5])
    more = ", ..." if v["count"] > min(len(v["worst"]), 5) else ""
    return f"{v['count']} of {v['n']} {v['item']}s {what}: {rows}{more}"


def _flagged_effect(v: Mapping[str, Any]) -> float:
    return 1.1 if v["flag"] != "outlier" else math.sqrt(v["worst"][0]["distance2"] / 6.0)


def times_of_noise(ratio: float) -> str:
    """Return how residuals compare with the noise given."""
    return f"residuals {digits(max(ratio, 1 / ratio), 2)} times {'larger' if ratio > 1 else 'smaller'} than this noise"


def _ratio(v: Mapping[str, Any]) -> float:
    return v["rms"] / v["expected"] if v["expected"] > 0 else math.inf


def _of_two(v: Mapping[str, Any]) -> float:
    return float(max(v["rotation"], v["translation"], key=lambda x: abs(math.log(x)) if x > 0 else 0.0))


def _correlated(v: Mapping[str, Any]) -> str:
    growth = v["growth"]
    if growth is None or growth < 1.05:
        return f"correlated ({probability(v['p_value'])}), hardly any effect on X"
    return f"correlated; X is about {digits(growth, 2)} times less certain"


def _drift(v: Mapping[str, Any]) -> str:
    kind = "drift" if v["drift"] else "correlation"
    return f"{kind} of the {v['way']}, included in the accuracy"


def _shape(v: Mapping[str, Any]) -> str:
    says = []
    if v["excess_kurtosis"] is not None:
        says.append(f"{'heavier' if v['excess_kurtosis'] > 0 else 'lighter'} tails")
    if v["skewness"] is not None:
        says.append("skewed")
    return f"not Gaussian ({probability(v['p_value'])}): {', '.join(says)}"


def _halves(v: Mapping[str, Any]) -> str:
    state = "agree" if v["agree"] else "differ"
    return f"{v['split']}: {state} ({probability(v['p_value'])})"


def _asked(v: Mapping[str, Any]) -> str:
    one = v["errors"][0]
    return f"the residuals indicate a {one['name']} error of {digits(100 * one['estimate'], 2)} %"


def _size(v: Mapping[str, Any]) -> str:
    share = 100 * abs(1 / (1 + v["estimate"]) - 1)
    return f"target {digits(share, 2)} % {'larger' if v['estimate'] < 0 else 'smaller'} than given"


def _open(v: Mapping[str, Any]) -> str:
    k = len(v["directions"])
    return f"{k} direction{'s' if k > 1 else ''} of X and W not determined"


def _moves(v: Mapping[str, Any]) -> str:
    return f"without {v['item']} {v['row']} X moves by {digits(v['shift_sd'], 2)} standard deviations"


def _local(v: Mapping[str, Any]) -> str:
    return f"poses span {digits(100 * v['span'], 2)} % of the reach: local"


_PHRASES: dict[str, Phrase] = {
    # input
    "poses.inverted": Phrase(INPUT, lambda v: f"{' and '.join(v['sides'])} poses inverted on request"),
    "input_checks.setup_not_said": Phrase(INPUT, lambda v: f"the setup may be {v['setup']}: say which", _constant(30)),
    "input_checks.setup_by_lengths": Phrase(
        INPUT,
        lambda v: f"the {v['what']} would sit {digits(v['length'], 2)} m from the gripper: {v['setup']}?",
        _constant(30),
    ),
    "poses.another_rotation": Phrase(
        INPUT, lambda v: f"the {v['side']} rotations seem to be {v['form']}, not {v['used']}"
    ),
    "input_checks.poses_unexplained": Phrase(INPUT, _readings),
    "input_checks.motions_unexplained": Phrase(
        INPUT, lambda v: f"X does not explain the motions ({_both(v['rotation'], v['translation'])} RMS)"
    ),
    "evidence.touches_used": Phrase(
        INPUT,
        lambda v: f"{v['count']} touched points contradict the poses ({probability(v['p_value'])})",
        _constant(3.0),
        rejects=True,
    ),
    "input_checks.wrong_scale": Phrase(INPUT, lambda v: _reading(v["reading"])),
    "input_checks.same_file": Phrase(INPUT, _text("robot and camera file hold the same poses")),
    "input_checks.angles_disagree": Phrase(
        INPUT,
        lambda v: (
            "a few pairs rotate by different angles" if v["few"] else "the rows of the two files do not belong together"
        ),
        _constant(1.2),
    ),
    "input_checks.shifted_rows": Phrase(INPUT, _text("rows are missing in one file: the pairing is shifted")),
    "input_checks.alphabetical_rows": Phrase(
        INPUT, lambda v: f"the {v['file']} rows are in alphabetical order ({', '.join(map(str, v['order'][:3]))}, ...)"
    ),
    "input_checks.shifted_run": Phrase(
        INPUT, lambda v: f"robot rows {v['first']} to {v['last']} are paired wrongly", _constant(1.5)
    ),
    "input_checks.tiny": Phrase(
        INPUT,
        lambda v: f"both files seem to be in a larger unit ({digits(1e3 * v['reach'], 2)} mm at most)",
        _constant(50),
    ),
    "input_checks.far": Phrase(INPUT, _far, _constant(50)),
    "input_checks.constant_column": Phrase(
        INPUT, lambda v: f"column {v['column']} of the {v['file']} poses is constant"
    ),
    "input_checks.identical_columns": Phrase(
        INPUT, lambda v: f"columns {' and '.join(v['columns'])} of the {v['file']} poses are equal", _constant(20)
    ),
    "input_checks.repeated_rows": Phrase(INPUT, _repeated),
    "input_checks.long_bracket": Phrase(
        INPUT,
        lambda v: f"the {v['what']} would sit {digits(v['length'], 2)} m from the gripper: wrong files?",
        _constant(30),
    ),
    "kinematics.another_arm": Phrase(INPUT, _text("the robot poses are not those of the URDF")),
    "kinematics.rows_apart": Phrase(
        INPUT, lambda v: f"{len(v['rows'])} poses: joints and robot pose differ", _constant(1.5)
    ),
    # outliers
    "diagnostics.flagged": Phrase(OUTLIERS, _flagged, _flagged_effect),
    "input_checks.outliers": Phrase(
        OUTLIERS, lambda v: f"{v['count']} of {v['n']} {v['what']}s fit much worse", _constant(3)
    ),
    "input_checks.flipped_poses": Phrase(
        OUTLIERS, lambda v: f"{len(v['rows'])} flipped: second solution of the target"
    ),
    "calibration.robust_failed": Phrase(OUTLIERS, _text("no robust weights found; outliers bias X"), _constant(3)),
    "calibration.robust_skipped": Phrase(OUTLIERS, _text("rejection skipped: X not determined without"), _constant(3)),
    "calibration.few_for_outliers": Phrase(OUTLIERS, _text("too few poses to be sure of outliers"), _constant(1.3)),
    # noise level
    "input_checks.noise_too_small": Phrase(NOISE, lambda v: times_of_noise(_ratio(v)), _ratio, rejects=True),
    "input_checks.noise_too_large": Phrase(NOISE, lambda v: times_of_noise(_ratio(v)), _constant(1.05)),
    "diagnostics.noise_too_small": Phrase(
        NOISE, lambda v: times_of_noise(v["scale"]), lambda v: float(v["scale"]), True
    ),
    "calibration.data_sheet_contradicted": Phrase(
        NOISE, lambda v: times_of_noise(_of_two(v)), lambda v: max(_of_two(v), 1.05), rejects=True
    ),
    "calibration.unweighted": Phrase(NOISE, _text("a part of the data is exact: X by 4dpa, unweighted"), _constant(2)),
    "calibration.noise_not_estimated": Phrase(NOISE, _text("noise not estimated, accuracy unknown"), _constant(10)),
    "calibration.no_covariance": Phrase(NOISE, _text("covariance not determined"), _constant(10)),
    "noise_estimation.exact": Phrase(NOISE, _text("residuals at rounding level: the data are exact")),
    "noise_estimation.interval_too_wide": Phrase(NOISE, _text("an interval did not converge (too wide)")),
    "noise_estimation.pixels_given": Phrase(
        NOISE,
        lambda v: f"pixel noise given contradicts the residuals by {digits(math.sqrt(v['factor']), 2)} times",
        lambda v: max(math.sqrt(v["factor"]), 1.05),
        rejects=True,
    ),
    "noise_estimation.unusual_pixels": Phrase(
        NOISE,
        lambda v: f"pixel noise of {digits(v['component']['value'], 2)} px is unusual",
        _constant(3),
        rejects=True,
    ),
    "noise_estimation.camera_factor": Phrase(
        NOISE,
        lambda v: f"residuals {digits(math.sqrt(v['factor']), 2)} times what the corners say",
        lambda v: max(math.sqrt(v["factor"]), 1.05),
        rejects=True,
    ),
    "noise_estimation.camera_excess": Phrase(
        NOISE, lambda v: f"corners share {digits(v['pixels'], 2)} px of error, included", _constant(1.2)
    ),
    "propagation.few_data": Phrase(NOISE, _text("too few data for this method's covariance"), _constant(3)),
    "propagation.precise_residuals": Phrase(NOISE, _text("this method's covariance may be too small"), _constant(3)),
    "propagation.curved": Phrase(NOISE, _text("first order is not enough for this method"), _constant(3)),
    # neighbours
    "diagnostics.correlated": Phrase(
        NEIGHBOURS, _correlated, lambda v: max(float(v["growth"] or 1.0), 1.0), rejects=True
    ),
    "noise_estimation.correlated": Phrase(NEIGHBOURS, _drift, _constant(1.02)),
    "diagnostics.uncorrelated": Phrase(NEIGHBOURS, _text("residuals of neighbouring poses uncorrelated")),
    # residuals
    "diagnostics.not_gaussian": Phrase(RESIDUALS, _shape, _constant(1.1)),
    "diagnostics.pattern": Phrase(
        RESIDUALS,
        lambda v: f"follow the {v['item']}s ({digits(100 * v['r_squared'], 2)} % explained)",
        lambda v: 1.0 / math.sqrt(max(1.0 - v["r_squared"], 0.01)),
        rejects=True,
    ),
    "diagnostics.wrong_row": Phrase(RESIDUALS, _moves, lambda v: float(v["shift_sd"])),
    # halves
    "diagnostics.halves": Phrase(HALVES, _halves, lambda v: math.sqrt(v["d2"] / 6.0), rejects=True),
    # motion
    "input_checks.parallel_axes": Phrase(MOTION, _text("rotation axes are nearly parallel"), _constant(2)),
    "input_checks.small_rotations": Phrase(
        MOTION, lambda v: f"rotations of {digits(math.degrees(v['largest']), 2)} deg at most: noise amplified"
    ),
    "input_checks.half_turns": Phrase(MOTION, _text("many rotations above 150 deg, little weight in 4dpa")),
    "calibration.open": Phrase(MOTION, _open, _constant(5)),
    "calibration.near_half_turn": Phrase(MOTION, _text("X rotates by about 180 deg"), _constant(1.2)),
    "diagnostics.needed_rows": Phrase(
        MOTION, lambda v: f"without {v['item']} {v['rows'][0]} the data do not determine X", _constant(2)
    ),
    # shared errors
    "diagnostics.undeclared": Phrase(SHARED, _asked, _constant(2), rejects=True),
    "calibration.target_size": Phrase(SHARED, _size, _constant(1.15)),
    "calibration.shared_contradicted": Phrase(
        SHARED,
        lambda v: f"{v['name']} contradicts what was assumed of it",
        lambda v: abs(v["estimate"]) / v["assumed"],
        rejects=True,
    ),
    "calibration.group_contradicted": Phrase(
        SHARED, lambda v: f"{v['name']} contradict what was assumed", lambda v: float(v["times"]), rejects=True
    ),
    "calibration.shared_opens": Phrase(SHARED, lambda v: f"{v['name']} as declared leaves X open", _constant(1.5)),
    "prediction.local_joints": Phrase(SHARED, _local, _constant(1.3)),
    "calibration.prior_contradicted": Phrase(
        SHARED,
        lambda v: f"the prior of {v['of']} contradicts the data ({probability(v['p_value'])})",
        lambda v: math.sqrt(v["chi2"] / v["dof"]),
        rejects=True,
    ),
    "poses.offset_taken_as_exact": Phrase(SHARED, _text("the clock offset counts as exact"), _constant(1.5)),
    "calibration.bundle_differs": Phrase(
        CAMERA, lambda v: f"bundle adjustment differs by {digits(v['distance'], 2)} sd", lambda v: float(v["distance"])
    ),
    # camera
    "camera.focal_uncertain": Phrase(CAMERA, lambda v: f"focal length known to {digits(100 * v['share'], 2)} % only"),
    "camera.another_board": Phrase(
        CAMERA, lambda v: f"corners {digits(v['pixels'], 2)} px off: another board?", _constant(8.0)
    ),
    "camera.coefficients_near_zero": Phrase(CAMERA, _text("some lens coefficients are not significant")),
    "camera.corners_left_out": Phrase(CAMERA, lambda v: f"{v['count']} of {v['n']} corners left out"),
    "camera.pictures_left_out": Phrase(CAMERA, lambda v: f"{len(v['pictures'])} images rejected"),
    "camera.residual_pattern": Phrase(CAMERA, _text("residuals have a pattern over the image"), _constant(1.5)),
    "camera.board_pattern": Phrase(CAMERA, _text("residuals follow the points of the board"), _constant(1.5)),
    "camera.squares_stretched": Phrase(CAMERA, _text("squares wider than high, or higher than wide")),
    "points.left_out": Phrase(CAMERA, lambda v: f"{v['count']} of {v['n']} points left out"),
    "points.poses_left_out": Phrase(CAMERA, lambda v: f"{len(v['poses'])} poses left out: {v['why']}"),
    "points.not_in_target": Phrase(CAMERA, lambda v: f"{len(v['points'])} measured points not in the target"),
    "points.noise_differs": Phrase(
        CAMERA,
        lambda v: f"residuals of points {digits(v['ratio'], 2)} times the noise given",
        lambda v: float(max(v["ratio"], 1.0)),
    ),
    "points.few_residuals": Phrase(CAMERA, _text("noise of the points from few residuals")),
    "points.scale": Phrase(
        CAMERA,
        lambda v: f"scale of the points {digits(100 * abs(v['scale']), 2)} % off the target",
        lambda v: float(abs(v["scale"]) / v["std"]),
    ),
    "points.target_off": Phrase(CAMERA, lambda v: f"{v['count']} of {v['n']} points off the target", _constant(1.5)),
}


def check_of(finding: Finding) -> str:
    """Return the name of the check that a finding belongs to."""
    known = _PHRASES.get(finding.code)
    return INPUT if known is None else known.check


def phrase(finding: Finding) -> str:
    """Return the finding in a short phrase; its code in words where there is none."""
    known = _PHRASES.get(finding.code)
    try:
        return finding.code.rpartition(".")[2].replace("_", " ") if known is None else known.words(finding.values)
    except (LookupError, TypeError, ValueError, ArithmeticError):  # values from a file of another version
        return finding.code.rpartition(".")[2].replace("_", " ")


def effect(finding: Finding) -> float:
    """Return by how many of its standard deviations X may be off, as far as the finding says."""
    if finding.severity == "failure":
        return math.inf
    known = _PHRASES.get(finding.code)
    try:
        return 1.0 if known is None else float(known.effect(finding.values))
    except (LookupError, TypeError, ValueError, ArithmeticError):
        return 1.0


def rejects(finding: Finding) -> bool:
    """Return whether a finding says that the covariance of X is too small: a test that failed."""
    if finding.severity == "note":
        return False
    known = _PHRASES.get(finding.code)
    return finding.severity == "failure" or (known is not None and known.rejects and effect(finding) > 1.1)
