r"""Intrinsics for pictures of another resolution, or for a part of the picture that they are of.

With pixels counted from the centre of the first one, a picture whose pixels are those of another one times s, and that
begins at the pixel (x, y) of it, has

    f' = s f,      c' = s (c - x + 1/2) - 1/2

as the corner of the first pixel, at -1/2, stays where it is. Coefficients of the lens do not change.
"""

from __future__ import annotations

import numpy as np

from ...errors import InputError
from .adjustment.setting import Known
from .known_intrinsics import KnownIntrinsics

# Two pictures have the same aspect where the ratios of their widths and heights differ by no more than this share, as
# sizes are rounded to pixels.
MAX_ASPECT_DIFFERENCE = 5e-3
# Pictures of the depth camera of Azure Kinect: first pixel in the sensor of 1024 x 1024, sensor pixels per pixel.
_AZURE_DEPTH = {(640, 576): (192, 180, 1), (320, 288): (192, 180, 2), (512, 512): (0, 0, 2)}
_AZURE_SENSOR = (1024, 1024)


Pair = tuple[float, float]


def moved(values: Known, offset: Pair, scale: Pair) -> dict[str, float | Pair]:
    """Return intrinsics for the picture that begins at ``offset`` (px), each pixel ``1 / scale`` of the others."""

    def at(name: str, value: float) -> float:
        s = scale["xy".index(name[1])]
        return s * value if name[0] == "f" else s * (value - offset["xy".index(name[1])] + 0.5) - 0.5

    found: dict[str, float | Pair] = {}
    for name, entry in values.items():
        if name not in ("fx", "fy", "cx", "cy"):
            found[name] = entry
        elif np.ndim(entry) == 0:
            found[name] = at(name, float(np.asarray(entry)))
        else:
            mean, sd = np.ravel(entry).tolist()
            found[name] = at(name, mean), scale["xy".index(name[1])] * sd
    return found


def camera_info_region(
    values: Known, size: tuple[int, int], roi: tuple[int, int, int, int], binning: tuple[int, int]
) -> tuple[dict[str, float | Pair], tuple[int, int]]:
    """Return the intrinsics and the size of the pictures of a ``camera_info``, whose K is of the full picture.

    ``roi`` is x_offset, y_offset, width and height in pixels of the full picture, 0 where all of it is sent;
    ``binning`` the pixels that are one along x and y, 0 as 1. Source: ``sensor_msgs/msg/CameraInfo.msg``.
    """
    x, y, width, height = roi
    per = max(binning[0], 1), max(binning[1], 1)
    whole = (width or size[0]) // per[0], (height or size[1]) // per[1]
    return moved(values, (x, y), (1.0 / per[0], 1.0 / per[1])), whole


def for_pictures(
    known: KnownIntrinsics, size: tuple[int, int] | None, roi: tuple[int, int, int, int] | None, name: str
) -> KnownIntrinsics:
    """Return the intrinsics of a file for pictures of ``size``, that show the part ``roi`` of the file's picture.

    Raises `InputError` where the pictures have another aspect, so that they show a part that the file does not name.
    """
    if roi is not None:
        x, y, width, height = roi
        whole = known.image_size
        if min(x, y) < 0 or min(width, height) <= 0:
            raise InputError(f"Expected --roi to be X,Y,WIDTH,HEIGHT in pixels of the picture of {name}, got {roi}.")
        if whole is not None and (x + width > whole[0] or y + height > whole[1]):
            raise InputError(f"--roi {','.join(map(str, roi))} is beyond the {whole[0]} x {whole[1]} pixels of {name}.")
        part = f"part {width} x {height} from ({x}, {y})"
        known = known._replace(values=moved(known.values, (x, y), (1.0, 1.0)), image_size=(width, height), how=part)
    before = known.image_size
    if size is None or before is None or before == size:
        return known
    how = f"{known.how}, " if known.how else ""
    if known.sensor_of_43 and before == _AZURE_SENSOR and size in _AZURE_DEPTH:
        x, y, per = _AZURE_DEPTH[size]
        values = moved(known.values, (x, y), (1.0 / per, 1.0 / per))
        return known._replace(values=values, image_size=size, how=f"{how}the part of the sensor of this mode")
    ratio = size[0] / before[0], size[1] / before[1]
    if known.sensor_of_43 and ratio[1] < ratio[0]:  # rows are cut above and below
        cut = 0.5 * (before[1] - size[1] / ratio[0])
        values = moved(known.values, (0.0, cut), (ratio[0], ratio[0]))
        return known._replace(values=values, image_size=size, how=f"{how}rows cut from 4:3, scaled by {ratio[0]:.4g}")
    if abs(ratio[0] / ratio[1] - 1.0) > MAX_ASPECT_DIFFERENCE:
        raise InputError(
            f"{name} is for pictures of {before[0]} x {before[1]} pixels, got {size[0]} x {size[1]}, another aspect: a "
            "part of them. Add --roi X,Y,WIDTH,HEIGHT, the part of the file's picture that the pictures show."
        )
    how = f"{how}scaled by {ratio[0]:.4g} from {before[0]} x {before[1]}"
    return known._replace(values=moved(known.values, (0.0, 0.0), ratio), image_size=size, how=how)
