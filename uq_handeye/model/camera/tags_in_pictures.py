"""Tags in pictures in which the board was not found: their dictionary and ids, for the message of the error."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np

from .adjustment.opencv import opencv
from .corner_refinement import Picture
from .description import Board
from .dictionaries import APRILTAGS, dictionary_of
from .tags import FEWEST

SIZES = (50, 100, 250, 1000)


FAMILIES = (*APRILTAGS, *(f"{k}X{k}_1000" for k in (4, 5, 6, 7)), "ARUCO_ORIGINAL")


# Share of the pictures in which an id is no chance.
OFTEN = 0.5


NAMED = 6


def other_tags(board: Board, pictures: Iterable[Picture]) -> str:
    """Return a sentence on the tags in pictures in which ``board`` is not; empty if there are none."""
    pictures = list(pictures)
    (name, ids), (mirrored, others) = (_commonest_tags([one[:, ::way] for one in pictures]) for way in (1, -1))
    if len(others) > max(2 * len(ids), FEWEST):
        return f" The pictures are mirror images: mirrored, they show tags of {mirrored}. Flip them."
    if not ids:
        return ""
    seen = f" The pictures show tags of {name}: {', '.join(map(str, ids[:NAMED]))}{' and more' * (len(ids) > NAMED)}"
    if board.kind == "chessboard":
        return f"{seen}. If the board has tags, name its kind (--pattern charuco, aprilgrid, aruco or apriltag)."
    if max(ids) < len(dictionary_of(board.dictionary).bytesList) and _same_family(name, str(board.dictionary)):
        return f"{seen}. These are of the dictionary that was looked for: check columns, rows and kind of the board."
    return f"{seen} (--dictionary {name})."


def _same_family(one: str, other: str) -> bool:
    """Return whether small dictionaries are parts of the same large one: 4X4_50 and 4X4_250."""
    first, second = (name if name in FAMILIES else name.partition("_")[0] for name in (one.upper(), other.upper()))
    return first == second


def _commonest_tags(pictures: list[Picture]) -> tuple[str, list[int]]:
    """Return the dictionary with most ids that are in many of the pictures, the smallest that has them; and these."""
    found: dict[str, list[int]] = {}
    cv2 = opencv()
    for name in FAMILIES:
        counts: Counter[int] = Counter()
        for border in (1, 2) if name in APRILTAGS else (1,):
            how = cv2.aruco.DetectorParameters()
            how.markerBorderBits = border
            detector = cv2.aruco.ArucoDetector(dictionary_of(name), how)
            for picture in pictures:
                _, ids, _ = detector.detectMarkers(np.ascontiguousarray(picture))
                counts.update(set(() if ids is None else np.asarray(ids).ravel().tolist()))
        found[name] = sorted(number for number, count in counts.items() if count >= OFTEN * len(pictures))
    name = max(found, key=lambda name: len(found[name]))
    ids = found[name]
    if ids and name.endswith("_1000"):
        name = f"{name[:3]}_{next(size for size in SIZES if max(ids) < size)}"
    return name, ids
