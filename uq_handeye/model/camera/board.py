"""Detection of the corners of a board in several pictures.

Boards and their frames are in `description`, the detection of each kind in `chessboard`, `charuco` and `tags`.
"""

from __future__ import annotations

import warnings
from collections import Counter, OrderedDict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...core.files.open import StrPath
from ...core.files.source import Source
from ...core.limits import MAX_LISTED
from ...core.presentation.units import MM_PER_M
from ...core.progress import progress_bar
from ...errors import InputError, InputWarning, require_type
from .charuco import charuco_finder
from .chessboard import chessboard_finder, in_small, shown_size
from .circles import circles_finder
from .corner_refinement import Seen
from .corners import Corners
from .description import CIRCLES, SQUARES, TAGS, Board
from .picture_files import _content, _decoded, _names, _picture, picture_paths
from .tag_grid import Tags, contradiction
from .tags import tag_finder
from .tags_in_pictures import other_tags

FINDERS = {
    "chessboard": chessboard_finder, "charuco": charuco_finder,
    "circles": circles_finder, "circles-asymmetric": circles_finder,
    "aprilgrid": tag_finder, "aruco": tag_finder, "apriltag": tag_finder,
}  # fmt: skip
# What to look at where a board is in no picture.
COUNTED = {
    "chessboard": "Counted are inner corners, one less than squares.",
    "charuco": "Counted are squares, columns first; check the dictionary (--dictionary), too.",
    "circles": "Counted are discs, columns first.",
    "circles-asymmetric": "Counted are discs in a row, and rows, e.g. 4x11.",
    "aprilgrid": "Counted are tags; check the dictionary (--dictionary), and the id at the lower left (`first_id`, "
    "--first-id).",
    "aruco": "Counted are tags; check the dictionary (--dictionary), and the id at the upper left (`first_id`, "
    "--first-id).",
    "single": "Check the dictionary (--dictionary), the id (`first_id`, --first-id), and that white paper surrounds "
    "the tag.",
}
# Another tag is named where it is in more than this share of the pictures of the commonest one.
MIN_SHARE_OF_COMMONEST_TAG = 0.1
# Looks by the content of the picture and the board, the latest last: a session that grows looks at each picture once.
_LOOKS: OrderedDict[tuple[bytes, Board], _Look] = OrderedDict()
# Pictures without a board after which another size of it is looked for.
PROBED_PICTURES = 2


def detect_board(images: str | Iterable[StrPath], board: Board, *, progress: bool = False) -> Corners:
    """The corners of a board in pictures.

    Parameters
    ----------
    images : glob text, or paths
        Such as ``"img/*.png"``. They are always taken in the natural order of their names (img2 before img10), and the
        position there, from 0, is the row of the robot pose that the picture was taken at.
    board : Board
    progress : bool
        Show a bar on stderr, if that is a terminal.

    Returns
    -------
    Corners
        With ``image_size``, and the names of pictures in which there is no board in ``missing``.

    Raises
    ------
    InputError
        No pictures, files that are none, pictures of different sizes, a board in none of them.
    MissingExtraError
        OpenCV is not installed.

    Warns
    -----
    InputWarning
        Pictures without a board, by name. A chessboard that looks the same after half a turn.
    """
    corners = find_corners(images, board, progress)
    if board.symmetry_order > 1:
        warnings.warn(_ambiguous(board), InputWarning, stacklevel=2)
    return corners


def find_corners(images: str | Iterable[StrPath], board: Board, progress: bool) -> Corners:
    """Find corners as `detect_board` does, without a warning about half turns: for callers who resolve them."""
    require_type("board", board, Board, "a Board")
    paths = picture_paths(images)
    names = _names(paths)
    tags: list[Tags] = []
    unclear: dict[int, list[float]] = {}
    found: dict[int, Seen] = {}
    sizes: dict[tuple[int, int], str] = {}
    with progress_bar("looking for the board", len(paths), "pictures", progress) as more:
        for row, path in enumerate(paths):
            hopeless = board.kind == "chessboard" and row >= PROBED_PICTURES and not found
            look = _look(path, board, small_first=hopeless)
            sizes.setdefault(look.size, names[row])
            if len(sizes) > 1:
                (one, some), (other, odd) = sizes.items()
                raise InputError(
                    f"Expected pictures of one size: {some} has {one[0]} x {one[1]} pixels and {odd} {other[0]} x "
                    f"{other[1]}. They must come from one camera, uncropped and unscaled."
                )
            if look.seen is not None:
                found[row] = look.seen
            elif look.unclear:
                unclear[row] = look.unclear
            tags += look.tags
            if row + 1 == PROBED_PICTURES and not found and board.kind == "chessboard":
                _require_size(board, paths[: row + 1])
            more(1)
    ids = [each.tolist() for each, _ in tags]
    if board.single:
        if board.first_id is None and (number := _commonest(ids)) is not None:
            return find_corners(images, replace(board, first_id=number), progress)
        _warn_of_copies(board, ids)
    missing = tuple(name for row, name in enumerate(names) if row not in found)
    absent = [name for row, name in enumerate(names) if row not in found and row not in unclear]
    if board.kind in TAGS and not board.single and (words := contradiction(board, tags, max(max(sizes)))):
        warnings.warn(words, InputWarning, stacklevel=3)
    if unclear:
        said = _unclear(
            [names[row] for row in unclear], len(paths), [side for each in unclear.values() for side in each]
        )
        if not found:
            raise InputError(said)
        warnings.warn(f"{said} These pictures are left out.", InputWarning, stacklevel=3)
    if not found:
        kind = "single" if board.single else board.kind
        raise InputError(
            f"No {board} was found in any of {len(paths)} pictures, the first {names[0]}: is it that board? "
            f"{COUNTED[kind]}{other_tags(board, map(_picture, paths[:3]))}"
        )
    if absent:
        warnings.warn(
            f"The board was not found in {len(absent)} of {len(paths)} pictures, which are left out: {listed(absent)}.",
            InputWarning,
            stacklevel=3,
        )
    (size,) = sizes
    numbers, pixels, window = (np.concatenate(part) for part in zip(*found.values(), strict=True))
    corners = Corners(
        np.repeat(list(found), [len(seen[0]) for seen in found.values()]),
        board.points[numbers],
        pixels,
        tuple(names[row] for row in found),
        image_size=size,
        missing=missing,
        board=board.text,
        window=None if board.kind in CIRCLES else window,
        diameter=np.full(len(numbers), board.disc) if board.kind in CIRCLES else None,
    )
    corners.require_once("The pictures")
    return corners


