"""Dictionaries of markers in OpenCV, and which way up OpenCV draws the tags of AprilTag's families."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.files.one_line import short
from ...errors import InputError
from .adjustment.opencv import opencv

# Code of the first tag of each family, row by row from its upper left, white 1, as AprilTag defines it.
APRILTAGS = {"APRILTAG_16H5": 0x231B, "APRILTAG_25H9": 0x155CBF1, "APRILTAG_36H10": 0x1CA92A687}


APRILTAGS |= {"APRILTAG_36H11": 0xD5D628584}


def dictionary_name(name: Any) -> str:
    """Return the name that OpenCV has, in capitals and without ``DICT_``, of one such as ``tag36h11`` or ``4x4_50``."""
    text = str(name).upper().removeprefix("DICT_").removeprefix("TAG")
    return f"APRILTAG_{text}" if f"APRILTAG_{text}" in APRILTAGS else text


def dictionary_of(name: Any) -> Any:
    """Return a predefined dictionary of OpenCV; raises `InputError` for other names."""
    aruco = opencv().aruco
    known = {key.removeprefix("DICT_").upper(): key for key in sorted(dir(aruco)) if key.startswith("DICT_")}
    if (text := dictionary_name(name)) not in known:
        names = ", ".join(key.removeprefix("DICT_") for key in known.values())
        raise InputError(f"Expected `dictionary` to be one of {names}, got {short(str(name))}.")
    return aruco.getPredefinedDictionary(getattr(aruco, known[text]))


def bits_of(words: Any, number: int) -> NDArray[np.bool_]:
    """Return the bits (k, k) of a marker as OpenCV draws it, white True, without its border."""
    cells = words.markerSize + 2
    drawn = np.asarray(words.generateImageMarker(number, 4 * cells, borderBits=1))
    return np.asarray(drawn[2::4, 2::4] > 127)[1:-1, 1:-1]


def drawn_upside_down(name: Any) -> bool:
    """Return whether OpenCV draws the tags of a family half a turn from how AprilTag does: version 4 did so."""
    if (code := APRILTAGS.get(dictionary_name(name))) is None:
        return False
    bits = bits_of(dictionary_of(name), 0)
    upright = np.array([code >> k & 1 for k in reversed(range(bits.size))], dtype=bool).reshape(bits.shape)
    return bool((bits[::-1, ::-1] == upright).all())
