"""Detection of the format of a file by its content, and reading of its poses without conversion."""

from __future__ import annotations

import difflib
import logging
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from io import BufferedReader, BytesIO
from pathlib import Path
from typing import Any, BinaryIO, cast

from ..core.files.folders import is_many, paths_of
from ..core.files.lines import is_number
from ..core.files.one_line import short
from ..core.files.open import Hashed, opened, require_size, shown
from ..core.files.pose_names import poses_named
from ..core.files.source import Source
from ..core.files.tree_values import Tree, fields_of, got, is_list, is_map, items_of
from ..core.files.trees import is_json, parse_tree
from ..core.limits import HEAD_BYTES, MAX_DESCRIPTION_BYTES, MAX_TABLE_BYTES
from ..errors import InputError
from .compas_frames import without_compas
from .contents import COLUMNS, Contents, without_repeats
from .controllers.forms import CONTROLLERS
from .controllers.readings import in_convention
from .controllers.records import entries_of, is_records
from .controllers.tables import names_a_pose
from .csv_poses import OF_POINTS, is_points_header, read_csv
from .declared import believed, of_comments, of_tree
from .easy_handeye import read_easy_handeye, read_easy_handeye2
from .foreign_files import refuse_foreign
from .json_poses import ONE_SIDE, is_message, read_json, samples_of
from .many_files import joined_contents
from .matlab_poses import START as MAT_START
from .matlab_poses import read_mat
from .matrices.matrix_trees import listed, matrices_of, read_matrix_tree
from .matrices.text import is_tree
from .moveit import NAMES as MOVEIT_NAMES
from .moveit import read_moveit
from .numpy_poses import read_npy, read_npz
from .opencv_storage import PAIRS, is_of_opencv, is_storage, joined_parts, read_opencv
from .text_formats import TEXTS, named_by
from .tum_poses import names_order, read_tum

# What each is, in a few words, for help texts.
FORMATS = {
    "csv": "timestamp,x,y,z,qx,qy,qz,qw with a header line",
    "tum": "timestamp tx ty tz qx qy qz qw, separated by spaces",
    "npz": "NumPy arrays robot and camera (n, 4, 4)",
    "npy": "one NumPy array (n, 4, 4)",
    "mat": "MAT-file of MATLAB, 4 x 4 x n",
    "easy_handeye": "hand_world_samples and camera_marker_samples, YAML",
    "easy_handeye2": "samples of robot and tracking, YAML",
    "moveit": "samples of MoveIt calibration, YAML",
    "opencv": "FileStorage with R_gripper2base, t_gripper2base, R_target2cam, t_target2cam",
    "json": "robot and camera, lists of 4x4 matrices or of translation and quaternion",
    **{name: known.about for name, known in TEXTS.items()},
}
_TABLES: dict[str, Callable[[BinaryIO, str], Contents]] = {"csv": read_csv, "tum": read_tum}
_ARRAYS: dict[str, Callable[[bytes, str], Contents]] = {"npz": read_npz, "npy": read_npy, "mat": read_mat}
_TREES: dict[str, Callable[[Tree, str], Contents]] = {
    "easy_handeye": read_easy_handeye,
    "easy_handeye2": read_easy_handeye2,
    "moveit": read_moveit,
    "opencv": read_opencv,
    "json": read_json,
    "matrix": read_matrix_tree,
}
# The format follows from these suffixes, without a note.
_SUFFIXES = {
    ".csv": "csv",
    ".tum": "tum",
    ".npz": "npz",
    ".npy": "npy",
    ".json": "json",
    ".mat": "mat",
    ".samples": "easy_handeye2",
}
# Beginnings of arrays.
_BINARY = {b"PK\x03\x04": "npz", b"PK\x05\x06": "npz", b"\x93NUMPY": "npy", MAT_START: "mat"}
# Marks of text in UTF-16, which spreadsheets write.
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
# What word processors and spreadsheets write for a minus and for spaces.
_PLAIN = str.maketrans({"\u2212": "-", "\u2013": "-", **dict.fromkeys("\u00a0\u202f\u2009\u2007", " "), "\ufeff": ""})
_log = logging.getLogger("uq_handeye")


