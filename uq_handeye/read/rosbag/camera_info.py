"""Intrinsics of a camera as the messages ``sensor_msgs/CameraInfo`` and ``foxglove.CameraCalibration`` have them.

Fields of ROS 1 (K, D, P) and ROS 2 (k, d, p) as in ``sensor_msgs/msg/CameraInfo.msg`` of ros2/common_interfaces: K and
D are of the picture as taken, P of the rectified one, in which no distortion is left. Both are of the full picture:
``roi`` and ``binning`` say which part of it was sent, and how many pixels are one. The fourth column of P,
``-fx B``, belongs to the second camera of a rectified pair, B beside the first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...core.geometry.se3 import Array
from ...errors import InputError
from ...formats.ros_messages import MessageError, part, when_and_where
from ...model.camera.intrinsics_of_programs import values_of
from ...model.camera.models import LINEAR, MODELS, CameraModel
from ...model.camera.picture_region import camera_info_region
from .message_types import RosMessage

# Distortion models of this package by the names that ROS gives them.
NAMES = {
    "plumb_bob": "brown",
    "rational_polynomial": "brown",
    "fisheye": "fisheye",
    "equidistant": "fisheye",
    "kannala_brandt": "fisheye",
    "": "brown",
}


@dataclass(frozen=True, eq=False)
class CameraInfo:
    """Camera matrix and distortion of the picture as taken, and the matrix of the rectified one."""

    frame: str
    image_size: tuple[int, int]
    model: str
    K: Array  # (4,) fx, fy, cx, cy
    D: Array
    P: Array  # (4,) fx, fy, cx, cy; 0 where it is not given
    baseline: float = 0.0  # m, of the second camera of a rectified pair from the first, along x

    def like(self, other: CameraInfo) -> bool:
        """Return whether the numbers are the same."""
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in ("K", "D", "P"))

    @property
    def rectified(self) -> bool:
        """True if there is a matrix of the rectified picture."""
        return bool(self.P[0] > 0 and self.P[1] > 0)

    @property
    def distorted(self) -> bool:
        """True if the picture as taken has a distortion of a model that is known."""
        return bool(self.D.any()) and self.model in NAMES

    def linear(self) -> Array:
        """(4,) fx, fy, cx, cy of the picture in which tags are detected: the rectified one where it is known."""
        return self.P if self.rectified else self.K

    def lens(self) -> tuple[CameraModel, Array]:
        """Return the model and its parameters for pixels of that picture."""
        if self.rectified or not self.D.any():
            return MODELS["pinhole"], self.linear()
        if self.model not in NAMES:
            raise InputError(
                f"The camera_info of {self.frame} has the distortion model {self.model}; known are "
                f"{', '.join(filter(None, NAMES))}. Detect in rectified pictures, or give --camera-matrix."
            )
        if not self.model and self.D.size == 4:
            raise InputError(
                f"The camera_info of {self.frame} has four coefficients and no distortion_model: brown or fisheye? "
                "Give --camera-matrix."
            )
        name, values = values_of(NAMES[self.model], self.K.tolist(), self.D.tolist(), f"camera_info of {self.frame}")
        model = MODELS[name]
        return model, np.array([values.get(key, 0.0) for key in model.names])

    def of_region(self, roi: tuple[int, int, int, int], binning: tuple[int, int]) -> CameraInfo:
        """Return the intrinsics of the picture as sent, by ``roi`` (x, y, width, height) and ``binning``."""

        def moved(linear: Array) -> tuple[Array, tuple[int, int]]:
            values, size = camera_info_region(
                dict(zip(LINEAR, linear.tolist(), strict=True)), self.image_size, roi, binning
            )
            return np.array([values[name] for name in LINEAR], dtype=float), size

        K, size = moved(self.K)
        return replace(self, image_size=size, K=K, P=moved(self.P)[0] if self.rectified else self.P)

    def text(self) -> str:
        """Return the matrix as --camera-matrix takes it: ``fx,fy,cx,cy``."""
        return ",".join(f"{float(value)!r}" for value in self.linear())


def camera_info_of(message: RosMessage) -> CameraInfo:
    """Return the intrinsics of a message; raises `MessageError` if it has none."""

    def numbers(*names: str) -> Array:
        value = next((found for name in names if (found := part(message, name)) is not None), ())
        return np.asarray(value, dtype=float).ravel()

    K, D, P = numbers("k", "K"), numbers("d", "D"), numbers("p", "P")
    if K.size != 9 or not np.isfinite(K).all() or K[0] <= 0 or K[4] <= 0 or not np.isfinite(D).all():
        raise MessageError("a camera matrix")
    P = P if P.size == 12 and np.isfinite(P).all() else np.zeros(12)
    size = int(part(message, "width") or 0), int(part(message, "height") or 0)
    frame = when_and_where(message)[1]
    model = str(part(message, "distortion_model") or "")
    baseline = -float(P[3] / P[0]) if P[0] > 0 else 0.0
    info = CameraInfo(frame, size, model, K[[0, 4, 2, 5]], D, P[[0, 5, 2, 6]], baseline)
    roi, per = part(message, "roi"), [int(part(message, f"binning_{axis}") or 0) for axis in "xy"]
    x, y, width, height = (
        int((None if roi is None else part(roi, name)) or 0) for name in ("x_offset", "y_offset", "width", "height")
    )
    if not (any((x, y, width, height)) or max(per) > 1):
        return info
    return info.of_region((x, y, width, height), (per[0], per[1]))


def camera_info_yaml(info: CameraInfo) -> str:
    """Return the intrinsics as --camera-matrix reads them, in the names of ``camera_calibration``."""
    fx, fy, cx, cy = info.linear().tolist()
    d = [] if info.rectified else info.D.tolist()
    lines = [
        f"image_width: {info.image_size[0]}",
        f"image_height: {info.image_size[1]}",
        f"distortion_model: {'plumb_bob' if info.rectified or not info.model else info.model}",
        f"camera_matrix: {{rows: 3, cols: 3, data: [{fx!r}, 0, {cx!r}, 0, {fy!r}, {cy!r}, 0, 0, 1]}}",
        f"distortion_coefficients: {{rows: 1, cols: {max(len(d), 5)}, data: {d or [0.0] * 5}}}",
    ]
    return "\n".join(lines) + "\n"
