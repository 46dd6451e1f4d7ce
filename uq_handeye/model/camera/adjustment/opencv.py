"""The module cv2 of OpenCV, where it is installed."""

from __future__ import annotations

from types import ModuleType

from ....errors import MissingExtraError


def opencv() -> ModuleType:
    """Return the module cv2; raises `MissingExtraError` with the command that installs it."""
    try:
        import cv2
    except ImportError as error:
        raise MissingExtraError(
            "Calibrating a camera needs OpenCV for its start: pip install '.[camera]' in the clone of uq-handeye."
        ) from error
    return cv2
