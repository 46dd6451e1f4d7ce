"""Reading and writing of intrinsics: JSON of this package, OpenCV's FileStorage, camera_info of ROS, data sheets.

The texts are for other programs, each with its convention and units. Sources of the rules:
OpenCV, ``calibrateCamera`` and ``fisheye`` (docs.opencv.org, calib3d); ROS, ``sensor_msgs/msg/CameraInfo.msg``
(ros2/common_interfaces) and the files of ``camera_calibration_parsers``.
"""

from __future__ import annotations

import numpy as np

from ...core.files.json_values import Json, JsonObject
from ...core.files.one_line import short
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.files.tree_values import fields_of, got, is_list, is_map, items_of, number
from ...core.files.trees import parse_toml, parse_tree
from ...core.geometry.se3 import Array
from ...core.limits import MAX_DESCRIPTION_BYTES
from ...core.presentation.numbers import Snippet
from ...core.presentation.numbers import short as short_number
from ...errors import InputError
from ...formats.opencv_storage import matrix_lines, stack, yaml_number
from .calibrated import Calibrated
from .intrinsics_of_programs import Found, intrinsics_of_colmap, intrinsics_of_program, model_called, values_of
from .known_intrinsics import KnownIntrinsics
from .models import MODELS
from .picture_region import camera_info_region

FORMAT = "uq-handeye camera 1"
# Names of the camera matrix and the coefficients in OpenCV's samples, ROS and programs of people.
_MATRIX = ("camera_matrix", "cameraMatrix", "K", "k")
_COEFFICIENTS = ("distortion_coefficients", "distCoeffs", "dist_coeffs", "D", "d")
_NAMES = sorted({name for model in MODELS.values() for name in model.names})
# Keys beside the names of the numbers.
_BESIDE = (
    "model", "camera_model", "distortion_model", "image_size", "image_width", "image_height", "width", "height",
)  # fmt: skip
# Standard deviations of ``calibrateCameraExtended``, in the order fx, fy, cx, cy and OpenCV's coefficients.
_DEVIATIONS = ("stdDeviationsIntrinsics", "std_deviations_intrinsics", "std_intrinsics")


def read_intrinsics(path: StrPath, model: str | None = None) -> KnownIntrinsics:
    """Intrinsics of a file, in pixels of this program (the first one's centre at 0), with standard deviations if given.

    Parameters
    ----------
    path : path of the file
        JSON or YAML with names, ``{"fx": 1080.0, "k1": [-0.1, 0.01]}``, two numbers a value and its standard deviation;
        the ``intrinsics.json`` of `CameraCalibration.write`, with its standard deviations but not their correlations;
        ``camera_matrix`` and ``distortion_coefficients`` of OpenCV's FileStorage or a ROS ``camera_info``, with its
        ``roi`` and ``binning``; or the file of a program in `intrinsics_of_programs`. A camera of several is named
        behind a colon, ``camchain.yaml:cam1``.
    model : name of a model or None
        Model of the coefficients, where the file does not name it.

    Raises
    ------
    InputError
        A file that cannot be read or is none of these; coefficients that no model here has.
    """
    location, camera = as_path(path), None
    if not location.exists() and ":" in location.name:
        stem, _, camera = str(location).rpartition(":")
        location = as_path(stem)
    name = shown(location)
    with opened(location, MAX_DESCRIPTION_BYTES) as file:
        data = file.read()
    text = data.decode("utf-8", "replace") if location.suffix.lower() == ".txt" else ""
    if (found := intrinsics_of_colmap(text, name, camera)) is not None:
        return _of_program(found, model, name)
    tree = parse_toml(location) if location.suffix.lower() == ".toml" else parse_tree(data, name)
    if not is_map(tree):
        raise InputError(f'{name}: expected intrinsics such as {{"fx": 1080.0, "fy": [1080.0, 2.0]}}, got {got(tree)}.')
    if (found := intrinsics_of_program(tree, name, camera)) is not None:
        return _of_program(found, model, name)
    size = _size(tree, name)
    named = _model(tree, name)
    if named is not None and model not in (None, "auto", named):
        raise InputError(f"The model of {name} is {named}, and `model` (--model) is {model}.")
    if any(key in tree for key in _MATRIX):
        return _of_opencv(tree, name, named or (None if model == "auto" else model), size)
    if is_map(tree.get("parameters")):
        return KnownIntrinsics(_of_ours(tree, name), named, size)
    entries = {key: value for key, value in tree.items() if key in _NAMES}
    unknown = [key for key in tree if key not in (*_NAMES, *_BESIDE)]
    if unknown or not entries:
        what = f"unknown: {short(', '.join(unknown))}" if unknown else "none of them"
        raise InputError(f"{name}: expected the names {', '.join(_NAMES)}, or camera_matrix of OpenCV; {what}.")
    return KnownIntrinsics({key: _entry(value, f"{name}, {key}") for key, value in entries.items()}, named, size)


