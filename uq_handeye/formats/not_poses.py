"""Files that people give in place of poses, by their first bytes or their suffix: each refused with what to do."""

from __future__ import annotations

from pathlib import PurePath

from ..errors import InputError

_PICTURE = (
    "is a picture: give pictures of the board by --images 'DIR/*.png' with --board (docs/how-to/camera.md), in place "
    "of a file of camera poses."
)
_BAG = (
    "is a ROS bag: give it by --bag, with --robot and --camera; uq-handeye bag lists its content (docs/how-to/ros.md)."
)
_CLOUD = (
    "is a point cloud, and holds no poses: detect the target in it, and give its poses, or its points to uq-handeye "
    "points (docs/how-to/points.md)."
)
_SHEET = "is a spreadsheet: save the sheet as CSV (docs/formats.md)."
# Beginnings that leave no doubt.
_STARTS: tuple[tuple[bytes, str], ...] = (
    (b"\x89PNG\r\n\x1a\n", _PICTURE),
    (b"\xff\xd8\xff", _PICTURE),
    (b"GIF8", _PICTURE),
    (b"II*\0", _PICTURE),
    (b"MM\0*", _PICTURE),
    (b"%PDF-", "is a PDF: copy its table into a text file (docs/formats.md)."),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", _SHEET),
    (
        b"MATLAB 7.3 MAT-file",
        "is a MAT-file of version 7.3: save it again in MATLAB by save('robot.mat', 'T', '-v7'), or write a row per "
        "pose by writematrix(reshape(T, 16, []).', 'robot.csv').",
    ),
    (b"#ROSBAG V", _BAG),
    (b"\x89MCAP0\r\n", _BAG),
    (b"SQLite format 3\0", _BAG),
    (b"ply\n", _CLOUD),
    (b"ply\r\n", _CLOUD),
    (b"# .PCD", _CLOUD),
    (b"PAR1", "is a Parquet table: write it as CSV (docs/formats.md)."),
    (b"7z\xbc\xaf\x27\x1c", "is an archive: unpack it, and give the file or the folder of the poses."),
    (b"Rar!", "is an archive: unpack it, and give the file or the folder of the poses."),
)
_HDF = b"\x89HDF\r\n\x1a\n"
_ZIP = b"PK\x03\x04"
_PICKLED = (".pkl", ".pickle", ".joblib", ".p")


def refuse_foreign(head: bytes, name: str, suffix: str) -> None:
    """Raise `InputError` for a file that holds no poses that can be read, by its first bytes."""
    for start, what in _STARTS:
        if head.startswith(start):
            raise InputError(f"{name} {what}")
    if head.startswith(_HDF):
        if suffix.lower() == ".zdf":
            raise InputError(f"{name} is a frame of Zivid, and {_CLOUD.removeprefix('is ')}")
        raise InputError(
            f"{name} is an HDF5 file: write the poses (n, 4, 4) by numpy.save (docs/formats.md, NPZ and NPY)."
        )
    if suffix.lower() == ".zdf":
        raise InputError(f"{name} is a frame of Zivid, and {_CLOUD.removeprefix('is ')}")
    pickled = head[:1] == b"\x80" and head[1:2] in (b"\x02", b"\x03", b"\x04", b"\x05")
    if pickled or (suffix.lower() in _PICKLED and not head.startswith((b"\x93NUMPY", _ZIP))):
        module = "joblib" if suffix.lower() == ".joblib" else "pickle"
        load = "joblib.load(FILE)" if module == "joblib" else "pickle.load(open(FILE, 'rb'))"
        raise InputError(
            f"{name} is a pickle of Python, which is never loaded: it can run any code. {conversion(name, load)}"
        )
    if head.startswith(_ZIP):
        member = head[30 : 30 + int.from_bytes(head[26:28], "little")]
        if (
            b"[Content_Types].xml" in head[:4096]
            or member.startswith((b"xl/", b"docProps/"))
            or suffix.lower() == ".ods"
        ):
            raise InputError(f"{name} {_SHEET}")
        if member and not member.endswith(b".npy") and suffix.lower() != ".npz":
            raise InputError(f"{name} is a ZIP archive: unpack it, and give the file or the folder of the poses.")


def conversion(name: str, load: str) -> str:
    """Return the sentence with the Python line that converts a trusted file, which is FILE in ``load``."""
    path = PurePath(name.partition(", ")[0])
    module = load.partition(".")[0]
    imports = "numpy as np" if "np." in load else f"{module}, numpy as np"
    target = path.stem + ("_poses.npy" if path.suffix == ".npy" else ".npy")
    return (
        f"If you trust it, convert it: import {imports}; "
        f"np.save('{target}', np.array({load.replace('FILE', repr(path.name))}, dtype=float))"
    )
