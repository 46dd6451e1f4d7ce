"""The file of a result, of one camera or of a rig: one format, its head, and the checks that all of them share.

Reading checks the format, finite numbers, what the numbers mean (convention, units), and that derived numbers agree
with those they follow from. Sentences (``warnings``) are written for other programs and not read: the findings are.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np

from ..core.files.json_files import parsed, require_signed, signed_text
from ..core.files.json_values import JsonObject
from ..core.files.open import StrPath
from ..core.files.packed import unpacked
from ..core.files.records import attributes, damaged, unequal, wrong_number
from ..core.files.tree_values import is_map
from ..core.geometry.conventions import CONVENTION
from ..core.geometry.se3 import Array
from ..errors import InputError

R = TypeVar("R")

FORMAT = "uq-handeye calibration 8"
# First words of the headline of a result that cannot be used.
NOT_USABLE = "NOT USABLE"
UNITS = {"rotation": "rad", "translation": "m"}
# What a result is of, as the file says.
OF_CAMERA, OF_RIG = "camera", "rig"


def head_of(of: str) -> JsonObject:
    """Return the first values of a file: its format, what it is of, and what its numbers mean."""
    return {"format": FORMAT, "of": of, "convention": CONVENTION, "units": UNITS}


def not_a_result(value: object) -> InputError:
    """Return the error of what is no result of a calibration."""
    return InputError(f"Expected `result` to be a Calibration, got {type(value).__name__}.")


def read_result(data: Any, of: str, derived: str, made: Callable[[dict[str, Any]], R]) -> R:
    """Return the result that ``made`` makes of the values of a file; raises `InputError` for others.

    ``derived``: attributes of the result that follow from the rest, as `attributes` takes them. A file of another
    format is refused by its format.
    """
    found = data.get("format") if is_map(data) else data
    if found != FORMAT:
        raise InputError(
            f"Expected a result file of format {FORMAT!r}, got {found!r:.60}. Write it again with this version: "
            "uq-handeye calibrate ROBOT CAMERA -o DIR, or uq-handeye calibrate RIG.toml -o DIR."
        )
    with damaged("The calibration"):
        data = unpacked(data)
        if (where := wrong_number(data, "calibration")) is not None:
            raise ValueError(where)
        for name, expected in head_of(of).items():
            if data[name] != expected:
                raise ValueError(f"{name} is {data[name]!r:.60}, expected {expected!r:.60}")
        result = made(data)
        with np.errstate(divide="raise", over="raise", invalid="raise"):
            if (where := unequal(attributes(result, derived), data, "calibration")) is not None:
                raise ValueError(f"{where} does not fit the rest")
    return result


class StoredResult:
    """A result that is written to a file, with a checksum, and read from it.

    The result of one camera and that of several have the same names: ``cameras``, ``targets``, ``arms``, `relative`,
    ``headline``, ``status``, ``reasons``, ``answered``, ``usable``, ``facts``, ``of_camera``, ``verdicts``, ``export``,
    ``report``. What uses a result asks for these, and not for its kind.
    """

    @property
    def identity(self) -> tuple[str, tuple[Array | None, ...]]:
        """Return what the result is of, in a word, and the arrays that tell it from others."""
        raise NotImplementedError

    @property
    def digest(self) -> str:
        """16 hexadecimal digits that identify all poses, their covariance and the setup."""
        of, parts = self.identity
        found = hashlib.sha256(of.encode())
        for part in parts:
            found.update(b"-" if part is None else np.ascontiguousarray(part, dtype="<f8").tobytes())
        return found.hexdigest()[:16]

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain numbers, lists and text; see `from_dict`."""
        raise NotImplementedError

    @classmethod
    def from_dict(cls, data: Any) -> Self:
        """Return the result of what `to_dict` writes; raises `InputError` on anything else."""
        raise NotImplementedError

    def to_json(self, path: StrPath | None = None) -> str:
        """JSON text, also written to ``path`` (whole or not at all); numbers survive without loss."""
        return signed_text(self.to_dict(), path)

    def save(self, path: StrPath) -> Path:
        """Write the result file, as `to_json`, and return its path; `uq_handeye.load` reads it."""
        self.to_json(path)
        return Path(path)

    @classmethod
    def from_json(cls, path: StrPath, data: Any = None) -> Self:
        """Read the text that `to_json` writes; ``data``: the content of the file, if it has been parsed."""
        data = parsed(path) if data is None else data
        try:
            found = cls.from_dict(data)
            require_signed(data)
            return found
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
