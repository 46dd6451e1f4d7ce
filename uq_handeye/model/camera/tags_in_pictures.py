"""Search for tags in pictures in which the board was not detected: dictionary and ids, for the error message."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from ...core.limits import MAX_NAMED
from .adjustment.opencv import opencv
from .corner_refinement import Picture
from .description import Board
from .dictionaries import APRILTAGS, dictionary_names, dictionary_of
from .tags import MIN_TAGS


def other_tags(board: Board, pictures: Iterable[Picture]) -> str:
    """Return a sentence on the tags in pictures in which ``board`` is not; empty if there are none."""
    pictures = list(pictures)
    (name, ids), (mirrored, others) = (_commonest_tags([one[:, ::way] for one in pictures]) for way in (1, -1))
    if len(others) > max(2 * len(ids), MIN_TAGS):
        return f" The pictures are mirror images: mirrored, they show tags of {mirrored}. Flip them."
    if not ids:
        return ""
    more = " and more" * (len(ids) > MAX_NAMED)
    seen = f" The pictures show tags of {name}: {', '.join(map(str, ids[:MAX_NAMED]))}{more}"
    if board.kind == "chessboard":
        return f"{seen}. If the board has tags, name its kind (--pattern charuco, aprilgrid, aruco or apriltag)."
    if max(ids) < len(dictionary_of(board.dictionary).bytesList) and _same_family(name, str(board.dictionary)):
        return f"{seen}. These are of the dictionary that was looked for: check columns, rows and kind of the board."
    return f"{seen} (--dictionary {name})."


def _families() -> list[str]:
    """Return the names of dictionaries that others are no larger than: ``4X4_1000`` holds the ids of ``4X4_50``."""
    return [*APRILTAGS, *(name for name in dictionary_names() if name.endswith("_1000")), "ARUCO_ORIGINAL"]


def _same_family(one: str, other: str) -> bool:
    """Return whether small dictionaries are parts of the same large one: 4X4_50 and 4X4_250."""
    first, second = (name if name in _families() else name.partition("_")[0] for name in (one.upper(), other.upper()))
    return first == second


def _commonest_tags(pictures: list[Picture]) -> tuple[str, list[int]]:
    """Return the dictionary with most ids that are in many of the pictures, the smallest that has them; and these."""
    found: dict[str, list[int]] = {}
    cv2 = opencv()
    for name in _families():
        counts: Counter[int] = Counter()
        for border in (1, 2) if name in APRILTAGS else (1,):
            how = cv2.aruco.DetectorParameters()
            how.markerBorderBits = border
            detector = cv2.aruco.ArucoDetector(dictionary_of(name), how)
            for picture in pictures:
                _, ids, _ = detector.detectMarkers(np.ascontiguousarray(picture))
                counts.update(set(() if ids is None else np.asarray(ids).ravel().tolist()))
        found[name] = sorted(number for number, count in counts.items() if 2 * count >= len(pictures))
    name = max(found, key=lambda name: len(found[name]))
    ids = found[name]
    if ids and name.endswith("_1000"):
        sizes = [int(other.partition("_")[2]) for other in dictionary_names() if other.startswith(name[:4])]
        name = f"{name[:4]}{min(size for size in sizes if max(ids) < size)}"
    return name, ids
