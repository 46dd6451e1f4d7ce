r"""Nominal kinematics of common arms, by name.

An arm is described in its zero posture, where the axes of all joints are parallel to those of the base: one line per
joint, from base to tip,

    axis    x y z    lower upper    usual lower upper

with the axis and the direction of its positive rotation in the base, the position of the joint frame from that of the
joint before it (mm, axes of the base), the limits of the joint (deg), and the range that it has in ordinary work (deg):
elbow up, tool in front, wrist bent to one side, so that one pose has one posture there; the roll of the elbow of seven
axes has a narrow range. The last line is the flange: its position from the last joint frame, and which axes of the base
its x and z are. Such lines hold what Denavit-Hartenberg rows do and the signs and zeros of the joints as well.

Joint values, base and flange are those of the maker's controller (its tool 0), with these exceptions:

- FANUC: joint 3 is the angle between upper arm and forearm; the controller reports it from the horizontal, that is plus
  joint 2.
- Kawasaki: the direction of the flange's x is a guess (a constant turn of the flange, which X absorbs).
- The origin of the base is on joint axis 1; FANUC, Yaskawa and Staubli have it at the height of joint 2.

The numbers are nominal: those of data sheets and of the robot descriptions that makers and ROS-Industrial publish. A
controller that has the calibrated numbers of its arm (UR, calibrated ABB) differs by up to some mm.
"""

from __future__ import annotations

import difflib
import functools
import re
from typing import NamedTuple

import numpy as np

from ....core.geometry.se3 import Array
from ....errors import InputError
from ..joint import REVOLUTE, ChainParts, Joint


class KnownArm(NamedTuple):
    """An arm of the table."""

    parts: ChainParts
    usual: Array  # (L, 2) range of each joint in ordinary work, rad
    source: str


class _Entry(NamedTuple):
    maker: str
    lines: str
    source: str


def _ur(d1: float, a2: float, a3: float, d4: float, d5: float, d6: float) -> _Entry:
    """Return a Universal Robots arm of these DH parameters, mm."""
    lines = f"""
        +z     0      0    {d1}   -360 360   -180 180
        -y     0      0     0     -360 360   -130 -10
        -y  {-a2}     0     0     -360 360     10 160
        -y  {-a3}     0     0     -360 360   -180 180
        -z     0   {-d4}    0     -360 360   -170 -10
        -y     0      0   {-d5}   -360 360   -180 180
               0   {-d6}    0       +x -y
    """
    return _Entry("Universal Robots", lines, "the maker's published DH parameters, base and flange of the controller")


_DATA_SHEET = "data sheet; signs and zeros as in the ROS-Industrial description"
_DESCRIPTION = "the maker's published robot description"

_FRANKA = """
    +z     0      0     333      {}   -160 160
    +y     0      0       0      {}    -60  70
    +z     0      0     316      {}    -10  10
    -y    82.5    0       0      {}   -150 -25
    +z   -82.5    0     384      {}   -180 180
    -y     0      0       0      {}     35 200
    -z    88      0       0      {}   -166 166
           0      0    -107      +x -z
"""

