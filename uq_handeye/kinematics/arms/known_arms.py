r"""Nominal kinematics of common arms, by name.

An arm is described in its zero posture, where the axes of all joints are parallel to those of the base: one line per
joint, from base to tip,

    axis    x y z    lower upper    usual lower upper

with the axis and the direction of its positive rotation in the base, the position of the joint frame from that of the
joint before it (mm, axes of the base), the limits of the joint (deg), and the range that it has in ordinary work (deg):
elbow up, tool in front, wrist bent to one side, so that one pose has one posture there, and the roll of the elbow of
seven axes in the middle of its range. The last line is the flange: its position from the last joint frame, and which
axes of the base its x and z are. Joint values, base and flange are those of the maker's controller (tool 0), where it
is not said otherwise.

The numbers are nominal ones of data sheets and of the robot descriptions that makers and ROS-Industrial publish. A
controller that has the calibrated numbers of its arm (UR, calibrated ABB) differs by up to some mm.
"""

from __future__ import annotations

import difflib
import functools
import re
from typing import NamedTuple

import numpy as np

from ...errors import InputError
from ...geometry.se3 import Array
from ..joint import REVOLUTE, ChainParts, Joint


class KnownArm(NamedTuple):
    """An arm of the table."""

    parts: ChainParts
    usual: Array  # (L, 2) range of each joint in ordinary work, rad
    source: str


_ELBOW_ARM = "data sheet (dimensions, limits); joint directions as in the maker's ROS-Industrial description"
_UR = "maker's published DH parameters; base and flange of the controller"

# Name: (lines, source).
_TABLE: dict[str, tuple[str, str]] = {
    "ur3e": (
        """
        +z     0      0     151.85   -360 360   -180 180
        -y     0      0       0      -360 360   -130 -10
        -y  -243.55   0       0      -360 360     10 160
        -y  -213.2    0       0      -360 360   -180 180
        -z     0   -131.05    0      -360 360   -170 -10
        -y     0      0     -85.35   -360 360   -180 180
               0    -92.1     0      +x -y
        """,
        _UR,
    ),
    "ur5e": (
        """
        +z     0      0     162.5    -360 360   -180 180
        -y     0      0       0      -360 360   -130 -10
        -y  -425      0       0      -360 360     10 160
        -y  -392.2    0       0      -360 360   -180 180
        -z     0   -133.3     0      -360 360   -170 -10
        -y     0      0     -99.7    -360 360   -180 180
               0    -99.6     0      +x -y
        """,
        _UR,
    ),
    "irb120": (
        """
        +z     0      0     290      -165 165   -165 165
        +y     0      0       0      -110 110    -45 100
        +y     0      0     270      -110  70    -70  65
        +x     0      0      70      -160 160   -180 180
        +y   302      0       0      -120 120      5 120
        +x     0      0       0      -400 400   -180 180
              72      0       0      -z +x
        """,
        _ELBOW_ARM,
    ),
    "irb2600": (
        """
        +z     0      0     445      -180 180   -180 180
        +y   150      0       0       -95 155    -50 100
        +y     0      0     700      -180  75    -75  70
        +x     0      0     115      -400 400   -180 180
        +y   795      0       0      -120 120      5 120
        +x     0      0       0      -400 400   -180 180
              85      0       0      -z +x
        """,
        "IRB 2600-12/1.65; " + _ELBOW_ARM,
    ),
    "kr6r900": (
        """
        -z     0      0     400      -170 170   -170 170
        +y    25      0       0      -190  45   -135 -10
        +y   455      0       0      -120 156     10 150
        -x     0      0      35      -185 185   -180 180
        +y   420      0       0      -120 120      5 120
        -x     0      0       0      -350 350   -180 180
              80      0       0      -z +x
        """,
        _ELBOW_ARM,
    ),
    "lrmate200id": (
        """
        +z     0      0       0      -170 170   -170 170
        +y    50      0       0      -100 145    -50 100
        -y     0      0     330      -140 213    -70  70
        -x     0      0      35      -190 190   -180 180
        -y   335      0       0      -125 125   -120  -5
        -x     0      0       0      -360 360   -180 180
              80      0       0      +z +x
        """,
        _ELBOW_ARM,
    ),
    "crx10ia": (
        """
        +z     0      0       0      -190 190   -180 180
        +y     0      0       0      -180 180    -50 100
        -y     0      0     540      -270 270    -80  80
        -x     0      0       0      -190 190   -180 180
        -y   540      0       0      -180 180   -170 -10
        -x     0   -150       0      -225 225   -180 180
             160      0       0      +z +x
        """,
        _ELBOW_ARM,
    ),
    "tx260": (
        """
        +z     0      0       0      -180 180   -180 180
        +y     0     20       0      -127 127    -40 100
        +y     0      0     290      -142 142     10 140
        +z     0      0       0      -270 270   -180 180
        +y     0      0     310      -122 132      5 130
        +z     0      0       0      -270 270   -180 180
               0      0      70      +x +z
        """,
        _ELBOW_ARM,
    ),
    "m1013": (
        """
        +z     0      0     152.5    -360 360   -180 180
        +y     0     34.5     0       -95  95    -40 95
        +y     0      0     620      -135 135     10 135
        +z     0      0       0      -360 360   -180 180
        +y     0      0     559      -135 135      5 130
        +z     0      0       0      -360 360   -180 180
               0      0     121      +x +z
        """,
        _ELBOW_ARM,
    ),
    "xarm6": (
        """
        +z     0      0     267      -360 360   -180 180
        +y     0      0       0      -118 120    -60 80
        -y    53.5    0     284.5    -225  11      0 100
        -z    77.5    0    -342.5    -360 360   -180 180
        -y     0      0       0       -97 180      5 120
        -z    76      0     -97      -360 360   -180 180
               0      0       0      +x -z
        """,
        _ELBOW_ARM,
    ),
    "iiwa14": (
        """
        +z     0      0     157.5    -170 170   -170 170
        +y     0      0     202.5    -120 120      0  90
        +z     0      0     204.5    -170 170     20  30
        -y     0      0     215.5    -120 120   -120 -10
        +z     0      0     184.5    -170 170   -180 180
        +y     0      0     215.5    -120 120      5 120
        +z     0      0      81      -175 175   -180 180
               0      0      45      +x +z
        """,
        _ELBOW_ARM,
    ),
    "panda": (
        """
        +z     0      0     333      -166 166   -166 166
        +y     0      0       0      -101 101    -60  70
        +z     0      0     316      -166 166    -10  10
        -y    82.5    0       0      -176  -4   -150 -25
        +z   -82.5    0     384      -166 166   -180 180
        -y     0      0       0        -1 215     20 200
        -z    88      0       0      -166 166   -180 180
               0      0    -107      +x -z
        """,
        "maker's published DH parameters (Craig's)",
    ),
    "gen3": (
        """
        +z     0      0     156.43   -360 360   -180 180
        +y     0     -5.375 128.38   -129 129      0  90
        -z     0     -6.375 210.38   -360 360    -30 -20
        +y     0     -6.375 210.38   -148 148     10 140
        -z     0     -6.375 208.43   -360 360   -180 180
        +y     0     -0.175 105.93   -120 120      5 118
        -z     0     -0.175 105.93   -360 360   -180 180
               0      0      61.525  +x +z
        """,
        "maker's published robot description",
    ),
}


