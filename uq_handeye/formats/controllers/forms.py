"""Table of the ways in which controllers write a pose: rotation, length unit, names of the numbers."""

from __future__ import annotations

from dataclasses import dataclass

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
    PoseForm(
        "ur",
        "Universal Robots",
        "rotvec-rad",
        "m",
        ("rx", "ry", "rz"),
        "The URScript Programming Language: a pose is p[x, y, z, rx, ry, rz], m and rotation vector in rad",
    ),
    PoseForm(
        "kuka",
        "KUKA",
        "ZYX-deg",
        "mm",
        ("A", "B", "C"),
        "KUKA System Software, Operating and Programming Instructions for System Integrators: FRAME, A about Z, B "
        "about the new Y, C about the new X",
    ),
    PoseForm(
        "fanuc",
        "FANUC",
        "xyz-deg",
        "mm",
        ("W", "P", "R"),
        "FANUC Robot Controller Operator's Manual: W, P, R about the fixed axes X, Y, Z",
    ),
    PoseForm(
        "abb",
        "ABB",
        "wxyz",
        "mm",
        ("q1", "q2", "q3", "q4"),
        "RAPID Technical Reference Manual: robtarget, pos in mm, orient q1 (scalar) to q4",
    ),
    PoseForm(
        "staubli",
        "Staubli",
        "XYZ-deg",
        "mm",
        ("rx", "ry", "rz"),
        "VAL 3 Reference Manual: trsf {x, y, z, rx, ry, rz}, rotations about X, the new Y, the new Z",
    ),
    PoseForm(
        "yaskawa",
        "Yaskawa",
        "xyz-deg",
        "mm",
        _RXYZ,
        "Yaskawa Operator's Manual, wrist attitude: Rx, Ry, Rz about the fixed axes X, Y, Z",
    ),
    PoseForm(
        "kawasaki",
        "Kawasaki",
        "ZYZ-deg",
        "mm",
        ("O", "A", "T"),
        "Kawasaki AS Language Reference Manual: transformation values X, Y, Z, O, A, T, Euler angles Z, Y, Z",
    ),
    PoseForm(
        "mitsubishi",
        "Mitsubishi Electric (MELFA)",
        "xyz-deg",
        "mm",
        ("A", "B", "C"),
        f"{_POSE_FORMATS}, Mitsubishi: A, B, C about the fixed axes X, Y, Z",
    ),
    PoseForm("denso", "Denso", "xyz-deg", "mm", ("RX", "RY", "RZ"), f"{_MECH_MIND}: static XYZ"),
    PoseForm("epson", "Epson", "ZYX-deg", "mm", ("U", "V", "W"), f"{_MECH_MIND}: rotated ZYX; U about Z, V, W"),
    PoseForm("doosan", "Doosan", "ZYZ-deg", "mm", ("A", "B", "C"), f"{_MECH_MIND}: rotated ZYZ; posx in DRL"),
    PoseForm("comau", "Comau", "ZYZ-deg", "mm", ("A", "E", "R"), f"{_MECH_MIND}: rotated ZYZ; {_ROBODK}, Pose_2_Comau"),
    PoseForm("techman", "Techman", "xyz-deg", "mm", _RXYZ, f"{_MECH_MIND}, TM: static XYZ"),
    PoseForm("dobot", "Dobot", "xyz-deg", "mm", _RXYZ, f"{_MECH_MIND}: static XYZ"),
    PoseForm("jaka", "JAKA", "xyz-deg", "mm", _RXYZ, f"{_MECH_MIND}: static XYZ"),
    PoseForm(
        "xarm",
        "UFACTORY",
        "xyz-deg",
        "mm",
        ("roll", "pitch", "yaw"),
        "UFACTORY xArm User Manual, Attitude: R = Rz(yaw) Ry(pitch) Rx(roll); mm and deg by default in its Python SDK",
    ),
    PoseForm(
        "rpy",
        "URDF, ROS",
        "xyz-rad",
        "m",
        ("roll", "pitch", "yaw"),
        "wiki.ros.org/urdf/XML/joint, origin: rpy about the fixed axes",
    ),
)
CONTROLLERS = {form.name: form for form in _FORMS}
