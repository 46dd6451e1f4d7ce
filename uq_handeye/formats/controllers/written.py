"""Poses written as text for a controller, a pendant or 3-D camera software, in the forms of `forms` or as matrices.

Where the language of a controller has a literal of a pose, a line is that literal (URScript, KRL, RAPID, VAL 3);
otherwise the text is a table with units in its header. Numbers have all digits, so that reading them gives the pose
back to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ...core.geometry.se3 import Array
from ...core.presentation.units import LENGTH_UNITS
from ...errors import InputError
from ..rotations import rotation_form
from .forms import CONTROLLERS, PoseForm

# HALCON's pose type 0: 'Rp+T', 'gba', 'point', that is Rx(alpha) Ry(beta) Rz(gamma).
_HALCON = rotation_form("XYZ-deg")
# Files of one pose.
SINGLE = ("zivid", "halcon")


def in_form(T: Array, form: PoseForm) -> Array:
    """Numbers (n, 3 + k) of poses (n, 4, 4) in metres as a controller writes them."""
    rotation = rotation_form(form.rotation).encode(T[:, :3, :3])
    return np.concatenate([T[:, :3, 3] / LENGTH_UNITS[form.units], rotation], axis=1) + 0.0


def columns(form: PoseForm) -> tuple[list[str], list[str]]:
    """Return names and units of the numbers of `in_form`."""
    capital = form.columns[0][0].isupper()
    axes = list("XYZ" if capital else "xyz")
    unit = form.rotation.partition("-")[2]
    return [*axes, *form.columns], [form.units] * 3 + [unit] * len(form.columns)


def written_poses(T: Array, format: str, names: Sequence[str], comments: Sequence[str] = ()) -> str:
    """Return poses (n, 4, 4) in metres as text in a format of `WRITTEN`, below lines of comments.

    Raises `InputError` for an unknown format, and for several poses in a format of one per file.
    """
    if format not in WRITTEN:
        raise InputError(f"Expected `format` to be one of {', '.join(WRITTEN)}, got {format!r}.")
    if format in SINGLE and len(T) != 1:
        raise InputError(f"A file of the format {format} holds one pose, not {len(T)}.")
    form = CONTROLLERS.get(format)
    mark = "#" if form is None else form.comment
    lines = _LINES[format](T, names) if form is None else _of_controller(T, form, names)
    return "\n".join([*(f"{mark} {comment}" for comment in comments), *lines, ""])


def _of_controller(T: Array, form: PoseForm, names: Sequence[str]) -> list[str]:
    numbers = in_form(T, form)
    if form.literal:
        return [form.literal.format(*row, name=name) for name, row in zip(names, numbers.tolist(), strict=True)]
    head = [f"{name} [{unit}]" if unit else name for name, unit in zip(*columns(form), strict=True)]
    return [",".join(head), *(",".join(map(repr, row)) for row in numbers.tolist())]


def _franka(T: Array, names: Sequence[str]) -> list[str]:
    head = ",".join(f"O_T_EE_{k}" for k in range(16))
    return [head, *(",".join(map(repr, pose.T.ravel().tolist())) for pose in T)]


def _zivid(T: Array, names: Sequence[str]) -> list[str]:
    in_mm = T[0].copy()
    in_mm[:3, 3] *= 1e3
    rows = ",\n".join(f"    [{', '.join(map(repr, row))}]" for row in in_mm.tolist())
    return ["__version__:", "  serializer: 1", "  data: 1", "FloatMatrix:", "  Data: [", *rows.split("\n"), "  ]"]


def _halcon(T: Array, names: Sequence[str]) -> list[str]:
    angles = (_HALCON.encode(T[:, :3, :3]) + 0.0)[0].tolist()
    return [
        "# 3D POSE PARAMETERS: rotation and translation",
        "",
        "# Used representation type:",
        "f 0",
        "",
        "# Rotation angles [deg] or Rodriguezvector:",
        f"r {' '.join(map(repr, angles))}",
        "",
        "# Translation vector (x y z [m]):",
        f"t {' '.join(map(repr, T[0, :3, 3].tolist()))}",
    ]


_LINES: dict[str, Callable[[Array, Sequence[str]], list[str]]] = {
    "matrix": lambda T, names: [" ".join(map(repr, pose.ravel().tolist())) for pose in T],
    "franka": _franka,
    "zivid": _zivid,
    "halcon": _halcon,
}


# All formats of `written_poses`.
WRITTEN = (*CONTROLLERS, *_LINES)
