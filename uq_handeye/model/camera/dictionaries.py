"""Dictionaries of markers in OpenCV, and the orientation in which OpenCV draws the tags of AprilTag's families."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from ...core.files.one_line import short
from ...errors import InputError
from .adjustment.opencv import opencv

if TYPE_CHECKING:
    from cv2.aruco import Dictionary

# Families of tags of AprilTag, as OpenCV names them.
APRILTAGS = ("APRILTAG_16H5", "APRILTAG_25H9", "APRILTAG_36H10", "APRILTAG_36H11")
# Code of the first tag of 36h11 as AprilTag defines it, row by row from its upper left, white 1.
FIRST_CODE_OF_36H11 = 0xD5D628584


def dictionary_name(name: str | None) -> str:
    """Return the name that OpenCV has, in capitals and without ``DICT_``, of one such as ``tag36h11`` or ``4x4_50``."""
    text = str(name).upper().removeprefix("DICT_").removeprefix("TAG")
    return f"APRILTAG_{text}" if f"APRILTAG_{text}" in APRILTAGS else text


def dictionary_names() -> list[str]:
    """Names of all predefined dictionaries of OpenCV, without ``DICT_``."""
    return [key.removeprefix("DICT_") for key in sorted(dir(opencv().aruco)) if key.startswith("DICT_")]


def dictionary_of(name: str | None) -> Dictionary:
    """Return a predefined dictionary of OpenCV; raises `InputError` for other names."""
    known = {key.upper(): key for key in dictionary_names()}
    if (text := dictionary_name(name)) not in known:
        raise InputError(f"Expected `dictionary` to be one of {', '.join(known.values())}, got {short(str(name))}.")
    aruco = opencv().aruco
    return cast("Dictionary", aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{known[text]}")))


def bits_of(words: Dictionary, number: int) -> NDArray[np.bool_]:
    """Return the bits (k, k) of a marker as OpenCV draws it, white True, without its border."""
    cells = words.markerSize + 2
    drawn = np.asarray(words.generateImageMarker(number, 4 * cells, borderBits=1))
    return np.asarray(drawn[2::4, 2::4] > 127)[1:-1, 1:-1]


def drawn_upside_down(name: str | None) -> bool:
    """Return whether OpenCV draws the tags of a family half a turn from how AprilTag does: version 4 draws all so."""
    if dictionary_name(name) not in APRILTAGS:
        return False
    bits = bits_of(dictionary_of("APRILTAG_36H11"), 0)
    upright = np.array([FIRST_CODE_OF_36H11 >> k & 1 for k in reversed(range(bits.size))], dtype=bool)
    return bool((bits[::-1, ::-1] == upright.reshape(bits.shape)).all())