def read_contents(path: Path, format: str | None) -> tuple[Contents, Source]:
    """Read the content of a file, of a folder or of a pattern, and its `Source`, whose notes say what was found out.

    Raises `InputError` for what cannot be read, in the words of the reader of the format; and for a content that is of
    no format or of several.
    """
    asked, format = format, None if format is None else str(format).lower()  # makers write their names in capitals
    if format is not None and format not in FORMATS:
        near = difflib.get_close_matches(format, FORMATS, n=1)
        hint = f" Did you mean {near[0]}?" if near else ""
        raise InputError(
            f"Expected `format` (--format) to be one of {', '.join(FORMATS)} (docs/formats.md), got {asked!r}.{hint}"
        )
    if is_many(path):
        paths, left = paths_of(path)
        contents, source = joined_contents(shown(path), paths, [_of_file(one, format) for one in paths], left)
    else:
        contents, source = _of_file(path, format)
    for note in source.notes:
        _log.info("%s: %s", shown(path), note)
    return contents, source


def _of_file(path: Path, format: str | None) -> tuple[Contents, Source]:
    name = shown(path)
    with opened(path, MAX_TABLE_BYTES) as raw:
        hashed = Hashed(raw)
        with BufferedReader(cast(Any, hashed), HEAD_BYTES) as file:
            head = file.peek(HEAD_BYTES)
            refuse_foreign(head, name, path.suffix)
            kind = _kind(head, name, path.suffix) if format is None else _of(format, head)
            found, contents = format, None
            try:
                found, contents = _read(file, kind, format, path, name)
                contents = without_repeats(contents)
            except InputError as error:
                told = "It looks like" in str(error)
                if format is not None and not told and (other := _looks_like(head, name, format)):
                    raise InputError(f"{error} It looks like {other}: leave `format` (--format) out.") from error
                if any(help in str(error) for help in ("docs/", "--", "import numpy")):
                    raise
                raise InputError(f"{error} Formats: docs/formats.md.") from error
            while file.read(HEAD_BYTES):  # a reader may stop before the end; the hash is of the whole file
                pass
    notes = list(contents.notes)
    if format is None and _SUFFIXES.get(path.suffix.lower()) != found:
        notes.insert(0, f"read as {found}, by its content")
    return contents, Source(shown(Path(path.name)), found, hashed.size, hashed.digest.hexdigest(), tuple(notes))


def _of(format: str, head: bytes = b"") -> str:
    if format == "matrix" and b"\0" not in head and is_tree(_text(head)):
        return "tree"
    if format in CONTROLLERS and head.lstrip().startswith(b"{") and is_json(_text(head)):
        return "tree"
    if head.startswith(tuple(_BINARY)) and (format in ("franka", "matrix") or format in CONTROLLERS):
        return next(kind for start, kind in _BINARY.items() if head.startswith(start))
    return format if format in _TABLES or format in _ARRAYS or format in TEXTS else "tree"


def _read(file: BufferedReader, kind: str, format: str | None, path: Path, name: str) -> tuple[str, Contents]:
    if kind in _TABLES and _is_plain(head := file.peek(HEAD_BYTES)):
        said = of_comments(_text(head[:HEAD_BYTES]))
        return kind, believed(_TABLES[kind](file, name), said, name)
    limit = MAX_TABLE_BYTES if kind in _ARRAYS else MAX_DESCRIPTION_BYTES
    pieces: list[bytes] = []
    total = 0
    while piece := file.read(HEAD_BYTES):
        pieces.append(piece)
        total += len(piece)
        require_size(total, limit, path)
    data = b"".join(pieces)
    if kind in _TABLES:
        text = _text(data)
        return kind, believed(_TABLES[kind](BytesIO(text.encode()), name), of_comments(text[:HEAD_BYTES]), name)
    if kind in _ARRAYS:
        contents = _ARRAYS[kind](data, name)
        return format or kind, contents if format not in CONTROLLERS else in_convention(contents, CONTROLLERS[format])
    if kind in TEXTS:
        text = _text(data)
        if kind == "table" and format is None and is_tree(text[:HEAD_BYTES]):
            with suppress(InputError):  # numbers in brackets, which a table may have as well
                return _of_tree(data, None, name)
        return kind, believed(TEXTS[kind].read(text, name), of_comments(text[:HEAD_BYTES]), name)
    return _of_tree(data, format, name)


