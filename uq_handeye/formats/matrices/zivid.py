"""Transforms of Zivid: one matrix 4x4 per YAML file, in mm.

    __version__:                          %YAML:1.0
      serializer: 1                       ---
      data: 1                             PoseState: !!opencv-matrix
    FloatMatrix:                             rows: 4
      Data: [[1, 0, 0, 400], ...]            ...

Source: zivid/zivid-python-samples, ``source/sample_utils/save_load_matrix.py`` (today's form, also what
``zivid.Matrix4x4.save`` writes) and ``robotTransform.yaml`` of 2020 (the older one); translations in mm as
``zivid.calibration.Pose`` takes them.
"""

from __future__ import annotations

import re

import numpy as np

from ...core.files.tree_values import fields_of, got, is_list, items_of, number
from ...core.files.trees import parse_tree
from ...errors import InputError
from ..contents import Contents, Reading, matrices_side
from ..opencv_storage import stack
from .layout import matrices_in

_ZIVID = (Reading("zivid", "matrix", "mm"),)
_KEYS = ("FloatMatrix", "PoseState")
_IS = re.compile(r"^\s*[\"']?(FloatMatrix|PoseState)[\"']?\s*:", re.MULTILINE)


def is_zivid(head: str) -> bool:
    """Return whether a text is a transform of Zivid."""
    return _IS.search(head) is not None


def read_zivid(text: str, name: str) -> Contents:
    """Return the pose of a file."""
    tree = parse_tree(text.encode(), name)
    key = next((key for key in _KEYS if key in fields_of(tree)), None)
    if key is None:
        raise InputError(f"{name}: expected FloatMatrix or PoseState (docs/formats.md, Zivid), got {got(tree)}.")
    value, where = fields_of(tree)[key], f"{name}, {key}"
    if key == "FloatMatrix":
        if "Data" not in fields_of(value):
            raise InputError(f"{where}: expected Data with a matrix 4x4, got {got(value)}.")
        data, where = items_of(value["Data"]), f"{where}, Data"
        flat = [entry for row in data for entry in (row if is_list(row) else [row])]
        numbers = np.array([number(entry, where) for entry in flat])
    else:
        numbers = stack(value, where).reshape(-1)
    if numbers.size != 16:
        raise InputError(f"{where}: expected a matrix 4x4, got {numbers.size} numbers.")
    found = matrices_in(numbers.reshape(1, 16))
    if found is None:
        raise InputError(f"{where}: expected the last row 0, 0, 0, 1, got {numbers[12:].tolist()}.")
    return Contents(
        only=matrices_side(where, found.T, readings=_ZIVID), notes=("translations in mm, as Zivid has them",)
    )
