"""Intrinsics as texts that people copy into other programs, each with its convention and units beside it.

Sources of the rules: OpenCV, ``calibrateCamera`` and ``fisheye`` (docs.opencv.org, calib3d); ROS,
``sensor_msgs/msg/CameraInfo.msg`` (ros2/common_interfaces) and the files of ``camera_calibration_parsers``.
"""

from __future__ import annotations

import numpy as np

from ....core.formatting.snippets import Snippet, short
from ....core.geometry.se3 import Array
from ....formats.opencv_storage import yaml_number
from ..calibrated import Calibrated
from .intrinsics_file import coefficients_of, opencv_text

PIXELS = "Pixels; the centre of the first pixel is at (0, 0), as in OpenCV."


def camera_snippets(cam: Calibrated) -> list[Snippet]:
    """OpenCV's FileStorage, ROS's camera_info and Python."""
    functions = "cv2.fisheye" if cam.model == "fisheye" else "cv2"
    return [
        Snippet("OpenCV FileStorage (YAML)", f"{PIXELS} For the functions of {functions}.", opencv_text(cam), "yaml"),
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
    return "rational_polynomial" if len(coefficients_of(cam)) == 8 else "plumb_bob"


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
    return ", ".join(short(float(x)) for x in values)
