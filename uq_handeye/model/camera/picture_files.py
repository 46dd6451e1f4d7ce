"""Files of pictures: their selection by name, their order, and reading them in grey."""

from __future__ import annotations

import os
import struct
import threading
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ...core.files.folders import natural
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.files.patterns import matching
from ...core.limits import MAX_TABLE_BYTES
from ...errors import InputError
from .adjustment.opencv import opencv
from .corner_refinement import Picture

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".webp")
# Detectors fail in smaller pictures.
MIN_PICTURE_SIDE_PX = 32
_DESCRIPTOR_2 = threading.Lock()


# Pictures of more pixels are refused.
MAX_PICTURE_PIXELS = 100_000_000


def picture_paths(images: str | Iterable[StrPath]) -> list[Path]:
    """The pictures that are meant, in natural order; a folder means those within it."""
    if isinstance(images, str | os.PathLike):
        images = [images]
    paths: list[Path] = []
    for entry in images:
        path = as_path(entry)
        if path.is_dir():
            inside = [child for child in path.iterdir() if child.suffix.lower() in SUFFIXES]
            if not inside:
                raise InputError(f"Expected pictures ({', '.join(SUFFIXES)}) in {shown(path)}, got none.")
            paths += inside
        elif path.exists():
            paths.append(path)
        else:
            matched = [one for one in matching(str(path)) if not one.is_dir()]
            if not matched:
                raise InputError(f"No pictures found for {shown(path)}: check the folder and the ending.")
            paths += matched
    if not paths:
        raise InputError("Expected `images` to name pictures, got none.")
    twice = [path for path, count in Counter(map(os.path.abspath, paths)).items() if count > 1]
    if twice:
        raise InputError(f"Expected every picture once, got {shown(Path(twice[0]))} twice.")
    return sorted(paths, key=natural)


def _names(paths: list[Path]) -> list[str]:
    """Without folders where that tells them apart."""
    bare = [path.name for path in paths]
    return [shown(Path(name)) for name in (bare if len(set(bare)) == len(bare) else map(str, paths))]


@contextmanager
def _unheard() -> Iterator[None]:
    """Discard what decoders in C write on a damaged picture to file descriptor 2: the error has it in one line."""
    with _DESCRIPTOR_2:
        try:
            kept = os.dup(2)
        except OSError:  # closed
            yield
            return
        try:
            with open(os.devnull, "wb") as nowhere:
                os.dup2(nowhere.fileno(), 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _picture(path: Path) -> Picture:
    """Read the picture in grey, as the sensor has it: the orientation stated in a file is for viewers."""
    return _decoded(_content(path), path)


def _content(path: Path) -> bytes:
    with opened(path, MAX_TABLE_BYTES) as file:
        return file.read()


def _stated_size(content: bytes) -> tuple[int, int]:
    """Return width and height as the beginning of a PNG or BMP states them; (0, 0) of other files."""
    if content[:8] == b"\x89PNG\r\n\x1a\n" and len(content) >= 24:
        width, height = struct.unpack(">II", content[16:24])
        return width, height
    if content[:2] == b"BM" and len(content) >= 26:
        width, height = struct.unpack("<ii", content[18:26])
        return abs(width), abs(height)
    return 0, 0


def _require_pixels(size: tuple[int, int], path: Path) -> None:
    if size[0] * size[1] > MAX_PICTURE_PIXELS:
        raise InputError(
            f"{shown(path)}: the picture has {size[0]} x {size[1]} pixels; at most {MAX_PICTURE_PIXELS // 1_000_000} "
            "megapixels are read."
        )


def _decoded(content: bytes, path: Path) -> Picture:
    cv2, data = opencv(), np.frombuffer(content, dtype=np.uint8)
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    _require_pixels(_stated_size(content), path)
    try:
        with _unheard():
            picture = cv2.imdecode(data, flags) if data.size else None
    except cv2.error:  # too many pixels
        picture = None
    if picture is None:
        raise InputError(f"{shown(path)}: expected a picture (PNG, JPEG, TIFF, BMP, ...), got none that can be read.")
    if min(picture.shape[:2]) < MIN_PICTURE_SIDE_PX:
        size = " x ".join(map(str, picture.shape[1::-1]))
        raise InputError(
            f"{shown(path)}: expected a picture of at least {MIN_PICTURE_SIDE_PX} pixels a side, got {size}."
        )
    _require_pixels((picture.shape[1], picture.shape[0]), path)
    if picture.dtype != np.uint8:
        picture = cv2.normalize(picture, None, 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)
    return np.asarray(picture)
