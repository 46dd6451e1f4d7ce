"""Files that are uploaded in the page: stored in the session's folder under generated names, and read like any other.

Only the suffix of a file name is kept, so that no name leads out of the folder; the size is bounded before it is
written.
"""

from __future__ import annotations

import io
import re
import warnings
import zipfile
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.files.atomic import write_atomically, write_files
from ...core.files.one_line import refused
from ...core.limits import MAX_TABLE_BYTES, MAX_UPLOAD_BYTES
from ...errors import InputError
from ...model.camera.picture_files import SUFFIXES
from .folder import POSE_FILES
from .question import ONE_AT_A_TIME
from .session import OWN

BAGS = (".bag", ".mcap", ".db3")
# Files of a bag that is a folder, in it or at its top.
_BAG_FILE = re.compile(r"(?:\w[\w. -]{0,150}/)?(?:metadata\.yaml|\w[\w.-]{0,150}\.(?:mcap|db3)(?:\.zstd)?)")


def keep_upload(folder: Path, side: str, name: str, content: bytes) -> Path:
    """Write an uploaded file of poses of one side, ``robot`` or ``camera``, into the folder, and return its path.

    Raises `InputError` for a suffix that no reader has, a file that is empty or too large, or a session whose poses
    came one by one.
    """
    if (folder / OWN).exists():
        raise InputError(f"The poses of this session came one by one ({OWN}). Start with another folder for files.")
    return _keep(folder, side, POSE_FILES, "a file of poses", name, content)


def keep_picture(folder: Path, name: str, content: bytes) -> Path:
    """Write an uploaded picture of the board into the folder, and return its path."""
    if content:
        thumbnail(io.BytesIO(content), name)  # it can be read, and is not too large
    return _keep(folder, "picture", SUFFIXES, "a picture", name, content)


def keep_bag(folder: Path, name: str, content: bytes) -> Path:
    """Write an uploaded bag of ROS, one file or a folder as .zip, into a folder of its own, and return its path."""
    path = _keep(folder / "bags", "bag", (*BAGS, ".zip"), "a bag of ROS, one file or its folder", name, content)
    return path if path.suffix != ".zip" else _unpacked(path, name)


def _unpacked(path: Path, name: str) -> Path:
    """Unpack the folder of a bag beside its .zip, which is removed: its files alone, and no more than they may hold."""
    contents, left = {}, MAX_TABLE_BYTES
    most = f"{left / 1e6:.0f} MB"
    try:
        with refused(f"{name!a}: not a .zip that can be read"), zipfile.ZipFile(path) as packed:
            files = [one for one in packed.infolist() if _BAG_FILE.fullmatch(one.filename)]
            if not files or len({one.filename.rpartition("/")[0] for one in files}) > 1:
                raise InputError(f"{name!a}: expected the folder of one bag, metadata.yaml and files .mcap or .db3.")
            for one in files:
                with packed.open(one) as file:
                    content = file.read(left + 1)
                if (left := left - len(content)) < 0:
                    raise InputError(f"{name!a} unpacks to more than {most}.")
                contents[one.filename.rpartition("/")[2]] = content
    finally:
        path.unlink()
    write_files(path.with_suffix(""), contents)
    return path.with_suffix("")


def keep_other(folder: Path, stem: str, suffix: str, what: str, name: str, content: bytes) -> Path:
    """Write a file that is not one of poses into a folder of its own, in place of the one before; return its path."""
    return _keep(folder / stem, stem, (suffix,), what, name, content, again=True)


def _keep(
    folder: Path, stem: str, suffixes: tuple[str, ...], what: str, name: str, content: bytes, again: bool = False
) -> Path:
    """Write a file under a name of ours: only its suffix is taken, so that no name leads out of the folder."""
    suffix = Path(name.replace("\\", "/")).suffix.lower()
    if suffix not in suffixes:
        raise InputError(f"Expected {what} ({', '.join(suffixes)}), got {name!a}.")
    if not content:
        raise InputError(f"{name!a} is empty.")
    if len(content) > MAX_UPLOAD_BYTES:
        raise InputError(f"{name!a} has {len(content) / 1e6:.0f} MB; at most {MAX_UPLOAD_BYTES / 1e6:.0f} MB are read.")
    folder.mkdir(exist_ok=True)
    names = (folder / (f"{stem}{suffix}" if number == 1 else f"{stem}_{number}{suffix}") for number in count(1))
    path = next(path for path in names if again or not path.exists())
    write_atomically(path, content)
    return path


def thumbnail(file: Path | io.BytesIO, name: str = "") -> NDArray[np.uint8]:
    """Return a picture (h, w, 3), at most 240 pixels wide and high; raises `InputError` for one that cannot be read."""
    from PIL import Image

    try:
        with ONE_AT_A_TIME, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(file) as picture:
                picture.thumbnail((240, 240))
                return np.asarray(picture.convert("RGB"))
    except (Image.DecompressionBombWarning, Image.DecompressionBombError):
        raise InputError(f"{name!a} has more pixels than are read, {Image.MAX_IMAGE_PIXELS}.") from None
    except (OSError, ValueError, SyntaxError):
        raise InputError(f"{name!a}: expected a picture ({', '.join(SUFFIXES)}).") from None
