"""Several files given by one name: a folder, or a pattern such as ``poses/*.txt``."""

from __future__ import annotations

import glob
import re
from collections import Counter, defaultdict
from collections.abc import Iterable
from pathlib import Path

from ...errors import InputError
from ..limits import MAX_FILES
from .open import shown
from .patterns import matching

# Files in the folder of a ROS bag.
BAGS = (".mcap", ".db3", ".zstd")
# Suffixes of files that lie beside poses and hold none; names of notes.
OTHER_FILES = (
    *(".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm", ".webp", ".exr", ".raw", ".gif"),
    *(".zdf", ".ply", ".pcd", ".stl", ".obj", ".las", ".mp4", ".avi", ".pdf", ".md", ".log", ".py", ".ipynb", ".zip"),
)
NOTES = ("readme", "license", "notes")
# Beginnings of names of camera poses.
_SEEN = re.compile(r"(?:.*[_.-])?(?:cam|target|board|marker|tag|pattern|object|checker|charuco)|c[_*]", re.IGNORECASE)


def natural(path: Path | str) -> tuple[tuple[tuple[int, str], ...], str]:
    """Sorts numbers within names by their value: img2 before img10."""
    parts = re.split(r"(\d+)", str(path))
    return tuple((int(part), "") if k % 2 else (0, part) for k, part in enumerate(parts)), str(path)


def is_many(path: Path) -> bool:
    """Return whether a path means several files: a folder, or a pattern that is no name of a file."""
    path = _meant(path)
    return path.is_dir() or (glob.has_magic(str(path)) and not path.exists())


def paths_of(path: Path) -> tuple[list[Path], list[str]]:
    """The files of a folder or a pattern, in the natural order of their names, and notes of what is left out.

    Hidden files and folders are left out, and of a folder also files that hold no poses (pictures, clouds, notes).

    Raises `InputError` for none, for a folder whose files have different suffixes, and for files of several kinds by
    their names, such as those of robot and camera.
    """
    path = _meant(path)
    notes = []
    if path.is_dir():
        found = [child for child in path.iterdir() if child.is_file() and not _hidden(child.name)]
        if any(child.name == "metadata.yaml" for child in found) and any(child.suffix in BAGS for child in found):
            raise InputError(
                f"{shown(path)} is a ROS bag: give it as --bag {shown(path)}; uq-handeye bag {shown(path)} lists what "
                "is in it."
            )
        poses = [child for child in found if _may_hold_poses(child)]
        if poses and len(poses) < len(found):
            others = sorted({child.suffix.lower() or child.name for child in found if child not in poses})
            notes.append(f"{len(found) - len(poses)} files that hold no poses are left out ({', '.join(others[:6])})")
            found = poses
        if not found:
            found = _one_in_each(path)
        counts = Counter(child.suffix.lower() for child in found)
        if len(counts) > 1:
            kinds = ", ".join(f"{number} {suffix or 'without suffix'}" for suffix, number in counts.most_common(6))
            usual = counts.most_common(1)[0][0]
            raise InputError(
                f"Expected files of one kind in the folder {shown(path)}, got {kinds}. Name those that are meant by a "
                f"pattern in quotes, e.g. '{shown(path / ('*' + usual))}'."
            )
    else:
        found = [one for one in matching(_escaped(path)) if not one.is_dir() and not _hidden(one.name)]
    if not found:
        what = f"No files in the folder {shown(path)}." if path.is_dir() else f"No file matches {shown(path)}."
        raise InputError(f"{what} Check the folder and the ending.")
    if len(found) > MAX_FILES:
        raise InputError(f"Expected at most {MAX_FILES} files, got {len(found)} by {shown(path)}.")
    _one_kind(path, found)
    return sorted(found, key=natural), notes


def _may_hold_poses(path: Path) -> bool:
    """Return whether a file is no picture, cloud or note."""
    return path.suffix.lower() not in OTHER_FILES and path.stem.lower() not in NOTES