def _of_tree(data: bytes, format: str | None, name: str) -> tuple[str, Contents]:
    """Return format and poses of YAML, JSON or XML."""
    tree = parse_tree(data, name, several=True)
    tree = joined_parts(without_compas(tree) if b"compas" in data else tree)
    said = of_tree(tree)
    where = ""
    if format in (None, "json", "opencv") or format in CONTROLLERS:
        tree = listed(tree)
        if is_of_opencv(tree):
            rows = items_of(tree)
            tree = {key: [row[key] for row in rows] for key in rows[0] if all(key in row for row in rows)}
        elif is_message(tree) and not _marked(tree):
            tree = [tree]
        elif not _marked(tree) and matrices_of(tree) is None:
            tree, where = entries_of(tree)
    maker = CONTROLLERS.get(format or "")
    found = format if format is not None and maker is None else _tree_format(tree, name)
    try:
        contents = _TREES[found](tree, name)
        if where:
            contents = replace(contents, notes=(f"poses from {short(where)}", *contents.notes))
        return format or found, believed(contents, said, name) if maker is None else in_convention(contents, maker)
    except InputError as error:
        others = [other for other, is_it in _MARKS.items() if is_it(tree)]
        if found in others or not others:
            raise
        raise InputError(f"{error} It looks like {' or '.join(others)}.") from error


def _is_plain(head: bytes) -> bool:
    """Return whether the beginning of a table is UTF-8 without what word processors write for a minus."""
    try:
        return not set(head.decode()) & {"\u2212", "\u2013"}
    except UnicodeDecodeError as error:
        return (b"\0" in head[: error.end] and not head.startswith(_UTF16)) or error.start > len(head) - 4