def _of_program(found: Found, model: str | None, name: str) -> KnownIntrinsics:
    """Return the intrinsics of another program's file."""
    if model not in (None, "auto", found.model):
        raise InputError(f"The model of {name} is {found.model}, and `model` (--model) is {model}.")
    return KnownIntrinsics(found.values, found.model, found.image_size, sensor_of_43=found.sensor_of_43)


def _entry(value: Json, where: str) -> float | tuple[float, float]:
    if is_list(value):
        if len(value) != 2:
            raise InputError(f"{where}: expected a value, or a value and its standard deviation, got {got(value)}.")
        mean, deviation = (number(part, where) for part in value)
        if deviation < 0:
            raise InputError(f"{where}: expected a standard deviation of at least 0, got {deviation:g}.")
        return mean, deviation
    return number(value, where)


def _of_ours(tree: JsonObject, name: str) -> dict[str, float | tuple[float, float]]:
    std = fields_of(tree.get("std"))
    values: dict[str, float | tuple[float, float]] = {}
    for key, value in fields_of(tree["parameters"]).items():
        mean = number(value, f"{name}, parameters, {short(key)}")
        deviation = number(std[key], f"{name}, std, {short(key)}") if key in std else 0.0
        values[key] = (mean, deviation) if deviation > 0 else mean
    return values


def _model(tree: JsonObject, name: str) -> str | None:
    for key in ("model", "camera_model", "distortion_model"):
        if tree.get(key):
            return model_called(str(tree[key]), f"{name}, {key}")
    return "fisheye" if tree.get("fisheye_model") == 1 else None


def _size(tree: JsonObject, name: str) -> tuple[int, int] | None:
    if "image_size" in tree:
        given = fields_of(tree["image_size"])
        value = [given.get("width"), given.get("height")] if given else items_of(tree["image_size"])
        if len(value) != 2:
            raise InputError(f"{name}, image_size: expected width and height, got {got(tree['image_size'])}.")
    elif {"image_width", "image_height"} <= set(tree):
        value = [tree["image_width"], tree["image_height"]]
    elif {"width", "height"} <= set(tree):  # a message of ROS
        value = [tree["width"], tree["height"]]
    else:
        return None
    width, height = (number(part, f"{name}, image size") for part in value)
    return int(width), int(height)


def _of_opencv(tree: JsonObject, name: str, model: str | None, size: tuple[int, int] | None) -> KnownIntrinsics:
    """Return the intrinsics of a camera matrix and coefficients in OpenCV's order, of a ``camera_info`` as sent."""
    key = next(key for key in _MATRIX if key in tree)
    K = stack(tree[key], f"{name}, {key}").reshape(-1)
    if K.size != 9 or abs(K[1]) > 0 or K[3] != 0 or K[6] != 0 or K[7] != 0 or K[8] != 1:
        raise InputError(f"{name}, {key}: expected [fx 0 cx; 0 fy cy; 0 0 1], got other numbers.")
    key = next((key for key in _COEFFICIENTS if key in tree), "")
    d = stack(tree[key], f"{name}, {key}").reshape(-1) if key else np.zeros(0)
    if model is None:
        if d.size == 4 and d.any():
            raise InputError(
                f"{name}, {key}: four coefficients are those of brown (k1, k2, p1, p2) or of fisheye (k1 to k4), and "
                "the file does not say which. Add --model brown or --model fisheye."
            )
        model = "brown" if d.any() else "pinhole"
    if model == "fisheye" and d.size != 4:
        raise InputError(f"{name}: expected the 4 coefficients of a fisheye, got {d.size}.")
    linear = [float(K[0]), float(K[4]), float(K[2]), float(K[5])]
    model, values = values_of(model, linear, d.tolist(), f"{name}, {key}" if key else name)
    known: dict[str, float | tuple[float, float]] = dict(values)
    if (given := next((key for key in _DEVIATIONS if key in tree), None)) is not None:
        sd = stack(tree[given], f"{name}, {given}").reshape(-1)
        if sd.size > 1 and sd[0] == 0 < sd[1]:  # OpenCV with a fixed aspect ratio: fx is the ratio times fy.
            sd[0] = sd[1] * K[0] / K[4]
        stated = {key: float(s) for key, s in zip(MODELS[model].names, sd, strict=False) if s > 0}
        known |= {key: (values[key], s) for key, s in stated.items() if key in values}
    roi, per = fields_of(tree.get("roi")), [int(number(tree.get(f"binning_{axis}", 0), name)) for axis in "xy"]
    if size is None or not (any(roi.values()) or max(per) > 1):
        return KnownIntrinsics(known, model, size)
    x, y, width, height = (int(number(roi.get(part, 0), name)) for part in ("x_offset", "y_offset", "width", "height"))
    known, size = camera_info_region(known, size, (x, y, width, height), (per[0], per[1]))
    return KnownIntrinsics(known, model, size, f"roi {width} x {height} from ({x}, {y}), binning {per[0]} x {per[1]}")


# ------------------------------------------------------------------------------------------------------- texts


