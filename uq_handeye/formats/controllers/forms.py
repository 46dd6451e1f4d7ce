"""Table of the ways in which controllers write a pose: rotation, length unit, names of the numbers.

Poses as texts for a controller, a pendant or software of 3-D cameras: the forms of `forms`, and matrices.

Where the language of a controller has a literal of a pose, a line is that literal (URScript, KRL, RAPID, VAL 3);
otherwise the text is a table with units in its header. Numbers have all digits, so that reading them gives the pose
back to rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.formatting.units import LENGTH_UNITS
from ...core.geometry.se3 import Array
from ...errors import InputError
from ..contents import rotation_form

# Tables of many makers in one place; each convention was compared with the maker's words where these are public.
_POSE_FORMATS = "rc_visard manual, appendix Pose formats (docs.baslerweb.com/stereovisard)"
_MECH_MIND = "Mech-Mind documentation, Euler Angles (docs.mech-mind.net, appendix)"
_ROBODK = "RoboDK Python API, robomath (robodk.com/doc/en/PythonAPI/robodk.html)"


@dataclass(frozen=True)
class PoseForm:
    """A pose as a controller writes it.

    Parameters
    ----------
    name : as ``--robot-format`` takes it
    maker : for people
    rotation : text of a `RotationForm`
    units : length unit
    columns : names of the numbers of the rotation, in their order
    source : the maker's documentation that is followed
    """

    name: str
    maker: str
    rotation: str
    units: str
    columns: tuple[str, ...]
    source: str


_RXYZ = ("Rx", "Ry", "Rz")
_FORMS = (
    PoseForm("ur", "Universal Robots", "rotvec-rad", "m", ("rx", "ry", "rz"),
        "The URScript Programming Language: a pose is p[x, y, z, rx, ry, rz], m and rotation vector in rad"),
    PoseForm("kuka", "KUKA", "ZYX-deg", "mm", ("A", "B", "C"),
        "KUKA System Software, Operating and Programming Instructions for System Integrators: FRAME, A about Z, B "
        "about the new Y, C about the new X"),
    PoseForm("fanuc", "FANUC", "xyz-deg", "mm", ("W", "P", "R"),
        "FANUC Robot Controller Operator's Manual: W, P, R about the fixed axes X, Y, Z"),
    PoseForm("abb", "ABB", "wxyz", "mm", ("q1", "q2", "q3", "q4"),
        "RAPID Technical Reference Manual: robtarget, pos in mm, orient q1 (scalar) to q4"),
    PoseForm("staubli", "Staubli", "XYZ-deg", "mm", ("rx", "ry", "rz"),
        "VAL 3 Reference Manual: trsf {x, y, z, rx, ry, rz}, rotations about X, the new Y, the new Z"),
    PoseForm("yaskawa", "Yaskawa", "xyz-deg", "mm", _RXYZ,
        "Yaskawa Operator's Manual, wrist attitude: Rx, Ry, Rz about the fixed axes X, Y, Z"),
    PoseForm("kawasaki", "Kawasaki", "ZYZ-deg", "mm", ("O", "A", "T"),
        "Kawasaki AS Language Reference Manual: transformation values X, Y, Z, O, A, T, Euler angles Z, Y, Z"),
    PoseForm("mitsubishi", "Mitsubishi Electric (MELFA)", "xyz-deg", "mm", ("A", "B", "C"),
        f"{_POSE_FORMATS}, Mitsubishi: A, B, C about the fixed axes X, Y, Z"),
    PoseForm("denso", "Denso", "xyz-deg", "mm", ("RX", "RY", "RZ"), f"{_MECH_MIND}: static XYZ"),
    PoseForm("epson", "Epson", "ZYX-deg", "mm", ("U", "V", "W"), f"{_MECH_MIND}: rotated ZYX; U about Z, V, W"),
    PoseForm("doosan", "Doosan", "ZYZ-deg", "mm", ("A", "B", "C"), f"{_MECH_MIND}: rotated ZYZ; posx in DRL"),
    PoseForm("comau", "Comau", "ZYZ-deg", "mm", ("A", "E", "R"), f"{_MECH_MIND}: rotated ZYZ; {_ROBODK}, Pose_2_Comau"),
    PoseForm("techman", "Techman", "xyz-deg", "mm", _RXYZ, f"{_MECH_MIND}, TM: static XYZ"),
    PoseForm("dobot", "Dobot", "xyz-deg", "mm", _RXYZ, f"{_MECH_MIND}: static XYZ"),
    PoseForm("jaka", "JAKA", "xyz-deg", "mm", _RXYZ, f"{_MECH_MIND}: static XYZ"),
    PoseForm("xarm", "UFACTORY", "xyz-deg", "mm", ("roll", "pitch", "yaw"),
        "UFACTORY xArm User Manual, Attitude: R = Rz(yaw) Ry(pitch) Rx(roll); mm and deg by default in its Python SDK"),
    PoseForm("rpy", "URDF, ROS", "xyz-rad", "m", ("roll", "pitch", "yaw"),
        "wiki.ros.org/urdf/XML/joint, origin: rpy about the fixed axes"),
)  # fmt: skip
CONTROLLERS = {form.name: form for form in _FORMS}


# Marks of comments; # where a form is not named.
_COMMENTS = {"kuka": ";", "abb": "!", "staubli": "//"}
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
    mark = _COMMENTS.get(format, "#")
    form = CONTROLLERS.get(format)
    lines = _LINES[format](T, names) if form is None else _of_controller(T, form, names)
    return "\n".join([*(f"{mark} {comment}" for comment in comments), *lines, ""])


def _of_controller(T: Array, form: PoseForm, names: Sequence[str]) -> list[str]:
    numbers = in_form(T, form)
    if form.name in _LITERALS:
        literal = _LITERALS[form.name]
        return [literal(name, list(map(repr, row))) for name, row in zip(names, numbers.tolist(), strict=True)]
    head = [f"{name} [{unit}]" if unit else name for name, unit in zip(*columns(form), strict=True)]
    return [",".join(head), *(",".join(map(repr, row)) for row in numbers.tolist())]


def _kuka(name: str, numbers: list[str]) -> str:
    fields = zip("XYZABC", numbers, strict=True)
    return f"DECL FRAME {name}={{{','.join(f'{axis} {number}' for axis, number in fields)}}}"


def _abb(name: str, numbers: list[str]) -> str:
    return f"CONST pose {name}:=[[{','.join(numbers[:3])}],[{','.join(numbers[3:])}]];"


_LITERALS: dict[str, Callable[[str, list[str]], str]] = {
    "ur": lambda name, numbers: f"{name} = p[{', '.join(numbers)}]",
    "kuka": _kuka,
    "abb": _abb,
    "staubli": lambda name, numbers: f"{{{','.join(numbers)}}}",
}


def _rows(T: Array) -> list[str]:
    return [" ".join(map(repr, row)) for row in T.tolist()]


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
    "matrix": lambda T, names: [" ".join(_rows(pose)) for pose in T],
    "franka": _franka,
    "zivid": _zivid,
    "halcon": _halcon,
}
# All formats of `written_poses`.
WRITTEN = (*CONTROLLERS, *_LINES)