_TABLE: dict[str, _Entry] = {
    "ur3e": _ur(151.85, 243.55, 213.2, 131.05, 85.35, 92.1),
    "ur5e": _ur(162.5, 425, 392.2, 133.3, 99.7, 99.6),
    "ur10e": _ur(180.7, 612.7, 571.55, 174.15, 119.85, 116.55),
    "ur16e": _ur(180.7, 478.4, 360, 174.15, 119.85, 116.55),
    "ur5": _ur(89.159, 425, 392.25, 109.15, 94.65, 82.3),
    "ur10": _ur(127.3, 612, 572.3, 163.941, 115.7, 92.2),
    "irb120": _Entry(
        "ABB",
        """
        +z     0      0     290      -165 165   -165 165
        +y     0      0       0      -110 110    -45 100
        +y     0      0     270      -110  70    -70  65
        +x     0      0      70      -160 160   -180 180
        +y   302      0       0      -120 120      5 120
        +x     0      0       0      -400 400   -180 180
              72      0       0      -z +x
        """,
        _DATA_SHEET + " (IRB 120-3/0.6)",
    ),
    "irb1200": _Entry(
        "ABB",
        """
        +z     0      0     399      -170 170   -170 170
        +y     0      0       0      -100 130    -45 100
        +y     0      0     448      -200  70    -80  65
        +x     0      0      42      -270 270   -180 180
        +y   451      0       0      -130 130      5 125
        +x     0      0       0      -400 400   -180 180
              82      0       0      -z +x
        """,
        _DATA_SHEET + " (IRB 1200-5/0.9)",
    ),
    "irb2600": _Entry(
        "ABB",
        """
        +z     0      0     445      -180 180   -180 180
        +y   150      0       0       -95 155    -50 100
        +y     0      0     700      -180  75    -75  70
        +x     0      0     115      -400 400   -180 180
        +y   795      0       0      -120 120      5 120
        +x     0      0       0      -400 400   -180 180
              85      0       0      -z +x
        """,
        _DATA_SHEET + " (IRB 2600-12/1.65)",
    ),
    "irb4600": _Entry(
        "ABB",
        """
        +z     0      0     495      -180 180   -180 180
        +y   175      0       0       -90 150    -50 100
        +y     0      0     900      -180  75    -75  70
        +x     0      0     175      -400 400   -180 180
        +y   960      0       0      -125 120      5 120
        +x     0      0       0      -400 400   -180 180
             135      0       0      -z +x
        """,
        "data sheet (IRB 4600-60/2.05)",
    ),
    "kr6r900": _Entry(
        "KUKA",
        """
        -z     0      0     400      -170 170   -170 170
        +y    25      0       0      -190  45   -135 -10
        +y   455      0       0      -120 156     10 150
        -x     0      0      35      -185 185   -180 180
        +y   420      0       0      -120 120      5 120
        -x     0      0       0      -350 350   -180 180
              80      0       0      -z +x
        """,
        _DATA_SHEET + " (KR 6 R900 sixx)",
    ),
    "kr10r1100": _Entry(
        "KUKA",
        """
        -z     0      0     400      -170 170   -170 170
        +y    25      0       0      -190  45   -135 -10
        +y   560      0       0      -120 156     10 150
        -x     0      0      35      -185 185   -180 180
        +y   515      0       0      -120 120      5 120
        -x     0      0       0      -350 350   -180 180
              80      0       0      -z +x
        """,
        _DATA_SHEET + " (KR 10 R1100 sixx)",
    ),
    "iiwa7": _Entry(
        "KUKA",
        """
        +z     0      0     157.5    -170 170   -170 170
        +y     0      0     182.5    -120 120    -30 100
        +z     0      0     182.5    -170 170     -5   5
        -y     0      0     217.5    -120 120   -115 -10
        +z     0      0     182.5    -170 170   -180 180
        +y     0      0     217.5    -120 120      5 120
        +z     0      0      81      -175 175   -180 180
               0      0      45      +x +z
        """,
        _DATA_SHEET + " (LBR iiwa 7 R800)",
    ),
    "iiwa14": _Entry(
        "KUKA",
        """
        +z     0      0     157.5    -170 170   -170 170
        +y     0      0     202.5    -120 120    -30 100
        +z     0      0     204.5    -170 170     20  30
        -y     0      0     215.5    -120 120   -115 -10
        +z     0      0     184.5    -170 170   -180 180
        +y     0      0     215.5    -120 120      5 120
        +z     0      0      81      -175 175   -180 180
               0      0      45      +x +z
        """,
        _DATA_SHEET + " (LBR iiwa 14 R820)",
    ),
    "lrmate200id": _Entry(
        "FANUC",
        """
        +z     0      0       0      -170 170   -170 170
        +y    50      0       0      -100 145    -50 100
        -y     0      0     330      -140 213    -70  70
        -x     0      0      35      -190 190   -180 180
        -y   335      0       0      -125 125   -120  -5
        -x     0      0       0      -360 360   -180 180
              80      0       0      +z +x
        """,
        _DATA_SHEET,
    ),
    "m10ia": _Entry(
        "FANUC",
        """
        +z     0      0       0      -170 170   -170 170
        +y   150      0       0       -90 160    -50 100
        -y     0      0     600      -180 264    -70  75
        -x     0      0     200      -190 190   -180 180
        -y   640      0       0      -190 190   -130  -5
        -x     0      0       0      -360 360   -180 180
             100      0       0      +z +x
        """,
        _DATA_SHEET,
    ),
    "crx10ia": _Entry(
        "FANUC",
        """
        +z     0      0       0      -190 190   -180 180
        +y     0      0       0      -180 180    -50 100
        -y     0      0     540      -285 285    -80  80
        -x     0      0       0      -190 190   -180 180
        -y   540   -150       0      -180 180   -170 -10
        -x   160      0       0      -225 225   -180 180
               0      0       0      +z +x
        """,
        _DATA_SHEET,
    ),
    "gp7": _Entry(
        "Yaskawa",
        """
        +z     0      0       0      -170 170   -170 170
        +y    40      0       0       -65 145    -50 100
        -y     0      0     445       -70 190    -70  75
        -x     0      0      40      -190 190   -180 180
        -y   440      0       0      -135 135   -130  -5
        -x     0      0       0      -360 360   -180 180
              80      0       0      +z +x
        """,
        _DATA_SHEET,
    ),
    "hc10": _Entry(
        "Yaskawa",
        """
        +z     0      0       0      -180 180   -180 180
        +y     0      0       0      -180 180    -50 100
        -y     0      0     700        -5 355     25 165
        +z     0      0    -500      -180 180   -180 180
        -y     0    162       0      -180 180   -170 -10
        +z     0      0       0      -180 180   -180 180
               0      0    -130      +x -z
        """,
        _DATA_SHEET,
    ),
    "tx260": _Entry(
        "Staubli",
        """
        +z     0      0       0      -180 180   -180 180
        +y     0      0       0      -127.5 127.5   -40 100
        +y     0     20     290      -152.5 152.5    10 140
        +z     0      0       0      -270 270   -180 180
        +y     0      0     310      -121 132.5      5 130
        +z     0      0       0      -270 270   -180 180
               0      0      70      +x +z
        """,
        _DATA_SHEET,
    ),
    "rs007n": _Entry(
        "Kawasaki",
        """
        -z     0      0     360      -180 180   -180 180
        -x     0      0       0      -135 135    -40  95
        +x     0      0     355      -155 155   -140 -10
        +z     0      0      92.5    -200 200   -180 180
        +x     0      0     282.5    -125 125      5 125
        +z     0      0       0      -360 360   -180 180
               0      0      78      +x +z
        """,
        _DESCRIPTION,
    ),
    "vs060": _Entry(
        "Denso",
        """
        +z     0      0     345      -170 170   -170 170
        +y     0      0       0      -120 120    -40 100
        +y     0      0     305      -125 155     10 140
        +z   -10      0     164.5    -270 270   -180 180
        +y     0      0     135.5    -120 120      5 120
        +z     0      0       0      -360 360   -180 180
               0      0      70      +x +z
        """,
        _DESCRIPTION,
    ),
    "panda": _Entry(
        "Franka",
        _FRANKA.format("-166 166", "-101 101", "-166 166", "-176 -4", "-166 166", "-1 215", "-166 166"),
        "the maker's published DH parameters",
    ),
    "fr3": _Entry(
        "Franka",
        _FRANKA.format("-157 157", "-102 102", "-166 166", "-174 -8", "-160 160", "31 258", "-172 172"),
        "the maker's published DH parameters",
    ),
    "gen3": _Entry(
        "Kinova",
        """
        -z     0      0     156.43   -360 360   -180 180
        +y     0     -5.375 128.38   -129 129    -30  95
        -z     0     -6.375 210.38   -360 360    -30 -20
        +y     0     -6.375 210.38   -148 148     10 140
        -z     0     -6.375 208.43   -360 360   -180 180
        +y     0     -0.175 105.93   -120 120      5 118
        -z     0     -0.175 105.93   -360 360   -180 180
               0      0      61.525  +x +z
        """,
        _DESCRIPTION + " (7 axes)",
    ),
    "xarm6": _Entry(
        "UFACTORY",
        """
        +z     0      0     267      -360 360   -180 180
        +y     0      0       0      -118 120    -60  80
        +y    53.5    0     284.5    -225  11   -160 -10
        -z    77.5    0    -342.5    -360 360   -180 180
        +y     0      0       0       -97 180      5 130
        -z    76      0     -97      -360 360   -180 180
               0      0       0      +x -z
        """,
        _DESCRIPTION,
    ),
    "xarm7": _Entry(
        "UFACTORY",
        """
        +z     0      0     267      -360 360   -180 180
        +y     0      0       0      -118 120    -60  80
        +z     0      0     293      -360 360     -5   5
        -y    52.5    0       0       -11 225     10 160
        -z    77.5    0    -342.5    -360 360   -180 180
        +y     0      0       0       -97 180      5 130
        -z    76      0     -97      -360 360   -180 180
               0      0       0      +x -z
        """,
        _DESCRIPTION,
    ),
    "m1013": _Entry(
        "Doosan",
        """
        +z     0      0     152.5    -360 360   -180 180
        +y     0     34.5     0      -360 360    -40  95
        +y     0      0     620      -160 160     10 140
        +z     0      0       0      -360 360   -180 180
        +y     0      0     559      -360 360      5 130
        +z     0      0       0      -360 360   -180 180
               0      0     121      +x +z
        """,
        _DESCRIPTION,
    ),
}

