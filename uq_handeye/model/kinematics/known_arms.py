r"""Nominal kinematics of common arms, by name.

An arm is described (`arms.toml`) in its zero posture, where the axes of all joints are parallel to those of the base:
one line per joint, from base to tip,

    axis    x y z    lower upper    usual lower upper

with the axis and the direction of its positive rotation in the base, the position of the joint frame from that of the
joint before it (mm, axes of the base), the limits of the joint (deg), and the range that it has in ordinary work (deg):
elbow up, tool in front, wrist bent to one side, so that one pose has one posture there; the roll of the elbow of seven
axes has a narrow range. The last line is the flange: its position from the last joint frame, and which axes of the base
its x and z are. Such lines contain the information of Denavit-Hartenberg rows, and the signs and zeros of the joints as
well.

Joint values, base and flange are those of the maker's controller (its tool 0), with these exceptions:

- FANUC: joint 3 is the angle between upper arm and forearm; the controller reports it from the horizontal, that is plus
  joint 2.
- Kawasaki: the direction of the flange's x is a guess (a constant turn of the flange, which X absorbs).
- HC10 and VS-060: the flange is that of the sources in the table. Another public description of each has it turned by
  half a turn about its z, and so has X of a camera on it.
- SO-101: base and tip are ``base_link`` and ``gripper_frame_link`` of the URDF, as in LeRobot. Other versions of the
  URDF have other base and tip frames, and the zero of the last joint 2.8 deg away. The limits are wider than its own,
  since a calibration by hand may go beyond them.
- The origin of the base is on joint axis 1; FANUC, Yaskawa and Staubli have it at the height of joint 2.

The numbers are nominal: those of data sheets and of the robot descriptions that makers and ROS-Industrial publish. A
controller that has the calibrated numbers of its arm (UR, calibrated ABB) differs by up to some mm.
"""

from __future__ import annotations

import difflib
import functools
import re
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array
from ...errors import InputError
from .joint import REVOLUTE, ChainParts, Joint


class KnownArm(NamedTuple):
    """An arm of the table."""

    parts: ChainParts
    usual: Array  # (L, 2) range of each joint in ordinary work, rad
    source: str


@functools.cache
def _table() -> dict[str, dict[str, Any]]:
    """Maker, source and lines of each arm, and its other names as `_plain` leaves them."""
    return tomllib.loads(Path(__file__).with_name("arms.toml").read_text(encoding="utf-8"))


def arm_names() -> tuple[str, ...]:
    """Names of the arms of the table."""
    return tuple(_table())


def known_arm(name: str) -> KnownArm:
    """Return an arm by its name, with or without its maker's.

    Case, spaces, ``-``, ``_`` and ``/`` do not matter. Raises `InputError` for a name that is not in the table, with
    the nearest ones.
    """
    wanted, names = _plain(name) if isinstance(name, str) else "", _names()
    if wanted in names:
        return _read(names[wanted])
    near = list(dict.fromkeys(names[one] for one in difflib.get_close_matches(wanted[:60], names, n=6, cutoff=0.55)))
    hint = f"Similar: {', '.join(near[:3])}" if near else f"Known: {', '.join(_table())}"
    raise InputError(
        f"No arm of the name {name!r:.60} is known. {hint}. Variants of an arm have other lengths: give those of yours "
        "(--urdf, --dh)."
    )


def maker_of(chain: str) -> str | None:
    """Return the maker of an arm of the table by the name of its chain (`known_arm`); None for other chains."""
    of = _entry(chain)
    return None if of is None else str(of["maker"])


def about_flange(chain: str) -> str:
    """Return what is open about the flange of an arm of the table, by the name of its chain, as a sentence, or ""."""
    return str((_entry(chain) or {}).get("about_flange", ""))


def _entry(chain: str) -> dict[str, Any] | None:
    return next((of for name, of in _table().items() if chain == f"{of['maker']} {name}"), None)


@functools.cache
def _names() -> dict[str, str]:
    """Names of the table by all names of the arms, with and without the maker's, as `_plain` leaves them."""
    table = _table()
    names = {plain: known for known, of in table.items() for plain in (_plain(known), *of.get("other_names", ()))}
    return names | {_plain(table[known]["maker"]) + plain: known for plain, known in names.items()}


def _plain(name: str) -> str:
    """``name`` in lower case without spaces and ``-``, ``_``, ``/``."""
    return re.sub(r"[\s_/-]+", "", name).lower()


@functools.lru_cache(maxsize=64)
def _read(name: str) -> KnownArm:
    of = _table()[name]
    *rows, flange = [line.split() for line in of["lines"].strip().splitlines()]
    joints, usual = [], []
    for k, (axis, *fields) in enumerate(rows):
        numbers = np.array([float(field) for field in fields])
        low, high, usual_low, usual_high = np.radians(numbers[3:]).tolist()
        joints.append(Joint(f"joint_{k + 1}", REVOLUTE, _placed(np.eye(3), numbers[:3]), _direction(axis), low, high))
        usual.append((max(low, usual_low), min(high, usual_high)))
    x, z = _direction(flange[3]), _direction(flange[4])
    end = _placed(np.stack([x, np.cross(z, x), z], axis=1), np.array([float(field) for field in flange[:3]]))
    if (angle := of.get("flange_at")) is not None:
        end = _placed(Rotation.from_rotvec(-np.radians(angle) * joints[-1].axis).as_matrix(), np.zeros(3)) @ end
    ranges = np.array(usual)
    ranges.flags.writeable = False
    return KnownArm(ChainParts(f"{of['maker']} {name}", "base", "tool0", tuple(joints), end), ranges, of["source"])


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