def _require_size(board: Board, paths: Sequence[Path]) -> None:
    """Raise `InputError` where the pictures show a chessboard with other numbers of corners."""
    shown_board = shown_size(map(_picture, paths))
    if shown_board is None or shown_board == (max(board.columns, board.rows), min(board.columns, board.rows)):
        return
    columns, rows = shown_board
    raise InputError(
        f"No {board} was found in the first {len(paths)} pictures: the pictures show {columns} x {rows} corners inside "
        f"the board. Give --board {columns}x{rows}."
    )


class _Look(NamedTuple):
    """Detection in a picture."""

    size: tuple[int, int]
    seen: Seen | None
    tags: list[Tags]
    unclear: list[float]  # sides of tags whose edges are not clear


def _look(path: Path, board: Board, small_first: bool = False) -> _Look:
    """Look for the board in a picture, or return what was found in one of the same content before.

    ``small_first``: not in the whole picture unless a small copy shows the board.
    """
    data = _content(path)
    key = (sha256(data).digest(), board)
    look = _LOOKS.pop(key, None)
    if look is None:
        picture, tags, unclear = _decoded(data, path), list[Tags](), list[float]()
        if small_first and not in_small(picture, board):
            return _Look((picture.shape[1], picture.shape[0]), None, tags, unclear)
        seen = (tag_finder(board, tags, unclear) if board.kind in TAGS else FINDERS[board.kind](board))(picture)
        look = _Look((picture.shape[1], picture.shape[0]), seen, tags, unclear)
    _LOOKS[key] = look
    while len(_LOOKS) > 2000:  # looks that are kept
        _LOOKS.popitem(last=False)
    return look


def _commonest(ids: list[list[int]]) -> int | None:
    """Return the id of the tag to look for where several are in the pictures (one per picture), with a warning."""
    counts = Counter(number for each in ids for number in set(each))
    if len(counts) < 2:
        return None
    most = max(counts.values())
    one = min(number for number, count in counts.items() if count == most)
    often = [
        f"{number} ({count} pictures)"
        for number, count in sorted(counts.items())
        if count > MIN_SHARE_OF_COMMONEST_TAG * most
    ]
    if len(often) > 1:
        warnings.warn(
            f"Several tags are in the pictures: {listed(often)}. Tag {one} was taken; `first_id` (--first-id) chooses "
            "another.",
            InputWarning,
            stacklevel=4,
        )
    return one


def _unclear(names: list[str], n: int, sides: list[float]) -> str:
    """Return a sentence on pictures in which tags are seen, but not their edges."""
    low, high = f"{min(sides):.0f}", f"{max(sides):.0f}"
    size = low if low == high else f"{low} to {high}"
    return (
        f"Tags are in {len(names)} of {n} pictures with edges that are too small or not clear for corners (sides of "
        f"{size} px): {listed(names)}. A tag needs 4 px of white paper around it: take pictures from nearer, or print "
        "it with a wider rim."
    )


def _warn_of_copies(board: Board, ids: list[list[int]]) -> None:
    counts = Counter(number for each in ids for number, count in Counter(each).items() if count > 1)
    number = board.first_id if board.first_id is not None else next(iter(counts), None)
    if number is not None and counts[number]:
        warnings.warn(
            f"Tag {number} is more than once in {counts[number]} picture{'s' * (counts[number] > 1)}, of which the "
            "largest is taken in each: "
            "the poses may be of different tags. Cover the others.",
            InputWarning,
            stacklevel=4,
        )


def _ambiguous(board: Board) -> str:
    turn = "a half turn" if board.symmetry_order == 2 else "a quarter turn"
    return (
        f"A {board} looks the same after {turn}: its x axis is taken to point right in each picture, which is wrong "
        f"where the camera rolled by more than {90 if board.symmetry_order == 2 else 45} degrees. uq-handeye calibrate "
        "ROBOT --images resolves it by the robot poses. Better use ChArUco, or a board with an odd and an even number."
    )


def listed(names: Sequence[str]) -> str:
    """Names in a sentence, not all if they are too many."""
    rest = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    return ", ".join(names[:MAX_LISTED]) + rest


def source_of(images: str | Iterable[StrPath], board: Board) -> Source:
    """The pictures as one source: the hash is that of their contents, one after the other in natural order."""
    paths = picture_paths(images)
    total, size = sha256(), 0
    for path in paths:
        data = _content(path)
        total.update(data)
        size += len(data)
    names = _names(paths)
    sides = "squares" if board.kind in SQUARES else "tags"
    if board.kind in CIRCLES:
        sides = f"discs of {MM_PER_M * board.disc:g} mm, distances"
    note = f"{board}, {sides} of {MM_PER_M * board.side:g} mm; the hash is of all pictures one after the other"
    return Source(f"{names[0]} to {names[-1]} ({len(paths)})", "pictures", size, total.hexdigest(), (note,))
