"""The module cv2 of OpenCV, where it is installed."""

from __future__ import annotations

from types import ModuleType

from ....errors import MissingExtraError


def opencv() -> ModuleType:
    """The module cv2, or a `MissingExtraError` that says how to get it."""
    try:
        import cv2
    except ImportError as error:
        raise MissingExtraError(
            "Calibrating a camera needs OpenCV for its start: pip install '.[camera]' in the clone of uq-handeye."
        ) from error
    return cv2
