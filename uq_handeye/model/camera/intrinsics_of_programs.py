"""Intrinsics in the files of other programs, in pixels and coefficients of this one.

Each program has keys by which its files are recognised. What they mean was measured with the programs themselves:

| file | first pixel's centre | coefficients |
|---|---|---|
| librealsense (``ppx``, ``coeffs``), lensboy, Kalibr | 0 | OpenCV's, or as the model says |
| camera-intrinsic-calibration | 0 | by name |
| depthai | 0 | OpenCV's 14 |
| Azure Kinect (k4a) | 0.5, in shares of the sensor | k1 to k6, two unused, p2, p1 |
| COLMAP, nerfstudio | 0.5 | those of the model |
| open3d | 0, matrix by columns | none |
| aniposelib, caliscope (TOML), multical, vision-calibration | 0 | OpenCV's; k1, k2, k3, p1, p2 of the last by name |

A model that is not one of `models` is refused with its name.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ...core.files.json_values import Json, JsonObject
from ...core.files.one_line import OF_DATA, refused, short
from ...core.files.tree_values import fields_of, got, is_list, is_map, is_plain_number, item, items_of, number, vector
from ...errors import InputError
from .models import CORNER_PX, LINEAR, MODELS

T = TypeVar("T")
# Coefficients in OpenCV's order, by their number.
BROWN = MODELS["brown_full"].coefficients
# What programs call the models; None: no distortion.
MODEL_NAMES: dict[str, str | None] = {
    "pinhole": "pinhole",
    "none": "pinhole",
    "": "pinhole",
    "brown": "brown",
    "radtan": "brown",
    "plumb_bob": "brown",
    "rational_polynomial": "brown",
    "brown_conrady": "brown",
    "modified_brown_conrady": "brown",
    "standard": "brown",
    "rational": "brown",
    "opencv": "brown",
    "full_opencv": "brown",
    "radial": "brown",
    "simple_radial": "brown",
    "simple_pinhole": "pinhole",
    "perspective": "brown",
    "brown_conrady5": "brown",
    "inverse_brown_conrady": "inverse_brown",
    "inverse_brown": "inverse_brown",
    "fisheye": "fisheye",
    "equidistant": "fisheye",
    "equi": "fisheye",
    "kannala_brandt": "fisheye",
    "kannala_brandt4": "fisheye",
    "kannalabrandt4": "fisheye",
    "opencv_fisheye": "fisheye",
    "thin_prism": "brown_full",
    "brown_full": "brown_full",
    "tilted": "brown_full",
    "fisheye624": "fisheye624",
    "rad_tan_thin_prism_fisheye": "fisheye624",
}


class Found(NamedTuple):
    """Intrinsics of one camera in a file."""

    model: str
    values: dict[str, float]
    image_size: tuple[int, int] | None
    sensor_of_43: bool = False  # whether pictures of another aspect are cut out of a picture of 4:3


def model_called(text: str, where: str) -> str:
    """Return the model of this package that a file names; raises `InputError` for another one."""
    name = text.strip().lower().replace("-", "_").removeprefix("distortion.").removeprefix("rs2_distortion_")
    name = name.replace(" ", "_")
    if (found := MODEL_NAMES.get(name)) is None:
        raise InputError(
            f"{where}: the camera model {short(text)} is not one that is known here ({', '.join(MODELS)}). Calibrate "
            "the camera from pictures in place of --intrinsics."
        )
    return found


def values_of(model: str, linear: Sequence[float], d: Sequence[float], where: str) -> tuple[str, dict[str, float]]:
    """Return the model and its values by name, of coefficients in the order of that model; trailing zeros are none.

    Brown's 12 or 14 coefficients are those of ``brown_full`` where more than the first eight are not 0. Raises
    `InputError` where there are more coefficients, not 0, than the model has.
    """
    coefficients = list(map(float, d))
    while len(coefficients) > len(MODELS[model].coefficients) and coefficients[-1] == 0.0:
        coefficients.pop()
    if model == "brown" and len(coefficients) > len(MODELS["brown"].coefficients):
        model = "brown_full"
    if model == "pinhole" and any(coefficients):
        raise InputError(f"{where}: a camera without distortion has no coefficients, got {short(str(coefficients))}.")
    names = MODELS[model].coefficients
    if len(coefficients) > len(names):
        raise InputError(
            f"{where}: the model {model} has the coefficients {', '.join(names) or 'none'}; got {len(coefficients)} "
            "numbers, others than 0 beyond."
        )
    if model in ("fisheye", "fisheye624") and len(coefficients) != len(names):
        raise InputError(f"{where}: expected {len(names)} coefficients of the model {model}, got {len(coefficients)}.")
    values = dict(zip(LINEAR, map(float, linear), strict=True))
    return model, values | dict(zip(names, coefficients, strict=False))


def found_of(
    called: str, linear: Sequence[float], d: Sequence[float], size: Any, where: str, first_pixel: float = 0.0
) -> Found:
    """Return the intrinsics of a camera whose file names the model and counts pixels from ``first_pixel``."""
    fx, fy, cx, cy = map(float, linear)
    model, values = values_of(model_called(called, where), (fx, fy, cx - first_pixel, cy - first_pixel), d, where)
    return Found(model, values, _size(size, where))


def _size(value: Any, where: str) -> tuple[int, int] | None:
    if value is None:
        return None
    if is_map(value):
        value = [item(value, "width", where), item(value, "height", where)]
    width, height = (int(part) for part in vector(list(value), 2, f"{where}, image size"))
    return width, height


class _Program(NamedTuple):
    """A program: how its files are recognised, the cameras in one by name, and the intrinsics of a camera."""

    recognised: Callable[[JsonObject], object]
    cameras: Callable[[JsonObject], Mapping[str, JsonObject]]
    read: Callable[[JsonObject, str], Found]


def intrinsics_of_program(tree: JsonObject, name: str, camera: str | None = None) -> Found | None:
    """Return the intrinsics in a file of another program; None where it is of none of them.

    ``camera`` chooses one of several. Raises `InputError` for a camera that is not there, or for one that is not named
    among several.
    """
    for program in _PROGRAMS:
        if program.recognised(tree):
            key, of = _chosen(program.cameras(tree), camera, name)
            with refused(f"{name}: not what this program writes", OF_DATA):
                return program.read(of, f"{name}, {key}" if key else name)
    return None


def _chosen(cameras: Mapping[str, T], camera: str | None, name: str) -> tuple[str, T]:
    if camera is None and len(cameras) == 1:
        return next(iter(cameras.items()))
    if camera is None or camera not in cameras:
        asked = "several cameras" if camera is None else f"no camera {short(camera)}"
        raise InputError(
            f"{name} holds {asked}: name one behind a colon, such as {name}:{next(iter(cameras), 'cam0')}. There are "
            f"{', '.join(cameras)}."
        )
    return camera, cameras[camera]


def _single(tree: JsonObject) -> dict[str, JsonObject]:
    """Return the one camera of a file."""
    return {"": tree}


def _numbers(value: Json, where: str) -> list[float]:
    """Return the numbers of a list, nested or not."""
    if not is_list(value):
        raise InputError(f"{where}: expected a list of numbers, got {got(value)}.")
    found: list[float] = []
    for part in value:
        found += _numbers(part, where) if is_list(part) else [number(part, where)]
    return found


def _matrix(value: Json, where: str) -> list[float]:
    """fx, fy, cx, cy of a camera matrix by rows; raises `InputError` for a skewed one."""
    K = _numbers(value, where)
    if len(K) != 9 or K[1] != 0 or K[3] != 0 or K[6:] != [0, 0, 1]:
        raise InputError(f"{where}: expected [fx 0 cx; 0 fy cy; 0 0 1], got other numbers.")
    return [K[0], K[4], K[2], K[5]]


def _of(tree: JsonObject, keys: str, where: str) -> list[float]:
    return [number(item(tree, key, where), f"{where}, {key}") for key in keys.split()]


def _realsense(tree: JsonObject, name: str) -> Found:
    size = None if "width" not in tree else [tree["width"], tree.get("height")]
    linear = _of(tree, "fx fy ppx ppy", name)
    return found_of(str(tree.get("model", "")), linear, _numbers(tree.get("coeffs", []), name), size, name)


def _lensboy(tree: JsonObject, name: str) -> Found:
    size = [tree["image_width"], tree["image_height"]]
    return found_of(
        str(tree["type"]), _of(tree, "fx fy cx cy", name), _numbers(tree["distortion_coeffs"], name), size, name
    )


def _rust_models(tree: JsonObject, name: str) -> Found:
    """camera-intrinsic-calibration: the model is the key, its numbers the value."""
    ((called, numbers),) = tree.items()
    of = fields_of(numbers)
    names = {"OpenCVModel5": ("brown", "k1 k2 p1 p2 k3"), "KannalaBrandt4": ("fisheye", "k1 k2 k3 k4")}
    if called not in names:
        raise InputError(
            f"{name}: the camera model {short(called)} is not one that is known here ({', '.join(MODELS)})."
        )
    model, keys = names[called]
    size = [item(of, key, name) for key in (("w", "h") if "w" in fields_of(of) else ("width", "height"))]
    return found_of(model, _of(of, "fx fy cx cy", name), _of(of, keys, name), size, name)


def _kalibr_cameras(tree: JsonObject) -> dict[str, JsonObject]:
    names = {"distortion_model", "camera_model"}
    return {key: of for key, of in tree.items() if is_map(of) and "intrinsics" in of and names & set(of)}


def _kalibr(of: JsonObject, where: str) -> Found:
    called = str(of.get("camera_model", "pinhole"))
    if called != "pinhole":
        raise InputError(f"{where}: the camera model {short(called)} of Kalibr is not known here; use pinhole.")
    linear = vector(of["intrinsics"], 4, f"{where}, intrinsics")
    lens = str(of.get("distortion_model", "none"))
    return found_of(lens, linear, _numbers(of.get("distortion_coeffs", []), where), of.get("resolution"), where)


def _azure_cameras(tree: JsonObject) -> dict[str, JsonObject]:
    cameras = map(fields_of, items_of(fields_of(tree["CalibrationInformation"]).get("Cameras")))
    named = [(str(of.get("Location", "")).removeprefix("CALIBRATION_CameraLocation"), of) for of in cameras]
    return {key: of for key, of in named if "Intrinsics" in of}


def _azure(of: JsonObject, where: str) -> Found:
    """k4a: shares of the sensor, pixels counted from the corner; the picture of 4:3 for the colour camera."""
    intrinsics = fields_of(of["Intrinsics"])
    p, called = _numbers(intrinsics["ModelParameters"], where), str(intrinsics.get("ModelType", ""))
    if len(p) < 14 or "BrownConrady" not in called:
        raise InputError(
            f"{where}: expected CALIBRATION_LensDistortionModelBrownConrady with 14 parameters, got {short(called)} "
            f"with {len(p)}: the rational model Rational6KT is another one."
        )
    if p[10] or p[11]:
        raise InputError(f"{where}: codx and cody, a centre of distortion of its own, are not known here.")
    width, height = number(of.get("SensorWidth", 4096), where), number(of.get("SensorHeight", 3072), where)
    linear = (p[2] * width, p[3] * height, p[0] * width, p[1] * height)
    found = found_of("brown", linear, [p[4], p[5], p[13], p[12], *p[6:10]], [width, height], where, CORNER_PX)
    return found._replace(sensor_of_43=True)


def _depthai_cameras(tree: JsonObject) -> dict[str, JsonObject]:
    pairs = [pair for pair in map(items_of, items_of(tree["cameraData"])) if len(pair) == 2]
    named = [(str(int(key) if is_plain_number(key) else key), fields_of(of)) for key, of in pairs]
    return {key: of for key, of in named if of.get("width")}


def _depthai(of: JsonObject, where: str) -> Found:
    wide = of.get("cameraType") in (1, "Fisheye", "FISHEYE")
    d = _numbers(of.get("distortionCoeff", []), where)
    linear = _matrix(of["intrinsicMatrix"], f"{where}, intrinsicMatrix")
    return found_of("fisheye" if wide else "brown", linear, d[:4] if wide else d, [of["width"], of["height"]], where)


# Coefficients of COLMAP's models behind the linear parameters, by their number of focal lengths.
_COLMAP = {
    "SIMPLE_PINHOLE": 1, "PINHOLE": 2, "SIMPLE_RADIAL": 1, "RADIAL": 1, "OPENCV": 2, "OPENCV_FISHEYE": 2,
    "FULL_OPENCV": 2, "RAD_TAN_THIN_PRISM_FISHEYE": 2,
}  # fmt: skip


def intrinsics_of_colmap(text: str, name: str, camera: str | None) -> Found | None:
    """Return the intrinsics in COLMAP's ``cameras.txt``; None for another text."""
    lines = [line.split() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines or not all(len(words) >= 7 and re.fullmatch(r"[A-Z_]+", words[1]) for words in lines):
        return None
    key, words = _chosen({words[0]: words for words in lines}, camera, name)
    where, called = f"{name}, camera {key}", words[1]
    if called not in _COLMAP:
        raise InputError(f"{where}: the camera model {called} of COLMAP is not known here ({', '.join(_COLMAP)} are).")
    try:
        width, height, *p = map(float, words[2:])
    except ValueError as error:
        raise InputError(f"{where}: expected CAMERA_ID MODEL WIDTH HEIGHT PARAMS, got other words.") from error
    f, rest = p[: _COLMAP[called]], p[_COLMAP[called] :]
    if len(rest) < 2:
        raise InputError(f"{where}: expected the parameters of {called}, got {len(p)} numbers.")
    return found_of(called, [f[0], f[-1], *rest[:2]], rest[2:], [width, height], where, CORNER_PX)


def _nerfstudio(tree: JsonObject, name: str) -> Found:
    called = str(tree.get("camera_model", "OPENCV"))
    names = ("k1", "k2", "k3", "k4") if "FISHEYE" in called else ("k1", "k2", "p1", "p2", "k3")
    if "FISHEYE" not in called and tree.get("k4"):
        raise InputError(f"{name}: k4 of nerfstudio's model {called} is not known here.")
    d = [number(tree.get(key, 0.0), f"{name}, {key}") for key in names]
    size = [tree["w"], tree["h"]] if {"w", "h"} <= set(tree) else None
    fy = tree.get("fl_y", tree["fl_x"])
    linear = [number(value, name) for value in (tree["fl_x"], fy, item(tree, "cx", name), item(tree, "cy", name))]
    return found_of(called if called in ("OPENCV_FISHEYE", "PINHOLE") else "OPENCV", linear, d, size, name, CORNER_PX)


def _open3d(tree: JsonObject, name: str) -> Found:
    of = fields_of(tree.get("intrinsic")) or tree
    K = np.reshape(vector(item(of, "intrinsic_matrix", name), 9, f"{name}, intrinsic_matrix"), (3, 3)).T
    return found_of("pinhole", _matrix(K.tolist(), name), [], [of["width"], of["height"]], name)


def _tables(tree: JsonObject) -> dict[str, JsonObject]:
    """Return the cameras of aniposelib and caliscope (matrix, distortions, size) and of multical (K, dist)."""
    inner = fields_of(tree.get("cameras")) or tree
    tables = {key: fields_of(of) for key, of in inner.items()}
    names = {"matrix", "distortions"}, {"K", "dist"}
    return {str(of.get("name", key)): of for key, of in tables.items() if any(keys <= set(of) for keys in names)}


def _of_table(of: JsonObject, where: str) -> Found:
    d = _numbers(of.get("distortions", of.get("dist")) or [], where)
    wide = of.get("fisheye") is True or "fisheye" in str(of.get("model", ""))
    K = _matrix(of.get("matrix", of.get("K")), where)
    return found_of("fisheye" if wide else "brown", K, d, of.get("size", of.get("image_size")), where)


def _vision_cameras(tree: Json, path: str = "") -> dict[str, JsonObject]:
    """Return what vision-calibration writes of each camera, wherever in a result."""
    if is_map(tree) and "fx_fy_cx_cy_skew" in str(fields_of(tree.get("intrinsics")).get("type", "")):
        return {path or "camera": tree}
    parts = list(fields_of(tree).items()) or [(str(k), part) for k, part in enumerate(items_of(tree))]
    found: dict[str, JsonObject] = {}
    for key, part in parts:
        found |= _vision_cameras(part, f"{path}.{key}" if path else key)
    return found


def _vision(of: JsonObject, where: str) -> Found:
    k, d = fields_of(of["intrinsics"]), fields_of(of.get("distortion"))
    if k.get("skew") or fields_of(of.get("sensor")).get("type", "identity") != "identity":
        raise InputError(f"{where}: a skewed or a tilted sensor of vision-calibration is not known here.")
    called = str(d.get("type", "brown_conrady5" if d else "none"))
    names = MODELS["brown_full" if called == "thin_prism" else model_called(called, where)].coefficients
    values = [number(d.get(key, 0.0), f"{where}, {key}") for key in names]
    return found_of(called, _of(k, "fx fy cx cy", where), values, None, where)


_RUST = {"UCM", "EUCM", "EUCMT", "OpenCVModel5", "KannalaBrandt4", "Ftheta", "FovCamera"}
_PROGRAMS = (
    _Program(lambda tree: {"ppx", "ppy"} <= set(tree), _single, _realsense),
    _Program(lambda tree: {"distortion_coeffs", "type"} <= set(tree), _single, _lensboy),
    _Program(lambda tree: len(tree) == 1 and _RUST & set(tree), _single, _rust_models),
    _Program(lambda tree: "CalibrationInformation" in tree, _azure_cameras, _azure),
    _Program(lambda tree: "cameraData" in tree, _depthai_cameras, _depthai),
    _Program(lambda tree: "fl_x" in tree, _single, _nerfstudio),
    _Program(lambda tree: "intrinsic_matrix" in {*tree, *fields_of(tree.get("intrinsic"))}, _single, _open3d),
    _Program(_kalibr_cameras, _kalibr_cameras, _kalibr),
    _Program(_tables, _tables, _of_table),
    _Program(_vision_cameras, _vision_cameras, _vision),
)
