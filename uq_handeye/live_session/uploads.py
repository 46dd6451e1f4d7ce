"""Files that are uploaded in the page: kept in the session's folder under a name of ours, and read like any other."""

from __future__ import annotations

from pathlib import Path

from ..errors import InputError
from ..files.atomic import write_atomically
from .folder import POSE_FILES
from .session import OWN

# Largest pose file (bytes); files of one side.
MOST_BYTES, MOST_FILES = 50_000_000, 1000


def keep_upload(folder: Path, side: str, name: str, content: bytes) -> Path:
    """Write an uploaded file of one side, ``robot`` or ``camera``, into the folder, and return its path.

    Only the suffix of its name is taken, so that no name leads out of the folder. Raises `InputError` for a suffix that
    no reader has, a file that is empty or too large, or a session whose poses came one by one.
    """
    suffix = Path(name.replace("\\", "/")).suffix.lower()
    if suffix not in POSE_FILES:
        raise InputError(f"Expected a file of poses ({', '.join(POSE_FILES)}), got {name!a}.")
    if not content:
        raise InputError(f"{name!a} is empty.")
    if len(content) > MOST_BYTES:
        raise InputError(f"{name!a} has {len(content) / 1e6:.0f} MB; at most {MOST_BYTES / 1e6:.0f} MB are read.")
    if (folder / OWN).exists():
        raise InputError(f"The poses of this session came one by one ({OWN}). Start with another folder for files.")
    for number in range(1, MOST_FILES):
        path = folder / (f"{side}{suffix}" if number == 1 else f"{side}_{number}{suffix}")
        if not path.exists():
            write_atomically(path, content)
            return path
    raise InputError(f"{folder} holds {MOST_FILES} files of the {side} already.")


def keep_result(folder: Path, name: str, content: bytes) -> Path:
    """Write an uploaded result, JSON, into a folder of its own, in place of the one before, and return its path."""
    if not name.lower().endswith(".json") or not content or len(content) > MOST_BYTES:
        raise InputError(f"Expected the result.json of a calibration, at most {MOST_BYTES / 1e6:.0f} MB, got {name!a}.")
    folder.mkdir(exist_ok=True)
    write_atomically(folder / "result.json", content)
    return folder / "result.json"