def _text(data: bytes) -> str:
    """Text of a controller or a tool, which need not be UTF-8 in its comments."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    if data.startswith(_UTF16):
        text = data.decode("utf-16", errors="replace")
    else:
        try:
            text = data.decode("utf-8")
        except UnicodeDecodeError:
            text = data.decode("latin-1")
    return text if text.isascii() else text.translate(_PLAIN)


def _looks_like(head: bytes, name: str, format: str) -> str | None:
    """The format that a file has in place of the one asked for, where that shows in its first bytes."""
    try:
        kind = _kind(head, name, "")
    except InputError:
        return None
    numbers = kind in (*_TABLES, "matrix", "table")
    text = head.lstrip()
    weak = kind == "tree" and not text.startswith((b"{", b"[", b"%YAML", b"---")) and b"<opencv_storage" not in text
    if kind == _of(format) or (numbers and format in CONTROLLERS) or weak:
        return None
    return "YAML, JSON or XML" if kind == "tree" else kind


def _kind(head: bytes, name: str, suffix: str) -> str:
    """csv, tum, npz, npy, or "tree" for YAML, JSON and XML; by the first bytes, and the suffix if these say nothing."""
    if (binary := next((kind for start, kind in _BINARY.items() if head.startswith(start)), None)) is not None:
        return binary
    if head.startswith(b"\x1f\x8b"):
        raise InputError(f"{name} is compressed by gzip; unpack it first.")
    lines = head.split(b"\n", 2)
    first_line = lines[0].decode(errors="replace")
    if first_line.strip() == ",".join(COLUMNS) and all(map(is_number, b"".join(lines[1:2]).strip().split(b","))):
        return "csv"  # as the table of poses is defined, so that no other format needs a look
    if is_points_header(first_line) and not names_a_pose(first_line):
        raise InputError(f"{name}: expected poses, got a table of points: {OF_POINTS}.")
    if (b"\0" not in head or head.startswith(_UTF16)) and (named := named_by(_text(head))):
        if len(named) > 1:
            raise InputError(
                f"{name}: the content fits {' and '.join(named)}; say which of them by `format` (--format)."
            )
        return named[0]
    stripped = (line.strip() for line in head.removeprefix(b"\xef\xbb\xbf").split(b"\n"))
    first = next((line for line in stripped if line and not line.startswith(b"#")), b"")
    if not first:
        if len(head) >= HEAD_BYTES:
            raise _unknown(name, head[:80])
        raise InputError(f"{name}: the file is empty; expected poses in a format of docs/formats.md.")
    words, fields = first.split(), re.split(rb"[,;\t]", first)
    names = {column.encode() for column in COLUMNS}
    if all(map(is_number, words)):
        return "tum"
    if first.startswith((b"{", b"[", b"<", b"%YAML", b"---", b"- ")) or b":" in first:
        return "tree"
    if len(words) == 8 and (is_number(words[1]) or names_order([word.decode(errors="replace") for word in words])):
        return "tum"
    if len(fields) > 1 or names <= set(re.split(rb"[,;\s]+", first)):
        return "csv"
    if (table := _SUFFIXES.get(suffix.lower(), "")) in _TABLES:
        return table  # whose reader says what is wrong
    raise _unknown(name, first)


def _unknown(name: str, start: bytes) -> InputError:
    began = short(start[:60].decode("utf-8", errors="backslashreplace"))
    return InputError(
        f"{name}: not a pose file that is known; it begins with {began}. Expected one of the formats "
        "of docs/formats.md; name it by `format` (--format) to see what is wrong."
    )


def _marked(tree: Tree) -> bool:
    """Return whether a tree is of a format by its keys."""
    return any(is_it(tree) for is_it in _MARKS.values())


def _tree_format(tree: Tree, name: str) -> str:
    """The format of YAML, JSON or XML, by its keys."""
    found = [format for format, is_it in _MARKS.items() if is_it(tree)]
    if len(found) == 1:
        return found[0]
    if not found and matrices_of(tree) is not None:
        return "matrix"
    if found:
        raise InputError(f"{name}: the content fits {' and '.join(found)}; say which of them by `format` (--format).")
    raise InputError(
        f"{name}: expected poses by the names of a format that is known ({', '.join(_TREES)}; docs/formats.md), got "
        f"{got(tree)}; name the format by `format` (--format) to see what it lacks."
    )


def _keys(tree: Tree) -> set[str]:
    """The keys of a map, or of the first item of a list."""
    return set(fields_of(next(iter(items_of(tree)), tree)))


def _is_json(tree: Tree) -> bool:
    if is_list(tree):
        first = next(iter(tree), None)
        return (
            is_list(first)
            or is_message(first)
            or "translation" in _keys(tree)
            or bool(samples_of(tree))
            or (is_records(tree) and not _is_easy_handeye2(tree) and matrices_of(tree) is None)
        )
    if samples_of(tree) or (is_list(fields_of(tree).get(ONE_SIDE)) and not is_storage(tree)):
        return True
    keys = _keys(tree)
    named = "format" in keys or bool(poses_named(keys))
    return named and not is_storage(tree) and "R_gripper2base" not in keys


def _is_easy_handeye(tree: Tree) -> bool:
    marks = {"hand_world_samples", "camera_marker_samples"}
    return is_map(tree) and bool(marks & (_keys(tree) | _keys(tree.get("samples"))))


def _is_easy_handeye2(tree: Tree) -> bool:
    if is_list(tree):
        return "robot" in _keys(tree) and bool(_keys(tree) & {"tracking", "optical"})
    samples = is_list(fields_of(tree).get("samples")) and not samples_of(tree)
    return samples or ("parameters" in _keys(tree) and bool(_keys(tree) & {"transform", "transformation"}))


_MARKS: dict[str, Callable[[Tree], bool]] = {
    "easy_handeye": _is_easy_handeye,
    "easy_handeye2": _is_easy_handeye2,
    "moveit": lambda tree: bool(_keys(tree) & {*MOVEIT_NAMES, "joint_values"}),
    "opencv": lambda tree: is_storage(tree) or bool({pair[0] for pair in PAIRS} & _keys(tree)),
    "json": _is_json,
}