# Other names, as `_plain` leaves them.
_ALIASES = {
    "irb12030.6": "irb120",
    "agilus": "kr6r900",
    "kr6r900sixx": "kr6r900",
    "kr6": "kr6r900",
    "kr10": "kr10r1100",
    "kr10r1100sixx": "kr10r1100",
    "lbriiwa7": "iiwa7",
    "lbriiwa7r800": "iiwa7",
    "lbriiwa14": "iiwa14",
    "lbriiwa14r820": "iiwa14",
    "lrmate": "lrmate200id",
    "emikapanda": "panda",
    "emikarobot": "panda",
    "research3": "fr3",
    "gen37dof": "gen3",
}


def arm_names() -> tuple[str, ...]:
    """Names of the arms of the table."""
    return tuple(_TABLE)


def known_arm(name: str) -> KnownArm:
    """Return an arm by its name, with or without its maker's.

    Case, spaces, ``-``, ``_`` and ``/`` do not matter. Raises `InputError` for a name that is not in the table, with
    the nearest ones.
    """
    wanted = _plain(name) if isinstance(name, str) else ""
    names = {known: known for known in _TABLE} | _ALIASES
    names |= {_plain(_TABLE[known].maker) + plain: known for plain, known in names.items()}
    if wanted in names:
        return _read(names[wanted])
    near = list(dict.fromkeys(names[one] for one in difflib.get_close_matches(wanted[:60], names, n=6, cutoff=0.55)))
    hint = f"Did you mean {' or '.join(near[:3])}?" if near else f"Known: {', '.join(_TABLE)}."
    raise InputError(f"No arm of the name {name!r:.60} is known. {hint}")