def _one_in_each(path: Path) -> list[Path]:
    """Return the file of poses in each folder of a folder, ``pose_00/data.json``; none unless all have one name.

    Raises `InputError` with the patterns to give where each folder has the same few files.
    """
    folders = [child for child in path.iterdir() if child.is_dir() and not _hidden(child.name)][: MAX_FILES + 1]
    found = []
    for folder in folders:
        inside = [child for child in folder.iterdir() if child.is_file() and not _hidden(child.name)]
        found += [child for child in inside if _may_hold_poses(child)]
    names = Counter(child.name for child in found)
    if len(folders) > 1 and 2 <= len(names) <= 4 and set(names.values()) == {len(folders)}:
        ordered = sorted(names, key=lambda name: bool(_SEEN.match(name)))  # the robot's first
        given = " ".join(f"'{shown(path / '*' / name)}'" for name in ordered)
        raise InputError(
            f"Expected the poses of one side in the folders of {shown(path)}, got {', '.join(ordered)} in each. Name "
            f"those of robot and camera by a pattern each, in quotes, the robot's first: {given}."
        )
    if len(names) == 1 and 2 * len(found) > len(folders) > len(found):
        bare = next(folder for folder in sorted(folders) if folder not in {child.parent for child in found})
        raise InputError(
            f"{shown(path)}: {len(found)} of {len(folders)} folders hold {found[0].name}; {bare.name} does not. Remove "
            f"the folders without it, or name the files by a pattern in quotes: '{shown(path / '*' / found[0].name)}'."
        )
    return found if len(found) == len(folders) and len(names) == 1 else []


def _meant(path: Path) -> Path:
    """A pattern without the quotes that some shells leave around it, and with the home folder for ~."""
    text = str(path)
    if len(text) > 2 and text[0] == text[-1] and text[0] in "'\"" and not path.exists():
        path = Path(text[1:-1])
    if str(path).startswith("~") and not path.exists():
        try:
            return path.expanduser()
        except RuntimeError:  # no such user
            return path
    return path


def _escaped(path: Path) -> str:
    """A pattern in which brackets of folders that exist are no pattern."""
    parts = path.parts
    whole = Path(parts[0])
    for k, part in enumerate(parts[1:], start=1):
        if not (whole / part).exists():
            return str(Path(glob.escape(str(whole)), *parts[k:])) if whole.exists() else str(path)
        whole /= part
    return str(path)


def _hidden(name: str) -> bool:
    return name.startswith((".", "~$")) or name.lower() in ("thumbs.db", "desktop.ini")


def _one_kind(path: Path, found: list[Path]) -> None:
    """Raise `InputError` for files whose names, without their numbers, are of a few kinds, each of several files."""
    kinds: dict[str, list[Path]] = defaultdict(list)
    for child in found:
        kinds[re.sub(r"\d+", "*", child.name)].append(child)
    if not 2 <= len(kinds) <= 4 or min(map(len, kinds.values())) < 2:
        return
    folders = {child.parent for child in found}
    folder = folders.pop() if len(folders) == 1 else path.parent
    kinds = dict(sorted(kinds.items(), key=lambda kind: bool(_SEEN.match(kind[0]))))  # the robot's first
    patterns = [re.sub(r"\*.*\*", "*", kind) for kind in kinds]
    shown_kinds = " and ".join(
        f"{pattern} ({len(files)})" for pattern, files in zip(patterns, kinds.values(), strict=True)
    )
    given = " ".join(f"'{shown(folder / pattern)}'" for pattern in patterns)
    raise InputError(
        f"Expected the poses of one side in {shown(path)}, got {shown_kinds}. Name those of robot and camera by a "
        f"pattern each, in quotes, the robot's first: {given}."
    )


def last_number(name: str) -> int | None:
    """Return the last number in the name of a file or of a pose, without its suffix."""
    numbers = re.findall(r"\d+", Path(name).stem)
    return int(numbers[-1]) if numbers and len(numbers[-1]) < 18 else None


def numbers_in(names: Iterable[str]) -> tuple[int, ...]:
    """Return the last numbers of names, or none where a name has none or two have the same."""
    found = [last_number(name) for name in names]
    numbers = tuple(number for number in found if number is not None)
    return numbers if len(set(numbers)) == len(found) else ()