def opencv_text(cam: Calibrated) -> str:
    """Format intrinsics as OpenCV reads them; its models and the order of its coefficients are ours."""
    return "\n".join(
        [
            "%YAML:1.0",
            "---",
            f"image_width: {cam.image_size[0]}",
            f"image_height: {cam.image_size[1]}",
            f'camera_model: "{cam.model}"',
            f'comment: "{_comment(cam)}"',
            *matrix_lines("camera_matrix", camera_matrix(cam)),
            *matrix_lines("distortion_coefficients", coefficients_of(cam)),
            "",
        ]
    )


# Functions of OpenCV that project by each model; others have none.
_FUNCTIONS = {"pinhole": "cv2", "brown": "cv2", "brown_full": "cv2", "fisheye": "cv2.fisheye"}


def _functions(cam: Calibrated) -> str:
    """Return which functions the coefficients are for."""
    if cam.model in _FUNCTIONS:
        return f"the functions of {_FUNCTIONS[cam.model]}"
    return f"the model {cam.model}, which OpenCV does not have"


def coefficients_of(cam: Calibrated) -> Array:
    """(c, 1): as OpenCV takes them, 5, 8 or 14 of Brown, 4 of fisheye, 5 zeros of a pinhole; all of other models."""
    d = np.array([cam.intrinsics[name] for name in cam.bundle.model.coefficients])
    if cam.model == "pinhole":
        d = np.zeros(5)
    elif cam.model in ("brown", "brown_full"):
        d = d[: next(count for count in (5, 8, 14) if not d[count:].any())]
    return np.asarray(d[:, None])


def _comment(cam: Calibrated) -> str:
    names = ", ".join(cam.bundle.model.coefficients[: len(coefficients_of(cam))]) or "none, zeros"
    return f"by uq-handeye: pixels, the first pixel's centre at (0, 0); for {_functions(cam)}; coefficients {names}"


PIXELS = "Pixels; the centre of the first pixel is at (0, 0), as in OpenCV."


def camera_snippets(cam: Calibrated) -> list[Snippet]:
    """OpenCV's FileStorage, ROS's camera_info and Python."""
    functions = _functions(cam)
    return [
        Snippet("OpenCV FileStorage (YAML)", f"{PIXELS} For {functions}.", opencv_text(cam), "yaml"),
        Snippet(
            "ROS camera_info (YAML)",
            f"{PIXELS} The distortion model is {ros_model(cam)}; put the name of your own camera in.",
            ros_text(cam),
            "yaml",
        ),
        Snippet(
            "Python",
            f"{PIXELS} K and d for {functions}; the covariance is that of {', '.join(cam.estimated) or 'nothing'}, in "
            "this order.",
            _python_text(cam),
            "python",
        ),
    ]


def ros_model(cam: Calibrated) -> str:
    """Return the name of the model in ROS."""
    if cam.model == "fisheye":
        return "equidistant"
    if cam.model not in _FUNCTIONS:
        return cam.model
    return "plumb_bob" if len(coefficients_of(cam)) == 5 else "rational_polynomial"


def ros_text(cam: Calibrated) -> str:
    """A camera_info file; no rectification, and P is K with a column of zeros."""
    K, d = camera_matrix(cam), coefficients_of(cam)
    entries = {
        "camera_matrix": K,
        "distortion_coefficients": d.T,
        "rectification_matrix": np.eye(3),
        "projection_matrix": np.hstack([K, np.zeros((3, 1))]),
    }
    lines = [f"image_width: {cam.image_size[0]}", f"image_height: {cam.image_size[1]}", "camera_name: camera"]
    for name, M in entries.items():
        if name == "distortion_coefficients":
            lines.append(f"distortion_model: {ros_model(cam)}")
        data = ", ".join(yaml_number(float(x)) for x in M.ravel())
        lines += [f"{name}:", f"  rows: {M.shape[0]}", f"  cols: {M.shape[1]}", f"  data: [{data}]"]
    return "\n".join(lines) + "\n"


def camera_matrix(cam: Calibrated) -> Array:
    """K (3, 3)."""
    value = cam.intrinsics
    return np.array([[value["fx"], 0.0, value["cx"]], [0.0, value["fy"], value["cy"]], [0.0, 0.0, 1.0]])


def _python_text(cam: Calibrated) -> str:
    free = np.isin(cam.bundle.model.names, cam.estimated)
    rows = [
        "import numpy as np",
        "",
        f"K = {_array(camera_matrix(cam), 4)}",
        f"d = np.array([{_row(coefficients_of(cam).ravel())}])",
    ]
    if free.any():
        rows.append(f"covariance = {_array(cam.bundle.intrinsics_covariance[np.ix_(free, free)], 13)}")
    return "\n".join(rows) + "\n"


def _array(M: Array, indent: int) -> str:
    return "np.array([" + (",\n" + " " * (indent + 10)).join(f"[{_row(row)}]" for row in M) + "])"


def _row(values: Array) -> str:
    return ", ".join(short_number(float(x)) for x in values)
