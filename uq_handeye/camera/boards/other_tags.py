"""Tags that are in pictures in which the board was not found: their dictionary and ids, for the message."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from ..adjustment.initial_guess import opencv
from .dictionaries import APRILTAGS, dictionary_of
from .refinement import Picture

SIZES = (50, 100, 250, 1000)
FAMILIES = (*APRILTAGS, *(f"{k}X{k}_1000" for k in (4, 5, 6, 7)), "ARUCO_ORIGINAL")
# Share of the pictures in which an id is no chance.
OFTEN = 0.5
NAMED = 6


def other_tags(pictures: Iterable[Picture]) -> str:
    """Return a sentence that names the dictionary and the ids of the tags in pictures; empty if there are none."""
    pictures = list(pictures)
    found: dict[str, list[int]] = {}
    cv2 = opencv()
    for name in FAMILIES:
        counts: Counter[int] = Counter()
        for border in (1, 2) if name in APRILTAGS else (1,):
            how = cv2.aruco.DetectorParameters()
            how.markerBorderBits = border
            detector = cv2.aruco.ArucoDetector(dictionary_of(name), how)
            for picture in pictures:
                _, ids, _ = detector.detectMarkers(picture)
                counts.update(set(() if ids is None else np.asarray(ids).ravel().tolist()))
        found[name] = sorted(number for number, count in counts.items() if count >= OFTEN * len(pictures))
    name = max(found, key=lambda name: len(found[name]))
    if not (ids := found[name]):
        return ""
    if name.endswith("_1000"):
        name = f"{name[:3]}_{next(size for size in SIZES if max(ids) < size)}"
    more = ", ..." if len(ids) > NAMED else ""
    return f" The pictures show tags of {name}: {', '.join(map(str, ids[:NAMED]))}{more} (--dictionary {name})."
