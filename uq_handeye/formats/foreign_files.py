"""Recognition of files that are no pose files, by their first bytes or their suffix, and advice for each."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from ..core.files.trees import parse_toml
from ..errors import InputError
from .contents import conversion

_HDF = b"\x89HDF\r\n\x1a\n"
_ZIP = b"PK\x03\x04"
_PICKLED = (".pkl", ".pickle", ".joblib", ".p")


@cache
def _foreign() -> dict[str, dict[str, str]]:
    """Return what files that hold no poses are, in words, and which of them each beginning tells."""
    return parse_toml(Path(__file__).with_name("foreign.toml"))


def refuse_foreign(head: bytes, name: str, suffix: str) -> None:
    """Raise `InputError` for a file that holds no poses that can be read, by its first bytes."""
    words, starts = _foreign().values()
    for start, what in starts.items():
        if head.startswith(start.encode("latin-1")):
            raise InputError(f"{name} {words[what]}")
    if suffix.lower() == ".zdf":
        raise InputError(f"{name} is a frame of Zivid, and {words['cloud'].removeprefix('is ')}")
    if head.startswith(_HDF):
        raise InputError(
            f"{name} is an HDF5 file: write the poses (n, 4, 4) by numpy.save (docs/formats.md, NPZ and NPY)."
        )
    pickled = head[:1] == b"\x80" and head[1:2] in (b"\x02", b"\x03", b"\x04", b"\x05")
    if pickled or (suffix.lower() in _PICKLED and not head.startswith((b"\x93NUMPY", _ZIP))):
        module = "joblib" if suffix.lower() == ".joblib" else "pickle"
        load = "joblib.load(FILE)" if module == "joblib" else "pickle.load(open(FILE, 'rb'))"
        raise InputError(
            f"{name} is a pickle of Python, which is never loaded: it can run any code. {conversion(name, load)}"
        )
    if head.startswith(_ZIP):
        member = head[30 : 30 + int.from_bytes(head[26:28], "little")]
        office = b"[Content_Types].xml" in head[:4096] or member.startswith((b"xl/", b"docProps/"))
        if office or suffix.lower() == ".ods":
            raise InputError(f"{name} {words['sheet']}")
        if member and not member.endswith(b".npy") and suffix.lower() != ".npz":
            raise InputError(f"{name} is a ZIP archive: unpack it, and give the file or the folder of the poses.")
