"""Detection of ChArUco boards in a picture, also of boards seen in part."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, cast

import numpy as np

from ...errors import InputError
from .adjustment.opencv import opencv
from .corner_refinement import Detection, Picture, refined
from .description import Board
from .dictionaries import dictionary_of

if TYPE_CHECKING:
    from cv2.aruco import CharucoDetector

# A view of fewer corners gives no pose worth its noise.
MIN_CORNERS_OF_VIEW = 6


def charuco_finder(board: Board) -> Callable[[Picture], Detection]:
    cv2 = opencv()
    words = dictionary_of(board.dictionary)

    # Half the window is a third of the white around the markers, whose corners are no part of a corner of the board.
    share = 0.33 * (1.0 - float(board.marker or 0.0) / board.side)

    def detector(legacy: bool) -> CharucoDetector:
        layout = cv2.aruco.CharucoBoard((board.columns, board.rows), board.side, float(board.marker or 0.0), words)
        layout.setLegacyPattern(legacy)
        return cast("CharucoDetector", cv2.aruco.CharucoDetector(layout))

    try:
        # Boards with an even number of rows began with a white square before OpenCV 4.6; prints of both are about.
        detectors = [detector(legacy) for legacy in ((False, True) if board.rows % 2 == 0 else (False,))]
    except cv2.error as error:
        raise InputError(f"OpenCV takes no {board} with the dictionary {board.dictionary}: too few markers?") from error

    def find(picture: Picture) -> Detection:
        for k, one in enumerate(detectors):
            corners, ids, _, _ = one.detectBoard(picture)
            if ids is None or len(ids) < MIN_CORNERS_OF_VIEW:
                continue
            numbers = np.asarray(ids, dtype=np.intp).ravel()
            if np.linalg.matrix_rank(board.points[numbers, :2] - board.points[numbers[0], :2]) < 2:
                continue  # corners of one line
            if k:
                detectors.reverse()  # it will be this one in all pictures
            # Releases of OpenCV differ by half a pixel here; refined once more, all give the same.
            return numbers, *refined(picture, np.asarray(corners, dtype=float), share)
        return None

    return find