def _plain(name: str) -> str:
    """``name`` in lower case without spaces and ``-``, ``_``, ``/``."""
    return re.sub(r"[\s_/-]+", "", name).lower()


@functools.lru_cache(maxsize=64)
def _read(name: str) -> KnownArm:
    maker, lines, source = _TABLE[name]
    *rows, flange = [line.split() for line in lines.strip().splitlines()]
    joints, usual = [], []
    for k, (axis, *fields) in enumerate(rows):
        numbers = np.array([float(field) for field in fields])
        low, high, usual_low, usual_high = np.radians(numbers[3:]).tolist()
        joints.append(Joint(f"joint_{k + 1}", REVOLUTE, _placed(np.eye(3), numbers[:3]), _direction(axis), low, high))
        usual.append((max(low, usual_low), min(high, usual_high)))
    x, z = _direction(flange[3]), _direction(flange[4])
    end = _placed(np.stack([x, np.cross(z, x), z], axis=1), np.array([float(field) for field in flange[:3]]))
    ranges = np.array(usual)
    ranges.flags.writeable = False
    return KnownArm(ChainParts(f"{maker} {name}", "base", "tool0", tuple(joints), end), ranges, source)


def _placed(R: Array, position: Array) -> Array:
    """(4, 4) m of a rotation and a position in mm."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, position * 1e-3
    return T


def _direction(axis: str) -> Array:
    """(3,) unit vector of an axis such as ``-y``."""
    out = np.zeros(3)
    out["xyz".index(axis[1])] = 1.0 if axis[0] == "+" else -1.0
    return out