def _vector(text: str) -> Array:
    """(3,) unit vector of an axis such as ``-y``."""
    out = np.zeros(3)
    out["xyz".index(text[1])] = 1.0 if text[0] == "+" else -1.0
    return out


def plain(name: str) -> str:
    """Return a name in lower case without spaces, ``-``, ``_`` and ``/``."""
    return re.sub(r"[\s_/.-]+", "", name).lower()


def arm_names() -> tuple[str, ...]:
    """Names of the arms of the table."""
    return tuple(_TABLE)


@functools.lru_cache(maxsize=64)
def _read(name: str) -> KnownArm:
    lines, source = _TABLE[name]
    *rows, flange = [line.split() for line in lines.strip().splitlines()]
    joints, usual = [], []
    for k, (axis, *fields) in enumerate(rows):
        numbers = [float(field) for field in fields]
        origin = np.eye(4)
        origin[:3, 3] = np.array(numbers[:3]) * 1e-3
        low, high = np.radians(numbers[3:5])
        joints.append(Joint(f"joint_{k + 1}", REVOLUTE, origin, _vector(axis), float(low), float(high)))
        usual.append(np.radians(numbers[5:7]))
    end = np.eye(4)
    x, z = _vector(flange[3]), _vector(flange[4])
    end[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    end[:3, 3] = np.array([float(field) for field in flange[:3]]) * 1e-3
    return KnownArm(ChainParts(name, "base", "tool0", tuple(joints), end, None), np.array(usual), source)


def known_arm(name: str) -> KnownArm:
    """Return an arm by its name; case, spaces, ``-``, ``_`` and ``/`` do not matter.

    Raises `InputError` for a name that is not in the table, with the nearest ones.
    """
    by_plain = {plain(known): known for known in _TABLE}
    found = by_plain.get(plain(name))
    if found is None:
        near = difflib.get_close_matches(plain(name), by_plain, n=3, cutoff=0.5)
        hint = f"did you mean {' or '.join(by_plain[one] for one in near)}?" if near else f"known: {', '.join(_TABLE)}."
        raise InputError(f"No arm of the name {name!r:.60} is known; {hint}")
    return _read(found)
