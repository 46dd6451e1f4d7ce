"""Intrinsics as a file states them."""

from __future__ import annotations

from typing import NamedTuple

from .adjustment.setting import Known


class KnownIntrinsics(NamedTuple):
    """Intrinsics as a file states them; ``values`` is what `calibrate_camera` takes as ``intrinsics``."""

    values: Known
    model: str | None  # where the file names it
    image_size: tuple[int, int] | None
    how: str = ""  # how they were brought to the pictures, where those have another size
    sensor_of_43: bool = False  # whether pictures of another aspect are cut out of one of 4:3
