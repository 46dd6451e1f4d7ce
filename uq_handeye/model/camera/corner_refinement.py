"""Corners between dark and light squares, refined to a fraction of a pixel by the gradients around them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from .adjustment.opencv import opencv
from .corners import smoothing

Picture = NDArray[np.uint8]
# Numbers of the board's points, their pixels, and half the widths of the windows in which these were refined.
Seen = tuple[NDArray[np.intp], Array, NDArray[np.intp]]
Detection = Seen | None


def refined(
    picture: Picture, corners: Array, share: float, room: Array | None = None
) -> tuple[Array, NDArray[np.intp]]:
    """Refine corners by the gradients around each of them (m, 2); also return half the width (m,) of the window: a
    share of the ``room`` (m,) that each has, pixels, or else of the distance to the nearest neighbour, but within the
    picture, as beyond its rim edges would seem to run on along the rows.
    """
    cv2 = opencv()
    flat = np.asarray(corners, dtype=float).reshape(-1, 2)
    if room is None:
        apart = np.linalg.norm(flat[:, None] - flat, axis=-1) + 1e9 * np.eye(len(flat))
        room = apart.min(axis=1)
        room = np.minimum(room, 1.2 * np.median(room))  # a neighbour may not have been found
    rim = np.minimum(flat, np.array(picture.shape[::-1]) - 1 - flat).min(axis=1) - 2  # the gradient needs two more
    windows = np.clip(np.minimum(share * room, rim), 2, 30).astype(np.intp)
    enough = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    grey, sigma = picture.astype(np.float32), smoothing(windows)
    smooth = {s: cv2.GaussianBlur(grey, (0, 0), s) for s in set(sigma.tolist())}
    found = [
        cv2.cornerSubPix(smooth[s], np.array(corner, dtype=np.float32).reshape(1, 1, 2), (w, w), (-1, -1), enough)
        for corner, w, s in zip(flat, windows.tolist(), sigma.tolist(), strict=True)
    ]
    return np.concatenate(found)[:, 0].astype(float), windows
